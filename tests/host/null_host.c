/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A foreign host that tests the boundary. It knows the contract and Embree but not the renderer, and traces
 * the output of a procedural library's groom:
 *
 *   null_host build/libmarram_procedural.so
 *
 * The scene is a square of two triangles that moves within the shutter, with hair in the wind.
 */
#include "core/plugin/marram_plugin.h"

#include <dlfcn.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { times = 2, strands = 2000, most_values = 128, most_numbers = 16, spare_floats = 4 };

#define CHECK(condition)                                                                                     \
    do {                                                                                                     \
        if (!(condition)) fail(#condition, __LINE__);                                                        \
    } while (0)

static char last_message[1024], last_id[64], last_place[256];
static unsigned pose_calls, pose_calls_before_message; /* of the last message */
static int cancel_asked;

static void fail(const char* condition, int line) {
    fprintf(stderr, "null_host.c:%d: does not hold: %s\nlast message: %s\n", line, condition, last_message);
    exit(1);
}

static void* allocate(size_t bytes) {
    void* memory = calloc(1, bytes);
    CHECK(memory != NULL);
    return memory;
}

/* ---- What the host provides ---- */

static void on_message(void* user, const MarramMessage* message) {
    (void)user;
    snprintf(last_id, sizeof last_id, "%s", message->id);
    snprintf(last_place, sizeof last_place, "%s", message->place);
    pose_calls_before_message = pose_calls;
    snprintf(last_message, sizeof last_message, "%s: %s", message->what, message->remedy);
}

/* Whether the last message has this id. */
static int last_message_is(const char* id) {
    const int same = strcmp(last_id, id) == 0;
    if (!same) fprintf(stderr, "the last message is %s\n", last_id);
    return same;
}

static void forget_messages(void) { last_message[0] = last_id[0] = last_place[0] = '\0'; }

static int on_cancelled(void* user) {
    (void)user;
    return cancel_asked;
}

static const MarramHost host = {sizeof(MarramHost), NULL, on_message, on_cancelled, NULL};

static const float corners[12] = {-1, 0, 1, 1, 0, 1, 1, 0, -1, -1, 0, -1};
static const float corner_uvs[8] = {0, 0, 1, 0, 1, 1, 0, 1};
static const uint32_t corner_triangles[6] = {0, 1, 2, 0, 2, 3};

/* The square at a frame: it moves along x and up. */
static MarramStatus pose(void* user, uint32_t mesh, double frame, float* positions, float* normals) {
    ++pose_calls;
    (void)user;
    (void)normals; /* it has none */
    if (mesh != 0) return MARRAM_ERROR;
    for (int i = 0; i < 4; ++i) {
        positions[3 * i] = (float)(corners[3 * i] + 0.5 * frame);
        positions[3 * i + 1] = (float)(corners[3 * i + 1] + 0.25 * frame);
        positions[3 * i + 2] = corners[3 * i + 2];
    }
    return MARRAM_OK;
}

static RTCGeometry make_square(RTCDevice device, float positions[times][12 + spare_floats]) {
    RTCGeometry square = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryTimeStepCount(square, times);
    for (unsigned t = 0; t < times; ++t)
        rtcSetSharedGeometryBuffer(square, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT3, positions[t], 0, 12,
                                   4);
    memcpy(rtcSetNewGeometryBuffer(square, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 2),
           corner_triangles, sizeof corner_triangles);
    rtcSetGeometryMask(square, MARRAM_ALL_ROLES | MARRAM_NAMED); /* Embree 4: 1 by default */
    rtcCommitGeometry(square);
    return square;
}

/* ---- Values: the declared defaults, overridden by the scene ---- */

typedef struct Given {
    const char *name, *text;
} Given;

typedef struct Values {
    MarramValue list[most_values];
    double numbers[most_values][most_numbers];
    uint32_t count;
    MarramValues lent;
} Values;

static const MarramValues* lend(Values* values) {
    const MarramValues lent = {sizeof(MarramValues), values->list, values->count, sizeof(MarramValue)};
    values->lent = lent;
    return &values->lent;
}

/* Reads all numbers of a text in order: enough for "[[0, 0.2], [1, 1]]". */
static size_t read_numbers(const char* text, double* numbers) {
    size_t count = 0;
    while (*text) {
        char* end = NULL;
        const double number = strtod(text, &end);
        if (end == text) {
            ++text;
            continue;
        }
        CHECK(count < most_numbers);
        numbers[count++] = number;
        text = end;
    }
    return count;
}

static const char* text_for(const MarramParam* param, const Given* given, size_t given_count) {
    for (size_t i = 0; i < given_count; ++i)
        if (strcmp(given[i].name, param->name) == 0) return given[i].text;
    return param->initial;
}

static void make_values(const MarramProcedural* type, const Given* given, size_t given_count,
                        Values* values) {
    values->count = 0;
    for (uint32_t i = 0; i < type->param_count; ++i) {
        const MarramParam* param = MARRAM_AT(MarramParam, type->params, type->param_stride, i);
        const char* text = text_for(param, given, given_count);
        const int in_list = strstr(param->name, "[].") != NULL; /* lists stay absent */
        if (strcmp(text, "none") == 0 || param->type == MARRAM_UNAVAILABLE || in_list) continue;
        CHECK(*text != '\0' && values->count < most_values);
        const int is_text =
            param->type == MARRAM_CHOICE || param->type == MARRAM_TEXT || param->type == MARRAM_MESH_NAME;
        MarramValue* value = &values->list[values->count];
        double* numbers = values->numbers[values->count++];
        value->name = param->name;
        value->type = param->type;
        value->numbers = numbers;
        value->number_count = is_text ? 0 : read_numbers(text, numbers);
        if (param->type == MARRAM_BOOLEAN) {
            numbers[0] = strcmp(text, "true") == 0;
            value->number_count = 1;
        }
        value->text = is_text ? text : param->type == MARRAM_RAMP ? "linear" : "";
        value->grid = NULL;
        value->place = "null_host";
        value->placement = NULL;
    }
}

static const Given good[] = {{"on", "square"},  {"count", "2000"},   {"length", "[0.1, 0.3]"},
                             {"width", "0.01"}, {"wind.speed", "7"}, {"wind.global_rotate", "1"}};
enum { good_count = sizeof good / sizeof *good };

/* ---- One run of the groom ---- */

typedef struct Curves {
    MarramOutput output;
    MarramPatch* patches;
    float* vertices[times]; /* 4 floats a vertex, cvs + 2 vertices a curve, all patches in a row */
    float *root_uv, *id;    /* 2 and 1 a curve */
} Curves;

static size_t vertex_count(const MarramOutput* output) {
    return output->curve_count * (output->cvs_per_curve + 2);
}

static uint32_t attribute_index(const MarramProcedural* type, const char* name) {
    for (uint32_t i = 0; i < type->attribute_count; ++i)
        if (strcmp(MARRAM_AT(MarramAttribute, type->attributes, type->attribute_stride, i)->name, name) == 0)
            return i;
    fail(name, __LINE__);
    return 0;
}

static void tessellate(const MarramProcedural* type, MarramInstance* instance, Curves* curves,
                       uint32_t patch) {
    const uint64_t first = curves->patches[patch].first_curve;
    const uint32_t attributes[2] = {attribute_index(type, "root_uv"), attribute_index(type, "id")};
    float* vertices[times];
    float* values[2];
    values[0] = curves->root_uv + 2 * first;
    values[1] = curves->id + first;
    for (uint32_t t = 0; t < curves->output.time_count; ++t)
        vertices[t] = curves->vertices[t] + 4 * first * (curves->output.cvs_per_curve + 2);
    const MarramPatchBuffers buffers = {sizeof(MarramPatchBuffers), vertices, NULL, 2, attributes, values};
    CHECK(type->tessellate(instance, patch, &buffers) == MARRAM_OK);
}

/* Embree reads up to 16 bytes past the end of a shared buffer. Patches are made from last to first, since
 * any order is allowed. */
static void make_curves(const MarramProcedural* type, MarramInstance* instance, const MarramFrame* frame,
                        Curves* curves) {
    MarramOutput* output = &curves->output;
    memset(output, 0, sizeof *output);
    output->size = sizeof *output;
    CHECK(type->begin(instance, frame, output) == MARRAM_OK);
    CHECK(output->kind == MARRAM_CURVES && output->curve_count == strands && output->cvs_per_curve >= 2);
    CHECK(output->time_count == times && output->patch_count > 1);
    curves->patches = allocate(output->patch_count * sizeof *curves->patches);
    for (unsigned t = 0; t < times; ++t)
        curves->vertices[t] = allocate((4 * vertex_count(output) + spare_floats) * sizeof(float));
    curves->root_uv = allocate(2 * output->curve_count * sizeof(float));
    curves->id = allocate(output->curve_count * sizeof(float));
    uint64_t next = 0;
    for (uint32_t i = 0; i < output->patch_count; ++i) {
        curves->patches[i].size = sizeof(MarramPatch);
        CHECK(type->patch(instance, i, &curves->patches[i]) == MARRAM_OK);
        CHECK(curves->patches[i].first_curve == next);
        next += curves->patches[i].curve_count;
    }
    CHECK(next == output->curve_count);
    for (uint32_t i = output->patch_count; i > 0; --i) tessellate(type, instance, curves, i - 1);
}

static void free_curves(Curves* curves) {
    free(curves->patches);
    for (unsigned t = 0; t < times; ++t) free(curves->vertices[t]);
    free(curves->root_uv);
    free(curves->id);
}

/* ---- Checks ---- */

static void check_bounds(const Curves* curves) {
    const uint32_t cvs = curves->output.cvs_per_curve;
    for (uint32_t i = 0; i < curves->output.patch_count; ++i) {
        const MarramPatch* patch = &curves->patches[i];
        for (unsigned t = 0; t < times; ++t)
            for (uint64_t k = 0; k < (uint64_t)patch->curve_count * (cvs + 2); ++k) {
                if (k % (cvs + 2) == 0 || k % (cvs + 2) == cvs + 1) continue; /* a phantom */
                const float* v = curves->vertices[t] + 4 * (patch->first_curve * (cvs + 2) + k);
                for (int axis = 0; axis < 3; ++axis)
                    CHECK(v[axis] - v[3] >= patch->lower[axis] && v[axis] + v[3] <= patch->upper[axis]);
            }
    }
}

/* V[0] = 2 P[0] - P[1] and V[n+1] = 2 P[n-1] - P[n-2]. */
static void check_phantoms(const Curves* curves) {
    const uint32_t cvs = curves->output.cvs_per_curve;
    for (unsigned t = 0; t < times; ++t)
        for (uint64_t c = 0; c < curves->output.curve_count; ++c) {
            const float* v = curves->vertices[t] + 4 * c * (cvs + 2);
            const float* tip = v + 4 * (cvs + 1);
            for (int i = 0; i < 4; ++i) {
                CHECK(fabsf(v[i] - (2 * v[4 + i] - v[8 + i])) <= 1e-6F);
                CHECK(fabsf(tip[i] - (2 * tip[i - 4] - tip[i - 8])) <= 1e-6F);
            }
        }
}

static double segment_length(const float* v) {
    const double x = (double)v[4] - v[0], y = (double)v[5] - v[1], z = (double)v[6] - v[2];
    return sqrt(x * x + y * y + z * z);
}

/* Wind rotates segments without stretching them: within 1e-5 and two units in the last place of a
 * coordinate. */
static void check_lengths(const Curves* bent, const Curves* rest) {
    const uint32_t cvs = bent->output.cvs_per_curve;
    size_t moved = 0;
    for (unsigned t = 0; t < times; ++t)
        for (uint64_t c = 0; c < bent->output.curve_count; ++c)
            for (uint32_t k = 1; k < cvs; ++k) {
                const size_t at = 4 * (c * (cvs + 2) + k);
                const double a = segment_length(bent->vertices[t] + at),
                             b = segment_length(rest->vertices[t] + at);
                const double ulp = 2.0 * (double)FLT_EPSILON; /* of coordinates up to 2 */
                CHECK(fabs(a - b) <= 1e-5 * b + 2.0 * ulp);
                moved += bent->vertices[t][at + 4] != rest->vertices[t][at + 4];
            }
    CHECK(moved > strands);
}

/* The root lies at its uv on the moving square. The square's uv runs along x and against z. */
static void check_attributes(const Curves* curves, const MarramFrame* frame) {
    const uint32_t cvs = curves->output.cvs_per_curve;
    for (uint64_t c = 0; c < curves->output.curve_count; ++c) {
        const float *uv = curves->root_uv + 2 * c, *a = curves->vertices[0] + 4 * (c * (cvs + 2) + 1);
        CHECK(fabs(a[0] - (2.0 * uv[0] - 1.0 + 0.5 * frame->times[0])) < 1e-5);
        CHECK(fabs(a[2] - (1.0 - 2.0 * uv[1])) < 1e-5);
        CHECK(curves->id[c] >= 0.0F && curves->id[c] < 16777216.0F && curves->id[c] == floorf(curves->id[c]));
    }
}

static RTCScene make_world(RTCDevice device, RTCGeometry square, const Curves* curves) {
    const uint32_t cvs = curves->output.cvs_per_curve;
    RTCGeometry hair = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE);
    rtcSetGeometryTimeStepCount(hair, times);
    for (unsigned t = 0; t < times; ++t)
        rtcSetSharedGeometryBuffer(hair, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4, curves->vertices[t], 0,
                                   16, vertex_count(&curves->output));
    unsigned* index = rtcSetNewGeometryBuffer(hair, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4,
                                              curves->output.curve_count * (cvs - 1));
    for (unsigned c = 0; c < curves->output.curve_count; ++c)
        for (unsigned k = 0; k + 1 < cvs; ++k) *index++ = c * (cvs + 2) + k;
    rtcSetGeometryMask(hair, 0xffffffffu);
    rtcCommitGeometry(hair);
    RTCScene world = rtcNewScene(device);
    rtcAttachGeometryByID(world, square, 0);
    rtcAttachGeometryByID(world, hair, 1);
    rtcReleaseGeometry(hair);
    rtcCommitScene(world);
    return world;
}

