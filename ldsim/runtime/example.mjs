// Pulls at the last movable vertex, a quarter of the solid's size along x: `node example.mjs`. In a page, fetch the files.

import { readFileSync } from "node:fs";
import { Model, Solid, runtimeOf } from "./solid.mjs";

const read = (name) => new Uint8Array(readFileSync(new URL(name, import.meta.url)));
const model = new Model(await runtimeOf(read("ldsim.wasm")), read("model.ldsim")), solid = new Solid(model);
const place = (v) => Array.from(model.rest.slice(3 * v, 3 * v + 3));
const [low, high] = [Math.min, Math.max].map((end) => [0, 1, 2].map((i) => model.rest.reduce((found, x, at) => (at % 3 === i ? end(found, x) : found), model.rest[i])));
const from = place(model.movable.lastIndexOf(1)), [x, y, z] = from, size = Math.hypot(...high.map((x, i) => x - low[i]));
const pull = solid.grab(model.held(from, 0.1 * size), [x + 0.25 * size, y, z], 50);
for (let step = 1; step <= 100; step++) {
  const { iterations } = solid.step();
  const middle = solid.centroid(pull).map((value) => value.toFixed(4));
  if (step % 20 === 0) console.log(`${(step * model.timeStep).toFixed(3)} s: held at ${middle} m, ${iterations} iterations`);
}
