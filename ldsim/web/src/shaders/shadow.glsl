uniform mat4 light; // the lamp's projection
uniform highp sampler2DShadow shadows;
// How much of the lamp reaches a point, 0 … 1: nine samples, each of which is interpolated.
float lit(vec3 world) {
  vec3 at = 0.5 + 0.5 * (light * vec4(world, 1.0)).xyz;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float total = 0.0, apart = 1.5 / float(textureSize(shadows, 0).x);
  for (int i = -1; i <= 1; i++) for (int j = -1; j <= 1; j++) {
    total += texture(shadows, vec3(at.xy + apart * vec2(i, j), at.z));
  }
  return total / 9.0;
}
