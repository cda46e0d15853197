/* The reduced step of ldsim: see ldsim.h for what it does and docs/guide/runtime.md for the file.
 *
 * One step of implicit Euler minimises the incremental potential (Fulton et al. 2019, Eq. 12) over z in R^r,
 *
 *     E(z) = 1/2 (f - f^)' I (f - f^) + sum_s w_s Psi(F_s) - load . f + sum_g 1/2 k |c_g + B_g f - target_g|^2
 *
 * with the features f = f(z) in R^m that displacements u = U f are linear in, f^ = 2 f_n - f_(n-1), I the reduced mass
 * over the time step squared, and F_s = 1 + G_s f the deformation gradient of a cubature point. This is the step of
 * ldsim/dynamics/reduced in Python: the same decisions in the same order, so that iterates agree to rounding.
 *
 * In order: numbers and small algebra, 3 x 3 tensors, materials, the model file, the decoder, the potential, its
 * tangent, the minimiser, compliance, grabs, the step, what can be read of a solid, saved states.
 */
#include "ldsim.h"

#include <float.h>
#include <math.h>
#ifndef LDSIM_NO_FILES
#include <stdio.h>
#endif
#include <stdlib.h>
#include <string.h>
#if defined _WIN32 && !defined LDSIM_NO_FILES
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#undef near
#undef far
#endif

#define MAX_LAYERS 8
#define LANES 4 /* points of a block, which are worked on together */
#define BLOCK (9 * LANES)
#define DIFFERENCES 6

/* Four numbers at once, in whatever registers the machine has: a vector type of GCC and Clang. */
typedef double four __attribute__((vector_size(32), aligned(8), may_alias));
typedef float four_single __attribute__((vector_size(16), aligned(4), may_alias));
typedef uint64_t bits_of_four __attribute__((vector_size(32)));

enum { ELU, RELU, TANH, SIGMOID, ACTIVATIONS };
enum { NEO_HOOKEAN, STABLE_NEO_HOOKEAN, ST_VENANT_KIRCHHOFF, FIXED_COROTATED, LINEAR, MATERIALS };

const char *ldsim_message(int code)
{
    switch (code) {
    case LDSIM_OK: return "all is well";
    case LDSIM_NO_MEMORY: return "there is not enough memory";
    case LDSIM_NO_FILE: return "the file cannot be read; check its path";
    case LDSIM_NOT_A_MODEL: return "this is no model of ldsim; write one by `ldsim export RUN --format c`";
    case LDSIM_OTHER_VERSION: return "the model is of another version than this library; export it again";
    case LDSIM_WRONG_SIZE: return "the model has not the size that it says; it was cut off, or is of another file";
    case LDSIM_DAMAGED: return "the checksum does not fit; the bytes were changed on their way, copy them again";
    case LDSIM_BAD_SIZES: return "the model has sizes that do not belong together, or are out of range";
    case LDSIM_BAD_INDEX: return "the model has an index that is out of range";
    case LDSIM_NOT_FINITE: return "there is a number that is not finite";
    case LDSIM_BAD_VALUE: return "the model has a number that must be positive and is not";
    case LDSIM_BIG_ENDIAN: return "this machine is big-endian; models are little-endian";
    case LDSIM_BAD_ARGUMENT: return "an argument is out of range: null, not finite, negative, or a vertex that is none";
    case LDSIM_TOO_MANY_GRABS: return "there are as many grabs as the solid was created for; release one";
    case LDSIM_NO_SUCH_GRAB: return "there is no such grab; it was released, here or by a reset";
    case LDSIM_TOO_FAR: return "the point is farther from the solid than half its diagonal; check that it is in metres";
    case LDSIM_ALL_PINNED: return "all vertices there are pinned; take hold of a part that can move";
    case LDSIM_NO_SUCH_SUPPORT: return "there is no such support; a model moves the pins that a motion of its run moves";
    case LDSIM_OTHER_MODEL: return "the saved state is of another model or of a solid that was not created for as many grabs, or damaged, or none";
    case LDSIM_OUT_OF_BOUNDS: return "the solid would be farther from rest than it may be: the saved state is, or so soft its dead load moves it there";
    default: return "there is no such code";
    }
}

/* ---- Numbers and small algebra ---------------------------------------------------------------------------------- */

/* Sums run in eight lanes, in one order whatever the compiler does with them. */
static double dot(const double *a, const double *b, int n)
{
    four s = {0.0, 0.0, 0.0, 0.0}, t = s;
    double rest = 0.0;
    int i = 0;
    for (; i + 8 <= n; i += 8) {
        s += *(const four *)(a + i) * *(const four *)(b + i);
        t += *(const four *)(a + i + 4) * *(const four *)(b + i + 4);
    }
    for (; i < n; i++) rest += a[i] * b[i];
    s += t;
    return ((s[0] + s[2]) + (s[1] + s[3])) + rest;
}

static double dot_single(const float *a, const double *b, int n)
{
    four s = {0.0, 0.0, 0.0, 0.0};
    double rest = 0.0;
    int i = 0;
    for (; i + 4 <= n; i += 4) s += __builtin_convertvector(*(const four_single *)(a + i), four) * *(const four *)(b + i);
    for (; i < n; i++) rest += a[i] * b[i];
    return ((s[0] + s[2]) + (s[1] + s[3])) + rest;
}

static double norm(const double *a, int n) { return sqrt(dot(a, a, n)); }

static void copy(double *restrict to, const double *restrict from, size_t n) { memcpy(to, from, n * sizeof *to); }

static void zero(double *a, size_t n) { memset(a, 0, n * sizeof *a); }

/* out += W' x for W (rows, columns), 32 columns at a time, whose sums stay in registers, then 8, 4 and single ones. */
static void add_transposed(const double *restrict W, const double *restrict x, double *restrict out, int rows,
                           int columns)
{
    int j = 0;
    for (; j + 32 <= columns; j += 32) {
        four *o = (four *)(out + j), a = o[0], b = o[1], c = o[2], d = o[3], e = o[4], f = o[5], g = o[6], h = o[7];
        for (int i = 0; i < rows; i++) {
            const four *w = (const four *)(W + (size_t)i * columns + j);
            const double v = x[i];
            a += v * w[0], b += v * w[1], c += v * w[2], d += v * w[3];
            e += v * w[4], f += v * w[5], g += v * w[6], h += v * w[7];
        }
        o[0] = a, o[1] = b, o[2] = c, o[3] = d, o[4] = e, o[5] = f, o[6] = g, o[7] = h;
    }
    for (; j + 8 <= columns; j += 8) {
        /* four rows at a time, for one sum would wait for itself */
        four *o = (four *)(out + j), none = {0.0, 0.0, 0.0, 0.0};
        four a = o[0], b = o[1], c = none, d = none, e = none, f = none, g = none, h = none;
        int i = 0;
        for (; i + 4 <= rows; i += 4) {
            const four *w = (const four *)(W + (size_t)i * columns + j), *p = (const four *)((const double *)w + columns);
            const four *q = (const four *)((const double *)p + columns), *r = (const four *)((const double *)q + columns);
            a += x[i] * w[0], b += x[i] * w[1], c += x[i + 1] * p[0], d += x[i + 1] * p[1];
            e += x[i + 2] * q[0], f += x[i + 2] * q[1], g += x[i + 3] * r[0], h += x[i + 3] * r[1];
        }
        for (; i < rows; i++) {
            const four *w = (const four *)(W + (size_t)i * columns + j);
            a += x[i] * w[0], b += x[i] * w[1];
        }
        o[0] = (a + c) + (e + g), o[1] = (b + d) + (f + h);
    }
    for (; j + 4 <= columns; j += 4) {
        four *o = (four *)(out + j), a = *o, b = {0.0, 0.0, 0.0, 0.0};
        int i = 0;
        for (; i + 2 <= rows; i += 2) {
            const double *w = W + (size_t)i * columns + j;
            a += x[i] * *(const four *)w, b += x[i + 1] * *(const four *)(w + columns);
        }
        if (i < rows) a += x[i] * *(const four *)(W + (size_t)i * columns + j);
        *o = a + b;
    }
    for (; j < columns; j++)
        for (int i = 0; i < rows; i++) out[j] += x[i] * W[(size_t)i * columns + j];
}

/* C += A'B for A (depth, stride), of which the first `rows` columns count, B (depth, columns) and C (rows, columns),
 * columns a multiple of four. `lower`: only what the lower triangle of C needs. */
static void add_gram(const double *restrict A, int stride, const double *restrict B, double *restrict C, int depth,
                     int rows, int columns, int lower)
{
    for (int i = 0; i + 4 <= rows; i += 4) {
        double *at = C + (size_t)i * columns;
        int j = 0;
        for (; j + 12 <= columns && !(lower && j > i + 3); j += 12) { /* 4 x 12, whose sums stay in registers */
            four *p = (four *)(at + j), *q = (four *)(at + columns + j), *r = (four *)(at + 2 * columns + j),
                 *s = (four *)(at + 3 * columns + j);
            four p0 = p[0], p1 = p[1], p2 = p[2], q0 = q[0], q1 = q[1], q2 = q[2];
            four r0 = r[0], r1 = r[1], r2 = r[2], s0 = s[0], s1 = s[1], s2 = s[2];
            for (int k = 0; k < depth; k++) {
                const double *a = A + (size_t)k * stride + i;
                const four *b = (const four *)(B + (size_t)k * columns + j), x = b[0], y = b[1], z = b[2];
                p0 += a[0] * x, p1 += a[0] * y, p2 += a[0] * z, q0 += a[1] * x, q1 += a[1] * y, q2 += a[1] * z;
                r0 += a[2] * x, r1 += a[2] * y, r2 += a[2] * z, s0 += a[3] * x, s1 += a[3] * y, s2 += a[3] * z;
            }
            p[0] = p0, p[1] = p1, p[2] = p2, q[0] = q0, q[1] = q1, q[2] = q2;
            r[0] = r0, r[1] = r1, r[2] = r2, s[0] = s0, s[1] = s1, s[2] = s2;
        }
        for (; j < columns && !(lower && j > i + 3); j += 4) {
            four *p = (four *)(at + j), *q = (four *)(at + columns + j), *r = (four *)(at + 2 * columns + j),
                 *s = (four *)(at + 3 * columns + j), p0 = *p, q0 = *q, r0 = *r, s0 = *s;
            for (int k = 0; k < depth; k++) {
                const double *a = A + (size_t)k * stride + i;
                const four x = *(const four *)(B + (size_t)k * columns + j);
                p0 += a[0] * x, q0 += a[1] * x, r0 += a[2] * x, s0 += a[3] * x;
            }
            *p = p0, *q = q0, *r = r0, *s = s0;
        }
    }
    for (int i = rows - rows % 4; i < rows; i++)
        for (int k = 0; k < depth; k++) {
            const double a = A[(size_t)k * stride + i];
            for (int j = 0; j < columns; j++) C[(size_t)i * columns + j] += a * B[(size_t)k * columns + j];
        }
}

/* out += W v. */
static void add_product(const double *restrict W, const double *restrict v, double *restrict out, int rows, int columns)
{
    for (int i = 0; i < rows; i++) out[i] += dot(W + (size_t)i * columns, v, columns);
}

/* Lower Cholesky factor in place; a pivot lost to rounding is replaced by a small share of the trace. */
static int cholesky(double *A, int n)
{
    double trace = 0.0;
    for (int a = 0; a < n; a++) trace += A[a * n + a];
    if (!(trace > 0.0 && trace < INFINITY)) return 0;
    const double least = 1e-13 * trace;
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++) {
            const double total = A[a * n + b] - dot(A + a * n, A + b * n, b);
            A[a * n + b] = a == b ? sqrt(fmax(total, least)) : total / A[b * n + b];
        }
    return 1;
}

/* inverse = A^-1 by the inverse of its Cholesky factor, which takes the place of A; inverse stays as it is where there is
 * none. */
static int invert(double *A, double *inverse, int n)
{
    if (!cholesky(A, n)) return 0;
    for (int a = 0; a < n; a++) { /* row by row; `inverse` holds the row of the factor meanwhile */
        double *row = A + (size_t)a * n;
        for (int b = 0; b < a; b++) inverse[b] = -row[b];
        const double scale = 1.0 / row[a];
        zero(row, n);
        for (int b = 0; b < a; b++)
            for (int c = 0; c <= b; c++) row[c] += inverse[b] * A[(size_t)b * n + c];
        row[a] = 1.0;
        for (int c = 0; c <= a; c++) row[c] *= scale;
    }
    zero(inverse, (size_t)n * n);
    if (n % 4 == 0) add_gram(A, n, A, inverse, n, n, n, 1);
    else for (int k = 0; k < n; k++)
        for (int a = 0; a <= k; a++)
            for (int b = 0; b <= a; b++) inverse[a * n + b] += A[k * n + a] * A[k * n + b];
    for (int a = 0; a < n; a++)
        for (int b = 0; b < a; b++) inverse[b * n + a] = inverse[a * n + b];
    return 1;
}

/* By its bits, so that no compiler may assume that all numbers are finite. */
static int finite_number(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits >> 52 & 0x7FF) != 0x7FF;
}

static int all_finite(const double *x, size_t n)
{
    int fine = 1;
    for (size_t i = 0; i < n; i++) fine &= finite_number(x[i]);
    return fine;
}

/* ---- 3 x 3 tensors, row by row; a symmetric one is (00, 11, 22, 01, 02, 12) ---------------------------------------- */

static double determinant(const double *A)
{
    return A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6]);
}

/* det(A) A^(-T), the derivative of the determinant. */
static void cofactor(const double *A, double *C)
{
    C[0] = A[4] * A[8] - A[5] * A[7], C[1] = A[5] * A[6] - A[3] * A[8], C[2] = A[3] * A[7] - A[4] * A[6];
    C[3] = A[2] * A[7] - A[1] * A[8], C[4] = A[0] * A[8] - A[2] * A[6], C[5] = A[1] * A[6] - A[0] * A[7];
    C[6] = A[1] * A[5] - A[2] * A[4], C[7] = A[2] * A[3] - A[0] * A[5], C[8] = A[0] * A[4] - A[1] * A[3];
}

/* F'F. */
static void gram(const double *F, double *S)
{
    S[0] = F[0] * F[0] + F[3] * F[3] + F[6] * F[6], S[1] = F[1] * F[1] + F[4] * F[4] + F[7] * F[7];
    S[2] = F[2] * F[2] + F[5] * F[5] + F[8] * F[8], S[3] = F[0] * F[1] + F[3] * F[4] + F[6] * F[7];
    S[4] = F[0] * F[2] + F[3] * F[5] + F[6] * F[8], S[5] = F[1] * F[2] + F[4] * F[5] + F[7] * F[8];
}

/* Turns rows p and q of V, and the pair (x, y) of off-diagonals, by the rotation that zeroes the off-diagonal *apq of
 * the diagonal entries *app and *aqq (Golub and Van Loan, Sec. 8.5). V is kept transposed, an eigenvector a row. */
static void jacobi_rotate(double *app, double *aqq, double *apq, double *x, double *y, double *vp, double *vq)
{
    if (*apq == 0.0) return;
    const double tau = (*aqq - *app) / (2.0 * *apq);
    const double t = copysign(1.0, tau) / (fabs(tau) + sqrt(1.0 + tau * tau));
    const double c = 1.0 / sqrt(1.0 + t * t), s = t * c, x0 = *x, y0 = *y;
    *app -= t * *apq, *aqq += t * *apq, *apq = 0.0;
    *x = c * x0 - s * y0, *y = s * x0 + c * y0;
    for (int i = 0; i < 3; i++) {
        const double a = vp[i], b = vq[i];
        vp[i] = c * a - s * b, vq[i] = s * a + c * b;
    }
}

/* Eigenvalues into S[0 .. 2], eigenvectors into the rows of V, by Jacobi's method; twelve sweeps end even on NaN. */
static void symmetric_eigen(double *S, double V[3][3])
{
    memset(V, 0, 9 * sizeof(double));
    V[0][0] = V[1][1] = V[2][2] = 1.0;
    for (int sweep = 0; sweep < 12; sweep++) {
        if (fabs(S[3]) + fabs(S[4]) + fabs(S[5]) <= 1e-17 * (fabs(S[0]) + fabs(S[1]) + fabs(S[2]))) break;
        jacobi_rotate(S, S + 1, S + 3, S + 4, S + 5, V[0], V[1]);
        jacobi_rotate(S, S + 2, S + 4, S + 3, S + 5, V[0], V[2]);
        jacobi_rotate(S + 1, S + 2, S + 5, S + 3, S + 4, V[1], V[2]);
    }
}

/* The nearest positive semidefinite matrix: negative eigenvalues set to zero. */
static void clamp_symmetric(double *S)
{
    const double a = S[0], b = S[1], c = S[2], d = S[3], e = S[4], f = S[5];
    const double minor = a * b - d * d, third = minor * c - (a * f * f - 2.0 * d * e * f + b * e * e);
    if (a > 0.0 && minor > 1e-14 * a * b && third > 1e-14 * a * b * c) return; /* Sylvester's criterion */
    double W[6], V[3][3];
    memcpy(W, S, sizeof W);
    symmetric_eigen(W, V);
    if (W[0] >= 0.0 && W[1] >= 0.0 && W[2] >= 0.0) return;
    static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int e6 = 0; e6 < 6; e6++) {
        S[e6] = 0.0;
        for (int i = 0; i < 3; i++) S[e6] += fmax(W[i], 0.0) * V[i][row[e6]] * V[i][column[e6]];
    }
}

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* F = U diag(sigma) V' with rotations U, V, row by row; the last sigma, the smallest, carries the sign of det F. */
static void signed_svd(const double *F, double *U, double *sigma, double *V)
{
    double S[6], W[3][3], p[3], x[3], y[3], z[3];
    gram(F, S);
    symmetric_eigen(S, W);
    int i = 0, j = 1; /* of the largest and the second stretch; the third follows as their cross product */
    if (S[1] > S[0] && S[1] >= S[2]) i = 1, j = S[0] >= S[2] ? 0 : 2;
    else if (S[2] > S[0] && S[2] > S[1]) i = 2, j = S[0] >= S[1] ? 0 : 1;
    else if (S[2] > S[1]) j = 2;
    cross(W[i], W[j], p);
    for (int a = 0; a < 3; a++) x[a] = dot3(F + 3 * a, W[i]), y[a] = dot3(F + 3 * a, W[j]);
    sigma[0] = sqrt(dot3(x, x));
    for (int a = 0; a < 3; a++) x[a] = sigma[0] > 0.0 ? x[a] / sigma[0] : a == 0;
    const double overlap = dot3(x, y);
    for (int a = 0; a < 3; a++) y[a] -= overlap * x[a];
    sigma[1] = sqrt(dot3(y, y));
    if (sigma[1] > 1e-14 * sigma[0]) {
        for (int a = 0; a < 3; a++) y[a] /= sigma[1];
    } else { /* a solid crushed to a line leaves no second direction: any one across the first will do */
        const int k = fabs(x[0]) < 0.8 ? 1 : 0;
        const double scale = 1.0 / sqrt(x[k] * x[k] + x[2] * x[2]), one = x[k], other = x[2];
        y[0] = y[1] = y[2] = 0.0;
        y[k] = other * scale, y[2] = -one * scale;
    }
    cross(x, y, z);
    sigma[2] = 0.0;
    for (int a = 0; a < 3; a++) {
        sigma[2] += z[a] * dot3(F + 3 * a, p);
        U[3 * a] = x[a], U[3 * a + 1] = y[a], U[3 * a + 2] = z[a];
        V[3 * a] = W[i][a], V[3 * a + 1] = W[j][a], V[3 * a + 2] = p[a];
    }
}

