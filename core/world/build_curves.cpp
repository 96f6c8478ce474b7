// SPDX-License-Identifier: Apache-2.0
// Builds the curves of a frame: chooses the number of motion keys, lets procedurals write CVs into Embree's
// buffers, and attaches these as cubics or as straight pieces.
#include "core/geometry/reserved_memory.h"
#include "core/trace/curve_pieces.h"
#include "core/trace/round_pieces.h"
#include "core/world/build_state.h"
#include "core/world/curve_memory.h"
#include "core/world/curve_parts.h"
#include "core/world/lazy_choice.h"
#include "core/world/lazy_curves.h"
#include "core/world/lent_geometry.h"

#include <fmt/format.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <bit>
#include <cmath>
#include <limits>

namespace marram {

namespace {

CurveLayout layout_of(const MarramOutput& output) {
    return {output.curve_count, output.cvs_per_curve, output.offsets};
}

// Rejects a procedural with invalid output.
void check_output(const Procedural& procedural, const MarramOutput& output) {
    if (output.offsets) {
        if (output.offsets[0] != 0)
            procedural.refuse("the offsets of its curves do not begin at 0", "fix the library");
        for (uint64_t c = 0; c < output.curve_count; ++c)
            if (output.offsets[c + 1] < output.offsets[c] || output.offsets[c + 1] - output.offsets[c] < 2)
                procedural.refuse("the offsets of its curves decrease, or leave a curve fewer than 2 CVs",
                                  "fix the library");
    } else if (output.cvs_per_curve < 2) {
        procedural.refuse("its curves have fewer than 2 CVs", "fix the library");
    }
    if (output.shape >= MARRAM_SHAPE_COUNT || output.basis > MARRAM_CATMULL_ROM)
        procedural.refuse("it asks for a shape or basis that the contract does not have", "fix the library");
    constexpr uint64_t most = std::numeric_limits<uint32_t>::max();
    if (output.curve_count > most ||
        (!output.offsets && output.curve_count > most / (uint64_t(output.cvs_per_curve) + 2)) ||
        layout_of(output).vertex_count() > most)
        procedural.refuse("its curves need more than 2^32 vertices",
                          "use fewer strands or CVs, or two procedurals");
}

// Calls body(0) ... body(count - 1) in parallel. The body is cheap: thousands per task.
template <typename Body>
void parallel(size_t count, Body&& body) {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 8192), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) body(i);
    });
}

RTCGeometryType curve_type(const MarramOutput& output) {
    const bool bspline = output.basis == MARRAM_BSPLINE;
    switch (output.shape) {
    case MARRAM_ROUND:
        return bspline ? RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE : RTC_GEOMETRY_TYPE_ROUND_CATMULL_ROM_CURVE;
    case MARRAM_RIBBON:
        return bspline ? RTC_GEOMETRY_TYPE_FLAT_BSPLINE_CURVE : RTC_GEOMETRY_TYPE_FLAT_CATMULL_ROM_CURVE;
    default:
        return bspline ? RTC_GEOMETRY_TYPE_NORMAL_ORIENTED_BSPLINE_CURVE
                       : RTC_GEOMETRY_TYPE_NORMAL_ORIENTED_CATMULL_ROM_CURVE;
    }
}

void check_patches(const CurveBuild& item) {
    const MarramOutput& output = item.output;
    const Procedural& procedural = *item.procedural;
    uint64_t next = 0;
    for (const MarramPatch& patch : item.patches) {
        if (patch.first_curve != next)
            procedural.refuse("its patches do not follow each other", "fix the library");
        if (patch.curve_count > output.curve_count - next) // a sum could overflow
            procedural.refuse("its patches do not add up to its curves", "fix the library");
        next += patch.curve_count;
    }
    if (next != output.curve_count)
        procedural.refuse("its patches do not add up to its curves", "fix the library");
}

// A motion key of an array of lazy curves.
float* reserve(CurveBuild& item, size_t bytes) {
    const auto memory = std::make_shared<ReservedMemory>(bytes + 16); // that Embree may read past the end
    item.memory.push_back(memory);
    return memory->as<float>();
}

