/* SPDX-License-Identifier: Apache-2.0 */
/*
 * THE CONTRACT between a renderer (the host) and a procedural: plain C99 data, plus the Embree handles that the host lends.
 * A procedural library is a shared library with one entry point, marram_library(). The host finds it by path, compares the
 * ABI number and Embree's major version, and knows nothing else of it.
 *
 * The scene is a graph. Meshes and curves of the scene are its leaves; a procedural depends on the geometry that its
 * parameters name (MARRAM_MESH_NAME, MARRAM_CURVES_NAME). Besides, a procedural that makes curves traces every mesh that
 * collides or shelters, so that it depends on those as well; one that makes a mesh traces the meshes that it names, no others.
 * The host makes instances in the order of these dependencies, whatever their order in the scene. A ring is an error.
 *
 *   lib = marram_library(MARRAM_ABI_VERSION)               once; NULL when the library speaks another version
 *   p->create(host, values, &instance)                    once for each procedural of the scene
 *   for each frame, in the order of the graph:
 *     p->prepare(instance, frame, states)                 if there is one: brings its simulation to the frame
 *     p->begin(instance, frame, &output)                  what will be handed over. Perhaps more than once, at other motion
 *                                                         samples, and a few patches after it: so a host learns how many
 *                                                         samples the motion needs
 *     MARRAM_MESH:   p->mesh(instance, &buffers)          the growth surface: lent, traced, grown on. No camera changes it
 *                    p->pose(instance, time, positions)   the same at any other time, any thread
 *                    p->begin_view, p->view_mesh          if there are: the render mesh, which the camera sees in its place
 *     MARRAM_CURVES: p->patch(instance, i, &patch)        bounds, from any thread
 *                    p->tessellate(instance, i, &b)       from any threads, in any order
 *     p->report(instance, sink, user)                     what was done since begin
 *   p->update(instance, update, &changed)                 values or inputs are others now; NULL: destroy and create
 *   p->destroy(instance)
 *
 * Conventions: right-handed, y up, metres, radians; frames are real numbers; matrices do not occur. Positions are floats.
 * Every call returns MARRAM_OK, or an error after having said why through host->message, or MARRAM_CANCELLED soon after
 * host->cancelled() has turned nonzero. Nothing is thrown across the border. Strings are UTF-8 and live as long as the
 * library (declarations) or the call (arguments). What an instance points to in what it fills (offsets, grids) lives until
 * its next begin, update or destroy.
 *
 * tessellate() is idempotent: the same frame and patch give the same bits whatever ran before and on whatever thread.
 * patch() is conservative: the box holds all that is drawn of the patch at every motion sample, width included.
 *
 * Growing: new fields go to the end of a struct, new callbacks to the end of MarramProcedural, and both sides go on working
 * with what they know. For that
 *   - a struct that is passed by itself begins with its `size`, set by whoever owns its memory: read or fill a field only if
 *     MARRAM_HAS(pointer, field);
 *   - an array comes with a count and a stride, the size of an element as its owner knows it: MARRAM_AT(type, first, stride, i);
 *   - no struct that may grow lies within another: it is pointed to;
 *   - a callback may be NULL, or missing, where its comment says so;
 *   - a parameter type that the host does not know disables the procedural that declares it, no other.
 * MARRAM_ABI_VERSION is raised only where that does not suffice. Both sides refuse any other version.
 */
#ifndef MARRAM_PLUGIN_H
#define MARRAM_PLUGIN_H

#include "embree.h" /* beside this file: so it is found in the source tree and where it is installed */

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MARRAM_ABI_VERSION 3u

/* Whether the owner of a struct knows a field of it. */
#define MARRAM_HAS(object, field)                                                                            \
    ((size_t)((const char*)(&(object)->field + 1) - (const char*)(object)) <= (object)->size)
/* Element i of an array, as a const type*. */
#define MARRAM_AT(type, first, stride, i)                                                                    \
    ((const type*)(const void*)((const char*)(first) + (size_t)(stride) * (size_t)(i)))

typedef enum MarramStatus { MARRAM_OK = 0, MARRAM_ERROR = 1, MARRAM_CANCELLED = 2 } MarramStatus;

/* ---- Geometry: what is lent, and in the same form what is handed over ---------------------------------------------- */

/* What an attribute has one value for. */
typedef enum MarramRate {
    MARRAM_PER_CURVE = 0,
    MARRAM_PER_CV = 1,
    MARRAM_PER_VERTEX = 2,
    MARRAM_PER_FACE = 3,
    MARRAM_RATE_COUNT
} MarramRate;