/* ---- Materials: energy density and first Piola-Kirchhoff stress P = dPsi/dF ----------------------------------------- */

/* y = x^(-1/3) for x > 0 to a few units in the last place, without a branch or a call; any number elsewhere. With b the
 * bits of x, four thirds of those of 1 less b/3 are those of a guess that is 3.4 % off; with h = 1 - x y^3, the series of
 * y (1 - h)^(-1/3) to its third power leaves the fourth power of an error, twelvefold. */
static inline void inverse_cube_root(const four *x, four *y)
{
    bits_of_four bits, third;
    memcpy(&bits, x, sizeof bits);
    third = (bits >> 2) + (bits >> 4);
    third += third >> 4;
    third += third >> 8;
    third += third >> 16;
    bits = UINT64_C(0x553EF0FF289DD796) - third;
    memcpy(y, &bits, sizeof bits);
    for (int i = 0; i < 2; i++) {
        const four h = 1.0 - (*x * *y) * (*y * *y);
        *y += (*y * h) * (1.0 / 3.0 + h * (2.0 / 9.0 + h * (14.0 / 81.0)));
    }
}

/* Of the strains H = F - 1 of a block, without cancellation near rest: tr F'F - 3 = 2 tr H + H:H, and
 * J - 1 = tr H + 1/2 ((tr H)^2 - tr H^2) + det H. */
static inline void invariants(const four *H, four *stretch, four *volume)
{
    const four a = H[0], b = H[1], c = H[2], d = H[3], e = H[4], f = H[5], g = H[6], h = H[7], i = H[8];
    const four trace = a + e + i, squares = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i;
    const four minors = (a * e - b * d) + (a * i - c * g) + (e * i - f * h);
    const four determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    *stretch = 2.0 * trace + squares, *volume = trace + minors + determinant;
}

/* Overwrites the strains of a block by the stresses by_F F + by_cofactor J F^(-T). */
static inline void put_stresses(four *P, const four *by_F, const four *by_cofactor)
{
    const four shear = *by_F, pressure = *by_cofactor;
    const four b = P[1], c = P[2], d = P[3], f = P[5], g = P[6], h = P[7];
    const four A = P[0] + 1.0, E = P[4] + 1.0, I = P[8] + 1.0;
    P[0] = shear * A + pressure * (E * I - f * h), P[1] = shear * b + pressure * (f * g - d * I);
    P[2] = shear * c + pressure * (d * h - E * g), P[3] = shear * d + pressure * (c * h - b * I);
    P[4] = shear * E + pressure * (A * I - c * g), P[5] = shear * f + pressure * (b * g - A * h);
    P[6] = shear * g + pressure * (b * f - c * E), P[7] = shear * h + pressure * (c * d - A * f);
    P[8] = shear * I + pressure * (A * E - b * d);
}

/* Overwrites the strains of a block, (9, LANES), by w P; returns the energy, the sum of w times
 * mu/2 (J^(-2/3) tr F'F - 3) + lambda/2 (J - 1)^2, infinite for J <= 0; for y = J^(-1/3),
 * y - 1 = -(J - 1) y^3 / (1 + y + y^2). Written out for all points at once, for this material is the usual one and no
 * compiler was seen to find it. */
static double sum_neo_hookean(double *restrict strain, const double *restrict w, const double *restrict mu,
                              const double *restrict lambda, double scale)
{
    four *P = (four *)strain, stretch, volume, y;
    invariants(P, &stretch, &volume);
    const four weight = *(const four *)w, m = scale * *(const four *)mu, l = scale * *(const four *)lambda;
    const four J = 1.0 + volume;
    inverse_cube_root(&J, &y);
    const four square = y * y, cube = square * y;
    const four less_one = -volume * cube / (1.0 + y + square);
    const four shape = 3.0 * (y + 1.0) * less_one + square * stretch;
    const four shear = weight * m * square;
    const four pressure = weight * (l * volume) - shear * (3.0 + stretch) * cube * (1.0 / 3.0);
    put_stresses(P, &shear, &pressure);
    const four density = weight * (0.5 * m * shape + 0.5 * l * volume * volume);
    for (int s = 0; s < LANES; s++)
        if (!(volume[s] > -1.0) && w[s] > 0.0) return INFINITY;
    return (density[0] + density[1]) + (density[2] + density[3]);
}

/* y = log x for normal x > 0 to a few units in the last place, without a branch or a call; a finite number elsewhere.
 * x = 2^k m with m from sqrt(1/2) to sqrt(2), and log m = 2 artanh s by its series, s = (m - 1)/(m + 1) <= 0.172. */
static inline void logarithm(const four *x, four *y)
{
    bits_of_four bits, power;
    four m, k;
    memcpy(&bits, x, sizeof bits);
    bits -= UINT64_C(0x3FE6A09E667F3BCD);                                  /* sqrt(1/2) */
    power = (bits + UINT64_C(0x4000000000000000)) >> 52;                   /* 1024 + k, so that no k is below zero */
    power |= UINT64_C(0x4330000000000000);                                 /* 2^52 and that many units */
    memcpy(&k, &power, sizeof k);
    k -= 0x1p52 + 1024.0;
    bits = (bits & UINT64_C(0x000FFFFFFFFFFFFF)) + UINT64_C(0x3FE6A09E667F3BCD);
    memcpy(&m, &bits, sizeof m);
    const four s = (m - 1.0) / (m + 1.0), t = s * s, t2 = t * t, t4 = t2 * t2;
    const four low = (1.0 / 3.0 + t * (1.0 / 5.0)) + t2 * (1.0 / 7.0 + t * (1.0 / 9.0));
    const four high = (1.0 / 11.0 + t * (1.0 / 13.0)) + t2 * (1.0 / 15.0 + t * (1.0 / 17.0));
    *y = k * 0x1.62E42FEFA39EFp-1 + 2.0 * (s + s * t * (low + t4 * (high + t4 * (1.0 / 19.0))));
}

/* The same for Smith, de Goes and Kim 2018, Eq. 14, with their moduli m = 4/3 mu and l = lambda + 5/6 mu of Sec. 3.4:
 * m/2 (tr F'F - 3 - log((tr F'F + 1)/4)) + l/2 (J - 1)^2 - 3/4 m (J - 1), which is theirs less its value at rest.
 * Written out too, for the points that stand for the potential of a condensed space are of it. */
static double sum_stable_neo_hookean(double *restrict strain, const double *restrict w, const double *restrict mu,
                                     const double *restrict lambda, double scale)
{
    four *P = (four *)strain, stretch, volume, ln;
    invariants(P, &stretch, &volume);
    const four weight = *(const four *)w, m = scale * *(const four *)mu * (4.0 / 3.0);
    const four l = scale * (*(const four *)lambda + *(const four *)mu * (5.0 / 6.0));
    const four quarter = 1.0 + 0.25 * stretch;
    logarithm(&quarter, &ln);
    const four shear = weight * m * (1.0 - 0.25 / quarter), pressure = weight * (l * volume - 0.75 * m);
    put_stresses(P, &shear, &pressure);
    const four density = weight * (0.5 * m * (stretch - ln) + volume * (0.5 * l * volume - 0.75 * m));
    return (density[0] + density[1]) + (density[2] + density[3]);
}

/* mu E:E + lambda/2 (tr E)^2 with E = (F'F - 1)/2 (Bonet and Wood 2008, Sec. 6.3). */
static inline double st_venant_kirchhoff(const double *F, double mu, double lambda, double *P)
{
    double C[6];
    gram(F, C);
    const double e00 = 0.5 * (C[0] - 1.0), e11 = 0.5 * (C[1] - 1.0), e22 = 0.5 * (C[2] - 1.0);
    const double trace = e00 + e11 + e22, m = 2.0 * mu, pressure = lambda * trace;
    const double square = e00 * e00 + e11 * e11 + e22 * e22 + 0.5 * (C[3] * C[3] + C[4] * C[4] + C[5] * C[5]);
    const double s0 = m * e00 + pressure, s1 = m * e11 + pressure, s2 = m * e22 + pressure;
    const double s01 = mu * C[3], s02 = mu * C[4], s12 = mu * C[5];
    for (int i = 0; i < 9; i += 3) {
        P[i] = F[i] * s0 + F[i + 1] * s01 + F[i + 2] * s02;
        P[i + 1] = F[i] * s01 + F[i + 1] * s1 + F[i + 2] * s12;
        P[i + 2] = F[i] * s02 + F[i + 1] * s12 + F[i + 2] * s2;
    }
    return mu * square + 0.5 * lambda * trace * trace;
}

/* mu sum (sigma - 1)^2 + lambda/2 (J - 1)^2 with signed stretches (Stomakhin et al. 2012, Eq. 4); R = U V'. */
static inline double fixed_corotated(const double *F, double mu, double lambda, double *P)
{
    double U[9], sigma[3], V[9], C[9], total = 0.0;
    signed_svd(F, U, sigma, V);
    const double J = determinant(F);
    cofactor(F, C);
    for (int i = 0; i < 3; i++) {
        total += (sigma[i] - 1.0) * (sigma[i] - 1.0);
        for (int j = 0; j < 3; j++) {
            const int e = 3 * i + j;
            P[e] = (2.0 * mu * F[e] - 2.0 * mu * dot3(U + 3 * i, V + 3 * j)) + lambda * (J - 1.0) * C[e];
        }
    }
    return mu * total + 0.5 * lambda * (J - 1.0) * (J - 1.0);
}

/* mu e:e + lambda/2 (tr e)^2 with e = (F + F')/2 - 1. */
static inline double linear_elastic(const double *F, double mu, double lambda, double *P)
{
    const double e00 = F[0] - 1.0, e11 = F[4] - 1.0, e22 = F[8] - 1.0;
    const double e01 = 0.5 * (F[1] + F[3]), e02 = 0.5 * (F[2] + F[6]), e12 = 0.5 * (F[5] + F[7]);
    const double trace = e00 + e11 + e22, m = 2.0 * mu, pressure = lambda * trace;
    P[0] = m * e00 + pressure, P[4] = m * e11 + pressure, P[8] = m * e22 + pressure;
    P[1] = P[3] = m * e01, P[2] = P[6] = m * e02, P[5] = P[7] = m * e12;
    return mu * (e00 * e00 + e11 * e11 + e22 * e22 + 2.0 * (e01 * e01 + e02 * e02 + e12 * e12)) +
           0.5 * lambda * trace * trace;
}

/* dPsi/dx, d2Psi/dx2 and d2Psi/dxdy at the stretches x, y, z; I1 = x^2 + y^2 + z^2 and J = xyz are handed in because
 * every order rounds them differently. */
static void slopes(int kind, double x, double y, double z, double I1, double J, double mu, double lambda, double *out)
{
    if (kind == NEO_HOOKEAN) {
        /* |J|, so that the tangent is finite where a line search looks at an inverted state */
        const double shear = mu * pow(fabs(J), -2.0 / 3.0), pressure = lambda * (J - 1.0), t = shear * I1 / 3.0;
        out[0] = shear * x - t / x + pressure * y * z;
        out[1] = -shear / 3.0 + 5.0 * t / (3.0 * x * x) + lambda * (y * z) * (y * z);
        out[2] = -2.0 / 3.0 * shear * (x / y + y / x) + 2.0 * t / (3.0 * x * y) + (lambda * J + pressure) * z;
    } else if (kind == STABLE_NEO_HOOKEAN) {
        const double m = 4.0 * mu / 3.0, l = lambda + 5.0 * mu / 6.0, alpha = 1.0 + 0.75 * m / l;
        const double by_I1 = 0.5 * m * (1.0 - 1.0 / (I1 + 1.0)), by_J = l * (J - alpha);
        const double twice = 0.5 * m / ((I1 + 1.0) * (I1 + 1.0)), area = y * z;
        out[0] = 2.0 * by_I1 * x + by_J * area;
        out[1] = 2.0 * by_I1 + 4.0 * twice * x * x + l * area * area;
        out[2] = 4.0 * twice * x * y + (l * J + by_J) * z;
    } else if (kind == ST_VENANT_KIRCHHOFF) {
        const double pressure = 0.5 * lambda * (I1 - 3.0);
        out[0] = (mu * (x * x - 1.0) + pressure) * x;
        out[1] = mu * (3.0 * x * x - 1.0) + pressure + lambda * x * x;
        out[2] = lambda * x * y;
    } else { /* FIXED_COROTATED */
        const double pressure = lambda * (J - 1.0);
        out[0] = 2.0 * mu * (x - 1.0) + pressure * y * z;
        out[1] = 2.0 * mu + lambda * (y * z) * (y * z);
        out[2] = (lambda * J + pressure) * z;
    }
}

/* d2Psi/dX_pq^2 into *same and d2Psi/dX_pq dX_qp into *other, from the eigenvalues of twist and flip, clamped (Smith, de
 * Goes and Kim 2019). mean, mixed: of d2Psi/dp2 and d2Psi/dq2, and d2Psi/dpdq. Where p and q meet, their difference is
 * the limit of the flip's quotient; where p and -q meet, their sum is that of the twist's, if Psi(-p, -q) = Psi(p, q). */
static void pair_tangent(double p, double q, double dp, double dq, double mean, double mixed, double *same,
                         double *other)
{
    const double small = 1e-5 * (fabs(p) + fabs(q)), limit = mean + mixed;
    double total = p + q, twist;
    if (fabs(total) <= small && fabs(dp + dq) <= 2.0 * fabs(limit) * small) {
        twist = limit;
    } else {
        /* a density such as the corotated one has no tangent where p = -q; a steep finite one stands for it */
        if (fabs(total) < 1e-8) total = total >= 0.0 ? 1e-8 : -1e-8;
        twist = (dp + dq) / total;
    }
    double flip = fabs(p - q) > small ? (dp - dq) / (p - q) : mean - mixed;
    twist = fmax(twist, 0.0), flip = fmax(flip, 0.0);
    *same = 0.5 * (flip + twist), *other = 0.5 * (flip - twist);
}

/* The tangent in the frame X = U' dF V where it is sparse: the stretch block D, and of the pairs 01, 02, 12 in O the
 * d2Psi/dX_ij^2, then the d2Psi/dX_ij dX_ji. No eigenvalue is negative: a preconditioner must be positive. */
static void clamped_tangent(int kind, const double *F, double mu, double lambda, double *U, double *V, double *D,
                            double *O)
{
    if (kind == LINEAR) { /* constant, and no function of the stretches, so it stands in the frame of the axes */
        for (int e = 0; e < 9; e++) U[e] = V[e] = e % 4 == 0;
        for (int i = 0; i < 3; i++) D[i] = 2.0 * mu + lambda, D[3 + i] = lambda, O[i] = O[3 + i] = mu;
        return;
    }
    double s[3], a[3], b[3], c[3], d[3], e[3];
    signed_svd(F, U, s, V);
    const double I1 = s[0] * s[0] + s[1] * s[1] + s[2] * s[2], J = s[0] * s[1] * s[2];
    slopes(kind, s[0], s[1], s[2], I1, J, mu, lambda, a);
    slopes(kind, s[1], s[0], s[2], I1, J, mu, lambda, b);
    slopes(kind, s[2], s[0], s[1], I1, J, mu, lambda, c);
    slopes(kind, s[0], s[2], s[1], I1, J, mu, lambda, d);
    slopes(kind, s[1], s[2], s[0], I1, J, mu, lambda, e);
    D[0] = a[1], D[1] = b[1], D[2] = c[1], D[3] = a[2], D[4] = d[2], D[5] = e[2];
    pair_tangent(s[0], s[1], a[0], b[0], 0.5 * (D[0] + D[1]), D[3], O, O + 3);
    pair_tangent(s[0], s[2], a[0], c[0], 0.5 * (D[0] + D[2]), D[4], O + 1, O + 4);
    pair_tangent(s[1], s[2], b[0], c[0], 0.5 * (D[1] + D[2]), D[5], O + 2, O + 5);
    clamp_symmetric(D);
}

/* The same for the other materials. One loop for one material: a choice inside
 * would keep the compiler from doing several points at once. */
#define SUM_OF(name)                                                                                                   \
    static double sum_##name(double *restrict strain, const double *restrict w, const double *restrict mu,             \
                             const double *restrict lambda, double scale)                                              \
    {                                                                                                                  \
        double density[LANES];                                                                                         \
        for (int s = 0; s < LANES; s++) {                                                                              \
            double F[9], P[9];                                                                                         \
            for (int e = 0; e < 9; e++) F[e] = strain[e * LANES + s] + (e % 4 == 0);                                   \
            density[s] = name(F, scale * mu[s], scale * lambda[s], P);                                                 \
            for (int e = 0; e < 9; e++) strain[e * LANES + s] = w[s] * P[e];                                           \
        }                                                                                                              \
        return (w[0] * density[0] + w[1] * density[1]) + (w[2] * density[2] + w[3] * density[3]);                                                                                 \
    }
SUM_OF(st_venant_kirchhoff)
SUM_OF(fixed_corotated)
SUM_OF(linear_elastic)

/* ---- The model file ------------------------------------------------------------------------------------------------ */

typedef struct {
    int rows, columns, lead; /* lead: columns that are zero, as those of coordinates that the skip alone moves */
    const double *weights, *biases;
    const double *used, *transposed; /* (rows, columns - lead) and (columns - lead, rows) */
} layer;

