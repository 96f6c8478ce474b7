/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The contract between a renderer (the host) and a procedural: plain C99 data, plus Embree handles owned by
 * the host. A procedural library is a shared library with one entry point, marram_library(). The host loads
 * it by path and compares the ABI number and Embree's major version. It knows nothing else about the library.
 *
 * The scene is a graph. Meshes and curves of the scene are its leaves. A procedural depends on the geometry
 * that its parameters name (MARRAM_MESH_NAME, MARRAM_CURVES_NAME). A procedural that makes curves also traces
 * every mesh that collides or shelters, and so depends on these too; one that makes a mesh traces only the
 * meshes that it names. The host makes instances in the order of these dependencies, not in the order of the
 * scene. A cycle is an error.
 *
 *   lib = marram_library(MARRAM_ABI_VERSION)               once; NULL if the library has another version
 *   p->create(host, values, &instance)                    once for each procedural of the scene
 *   for each frame, in the order of the graph:
 *     p->prepare(instance, frame, states)                 optional: advances its simulation to the frame
 *     p->begin(instance, frame, &output)                  describes the output. May be called several times
 *                                                         with other motion samples, each followed by a few
 *                                                         patches: the host measures how many it needs
 *     MARRAM_MESH:   p->mesh(instance, &buffers)          the growth surface: lent, traced, grown on;
 *                                                         independent of the camera
 *                    p->pose(instance, time, positions)   the same at any other time; any thread
 *                    p->begin_view, p->view_mesh          optional: the render mesh, rendered instead
 *     MARRAM_CURVES: p->patch(instance, i, &patch)        bounds; any thread
 *                    p->tessellate(instance, i, &b)       any threads, in any order
 *     p->report(instance, sink, user)                     statistics since begin
 *   p->update(instance, update, &changed)                 values or inputs changed; NULL: destroy, create
 *   p->destroy(instance)
 *
 * Conventions: right-handed, y up, metres, radians; frames are real numbers; matrices are used only by
 * instance_transform(). Positions are floats. Every call returns MARRAM_OK; or MARRAM_ERROR, after a message
 * through host->message that says why; or MARRAM_CANCELLED, soon after host->cancelled() has become nonzero.
 * No exception crosses the interface. Strings are UTF-8 and live as long as the library (declarations) or the
 * call (arguments). Memory that an instance points to in structs that it fills (offsets, grids) lives until
 * its next begin, update or destroy.
 *
 * tessellate() is idempotent: the same frame and patch give the same bits, independent of earlier calls and
 * of threads. patch() is conservative: the box contains all curves of the patch at every motion sample,
 * including their width.
 *
 * Extension: new fields go to the end of a struct, new callbacks to the end of MarramProcedural. Both sides
 * continue to work with the fields that they know. Therefore
 *   - a struct that is passed by itself begins with its `size`, set by the owner of its memory: read or fill
 *     a field only if MARRAM_HAS(pointer, field); a size of 0 is refused as a mistake;
 *   - an array comes with a count and a stride, the size of an element for its owner:
 *     MARRAM_AT(type, first, stride, i);
 *   - a struct that may grow is never embedded in another: it is pointed to;
 *   - a callback may be NULL, or missing, where its comment says so;
 *   - a parameter type that the host does not know disables the procedural that declares it, and no other.
 * MARRAM_ABI_VERSION is raised only if that is not enough. Both sides reject any other version.
 */
#ifndef MARRAM_PLUGIN_H
#define MARRAM_PLUGIN_H

#include "embree.h" /* in the same folder, in the source tree and when installed */
#include "marram_types.h"

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

/* ---- Geometry, lent by the host or made by a procedural ------------------------------------------------ */

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
    uint32_t discrete;   /* 1: values are identifiers: never average or interpolate them */
    const char* help;    /* one line */
    const float* values; /* `components` floats per curve, CV, vertex or face; NULL in a declaration */
    uint32_t animated;   /* 1: changes from frame to frame, so strands cannot be placed by it */
} MarramAttribute;

/*
 * Values on a grid: images, masks, tables, lattices, wind fields. Sample (i, j, k) has its components at
 * values + components * (i + nx * (j + ny * k)) and the position origin + i axes[0] + j axes[1] + k axes[2].
 */
