// The five materials, ported from ldsim/mechanics/materials/: energy density, first Piola–Kirchhoff stress and the
// derivatives in the principal stretches, from which the tangent follows. The order is that of MATERIALS in Python.

import { PAIRS, clampSymmetric, cofactor, determinant, signedSvd, squaredNorm } from "./tensors.js";

const NEO_HOOKEAN = 0, STABLE_NEO_HOOKEAN = 1, ST_VENANT_KIRCHHOFF = 2, FIXED_COROTATED = 3, LINEAR = 4;

const cof = new Float64Array(9), svdU = new Float64Array(9), svdV = new Float64Array(9), sigma = new Float64Array(3);

/** Ψ(F), J/m³; writes P = ∂Ψ/∂F, Pa. Infinite where the material does not allow inversion. */
export function energyStress(kind, F, mu, lam, P) {
  switch (kind) {
    case NEO_HOOKEAN:
      return neoHookean(F, mu, lam, P);
    case STABLE_NEO_HOOKEAN:
      return stableNeoHookean(F, mu, lam, P);
    case ST_VENANT_KIRCHHOFF:
      return kirchhoff(F, mu, lam, P);
    case FIXED_COROTATED:
      return corotated(F, mu, lam, P);
    case LINEAR:
      return linear(F, mu, lam, P);
    default:
      throw new Error(`no material has the number ${kind}`);
  }
}

/** P = shear F + pressure cof F. */
function shearAndPressure(F, shear, pressure, P) {
  cofactor(F, cof);
  for (let i = 0; i < 9; i++) P[i] = shear * F[i] + pressure * cof[i];
}

function neoHookean(F, mu, lam, P) {
  const J = determinant(F);
  if (J <= 0) return Infinity;
  const I1 = squaredNorm(F), shear = mu * Math.pow(J, -2 / 3);
  shearAndPressure(F, shear, lam * (J - 1) - (shear * I1) / (3 * J), P);
  return 0.5 * (shear * I1 - 3 * mu) + 0.5 * lam * (J - 1) ** 2;
}

function stableNeoHookean(F, mu, lam, P) {
  const m = (4 * mu) / 3, l = lam + (5 * mu) / 6, alpha = 1 + (0.75 * m) / l;
  const I1 = squaredNorm(F), J = determinant(F);
  shearAndPressure(F, m * (1 - 1 / (I1 + 1)), l * (J - alpha), P);
  const atRest = 0.5 * l * (1 - alpha) ** 2 - 0.5 * m * Math.log(4);
  return 0.5 * m * (I1 - 3) + 0.5 * l * (J - alpha) ** 2 - 0.5 * m * Math.log(I1 + 1) - atRest;
}

function kirchhoff(F, mu, lam, P) {
  const E0 = 0.5 * (F[0] * F[0] + F[3] * F[3] + F[6] * F[6] - 1);
  const E1 = 0.5 * (F[1] * F[1] + F[4] * F[4] + F[7] * F[7] - 1);
  const E2 = 0.5 * (F[2] * F[2] + F[5] * F[5] + F[8] * F[8] - 1);
  const E3 = 0.5 * (F[0] * F[1] + F[3] * F[4] + F[6] * F[7]);
  const E4 = 0.5 * (F[0] * F[2] + F[3] * F[5] + F[6] * F[8]);
  const E5 = 0.5 * (F[1] * F[2] + F[4] * F[5] + F[7] * F[8]);
  const trace = E0 + E1 + E2, pressure = lam * trace;
  const s0 = 2 * mu * E0 + pressure, s1 = 2 * mu * E1 + pressure, s2 = 2 * mu * E2 + pressure;
  const s01 = 2 * mu * E3, s02 = 2 * mu * E4, s12 = 2 * mu * E5;
  for (let i = 0; i < 9; i += 3) {
    P[i] = F[i] * s0 + F[i + 1] * s01 + F[i + 2] * s02;
    P[i + 1] = F[i] * s01 + F[i + 1] * s1 + F[i + 2] * s12;
    P[i + 2] = F[i] * s02 + F[i + 1] * s12 + F[i + 2] * s2;
  }
  return mu * (E0 * E0 + E1 * E1 + E2 * E2 + 2 * (E3 * E3 + E4 * E4 + E5 * E5)) + 0.5 * lam * trace * trace;
}

function corotated(F, mu, lam, P) {
  signedSvd(F, svdU, sigma, svdV);
  const J = determinant(F), pressure = lam * (J - 1);
  cofactor(F, cof);
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      const R = svdU[3 * i] * svdV[3 * j] + svdU[3 * i + 1] * svdV[3 * j + 1] + svdU[3 * i + 2] * svdV[3 * j + 2];
      P[3 * i + j] = 2 * mu * (F[3 * i + j] - R) + pressure * cof[3 * i + j];
    }
  }
  const strain = (sigma[0] - 1) ** 2 + (sigma[1] - 1) ** 2 + (sigma[2] - 1) ** 2;
  return mu * strain + 0.5 * lam * (J - 1) ** 2;
}

function linear(F, mu, lam, P) {
  const trace = F[0] + F[4] + F[8] - 3, pressure = lam * trace;
  const e01 = 0.5 * (F[1] + F[3]), e02 = 0.5 * (F[2] + F[6]), e12 = 0.5 * (F[5] + F[7]);
  P[0] = 2 * mu * (F[0] - 1) + pressure;
  P[4] = 2 * mu * (F[4] - 1) + pressure;
  P[8] = 2 * mu * (F[8] - 1) + pressure;
  P[1] = P[3] = 2 * mu * e01;
  P[2] = P[6] = 2 * mu * e02;
  P[5] = P[7] = 2 * mu * e12;
  const square = (F[0] - 1) ** 2 + (F[4] - 1) ** 2 + (F[8] - 1) ** 2 + 2 * (e01 * e01 + e02 * e02 + e12 * e12);
  return mu * square + 0.5 * lam * trace * trace;
}