/* Counts in the header, in the order of the file. */
typedef struct {
    uint32_t vertices, triangles, r, features, layers, width[MAX_LAYERS], activation, last_activated, skip, mapped,
        points, full_inertia, supports, landmarks, condensed, anchors, nearest, cells, corners, basis_bytes, max_iterations, modes;
} counts;

typedef struct {
    double time_step, gravity[3], tolerance, mass, diagonal, stiffness, radius, reach, threshold, turns;
} numbers;

#define HEADER_SIZE 256
#define NUMBERS_AT (HEADER_SIZE - sizeof(numbers))

struct ldsim_model {
    counts n;
    numbers given;
    uint64_t fingerprint;
    int r, m, points, width, hidden, moved; /* moved: 12 numbers a support */
    int own, modes; /* of the m features: those that the layers and the skip make, and after them modes that swing */
    int anchors;                            /* 0 where the model is not condensed */
    int wide;                               /* r, up to a multiple of four */
    layer layer[MAX_LAYERS];
    /* all below point into bytes; of basis and compliance either the float64 is there or the float32 */
    const double *rest, *at_zero, *skip, *maps, *weights, *mu, *lambda, *inertia, *load, *unit_weight, *lifting,
        *lifted_strain, *lifted_inertia, *landmarks, *mode_rows, *squares, *sag, *vertex_mass, *share, *basis64, *compliance64;
    const float *basis32, *compliance32;
    const uint32_t *triangles, *movable, *kind, *near, *cell; /* cell: vertices of the cells of a condensed model */
    /* what steps read, laid out for them: strain maps (blocks, mapped, 9, LANES), of each block weights, mu and lambda
     * (3, LANES), a number of the file for each of its points, and the skip and mode_rows transposed */
    int blocks;
    double *packed;
    const double *block_maps, *block_points, *skip_transposed, *mode_columns;
    /* of a condensed model: bounds of the mass that hangs on each anchor, and of how far dead load and weight move it */
    double *anchor_mass, sag_reach[4];
    double *compliance; /* of the anchors, (3a, 3a), whole */
    const uint32_t *block_first;
    uint64_t bytes[]; /* the file, aligned */
};

/* Walks through the arrays of a file, or only adds up their size where `at` is null. */
typedef struct {
    const unsigned char *at;
    uint64_t size;
} walk;

static const void *next_array(walk *w, uint64_t count, size_t each)
{
    const unsigned char *found = w->at ? w->at + w->size : NULL;
    w->size += (count * each + 7) & ~UINT64_C(7); /* every array begins at a multiple of 8 */
    return found;
}

static void find_arrays(ldsim_model *M, walk *w)
{
    const counts *n = &M->n;
    const uint64_t v = n->vertices, r = n->r, own = n->features, c = n->points, l = 12 * (uint64_t)n->supports;
    const uint64_t m = own + n->modes;
    const uint64_t condensed = n->condensed != 0, a = 3 * (uint64_t)n->anchors;
    M->rest = next_array(w, 3 * v, 8);
    for (uint32_t i = 0; i < n->layers; i++) {
        const uint64_t rows = i ? n->width[i - 1] : r;
        M->layer[i].rows = (int)rows, M->layer[i].columns = (int)n->width[i];
        M->layer[i].weights = next_array(w, rows * n->width[i], 8);
        M->layer[i].biases = next_array(w, n->width[i], 8);
    }
    M->at_zero = next_array(w, n->layers ? n->width[n->layers - 1] : 0, 8);
    M->skip = next_array(w, n->skip ? r * own : 0, 8);
    M->maps = next_array(w, n->mapped * 9 * c, 8);
    M->weights = next_array(w, c, 8);
    M->mu = next_array(w, c, 8);
    M->lambda = next_array(w, c, 8);
    M->inertia = next_array(w, n->full_inertia ? own * own : own, 8);
    M->load = next_array(w, m, 8);
    M->unit_weight = next_array(w, 3 * m, 8);
    M->lifting = next_array(w, 3 * v * l, 8);
    M->lifted_strain = next_array(w, 9 * c * l, 8);
    M->lifted_inertia = next_array(w, m * l, 8);
    M->landmarks = next_array(w, n->landmarks * r, 8);
    M->mode_rows = next_array(w, n->modes * own, 8);
    M->squares = next_array(w, n->modes, 8);
    M->sag = next_array(w, condensed * 12 * v, 8);
    M->vertex_mass = next_array(w, condensed * v, 8);
    M->share = next_array(w, v * n->nearest, 8);
    const void *basis = next_array(w, 3 * v * m, n->basis_bytes);
    const void *compliance = next_array(w, a * (a + 1) / 2, n->basis_bytes);
    const int wide = n->basis_bytes == 8;
    M->basis64 = wide ? basis : NULL, M->basis32 = wide ? NULL : basis;
    M->compliance64 = wide ? compliance : NULL, M->compliance32 = wide ? NULL : compliance;
    M->triangles = next_array(w, 3 * (uint64_t)n->triangles, 4);
    M->movable = next_array(w, v, 4);
    M->kind = next_array(w, c, 4);
    M->near = next_array(w, v * n->nearest, 4);
    M->cell = next_array(w, (uint64_t)n->cells * n->corners, 4);
}

/* Two running sums of 64-bit words, of which the second tells their order (Fletcher 1982). */
static void add_up(const uint64_t *words, size_t count, uint64_t sums[2])
{
    sums[0] = sums[1] = 0;
    for (size_t i = 0; i < count; i++) sums[0] += words[i], sums[1] += sums[0];
}

/* Bounds so small that no product of three counts leaves 64 bits and no product of two an int. */
static int counts_fit(const ldsim_model *M)
{
    const counts *n = &M->n;
    const uint32_t last = n->layers && n->layers <= MAX_LAYERS ? n->width[n->layers - 1] : n->r;
    int fine = n->vertices >= 1 && n->vertices < 1u << 26 && n->triangles < 1u << 27 && n->r >= 1 && n->r < 1u << 13;
    fine &= n->features >= n->r && n->features < 1u << 13 && n->layers <= MAX_LAYERS && n->activation < ACTIVATIONS;
    for (uint32_t i = 0; i < MAX_LAYERS; i++)
        fine &= i < n->layers ? n->width[i] >= 1 && n->width[i] < 1u << 13 : n->width[i] == 0;
    fine &= last <= n->features && (n->layers || (n->features == n->r && !n->skip && !n->last_activated));
    fine &= n->last_activated <= 1 && n->skip <= 1 && n->full_inertia <= 1 && n->condensed <= 1;
    fine &= n->mapped >= 1 && n->mapped <= n->features && n->points >= 1 && n->points < 1u << 20;
    fine &= n->supports < 1u << 8 && n->landmarks < 1u << 20 && (n->basis_bytes == 8 || n->basis_bytes == 4);
    fine &= n->max_iterations >= 1 && n->max_iterations < 1u << 20;
    fine &= n->condensed ? n->anchors >= 1 && n->anchors < 1u << 13 && n->nearest >= 1 && n->nearest < 1u << 6 && !n->supports
                         : !n->anchors && !n->nearest;
    fine &= n->condensed ? n->cells >= 1 && n->cells < 1u << 27 && n->corners >= 2 && n->corners <= 8 : !n->cells && !n->corners;
    fine &= n->modes < 1u << 13 && (!n->modes || (n->condensed && n->layers));
    return fine;
}

static int all_below(const uint32_t *x, uint64_t count, uint32_t bound)
{
    int fine = 1;
    for (uint64_t i = 0; i < count; i++) fine &= x[i] < bound;
    return fine;
}

static int all_positive(const double *x, uint64_t count)
{
    int fine = 1;
    for (uint64_t i = 0; i < count; i++) fine &= x[i] > 0.0;
    return fine;
}

static int all_finite32(const float *x, uint64_t count)
{
    int fine = 1;
    for (uint64_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, x + i, sizeof bits);
        fine &= (bits >> 23 & 0xFF) != 0xFF;
    }
    return fine;
}

static int check_model(ldsim_model *M)
{
    const counts *n = &M->n;
    const numbers *x = &M->given;
    const unsigned char *bytes = (const unsigned char *)M->bytes;
    const double *end = M->basis64 ? (const double *)(const void *)M->triangles : (const double *)(const void *)M->basis32;
    if (!all_finite((const double *)(const void *)(bytes + NUMBERS_AT), sizeof *x / 8)) return LDSIM_NOT_FINITE;
    if (!all_finite(M->rest, (size_t)(end - M->rest))) return LDSIM_NOT_FINITE;
    if (M->basis32 && !all_finite32(M->basis32, (uint64_t)((const float *)(const void *)M->triangles - M->basis32)))
        return LDSIM_NOT_FINITE;
    const double positive[] = {x->time_step, x->tolerance, x->mass, x->diagonal, x->stiffness, x->radius};
    if (!all_positive(positive, 6) || (n->landmarks && !(x->reach > 0.0)) || x->threshold < 0.0) return LDSIM_BAD_VALUE;
    if (!all_positive(M->weights, n->points) || !all_positive(M->mu, n->points) || !all_positive(M->squares, n->modes)) return LDSIM_BAD_VALUE;
    if (!all_below(M->triangles, 3 * (uint64_t)n->triangles, n->vertices) || !all_below(M->movable, n->vertices, 2) ||
        !all_below(M->kind, n->points, MATERIALS) ||
        !all_below(M->near, (uint64_t)n->vertices * n->nearest, n->anchors) ||
        !all_below(M->cell, (uint64_t)n->cells * n->corners, n->vertices))
        return LDSIM_BAD_INDEX;
    return LDSIM_OK;
}

static const double *transposed(const double *from, int rows, int columns, double *to)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) to[(size_t)j * rows + i] = from[(size_t)i * columns + j];
    return to;
}

/* A block is filled up with points without weight. */
static void pack_block(const ldsim_model *M, int start, int count, double *maps, double *points)
{
    const int c = M->points;
    for (int s = 0; s < LANES; s++) {
        points[s] = s < count ? M->weights[start + s] : 0.0;
        points[LANES + s] = M->mu[start + (s < count ? s : 0)];
        points[2 * LANES + s] = M->lambda[start + (s < count ? s : 0)];
        for (int row = 0; row < 9 * (int)M->n.mapped; row++)
            maps[(size_t)row * LANES + s] = s < count ? M->maps[(size_t)row * c + start + s] : 0.0;
    }
}

/* Where the next block ends: it is full, or another material begins. */
static int block_end(const ldsim_model *M, int start)
{
    int stop = start + 1;
    while (stop < M->points && stop < start + LANES && M->kind[stop] == M->kind[start]) stop++;
    return stop;
}

static int leading_zeros(const layer *l)
{
    for (int j = 0; j < l->columns; j++)
        for (int i = 0; i < l->rows; i++)
            if (l->weights[(size_t)i * l->columns + j] != 0.0) return j;
    return l->columns - 1;
}

/* |sum_p w_p s_p|^2 <= (sum |w_p|) (sum |w_p| |s_p|^2): what follows bounds the mass-weighted square of what anchors move. */
static void bound_residual(ldsim_model *M)
{
    const int p = (int)M->n.nearest;
    zero(M->anchor_mass, M->anchors);
    for (uint32_t v = 0; v < M->n.vertices; v++) {
        const double *share = M->share + (size_t)v * p, *sag = M->sag + 12 * (size_t)v;
        double sum = 0.0;
        for (int i = 0; i < p; i++) sum += fabs(share[i]);
        for (int i = 0; i < p; i++) M->anchor_mass[M->near[(size_t)v * p + i]] += M->vertex_mass[v] * sum * fabs(share[i]);
        for (int e = 0; e < 12; e++) M->sag_reach[e % 4] += M->vertex_mass[v] * sag[e] * sag[e];
    }
    for (int j = 0; j < 4; j++) M->sag_reach[j] = sqrt(M->sag_reach[j]);
}

/* The file has the lower triangle, row by row. Sixteen columns at a time, so that writing down them stays in the cache. */
static void unfold_compliance(ldsim_model *M)
{
    const size_t size = 3 * (size_t)M->anchors;
    for (size_t left = 0; left < size; left += 16)
        for (size_t i = left; i < size; i++)
            for (size_t j = left; j <= i && j < left + 16; j++) {
                const size_t at = i * (i + 1) / 2 + j;
                const double entry = M->compliance64 ? M->compliance64[at] : M->compliance32[at];
                M->compliance[i * size + j] = M->compliance[j * size + i] = entry;
            }
}

/* Whether so many numbers behind so many bytes can be asked for: where size_t has 32 bits, as in a page, it wraps. */
static int can_be_held(uint64_t count, size_t head) { return count <= (SIZE_MAX - head) / sizeof(double); }

/* Whether there was memory for it. */
static int pack(ldsim_model *M)
{
    uint64_t total = 8 + (M->n.skip ? (uint64_t)M->r * M->own : 0) + (uint64_t)M->modes * M->own + M->anchors + 9 * (uint64_t)M->anchors * M->anchors;
    M->blocks = 0;
    for (int start = 0; start < M->points; start = block_end(M, start)) M->blocks++;
    const size_t maps = (size_t)M->n.mapped * BLOCK;
    total += M->blocks * ((uint64_t)maps + 3 * LANES + 1);
    for (uint32_t i = 0; i < M->n.layers; i++) total += 2 * (uint64_t)M->layer[i].rows * M->layer[i].columns;
    M->packed = can_be_held(total, 0) ? malloc((size_t)total * sizeof(double)) : NULL;
    if (!M->packed) return 0;
    double *at = M->packed + (64 - (uintptr_t)M->packed % 64) % 64 / sizeof(double);
    M->block_maps = at, M->block_points = at += M->blocks * maps;
    uint32_t *first = (uint32_t *)(void *)(at += 3 * LANES * (size_t)M->blocks);
    M->block_first = first;
    for (int b = 0, start = 0, stop; b < M->blocks; b++, start = stop) {
        first[b] = (uint32_t)start, stop = block_end(M, start);
        pack_block(M, start, stop - start, (double *)M->block_maps + b * maps, (double *)M->block_points + 3 * LANES * b);
    }
    at += M->blocks;
    for (uint32_t i = 0; i < M->n.layers; i++) {
        layer *l = M->layer + i;
        l->lead = i + 1 < M->n.layers || M->n.last_activated ? 0 : leading_zeros(l);
        const int used = l->columns - l->lead;
        for (int row = 0; row < l->rows; row++)
            copy(at + (size_t)row * used, l->weights + (size_t)row * l->columns + l->lead, used);
        l->used = at, at += (size_t)l->rows * used;
        l->transposed = transposed(l->used, l->rows, used, at), at += (size_t)l->rows * used;
    }
    if (M->n.skip) M->skip_transposed = transposed(M->skip, M->r, M->own, at), at += (size_t)M->r * M->own;
    M->mode_columns = transposed(M->mode_rows, M->modes, M->own, at), at += (size_t)M->modes * M->own;
    M->anchor_mass = at, M->compliance = at + M->anchors;
    if (M->anchors) bound_residual(M), unfold_compliance(M);
    return 1;
}

int ldsim_load(const void *given, size_t size, ldsim_model **model)
{
    static const unsigned char magic[8] = {'L', 'D', 'S', 'I', 'M', '\r', '\n', 0x1A};
    const uint32_t one = 1;
    ldsim_model head, *M;
    uint64_t sums[2], told[3];
    uint32_t version[2];
    if (!given || !model) return LDSIM_BAD_ARGUMENT;
    *model = NULL;
    if (*(const unsigned char *)&one != 1) return LDSIM_BIG_ENDIAN;
    if (size < 8 || memcmp(given, magic, 8) != 0) return LDSIM_NOT_A_MODEL;
    if (size < HEADER_SIZE || size % 8) return LDSIM_WRONG_SIZE;
    const unsigned char *bytes = given;
    memcpy(version, bytes + 8, 8);
    memcpy(told, bytes + 16, 24); /* size and the two sums */
    if (version[0] != LDSIM_FILE_VERSION || version[1] != HEADER_SIZE) return LDSIM_OTHER_VERSION;
    if (told[0] != size) return LDSIM_WRONG_SIZE;
    memset(&head, 0, sizeof head);
    memcpy(&head.n, bytes + 40, sizeof head.n);
    if (!counts_fit(&head)) return LDSIM_BAD_SIZES;
    walk w = {NULL, HEADER_SIZE};
    find_arrays(&head, &w);
    if (w.size != size) return LDSIM_BAD_SIZES;
    M = malloc(sizeof *M + size);
    if (!M) return LDSIM_NO_MEMORY;
    *M = head;
    memcpy(M->bytes, given, size);
    memcpy(&M->given, (unsigned char *)M->bytes + NUMBERS_AT, sizeof M->given);
    add_up(M->bytes + 5, size / 8 - 5, sums);
    w.at = (const unsigned char *)M->bytes, w.size = HEADER_SIZE;
    find_arrays(M, &w);
    M->fingerprint = sums[0] ^ (sums[1] << 1);
    M->wide = ((int)M->n.r + 3) / 4 * 4;
    M->r = (int)M->n.r, M->own = (int)M->n.features, M->modes = (int)M->n.modes, M->points = (int)M->n.points, M->moved = 12 * (int)M->n.supports;
    M->m = M->own + M->modes, M->anchors = (int)M->n.anchors;
    for (uint32_t i = 0; i < M->n.layers; i++) M->hidden += (int)M->n.width[i], M->width = (int)M->n.width[i];
    int code = sums[0] != told[1] || sums[1] != told[2] ? LDSIM_DAMAGED : check_model(M);
    if (code == LDSIM_OK && !pack(M)) code = LDSIM_NO_MEMORY;
    if (code != LDSIM_OK) {
        free(M);
        return code;
    }
    *model = M;
    return LDSIM_OK;
}

#ifndef LDSIM_NO_FILES
/* A path in UTF-8, which fopen of Windows does not take; what is no UTF-8 it may know as of its own code page. */
static FILE *opened(const char *path)
{
#ifdef _WIN32
    wchar_t wide[4096];
    if (MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, 4096)) return _wfopen(wide, L"rb");
#endif
    return fopen(path, "rb");
}

int ldsim_load_file(const char *path, ldsim_model **model)
{
    if (!path || !model) return LDSIM_BAD_ARGUMENT;
    *model = NULL;
    FILE *file = opened(path);
    if (!file) return LDSIM_NO_FILE;
    /* a folder opens, but cannot be read */
    long size = (fgetc(file) == EOF && ferror(file)) || fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    void *bytes = size > 0 && !fseek(file, 0, SEEK_SET) ? malloc((size_t)size) : NULL;
    int code = size < 0 ? LDSIM_NO_FILE : size == 0 ? LDSIM_NOT_A_MODEL : LDSIM_NO_MEMORY;
    if (bytes) code = fread(bytes, 1, (size_t)size, file) == (size_t)size ? LDSIM_OK : LDSIM_NO_FILE;
    fclose(file);
    if (code == LDSIM_OK) code = ldsim_load(bytes, (size_t)size, model);
    free(bytes);
    return code;
}
#endif

