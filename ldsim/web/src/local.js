// The model inside the page, in the place of a server: obeys the page, steps at the pace of time, and hands out frames.

import { inflated, unpacked } from "./arrays.js";
import { everyPicture } from "./dom.js";
import { Model, Solid, runtimeOf } from "./solid.js";
import { minus } from "./vector.js";

const BUDGET_MS = 24; // of stepping in one picture, so that the page stays responsive where steps are slow
const MEAN_STEPS = 200; // that the time of a step is told of: the clock of a page is coarser than a step
const PATIENCE = 20; // steps in a row that may be lost before the solid starts again

const HELD = 3; // an outcome of ldsim_step
const MOST = 16; // pulls at once
const POSES = 50; // kept for undo

export class Local {
  /** about: what Python says of the solid; packed: the library and the models (ldsim/export/playground.py). */
  static async open(about, packed) {
    const runtime = await runtimeOf(await inflated(packed.runtime)), models = {};
    for (const name of about.spaces) models[name] = new Model(runtime, await inflated(packed[name]));
    return new Local(about, models);
  }

  constructor(about, models) {
    const { rest, movable, triangles, timeStep, gravity } = models.latent;
    const surface = Array.from(new Set(triangles)).sort((a, b) => a - b); // the vertices on the surface
    const number = new Map(surface.map((v, i) => [v, i]));
    Object.assign(this, { models, h: timeStep, pull: about.pull, pulls: new Map(), poses: [] });
    this.look = { gravity, stiffness: 1, speed: 1, paused: false, colour: "plain" };
    this.motions = Object.fromEntries(about.motions.map((motion) => [motion.name, motion]));
    Object.assign(this, { chosen: about.motions[0]?.name ?? "", playing: null });
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
    Object.assign(this, { owed: 0, number: 0, seconds: 0, share: 1, failures: 0, records: {} });
    this.spaces([about.space]);
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
    const name = kind === "pause" ? "paused" : kind, acts = kind === "gravity" || kind === "stiffness";
    const before = this.look[name];
    if (acts && this.playing) this.handlers.notice({ text: `${kind} stays as it is while a motion is played; stop first` });
    else if (name in this.look) this.look[name] = value;
    else this[kind](value ?? values);
    try {
      if (acts && !this.playing) this.condition();
    } catch (error) { // in every space, or in none
      this.look[name] = before;
      this.condition();
      this.handlers.notice({ text: error.message });
    }
    if (!["grab", "move", "release"].includes(kind)) this.handlers.status(this.status());
  }

