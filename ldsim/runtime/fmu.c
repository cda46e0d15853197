/* A model of ldsim as a functional mock-up unit for co-simulation (FMI 2.0.4 and 3.0.2; FMI says which, 2 or 3).
 *
 * GRABS grabs and TRACKS tracked points; what each value reference means stands in ldsim/export/fmu.py, which writes the
 * modelDescription.xml. A communication step takes as many steps of the model as end within it. */
#include "ldsim.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

enum { OK, WARNING, DISCARD, ERROR };
enum { GRABS = 4, TRACKS = 4, GRAVITY = 1, NOVELTY = 4, GRAB = 100, TRACK = 300, PER_GRAB = 20, PER_TRACK = 10 };

typedef uint32_t reference;
#if FMI == 2
typedef int boolean;
typedef void (*logger)(void *environment, const char *instance, int status, const char *category, const char *message, ...);
typedef struct {
    logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} callbacks;
#else
typedef _Bool boolean;
typedef void (*logger)(void *environment, int status, const char *category, const char *message);
#endif

/* What a master sets and what follows from it; all that a saved state holds beside the solid. */
typedef struct {
    double gravity[3], start, time; /* time: the communication point that was reached */
    struct {
        int32_t held;
        uint32_t id; /* 0 where nothing is held */
        double target[3], point[3], stiffness, radius;
    } grab[GRABS];
    double at[TRACKS][3];
    uint32_t vertex[TRACKS];
    int64_t steps; /* taken since the start */
    int32_t initialised; /* from then on what is tracked is fixed */
} settings;

typedef struct {
    ldsim_model *model;
    ldsim_solid *solid;
    ldsim_info info;
    settings now;
    logger log;
    void *environment;
    char name[64];
} unit;

typedef struct {
    settings now;
    size_t size;
    unsigned char solid[];
} saved;

static int say(const unit *u, int status, const char *message)
{
#if FMI == 2
    if (u->log) u->log(u->environment, u->name, status, "logStatusError", "%s", message);
#else
    if (u->log) u->log(u->environment, status, "logStatusError", message);
#endif
    return status;
}

/* ---- Values ------------------------------------------------------------------------------------------------------ */

/* Where a number that may be set is kept, NULL where there is none. */
static double *input(unit *u, reference r)
{
    if (r >= GRAVITY && r < GRAVITY + 3) return u->now.gravity + (r - GRAVITY);
    if (r >= GRAB && r < GRAB + GRABS * PER_GRAB) {
        const reference g = (r - GRAB) / PER_GRAB, i = (r - GRAB) % PER_GRAB;
        if (i >= 1 && i <= 3) return u->now.grab[g].target + (i - 1);
        if (i >= 4 && i <= 6) return u->now.grab[g].point + (i - 4);
        if (i == 7) return &u->now.grab[g].stiffness;
        if (i == 8) return &u->now.grab[g].radius;
    }
    if (r >= TRACK && r < TRACK + TRACKS * PER_TRACK && (r - TRACK) % PER_TRACK < 3)
        return u->now.at[(r - TRACK) / PER_TRACK] + (r - TRACK) % PER_TRACK;
    return NULL;
}

static int value(unit *u, reference r, double *found)
{
    const double *kept = input(u, r);
    double three[3] = {0.0, 0.0, 0.0};
    if (kept) *found = *kept;
    else if (r == 0) *found = u->now.time;
    else if (r == NOVELTY) {
        *found = ldsim_novelty(u->solid);
        if (!(*found >= 0.0)) *found = -1.0; /* a model that does not tell */
    } else if (r >= GRAB && r < GRAB + GRABS * PER_GRAB && (r - GRAB) % PER_GRAB >= 9 && (r - GRAB) % PER_GRAB < 12) {
        const uint32_t id = u->now.grab[(r - GRAB) / PER_GRAB].id;
        if (id) ldsim_force(u->solid, id, three);
        *found = three[(r - GRAB) % PER_GRAB - 9];
    } else if (r >= TRACK && r < TRACK + TRACKS * PER_TRACK && (r - TRACK) % PER_TRACK < 6) {
        const uint32_t vertex = u->now.vertex[(r - TRACK) / PER_TRACK], axis = (r - TRACK) % PER_TRACK - 3;
        ldsim_displacement(u->solid, &vertex, 1, three);
        *found = ldsim_rest(u->model)[3 * (size_t)vertex + axis] + three[axis];
    } else return say(u, ERROR, "there is no such number");
    return OK;
}