void ldsim_free(ldsim_model *model)
{
    if (model) free(model->packed);
    free(model);
}

void ldsim_describe(const ldsim_model *M, ldsim_info *info)
{
    const counts *n = &M->n;
    const numbers *x = &M->given;
    const ldsim_info found = {n->vertices,  n->triangles,      n->r,         (uint32_t)M->m,
                              n->points,    n->supports,       n->condensed != 0, x->time_step,
                              {x->gravity[0], x->gravity[1], x->gravity[2]}, x->diagonal, x->stiffness, x->radius};
    *info = found;
}

const double *ldsim_rest(const ldsim_model *M) { return M->rest; }

const uint32_t *ldsim_triangles(const ldsim_model *M) { return M->triangles; }

const uint32_t *ldsim_movable(const ldsim_model *M) { return M->movable; }

static double basis_entry(const ldsim_model *M, size_t i) { return M->basis64 ? M->basis64[i] : M->basis32[i]; }

int ldsim_fields(const ldsim_model *M, const uint32_t *vertices, uint32_t count, float *fields)
{
    const size_t row = 3 * (size_t)M->m;
    if (!vertices || !fields || !all_below(vertices, count, M->n.vertices)) return LDSIM_BAD_ARGUMENT;
    for (uint32_t i = 0; i < count; i++)
        for (size_t e = 0; e < row; e++) fields[i * row + e] = (float)basis_entry(M, vertices[i] * row + e);
    return LDSIM_OK;
}

/* ---- The decoder: f(z) = N(z) - N(0) + A z, the identity where there are no layers ----------------------------------- */

/* e^y - 1 for -700 < y <= 0 to 2 units in the last place, without a branch, for vectors: e^y = 2^n e^f with |f| <= 1/2 ln 2,
 * the latter by its Taylor series; n is rounded by adding 1.5 * 2^52, and 2^n made from bits. */
static inline double expm1_negative(double y)
{
    const double rounder = 6755399441055744.0, shifted = y * 1.4426950408889634074 + rounder, n = shifted - rounder;
    const double f = (y - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10, g = f * f, h = g * g;
    /* in pairs, so that not every product waits for the one before */
    const double low = (0.5 + f * (1.0 / 6.0)) + g * (1.0 / 24.0 + f * (1.0 / 120.0));
    const double middle = (1.0 / 720.0 + f * (1.0 / 5040.0)) + g * (1.0 / 40320.0 + f * (1.0 / 362880.0));
    const double high = (1.0 / 3628800.0 + f * (1.0 / 39916800.0)) + g * (1.0 / 479001600.0 + f * (1.0 / 6227020800.0));
    const double p = ((high * h + middle) * h + low) * g + f;
    uint64_t bits;
    double power;
    memcpy(&bits, &shifted, sizeof bits);
    bits = (bits + 1023) << 52;
    memcpy(&power, &bits, sizeof power);
    return power * p + (power - 1.0);
}

static void elu(double *x, int count)
{
    for (int i = 0; i < count; i++) {
        const double v = x[i], y = v < 0.0 ? v : 0.0, e = expm1_negative(y > -700.0 ? y : -700.0);
        x[i] = v <= 0.0 ? e : v;
    }
}

/* scale tanh(rate x) + shift, by tanh x = -e / (2 + e) with e = exp(-2x) - 1 for x >= 0. */
static void hyperbolic(double *x, int count, double rate, double scale, double shift)
{
    for (int i = 0; i < count; i++) {
        const double v = rate * x[i], y = -2.0 * fabs(v), e = expm1_negative(y > -700.0 ? y : -700.0);
        x[i] = scale * copysign(-e / (2.0 + e), v) + shift;
    }
}

static void activate(uint32_t kind, double *x, int n)
{
    if (kind == ELU) elu(x, n);
    else if (kind == RELU) for (int i = 0; i < n; i++) x[i] = fmax(x[i], 0.0);
    else if (kind == TANH) hyperbolic(x, n, 1.0, 1.0, 0.0);
    else hyperbolic(x, n, 0.5, 0.5, 0.5);
}

/* The activation's derivative in terms of its value. */
static double slope(uint32_t kind, double y)
{
    if (kind == ELU) return y > 0.0 ? 1.0 : y + 1.0;
    if (kind == RELU) return y > 0.0;
    if (kind == TANH) return 1.0 - y * y;
    return y * (1.0 - y);
}

static int is_activated(const ldsim_model *M, uint32_t i) { return i + 1 < M->n.layers || M->n.last_activated; }

/* Values of all layers are kept in hidden, for the derivatives follow from them. */
static void decode(const ldsim_model *M, const double *z, double *hidden, double *f)
{
    if (M->n.layers == 0) {
        copy(f, z, M->r);
        return;
    }
    const double *x = z;
    double *out = hidden;
    for (uint32_t i = 0; i < M->n.layers; i++) {
        const layer *l = M->layer + i;
        copy(out, l->biases, l->columns);
        add_transposed(l->used, x, out + l->lead, l->rows, l->columns - l->lead);
        if (is_activated(M, i)) activate(M->n.activation, out, l->columns);
        x = out, out += l->columns;
    }
    for (int j = 0; j < M->width; j++) f[j] = x[j] - M->at_zero[j];
    zero(f + M->width, M->m - M->width);
    if (M->n.skip) add_transposed(M->skip, z, f, M->r, M->own);
    if (M->modes) add_transposed(M->mode_columns, f, f + M->own, M->own, M->modes);
}

/* gradient = J' v at the z that was decoded last; scratch is as long as hidden, twice, and where modes swing as `own`. */
static void decode_vjp(const ldsim_model *M, const double *hidden, const double *v, double *scratch, double *gradient)
{
    if (M->n.layers == 0) {
        copy(gradient, v, M->r);
        return;
    }
    if (M->modes) { /* what pulls a mode pulls the features that it follows */
        copy(scratch, v, M->own);
        add_transposed(M->mode_rows, v + M->own, scratch, M->modes, M->own);
        v = scratch, scratch += M->own;
    }
    const double *y = hidden + M->hidden, *incoming = v;
    for (uint32_t i = M->n.layers; i-- > 0;) {
        const layer *l = M->layer + i;
        y -= l->columns;
        if (is_activated(M, i)) {
            for (int j = 0; j < l->columns; j++) scratch[j] = incoming[j] * slope(M->n.activation, y[j]);
            incoming = scratch, scratch += l->columns;
        }
        double *out = i ? scratch : gradient;
        zero(out, l->rows);
        add_transposed(l->transposed, incoming + l->lead, out, l->columns - l->lead, l->rows);
        incoming = out;
        if (i) scratch += l->rows;
    }
    if (M->n.skip) add_transposed(M->skip_transposed, v, gradient, M->own, M->r);
}

static void widen(const double *from, double *to, int rows, int columns, int wide)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < wide; j++) to[(size_t)i * wide + j] = j < columns ? from[(size_t)i * columns + j] : 0.0;
}

/* jacobian (m, wide) = J at the z that was decoded last, its columns filled up with zeros to M->wide. */
static void decode_jacobian(const ldsim_model *M, const double *hidden, double *scratch, double *jacobian)
{
    const int wide = M->wide;
    zero(jacobian, (size_t)M->m * wide);
    if (M->n.layers == 0) {
        for (int a = 0; a < M->r; a++) jacobian[(size_t)a * wide + a] = 1.0;
        return;
    }
    const double *y = hidden, *x = NULL;
    for (uint32_t i = 0; i < M->n.layers; i++) {
        const layer *l = M->layer + i;
        const int used = l->columns - l->lead, last = i + 1 == M->n.layers;
        double *out = last ? jacobian : scratch;
        double *first = out + (size_t)l->lead * wide;
        if (i == 0) widen(l->transposed, first, used, l->rows, wide);
        else {
            if (!last) zero(out, (size_t)l->columns * wide);
            add_gram(l->used, used, x, first, l->rows, used, wide, 0);
        }
        for (int j = 0; j < l->columns && is_activated(M, i); j++) {
            const double steepness = slope(M->n.activation, y[j]);
            for (int a = 0; a < wide; a++) out[(size_t)j * wide + a] *= steepness;
        }
        x = out, scratch += last ? 0 : (size_t)l->columns * wide, y += l->columns;
    }
    for (int j = 0; M->n.skip && j < M->own; j++)
        for (int a = 0; a < M->r; a++) jacobian[(size_t)j * wide + a] += M->skip_transposed[(size_t)j * M->r + a];
    if (M->modes) add_gram(M->mode_columns, M->modes, jacobian, jacobian + (size_t)M->own * wide, M->own, M->modes, wide, 0);
}

/* ---- A solid ------------------------------------------------------------------------------------------------------- */

/* All that a step makes and the next one starts from. The arrays lie one after another, the first one at z. */
typedef struct {
    double *z, *z_before, *guess; /* (r,) */
    double *differences;          /* (DIFFERENCES, r), of z, of the second order and up */
    double *f, *f_before;         /* (m,) */
    double *H;                    /* (r, r), an estimate of the inverse Hessian */
    double *a, *a_before;         /* (moved,), where moved pins were in the last two frames */
    double gravity[3];            /* that acted in the last step */
    int32_t usable;               /* whether H was made; otherwise the next step makes it */
    int32_t fresh, excess;        /* iterations of the step that made H, and those beyond them since */
    uint32_t held[LDSIM_MAX_GRABS]; /* the grabs that H includes, 0 after the last */
    double *springs;                /* and their springs, (3 max_grabs, m), as if their stiffness were 1 */
    int32_t rows;                   /* of them; the others are 0 */
} moment;

typedef struct {
    uint32_t id, count; /* 0: free */
    int released;       /* it pulls no more; its dent in a condensed model is there until the next step */
    double target[3], target_then[3], stiffness; /* then: in the last step */
    double centre[3];    /* centroid of the held vertices at rest */
    double sag[12];      /* and what weight and dead loads move it, of a condensed model */
    uint32_t *vertices;  /* room for all */
    double *B, *lifted;  /* (3, m) and (3, moved): how features and moved pins move the centroid */
    double *load, *field; /* of a condensed model: what anchors get of a force, (a,), and a unit force moves, (3, a, 3) */
    double reach;         /* a bound of the mass-weighted norm of that field */
    /* and of a condensed model how the cells around it have turned and stretched: A = R U^1/2 of R U = I + gradient f */
    double warp[9], inverse[9], *gradient; /* A and the inverse of R U, row by row; gradient: (9, m) */
    double *turned;                        /* A times how modes that swing move the centroid, (3, modes) */
} grab;

struct ldsim_solid {
    const ldsim_model *model;
    int max_grabs;
    uint32_t next_id;
    double gravity[3], scale;
    moment now, first, second, start; /* the state, two tries at the next one, and what a second try starts from */
    size_t moment_size;               /* numbers of one */
    double *pins;                     /* (moved,), where pins are from now on */
    grab grabs[LDSIM_MAX_GRABS];
    /* compliance[i][j]: what a unit force on grab j moves the centroid of grab i, (3, 3), of a condensed model */
    double *compliance;
    int looking_back;    /* whether the springs below are to be those of the last step, as `swap_loads` says */
    int renewed_springs; /* whether the springs below are those of the grabs, and warped as the solid is now */
    /* what a step reads: g springs in the order in which they were taken */
    int g, order[LDSIM_MAX_GRABS];
    double *B, *centre, *target, *stiffness, *root;
    /* where modes swing: how far each follows the decoder within a step and gives way to a force, and where it goes without
     * grabs, less what follows (modes,); and the root of what grabs meet within a step */
    double *follows, *gives, *swung, *swinging;
    /* what is decoded at a state (m,), and how far modes are from where that and their weight have them (modes,) */
    double *relaxed, *strays;
    double *weight, weighed[3]; /* load and weight under a gravity, (m,), and which */
    double *force, *lifted; /* load and weight, (m,); strain of moved pins, (blocks, 9, LANES) */
    /* scratch memory */
    double *hidden, *scratch, *tangents, *predictor, *offset, *pull, *lanes, *gradient, *gradient_new, *direction,
        *z_new, *jacobian, *product, *hessian, *turned, *stressed, *s, *y, *Hy, *joint, *inverse, *arms, *touched;
    /* what grabs pull with, (max_grabs, 3), and behind it how far that moves modes where nothing swings, (max_grabs, modes) */
    double *pulls, *tried;
    double *positions;
};

/* ---- The potential --------------------------------------------------------------------------------------------------- */

/* strain (9, LANES) of a block = G f, with what moved pins add. */
static void strains(const ldsim_solid *S, int block, const double *f, double *strain)
{
    const ldsim_model *M = S->model;
    const double *maps = M->block_maps + (size_t)block * M->n.mapped * BLOCK;
    if (M->moved) copy(strain, S->lifted + (size_t)block * BLOCK, BLOCK);
    else zero(strain, BLOCK);
    four *x = (four *)strain, a = x[0], b = x[1], c = x[2], d = x[3], e = x[4], p = x[5], q = x[6], r = x[7], s = x[8];
    for (int j = 0; j < (int)M->n.mapped; j++) {
        const four *G = (const four *)(maps + (size_t)j * BLOCK);
        const double v = f[j];
        a += v * G[0], b += v * G[1], c += v * G[2], d += v * G[3], e += v * G[4];
        p += v * G[5], q += v * G[6], r += v * G[7], s += v * G[8];
    }
    x[0] = a, x[1] = b, x[2] = c, x[3] = d, x[4] = e, x[5] = p, x[6] = q, x[7] = r, x[8] = s;
}

/* Overwrites the strains of a block by w P; the energy. */
static double weighted_stresses(const ldsim_solid *S, int block, double *strain)
{
    const ldsim_model *M = S->model;
    const double *w = M->block_points + 3 * LANES * (size_t)block, *mu = w + LANES, *lambda = mu + LANES;
    switch (M->kind[M->block_first[block]]) {
    case NEO_HOOKEAN: return sum_neo_hookean(strain, w, mu, lambda, S->scale);
    case STABLE_NEO_HOOKEAN: return sum_stable_neo_hookean(strain, w, mu, lambda, S->scale);
    case ST_VENANT_KIRCHHOFF: return sum_st_venant_kirchhoff(strain, w, mu, lambda, S->scale);
    case FIXED_COROTATED: return sum_fixed_corotated(strain, w, mu, lambda, S->scale);
    default: return sum_linear_elastic(strain, w, mu, lambda, S->scale);
    }
}

/* lanes (mapped, LANES) += G' P of a block; their sums are the forces. */
static void add_forces(const ldsim_model *M, int block, const double *stress, double *lanes)
{
    const double *maps = M->block_maps + (size_t)block * M->n.mapped * BLOCK;
    const four *P = (const four *)stress, a = P[0], b = P[1], c = P[2], d = P[3], e = P[4];
    const four p = P[5], q = P[6], r = P[7], s = P[8];
    for (int j = 0; j < (int)M->n.mapped; j++) {
        const four *G = (const four *)(maps + (size_t)j * BLOCK);
        *(four *)(lanes + LANES * j) += ((a * G[0] + b * G[1]) + (c * G[2] + d * G[3])) +
                                        ((e * G[4] + p * G[5]) + (q * G[6] + r * G[7])) + s * G[8];
    }
}

/* The elastic energy; adds its gradient to S->pull. Infinite where one density is, or is not a number, as infinity less
 * infinity. A block is read once for both, while it is in the cache. */
static double add_elastic(ldsim_solid *S, const double *f)
{
    const ldsim_model *M = S->model;
    double total = 0.0, strain[BLOCK];
    zero(S->lanes, LANES * (size_t)M->n.mapped);
    for (int block = 0; block < M->blocks; block++) {
        strains(S, block, f, strain);
        total += weighted_stresses(S, block, strain);
        if (!(total < INFINITY)) return INFINITY;
        add_forces(M, block, strain, S->lanes);
    }
    for (int j = 0; j < (int)M->n.mapped; j++) {
        const double *lane = S->lanes + LANES * (size_t)j;
        S->pull[j] += (lane[0] + lane[2]) + (lane[1] + lane[3]);
    }
    return total;
}

/* momentum (m,) = I x, of modes the share that they follow. */
static void multiply_inertia(const ldsim_solid *S, const double *x, double *momentum)
{
    const ldsim_model *M = S->model;
    const double rate = 1.0 / (M->given.time_step * M->given.time_step);
    for (int j = 0; j < M->modes; j++) momentum[M->own + j] = rate * S->follows[j] * x[M->own + j];
    if (M->n.full_inertia) { /* which is symmetric, and sums down its columns need not be added up in the end */
        zero(momentum, M->own);
        add_transposed(M->inertia, x, momentum, M->own, M->own);
    } else /* a basis orthonormal in the mass has a diagonal inertia, which saves m^2 products */
        for (int j = 0; j < M->own; j++) momentum[j] = M->inertia[j] * x[j];
}

/* E(z) in J and its gradient in N; f(z) is left in f. An infinite value is only backed away from: it has no gradient. */
static double value_gradient(ldsim_solid *S, const double *z, double *f, double *gradient)
{
    const ldsim_model *M = S->model;
    const int m = M->m;
    decode(M, z, S->hidden, f);
    for (int j = 0; j < m; j++) S->offset[j] = f[j] - S->predictor[j];
    multiply_inertia(S, S->offset, S->pull);
    double value = 0.5 * dot(S->offset, S->pull, m) - dot(S->force, f, m);
    for (int j = 0; j < m; j++) S->pull[j] -= S->force[j];
    for (int i = 0; i < 3 * S->g; i++) {
        const double *row = S->B + (size_t)i * m, k = S->stiffness[i / 3];
        const double stretch = S->centre[i] - S->target[i] + dot(row, f, m);
        value += 0.5 * k * stretch * stretch;
        for (int j = 0; j < m; j++) S->pull[j] += k * stretch * row[j];
    }
    value += add_elastic(S, f);
    if (!(value < INFINITY)) return INFINITY;
    decode_vjp(M, S->hidden, S->pull, S->scratch, gradient);
    return value;
}

/* ---- Its tangent, for the preconditioner --------------------------------------------------------------------------- */

/* One point of every direction into the frame of the singular vectors, X = U' X V, and T = w times the tangent applied to
 * it. Entry e of all directions of the point lies at e `apart` in X and in T. */
