// The page: a clock that steps the solid, pointers that pull it, and the controls.

import { readSafetensors, spaceOf } from "./model.js";
import { inner } from "./potential.js";
import { Solid } from "./solid.js";
import { Stepper } from "./stepping.js";
import { dot } from "./surface.js";
import { View } from "./view.js";

const BUDGET_MS = 24; // of stepping in one picture, so that the page stays responsive where steps are slow
const PATIENCE = 20; // steps that may be lost before the page starts again
const SPACE_WORDS = { latent: "Latent", linear: "Linear" };

function start(about, packed) {
  try {
    const bytes = Uint8Array.from(atob(packed.textContent), (c) => c.charCodeAt(0));
    packed.remove();
    const page = new Page(about, readSafetensors(bytes.buffer));
    window.playground = page;
    page.run();
  } catch (error) {
    tell(error.message);
    throw error;
  }
}

const byId = (id) => document.getElementById(id);

function tell(text) {
  byId("message").textContent = text;
  byId("message").hidden = !text;
}

class Page {
  constructor(about, arrays) {
    this.about = about;
    this.h = arrays.time_step.data[0];
    this.gravity = arrays.gravity.data;
    this.radius = arrays.pull_radius.data[0];
    this.stiffness = arrays.pull_stiffness.data[0];
    this.solid = new Solid(arrays);
    this.view = new View(byId("canvas"), this.solid, about.up, about.azimuth, about.elevation);
    this.steppers = {};
    for (const name of Object.keys(SPACE_WORDS)) this.steppers[name] = new Stepper(spaceOf(arrays, name), this.h);
    this.pulls = new Map(); // pointer → { spring, held, grip, anchor, normal, dots }
    this.fingers = new Map(); // pointers that turn the view → last place
    this.paused = false;
    this.pace = 1;
    this.owed = 0;
    this.stepMs = 0;
    this.pictureMs = 0;
    this.failures = 0;
    this.makeSpaceButtons();
    this.choose("latent");
    this.listen();
    this.readColours();
    this.decode();
  }

  get stepper() {
    return this.steppers[this.space];
  }

  // The clock