/** ∂Ψ/∂σ (3 values) and ∂²Ψ/∂σ² (00, 11, 22, 01, 02, 12) at the stretches a, b, c, Pa; written into `out` (9). */
function principal(kind, a, b, c, mu, lam, out) {
  const J = a * b * c, I1 = a * a + b * b + c * c;
  if (kind === ST_VENANT_KIRCHHOFF) {
    const pressure = 0.5 * lam * (I1 - 3);
    out[0] = (mu * (a * a - 1) + pressure) * a;
    out[1] = (mu * (b * b - 1) + pressure) * b;
    out[2] = (mu * (c * c - 1) + pressure) * c;
    out[3] = mu * (3 * a * a - 1) + pressure + lam * a * a;
    out[4] = mu * (3 * b * b - 1) + pressure + lam * b * b;
    out[5] = mu * (3 * c * c - 1) + pressure + lam * c * c;
    out[6] = lam * a * b;
    out[7] = lam * a * c;
    out[8] = lam * b * c;
    return;
  }
  let l = lam, p, soft = 0, shear = 0, t = 0;
  if (kind === FIXED_COROTATED) {
    p = lam * (J - 1);
    out[0] = 2 * mu * (a - 1);
    out[1] = 2 * mu * (b - 1);
    out[2] = 2 * mu * (c - 1);
    out[3] = out[4] = out[5] = 2 * mu;
    out[6] = out[7] = out[8] = 0;
  } else if (kind === STABLE_NEO_HOOKEAN) {
    const m = (4 * mu) / 3;
    l = lam + (5 * mu) / 6;
    p = l * (J - 1 - (0.75 * m) / l);
    shear = m * (1 - 1 / (I1 + 1));
    soft = (2 * m) / (I1 + 1) ** 2;
    out[0] = shear * a;
    out[1] = shear * b;
    out[2] = shear * c;
    out[3] = shear + soft * a * a;
    out[4] = shear + soft * b * b;
    out[5] = shear + soft * c * c;
    out[6] = soft * a * b;
    out[7] = soft * a * c;
    out[8] = soft * b * c;
  } else {
    p = lam * (J - 1);
    shear = mu * Math.pow(Math.abs(J), -2 / 3);
    t = (shear * I1) / 3;
    out[0] = shear * a - t / a;
    out[1] = shear * b - t / b;
    out[2] = shear * c - t / c;
    out[3] = -shear / 3 + (5 * t) / (3 * a * a);
    out[4] = -shear / 3 + (5 * t) / (3 * b * b);
    out[5] = -shear / 3 + (5 * t) / (3 * c * c);
    out[6] = (-2 / 3) * shear * (a / b + b / a) + (2 * t) / (3 * a * b);
    out[7] = (-2 / 3) * shear * (a / c + c / a) + (2 * t) / (3 * a * c);
    out[8] = (-2 / 3) * shear * (b / c + c / b) + (2 * t) / (3 * b * c);
  }
  // the volume term λ/2 (J − α)² is the same in all three
  out[0] += p * b * c;
  out[1] += p * a * c;
  out[2] += p * a * b;
  out[3] += l * (b * c) ** 2;
  out[4] += l * (a * c) ** 2;
  out[5] += l * (a * b) ** 2;
  out[6] += (l * J + p) * c;
  out[7] += (l * J + p) * b;
  out[8] += (l * J + p) * a;
}

/**
 * The tangent ∂²Ψ/∂F² in the frame of the singular vectors, negative eigenvalues set to zero (Smith et al. 2019).
 *
 * Writes U, V, the stretch block D as (00, 11, 22, 01, 02, 12) and the off-diagonal pairs O as (a01, a02, a12, b01,
 * b02, b12), as `materials.tangent` in Python does.
 */
export function tangent(kind, F, mu, lam, U, V, D, O) {
  if (kind === LINEAR) {
    U.fill(0);
    V.fill(0);
    U[0] = U[4] = U[8] = V[0] = V[4] = V[8] = 1;
    D[0] = D[1] = D[2] = 2 * mu + lam;
    D[3] = D[4] = D[5] = lam;
    O.fill(mu);
    return;
  }
  const h = tangent.h;
  signedSvd(F, U, sigma, V);
  principal(kind, sigma[0], sigma[1], sigma[2], mu, lam, h);
  for (let pair = 0; pair < 3; pair++) {
    const [i, j] = PAIRS[pair];
    const p = sigma[i], q = sigma[j];
    let total = p + q;
    if (Math.abs(total) < 1e-8) total = total >= 0 ? 1e-8 : -1e-8;
    const twist = Math.max((h[i] + h[j]) / total, 0);
    const apart = Math.abs(p - q) > 1e-5 * (Math.abs(p) + Math.abs(q));
    const flip = Math.max(apart ? (h[i] - h[j]) / (p - q) : 0.5 * (h[3 + i] + h[3 + j]) - h[6 + pair], 0);
    O[pair] = 0.5 * (flip + twist);
    O[3 + pair] = 0.5 * (flip - twist);
  }
  for (let i = 0; i < 6; i++) D[i] = h[3 + i];
  clampSymmetric(D);
}
tangent.h = new Float64Array(9);
