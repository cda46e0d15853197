// Figures that can be read and zoomed. Python draws them (plotting.py); this reads the points back from the drawn curves,
// says the values of the one under the pointer or the keys, and stretches what lies inside the axes when a range is chosen.
// All geometry is in the drawing's own units; `window` is the part of the axes' box that fills it when zoomed.

const PAIR = /(-?[\d.]+(?:e-?\d+)?) (-?[\d.]+(?:e-?\d+)?)/g;
const DRAG = 5; // units that make a press a drag
const NARROWEST = 1e-4; // of the box

/** A value as short text: four digits, powers of ten beyond 10⁻³ and 10⁵. */
function shortly(value) {
  if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5)) return String(Number(value.toPrecision(4)));
  const [mantissa, power] = value.toExponential(3).split("e");
  return `${Number(mantissa)} · 10${[...String(Number(power))].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
}

/** One direction of one axes: places on the page and values. `from` and `to` are where its limits are drawn. */
class Scale {
  constructor({ label, limits, scale }, from, to) {
    this.label = label.replace(/ \(.*\)$/, "");
    this.log = scale === "log";
    this.limits = limits.map((x) => this.bent(x));
    Object.assign(this, { from, to });
  }

  bent(value) {
    return this.log ? Math.log10(value) : value;
  }

  value(place) {
    const [low, high] = this.limits, x = low + ((place - this.from) / (this.to - this.from)) * (high - low);
    return this.log ? 10 ** x : x;
  }

  place(value) {
    const [low, high] = this.limits;
    return this.from + ((this.bent(value) - low) / (high - low)) * (this.to - this.from);
  }

  /** Round values between two places: about five, or whole decades. */
  ticks(a, b) {
    const [low, high] = [this.value(a), this.value(b)].sort((x, y) => x - y);
    if (this.log && high / low > 5) {
      const decades = Math.log10(high / low), steps = decades < 2 ? [1, 2, 5] : [1], found = [];
      const every = Math.ceil(decades / 6);
      for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += every) {
        found.push(...steps.map((step) => step * 10 ** power));
      }
      return found.filter((x) => x >= low && x <= high);
    }
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough), found = [];
    for (let i = Math.ceil(low / step); i <= high / step; i++) found.push(i * step);
    return found;
  }
}

export class Plot {
  constructor(svg) {
    this.svg = svg;
    this.frame = svg.parentElement;
    const all = JSON.parse(svg.dataset.axes), [left, top, right, bottom] = all[0].box;
    this.home = { x: [left, right], y: [top, bottom] };
    this.window = { x: [left, right], y: [top, bottom] };
    this.axes = all.map(({ x, y }) => ({ x: new Scale(x, left, right), y: new Scale(y, bottom, top) }));
    this.readCurves();
    this.readInside();
    this.addParts();
    this.listen();
  }

  // What Python drew

  readCurves() {
    this.curves = [...this.svg.querySelectorAll(".ldsim-curve")].map((group) => {
      const path = group.querySelector("path[clip-path]");
      const points = Array.from((path?.getAttribute("d") ?? "").matchAll(PAIR), ([, x, y]) => [Number(x), Number(y)]);
      return { name: group.dataset.name, axes: this.axes[group.dataset.axes], points };
    });
  }

  /** Everything that moves when zoomed, with how it was drawn. */
  readInside() {
    this.inside = [];
    for (const element of this.svg.querySelectorAll("[clip-path]")) {
      if (element.closest(".ldsim-axis")) continue;
      if (element.tagName === "path") this.inside.push({ element, d: element.getAttribute("d") });
      for (const use of element.querySelectorAll("use")) {
        this.inside.push({ element: use, x: Number(use.getAttribute("x")), y: Number(use.getAttribute("y")) });
      }
    }
    this.notes = [...this.svg.querySelectorAll(".ldsim-note")].map((element) => {
      const [x, y] = JSON.parse(element.dataset.name), scales = this.axes[element.dataset.axes];
      return { element, x: x === null ? null : scales.x.place(x), y: y === null ? null : scales.y.place(y) };
    });
    this.rulers = [...this.svg.querySelectorAll(".ldsim-axis")].map((group) => {
      const ticks = [...group.children].filter((child) => !child.classList.contains("ldsim-label"));
      return { ticks, name: group.dataset.name, axes: Number(group.dataset.axes), group };
    });
  }

  addParts() {
    const make = (name, className, parent) => {
      const element = document.createElementNS("http://www.w3.org/2000/svg", name);
      element.setAttribute("class", className);
      return parent.appendChild(element);
    };
    this.make = make;
    this.choice = make("rect", "choice", this.svg);
    this.dot = make("circle", "dot", this.svg);
    this.dot.setAttribute("r", 4);
    this.told = document.createElement("div");
    this.told.className = "told";
    this.told.setAttribute("role", "status");
    this.whole = document.createElement("button");
    Object.assign(this.whole, { className: "whole", type: "button", textContent: "Whole range", hidden: true });
    this.frame.append(this.told, this.whole);
    this.frame.classList.add("live");
    this.frame.tabIndex = 0;
    this.frame.setAttribute("role", "group");
    const title = this.svg.querySelector("title").textContent;
    const keys = "Left and right read a curve, up and down change it, plus and minus zoom, zero shows the whole range.";
    this.frame.setAttribute("aria-label", `${title}. ${keys}`);
    this.svg.querySelector("title").remove(); // its tooltip would lie over the values
    this.svg.setAttribute("aria-label", title);
    this.hide();
  }

  // Zooming

  /** Where a place of the unzoomed drawing is now, along x or y. */
  moved(place, name) {
    const [a, b] = this.window[name], [from, to] = this.home[name];
    return from + ((place - a) / (b - a)) * (to - from);
  }

  /** The reverse. */
  unmoved(place, name) {
    const [a, b] = this.window[name], [from, to] = this.home[name];
    return a + ((place - from) / (to - from)) * (b - a);
  }

  /** Shows the part of the drawing between two places along x, y or both; what leaves the drawing is cut. */
  zoom(ranges) {
    for (const [name, range] of Object.entries(ranges)) {
      const [low, high] = this.home[name], least = NARROWEST * (high - low);
      let [a, b] = range.map((place) => Math.min(high, Math.max(low, place))).sort((x, y) => x - y);
      if (b - a < least) [a, b] = [Math.min(a, high - least), Math.min(a, high - least) + least];
      this.window[name] = [a, b];
    }
    this.redraw();
  }

  reset() {
    this.zoom(this.home);
  }

  redraw() {
    const x = (place) => this.moved(place, "x"), y = (place) => this.moved(place, "y");
    for (const part of this.inside) {
      if (part.d !== undefined) {
        const d = part.d.replace(PAIR, (_, a, b) => `${x(Number(a)).toFixed(3)} ${y(Number(b)).toFixed(3)}`);
        part.element.setAttribute("d", d);
      } else {
        part.element.setAttribute("x", x(part.x).toFixed(3));
        part.element.setAttribute("y", y(part.y).toFixed(3));
      }
    }
    for (const { element, ...at } of this.notes) {
      const shift = ["x", "y"].map((name) => (at[name] === null ? 0 : this.moved(at[name], name) - at[name]));
      const seen = ["x", "y"].every((name) => at[name] === null || this.holds(this.moved(at[name], name), name));
      element.setAttribute("transform", `translate(${shift})`);
      element.style.display = seen ? "" : "none";
    }
    for (const ruler of this.rulers) this.redrawRuler(ruler);
    this.whole.hidden = !this.zoomed("x") && !this.zoomed("y");
    if (this.at) this.tell(...this.at);
  }

  zoomed(name) {
    return this.window[name].some((place, i) => place !== this.home[name][i]);
  }

  /** Whether a place on the page is inside the axes, along x or y. */
  holds(place, name) {
    return place >= this.home[name][0] - 0.01 && place <= this.home[name][1] + 0.01;
  }

  /** Python's ticks for the whole range, new ones in their style for a part of it. */
  redrawRuler({ ticks, name, axes, group }) {
    const zoomed = this.zoomed(name), scale = this.axes[axes][name];
    for (const tick of ticks) tick.style.display = zoomed ? "none" : "";
    group.querySelector(".ticks")?.remove();
    const pattern = ticks.map((tick) => ({ text: tick.querySelector("text"), grid: tick.querySelector("path[clip-path]") }));
    const like = pattern.find(({ text }) => text);
    if (!zoomed || !like || !scale.label) return;
    const fresh = this.make("g", "ticks", group);
    for (const value of scale.ticks(...this.window[name])) {
      const place = this.moved(scale.place(value), name), [low, high] = this.home[name === "x" ? "y" : "x"];
      if (like.grid) {
        const line = this.make("path", "", fresh);
        line.setAttribute("style", like.grid.getAttribute("style"));
        line.setAttribute("d", name === "x" ? `M ${place} ${low} L ${place} ${high}` : `M ${low} ${place} L ${high} ${place}`);
      }
      const text = this.make("text", "", fresh), at = { x: like.text.getAttribute("x"), y: like.text.getAttribute("y") };
      at[name] = name === "x" ? place : place + 3.2; // half the height of a digit below the tick
      text.setAttribute("style", like.text.getAttribute("style"));
      text.setAttribute("x", at.x);
      text.setAttribute("y", at.y);
      text.textContent = shortly(value);
    }
  }

  // Reading values

  /** Marks a curve's point and says its values. */
  tell(curve, index) {
    this.at = [curve, index];
    const { name, axes, points } = curve, [x, y] = points[index], places = [this.moved(x, "x"), this.moved(y, "y")];
    const seen = this.holds(places[0], "x") && this.holds(places[1], "y");
    this.dot.style.display = this.told.style.display = seen ? "" : "none";
    this.dot.setAttribute("cx", places[0]);
    this.dot.setAttribute("cy", places[1]);
    const lines = [[axes.x, x], [axes.y, y]].filter(([scale]) => scale.label);
    const head = document.createElement("b");
    head.textContent = name;
    this.told.replaceChildren(head, ...lines.flatMap(([scale, place]) => {
      const value = document.createElement("span");
      value.textContent = ` ${scale.label}: ${shortly(scale.value(place))}`;
      return [document.createElement("br"), value];
    }));
    const box = this.svg.getBoundingClientRect(), own = this.frame.getBoundingClientRect(), unit = box.width / this.width;
    const left = box.left - own.left + places[0] * unit, top = box.top - own.top + places[1] * unit;
    const aside = left + 14 + this.told.offsetWidth > own.width ? left - 14 - this.told.offsetWidth : left + 14;
    this.told.style.left = `${Math.max(0, aside)}px`;
    this.told.style.top = `${Math.max(0, top - this.told.offsetHeight - 8)}px`;
  }

  hide() {
    this.at = null;
    for (const part of [this.dot, this.told, this.choice]) part.style.display = "none";
  }

  get width() {
    return this.svg.viewBox.baseVal.width;
  }

  /** The pointer in the drawing's units. */
  pointer(event) {
    const box = this.svg.getBoundingClientRect(), unit = this.width / box.width;
    return [(event.clientX - box.left) * unit, (event.clientY - box.top) * unit];
  }

  tellNearest([x, y]) {
    let nearest = Infinity, found = null;
    for (const curve of this.curves) {
      curve.points.forEach(([px, py], index) => {
        const at = [this.moved(px, "x"), this.moved(py, "y")], distance = Math.hypot(at[0] - x, at[1] - y);
        if (distance < nearest && this.holds(at[0], "x") && this.holds(at[1], "y")) [nearest, found] = [distance, [curve, index]];
      });
    }
    if (found) this.tell(...found);
    else this.hide();
  }

  // Pointer and keys

  listen() {
    const on = (event, action) => this.svg.addEventListener(event, action);
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.up(event));
    on("pointercancel", () => this.cancel());
    on("pointerleave", (event) => event.pointerType === "mouse" && !this.from && this.hide());
    on("dblclick", () => this.reset());
    this.whole.addEventListener("click", () => this.reset());
    this.frame.addEventListener("keydown", (event) => this.key(event));
    this.frame.addEventListener("focusout", () => this.hide());
  }

  down(event) {
    if (event.button !== 0) return;
    this.from = this.pointer(event);
    this.svg.setPointerCapture(event.pointerId);
  }

  move(event) {
    const to = this.pointer(event), range = this.from && this.range(to);
    if (!range) {
      if (event.pointerType === "mouse") this.tellNearest(to);
      return;
    }
    this.hide();
    const [x, y] = [range.x ?? this.home.x, range.y ?? this.home.y];
    const sizes = { x: Math.min(...x), y: Math.min(...y), width: Math.abs(x[1] - x[0]), height: Math.abs(y[1] - y[0]) };
    for (const [name, value] of Object.entries(sizes)) this.choice.setAttribute(name, value);
    this.choice.style.display = "";
  }

  up(event) {
    const to = this.pointer(event), range = this.from && this.range(to);
    this.cancel();
    if (!range) {
      this.tellNearest(to);
      return;
    }
    const places = Object.entries(range).map(([name, ends]) => [name, ends.map((place) => this.unmoved(place, name))]);
    this.zoom(Object.fromEntries(places));
  }

  cancel() {
    this.from = null;
    this.choice.style.display = "none";
  }

  /** What a drag to here chooses on the page: a range of x, of y, or of both; null while it is a press. */
  range(to) {
    const size = to.map((place, i) => Math.abs(place - this.from[i]));
    if (Math.max(...size) < DRAG) return null;
    const clipped = (i, name) => [this.from[i], to[i]].map((at) => Math.min(this.home[name][1], Math.max(this.home[name][0], at)));
    const along = {};
    if (size[0] > size[1] / 2) along.x = clipped(0, "x");
    if (size[1] > size[0] / 2) along.y = clipped(1, "y");
    return along;
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.frame || !this.curves.length) return;
    const keys = {
      ArrowLeft: () => this.step(-1),
      ArrowRight: () => this.step(1),
      ArrowUp: () => this.change(-1),
      ArrowDown: () => this.change(1),
      "+": () => this.zoomAbout(1 / 2),
      "=": () => this.zoomAbout(1 / 2),
      "-": () => this.zoomAbout(2),
      0: () => this.reset(),
      Escape: () => this.hide(),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  /** The next or previous point of the curve that is in sight. */
  step(by) {
    const [curve, index] = this.at ?? [this.curves[0], by > 0 ? -1 : this.curves[0].points.length];
    const inSight = (i) => curve.points[i] && ["x", "y"].every((name, axis) => this.holds(this.moved(curve.points[i][axis], name), name));
    let next = index + by;
    while (curve.points[next] && !inSight(next)) next += by;
    if (curve.points[next]) this.tell(curve, next);
  }

  /** Another curve, at its point nearest along x. */
  change(by) {
    const [curve, index] = this.at ?? [this.curves.at(by > 0 ? -1 : 0), 0], count = this.curves.length;
    const next = this.curves[(this.curves.indexOf(curve) + by + count) % count];
    const x = curve.points[index][0], apart = next.points.map((point) => Math.abs(point[0] - x));
    this.tell(next, apart.indexOf(Math.min(...apart)));
  }

  /** Zooms x by a factor about the point that is told, or the middle. */
  zoomAbout(factor) {
    const [a, b] = this.window.x, middle = this.at ? this.at[0].points[this.at[1]][0] : (a + b) / 2;
    this.zoom({ x: [middle - factor * (middle - a), middle + factor * (b - middle)] });
  }
}