/* Traces a ray from far above to the middle of each strand's second segment, at a time within the shutter:
 * it must hit a curve there or before. */
static void check_hits(RTCScene world, const Curves* curves) {
    static const float towards[3] = {0.48F, -0.6F, 0.64F};
    static const float weights[4] = {1 / 48.0F, 23 / 48.0F, 23 / 48.0F, 1 / 48.0F};
    const float distance = 10.0F;
    const uint32_t cvs = curves->output.cvs_per_curve;
    for (uint64_t c = 0; c < curves->output.curve_count; ++c) {
        const float time = (float)(c % 9) / 8.0F;
        struct RTCRayHit ray;
        memset(&ray, 0, sizeof ray);
        float p[4] = {0, 0, 0, 0};
        for (uint32_t k = 0; k < 4; ++k)
            for (int i = 0; i < 4; ++i) {
                const size_t at = 4 * (c * (cvs + 2) + k + 1) + (size_t)i;
                p[i] += weights[k] * ((1 - time) * curves->vertices[0][at] + time * curves->vertices[1][at]);
            }
        ray.ray.org_x = p[0] - distance * towards[0];
        ray.ray.org_y = p[1] - distance * towards[1];
        ray.ray.org_z = p[2] - distance * towards[2];
        ray.ray.dir_x = towards[0];
        ray.ray.dir_y = towards[1];
        ray.ray.dir_z = towards[2];
        ray.ray.tfar = 100.0F;
        ray.ray.time = time;
        ray.ray.mask = ~0U;
        ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        marram_intersect1(world, &ray, 0);
        CHECK(ray.hit.geomID == 1 && ray.ray.tfar <= distance + 1e-4F);
        CHECK(ray.hit.primID < curves->output.curve_count * (cvs - 1));
    }
}