// Chooses the attributes that anything needs.
void choose_attributes(const Build& build, CurveBuild& item) {
    const std::vector<MarramAttribute>& attributes = item.procedural->attributes();
    // If another procedural reads these curves, it may use any attribute: keep all.
    const auto uses_curves = [&](const auto& other) { return other->names(item.procedural->name()); };
    const bool read_by_others = std::ranges::any_of(build.geometry.procedurals, uses_curves);
    for (uint32_t a = 0; a < attributes.size(); ++a) {
        const MarramAttribute& attribute = attributes[a];
        if (!read_by_others &&
            std::ranges::find(build.settings.attributes, attribute.name) == build.settings.attributes.end())
            continue;
        if ((attribute.rate != MARRAM_PER_CURVE && attribute.rate != MARRAM_PER_CV) ||
            attribute.components < 1 || attribute.components > 4)
            item.procedural->refuse(
                fmt::format("its attribute '{}' is not 1 to 4 floats per curve or per CV", attribute.name),
                "fix the library");
        item.attributes.push_back(a);
    }
}

void allocate_vertices(Build& build, CurveBuild& item, size_t vertices) {
    const MarramOutput& output = item.output;
    const bool oriented = output.shape == MARRAM_ORIENTED_RIBBON;
    if (item.lazy) {
        for (uint32_t t = 0; t < output.time_count; ++t) {
            item.vertices.push_back(reserve(item, 16 * vertices));
            if (oriented) item.normals.push_back(reserve(item, 12 * vertices));
        }
        return;
    }
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), curve_type(output));
    item.geometry = {geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); }};
    rtcSetGeometryTimeStepCount(geometry, output.time_count);
    for (uint32_t t = 0; t < output.time_count; ++t) {
        item.vertices.push_back(static_cast<float*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4, 16, vertices)));
        if (oriented)
            item.normals.push_back(static_cast<float*>(rtcSetNewGeometryBuffer(
                geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3, 12, vertices)));
    }
    build.check_device();
    build.stats.curve_bytes += vertices * output.time_count * (oriented ? 28 : 16);
}

void allocate(Build& build, CurveBuild& item) {
    const MarramOutput& output = item.output;
    const CurveLayout layout = layout_of(output);
    const size_t count = output.curve_count, vertices = layout.vertex_count();
    allocate_vertices(build, item, vertices);
    CurveGeometry& curves = item.curves;
    curves.name = item.procedural->name();
    curves.material = item.procedural->material;
    curves.basis = output.basis;
    curves.shape = output.shape;
    curves.curve_count = count;
    curves.all_curves = std::max<uint64_t>(output.all_curves, count);
    if (count > 0 && build.settings.widening > 0.0)
        item.widened = float(std::pow(double(curves.all_curves) / double(count), build.settings.widening));
    curves.cvs_per_curve = output.offsets ? 0 : output.cvs_per_curve;
    if (output.offsets) {
        curves.offsets.assign(output.offsets, output.offsets + count + 1);
        curves.curve_of_segment.reserve(layout.segment_count());
        for (uint64_t c = 0; c < count; ++c)
            curves.curve_of_segment.insert(curves.curve_of_segment.end(), layout.cvs(c) - 1, uint32_t(c));
    }
    curves.vertices.assign(item.vertices.begin(), item.vertices.end());
    curves.normals.assign(item.normals.begin(), item.normals.end());
    for (const uint32_t a : item.attributes) {
        const MarramAttribute& attribute = item.procedural->attributes()[a];
        const size_t values = item.value_count(attribute);
        AttributeValues& made = curves.attributes.emplace_back();
        made = {attribute.name, attribute.components, attribute.rate, {}, attribute.discrete != 0};
        if (item.lazy)
            made.lazy = reserve(item, values * sizeof(float));
        else
            made.values.resize(values);
        item.attribute_values.push_back(const_cast<float*>(made.data()));
        if (!item.lazy) build.stats.attribute_bytes += values * sizeof(float);
    }
    build.stats.curves += count;
    build.stats.cvs += layout.cv_count();
    build.stats.segments += layout.segment_count();
}