static int get_numbers(unit *u, const reference r[], size_t count, double values[])
{
    for (size_t i = 0; i < count; i++)
        if (value(u, r[i], values + i) != OK) return ERROR;
    return OK;
}

/* The vertices nearest to where points are to be tracked. */
static void track(unit *u)
{
    const double *x = ldsim_rest(u->model);
    for (int t = 0; t < TRACKS; t++) {
        double least = INFINITY;
        for (uint32_t v = 0; v < u->info.vertices; v++) {
            double away = 0.0;
            for (int i = 0; i < 3; i++) away += (x[3 * v + i] - u->now.at[t][i]) * (x[3 * v + i] - u->now.at[t][i]);
            if (away < least) least = away, u->now.vertex[t] = v;
        }
    }
}

static int set_numbers(unit *u, const reference r[], size_t count, const double values[])
{
    int tracked = 0;
    for (size_t i = 0; i < count; i++) {
        double *kept = input(u, r[i]);
        if (!kept) return say(u, ERROR, "there is no such number, or it is an output");
        if (!isfinite(values[i])) return say(u, ERROR, "a number is not finite");
        if (r[i] >= TRACK && u->now.initialised) return say(u, ERROR, "what is tracked is fixed once the unit is initialised");
        *kept = values[i], tracked |= r[i] >= TRACK;
    }
    if (tracked) track(u);
    return OK;
}

static int32_t *held(unit *u, reference r)
{
    const int fine = r >= GRAB && r < GRAB + GRABS * PER_GRAB && (r - GRAB) % PER_GRAB == 0;
    return fine ? &u->now.grab[(r - GRAB) / PER_GRAB].held : NULL;
}

static int get_booleans(unit *u, const reference r[], size_t count, boolean values[])
{
    for (size_t i = 0; i < count; i++) {
        const int32_t *kept = held(u, r[i]);
        if (!kept) return say(u, ERROR, "there is no such boolean");
        values[i] = *kept != 0;
    }
    return OK;
}

static int set_booleans(unit *u, const reference r[], size_t count, const boolean values[])
{
    for (size_t i = 0; i < count; i++) {
        int32_t *kept = held(u, r[i]);
        if (!kept) return say(u, ERROR, "there is no such boolean");
        *kept = values[i] != 0;
    }
    return OK;
}

/* ---- Life -------------------------------------------------------------------------------------------------------- */

/* Back to rest; what is held at first is nothing, and point and target of a grab and the tracked points lie at the
 * vertex farthest from the first pinned one, or from the first vertex. */
static void begin(unit *u)
{
    const double *x = ldsim_rest(u->model);
    const uint32_t *movable = ldsim_movable(u->model);
    uint32_t from = 0, far = 0;
    double most = -1.0;
    for (uint32_t v = u->info.vertices; v-- > 0;)
        if (!movable[v]) from = v;
    for (uint32_t v = 0; v < u->info.vertices; v++) {
        double away = 0.0;
        for (int i = 0; i < 3; i++) away += (x[3 * v + i] - x[3 * from + i]) * (x[3 * v + i] - x[3 * from + i]);
        if (away > most) most = away, far = v;
    }
    ldsim_reset(u->solid);
    memset(&u->now, 0, sizeof u->now);
    memcpy(u->now.gravity, u->info.gravity, sizeof u->now.gravity);
    for (int g = 0; g < GRABS; g++)
        for (int i = 0; i < 3; i++) u->now.grab[g].point[i] = u->now.grab[g].target[i] = x[3 * far + i];
    for (int t = 0; t < TRACKS; t++)
        for (int i = 0; i < 3; i++) u->now.at[t][i] = x[3 * far + i];
    track(u);
}

