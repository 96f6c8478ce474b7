/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A small desert: all that a mesh procedural can do, in C.
 *
 *   hill   a square of (divisions + 1)^2 vertices. It stands on a mesh that it names and traces, and its layers
 *          have their own types. It rises near drawn curves and by a table of numbers. It grows from frame to
 *          frame by a simulation that stores states, and swells within the shutter. It outputs attributes, a
 *          grid, and a render mesh that is finer nearer to the camera.
 *   reeds  curves of 2, 3, 4 and 5 CVs in turn, along the curves that it names or upwards from the origin.
 */
#include "core/plugin/marram_plugin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { most_layers = 8, most_text = 64, most_divisions = 256, most_curves = 64 };

typedef struct Layer {
    int is_bump; /* otherwise a slab */
    double height, x, z;
} Layer;

typedef struct Settings {
    double size, swell, grow, tone, record, air;
    int divisions;
    char on[most_text], along[most_text];
    Layer layers[most_layers];
    int layer_count;
} Settings;

struct MarramInstance {
    MarramHost host;
    Settings settings;
    /* State of the current frame. */
    double frame, times[64];
    uint32_t time_count;
    double base;    /* height of the mesh below */
    double grown;   /* by the simulation */
    double ridge_x; /* of the first drawn curve */
    int simulated;  /* steps since create */
    float* heights; /* the output grid */
    MarramGrid grid;
    int view_divisions;
    uint64_t* offsets; /* of reeds */
    double root[3];
};

static const MarramParam hill_params[] = {
    {"on", MARRAM_MESH_NAME, "", "none", 0, 0, "", "mesh that it stands on", NULL, NULL},
    {"along", MARRAM_CURVES_NAME, "", "none", 0, 0, "", "curves that it rises beside", NULL, NULL},
    {"record", MARRAM_TABLE, "", "none", 0, 0, "", "whose first column's sum it rises by", NULL, NULL},
    {"air", MARRAM_VOLUME, "m/s", "none", 0, 0, "", "whose last vector's y it rises by", NULL, NULL},
    {"size", MARRAM_NUMBER, "m", "4", 1e-3, 1e6, "", "side of its square", NULL, NULL},
    {"divisions", MARRAM_INTEGER, "", "8", 1, most_divisions, "", "squares a side", "4|8|16",
     "seconds.procedural_meshes"},
    {"swell", MARRAM_NUMBER, "m", "0", -1e3, 1e3, "", "rises by this, times sin(frame)", NULL, NULL},
    {"grow", MARRAM_NUMBER, "m", "0", -1e3, 1e3, "", "rises by this a frame", NULL, NULL},
    {"tone", MARRAM_NUMBER, "", "1", 0, 1e3, "", "factor of the attribute sand", NULL, NULL},
};
static const MarramParam reeds_params[] = {
    {"along", MARRAM_CURVES_NAME, "", "none", 0, 0, "", "curves that they begin on", NULL, NULL},
    {"fan", MARRAM_MESH_NAME, "", "none", 0, 0, "", "a mesh that has to be there first", NULL, NULL},
};
static const MarramParam bump_params[] = {
    {"height", MARRAM_NUMBER, "m", "1", -1e3, 1e3, "", "of its middle", NULL, NULL},
    {"at", MARRAM_VEC2, "m", "[0, 0]", -1e6, 1e6, "", "x and z of its middle", NULL, NULL},
};
static const MarramParam slab_params[] = {
    {"height", MARRAM_NUMBER, "m", "0.5", -1e3, 1e3, "", "everywhere", NULL, NULL},
};
static const MarramItemType item_types[] = {
    {"layer", "bump", "a round hill 1 m wide", bump_params, 2, sizeof(MarramParam)},
    {"layer", "slab", "as high everywhere", slab_params, 1, sizeof(MarramParam)},
};
static const MarramAttribute hill_attributes[] = {
    {"sand", 1, MARRAM_PER_VERTEX, 0, "height times tone, 0 to 1", NULL, 0},
    {"square", 1, MARRAM_PER_FACE, 1, "number of the square", NULL, 0},
    {"age", 1, MARRAM_PER_VERTEX, 0, "what has grown, m", NULL, 1},
};
static const MarramAttribute reeds_attributes[] = {
    {"count", 1, MARRAM_PER_CURVE, 0, "CVs of the curve", NULL, 0},
    {"number", 1, MARRAM_PER_CV, 0, "CVs from the root", NULL, 0},
};
static const MarramReportEntry report_entries[] = {
    {"hill.simulated", "count", MARRAM_SUM, NULL, NULL, "frames that were simulated"},
    {"hill.highest", "m", MARRAM_MAXIMUM, NULL, NULL, "of all hills"},
    {"hill.steepness", "1", MARRAM_RATIO, "hill.highest", "hill.size", "height over size"},
    {"hill.size", "m", MARRAM_MAXIMUM, NULL, NULL, "of the widest"},
};

