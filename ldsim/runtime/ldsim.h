/* ldsim: steps a reduced deformable solid.
 *
 * A model is a file that `ldsim export RUN --format c` writes; its layout is in docs/guide/runtime.md. Lengths are in
 * metres, times in seconds, forces in newtons. All vectors are x, y, z.
 *
 *     ldsim_model *model;
 *     ldsim_solid *solid;
 *     uint32_t pull;
 *     ldsim_load_file("model.ldsim", &model);
 *     ldsim_create(model, 4, &solid);
 *     ldsim_grab(solid, point, target, 0.0, 0.0, &pull);
 *     ldsim_step(solid, NULL);
 *
 * A model is never written to once it is loaded: any number of solids and threads may share it. A solid belongs to one
 * thread at a time. Nothing is allocated but in ldsim_load, ldsim_load_file and ldsim_create. There is no global state.
 * The same calls on the same machine with the same binary give the same bits.
 */
#ifndef LDSIM_H
#define LDSIM_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LDSIM_FILE_VERSION 3u
#define LDSIM_MAX_GRABS 32

typedef struct ldsim_model ldsim_model;
typedef struct ldsim_solid ldsim_solid;

/* What a call returns. LDSIM_OK is 0; ldsim_message tells the others in words. A call that fails changes nothing. */
typedef enum {
    LDSIM_OK,
    LDSIM_NO_MEMORY,
    LDSIM_NO_FILE,
    LDSIM_NOT_A_MODEL,
    LDSIM_OTHER_VERSION,
    LDSIM_WRONG_SIZE,
    LDSIM_DAMAGED,
    LDSIM_BAD_SIZES,
    LDSIM_BAD_INDEX,
    LDSIM_NOT_FINITE,
    LDSIM_BAD_VALUE,
    LDSIM_BIG_ENDIAN,
    LDSIM_BAD_ARGUMENT,
    LDSIM_TOO_MANY_GRABS,
    LDSIM_NO_SUCH_GRAB,
    LDSIM_TOO_FAR,
    LDSIM_ALL_PINNED,
    LDSIM_NO_SUCH_SUPPORT,
    LDSIM_OTHER_MODEL,
    LDSIM_OUT_OF_BOUNDS
} ldsim_code;

/* Why the minimiser of a step stopped. */
typedef enum { LDSIM_CONVERGED, LDSIM_ITERATIONS_SPENT, LDSIM_NO_DECREASE, LDSIM_INFINITE_START } ldsim_reason;

/* What came of a step. SHORT: the minimiser stopped before its tolerance, its best point was taken. SLOWED: no step in
 * motion stayed finite and in bounds, it was taken from standstill. HELD: not even that; the shape was kept. */
typedef enum { LDSIM_SOLVED, LDSIM_SHORT, LDSIM_SLOWED, LDSIM_HELD } ldsim_outcome;

typedef struct {
    uint32_t vertices, triangles;
    uint32_t r;          /* coordinates that move */
    uint32_t features;   /* numbers that displacements are linear in */
    uint32_t points;     /* cubature points */
    uint32_t supports;   /* groups of pins that may move */
    int condensed;       /* whether all but the r coordinates is in static equilibrium */
    double time_step;
    double gravity[3];
    double diagonal;     /* of the solid at rest */
    double stiffness, radius; /* of a grab where none is given */
} ldsim_info;

typedef struct {
    int iterations, evaluations; /* retries included */
    ldsim_reason reason;
    ldsim_outcome outcome;
    double energy, gradient_norm; /* J and N, where the minimiser stopped */
} ldsim_record;

const char *ldsim_message(int code);

