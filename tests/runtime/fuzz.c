/* Damages a model in many ways and does to whatever still loads all that a host may do; for the sanitizers to watch.
 *
 *     fuzz MODEL SEED ROUNDS
 *
 * Half of the damaged files get checksums that fit, so that the checks behind them are reached too. The last line tells
 * how many were refused and how many ran. */
#include "ldsim.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t state;

static uint64_t next_random(void) /* splitmix64 */
{
    uint64_t z = state += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

static size_t below(size_t n) { return (size_t)(next_random() % n); }

/* Makes size and sums of a changed file fit again. */
static void seal(unsigned char *bytes, size_t size)
{
    uint64_t sums[2] = {0, 0}, word;
    for (size_t i = 40; i + 8 <= size; i += 8) {
        memcpy(&word, bytes + i, 8);
        sums[0] += word, sums[1] += sums[0];
    }
    word = size;
    memcpy(bytes + 16, &word, 8);
    memcpy(bytes + 24, sums, 16);
}

static size_t damage(unsigned char *bytes, size_t size, size_t original)
{
    static const uint32_t odd[] = {0, 1, 2, 7, 255, 65535, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FF00000, 0xFFF80000};
    const size_t changes = 1 + below(4);
    for (size_t i = 0; i < changes; i++) {
        /* the header decides most, then the indices, which stand at the end */
        const size_t end = original / 4 < 2048 ? original / 4 : 2048;
        const size_t places[] = {below(original - 4), original - 4 - 4 * below(end)};
        const size_t at = below(2) ? 4 * below(64) : places[below(2)];
        const uint32_t value = below(2) ? odd[below(sizeof odd / sizeof *odd)] : (uint32_t)next_random();
        if (below(2)) memcpy(bytes + at, &value, 4);
        else bytes[at] ^= (unsigned char)(1u << below(8));
    }
    if (below(8) == 0) size = below(size + 1);
    if (below(2) && size >= 256) seal(bytes, size);
    return size;
}

static void host(const ldsim_model *model)
{
    ldsim_solid *solid, *other;
    ldsim_info info;
    ldsim_record record;
    uint32_t grab[3] = {0, 0, 0};
    ldsim_describe(model, &info);
    if (ldsim_create(model, 2, &solid) != LDSIM_OK) return;
    const double *x = ldsim_rest(model), gravity[3] = {1.0, -20.0, 0.5};
    const double map[12] = {1.0, 0.1, 0.0, 0.01, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0};
    double *u = malloc(3 * (size_t)info.vertices * sizeof *u), three[3];
    for (int i = 0; i < 3; i++) {
        const double *point = x + 3 * below(info.vertices);
        const double target[3] = {point[0] + info.diagonal, point[1] - 1e3, point[2]};
        ldsim_grab(solid, point, target, 0.0, 0.0, grab + i);
        ldsim_step(solid, &record);
    }
    ldsim_set_gravity(solid, gravity), ldsim_set_stiffness(solid, 1e-3), ldsim_move_pins(solid, 0, map);
    ldsim_step(solid, NULL), ldsim_force(solid, grab[0], three), ldsim_displacements(solid, u);
    const size_t size = ldsim_state_size(solid);
    unsigned char *saved = malloc(size);
    ldsim_save(solid, saved);
    if (ldsim_create(model, 2, &other) == LDSIM_OK) {
        ldsim_restore(other, saved, size), ldsim_step(other, NULL);
        for (int i = 0; i < 4; i++) { /* and states that are damaged too */
            saved[below(size)] ^= (unsigned char)(1u << below(8));
            uint64_t sums[2] = {0, 0}, word;
            for (size_t j = 40; j + 8 <= size; j += 8) memcpy(&word, saved + j, 8), sums[0] += word, sums[1] += sums[0];
            memcpy(saved + 24, sums, 16);
            ldsim_restore(other, saved, size), ldsim_step(other, NULL);
        }
        ldsim_destroy(other);
    }
    ldsim_release(solid, grab[0]), ldsim_step(solid, &record), ldsim_reset(solid);
    ldsim_step_many(&solid, 1, 3, &record), ldsim_novelty(solid);
    free(saved), free(u), ldsim_destroy(solid);
}

int main(int count, char **words)
{
    FILE *file = fopen(words[1], "rb");
    if (count != 4 || !file) return 2;
    fseek(file, 0, SEEK_END);
    const size_t size = (size_t)ftell(file);
    unsigned char *model = malloc(size);
    rewind(file);
    if (fread(model, 1, size, file) != size) return 2;
    fclose(file);
    state = strtoull(words[2], NULL, 10);
    long refused = 0, ran = 0;
    for (long round = strtol(words[3], NULL, 10); round > 0; round--) {
        /* of exactly its size, so that a byte beyond it is noticed */
        unsigned char *changed = malloc(size);
        memcpy(changed, model, size);
        const size_t left = damage(changed, size, size);
        unsigned char *exact = malloc(left ? left : 1);
        memcpy(exact, changed, left);
        ldsim_model *loaded;
        if (ldsim_load(exact, left, &loaded) == LDSIM_OK) ran++, host(loaded), ldsim_free(loaded);
        else refused++;
        free(exact), free(changed);
    }
    free(model);
    printf("%ld %ld\n", refused, ran);
    return 0;
}
