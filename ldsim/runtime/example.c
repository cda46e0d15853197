/* Pulls at the vertex that is farthest from the first one, a quarter of the solid's size along x, and lets it go. */
#include "ldsim.h"

#include <stdio.h>
#include <stdlib.h>

static void check(int code)
{
    if (code != LDSIM_OK) fprintf(stderr, "%s\n", ldsim_message(code)), exit(1);
}

int main(int count, char **words)
{
    ldsim_model *model;
    ldsim_solid *solid;
    ldsim_info info;
    check(ldsim_load_file(count > 1 ? words[1] : "model.ldsim", &model));
    check(ldsim_create(model, 4, &solid));
    ldsim_describe(model, &info);
    const double *x = ldsim_rest(model);
    uint32_t far = 0, pull = 0;
    double most = 0.0, force[3] = {0.0, 0.0, 0.0}, u[3] = {0.0, 0.0, 0.0};
    for (uint32_t v = 0; v < info.vertices; v++) {
        double away = 0.0;
        for (int i = 0; i < 3; i++) away += (x[3 * v + i] - x[i]) * (x[3 * v + i] - x[i]);
        if (away > most) most = away, far = v;
    }
    for (int step = 0; step < 200; step++) {
        ldsim_record record;
        const double now[3] = {x[3 * far] + u[0], x[3 * far + 1] + u[1], x[3 * far + 2] + u[2]};
        const double target[3] = {now[0] + 0.25 * info.diagonal, now[1], now[2]};
        if (step == 20) check(ldsim_grab(solid, now, target, 0.0, 0.0, &pull));
        if (step == 120) check(ldsim_release(solid, pull));
        ldsim_step(solid, &record);
        if (step >= 20 && step < 120) check(ldsim_force(solid, pull, force));
        check(ldsim_displacement(solid, &far, 1, u));
        if (step % 20 == 19)
            printf("%.3f s: moved by %+.6f %+.6f %+.6f m, pulled with %.4f N, %d iterations\n",
                   (step + 1) * info.time_step, u[0], u[1], u[2], step < 120 ? force[0] : 0.0, record.iterations);
    }
    ldsim_destroy(solid);
    ldsim_free(model);
    return 0;
}
