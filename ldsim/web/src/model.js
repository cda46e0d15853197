// The model inside the page: a safetensors file (ldsim/export/arrays.py), unpacked without a copy where it is aligned.

import { Decoder } from "./decoder.js";

const ARRAY_TYPES = { F64: Float64Array, F32: Float32Array, I32: Int32Array, I8: Int8Array, U8: Uint8Array };

/** name → { data, shape } of a safetensors file in an ArrayBuffer. */
export function readSafetensors(buffer) {
  const length = Number(new DataView(buffer).getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const arrays = { notes: header.__metadata__ };
  for (const [name, entry] of Object.entries(header)) {
    if (name === "__metadata__") continue;
    const [start, stop] = entry.data_offsets, type = ARRAY_TYPES[entry.dtype];
    const data = new type(buffer, 8 + length + start, (stop - start) / type.BYTES_PER_ELEMENT);
    arrays[name] = { data, shape: entry.shape };
  }
  return arrays;
}

/** One space of the model: what the step reads. */
export function spaceOf(arrays, name) {
  const part = (key) => arrays[`${name}/${key}`].data;
  const sizes = Array.from(part("sizes"));
  return {
    name,
    r: sizes[0],
    k: sizes[sizes.length - 1],
    decoder: new Decoder(sizes, part("weights"), part("biases"), part("rest"), part("skip"), part("activation")[0]),
    strainMaps: part("strain_maps"), // (c, 9, k)
    weights: part("cubature_weights"),
    material: part("material"),
    mu: part("mu"),
    lam: part("lam"),
    mass: part("mass"),
    restStiffness: part("rest_stiffness"),
    unitLoads: part("unit_loads"),
    load: part("load"),
    points: part("cubature_weights").length,
  };
}
