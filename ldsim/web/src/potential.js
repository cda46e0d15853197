// The incremental potential of a reduced space and its tangent, ported from ldsim/dynamics/reduced/potential.py:
//   E(z) = ½ (q − q̂)ᵀ M̃/h² (q − q̂) + Σ_s w_s Ψ(F_s) − f̃·q + Σ ½ k ‖c₀ + B q − target‖²,  q = φ(z)

import { material as materialOf } from "./generated/materials.js";
import { inner } from "./vector.js";

const UPPER = [1, 2, 5], LOWER = [3, 6, 7]; // where the pairs 01, 02, 12 stand in a matrix, and their transposes
const A = new Float64Array(9);

export class Potential {
  /** h: time step, s. `load` (k) and `stiffer`, a factor on all moduli, may be changed between steps. */
  constructor(space, h) {
    const { r, k, points } = space;
    Object.assign(this, { space, h, stiffer: 1, springs: [] }); // of springs: { B: 3 × (k), centre, target, stiffness }
    for (const name of ["load", "predictor", "q", "offset", "force"]) this[name] = new Float64Array(k);
    this.F = new Float64Array(9 * points);
    this.jacobian = new Float64Array(r * k);
    [this.directions, this.stressed] = [0, 1].map(() => Array.from({ length: r }, () => new Float64Array(9 * points)));
    // one row of all points for each of the k columns, so that loops run along memory
    this.G = Array.from({ length: k }, (_, j) => Float64Array.from({ length: 9 * points }, (_, i) => space.strainMaps[i * k + j]));
    this.inertia = Array.from({ length: k }, (_, i) => space.mass.slice(i * k, (i + 1) * k).map((m) => m / (h * h)));
  }

  /** The dead load and the weight of the solid under gravity (3), m/s². */
  setGravity(gravity) {
    const k = this.space.k;
    for (let j = 0; j < k; j++) {
      this.load[j] = this.space.load[j];
      for (let axis = 0; axis < 3; axis++) this.load[j] += gravity[axis] * this.space.unitLoads[axis * k + j];
    }
  }

  /** F = G q for all points, four rows at a time. */
  strains(q, F) {
    const G = this.G, k = q.length, even = k - (k % 4), n = F.length;
    F.fill(0);
    for (let j = 0; j < even; j += 4) {
      const a = q[j], b = q[j + 1], c = q[j + 2], d = q[j + 3];
      const A = G[j], B = G[j + 1], C = G[j + 2], D = G[j + 3];
      for (let i = 0; i < n; i++) F[i] += a * A[i] + b * B[i] + c * C[i] + d * D[i];
    }
    for (let j = even; j < k; j++) {
      const a = q[j], A = G[j];
      for (let i = 0; i < n; i++) F[i] += a * A[i];
    }
  }

  /** F = I + G q. */
  deformation(q) {
    this.strains(q, this.F);
    for (let i = 0; i < this.F.length; i += 9) for (let e = 0; e < 9; e += 4) this.F[i + e] += 1;
  }

  /** Elastic energy of all points; overwrites F with w P. */
  stresses() {
    const { weights, material, mu, lam, points } = this.space;
    const F = this.F;
    let total = 0;
    for (let s = 0; s < points; s++) {
      const i = 9 * s, w = weights[s] * this.stiffer;
      for (let e = 0; e < 9; e++) A[e] = F[i + e];
      const [density, P] = materialOf(material[s]).energyStress(A, mu[s], lam[s]);
      if (!(density < Infinity)) return Infinity;
      total += w * density;
      for (let e = 0; e < 9; e++) F[i + e] = w * P[e];
    }
    return total;
  }

