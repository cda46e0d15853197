// Sharp edges: a vertex on one becomes several, so that each side keeps a normal of its own.

const SHARP = Math.cos((38 * Math.PI) / 180);

function faceNormals(rest, triangles) {
  const normals = [];
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [0, 1, 2].map((i) => rest.subarray(3 * triangles[t + i], 3 * triangles[t + i] + 3));
    const [u, v] = [0, 1].map((i) => [b, c][i].map((x, axis) => x - a[axis]));
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n) || 1;
    normals.push(n.map((x) => x / length));
  }
  return normals;
}

/** The triangles around one vertex in groups that no sharp edge parts; two meet where they share another corner. */
function groups(around, vertex, triangles, normals) {
  const left = new Set(around);
  const found = [];
  while (left.size) {
    const [first] = left;
    left.delete(first);
    const group = [first];
    for (const face of group)
      for (const other of [...left]) {
        const corners = [0, 1, 2].map((i) => triangles[3 * face + i]);
        const meet = [0, 1, 2].some((i) => triangles[3 * other + i] !== vertex && corners.includes(triangles[3 * other + i]));
        const cosine = normals[face].reduce((sum, x, axis) => sum + x * normals[other][axis], 0);
        if (!meet || cosine < SHARP) continue;
        left.delete(other);
        group.push(other);
      }
    found.push(group);
  }
  return found;
}

/** Rows of `data`, `size` numbers each, in the order of `source`. */
export function rows(data, size, source) {
  const taken = new data.constructor(size * source.length);
  source.forEach((row, i) => taken.set(data.subarray(size * row, size * (row + 1)), size * i));
  return taken;
}

/** The solid with split vertices: the first are the surface's own, the others copies; `source` says of which. */
export function withCreases(solid) {
  const { rest, triangles } = solid;
  const normals = faceNormals(rest, triangles);
  const around = Array.from({ length: rest.length / 3 }, () => []);
  triangles.forEach((vertex, i) => around[vertex].push(Math.floor(i / 3)));
  const source = around.map((_, vertex) => vertex);
  const split = triangles.slice();
  around.forEach((faces, vertex) => {
    for (const group of groups(faces, vertex, triangles, normals).slice(1)) {
      for (const face of group)
        for (let i = 3 * face; i < 3 * face + 3; i++) if (triangles[i] === vertex) split[i] = source.length;
      source.push(vertex);
    }
  });
  return { ...solid, own: rest.length / 3, source, triangles: split, rest: rows(rest, 3, source), pinned: rows(solid.pinned, 1, source) };
}
