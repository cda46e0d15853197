uniform vec3 base;
out vec4 colour;
void main() {
  vec2 at = 2.0 * gl_PointCoord - 1.0;
  float square = dot(at, at);
  if (square > 1.0) discard;
  colour = vec4(base * (0.55 + 0.45 * dot(vec3(at.x, -at.y, sqrt(1.0 - square)), vec3(-0.3, 0.72, 0.62))), 1.0);
}