typedef struct MarramAttribute {
    const char* name;    /* "root_normal", "root_uv", "id", "envelope", "sand", ... */
    uint32_t components; /* 1 ... 4 floats */
    MarramRate rate;
    uint32_t discrete;   /* 1: a name rather than a quantity, such as an id: never averaged or interpolated */
    const char* help;    /* one line */
    const float* values; /* components floats a curve, CV, vertex or face; NULL in a declaration */
    uint32_t animated;   /* 1: differs from frame to frame, so that nothing can be placed by it */
} MarramAttribute;

/*
 * Values on a grid: images, masks, tables, lattices, wind fields. Sample (i, j, k) has its components at
 * values + components * (i + nx * (j + ny * k)) and stands at origin + i axes[0] + j axes[1] + k axes[2].
 */
typedef struct MarramGrid {
    const char* name;
    uint32_t nx, ny, nz; /* 1 or more */
    uint32_t components; /* 1 ... 4 */
    double origin[3]; /* metres; of an image (u, v, 0) of its first pixel's centre, the one at the top left */
    double axes[3][3]; /* from a sample to the next in x, y, z */
    const float* values;
} MarramGrid;

/* Where the file of an image says that its pixels lie, and what they mean. */
typedef struct MarramPlacement {
    size_t size;
    uint32_t has_center, has_extent, has_range; /* 0: the file does not say */
    double center[2];                           /* metres, x and z: the middle of the image */
    double extent[2]; /* metres, x and z, above 0: pixels and all, not from centre to centre */
    double range[2];  /* what the values 0 and 1 stand for, such as heights in metres */
} MarramPlacement;

/* What a mesh is there for; bits. As Embree's geometry masks they say which rays meet it. */
typedef enum MarramRole {
    MARRAM_COLLIDES = 1,       /* strands do not enter it */
    MARRAM_SHELTERS = 2,       /* strands behind it stand in its lee */
    MARRAM_CASTS_SHADOWS = 4,  /* light does not pass it, neither direct nor indirect */
    MARRAM_SEEN_BY_CAMERA = 8, /* camera rays meet it */
    MARRAM_ALL_ROLES = 15,
    MARRAM_NAMED =
        16 /* in every mask: what a procedural names it can trace by this bit, whatever its roles */
} MarramRole;

/* A triangle mesh at the motion samples of the frame. Vertices on a uv seam may stand twice. */
typedef struct MarramMesh {
    const char* name;
    uint32_t geometry_id; /* in MarramFrame.colliders and in the world */
    uint32_t roles;       /* MarramRole */
    uint32_t vertex_count, triangle_count;
    uint32_t time_count;               /* 1 for a mesh that rests, else MarramFrame.time_count */
    const float* const* positions;     /* [time_count], xyz packed */
    const float* const* normals;       /* [time_count], xyz packed unit vertex normals; NULL: facetted */
    const uint32_t* triangles;         /* 3 a triangle, anticlockwise seen from outside */
    const float* uvs;                  /* 2 a vertex; NULL where the mesh has none */
    const MarramAttribute* attributes; /* per vertex or per face */
    uint32_t attribute_count, attribute_stride;
    const MarramGrid* grids;
    uint32_t grid_count, grid_stride;
    uint64_t topology; /* a digest of its triangles: two meshes with one have the same */
    /* Of an instance: 1 + the index in MarramFrame.meshes of the mesh that it shows once more, which is none itself, has the same triangles,
     * and stands before it. What grows on that mesh grows on the instance, too. 0: it is no instance. */
    uint32_t instance_of;
} MarramMesh;

typedef enum MarramBasis { MARRAM_BSPLINE = 0, MARRAM_CATMULL_ROM = 1, MARRAM_LINEAR = 2 } MarramBasis;

/*
 * Curves. One of n CVs takes n + 2 vertices (x, y, z, radius): one before the root and one behind the tip, so that the
 * drawn cubic starts in the root and ends in the tip: V[0] = 2 P[0] - P[1], V[1..n] = P[0..n-1], V[n+1] = 2 P[n-1] - P[n-2],
 * radii alike. Curve c has cvs_per_curve CVs and begins at vertex c * (cvs_per_curve + 2); where counts differ it has
 * offsets[c + 1] - offsets[c] and begins at vertex offsets[c] + 2 c.
 */
