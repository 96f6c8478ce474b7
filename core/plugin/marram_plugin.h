/* SPDX-License-Identifier: Apache-2.0 */
/*
 * THE CONTRACT between a renderer and a procedural: plain C99 data, plus the Embree handles that the renderer lends.
 * A procedural library is a shared library with one entry point, marram_library(). The renderer finds it by path, checks the
 * ABI number, and knows nothing else of it.
 *
 * One frame, seen from the renderer:
 *
 *   MarramLibrary* lib = marram_library(MARRAM_ABI_VERSION)        once; NULL when the library speaks another version
 *   p->create(host, values, n, &instance)                         once for each procedural of the scene
 *   p->begin(instance, frame, &output)                            each frame; says what will be handed over. Perhaps once more
 *                                                                 before, at other motion samples, and a few patches after it:
 *                                                                 so a renderer learns how many samples the motion needs
 *   output.kind == MARRAM_MESH:   p->mesh(instance, &buffers)     phase 1: the mesh joins the colliders
 *   ... the renderer commits the colliders, then calls begin of everything that makes curves ...
 *   output.kind == MARRAM_CURVES: p->patch(instance, i, &patch)   bounds, from any thread
 *                                 p->tessellate(instance, i, &b)  phase 2: from any threads, in any order
 *   p->report(instance, sink, user)                               seconds and counts of what was done since begin
 *   p->destroy(instance)
 *
 * Conventions: right-handed, y up, metres, radians; frames are real numbers; matrices do not occur. Positions are floats.
 * Every call returns MARRAM_OK, or an error after having said why through host->message, or MARRAM_CANCELLED soon after
 * host->cancelled() has turned nonzero. Nothing is thrown across the border. Strings are UTF-8 and live as long as the
 * library (declarations) or the call (arguments).
 *
 * tessellate() is idempotent: the same frame and patch give the same bits whatever ran before and on whatever thread.
 * patch() is conservative: the box holds all that is drawn of the patch at every motion sample, width included.
 *
 * To extend: add fields at the end of a struct and raise MARRAM_ABI_VERSION. Both sides refuse any other version.
 */
#ifndef MARRAM_PLUGIN_H
#define MARRAM_PLUGIN_H

#include "core/plugin/embree.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MARRAM_ABI_VERSION 2u

typedef enum MarramStatus { MARRAM_OK = 0, MARRAM_ERROR = 1, MARRAM_CANCELLED = 2 } MarramStatus;
/* A renderer shows information at once, warnings with the frame that they are about; faults are why a call returns MARRAM_ERROR. */
typedef enum MarramSeverity { MARRAM_INFO = 0, MARRAM_WARNING = 1, MARRAM_FAULT = 2 } MarramSeverity;

/* ---- Parameters ------------------------------------------------------------------------------------------------- */

typedef enum MarramParamType {
    MARRAM_BOOLEAN,   /* numbers[0] is 0 or 1 */
    MARRAM_INTEGER,   /* numbers[0] */
    MARRAM_NUMBER,    /* numbers[0] */
    MARRAM_VEC2,      /* numbers[0..1] */
    MARRAM_VEC3,      /* numbers[0..2] */
    MARRAM_RANGE,     /* numbers[0..1], low <= high */
    MARRAM_COLOR,     /* numbers[0..2], linear */
    MARRAM_TEXT,      /* text */
    MARRAM_CHOICE,    /* text, one of choices "a|b|c" */
    MARRAM_RAMP,      /* numbers = p0 v0 p1 v1 ..., text = "linear" | "smooth" | "constant" */
    MARRAM_IMAGE,     /* image: the renderer has read the file; text = its path */
    MARRAM_MESH_NAME, /* text = name of a mesh of the scene, given in MarramFrame.meshes */
    MARRAM_KEYS, /* keyed transform: numbers = 10 a key: frame, translate xyz, rotate xyz in degrees, scale xyz,
                           frames ascending; text = "linear" | "smooth". Scale, then rotate about x, y, z, then translate */
    MARRAM_UNAVAILABLE, /* declared so that a scene that asks for it is told; never handed over */
    MARRAM_PARAM_TYPE_COUNT
} MarramParamType;

/*
 * A name is dotted where tables nest: "noise.octaves". One table of a name may be followed by []: a list of tables, whose
 * every element has the parameter: "gusts.control[].shape" stands in a scene as [[wind.gusts.control]] shape = "box". Its
 * values come as "gusts.control[0].shape", "gusts.control[1].shape", ..., numbered without gaps, defaults filled in for
 * each element; a list that is absent or empty has no values.
 */