typedef struct MarramGrid {
    const char* name;
    uint32_t nx, ny, nz; /* 1 or more */
    uint32_t components; /* 1 ... 4 */
    /* Metres; of an image: (u, v, 0) of the center of the top left pixel. An image whose name contains <UDIM> covers all of its
       tiles, each a unit square of uv with as many pixels; missing tiles are NaN. */
    double origin[3];
    double axes[3][3]; /* from a sample to the next in x, y, z */
    const float* values;
} MarramGrid;

/*
 * Vectors in space, which may change in time: a grid of three components (along x, y and z of the scene) for each of
 * its frames. Between frames they are interpolated linearly; before the first and after the last they are constant.
 * The grids may differ in size and place. Not copied: unlike other values, a volume lives until the update that
 * replaces it has returned MARRAM_OK, or the instance is destroyed.
 */
typedef struct MarramVolume {
    size_t size;
    uint32_t count; /* of grids, 1 or more */
    uint32_t grid_stride;
    const MarramGrid* grids; /* [count] */
    const double* frames;    /* [count], strictly ascending; NULL with one grid, which holds at all times */
    uint32_t staggered; /* 1: component a of each sample is half a step before its position along axes[a] */
} MarramVolume;

/* Position and range of an image, from its file. */
typedef struct MarramPlacement {
    size_t size;
    uint32_t has_center, has_extent, has_range; /* 0: not in the file */
    double center[2];                           /* metres, x and z: the center of the image */
    double extent[2]; /* metres, x and z, > 0: including the border pixels, not from center to center */
    double range[2];  /* meaning of the values 0 and 1, such as heights in metres */
} MarramPlacement;

/* The roles of a mesh, as bits. Used as Embree's geometry mask, they select the rays that can hit it. */
typedef enum MarramRole {
    MARRAM_COLLIDES = 1,       /* strands do not enter it */
    MARRAM_SHELTERS = 2,       /* strands behind it are in its lee */
    MARRAM_CASTS_SHADOWS = 4,  /* blocks light, direct and indirect */
    MARRAM_SEEN_BY_CAMERA = 8, /* camera rays hit it */
    MARRAM_ALL_ROLES = 15,
    MARRAM_NAMED = 16 /* set in every mask: selects meshes that a procedural names, whatever their roles */
} MarramRole;

/* A triangle mesh at the motion samples of the frame. Vertices on a uv seam may be duplicated. */
typedef struct MarramMesh {
    const char* name;
    uint32_t geometry_id; /* in MarramFrame.colliders and in the world */
    uint32_t roles;       /* MarramRole */
    uint32_t vertex_count, triangle_count;
    uint32_t time_count;               /* 1 for a static mesh, else MarramFrame.time_count */
    const float* const* positions;     /* [time_count], xyz packed */
    const float* const* normals;       /* [time_count], xyz packed unit vertex normals; NULL: facetted */
    const uint32_t* triangles;         /* 3 per triangle, counter-clockwise seen from outside */
    const float* uvs;                  /* 2 per vertex; NULL if the mesh has none */
    const MarramAttribute* attributes; /* per vertex or per face */
    uint32_t attribute_count, attribute_stride;
    const MarramGrid* grids;
    uint32_t grid_count, grid_stride;
    uint64_t topology; /* a digest of the triangles: meshes with the same digest have the same triangles */
    /* 0: not an instance. Else 1 + the index in MarramFrame.meshes of the mesh that it instances. That mesh
     * is not an instance itself, has the same triangles and comes before it. Strands on that mesh are
     * instanced with it. */
    uint32_t instance_of;
    /* 1: its vertices differ at other frames, see MarramFrame.pose. 0 with one motion sample: they never do, and the past
     * is not asked for. */
    uint32_t moves;
} MarramMesh;

typedef enum MarramBasis { MARRAM_BSPLINE = 0, MARRAM_CATMULL_ROM = 1, MARRAM_LINEAR = 2 } MarramBasis;

