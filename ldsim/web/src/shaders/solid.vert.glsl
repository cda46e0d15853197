// A surface in the world, seen by a camera or, for its shadow, by the lamp.
uniform mat4 project, turn;
uniform vec3 offset; // of this body, in the world
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float tint;
layout(location = 3) in float pinned;
layout(location = 4) in float vertex; // of which this one is a copy
out vec3 worldPosition, worldNormal;
out float mixed, held;
#ifdef DECODED
uniform highp sampler2D decodedPositions, decodedNormals;
uniform float displacements; // what to multiply the displacement by for the tint, or 0 for that of the attribute
vec4 texel(highp sampler2D source, int i) {
  int width = textureSize(source, 0).x;
  return texelFetch(source, ivec2(i % width, i / width), 0);
}
#endif
void main() {
  mixed = tint;
#ifdef DECODED
  vec4 decoded = texel(decodedPositions, int(vertex + 0.5));
  vec3 x = decoded.xyz, n = texel(decodedNormals, gl_VertexID).xyz;
  if (displacements > 0.0) mixed = displacements * decoded.w;
#else
  vec3 x = position, n = normal;
#endif
  vec4 world = turn * vec4(x, 1.0) + vec4(offset, 0.0);
  worldPosition = world.xyz;
  worldNormal = mat3(turn) * n;
  held = pinned;
  gl_Position = project * world;
}