typedef struct MarramParam {
    const char* name;
    MarramParamType type;
    const char* unit; /* "m", "deg", "m/s", "1/m", "frames"; "" where there is none */
    const char*
        initial; /* default as written in a scene file (TOML); "" = must be given; "none" = may be absent */
    double minimum, maximum; /* of every component, both ends allowed */
    const char* choices;     /* "a|b|c" of a choice, else "" */
    const char* help;        /* one line */
} MarramParam;

typedef struct MarramImage {
    uint32_t width, height, channels;
    const float* pixels; /* rows from the top, linear values, channels interleaved */
} MarramImage;

typedef struct MarramValue {
    const char* name;
    MarramParamType type;
    const double* numbers;
    size_t number_count;
    const char* text;         /* "" where there is none */
    const MarramImage* image; /* NULL where there is none */
    const char* place;        /* "file:line:column" to begin a message with */
} MarramValue;

/* ---- What the renderer lends ------------------------------------------------------------------------------------- */

typedef struct MarramHost { /* valid from create to destroy; every function may be called from any thread */
    void* user;
    void (*message)(void* user, MarramSeverity severity, const char* place, const char* text);
    int (*cancelled)(void* user); /* cheap; ask at least every few milliseconds */
} MarramHost;

/* A triangle mesh of the scene, at the motion samples of the frame. Vertices on a uv seam may stand twice. */
typedef struct MarramMesh {
    const char* name;
    uint32_t geometry_id; /* in MarramFrame.colliders */
    uint32_t vertex_count, triangle_count;
    uint32_t time_count;           /* 1 for a mesh that rests, else MarramFrame.time_count */
    const float* const* positions; /* [time_count], xyz packed */
    const float* const* normals;   /* [time_count], xyz packed unit vertex normals; NULL: facetted */
    const uint32_t* triangles;     /* 3 a triangle, anticlockwise seen from outside */
    const float* uvs;              /* 2 a vertex; NULL where the mesh has none */
} MarramMesh;

typedef enum MarramStage { MARRAM_REST = 0, MARRAM_BENT = 1, MARRAM_FINAL = 2 } MarramStage;

typedef struct MarramFrame { /* valid from begin until the frame's last call, report included */
    double fps, frame;
    double bind_frame;   /* where roots are placed: the same for every frame of a shot */
    uint32_t time_count; /* motion samples, 1 ... 64 */
    const double* times; /* in frames, ascending; equally spaced over the shutter */
    MarramStage stage;   /* stop after this one */
    double tolerance;    /* metres; 0: a thousandth of a strand's length, or less where less is cheap */
    double camera_position[3];
    double pixel_angle; /* radians a pixel spans at the image's centre */
    RTCDevice device;
    RTCScene colliders; /* committed; to be traced and queried only. NULL while meshes are being made */
    uint32_t mesh_count;
    const MarramMesh* meshes;
    /*
     * A mesh at any time (frames), also outside the shutter; any thread. positions: 3 * vertex_count floats. normals: as
     * many, filled with the unit vertex normals at that time where the mesh has normals (MarramMesh.normals), else left
     * as they are; NULL where they are not wanted.
     */
    MarramStatus (*pose)(void* pose_user, uint32_t mesh, double frame, float* positions, float* normals);
    void* pose_user;
} MarramFrame;

/* ---- What a procedural hands over -------------------------------------------------------------------------------- */

typedef enum MarramOutputKind { MARRAM_CURVES = 0, MARRAM_MESH = 1 } MarramOutputKind;
typedef enum MarramBasis { MARRAM_BSPLINE = 0, MARRAM_CATMULL_ROM = 1 } MarramBasis;
typedef enum MarramShape {
    MARRAM_ROUND = 0,           /* a swept circle */
    MARRAM_RIBBON = 1,          /* flat, faces every ray */
    MARRAM_ORIENTED_RIBBON = 2, /* flat, its normal handed over */
    MARRAM_SHAPE_COUNT
} MarramShape;

/* An attribute that curves can carry for shading and image layers; filled only when the renderer asks for it. */
typedef struct MarramAttribute {
    const char* name;    /* "root_normal", "root_uv", "id", "envelope", ... */
    uint32_t components; /* 1 ... 4 floats */
    uint32_t per_cv;     /* 0: one a curve; 1: one for each of its CVs */
    uint32_t discrete;   /* 1: a name rather than a quantity, such as an id: never averaged or interpolated */
    const char* help;
} MarramAttribute;

