/* SPDX-License-Identifier: Apache-2.0 */
/*
 * For hosts: makes the values of a procedural from its declared defaults and from values that the host sets
 * by name. C99 and C++20; link libmarram_host, which accepts and refuses what marram does in a scene file:
 * names, types, ranges, choices, ramps, keys, lists.
 *
 *   MarramProcedural groom;
 *   if (marram_find_procedural(library, "groom", &host, &groom) != MARRAM_OK) return 1;
 *   MarramHostValues* values = marram_values_new(&groom);
 *   marram_set(values, "on", "ground");                        as in a scene file
 *   marram_set(values, "length", "[0.1, 0.3]");
 *   marram_set_number(values, "wind.speed", 7);
 *   marram_set(values, "wind.gusts.control[0].shape", "box");  an element of a list, with defaults otherwise
 *   const MarramValues* lent = marram_values_finish(values, &host);
 *   if (!lent) return 1;                                       host.message has been called for every mistake
 *   groom.create(&host, lent, &instance);
 *   marram_values_free(values);
 *
 * A wrong value is not stored: the previous value stays, and the error is reported by each
 * marram_values_finish() until the name is set correctly or reset. The same values may be changed and
 * finished again for update(). One thread at a time. Cost: microseconds for each value.
 *
 * Ids of its messages: host.library, host.procedural, host.name, host.value, host.missing, host.list,
 * host.memory.
 */
#ifndef MARRAM_HOST_H
#define MARRAM_HOST_H

#include "marram_plugin.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define MARRAM_HOST_API __attribute__((visibility("default")))
#else
#define MARRAM_HOST_API
#endif

/* ---- Finding a procedural ------------------------------------------------------------------------------ */

/* The functions *_for() tell the library what the host was compiled with: sizes of structs that grow, and
 * Embree. Call those without "_for". */
MARRAM_HOST_API MarramStatus marram_find_procedural_for(uint32_t embree_major, const MarramLibrary* library,
                                                        const char* name, const MarramHost* host,
                                                        MarramProcedural* out, size_t size);
MARRAM_HOST_API MarramStatus marram_load_procedural_for(uint32_t embree_major, const char* path,
                                                        const char* name, const MarramHost* host,
                                                        MarramProcedural* out, size_t size);

/* Copies a procedural of a library: the fields that this version of the contract knows. On failure
 * reports the reason through host->message: another ABI or Embree, no such name, an unknown parameter type, a
 * missing function. */
static inline MarramStatus marram_find_procedural(const MarramLibrary* library, const char* name,
                                                  const MarramHost* host, MarramProcedural* out) {
    return marram_find_procedural_for(MARRAM_EMBREE_MAJOR, library, name, host, out, sizeof *out);
}

/* The same, after loading a library, which stays loaded. A path without a folder is searched where dlopen()
 * does. */
static inline MarramStatus marram_load_procedural(const char* path, const char* name, const MarramHost* host,
                                                  MarramProcedural* out) {
    return marram_load_procedural_for(MARRAM_EMBREE_MAJOR, path, name, host, out, sizeof *out);
}

/* ---- Values by name ------------------------------------------------------------------------------------ */

typedef struct MarramHostValues MarramHostValues;

MARRAM_HOST_API MarramHostValues* marram_values_new_for(const MarramProcedural* type, size_t size);

/* Values with defaults only. The library must stay loaded. NULL: out of memory, or a procedural that
 * marram_find_procedural() refuses. */
static inline MarramHostValues* marram_values_new(const MarramProcedural* type) {
    return marram_values_new_for(type, sizeof *type);
}
MARRAM_HOST_API void marram_values_free(MarramHostValues* values); /* NULL: does nothing */

/* Sets the MarramValue.place of values that are set from now on: messages about them begin with it.
 * Initially "". */
MARRAM_HOST_API void marram_values_place(MarramHostValues* values, const char* place);

/* The functions below return MARRAM_ERROR if the value is wrong. marram_values_finish() reports why. */

/* TOML as in a scene file: 7, 0.5, true, [0, 1, 0], [[0, 0.2], [1, 1]],
 * { knots = [...], interpolation = "smooth" }, { translate = [0, 1, 0] }, { keys = [...] }. Texts may leave
 * out their quotes. Blanks around a value are ignored. */
MARRAM_HOST_API MarramStatus marram_set(MarramHostValues* values, const char* name, const char* toml);
/* For MARRAM_BOOLEAN (0 or 1), MARRAM_INTEGER, MARRAM_NUMBER. Sets all components of ranges and colours. */
MARRAM_HOST_API MarramStatus marram_set_number(MarramHostValues* values, const char* name, double number);
/* For the same types, and for vectors, ranges and colours. */
MARRAM_HOST_API MarramStatus marram_set_numbers(MarramHostValues* values, const char* name,
                                                const double* numbers, size_t count);
/* For texts, choices, names of meshes and curves, types of elements. Without quotes. */
MARRAM_HOST_API MarramStatus marram_set_text(MarramHostValues* values, const char* name, const char* text);
/* Position and value of each knot; "linear", "smooth" or "constant". */
MARRAM_HOST_API MarramStatus marram_set_ramp(MarramHostValues* values, const char* name, const double* knots,
                                             size_t number_count, const char* interpolation);
/* Ten numbers per key, see MARRAM_KEYS; "linear" or "smooth". */
MARRAM_HOST_API MarramStatus marram_set_keys(MarramHostValues* values, const char* name,
                                             const double* numbers, size_t number_count,
                                             const char* interpolation);
/* An image (text: its path) or a table (text: its columns' names, separated by commas) that the host has
 * read. Not copied: it must live until create() or update() has returned. placement may be NULL. */
