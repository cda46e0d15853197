// The reduced step and the model it reads: what the exported page steps with, and what the tests hold to Python's.

export { energyStress, tangent } from "./materials.js";
export { readSafetensors, spaceOf } from "./model.js";
export { Solid } from "./solid.js";
export { Stepper } from "./stepping.js";
