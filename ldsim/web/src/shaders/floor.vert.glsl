// A square on the floor around the middle of what is seen.
uniform mat4 project;
uniform vec3 middle;
uniform float reach;
out vec3 worldPosition;
void main() {
  vec2 corner = vec2(gl_VertexID % 2, gl_VertexID / 2) * 2.0 - 1.0;
  worldPosition = middle + reach * vec3(corner.x, 0.0, corner.y);
  gl_Position = project * vec4(worldPosition, 1.0);
}
