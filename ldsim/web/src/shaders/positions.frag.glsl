// x + U q of one vertex, and the length of U q.
uniform highp sampler2D rest, basis, q;
uniform int width, count, columns;
out vec4 result;
vec4 texel(highp sampler2D source, int i) {
  int width = textureSize(source, 0).x;
  return texelFetch(source, ivec2(i % width, i / width), 0);
}
void main() {
  int i = int(gl_FragCoord.y) * width + int(gl_FragCoord.x);
  if (i >= count) discard;
  vec3 u = vec3(0.0);
  for (int j = 0; j < columns; j++) u += texel(basis, i * columns + j).xyz * texel(q, j).x;
  result = vec4(texel(rest, i).xyz + u, length(u));
}
