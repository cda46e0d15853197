// Figures that can be read and zoomed, drawn from their numbers (report/figure.py): curves and marks on one or two scales,
// the values of the point under the pointer or the keys, and any range of the axes when one is chosen.

import { digits, draw, make } from "./dom.js";

const WIDTH = 374, UNIT = 72; // of a drawing; its height is told in units
const DRAG = 5; // that make a press a drag
const NARROWEST = 1e-4; // of the whole range
const LETTER = 5.5; // its width on average, in the widest of usual fonts
const KEYS = "Left and right read a curve, up and down change it, plus and minus zoom, zero shows the whole range.";
const SHAPES = {
  circle: "M-1 0a1 1 0 1 0 2 0a1 1 0 1 0-2 0",
  square: "M-.9-.9h1.8v1.8h-1.8z",
  diamond: "M0-1.25L1.25 0L0 1.25L-1.25 0z",
  triangle: "M0-1.2L1.15.9h-2.3z",
};

/** A value as short text: four digits, powers of ten beyond 10⁻³ and 10⁵. */
function shortly(value) {
  if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5)) return digits(value, 4);
  const [mantissa, power] = value.toExponential(3).split("e").map(Number);
  const exponent = [...String(power)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
  return `${mantissa === 1 ? "" : `${mantissa} · `}10${exponent}`;
}

const tone = ({ colour }) => ({ style: `--tone: var(--${colour})` });
const words = (...classes) => classes.filter(Boolean).join(" ");

/** A new element of a drawing at the end of `parent`. */
function put(parent, tag, attributes, text = "") {
  parent.append(draw(tag, attributes));
  parent.lastChild.textContent = text;
  return parent.lastChild;
}

function putMark(parent, { marker, dashed }, radius, transform) {
  const look = { class: words("mark", dashed && "hollow"), "vector-effect": "non-scaling-stroke" };
  put(parent, "path", { ...look, d: SHAPES[marker], transform: `${transform} scale(${radius})` });
}

/** Places on the way to one, some four units apart. */
function along([a, b], [c, d]) {
  const count = Math.max(1, Math.ceil(Math.hypot(c - a, d - b) / 4));
  return Array.from({ length: count }, (_, i) => [a + ((c - a) * (i + 1)) / count, b + ((d - b) * (i + 1)) / count]);
}

const putLine = (parent, { kind, dashed, faint }, d) =>
  put(parent, "path", { class: words("curve", kind, dashed && "dashed", faint && "faint"), d });

/** One axis: values, places in the drawing, and which share of the whole range is in sight. */
class Scale {
  constructor(axis, values) {
    Object.assign(this, axis, { window: [0, 1] });
    const bent = values.map((value) => this.bent(value)).filter(Number.isFinite);
    const low = Math.min(...bent), high = Math.max(...bent), rim = this.margin * (high - low || 1);
    this.whole = this.names.length ? [this.names.length - 0.4, -0.6] : [this.zero ? 0 : low - rim, high + rim];
  }

  bent(value) { return this.log ? Math.log10(value) : value; }
  /** How far along the whole range a value is, 0 to 1. */
  share(value) { return (this.bent(value) - this.whole[0]) / (this.whole[1] - this.whole[0]); }
  shareAt(place) {
    return this.window[0] + ((place - this.from) / (this.to - this.from)) * (this.window[1] - this.window[0]);
  }
  place(value) {
    return this.from + ((this.share(value) - this.window[0]) / (this.window[1] - this.window[0])) * (this.to - this.from);
  }
  value(place) {
    const bent = this.whole[0] + this.shareAt(place) * (this.whole[1] - this.whole[0]);
    return this.log ? 10 ** bent : bent;
  }
  holds(value) {
    const share = this.share(value);
    return share >= this.window[0] - 1e-6 && share <= this.window[1] + 1e-6;
  }

  /** Shows the range between two shares of the whole. */
  zoom(...ends) {
    const [low, high] = ends.map((share) => Math.min(1, Math.max(0, share))).sort((a, b) => a - b);
    const start = Math.min(low, 1 - NARROWEST);
    this.window = [start, Math.max(high, start + NARROWEST)];
  }
  get zoomed() { return this.window[0] > 0 || this.window[1] < 1; }

