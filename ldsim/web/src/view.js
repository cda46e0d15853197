// Draws moving surfaces with WebGL 2: solids lit by one lamp, their shadows on each other and on a floor, and points.

import { lampProjection } from "./camera.js";
import { Program, attribute, deleteArray, isSoftware, target, texture, update } from "./gl.js";
import { normalised } from "./vector.js";
import depthShader from "./shaders/depth.frag.glsl";
import floorFragment from "./shaders/floor.frag.glsl";
import floorVertex from "./shaders/floor.vert.glsl";
import pointFragment from "./shaders/points.frag.glsl";
import pointVertex from "./shaders/points.vert.glsl";
import shadowShader from "./shaders/shadow.glsl";
import solidFragment from "./shaders/solid.frag.glsl";
import solidVertex from "./shaders/solid.vert.glsl";

const LAMP = normalised([-0.3, 0.72, 0.62]);
const DECODED = "#define DECODED\n";

/** One surface on the graphics card. What it looks like may be changed at any time; `changed` says that it has moved. */
export class Body {
  /** pinned: 0 or 1 for every vertex of the surface, or null; decoder: a GpuDecoder of this surface, or null. */
  constructor(gl, surface, pinned = null, decoder = null) {
    Object.assign(this, { gl, surface, decoder, offset: [0, 0, 0], colour: [0.5, 0.5, 0.5], ramp: 0 });
    Object.assign(this, { opacity: 1, wire: false, displacements: 0, points: null, changed: true });
    const { copies, corners } = surface, edges = surface.edges();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    if (!decoder) {
      this.positions = attribute(gl, 0, 3, surface.drawn);
      this.normals = attribute(gl, 1, 3, surface.normals);
    }
    this.tints = attribute(gl, 2, 1, surface.drawnTints);
    if (pinned) attribute(gl, 3, 1, Float32Array.from(copies, (v) => pinned[v]));
    attribute(gl, 4, 1, Float32Array.from(copies));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Uint32Array.from([...corners, ...edges]), gl.STATIC_DRAW);
    this.counts = { triangles: corners.length, edges: edges.length };
  }

  upload() {
    const { gl, surface } = this;
    if (!this.changed) return;
    if (!this.decoder) {
      update(gl, this.positions, surface.drawn);
      update(gl, this.normals, surface.normals);
    }
    update(gl, this.tints, surface.drawnTints);
    this.changed = false;
  }

  draw(programs, values) {
    const { gl, decoder, counts } = this;
    gl.bindVertexArray(this.array);
    const decoded = decoder && { decodedPositions: decoder.positions.texture, decodedNormals: decoder.normals.texture };
    const { offset, ramp, opacity, displacements, colour: base } = this;
    programs[decoder ? 1 : 0].use({ ...values, ...decoded, offset, ramp, opacity, displacements, base });
    if (this.wire) gl.drawElements(gl.LINES, counts.edges, gl.UNSIGNED_INT, 4 * counts.triangles);
    else gl.drawElements(gl.TRIANGLES, counts.triangles, gl.UNSIGNED_INT, 0);
  }

  /** Balls at `positions` (3p), drawn while `points` is set. */
  drawPoints(program, values) {
    const { gl, points, offset } = this;
    this.pointArray ??= gl.createVertexArray();
    gl.bindVertexArray(this.pointArray);
    this.pointBuffer ??= attribute(gl, 0, 3, points);
    update(gl, this.pointBuffer, points);
    program.use({ ...values, offset });
    gl.drawArrays(gl.POINTS, 0, points.length / 3);
  }

  /** Frees what it has on the graphics card; it is not drawn again. */
  dispose() {
    for (const array of [this.array, this.pointArray]) if (array) deleteArray(this.gl, array);
    this.decoder?.dispose();
  }
}

export class View {
  /** quality: "plain" draws fewer pixels and coarser shadows; left out, a renderer on the CPU does. */
  constructor(camera, quality) {
    const { canvas } = camera, gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
    if (!gl) throw new Error("This browser has no WebGL 2; try another, or turn on hardware acceleration.");
    Object.assign(this, { camera, canvas, gl, software: isSoftware(gl), floor: 0 });
    this.plain = quality === "plain" || (quality !== "fine" && this.software);
    const both = (fragment) => ["", DECODED].map((define) => new Program(gl, define + solidVertex, fragment));
    this.solids = both(shadowShader + solidFragment);
    this.depths = both(depthShader);
    this.ground = new Program(gl, floorVertex, shadowShader + floorFragment);
    this.balls = new Program(gl, pointVertex, pointFragment);
    this.shadowSize = this.plain ? 512 : 2048;
    this.shadows = texture(gl, gl.DEPTH_COMPONENT24, this.shadowSize, this.shadowSize);
    this.shadowFrame = target(gl, gl.DEPTH_ATTACHMENT, this.shadows);
  }

  /** Device pixels in a CSS pixel. */
  get dots() {
    return this.plain ? 1 : Math.min(window.devicePixelRatio || 1, 2);
  }

  /** An empty canvas, as large as it is on the page. */
  clear() {
    const { gl, canvas, dots } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.round(x * dots));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** Draws bodies into the camera's part of the canvas; colours: { stops, shade, grid }, the last two with opacity. */
  draw(bodies, { stops, shade, grid }) {
    const { gl, camera, dots } = this, { centre } = camera.home, { eye, half } = camera.view(), box = camera.box;
    const reach = 0.75 * camera.diagonal + camera.span, turn = camera.turn;
    const light = lampProjection(LAMP, centre, reach);
    for (const body of bodies) body.upload();
    this.drawShadows(bodies, { project: light, turn });
    gl.viewport(...[box.left, box.bottom, box.width, box.height].map((x) => Math.round(x * dots)));
    const project = camera.projection(), lit = { project, turn, light, shadows: this.shadows };
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.disable(gl.DEPTH_TEST);
    gl.bindVertexArray(null);
    const most = camera.diagonal / 3, power = 10 ** Math.floor(Math.log10(most));
    const cell = [5, 2, 1].find((step) => step * power <= most) * power, middle = [centre[0], this.floor, centre[2]];
    this.ground.use({ ...lit, shade, grid, cell, middle, reach: 5 * (camera.diagonal + camera.span) });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.enable(gl.DEPTH_TEST);
    const values = { ...lit, lamp: LAMP, eye, stops: stops.flat(), bias: 0.012 * camera.diagonal };
    for (const body of bodies) if (body.opacity === 1) body.draw(this.solids, values);
    const size = (0.022 * camera.diagonal * box.height * dots) / (2 * half.y);
    for (const body of bodies) if (body.points) body.drawPoints(this.balls, { project, turn, size, base: stops[2] });
    gl.depthMask(false); // what is seen through hides nothing
    for (const body of bodies) if (body.opacity < 1) body.draw(this.solids, values);
    gl.depthMask(true);
  }

  drawShadows(bodies, values) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, this.shadowSize, this.shadowSize);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 2);
    for (const body of bodies) body.draw(this.depths, values);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
}