static void count_key(void* user, const char* key, double value) {
    int* found = user;
    CHECK(isfinite(value) && value >= 0.0);
    if (strncmp(key, "seconds.", 8) == 0 || strncmp(key, "thread_seconds.", 15) == 0) ++found[0];
    if (strcmp(key, "memory.curve_extra_bytes") == 0) ++found[1];
}

static void check_report(const MarramProcedural* type, MarramInstance* instance) {
    int found[2] = {0, 0};
    type->report(instance, count_key, found);
    CHECK(found[0] > 0 && found[1] == 1);
}

static void check_mistakes(const MarramProcedural* type, const MarramFrame* frame) {
    static Values values;
    MarramInstance* instance = NULL;
    Given bad[good_count + 1];
    memcpy(bad, good, sizeof good);
    bad[good_count].name = "density";
    bad[good_count].text = "100";
    make_values(type, bad, good_count + 1, &values);
    forget_messages();
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_ERROR);
    CHECK(last_message_is("groom.density_and_count") && strcmp(last_place, "null_host") == 0);

    bad[0].text = "circle";
    make_values(type, bad, good_count, &values);
    forget_messages();
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_OK);
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->begin(instance, frame, &output) == MARRAM_ERROR && last_message_is("groom.no_mesh") &&
          strstr(last_message, "circle"));
    type->destroy(instance);
}

