// The reduced step: L-BFGS around the tangent of an earlier state, ported from ldsim/dynamics/reduced/ and
// ldsim/optimise/, with the stop rule ‖∇E‖ ≤ tolerance · max(‖z‖, 1).

import { Potential } from "./potential.js";
import { inner } from "./vector.js";

const ARMIJO = 1e-4, ROUNDOFF = 1e-10, MAX_BACKTRACKS = 40, EPSILON = 2 ** -52;
const WINDOW = 8, RENEWAL = 12, RENEWAL_COST = 6;

/** Lower Cholesky factor in place; a pivot lost to rounding is replaced by a small share of the trace. */
function cholesky(A, r) {
  let trace = 0;
  for (let a = 0; a < r; a++) trace += A[a * r + a];
  if (!(trace > 0 && trace < Infinity)) return false;
  for (let a = 0; a < r; a++) {
    for (let b = 0; b <= a; b++) {
      let total = A[a * r + b];
      for (let j = 0; j < b; j++) total -= A[a * r + j] * A[b * r + j];
      A[a * r + b] = a === b ? Math.sqrt(Math.max(total, 1e-13 * trace)) : total / A[b * r + b];
    }
  }
  return true;
}

function solveCholesky(L, x, r) {
  for (let a = 0; a < r; a++) {
    let total = x[a];
    for (let b = 0; b < a; b++) total -= L[a * r + b] * x[b];
    x[a] = total / L[a * r + a];
  }
  for (let a = r - 1; a >= 0; a--) {
    let total = x[a];
    for (let b = a + 1; b < r; b++) total -= L[b * r + a] * x[b];
    x[a] = total / L[a * r + a];
  }
}

/** Sufficient decrease, or its form in the slopes where the values differ only by rounding. */
function accepts(f0, slope0, step, f, slope) {
  if (!(f < Infinity)) return false;
  if (Math.abs(f - f0) <= ROUNDOFF * Math.abs(f0)) return 0.9 * slope0 <= slope && slope <= -0.8 * slope0;
  return f <= f0 + ARMIJO * step * slope0;
}

/** The step to try after one that was not accepted. */
function nextStep(f0, slope0, step, f, slope) {
  if (!(f < Infinity)) return 0.25 * step;
  if (Math.abs(f - f0) <= ROUNDOFF * Math.abs(f0)) {
    return slope > slope0 ? step * Math.min(Math.max(slope0 / Math.min(slope0 - slope, -1e-300), 0.1), 10) : 10 * step;
  }
  const curvature = f - f0 - slope0 * step;
  if (curvature <= 0) return 0.5 * step;
  return Math.min(Math.max((-0.5 * slope0 * step * step) / curvature, 0.1 * step), 0.5 * step);
}

/** The pairs (s, y) of the last steps, newest last. */
class Memory {
  pairs = [];
  clear = () => (this.pairs.length = 0);

  add(zNew, z, gNew, g) {
    const s = zNew.map((x, i) => x - z[i]), y = gNew.map((x, i) => x - g[i]);
    const sy = inner(s, y);
    if (sy <= 1e-14 * Math.sqrt(inner(s, s) * inner(y, y))) return;
    if (this.pairs.length === WINDOW) this.pairs.shift();
    this.pairs.push({ s, y, rho: 1 / sy, alpha: 0 });
  }

  /** Writes −H g into d by the two-loop recursion around the factor L; returns the slope g·d. */
  direction(g, d, L, r) {
    for (let i = 0; i < r; i++) d[i] = -g[i];
    for (let p = this.pairs.length - 1; p >= 0; p--) {
      const pair = this.pairs[p];
      pair.alpha = pair.rho * inner(pair.s, d);
      for (let i = 0; i < r; i++) d[i] -= pair.alpha * pair.y[i];
    }
    solveCholesky(L, d, r);
    for (const { s, y, rho, alpha } of this.pairs) {
      const beta = alpha - rho * inner(y, d);
      for (let i = 0; i < r; i++) d[i] += beta * s[i];
    }
    return inner(g, d);
  }
}

