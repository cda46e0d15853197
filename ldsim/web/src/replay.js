// The replay: one motion in all spaces in step, each in a panel of one canvas, seen by one camera. The figure that holds it
// is hidden in the page until everything works; without WebGL or script the page keeps its still pictures.

import { unpacked } from "./arrays.js";
import { Camera, Fingers } from "./camera.js";
import { digits, everyPicture, gradient, make, onThemeChange, pull, scale, shade } from "./dom.js";
import { Surface } from "./surface.js";
import { Body, View } from "./view.js";
import { at } from "./vector.js";

const ROLES = { train: "training", validation: "validation", test: "test" };

const millimetres = (value) => `${digits(value)} mm`;

export class Replay {
  constructor(figure) {
    this.figure = figure;
    this.part = (name) => figure.querySelector(`.${name}`);
    const data = JSON.parse(this.part("data").textContent), { low, high } = data;
    this.part("bar").style.background = gradient();
    this.motions = data.motions;
    this.surface = new Surface(unpacked(data.rest), unpacked(data.triangles));
    this.columns = data.scales.length;
    this.basis = Float32Array.from(unpacked(data.modes), (mode, i) => mode * data.scales[i % this.columns]); // (3v, K)
    this.canvas = this.part("canvas");
    this.camera = new Camera(this.canvas, data.up, data.azimuth, data.elevation);
    this.camera.frame(low.map((x, i) => (x + high[i]) / 2), 0.85 * Math.hypot(...high.map((x, i) => x - low[i])));
    this.view = new View(this.camera);
    this.view.floor = low[1];
    this.body = Object.assign(new Body(this.view.gl, this.surface), { ramp: 1 });
    this.fingers = new Fingers(this.camera, false);
    this.reference = new Float32Array(this.surface.positions.length);
    for (const [i, motion] of data.motions.entries()) {
      this.part("motion").append(new Option(`${motion.name} (${ROLES[motion.role]})`, i));
    }
    this.listen();
    figure.hidden = false;
    this.readColours();
    this.choose(0);
  }

  // The clock