/*
 * Curves. A curve of n CVs has n + 2 vertices (x, y, z, radius): one before the root and one after the tip,
 * so that the cubic starts at the root and ends at the tip:
 *   V[0] = 2 P[0] - P[1], V[1..n] = P[0..n-1], V[n+1] = 2 P[n-1] - P[n-2], and the radii likewise.
 * Curve c has cvs_per_curve CVs and begins at vertex c * (cvs_per_curve + 2). If counts differ, it has
 * offsets[c + 1] - offsets[c] CVs and begins at vertex offsets[c] + 2 c.
 */
typedef struct MarramCurves {
    const char* name;
    uint64_t curve_count;
    uint32_t cvs_per_curve;       /* 0: see offsets */
    const uint64_t* offsets;      /* [curve_count + 1], from 0; NULL if all have the same number of CVs */
    uint32_t time_count;          /* 1 for static curves, else MarramFrame.time_count */
    const float* const* vertices; /* [time_count], 4 floats per vertex */
    const uint32_t* closed;       /* [curve_count], 1: the last CV is joined to the first; NULL: none is */
    MarramBasis basis;            /* MARRAM_LINEAR: polylines through the CVs */
    const MarramAttribute* attributes; /* per curve or per CV */
    uint32_t attribute_count, attribute_stride;
    uint32_t moves; /* 1: they differ at other frames, see MarramFrame.pose_curves */
} MarramCurves;

/* ---- Parameters ------------------------------------------------------------------------------------------------- */

/*
 * Names are dotted for nested tables: "noise.octaves". One table in a name may be followed by []. It is then
 * a list of tables, and each element has the parameter: "gusts.control[].shape" is [[wind.gusts.control]]
 * shape = "box" in a scene. Its values are passed as "gusts.control[0].shape", "gusts.control[1].shape", ...,
 * numbered without gaps, with defaults filled in for each element. A list that is absent or empty has no
 * values.
 */
typedef struct MarramParam {
    const char* name;
    MarramParamType type; /* marram_types.h says what its values hold */
    const char* unit;     /* "m", "deg", "m/s", "1/m", "frames"; "": no unit */
    const char* initial;  /* default, in TOML as in a scene file; "": must be given; "none": may be absent */
    double minimum, maximum; /* of every component, both ends allowed */
    /* "a|b|c" of a choice; "each" of a MARRAM_MESH_NAME that may be a list: one instance for each; "uv" of a MARRAM_IMAGE that may
       be in UDIM tiles, "fur.<UDIM>.png"; else "" */
    const char* choices;
    const char* help; /* one line */
    /* Values that `marram measure` tries, as in a scene: "1|4|16", or "1..levels": all integers up to the parameter
       `levels`. "" or NULL: none. */
    const char* sweep;
    /* The report entry whose seconds it affects: "seconds.shield". "" or NULL: all stages. */
    const char* sweep_time;
    uint32_t keyable; /* 1: its numbers may change in time, see MarramValue.keyframes */
} MarramParam;

/*
 * A list of tables whose elements have types, each with its own parameters:
 * [[procedural.layer]] type = "dune". This struct describes one type. The values of element 2 are passed as
 * "layer[2].type" (MARRAM_CHOICE) and "layer[2].<name>".
 */
typedef struct MarramItemType {
    const char* list; /* "layer" */
    const char* type; /* "dune" */
    const char* help;
    const MarramParam* params;
    uint32_t param_count, param_stride;
} MarramItemType;

/* How the numbers of a value change in time. Each number is interpolated by itself; before the first key and
 * after the last it is constant. */
typedef struct MarramKeyframes {
    size_t size;
    uint32_t count;            /* 1 or more */
    const double* frames;      /* [count], strictly ascending */
    const double* numbers;     /* [count * MarramValue.number_count] */
    const char* interpolation; /* "linear", "smooth" (flat at every key) or "constant" (until the next key) */
} MarramKeyframes;

typedef struct MarramValue {
    const char* name;
    MarramParamType type;
    const double* numbers;
    size_t number_count;
    const char* text;                 /* "" if there is none */
    const MarramGrid* grid;           /* NULL if there is none */
    const char* place;                /* "file:line:column", to begin a message with */
    const MarramPlacement* placement; /* of MARRAM_IMAGE; NULL if the file has none */
    /* Of MARRAM_CURVES_NAME: the attributes of the scene's curves of that name, without values; none if not
     * known yet. */
    const MarramAttribute* attributes;
    uint32_t attribute_count, attribute_stride;
    /* Only of a keyable parameter; NULL if the value is constant. `numbers` are those of the first key. */
    const MarramKeyframes* keyframes;
    const MarramVolume* volume; /* of MARRAM_VOLUME; NULL if there is none */
} MarramValue;