/** Steps one reduced space; its state is z, q and those of the frame before. */
export class Stepper {
  constructor(space, h, tolerance = 1e-8, maxIterations = 200) {
    const { r, k } = space;
    Object.assign(this, { space, tolerance, maxIterations, potential: new Potential(space, h), memory: new Memory() });
    for (const name of ["z", "zPrevious", "zNew", "g", "gNew", "d"]) this[name] = new Float64Array(r);
    for (const name of ["q", "qPrevious"]) this[name] = new Float64Array(k);
    this.hessian = new Float64Array(r * r);
    this.factor = Float64Array.from(this.hessian, (_, i) => (i % (r + 1) === 0 ? 1 : 0));
    this.reset();
  }

  reset() {
    for (const values of [this.z, this.zPrevious, this.q, this.qPrevious]) values.fill(0);
    this.renew();
  }

  /** The preconditioner is made anew in the next step: call it when a spring or a modulus has changed. */
  renew() {
    this.stale = true;
    this.excess = 0;
  }

  /** One step of implicit Euler; `lost` where even the last state has infinite energy, and z is kept. */
  step() {
    const { potential, space, z, zPrevious, q, qPrevious, zNew } = this;
    for (let j = 0; j < space.k; j++) potential.predictor[j] = 2 * q[j] - qPrevious[j];
    for (let i = 0; i < space.r; i++) zNew[i] = 2 * z[i] - zPrevious[i];
    zPrevious.set(z);
    qPrevious.set(q);
    const fresh = this.stale || this.excess > RENEWAL_COST;
    const record = this.minimise(fresh);
    if (fresh) {
      this.freshIterations = record.iterations;
      this.excess = 0;
      this.stale = record.iterations === 0;
    } else {
      this.excess += Math.max(record.iterations - this.freshIterations, 0);
    }
    space.decoder.decode(z, q);
    return record;
  }

  /** Minimises from zNew, or from z where the energy there is infinite, into z. */
  minimise(fresh) {
    const { potential, space, z, zNew, d } = this, r = space.r;
    let evaluations = 1;
    let f = potential.valueGradient(zNew, this.g);
    if (f < Infinity) z.set(zNew);
    else {
      f = potential.valueGradient(z, this.g);
      evaluations++;
    }
    if (!(f < Infinity)) return { iterations: 0, evaluations, converged: false, lost: true };
    this.memory.clear();
    for (let iteration = 0; iteration < this.maxIterations; iteration++) {
      const norm = Math.sqrt(inner(this.g, this.g));
      if (norm <= this.tolerance * Math.max(Math.sqrt(inner(z, z)), 1)) return { iterations: iteration, evaluations, converged: true };
      if ((fresh && iteration === 0) || (iteration > 0 && iteration % RENEWAL === 0)) this.precondition();
      let slope = this.memory.direction(this.g, d, this.factor, r);
      if (!(slope < 0)) {
        this.memory.clear();
        slope = this.memory.direction(this.g, d, this.factor, r);
      }
      const found = this.search(f, slope);
      evaluations += found.evaluations;
      if (!found.accepted) return { iterations: iteration, evaluations, converged: false };
      this.memory.add(zNew, z, this.gNew, this.g);
      z.set(zNew);
      [this.g, this.gNew] = [this.gNew, this.g];
      f = found.f;
    }
    return { iterations: this.maxIterations, evaluations, converged: false };
  }

  /** Factorises the tangent at z; the memory starts anew. */
  precondition() {
    this.space.decoder.decode(this.z, this.potential.q);
    this.potential.currentTangent(this.hessian);
    if (cholesky(this.hessian, this.space.r)) this.factor.set(this.hessian);
    this.memory.clear();
  }

  /** Line search from z along d into zNew and gNew. */
  search(f, slope) {
    const { z, zNew, d } = this;
    let length = 1;
    for (let evaluations = 1; evaluations <= MAX_BACKTRACKS; evaluations++) {
      for (let i = 0; i < z.length; i++) zNew[i] = z[i] + length * d[i];
      const fNew = this.potential.valueGradient(zNew, this.gNew);
      const slopeNew = fNew < Infinity ? inner(this.gNew, d) : Infinity;
      if (accepts(f, slope, length, fNew, slopeNew)) return { accepted: true, f: fNew, evaluations };
      length = nextStep(f, slope, length, fNew, slopeNew);
      if (length * Math.sqrt(inner(d, d)) <= EPSILON * Math.sqrt(inner(z, z))) return { accepted: false, f, evaluations };
    }
    return { accepted: false, f, evaluations: MAX_BACKTRACKS };
  }
}
