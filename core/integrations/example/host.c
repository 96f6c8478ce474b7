/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A host of about 150 lines of code that needs only Embree and libmarram_host: renders grass in the wind on a square of ground.
 *
 *   host meadow.ppm strands.bin
 *
 * strands.bin holds x, y, z of all control vertices, then their diameters, as 32-bit floats, like a .hair
 * file after its header. meadow.toml in this folder is the same scene for marram. Step numbers in comments
 * refer to ../README.md.
 */
#include <marram/marram_host.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { width = 320, height = 180, ground_id = 0, grass_id = 1 };
enum { spare_floats = 4 }; /* Embree reads beyond the end of buffers */

static const MarramHost host = {
    .size = sizeof host, .message = marram_print_message, .cancelled = marram_never_cancelled};

static void* check(void* pointer, const char* what) {
    if (!pointer) fprintf(stderr, "host: %s\n", what), exit(1);
    return pointer;
}

static void ok(MarramStatus status) {
    if (status != MARRAM_OK) exit(1); /* the message says why */
}

/* ---- The ground: two static triangles ---- */

static const float corners[12 + spare_floats] = {-2, 0, -2, 2, 0, -2, -2, 0, 2, 2, 0, 2};
static const float* const samples[1] = {corners};
static const uint32_t triangles[6] = {0, 2, 1, 1, 2, 3};

static RTCGeometry make_ground(RTCDevice device) {
    RTCGeometry ground = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(ground, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, corners, 0, 12, 4);
    rtcSetSharedGeometryBuffer(ground, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, triangles, 0, 12, 2);
    rtcSetGeometryMask(ground, MARRAM_ALL_ROLES | MARRAM_NAMED);
    rtcCommitGeometry(ground);
    return ground;
}

/* ---- The grass ---- */

static MarramInstance* make_grass(const MarramProcedural* groom) {
    static const char* const settings[][2] = {
        {"on", "ground"},
        {"count", "2000"},
        {"length", "[0.15, 0.3]"},
        {"width", "0.01"},
        {"wind.direction", "[1, 0, 0.3]"},
        {"wind.speed", "7"},
        {"wind.global_rotate", "0.8"},
        {"wind.gusts.num_gusts", "40"},
        {"wind.gusts.radius_range", "[0.3, 1]"},
        {"wind.gusts.control[0].transform", "{ translate = [0.5, 0, 0.5] }"},
        {"wind.gusts.control[0].strength", "0.5"},
        {"wind.jiggle.frequency", "2"},
        {"wind.collision.solver", "exact"}};
    MarramInstance* grass = NULL;
    MarramHostValues* values = check(marram_values_new(groom), "out of memory"); /* step 2 */
    for (size_t i = 0; i < sizeof settings / sizeof *settings; ++i)
        marram_set(values, settings[i][0], settings[i][1]);
    const MarramValues* all = marram_values_finish(values, &host); /* step 3 */
    if (!all) exit(1);
    ok(groom->create(&host, all, &grass));
    marram_values_free(values);
    return grass;
}

/* Vertices of all curves, 4 floats each: the CVs, one vertex before each root and one after each tip. */
static float* make_curves(const MarramProcedural* groom, MarramInstance* grass, const MarramFrame* frame,
                          MarramOutput* output) {
    memset(output, 0, sizeof *output);
    output->size = sizeof *output;
    ok(groom->begin(grass, frame, output)); /* step 5 */
    const size_t floats = 4 * (size_t)(output->cvs_per_curve + 2);
    float* vertices =
        check(calloc(output->curve_count * floats + spare_floats, sizeof(float)), "out of memory");
    for (uint32_t i = 0; i < output->patch_count; ++i) { /* step 6; may run in parallel */
        MarramPatch patch = {.size = sizeof patch};
        ok(groom->patch(grass, i, &patch));
        float* step = vertices + floats * patch.first_curve;
        const MarramPatchBuffers buffers = {.size = sizeof buffers, .vertices = &step};
        ok(groom->tessellate(grass, i, &buffers));
    }
    return vertices;
}