/* ---- Values ---- */

static void say(const MarramInstance* instance, MarramSeverity severity, const char* id, const char* place,
                const char* what, const char* remedy) {
    MarramMessage message;
    memset(&message, 0, sizeof message);
    message.size = sizeof message;
    message.severity = severity;
    message.id = id;
    message.place = place;
    message.what = what;
    message.remedy = remedy;
    instance->host.message(instance->host.user, &message);
}

static double first_column(const MarramGrid* table) {
    double sum = 0.0;
    for (uint32_t row = 0; row < table->ny; ++row) sum += table->values[(size_t)row * table->nx];
    return sum;
}

/* The y of the last vector of the last frame. */
static double last_rise(const MarramVolume* volume) {
    const MarramGrid* grid = MARRAM_AT(MarramGrid, volume->grids, volume->grid_stride, volume->count - 1);
    return grid->values[3 * (size_t)grid->nx * grid->ny * grid->nz - 2];
}

static int layer_index(const char* name) { return (int)strtol(name + strlen("layer["), NULL, 10); }

static void read_value(const MarramValue* value, Settings* to) {
    const char* name = value->name;
    const double number = value->number_count > 0 ? value->numbers[0] : 0.0;
    if (strcmp(name, "on") == 0) strncpy(to->on, value->text, most_text - 1);
    if (strcmp(name, "along") == 0) strncpy(to->along, value->text, most_text - 1);
    if (strcmp(name, "record") == 0) to->record = first_column(value->grid);
    if (strcmp(name, "air") == 0) to->air = last_rise(value->volume);
    if (strcmp(name, "size") == 0) to->size = number;
    if (strcmp(name, "divisions") == 0) to->divisions = (int)number;
    if (strcmp(name, "swell") == 0) to->swell = number;
    if (strcmp(name, "grow") == 0) to->grow = number;
    if (strcmp(name, "tone") == 0) to->tone = number;
    if (strncmp(name, "layer[", 6) != 0 || layer_index(name) >= most_layers) return;
    Layer* layer = &to->layers[layer_index(name)];
    const char* field = strchr(name, '.') + 1;
    if (layer_index(name) + 1 > to->layer_count) to->layer_count = layer_index(name) + 1;
    if (strcmp(field, "type") == 0) layer->is_bump = strcmp(value->text, "bump") == 0;
    if (strcmp(field, "height") == 0) layer->height = number;
    if (strcmp(field, "at") == 0) layer->x = value->numbers[0], layer->z = value->numbers[1];
}

static void read_values(const MarramValues* values, Settings* to) {
    memset(to, 0, sizeof *to);
    for (uint32_t i = 0; i < values->count; ++i)
        read_value(MARRAM_AT(MarramValue, values->first, values->stride, i), to);
}

static MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    MarramInstance* instance = calloc(1, sizeof *instance);
    if (!instance) return MARRAM_ERROR;
    memcpy(&instance->host, host, host->size < sizeof(MarramHost) ? host->size : sizeof(MarramHost));
    read_values(values, &instance->settings);
    *out = instance;
    return MARRAM_OK;
}

