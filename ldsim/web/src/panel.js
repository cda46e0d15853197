// The controls and the numbers beside the picture.

import { byId, digits, fixed, gradient, make } from "./dom.js";

/** "linear_20" as "Linear 20", and the class of its colour, linear. */
const titled = (space) => (space[0].toUpperCase() + space.slice(1)).replace("_", " ");
const toned = (space) => space.split("_")[0];
const [NARROW, LOW] = [640, 540]; // pixels of a window, or a notebook's cell, in which the controls would cover the solid: they begin folded
const OUTCOMES = ["", "stopped early", "slowed", "held"];
const KEYS = { " ": "pause", ".": "step", s: "step", r: "reset", u: "undo", 0: "home", c: "capture", "?": "help", h: "help" };
/** What a button with a sign does, for whoever points at it and whoever hears the page. */
const explain = (name, text) => ["title", "aria-label"].forEach((attribute) => byId(name).setAttribute(attribute, text));
const TILTS = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };

export class Panel {
  /** axes: along which gravity is tilted; send: to what steps; local: what the page itself does, by name. */
  constructor(solid, axes, send, local) {
    Object.assign(this, { solid, axes, send, tilt: [0, 0] });
    document.title = `${solid.title} · ldsim`;
    byId("title").textContent = byId("title").title = solid.title;
    byId("subtitle").textContent = solid.subtitle;
    byId("ramp").style.background = gradient();
    byId("pause").onclick = () => send("pause", { value: !this.status.paused });
    byId("step").onclick = () => send("step");
    byId("reset").onclick = () => send("reset");
    byId("undo").onclick = () => send("undo");
    byId("speed").onchange = () => send("speed", { value: Number(byId("speed").value) });
    byId("stiffness").oninput = () => send("stiffness", { value: 10 ** Number(byId("stiffness").value) });
    byId("gravity").onchange = () => this.sendGravity();
    byId("colour").onchange = () => {
      local.colour(byId("colour").value);
      send("colour", { value: byId("colour").value });
    };
    byId("points").onchange = () => local.points(byId("points").checked);
    byId("wireframe").onchange = () => local.wireframe(byId("wireframe").checked);
    byId("theme").onclick = () => local.theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    byId("home").onclick = () => local.home();
    byId("capture").onclick = () => local.capture();
    byId("help").onclick = () => byId("manual").showModal();
    if (innerWidth <= NARROW || innerHeight <= LOW) document.body.classList.add("folded");
    byId("fold").onclick = () => document.body.classList.toggle("folded");
    byId("record").onclick = () => send("record", { value: !this.status.recorder.recording });
    byId("replay").onclick = () => send("replay", { value: !this.status.player.playing });
    byId("motions").onchange = () => send("take", { value: byId("motions").value });
    byId("discard").onclick = () => send("discard", { value: this.status.player.chosen });
    // Not every page can do everything: where it steps by itself, or records, some of it is not offered.
    for (const element of document.querySelectorAll(`[data-not~=${solid.mode}]`)) element.remove();
    this.makeTilt();
    addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const commanded = event.ctrlKey || event.metaKey, press = commanded ? event.key === "z" && "undo" : KEYS[event.key];
    if (!press || event.target.closest?.("button, select, input, summary")) return;
    event.preventDefault();
    byId(press).click();
  }

  /** A pad on which the direction of gravity is dragged; a double click sets it upright. */
  makeTilt() {
    const pad = byId("tilt");
    const set = (event) => {
      const { left, top, width, height } = pad.getBoundingClientRect();
      this.setTilt((2 * (event.clientX - left)) / width - 1, (2 * (event.clientY - top)) / height - 1);
    };
    pad.onpointerdown = (event) => {
      pad.setPointerCapture(event.pointerId);
      set(event);
    };
    pad.onpointermove = (event) => event.buttons && set(event);
    pad.ondblclick = () => this.setTilt(0, 0);
    pad.onkeydown = ({ key }) => TILTS[key] && this.setTilt(this.tilt[0] + TILTS[key][0], this.tilt[1] + TILTS[key][1]);
  }

  setTilt(x, y) {
    const length = Math.max(1, Math.hypot(x, y));
    this.tilt = [x / length, y / length];
    byId("needle").style.transform = `translate(${50 * this.tilt[0]}%, ${50 * this.tilt[1]}%)`;
    const angle = Math.round(90 * Math.hypot(...this.tilt));
    byId("tilt").setAttribute("aria-valuenow", angle);
    byId("tilt").setAttribute("aria-valuetext", `${angle}° from upright`);
    byId("gravity").checked = true;
    this.sendGravity();
  }

  sendGravity() {
    const { up, right, toward } = this.axes, [x, y] = this.tilt, away = Math.hypot(x, y);
    const down = Math.cos((away * Math.PI) / 2), aside = away > 0 ? Math.sin((away * Math.PI) / 2) / away : 0;
    const size = byId("gravity").checked ? Math.hypot(...this.solid.gravity) || 9.81 : 0;
    this.send("gravity", { value: up.map((u, i) => size * (-down * u + aside * (x * right[i] + y * toward[i]))) });
  }