/* ---- A faulty host gets a message, and nothing crashes ---- */

static MarramValue* value_of(Values* values, const char* name) {
    for (uint32_t i = 0; i < values->count; ++i)
        if (strcmp(values->list[i].name, name) == 0) return &values->list[i];
    fail(name, __LINE__);
    return NULL;
}

/* Spoils one value. The message must name it and what is allowed. */
static void check_refused(const MarramProcedural* type, Values* values, const char* name,
                          const char* allowed) {
    MarramInstance* instance = NULL;
    forget_messages();
    CHECK(type->create(&host, lend(values), &instance) == MARRAM_ERROR && instance == NULL);
    CHECK(last_message_is("contract.value"));
    if (!strstr(last_message, name) || !strstr(last_message, allowed)) fail(allowed, __LINE__);
}

static void check_bad_values(const MarramProcedural* type) {
    static Values values;
    static const struct {
        const char *name, *allowed;
        size_t number_count; /* of `numbers` */
        double numbers[4];
        const char* text;
    } bad[] = {{"count", "1 to 2e+09", 1, {-5}, NULL},
               {"count", "a whole number", 1, {2.5}, NULL},
               {"count", "1 to 2e+09", 1, {NAN}, NULL},
               {"count", "give 1", 0, {0}, NULL},
               {"length", "lower number first", 2, {2, 1}, NULL},
               {"length", "give 2", 1, {2}, NULL},
               {"width", "0 to", 1, {-1}, NULL},
               {"shape", "round|ribbon|oriented-ribbon", 0, {0}, "cube"},
               {"on", "the name of a mesh", 0, {0}, ""},
               {"envelope", "at least one", 0, {0}, "linear"},
               {"envelope", "at least one", 3, {0, 1, 1}, "linear"},
               {"envelope", "linear|smooth|constant", 4, {0, 1, 1, 1}, "cubic"},
               {"envelope", "ascend", 4, {1, 1, 0, 1}, "linear"},
               {"envelope", "NULL", 4, {0, 1, 1, 1}, NULL},
               {"wind.direction", "1e+09", 3, {INFINITY, 0, 0}, NULL},
               {"wind.gusts.redraw", "0 or 1", 1, {2}, NULL}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        make_values(type, good, good_count, &values);
        MarramValue* value = value_of(&values, bad[i].name);
        const int is_null_text = strcmp(bad[i].allowed, "NULL") == 0;
        value->number_count = bad[i].number_count;
        value->numbers = bad[i].numbers;
        if (bad[i].text || is_null_text) value->text = bad[i].text;
        check_refused(type, &values, bad[i].name, bad[i].allowed);
    }
    make_values(type, good, good_count, &values);
    value_of(&values, "count")->name = "coutn";
    check_refused(type, &values, "coutn", "declared");
    make_values(type, good, good_count, &values);
    value_of(&values, "count")->type = MARRAM_TEXT;
    check_refused(type, &values, "count", "declared with type");
    make_values(type, good, good_count, &values);
    value_of(&values, "count")->numbers = NULL;
    check_refused(type, &values, "count", "NULL");
    make_values(type, good, good_count, &values);
    value_of(&values, "count")->name = NULL;
    check_refused(type, &values, "", "no name");
    make_values(type, good, good_count, &values);
    values.list[values.count] = *value_of(&values, "width");
    ++values.count;
    check_refused(type, &values, "width", "twice");
    make_values(type, good, good_count, &values);
    values.list[values.count] = *value_of(&values, "width");
    values.list[values.count++].name = "wind.gusts.control[1].strength";
    check_refused(type, &values, "wind.gusts.control", "without gaps");
    MarramInstance* instance = NULL;
    const MarramValues none = {sizeof(MarramValues), NULL, 3, sizeof(MarramValue)};
    CHECK(type->create(&host, NULL, &instance) == MARRAM_ERROR && last_message_is("contract.null_values"));
    CHECK(type->create(&host, &none, &instance) == MARRAM_ERROR && last_message_is("contract.null_values"));
    CHECK(type->create(&host, lend(&values), NULL) == MARRAM_ERROR);
    CHECK(type->create(NULL, NULL, NULL) == MARRAM_ERROR);
}

