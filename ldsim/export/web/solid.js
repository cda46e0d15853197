// The solid: the mesh that moves with the reduced coordinates, and the springs that pull on it.

const CREASE = Math.cos((35 * Math.PI) / 180); // facets that meet at a sharper angle have an edge between them

function normalised(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((x) => x / length);
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

class Solid {
  /** arrays: as readSafetensors gives them. */
  constructor(arrays) {
    this.vertices = arrays.vertices.data;
    this.n = arrays.vertices.shape[0];
    this.basis = arrays.basis.data; // (3n, K), row by row
    this.columns = arrays.basis.shape[1];
    this.movable = arrays.movable.data;
    const triangles = arrays.surface_triangles.data;
    this.surface = Int32Array.from(new Set(triangles)).sort(); // the vertices on the surface
    const number = new Map(Array.from(this.surface, (v, i) => [v, i]));
    this.triangles = Uint32Array.from(triangles, (v) => number.get(v)); // in the surface's numbering
    this.positions = new Float32Array(3 * this.surface.length);
    this.makeCorners();
  }

  /**
   * Splits the surface's vertices where it has an edge, so that edges look sharp: `corners` are the drawn triangles in
   * the numbering of `copies`, each of which is a copy of a surface vertex with a normal of its own.
   */
  makeCorners() {
    const { triangles, surface, vertices } = this;
    const rest = (i) => Array.from(vertices.subarray(3 * surface[i], 3 * surface[i] + 3));
    const groups = new Map(); // surface vertex → [{ copy, normal }]
    const copies = [];
    this.corners = new Uint32Array(triangles.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [0, 1, 2].map((i) => rest(triangles[t + i]));
      const normal = normalised(cross(b.map((x, i) => x - a[i]), c.map((x, i) => x - a[i])));
      for (let i = t; i < t + 3; i++) {
        const known = groups.get(triangles[i]) ?? groups.set(triangles[i], []).get(triangles[i]);
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

  /** Moves the surface to q: positions, and positions and normals of the copies that are drawn. */
  decode(q) {
    const { surface, positions, copies, drawn, normals, corners } = this;
    for (let i = 0; i < surface.length; i++) {
      for (let axis = 0; axis < 3; axis++) positions[3 * i + axis] = this.coordinate(3 * surface[i] + axis, q);
    }
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
