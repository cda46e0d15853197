// The reduced step and the model it reads: what the exported page steps with, and what the tests hold to Python's.

export { readSafetensors } from "./arrays.js";
export { material } from "./generated/materials.js";
export { held, spaceOf, springOn } from "./model.js";
export { Stepper } from "./stepping.js";
export { displaced } from "./surface.js";
