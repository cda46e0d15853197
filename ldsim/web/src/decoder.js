// The decoder φ(z) = N(z) − N(0) + A z, its skip kept as Aᵀ, and its derivatives, ported from ldsim/space/decoder.py.

const ACTIVATIONS = [
  { value: (x) => (x > 0 ? x : Math.expm1(x)), slope: (y) => (y > 0 ? 1 : y + 1) },
  { value: (x) => Math.max(x, 0), slope: (y) => (y > 0 ? 1 : 0) },
  { value: Math.tanh, slope: (y) => 1 - y * y },
  { value: (x) => 0.5 + 0.5 * Math.tanh(0.5 * x), slope: (y) => y * (1 - y) },
];

/** out += x W, for a table W of as many rows as x has numbers. */
function addRows(x, W, out) {
  const columns = out.length;
  for (let i = 0, w = 0; i < x.length; i++, w += columns) for (let j = 0; j < columns; j++) out[j] += x[i] * W[w + j];
}

/** out += W x, for a table W of as many columns as x has numbers. */
function addColumns(x, W, out) {
  for (let i = 0, w = 0; i < out.length; i++) for (let j = 0; j < x.length; j++) out[i] += W[w++] * x[j];
}

export class Decoder {
  /** sizes: r, hidden widths, k, or k alone for the identity; the others as `Layers` in Python. */
  constructor(sizes, weights, biases, rest, skip, activation) {
    Object.assign(this, { sizes, skip, identity: sizes.length === 1, activation: ACTIVATIONS[activation], layers: [] });
    this.rest = this.identity ? new Float64Array(sizes[0]) : rest;
    let w = 0, b = 0;
    for (let i = 0; i + 1 < sizes.length; i++) {
      const rows = sizes[i], columns = sizes[i + 1];
      this.layers.push({
        columns,
        last: i + 2 === sizes.length,
        W: weights.subarray(w, (w += rows * columns)),
        b: biases.subarray(b, (b += columns)),
        out: new Float64Array(columns), // activations, kept for the derivatives
        back: new Float64Array(rows),
        tangent: new Float64Array(columns),
      });
    }
  }

  /** q = φ(z). */
  decode(z, q) {
    let input = z;
    for (const { columns, last, W, b, out } of this.layers) {
      out.set(b);
      addRows(input, W, out);
      if (!last) for (let j = 0; j < columns; j++) out[j] = this.activation.value(out[j]);
      input = out;
    }
    for (let i = 0; i < q.length; i++) q[i] = input[i] - this.rest[i];
    if (this.skip.length) addRows(z, this.skip, q);
  }

  /** gradient = J(z)ᵀ v at the z last decoded. */
  vjp(v, gradient) {
    let incoming = v;
    for (let l = this.layers.length - 1; l >= 0; l--) {
      const { W, back } = this.layers[l];
      back.fill(0);
      addColumns(incoming, W, back);
      if (l > 0) for (let i = 0; i < back.length; i++) back[i] *= this.activation.slope(this.layers[l - 1].out[i]);
      incoming = back;
    }
    gradient.set(incoming);
    if (this.skip.length) addColumns(v, this.skip, gradient);
  }

  /** jacobian (r, k) = J(z)ᵀ at the z last decoded, one tangent a row. */
  jacobian(jacobian, r, k) {
    for (let a = 0; a < r; a++) {
      const row = jacobian.subarray(a * k, (a + 1) * k), start = new Float64Array(r);
      start[a] = 1;
      let source = start;
      for (const { columns, last, W, out, tangent } of this.layers) {
        tangent.fill(0);
        addRows(source, W, tangent);
        if (!last) for (let j = 0; j < columns; j++) tangent[j] *= this.activation.slope(out[j]);
        source = tangent;
      }
      row.set(source);
      if (this.skip.length) addRows(start, this.skip, row);
    }
  }
}