typedef struct MarramCurves {
    const char* name;
    uint64_t curve_count;
    uint32_t cvs_per_curve;       /* 0: see offsets */
    const uint64_t* offsets;      /* [curve_count + 1], from 0; NULL where all have as many CVs */
    uint32_t time_count;          /* 1 for curves that rest, else MarramFrame.time_count */
    const float* const* vertices; /* [time_count], 4 floats a vertex */
    const uint32_t* closed;       /* [curve_count], 1: the last CV is joined to the first; NULL: none is */
    MarramBasis basis;            /* how they are drawn: MARRAM_LINEAR through the CVs, as polylines are */
    const MarramAttribute* attributes; /* per curve or per CV */
    uint32_t attribute_count, attribute_stride;
    uint32_t moves; /* 1: they stand elsewhere at other frames, see MarramFrame.pose_curves */
} MarramCurves;

/* ---- Parameters ------------------------------------------------------------------------------------------------- */

typedef enum MarramParamType {
    MARRAM_BOOLEAN, /* numbers[0] is 0 or 1 */
    MARRAM_INTEGER, /* numbers[0] */
    MARRAM_NUMBER,  /* numbers[0] */
    MARRAM_VEC2,    /* numbers[0..1] */
    MARRAM_VEC3,    /* numbers[0..2] */
    MARRAM_RANGE,   /* numbers[0..1], low <= high */
    MARRAM_COLOR,   /* numbers[0..2], linear */
    MARRAM_TEXT,    /* text */
    MARRAM_CHOICE,  /* text, one of choices "a|b|c" */
    MARRAM_RAMP,    /* numbers = p0 v0 p1 v1 ..., text = "linear" | "smooth" | "constant" */
    MARRAM_IMAGE, /* grid: the host has read the file; rows from the top, linear values, nz = 1. text = its path */
    MARRAM_MESH_NAME, /* text = name of a mesh, scene's or procedural's, given in MarramFrame.meshes: a dependency */
    MARRAM_KEYS, /* keyed transform: numbers = 10 a key: frame, translate xyz, rotate xyz in degrees, scale xyz,
                           frames ascending; text = "linear" | "smooth". Scale, then rotate about x, y, z, then translate */
    MARRAM_UNAVAILABLE, /* declared so that a scene that asks for it is told; never handed over */
    MARRAM_CURVES_NAME, /* text = name of curves, scene's or procedural's, given in MarramFrame.curves: a dependency */
    MARRAM_TABLE, /* grid: a table of numbers that the host has read from CSV, nx columns, ny rows, 1 component;
                           text = the columns' names, separated by commas */
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
    /* "a|b|c" of a choice; "each" of a MARRAM_MESH_NAME where a scene may name several: an instance is made for each; else "" */
    const char* choices;
    const char* help; /* one line */
    const char*
        sweep; /* values that a measurement of speed against error tries, as in a scene: "1|4|16"; "" or NULL: none */
    const char*
        sweep_time; /* the report entry whose seconds it changes: "seconds.shield"; "" or NULL: of all stages */
} MarramParam;

/*
 * A list of tables whose elements each have a type with parameters of its own: [[procedural.layer]] type = "dune". One entry
 * is one type. The values of element 2 come as "layer[2].type" (MARRAM_CHOICE) and "layer[2].<name>".
 */
typedef struct MarramItemType {
    const char* list; /* "layer" */
    const char* type; /* "dune" */
    const char* help;
    const MarramParam* params;
    uint32_t param_count, param_stride;
} MarramItemType;

typedef struct MarramValue {
    const char* name;
    MarramParamType type;
    const double* numbers;
    size_t number_count;
    const char* text;                 /* "" where there is none */
    const MarramGrid* grid;           /* NULL where there is none */
    const char* place;                /* "file:line:column" to begin a message with */
    const MarramPlacement* placement; /* of MARRAM_IMAGE; NULL where the file does not say */
    /* Of MARRAM_CURVES_NAME: what the scene's curves of that name carry, without values; none where the host does not know yet. */
    const MarramAttribute* attributes;
    uint32_t attribute_count, attribute_stride;
} MarramValue;

/* All declared parameters, wind ones as "wind.<name>"; absent "none" ones are left out. What a procedural does not say of the
 * wind itself is the scene's; its own list of tables replaces the scene's list as a whole. */
typedef struct MarramValues {
    size_t size;
    const MarramValue* first;
    uint32_t count, stride;
} MarramValues;

/* ---- What the host lends ----------------------------------------------------------------------------------------- */