static MarramStatus update(MarramInstance* instance, const MarramUpdate* given, uint32_t* changed) {
    Settings settings, old = instance->settings;
    read_values(given->values, &settings);
    if (settings.size > 1e5) {
        say(instance, MARRAM_FAULT, "hill.size", "", "the hill is wider than 100 km", "give a smaller size");
        return MARRAM_ERROR;
    }
    *changed = MARRAM_NOTHING;
    if (settings.tone != old.tone) *changed |= MARRAM_ATTRIBUTES;
    if (settings.divisions != old.divisions) *changed |= MARRAM_EVERYTHING;
    instance->settings = settings;
    settings.tone = old.tone;
    settings.divisions = old.divisions;
    if (memcmp(&settings, &old, sizeof old) != 0 || given->inputs != MARRAM_NOTHING)
        *changed |= MARRAM_POSITIONS | MARRAM_ATTRIBUTES;
    return MARRAM_OK;
}

static void destroy(MarramInstance* instance) {
    free(instance->heights);
    free(instance->offsets);
    free(instance);
}

/* ---- hill ---- */

static double height_at(const MarramInstance* instance, double x, double z, double frame) {
    const Settings* s = &instance->settings;
    double height = instance->base + instance->grown + s->record + s->air + s->swell * sin(frame);
    for (int i = 0; i < s->layer_count; ++i) {
        const Layer* layer = &s->layers[i];
        const double dx = x - layer->x, dz = z - layer->z;
        height += layer->is_bump ? layer->height * exp(-(dx * dx + dz * dz)) : layer->height;
    }
    if (s->along[0]) height += exp(-(x - instance->ridge_x) * (x - instance->ridge_x));
    return height;
}

static void put_positions(const MarramInstance* instance, int divisions, double frame, float* positions) {
    for (int j = 0; j <= divisions; ++j)
        for (int i = 0; i <= divisions; ++i) {
            const double x = instance->settings.size * ((double)i / divisions - 0.5),
                         z = instance->settings.size * ((double)j / divisions - 0.5);
            *positions++ = (float)x;
            *positions++ = (float)height_at(instance, x, z, frame);
            *positions++ = (float)z;
        }
}

static void put_triangles(int divisions, uint32_t* triangles) {
    const uint32_t row = (uint32_t)divisions + 1;
    for (uint32_t j = 0; j + 1 < row; ++j)
        for (uint32_t i = 0; i + 1 < row; ++i) {
            const uint32_t a = j * row + i;
            const uint32_t corners[6] = {a, a + row, a + 1, a + 1, a + row, a + row + 1};
            memcpy(triangles, corners, sizeof corners);
            triangles += 6;
        }
}

/* Steps from frame to frame, from the latest state on. Long work asks whether to continue. */
static MarramStatus prepare(MarramInstance* instance, const MarramFrame* frame, const MarramStates* states) {
    MarramState state;
    memset(&state, 0, sizeof state);
    state.size = sizeof state;
    instance->grown = 0.0;
    double at = frame->bind_frame;
    if (instance->settings.grow == 0.0) return MARRAM_OK;
    if (states->load(states->user, frame->frame, &state) != MARRAM_OK) return MARRAM_ERROR;
    if (state.data && state.byte_count == sizeof(double)) {
        memcpy(&instance->grown, state.data, sizeof(double));
        at = state.frame;
    }
    for (double next = at + 1.0; next <= frame->frame; next += 1.0) {
        if (instance->host.cancelled(instance->host.user)) return MARRAM_CANCELLED;
        instance->grown += instance->settings.grow;
        ++instance->simulated;
        MarramState kept;
        memset(&kept, 0, sizeof kept);
        kept.size = sizeof kept;
        kept.frame = next;
        kept.data = &instance->grown;
        kept.byte_count = sizeof(double);
        if (states->store(states->user, &kept) != MARRAM_OK) return MARRAM_ERROR;
        if (MARRAM_HAS(&instance->host, progress) && instance->host.progress)
            instance->host.progress(instance->host.user, (next - at) / (frame->frame - at), "growing");
    }
    return MARRAM_OK;
}

