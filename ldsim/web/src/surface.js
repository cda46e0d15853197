// A surface that moves: its triangles, and the copies of its vertices that are drawn.

import { at, cross, dot, minus, normalised } from "./vector.js";

const CREASE = Math.cos((35 * Math.PI) / 180); // facets that meet at a sharper angle have an edge between them

/** out = x + U q, for coordinates x (m), a basis (m, k) row by row, and q of at most k numbers. */
export function displaced(x, basis, k, q, out) {
  for (let i = 0, row = 0; i < out.length; i++, row += k) {
    let total = x[i];
    for (let j = 0; j < q.length; j++) total += basis[row + j] * q[j];
    out[i] = total;
  }
  return out;
}

export class Surface {
  /** rest: positions (3v); triangles: in the numbering of the vertices. */
  constructor(rest, triangles) {
    this.rest = rest;
    this.triangles = triangles;
    this.count = rest.length / 3;
    this.positions = Float32Array.from(rest);
    this.tints = new Float32Array(this.count); // 0 … 1, from the first colour to the last
    this.makeCorners();
    this.refresh();
  }

  /**
   * Splits the surface's vertices where it has an edge, so that edges look sharp: `corners` are the drawn triangles in
   * the numbering of `copies`, each of which is a copy of a surface vertex with a normal of its own.
   */
  makeCorners() {
    const { triangles, rest } = this;
    const groups = Array.from({ length: this.count }, () => []); // of a vertex: [{ copy, normal }]
    const copies = [];
    this.corners = new Uint32Array(triangles.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [0, 1, 2].map((i) => at(rest, triangles[t + i]));
      const normal = normalised(cross(minus(b, a), minus(c, a)));
      for (let i = t; i < t + 3; i++) {
        const known = groups[triangles[i]];
        let group = known.find((one) => dot(one.normal, normal) > CREASE);
        if (!group) {
          group = { copy: copies.length, normal };
          known.push(group);
          copies.push(triangles[i]);
        }
        this.corners[i] = group.copy;
      }
    }
    this.copies = Uint32Array.from(copies);
    this.drawn = new Float32Array(3 * copies.length);
    this.normals = new Float32Array(3 * copies.length);
    this.drawnTints = new Float32Array(copies.length);
  }

  /** The triangles' edges, each once, in the numbering of `copies`. */
  edges() {
    const found = new Map();
    this.triangles.forEach((v, i) => {
      const next = i % 3 === 2 ? i - 2 : i + 1, w = this.triangles[next];
      found.set(Math.min(v, w) * this.count + Math.max(v, w), [this.corners[i], this.corners[next]]);
    });
    return Uint32Array.from([...found.values()].flat());
  }

  /** Moves the vertices to x + U q. */
  move(basis, k, q) {
    displaced(this.rest, basis, k, q, this.positions);
  }

  /** Tints by the distance of each vertex to where it is in `reference`: 1 at `limit` and beyond. */
  tintByDistance(reference, limit) {
    const { positions: p, tints } = this;
    for (let v = 0, i = 0; v < tints.length; v++, i += 3) {
      const apart = Math.hypot(p[i] - reference[i], p[i + 1] - reference[i + 1], p[i + 2] - reference[i + 2]);
      tints[v] = Math.min(1, apart / limit);
    }
  }

  /** Hands tints to the copies that are drawn. */
  refreshTints() {
    for (let i = 0; i < this.copies.length; i++) this.drawnTints[i] = this.tints[this.copies[i]];
  }

  /** Hands positions to the copies that are drawn, and computes their normals: those of facets, weighted by area. */
  refresh() {
    const { positions, copies, drawn, normals, corners } = this;
    this.refreshTints();
    for (let i = 0; i < copies.length; i++) {
      for (let axis = 0; axis < 3; axis++) drawn[3 * i + axis] = positions[3 * copies[i] + axis];
    }
    normals.fill(0);
    for (let t = 0; t < corners.length; t += 3) {
      const a = 3 * corners[t], b = 3 * corners[t + 1], c = 3 * corners[t + 2];
      const x1 = drawn[b] - drawn[a], y1 = drawn[b + 1] - drawn[a + 1], z1 = drawn[b + 2] - drawn[a + 2];
      const x2 = drawn[c] - drawn[a], y2 = drawn[c + 1] - drawn[a + 1], z2 = drawn[c + 2] - drawn[a + 2];
      const nx = y1 * z2 - z1 * y2, ny = z1 * x2 - x1 * z2, nz = x1 * y2 - y1 * x2;
      for (let i = t; i < t + 3; i++) {
        const v = 3 * corners[i];
        normals[v] += nx;
        normals[v + 1] += ny;
        normals[v + 2] += nz;
      }
    }
  }

  /** Where a ray first meets the surface: { distance, point, corners, share }, or null (Möller and Trumbore 1997). */
  hit(origin, direction) {
    const { positions, triangles } = this;
    let best = null;
    for (let t = 0; t < triangles.length; t += 3) {
      const corners = [triangles[t], triangles[t + 1], triangles[t + 2]], a = at(positions, corners[0]);
      const e = minus(at(positions, corners[1]), a), f = minus(at(positions, corners[2]), a);
      const h = cross(direction, f), determinant = dot(e, h);
      if (determinant === 0) continue;
      const s = minus(origin, a), u = dot(s, h) / determinant;
      if (u < 0 || u > 1) continue;
      const r = cross(s, e), v = dot(direction, r) / determinant;
      if (v < 0 || u + v > 1) continue;
      const distance = dot(f, r) / determinant;
      if (distance > 0 && !(distance > best?.distance)) best = { distance, corners, share: [1 - u - v, u, v] };
    }
    return best && { ...best, point: origin.map((x, i) => x + best.distance * direction[i]) };
  }
}

/** The place of a hit on other positions of the same surface. */
export function blend({ corners, share }, positions) {
  return [0, 1, 2].map((axis) => corners.reduce((sum, corner, i) => sum + share[i] * positions[3 * corner + axis], 0));
}