/* Information is shown at once, warnings with the frame that they are about; faults are why a call returns MARRAM_ERROR. */
typedef enum MarramSeverity { MARRAM_INFO = 0, MARRAM_WARNING = 1, MARRAM_FAULT = 2 } MarramSeverity;

typedef struct MarramMessage {
    size_t size;
    MarramSeverity severity;
    const char* id;     /* "groom.no_mesh": for programs; never changes its meaning */
    const char* place;  /* "file:line:column"; "": the table of the procedural */
    const char* what;   /* what is wrong, or what there is to know; one line */
    const char* remedy; /* what to do; "" where there is nothing to do */
} MarramMessage;

typedef struct MarramHost { /* valid from create to destroy; every function may be called from any thread */
    size_t size;
    void* user;
    void (*message)(void* user, const MarramMessage* message);
    int (*cancelled)(void* user); /* cheap; ask at least every few milliseconds */
    /* How much of prepare() is done, 0 ... 1, and in words: "4.2 years of 10". May be NULL. */
    void (*progress)(void* user, double share, const char* words);
} MarramHost;

/*
 * What a simulation keeps of its past: bytes, stamped with a frame. The host keeps them from run to run and forgets them when
 * the procedural's values, its inputs, files that these come from, or the library's version change.
 */
typedef struct MarramState {
    size_t size;
    double frame;
    const void* data;
    size_t byte_count;
} MarramState;

typedef struct MarramStates { /* valid while prepare() runs; from one thread at a time */
    size_t size;
    void* user;
    /* The latest state at or before the frame; its data, which is there until the next load, is NULL where there is none. */
    MarramStatus (*load)(void* user, double frame, MarramState* out);
    /* Keeps a copy; one of the same frame is replaced. */
    MarramStatus (*store)(void* user, const MarramState* state);
} MarramStates;

typedef enum MarramStage { MARRAM_REST = 0, MARRAM_BENT = 1, MARRAM_FINAL = 2 } MarramStage;

typedef struct MarramFrame { /* valid from begin until the frame's last call, report included */
    size_t size;
    double fps, frame;
    double bind_frame;   /* where roots are placed: the same for every frame of a shot */
    uint32_t time_count; /* motion samples, 1 ... 64 */
    const double* times; /* in frames, ascending; equally spaced over the shutter */
    MarramStage stage;   /* stop after this one */
    double tolerance;    /* metres; 0: a thousandth of a strand's length, or less where less is cheap */
    RTCDevice device;
    /* Committed; to be traced and queried only: of the meshes below, each under its geometry_id, with its roles as mask. NULL
     * where there is no mesh to trace. */
    RTCScene colliders;
    const MarramMesh* meshes; /* those that are named, and for curves all that collide or shelter */
    uint32_t mesh_count, mesh_stride;
    /*
     * A mesh at any time (frames), also outside the shutter; any thread. `mesh` is an index into meshes. positions: 3 *
     * vertex_count floats. normals: as many, filled with the unit vertex normals at that time where the mesh has normals
     * (MarramMesh.normals), else left as they are; NULL where they are not wanted.
     */
    MarramStatus (*pose)(void* pose_user, uint32_t mesh, double frame, float* positions, float* normals);
    void* pose_user;
    const MarramCurves* curves; /* those that are named */
    uint32_t curves_count, curves_stride;
    /*
     * Some curves at any time (frames), also outside the shutter; any thread. `curves` is an index into them. vertices: 4 floats for
     * each vertex of those curves. Curves that a procedural makes are known within the shutter alone, and rest before and behind it.
     * NULL: the host cannot tell.
     */
    MarramStatus (*pose_curves)(void* pose_user, uint32_t curves, double frame, uint64_t first_curve,
                                uint64_t curve_count, float* vertices);
    /*
     * What takes a mesh, as it stands in the world, to an instance of it, which `mesh` is the index of; at any time; any thread. matrix: 12
     * numbers, m[0] x + m[1] y + m[2] z + m[3] and so on for y and z; a turn, a translation and one scale for all axes, not 0. NULL where no
     * mesh is an instance.
     */
    MarramStatus (*instance_transform)(void* pose_user, uint32_t mesh, double frame, double* matrix);
} MarramFrame;

