// The pages of `ldsim report` and `ldsim compare`: figures that can be read and zoomed, and the replay.

import { Plot } from "./plot.js";
import { Replay } from "./replay.js";

document.addEventListener("DOMContentLoaded", () => {
  for (const frame of document.querySelectorAll(".plot")) frame.plot = new Plot(frame);
  // Where there is no WebGL 2 the figure stays hidden; the still pictures below it say what they can.
  if (!document.createElement("canvas").getContext("webgl2")) return;
  for (const figure of document.querySelectorAll("figure.replay")) figure.replay = new Replay(figure);
});
