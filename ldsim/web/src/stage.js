// The stage of the playground: the solid in several spaces side by side, seen by one camera, and the pulls on it.

import { Camera, Fingers } from "./camera.js";
import { GpuDecoder } from "./decode.js";
import { byId, colour, make, pull, scale, shade, short } from "./dom.js";
import { Surface, displaced } from "./surface.js";
import { along, box, dot } from "./vector.js";
import { Body, View } from "./view.js";

const [WIDE, COVERED] = [900, 300]; // the controls cover the right of a wide window
const GLASS = 0.38;

/** The solid in one space: its surface, its colours, its cubature points. */
export class Shape {
  /** space: its block, with k = 0 in the full space; offset: where it stands, in the world. */
  constructor(stage, space, offset) {
    const { solid, view } = stage;
    Object.assign(this, { stage, solid, space, offset });
    this.surface = new Surface(solid.rest, solid.triangles);
    const decoder = stage.gpu && space.k ? new GpuDecoder(view.gl, this.surface, space.basis, space.k) : null;
    this.body = Object.assign(new Body(view.gl, this.surface, solid.pinned, decoder), { offset, colour: colour(space.space) });
    this.label = make("div", { class: `label ${space.space}` });
    this.q = new Float32Array(space.k || solid.rest.length);
    this.setMode("plain");
    this.show(this.q);
  }

  /** The shape of coordinates q, or of displacements where the space is full. */
  show(q) {
    const { body, surface } = this;
    this.q = q.slice();
    this.fresh = false;
    if (body.decoder) body.decoder.decode(q);
    else {
      this.current();
      if (body.displacements) surface.tintByDistance(surface.rest, 1 / body.displacements);
      surface.refresh();
      body.changed = true;
    }
    if (body.points) this.setPoints(true);
  }

  /** Positions of the surface now, (3v), in the frame of the solid. */
  current() {
    const { positions, rest } = this.surface;
    if (!this.fresh) {
      if (this.space.k) this.surface.move(this.space.basis, this.space.k, this.q);
      else for (let i = 0; i < rest.length; i++) positions[i] = rest[i] + this.q[i];
    }
    this.fresh = true;
    return positions;
  }

  setPoints(visible) {
    const { point_rest: rest, point_basis: basis, k } = this.space;
    this.body.points = visible && rest ? displaced(rest, basis, k, this.q, new Float32Array(rest.length)) : null;
    this.body.opacity = this.body.points ? GLASS : 1;
  }

  /** What the colour shows: "plain", "displacement", "novelty", or a field that the server sends. */
  setMode(name) {
    this.body.ramp = Number(name !== "plain" && name !== "novelty");
    this.body.displacements = name === "displacement" ? 4 / this.stage.diagonal : 0;
    this.setTints((tints) => tints.fill(0));
  }

  /** The novelty score from 0 to 2, where 1 is where to warn; the space's own colour where it is not known. */
  setNovelty(value) {
    this.body.ramp = Number(Number.isFinite(value));
    this.setTints((tints) => tints.fill(Math.min(value, 2) / 2));
  }

  /** A field of the server: a byte for every vertex. */
  setField(values) {
    this.setTints((tints) => values.forEach((value, v) => (tints[v] = value / 255)));
  }

  setTints(action) {
    action(this.surface.tints);
    this.surface.refreshTints();
    this.body.changed = true;
  }
}

export class Stage {
  /** solid: its block; options: `decode` (gpu or cpu) and `quality` (fine or plain), from the page's address. */
  constructor(canvas, solid, { decode, quality }) {
    Object.assign(this, { canvas, solid, shapes: [], grabs: [] });
    this.camera = new Camera(canvas, solid.up, solid.azimuth, solid.elevation);
    this.view = new View(this.camera, quality);
    const canDecode = this.view.gl.getExtension("EXT_color_buffer_float") !== null;
    this.gpu = decode === "gpu" || (decode !== "cpu" && !this.view.software && canDecode);
    this.fingers = new Fingers(this.camera, true);
    this.measure();
  }