  show(status) {
    this.status = status;
    byId("pause").textContent = status.paused ? "▶" : "❚❚";
    explain("pause", status.paused ? "Go on (space)" : "Pause (space)");
    byId("speed").value = String(status.speed);
    byId("stiffness").value = String(Math.log10(status.stiffness));
    byId("stiffness-value").textContent = `× ${status.stiffness.toFixed(status.stiffness < 1 ? 2 : 1)}`;
    byId("gravity").checked = status.gravity.some((x) => x !== 0);
    byId("colour").value = status.colour;
    this.showSpaces(status);
    byId("recorder").hidden = status.recorder === null;
    document.body.classList.toggle("recording", Boolean(status.recorder?.recording));
    this.showPlayer(status);
    if (!status.recorder) return;
    const { recording, file } = status.recorder;
    byId("record").textContent = recording ? "■ Stop" : "● Record";
    byId("file").textContent = status.player.chosen ? "" : `A take goes to ${file}.`;
  }

  /** The motions of a run, or the takes recorded here. */
  showPlayer({ player, recorder }) {
    byId("player").hidden = !player?.chosen;
    if (byId("player").hidden) return;
    const { playing, motions, chosen } = player, busy = playing || Boolean(recorder?.recording);
    byId("replay").textContent = playing ? "■" : "▶";
    explain("replay", playing ? "Stop" : "Play this motion from rest");
    byId("replay").disabled = Boolean(recorder?.recording);
    for (const name of ["motions", "discard"]) byId(name).disabled = busy;
    byId("discard").hidden = !recorder;
    const entries = Object.entries(motions).map(([name, words]) => make("option", { value: name }, `${name} · ${words}`));
    byId("motions").replaceChildren(...entries);
    byId("motions").value = chosen;
    byId("motions").title = byId("motions").selectedOptions[0]?.textContent ?? ""; // the panel may be too narrow for it
  }

  showSpaces({ offered, spaces }) {
    byId("spaces").hidden = offered.length < 2;
    const buttons = offered.map((name) => {
      const button = make("button", { class: `space ${toned(name)}`, "aria-pressed": spaces.includes(name) }, titled(name));
      button.onclick = () => {
        const next = offered.filter((other) => (other === name) !== this.status.spaces.includes(other));
        if (!next.length) return;
        this.status.spaces = next; // the next click may come before the server's word
        this.send("spaces", { value: next });
      };
      return button;
    });
    byId("spaces").replaceChildren(...buttons);
  }

  /** Numbers of a frame, twice a second; gives back what the label of each solid says. */
  statistics(frame, spaces, pictures) {
    const { seconds, bytes, share } = frame;
    const cost = bytes ? `${bytes} B a frame` : `${Math.round(100 * share)} % of real time`;
    byId("clock").textContent = `${fixed(seconds, 2)} s simulated`;
    const counts = frame.spaces.map(({ iterations, evaluations }, i) => {
      return `${titled(spaces[i])}: ${fixed(iterations, 1)} iterations, ${fixed(evaluations, 1)} evaluations a step`;
    });
    byId("details").textContent = [...counts, `${fixed(pictures, 0)} pictures/s`, cost].join(" · ");
    const rows = frame.spaces.map(({ milliseconds, outcome, troubled, novelty, distance, error }, i) => {
      const time = frame.paused && !milliseconds ? "–" : `${fixed(milliseconds, milliseconds < 1 ? 3 : 1)} ms`;
      const state = OUTCOMES[outcome] || (novelty > 1 ? "unfamiliar" : troubled ? `${troubled} not solved` : "fine");
      const off = Number.isFinite(distance) ? `${digits(1000 * distance, 2)} mm` : "";
      const whole = Number.isFinite(error) ? `${digits(100 * error, 2)} %` : "";
      const alarming = outcome > 1 || novelty > 1 ? "alarming" : "";
      return { name: spaces[i], time, state, off, whole, alarming };
    });
    byId("statistics").replaceChildren(...rows.map(({ name, time, state, alarming }) => {
      const cells = [time, state].map((text) => make("td", {}, text));
      return make("tr", { class: `${toned(name)} ${alarming}` }, make("th", {}, titled(name)), ...cells);
    }));
    return rows.map(({ name, time, off, whole }) => {
      return [make("b", {}, titled(name)), ` ${time}`, ...(off ? [make("br"), `${off} off, ${whole} so far`] : [])];
    });
  }

  /** The ends of the colour scale, or null for none. */
  legend(ends) {
    byId("legend").hidden = ends === null;
    if (ends !== null) [byId("low").textContent, byId("high").textContent] = ends;
  }

  notice(text, sticky = false) {
    clearTimeout(this.clearing);
    byId("notice").textContent = text;
    byId("notice").hidden = text === "";
    if (!sticky) this.clearing = setTimeout(() => (byId("notice").hidden = true), 6000);
  }
}
