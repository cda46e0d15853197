// The decoder φ(z) = N(z) − N(0) + A z, its skip kept as Aᵀ, and its derivatives, ported from ldsim/reduction/decoder.py.

const ACTIVATIONS = [
  { value: (x) => (x > 0 ? x : Math.expm1(x)), slope: (y) => (y > 0 ? 1 : y + 1) },
  { value: (x) => Math.max(x, 0), slope: (y) => (y > 0 ? 1 : 0) },
  { value: Math.tanh, slope: (y) => 1 - y * y },
  { value: (x) => 0.5 + 0.5 * Math.tanh(0.5 * x), slope: (y) => y * (1 - y) },
];

export class Decoder {
  /** sizes: r, hidden widths, k, or k alone for the identity; the others as `Layers` in Python. */
  constructor(sizes, weights, biases, rest, skip, activation) {
    this.sizes = sizes;
    this.identity = sizes.length === 1;
    this.rest = rest;
    this.skip = skip;
    this.activation = ACTIVATIONS[activation];
    this.layers = [];
    let w = 0, b = 0;
    for (let i = 0; i + 1 < sizes.length; i++) {
      const rows = sizes[i], columns = sizes[i + 1], last = i + 2 === sizes.length;
      this.layers.push({
        rows,
        columns,
        last,
        W: weights.subarray(w, w + rows * columns),
        b: biases.subarray(b, b + columns),
        out: new Float64Array(columns), // activations, kept for the derivatives
        back: new Float64Array(rows),
        tangent: new Float64Array(columns),
      });
      w += rows * columns;
      b += columns;
    }
  }

  /** q = φ(z). */
  decode(z, q) {
    if (this.identity) {
      q.set(z);
      return;
    }
    const value = this.activation.value;
    let input = z;
    for (const { rows, columns, last, W, b, out } of this.layers) {
      out.set(b);
      for (let i = 0, w = 0; i < rows; i++) {
        const x = input[i];
        for (let j = 0; j < columns; j++) out[j] += x * W[w++];
      }
      if (!last) for (let j = 0; j < columns; j++) out[j] = value(out[j]);
      input = out;
    }
    for (let i = 0; i < q.length; i++) q[i] = input[i] - this.rest[i];
    if (this.skip.length) {
      for (let j = 0, w = 0; j < z.length; j++) for (let i = 0; i < q.length; i++) q[i] += this.skip[w++] * z[j];
    }
  }

  /** gradient = J(z)ᵀ v at the z last decoded. */
  vjp(v, gradient) {
    if (this.identity) {
      gradient.set(v);
      return;
    }
    const slope = this.activation.slope;
    let incoming = v;
    for (let l = this.layers.length - 1; l >= 0; l--) {
      const { rows, columns, W, back } = this.layers[l];
      for (let i = 0, w = 0; i < rows; i++) {
        let total = 0;
        for (let j = 0; j < columns; j++) total += W[w++] * incoming[j];
        back[i] = l === 0 ? total : total * slope(this.layers[l - 1].out[i]);
      }
      incoming = back;
    }
    gradient.set(incoming);
    if (this.skip.length) {
      for (let j = 0, w = 0; j < gradient.length; j++) for (let i = 0; i < v.length; i++) gradient[j] += this.skip[w++] * v[i];
    }
  }

  /** jacobian (r, k) = J(z)ᵀ at the z last decoded, one tangent a row. */
  jacobian(jacobian, r, k) {
    if (this.identity) {
      jacobian.fill(0);
      for (let i = 0; i < r; i++) jacobian[i * k + i] = 1;
      return;
    }
    const slope = this.activation.slope;
    for (let a = 0; a < r; a++) {
      let source = null;
      for (const { rows, columns, last, W, out, tangent } of this.layers) {
        if (source === null) {
          tangent.set(W.subarray(a * columns, (a + 1) * columns));
        } else {
          tangent.fill(0);
          for (let i = 0, w = 0; i < rows; i++) {
            const x = source[i];
            for (let j = 0; j < columns; j++) tangent[j] += x * W[w++];
          }
        }
        if (!last) for (let j = 0; j < columns; j++) tangent[j] *= slope(out[j]);
        source = tangent;
      }
      for (let j = 0; j < k; j++) jacobian[a * k + j] = source[j] + (this.skip.length ? this.skip[a * k + j] : 0);
    }
  }
}
