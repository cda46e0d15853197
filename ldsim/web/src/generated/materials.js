// Made by `python -m tools.port` from ldsim/mechanics/materials: change that, not this.

function tensors_squared_norm(A) {
return (((((((((A[0] * A[0]) + (A[1] * A[1])) + (A[2] * A[2])) + (A[3] * A[3])) + (A[4] * A[4])) + (A[5] * A[5])) + (A[6] * A[6])) + (A[7] * A[7])) + (A[8] * A[8]));
}
function tensors_determinant(A) {
return (((A[0] * ((A[4] * A[8]) - (A[5] * A[7]))) - (A[1] * ((A[3] * A[8]) - (A[5] * A[6])))) + (A[2] * ((A[3] * A[7]) - (A[4] * A[6]))));
}
function neo_hookean__invariants(F) {
let a, b, c, less_one, minors, stretch, trace, volume, y;
{ const all = [(F[0] - 1.0), (F[4] - 1.0), (F[8] - 1.0)];
a = all[0];
b = all[1];
c = all[2];
}
trace = ((a + b) + c);
stretch = ((2.0 * trace) + tensors_squared_norm([a, F[1], F[2], F[3], b, F[5], F[6], F[7], c]));
minors = ((((a * b) - (F[1] * F[3])) + ((a * c) - (F[2] * F[6]))) + ((b * c) - (F[5] * F[7])));
volume = ((trace + minors) + tensors_determinant([a, F[1], F[2], F[3], b, F[5], F[6], F[7], c]));
y = ((x) => 1 / Math.cbrt(x))((1.0 + volume));
less_one = (((-volume) * ((y * y) * y)) / ((1.0 + y) + (y * y)));
return [(3.0 + stretch), volume, y, (((3.0 * (y + 1.0)) * less_one) + ((y * y) * stretch))];
}
function tensors_combination(a, A, b, B) {
return [((a * A[0]) + (b * B[0])), ((a * A[1]) + (b * B[1])), ((a * A[2]) + (b * B[2])), ((a * A[3]) + (b * B[3])), ((a * A[4]) + (b * B[4])), ((a * A[5]) + (b * B[5])), ((a * A[6]) + (b * B[6])), ((a * A[7]) + (b * B[7])), ((a * A[8]) + (b * B[8]))];
}
function tensors_cofactor(A) {
return [((A[4] * A[8]) - (A[5] * A[7])), ((A[5] * A[6]) - (A[3] * A[8])), ((A[3] * A[7]) - (A[4] * A[6])), ((A[2] * A[7]) - (A[1] * A[8])), ((A[0] * A[8]) - (A[2] * A[6])), ((A[1] * A[6]) - (A[0] * A[7])), ((A[1] * A[5]) - (A[2] * A[4])), ((A[2] * A[3]) - (A[0] * A[5])), ((A[0] * A[4]) - (A[1] * A[3]))];
}
function neo_hookean_energy_stress(F, mu, lam) {
let I1, P, pressure, shape, shear, volume, y;
{ const all = neo_hookean__invariants(F);
I1 = all[0];
volume = all[1];
y = all[2];
shape = all[3];
}
shear = ((mu * y) * y);
pressure = ((lam * volume) - (((shear * I1) * ((y * y) * y)) / 3.0));
P = tensors_combination(shear, F, pressure, tensors_cofactor(F));
return [((volume > (-1.0)) ? (((0.5 * mu) * shape) + (((0.5 * lam) * volume) * volume)) : Infinity), P];
}
const tensors_SWEEPS = 12;
function tensors_jacobi_rotation(app, aqq, apq) {
let c, t, tau;
if ((apq === 0.0)) {
return [1.0, 0.0, 0.0];
}
tau = ((aqq - app) / (2.0 * apq));
t = (((size, sign) => (sign < 0 || Object.is(sign, -0) ? -size : size))(1.0, tau) / (Math.abs(tau) + Math.sqrt((1.0 + (tau * tau)))));
c = (1.0 / Math.sqrt((1.0 + (t * t))));
return [c, (t * c), t];
}
function tensors_symmetric_eigen(S) {
let _, a, b, c, cs, d, e, f, sn, t, v00, v01, v02, v10, v11, v12, v20, v21, v22;
{ const all = S;
a = all[0];
b = all[1];
c = all[2];
d = all[3];
e = all[4];
f = all[5];
}
{ const all = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
v00 = all[0];
v01 = all[1];
v02 = all[2];
v10 = all[3];
v11 = all[4];
v12 = all[5];
v20 = all[6];
v21 = all[7];
v22 = all[8];
}
for (_ = 0; _ < tensors_SWEEPS; _++) {
if ((((Math.abs(d) + Math.abs(e)) + Math.abs(f)) <= (1e-17 * ((Math.abs(a) + Math.abs(b)) + Math.abs(c))))) {
break;
}
{ const all = tensors_jacobi_rotation(a, b, d);
cs = all[0];
sn = all[1];
t = all[2];
}
{ const all = [(a - (t * d)), (b + (t * d)), 0.0];
a = all[0];
b = all[1];
d = all[2];
}
{ const all = [((cs * e) - (sn * f)), ((sn * e) + (cs * f))];
e = all[0];
f = all[1];
}
{ const all = [((cs * v00) - (sn * v01)), ((sn * v00) + (cs * v01))];
v00 = all[0];
v01 = all[1];
}
{ const all = [((cs * v10) - (sn * v11)), ((sn * v10) + (cs * v11))];
v10 = all[0];
v11 = all[1];
}
{ const all = [((cs * v20) - (sn * v21)), ((sn * v20) + (cs * v21))];
v20 = all[0];
v21 = all[1];
}
{ const all = tensors_jacobi_rotation(a, c, e);
cs = all[0];
sn = all[1];
t = all[2];
}
{ const all = [(a - (t * e)), (c + (t * e)), 0.0];
a = all[0];
c = all[1];
e = all[2];
}
{ const all = [((cs * d) - (sn * f)), ((sn * d) + (cs * f))];
d = all[0];
f = all[1];
}
{ const all = [((cs * v00) - (sn * v02)), ((sn * v00) + (cs * v02))];
v00 = all[0];
v02 = all[1];
}
{ const all = [((cs * v10) - (sn * v12)), ((sn * v10) + (cs * v12))];
v10 = all[0];
v12 = all[1];
}
{ const all = [((cs * v20) - (sn * v22)), ((sn * v20) + (cs * v22))];
v20 = all[0];
v22 = all[1];
}
{ const all = tensors_jacobi_rotation(b, c, f);
cs = all[0];
sn = all[1];
t = all[2];
}
{ const all = [(b - (t * f)), (c + (t * f)), 0.0];
b = all[0];
c = all[1];
f = all[2];
}
{ const all = [((cs * d) - (sn * e)), ((sn * d) + (cs * e))];
d = all[0];
e = all[1];
}
{ const all = [((cs * v01) - (sn * v02)), ((sn * v01) + (cs * v02))];
v01 = all[0];
v02 = all[1];
}
{ const all = [((cs * v11) - (sn * v12)), ((sn * v11) + (cs * v12))];
v11 = all[0];
v12 = all[1];
}
{ const all = [((cs * v21) - (sn * v22)), ((sn * v21) + (cs * v22))];
v21 = all[0];
v22 = all[1];
}
}
return [a, b, c, [v00, v01, v02, v10, v11, v12, v20, v21, v22]];
}
function tensors_gram(F) {
return [(((F[0] * F[0]) + (F[3] * F[3])) + (F[6] * F[6])), (((F[1] * F[1]) + (F[4] * F[4])) + (F[7] * F[7])), (((F[2] * F[2]) + (F[5] * F[5])) + (F[8] * F[8])), (((F[0] * F[1]) + (F[3] * F[4])) + (F[6] * F[7])), (((F[0] * F[2]) + (F[3] * F[5])) + (F[6] * F[8])), (((F[1] * F[2]) + (F[4] * F[5])) + (F[7] * F[8]))];
}
function tensors__cross(a, b) {
return [((a[1] * b[2]) - (a[2] * b[1])), ((a[2] * b[0]) - (a[0] * b[2])), ((a[0] * b[1]) - (a[1] * b[0]))];
}
function tensors__dot(a, b) {
return (((a[0] * b[0]) + (a[1] * b[1])) + (a[2] * b[2]));
}
function tensors__times(A, x) {
return [tensors__dot([A[0], A[1], A[2]], x), tensors__dot([A[3], A[4], A[5]], x), tensors__dot([A[6], A[7], A[8]], x)];
}
function tensors_signed_svd(F) {
let U, V, i, j, l0, l1, l2, overlap, p, q, r, s0, s1, s2, scale, x, y, z;
{ const all = tensors_symmetric_eigen(tensors_gram(F));
l0 = all[0];
l1 = all[1];
l2 = all[2];
V = all[3];
}
{ const all = [0, 1];
i = all[0];
j = all[1];
}
if (((l1 > l0) && (l1 >= l2))) {
{ const all = [1, ((l0 >= l2) ? 0 : 2)];
i = all[0];
j = all[1];
}
}
else {
if (((l2 > l0) && (l2 > l1))) {
{ const all = [2, ((l0 >= l1) ? 0 : 1)];
i = all[0];
j = all[1];
}
}
else {
if ((l2 > l1)) {
j = 2;
}
}
}
{ const all = [[V[i], V[(3 + i)], V[(6 + i)]], [V[j], V[(3 + j)], V[(6 + j)]]];
p = all[0];
q = all[1];
}
r = tensors__cross(p, q);
{ const all = [tensors__times(F, p), tensors__times(F, q)];
x = all[0];
y = all[1];
}
s0 = Math.sqrt(tensors__dot(x, x));
x = ((s0 > 0.0) ? [(x[0] / s0), (x[1] / s0), (x[2] / s0)] : [1.0, 0.0, 0.0]);
overlap = tensors__dot(x, y);
y = [(y[0] - (overlap * x[0])), (y[1] - (overlap * x[1])), (y[2] - (overlap * x[2]))];
s1 = Math.sqrt(tensors__dot(y, y));
if ((s1 > (1e-14 * s0))) {
y = [(y[0] / s1), (y[1] / s1), (y[2] / s1)];
}
else {
if ((Math.abs(x[0]) < 0.8)) {
scale = (1.0 / Math.sqrt(((x[1] * x[1]) + (x[2] * x[2]))));
y = [0.0, (x[2] * scale), ((-x[1]) * scale)];
}
else {
scale = (1.0 / Math.sqrt(((x[0] * x[0]) + (x[2] * x[2]))));
y = [(x[2] * scale), 0.0, ((-x[0]) * scale)];
}
}
z = tensors__cross(x, y);
s2 = tensors__dot(z, tensors__times(F, r));
U = [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
return [U, [s0, s1, s2], [p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]]];
}
function isotropic__pair(p, q, dp, dq, mean, mixed, clamp) {
let flip, limit, small, total, twist;
small = (1e-05 * (Math.abs(p) + Math.abs(q)));
{ const all = [(p + q), (mean + mixed)];
total = all[0];
limit = all[1];
}
if (((Math.abs(total) <= small) && (Math.abs((dp + dq)) <= ((2.0 * Math.abs(limit)) * small)))) {
twist = limit;
}
else {
if ((Math.abs(total) < 1e-08)) {
total = ((total >= 0.0) ? 1e-08 : (-1e-08));
}
twist = ((dp + dq) / total);
}
flip = ((Math.abs((p - q)) > small) ? ((dp - dq) / (p - q)) : (mean - mixed));
if (clamp) {
twist = Math.max(twist, 0.0);
flip = Math.max(flip, 0.0);
}
return [(0.5 * (flip + twist)), (0.5 * (flip - twist))];
}
function tensors__positive(S) {
let a, b, c, d, e, f, minor, third;
{ const all = S;
a = all[0];
b = all[1];
c = all[2];
d = all[3];
e = all[4];
f = all[5];
}
minor = ((a * b) - (d * d));
third = ((minor * c) - ((((a * f) * f) - (((2.0 * d) * e) * f)) + ((b * e) * e)));
return ((a > 0.0) && (minor > ((1e-14 * a) * b)) && (third > (((1e-14 * a) * b) * c)));
}
function tensors_clamped_symmetric(S) {
let V, a, b, c;
if (tensors__positive(S)) {
return S;
}
{ const all = tensors_symmetric_eigen(S);
a = all[0];
b = all[1];
c = all[2];
V = all[3];
}
if (((a >= 0.0) && (b >= 0.0) && (c >= 0.0))) {
return S;
}
{ const all = [Math.max(a, 0.0), Math.max(b, 0.0), Math.max(c, 0.0)];
a = all[0];
b = all[1];
c = all[2];
}
return [((((a * V[0]) * V[0]) + ((b * V[1]) * V[1])) + ((c * V[2]) * V[2])), ((((a * V[3]) * V[3]) + ((b * V[4]) * V[4])) + ((c * V[5]) * V[5])), ((((a * V[6]) * V[6]) + ((b * V[7]) * V[7])) + ((c * V[8]) * V[8])), ((((a * V[0]) * V[3]) + ((b * V[1]) * V[4])) + ((c * V[2]) * V[5])), ((((a * V[0]) * V[6]) + ((b * V[1]) * V[7])) + ((c * V[2]) * V[8])), ((((a * V[3]) * V[6]) + ((b * V[4]) * V[7])) + ((c * V[5]) * V[8]))];
}
function isotropic_isotropic(slopes) {
let I1, J, U, V, _, a01, a02, a12, b01, b02, b12, d0, d1, d2, h00, h01, h02, h11, h12, h22, p, q, r, stretch;
function tangent(F, mu, lam, clamp) {
let I1, J, U, V, _, a01, a02, a12, b01, b02, b12, d0, d1, d2, h00, h01, h02, h11, h12, h22, p, q, r, stretch;
{ const all = tensors_signed_svd(F);
U = all[0];
p = all[1][0];
q = all[1][1];
r = all[1][2];
V = all[2];
}
{ const all = [(((p * p) + (q * q)) + (r * r)), ((p * q) * r)];
I1 = all[0];
J = all[1];
}
{ const all = slopes(p, q, r, I1, J, mu, lam);
d0 = all[0];
h00 = all[1];
h01 = all[2];
}
{ const all = slopes(q, p, r, I1, J, mu, lam);
d1 = all[0];
h11 = all[1];
_ = all[2];
}
{ const all = slopes(r, p, q, I1, J, mu, lam);
d2 = all[0];
h22 = all[1];
_ = all[2];
}
{ const all = slopes(p, r, q, I1, J, mu, lam);
_ = all[0];
_ = all[1];
h02 = all[2];
}
{ const all = slopes(q, r, p, I1, J, mu, lam);
_ = all[0];
_ = all[1];
h12 = all[2];
}
{ const all = isotropic__pair(p, q, d0, d1, (0.5 * (h00 + h11)), h01, clamp);
a01 = all[0];
b01 = all[1];
}
{ const all = isotropic__pair(p, r, d0, d2, (0.5 * (h00 + h22)), h02, clamp);
a02 = all[0];
b02 = all[1];
}
{ const all = isotropic__pair(q, r, d1, d2, (0.5 * (h11 + h22)), h12, clamp);
a12 = all[0];
b12 = all[1];
}
stretch = [h00, h11, h22, h01, h02, h12];
if (clamp) {
stretch = tensors_clamped_symmetric(stretch);
}
return [U, V, stretch, [a01, a02, a12, b01, b02, b12]];
}
return tangent;
}
function neo_hookean_slopes(x, y, z, I1, J, mu, lam) {
let pressure, shear, t;
shear = (mu * (Math.abs(J) ** ((-2.0) / 3.0)));
pressure = (lam * (J - 1.0));
t = ((shear * I1) / 3.0);
return [(((shear * x) - (t / x)) + ((pressure * y) * z)), ((((-shear) / 3.0) + ((5.0 * t) / ((3.0 * x) * x))) + (lam * ((y * z) ** 2))), ((((((-2.0) / 3.0) * shear) * ((x / y) + (y / x))) + ((2.0 * t) / ((3.0 * x) * y))) + (((lam * J) + pressure) * z))];
}
const neo_hookean_tangent = isotropic_isotropic(neo_hookean_slopes);
function isotropic_of_invariants(density, slopes) {
let I1, J, _, area, by_I1, by_J, mixed, twice_I1, twice_J;
function energy_stress(F, mu, lam) {
let I1, J, _, by_I1, by_J;
{ const all = [tensors_squared_norm(F), tensors_determinant(F)];
I1 = all[0];
J = all[1];
}
{ const all = slopes(I1, J, mu, lam);
by_I1 = all[0];
by_J = all[1];
_ = all[2];
_ = all[3];
_ = all[4];
}
return [density(I1, J, mu, lam), tensors_combination((2.0 * by_I1), F, by_J, tensors_cofactor(F))];
}
function stretched(x, y, z, I1, J, mu, lam) {
let area, by_I1, by_J, mixed, twice_I1, twice_J;
{ const all = slopes(I1, J, mu, lam);
by_I1 = all[0];
by_J = all[1];
twice_I1 = all[2];
mixed = all[3];
twice_J = all[4];
}
area = (y * z);
return [(((2.0 * by_I1) * x) + (by_J * area)), ((((2.0 * by_I1) + (((4.0 * twice_I1) * x) * x)) + (((4.0 * mixed) * x) * area)) + ((twice_J * area) * area)), ((((4.0 * twice_I1) * x) * y) + (((((2.0 * mixed) * ((x * x) + (y * y))) + (twice_J * J)) + by_J) * z))];
}
return [energy_stress, isotropic_isotropic(stretched)];
}
function stable_neo_hookean_density(I1, J, mu, lam) {
let alpha, l, m, volumetric;
{ const all = [((4.0 * mu) / 3.0), (lam + ((5.0 * mu) / 6.0))];
m = all[0];
l = all[1];
}
alpha = (1.0 + ((0.75 * m) / l));
volumetric = (((J - alpha) ** 2) - ((1.0 - alpha) ** 2));
return (((0.5 * m) * ((I1 - 3.0) - Math.log(((I1 + 1.0) / 4.0)))) + ((0.5 * l) * volumetric));
}
function stable_neo_hookean_slopes(I1, J, mu, lam) {
let alpha, l, m;
{ const all = [((4.0 * mu) / 3.0), (lam + ((5.0 * mu) / 6.0))];
m = all[0];
l = all[1];
}
alpha = (1.0 + ((0.75 * m) / l));
return [((0.5 * m) * (1.0 - (1.0 / (I1 + 1.0)))), (l * (J - alpha)), ((0.5 * m) / ((I1 + 1.0) ** 2)), 0.0, l];
}
const [stable_neo_hookean_energy_stress, stable_neo_hookean_tangent] = isotropic_of_invariants(stable_neo_hookean_density, stable_neo_hookean_slopes);
function tensors__row(x, y, z, B) {
return [(((x * B[0]) + (y * B[3])) + (z * B[6])), (((x * B[1]) + (y * B[4])) + (z * B[7])), (((x * B[2]) + (y * B[5])) + (z * B[8]))];
}
function tensors_product(A, B) {
return [...tensors__row(A[0], A[1], A[2], B), ...tensors__row(A[3], A[4], A[5], B), ...tensors__row(A[6], A[7], A[8], B)];
}
function st_venant_kirchhoff_energy_stress(F, mu, lam) {
let S, c00, c01, c02, c11, c12, c22, e00, e11, e22, m, pressure, s01, s02, s12, square, trace;
{ const all = tensors_gram(F);
c00 = all[0];
c11 = all[1];
c22 = all[2];
c01 = all[3];
c02 = all[4];
c12 = all[5];
}
{ const all = [(0.5 * (c00 - 1.0)), (0.5 * (c11 - 1.0)), (0.5 * (c22 - 1.0))];
e00 = all[0];
e11 = all[1];
e22 = all[2];
}
trace = ((e00 + e11) + e22);
square = ((((e00 * e00) + (e11 * e11)) + (e22 * e22)) + (0.5 * (((c01 * c01) + (c02 * c02)) + (c12 * c12))));
{ const all = [(2.0 * mu), (lam * trace)];
m = all[0];
pressure = all[1];
}
{ const all = [(mu * c01), (mu * c02), (mu * c12)];
s01 = all[0];
s02 = all[1];
s12 = all[2];
}
S = [((m * e00) + pressure), s01, s02, s01, ((m * e11) + pressure), s12, s02, s12, ((m * e22) + pressure)];
return [((mu * square) + (((0.5 * lam) * trace) * trace)), tensors_product(F, S)];
}
function st_venant_kirchhoff_slopes(x, y, z, I1, J, mu, lam) {
let pressure;
pressure = ((0.5 * lam) * (I1 - 3.0));
return [(((mu * ((x * x) - 1.0)) + pressure) * x), (((mu * (((3.0 * x) * x) - 1.0)) + pressure) + ((lam * x) * x)), ((lam * x) * y)];
}
const st_venant_kirchhoff_tangent = isotropic_isotropic(st_venant_kirchhoff_slopes);
function tensors_product_transposed(A, B) {
return tensors_product(A, [B[0], B[3], B[6], B[1], B[4], B[7], B[2], B[5], B[8]]);
}
function fixed_corotated_energy_stress(F, mu, lam) {
let J, P, U, V, a, b, c, shear;
{ const all = tensors_signed_svd(F);
U = all[0];
a = all[1][0];
b = all[1][1];
c = all[1][2];
V = all[2];
}
J = tensors_determinant(F);
shear = tensors_combination((2.0 * mu), F, ((-2.0) * mu), tensors_product_transposed(U, V));
P = tensors_combination(1.0, shear, (lam * (J - 1.0)), tensors_cofactor(F));
return [((mu * ((((a - 1.0) ** 2) + ((b - 1.0) ** 2)) + ((c - 1.0) ** 2))) + ((0.5 * lam) * ((J - 1.0) ** 2))), P];
}
function fixed_corotated_slopes(x, y, z, I1, J, mu, lam) {
let pressure;
pressure = (lam * (J - 1.0));
return [(((2.0 * mu) * (x - 1.0)) + ((pressure * y) * z)), ((2.0 * mu) + (lam * ((y * z) ** 2))), (((lam * J) + pressure) * z)];
}
const fixed_corotated_tangent = isotropic_isotropic(fixed_corotated_slopes);
function linear_energy_stress(F, mu, lam) {
let P, e00, e01, e02, e11, e12, e22, m, pressure, square, trace;
{ const all = [(F[0] - 1.0), (F[4] - 1.0), (F[8] - 1.0)];
e00 = all[0];
e11 = all[1];
e22 = all[2];
}
{ const all = [(0.5 * (F[1] + F[3])), (0.5 * (F[2] + F[6])), (0.5 * (F[5] + F[7]))];
e01 = all[0];
e02 = all[1];
e12 = all[2];
}
trace = ((e00 + e11) + e22);
{ const all = [(2.0 * mu), (lam * trace)];
m = all[0];
pressure = all[1];
}
square = ((((e00 * e00) + (e11 * e11)) + (e22 * e22)) + (2.0 * (((e01 * e01) + (e02 * e02)) + (e12 * e12))));
P = [((m * e00) + pressure), (m * e01), (m * e02), (m * e01), ((m * e11) + pressure), (m * e12), (m * e02), (m * e12), ((m * e22) + pressure)];
return [((mu * square) + (((0.5 * lam) * trace) * trace)), P];
}
const tensors_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
function linear_tangent(F, mu, lam, clamp) {
let stiff;
stiff = ((2.0 * mu) + lam);
return [tensors_IDENTITY, tensors_IDENTITY, [stiff, stiff, stiff, lam, lam, lam], [mu, mu, mu, mu, mu, mu]];
}
const MATERIALS = {
0: { energyStress: neo_hookean_energy_stress, tangent: neo_hookean_tangent },
1: { energyStress: stable_neo_hookean_energy_stress, tangent: stable_neo_hookean_tangent },
2: { energyStress: st_venant_kirchhoff_energy_stress, tangent: st_venant_kirchhoff_tangent },
3: { energyStress: fixed_corotated_energy_stress, tangent: fixed_corotated_tangent },
4: { energyStress: linear_energy_stress, tangent: linear_tangent },
};

/** The material of a number, as Python numbers them. */
export function material(number) {
  if (!MATERIALS[number]) throw new Error(`no material has the number ${number}`);
  return MATERIALS[number];
}
