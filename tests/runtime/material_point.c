/* The materials of the library one point at a time, for the committed vectors. */
#include "ldsim.c"

double energy_stress(int kind, const double *F, double mu, double lambda, double *P)
{
    double strain[9], one = 1.0;
    for (int e = 0; e < 9; e++) strain[e] = F[e] - (e % 4 == 0);
    const double energy = kind == NEO_HOOKEAN          ? sum_neo_hookean(0, 1, 1, strain, &one, &mu, &lambda, 1.0)
                          : kind == STABLE_NEO_HOOKEAN ? sum_stable_neo_hookean(0, 1, 1, strain, &one, &mu, &lambda, 1.0)
                          : kind == ST_VENANT_KIRCHHOFF ? sum_st_venant_kirchhoff(0, 1, 1, strain, &one, &mu, &lambda, 1.0)
                          : kind == FIXED_COROTATED    ? sum_fixed_corotated(0, 1, 1, strain, &one, &mu, &lambda, 1.0)
                                                       : sum_linear_elastic(0, 1, 1, strain, &one, &mu, &lambda, 1.0);
    for (int e = 0; e < 9; e++) P[e] = strain[e];
    return energy;
}

void tangent(int kind, const double *F, double mu, double lambda, double *U, double *V, double *D, double *O)
{
    clamped_tangent(kind, F, mu, lambda, U, V, D, O);
}