  play(playing) {
    this.playing = playing;
    this.part("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    let owed = 0;
    everyPicture((elapsed) => {
      if (!this.playing) return false;
      owed += elapsed * Number(this.part("speed").value);
      const steps = Math.floor(owed / this.motion.seconds);
      owed -= steps * this.motion.seconds;
      if (steps) this.show((this.frame + steps) % this.motion.frames);
      return true;
    });
  }

  // What is seen

  /** Turns to a motion, at the frame in which it is farthest from rest. */
  choose(number) {
    this.motion = this.motions[number];
    for (const shown of this.motion.spaces) {
      shown.q ??= unpacked(shown.coordinates);
      shown.mean ??= shown.mean_mm && unpacked(shown.mean_mm);
      shown.paths ??= shown.grips.map(unpacked);
    }
    for (const drag of this.motion.drags) drag.path ??= unpacked(drag.targets);
    this.panels = this.motion.spaces.map((shown) => {
      const told = make("span");
      return { shown, told, label: make("div", { class: `panel space ${shown.space}` }, make("b", {}, shown.title), told) };
    });
    this.part("panels").replaceChildren(...this.panels.map(({ label }) => label));
    this.part("scrub").max = this.motion.frames - 1;
    const judged = this.motion.spaces.length > 1 && this.motion.spaces[0].space === "full" && this.motion.limit > 0;
    this.part("key-bar").hidden = !judged;
    this.limit = judged ? this.motion.limit : Infinity;
    this.part("limit").textContent = millimetres(1000 * this.motion.limit);
    this.show(this.motion.start);
  }

  show(frame) {
    this.frame = frame;
    this.part("scrub").value = frame;
    const seconds = ((frame + 1) * this.motion.seconds).toFixed(2);
    this.part("scrub").setAttribute("aria-valuetext", `${seconds} seconds`);
    this.part("time").textContent = `${seconds} s`;
    this.draw();
  }

  /** The surface as a space had it in a frame. */
  decode({ q }, frame) {
    this.surface.move(this.basis, this.columns, q.subarray(frame * this.columns, (frame + 1) * this.columns));
  }

  draw() {
    const { surface, view, camera, frame } = this, whole = this.canvas.getBoundingClientRect(), lines = [];
    view.clear();
    for (const { shown, label, told } of this.panels) {
      const lost = frame >= shown.frames;
      told.textContent = lost ? `diverged at ${(shown.frames * this.motion.seconds).toFixed(2)} s`
        : shown.mean ? `${millimetres(shown.mean[frame])} from full space on average` : "\u00a0";
      // The solid is drawn below the words of its panel.
      const box = label.getBoundingClientRect(), height = box.bottom - told.getBoundingClientRect().bottom;
      camera.part = { left: box.left - whole.left, bottom: whole.bottom - box.bottom, width: box.width, height };
      if (lost) continue;
      this.decode(shown, frame);
      if (shown.space === "full") this.reference.set(surface.positions);
      surface.tintByDistance(this.reference, this.limit);
      surface.refresh();
      this.body.changed = true;
      view.draw([this.body], this.colours);
      lines.push(...this.pulls(shown, frame));
    }
    this.part("pulls").replaceChildren(...lines);
  }

  /** A line from what each drag holds to where it pulls, in the panel that is drawn. */
  pulls(shown, frame) {
    const { left, bottom, height } = this.camera.part, corner = [left, this.canvas.clientHeight - bottom - height];
    const place = (path, i) => this.camera.toScreen(at(path, i)).map((x, axis) => x + corner[axis]);
    return this.motion.drags.flatMap(({ first, path }, i) => {
      const now = frame - first;
      if (now < 0 || 3 * now >= Math.min(path.length, shown.paths[i].length)) return [];
      return pull(place(shown.paths[i], now), place(path, now), 3.5);
    });
  }

  readColours() {
    this.colours = { stops: scale(), shade: shade(this.figure), grid: [0, 0, 0, 0] };
  }

  // Controls

  listen() {
    const on = (name, event, action, options) => this.part(name).addEventListener(event, action, options);
    const redrawn = (action) => (event) => {
      action(event);
      this.draw();
    };
    on("play", "click", () => this.play(!this.playing));
    on("scrub", "input", (event) => {
      this.play(false);
      this.show(event.target.valueAsNumber);
    });
    on("motion", "change", (event) => this.choose(Number(event.target.value)));
    for (const [name, event] of [["home", "click"], ["canvas", "dblclick"]]) on(name, event, redrawn(() => this.camera.reset()));
    on("canvas", "pointerdown", (event) => this.fingers.down(event));
    on("canvas", "pointermove", (event) => this.fingers.move(event) && this.draw());
    for (const end of ["pointerup", "pointercancel"]) on("canvas", end, (event) => this.fingers.up(event));
    // One finger up or down scrolls the page (touch-action in the style); two are the replay's alone.
    on("canvas", "touchstart", (event) => event.touches.length > 1 && event.preventDefault(), { passive: false });
    // The wheel zooms once the canvas was clicked; before that it goes on scrolling the page.
    const zooms = (event) => document.activeElement === this.canvas || event.ctrlKey;
    on("canvas", "wheel", redrawn((event) => zooms(event) && this.fingers.wheel(event)), { passive: false });
    on("canvas", "keydown", (event) => this.key(event));
    on("canvas", "webglcontextlost", () => (this.figure.hidden = true));
    new ResizeObserver(() => this.motion && this.draw()).observe(this.canvas);
    onThemeChange(redrawn(() => this.readColours()));
  }

  key(event) {
    const { camera } = this;
    const keys = {
      ArrowLeft: () => camera.orbit(-12, 0),
      ArrowRight: () => camera.orbit(12, 0),
      ArrowUp: () => camera.orbit(0, -12),
      ArrowDown: () => camera.orbit(0, 12),
      "+": () => camera.zoomBy(1.15),
      "=": () => camera.zoomBy(1.15),
      "-": () => camera.zoomBy(1 / 1.15),
      0: () => camera.reset(),
      " ": () => this.play(!this.playing),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
    this.draw();
  }
}