static void end(unit *u)
{
    if (!u) return;
    if (u->solid) ldsim_destroy(u->solid);
    if (u->model) ldsim_free(u->model);
    free(u);
}

static unit *create(const char *name, const char *resources, logger log, void *environment)
{
    unit *u = calloc(1, sizeof *u);
    if (!u) return NULL;
    u->log = log, u->environment = environment;
    snprintf(u->name, sizeof u->name, "%s", name ? name : "");
    const size_t room = (resources ? strlen(resources) : 0) + 16;
    char *path = malloc(room);
    int code = path ? LDSIM_OK : LDSIM_NO_MEMORY;
    if (code == LDSIM_OK) {
        const char *end_of = resources && *resources ? resources + strlen(resources) - 1 : "";
        snprintf(path, room, "%s%smodel.ldsim", resources ? resources : "", *end_of == '/' || *end_of == '\\' ? "" : "/");
        code = ldsim_load_file(path, &u->model);
    }
    free(path);
    if (code == LDSIM_OK) code = ldsim_create(u->model, GRABS, &u->solid);
    if (code != LDSIM_OK) {
        say(u, ERROR, ldsim_message(code));
        end(u);
        return NULL;
    }
    ldsim_describe(u->model, &u->info);
    begin(u);
    return u;
}

/* Takes hold, moves and lets go as the inputs say. */
static int pull(unit *u)
{
    int code = ldsim_set_gravity(u->solid, u->now.gravity);
    for (int g = 0; g < GRABS && code == LDSIM_OK; g++) {
        uint32_t *id = &u->now.grab[g].id;
        if (u->now.grab[g].held && *id) code = ldsim_move(u->solid, *id, u->now.grab[g].target);
        else if (u->now.grab[g].held)
            code = ldsim_grab(u->solid, u->now.grab[g].point, u->now.grab[g].target, u->now.grab[g].stiffness,
                              u->now.grab[g].radius, id);
        else if (*id) code = ldsim_release(u->solid, *id), *id = 0;
    }
    return code == LDSIM_OK ? OK : say(u, ERROR, ldsim_message(code));
}

static int advance(unit *u, double time, double step)
{
    const double ends = floor((time + step - u->now.start) / u->info.time_step + 1e-6);
    if (!(step >= 0.0) || !(ends < 9e15)) return say(u, ERROR, "the time or the step is out of range");
    if (pull(u) != OK) return ERROR;
    ldsim_outcome worst = LDSIM_SOLVED;
    for (; (double)u->now.steps < ends; u->now.steps++) {
        const ldsim_outcome outcome = ldsim_step(u->solid, NULL);
        if (outcome > worst) worst = outcome;
    }
    u->now.time = time + step;
    return worst <= LDSIM_SHORT ? OK : say(u, WARNING, "a step was slowed or held: the pull is too hard for the model");
}

/* ---- Saved states ------------------------------------------------------------------------------------------------ */

static int keep(unit *u, void **state)
{
    const size_t size = ldsim_state_size(u->solid);
    saved *kept = malloc(sizeof *kept + size);
    if (!kept) return say(u, ERROR, ldsim_message(LDSIM_NO_MEMORY));
    memset(kept, 0, sizeof *kept);
    kept->now = u->now, kept->size = size;
    ldsim_save(u->solid, kept->solid);
    free(*state);
    *state = kept;
    return OK;
}

static int back(unit *u, const void *state)
{
    const saved *kept = state;
    const int code = kept ? ldsim_restore(u->solid, kept->solid, kept->size) : LDSIM_BAD_ARGUMENT;
    if (code != LDSIM_OK) return say(u, ERROR, ldsim_message(code));
    u->now = kept->now;
    return OK;
}

static int serialised_size(const void *state, size_t *size)
{
    *size = sizeof(saved) + ((const saved *)state)->size;
    return OK;
}