/* The height of the mesh below, found by a ray from far above; 0 if there is none. */
static MarramStatus find_base(MarramInstance* instance, const MarramFrame* frame) {
    struct RTCRayHit ray;
    instance->base = 0.0;
    if (!instance->settings.on[0]) return MARRAM_OK;
    if (frame->mesh_count != 1 || !frame->colliders ||
        strcmp(MARRAM_AT(MarramMesh, frame->meshes, frame->mesh_stride, 0)->name, instance->settings.on) !=
            0) {
        say(instance, MARRAM_FAULT, "hill.no_ground", "",
            "the mesh that it stands on is not lent, or not alone", "lend what is named");
        return MARRAM_ERROR;
    }
    memset(&ray, 0, sizeof ray);
    ray.ray.org_y = 1000.0F;
    ray.ray.dir_y = -1.0F;
    ray.ray.tfar = 1e6F;
    ray.ray.mask = MARRAM_NAMED;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(frame->colliders, &ray, 0);
    if (ray.hit.geomID != RTC_INVALID_GEOMETRY_ID) instance->base = 1000.0 - (double)ray.ray.tfar;
    return MARRAM_OK;
}

static MarramStatus begin_hill(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    const int divisions = instance->settings.divisions;
    if (find_base(instance, frame) != MARRAM_OK) return MARRAM_ERROR;
    instance->frame = frame->frame;
    if (instance->settings.along[0]) {
        if (frame->curves_count != 1) {
            say(instance, MARRAM_FAULT, "hill.no_curves", "", "the curves that it names are not lent",
                "lend them");
            return MARRAM_ERROR;
        }
        instance->ridge_x = frame->curves->vertices[0][4];
    }
    if (instance->settings.swell > 100.0)
        say(instance, MARRAM_WARNING, "hill.swell", "", "the hill swells by more than 100 m", "lower swell");
    out->kind = MARRAM_MESH;
    out->vertex_count = (uint32_t)((divisions + 1) * (divisions + 1));
    out->triangle_count = (uint32_t)(2 * divisions * divisions);
    out->time_count = instance->time_count = instance->settings.swell != 0.0 ? frame->time_count : 1;
    for (uint32_t t = 0; t < frame->time_count; ++t) instance->times[t] = frame->times[t];
    return MARRAM_OK;
}

static void put_attributes(const MarramInstance* instance, int divisions, const MarramMeshBuffers* buffers) {
    const int vertices = (divisions + 1) * (divisions + 1);
    for (uint32_t a = 0; a < buffers->attribute_count; ++a) {
        float* values = buffers->attribute_values[a];
        if (buffers->attributes[a] == 0)
            for (int v = 0; v < vertices; ++v) {
                const double sand = (double)buffers->positions[0][3 * v + 1] * instance->settings.tone;
                values[v] = (float)(sand < 0.0 ? 0.0 : sand > 1.0 ? 1.0 : sand);
            }
        else if (buffers->attributes[a] == 1)
            for (int f = 0; f < 2 * divisions * divisions; ++f) values[f] = (float)(f / 2);
        else
            for (int v = 0; v < vertices; ++v) values[v] = (float)instance->grown;
    }
}

static void put_grid(MarramInstance* instance, int divisions, const float* positions) {
    const size_t count = (size_t)(divisions + 1) * (size_t)(divisions + 1);
    MarramGrid* grid = &instance->grid;
    free(instance->heights);
    instance->heights = malloc(count * sizeof(float));
    if (!instance->heights) return;
    for (size_t i = 0; i < count; ++i) instance->heights[i] = positions[3 * i + 1];
    memset(grid, 0, sizeof *grid);
    grid->name = "height";
    grid->nx = grid->ny = (uint32_t)divisions + 1;
    grid->nz = grid->components = 1;
    grid->origin[0] = grid->origin[2] = -0.5 * instance->settings.size;
    grid->axes[0][0] = grid->axes[1][2] = instance->settings.size / divisions;
    grid->axes[2][1] = 1.0;
    grid->values = instance->heights;
}