static void check_bad_frames(const MarramProcedural* type, Values* values, const MarramFrame* good_frame) {
    MarramInstance* instance = NULL;
    MarramOutput output = {sizeof(MarramOutput)};
    MarramPatch patch = {sizeof(MarramPatch)};
    CHECK(type->create(&host, lend(values), &instance) == MARRAM_OK);
    CHECK(type->patch(instance, 0, &patch) == MARRAM_ERROR && last_message_is("contract.no_frame"));
    static const double downwards[times] = {2.0, 1.0};
    for (int fault = 0; fault < 8; ++fault) {
        MarramFrame frame = *good_frame;
        MarramMesh mesh = frame.meshes[0];
        if (fault == 0) frame.pose = NULL;
        if (fault == 1) frame.times = NULL;
        if (fault == 2) frame.times = downwards;
        if (fault == 3) frame.time_count = 65;
        if (fault == 4) frame.fps = 0.0;
        if (fault == 5) frame.meshes = NULL;
        if (fault >= 6) frame.meshes = &mesh;
        if (fault == 6) mesh.positions = NULL;
        if (fault == 7) mesh.triangles = NULL;
        forget_messages();
        CHECK(type->begin(instance, &frame, &output) == MARRAM_ERROR && last_message_is("contract.frame"));
    }
    CHECK(type->begin(instance, NULL, &output) == MARRAM_ERROR &&
          type->begin(instance, good_frame, NULL) == MARRAM_ERROR);
    MarramFrame frame = *good_frame;
    CHECK(type->begin(instance, &frame, &output) == MARRAM_OK);
    forget_messages();
    CHECK(type->patch(instance, output.patch_count, &patch) == MARRAM_ERROR &&
          last_message_is("contract.patch_range"));
    CHECK(type->patch(instance, UINT32_MAX, &patch) == MARRAM_ERROR &&
          type->patch(instance, 0, NULL) == MARRAM_ERROR);
    const MarramPatchBuffers none = {sizeof(MarramPatchBuffers), NULL, NULL, 0, NULL, NULL};
    CHECK(type->tessellate(instance, 0, &none) == MARRAM_ERROR && last_message_is("contract.null_buffer"));
    CHECK(type->tessellate(instance, 0, NULL) == MARRAM_ERROR);
    CHECK(type->tessellate(instance, output.patch_count, &none) == MARRAM_ERROR &&
          last_message_is("contract.patch_range"));
    MarramMesh other = frame.meshes[0];
    other.triangle_count = 1;
    frame.meshes = &other;
    CHECK(type->begin(instance, &frame, &output) == MARRAM_ERROR && last_message_is("groom.topology"));
    other = good_frame->meshes[0];
    other.topology += 1; /* as many triangles, but different ones */
    CHECK(type->begin(instance, &frame, &output) == MARRAM_ERROR && last_message_is("groom.topology"));
    type->destroy(instance);
}