static void stress_directions(const ldsim_solid *S, uint32_t kind, const double F[9], double w, double mu, double lambda,
                              double *X, double *T, int apart)
{
    double U[9], V[9], D[6], O[6];
    clamped_tangent((int)kind, F, S->scale * mu, S->scale * lambda, U, V, D, O);
    for (int i = 0; i < 6; i++) D[i] *= w, O[i] *= w;
    for (int a = 0; a < S->model->wide; a += 4) {
        four x[9], y[9];
        for (int e = 0; e < 9; e++) x[e] = *(four *)(X + e * apart + a);
        for (int p = 0; p < 3; p++)
            for (int j = 0; j < 3; j++) y[3 * p + j] = U[p] * x[j] + U[3 + p] * x[3 + j] + U[6 + p] * x[6 + j];
        for (int p = 0; p < 9; p += 3)
            for (int j = 0; j < 3; j++) x[p + j] = y[p] * V[j] + y[p + 1] * V[3 + j] + y[p + 2] * V[6 + j];
        y[0] = D[0] * x[0] + D[3] * x[4] + D[4] * x[8];
        y[4] = D[3] * x[0] + D[1] * x[4] + D[5] * x[8];
        y[8] = D[4] * x[0] + D[5] * x[4] + D[2] * x[8];
        y[1] = O[0] * x[1] + O[3] * x[3], y[3] = O[0] * x[3] + O[3] * x[1];
        y[2] = O[1] * x[2] + O[4] * x[6], y[6] = O[1] * x[6] + O[4] * x[2];
        y[5] = O[2] * x[5] + O[5] * x[7], y[7] = O[2] * x[7] + O[5] * x[5];
        for (int e = 0; e < 9; e++) *(four *)(X + e * apart + a) = x[e], *(four *)(T + e * apart + a) = y[e];
    }
}

/* hessian (r, wide) += J' G' w d2Psi/dF2 G J of a block, clamped at every point. */
static void add_block_tangent(ldsim_solid *S, int block, const double *f)
{
    const ldsim_model *M = S->model;
    const int wide = M->wide, mapped = (int)M->n.mapped;
    const double *maps = M->block_maps + (size_t)block * mapped * BLOCK;
    const double *points = M->block_points + 3 * LANES * (size_t)block;
    double strain[BLOCK], F[9], *X = S->turned, *T = S->stressed;
    strains(S, block, f, strain);
    zero(X, (size_t)BLOCK * wide);
    if (M->n.layers) add_gram(maps, BLOCK, S->jacobian, X, mapped, BLOCK, wide, 0);
    else /* J is the identity */
        for (int row = 0; row < BLOCK; row++)
            for (int j = 0; j < mapped; j++) X[(size_t)row * wide + j] = maps[(size_t)j * BLOCK + row];
    for (int s = 0; s < LANES; s++) {
        for (int e = 0; e < 9; e++) F[e] = strain[e * LANES + s] + (e % 4 == 0);
        stress_directions(S, M->kind[M->block_first[block]], F, points[s], points[LANES + s], points[2 * LANES + s],
                          X + (size_t)s * wide, T + (size_t)s * wide, LANES * wide);
    }
    add_gram(T, wide, X, S->hessian, BLOCK, M->r, wide, 1);
}

/* hessian (r, r) = J' (I + sum w G' d2Psi/dF2 G + sum k B'B) J at z. */
static void tangent_at(ldsim_solid *S, const double *z, double *f)
{
    const ldsim_model *M = S->model;
    const int r = M->r, m = M->m, wide = M->wide;
    double *J = S->jacobian, *H = S->hessian, *product = S->product;
    decode(M, z, S->hidden, f);
    decode_jacobian(M, S->hidden, S->tangents, J);
    zero(product, (size_t)m * wide), zero(H, (size_t)r * wide);
    const int own = M->own;
    const double rate = 1.0 / (M->given.time_step * M->given.time_step);
    if (M->n.full_inertia) add_gram(M->inertia, own, J, product, own, own, wide, 0);
    else
        for (int j = 0; j < own; j++)
            for (int a = 0; a < wide; a++) product[(size_t)j * wide + a] = M->inertia[j] * J[(size_t)j * wide + a];
    for (int j = own; j < m; j++)
        for (int a = 0; a < wide; a++) product[(size_t)j * wide + a] = rate * S->follows[j - own] * J[(size_t)j * wide + a];
    add_gram(product, wide, J, H, m, r, wide, 1);
    for (int block = 0; block < M->blocks; block++) add_block_tangent(S, block, f);
    for (int i = 0; i < 3 * S->g; i++) {
        zero(product, wide);
        add_transposed(J, S->B + (size_t)i * m, product, m, wide);
        for (int a = 0; a < r; a++)
            for (int b = 0; b <= a; b++) H[a * wide + b] += S->stiffness[i / 3] * product[a] * product[b];
    }
    for (int a = 0; a < r; a++) /* rows move forwards, never over what is still to be read */
        for (int b = 0; b <= a; b++) H[a * r + b] = H[a * wide + b];
    for (int a = 0; a < r; a++)
        for (int b = 0; b < a; b++) H[b * r + a] = H[a * r + b];
}

/* ---- The minimiser: BFGS whose inverse Hessian goes on from step to step (Nocedal and Wright 2006, Eq. 6.17) ----------- */

#define ARMIJO 1e-4
#define ROUNDOFF 1e-10 /* values closer than this share are told apart by their slopes: large terms in them cancel */
#define MAX_BACKTRACKS 40
#define RENEWAL 25      /* iterations after which a step gives its preconditioner up */
#define RENEWAL_COST 1000 /* and beyond those of the step that made it: BFGS mends it by itself */
#define LEAST_LEFT 0.1  /* of the curvature along a spring that goes, for the rest to be known by the difference */

/* Sufficient decrease, or its form in the slopes where the values differ only by rounding (Hager and Zhang 2005, Eq.
 * 4.1), where the slope must also have risen by a tenth, so that steps of rounding size are not accepted without end. */
static int accepts(double f0, double slope0, double step, double f, double slope)
{
    if (!(f < INFINITY)) return 0;
    if (fabs(f - f0) <= ROUNDOFF * fabs(f0)) return 0.9 * slope0 <= slope && slope <= -0.8 * slope0;
    return f <= f0 + ARMIJO * step * slope0;
}

/* The step to try after one that was not accepted: where the values tell, the minimiser of the parabola through both and
 * the first slope; where they differ only by rounding, the root of the secant through both slopes. */
static double next_step(double f0, double slope0, double step, double f, double slope)
{
    if (!(f < INFINITY)) return 0.25 * step;
    if (fabs(f - f0) <= ROUNDOFF * fabs(f0))
        return slope > slope0 ? step * fmin(fmax(slope0 / fmin(slope0 - slope, -1e-300), 0.1), 10.0) : 10.0 * step;
    const double curvature = f - f0 - slope0 * step;
    if (curvature <= 0.0) return 0.5 * step;
    return fmin(fmax(-0.5 * slope0 * step * step / curvature, 0.1 * step), 0.5 * step);
}

typedef struct {
    int iterations, evaluations;
    ldsim_reason reason;
    double value, norm;
} solution;

/* Line search from z along the direction; whether it succeeded, with the value at z_new in *f. */
static int search(ldsim_solid *S, const double *z, double *features, double *f, double slope0, int *evaluations)
{
    const int r = S->model->r;
    double length = 1.0;
    for (int tried = 1; tried <= MAX_BACKTRACKS; tried++) {
        for (int i = 0; i < r; i++) S->z_new[i] = z[i] + length * S->direction[i];
        const double f_new = value_gradient(S, S->z_new, features, S->gradient_new);
        const double slope_new = f_new < INFINITY ? dot(S->gradient_new, S->direction, r) : (double)INFINITY;
        ++*evaluations;
        if (accepts(*f, slope0, length, f_new, slope_new)) {
            *f = f_new;
            return 1;
        }
        length = next_step(*f, slope0, length, f_new, slope_new);
        /* a shorter step would not change z any more */
        if (length * norm(S->direction, r) <= DBL_EPSILON * norm(z, r)) return 0;
    }
    return 0;
}

/* By how much the gradient at z changes where every coordinate is moved by a rounding, N; f(z) is left in f. */
static double rounding(ldsim_solid *S, const double *z, double *f)
{
    const int r = S->model->r;
    for (int i = 0; i < r; i++) S->z_new[i] = z[i] * (i % 2 ? 1.0 + DBL_EPSILON : 1.0 - DBL_EPSILON);
    value_gradient(S, S->z_new, f, S->gradient_new);
    for (int i = 0; i < r; i++) S->gradient_new[i] -= S->gradient[i];
    decode(S->model, z, S->hidden, f);
    return norm(S->gradient_new, r);
}

/* H <- (1 - s y'/sy) H (1 - y s'/sy) + s s'/sy, if the curvature sy of the last pair is safely positive. */
static void update(ldsim_solid *S, const double *z, double *H)
{
    const int r = S->model->r;
    double *s = S->s, *y = S->y, *Hy = S->Hy;
    for (int i = 0; i < r; i++) s[i] = S->z_new[i] - z[i], y[i] = S->gradient_new[i] - S->gradient[i];
    const double sy = dot(s, y, r);
    if (!(sy > 1e-14 * sqrt(dot(s, s, r) * dot(y, y, r)))) return;
    zero(Hy, r);
    add_transposed(H, y, Hy, r, r);
    /* expanded into two outer products, so that H is read and written once */
    const double scale = (1.0 + dot(y, Hy, r) / sy) / sy;
    for (int i = 0; i < r; i++) {
        const double a = scale * s[i] - Hy[i] / sy, b = s[i] / sy;
        for (int j = 0; j < r; j++) H[i * r + j] += a * s[j] - b * Hy[j];
    }
}

/* H <- (H^-1 + sign a a')^-1 for the gradient a of a spring of unit stiffness at the z that was decoded last (Sherman and
 * Morrison); whether so much of the curvature along a is left that the result can be trusted. */
static int exchange_spring(ldsim_solid *S, const double *spring, double sign, double *H)
{
    const int r = S->model->r;
    double *a = S->s, *Ha = S->Hy;
    decode_vjp(S->model, S->hidden, spring, S->scratch, a);
    zero(Ha, r);
    add_transposed(H, a, Ha, r, r);
    const double left = 1.0 + sign * dot(a, Ha, r);
    if (!(left > LEAST_LEFT)) return 0;
    for (int i = 0; i < r; i++)
        for (int j = 0; j < r; j++) H[i * r + j] -= sign / left * Ha[i] * Ha[j];
    return 1;
}

/* The springs of this step come into H, and those of the step before, where others were held, go. */
static int exchange_springs(ldsim_solid *S, const moment *before, double *H)
{
    const int m = S->model->m;
    int fine = 1;
    for (int i = 0; i < 3 * S->g && fine; i++) {
        for (int j = 0; j < m; j++) S->offset[j] = sqrt(S->stiffness[i / 3]) * S->B[(size_t)i * m + j];
        fine = exchange_spring(S, S->offset, 1.0, H);
    }
    for (int i = 0; i < before->rows && fine; i++) fine = exchange_spring(S, before->springs + (size_t)i * m, -1.0, H);
    return fine;
}

static void keep_springs(const ldsim_solid *S, moment *to)
{
    const int m = S->model->m, rows = 3 * S->g;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < m; j++)
            to->springs[(size_t)i * m + j] = sqrt(S->stiffness[i / 3]) * S->B[(size_t)i * m + j];
    if (to->rows > rows) zero(to->springs + (size_t)rows * m, (size_t)(to->rows - rows) * m);
    to->rows = rows;
}

static void find_direction(ldsim_solid *S, const double *H)
{
    const int r = S->model->r;
    for (int i = 0; i < r; i++) S->Hy[i] = -S->gradient[i];
    zero(S->direction, r);
    add_transposed(H, S->Hy, S->direction, r, r); /* H is symmetric */
}

/* One more step from where the minimiser may stop, without looking at E there: z is then ten times as near to the minimum, for
 * the price of a decoder. */
static void go_on(ldsim_solid *S, double *z, const double *H, double *f)
{
    find_direction(S, H);
    for (int i = 0; i < S->model->r; i++) z[i] += S->direction[i];
    decode(S->model, z, S->hidden, f);
}

/* Minimises E from the guess of the moment before, or from z where that has infinite energy. z: z_n, then z_(n+1), whose
 * features are left in f. H is renewed at once where `renew` says so, and where `others` are held, their springs are
 * exchanged in it. Value and norm are those where E was evaluated last. */
static solution minimise(ldsim_solid *S, const moment *before, double *z, double *f, double *H, int renew, int others)
{
    const double *guess = before->guess;
    const ldsim_model *M = S->model;
    const int r = M->r;
    solution found = {0, 1, LDSIM_CONVERGED, 0.0, INFINITY};
    int renewed_at = -1;
    found.value = value_gradient(S, guess, f, S->gradient);
    if (found.value < INFINITY) {
        copy(z, guess, r);
    } else {
        found.value = value_gradient(S, z, f, S->gradient);
        found.evaluations++;
    }
    if (!(found.value < INFINITY)) {
        found.reason = LDSIM_INFINITE_START;
        return found;
    }
    for (; found.iterations < (int)M->n.max_iterations; found.iterations++) {
        found.norm = norm(S->gradient, r);
        if (found.norm <= M->given.tolerance * fmax(norm(z, r), 1.0)) {
            if (!(renew || others)) go_on(S, z, H, f);
            return found;
        }
        if (others && !renew) renew = !exchange_springs(S, before, H);
        others = 0;
        const int overdue = found.iterations - (renewed_at > 0 ? renewed_at : 0) >= RENEWAL;
        if (found.iterations > 0 && (renew || overdue)) {
            /* a step that goes on for long: forces that cancel may leave nothing but their rounding */
            found.evaluations++;
            if (found.norm <= rounding(S, z, f)) return found;
        }
        if (renew || overdue) {
            tangent_at(S, z, f);
            invert(S->hessian, H, r); /* kept as it is where the tangent has no factor */
            renew = 0, renewed_at = found.iterations;
        }
        find_direction(S, H);
        const double slope0 = dot(S->gradient, S->direction, r);
        if (!(slope0 < 0.0 && search(S, z, f, &found.value, slope0, &found.evaluations))) {
            /* with a fresh preconditioner there is nothing better to try; with an old one, that */
            if (renewed_at == found.iterations) {
                found.evaluations++;
                if (!(found.norm <= rounding(S, z, f))) found.reason = LDSIM_NO_DECREASE;
                return found;
            }
            renew = 1;
            continue;
        }
        update(S, z, H);
        copy(z, S->z_new, r);
        copy(S->gradient, S->gradient_new, r);
    }
    found.norm = norm(S->gradient, r), found.reason = LDSIM_ITERATIONS_SPENT;
    return found;
}

/* ---- Compliance: what a force moves beside the coordinates of a condensed model ---------------------------------------- */

/* What a unit force along each axis of a grab moves at the anchors, A P'B', and how far that reaches. */
static void move_anchors(const ldsim_model *M, grab *own)
{
    const size_t size = 3 * (size_t)M->anchors;
    zero(own->field, 3 * size);
    for (size_t a = 0; a < size; a++) {
        const double share = own->load[a / 3], *restrict row = M->compliance + a * size;
        double *restrict field = own->field + a % 3 * size;
        for (size_t e = 0; e < size && share != 0.0; e++) field[e] += share * row[e];
    }
    own->reach = 0.0;
    for (size_t e = 0; e < 3 * size; e++) own->reach += M->anchor_mass[e % size / 3] * own->field[e] * own->field[e];
    own->reach = sqrt(own->reach);
}

/* out (3, 3) = what the field of one grab moves the centroid of another. */
static void mean_field(const ldsim_model *M, const grab *moving, const grab *moved, double *out)
{
    zero(out, 9);
    const size_t size = 3 * (size_t)M->anchors;
    for (size_t a = 0; a < size; a++)
        for (int axis = 0; axis < 3 && moved->load[a / 3] != 0.0; axis++)
            out[3 * (a % 3) + axis] += moved->load[a / 3] * moving->field[axis * size + a];
}

static double *pair_of(const ldsim_solid *S, int i, int j) { return S->compliance + 9 * ((size_t)i * S->max_grabs + j); }

/* What a unit force along each axis of grab i moves: the anchors, and the centroids of all grabs. */
static void find_field(ldsim_solid *S, int i)
{
    grab *own = S->grabs + i;
    move_anchors(S->model, own);
    for (int j = 0; j < S->max_grabs; j++) {
        if (S->grabs[j].id == 0) continue;
        mean_field(S->model, own, S->grabs + j, pair_of(S, j, i));
        if (j != i) mean_field(S->model, S->grabs + j, own, pair_of(S, i, j));
    }
}

/* ---- Grabs ----------------------------------------------------------------------------------------------------------- */

/* A'x of A, row by row. */
static void warp_back(const double *A, const double *x, double *warped)
{
    for (int i = 0; i < 3; i++) warped[i] = A[i] * x[0] + A[3 + i] * x[1] + A[6 + i] * x[2];
}

/* Whether what modes that swing have of a dent turns with the place that is held. */
static int modes_turn(const ldsim_model *M) { return M->modes && M->given.turns != 0.0; }

/* How far the pulls of one grab move modes where nothing swings, (modes,). */
static double *given_by(const ldsim_solid *S, const double *pulls, int g)
{
    return (double *)pulls + 3 * (size_t)S->max_grabs + (size_t)g * S->model->modes;
}

static size_t pulls_size(const ldsim_solid *S) { return (size_t)S->max_grabs * (3 + (size_t)S->model->modes); }

/* How far a row of modes moves by what is given, of a row of U. */
static double modes_moved(const ldsim_model *M, size_t row, const double *given)
{
    const size_t first = row * M->m + M->own;
    return M->basis64 ? dot(M->basis64 + first, given, M->modes) : dot_single(M->basis32 + first, given, M->modes);
}