// True if the tolerance, not film.curve_pieces, chooses the number of straight pieces (linear segments).
bool tolerance_chooses_pieces(const MarramOutput& output, const BuildSettings& settings) {
    return settings.trace_curves && settings.curve_pieces < 0 && !output.offsets &&
           output.shape != MARRAM_ORIENTED_RIBBON;
}

bool finite(const float* values, size_t count) {
    constexpr int32_t exponent = 0x7f800000; // all exponent bits: infinity or NaN
    int32_t most = 0;
    for (size_t i = 0; i < count; ++i) most = std::max(most, std::bit_cast<int32_t>(values[i]) & exponent);
    return most < exponent;
}

} // namespace

void tessellate_patch(const CurveBuild& item, uint32_t index) {
    const MarramPatch& patch = item.patches[index];
    const CurveLayout layout = layout_of(item.output);
    const size_t first_vertex = layout.first_vertex(patch.first_curve);
    const size_t vertex_count = layout.first_vertex(patch.first_curve + patch.curve_count) - first_vertex;
    float* vertices[max_motion_keys];
    float* normals[max_motion_keys];
    std::vector<float*> attributes(item.attributes.size());
    for (uint32_t t = 0; t < item.output.time_count; ++t) {
        vertices[t] = item.vertices[t] + 4 * first_vertex;
        if (!item.normals.empty()) normals[t] = item.normals[t] + 3 * first_vertex;
    }
    for (size_t a = 0; a < item.attributes.size(); ++a) {
        const MarramAttribute& attribute = item.procedural->attributes()[item.attributes[a]];
        const size_t first =
            attribute.rate == MARRAM_PER_CV ? layout.first_cv(patch.first_curve) : patch.first_curve;
        attributes[a] = item.attribute_values[a] + first * attribute.components;
    }
    item.procedural->tessellate(
        index, {sizeof(MarramPatchBuffers), vertices, item.normals.empty() ? nullptr : normals,
                uint32_t(item.attributes.size()), item.attributes.data(), attributes.data()});
    for (uint32_t t = 0; item.widened > 1.0F && t < item.output.time_count; ++t)
        for (size_t v = 0; v < vertex_count; ++v) vertices[t][4 * v + 3] *= item.widened;
    for (uint32_t t = 0; t < item.output.time_count; ++t)
        if (!finite(vertices[t], vertex_count * 4))
            item.procedural->refuse("a CV is not a finite number",
                                    "look for huge values in the scene, or fix the library");
}

namespace {

// Segment k of curve c starts at vertex c * stride + k.
void put_indices(Build& build, RTCGeometry geometry, size_t curves, uint32_t segments, uint32_t stride) {
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, curves * segments));
    build.check_device();
    parallel(curves, [=](size_t curve) {
        for (uint32_t k = 0; k < segments; ++k) indices[curve * segments + k] = uint32_t(curve * stride + k);
    });
    build.stats.curve_bytes += curves * segments * 4;
}

// The same for curves with different CV counts.
void put_indices(Build& build, RTCGeometry geometry, const CurveLayout& layout) {
    const size_t segments = layout.segment_count();
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, segments));
    build.check_device();
    parallel(layout.curve_count, [=](size_t curve) {
        for (uint32_t k = 0; k + 1 < layout.cvs(curve); ++k)
            indices[layout.first_segment(curve) + k] = uint32_t(layout.first_vertex(curve) + k);
    });
    build.stats.curve_bytes += segments * 4;
}

// The cubics themselves.
TracedVertices traced_cubics(const CurveBuild& item) {
    const MarramOutput& output = item.output;
    const bool alike = !output.offsets;
    return {item.geometry,
            curve_type(output),
            item.vertices,
            item.normals,
            layout_of(output).vertex_count(),
            alike ? output.cvs_per_curve - 1 : 0,
            alike ? output.cvs_per_curve + 2 : 0};
}

