uniform vec4 shade, grid; // colours with their opacity
uniform vec3 middle;
uniform float reach, cell;
in vec3 worldPosition;
out vec4 colour;
void main() {
  vec2 from = worldPosition.xz - middle.xz, cells = from / cell;
  vec2 line = abs(fract(cells - 0.5) - 0.5) / fwidth(cells);
  vec2 thin = fwidth(cells);
  float far = 5.0 * length(from) / reach;
  float ink = grid.a * (1.0 - min(min(line.x, line.y), 1.0)) * exp(-far * far) * clamp(0.3 / max(thin.x, thin.y), 0.0, 1.0);
  float dark = shade.a * (1.0 - lit(worldPosition));
  colour = mix(vec4(shade.rgb * dark, dark), vec4(grid.rgb, 1.0), ink);
}