/* u (3,) of one vertex at some moment, with what grabs pull by then, see `pulls`. */
static void displacement_at(const ldsim_solid *S, uint32_t v, const moment *at, const double *pulls, double *u)
{
    const ldsim_model *M = S->model;
    for (int axis = 0; axis < 3; axis++) {
        const size_t row = 3 * (size_t)v + axis;
        u[axis] = M->basis64 ? dot(M->basis64 + row * M->m, at->f, M->m) : dot_single(M->basis32 + row * M->m, at->f, M->m);
        if (M->moved) u[axis] += dot(M->lifting + row * M->moved, at->a, M->moved);
    }
    if (!M->anchors) return;
    const size_t size = 3 * (size_t)M->anchors;
    double slack[3];
    for (int axis = 0; axis < 3; axis++) {
        const double *sag = M->sag + 12 * (size_t)v + 4 * axis;
        slack[axis] = sag[0] + dot3(sag + 1, at->gravity);
    }
    for (int g = 0; g < S->max_grabs; g++) {
        if (!S->grabs[g].id) continue;
        double pull[3], moved[3] = {0.0, 0.0, 0.0};
        warp_back(S->grabs[g].warp, pulls + 3 * g, pull);
        for (uint32_t i = 0; i < M->n.nearest; i++) {
            const size_t place = (size_t)v * M->n.nearest + i;
            const double *field = S->grabs[g].field + 3 * (size_t)M->near[place];
            for (int axis = 0; axis < 3; axis++, field++)
                moved[axis] += M->share[place] * (field[0] * pull[0] + field[size] * pull[1] + field[2 * size] * pull[2]);
        }
        for (int axis = 0; axis < 3; axis++) slack[axis] += dot3(S->grabs[g].warp + 3 * axis, moved);
    }
    for (int axis = 0; axis < 3; axis++) u[axis] += slack[axis] / S->scale;
    /* what modes have of a dent is turned with it, and is there only as far as they have moved */
    for (int g = 0; modes_turn(M) && g < S->max_grabs; g++) {
        if (!S->grabs[g].id) continue;
        double by[3];
        for (int axis = 0; axis < 3; axis++) by[axis] = modes_moved(M, 3 * (size_t)v + axis, given_by(S, pulls, g));
        for (int axis = 0; axis < 3; axis++) u[axis] += dot3(S->grabs[g].warp + 3 * axis, by) - by[axis];
    }
}

static void displacement_of(const ldsim_solid *S, uint32_t v, double *u)
{
    displacement_at(S, v, &S->now, S->pulls, u);
}

/* The deformation gradient around the held vertices, by least squares: with the arms d of a cell, from its middle at rest to
 * its vertices, and their places y, the sum of y_v d_v' over the cells times the inverse of that at rest; I + gradient f. */
static void find_gradient(ldsim_solid *S, grab *g)
{
    const ldsim_model *M = S->model;
    const int corners = (int)M->n.corners, m = M->m;
    double *arms = S->arms, *touched = S->touched, shape[9] = {0.0}, inverse[9];
    zero(arms, 3 * (size_t)M->n.vertices), zero(touched, M->n.vertices), zero(g->gradient, 9 * (size_t)m);
    for (uint32_t i = 0; i < g->count; i++) touched[g->vertices[i]] = 1.0;
    for (uint32_t c = 0; c < M->n.cells; c++) {
        const uint32_t *cell = M->cell + (size_t)c * corners;
        double any = 0.0;
        for (int i = 0; i < corners; i++) any += touched[cell[i]];
        for (int axis = 0; axis < 3 && any > 0.0; axis++) {
            double middle = 0.0;
            for (int i = 0; i < corners; i++) middle += M->rest[3 * (size_t)cell[i] + axis] / corners;
            for (int i = 0; i < corners; i++) arms[3 * (size_t)cell[i] + axis] += M->rest[3 * (size_t)cell[i] + axis] - middle;
        }
    }
    for (size_t v = 0; v < M->n.vertices; v++)
        for (int e = 0; e < 9; e++) shape[e] += M->rest[3 * v + (size_t)(e / 3)] * arms[3 * v + (size_t)(e % 3)];
    if (!invert(shape, inverse, 3)) return; /* flat cells: as if they did not stretch */
    for (size_t v = 0; v < M->n.vertices; v++) {
        const double *arm = arms + 3 * v;
        if (arm[0] == 0.0 && arm[1] == 0.0 && arm[2] == 0.0) continue;
        const double d[3] = {dot3(inverse, arm), dot3(inverse + 3, arm), dot3(inverse + 6, arm)};
        for (int e = 0; e < 9; e++) {
            const size_t row = 3 * v + (size_t)(e / 3);
            double *gradient = g->gradient + (size_t)e * m;
            if (M->basis64)
                for (int j = 0; j < m; j++) gradient[j] += M->basis64[row * m + j] * d[e % 3];
            else
                for (int j = 0; j < m; j++) gradient[j] += M->basis32[row * m + j] * d[e % 3];
        }
    }
}

/* Makes a grab of a free place: all that depends on its vertices alone. */
static void hold(ldsim_solid *S, int place, uint32_t id, const uint32_t *vertices, uint32_t count)
{
    const ldsim_model *M = S->model;
    grab *g = S->grabs + place;
    const int m = M->m, l = M->moved;
    g->id = id, g->count = count, g->released = 0;
    memmove(g->vertices, vertices, count * sizeof *vertices);
    zero(g->B, 3 * (size_t)m), zero(g->lifted, 3 * (size_t)l), zero(g->centre, 3), zero(g->sag, 12);
    zero(g->load, M->anchors), zero(S->pulls + 3 * place, 3), zero(given_by(S, S->pulls, place), M->modes);
    const double share = 1.0 / count;
    for (uint32_t i = 0; i < count; i++) {
        for (int axis = 0; axis < 3; axis++) {
            const size_t row = 3 * (size_t)vertices[i] + axis;
            g->centre[axis] += share * M->rest[row];
            if (M->basis64)
                for (int j = 0; j < m; j++) g->B[axis * m + j] += share * M->basis64[row * m + j];
            else
                for (int j = 0; j < m; j++) g->B[axis * m + j] += share * M->basis32[row * m + j];
            for (int j = 0; j < l; j++) g->lifted[axis * l + j] += share * M->lifting[row * l + j];
            for (int j = 0; M->anchors && j < 4; j++) g->sag[4 * axis + j] += share * M->sag[4 * row + j];
        }
        for (size_t j = (size_t)vertices[i] * M->n.nearest, stop = j + M->n.nearest; j < stop; j++)
            g->load[M->near[j]] += share * M->share[j];
    }
    if (M->anchors) find_field(S, place), find_gradient(S, g);
}

/* Whether a grab pulled in the last step. */
static int has_pulled(const ldsim_solid *S, const grab *g)
{
    for (int i = 0; i < LDSIM_MAX_GRABS; i++)
        if (g->id && S->now.held[i] == g->id) return 1;
    return 0;
}

/* The grabs that pull in the next step, or in the last one where that is looked back at, as they were taken. */
static void order_grabs(ldsim_solid *S)
{
    S->g = 0;
    for (int i = 0; i < S->max_grabs; i++) {
        const grab *g = S->grabs + i;
        if (S->looking_back ? !has_pulled(S, g) : !g->id || g->released) continue;
        int at = S->g++;
        for (; at > 0 && S->grabs[S->order[at - 1]].id > S->grabs[i].id; at--) S->order[at] = S->order[at - 1];
        S->order[at] = i;
    }
}

#define LEAST_STRETCH 0.25 /* what is pressed flat does not get ever stiffer */

static void warp_grab(grab *g, const double *f, int m)
{
    double F[9], U[9], sigma[3], V[9];
    for (int e = 0; e < 9; e++) F[e] = (e % 4 == 0) + dot(g->gradient + (size_t)e * m, f, m);
    signed_svd(F, U, sigma, V);
    for (int e = 0; e < 9; e++) g->warp[e] = g->inverse[e] = 0.0;
    for (int i = 0; i < 3; i++) {
        const double stretch = sigma[i] > LEAST_STRETCH ? sigma[i] : LEAST_STRETCH;
        for (int e = 0; e < 9; e++) {
            g->warp[e] += U[3 * (e / 3) + i] * sqrt(stretch) * V[3 * (e % 3) + i];
            g->inverse[e] += V[3 * (e / 3) + i] / stretch * U[3 * (e % 3) + i];
        }
    }
}

static void turn_modes(const ldsim_model *M, grab *g)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < M->modes; j++) {
            const double *B = g->B + M->own + j;
            g->turned[i * M->modes + j] = B[i * M->m];
            if (!modes_turn(M)) continue;
            g->turned[i * M->modes + j] = g->warp[3 * i] * B[0] + g->warp[3 * i + 1] * B[M->m] + g->warp[3 * i + 2] * B[2 * M->m];
        }
}

/* block (3, 3) = A_p C A_q', with C what a force on grab q moves grab p by at rest, of both ways round the mean. */
static void warped_pair(const ldsim_solid *S, int p, int q, double *block)
{
    const double *there = pair_of(S, p, q), *back = pair_of(S, q, p), *A = S->grabs[q].warp;
    double half[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            half[3 * i + j] = 0.0;
            for (int k = 0; k < 3; k++) half[3 * i + j] += 0.5 * (there[3 * i + k] + back[3 * k + i]) * A[3 * j + k];
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            block[3 * i + j] = 0.0;
            for (int k = 0; k < 3; k++) block[3 * i + j] += S->grabs[p].warp[3 * i + k] * half[3 * k + j];
        }
}

/* Load and weight of the features under the gravity of the next step. */
static void weigh(ldsim_solid *S)
{
    const ldsim_model *M = S->model;
    if (memcmp(S->weighed, S->gravity, sizeof S->weighed) == 0) return;
    copy(S->weight, M->load, M->m), copy(S->weighed, S->gravity, 3);
    add_product(M->unit_weight, S->gravity, S->weight, M->m, 3);
}

/* How far weight has mode j where nothing swings. */
static double sunk(const ldsim_solid *S, int j)
{
    return S->weight[S->model->own + j] / (S->scale * S->model->squares[j]);
}

/* The features that the coordinates decode to where they are f, in which modes are where they are by now; of these is told
 * how far they are from there. */
static const double *relaxed(const ldsim_solid *S, const double *f)
{
    const ldsim_model *M = S->model;
    if (!M->modes) return f;
    double *x = S->relaxed + M->own;
    copy(S->relaxed, f, M->own), zero(x, M->modes);
    add_transposed(M->mode_columns, f, x, M->own, M->modes);
    for (int j = 0; j < M->modes; j++) S->strays[j] = f[M->own + j] - x[j] - sunk(S, j);
    return S->relaxed;
}

/* How far pulls move modes where nothing swings, behind them. */
static void give(const ldsim_solid *S, double *pulls)
{
    const ldsim_model *M = S->model;
    for (int g = 0; g < S->max_grabs; g++) {
        double *given = given_by(S, pulls, g);
        zero(given, M->modes);
        if (!S->grabs[g].id) continue;
        for (int axis = 0; axis < 3; axis++)
            for (int j = 0; j < M->modes; j++) given[j] += pulls[3 * g + axis] * S->grabs[g].turned[axis * M->modes + j];
        for (int j = 0; j < M->modes; j++) given[j] /= S->scale * M->squares[j];
    }
}

/* c(f) of all grabs, centre + B f, with what weight and dead loads move. */
static void centroids(const ldsim_solid *S, const double *f, double *found)
{
    const int m = S->model->m;
    for (int i = 0; i < 3 * S->g; i++) {
        const grab *g = S->grabs + S->order[i / 3];
        const double *sag = g->sag + 4 * (i % 3);
        const double *B = g->B + (i % 3) * m;
        found[i] = g->centre[i % 3] + (sag[0] + dot3(sag + 1, S->gravity)) / S->scale + dot(B, f, m);
        for (int j = 0; j < S->model->modes; j++) found[i] += B[S->model->own + j] * sunk(S, j);
    }
}

/* What the springs of a condensed model pull with where the features are f, Q p, grab by grab as they were taken, (3g,); and
 * of the way p from each centroid to its target what is not the stretch of its spring: the dent p - Q p / k, (3g,), with
 * what modes that turn have done of it. */
static void find_pulls_and_dents(const ldsim_solid *S, const double *f, double *pulls, double *dents)
{
    const int rows = 3 * S->g, modes = S->model->modes;
    double way[3 * LDSIM_MAX_GRABS], part[3 * LDSIM_MAX_GRABS];
    if (!rows) return;
    centroids(S, relaxed(S, f), way);
    for (int i = 0; i < rows; i++) {
        const grab *g = S->grabs + S->order[i / 3];
        way[i] = g->target[i % 3] - way[i];
        if (modes) way[i] -= dot(g->turned + i % 3 * modes, S->strays, modes);
    }
    for (int i = 0; i < rows; i++) {
        part[i] = pulls[i] = 0.0;
        for (int j = i; j < rows; j++) part[i] += S->root[j * rows + i] * way[j];
    }
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j <= i; j++) pulls[i] += S->root[i * rows + j] * part[j];
        const grab *g = S->grabs + S->order[i / 3];
        dents[i] = way[i] - pulls[i] / g->stiffness;
        if (modes_turn(S->model)) dents[i] += dot(g->turned + i % 3 * modes, S->strays, modes);
    }
}

/* The spring holds the solid by the end of the dent x = A d that it makes, and A d moves with f as well, by
 * H = d(A d)/df at fixed d: a lever on which the force turns and stretches the solid. With L_j = dF/df_j F^-1, to first order
 * in the stretch, dA/df_j = (skew L_j + 1/2 sym L_j) A, so H_j = (3/4 L_j - 1/4 L_j') x. Adds H to B, and makes of the
 * centroid at f the centre for that. */
static void add_lever(const grab *g, const double *f, int m, const double *x, double *centre, double *B, double *lever)
{
    const double y[3] = {dot3(g->inverse, x), dot3(g->inverse + 3, x), dot3(g->inverse + 6, x)};
    for (int i = 0; i < 3; i++) {
        zero(lever, m);
        for (int e = 0; e < 9; e++) {
            const double share = (e / 3 == i ? 0.75 * y[e % 3] : 0.0) - 0.25 * g->inverse[3 * (e % 3) + i] * x[e / 3];
            const double *gradient = g->gradient + (size_t)e * m;
            for (int j = 0; j < m; j++) lever[j] += share * gradient[j];
        }
        for (int j = 0; j < m; j++) B[(size_t)i * m + j] += lever[j];
        centre[i] -= dot(B + (size_t)i * m, f, m);
    }
}

/* The springs that a step reads which begins where the features are f. Those of a condensed model are in series with its
 * compliance, which warps with the solid: their energy 1/2 p' Q p couples all, Q = L L'. It is 1/2 |L' p|^2, that is springs
 * of unit stiffness on L'B, here with the levers that the dents at f are. */
static void aim_springs(ldsim_solid *S, const double *f)
{
    const ldsim_model *M = S->model;
    const int m = M->m, rows = 3 * S->g, condensed = M->anchors > 0;
    double *B = condensed ? S->inverse : S->B;
    double centre[3 * LDSIM_MAX_GRABS], pulls[3 * LDSIM_MAX_GRABS], dents[3 * LDSIM_MAX_GRABS];
    for (int i = 0; i < rows; i++) {
        const grab *g = S->grabs + S->order[i / 3];
        copy(B + (size_t)i * m, g->B + (i % 3) * m, m);
        S->centre[i] = g->centre[i % 3];
        S->target[i] = g->target[i % 3];
    }
    if (!condensed || !rows) return;
    const double *root = M->modes ? S->swinging : S->root;
    find_pulls_and_dents(S, f, pulls, dents);
    const double *pose = M->modes ? S->relaxed : f; /* as it was left there */
    centroids(S, pose, centre);
    for (int i = 0; i < S->g; i++)
        add_lever(S->grabs + S->order[i], pose, m, dents + 3 * i, centre + 3 * i, B + 3 * (size_t)i * m, S->B);
    for (int i = 0; i < rows; i++) {
        const double *turned = S->grabs[S->order[i / 3]].turned + i % 3 * M->modes;
        double *swinging = B + (size_t)i * m + M->own;
        for (int j = 0; j < M->modes; j++) {
            centre[i] += turned[j] * (S->swung[j] - sunk(S, j));
            swinging[j] -= (1.0 - S->follows[j]) * turned[j];
        }
    }
    for (int i = 0; i < rows; i++) {
        S->target[i] = S->centre[i] = 0.0;
        zero(S->B + (size_t)i * m, m);
        for (int j = i; j < rows; j++) {
            const double share = root[j * rows + i];
            S->target[i] += share * S->grabs[S->order[j / 3]].target[j % 3];
            S->centre[i] += share * centre[j];
            for (int e = 0; e < m; e++) S->B[(size_t)i * m + e] += share * B[(size_t)j * m + e];
        }
    }
}

/* Within a step modes give way to grabs too, as far as their mass lets them. */
static void soften_by_modes(ldsim_solid *S)
{
    const ldsim_model *M = S->model;
    const int rows = 3 * S->g;
    copy(S->joint, S->swinging, (size_t)rows * rows);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < rows; j++) {
            const double *here = S->grabs[S->order[i / 3]].turned + i % 3 * M->modes;
            const double *there = S->grabs[S->order[j / 3]].turned + j % 3 * M->modes;
            for (int e = 0; e < M->modes; e++) S->joint[i * rows + j] += here[e] * S->gives[e] * there[e];
        }
    invert(S->joint, S->swinging, rows);
    cholesky(S->swinging, rows);
}

/* Brings all of the springs that does not depend on targets to where the features are f: which there are, and of a condensed
 * model Q = (diag(1/k) + A B C B'A')^-1 = L L'. */
static void make_springs(ldsim_solid *S, const double *f)
{
    const ldsim_model *M = S->model;
    order_grabs(S);
    const int rows = 3 * S->g;
    for (int i = 0; i < S->g; i++) S->stiffness[i] = M->anchors ? 1.0 : S->grabs[S->order[i]].stiffness;
    if (M->modes) weigh(S);
    const double *pose = NULL;
    for (int i = 0; M->anchors && i < S->max_grabs; i++) {
        if (!S->grabs[i].id) continue;
        if (!pose) pose = relaxed(S, f);
        warp_grab(S->grabs + i, pose, M->m), turn_modes(M, S->grabs + i);
    }
    if (M->anchors && S->g) {
        double block[9];
        for (int i = 0; i < S->g; i++)
            for (int j = 0; j < S->g; j++) {
                const double soft = i == j ? 1.0 / S->grabs[S->order[i]].stiffness : 0.0;
                warped_pair(S, S->order[i], S->order[j], block);
                for (int e = 0; e < 9; e++)
                    S->joint[(3 * i + e / 3) * rows + 3 * j + e % 3] = block[e] / S->scale + (e % 4 == 0) * soft;
            }
        copy(S->swinging, S->joint, M->modes ? (size_t)rows * rows : 0);
        invert(S->joint, S->root, rows);
        cholesky(S->root, rows);
        if (M->modes) soften_by_modes(S);
    }
    S->renewed_springs = 1;
}