/* Work that would take half a minute is announced before it begins. */
static void check_announcement(const MarramProcedural* type, const MarramFrame* frame) {
    static Values values;
    Given given[good_count + 1];
    memcpy(given, good, sizeof good);
    given[1].text = "400000";
    given[good_count].name = "cvs";
    given[good_count].text = "1000";
    make_values(type, given, good_count + 1, &values);
    MarramInstance* instance = NULL;
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_OK);
    forget_messages();
    CHECK(type->begin(instance, frame, &output) == MARRAM_OK);
    CHECK(last_message_is("groom.long_work"));
    CHECK(strstr(last_message, "4e+08 CVs, 1000 per strand, at 2 motion samples") &&
          strstr(last_message, "of one processor"));
    type->destroy(instance);
}

/* A long past is announced before its poses are read. */
static void check_announcement_of_past(const MarramProcedural* type, const MarramFrame* frame) {
    static Values values;
    Given given[good_count + 2];
    memcpy(given, good, sizeof good);
    given[1].text = "20000";
    given[good_count].name = "wind.jiggle.frequency";
    given[good_count].text = "2";
    given[good_count + 1].name = "wind.jiggle.damping";
    given[good_count + 1].text = "0.01";
    make_values(type, given, good_count + 2, &values);
    MarramInstance* instance = NULL;
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_OK);
    forget_messages();
    pose_calls = 0;
    CHECK(type->begin(instance, frame, &output) == MARRAM_OK);
    CHECK(last_message_is("groom.long_work"));
    CHECK(pose_calls > 1000 && pose_calls_before_message < 20);
    type->destroy(instance);
}

/* Cancels before roots are placed, and between two patches. */
static void check_cancel(const MarramProcedural* type, Values* values, const MarramFrame* frame) {
    MarramInstance* instance = NULL;
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->create(&host, lend(values), &instance) == MARRAM_OK);
    cancel_asked = 1;
    CHECK(type->begin(instance, frame, &output) == MARRAM_CANCELLED);
    cancel_asked = 0;
    Curves curves;
    make_curves(type, instance, frame, &curves);
    cancel_asked = 1;
    const MarramPatchBuffers buffers = {sizeof(MarramPatchBuffers), curves.vertices, NULL, 0, NULL, NULL};
    CHECK(type->tessellate(instance, 0, &buffers) == MARRAM_CANCELLED);
    cancel_asked = 0;
    free_curves(&curves);
    type->destroy(instance);
}

/* ---- Updates ---- */

static uint32_t update_with(const MarramProcedural* type, MarramInstance* instance, const char* name,
                            const char* text, uint32_t inputs) {
    static Values values;
    Given given[good_count + 1];
    memcpy(given, good, sizeof good);
    given[good_count].name = name;
    given[good_count].text = text;
    make_values(type, given, good_count + 1, &values);
    const MarramUpdate update = {sizeof(MarramUpdate), lend(&values), inputs};
    uint32_t changed = 99;
    CHECK(type->update(instance, &update, &changed) == MARRAM_OK);
    return changed;
}

static int same_curves(const Curves* a, const Curves* b) {
    return memcmp(a->vertices[0], b->vertices[0], 16 * vertex_count(&a->output)) == 0;
}

/* An updated instance equals, to the bit, one that is created with the change. The update reports what it
 * changed; an error leaves the instance unchanged. */