  /** E(z), J; writes its gradient, N. q = φ(z) is left in this.q. */
  valueGradient(z, gradient) {
    const { q, offset, force, predictor, load, inertia, G, F } = this;
    const k = q.length;
    this.space.decoder.decode(z, q);
    this.deformation(q);
    let value = this.stresses();
    if (!(value < Infinity)) return Infinity;
    for (let j = 0; j < k; j++) offset[j] = q[j] - predictor[j];
    for (let j = 0; j < k; j++) {
      const momentum = inner(inertia[j], offset);
      force[j] = momentum - load[j] + inner(G[j], F);
      value += 0.5 * offset[j] * momentum - load[j] * q[j];
    }
    for (const { B, centre, target, stiffness } of this.springs) {
      for (let axis = 0; axis < 3; axis++) {
        const pull = centre[axis] - target[axis] + inner(B[axis], q);
        value += 0.5 * stiffness * pull * pull;
        for (let j = 0; j < k; j++) force[j] += stiffness * pull * B[axis][j];
      }
    }
    this.space.decoder.vjp(force, gradient);
    return value;
  }

  /** hessian (r, r) = Jᵀ (M̃/h² + Σ w Gᵀ ∂²Ψ/∂F² G + Σ k BᵀB) J at the state last decoded, clamped at every point. */
  currentTangent(hessian) {
    const { r, k, decoder, points } = this.space;
    const J = this.jacobian, X = this.directions, T = this.stressed;
    decoder.jacobian(J, r, k);
    const rows = Array.from({ length: r }, (_, a) => J.subarray(a * k, (a + 1) * k));
    const product = new Float64Array(k);
    for (let a = 0; a < r; a++) {
      if (decoder.identity) X[a].set(this.G[a]);
      else this.strains(rows[a], X[a]);
    }
    this.deformation(this.q);
    for (let s = 0; s < points; s++) this.stressDirections(s);
    for (let a = 0; a < r; a++) {
      for (let j = 0; j < k; j++) product[j] = inner(this.inertia[j], rows[a]);
      for (let b = 0; b <= a; b++) {
        hessian[a * r + b] = hessian[b * r + a] = inner(product, rows[b]) + inner(T[a], X[b]);
      }
    }
    for (const { B, stiffness } of this.springs) {
      for (const row of B) {
        const pulled = rows.map((tangent) => inner(row, tangent));
        for (let a = 0; a < r; a++) for (let b = 0; b < r; b++) hessian[a * r + b] += stiffness * pulled[a] * pulled[b];
      }
    }
  }

  /** Turns point s of every X_a into the singular frame and writes T_a, w times the tangent applied to it. */
  stressDirections(s) {
    const { weights, material, mu, lam } = this.space;
    const i = 9 * s;
    for (let e = 0; e < 9; e++) A[e] = this.F[i + e];
    const [U, V, D, O] = materialOf(material[s]).tangent(A, mu[s], lam[s], true);
    const w = weights[s] * this.stiffer;
    for (let a = 0; a < this.directions.length; a++) {
      const x = this.directions[a], t = this.stressed[a];
      for (let p = 0; p < 3; p++) {
        const m0 = U[p] * x[i] + U[3 + p] * x[i + 3] + U[6 + p] * x[i + 6];
        const m1 = U[p] * x[i + 1] + U[3 + p] * x[i + 4] + U[6 + p] * x[i + 7];
        const m2 = U[p] * x[i + 2] + U[3 + p] * x[i + 5] + U[6 + p] * x[i + 8];
        for (let c = 0; c < 3; c++) t[i + 3 * p + c] = m0 * V[c] + m1 * V[3 + c] + m2 * V[6 + c];
      }
      for (let e = 0; e < 9; e++) x[i + e] = t[i + e];
      t[i] = w * (D[0] * x[i] + D[3] * x[i + 4] + D[4] * x[i + 8]);
      t[i + 4] = w * (D[3] * x[i] + D[1] * x[i + 4] + D[5] * x[i + 8]);
      t[i + 8] = w * (D[4] * x[i] + D[5] * x[i + 4] + D[2] * x[i + 8]);
      for (let pair = 0; pair < 3; pair++) {
        const one = i + UPPER[pair], other = i + LOWER[pair];
        t[one] = w * (O[pair] * x[one] + O[3 + pair] * x[other]);
        t[other] = w * (O[pair] * x[other] + O[3 + pair] * x[one]);
      }
    }
  }
}
