// Draws a moving surface with WebGL 2: a lit solid and its shadow on a floor, seen by a camera that orbits. The surface
// may be drawn several times, at other positions, in parts of one canvas.

import { cross, dot, normalised } from "./surface.js";

const VERTEX = `#version 300 es
uniform mat4 project, turn;
uniform float flat_at;   // height of the floor where the shadow is drawn, or a huge number for the surface itself
uniform vec3 lamp;
in vec3 position, normal;
in float tint;
out vec3 world_normal, world_position;
out float mixed;
void main() {
  vec4 world = turn * vec4(position, 1.0);
  if (flat_at < 1e20) world.xyz -= lamp * (world.y - flat_at) / lamp.y;
  world_normal = mat3(turn) * normal;
  world_position = world.xyz;
  mixed = tint;
  gl_Position = project * world;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 eye, lamp, stops[4]; // stops: the colours of tints 0, 1/3, 2/3, 1
uniform vec4 shade;      // the shadow's colour, or alpha 0 for the surface itself
in vec3 world_normal, world_position;
in float mixed;
out vec4 colour;
void main() {
  if (shade.a > 0.0) { colour = vec4(shade.rgb * shade.a, shade.a); return; }
  vec3 n = normalize(world_normal), towards = normalize(eye - world_position);
  if (dot(n, towards) < 0.0) n = -n;
  float sky = 0.5 + 0.5 * n.y, key = max(dot(n, lamp), 0.0);
  float gleam = pow(max(dot(n, normalize(lamp + towards)), 0.0), 42.0) * 0.22;
  float rim = pow(1.0 - max(dot(n, towards), 0.0), 3.0) * 0.16;
  float at = 3.0 * clamp(mixed, 0.0, 1.0);
  vec3 base = mix(mix(stops[0], stops[1], min(at, 1.0)), mix(stops[2], stops[3], max(at - 2.0, 0.0)), clamp(at - 1.0, 0.0, 1.0));
  colour = vec4(base * (0.42 + 0.24 * sky + 0.56 * key) + gleam + rim * sky, 1.0);
}`;
const LAMP = normalised([-0.3, 0.72, 0.62]);

