// Elements, numbers as text, and the colours of the palette.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** An element with attributes and children, nodes or text. */
export const make = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);

/** The same of SVG. */
export const draw = (tag, attributes = {}) => filled(document.createElementNS(SVG, tag), attributes, []);

/** A line with a ball at its end, between two places on the page: what pulls and where to. */
export function pull([x1, y1], [x2, y2], radius) {
  return [draw("line", { x1, y1, x2, y2 }), draw("circle", { cx: x2, cy: y2, r: radius })];
}

/** A number with so many significant digits and no zeros behind. */
export const digits = (value, count = 3) => String(Number(value.toPrecision(count)));

const PREFIXES = { "-1": "m", 0: "", 1: "k", 2: "M" };

/** A number with three digits and the prefix of its unit. */
export function short(value) {
  const power = value > 0 ? Math.max(-1, Math.min(2, Math.floor(Math.log10(value) / 3))) : 0;
  return `${digits(value / 1000 ** power)} ${PREFIXES[power]}`;
}

/** A number with so many places, a dash where there is none. */
export const fixed = (value, places) => (Number.isFinite(value) ? value.toFixed(places) : "–");

/** A colour of the palette (pages/palette.css), "latent" for --latent: red, green and blue from 0 to 1. */
export function colour(name, element = document.documentElement) {
  const hex = getComputedStyle(element).getPropertyValue(`--${name}`).trim();
  return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
}

/** The four colours of the scale, from little to much. */
export const scale = () => [0, 1, 2, 3].map((i) => colour(`scale-${i}`));

/** The shadow's colour with its opacity, as shaders have it. */
export const shade = (element = document.documentElement) =>
  getComputedStyle(element).getPropertyValue("--shadow").trim().split(/\s+/).map(Number);

/** The scale as the background of an element. */
export const gradient = () => `linear-gradient(90deg, ${[0, 1, 2, 3].map((i) => `var(--scale-${i})`)})`;

export function onThemeChange(action) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", action);
}

/** Does something with the seconds since the last picture, before every picture for as long as it returns true. */
export function everyPicture(action) {
  let last = null; // the browser's clock for pictures, which may be behind performance.now()
  const tick = (now) => {
    const elapsed = Math.min(Math.max(now - (last ?? now), 0), 250) / 1000;
    last = now;
    if (action(elapsed)) requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
