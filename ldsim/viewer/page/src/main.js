// The page: fetches the solid, links to the server, draws what it sends, and sends what the hand does.

import { withCreases } from './creases.js';
import { Hand } from './hand.js';
import { Link, fetchBlock } from './link.js';
import { Panel } from './panel.js';
import { Stage } from './stage.js';

const UNITS = { energy: 'J/m³', stress: 'Pa' };
const options = new URLSearchParams(location.search);

function fail(text) {
  const overlay = document.getElementById('overlay');
  overlay.textContent = text;
  overlay.hidden = false;
}

/** A number with three digits and a unit prefix. */
function short(value) {
  const power = value > 0 ? Math.max(-1, Math.min(2, Math.floor(Math.log10(value) / 3))) : 0;
  return `${Number((value / 1000 ** power).toPrecision(3))} ${{ '-1': 'm', 0: '', 1: 'k', 2: 'M' }[power]}`;
}

class Page {
  constructor(solid) {
    this.solid = solid;
    this.stage = new Stage(document.getElementById('stage'), solid, Object.fromEntries(options));
    const { up, right, toward } = this.stage;
    const strength = Math.hypot(...solid.gravity) || 9.81;
    solid.frame = { up: up.toArray(), right: right.toArray(), toward: toward.toArray(), strength };
    this.spaces = new Map();
    this.shown = [];
    this.frame = null;
    this.times = [];
    const send = (kind, values) => this.link.send(kind, values);
    this.panel = new Panel(solid, send, {
      theme: (name) => this.stage.setTheme(name),
      colour: (name) => this.setColour(name),
      points: (visible) => this.stage.bodies.forEach((body) => body.setPoints(visible)),
      wireframe: (on) => this.stage.bodies.forEach((body) => (body.material.wireframe = on)),
    });
    this.hand = new Hand(this.stage, send, solid.mode);
    this.stage.setTheme(matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark');
    this.link = new Link({
      frame: (frame) => (this.frame = frame),
      colours: (colours) => this.showColours(colours),
      status: (status) => this.setStatus(status),
      notice: ({ text }) => this.panel.notice(text),
      lost: () => {
        this.panel.notice('The connection is lost; trying again …', true);
        document.body.classList.add('lost');
      },
      found: () => {
        this.panel.notice('Connected again');
        document.body.classList.remove('lost');
      },
    });
    this.drawn = 0;
    requestAnimationFrame(() => this.draw());
    setInterval(() => this.statistics(), 500);
  }

  async setStatus(status) {
    this.panel.show(status);
    if (status.spaces.join() === this.shown.join()) return;
    this.shown = status.spaces;
    const missing = status.spaces.filter((name) => !this.spaces.has(name));
    for (const name of missing) this.spaces.set(name, await fetchBlock(`space/${name}`));
    if (this.shown !== status.spaces) return;
    this.stage.setSpaces(status.spaces.map((name) => this.spaces.get(name)));
    const { points, wireframe } = Object.fromEntries(['points', 'wireframe'].map((id) => [id, document.getElementById(id).checked]));
    for (const body of this.stage.bodies) {
      body.setPoints(points);
      body.material.wireframe = wireframe;
    }
    this.setColour(status.colour);
  }

  setColour(name) {
    const mode = { plain: 0, displacement: 1, distrust: 0 }[name] ?? 2;
    this.stage.bodies.forEach((body) => body.setMode(mode));
    this.panel.legend(mode === 1 ? ['0', `${short(this.stage.diagonal / 4)}m`] : mode === 2 ? ['0', '…'] : name === 'distrust' ? ['as trained', 'far away'] : null);
    this.colour = name;
  }

  showColours({ space, high, values }) {
    const body = this.stage.bodies[space];
    if (!body || values.length !== this.solid.own) return;
    body.setShade(values);
    if (this.colour in UNITS) this.panel.legend(['0', `${short(high)}${UNITS[this.colour]}`]);
  }

  /** The newest frame on the bodies, once: none where spaces are just changing. */
  apply() {
    const { frame, stage } = this;
    if (!frame || frame.number === this.applied) return;
    if (frame.spaces.length !== stage.bodies.length) return;
    if (frame.spaces.some((space, i) => space.q.length !== stage.bodies[i].q.length)) return;
    frame.spaces.forEach((space, i) => {
      stage.bodies[i].show(space.q);
      if (this.colour === 'distrust') stage.bodies[i].setDistrust(space.distrust);
    });
    stage.setGrabs(frame.grabs);
    this.applied = frame.number;
  }

  draw() {
    requestAnimationFrame(() => this.draw());
    this.apply();
    this.stage.draw();
    this.drawn += 1;
    this.times.push(performance.now());
    if (this.times.length > 40) this.times.shift();
  }

  statistics() {
    if (!this.frame || this.frame.spaces.length !== this.shown.length) return;
    const span = this.times.at(-1) - this.times[0];
    this.panel.statistics(this.frame, this.shown, (1000 * (this.times.length - 1)) / span);
  }

  /** For tests: what is drawn, where, and how. */
  get probe() {
    const { stage } = this;
    return {
      ready: stage.bodies.length > 0 && this.applied !== undefined,
      drawn: this.drawn,
      frame: this.frame?.number,
      bytes: this.frame?.bytes,
      grabs: this.frame?.grabs.length,
      gpu: stage.gpu,
      software: stage.software,
      q: (i) => Array.from(stage.bodies[i].q),
      positions: (i) => Array.from(stage.bodies[i].current().subarray(0, 3 * this.solid.own)),
      decoded: (i) => Array.from(stage.bodies[i].decoder.read(this.solid.own)),
      screen: (i, vertex) => stage.toScreen(Array.from(stage.bodies[i].current().subarray(3 * vertex, 3 * vertex + 3)), stage.bodies[i]),
      place: (i, point) => stage.toScreen(point, stage.bodies[i]),
      disconnect: () => this.link.socket.close(),
    };
  }
}

fetchBlock('solid')
  .then((solid) => {
    const page = new Page(withCreases(solid));
    Object.defineProperty(window, 'ldsim', { get: () => page.probe });
    document.getElementById('overlay').hidden = true;
  })
  .catch((error) => {
    const graphics = /webgl/i.test(error.message);
    fail(graphics ? 'This browser has no WebGL 2; try another, or turn on hardware acceleration.' : `ldsim cannot be reached: ${error.message}`);
  });