export class View {
  /** up: the rotation (9, row by row) that turns the model's up to y. */
  constructor(canvas, surface, up, azimuth, elevation) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, stencil: true, premultipliedAlpha: true });
    if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer or has switched off.");
    this.canvas = canvas;
    this.gl = gl;
    this.surface = surface;
    this.up = up;
    this.frameSurface(azimuth, elevation);
    this.program = this.link();
    const at = (name) => gl.getUniformLocation(this.program, name);
    this.uniforms = Object.fromEntries(
      ["project", "turn", "flat_at", "lamp", "eye", "stops", "shade"].map((name) => [name, at(name)]),
    );
    this.positions = this.attribute("position", 3, surface.drawn, gl.DYNAMIC_DRAW);
    this.normals = this.attribute("normal", 3, surface.normals, gl.DYNAMIC_DRAW);
    this.tints = this.attribute("tint", 1, surface.drawnTints, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, surface.corners, gl.STATIC_DRAW);
  }

  /** Sets the camera so that the surface at rest, with room to swing, fills the picture. */
  frameSurface(azimuth, elevation) {
    const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
    const { rest } = this.surface;
    for (let v = 0; v < rest.length; v += 3) {
      const x = this.toWorld(rest.subarray(v, v + 3));
      for (let i = 0; i < 3; i++) {
        low[i] = Math.min(low[i], x[i]);
        high[i] = Math.max(high[i], x[i]);
      }
    }
    const diagonal = Math.hypot(...high.map((x, i) => x - low[i]));
    this.frameBox([low[0], low[1] - 0.22 * diagonal, low[2]], [high[0], high[1] + 0.08 * diagonal, high[2]], diagonal);
    this.home = { ...this.home, azimuth, elevation };
    this.reset();
  }

  /** Sets the camera so that the box between two corners fills the picture, with the floor at its foot. */
  frameBox(low, high, diagonal = 0.66 * Math.hypot(...high.map((x, i) => x - low[i]))) {
    this.diagonal = diagonal;
    this.home = { ...this.home, zoom: 1, centre: low.map((x, i) => (x + high[i]) / 2) };
    this.floor = low[1];
    this.reset();
  }

  reset() {
    Object.assign(this, this.home, { centre: [...this.home.centre] });
  }

  toWorld(x) {
    const R = this.up;
    return [0, 3, 6].map((i) => R[i] * x[0] + R[i + 1] * x[1] + R[i + 2] * x[2]);
  }

  toModel(x) {
    const R = this.up;
    return [0, 1, 2].map((i) => R[i] * x[0] + R[i + 3] * x[1] + R[i + 6] * x[2]);
  }

  link() {
    const gl = this.gl, program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "shader");
    gl.useProgram(program);
    return program;
  }

  attribute(name, size, values, usage) {
    const gl = this.gl, buffer = gl.createBuffer(), place = gl.getAttribLocation(this.program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, usage);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    return buffer;
  }

  /** The camera's axes right, up and out of the screen, its eye, and the tangents of half the field of view. */
  camera() {
    const a = (this.azimuth * Math.PI) / 180, e = (this.elevation * Math.PI) / 180;
    const out = [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
    const right = [Math.cos(a), 0, -Math.sin(a)], up = cross(out, right);
    const { width, height } = this.box;
    const narrow = 0.3, aspect = width / Math.max(height, 1);
    const half = { x: aspect < 1 ? narrow : narrow * aspect, y: aspect < 1 ? narrow / aspect : narrow };
    const distance = (0.56 * this.diagonal) / narrow / this.zoom;
    const eye = this.centre.map((x, i) => x + distance * out[i]);
    return { right, up, out, eye, half, distance };
  }

  projection({ right, up, out, eye, half, distance }) {
    const near = distance * 0.02, far = distance + 12 * this.diagonal;
    const c = -(far + near) / (far - near), d = (-2 * far * near) / (far - near);
    const rows = [
      [...right.map((x) => x / half.x), -dot(right, eye) / half.x],
      [...up.map((x) => x / half.y), -dot(up, eye) / half.y],
      [...out.map((x) => x * c), -dot(out, eye) * c + d],
      [...out.map((x) => -x), dot(out, eye)],
    ];
    return new Float32Array([0, 1, 2, 3].flatMap((j) => rows.map((row) => row[j])));
  }

  /** The part of the canvas that is drawn to, CSS pixels from its lower left corner. */
  get box() {
    return this.part ?? { left: 0, bottom: 0, width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  /** Draws the surface as last refreshed onto the whole canvas; stops and shadow as in the shaders. */
  draw(colours) {
    this.part = null;
    this.clear();
    this.drawPart(colours);
  }

  clear() {
    const { gl, canvas } = this;
    const width = Math.round(canvas.clientWidth * this.dots), height = Math.round(canvas.clientHeight * this.dots);
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  }

  /** Device pixels in a CSS pixel. */
  get dots() {
    return Math.min(window.devicePixelRatio || 1, 2);
  }

  /** Draws the surface as last refreshed into `box`. */
  drawPart(colours) {
    const { gl, surface, uniforms, dots, box } = this;
    gl.viewport(...[box.left, box.bottom, box.width, box.height].map((x) => Math.round(x * dots)));
    const changed = [[this.positions, surface.drawn], [this.normals, surface.normals], [this.tints, surface.drawnTints]];
    for (const [buffer, values] of changed) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
    }
    const camera = this.camera(), R = this.up;
    gl.uniformMatrix4fv(uniforms.project, false, this.projection(camera));
    gl.uniformMatrix4fv(uniforms.turn, false, [R[0], R[3], R[6], 0, R[1], R[4], R[7], 0, R[2], R[5], R[8], 0, 0, 0, 0, 1]);
    gl.uniform3fv(uniforms.lamp, LAMP);
    gl.uniform3fv(uniforms.eye, camera.eye);
    gl.uniform3fv(uniforms.stops, colours.stops.flat());
    this.drawShadow(colours.shadow);
    gl.uniform1f(uniforms.flat_at, 1e30);
    gl.uniform4fv(uniforms.shade, [0, 0, 0, 0]);
    gl.enable(gl.DEPTH_TEST);
    gl.drawElements(gl.TRIANGLES, surface.corners.length, gl.UNSIGNED_INT, 0);
  }

  /** The surface flattened along the lamp's rays onto the floor, every pixel once. */
  drawShadow(colour) {
    const { gl, uniforms } = this;
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.uniform1f(uniforms.flat_at, this.floor);
    gl.uniform4fv(uniforms.shade, colour);
    gl.drawElements(gl.TRIANGLES, this.surface.corners.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.BLEND);
  }

  /** The ray through a point of the part that is drawn to, CSS pixels, in the model's coordinates. */
  ray(x, y) {
    const { right, up, out, eye, half } = this.camera();
    const { width, height } = this.box, sx = ((2 * x) / width - 1) * half.x, sy = (1 - (2 * y) / height) * half.y;
    const direction = normalised([0, 1, 2].map((i) => right[i] * sx + up[i] * sy - out[i]));
    return { origin: this.toModel(eye), direction: this.toModel(direction), out: this.toModel(out) };
  }

  /** Where a point of the model is on that part, CSS pixels. */
  toScreen(point) {
    const { right, up, out, eye, half } = this.camera(), from = this.toWorld(point).map((x, i) => x - eye[i]);
    const depth = -dot(out, from);
    const x = dot(right, from) / depth / half.x, y = dot(up, from) / depth / half.y;
    return [((x + 1) / 2) * this.box.width, ((1 - y) / 2) * this.box.height];
  }

  orbit(dx, dy) {
    this.azimuth -= dx * 0.4;
    this.elevation = Math.min(89, Math.max(-89, this.elevation + dy * 0.4));
  }

  pan(dx, dy) {
    const { right, up, half, distance } = this.camera(), scale = (2 * half.y * distance) / this.box.height;
    for (let i = 0; i < 3; i++) this.centre[i] += scale * (up[i] * dy - right[i] * dx);
  }

  zoomBy(factor) {
    this.zoom = Math.min(20, Math.max(0.2, this.zoom * factor));
  }
}