/* All declared parameters; those of the wind as "wind.<name>". Absent parameters with the default "none" are
 * left out. Wind parameters that a procedural does not set have the scene's values; its own list of tables
 * replaces the scene's whole list. */
typedef struct MarramValues {
    size_t size;
    const MarramValue* first;
    uint32_t count, stride;
} MarramValues;

/* ---- What the host provides ---------------------------------------------------------------------------- */

/* Information is shown at once, warnings with their frame. A fault is the reason why a call returns
 * MARRAM_ERROR. A common warning holds for the scene only if every instance that makes curves sends it in the same
 * frame: one groom that no gust touches is no mistake. */
typedef enum MarramSeverity {
    MARRAM_INFO = 0,
    MARRAM_WARNING = 1,
    MARRAM_FAULT = 2,
    MARRAM_COMMON_WARNING = 3
} MarramSeverity;

typedef struct MarramMessage {
    size_t size;
    MarramSeverity severity;
    const char* id;     /* "groom.no_mesh": for programs; its meaning never changes */
    const char* place;  /* "file:line:column"; "": the table of the procedural */
    const char* what;   /* the problem, or the information; one line */
    const char* remedy; /* what to do; "" if there is nothing to do */
} MarramMessage;

typedef struct MarramHost { /* valid from create to destroy; every function may be called from any thread */
    size_t size;
    void* user;
    void (*message)(void* user, const MarramMessage* message);
    /* Cheap: called at least every few milliseconds. Once it is nonzero it stays so until the call has returned. */
    int (*cancelled)(void* user);
    /* Progress of prepare(): 0 ... 1, and a text, "4.2 years of 10". May be NULL. */
    void (*progress)(void* user, double share, const char* words);
    /*
     * The host's task executor: calls task(data, index) once for each index below count, in any order, from any
     * threads, and returns when all calls have returned and what they wrote is visible. A call stays on one
     * thread and throws nothing. May be called from within a task. NULL: the library runs its loops on TBB.
     */
    void (*parallel_for)(void* user, uint64_t count, void (*task)(void* data, uint64_t index), void* data);
} MarramHost;

/*
 * A saved state of a simulation: bytes with a frame. The host keeps states from run to run, and discards them
 * when the procedural's values, its inputs, the files that these come from, or the library's version change.
 */
typedef struct MarramState {
    size_t size;
    double frame;
    const void* data;
    size_t byte_count;
} MarramState;

typedef struct MarramStates { /* valid while prepare() runs; one thread at a time */
    size_t size;
    void* user;
    /* The latest state at or before the frame. Its data is valid until the next load; NULL if there is no
     * state. */
    MarramStatus (*load)(void* user, double frame, MarramState* out);
    /* Keeps a copy, and replaces a state of the same frame. */
    MarramStatus (*store)(void* user, const MarramState* state);
} MarramStates;

typedef enum MarramStage { MARRAM_REST = 0, MARRAM_BENT = 1, MARRAM_FINAL = 2 } MarramStage;

/* The camera: for render meshes and levels of detail only. Interpolate linearly between samples. */
typedef struct MarramView {
    size_t size;
    double frame;
    uint32_t time_count;      /* 1 ... 64 */
    const double* times;      /* in frames, ascending */
    const double* positions;  /* [time_count], xyz packed */
    const double* directions; /* [time_count], unit view directions */
    const double* ups;        /* [time_count], unit, perpendicular to the directions */
    double fov;               /* vertical angle of view, radians */
    uint32_t width, height;   /* pixels */
    double tolerance;         /* metres, 0: see tolerance_pixels */
    double tolerance_pixels;  /* pixels, 0: half a pixel */
} MarramView;