  status() {
    const motions = Object.fromEntries(Object.values(this.motions).map(({ name, words }) => [name, words]));
    const player = { playing: this.playing !== null, motions, chosen: this.chosen };
    return { ...this.look, kind: "status", offered: Object.keys(this.solids), spaces: this.names, recorder: null, player };
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

  /** Of every space, seen or not: one that is turned on is where its pulls have brought it. */
  stepOnce() {
    let held = false;
    this.prepare();
    for (const [name, solid] of Object.entries(this.solids)) {
      const before = performance.now(), record = solid.step(), taken = performance.now() - before;
      const { milliseconds = 0, count = 0 } = this.records[name] ?? {}, share = 1 / Math.min(count + 1, MEAN_STEPS);
      this.records[name] = { ...record, count: count + 1, milliseconds: milliseconds + share * (taken - milliseconds) };
      held ||= record.outcome === HELD && this.names.includes(name);
    }
    this.seconds += this.h;
    this.failures = held ? this.failures + 1 : 0;
    if (this.failures <= PATIENCE) return;
    this.reset();
    this.handlers.notice({ text: "The pull turned a part of the solid inside out. It starts again from rest." });
  }

  frame() {
    this.number += 1;
    const idle = { milliseconds: 0, iterations: 0, evaluations: 0, outcome: 0 };
    const spaces = this.names.map((name) => {
      const { features, novelty } = this.solids[name];
      return { ...(this.records[name] ?? idle), q: Float32Array.from(features), troubled: 0, novelty, distance: NaN, error: NaN };
    });
    const grabs = Array.from(this.pulls, ([id, { target, grabs }]) => {
      return { id, target, centroids: this.names.flatMap((name) => this.solids[name].centroid(grabs[name])) };
    });
    return { number: this.number, seconds: this.seconds, share: this.share, paused: this.look.paused, spaces, grabs };
  }

  // What the page says, one method a message

  /** What a function makes of every solid, by the name of its space. */
  each = (made) => Object.fromEntries(Object.entries(this.solids).map(([name, solid]) => [name, made(solid, name)]));

  /** Takes hold around `point`, at rest, in every space; a pinned part is not held, and nothing is pulled. */
  grab({ id, point, target }) {
    const { radius, stiffness } = this.pull, held = this.models.latent.held(point, radius);
    if (!held.length) this.handlers.notice({ text: "this place is pinned and will not move; pull where the solid can give way" });
    if (!held.length || this.pulls.has(id) || this.pulls.size >= MOST) return;
    this.stop();
    this.remember();
    const grabs = this.each((solid) => solid.grab(held, target, stiffness));
    const grips = this.each((solid, name) => solid.centroid(grabs[name]));
    this.pulls.set(id, { held, start: target, target, grabs, grips, aims: grips });
    this.move({ id, target });
  }

  /** What is held follows the target from where it was: taking hold alone moves nothing. */
  move({ id, target }) {
    const pull = this.pulls.get(id);
    if (!pull || this.playing) return;
    pull.target = target;
    const way = minus(target, pull.start);
    pull.aims = this.each((_, name) => pull.grips[name].map((x, i) => x + way[i]));
    this.each((solid, name) => solid.move(pull.grabs[name], pull.aims[name]));
  }

  release({ id }) {
    if (!this.playing) this.letGo(id);
  }

  letGo(id) {
    const pull = this.pulls.get(id);
    this.pulls.delete(id);
    if (pull) this.each((solid, name) => solid.release(pull.grabs[name]));
  }

  take(name) {
    this.chosen = name;
  }

  /** Plays the chosen motion from rest, or ends it. */
  replay(value) {
    this.stop();
    if (!value) return;
    this.reset();
    const drags = this.motions[this.chosen].drags.map((drag) => ({ ...drag, targets: unpacked(drag.targets) }));
    this.playing = { ...this.motions[this.chosen], drags, frame: 0 };
  }

  /** Ends the motion that is played, and lets go. */
  stop() {
    if (!this.playing) return;
    this.playing = null;
    for (const id of [...this.pulls.keys()]) this.letGo(id);
    this.condition();
    this.handlers.status(this.status());
  }

  /** Before each step: what pulls in the next frame of the motion that is played. */
  prepare() {
    if (!this.playing) return;
    const { drags, frames, gravity, frame } = this.playing;
    if (frame === frames) return this.stop();
    this.playing.frame += 1;
    drags.forEach((drag, id) => this.drag(id, drag, frame - drag.start));
    if (gravity) this.each((solid) => solid.setGravity(gravity[frame]));
  }

  /** A pull of a motion in the frame `at` since it began. */
  drag(id, { held, stiffness, targets }, at) {
    const target = Array.from(targets.slice(3 * at, 3 * at + 3)), pull = this.pulls.get(id);
    if (at < 0 || !target.length) return pull && this.letGo(id);
    if (!pull) this.pulls.set(id, { target, grabs: this.each((solid) => solid.grab(held, target, stiffness)) });
    else this.each((solid, name) => solid.move(pull.grabs[name], (pull.target = target)));
  }

  /** Gravity and stiffness act from the next step on. */
  condition() {
    for (const solid of Object.values(this.solids)) {
      solid.setGravity(this.look.gravity);
      solid.setStiffness(this.look.stiffness);
    }
  }

  step() {
    this.look.paused = true;
    this.stepOnce();
  }

  reset() {
    this.stop();
    this.remember();
    this.pulls.clear();
    this.each((solid) => solid.reset());
    Object.assign(this, { records: {}, failures: 0, owed: 0, seconds: 0 });
  }

  /** Keeps the present pose of every space, with the pulls, for an undo. */
  remember() {
    const states = this.each((solid) => solid.save());
    const pulls = Array.from(this.pulls, ([id, pull]) => [id, { ...pull }]);
    this.poses.push({ states, pulls, seconds: this.seconds });
    if (this.poses.length > POSES) this.poses.shift();
  }

  /** Back to before the last pull, motion or return to rest. */
  undo() {
    this.stop();
    const pose = this.poses.pop();
    if (!pose) {
      this.handlers.notice({ text: "nothing to undo: undo goes back to before the last pull, motion or return to rest" });
      return;
    }
    this.each((solid, name) => solid.restore(pose.states[name]));
    Object.assign(this, { pulls: new Map(pose.pulls), seconds: pose.seconds, records: {}, failures: 0, owed: 0 });
    this.condition();
  }

  /** Those that are seen. */
  spaces(names) {
    this.names = names;
  }
}