static MarramStatus pose(MarramInstance* instance, double frame, float* positions) {
    put_positions(instance, instance->settings.divisions, frame, positions);
    return MARRAM_OK;
}

static MarramStatus mesh(MarramInstance* instance, MarramMeshBuffers* buffers) {
    const int divisions = instance->settings.divisions;
    for (uint32_t t = 0; t < instance->time_count; ++t)
        put_positions(instance, divisions, instance->times[t], buffers->positions[t]);
    put_triangles(divisions, buffers->triangles);
    put_attributes(instance, divisions, buffers);
    put_grid(instance, divisions, buffers->positions[0]);
    if (!instance->heights) return MARRAM_ERROR;
    buffers->grids = &instance->grid;
    buffers->grid_count = 1;
    buffers->grid_stride = sizeof(MarramGrid);
    return MARRAM_OK;
}

/* Cells as large as a tenth of the camera's distance. */
static MarramStatus begin_view(MarramInstance* instance, const MarramView* view, MarramOutput* out) {
    const double* p = view->positions;
    const double distance = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    const double divisions = ceil(10.0 * instance->settings.size / distance);
    if (instance->settings.swell != 0.0) return MARRAM_OK; /* it moves: the growth surface is rendered */
    instance->view_divisions = divisions > most_divisions ? most_divisions : (int)divisions;
    out->kind = MARRAM_MESH;
    out->time_count = 1;
    out->vertex_count = (uint32_t)((instance->view_divisions + 1) * (instance->view_divisions + 1));
    out->triangle_count = (uint32_t)(2 * instance->view_divisions * instance->view_divisions);
    return MARRAM_OK;
}

static MarramStatus view_mesh(MarramInstance* instance, MarramMeshBuffers* buffers) {
    put_positions(instance, instance->view_divisions, instance->frame, buffers->positions[0]);
    put_triangles(instance->view_divisions, buffers->triangles);
    put_attributes(instance, instance->view_divisions, buffers);
    return MARRAM_OK;
}

static void report(MarramInstance* instance, void (*sink)(void*, const char*, double), void* user) {
    sink(user, "hill.simulated", instance->simulated);
    sink(user, "hill.highest", height_at(instance, 0.0, 0.0, instance->frame));
    sink(user, "hill.size", instance->settings.size);
    instance->simulated = 0;
}

/* ---- reeds ---- */

static MarramStatus begin_reeds(MarramInstance* instance, const MarramFrame* frame, MarramOutput* out) {
    const MarramCurves* along = frame->curves_count > 0 ? frame->curves : NULL;
    const uint64_t count = along ? along->curve_count : 4;
    if (count > most_curves) return MARRAM_ERROR;
    for (int axis = 0; axis < 3; ++axis)
        instance->root[axis] = along ? (double)along->vertices[0][4 + axis] : 0.0;
    free(instance->offsets);
    instance->offsets = malloc((count + 1) * sizeof(uint64_t));
    if (!instance->offsets) return MARRAM_ERROR;
    instance->offsets[0] = 0;
    for (uint64_t c = 0; c < count; ++c) instance->offsets[c + 1] = instance->offsets[c] + 2 + c % 4;
    out->kind = MARRAM_CURVES;
    out->curve_count = count;
    out->offsets = instance->offsets;
    out->patch_count = 1;
    out->time_count = 1;
    out->basis = MARRAM_BSPLINE;
    out->shape = MARRAM_ROUND;
    instance->settings.layer_count = (int)count; /* for patch */
    return MARRAM_OK;
}

static MarramStatus patch(MarramInstance* instance, uint32_t index, MarramPatch* out) {
    (void)index;
    out->first_curve = 0;
    out->curve_count = (uint32_t)instance->settings.layer_count;
    for (int axis = 0; axis < 3; ++axis) {
        out->lower[axis] = (float)instance->root[axis] - 100.0F;
        out->upper[axis] = (float)instance->root[axis] + 100.0F;
    }
    return MARRAM_OK;
}