  /** Round values in sight: about five, or whole decades. */
  ticks() {
    if (this.names.length) return this.names.map((_, row) => row).filter((row) => this.holds(row));
    const low = this.value(this.from), high = this.value(this.to), found = [];
    if (this.log && high / low > 5) {
      const decades = Math.log10(high / low), steps = decades < 2 ? [1, 2, 5] : [1], every = Math.ceil(decades / 6);
      for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += every) {
        found.push(...steps.map((step) => step * 10 ** power));
      }
      return found.filter((value) => value >= low && value <= high);
    }
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
    for (let i = Math.ceil(low / step); i <= high / step; i++) found.push(i * step);
    return found;
  }
  words(value) { return this.names.length ? this.names[value] : shortly(value); }
  told(value) { return `${this.label ? `${this.label.replace(/ \(.*\)$/, "")}: ` : ""}${this.words(value)}`; }
}

export class Plot {
  static count = 0;

  constructor(frame) {
    this.frame = frame;
    this.data = JSON.parse(frame.querySelector("script").textContent);
    this.makeScales();
    this.series = this.data.series.map((series) => {
      const x = this.x, y = series.right ? this.right : this.y, points = series.x.map((value, i) => [value, series.y[i]]);
      return { ...series, scales: [x, y], points: points.filter(([a, b]) => isFinite(x.share(a)) && isFinite(y.share(b))) };
    });
    this.curves = this.series.filter(({ kind, points }) => kind !== "link" && points.length);
    this.makeParts();
    this.redraw();
    this.listen();
  }

  makeScales() {
    const { x, y, right, series, guides, height } = this.data;
    const scale = (axis, name, pick) => new Scale(axis, [
      ...series.flatMap(pick), ...guides.filter((guide) => guide.axis === name).map(({ at }) => at),
    ]);
    this.x = scale(x, "x", (one) => one.x);
    this.y = scale(y, "y", (one) => (one.right ? [] : one.y));
    this.right = right && scale(right, "right", (one) => (one.right ? one.y : []));
    this.height = height * UNIT;
    for (const upright of [this.y, this.right]) if (upright) Object.assign(upright, { from: this.height - 32, to: 6 });
    const widest = (one) => LETTER * Math.max(...one.ticks().map((value) => one.words(value).length));
    this.x.from = 10 + widest(this.y) + (y.label ? 14 : 0);
    this.x.to = WIDTH - (right ? 22 + widest(this.right) : 8);
  }

  makeParts() {
    const { frame, data } = this;
    this.clip = `plot-${Plot.count++}`;
    this.svg = draw("svg", { viewBox: `0 0 ${WIDTH} ${this.height}`, role: "img", "aria-label": data.title });
    this.told = make("div", { class: "told", role: "status" });
    this.whole = make("button", { class: "whole", type: "button" }, "Whole range");
    frame.append(make("div", { class: "legend" }, ...this.entries()), this.svg, this.told, this.whole);
    Object.assign(frame, { tabIndex: 0, role: "group", ariaLabel: `${data.title}. ${KEYS}` }).classList.add("live");
  }

  /** Of the legend: each name once, with a sample of its look. */
  entries() {
    const names = new Map(Object.keys(this.data.shades ?? {}).map((name) => [name, null]));
    for (const series of this.curves) if (!names.has(series.name)) names.set(series.name, series);
    if (names.size === 1 && names.has(this.data.y.label)) return [];
    return [...names].map(([name, series]) => {
      const sample = draw("svg", { viewBox: "0 0 22 10", ...tone(series ?? {}) });
      if (!series) put(sample, "rect", { class: "shade", width: 22, height: 10 });
      if (series?.kind === "line") putLine(sample, series, "M0 5H22");
      if (series?.marker) putMark(sample, series, 3, "translate(11 5)");
      return make("span", {}, sample, series?.right ? `${name} (right)` : name);
    });
  }

  // Drawing