// Makes the straight pieces that Embree traces in place of the cubics. Their vertices lie on the cubics.
TracedVertices traced_pieces(Build& build, CurveBuild& item) {
    const MarramOutput& output = item.output;
    const uint32_t pieces = item.curves.pieces;
    const size_t cvs = output.cvs_per_curve;
    const uint32_t per_curve = (output.cvs_per_curve - 1) * pieces;
    if (output.curve_count > std::numeric_limits<uint32_t>::max() / (uint64_t(per_curve) + 1))
        item.procedural->refuse("its curves need more than 2^32 vertices when they are cut into pieces",
                                "set film.curve_pieces = 0, or use fewer strands");
    TracedVertices traced{{},           RTC_GEOMETRY_TYPE_FLAT_LINEAR_CURVE,  {},
                          {},           output.curve_count * (per_curve + 1), per_curve,
                          per_curve + 1};
    if (item.lazy) { // written when its patches are built
        for (uint32_t t = 0; t < output.time_count; ++t) {
            traced.vertices.push_back(reserve(item, 16 * traced.vertex_count));
            if (output.shape == MARRAM_ROUND) item.curves.round_pieces.push_back(traced.vertices.back());
        }
        return traced;
    }
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), RTC_GEOMETRY_TYPE_FLAT_LINEAR_CURVE);
    traced.geometry = {geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); }};
    rtcSetGeometryTimeStepCount(geometry, output.time_count);
    for (uint32_t t = 0; t < output.time_count; ++t) {
        auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4, 16, traced.vertex_count));
        build.check_device();
        tbb::parallel_for(size_t{0}, item.patches.size(), [&](size_t i) {
            const MarramPatch& patch = item.patches[i];
            const size_t first = 4 * patch.first_curve * (cvs + 2);
            write_pieces({item.vertices[t] + first, patch.curve_count, output.cvs_per_curve, output.basis},
                         item.vertices[0] + first, pieces,
                         vertices + 4 * patch.first_curve * (per_curve + 1));
        });
        traced.vertices.push_back(vertices);
        build.stats.curve_bytes += traced.vertex_count * 16;
        if (output.shape == MARRAM_ROUND) add_round_pieces(build.world, item.curves, vertices);
    }
    return traced;
}

uint64_t segments_of(const CurveBuild& item) { return layout_of(item.output).segment_count(); }

// Round pieces need a filter that slows down every hit in the scene: use them only if they are at least half
// of all segments.
bool mostly_round(const std::vector<CurveBuild>& items) {
    uint64_t all = 0, round = 0;
    for (const CurveBuild& item : items) {
        all += segments_of(item);
        if (item.output.shape == MARRAM_ROUND) round += segments_of(item);
    }
    return 2 * round >= all;
}

// Largest error of straight pieces over all curves, for each number of pieces.
ChordErrors chord_errors(const CurveBuild& item, const BuildSettings& settings) {
    const ChordLimit limit{settings.tolerance, settings.view.pixel_angle, settings.view.position};
    const uint32_t cvs = item.output.cvs_per_curve;
    const std::vector<uint32_t> known = item.patches_made_early();
    const auto of_patches = [&](const tbb::blocked_range<size_t>& patches, ChordErrors errors) {
        for (size_t i = patches.begin(); i < patches.end(); ++i)
            for (uint32_t t = 0; t < item.output.time_count; ++t) {
                const MarramPatch& patch = item.patches[known[i]];
                add_chord_errors({item.vertices[t] + 4 * patch.first_curve * (cvs + 2), patch.curve_count,
                                  cvs, item.output.basis},
                                 limit, errors);
            }
        return errors;
    };
    return tbb::parallel_reduce(tbb::blocked_range<size_t>(0, known.size()), ChordErrors{}, of_patches,
                                max_errors);
}

