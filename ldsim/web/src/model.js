// A reduced model as the exported page has it: its spaces, and what a pull takes hold of.

import { Decoder } from "./decoder.js";

/** The basis of a space, (3n, k): its own, or the one that all share. */
export const basisOf = (arrays, name) => arrays[`${name}/basis`] ?? arrays.basis;

/** One space of the model: what the step reads. arrays: as readSafetensors gives them. */
export function spaceOf(arrays, name) {
  const part = (key) => arrays[`${name}/${key}`].data, sizes = Array.from(part("sizes"));
  return {
    name,
    r: sizes[0],
    k: sizes[sizes.length - 1],
    decoder: new Decoder(sizes, part("weights"), part("biases"), part("rest"), part("skip"), part("activation")[0]),
    ...Object.fromEntries(["material", "mu", "lam", "mass", "load"].map((key) => [key, part(key)])),
    strainMaps: part("strain_maps"), // (c, 9, k)
    weights: part("cubature_weights"),
    unitLoads: part("unit_loads"),
    points: part("cubature_weights").length,
  };
}

/** The movable vertices within `radius` of the one nearest to `point`, at positions (3n): `held_vertices` in Python. */
export function held(positions, movable, point, radius) {
  const apart = (v, x) => Math.hypot(positions[3 * v] - x[0], positions[3 * v + 1] - x[1], positions[3 * v + 2] - x[2]);
  const all = Array.from(movable.keys()), distances = all.map((v) => apart(v, point));
  const picked = distances.reduce((best, distance, v) => (distance < distances[best] ? v : best), 0);
  const centre = positions.slice(3 * picked, 3 * picked + 3);
  return all.filter((v) => movable[v] && apart(v, centre) <= radius);
}

/** The spring on the centroid of the given vertices, c(q) = centre + B q, for a space of dimension k. */
export function springOn(vertices, basis, held, stiffness, k) {
  const B = Array.from({ length: 3 }, () => new Float64Array(k)), centre = [0, 0, 0], columns = basis.shape[1];
  for (const v of held) {
    for (let axis = 0; axis < 3; axis++) {
      const row = 3 * v + axis;
      centre[axis] += vertices.data[row] / held.length;
      for (let j = 0; j < k; j++) B[axis][j] += basis.data[row * columns + j] / held.length;
    }
  }
  return { B, centre, target: Float64Array.from(centre), stiffness };
}