/* Frames and times are between -1e12 and 1e12: later ones cannot be told apart. */
typedef struct MarramFrame { /* valid from begin until the frame's last call, report included */
    size_t size;
    double fps, frame;
    double bind_frame;   /* the frame at which roots are placed: the same for every frame of a shot */
    uint32_t time_count; /* motion samples, 1 ... 64 */
    const double* times; /* in frames, ascending; equally spaced over the shutter */
    MarramStage stage;   /* stop after this one */
    double tolerance;    /* metres; 0: a thousandth of a strand's length, or less where that is cheap */
    RTCDevice device;
    /* A committed scene of the meshes below, each under its geometry_id with its roles as mask. For tracing
     * and queries only. NULL if there is no mesh to trace. */
    RTCScene colliders;
    const MarramMesh* meshes; /* the named ones and, for curves, all that collide or shelter */
    uint32_t mesh_count, mesh_stride;
    /*
     * Evaluates a mesh at any time (frames), also outside the shutter; any thread. `mesh` is an index into
     * meshes. positions: 3 * vertex_count floats. normals: as many, set to the unit vertex normals at that
     * time if the mesh has normals (MarramMesh.normals), else not changed; NULL if not wanted.
     */
    MarramStatus (*pose)(void* pose_user, uint32_t mesh, double frame, float* positions, float* normals);
    void* pose_user;
    const MarramCurves* curves; /* the named ones */
    uint32_t curves_count, curves_stride;
    /*
     * Evaluates some curves at any time (frames), also outside the shutter; any thread. `curves` is an index
     * into curves. vertices: 4 floats per vertex of these curves. Curves made by a procedural are known only
     * within the shutter, and constant before and after it. NULL: not supported by the host.
     */
    MarramStatus (*pose_curves)(void* pose_user, uint32_t curves, double frame, uint64_t first_curve,
                                uint64_t curve_count, float* vertices);
    /*
     * The transform from the instanced mesh, in world space, to its instance with the index `mesh`, at any
     * time; any thread. matrix: 12 numbers, row by row: x' = m[0] x + m[1] y + m[2] z + m[3], and so on. A
     * rotation, a translation and a uniform scale other than 0. NULL if no mesh is an instance.
     */
    MarramStatus (*instance_transform)(void* pose_user, uint32_t mesh, double frame, double* matrix);
    double shot_first,
        shot_last; /* frames of the shot; equal: not known. For messages only, never for the output */
    /*
     * Of a preview: about this share of the curves is enough, 0 ... 1; 0: all. A curve that is made is the
     * same as in a frame of all, and a larger share makes the same curves and more. A procedural may ignore
     * it; one that does not sets MarramOutput.all_curves.
     */
    double share;
    const MarramView* view; /* NULL: make all curves in full, as for a bake, or where others read them */
} MarramFrame;

/* ---- What a procedural outputs ------------------------------------------------------------------------- */

typedef enum MarramOutputKind { MARRAM_CURVES = 0, MARRAM_MESH = 1 } MarramOutputKind;
typedef enum MarramShape {
    MARRAM_ROUND = 0,           /* a swept circle */
    MARRAM_RIBBON = 1,          /* flat, faces the ray */
    MARRAM_ORIENTED_RIBBON = 2, /* flat, with given normals */
    MARRAM_SHAPE_COUNT
} MarramShape;

typedef struct MarramOutput { /* the host sets size, and all other fields to zero */
    size_t size;
    MarramOutputKind kind;
    uint32_t time_count; /* 1 if nothing moves within the shutter, else MarramFrame.time_count */
    /* MARRAM_CURVES; see MarramCurves for the layout */
    uint64_t curve_count;
    uint32_t cvs_per_curve;  /* 2 or more, at every motion sample; 0: see offsets */
    const uint64_t* offsets; /* [curve_count + 1]; 2 or more CVs per curve; NULL if all have equal counts */
    uint32_t patch_count;    /* patches are consecutive ranges of curves */
    MarramBasis basis;       /* MARRAM_BSPLINE or MARRAM_CATMULL_ROM */
    MarramShape shape;
    /* MARRAM_MESH */
    uint32_t vertex_count, triangle_count, has_uvs;
    uint32_t has_normals; /* 0: the host makes vertex normals from the triangles */
    /* Digest of what mesh() outputs, and separately of what view_mesh() does. Outputs of this instance with the
     * same digest are equal to the bit, including attributes and grids, so the host may keep the output and
     * skip the call. 0: always call. */
    uint64_t digest;
    uint64_t all_curves; /* curves without MarramFrame.share; 0: curve_count */
} MarramOutput;