/* The camera, which render meshes are made for and nothing else. Any time between two samples is a straight blend. */
typedef struct MarramView {
    size_t size;
    double frame;
    uint32_t time_count;      /* 1 ... 64 */
    const double* times;      /* in frames, ascending */
    const double* positions;  /* [time_count], xyz packed */
    const double* directions; /* [time_count], unit: where it looks */
    const double* ups;        /* [time_count], unit, at right angles to the directions */
    double fov;               /* vertical angle of view */
    uint32_t width, height;   /* pixels */
    double tolerance;         /* metres, 0: see tolerance_pixels */
    double tolerance_pixels;  /* pixels, 0: half a one */
} MarramView;

/* ---- What a procedural hands over -------------------------------------------------------------------------------- */

typedef enum MarramOutputKind { MARRAM_CURVES = 0, MARRAM_MESH = 1 } MarramOutputKind;
typedef enum MarramShape {
    MARRAM_ROUND = 0,           /* a swept circle */
    MARRAM_RIBBON = 1,          /* flat, faces every ray */
    MARRAM_ORIENTED_RIBBON = 2, /* flat, its normal handed over */
    MARRAM_SHAPE_COUNT
} MarramShape;

typedef struct MarramOutput { /* the host sets size, and all else to zero */
    size_t size;
    MarramOutputKind kind;
    uint32_t time_count; /* 1 where nothing moves within the shutter, else MarramFrame.time_count */
    /* MARRAM_CURVES; see MarramCurves for the layout */
    uint64_t curve_count;
    uint32_t cvs_per_curve;  /* 2 or more, at every motion sample; 0: see offsets */
    const uint64_t* offsets; /* [curve_count + 1]; 2 CVs or more a curve; NULL where all have as many */
    uint32_t patch_count;    /* patches follow each other in curve order */
    MarramBasis basis;       /* MARRAM_BSPLINE or MARRAM_CATMULL_ROM */
    MarramShape shape;
    /* MARRAM_MESH */
    uint32_t vertex_count, triangle_count, has_uvs;
    uint32_t has_normals; /* 0: the host makes vertex normals from the triangles */
    /* Of mesh() and of view_mesh(), each by itself: what this instance hands over under one number is the same to the bit, attributes and
     * grids included, so that the host may keep it and not ask again. 0: ask. */
    uint64_t version;
} MarramOutput;

typedef struct MarramPatch {
    size_t size;
    uint64_t first_curve;
    uint32_t curve_count;
    float lower[3], upper[3];
} MarramPatch;

/* Where a patch goes: straight into the buffers that Embree reads. Pointers are those of the patch's first curve. */
typedef struct MarramPatchBuffers {
    size_t size;
    float* const* vertices; /* [output.time_count], 4 floats a vertex, 16-byte aligned */
    float* const*
        normals; /* [output.time_count], 3 floats a vertex; MARRAM_ORIENTED_RIBBON only, else NULL */
    uint32_t attribute_count; /* attributes asked for: indices into the instance's */
    const uint32_t* attributes;
    float* const* attribute_values; /* [attribute_count] */
} MarramPatchBuffers;

typedef struct MarramMeshBuffers {
    size_t size;
    float* const* positions; /* [output.time_count], 3 * vertex_count */
    uint32_t* triangles;     /* 3 * triangle_count */
    float* uvs;              /* NULL unless has_uvs */
    uint32_t attribute_count;
    const uint32_t* attributes;
    float* const* attribute_values;
    const MarramGrid* grids; /* filled in by the procedural, whose they stay */
    uint32_t grid_count, grid_stride;
    float* const* normals; /* [output.time_count], 3 * vertex_count, unit; NULL unless has_normals */
} MarramMeshBuffers;

typedef struct MarramAttributeList {
    size_t size;
    const MarramAttribute* attributes;
    uint32_t count, stride;
} MarramAttributeList;

/* What an update touched, bits. What it did not touch is as it was, to the bit. */
typedef enum MarramChange {
    MARRAM_NOTHING = 0,
    MARRAM_ATTRIBUTES = 1, /* attributes and grids */
    MARRAM_POSITIONS = 2,
    MARRAM_TOPOLOGY = 4,
    MARRAM_EVERYTHING = 7
} MarramChange;

typedef struct MarramUpdate {
    size_t size;
    const MarramValues* values; /* all of them, changed or not */
    uint32_t inputs; /* MarramChange: what has changed of the geometry that the procedural depends on */
} MarramUpdate;

/* How the entries of one path from several procedurals become one. */
typedef enum MarramCombine {
    MARRAM_SUM = 0,
    MARRAM_MAXIMUM = 1,
    MARRAM_LAST = 2,
    MARRAM_EACH = 3, /* not at all: kept under the name of each procedural */
    MARRAM_RATIO = 4 /* not reported: numerator / denominator, of two other paths; 1 where the latter is 0 */
} MarramCombine;

