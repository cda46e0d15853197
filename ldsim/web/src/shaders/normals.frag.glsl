// The normal of one copy of a vertex: the sum over its triangles, of which `pairs` names the two other corners.
uniform highp sampler2D positions, pairs, ranges;
uniform int width, count;
out vec4 result;
vec4 texel(highp sampler2D source, int i) {
  int width = textureSize(source, 0).x;
  return texelFetch(source, ivec2(i % width, i / width), 0);
}
vec3 at(float vertex) { return texel(positions, int(vertex + 0.5)).xyz; }
void main() {
  int i = int(gl_FragCoord.y) * width + int(gl_FragCoord.x);
  if (i >= count) discard;
  vec3 range = texel(ranges, i).xyz, x = at(range.z), normal = vec3(0.0);
  for (int p = int(range.x); p < int(range.y); p++) {
    vec2 pair = texel(pairs, p).xy;
    normal += cross(at(pair.x) - x, at(pair.y) - x);
  }
  result = vec4(normal, 0.0);
}