typedef struct MarramPatch {
    size_t size;
    uint64_t first_curve;
    uint32_t curve_count;
    float lower[3], upper[3];
} MarramPatch;

/* The destination of a patch: the buffers that Embree reads. Pointers are to the data of the patch's first
 * curve. */
typedef struct MarramPatchBuffers {
    size_t size;
    float* const* vertices; /* [output.time_count], 4 floats per vertex, 16-byte aligned */
    float* const* normals;  /* [output.time_count], 3 floats per vertex; NULL unless MARRAM_ORIENTED_RIBBON */
    uint32_t attribute_count; /* requested attributes: indices into the instance's */
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
    const MarramGrid* grids; /* set by the procedural, which keeps ownership */
    uint32_t grid_count, grid_stride;
    float* const* normals; /* [output.time_count], 3 * vertex_count, unit; NULL unless has_normals */
} MarramMeshBuffers;

typedef struct MarramAttributeList {
    size_t size;
    const MarramAttribute* attributes;
    uint32_t count, stride;
} MarramAttributeList;

/* The parts of the output that an update has changed, as bits. The others are unchanged to the bit. */
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
    uint32_t inputs;            /* MarramChange: changes of the geometry that the procedural depends on */
} MarramUpdate;

/* How the host combines the entries of the same path from several procedurals. */
typedef enum MarramCombine {
    MARRAM_SUM = 0,
    MARRAM_MAXIMUM = 1,
    MARRAM_LAST = 2,
    MARRAM_EACH = 3, /* not combined: kept under the name of each procedural */
    MARRAM_RATIO = 4 /* not reported: numerator / denominator, two other paths; 1 if the denominator is 0 */
} MarramCombine;

/*
 * An entry that a procedural may report. Units: "s" wall seconds, "thread s" seconds summed over threads,
 * "count", "bytes", "rad", ... An entry "thread_seconds.<stage>" in "thread s" is the time of a stage of
 * tessellate(): the host divides the wall seconds among such entries in proportion, and shows them as
 * "seconds.<stage>". "[]" in a path stands for any index, "*" for any name: "terrain.layer[].*.seconds".
 */
typedef struct MarramReportEntry {
    const char* path; /* "collision.contacts" */
    const char* unit;
    MarramCombine combine;
    const char *numerator, *denominator; /* paths, for a ratio; else NULL */
    const char* help;                    /* one line */
} MarramReportEntry;

typedef struct MarramInstance MarramInstance; /* opaque, defined by the procedural */

