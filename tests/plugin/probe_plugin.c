/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A procedural that reports what it is given: its values by name, and the poses of the first mesh (its first
 * vertex and normal at the frame `pose_at`, and whether they exist). It also reports made-up seconds and
 * counts, `report` times as many, and makes one straight curve.
 */
#include "core/plugin/marram_plugin.h"

#include <stdlib.h>
#include <string.h>

enum { most_values = 64, most_name = 64, most_floats = 3 * 4096 };

struct MarramInstance {
    char names[most_values][most_name];
    double numbers[most_values][12]; /* the first numbers, then their count and the text's length */
    uint32_t value_count;
    float positions[most_floats], normals[most_floats];
};

enum { number_count_at = 10, text_length_at = 11 };

#define WIND_PARAMS(prefix)                                                                                  \
    {prefix "plain", MARRAM_NUMBER, "", "1", -1e6, 1e6, "", "a number"},                                     \
        {prefix "balls[].size", MARRAM_NUMBER, "m", "2", 0, 1e6, "", "a number of each"},                    \
        {prefix "balls[].keys", MARRAM_KEYS, "", "{}", 0, 0, "", "a transform of each"}, {                   \
        prefix "balls[].maybe", MARRAM_NUMBER, "", "none", -1e6, 1e6, "", "of those that have it"            \
    }

static const MarramParam wind_params[] = {WIND_PARAMS("")};
static const MarramParam params[] = {
    {"pose_at", MARRAM_NUMBER, "frames", "0", -1e6, 1e6, "", "when to look at the first mesh"},
    {"report", MARRAM_NUMBER, "", "1", 0, 1e6, "", "factor on the made-up counts"},
    {"own[].number", MARRAM_NUMBER, "", "3", -1e6, 1e6, "", "a list of its own"},
    WIND_PARAMS("wind."),
};

static MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    (void)host;
    MarramInstance* instance = calloc(1, sizeof *instance);
    if (!instance || values->count > most_values) return MARRAM_ERROR;
    for (uint32_t i = 0; i < values->count; ++i) {
        const MarramValue* value = MARRAM_AT(MarramValue, values->first, values->stride, i);
        double* numbers = instance->numbers[i];
        strncpy(instance->names[i], value->name, most_name - 1);
        for (size_t k = 0; k < value->number_count && k < number_count_at; ++k)
            numbers[k] = value->numbers[k];
        numbers[number_count_at] = (double)value->number_count;
        numbers[text_length_at] = (double)strlen(value->text);
    }
    instance->value_count = values->count;
    *out = instance;
    return MARRAM_OK;
}

static double number(const MarramInstance* instance, const char* name) {
    for (uint32_t i = 0; i < instance->value_count; ++i)
        if (strcmp(instance->names[i], name) == 0) return instance->numbers[i][0];
    return 0.0;
}

static MarramStatus begin(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    const double when = number(instance, "pose_at");
    if (frame->mesh_count > 0 && 3 * frame->meshes[0].vertex_count <= most_floats) {
        if (frame->pose(frame->pose_user, 0, when, instance->positions, NULL) != MARRAM_OK)
            return MARRAM_ERROR;
        if (frame->pose(frame->pose_user, 0, when, instance->positions, instance->normals) != MARRAM_OK)
            return MARRAM_ERROR;
    }
    out->kind = MARRAM_CURVES;
    out->curve_count = out->patch_count = out->time_count = 1;
    out->cvs_per_curve = 2;
    return MARRAM_OK;
}

static MarramStatus patch(MarramInstance* instance, uint32_t index, MarramPatch* out) {
    (void)instance;
    (void)index;
    out->curve_count = 1;
    out->upper[1] = 2.0F;
    return MARRAM_OK;
}

static MarramStatus tessellate(MarramInstance* instance, uint32_t index, const MarramPatchBuffers* buffers) {
    (void)instance;
    (void)index;
    for (int k = 0; k < 4; ++k) {
        float* v = buffers->vertices[0] + 4 * k;
        v[0] = v[2] = 0.0F;
        v[1] = (float)k - 1.0F;
        v[3] = 0.01F;
    }
    return MARRAM_OK;
}

static void report(MarramInstance* instance, void (*sink)(void*, const char*, double), void* user) {
    static const char* const stages[] = {"expand", "gusts", "shield", "bend", "jiggle", "collide"};
    static const char* const counts[] = {"contacts", "pushed_out",   "unresolved", "targets_not_raised",
                                         "dips",     "turned_angle", "goal_angle"};
    static const char* const axes[] = {"x", "y", "z"};
    char key[64];
    const double factor = number(instance, "report");
    for (int i = 0; i < 6 && factor > 0.0; ++i)
        sink(user, strcat(strcpy(key, "thread_seconds."), stages[i]), i + 1.0);
    for (int i = 0; i < 7 && factor > 0.0; ++i)
        sink(user, strcat(strcpy(key, "collision."), counts[i]), factor * (i + 2.0));
    for (uint32_t i = 0; i < instance->value_count; ++i) {
        sink(user, strcat(strcpy(key, "value."), instance->names[i]), instance->numbers[i][0]);
        sink(user, strcat(strcpy(key, "numbers."), instance->names[i]),
             instance->numbers[i][number_count_at]);
        sink(user, strcat(strcpy(key, "letters."), instance->names[i]), instance->numbers[i][text_length_at]);
    }
    for (int axis = 0; axis < 3; ++axis) {
        sink(user, strcat(strcpy(key, "position."), axes[axis]), (double)instance->positions[axis]);
        sink(user, strcat(strcpy(key, "normal."), axes[axis]), (double)instance->normals[axis]);
    }
}

static void destroy(MarramInstance* instance) { free(instance); }

static const MarramProcedural procedurals[] = {
    {"probe", "says what it is given", MARRAM_CURVES, params, sizeof params / sizeof *params, sizeof *params,
     NULL, 0, 0, create, begin, patch, tessellate, NULL, report, destroy},
};

static const MarramReportEntry entries[] = {
    {"thread_seconds.expand", "thread s", MARRAM_SUM, NULL, NULL, ""},
    {"collision.turned_angle", "rad", MARRAM_SUM, NULL, NULL, ""},
    {"collision.goal_angle", "rad", MARRAM_SUM, NULL, NULL, ""},
    {"collision.reached", "1", MARRAM_RATIO, "collision.turned_angle", "collision.goal_angle", ""},
    {"value.pose_at", "frames", MARRAM_EACH, NULL, NULL, ""},
    {"value.report", "1", MARRAM_MAXIMUM, NULL, NULL, ""},
    {"value.wind.plain", "1", MARRAM_LAST, NULL, NULL, ""},
};

const MarramLibrary* marram_library(uint32_t abi);
const MarramLibrary* marram_library(uint32_t abi) {
    static const MarramLibrary library = {MARRAM_ABI_VERSION,
                                          MARRAM_EMBREE_MAJOR,
                                          sizeof library,
                                          "probe_plugin",
                                          "1",
                                          wind_params,
                                          sizeof wind_params / sizeof *wind_params,
                                          sizeof *wind_params,
                                          procedurals,
                                          1,
                                          sizeof *procedurals,
                                          entries,
                                          sizeof entries / sizeof *entries,
                                          sizeof *entries};
    return abi == MARRAM_ABI_VERSION ? &library : NULL;
}