typedef struct MarramOutput {
    MarramOutputKind kind;
    /* MARRAM_CURVES */
    uint64_t curve_count;
    uint32_t cvs_per_curve; /* >= 2, the same for every curve and every motion sample */
    uint32_t patch_count;   /* patches follow each other in curve order */
    uint32_t time_count;    /* 1 where nothing moves within the shutter, else MarramFrame.time_count */
    MarramBasis basis;
    MarramShape shape;
    /* MARRAM_MESH */
    uint32_t vertex_count, triangle_count, has_uvs;
} MarramOutput;

typedef struct MarramPatch {
    uint64_t first_curve;
    uint32_t curve_count;
    float lower[3], upper[3];
} MarramPatch;

/*
 * Where a patch goes: straight into the buffers that Embree reads. A curve of n CVs takes n + 2 vertices (x, y, z, radius):
 * one before the root and one behind the tip, so that the drawn cubic starts in the root and ends in the tip:
 * V[0] = 2 P[0] - P[1], V[1..n] = P[0..n-1], V[n+1] = 2 P[n-1] - P[n-2], radii alike. Embree's segment k of the curve
 * starts at vertex k. Pointers are those of the patch's first curve.
 */
typedef struct MarramPatchBuffers {
    float* const* vertices; /* [output.time_count], 4 floats a vertex, 16-byte aligned */
    float* const*
        normals; /* [output.time_count], 3 floats a vertex; MARRAM_ORIENTED_RIBBON only, else NULL */
    uint32_t attribute_count; /* attributes asked for: indices into MarramProcedural.attributes */
    const uint32_t* attributes;
    float* const*
        attribute_values; /* [attribute_count]: curves * components, or curves * cvs_per_curve * components */
} MarramPatchBuffers;

typedef struct MarramMeshBuffers {
    float* positions; /* 3 * vertex_count, at the frame */
    uint32_t* triangles;
    float* uvs; /* NULL unless has_uvs */
} MarramMeshBuffers;

typedef struct MarramInstance MarramInstance; /* the procedural's own */

typedef struct MarramProcedural {
    const char* name; /* the `type` in scene files */
    const char* help;
    MarramOutputKind kind;
    const MarramParam* params;
    uint32_t param_count;
    const MarramAttribute* attributes;
    uint32_t attribute_count;
    /* values: all declared parameters, wind ones as "wind.<name>"; absent "none" ones are left out. What a procedural does
     * not say of the wind itself is the scene's; its own list of tables replaces the scene's list as a whole. */
    MarramStatus (*create)(const MarramHost* host, const MarramValue* values, uint32_t value_count,
                           MarramInstance** out);
    MarramStatus (*begin)(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out);
    MarramStatus (*patch)(MarramInstance* instance, uint32_t patch, MarramPatch* out);
    MarramStatus (*tessellate)(MarramInstance* instance, uint32_t patch, const MarramPatchBuffers* buffers);
    MarramStatus (*mesh)(MarramInstance* instance, const MarramMeshBuffers* buffers);
    /*
     * What was done since begin; what is not reported counts as 0. "seconds.roots", "seconds.chain": wall seconds within
     * begin, of placing roots and finding out dials, and of preparing collision.
     * "thread_seconds.expand", ".gusts", ".shield", ".bend", ".jiggle", ".collide": of tessellate, summed over threads.
     * "collision.contacts", ".pushed_out", ".unresolved", ".skipped_pushes", ".dips": counts. "collision.goal_angle",
     * ".turned_angle": radians, sums over segments. "memory.bytes": the most held at any time. "chosen.<dial>": where the
     * tolerance has put a dial that the scene left to it.
     */
    void (*report)(MarramInstance* instance, void (*sink)(void* user, const char* key, double value),
                   void* user);
    void (*destroy)(MarramInstance* instance);
} MarramProcedural;

typedef struct MarramLibrary {
    uint32_t abi; /* MARRAM_ABI_VERSION the library was built with */
    const char* name;
    const char* version;
    const MarramParam* wind_params; /* what a scene's one [wind] may say */
    uint32_t wind_param_count;
    const MarramProcedural* procedurals;
    uint32_t procedural_count;
} MarramLibrary;

/* The entry point. Returns NULL when the library cannot speak the version asked for. */
#define MARRAM_ENTRY_POINT "marram_library"
typedef const MarramLibrary* (*MarramLibraryFunction)(uint32_t abi);

#ifdef __cplusplus
}
#endif
#endif