/* The bytes are copied; they need not outlive the call. */
int ldsim_load(const void *bytes, size_t size, ldsim_model **model);
/* A path is in UTF-8, on Windows too; left out where LDSIM_NO_FILES is defined. */
int ldsim_load_file(const char *path, ldsim_model **model);
void ldsim_free(ldsim_model *model); /* after all of its solids are destroyed */
void ldsim_describe(const ldsim_model *model, ldsim_info *info);
const double *ldsim_rest(const ldsim_model *model);        /* positions at rest, (vertices, 3) */
const uint32_t *ldsim_triangles(const ldsim_model *model); /* of the surface, outward, (triangles, 3) */
const uint32_t *ldsim_movable(const ldsim_model *model);   /* 0 where pinned, (vertices,) */
/* What each feature moves some vertices, (count, 3, features): for a graphics card to draw sum_j fields_j feature_j. */
int ldsim_fields(const ldsim_model *model, const uint32_t *vertices, uint32_t count, float *fields);

/* A solid at rest, with room for so many grabs at once, at most LDSIM_MAX_GRABS. */
int ldsim_create(const ldsim_model *model, int max_grabs, ldsim_solid **solid);
void ldsim_destroy(ldsim_solid *solid);
void ldsim_reset(ldsim_solid *solid); /* back to rest, pins too, without grabs; gravity and stiffness stay */

/* Takes hold of the movable vertices within a radius of the one nearest to a point of the deformed solid and pulls
 * their centroid towards a target; stiffness and radius 0 for the usual ones, where in Python a radius of 0 holds that
 * vertex alone. `grab` names it from now on. */
int ldsim_grab(ldsim_solid *solid, const double point[3], const double target[3], double stiffness, double radius,
               uint32_t *grab);
/* The same for vertices that are named. Pinned ones among them do not move. */
int ldsim_grab_vertices(ldsim_solid *solid, const uint32_t *vertices, uint32_t count, const double target[3],
                        double stiffness, uint32_t *grab);
int ldsim_move(ldsim_solid *solid, uint32_t grab, const double target[3]);
/* The dent of a condensed model stays until the next step, or until another grab needs its place. */
int ldsim_release(ldsim_solid *solid, uint32_t grab);
int ldsim_centroid(const ldsim_solid *solid, uint32_t grab, double centroid[3]);
int ldsim_force(const ldsim_solid *solid, uint32_t grab, double force[3]); /* N, on the solid */

int ldsim_set_gravity(ldsim_solid *solid, const double gravity[3]);
/* Of the material, 1 for its own. A condensed solid that would give way out of bounds to what pulls it gives way to nothing
 * until the next step; where its dead load alone would do that, LDSIM_OUT_OF_BOUNDS. */
int ldsim_set_stiffness(ldsim_solid *solid, double scale);
/* Where the pins of a support are from now on, x = A X + b: (A | b) row by row. */
int ldsim_move_pins(ldsim_solid *solid, uint32_t support, const double map[12]);

/* One time step. `record` may be NULL. */
ldsim_outcome ldsim_step(ldsim_solid *solid, ldsim_record *record);
/* So many steps of each of some solids, as threads take them that have solids of their own; the worst outcome of all.
 * `records`, (count,) or NULL, are of the last steps. */
ldsim_outcome ldsim_step_many(ldsim_solid *const *solids, uint32_t count, uint32_t steps, ldsim_record *records);

/* Displacements of all vertices, (vertices, 3), or of some. */
void ldsim_displacements(const ldsim_solid *solid, double *u);
int ldsim_displacement(const ldsim_solid *solid, const uint32_t *vertices, uint32_t count, double *u);
/* z, (r,), and the features; where they lie changes with every step, restored state and stiffness. */
const double *ldsim_coordinates(const ldsim_solid *solid);
const double *ldsim_features(const ldsim_solid *solid); /* (features,) */
/* How far the shape is from the training data: from 1 on, beware. NaN where the model does not tell. */
double ldsim_novelty(const ldsim_solid *solid);

/* All that the next step depends on, to come back to or to continue in another solid of the same model that was created
 * for as many grabs. Its size grows with how many vertices are held: ask for it before each save. */
size_t ldsim_state_size(const ldsim_solid *solid);
void ldsim_save(const ldsim_solid *solid, void *state);
int ldsim_restore(ldsim_solid *solid, const void *state, size_t size);

#ifdef __cplusplus
}
#endif
#endif