// Number of straight pieces per segment: the setting, or what the tolerance allows and max_useful_pieces()
// limits. 0: trace the cubic, as always for oriented ribbons and curves with different CV counts.
uint32_t choose_pieces(Build& build, const CurveBuild& item, bool allow_round_pieces) {
    const MarramOutput& output = item.output;
    if (output.shape == MARRAM_ORIENTED_RIBBON || output.offsets) return 0;
    if (!tolerance_chooses_pieces(output, build.settings)) return uint32_t(build.settings.curve_pieces);
    const uint32_t most = output.shape == MARRAM_ROUND && !allow_round_pieces
                              ? 0
                              : max_useful_pieces(output.shape, output.time_count);
    const uint32_t pieces = most > 0 ? min_pieces(chord_errors(item, build.settings), most) : 0;
    build.stats.chosen[item.procedural->name() + ".curve_pieces"] = pieces;
    return pieces;
}

// Attaches the boxes of lazy curves, which then own the rest.
void attach_lazy(Build& build, CurveBuild& item, TracedVertices traced, uint32_t set, bool spans) {
    World& world = build.world;
    // Pieces tie at their corners, and which one is hit must not depend on when patches were built.
    if (item.curves.pieces > 0) world.filtered = true;
    item.curves.lazy = true;
    world.curves.push_back(std::move(item.curves));
    if (!world.lazy) world.lazy = std::make_shared<LazyWorld>(world.scene, world.device_state);
    auto& lazy = static_cast<LazyWorld&>(*world.lazy);
    const size_t end_key_hit_id = world.meshes.size() + build.items.size() + world.curve_parts.size();
    if (item.has_parts) world.curve_parts.push_back({.curves = set, .end_keys_only = true});
    lazy.curves.push_back(std::make_unique<LazyCurves>(build, lazy, std::move(item), std::move(traced), set,
                                                       uint32_t(end_key_hit_id), spans));
    lazy.curves.back()->attach(build);
}

// Attaches the curves to the world scene, as cubics or as straight pieces. spans: see attach_parts().
void attach(Build& build, CurveBuild& item, bool spans) {
    const auto set = uint32_t(build.world.curves.size());
    TracedVertices traced = item.curves.pieces > 0 ? traced_pieces(build, item) : traced_cubics(item);
    if (item.lazy) {
        attach_lazy(build, item, std::move(traced), set, spans);
        return;
    }
    if (!item.curves.end_keys_only.empty()) {
        attach_parts(build, item, traced, set, spans);
        return;
    }
    if (traced.segments > 0)
        put_indices(build, traced.geometry.get(), item.output.curve_count, traced.segments, traced.stride);
    else
        put_indices(build, traced.geometry.get(), item.curves.layout());
    attach_geometry(build, traced.geometry.get(), unsigned(build.world.meshes.size() + set));
}

} // namespace

void take_report(BuildStats& stats, Procedural& procedural, double wall) {
    stats.report.add(procedural.name(), procedural.report(), wall);
    constexpr std::string_view chosen = "chosen.";
    for (const auto& [path, entry] : stats.report.entries())
        if (const auto own = entry.each.find(procedural.name());
            path.starts_with(chosen) && own != entry.each.end())
            stats.chosen[procedural.name() + "." + path.substr(chosen.size())] = own->second;
    take_warnings(stats, procedural);
}

// ---- number of motion keys -----------------------------------------------------------------------------