typedef struct MarramProcedural {
    const char* name; /* the `type` in scene files */
    const char* help;
    MarramOutputKind kind;
    const MarramParam* params;
    uint32_t param_count, param_stride;
    const MarramAttribute* attributes; /* of every instance; values are NULL */
    uint32_t attribute_count, attribute_stride;
    MarramStatus (*create)(const MarramHost* host, const MarramValues* values, MarramInstance** out);
    MarramStatus (*begin)(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out);
    MarramStatus (*patch)(MarramInstance* instance, uint32_t patch, MarramPatch* out); /* NULL for a mesh */
    MarramStatus (*tessellate)(MarramInstance* instance, uint32_t patch,
                               const MarramPatchBuffers* buffers);              /* likewise */
    MarramStatus (*mesh)(MarramInstance* instance, MarramMeshBuffers* buffers); /* NULL for curves */
    /* Reports statistics since begin, by the paths of report_entries. Entries not reported count as 0. May be
     * NULL. */
    void (*report)(MarramInstance* instance, void (*sink)(void* user, const char* path, double value),
                   void* user);
    void (*destroy)(MarramInstance* instance);
    /* All members below may be NULL. */
    const MarramItemType* item_types;
    uint32_t item_type_count, item_type_stride;
    /* The attributes of this instance, instead of the type's. Called once after create and after each
     * update. */
    MarramStatus (*attributes_of)(MarramInstance* instance, MarramAttributeList* out);
    /* The mesh at any time, after mesh(): 3 * vertex_count floats; any thread. NULL: it does not change with
     * time. */
    MarramStatus (*pose)(MarramInstance* instance, double frame, float* positions);
    /* The render mesh, after mesh(). out->triangle_count == 0: render the growth surface. */
    MarramStatus (*begin_view)(MarramInstance* instance, const MarramView* view, MarramOutput* out);
    MarramStatus (*view_mesh)(MarramInstance* instance, MarramMeshBuffers* buffers);
    /* Simulates up to the frame, loading and storing states. frame: as for begin. */
    MarramStatus (*prepare)(MarramInstance* instance, const MarramFrame* frame, const MarramStates* states);
    /* Applies new values and returns which parts of the output change (MarramChange). An error leaves the
     * instance unchanged. */
    MarramStatus (*update)(MarramInstance* instance, const MarramUpdate* update, uint32_t* changed);
    /* Writes what it has generated since begin as explicit scene text that gives the same result, to be
     * pasted into a scene file and edited. The sink is called for each piece of text; maybe never. */
    MarramStatus (*describe)(MarramInstance* instance, void (*sink)(void* user, const char* text),
                             void* user);
    /* Says in a few lines of text what it does in the shot, after begin: for people who look at a scene. Instances
     * that say the same are listed together. */
    MarramStatus (*summarize)(MarramInstance* instance, void (*sink)(void* user, const char* text),
                              void* user);
    /* The random gusts of its wind at the frame, after begin: for a user interface that shows them. The sink is called
     * for each, in the calling thread, before gusts returns: a sphere in world space, m, and its influence at the
     * centre (wind.gusts: 1 is the full strength of one gust), which falls to 0 at the radius. */
    MarramStatus (*gusts)(MarramInstance* instance,
                          void (*sink)(void* user, const double center[3], double radius, double strength),
                          void* user);
    /* The wind at points of the air at the frame, after begin: for a user interface that shows it. points: x, y, z of
     * each, m, world space. The sink is called for each point in order, in the calling thread, before air returns.
     * velocity, m/s: of the local wind, with fields and ground. noise: strands there turn towards velocity /
     * |velocity| + noise. share: of the wind, 0 ... 1, by gusts and wind.calm; shelter and canopies are not in it. */
    MarramStatus (*air)(MarramInstance* instance, uint64_t count, const double* points,
                        void (*sink)(void* user, const double velocity[3], const double noise[3],
                                     double share),
                        void* user);
    /* The rays by which the shelter of a strand is found at the frame, after begin: for a user interface. cvs: x, y,
     * z of each CV of the strand at rest, from its root on, m, world space; root_normal: of the mesh at its root,
     * unit. The sink is called for each ray, in the calling thread, before shelter_rays returns: the CV that sends
     * it, where it begins and where it ends (at a mesh that shelters, else wind.shielding.offset upwind), and the
     * shelter that it finds, 0 ... 1. Never without wind.shielding. */
    MarramStatus (*shelter_rays)(MarramInstance* instance, uint32_t cv_count, const double* cvs,
                                 const double root_normal[3],
                                 void (*sink)(void* user, uint32_t cv, const double from[3],
                                              const double to[3], double shelter),
                                 void* user);
} MarramProcedural;

typedef struct MarramLibrary {
    uint32_t abi;          /* MARRAM_ABI_VERSION that the library was built with; always the first field */
    uint32_t embree_major; /* MARRAM_EMBREE_MAJOR that it was built with; 0 if it never calls Embree */
    size_t size;
    const char* name;
    const char* version;
    const MarramParam* wind_params; /* parameters of the scene's table [wind] */
    uint32_t wind_param_count, wind_param_stride;
    const MarramProcedural* procedurals;
    uint32_t procedural_count, procedural_stride;
    const MarramReportEntry* report_entries; /* of all its procedurals */
    uint32_t report_entry_count, report_entry_stride;
    /* What the parameters of [wind] do together, for the manual: plain text, of any number of lines of at most 100
     * characters; NULL: nothing. */
    const char* wind_help;
} MarramLibrary;

/* The entry point. Returns NULL if the library does not support the requested version. */
#define MARRAM_ENTRY_POINT "marram_library"
typedef const MarramLibrary* (*MarramLibraryFunction)(uint32_t abi);

#ifdef __cplusplus
}
#endif
#endif