static RTCGeometry make_grass_geometry(RTCDevice device, const MarramOutput* output, const float* vertices) {
    RTCGeometry hair =
        rtcNewGeometry(device, RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE); /* see output->basis and shape */
    const size_t vertex_count = output->curve_count * (output->cvs_per_curve + 2);
    rtcSetSharedGeometryBuffer(hair, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, vertices, 0, 16,
                               vertex_count);
    marram_segment_indices(output, rtcSetNewGeometryBuffer(hair, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4,
                                                           marram_segment_count(output)));
    rtcCommitGeometry(hair);
    return hair;
}

/* ---- Output ---- */

static void write_strands(const char* file, const MarramOutput* output, const float* vertices) {
    FILE* out = check(fopen(file, "wb"), "cannot write the strands");
    const size_t cvs = output->cvs_per_curve;
    for (int part = 0; part < 2; ++part) /* positions, then diameters */
        for (size_t c = 0; c < output->curve_count; ++c)
            for (size_t k = 1; k <= cvs; ++k) {
                const float *v = vertices + 4 * (c * (cvs + 2) + k), diameter = 2 * v[3];
                fwrite(part == 0 ? v : &diameter, sizeof(float), part == 0 ? 3 : 1, out);
            }
    if (fclose(out) != 0) check(NULL, "cannot write the strands");
}

static void write_picture(const char* file, RTCScene world) {
    FILE* out = check(fopen(file, "wb"), "cannot write the picture");
    fprintf(out, "P6\n%d %d\n255\n", width, height);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            static const float colors[3][3] = {
                {150, 120, 80}, {90, 160, 60}, {150, 180, 220}}; /* ground, grass, sky */
            struct RTCRayHit ray = {.ray = {.org_y = 0.9F, .org_z = 3, .tfar = 100, .mask = ~0U}};
            ray.ray.dir_x = ((float)x + 0.5F - width / 2.0F) / height;
            ray.ray.dir_y = (height / 2.0F - (float)y - 0.5F) / height - 0.25F;
            ray.ray.dir_z = -1;
            ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
            marram_intersect1(world, &ray, 1);
            const float nx = ray.hit.Ng_x, ny = ray.hit.Ng_y, nz = ray.hit.Ng_z, /* hits only */
                cosine = fabsf(0.48F * nx + 0.6F * ny + 0.64F * nz) / sqrtf(nx * nx + ny * ny + nz * nz);
            const int hit = ray.hit.geomID != RTC_INVALID_GEOMETRY_ID;
            const float* color = colors[hit ? ray.hit.geomID : 2];
            for (int i = 0; i < 3; ++i) fputc((int)(color[i] * (hit ? 0.35F + 0.65F * cosine : 1)), out);
        }
    if (fclose(out) != 0) check(NULL, "cannot write the picture");
}

int main(int argc, char** argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: host PICTURE.ppm STRANDS.bin\n");
        return 2;
    }
    static const double time = 12.0; /* one motion sample: frame 12 */
    MarramProcedural groom;
    ok(marram_load_procedural(PLUGIN, "groom", &host, &groom)); /* step 1 */
    MarramInstance* grass = make_grass(&groom);
    RTCDevice device = check(rtcNewDevice(NULL), "no Embree device");
    RTCScene colliders = rtcNewScene(device), world = rtcNewScene(device);
    RTCGeometry ground = make_ground(device);
    rtcAttachGeometryByID(colliders, ground, ground_id); /* step 4: lend the ground */
    rtcCommitScene(colliders);
    const MarramMesh mesh = marram_static_mesh("ground", ground_id, samples, 4, triangles, 2);
    MarramFrame frame = marram_default_frame(&time, 1);
    frame.device = device;
    frame.colliders = colliders;
    marram_lend_static(&frame, &mesh, 1);
    MarramOutput output;
    float* vertices = make_curves(&groom, grass, &frame, &output);
    RTCGeometry hair = make_grass_geometry(device, &output, vertices); /* step 7 */
    rtcAttachGeometryByID(world, ground, ground_id);
    rtcAttachGeometryByID(world, hair, grass_id);
    rtcCommitScene(world);
    write_picture(argv[1], world);
    write_strands(argv[2], &output, vertices);
    groom.destroy(grass);
    rtcReleaseGeometry(ground), rtcReleaseGeometry(hair);
    rtcReleaseScene(colliders), rtcReleaseScene(world);
    rtcReleaseDevice(device);
    free(vertices);
    return 0;
}