namespace {

constexpr uint32_t few_instants = 5, more_instants = 17; // at which strand motion is sampled

// Measures the motion of strands in some patches of a procedural. Empty if its curves do not move.
StrandMotion measure_motion(Build& build, Procedural& procedural, uint32_t instants) {
    StrandMotion motion;
    const LentGeometry lent(build, procedural, build.times(instants)); // may build colliders
    if (procedural.prepares()) prepare(build, procedural, lent.frame());
    take_warnings(build.stats, procedural); // of the preparation, which is not repeated
    build.progress.phase = "looking at motion";
    const double before = wall_seconds();
    const MarramOutput output = procedural.begin(lent.frame()); // reports its own seconds
    build.stats.choose_keys -= wall_seconds() - before;
    check_output(procedural, output);
    if (output.time_count != instants || output.patch_count == 0) return motion;
    // A 16th of the patches, but 16 to 64 of them, evenly spaced: any patch may move most.
    const uint32_t count = std::min(output.patch_count, std::clamp(output.patch_count / 16, 16U, 64U));
    std::vector<StrandMotion> found(count);
    tbb::parallel_for(uint32_t{0}, count, [&](uint32_t i) {
        if (build.cancel.load(std::memory_order_relaxed)) throw Cancelled{};
        const auto index = uint32_t(uint64_t(i) * (output.patch_count - 1) / std::max(count - 1, 1U));
        const MarramPatch patch = procedural.patch(index);
        if (patch.first_curve > output.curve_count ||
            patch.curve_count > output.curve_count - patch.first_curve)
            procedural.refuse("its patches do not add up to its curves", "fix the library");
        const CurveLayout layout = layout_of(output);
        const size_t first = layout.first_vertex(patch.first_curve);
        const size_t vertices = layout.first_vertex(patch.first_curve + patch.curve_count) - first;
        const bool oriented = output.shape == MARRAM_ORIENTED_RIBBON;
        std::vector<std::vector<float>> positions(instants), normal_storage(instants);
        std::vector<float*> at(instants), normals(instants);
        for (uint32_t t = 0; t < instants; ++t) {
            positions[t].resize(4 * vertices);
            if (oriented) normal_storage[t].resize(3 * vertices);
            at[t] = positions[t].data();
            normals[t] = normal_storage[t].data();
        }
        procedural.tessellate(index, {sizeof(MarramPatchBuffers), at.data(),
                                      oriented ? normals.data() : nullptr, 0, nullptr, nullptr});
        std::vector<const float*> samples(instants);
        for (uint64_t curve = patch.first_curve; curve < patch.first_curve + patch.curve_count; ++curve) {
            for (uint32_t t = 0; t < instants; ++t)
                samples[t] = at[t] + 4 * (layout.first_vertex(curve) - first + 1);
            found[i].add(samples, layout.cvs(curve), build.settings.view);
        }
    });
    for (const StrandMotion& one : found) motion.add(one);
    take_warnings(build.stats,
                  procedural); // of what make_curves() does not repeat, such as the placing of roots
    return motion;
}

// Keys for the sampled motion of the strands, and for the geometry that they grow on: its path may curve
// between the sampled instants.
uint32_t choose_keys(Build& build, Procedural& procedural) {
    const BuildSettings& settings = build.settings;
    StrandMotion motion = measure_motion(build, procedural, few_instants);
    // With few samples, strands that turn fast look like strands that jump: sample more often.
    constexpr double jump_threshold = 0.01;
    if (motion.jump_fraction(settings.tolerance) > jump_threshold)
        motion = measure_motion(build, procedural, more_instants);
    uint32_t keys = motion.keys_for(settings.tolerance);
    for (const SceneMesh& mesh : build.geometry.meshes)
        if (procedural.refers_to_mesh(mesh.object().name))
            keys =
                motion_keys_for(mesh, settings.tolerance, settings.view, build.open(), build.close(), keys);
    for (const MeshGeometry& mesh : build.world.meshes) // including those made by procedurals
        if (procedural.names(mesh.name)) keys = std::max(keys, uint32_t(mesh.positions.size()));
    for (const CurveBuild& item : build.items)
        if (procedural.refers_to_curves(item.curves.name)) keys = std::max(keys, item.output.time_count);
    const double residual_error = motion.residual_error(keys, settings.tolerance);
    build.stats.motion_error = std::max(build.stats.motion_error, residual_error);
    build.stats.motion_jumps = std::max(build.stats.motion_jumps, motion.jump_fraction(settings.tolerance));
    build.stats.chosen[procedural.name() + ".motion_keys"] = keys;
    if (residual_error > settings.tolerance)
        build.stats.warnings.push_back(
            {procedural.place(),
             fmt::format("the strands of '{}' move so fast that {} motion keys are off by {:.3g} m, the "
                         "tolerance is {:.3g} m",
                         procedural.name(), keys, residual_error, settings.tolerance),
             "shorten camera.shutter, or give more tolerance", "curves.motion"});
    return keys;
}

} // namespace

