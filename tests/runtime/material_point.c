/* The materials of the library one point at a time, for the committed vectors. */
#include "ldsim.c"

double energy_stress(int kind, const double *F, double mu, double lambda, double *P)
{
    double (*const sums[])(double *restrict, const double *restrict, const double *restrict, const double *restrict,
                           double) = {sum_neo_hookean, sum_stable_neo_hookean, sum_st_venant_kirchhoff,
                                      sum_fixed_corotated, sum_linear_elastic};
    double strain[BLOCK] = {0.0}, w[LANES] = {0.0}, m[LANES], l[LANES];
    for (int s = 0; s < LANES; s++) m[s] = mu, l[s] = lambda;
    w[1] = 1.0; /* one point among others without weight */
    for (int e = 0; e < 9; e++) strain[e * LANES + 1] = F[e] - (e % 4 == 0);
    const double energy = sums[kind](strain, w, m, l, 1.0);
    for (int e = 0; e < 9; e++) P[e] = strain[e * LANES + 1];
    return energy;
}

void tangent(int kind, const double *F, double mu, double lambda, double *U, double *V, double *D, double *O)
{
    clamped_tangent(kind, F, mu, lambda, U, V, D, O);
}
