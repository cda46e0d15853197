uniform mat4 project, turn;
uniform vec3 offset;
uniform float size; // of a point one metre away, pixels
layout(location = 0) in vec3 position;
void main() {
  gl_Position = project * (turn * vec4(position, 1.0) + vec4(offset, 0.0));
  gl_PointSize = size / gl_Position.w;
}
