// 3×3 tensor algebra, ported from ldsim/mechanics/materials/tensors.py: a matrix is nine numbers, row by row.

const SWEEPS = 12;

export function determinant(A) {
  return A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6]);
}

/** det(A) A^(−T), the derivative of the determinant. */
export function cofactor(A, C) {
  C[0] = A[4] * A[8] - A[5] * A[7];
  C[1] = A[5] * A[6] - A[3] * A[8];
  C[2] = A[3] * A[7] - A[4] * A[6];
  C[3] = A[2] * A[7] - A[1] * A[8];
  C[4] = A[0] * A[8] - A[2] * A[6];
  C[5] = A[1] * A[6] - A[0] * A[7];
  C[6] = A[1] * A[5] - A[2] * A[4];
  C[7] = A[2] * A[3] - A[0] * A[5];
  C[8] = A[0] * A[4] - A[1] * A[3];
}

export function squaredNorm(A) {
  let total = 0;
  for (let i = 0; i < 9; i++) total += A[i] * A[i];
  return total;
}

const OTHER = [2, 1, 0]; // the index that the pair 01, 02, 12 leaves out is 2, 1, 0
export const PAIRS = [[0, 1], [0, 2], [1, 2]];

/**
 * Eigenvalues `values` (3) and the rotation V of eigenvectors (columns) of S = (s00, s11, s22, s01, s02, s12), by
 * cyclic Jacobi rotations (Golub and Van Loan, Sec. 8.5).
 */
function symmetricEigen(S, values, V) {
  const diagonal = values;
  diagonal[0] = S[0];
  diagonal[1] = S[1];
  diagonal[2] = S[2];
  const off = [S[3], S[4], S[5]];
  V.fill(0);
  V[0] = V[4] = V[8] = 1;
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    const size = Math.abs(off[0]) + Math.abs(off[1]) + Math.abs(off[2]);
    if (size <= 1e-17 * (Math.abs(diagonal[0]) + Math.abs(diagonal[1]) + Math.abs(diagonal[2]))) break;
    for (let pair = 0; pair < 3; pair++) {
      const apq = off[pair];
      if (apq === 0) continue;
      const [p, q] = PAIRS[pair];
      const tau = (diagonal[q] - diagonal[p]) / (2 * apq);
      const t = (tau < 0 || Object.is(tau, -0) ? -1 : 1) / (Math.abs(tau) + Math.sqrt(1 + tau * tau));
      const c = 1 / Math.sqrt(1 + t * t), s = t * c;
      diagonal[p] -= t * apq;
      diagonal[q] += t * apq;
      off[pair] = 0;
      // the two other off-diagonals, those that row p and row q share with the third axis
      const third = OTHER[pair];
      const withP = pairOf(p, third), withQ = pairOf(q, third);
      const x = off[withP], y = off[withQ];
      off[withP] = c * x - s * y;
      off[withQ] = s * x + c * y;
      for (let row = 0; row < 9; row += 3) {
        const v = V[row + p], w = V[row + q];
        V[row + p] = c * v - s * w;
        V[row + q] = s * v + c * w;
      }
    }
  }
}

function pairOf(a, b) {
  return a + b - 1; // 01 → 0, 02 → 1, 12 → 2
}

/** Sets the negative eigenvalues of S = (s00, s11, s22, s01, s02, s12) to zero, in place. */
export function clampSymmetric(S) {
  const values = clampSymmetric.values, V = clampSymmetric.V;
  symmetricEigen(S, values, V);
  if (values[0] >= 0 && values[1] >= 0 && values[2] >= 0) return;
  S.fill(0);
  for (let e = 0; e < 3; e++) {
    const l = Math.max(values[e], 0), x = V[e], y = V[3 + e], z = V[6 + e];
    S[0] += l * x * x;
    S[1] += l * y * y;
    S[2] += l * z * z;
    S[3] += l * x * y;
    S[4] += l * x * z;
    S[5] += l * y * z;
  }
}
clampSymmetric.values = new Float64Array(3);
clampSymmetric.V = new Float64Array(9);

/** F = U diag(σ) Vᵀ with U and V rotations; the last σ carries the sign of det F. */
export function signedSvd(F, U, sigma, V) {
  const { C, values, W } = signedSvd;
  C[0] = F[0] * F[0] + F[3] * F[3] + F[6] * F[6];
  C[1] = F[1] * F[1] + F[4] * F[4] + F[7] * F[7];
  C[2] = F[2] * F[2] + F[5] * F[5] + F[8] * F[8];
  C[3] = F[0] * F[1] + F[3] * F[4] + F[6] * F[7];
  C[4] = F[0] * F[2] + F[3] * F[5] + F[6] * F[8];
  C[5] = F[1] * F[2] + F[4] * F[5] + F[7] * F[8];
  symmetricEigen(C, values, W);
  const order = [0, 1, 2].sort((a, b) => values[b] - values[a]);
  for (let row = 0; row < 3; row++) {
    V[3 * row] = W[3 * row + order[0]];
    V[3 * row + 1] = W[3 * row + order[1]];
  }
  V[2] = V[3] * V[7] - V[6] * V[4];
  V[5] = V[6] * V[1] - V[0] * V[7];
  V[8] = V[0] * V[4] - V[3] * V[1];
  let [x0, x1, x2] = column(F, V, 0), [y0, y1, y2] = column(F, V, 1);
  const [w0, w1, w2] = column(F, V, 2);
  const s0 = Math.sqrt(x0 * x0 + x1 * x1 + x2 * x2);
  if (s0 > 0) [x0, x1, x2] = [x0 / s0, x1 / s0, x2 / s0];
  else [x0, x1, x2] = [1, 0, 0];
  const overlap = x0 * y0 + x1 * y1 + x2 * y2;
  [y0, y1, y2] = [y0 - overlap * x0, y1 - overlap * x1, y2 - overlap * x2];
  const s1 = Math.sqrt(y0 * y0 + y1 * y1 + y2 * y2);
  if (s1 > 1e-14 * s0) {
    [y0, y1, y2] = [y0 / s1, y1 / s1, y2 / s1];
  } else if (Math.abs(x0) < 0.8) {
    const scale = 1 / Math.sqrt(x1 * x1 + x2 * x2);
    [y0, y1, y2] = [0, x2 * scale, -x1 * scale];
  } else {
    const scale = 1 / Math.sqrt(x0 * x0 + x2 * x2);
    [y0, y1, y2] = [x2 * scale, 0, -x0 * scale];
  }
  const z0 = x1 * y2 - x2 * y1, z1 = x2 * y0 - x0 * y2, z2 = x0 * y1 - x1 * y0;
  sigma[0] = s0;
  sigma[1] = s1;
  sigma[2] = z0 * w0 + z1 * w1 + z2 * w2;
  U[0] = x0; U[1] = y0; U[2] = z0;
  U[3] = x1; U[4] = y1; U[5] = z1;
  U[6] = x2; U[7] = y2; U[8] = z2;
}
signedSvd.C = new Float64Array(6);
signedSvd.values = new Float64Array(3);
signedSvd.W = new Float64Array(9);

/** Column j of F V. */
function column(F, V, j) {
  return [
    F[0] * V[j] + F[1] * V[3 + j] + F[2] * V[6 + j],
    F[3] * V[j] + F[4] * V[3 + j] + F[5] * V[6 + j],
    F[6] * V[j] + F[7] * V[3 + j] + F[8] * V[6 + j],
  ];
}