/* CV k of curve c stands at root + (c, 0.5 k, 0). */
static MarramStatus tessellate(MarramInstance* instance, uint32_t index, const MarramPatchBuffers* buffers) {
    float* v = buffers->vertices[0];
    (void)index;
    for (int c = 0; c < instance->settings.layer_count; ++c) {
        const int cvs = (int)(instance->offsets[c + 1] - instance->offsets[c]);
        for (int k = -1; k <= cvs; ++k, v += 4) {
            v[0] = (float)(instance->root[0] + c);
            v[1] = (float)(instance->root[1] + 0.5 * k);
            v[2] = (float)instance->root[2];
            v[3] = 0.05F;
        }
        for (uint32_t a = 0; a < buffers->attribute_count; ++a) {
            float* values = buffers->attribute_values[a];
            if (buffers->attributes[a] == 0)
                values[c] = (float)cvs;
            else
                for (int k = 0; k < cvs; ++k) values[instance->offsets[c] + (uint64_t)k] = (float)k;
        }
    }
    return MARRAM_OK;
}

#if defined(GROWN) /* built with a header of the future: tests/CMakeLists.txt */
enum { procedural_count = 3 };
static const MarramParam future_params[] = {{"wish",
                                             MARRAM_FROM_THE_FUTURE,
                                             "",
                                             "none",
                                             0,
                                             0,
                                             "",
                                             "what nobody knows today",
                                             NULL,
                                             NULL,
                                             0,
                                             {0, 0, 0}}};
#else
enum { procedural_count = 2 };
#endif

const MarramLibrary* marram_library(uint32_t abi);
const MarramLibrary* marram_library(uint32_t abi) {
    static MarramProcedural procedurals[procedural_count];
    static MarramLibrary library;
    MarramProcedural *hill = &procedurals[0], *reeds = &procedurals[1];
    if (abi != MARRAM_ABI_VERSION) return NULL;
    hill->name = "hill";
    hill->help = "a square of sand";
    hill->kind = MARRAM_MESH;
    hill->params = hill_params;
    hill->param_count = sizeof hill_params / sizeof *hill_params;
    hill->attributes = hill_attributes;
    hill->attribute_count = 3;
    hill->item_types = item_types;
    hill->item_type_count = 2;
    hill->item_type_stride = sizeof(MarramItemType);
    hill->begin = begin_hill;
    hill->mesh = mesh;
    hill->pose = pose;
    hill->begin_view = begin_view;
    hill->view_mesh = view_mesh;
    hill->prepare = prepare;
    hill->report = report;
    reeds->name = "reeds";
    reeds->help = "curves of different CV counts";
    reeds->kind = MARRAM_CURVES;
    reeds->params = reeds_params;
    reeds->param_count = 2;
    reeds->attributes = reeds_attributes;
    reeds->attribute_count = 2;
    reeds->begin = begin_reeds;
    reeds->patch = patch;
    reeds->tessellate = tessellate;
#if defined(GROWN)
    procedurals[2] = *reeds;
    procedurals[2].name = "wisher";
    procedurals[2].params = future_params;
    procedurals[2].param_count = 1;
#endif
    for (int i = 0; i < procedural_count; ++i) {
        procedurals[i].param_stride = sizeof(MarramParam);
        procedurals[i].attribute_stride = sizeof(MarramAttribute);
        procedurals[i].create = create;
        procedurals[i].destroy = destroy;
    }
    hill->update = update;
    library.abi = MARRAM_ABI_VERSION;
    library.embree_major = MARRAM_EMBREE_MAJOR;
    library.size = sizeof library;
    library.name = "terrain_plugin";
    library.version = "1";
    library.procedurals = procedurals;
    library.procedural_count = procedural_count;
    library.procedural_stride = sizeof(MarramProcedural);
    library.report_entries = report_entries;
    library.report_entry_count = 4;
    library.report_entry_stride = sizeof(MarramReportEntry);
    return &library;
}