  run() {
    let last = null; // the browser's clock for pictures, which may be behind performance.now()
    const tick = (now) => {
      const elapsed = Math.min(Math.max(now - (last ?? now), 0), 250);
      last = now;
      this.pictureMs = this.pictureMs ? 0.9 * this.pictureMs + 0.1 * elapsed : elapsed;
      if (!this.paused) this.advance((elapsed / 1000) * this.pace);
      this.show();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  /** Steps as many times as `seconds` of the solid's time ask for and the budget allows. */
  advance(seconds) {
    this.owed += seconds;
    const deadline = performance.now() + BUDGET_MS;
    let stepped = 0;
    while (this.owed >= this.h && performance.now() < deadline) {
      this.stepOnce();
      this.owed -= this.h;
      stepped++;
    }
    const behind = this.owed >= this.h;
    if (behind) this.owed = 0; // what cannot be caught up is dropped: the solid moves slower than the clock
    this.real = 0.95 * (this.real ?? 1) + 0.05 * (behind ? (stepped * this.h) / Math.max(seconds, this.h) : 1);
  }

  stepOnce() {
    const before = performance.now();
    const { lost, iterations } = this.stepper.step();
    this.stepMs = this.stepMs ? 0.9 * this.stepMs + 0.1 * (performance.now() - before) : performance.now() - before;
    this.iterations = iterations;
    this.failures = lost ? this.failures + 1 : 0;
    if (this.failures > PATIENCE || !this.stepper.q.every(Number.isFinite)) {
      this.reset();
      tell("The pull turned a part of the solid inside out. It starts again from rest.");
      setTimeout(() => tell(""), 4000);
    }
  }

  // What is seen

  decode() {
    this.solid.decode(this.stepper.q);
  }

  show() {
    this.decode();
    this.view.draw(this.colours);
    for (const pull of this.pulls.values()) this.drawPull(pull);
    const now = performance.now();
    if (now - (this.toldAt ?? 0) > 300) {
      this.toldAt = now;
      const late = this.paused ? "paused" : `${Math.round(100 * (this.real ?? 1) * this.pace)} % of real time`;
      const rate = this.pictureMs ? `${Math.round(1000 / this.pictureMs)} pictures a second` : "";
      const step = this.stepMs ? `step ${this.stepMs.toFixed(2)} ms, ${this.iterations} iterations` : "no step yet";
      byId("numbers").textContent = `${step} · ${rate} · ${late}`;
    }
  }

  drawPull({ spring, dots }) {
    const grip = [0, 1, 2].map((axis) => spring.centre[axis] + inner(spring.B[axis], this.stepper.q));
    const [x1, y1] = this.view.toScreen(grip), [x2, y2] = this.view.toScreen(spring.target);
    const [line, dot] = dots;
    for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(name, value.toFixed(1));
    dot.setAttribute("cx", x2.toFixed(1));
    dot.setAttribute("cy", y2.toFixed(1));
  }

  readColours() {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim().split(/\s+/).map(Number);
    const clay = read("--clay"), pin = read("--pin");
    const stops = [0, 1 / 3, 2 / 3, 1].map((share) => clay.map((x, i) => x + share * (pin[i] - x)));
    this.colours = { stops, shadow: read("--shadow") };
  }

  // Pulls

  /** Takes hold of the solid under a point of the canvas; false where there is none. */
  grab(pointer, x, y) {
    const { origin, direction, out } = this.view.ray(x, y);
    this.decode();
    const hit = this.solid.rayHit(origin, direction);
    if (!hit) return false;
    const held = this.solid.held(hit, this.radius, this.stepper.q);
    if (!held.length) return true; // a pinned part: nothing to pull, and the view should not turn either
    const spring = this.solid.spring(held, this.stiffness, this.stepper.space.k);
    const grip = [0, 1, 2].map((axis) => spring.centre[axis] + inner(spring.B[axis], this.stepper.q));
    spring.target.set(grip);
    const dots = ["line", "circle"].map((name) => document.createElementNS("http://www.w3.org/2000/svg", name));
    dots[1].setAttribute("r", "7");
    byId("pulls").append(...dots);
    this.pulls.set(pointer, { spring, held, anchor: hit, grip, normal: out, dots });
    this.springsChanged();
    return true;
  }

  /** Moves a pull's target with the pointer, in the plane through the grabbed point that faces the camera. */
  pullTo(pointer, x, y) {
    const { spring, anchor, grip, normal } = this.pulls.get(pointer);
    const { origin, direction } = this.view.ray(x, y);
    const distance = dot(anchor.map((a, i) => a - origin[i]), normal) / dot(direction, normal);
    for (let i = 0; i < 3; i++) spring.target[i] = grip[i] + origin[i] + distance * direction[i] - anchor[i];
  }

  release(pointer) {
    for (const element of this.pulls.get(pointer)?.dots ?? []) element.remove();
    if (this.pulls.delete(pointer)) this.springsChanged();
  }

  springsChanged() {
    this.stepper.potential.springs = Array.from(this.pulls.values(), (pull) => pull.spring);
    this.stepper.renew();
    byId("canvas").classList.toggle("pulling", this.pulls.size > 0);
  }

  // Controls

  choose(space) {
    for (const pointer of [...this.pulls.keys()]) this.release(pointer);
    this.space = space;
    this.stepper.reset();
    this.applyPhysics();
    const { r, points } = this.stepper.space;
    const cells = `${this.about.cells.toLocaleString("en")} ${this.about.cell_type === "tet4" ? "tetrahedra" : "hexahedra"}`;
    byId("about").textContent = `${cells}, moved by ${r} numbers and ${points} cubature points`;
    for (const button of byId("spaces").children) button.setAttribute("aria-checked", button.dataset.space === space);
  }

  applyPhysics() {
    const stiffer = 2 ** byId("stiffness").valueAsNumber, on = byId("gravity").checked;
    byId("stiffness-value").textContent = `×${stiffer < 1 ? stiffer.toFixed(2) : stiffer.toFixed(1).replace(/\.0$/, "")}`;
    this.stepper.potential.stiffer = stiffer;
    this.stepper.potential.setGravity(on ? this.gravity : [0, 0, 0]);
    this.stepper.renew();
  }

  reset() {
    for (const pointer of [...this.pulls.keys()]) this.release(pointer);
    this.stepper.reset();
    this.failures = 0;
    this.owed = 0;
  }

  pause(paused) {
    this.paused = paused;
    byId("pause").textContent = paused ? "Go on" : "Pause";
    byId("pause").setAttribute("aria-pressed", paused);
  }

  makeSpaceButtons() {
    for (const [name, word] of Object.entries(SPACE_WORDS)) {
      const button = document.createElement("button");
      button.textContent = word;
      button.dataset.space = name;
      button.setAttribute("role", "radio");
      button.addEventListener("click", () => this.choose(name));
      byId("spaces").append(button);
    }
  }

  listen() {
    const on = (id, event, action) => byId(id).addEventListener(event, action);
    on("pause", "click", () => this.pause(!this.paused));
    on("single", "click", () => {
      this.pause(true);
      this.stepOnce();
    });
    on("reset", "click", () => this.reset());
    on("gravity", "change", () => this.applyPhysics());
    on("stiffness", "input", () => this.applyPhysics());
    on("speed", "input", () => {
      this.pace = 2 ** byId("speed").valueAsNumber;
      byId("speed-value").textContent = this.pace === 1 ? "×1" : `1/${1 / this.pace}`;
    });
    on("canvas", "pointerdown", (event) => this.down(event));
    on("canvas", "pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) on("canvas", end, (event) => this.up(event));
    on("canvas", "contextmenu", (event) => event.preventDefault());
    on("canvas", "dblclick", () => this.view.reset());
    on("canvas", "wheel", (event) => {
      event.preventDefault();
      this.view.zoomBy(Math.exp(-0.0012 * event.deltaY));
    });
    const keys = { " ": "pause", s: "single", r: "reset" };
    document.addEventListener("keydown", (event) => {
      const onControl = event.target.closest?.("button, input");
      if (!onControl && keys[event.key]) {
        event.preventDefault();
        byId(keys[event.key]).click();
      }
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.readColours());
  }

  // Pointers: one that meets the solid pulls, others turn the view; two beside the solid zoom and shift it

  down(event) {
    byId("hint").classList.add("done");
    const { offsetX: x, offsetY: y, pointerId } = event;
    byId("canvas").setPointerCapture(pointerId);
    if (event.button === 0 && !event.shiftKey && this.fingers.size === 0 && this.grab(pointerId, x, y)) return;
    this.fingers.set(pointerId, [x, y]);
  }

  move(event) {
    const { offsetX: x, offsetY: y, pointerId } = event;
    if (this.pulls.has(pointerId)) this.pullTo(pointerId, x, y);
    else if (this.fingers.has(pointerId)) this.turn(event, x, y);
  }

  turn(event, x, y) {
    const [oldX, oldY] = this.fingers.get(event.pointerId);
    this.fingers.set(event.pointerId, [x, y]);
    if (this.fingers.size === 2) {
      const [other] = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      this.view.zoomBy(Math.hypot(x - other[0], y - other[1]) / Math.max(Math.hypot(oldX - other[0], oldY - other[1]), 1));
      this.view.pan((x - oldX) / 2, (y - oldY) / 2);
    } else if (event.shiftKey || event.buttons === 2 || event.buttons === 4) this.view.pan(x - oldX, y - oldY);
    else this.view.orbit(x - oldX, y - oldY);
  }

  up(event) {
    this.release(event.pointerId);
    this.fingers.delete(event.pointerId);
  }
}

start(JSON.parse(byId("about-data").textContent), byId("model"));
