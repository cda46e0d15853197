// The model inside the page, in the place of a server: obeys the page, steps at the pace of time, and hands out frames.

import { decoded } from "./arrays.js";
import { everyPicture } from "./dom.js";
import { Model, Solid, runtimeOf } from "./solid.js";
import { minus } from "./vector.js";

const BUDGET_MS = 24; // of stepping in one picture, so that the page stays responsive where steps are slow
const PATIENCE = 20; // steps in a row that may be lost before the solid starts again

const HELD = 3; // an outcome of ldsim_step
const MOST = 16; // pulls at once
const POSES = 50; // kept for undo

export class Local {
  /** about: what Python says of the solid; packed: the library and the models in base64 (ldsim/export/playground.py). */
  static async open(about, packed) {
    const bytes = (name) => new Uint8Array(decoded(packed[name]));
    const runtime = await runtimeOf(bytes("runtime"));
    return new Local(about, Object.fromEntries(["latent", "linear"].map((name) => [name, new Model(runtime, bytes(name))])));
  }

  constructor(about, models) {
    const { rest, movable, triangles, timeStep, gravity } = models.latent;
    const surface = Array.from(new Set(triangles)).sort((a, b) => a - b); // the vertices on the surface
    const number = new Map(surface.map((v, i) => [v, i]));
    Object.assign(this, { models, h: timeStep, pull: about.pull, pulls: new Map(), poses: [] });
    this.look = { gravity, stiffness: 1, speed: 1, paused: false, colour: "plain" };
    this.solids = {};
    this.blocks = {};
    for (const [space, model] of Object.entries(models)) {
      this.solids[space] = new Solid(model, MOST);
      this.blocks[space] = { space, k: model.features, basis: model.fields(surface) };
    }
    this.block = {
      ...about,
      mode: "local",
      gravity,
      rest: Float32Array.from(surface.flatMap((v) => Array.from(rest.slice(3 * v, 3 * v + 3)))),
      triangles: Uint32Array.from(triangles, (v) => number.get(v)),
      pinned: Uint32Array.from(surface, (v) => 1 - movable[v]),
    };
    Object.assign(this, { owed: 0, number: 0, seconds: 0, share: 1, failures: 0, records: [] });
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
    return { ...this.look, kind: "status", offered: Object.keys(this.solids), spaces: this.names, recorder: null, player: null };
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
    let held = false;
    this.shown.forEach((solid, i) => {
      const before = performance.now(), record = solid.step(), taken = performance.now() - before;
      this.records[i] = { ...record, milliseconds: 0.9 * (this.records[i]?.milliseconds ?? taken) + 0.1 * taken };
      held ||= record.outcome === HELD;
    });
    this.seconds += this.h;
    this.failures = held ? this.failures + 1 : 0;
    if (this.failures <= PATIENCE) return;
    this.reset();
    this.handlers.notice({ text: "The pull turned a part of the solid inside out. It starts again from rest." });
  }

  frame() {
    this.number += 1;
    const idle = { milliseconds: 0, iterations: 0, evaluations: 0, outcome: 0 };
    const spaces = this.shown.map(({ features, novelty }, i) => {
      return { ...(this.records[i] ?? idle), q: Float32Array.from(features), troubled: 0, novelty, distance: NaN, error: NaN };
    });
    const grabs = Array.from(this.pulls, ([id, { target, grabs }]) => {
      return { id, target, centroids: grabs.flatMap((grab, i) => this.shown[i].centroid(grab)) };
    });
    return { number: this.number, seconds: this.seconds, share: this.share, paused: this.look.paused, spaces, grabs };
  }

  // What the page says, one method a message

  /** Takes hold around `point`, at rest; a pinned part is not held, and nothing is pulled. */
  grab({ id, point, target }) {
    const { radius, stiffness } = this.pull, held = this.models.latent.held(point, radius);
    if (!held.length || this.pulls.has(id) || this.pulls.size >= MOST) return;
    this.remember();
    const grabs = this.shown.map((solid) => solid.grab(held, target, stiffness));
    const grips = this.shown.map((solid, i) => solid.centroid(grabs[i]));
    this.pulls.set(id, { held, start: target, target, grabs, grips, aims: grips });
    this.move({ id, target });
  }

  /** What is held follows the target from where it was: taking hold alone moves nothing. */
  move({ id, target }) {
    const pull = this.pulls.get(id);
    if (!pull) return;
    pull.target = target;
    const way = minus(target, pull.start);
    pull.aims = pull.grips.map((grip) => grip.map((x, i) => x + way[i]));
    this.shown.forEach((solid, i) => solid.move(pull.grabs[i], pull.aims[i]));
  }

  release({ id }) {
    const pull = this.pulls.get(id);
    this.pulls.delete(id);
    if (pull) this.shown.forEach((solid, i) => solid.release(pull.grabs[i]));
  }

  /** Gravity and stiffness act from the next step on. */
  condition() {
    for (const solid of this.shown) {
      solid.setGravity(this.look.gravity);
      solid.setStiffness(this.look.stiffness);
    }
  }

  step() {
    this.look.paused = true;
    this.stepOnce();
  }

  reset() {
    this.remember();
    this.pulls.clear();
    for (const solid of this.shown) solid.reset();
    Object.assign(this, { records: [], failures: 0, owed: 0, seconds: 0 });
  }

  /** Keeps the present pose of every space, with the pulls, for an undo. */
  remember() {
    const states = Object.entries(this.solids).map(([name, solid]) => [name, solid.save()]);
    const pulls = Array.from(this.pulls, ([id, pull]) => [id, { ...pull }]);
    this.poses.push({ states, pulls, names: this.names, seconds: this.seconds });
    if (this.poses.length > POSES) this.poses.shift();
  }

  /** Back to before the last pull or return to rest, in the spaces shown then. */
  undo() {
    const pose = this.poses.pop();
    if (!pose) {
      this.handlers.notice({ text: "nothing to undo: undo goes back to before the last pull or return to rest" });
      return;
    }
    for (const [name, state] of pose.states) this.solids[name].restore(state);
    Object.assign(this, { pulls: new Map(pose.pulls), seconds: pose.seconds, names: pose.names, records: [], failures: 0, owed: 0 });
    this.shown = this.names.map((name) => this.solids[name]);
    this.condition();
  }

  /** Those that go on keep their pose; one that comes begins at rest, under the same pulls. */
  spaces(names) {
    const place = new Map(this.names?.map((name, i) => [name, i]));
    const kept = (list, name, other) => (place.has(name) ? list[place.get(name)] : other());
    this.records = names.map((name) => kept(this.records, name, () => undefined));
    for (const name of names) if (!place.has(name)) this.solids[name].reset();
    for (const pull of this.pulls.values()) {
      const grabs = names.map((name) => kept(pull.grabs, name, () => this.solids[name].grab(pull.held, pull.target, this.pull.stiffness)));
      pull.grips = names.map((name, i) => kept(pull.grips, name, () => this.solids[name].centroid(grabs[i])));
      pull.grabs = grabs;
    }
    this.names = names;
    this.shown = names.map((name) => this.solids[name]);
    for (const [id, { target }] of this.pulls) this.move({ id, target });
    this.condition();
  }
}