  redraw() {
    const { x, y, svg, data } = this, area = { x: x.from, y: y.to, width: x.to - x.from, height: y.from - y.to };
    svg.replaceChildren();
    put(put(svg, "clipPath", { id: this.clip }), "rect", area);
    this.drawRulers(put(svg, "g", { class: "rulers" }));
    const inside = put(svg, "g", { "clip-path": `url(#${this.clip})` });
    for (const ends of Object.values(data.shades ?? {}).flat()) {
      const [begin, end] = ends.map((value) => x.place(value));
      put(inside, "rect", { ...area, class: "shade", x: begin, width: end - begin });
    }
    this.taken = this.covered();
    for (const series of this.series) this.drawSeries(series, put(inside, "g", tone(series)));
    const guides = data.guides.toSorted((a, b) => (b.axis === "x") - (a.axis === "x")); // level ones find a place beside upright ones
    for (const guide of guides) if (this[guide.axis].holds(guide.at)) this.drawGuide(guide, put(inside, "g", tone(guide)));
    this.choice = put(svg, "rect", { class: "choice", style: "display: none" });
    this.dot = put(svg, "circle", { class: "dot", r: 4 });
    this.whole.hidden = !x.zoomed && !y.zoomed;
    if (this.at) this.tell(...this.at);
    else this.hide();
  }

  drawRulers(group) {
    const { x, y, right } = this, text = (place, at, said) => put(group, "text", { class: place, ...at }, said);
    const aside = (at) => ({ transform: `translate(${at} ${(y.from + y.to) / 2}) rotate(-90)` });
    for (const value of x.ticks()) {
      put(group, "path", { d: `M${x.place(value)} ${y.from}V${y.to}` });
      text("x", { x: x.place(value), y: y.from + 12 }, x.words(value));
    }
    for (const value of y.ticks()) {
      put(group, "path", { d: `M${x.from} ${y.place(value)}H${x.to}` });
      text("y", { x: x.from - 5, y: y.place(value) + 3 }, y.words(value));
    }
    for (const value of right?.ticks() ?? []) text("", { x: x.to + 5, y: right.place(value) + 3 }, right.words(value));
    put(group, "path", { class: "axis", d: `M${x.from} ${y.to}V${y.from}H${x.to}` });
    text("x", { x: (x.from + x.to) / 2, y: this.height - 4 }, x.label);
    text("x", aside(9), y.label);
    if (right) text("x", aside(WIDTH - 4), right.label);
  }

  /** Boxes of what no text should lie on: marks, curves and level lines. */
  covered() {
    const { x, data } = this, around = ([a, b], rim) => [a - rim, b - rim, a + rim, b + rim];
    const level = data.guides.filter(({ axis, at }) => axis !== "x" && this[axis].holds(at));
    const boxes = level.map(({ axis, at }) => [x.from, this[axis].place(at) - 1, x.to, this[axis].place(at) + 1]);
    for (const { kind, scales: [X, Y], points } of this.curves) {
      const places = points.map(([a, b]) => [X.place(a), Y.place(b)]);
      if (kind === "marks") boxes.push(...places.map((place) => around(place, 4)));
      else for (const [i, end] of places.entries()) boxes.push(...along(places[i - 1] ?? end, end).map((place) => around(place, 1)));
    }
    return boxes;
  }

  /** Of some boxes (left, top, right, bottom) for a text, the number of the first that nothing lies in, or else the first. */
  free(boxes) {
    const apart = (a, b) => a[2] < b[0] || b[2] < a[0] || a[3] < b[1] || b[3] < a[1];
    const inside = ([left, top, right, base]) => left >= this.x.from && right <= this.x.to && top >= this.y.to - 1 && base < this.y.from;
    const found = Math.max(boxes.findIndex((box) => inside(box) && this.taken.every((other) => apart(box, other))), 0);
    this.taken.push(boxes[found]);
    return found;
  }