/*
 * What a procedural may report. Units: "s" wall seconds, "thread s" seconds summed over threads, "count", "bytes", "rad", ...
 * An entry "thread_seconds.<stage>" in "thread s" tells how tessellate() spent its time: the host shares out the wall seconds
 * among such entries and shows them as "seconds.<stage>".
 */
typedef struct MarramReportEntry {
    const char* path; /* "collision.contacts" */
    const char* unit;
    MarramCombine combine;
    const char *numerator, *denominator; /* paths, of a ratio; else NULL */
    const char* help;                    /* one line */
} MarramReportEntry;

typedef struct MarramInstance MarramInstance; /* the procedural's own */

typedef struct MarramProcedural {
    const char* name; /* the `type` in scene files */
    const char* help;
    MarramOutputKind kind;
    const MarramParam* params;
    uint32_t param_count, param_stride;
    const MarramAttribute* attributes; /* that every instance has; values are NULL */
    uint32_t attribute_count, attribute_stride;
    MarramStatus (*create)(const MarramHost* host, const MarramValues* values, MarramInstance** out);
    MarramStatus (*begin)(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out);
    MarramStatus (*patch)(MarramInstance* instance, uint32_t patch, MarramPatch* out); /* NULL for a mesh */
    MarramStatus (*tessellate)(MarramInstance* instance, uint32_t patch,
                               const MarramPatchBuffers* buffers);              /* likewise */
    MarramStatus (*mesh)(MarramInstance* instance, MarramMeshBuffers* buffers); /* NULL for curves */
    /* What was done since begin, by the library's paths; what is not reported counts as 0. May be NULL. */
    void (*report)(MarramInstance* instance, void (*sink)(void* user, const char* path, double value),
                   void* user);
    void (*destroy)(MarramInstance* instance);
    /* Each of what follows may be NULL. */
    const MarramItemType* item_types;
    uint32_t item_type_count, item_type_stride;
    /* The attributes of this instance instead of the type's; asked for once, after create and after each update. */
    MarramStatus (*attributes_of)(MarramInstance* instance, MarramAttributeList* out);
    /* A mesh at any time, after mesh(): 3 * vertex_count floats, any thread. NULL: it is the same at every time. */
    MarramStatus (*pose)(MarramInstance* instance, double frame, float* positions);
    /* The render mesh, after mesh(): out->triangle_count 0 means that the growth surface is what is seen. */
    MarramStatus (*begin_view)(MarramInstance* instance, const MarramView* view, MarramOutput* out);
    MarramStatus (*view_mesh)(MarramInstance* instance, MarramMeshBuffers* buffers);
    /* Computes what the frame needs of the past, loading and storing states. frame: as of begin. */
    MarramStatus (*prepare)(MarramInstance* instance, const MarramFrame* frame, const MarramStates* states);
    /* Takes over new values and says what that changes of the output. An error leaves the instance as it was. */
    MarramStatus (*update)(MarramInstance* instance, const MarramUpdate* update, uint32_t* changed);
    /* What it has generated, since begin, as text of a scene that draws the same by hand: to be pasted into a scene file and edited.
     * The sink is called for one piece of text after the other, perhaps never. */
    MarramStatus (*describe)(MarramInstance* instance, void (*sink)(void* user, const char* text),
                             void* user);
} MarramProcedural;

typedef struct MarramLibrary {
    uint32_t abi;          /* MARRAM_ABI_VERSION the library was built with; always the first field */
    uint32_t embree_major; /* MARRAM_EMBREE_MAJOR it was built with; 0 where it never calls Embree */
    size_t size;
    const char* name;
    const char* version;
    const MarramParam* wind_params; /* what a scene's one [wind] may say */
    uint32_t wind_param_count, wind_param_stride;
    const MarramProcedural* procedurals;
    uint32_t procedural_count, procedural_stride;
    const MarramReportEntry* report_entries; /* of all its procedurals */
    uint32_t report_entry_count, report_entry_stride;
} MarramLibrary;

/* The entry point. Returns NULL when the library cannot speak the version asked for. */
#define MARRAM_ENTRY_POINT "marram_library"
typedef const MarramLibrary* (*MarramLibraryFunction)(uint32_t abi);

#ifdef __cplusplus
}
#endif
#endif