  /** The box of the solid in the world, the floor below it, and how far apart two of it stand. */
  measure() {
    const { rest, pinned } = this.solid, { camera } = this, upright = new Float32Array(rest.length), angle = camera.home.azimuth;
    for (let i = 0; i < rest.length; i += 3) upright.set(camera.toWorld(rest.subarray(i, i + 3)), i);
    const { low, high, diagonal, centre } = box(upright);
    Object.assign(this, { diagonal, centre, above: [centre[0], high[1] + 0.1 * diagonal, centre[2]] });
    this.right = [Math.cos((angle * Math.PI) / 180), 0, -Math.sin((angle * Math.PI) / 180)];
    const broad = Math.abs(this.right[0]) * (high[0] - low[0]) + Math.abs(this.right[2]) * (high[2] - low[2]);
    this.aside = Math.max(1.2 * broad, 0.55 * diagonal);
    // A solid that stands on its pins touches the floor, another swings above it.
    const feet = [...pinned.keys()].filter((v) => pinned[v]).map((v) => upright[3 * v + 1] - low[1]);
    const stands = feet.length > 0 && feet.reduce((a, b) => a + b, 0) < 0.1 * diagonal * feet.length;
    this.view.floor = low[1] - (stands ? 0.002 : 0.3) * diagonal;
    this.room = (stands ? 1.1 : 1.3) * diagonal; // what hangs sags, out of a view of its rest alone
    if (!stands) this.centre = [centre[0], centre[1] - 0.12 * diagonal, centre[2]];
    camera.frame(this.centre, this.room);
  }

  /** The axes of the screen, upright, in the frame of the solid; gravity is tilted along them. */
  get axes() {
    const out = [-this.right[2], 0, this.right[0]];
    return { up: this.camera.toModel([0, 1, 0]), right: this.camera.toModel(this.right), toward: this.camera.toModel(out) };
  }

  /** The spaces of these blocks, side by side. */
  setSpaces(spaces) {
    for (const { body } of this.shapes) body.dispose();
    const middle = (spaces.length - 1) / 2;
    this.shapes = spaces.map((space, i) => new Shape(this, space, this.right.map((x) => (i - middle) * this.aside * x)));
    this.grabs = []; // those of the next frame fit the spaces
    byId("labels").style.setProperty("--shown", spaces.length);
    byId("labels").replaceChildren(...(spaces.length > 1 ? this.shapes.map(({ label }) => label) : []));
    this.camera.frame(this.centre, this.room, middle * this.aside);
  }

  /** The palette's colours as they are now. */
  readColours() {
    this.colours = { stops: scale(), shade: shade(), grid: [...colour("soft"), 0.35] };
    for (const { body, space } of this.shapes) body.colour = colour(space.space);
  }

  draw() {
    const { view, camera } = this;
    camera.covered = this.canvas.clientWidth > WIDE ? COVERED : 0;
    view.clear();
    view.draw(this.shapes.map(({ body }) => body), this.colours);
    const lines = this.grabs.flatMap(({ target, centroids }) => this.shapes.flatMap(({ offset }, i) => {
      return pull(camera.toScreen(centroids.slice(3 * i, 3 * i + 3), offset), camera.toScreen(target, offset), 5.5);
    }));
    byId("pulls").replaceChildren(...lines);
    for (const { label, offset } of this.shapes) {
      const [x, y] = camera.toScreen(camera.toModel(this.above), offset);
      label.style.transform = `translate(${x}px, ${Math.max(y, 44)}px) translate(-50%, -100%)`;
    }
    this.drawScale();
  }

  /** A bar of a round length, as it is where the camera looks. */
  drawScale() {
    const { half, distance } = this.camera.view(), metres = (2 * half.y * distance) / this.camera.box.height; // of a pixel
    const most = 140 * metres, power = 10 ** Math.floor(Math.log10(most)), round = [5, 2, 1].find((step) => step * power <= most) * power;
    byId("ruler").style.width = `${round / metres}px`;
    byId("ruler").textContent = `${short(round)}m`;
  }

  /** The ray under the pointer in the frame of a shape. */
  ray({ offsetX, offsetY }, { offset }) {
    const { origin, direction, out } = this.camera.ray(offsetX, offsetY);
    return { origin: along(origin, -1, this.camera.toModel(offset)), direction, out };
  }

  /** What is under the pointer, the nearest of all shapes: as Surface.hit says, with the shape; or null. */
  hit(event) {
    let best = null;
    for (const shape of this.shapes) {
      const { origin, direction } = this.ray(event, shape);
      shape.current();
      const found = shape.surface.hit(origin, direction);
      if (found && !(found.distance > best?.distance)) best = { ...found, shape };
    }
    return best;
  }

  /** Where the pointer is in the plane through `start` that faces the camera, in the frame of a shape. */
  inPlane(event, shape, start) {
    const { origin, direction, out } = this.ray(event, shape);
    const distance = (dot(start, out) - dot(origin, out)) / dot(direction, out);
    return along(origin, distance, direction);
  }
}