/* What the springs of a condensed model pull with where the features are f, see `pulls`. */
static void find_pulls(const ldsim_solid *S, const double *f, double *pulls)
{
    double ordered[3 * LDSIM_MAX_GRABS], dents[3 * LDSIM_MAX_GRABS];
    zero(pulls, 3 * (size_t)S->max_grabs);
    find_pulls_and_dents(S, f, ordered, dents);
    for (int i = 0; i < 3 * S->g; i++) pulls[3 * S->order[i / 3] + i % 3] = ordered[i];
    give(S, pulls);
}

static grab *find_grab(const ldsim_solid *S, uint32_t id)
{
    for (int i = 0; id && i < S->max_grabs; i++)
        if (S->grabs[i].id == id && !S->grabs[i].released) return (grab *)&S->grabs[i];
    return NULL;
}

/* Rather a free place than that of a dent that lasts until the next step. */
static int free_place(const ldsim_solid *S)
{
    int released = -1;
    for (int i = 0; i < S->max_grabs; i++) {
        if (S->grabs[i].id == 0) return i;
        if (S->grabs[i].released) released = i;
    }
    return released;
}

/* A stiffness or a radius of 0 stands for the usual one. */
static int not_negative(double x) { return x >= 0.0 && finite_number(x); }

static int pull_is_possible(const double *target, double stiffness)
{
    return target && all_finite(target, 3) && not_negative(stiffness);
}

int ldsim_grab_vertices(ldsim_solid *S, const uint32_t *vertices, uint32_t count, const double target[3],
                        double stiffness, uint32_t *id)
{
    const ldsim_model *M = S->model;
    if (!vertices || !id || !pull_is_possible(target, stiffness)) return LDSIM_BAD_ARGUMENT;
    if (count < 1 || count > M->n.vertices || !all_below(vertices, count, M->n.vertices)) return LDSIM_BAD_ARGUMENT;
    const int place = free_place(S);
    if (place < 0 || S->next_id == 0) return LDSIM_TOO_MANY_GRABS; /* 0: all numbers are used up */
    hold(S, place, S->next_id++, vertices, count);
    S->grabs[place].stiffness = stiffness > 0.0 ? stiffness : M->given.stiffness;
    copy(S->grabs[place].target, target, 3), copy(S->grabs[place].target_then, target, 3);
    S->renewed_springs = 0;
    if (M->anchors) { /* the compliance has put out of the caches what a step reads: the next one need not wait for it */
        make_springs(S, S->now.f);
        aim_springs(S, S->now.f);
        value_gradient(S, S->now.z, S->first.f, S->gradient_new);
    }
    *id = S->grabs[place].id;
    return LDSIM_OK;
}

static double apart(const double *a, const double *b)
{
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

int ldsim_grab(ldsim_solid *S, const double point[3], const double target[3], double stiffness, double radius,
               uint32_t *id)
{
    const ldsim_model *M = S->model;
    const uint32_t n = M->n.vertices;
    if (!point || !id || !all_finite(point, 3) || !pull_is_possible(target, stiffness) || !not_negative(radius))
        return LDSIM_BAD_ARGUMENT;
    if (radius == 0.0) radius = M->given.radius;
    const int place = free_place(S);
    if (place < 0) return LDSIM_TOO_MANY_GRABS;
    double *x = S->positions, least = INFINITY;
    uint32_t picked = 0, count = 0, *found = S->grabs[place].vertices;
    for (uint32_t v = 0; v < n; v++) {
        displacement_of(S, v, x + 3 * (size_t)v);
        for (int axis = 0; axis < 3; axis++) x[3 * (size_t)v + axis] += M->rest[3 * (size_t)v + axis];
        const double distance = apart(x + 3 * (size_t)v, point);
        if (distance < least) least = distance, picked = v;
    }
    if (!(least <= 0.5 * M->given.diagonal)) return LDSIM_TOO_FAR;
    for (uint32_t v = 0; v < n; v++)
        if (M->movable[v] && apart(x + 3 * (size_t)v, x + 3 * (size_t)picked) <= radius) found[count++] = v;
    if (count == 0) return LDSIM_ALL_PINNED;
    return ldsim_grab_vertices(S, found, count, target, stiffness, id);
}

int ldsim_move(ldsim_solid *S, uint32_t id, const double target[3])
{
    grab *g = find_grab(S, id);
    if (!g) return LDSIM_NO_SUCH_GRAB;
    if (!target || !all_finite(target, 3)) return LDSIM_BAD_ARGUMENT;
    copy(g->target, target, 3);
    return LDSIM_OK;
}

int ldsim_release(ldsim_solid *S, uint32_t id)
{
    grab *g = find_grab(S, id);
    if (!g) return LDSIM_NO_SUCH_GRAB;
    if (S->model->anchors) g->released = 1;
    else g->id = 0;
    S->renewed_springs = 0;
    return LDSIM_OK;
}

int ldsim_centroid(const ldsim_solid *S, uint32_t id, double centroid[3])
{
    const ldsim_model *M = S->model;
    const grab *g = find_grab(S, id);
    if (!g) return LDSIM_NO_SUCH_GRAB;
    if (!centroid) return LDSIM_BAD_ARGUMENT;
    double slack[3] = {0.0, 0.0, 0.0}, pull[3];
    for (int j = 0; M->anchors && j < S->max_grabs; j++) {
        if (!S->grabs[j].id) continue;
        const double *there = pair_of(S, (int)(g - S->grabs), j), *A = S->grabs[j].warp;
        warp_back(A, S->pulls + 3 * j, pull);
        const double moved[3] = {dot3(there, pull), dot3(there + 3, pull), dot3(there + 6, pull)};
        for (int axis = 0; axis < 3; axis++) slack[axis] += dot3(A + 3 * axis, moved);
    }
    for (int axis = 0; axis < 3; axis++) {
        centroid[axis] = g->centre[axis] + dot(g->B + axis * M->m, S->now.f, M->m);
        if (M->moved) centroid[axis] += dot(g->lifted + axis * M->moved, S->now.a, M->moved);
        if (!M->anchors) continue;
        slack[axis] += g->sag[4 * axis] + dot3(g->sag + 4 * axis + 1, S->now.gravity);
        centroid[axis] += slack[axis] / S->scale;
    }
    for (int j = 0; modes_turn(M) && j < S->max_grabs; j++) {
        double by[3];
        if (!S->grabs[j].id) continue;
        for (int axis = 0; axis < 3; axis++) by[axis] = dot(g->B + axis * M->m + M->own, given_by(S, S->pulls, j), M->modes);
        for (int axis = 0; axis < 3; axis++) centroid[axis] += dot3(S->grabs[j].warp + 3 * axis, by) - by[axis];
    }
    return LDSIM_OK;
}

int ldsim_force(const ldsim_solid *S, uint32_t id, double force[3])
{
    const int code = ldsim_centroid(S, id, force);
    if (code != LDSIM_OK) return code;
    const grab *g = find_grab(S, id);
    const double *pull = S->pulls + 3 * (g - S->grabs);
    for (int axis = 0; axis < 3; axis++)
        if (S->model->anchors && has_pulled(S, g)) /* what is drawn tells no force: dents of several grabs couple */
            force[axis] = pull[axis] + g->stiffness * (g->target[axis] - g->target_then[axis]);
        else force[axis] = g->stiffness * (g->target[axis] - force[axis]);
    return LDSIM_OK;
}

int ldsim_set_gravity(ldsim_solid *S, const double gravity[3])
{
    if (!gravity || !all_finite(gravity, 3)) return LDSIM_BAD_ARGUMENT;
    copy(S->gravity, gravity, 3);
    S->renewed_springs = 0; /* the sag of a condensed model is in them */
    return LDSIM_OK;
}

/* Of modes w, in a step of length h: g = 1 / (w^2 + 1/h^2) and a = w^2 g. */
static void scale_by(ldsim_solid *S, double scale)
{
    const double h = S->model->given.time_step;
    S->scale = scale;
    for (int j = 0; j < S->model->modes; j++) {
        const double square = scale * S->model->squares[j];
        S->gives[j] = 1.0 / (square + 1.0 / (h * h));
        S->follows[j] = square * S->gives[j];
    }
}

int ldsim_move_pins(ldsim_solid *S, uint32_t support, const double map[12])
{
    if (support >= S->model->n.supports) return LDSIM_NO_SUCH_SUPPORT;
    if (!map || !all_finite(map, 12)) return LDSIM_BAD_ARGUMENT;
    for (int e = 0; e < 12; e++) S->pins[12 * support + e] = map[e] - (e % 5 == 0); /* less the identity */
    return LDSIM_OK;
}

/* ---- The step -------------------------------------------------------------------------------------------------------- */

#define BOUND 3.0 /* a step that leaves the solid this many diagonals (root mean square) from rest is not taken */

/* What is not finite is out of bounds. */
static int within(const ldsim_model *M, double norm) { return norm <= BOUND * M->given.diagonal * sqrt(M->given.mass); }

/* The mass-weighted norm of the displacement by features alone. */
static double features_norm(ldsim_solid *S, const moment *at)
{
    const ldsim_model *M = S->model;
    const double h = M->given.time_step, *modes = at->f + M->own;
    multiply_inertia(S, at->f, S->pull);
    return sqrt(h * h * dot(at->f, S->pull, M->own) + dot(modes, modes, M->modes));
}

/* The mass-weighted norm of the displacement, vertex by vertex, with what grabs pull by then. */
static double whole_norm(const ldsim_solid *S, const moment *at, const double *pulls)
{
    const ldsim_model *M = S->model;
    double norm = 0.0, u[3];
    for (uint32_t v = 0; v < M->n.vertices; v++) {
        displacement_at(S, v, at, pulls, u);
        norm += M->vertex_mass[v] * dot3(u, u);
    }
    return sqrt(norm);
}

/* Of a condensed model, what moves beside the coordinates counts too: by a bound, and vertex by vertex where that is not
 * within. */
static int out_of_bounds(ldsim_solid *S, const moment *at)
{
    const ldsim_model *M = S->model;
    double norm = features_norm(S, at), beside = M->sag_reach[0], *pulls = S->tried;
    if (!M->anchors || !finite_number(norm)) return !within(M, norm);
    find_pulls(S, at->f, pulls);
    for (int i = 0; i < 3; i++) beside += M->sag_reach[1 + i] * fabs(at->gravity[i]);
    for (int g = 0; g < S->max_grabs; g++) {
        if (!S->grabs[g].id) continue;
        const double turn = dot(S->grabs[g].warp, S->grabs[g].warp, 9), *given = given_by(S, pulls, g);
        beside += S->grabs[g].reach * turn * sqrt(dot3(pulls + 3 * g, pulls + 3 * g));
        if (modes_turn(M)) beside += S->scale * (1.0 + sqrt(turn)) * sqrt(dot(given, given, M->modes));
    }
    if (within(M, norm + beside / S->scale)) return 0;
    if (S->g) make_springs(S, at->f), find_pulls(S, at->f, pulls), S->renewed_springs = 0;
    return !within(M, whole_norm(S, at, pulls));
}

static void identity(double *H, int r)
{
    zero(H, (size_t)r * r);
    for (int i = 0; i < r; i++) H[i * r + i] = 1.0;
}

/* The strain of moved pins in a block. */
static void lift(ldsim_solid *S, int block)
{
    const ldsim_model *M = S->model;
    const int start = (int)M->block_first[block], stop = block + 1 < M->blocks ? (int)M->block_first[block + 1] : M->points;
    for (int s = start; s < stop; s++)
        for (int e = 0; e < 9; e++)
            S->lifted[(size_t)block * BLOCK + e * LANES + s - start] =
                dot(M->lifted_strain + (e * (size_t)M->points + s) * M->moved, S->pins, M->moved);
}

/* Differences of z, and where the next step starts. The polynomial of order d through the last d + 1 states leads to the
 * sum of the differences up to that order, and was wrong at the last state by the one of order d + 1: so the order is
 * that of the least difference, a high one where the motion is smooth and a low one after a jolt. */
static void extrapolate(int r, const moment *from, moment *to)
{
    double least = 0.0;
    int order = 0;
    for (int i = 0; i < r; i++) least += (to->z[i] - from->z[i]) * (to->z[i] - from->z[i]);
    for (int j = 0; j < DIFFERENCES; j++) {
        double size = 0.0, *D = to->differences + (size_t)j * r;
        for (int i = 0; i < r; i++) {
            if (j == 0) D[i] = (to->z[i] - from->z[i]) - (from->z[i] - from->z_before[i]);
            else D[i] = D[i - r] - from->differences[(size_t)(j - 1) * r + i];
            size += D[i] * D[i];
        }
        if (size < 0.5 * least) least = size, order = j + 1; /* for after a jolt all are of one size */
    }
    for (int i = 0; i < r; i++) {
        to->guess[i] = to->z[i] + (order > 0 ? to->z[i] - from->z[i] : 0.0);
        for (int j = 0; j < order - 1; j++) to->guess[i] += to->differences[(size_t)j * r + i];
    }
}

/* Modes at the end of a step, from what was decoded: what follows it, their own motion, and what grabs pull them by. */
static void swing_on(ldsim_solid *S, double *f)
{
    const ldsim_model *M = S->model;
    const int m = M->m, rows = 3 * S->g;
    double stretch[3 * LDSIM_MAX_GRABS], *modes = f + M->own;
    for (int i = 0; i < rows; i++) stretch[i] = S->target[i] - S->centre[i] - dot(S->B + (size_t)i * m, f, m);
    for (int j = 0; j < M->modes; j++) modes[j] = S->follows[j] * modes[j] + S->swung[j];
    for (int i = 0; i < rows; i++) {
        const double *B = S->grabs[S->order[i / 3]].turned + i % 3 * M->modes;
        double force = 0.0;
        for (int j = 0; j <= i; j++) force += S->swinging[i * rows + j] * stretch[j];
        for (int j = 0; j < M->modes; j++) modes[j] += S->gives[j] * force * B[j];
    }
}

/* One step of implicit Euler from one moment to another. */
static solution try_step(ldsim_solid *S, const moment *from, moment *to)
{
    const ldsim_model *M = S->model;
    const int r = M->r, m = M->m, l = M->moved;
    weigh(S);
    copy(S->force, S->weight, m);
    for (int j = 0; j < m; j++) S->predictor[j] = 2.0 * from->f[j] - from->f_before[j];
    for (int j = 0; j < M->modes; j++) {
        S->force[M->own + j] *= S->follows[j];
        S->swung[j] = (1.0 - S->follows[j]) * S->predictor[M->own + j] + S->gives[j] * S->weight[M->own + j];
    }
    if (!S->renewed_springs) make_springs(S, from->f);
    aim_springs(S, from->f);
    if (l) {
        double *change = S->scratch;
        for (int j = 0; j < l; j++) change[j] = -(S->pins[j] - 2.0 * from->a[j] + from->a_before[j]);
        add_product(M->lifted_inertia, change, S->force, m, l);
        for (int block = 0; block < M->blocks; block++) lift(S, block);
        for (int i = 0; i < 3 * S->g; i++) {
            const grab *g = S->grabs + S->order[i / 3];
            S->centre[i] = g->centre[i % 3] + dot(g->lifted + (i % 3) * l, S->pins, l);
        }
    }
    uint32_t held[LDSIM_MAX_GRABS] = {0};
    for (int i = 0; i < S->g; i++) held[i] = S->grabs[S->order[i]].id;
    const int renew = !from->usable || from->excess > RENEWAL_COST, others = memcmp(held, from->held, sizeof held) != 0;
    copy(to->z, from->z, r);
    copy(to->H, from->H, (size_t)r * r);
    const solution found = minimise(S, from, to->z, to->f, to->H, renew, others);
    if (M->modes) swing_on(S, to->f);
    copy(to->z_before, from->z, r);
    extrapolate(r, from, to);
    copy(to->f_before, from->f, m);
    copy(to->a, S->pins, l);
    copy(to->a_before, from->a, l);
    copy(to->gravity, S->gravity, 3);
    memcpy(to->held, held, sizeof held), keep_springs(S, to);
    const int beyond = found.iterations - from->fresh;
    to->usable = !(renew || others) || found.iterations > 0; /* where no iteration was needed, nothing was made */
    to->fresh = renew ? found.iterations : from->fresh;
    to->excess = renew ? 0 : from->excess + (beyond > 0 ? beyond : 0);
    return found;
}

/* Copies a moment without what was kept from earlier steps. */
static void copy_renewed(const ldsim_solid *S, const moment *from, moment *to)
{
    copy(to->z, from->z, S->moment_size);
    copy(to->gravity, from->gravity, 3);
    to->rows = from->rows;
    memcpy(to->held, from->held, sizeof to->held);
    identity(to->H, S->model->r);
    to->usable = to->fresh = to->excess = 0;
}

static void take(ldsim_solid *S, moment *found)
{
    const moment before = S->now;
    S->now = *found, *found = before;
}

static void swap(double *a, double *b)
{
    for (int i = 0; i < 3; i++) {
        const double kept = a[i];
        a[i] = b[i], b[i] = kept;
    }
}

/* Puts the loads of the last step in the place of those of the next one, or these back: which grabs pull, where to, and
 * gravity. */
static void swap_loads(ldsim_solid *S)
{
    S->looking_back = !S->looking_back;
    swap(S->gravity, S->now.gravity);
    for (int g = 0; g < S->max_grabs; g++) swap(S->grabs[g].target, S->grabs[g].target_then);
}

/* Softer, a condensed solid gives way at once to what pulled it: where that leads out of bounds, rather to nothing, in its
 * shape or else at rest. Whether one of them is within bounds; it is in S->start then, and what grabs pull in S->tried. */
static int find_softer(ldsim_solid *S)
{
    const ldsim_model *M = S->model;
    copy_renewed(S, &S->now, &S->start);
    swap_loads(S), make_springs(S, S->now.f), find_pulls(S, S->now.f, S->tried), swap_loads(S);
    if (within(M, whole_norm(S, &S->start, S->tried))) return 1;
    zero(S->tried, pulls_size(S)), zero(S->start.gravity, 3);
    memset(S->start.held, 0, sizeof S->start.held), S->start.rows = 0;
    if (within(M, whole_norm(S, &S->start, S->tried))) return 1;
    zero(S->start.z, S->moment_size), identity(S->start.H, M->r);
    return within(M, whole_norm(S, &S->start, S->tried));
}

int ldsim_set_stiffness(ldsim_solid *S, double scale)
{
    const double before = S->scale;
    if (!(scale > 0.0) || !finite_number(scale)) return LDSIM_BAD_ARGUMENT;
    if (scale == before) return LDSIM_OK;
    scale_by(S, scale);
    const int fine = !S->model->anchors || find_softer(S);
    if (!fine) scale_by(S, before);
    else if (S->model->anchors) take(S, &S->start), copy(S->pulls, S->tried, pulls_size(S));
    else S->now.usable = 0;
    if (S->model->anchors) make_springs(S, S->now.f); /* what is read next needs the warps */
    else S->renewed_springs = 0;
    return fine ? LDSIM_OK : LDSIM_OUT_OF_BOUNDS;
}

ldsim_outcome ldsim_step(ldsim_solid *S, ldsim_record *record)
{
    const ldsim_model *M = S->model;
    moment *found = &S->first;
    solution last = try_step(S, &S->now, found);
    int iterations = last.iterations, evaluations = last.evaluations;
    int lost = last.reason == LDSIM_INFINITE_START || out_of_bounds(S, found);
    if (last.reason == LDSIM_NO_DECREASE && !lost) { /* again, with a new preconditioner */
        copy_renewed(S, &S->now, &S->start);
        const solution second = try_step(S, &S->start, &S->second);
        iterations += second.iterations, evaluations += second.evaluations;
        if (second.reason != LDSIM_INFINITE_START && !out_of_bounds(S, &S->second)) found = &S->second, last = second;
    }
    ldsim_outcome outcome = last.reason == LDSIM_CONVERGED ? LDSIM_SOLVED : LDSIM_SHORT;
    if (lost) { /* from standstill */
        copy_renewed(S, &S->now, &S->start);
        copy(S->start.z_before, S->start.z, M->r);
        copy(S->start.guess, S->start.z, M->r);
        zero(S->start.differences, DIFFERENCES * (size_t)M->r);
        copy(S->start.f_before, S->start.f, M->m);
        copy(S->start.a_before, S->start.a, M->moved);
        found = &S->first;
        last = try_step(S, &S->start, found);
        iterations += last.iterations, evaluations += last.evaluations;
        outcome = LDSIM_SLOWED;
        if (last.reason == LDSIM_INFINITE_START || out_of_bounds(S, found)) outcome = LDSIM_HELD, found = &S->start;
    }
    take(S, found);
    for (int g = 0; g < S->max_grabs && outcome != LDSIM_HELD; g++) {
        copy(S->grabs[g].target_then, S->grabs[g].target, 3);
        if (S->grabs[g].released) S->grabs[g].id = 0, S->grabs[g].released = 0;
    }
    if (M->anchors && S->g) make_springs(S, S->now.f);
    if (M->anchors && outcome != LDSIM_HELD) find_pulls(S, S->now.f, S->pulls);
    if (record) {
        const ldsim_record told = {iterations, evaluations, last.reason, outcome, last.value, last.norm};
        *record = told;
    }
    return outcome;
}

ldsim_outcome ldsim_step_many(ldsim_solid *const *solids, uint32_t count, uint32_t steps, ldsim_record *records)
{
    ldsim_outcome worst = LDSIM_SOLVED;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t step = 0; step < steps; step++) {
            const ldsim_outcome outcome = ldsim_step(solids[i], records ? records + i : NULL);
            if (outcome > worst) worst = outcome;
        }
    return worst;
}