uint32_t motion_keys_of_curves(Build& build, Procedural& procedural) {
    if (!(build.open() < build.close())) return 1;
    if (!build.chooses_keys()) return std::max(build.settings.motion_keys, 2U);
    const double begin = wall_seconds();
    const uint32_t keys = choose_keys(build, procedural);
    build.stats.choose_keys += wall_seconds() - begin;
    return keys;
}

void make_curves(Build& build, Procedural& procedural, uint32_t keys) {
    CurveBuild& item = build.items.emplace_back();
    item.procedural = &procedural;
    const auto lent =
        std::make_shared<LentGeometry>(build, procedural, build.times(keys)); // may build colliders
    if (procedural.prepares()) prepare(build, procedural, lent->frame());
    build.progress.fraction = 0.0;
    build.progress.phase = "expanding";
    item.output = procedural.begin(lent->frame());
    check_output(procedural, item.output);
    const double patches_start = wall_seconds();
    item.patches.resize(item.output.patch_count);
    tbb::parallel_for(uint32_t{0}, item.output.patch_count,
                      [&](uint32_t i) { item.patches[i] = procedural.patch(i); });
    build.stats.report.add("seconds.expand", wall_seconds() - patches_start);
    check_patches(item);
    if (item.output.time_count != 1 && item.output.time_count != keys)
        procedural.refuse("its number of motion samples is not the requested one", "fix the library");
    choose_attributes(build, item);
    item.lazy = is_lazy(build, item);
    if (item.lazy) {
        item.lent = lent;
        if (tolerance_chooses_pieces(item.output, build.settings) || (build.chooses_keys() && keys > 2))
            item.sample_patches = patches_to_look_at(item, build.settings.view);
    }
    if (!item.lazy && !fits_memory(build, item)) return; // make_all() ends the frame
    allocate(build, item);
    const double begin = wall_seconds();
    const std::vector<uint32_t> to_make = item.patches_made_early();
    std::atomic<uint32_t> done{0};
    tbb::parallel_for(size_t{0}, to_make.size(), [&](size_t i) {
        if (build.cancel.load(std::memory_order_relaxed)) throw Cancelled{};
        tessellate_patch(item, to_make[i]);
        build.progress.fraction = double(++done) / double(to_make.size());
    });
    const double wall = wall_seconds() - begin;
    if (!item.lazy) take_report(build.stats, procedural, wall);
    item.output.offsets = item.curves.layout().offsets; // the procedural may free its own
}

void attach_curves(Build& build) {
    const double begin = wall_seconds();
    // In the scene's order, not the order in which they were made.
    std::ranges::sort(build.items, {}, [&](const CurveBuild& item) {
        return std::ranges::find_if(build.geometry.procedurals,
                                    [&](const auto& p) { return p.get() == item.procedural; });
    });
    const bool allow_round_pieces = mostly_round(build.items);
    const auto is_traced = [&](const CurveBuild& item) {
        return build.settings.trace_curves && item.output.curve_count > 0;
    };
    for (CurveBuild& item : build.items) {
        if (!is_traced(item)) continue;
        item.curves.pieces = choose_pieces(build, item, allow_round_pieces);
        find_end_key_curves(build, item);
    }
    check_memory(build);
    const bool spans = std::ranges::none_of(build.items, [&](const CurveBuild& item) {
        return is_traced(item) && item.vertices.size() > 2 && !item.has_parts;
    });
    for (CurveBuild& item : build.items) {
        for (const MarramPatch& patch : item.patches) build.stats.patch_bounds.push_back(padded_box(patch));
        build.curves.push_back(item.geometry);
        const bool lazy = item.lazy;
        if (is_traced(item)) attach(build, item, spans);
        if (lazy) continue; // it is in the world already
        build.world.curves.push_back(std::move(item.curves));
    }
    build.stats.bvh += wall_seconds() - begin;
}

} // namespace marram
