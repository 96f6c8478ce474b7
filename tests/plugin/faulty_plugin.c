/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Procedurals that break the contract, each in the way that its parameter `fault` selects. Built as is, and
 * with one of
 *   NO_ENTRY_POINT   nothing is exported
 *   OTHER_ABI        the table gives another version
 *   OTHER_EMBREE     the table says that it was built with another Embree
 *   REFUSES          the entry point accepts no version
 */
#define _POSIX_C_SOURCE 199309L
#include "core/plugin/marram_plugin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { curves_a_patch = 4, slow_patches = 1000 };

struct MarramInstance {
    char fault[32];
};

#define CURVE_FAULTS                                                                                         \
    "none|silent-create|silent-begin|silent-tessellate|nan|infinite|one-cv|shape|times|too-many|too-few|"    \
    "gap|mesh|lies|"                                                                                              \
    "deaf|stuck"
#define MESH_FAULTS "none|silent-mesh|nan|index|curves|empty"

static const MarramParam curve_params[] = {
    {"fault", MARRAM_CHOICE, "", "none", 0, 0, CURVE_FAULTS, "what goes wrong"}};
static const MarramParam mesh_params[] = {
    {"fault", MARRAM_CHOICE, "", "none", 0, 0, MESH_FAULTS, "what goes wrong"}};

static int is(const MarramInstance* instance, const char* fault) {
    return strcmp(instance->fault, fault) == 0;
}

static MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    (void)host;
    MarramInstance* instance = calloc(1, sizeof *instance);
    if (!instance) return MARRAM_ERROR;
    if (values->count > 0) strncpy(instance->fault, values->first->text, sizeof instance->fault - 1);
    if (is(instance, "silent-create")) {
        free(instance);
        return MARRAM_ERROR;
    }
    *out = instance;
    return MARRAM_OK;
}

static MarramStatus begin_curves(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    if (is(instance, "silent-begin")) return MARRAM_ERROR;
    out->kind = is(instance, "mesh") ? MARRAM_MESH : MARRAM_CURVES;
    out->patch_count = is(instance, "deaf") ? slow_patches : is(instance, "stuck") ? 1 : 3;
    out->curve_count = (uint64_t)out->patch_count * curves_a_patch;
    if (is(instance, "too-many")) out->curve_count -= 1;
    if (is(instance, "too-few")) out->curve_count += 1;
    out->cvs_per_curve = is(instance, "one-cv") ? 1 : 4;
    out->time_count = is(instance, "times") ? frame->time_count + 1 : 1;
    out->basis = MARRAM_BSPLINE;
    out->shape = is(instance, "shape") ? MARRAM_SHAPE_COUNT : MARRAM_ROUND;
    return MARRAM_OK;
}

static MarramStatus patch(MarramInstance* instance, uint32_t index, MarramPatch* out) {
    out->first_curve = (uint64_t)index * curves_a_patch + (is(instance, "gap") && index == 1 ? 1 : 0);
    out->curve_count = curves_a_patch;
    for (int axis = 0; axis < 3; ++axis) {
        out->lower[axis] = -1e4F;
        out->upper[axis] = is(instance, "lies") ? 2.0F : 1e4F; /* its curves are up to 12 m away */
    }
    return MARRAM_OK;
}

static void pause_for(time_t seconds, long nanoseconds) {
    struct timespec duration;
    duration.tv_sec = seconds;
    duration.tv_nsec = nanoseconds;
    nanosleep(&duration, NULL);
}

static MarramStatus tessellate(MarramInstance* instance, uint32_t index, const MarramPatchBuffers* buffers) {
    if (is(instance, "silent-tessellate")) return MARRAM_ERROR;
    if (is(instance, "deaf")) pause_for(0, 10000000L); /* both should ask the host whether to continue */
    if (is(instance, "stuck")) pause_for(600, 0);
    for (int c = 0; c < curves_a_patch; ++c)
        for (int k = 0; k < 6; ++k) {
            float* v = buffers->vertices[0] + 4 * (6 * c + k);
            v[0] = (float)(index * curves_a_patch + (uint32_t)c);
            v[1] = (float)(k - 1);
            v[2] = 0.0F;
            v[3] = 0.01F;
        }
    if (is(instance, "nan") && index == 2) buffers->vertices[0][4 * (6 * 3 + 2) + 1] = NAN;
    if (is(instance, "infinite") && index == 1) buffers->vertices[0][4 * 5 + 3] = INFINITY;
    return MARRAM_OK;
}

static MarramStatus begin_mesh(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    (void)frame;
    out->time_count = 1;
    out->kind = is(instance, "curves") ? MARRAM_CURVES : MARRAM_MESH;
    out->vertex_count = is(instance, "empty") ? 0 : 3;
    out->triangle_count = is(instance, "empty") ? 0 : 1;
    return MARRAM_OK;
}

static MarramStatus mesh(MarramInstance* instance, MarramMeshBuffers* buffers) {
    static const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    if (is(instance, "silent-mesh")) return MARRAM_ERROR;
    if (is(instance, "empty")) return MARRAM_OK;
    memcpy(buffers->positions[0], positions, sizeof positions);
    for (uint32_t i = 0; i < 3; ++i) buffers->triangles[i] = i;
    if (is(instance, "nan")) buffers->positions[0][4] = NAN;
    if (is(instance, "index")) buffers->triangles[2] = 3;
    return MARRAM_OK;
}

static void destroy(MarramInstance* instance) { free(instance); }

static const MarramProcedural procedurals[] = {
    {"faulty_curves", "curves that break the contract", MARRAM_CURVES, curve_params, 1, sizeof(MarramParam),
     NULL, 0, 0, create, begin_curves, patch, tessellate, NULL, NULL, destroy},
    {"faulty_mesh", "a mesh that breaks the contract", MARRAM_MESH, mesh_params, 1, sizeof(MarramParam), NULL,
     0, 0, create, begin_mesh, NULL, NULL, mesh, NULL, destroy},
    {"no_destroy", "a mesh that nobody can get rid of", MARRAM_MESH, mesh_params, 1, sizeof(MarramParam),
     NULL, 0, 0, create, begin_mesh, NULL, NULL, mesh, NULL, NULL},
};

#if defined(OTHER_EMBREE)
#define EMBREE (MARRAM_EMBREE_MAJOR + 1)
#else
#define EMBREE MARRAM_EMBREE_MAJOR
#endif

#if defined(OTHER_ABI)
#define TABLE_ABI (MARRAM_ABI_VERSION + 1)
#else
#define TABLE_ABI MARRAM_ABI_VERSION
#endif

#if defined(REFUSES)
#define SPEAKS 0
#else
#define SPEAKS 1
#endif

#if defined(NO_ENTRY_POINT)
#define ENTRY_POINT some_other_function
#else
#define ENTRY_POINT marram_library
#endif

const MarramLibrary* ENTRY_POINT(uint32_t abi);
const MarramLibrary* ENTRY_POINT(uint32_t abi) {
    static const MarramLibrary library = {TABLE_ABI,
                                          EMBREE,
                                          sizeof library,
                                          "faulty_plugin",
                                          "1",
                                          NULL,
                                          0,
                                          0,
                                          procedurals,
                                          3,
                                          sizeof *procedurals,
                                          NULL,
                                          0,
                                          0};
    (void)abi;
    return SPEAKS ? &library : NULL;
}
