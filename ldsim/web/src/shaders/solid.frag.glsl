uniform vec3 eye, lamp, base, stops[4]; // stops: the colours of tints 0, 1/3, 2/3, 1
uniform float ramp, opacity, bias;      // ramp: 1 to colour by the tint, 0 for the base colour
in vec3 worldPosition, worldNormal;
in float mixed, held;
out vec4 colour;
void main() {
  vec3 n = normalize(worldNormal), towards = normalize(eye - worldPosition);
  float light = lit(worldPosition + sign(dot(n, lamp)) * bias * n);
  if (dot(n, towards) < 0.0) n = -n;
  float sky = 0.5 + 0.5 * n.y, key = light * max(dot(n, lamp), 0.0);
  float gleam = light * pow(max(dot(n, normalize(lamp + towards)), 0.0), 42.0) * 0.22;
  float rim = pow(1.0 - max(dot(n, towards), 0.0), 3.0) * 0.16;
  float at = 3.0 * clamp(mixed, 0.0, 1.0);
  vec3 low = mix(stops[0], stops[1], min(at, 1.0)), high = mix(stops[2], stops[3], max(at - 2.0, 0.0));
  vec3 own = ramp > 0.5 ? mix(low, high, clamp(at - 1.0, 0.0, 1.0)) : base;
  own = mix(own, vec3(0.13, 0.14, 0.16), 0.7 * smoothstep(0.6, 1.0, held)); // what is pinned is dark
  own *= 0.88; // leaves room for light on the palest colour
  colour = vec4(own * (0.42 + 0.24 * sky + 0.56 * key) + gleam + rim * sky, 1.0) * opacity;
}