/* ---- Making and reading a solid -------------------------------------------------------------------------------------- */

/* Cuts one block of memory into arrays, or only adds up their sizes where `at` is null. */
static double *cut(double **at, uint64_t *total, size_t count)
{
    double *found = *at;
    if (found) *at += count;
    *total += count;
    return found;
}

static void lay_out_moment(const ldsim_model *M, int max_grabs, moment *x, double **at, uint64_t *total)
{
    x->z = cut(at, total, M->r), x->z_before = cut(at, total, M->r), x->guess = cut(at, total, M->r);
    x->differences = cut(at, total, DIFFERENCES * (size_t)M->r);
    x->f = cut(at, total, M->m), x->f_before = cut(at, total, M->m);
    x->H = cut(at, total, (size_t)M->r * M->r);
    x->a = cut(at, total, M->moved), x->a_before = cut(at, total, M->moved);
    x->springs = cut(at, total, 3 * (size_t)max_grabs * M->m);
}

static uint64_t lay_out(ldsim_solid *S, double *block)
{
    const ldsim_model *M = S->model;
    const size_t r = M->r, m = M->m, wide = M->wide, l = M->moved, n = M->n.vertices, most = S->max_grabs, rows = 3 * most;
    const size_t a = M->anchors, w = M->modes, work = 2 * (size_t)M->hidden + l + (w ? M->own : 0);
    uint64_t total = 0;
    double **at = &block;
    moment *moments[] = {&S->now, &S->first, &S->second, &S->start};
    for (int i = 0; i < 4; i++) lay_out_moment(M, S->max_grabs, moments[i], at, &total);
    S->moment_size = (size_t)(total / 4);
    S->pins = cut(at, &total, l);
    for (size_t i = 0; i < most; i++) {
        grab *g = S->grabs + i;
        g->vertices = (uint32_t *)(void *)cut(at, &total, (n + 1) / 2);
        g->B = cut(at, &total, 3 * m), g->lifted = cut(at, &total, 3 * l), g->load = cut(at, &total, a);
        g->field = cut(at, &total, 9 * a), g->gradient = cut(at, &total, a ? 9 * m : 0);
        g->turned = cut(at, &total, 3 * w);
    }
    S->compliance = cut(at, &total, a ? 9 * most * most : 0);
    S->pulls = cut(at, &total, pulls_size(S)), S->tried = cut(at, &total, pulls_size(S));
    S->B = cut(at, &total, rows * m), S->centre = cut(at, &total, rows), S->target = cut(at, &total, rows);
    S->stiffness = cut(at, &total, most), S->root = cut(at, &total, rows * rows);
    S->joint = cut(at, &total, rows * rows), S->inverse = cut(at, &total, rows * m);
    S->force = cut(at, &total, m), S->lifted = cut(at, &total, l ? BLOCK * (size_t)M->blocks : 0);
    S->weight = cut(at, &total, m);
    S->follows = cut(at, &total, w), S->gives = cut(at, &total, w), S->swung = cut(at, &total, w);
    S->swinging = cut(at, &total, w ? rows * rows : 0);
    S->relaxed = cut(at, &total, w ? m : 0), S->strays = cut(at, &total, w);
    S->hidden = cut(at, &total, M->hidden), S->scratch = cut(at, &total, work);
    S->predictor = cut(at, &total, m), S->offset = cut(at, &total, m), S->pull = cut(at, &total, m);
    S->product = cut(at, &total, m * wide), S->lanes = cut(at, &total, LANES * (size_t)M->n.mapped);
    S->jacobian = cut(at, &total, m * wide), S->tangents = cut(at, &total, wide * M->hidden);
    S->gradient = cut(at, &total, r), S->gradient_new = cut(at, &total, r), S->direction = cut(at, &total, r);
    S->z_new = cut(at, &total, r), S->s = cut(at, &total, r), S->y = cut(at, &total, r), S->Hy = cut(at, &total, r);
    S->hessian = cut(at, &total, r * wide);
    S->turned = cut(at, &total, BLOCK * wide), S->stressed = cut(at, &total, BLOCK * wide);
    S->positions = cut(at, &total, 3 * n);
    S->arms = cut(at, &total, a ? 3 * n : 0), S->touched = cut(at, &total, a ? n : 0);
    return total;
}

int ldsim_create(const ldsim_model *model, int max_grabs, ldsim_solid **solid)
{
    if (!model || !solid || max_grabs < 0 || max_grabs > LDSIM_MAX_GRABS) return LDSIM_BAD_ARGUMENT;
    ldsim_solid shape;
    memset(&shape, 0, sizeof shape);
    shape.model = model, shape.max_grabs = max_grabs;
    const uint64_t total = lay_out(&shape, NULL);
    const size_t head = (sizeof shape + 15) / 16 * 16;
    *solid = can_be_held(total, head) ? calloc(1, head + (size_t)total * sizeof(double)) : NULL;
    if (!*solid) return LDSIM_NO_MEMORY;
    **solid = shape;
    lay_out(*solid, (double *)(void *)((unsigned char *)*solid + head));
    (*solid)->next_id = 1;
    scale_by(*solid, 1.0);
    copy((*solid)->gravity, model->given.gravity, 3);
    (*solid)->weighed[0] = (double)NAN; /* nothing was weighed yet */
    ldsim_reset(*solid);
    return LDSIM_OK;
}

void ldsim_destroy(ldsim_solid *solid) { free(solid); }

void ldsim_reset(ldsim_solid *S)
{
    for (int i = 0; i < S->max_grabs; i++) S->grabs[i].id = 0, S->grabs[i].released = 0;
    zero(S->now.z, S->moment_size);
    zero(S->pins, S->model->moved);
    identity(S->now.H, S->model->r);
    copy(S->now.gravity, S->model->given.gravity, 3);
    memset(S->now.held, 0, sizeof S->now.held);
    S->now.usable = S->now.fresh = S->now.excess = S->now.rows = S->renewed_springs = 0;
}

void ldsim_displacements(const ldsim_solid *S, double *u)
{
    for (uint32_t v = 0; v < S->model->n.vertices; v++) displacement_of(S, v, u + 3 * (size_t)v);
}

int ldsim_displacement(const ldsim_solid *S, const uint32_t *vertices, uint32_t count, double *u)
{
    if (!vertices || !u || !all_below(vertices, count, S->model->n.vertices)) return LDSIM_BAD_ARGUMENT;
    for (uint32_t i = 0; i < count; i++) displacement_of(S, vertices[i], u + 3 * (size_t)i);
    return LDSIM_OK;
}

const double *ldsim_coordinates(const ldsim_solid *S) { return S->now.z; }

const double *ldsim_features(const ldsim_solid *S) { return S->now.f; }

double ldsim_novelty(const ldsim_solid *S)
{
    const ldsim_model *M = S->model;
    double least = INFINITY;
    for (uint32_t i = 0; i < M->n.landmarks; i++) {
        double total = 0.0;
        for (int a = 0; a < M->r; a++) {
            const double away = M->landmarks[(size_t)i * M->r + a] - S->now.z[a];
            total += away * away;
        }
        least = fmin(least, total);
    }
    return M->n.landmarks ? sqrt(least) / M->given.reach / M->given.threshold : (double)NAN;
}

/* ---- Saved states -------------------------------------------------------------------------------------------------- */

typedef struct {
    uint64_t magic, fingerprint, size, sums[2];
    double gravity[3], scale, gravity_then[3];
    uint32_t next_id, g;
    int32_t usable, fresh, excess, rows;
    uint32_t held[LDSIM_MAX_GRABS];
    struct {
        uint32_t id, count;
        double target[3], stiffness, pull[3], target_then[3];
        uint32_t place, released;
    } grabs[LDSIM_MAX_GRABS];
} saved; /* followed by the numbers of the moment, the pins, and the vertices of each grab */

#define SAVED UINT64_C(0x65746174734D4953) /* "SIMstate" */

size_t ldsim_state_size(const ldsim_solid *S)
{
    size_t vertices = 0;
    for (int i = 0; i < S->max_grabs; i++)
        if (S->grabs[i].id) vertices += S->grabs[i].count;
    return sizeof(saved) + (S->moment_size + S->model->moved) * sizeof(double) + (vertices + 1) / 2 * 8;
}

/* The sums over all words of a state after those that hold them; a state may lie at any address. */
static void state_sums(const unsigned char *state, size_t size, uint64_t sums[2])
{
    uint64_t word;
    sums[0] = sums[1] = 0;
    for (size_t i = 40; i + 8 <= size; i += 8) {
        memcpy(&word, state + i, 8);
        sums[0] += word, sums[1] += sums[0];
    }
}

void ldsim_save(const ldsim_solid *S, void *state)
{
    saved head;
    memset(&head, 0, sizeof head);
    head.magic = SAVED, head.fingerprint = S->model->fingerprint, head.size = ldsim_state_size(S);
    copy(head.gravity, S->gravity, 3), copy(head.gravity_then, S->now.gravity, 3);
    head.scale = S->scale, head.next_id = S->next_id;
    head.usable = S->now.usable, head.fresh = S->now.fresh, head.excess = S->now.excess, head.rows = S->now.rows;
    memcpy(head.held, S->now.held, sizeof head.held);
    unsigned char *numbers_at = (unsigned char *)state + sizeof head;
    unsigned char *pins_at = numbers_at + S->moment_size * sizeof(double);
    unsigned char *at = pins_at + S->model->moved * sizeof(double);
    memset(state, 0, head.size); /* what lies between the arrays, too, is the same each time */
    for (int i = 0; i < S->max_grabs; i++) {
        const grab *g = S->grabs + i;
        if (g->id == 0) continue;
        head.grabs[head.g].id = g->id, head.grabs[head.g].count = g->count;
        head.grabs[head.g].stiffness = g->stiffness, head.grabs[head.g].released = g->released != 0;
        head.grabs[head.g].place = (uint32_t)i;
        copy(head.grabs[head.g].target_then, g->target_then, 3);
        copy(head.grabs[head.g].target, g->target, 3), copy(head.grabs[head.g++].pull, S->pulls + 3 * i, 3);
        memcpy(at, g->vertices, g->count * sizeof(uint32_t));
        at += g->count * sizeof(uint32_t);
    }
    memcpy(numbers_at, S->now.z, S->moment_size * sizeof(double));
    memcpy(pins_at, S->pins, S->model->moved * sizeof(double));
    memcpy(state, &head, sizeof head);
    state_sums(state, head.size, head.sums);
    memcpy(state, &head, sizeof head);
}

/* Whether all of a state is what ldsim_save may have written for this model; S->start holds its numbers then. */
static int check_state(ldsim_solid *S, const saved *head, const unsigned char *state, size_t size)
{
    const ldsim_model *M = S->model;
    const size_t fixed = sizeof *head + (S->moment_size + M->moved) * sizeof(double);
    size_t vertices = 0;
    uint32_t vertex;
    if (head->g > (uint32_t)S->max_grabs) return LDSIM_TOO_MANY_GRABS;
    int fine = all_finite(head->gravity, 3) && all_finite(head->gravity_then, 3) && finite_number(head->scale);
    fine = fine && head->scale > 0.0 && head->next_id > 0 && head->fresh >= 0 && head->excess >= 0;
    fine = fine && head->rows >= 0 && head->rows <= 3 * S->max_grabs;
    for (uint32_t i = 0; fine && i < head->g; i++) {
        fine = head->grabs[i].id && head->grabs[i].id < head->next_id && head->grabs[i].count;
        fine = fine && head->grabs[i].count <= M->n.vertices && head->grabs[i].stiffness > 0.0;
        fine = fine && all_finite(head->grabs[i].target, 10);
        fine = fine && head->grabs[i].place < (uint32_t)S->max_grabs;
        for (uint32_t j = 0; j < i; j++)
            fine = fine && head->grabs[j].id != head->grabs[i].id && head->grabs[j].place != head->grabs[i].place;
        vertices += head->grabs[i].count;
    }
    if (!fine || size < fixed || size - fixed != (vertices + 1) / 2 * 8) return LDSIM_OTHER_MODEL;
    for (size_t i = 0; i < vertices; i++) {
        memcpy(&vertex, state + fixed + 4 * i, 4);
        if (vertex >= M->n.vertices) return LDSIM_OTHER_MODEL;
    }
    memcpy(S->start.z, state + sizeof *head, S->moment_size * sizeof(double));
    memcpy(S->scratch, state + sizeof *head + S->moment_size * sizeof(double), M->moved * sizeof(double));
    if (!all_finite(S->start.z, S->moment_size) || !all_finite(S->scratch, M->moved)) return LDSIM_NOT_FINITE;
    return !within(M, features_norm(S, &S->start)) ? LDSIM_OUT_OF_BOUNDS : LDSIM_OK;
}

int ldsim_restore(ldsim_solid *S, const void *state, size_t size)
{
    const ldsim_model *M = S->model;
    uint64_t sums[2];
    saved head;
    if (!state || size < sizeof head) return LDSIM_OTHER_MODEL;
    memcpy(&head, state, sizeof head);
    if (head.magic != SAVED || head.fingerprint != M->fingerprint || head.size != size) return LDSIM_OTHER_MODEL;
    state_sums(state, size, sums);
    if (sums[0] != head.sums[0] || sums[1] != head.sums[1]) return LDSIM_OTHER_MODEL;
    const int code = check_state(S, &head, state, size);
    if (code != LDSIM_OK) return code;
    memcpy(S->start.held, head.held, sizeof head.held);
    S->start.usable = head.usable != 0, S->start.fresh = head.fresh, S->start.excess = head.excess;
    S->start.rows = head.rows;
    copy(S->start.gravity, head.gravity_then, 3);
    take(S, &S->start);
    copy(S->pins, S->scratch, M->moved);
    copy(S->gravity, head.gravity, 3);
    scale_by(S, head.scale), S->renewed_springs = 0;
    if (head.next_id > S->next_id) S->next_id = head.next_id;
    /* Each has its place again, for sums go by places; one that is held there already is kept, for its field costs solves. */
    const unsigned char *const lists = (const unsigned char *)state + sizeof head + (S->moment_size + M->moved) * sizeof(double);
    for (int i = 0; i < S->max_grabs; i++) {
        const unsigned char *at = lists;
        int kept = 0;
        for (uint32_t j = 0; j < head.g; at += 4 * (size_t)head.grabs[j++].count)
            kept |= head.grabs[j].place == (uint32_t)i && head.grabs[j].id == S->grabs[i].id &&
                    head.grabs[j].count == S->grabs[i].count && memcmp(at, S->grabs[i].vertices, 4 * (size_t)S->grabs[i].count) == 0;
        if (!kept) S->grabs[i].id = 0;
    }
    const unsigned char *at = lists;
    for (uint32_t j = 0; j < head.g; at += 4 * (size_t)head.grabs[j++].count) {
        const int place = (int)head.grabs[j].place;
        grab *g = S->grabs + place;
        if (!g->id) {
            memcpy(g->vertices, at, 4 * (size_t)head.grabs[j].count);
            hold(S, place, head.grabs[j].id, g->vertices, head.grabs[j].count);
        }
        copy(g->target, head.grabs[j].target, 3), copy(g->target_then, head.grabs[j].target_then, 3);
        copy(S->pulls + 3 * place, head.grabs[j].pull, 3);
        g->stiffness = head.grabs[j].stiffness, g->released = head.grabs[j].released != 0;
    }
    if (S->model->anchors) make_springs(S, S->now.f), give(S, S->pulls); /* what is read next needs the warps */
    return LDSIM_OK;
}