MARRAM_HOST_API MarramStatus marram_set_grid(MarramHostValues* values, const char* name,
                                             const MarramGrid* grid, const MarramPlacement* placement,
                                             const char* text);
/* A volume that the host has read. text: its path. Not copied: see MarramVolume. */
MARRAM_HOST_API MarramStatus marram_set_volume(MarramHostValues* values, const char* name,
                                               const MarramVolume* volume, const char* text);
MARRAM_HOST_API MarramStatus marram_set_curves_for(MarramHostValues* values, const char* name,
                                                   const char* curves, const MarramAttribute* attributes,
                                                   uint32_t attribute_count, size_t size);
/* The name of curves, and the declarations (without values) of their attributes, which strands made from
 * these curves have, too. Not copied: see marram_set_grid(). */
static inline MarramStatus marram_set_curves(MarramHostValues* values, const char* name, const char* curves,
                                             const MarramAttribute* attributes, uint32_t attribute_count) {
    return marram_set_curves_for(values, name, curves, attributes, attribute_count, sizeof *attributes);
}
/* Restores the default. */
MARRAM_HOST_API void marram_reset(MarramHostValues* values, const char* name);
/* Adds an element with defaults to a list: "wind.gusts.control", "layer". type: for a list whose elements
 * have types (MarramItemType), else NULL. Returns the index, or -1 on failure. Setting a value of an element
 * adds the element, too. */
MARRAM_HOST_API long marram_add(MarramHostValues* values, const char* list, const char* type);

/* All values, for create() or update(). Valid until the next call with these values. NULL if anything is
 * wrong: all errors have then been reported to host, which may be NULL. */
MARRAM_HOST_API const MarramValues* marram_values_finish(MarramHostValues* values, const MarramHost* host);

/* ---- Small parts of a host ----------------------------------------------------------------------------- */

/* Simple callbacks of a MarramHost: prints messages to stderr; never cancels. */
static inline void marram_print_message(void* user, const MarramMessage* m) {
    (void)user;
    fprintf(stderr, "%s%s%s%s%s\n", m->place, *m->place ? ": " : "", m->what, *m->remedy ? ": " : "",
            m->remedy);
}

static inline int marram_never_cancelled(void* user) {
    (void)user;
    return 0;
}

/* A frame with the defaults of a marram scene, at times[0]: 24 frames a second, strands bound at frame 1, the
 * whole chain, a tolerance of 1 mm. `times` is not copied. Set device, colliders, meshes and pose. */
static inline MarramFrame marram_default_frame(const double* times, uint32_t time_count) {
    MarramFrame frame;
    memset(&frame, 0, sizeof frame);
    frame.size = sizeof frame;
    frame.fps = 24.0;
    frame.frame = times && time_count > 0 ? times[0] : 0.0;
    frame.bind_frame = 1.0;
    frame.time_count = time_count;
    frame.times = times;
    frame.stage = MARRAM_FINAL;
    frame.tolerance = 1e-3;
    frame.mesh_stride = sizeof(MarramMesh);
    frame.curves_stride = sizeof(MarramCurves);
    return frame;
}

/* A mesh that does not move, with all roles, without normals and uvs. `positions` is not copied: it points to
 * one pointer to 3 * vertex_count floats. */
static inline MarramMesh marram_static_mesh(const char* name, uint32_t geometry_id,
                                            const float* const* positions, uint32_t vertex_count,
                                            const uint32_t* triangles, uint32_t triangle_count) {
    MarramMesh mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.name = name;
    mesh.geometry_id = geometry_id;
    mesh.roles = MARRAM_ALL_ROLES;
    mesh.vertex_count = vertex_count;
    mesh.triangle_count = triangle_count;
    mesh.time_count = 1;
    mesh.positions = positions;
    mesh.triangles = triangles;
    return mesh;
}

/* MarramFrame.pose of the meshes that marram_lend_static() lends. */
static inline MarramStatus marram_host_pose_static(void* user, uint32_t index, double frame, float* positions,
                                                   float* normals) {
    const MarramMesh* mesh = (const MarramMesh*)user + index;
    const size_t bytes = 3 * sizeof(float) * (size_t)mesh->vertex_count;
    (void)frame;
    memcpy(positions, mesh->positions[0], bytes);
    if (normals && mesh->normals) memcpy(normals, mesh->normals[0], bytes);
    return MARRAM_OK;
}

/* Lends meshes of which none moves: sets meshes, mesh_count, pose and pose_user of the frame. */
static inline void marram_lend_static(MarramFrame* frame, const MarramMesh* meshes, uint32_t mesh_count) {
    frame->meshes = meshes;
    frame->mesh_count = mesh_count;
    frame->pose = marram_host_pose_static;
    frame->pose_user = (void*)meshes; /* only read */
}

/* The index buffer of an Embree curve geometry: the number of cubic segments of all curves, and the first
 * vertex of each. MARRAM_CURVES only. */
static inline uint64_t marram_segment_count(const MarramOutput* output) {
    const uint64_t curves = output->curve_count;
    return (output->offsets ? output->offsets[curves] : curves * output->cvs_per_curve) - curves;
}

static inline void marram_segment_indices(const MarramOutput* output, uint32_t* indices) {
    uint32_t vertex = 0; /* Embree's indices have 32 bits */
    for (uint64_t c = 0; c < output->curve_count; ++c) {
        const uint64_t cvs =
            output->offsets ? output->offsets[c + 1] - output->offsets[c] : output->cvs_per_curve;
        for (uint64_t k = 0; k + 1 < cvs; ++k) *indices++ = vertex + (uint32_t)k;
        vertex += (uint32_t)cvs + 2;
    }
}

#ifdef __cplusplus
}
#endif
#endif
