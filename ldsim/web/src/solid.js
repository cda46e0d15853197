// The solid: the mesh that moves with the reduced coordinates, and the springs that pull on it.

import { Surface } from "./surface.js";

export class Solid extends Surface {
  /** arrays: as readSafetensors gives them. */
  constructor(arrays) {
    const triangles = arrays.surface_triangles.data, vertices = arrays.vertices.data;
    const surface = Int32Array.from(new Set(triangles)).sort(); // the vertices on the surface
    const number = new Map(Array.from(surface, (v, i) => [v, i]));
    const rest = new Float64Array(3 * surface.length);
    surface.forEach((v, i) => rest.set(vertices.subarray(3 * v, 3 * v + 3), 3 * i));
    super(rest, Uint32Array.from(triangles, (v) => number.get(v)));
    this.surface = surface;
    this.vertices = vertices;
    this.n = arrays.vertices.shape[0];
    this.basis = arrays.basis.data; // (3n, K), row by row
    this.columns = arrays.basis.shape[1];
    this.movable = arrays.movable.data;
    this.tints = Float32Array.from(surface, (v) => (this.movable[v] ? 0 : 1)); // pinned vertices have a colour of their own
  }

  /** Position of one coordinate (3 v + axis) at q. */
  coordinate(row, q) {
    let total = this.vertices[row];
    for (let j = 0, u = row * this.columns; j < q.length; j++) total += this.basis[u + j] * q[j];
    return total;
  }

  /** Positions of the given vertices at q, 3 numbers each. */
  positionsOf(vertices, q) {
    const out = new Float64Array(3 * vertices.length);
    for (let i = 0; i < vertices.length; i++) {
      for (let axis = 0; axis < 3; axis++) out[3 * i + axis] = this.coordinate(3 * vertices[i] + axis, q);
    }
    return out;
  }

  /** Moves the surface to q. */
  decode(q) {
    const { surface, positions } = this;
    for (let i = 0; i < surface.length; i++) {
      for (let axis = 0; axis < 3; axis++) positions[3 * i + axis] = this.coordinate(3 * surface[i] + axis, q);
    }
    this.refresh();
  }

  /** The movable vertices within `radius` of the one nearest to `point`, at q: `held_vertices` in Python. */
  held(point, radius, q) {
    const all = this.positionsOf(Array.from({ length: this.n }, (_, i) => i), q);
    const near = (x, v) => Math.hypot(all[3 * v] - x[0], all[3 * v + 1] - x[1], all[3 * v + 2] - x[2]);
    let picked = 0;
    for (let v = 1; v < this.n; v++) if (near(point, v) < near(point, picked)) picked = v;
    const centre = all.slice(3 * picked, 3 * picked + 3);
    return Array.from({ length: this.n }, (_, v) => v).filter((v) => this.movable[v] && near(centre, v) <= radius);
  }

  /** The spring on the centroid of the given vertices, c(q) = centre + B q, for a space of dimension k. */
  spring(vertices, stiffness, k) {
    const B = Array.from({ length: 3 }, () => new Float64Array(k)), centre = [0, 0, 0];
    for (const v of vertices) {
      for (let axis = 0; axis < 3; axis++) {
        const row = 3 * v + axis;
        centre[axis] += this.vertices[row] / vertices.length;
        for (let j = 0; j < k; j++) B[axis][j] += this.basis[row * this.columns + j] / vertices.length;
      }
    }
    return { B, centre, target: Float64Array.from(centre), stiffness };
  }

  /** The nearest point of the surface on a ray, or null. */
  rayHit(origin, direction) {
    const { positions: p, triangles } = this;
    let nearest = Infinity;
    for (let t = 0; t < triangles.length; t += 3) {
      const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
      const distance = rayTriangle(origin, direction, p, a, b, c);
      if (distance < nearest) nearest = distance;
    }
    return nearest < Infinity ? origin.map((x, i) => x + nearest * direction[i]) : null;
  }
}

/** Distance along a ray to a triangle, ∞ where it misses (Möller and Trumbore 1997). */
function rayTriangle(o, d, p, a, b, c) {
  const e0 = p[b] - p[a], e1 = p[b + 1] - p[a + 1], e2 = p[b + 2] - p[a + 2];
  const f0 = p[c] - p[a], f1 = p[c + 1] - p[a + 1], f2 = p[c + 2] - p[a + 2];
  const h0 = d[1] * f2 - d[2] * f1, h1 = d[2] * f0 - d[0] * f2, h2 = d[0] * f1 - d[1] * f0;
  const det = e0 * h0 + e1 * h1 + e2 * h2;
  if (det === 0) return Infinity;
  const s0 = o[0] - p[a], s1 = o[1] - p[a + 1], s2 = o[2] - p[a + 2];
  const u = (s0 * h0 + s1 * h1 + s2 * h2) / det;
  if (u < 0 || u > 1) return Infinity;
  const q0 = s1 * e2 - s2 * e1, q1 = s2 * e0 - s0 * e2, q2 = s0 * e1 - s1 * e0;
  const v = (d[0] * q0 + d[1] * q1 + d[2] * q2) / det;
  if (v < 0 || u + v > 1) return Infinity;
  const distance = (f0 * q0 + f1 * q1 + f2 * q2) / det;
  return distance > 0 ? distance : Infinity;
}
