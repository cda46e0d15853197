// A camera that orbits. The world is the model turned so that up is y; places on the page are CSS pixels.

import { along, cross, dot, minus, normalised } from "./vector.js";

const NARROW = 0.3; // tangent of half the field of view, along the shorter side

/** A matrix of four rows as shaders take it. */
const columns = (rows) => new Float32Array([0, 1, 2, 3].flatMap((j) => rows.map((row) => row[j])));

export class Camera {
  /** canvas: what is drawn to; up: the rotation (9, row by row) from model to world; angles in degrees. */
  constructor(canvas, up, azimuth, elevation) {
    this.canvas = canvas;
    this.up = up;
    this.home = { azimuth, elevation, zoom: 1 };
    this.part = null; // of the canvas, from its lower left corner: { left, bottom, width, height }; null for all of it
    this.covered = 0; // pixels at the right of the part that something lies over
  }

  /** What is looked at: a ball around `centre`, in the world, and as much again to both sides as `span`. */
  frame(centre, diagonal, span = 0) {
    Object.assign(this, { diagonal, span });
    this.home.centre = centre;
    this.reset();
  }

  reset() {
    Object.assign(this, this.home, { centre: [...this.home.centre] });
  }

  get box() {
    return this.part ?? { left: 0, bottom: 0, width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  toWorld(x) {
    const R = this.up;
    return [0, 3, 6].map((i) => R[i] * x[0] + R[i + 1] * x[1] + R[i + 2] * x[2]);
  }

  toModel(x) {
    const R = this.up;
    return [0, 1, 2].map((i) => R[i] * x[0] + R[i + 3] * x[1] + R[i + 6] * x[2]);
  }

  get turn() {
    const R = this.up;
    return [R[0], R[3], R[6], 0, R[1], R[4], R[7], 0, R[2], R[5], R[8], 0, 0, 0, 0, 1];
  }

  /** The axes right, up and out of the screen, the eye, and the tangents of half the field of view of the whole part. */
  view() {
    const a = (this.azimuth * Math.PI) / 180, e = (this.elevation * Math.PI) / 180;
    const out = [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
    const right = [Math.cos(a), 0, -Math.sin(a)], up = cross(out, right);
    const { width, height } = this.box, free = Math.max(width - this.covered, 1), aspect = free / Math.max(height, 1);
    const x = aspect < 1 ? NARROW : NARROW * aspect, y = aspect < 1 ? NARROW / aspect : NARROW;
    const ball = 0.56 * this.diagonal, distance = Math.max((ball + this.span) / x, ball / y) / this.zoom;
    const half = { x: (x * width) / free, y };
    return { right, up, out, eye: along(this.centre, distance, out), half, distance, shift: -this.covered / width };
  }

  /** The matrix from the world to the part, column by column. */
  projection() {
    const { right, up, out, eye, half, distance, shift } = this.view();
    const near = distance * 0.02, far = distance + 12 * (this.diagonal + this.span);
    const c = -(far + near) / (far - near), d = (-2 * far * near) / (far - near);
    const w = [...out.map((x) => -x), dot(out, eye)];
    const rows = [
      [...right, -dot(right, eye)].map((x, i) => x / half.x + shift * w[i]),
      [...up, -dot(up, eye)].map((x) => x / half.y),
      [...out.map((x) => x * c), -dot(out, eye) * c + d],
      w,
    ];
    return columns(rows);
  }

  /** The ray through a point of the part, in the model's coordinates, and the direction out of the screen. */
  ray(x, y) {
    const { right, up, out, eye, half, shift } = this.view(), { width, height } = this.box;
    const sx = ((2 * x) / width - 1 - shift) * half.x, sy = (1 - (2 * y) / height) * half.y;
    const direction = normalised([0, 1, 2].map((i) => right[i] * sx + up[i] * sy - out[i]));
    return { origin: this.toModel(eye), direction: this.toModel(direction), out: this.toModel(out) };
  }

  /** Where a point of the model is on the part, for a body that stands at `offset` in the world. */
  toScreen(point, offset = [0, 0, 0]) {
    const { right, up, out, eye, half, shift } = this.view();
    const from = minus(along(this.toWorld(point), 1, offset), eye), depth = -dot(out, from), { width, height } = this.box;
    const x = dot(right, from) / depth / half.x + shift, y = dot(up, from) / depth / half.y;
    return [((x + 1) / 2) * width, ((1 - y) / 2) * height];
  }

  orbit(dx, dy) {
    this.azimuth -= dx * 0.4;
    this.elevation = Math.min(89, Math.max(-89, this.elevation + dy * 0.4));
  }

  pan(dx, dy) {
    const { right, up, half, distance } = this.view(), scale = (2 * half.y * distance) / this.box.height;
    for (let i = 0; i < 3; i++) this.centre[i] += scale * (up[i] * dy - right[i] * dx);
  }

  zoomBy(factor) {
    this.zoom = Math.min(20, Math.max(0.2, this.zoom * factor));
  }
}

/** The matrix of a lamp far away, column by column: it lights a ball of the world around `centre`. */
export function lampProjection(lamp, centre, reach) {
  const right = normalised(cross([0, 1, 0], lamp)), up = cross(lamp, right), deep = 6 * reach;
  const rows = [[right, reach], [up, reach], [lamp, -deep]].map(([axis, size]) => [...axis, -dot(axis, centre)].map((x) => x / size));
  return columns([...rows, [0, 0, 0, 1]]);
}

/** The pointers on a canvas that turn the view: one orbits, two zoom and, where `pans`, shift. */
export class Fingers {
  constructor(camera, pans) {
    this.camera = camera;
    this.pans = pans;
    this.places = new Map(); // pointer → its last place
  }

  down({ pointerId, offsetX, offsetY }) {
    this.camera.canvas.setPointerCapture(pointerId);
    this.places.set(pointerId, [offsetX, offsetY]);
  }

  up({ pointerId }) {
    this.places.delete(pointerId);
  }

  /** Whether the pointer turned the view. */
  move(event) {
    const old = this.places.get(event.pointerId), { camera } = this;
    if (!old) return false;
    const now = [event.offsetX, event.offsetY], [dx, dy] = [now[0] - old[0], now[1] - old[1]];
    this.places.set(event.pointerId, now);
    const other = [...this.places].find(([id]) => id !== event.pointerId)?.[1];
    const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    if (other) camera.zoomBy(apart(now) / apart(old));
    if (this.pans && (other || event.shiftKey || event.buttons === 2 || event.buttons === 4)) {
      camera.pan(dx / (other ? 2 : 1), dy / (other ? 2 : 1));
    } else camera.orbit(dx / (other ? 2 : 1), dy / (other ? 2 : 1));
    return true;
  }

  wheel(event) {
    event.preventDefault();
    this.camera.zoomBy(Math.exp(-0.0012 * event.deltaY));
  }
}
