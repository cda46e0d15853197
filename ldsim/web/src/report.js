// The pages of `ldsim report` and `ldsim compare`: figures that can be read and zoomed, and the replay.

import { Plot } from "./plot.js";
import { Replay } from "./replay.js";

document.addEventListener("DOMContentLoaded", () => {
  for (const svg of document.querySelectorAll(".plot > svg[data-axes]")) svg.parentElement.plot = new Plot(svg);
  // Where there is no WebGL 2 the figure stays hidden; the still pictures below it say what they can.
  if (!document.createElement("canvas").getContext("webgl2")) return;
  for (const figure of document.querySelectorAll("figure.replay")) figure.replay = new Replay(figure);
});
