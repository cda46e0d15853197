// The replay: one motion in all spaces in step, each in a panel of one canvas, seen by one camera. The figure that holds it
// is hidden in the page until everything works; without WebGL or script the page keeps its still pictures.

import { Surface } from "./surface.js";
import { View } from "./view.js";

const TYPES = { f4: Float32Array, u2: Uint16Array, i2: Int16Array };
const DIMMED = 0.88; // leaves room for light on the palest colour
const SVG = "http://www.w3.org/2000/svg";

function unpacked([type, text]) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new TYPES[type](bytes.buffer);
}

/** Millimetres as text, in three digits. */
function millimetres(value) {
  return `${value === 0 ? 0 : Number(value.toPrecision(3))} mm`;
}

export class Replay {
  constructor(figure) {
    this.figure = figure;
    this.part = (name) => figure.querySelector(`.${name}`);
    const data = JSON.parse(this.part("data").textContent);
    this.scales = data.scales;
    this.stops = data.stops;
    const shown = data.stops.map((stop) => `rgb(${stop.map((x) => Math.round(255 * x))})`);
    this.part("bar").style.background = `linear-gradient(90deg, ${shown})`;
    this.modes = unpacked(data.modes); // (K, 3v)
    this.motions = data.motions;
    this.surface = new Surface(unpacked(data.rest), unpacked(data.triangles));
    this.canvas = this.part("canvas");
    this.view = new View(this.canvas, this.surface, data.up, data.azimuth, data.elevation);
    this.view.frameBox(data.low, data.high);
    this.fingers = new Map(); // pointers on the canvas → last place
    this.reference = new Float32Array(this.surface.positions.length);
    for (const [i, motion] of data.motions.entries()) {
      this.part("motion").append(new Option(`${motion.name} (${motion.role === "heldout" ? "held-out" : "training"})`, i));
    }
    this.listen();
    figure.hidden = false;
    this.readColours();
    this.choose(0);
  }

  // The clock

  get seconds() {
    return (this.frame + 1) * this.motion.seconds;
  }