static int serialise(unit *u, const void *state, unsigned char *bytes, size_t size)
{
    size_t whole;
    serialised_size(state, &whole);
    if (size < whole) return say(u, ERROR, "there is not enough room for the state");
    memcpy(bytes, state, whole);
    return OK;
}

static int deserialise(unit *u, const unsigned char *bytes, size_t size, void **state)
{
    saved head;
    if (size < sizeof head) return say(u, ERROR, ldsim_message(LDSIM_OTHER_MODEL));
    memcpy(&head, bytes, sizeof head);
    if (head.size != size - sizeof head) return say(u, ERROR, ldsim_message(LDSIM_OTHER_MODEL));
    for (int t = 0; t < TRACKS; t++)
        if (head.now.vertex[t] >= u->info.vertices) return say(u, ERROR, ldsim_message(LDSIM_OTHER_MODEL));
    void *kept = malloc(size);
    if (!kept) return say(u, ERROR, ldsim_message(LDSIM_NO_MEMORY));
    *state = memcpy(kept, bytes, size);
    return OK;
}

static int none(unit *u) { return say(u, ERROR, "this unit has nothing of that kind"); }

/* ---- The interfaces ---------------------------------------------------------------------------------------------- */

#define API(name) EXPORTED int NAME(name)
#if FMI == 2
#define NAME(name) fmi2##name
#else
#define NAME(name) fmi3##name
#endif

API(EnterInitializationMode)(
#if FMI == 2
    void *u
#else
    void *u, boolean tolerance_defined, double tolerance, double start, boolean stop_defined, double stop
#endif
)
{
#if FMI == 3
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((unit *)u)->now.start = ((unit *)u)->now.time = start;
#endif
    return (void)u, OK;
}
API(ExitInitializationMode)(void *u) { return ((unit *)u)->now.initialised = 1, OK; }
API(Terminate)(void *u) { return (void)u, OK; }
API(Reset)(void *u) { return begin(u), OK; }
EXPORTED void NAME(FreeInstance)(void *u) { end(u); }

#if FMI == 2
EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }
API(SetDebugLogging)(void *u, boolean on, size_t count, const char *const names[])
{
    return (void)u, (void)on, (void)count, (void)names, OK;
}

/* The bytes that a URI such as file:///a%20b stands for, in place; a % that no two hexadecimal digits follow is itself. */
static void unescape(char *path)
{
    char *to = path;
    for (const char *from = path; *from; to++) {
        const int escaped = *from == '%' && isxdigit((unsigned char)from[1]) && isxdigit((unsigned char)from[2]);
        const char code[3] = {escaped ? from[1] : 0, escaped ? from[2] : 0, 0};
        if (escaped) *to = (char)strtoul(code, NULL, 16), from += 3;
        else *to = *from++;
    }
    *to = 0;
}

/* The path in a URI, in place: after file: there may be a host, which is this machine, or on Windows that of a share. */
static char *path_in(char *uri)
{
    unescape(uri);
    char *path = strncmp(uri, "file:", 5) ? uri : uri + 5;
    char *after = path != uri && strncmp(path, "//", 2) == 0 ? strchr(path + 2, '/') : NULL;
#ifdef _WIN32
    if (after && after != path + 2 && strncmp(path, "//localhost/", 12)) return path;
#endif
    if (after) path = after;
#ifdef _WIN32
    if (path[0] == '/' && path[1] && path[2] == ':') path++;
#endif
    return path;
}

