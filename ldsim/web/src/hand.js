// The hand: pointers that take hold of a solid, pull, and let go or leave a pull behind; others turn the view.

import { blend } from "./surface.js";
import { along, length, minus } from "./vector.js";

const NEAR = 16; // pixels around a target that was left behind
const FARTHEST = 2; // that a target may go from where it began, diagonals

export class Hand {
  /** send: to what steps; mode: "record" takes hold of the solid as it is, others of the same point at rest. */
  constructor(stage, send, mode) {
    Object.assign(this, { stage, send, mode, pulls: new Map() });
    const { canvas, fingers } = stage, on = (name, action) => canvas.addEventListener(name, action);
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event) || fingers.move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) on(end, (event) => this.up(event));
    on("contextmenu", (event) => event.preventDefault());
    on("dblclick", (event) => this.stage.hit(event) || stage.camera.reset());
    on("wheel", (event) => fingers.wheel(event));
  }

  /** The pull left behind whose target is under the pointer, if there is one: what another finger holds is not. */
  left({ offsetX, offsetY }) {
    const { camera, shapes, grabs } = this.stage, held = new Set([...this.pulls.values()].map(({ id }) => id));
    for (const { id, target } of grabs) {
      if (held.has(id)) continue;
      for (const shape of shapes) {
        const [x, y] = camera.toScreen(target, shape.offset);
        if (Math.hypot(x - offsetX, y - offsetY) < NEAR) return { id, shape, point: Array.from(target), old: true };
      }
    }
    return null;
  }

  down(event) {
    const { fingers, canvas } = this.stage;
    const found = event.button === 0 && !fingers.places.size ? this.left(event) ?? this.stage.hit(event) : null;
    if (!found) {
      fingers.down(event);
      return;
    }
    const { id = Math.floor(Math.random() * 2 ** 31), shape, point, old = false } = found;
    this.pulls.set(event.pointerId, { id, shape, start: point, old, moved: false });
    canvas.setPointerCapture(event.pointerId);
    if (!old) this.send("grab", { id, point: blend(found, this.mode === "record" ? shape.current() : shape.solid.rest), target: point });
  }

  /** Whether the pointer pulls. */
  move(event) {
    const pull = this.pulls.get(event.pointerId);
    if (!pull) return false;
    const { stage } = this, way = minus(stage.inPlane(event, pull.shape, pull.start), pull.start), far = length(way);
    if (!Number.isFinite(far)) return true;
    pull.moved ||= far > 0.005 * stage.diagonal;
    const target = along(pull.start, Math.min(1, (FARTHEST * stage.diagonal) / (far || 1)), way);
    this.send("move", { id: pull.id, target });
    return true;
  }

  up(event) {
    const pull = this.pulls.get(event.pointerId);
    this.stage.fingers.up(event);
    this.pulls.delete(event.pointerId);
    if (!pull) return;
    const keep = this.mode !== "record" && (pull.old ? pull.moved : event.shiftKey);
    if (!keep) this.send("release", { id: pull.id });
  }
}