  play(playing) {
    this.playing = playing;
    this.part("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    let last = null, owed = 0;
    const tick = (now) => {
      if (!this.playing) return;
      owed += (Math.min(now - (last ?? now), 250) / 1000) * Number(this.part("speed").value);
      last = now;
      const steps = Math.floor(owed / this.motion.seconds);
      owed -= steps * this.motion.seconds;
      if (steps) this.show((this.frame + steps) % this.motion.frames);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  // What is seen

  /** Turns to a motion, at the frame in which it is farthest from rest. */
  choose(number) {
    this.motion = this.motions[number];
    for (const film of this.motion.films) {
      film.q ??= unpacked(film.coordinates);
      film.mean ??= film.mean_mm && unpacked(film.mean_mm);
      film.paths ??= film.grips.map(unpacked);
    }
    for (const drag of this.motion.drags) drag.path ??= unpacked(drag.targets);
    this.makePanels();
    this.part("scrub").max = this.motion.frames - 1;
    const judged = this.motion.films.length > 1 && this.motion.films[0].space === "full" && this.motion.limit > 0;
    this.part("key-bar").hidden = !judged;
    this.limit = judged ? this.motion.limit : Infinity;
    this.part("limit").textContent = millimetres(1000 * this.motion.limit);
    this.show(this.motion.start);
  }

  makePanels() {
    this.panels = this.motion.films.map((film) => {
      const label = document.createElement("div"), title = document.createElement("b"), told = document.createElement("span");
      label.className = `panel space ${film.space}`;
      title.textContent = film.title;
      label.append(title, told);
      return { film, label, told };
    });
    this.part("panels").replaceChildren(...this.panels.map(({ label }) => label));
  }

  show(frame) {
    this.frame = frame;
    this.part("scrub").value = frame;
    this.part("scrub").setAttribute("aria-valuetext", `${this.seconds.toFixed(2)} seconds`);
    this.part("time").textContent = `${this.seconds.toFixed(2)} s`;
    this.draw();
  }

  /** x = X + W c of a film's frame. */
  decode({ q }, frame) {
    const { positions, rest } = this.surface, K = this.scales.length;
    positions.set(rest);
    for (let j = 0; j < K; j++) {
      const c = this.scales[j] * q[frame * K + j], from = j * positions.length;
      if (c) for (let i = 0; i < positions.length; i++) positions[i] += c * this.modes[from + i];
    }
  }

  /** Colours vertices by their distance to the reference, as a share of the limit. */
  tint() {
    const { positions: p, tints } = this.surface, r = this.reference;
    for (let v = 0, i = 0; v < tints.length; v++, i += 3) {
      tints[v] = Math.min(1, Math.hypot(p[i] - r[i], p[i + 1] - r[i + 1], p[i + 2] - r[i + 2]) / this.limit);
    }
  }

  draw() {
    const { surface, view, frame } = this, whole = this.canvas.getBoundingClientRect(), lines = [];
    view.clear();
    for (const { film, label, told } of this.panels) {
      const lost = frame >= film.frames;
      told.textContent = lost ? `diverged at ${(film.frames * this.motion.seconds).toFixed(2)} s`
        : film.mean ? `${millimetres(film.mean[frame])} from full space on average` : "\u00a0";
      // The solid is drawn below the words of its panel.
      const box = label.getBoundingClientRect(), height = box.bottom - told.getBoundingClientRect().bottom;
      view.part = { left: box.left - whole.left, bottom: whole.bottom - box.bottom, width: box.width, height };
      if (lost) continue;
      this.decode(film, frame);
      if (film.space === "full") this.reference.set(surface.positions);
      if (Number.isFinite(this.limit)) this.tint();
      else surface.tints.fill(0);
      surface.refresh();
      view.drawPart(this.colours);
      lines.push(...this.pulls(film, frame));
    }
    this.part("pulls").replaceChildren(...lines);
  }

  /** A line from what each drag holds to where it pulls, in the panel that is drawn. */
  pulls(film, frame) {
    const { left, bottom, height } = this.view.part, top = this.canvas.clientHeight - bottom - height;
    return this.motion.drags.flatMap(({ first, path }, i) => {
      const at = 3 * (frame - first);
      if (at < 0 || at >= Math.min(path.length, film.paths[i].length)) return [];
      const [from, to] = [film.paths[i], path].map((some) => this.view.toScreen(some.subarray(at, at + 3)));
      const line = document.createElementNS(SVG, "line"), dot = document.createElementNS(SVG, "circle");
      const numbers = { x1: left + from[0], y1: top + from[1], x2: left + to[0], y2: top + to[1] };
      for (const [name, value] of Object.entries(numbers)) line.setAttribute(name, value.toFixed(1));
      for (const [name, value] of [["cx", numbers.x2], ["cy", numbers.y2], ["r", 3.5]]) dot.setAttribute(name, value);
      return [line, dot];
    });
  }

  readColours() {
    const style = getComputedStyle(this.figure);
    const read = (name) => style.getPropertyValue(name).trim().split(/\s+/).map(Number);
    this.colours = { stops: this.stops.map((stop) => stop.map((x) => DIMMED * x)), shadow: read("--shadow") };
  }

  // Controls

  listen() {
    const on = (name, event, action, options) => this.part(name).addEventListener(event, action, options);
    on("play", "click", () => this.play(!this.playing));
    on("scrub", "input", (event) => {
      this.play(false);
      this.show(event.target.valueAsNumber);
    });
    on("motion", "change", (event) => this.choose(Number(event.target.value)));
    on("home", "click", () => this.home());
    on("canvas", "pointerdown", (event) => {
      this.fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
      this.canvas.setPointerCapture(event.pointerId);
    });
    on("canvas", "pointermove", (event) => this.turn(event));
    for (const end of ["pointerup", "pointercancel"]) on("canvas", end, (event) => this.fingers.delete(event.pointerId));
    // One finger up or down scrolls the page (touch-action in the style); two are the replay's alone.
    on("canvas", "touchstart", (event) => event.touches.length > 1 && event.preventDefault(), { passive: false });
    on("canvas", "dblclick", () => this.home());
    on("canvas", "wheel", (event) => this.wheel(event), { passive: false });
    on("canvas", "keydown", (event) => this.key(event));
    on("canvas", "webglcontextlost", () => (this.figure.hidden = true));
    new ResizeObserver(() => this.motion && this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.readColours();
      this.draw();
    });
  }

  home() {
    this.view.reset();
    this.draw();
  }

  turn(event) {
    const old = this.fingers.get(event.pointerId);
    if (!old) return;
    const { offsetX: x, offsetY: y } = event;
    this.fingers.set(event.pointerId, [x, y]);
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    if (others.length) {
      const apart = (a) => Math.max(Math.hypot(a[0] - others[0][0], a[1] - others[0][1]), 1);
      this.view.zoomBy(apart([x, y]) / apart(old));
    }
    const share = 1 / (1 + others.length);
    this.view.orbit(share * (x - old[0]), share * (y - old[1]));
    this.draw();
  }

  /** The wheel zooms once the canvas was clicked; before that it goes on scrolling the page. */
  wheel(event) {
    if (document.activeElement !== this.canvas && !event.ctrlKey) return;
    event.preventDefault();
    this.view.zoomBy(Math.exp(-0.0012 * event.deltaY));
    this.draw();
  }

  key(event) {
    const keys = {
      ArrowLeft: () => this.view.orbit(-12, 0),
      ArrowRight: () => this.view.orbit(12, 0),
      ArrowUp: () => this.view.orbit(0, -12),
      ArrowDown: () => this.view.orbit(0, 12),
      "+": () => this.view.zoomBy(1.15),
      "=": () => this.view.zoomBy(1.15),
      "-": () => this.view.zoomBy(1 / 1.15),
      0: () => this.view.reset(),
      " ": () => this.play(!this.playing),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
    this.draw();
  }
}
