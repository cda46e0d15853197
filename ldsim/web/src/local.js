// The model inside the page, in the place of a server: obeys the page, steps at the pace of time, and hands out frames.

import { decoded, readSafetensors } from "./arrays.js";
import { everyPicture } from "./dom.js";
import { basisOf, held, spaceOf, springOn } from "./model.js";
import { Stepper } from "./stepping.js";
import { inner, minus } from "./vector.js";

const BUDGET_MS = 24; // of stepping in one picture, so that the page stays responsive where steps are slow
const PATIENCE = 20; // steps in a row that may be lost before the solid starts again

/** Rows of a table, of which the first k columns. */
function taken({ data, shape }, rows, k) {
  const out = new Float32Array(rows.length * k), columns = shape.at(-1);
  rows.forEach((row, i) => out.set(data.subarray(row * columns, row * columns + k), i * k));
  return out;
}

export class Local {
  /** about: what Python says of the solid; packed: the model as safetensors in base64 (ldsim/export/playground.py). */
  constructor(about, packed) {
    const arrays = readSafetensors(decoded(packed)), { vertices, movable, surface_triangles: triangles } = arrays;
    const surface = Array.from(new Set(triangles.data)).sort((a, b) => a - b); // the vertices on the surface
    const number = new Map(surface.map((v, i) => [v, i])), coordinates = surface.flatMap((v) => [3 * v, 3 * v + 1, 3 * v + 2]);
    Object.assign(this, { arrays, h: arrays.time_step.data[0], radius: arrays.pull_radius.data[0], pulls: new Map() });
    this.look = { gravity: Array.from(arrays.gravity.data), stiffness: 1, speed: 1, paused: false, colour: "plain" };
    this.steppers = {};
    this.blocks = {};
    for (const space of ["latent", "linear"]) {
      const model = spaceOf(arrays, space);
      this.steppers[space] = new Stepper(model, this.h);
      this.blocks[space] = { space, k: model.k, basis: taken(basisOf(arrays, space), coordinates, model.k) };
    }
    this.block = {
      ...about,
      mode: "local",
      gravity: this.look.gravity,
      rest: taken(vertices, surface, 3),
      triangles: Uint32Array.from(triangles.data, (v) => number.get(v)),
      pinned: Uint32Array.from(surface, (v) => 1 - movable.data[v]),
    };
    Object.assign(this, { owed: 0, number: 0, seconds: 0, share: 1, failures: 0 });
    this.spaces(["latent"]);
  }

  solid = async () => this.block;
  space = async (name) => this.blocks[name];

  /** Steps from now on; handlers as those of Link. */
  connect(handlers) {
    this.handlers = handlers;
    handlers.status(this.status());
    everyPicture((elapsed) => {
      if (!this.look.paused) this.advance(elapsed * this.look.speed, elapsed);
      this.handlers.frame(this.frame());
      return true;
    });
  }

  send(kind, { value, ...values } = {}) {
    const name = kind === "pause" ? "paused" : kind;
    if (name in this.look) this.look[name] = value;
    else this[kind](value ?? values);
    if (kind === "gravity" || kind === "stiffness") this.condition();
    if (!["grab", "move", "release"].includes(kind)) this.handlers.status(this.status());
  }

  status() {
    const offered = Object.keys(this.steppers);
    return { ...this.look, kind: "status", offered, spaces: this.shown.map(({ space }) => space.name), recorder: null };
  }

  // The clock

  /** Steps as many times as `seconds` of the solid's time ask for and the budget allows. */
  advance(seconds, elapsed) {
    this.owed += seconds;
    const deadline = performance.now() + BUDGET_MS;
    let stepped = 0;
    for (; this.owed >= this.h && performance.now() < deadline; stepped++, this.owed -= this.h) this.stepOnce();
    const behind = this.owed >= this.h;
    if (behind) this.owed = 0; // what cannot be caught up is dropped: the solid moves slower than the clock
    if (elapsed) this.share = 0.95 * this.share + 0.05 * (behind ? (stepped * this.h) / elapsed : this.look.speed);
  }

  stepOnce() {
    let lost = false;
    this.shown.forEach((stepper, i) => {
      const before = performance.now(), record = stepper.step(), taken = performance.now() - before;
      this.records[i] = { ...record, milliseconds: 0.9 * (this.records[i]?.milliseconds ?? taken) + 0.1 * taken };
      lost ||= record.lost || !stepper.q.every(Number.isFinite);
    });
    this.seconds += this.h;
    this.failures = lost ? this.failures + 1 : 0;
    if (this.failures <= PATIENCE) return;
    this.reset();
    this.handlers.notice({ text: "The pull turned a part of the solid inside out. It starts again from rest." });
  }

  frame() {
    this.number += 1;
    const idle = { milliseconds: 0, iterations: 0, evaluations: 0, converged: true };
    const spaces = this.shown.map(({ q }, i) => {
      const { converged, lost, ...record } = this.records[i] ?? idle;
      return { ...record, q: Float32Array.from(q), outcome: lost ? 3 : converged ? 0 : 1, troubled: 0, novelty: NaN };
    });
    const grabs = Array.from(this.pulls, ([id, { target, springs }]) => {
      return { id, target, centroids: springs.flatMap((spring, i) => this.centroid(spring, this.shown[i].q)) };
    });
    return { number: this.number, seconds: this.seconds, share: this.share, paused: this.look.paused, spaces, grabs };
  }

  centroid({ centre, B }, q) {
    return [0, 1, 2].map((axis) => centre[axis] + inner(B[axis], q));
  }

  // What the page says, one method a message

  /** Takes hold around `point`, at rest; a pinned part is not held, and nothing is pulled. */
  grab({ id, point, target }) {
    const { vertices, movable, pull_stiffness: stiffness } = this.arrays;
    const found = held(vertices.data, movable.data, point, this.radius);
    if (!found.length) return;
    const springs = this.shown.map(({ space, q }) => {
      const spring = springOn(vertices, basisOf(this.arrays, space.name), found, stiffness.data[0], space.k);
      spring.grip = this.centroid(spring, q);
      return spring;
    });
    this.pulls.set(id, { held: found, start: target, target, springs });
    this.move({ id, target });
    this.springsChanged();
  }

  /** What is held follows the target from where it was: taking hold alone moves nothing. */
  move({ id, target }) {
    const pull = this.pulls.get(id);
    if (!pull) return;
    pull.target = target;
    const way = minus(target, pull.start);
    for (const { target, grip } of pull.springs) for (let i = 0; i < 3; i++) target[i] = grip[i] + way[i];
  }

  release({ id }) {
    this.pulls.delete(id);
    this.springsChanged();
  }

  springsChanged() {
    this.shown.forEach((stepper, i) => {
      stepper.potential.springs = Array.from(this.pulls.values(), ({ springs }) => springs[i]);
      stepper.renew();
    });
  }

  /** Gravity and stiffness act from the next step on. */
  condition() {
    for (const stepper of this.shown) {
      stepper.potential.stiffer = this.look.stiffness;
      stepper.potential.setGravity(this.look.gravity);
      stepper.renew();
    }
  }

  step() {
    this.look.paused = true;
    this.stepOnce();
  }

  reset() {
    this.pulls.clear();
    this.springsChanged();
    for (const stepper of this.shown) stepper.reset();
    Object.assign(this, { records: [], failures: 0, owed: 0, seconds: 0 });
  }

  spaces(names) {
    this.shown = names.map((name) => this.steppers[name]);
    this.reset();
    this.condition();
  }
}