static void check_update(const MarramProcedural* type, Values* values, const MarramFrame* frame) {
    MarramInstance *told = NULL, *fresh = NULL;
    CHECK(type->create(&host, lend(values), &told) == MARRAM_OK);
    Curves before, after, made;
    make_curves(type, told, frame, &before);
    CHECK(update_with(type, told, "", "", MARRAM_NOTHING) == MARRAM_NOTHING);
    CHECK(update_with(type, told, "lean", "45", MARRAM_NOTHING) == (MARRAM_POSITIONS | MARRAM_ATTRIBUTES));
    make_curves(type, told, frame, &after);
    CHECK(!same_curves(&before, &after));
    static Values leaning;
    Given given[good_count + 1];
    memcpy(given, good, sizeof good);
    given[good_count].name = "lean";
    given[good_count].text = "45";
    make_values(type, given, good_count + 1, &leaning);
    CHECK(type->create(&host, lend(&leaning), &fresh) == MARRAM_OK);
    make_curves(type, fresh, frame, &made);
    CHECK(same_curves(&after, &made));
    CHECK(memcmp(before.id, after.id, strands * sizeof(float)) == 0); /* roots stay */
    CHECK(update_with(type, told, "cvs", "5", MARRAM_NOTHING) == MARRAM_EVERYTHING);
    CHECK(update_with(type, told, "seed", "7", MARRAM_NOTHING) == MARRAM_EVERYTHING);
    free_curves(&after);
    make_curves(type, told, frame, &after);
    CHECK(memcmp(before.id, after.id, strands * sizeof(float)) != 0);
    /* Another mesh is allowed once it is announced. */
    MarramMesh mesh = frame->meshes[0];
    MarramFrame other = *frame;
    other.meshes = &mesh;
    mesh.topology += 1;
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->begin(told, &other, &output) == MARRAM_ERROR && last_message_is("groom.topology"));
    CHECK(update_with(type, told, "", "", MARRAM_TOPOLOGY) == MARRAM_EVERYTHING);
    CHECK(type->begin(told, &other, &output) == MARRAM_OK);
    values->list[values->count] = values->list[0];
    ++values->count; /* a value twice */
    const MarramUpdate wrong = {sizeof(MarramUpdate), lend(values), MARRAM_NOTHING};
    uint32_t changed = 0;
    CHECK(type->update(told, &wrong, &changed) == MARRAM_ERROR && last_message_is("contract.value"));
    CHECK(type->update(told, NULL, &changed) == MARRAM_ERROR && last_message_is("contract.null_update"));
    --values->count;
    free_curves(&after);
    CHECK(update_with(type, told, "", "", MARRAM_TOPOLOGY) == MARRAM_EVERYTHING);
    make_curves(type, told, frame, &after);
    CHECK(same_curves(&before, &after));
    free_curves(&before);
    free_curves(&after);
    free_curves(&made);
    type->destroy(told);
    type->destroy(fresh);
}

/* ---- Attributes of the mesh ---- */

/* Half of the square is bare: the attribute is 0 at x = -1 and 1 at x = 1, and the ramp cuts it in the
 * middle. */
static void check_masked(const MarramProcedural* type, const MarramFrame* frame) {
    static const float sand[4] = {0, 1, 1, 0};
    static const double step[4] = {0.0, 0.0, 0.5, 1.0};
    static Values values;
    make_values(type, good, good_count, &values);
    const char* const names[2] = {"density_by[0].attribute", "density_by[0].ramp"};
    for (int i = 0; i < 2; ++i) {
        MarramValue* value = &values.list[values.count++];
        memset(value, 0, sizeof *value);
        value->name = names[i];
        value->type = i == 0 ? MARRAM_TEXT : MARRAM_RAMP;
        value->text = i == 0 ? "sand" : "constant";
        value->numbers = step;
        value->number_count = i == 0 ? 0 : 4;
        value->place = "null_host";
    }
    MarramInstance* instance = NULL;
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_OK);
    MarramOutput output = {sizeof(MarramOutput)};
    CHECK(type->begin(instance, frame, &output) == MARRAM_ERROR && last_message_is("groom.no_attribute"));
    MarramAttribute attribute = {"sand", 1, MARRAM_PER_VERTEX, 0, "", sand, 0};
    MarramMesh mesh = frame->meshes[0];
    mesh.attributes = &attribute;
    mesh.attribute_count = 1;
    mesh.attribute_stride = sizeof attribute;
    MarramFrame masked = *frame;
    masked.meshes = &mesh;
    Curves curves;
    make_curves(type, instance, &masked, &curves);
    for (uint64_t c = 0; c < curves.output.curve_count; ++c) CHECK(curves.root_uv[2 * c] >= 0.5F);
    free_curves(&curves);
    attribute.animated = 1;
    CHECK(type->begin(instance, &masked, &output) == MARRAM_ERROR &&
          last_message_is("groom.animated_attribute"));
    attribute.animated = 0;
    attribute.values = NULL;
    CHECK(type->begin(instance, &masked, &output) == MARRAM_ERROR && last_message_is("contract.frame"));
    type->destroy(instance);
}