  drawGuide({ at, text, axis, at_start: atStart }, group) {
    const { x, y } = this, place = this[axis].place(at), upright = axis === "x";
    group.setAttribute("class", words("guide", upright && "upright"));
    put(group, "path", { d: upright ? `M${place} ${y.from}V${y.to}` : `M${x.from} ${place}H${x.to}` });
    const long = LETTER * text.length;
    if (upright) {
      const places = Array.from({ length: 13 }, (_, i) => i / 12);
      const tops = places.map((share) => y.to + share * (y.from - 4 - long - y.to)); // where a text along the line begins
      const beside = places.map((share) => y.to + share * (y.from - 14 - y.to)); // and where a level one is, if none of these is free
      const boxes = [
        ...tops.flatMap((top) => [[place - 11, top, place - 2, top + long], [place + 1, top, place + 10, top + long]]),
        ...beside.flatMap((top) => [[place - 4 - long, top, place - 4, top + 9], [place + 4, top, place + 4 + long, top + 9]]),
      ];
      const i = this.free(boxes), [, top, right] = boxes[i];
      const turned = i < 2 * places.length ? `translate(${right - 1} ${top + 2}) rotate(-90)` : `translate(${right} ${top + 8})`;
      put(group, "text", { class: "y", transform: turned }, text);
      return;
    }
    const lefts = [0, 0.2, 0.4, 0.6, 0.8, 1].map((share) => x.to - 3 - long - share * (x.to - x.from - 7 - long));
    const ends = [-3, 10].flatMap((under) => lefts.map((left) => [left, place + under]));
    if (atStart) ends.reverse();
    const [left, base] = ends[this.free(ends.map(([from, under]) => [from, under - 8, from + long, under + 1]))];
    const last = left + long > x.to - 4; // at the right end, whatever the font
    put(group, "text", { x: last ? x.to - 3 : left, y: base, ...(last && { style: "text-anchor: end" }) }, text);
  }

  drawSeries(series, group) {
    const [x, y] = series.scales, places = series.points.map(([a, b]) => [x.place(a).toFixed(2), y.place(b).toFixed(2)]);
    const line = series.kind === "line", every = line ? Math.max(Math.floor(places.length / 8), 1) : 1;
    const marked = series.marker ? places.filter((_, i) => i % every === 0) : [];
    if (series.kind !== "marks") putLine(group, series, `M${places.join("L")}`);
    for (const place of marked) putMark(group, series, line ? 2.2 : 3.6, `translate(${place})`);
    for (const [i, label] of series.labels.entries()) {
      const [a, b] = [x.place(series.x[i]), y.place(series.y[i])], long = LETTER * label.length;
      const sides = [[a + 7, b - 4], [a + 7, b + 10], [a - 7 - long, b - 4], [a - 7 - long, b + 10], [a - long / 2, b - 8], [a - long / 2, b + 15]];
      const [left, base] = sides[this.free(sides.map(([from, under]) => [from, under - 8, from + long, under + 1]))];
      put(group, "text", { class: "label", x: left, y: base }, label);
    }
  }

  /** Shows other shares of the whole of x, of y, or of both; y and the right axis go together. */
  zoom({ x, y }) {
    if (x) this.x.zoom(...x);
    for (const scale of y ? [this.y, this.right] : []) scale?.zoom(...y);
    this.redraw();
  }

  reset() { this.zoom({ x: [0, 1], y: [0, 1] }); }

  // Reading values

  seen({ scales }, point) { return scales.every((scale, i) => scale.holds(point[i])); }

  /** Marks a curve's point and says its values. */
  tell(curve, index) {
    this.at = [curve, index];
    const { told, dot } = this, point = curve.points[index], [x, y] = curve.scales.map((scale, i) => scale.place(point[i]));
    told.style.display = dot.style.display = this.seen(curve, point) ? "" : "none";
    [dot.cx.baseVal.value, dot.cy.baseVal.value] = [x, y];
    told.replaceChildren(make("b", {}, curve.name), ...curve.scales.flatMap((scale, i) => [make("br"), ` ${scale.told(point[i])}`]));
    const box = this.svg.getBoundingClientRect(), own = this.frame.getBoundingClientRect(), unit = box.width / WIDTH;
    const left = box.left - own.left + x * unit, aside = left + 14 + told.offsetWidth > own.width ? -14 - told.offsetWidth : 14;
    told.style.left = `${Math.max(0, left + aside)}px`;
    told.style.top = `${Math.max(0, box.top - own.top + y * unit - told.offsetHeight - 8)}px`;
  }

  hide() {
    this.at = null;
    for (const part of [this.told, this.dot]) part.style.display = "none";
  }

