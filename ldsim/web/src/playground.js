// The playground: draws what a server or the page itself steps, and tells it what the hand and the controls do.

import { byId, everyPicture, make, onThemeChange, short } from "./dom.js";
import { Hand } from "./hand.js";
import { Link } from "./link.js";
import { Local } from "./local.js";
import { Panel } from "./panel.js";
import { Stage } from "./stage.js";

const RETRY = 1000; // ms
const UNITS = { energy: "J/m³", stress: "Pa" };
class Page {
  /** source: a Link to the server, or what steps in the page; solid: its block. */
  constructor(source, solid) {
    Object.assign(this, { source, solid, blocks: new Map(), shown: [], frame: null, times: [], drawn: 0 });
    const options = Object.fromEntries(new URLSearchParams(location.search));
    this.stage = new Stage(byId("stage"), solid, options);
    const send = (kind, values) => {
      if (kind === "grab" && this.panel.status.paused) this.panel.notice("Paused: the solid follows the pull when time goes on (space, or ▶).");
      source.send(kind, values);
    };
    this.panel = new Panel(solid, this.stage.axes, send, {
      theme: (name) => this.setTheme(name),
      colour: (name) => this.setColour(name),
      home: () => this.stage.camera.reset(),
      capture: () => this.capture(),
      points: (visible) => this.stage.shapes.forEach((shape) => shape.setPoints(visible)),
      wireframe: (on) => this.stage.shapes.forEach(({ body }) => (body.wire = on)),
    });
    this.hand = new Hand(this.stage, send, solid.mode);
    const follow = () => this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    follow();
    onThemeChange(follow);
    source.connect({
      frame: (frame) => (this.frame = frame),
      colours: (colours) => this.showColours(colours),
      status: (status) => this.setStatus(status),
      notice: ({ text }) => this.panel.notice(text),
      lost: () => this.setLost(true),
      found: () => this.setLost(false),
    });
    everyPicture(() => this.draw());
    setInterval(() => this.statistics(), 500);
  }

  /** The palette's light or dark colours, whatever the browser prefers. */
  setTheme(name) {
    document.documentElement.dataset.theme = name;
    for (const rule of [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules])) {
      rule.ofDark ??= rule.media?.mediaText === "(prefers-color-scheme: dark)";
      if (rule.ofDark) rule.media.mediaText = name === "dark" ? "all" : "not all";
    }
    this.stage.readColours();
  }

  /** The picture as a file. */
  capture() {
    this.stage.draw(); // in this turn, while the canvas still holds it
    byId("stage").toBlob((blob) => {
      const link = make("a", { href: URL.createObjectURL(blob), download: `${this.solid.title}.png` });
      link.click();
      URL.revokeObjectURL(link.href);
    });
  }

  setLost(lost) {
    this.panel.notice(lost ? "The connection is lost; trying again …" : "Connected again", lost);
    document.body.classList.toggle("lost", lost);
  }

  async setStatus(status) {
    this.panel.show(status);
    if (status.spaces.join() === this.shown.join()) {
      if (status.colour !== this.colour) this.setColour(status.colour); // another page has chosen it
      return;
    }
    this.shown = status.spaces;
    const missing = status.spaces.filter((name) => !this.blocks.has(name));
    try {
      for (const name of missing) this.blocks.set(name, await this.source.space(name));
    } catch (error) {
      if (this.shown !== status.spaces) return;
      this.shown = []; // the next status asks again, and where none comes, the last one does
      clearTimeout(this.retrying);
      this.retrying = setTimeout(() => this.setStatus(this.panel.status), RETRY);
      this.panel.notice(`A space could not be fetched (${error.message}); trying again …`);
      return;
    }
    if (this.shown !== status.spaces) return;
    this.stage.setSpaces(status.spaces.map((name) => this.blocks.get(name)));
    for (const shape of this.stage.shapes) {
      shape.setPoints(byId("points")?.checked);
      shape.body.wire = byId("wireframe").checked;
    }
    this.setColour(status.colour);
  }

  setColour(name) {
    this.stage.shapes.forEach((shape) => shape.setMode(name));
    const far = `${short(this.stage.diagonal / 4)}m`;
    const ends = { plain: null, displacement: ["0", far], novelty: ["as in training", "far from it"] }[name];
    this.panel.legend(ends === undefined ? ["0", "…"] : ends);
    this.colour = name;
  }

  showColours({ space, high, values }) {
    const shape = this.stage.shapes[space];
    if (!shape || values.length !== shape.surface.count || !(this.colour in UNITS)) return;
    shape.setField(values);
    this.panel.legend(["0", `${short(high)}${UNITS[this.colour]}`]);
  }

  /** The newest frame on the shapes, once: none where spaces are just changing. */
  apply() {
    const { frame, stage } = this;
    if (!frame || frame.number === this.applied) return;
    if (frame.spaces.length !== stage.shapes.length) return;
    if (frame.spaces.some((space, i) => space.q.length !== stage.shapes[i].q.length)) return;
    frame.spaces.forEach((space, i) => {
      stage.shapes[i].show(space.q);
      if (this.colour === "novelty") stage.shapes[i].setNovelty(space.novelty);
    });
    stage.grabs = frame.grabs;
    this.applied = frame.number;
  }

  draw() {
    this.apply();
    this.stage.draw();
    this.drawn += 1;
    this.times.push(performance.now());
    if (this.times.length > 40) this.times.shift();
    return true;
  }

  statistics() {
    if (!this.frame || this.frame.spaces.length !== this.shown.length) return;
    const span = this.times.at(-1) - this.times[0];
    const said = this.panel.statistics(this.frame, this.shown, (1000 * (this.times.length - 1)) / span);
    this.stage.shapes.forEach(({ label }, i) => label.replaceChildren(...said[i]));
  }

  /** For tests: what is drawn, where, and how. */
  get probe() {
    const { stage, frame, solid, source, drawn } = this, { camera, shapes, gpu } = stage;
    const place = (i, point) => camera.toScreen(point, shapes[i].offset); // the canvas fills the window
    return {
      ...{ drawn, gpu, place, source, camera, stage, frame: frame?.number, bytes: frame?.bytes, grabs: frame?.grabs.length },
      ready: shapes.length > 0 && this.applied !== undefined,
      q: (i) => Array.from(shapes[i].q),
      positions: (i) => Array.from(shapes[i].current()),
      decoded: (i) => Array.from(shapes[i].body.decoder.read(solid.rest.length / 3)),
      screen: (i, vertex) => place(i, shapes[i].current().subarray(3 * vertex, 3 * vertex + 3)),
    };
  }
}

/** Opens the page: with the model inside it, or else with the server that it came from. */
async function start() {
  const model = byId("model"), overlay = byId("overlay");
  try {
    const [about, packed] = model ? [byId("about"), model].map(({ textContent }) => JSON.parse(textContent)) : [];
    const source = model ? await Local.open(about, packed) : new Link();
    model?.remove();
    const page = new Page(source, await source.solid());
    Object.defineProperty(window, "ldsim", { get: () => page.probe });
    overlay.hidden = true;
  } catch (error) {
    overlay.textContent = model || /webgl/i.test(error.message) ? error.message : `ldsim cannot be reached: ${error.message}`;
    overlay.hidden = false;
  }
}

start();