EXPORTED void *fmi2Instantiate(const char *name, int kind, const char *token, const char *resources,
                               const callbacks *calls, boolean visible, boolean logging)
{
    (void)token, (void)visible, (void)logging;
    if (kind != 1 || !calls) return NULL; /* 1: co-simulation */
    char *path = malloc((resources ? strlen(resources) : 0) + 1);
    if (!path) return NULL;
    strcpy(path, resources ? resources : "");
    unit *u = create(name, path_in(path), calls->log, calls->environment);
    free(path);
    return u;
}
API(SetupExperiment)(void *u, boolean defined, double tolerance, double start, boolean stop_defined, double stop)
{
    (void)defined, (void)tolerance, (void)stop_defined, (void)stop;
    return ((unit *)u)->now.start = ((unit *)u)->now.time = start, OK;
}
API(GetReal)(void *u, const reference r[], size_t n, double x[]) { return get_numbers(u, r, n, x); }
API(SetReal)(void *u, const reference r[], size_t n, const double x[]) { return set_numbers(u, r, n, x); }
API(GetBoolean)(void *u, const reference r[], size_t n, boolean x[]) { return get_booleans(u, r, n, x); }
API(SetBoolean)(void *u, const reference r[], size_t n, const boolean x[]) { return set_booleans(u, r, n, x); }
#define NOTHING(name, type)                                                                                            \
    API(Get##name)(void *u, const reference r[], size_t n, type x[]) { return (void)r, (void)x, n ? none(u) : OK; }      \
    API(Set##name)(void *u, const reference r[], size_t n, type const x[]) { return (void)r, (void)x, n ? none(u) : OK; }
NOTHING(Integer, int)
NOTHING(String, const char *)
API(DoStep)(void *u, double time, double step, boolean no_return) { return (void)no_return, advance(u, time, step); }
API(CancelStep)(void *u) { return none(u); }
API(GetDirectionalDerivative)(void *u, const reference a[], size_t n, const reference b[], size_t m, const double x[],
                              double y[])
{
    return (void)a, (void)n, (void)b, (void)m, (void)x, (void)y, none(u);
}
API(SetRealInputDerivatives)(void *u, const reference r[], size_t n, const int order[], const double x[])
{
    return (void)r, (void)n, (void)order, (void)x, none(u);
}
API(GetRealOutputDerivatives)(void *u, const reference r[], size_t n, const int order[], double x[])
{
    return (void)r, (void)n, (void)order, (void)x, none(u);
}
#define STATUS(name, type)                                                                                             \
    API(Get##name)(void *u, int kind, type *x) { return (void)u, (void)kind, (void)x, DISCARD; }
STATUS(Status, int)
STATUS(RealStatus, double)
STATUS(IntegerStatus, int)
STATUS(BooleanStatus, boolean)
STATUS(StringStatus, const char *)
API(GetFMUstate)(void *u, void **state) { return keep(u, state); }
API(SetFMUstate)(void *u, void *state) { return back(u, state); }
API(FreeFMUstate)(void *u, void **state) { return (void)u, free(*state), *state = NULL, OK; }
API(SerializedFMUstateSize)(void *u, void *state, size_t *size) { return (void)u, serialised_size(state, size); }
API(SerializeFMUstate)(void *u, void *state, unsigned char bytes[], size_t size) { return serialise(u, state, bytes, size); }
API(DeSerializeFMUstate)(void *u, const unsigned char bytes[], size_t size, void **state)
{
    return deserialise(u, bytes, size, state);
}
#else
EXPORTED const char *fmi3GetVersion(void) { return "3.0"; }
API(SetDebugLogging)(void *u, boolean on, size_t count, const char *const names[])
{
    return (void)u, (void)on, (void)count, (void)names, OK;
}
EXPORTED void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, boolean visible,
                                           boolean logging, boolean events, boolean early, const reference wanted[],
                                           size_t count, void *environment, logger log, void *update)
{
    (void)token, (void)visible, (void)logging, (void)events, (void)early, (void)wanted, (void)count, (void)update;
    return create(name, resources, log, environment);
}
EXPORTED void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, boolean visible,
                                            boolean logging, void *environment, logger log)
{
    return (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log, NULL;
}
EXPORTED void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                                 boolean visible, boolean logging, void *environment, logger log,
                                                 void *update, void *lock, void *unlock)
{
    (void)update, (void)lock, (void)unlock;
    return (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log, NULL;
}
API(GetFloat64)(void *u, const reference r[], size_t n, double x[], size_t m)
{
    return n == m ? get_numbers(u, r, n, x) : none(u);
}
API(SetFloat64)(void *u, const reference r[], size_t n, const double x[], size_t m)
{
    return n == m ? set_numbers(u, r, n, x) : none(u);
}
API(GetBoolean)(void *u, const reference r[], size_t n, boolean x[], size_t m)
{
    return n == m ? get_booleans(u, r, n, x) : none(u);
}
API(SetBoolean)(void *u, const reference r[], size_t n, const boolean x[], size_t m)
{
    return n == m ? set_booleans(u, r, n, x) : none(u);
}
#define NOTHING(name, type)                                                                                            \
    API(Get##name)(void *u, const reference r[], size_t n, type x[], size_t m)                                         \
    {                                                                                                                  \
        return (void)r, (void)x, (void)m, n ? none(u) : OK;                                                            \
    }                                                                                                                  \
    API(Set##name)(void *u, const reference r[], size_t n, type const x[], size_t m)                                   \
    {                                                                                                                  \
        return (void)r, (void)x, (void)m, n ? none(u) : OK;                                                            \
    }
NOTHING(Float32, float)
NOTHING(Int8, int8_t)
NOTHING(UInt8, uint8_t)
NOTHING(Int16, int16_t)
NOTHING(UInt16, uint16_t)
NOTHING(Int32, int32_t)
NOTHING(UInt32, uint32_t)
NOTHING(Int64, int64_t)
NOTHING(UInt64, uint64_t)
NOTHING(String, const char *)
API(DoStep)(void *u, double time, double step, boolean no_set, boolean *event, boolean *terminate, boolean *early,
            double *reached)
{
    (void)no_set;
    const int status = advance(u, time, step);
    *event = *terminate = *early = 0, *reached = ((unit *)u)->now.time;
    return status;
}
API(EnterEventMode)(void *u) { return none(u); }
API(EnterStepMode)(void *u) { return none(u); }
API(EnterConfigurationMode)(void *u) { return none(u); }
API(ExitConfigurationMode)(void *u) { return none(u); }
API(GetFMUState)(void *u, void **state) { return keep(u, state); }
API(SetFMUState)(void *u, void *state) { return back(u, state); }
API(FreeFMUState)(void *u, void **state) { return (void)u, free(*state), *state = NULL, OK; }
API(SerializedFMUStateSize)(void *u, void *state, size_t *size) { return (void)u, serialised_size(state, size); }
API(SerializeFMUState)(void *u, void *state, unsigned char bytes[], size_t size) { return serialise(u, state, bytes, size); }
API(DeserializeFMUState)(void *u, const unsigned char bytes[], size_t size, void **state)
{
    return deserialise(u, bytes, size, state);
}
/* What a co-simulation never calls; a host may still look for the names. Their further arguments are not looked at. */
#define UNUSED(name)                                                                                                   \
    API(name)(void *u) { return none(u); }
UNUSED(GetBinary)
UNUSED(SetBinary)
UNUSED(GetClock)
UNUSED(SetClock)
UNUSED(GetNumberOfVariableDependencies)
UNUSED(GetVariableDependencies)
UNUSED(GetDirectionalDerivative)
UNUSED(GetAdjointDerivative)
UNUSED(GetIntervalDecimal)
UNUSED(GetIntervalFraction)
UNUSED(GetShiftDecimal)
UNUSED(GetShiftFraction)
UNUSED(SetIntervalDecimal)
UNUSED(SetIntervalFraction)
UNUSED(SetShiftDecimal)
UNUSED(SetShiftFraction)
UNUSED(EvaluateDiscreteStates)
UNUSED(UpdateDiscreteStates)
UNUSED(EnterContinuousTimeMode)
UNUSED(CompletedIntegratorStep)
UNUSED(SetTime)
UNUSED(SetContinuousStates)
UNUSED(GetContinuousStateDerivatives)
UNUSED(GetEventIndicators)
UNUSED(GetContinuousStates)
UNUSED(GetNominalsOfContinuousStates)
UNUSED(GetNumberOfEventIndicators)
UNUSED(GetNumberOfContinuousStates)
UNUSED(GetOutputDerivatives)
UNUSED(ActivateModelPartition)
#endif
