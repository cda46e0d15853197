// A surface that moves: its triangles, and the copies of its vertices that are drawn.

const CREASE = Math.cos((35 * Math.PI) / 180); // facets that meet at a sharper angle have an edge between them

export function normalised(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((x) => x / length);
}

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export class Surface {
  /** rest: positions (3v); triangles: in the numbering of the vertices. */
  constructor(rest, triangles) {
    this.rest = rest;
    this.triangles = triangles;
    this.positions = Float32Array.from(rest);
    this.tints = new Float32Array(rest.length / 3); // 0 … 1, from the first colour to the last
    this.makeCorners();
  }

  /**
   * Splits the surface's vertices where it has an edge, so that edges look sharp: `corners` are the drawn triangles in
   * the numbering of `copies`, each of which is a copy of a surface vertex with a normal of its own.
   */
  makeCorners() {
    const { triangles } = this;
    const rest = (i) => Array.from(this.rest.subarray(3 * i, 3 * i + 3));
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
    this.drawnTints = new Float32Array(copies.length);
  }

  /** Hands positions and tints to the copies that are drawn, and computes their normals. */
  refresh() {
    const { positions, copies, drawn, normals, corners } = this;
    for (let i = 0; i < copies.length; i++) {
      for (let axis = 0; axis < 3; axis++) drawn[3 * i + axis] = positions[3 * copies[i] + axis];
      this.drawnTints[i] = this.tints[copies[i]];
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
}
