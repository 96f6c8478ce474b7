/* SPDX-License-Identifier: Apache-2.0 */
/* A procedural that makes a mesh: a pyramid on a square base, facing outwards, with uvs. As small as the
 * contract allows. */
#include "core/plugin/marram_plugin.h"

#include <stdlib.h>
#include <string.h>

struct MarramInstance {
    const MarramHost* host; /* lent from create to destroy */
    MarramHost as_lent;
    double base, height;
};

static const MarramParam params[] = {
    {"base", MARRAM_NUMBER, "m", "2", 1e-3, 1e6, "", "side of the square it stands on"},
    {"height", MARRAM_NUMBER, "m", "1", 1e-3, 1e6, "", "of the apex"},
};

static double number(const MarramValue* values, uint32_t count, const char* name) {
    for (uint32_t i = 0; i < count; ++i)
        if (strcmp(values[i].name, name) == 0) return values[i].numbers[0];
    return 0.0;
}

static MarramStatus create(const MarramHost* host, const MarramValue* values, uint32_t count,
                           MarramInstance** out) {
    MarramInstance* instance = malloc(sizeof *instance);
    if (!instance) return MARRAM_ERROR;
    instance->host = host;
    instance->as_lent = *host;
    instance->base = number(values, count, "base");
    instance->height = number(values, count, "height");
    *out = instance;
    return MARRAM_OK;
}

static MarramStatus begin(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    const MarramHost *now = instance->host, *then = &instance->as_lent;
    if (now->user != then->user || now->message != then->message || now->cancelled != then->cancelled) {
        then->message(then->user, MARRAM_FAULT, "", "the host is gone before destroy: keep it");
        return MARRAM_ERROR;
    }
    if (frame->colliders) { /* the contract: NULL while meshes are being made */
        now->message(now->user, MARRAM_FAULT, "", "there are colliders already: make meshes first");
        return MARRAM_ERROR;
    }
    memset(out, 0, sizeof *out);
    out->kind = MARRAM_MESH;
    out->vertex_count = 5;
    out->triangle_count = 6;
    out->has_uvs = 1;
    now->message(now->user, MARRAM_INFO, "", "a pyramid is being made");
    return MARRAM_OK;
}

static MarramStatus mesh(MarramInstance* instance, const MarramMeshBuffers* buffers) {
    static const float corners[4][2] = {
        {-0.5F, 0.5F}, {0.5F, 0.5F}, {0.5F, -0.5F}, {-0.5F, -0.5F}}; /* x, z */
    static const uint32_t triangles[18] = {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4, 0, 2, 1, 0, 3, 2};
    for (int i = 0; i < 4; ++i) {
        buffers->positions[3 * i] = (float)(instance->base * corners[i][0]);
        buffers->positions[3 * i + 1] = 0.0F;
        buffers->positions[3 * i + 2] = (float)(instance->base * corners[i][1]);
        buffers->uvs[2 * i] = corners[i][0] + 0.5F;
        buffers->uvs[2 * i + 1] = 0.5F - corners[i][1];
    }
    buffers->positions[12] = buffers->positions[14] = 0.0F;
    buffers->positions[13] = (float)instance->height;
    buffers->uvs[8] = buffers->uvs[9] = 0.5F;
    memcpy(buffers->triangles, triangles, sizeof triangles);
    return MARRAM_OK;
}

static MarramStatus no_patch(MarramInstance* instance, uint32_t index, MarramPatch* out) {
    (void)instance;
    (void)index;
    (void)out;
    return MARRAM_ERROR;
}

static MarramStatus no_curves(MarramInstance* instance, uint32_t index, const MarramPatchBuffers* buffers) {
    (void)instance;
    (void)index;
    (void)buffers;
    return MARRAM_ERROR;
}

static void report(MarramInstance* instance, void (*sink)(void*, const char*, double), void* user) {
    (void)instance;
    sink(user, "memory.bytes", (double)sizeof(MarramInstance));
}

static void destroy(MarramInstance* instance) { free(instance); }

const MarramLibrary* marram_library(uint32_t abi);
const MarramLibrary* marram_library(uint32_t abi) {
    static const MarramProcedural procedurals[] = {{"pyramid", "a pyramid", MARRAM_MESH, params, 2, NULL, 0,
                                                    create, begin, no_patch, no_curves, mesh, report,
                                                    destroy}};
    static const MarramLibrary library = {MARRAM_ABI_VERSION, "mesh_plugin", "1", NULL, 0, procedurals, 1};
    return abi == MARRAM_ABI_VERSION ? &library : NULL;
}