  tellNearest([x, y]) {
    const all = this.curves.flatMap((curve) => curve.points.map((point, index) => ({ curve, point, index })));
    const away = ({ curve: { scales: [X, Y] }, point: [a, b] }) => Math.hypot(X.place(a) - x, Y.place(b) - y);
    const near = all.filter(({ curve, point }) => this.seen(curve, point)).map((one) => [away(one), one]);
    const [, found] = near.reduce((best, one) => (one[0] < best[0] ? one : best), [Infinity, null]);
    if (found) this.tell(found.curve, found.index);
    else this.hide();
  }

  // Pointer and keys

  listen() {
    const act = {
      pointerdown: (event) => event.button === 0 && this.down(event),
      pointermove: (event) => this.move(event, this.pointer(event)),
      pointerup: (event) => this.up(this.pointer(event)),
      pointercancel: () => this.up(null),
      pointerleave: (event) => event.pointerType === "mouse" && !this.start && this.hide(),
      dblclick: () => this.reset(),
    };
    for (const [name, action] of Object.entries(act)) this.svg.addEventListener(name, action);
    this.whole.addEventListener("click", () => this.reset());
    this.frame.addEventListener("keydown", (event) => this.key(event));
    this.frame.addEventListener("focusout", () => this.hide());
  }

  /** The pointer in the drawing's units. */
  pointer(event) {
    const box = this.svg.getBoundingClientRect(), unit = WIDTH / box.width;
    return [(event.clientX - box.left) * unit, (event.clientY - box.top) * unit];
  }

  down(event) {
    this.start = this.pointer(event);
    this.svg.setPointerCapture(event.pointerId);
  }

  move(event, to) {
    const range = this.range(to), sides = ["x", "y"].map((name) => range?.[name] ?? [this[name].from, this[name].to]);
    if (range) {
      this.hide();
      const [x, y, width, height] = [...sides.map((ends) => Math.min(...ends)), ...sides.map(([a, b]) => Math.abs(b - a))];
      for (const [name, value] of Object.entries({ x, y, width, height, style: "" })) this.choice.setAttribute(name, value);
    } else if (event.pointerType === "mouse") this.tellNearest(to);
  }

  up(to) {
    const range = to && this.range(to);
    this.start = null;
    this.choice.style.display = "none";
    if (range) this.zoom({ x: range.x?.map((at) => this.x.shareAt(at)), y: range.y?.map((at) => this.y.shareAt(at)) });
    else if (to) this.tellNearest(to);
  }

  /** What a drag to here chooses of the drawing: a range of x, of y, or of both; null while it is a press. */
  range(to) {
    const size = to.map((place, i) => Math.abs(place - (this.start ?? to)[i])), [x, y] = to.map((place, i) => [this.start?.[i], place]);
    if (Math.max(...size) < DRAG) return null;
    return { ...(size[0] > size[1] / 2 && { x }), ...(size[1] > size[0] / 2 && { y }) };
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.frame || !this.curves.length) return;
    const keys = {
      ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1),
      ArrowUp: () => this.change(-1), ArrowDown: () => this.change(1),
      "+": () => this.zoomAbout(1 / 2), "=": () => this.zoomAbout(1 / 2), "-": () => this.zoomAbout(2),
      0: () => this.reset(), Escape: () => this.hide(),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  /** The next or previous point of the curve that is in sight. */
  step(by) {
    const [curve, index] = this.at ?? [this.curves[0], by > 0 ? -1 : this.curves[0].points.length];
    let next = index + by;
    while (curve.points[next] && !this.seen(curve, curve.points[next])) next += by;
    if (curve.points[next]) this.tell(curve, next);
  }

  /** Another curve, at its point nearest along x. */
  change(by) {
    const [curve, index] = this.at ?? [this.curves.at(by > 0 ? -1 : 0), 0], count = this.curves.length;
    const next = this.curves[(this.curves.indexOf(curve) + by + count) % count], at = this.x.share(curve.points[index][0]);
    const apart = next.points.map(([x]) => Math.abs(this.x.share(x) - at));
    this.tell(next, apart.indexOf(Math.min(...apart)));
  }

  /** Zooms x by a factor about the point that is told, or the middle. */
  zoomAbout(factor) {
    const [a, b] = this.x.window, middle = this.at ? this.x.share(this.at[0].points[this.at[1]][0]) : (a + b) / 2;
    this.zoom({ x: [middle - factor * (middle - a), middle + factor * (b - middle)] });
  }
}