static const MarramProcedural* find_groom(void* handle) {
    MarramLibraryFunction entry = NULL;
    void* symbol = dlsym(handle, MARRAM_ENTRY_POINT);
    CHECK(symbol != NULL);
    memcpy(&entry, &symbol, sizeof entry); /* C has no cast from an object pointer to a function */
    CHECK(entry(MARRAM_ABI_VERSION + 1) == NULL && entry(0) == NULL);
    const MarramLibrary* library = entry(MARRAM_ABI_VERSION);
    CHECK(library != NULL && library->abi == MARRAM_ABI_VERSION &&
          library->embree_major == MARRAM_EMBREE_MAJOR);
    static MarramProcedural groom; /* the members that both sides know */
    for (uint32_t i = 0; i < library->procedural_count; ++i) {
        const size_t stride = library->procedural_stride;
        const MarramProcedural* one = MARRAM_AT(MarramProcedural, library->procedurals, stride, i);
        if (strcmp(one->name, "groom") != 0) continue;
        memcpy(&groom, one, stride < sizeof groom ? stride : sizeof groom);
        return &groom;
    }
    fail("the library has a groom", __LINE__);
    return NULL;
}

static void run(const MarramProcedural* type, RTCDevice device, RTCGeometry square,
                const MarramFrame* frame) {
    static Values values;
    make_values(type, good, good_count, &values);
    MarramInstance* instance = NULL;
    CHECK(type->create(&host, lend(&values), &instance) == MARRAM_OK);
    Curves bent, again, rest;
    make_curves(type, instance, frame, &bent);
    check_report(type, instance);
    make_curves(type, instance, frame, &again);
    tessellate(type, instance, &again, 0); /* once more into the same buffers */
    for (unsigned t = 0; t < times; ++t)
        CHECK(memcmp(bent.vertices[t], again.vertices[t], 16 * vertex_count(&bent.output)) == 0);
    CHECK(memcmp(bent.id, again.id, strands * sizeof(float)) == 0);
    MarramFrame at_rest = *frame;
    at_rest.stage = MARRAM_REST;
    make_curves(type, instance, &at_rest, &rest);
    check_bounds(&bent);
    check_bounds(&rest);
    check_phantoms(&bent);
    check_lengths(&bent, &rest);
    check_attributes(&bent, frame);
    RTCScene world = make_world(device, square, &bent);
    check_hits(world, &bent);
    rtcReleaseScene(world);
    type->destroy(instance);
    free_curves(&bent);
    free_curves(&again);
    free_curves(&rest);
    check_update(type, &values, frame);
    check_masked(type, frame);
    check_mistakes(type, frame);
    check_cancel(type, &values, frame);
    check_bad_values(type);
    check_bad_frames(type, &values, frame);
    check_announcement(type, frame);
    check_announcement_of_past(type, frame);
}

int main(int argc, char** argv) {
    void* handle = argc == 2 ? dlopen(argv[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!handle) {
        fprintf(stderr, "usage: null_host LIBRARY.so\n%s\n", argc == 2 ? dlerror() : "");
        return 2;
    }
    static const double shutter[times] = {1.0, 1.5};
    float positions[times][12 + spare_floats];
    const float* steps[times];
    for (unsigned t = 0; t < times; ++t) {
        pose(NULL, 0, shutter[t], positions[t], NULL);
        steps[t] = positions[t];
    }
    RTCDevice device = rtcNewDevice(NULL);
    RTCGeometry square = make_square(device, positions);
    RTCScene colliders = rtcNewScene(device);
    rtcAttachGeometryByID(colliders, square, 0);
    rtcCommitScene(colliders);
    const MarramMesh mesh = {"square",   0,    MARRAM_ALL_ROLES,
                             4,          2,    times,
                             steps,      NULL, corner_triangles,
                             corner_uvs, NULL, 0,
                             0,          NULL, 0,
                             0,          1};
    MarramFrame frame;
    memset(&frame, 0, sizeof frame);
    frame.size = sizeof frame;
    frame.fps = 24.0;
    frame.frame = frame.bind_frame = 1.0;
    frame.time_count = times;
    frame.times = shutter;
    frame.stage = MARRAM_FINAL;
    frame.device = device;
    frame.colliders = colliders;
    frame.mesh_count = 1;
    frame.mesh_stride = sizeof mesh;
    frame.meshes = &mesh;
    frame.pose = pose;
    run(find_groom(handle), device, square, &frame);
    rtcReleaseScene(colliders);
    rtcReleaseGeometry(square);
    CHECK(rtcGetDeviceError(device) == RTC_ERROR_NONE);
    rtcReleaseDevice(device);
    dlclose(handle);
    CHECK(dlopen(argv[1], RTLD_NOW | RTLD_NOLOAD)); /* threads of TBB may still return through its code */
    printf("%d strands at %d times, bounded, repeated and hit\n", (int)strands, (int)times);
    return 0;
}
