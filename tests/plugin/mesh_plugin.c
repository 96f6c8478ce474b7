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

static double number(const MarramValues* values, const char* name) {
    for (uint32_t i = 0; i < values->count; ++i) {
        const MarramValue* value = MARRAM_AT(MarramValue, values->first, values->stride, i);
        if (strcmp(value->name, name) == 0) return value->numbers[0];
    }
    return 0.0;
}

static void say(const MarramHost* host, MarramSeverity severity, const char* id, const char* what,
                const char* remedy) {
    MarramMessage message;
    memset(&message, 0, sizeof message);
    message.size = sizeof message;
    message.severity = severity;
    message.id = id;
    message.place = "";
    message.what = what;
    message.remedy = remedy;
    host->message(host->user, &message);
}

static MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    MarramInstance* instance = malloc(sizeof *instance);
    if (!instance) return MARRAM_ERROR;
    instance->host = host;
    instance->as_lent = *host;
    instance->base = number(values, "base");
    instance->height = number(values, "height");
    *out = instance;
    return MARRAM_OK;
}

static MarramStatus begin(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    const MarramHost *now = instance->host, *then = &instance->as_lent;
    if (now->user != then->user || now->message != then->message || now->cancelled != then->cancelled) {
        say(then, MARRAM_FAULT, "pyramid.host", "the host is gone before destroy", "keep it");
        return MARRAM_ERROR;
    }
    if (frame->colliders || frame->mesh_count > 0) { /* the contract: it names no mesh, so it gets none */
        say(now, MARRAM_FAULT, "pyramid.colliders", "meshes are lent that it does not name", "lend none");
        return MARRAM_ERROR;
    }
    out->kind = MARRAM_MESH;
    out->time_count = 1;
    out->vertex_count = 5;
    out->triangle_count = 6;
    out->has_uvs = 1;
    say(now, MARRAM_INFO, "pyramid.made", "a pyramid is being made", "");
    return MARRAM_OK;
}

static MarramStatus mesh(MarramInstance* instance, MarramMeshBuffers* buffers) {
    float* positions = buffers->positions[0];
    static const float corners[4][2] = {
        {-0.5F, 0.5F}, {0.5F, 0.5F}, {0.5F, -0.5F}, {-0.5F, -0.5F}}; /* x, z */
    static const uint32_t triangles[18] = {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4, 0, 2, 1, 0, 3, 2};
    for (int i = 0; i < 4; ++i) {
        positions[3 * i] = (float)(instance->base * corners[i][0]);
        positions[3 * i + 1] = 0.0F;
        positions[3 * i + 2] = (float)(instance->base * corners[i][1]);
        buffers->uvs[2 * i] = corners[i][0] + 0.5F;
        buffers->uvs[2 * i + 1] = 0.5F - corners[i][1];
    }
    positions[12] = positions[14] = 0.0F;
    positions[13] = (float)instance->height;
    buffers->uvs[8] = buffers->uvs[9] = 0.5F;
    memcpy(buffers->triangles, triangles, sizeof triangles);
    return MARRAM_OK;
}

static void report(MarramInstance* instance, void (*sink)(void*, const char*, double), void* user) {
    (void)instance;
    sink(user, "memory.bytes", (double)sizeof(MarramInstance));
}

static void destroy(MarramInstance* instance) { free(instance); }

const MarramLibrary* marram_library(uint32_t abi);
const MarramLibrary* marram_library(uint32_t abi) {
    static const MarramProcedural procedurals[] = {{"pyramid", "a pyramid", MARRAM_MESH, params, 2,
                                                    sizeof(MarramParam), NULL, 0, 0, create, begin, NULL,
                                                    NULL, mesh, report, destroy}};
    static const MarramReportEntry entries[] = {
        {"memory.bytes", "bytes", MARRAM_SUM, NULL, NULL, "of all pyramids' instances"}};
    static const MarramLibrary library = {
        MARRAM_ABI_VERSION, 0, sizeof library,      "mesh_plugin", "1", NULL,           0, 0,
        procedurals,        1, sizeof *procedurals, entries,       1,   sizeof *entries};
    return abi == MARRAM_ABI_VERSION ? &library : NULL;
}
