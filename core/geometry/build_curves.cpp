// SPDX-License-Identifier: Apache-2.0
// Phase 2 of a frame: procedurals make their curves in Embree's buffers, which are attached as they are or cut into pieces.
#include "core/geometry/build_state.h"
#include "core/geometry/curve_pieces.h"
#include "core/geometry/lent_meshes.h"
#include "core/geometry/round_pieces.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <bit>
#include <limits>

namespace marram {

void check_output(const Procedural& procedural, const MarramOutput& output) {
    if (output.cvs_per_curve < 2) procedural.refuse("its curves have fewer than 2 CVs", "mend the library");
    if (output.shape >= MARRAM_SHAPE_COUNT || output.basis > MARRAM_CATMULL_ROM)
        procedural.refuse("it asks for a shape or basis that the contract does not have", "mend the library");
    constexpr uint64_t most = std::numeric_limits<uint32_t>::max();
    if (output.curve_count > most / (uint64_t(output.cvs_per_curve) + 2))
        procedural.refuse("its curves need more than 2^32 vertices",
                          "use fewer strands or CVs, or two procedurals");
}

namespace {

// body(0), ... body(count - 1), which are cheap: thousands a task.
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

// The curves of one procedural while they are being made.
struct CurveBuild {
    Procedural* procedural;
    MarramOutput output;
    std::vector<MarramPatch> patches;
    std::vector<uint32_t> attributes; // indices asked for
    CurveGeometry curves;
    std::shared_ptr<RTCGeometryTy> geometry;
    std::vector<float*> vertices, normals; // [time]
};

void check_patches(const CurveBuild& item) {
    const MarramOutput& output = item.output;
    const Procedural& procedural = *item.procedural;
    uint64_t next = 0;
    for (const MarramPatch& patch : item.patches) {
        if (patch.first_curve != next)
            procedural.refuse("its patches do not follow each other", "mend the library");
        next += patch.curve_count;
    }
    if (next != output.curve_count)
        procedural.refuse("its patches do not add up to its curves", "mend the library");
}

void allocate(Build& build, CurveBuild& item) {
    const MarramOutput& output = item.output;
    const size_t count = output.curve_count, vertices = count * (output.cvs_per_curve + 2);
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), curve_type(output));
    item.geometry = {geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); }};
    rtcSetGeometryTimeStepCount(geometry, output.time_count);
    const bool oriented = output.shape == MARRAM_ORIENTED_RIBBON;
    for (uint32_t t = 0; t < output.time_count; ++t) {
        item.vertices.push_back(static_cast<float*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4, 16, vertices)));
        if (oriented)
            item.normals.push_back(static_cast<float*>(rtcSetNewGeometryBuffer(
                geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3, 12, vertices)));
    }
    build.check_device();
    CurveGeometry& curves = item.curves;
    curves.name = item.procedural->name();
    curves.material = item.procedural->material;
    curves.basis = output.basis;
    curves.shape = output.shape;
    curves.curve_count = count;
    curves.cvs_per_curve = output.cvs_per_curve;
    curves.vertices.assign(item.vertices.begin(), item.vertices.end());
    curves.normals.assign(item.normals.begin(), item.normals.end());
    const MarramProcedural& type = item.procedural->type();
    for (uint32_t a = 0; a < type.attribute_count; ++a)
        for (const std::string& wanted : build.settings.attributes) {
            const MarramAttribute& attribute = type.attributes[a];
            if (wanted != attribute.name) continue;
            item.attributes.push_back(a);
            const size_t values =
                count * attribute.components * (attribute.per_cv ? output.cvs_per_curve : 1);
            curves.attributes.push_back({attribute.name, attribute.components, attribute.per_cv != 0,
                                         std::vector<float>(values), attribute.discrete != 0});
            build.stats.curve_extra_bytes += values * sizeof(float);
            break;
        }
    build.stats.curves += count;
    build.stats.cvs += count * output.cvs_per_curve;
    build.stats.segments += count * (output.cvs_per_curve - 1);
    build.stats.curve_bytes += vertices * output.time_count * (oriented ? 28 : 16);
}

// Whether the tolerance decides on straight pieces.
bool may_be_pieces(const MarramOutput& output, const BuildSettings& settings) {
    return settings.curves_bvh && settings.curve_pieces < 0 && output.shape != MARRAM_ORIENTED_RIBBON;
}

bool finite(const float* values, size_t count) {
    constexpr int32_t exponent = 0x7f800000; // all of its bits: infinite or not a number
    int32_t most = 0;
    for (size_t i = 0; i < count; ++i) most = std::max(most, std::bit_cast<int32_t>(values[i]) & exponent);
    return most < exponent;
}

void tessellate_patch(CurveBuild& item, uint32_t index) {
    const MarramPatch& patch = item.patches[index];
    const uint32_t cvs = item.output.cvs_per_curve;
    const size_t first_vertex = patch.first_curve * (cvs + 2);
    float* vertices[64];
    float* normals[64];
    float* attributes[64];
    for (uint32_t t = 0; t < item.output.time_count; ++t) {
        vertices[t] = item.vertices[t] + 4 * first_vertex;
        if (!item.normals.empty()) normals[t] = item.normals[t] + 3 * first_vertex;
    }
    for (size_t a = 0; a < item.attributes.size(); ++a) {
        CurveAttributeValues& values = item.curves.attributes[a];
        attributes[a] =
            values.values.data() + patch.first_curve * values.components * (values.per_cv ? cvs : 1);
    }
    item.procedural->tessellate(index,
                                {vertices, item.normals.empty() ? nullptr : normals,
                                 uint32_t(item.attributes.size()), item.attributes.data(), attributes});
    for (uint32_t t = 0; t < item.output.time_count; ++t)
        if (!finite(vertices[t], size_t(patch.curve_count) * (cvs + 2) * 4))
            item.procedural->refuse("a CV is not a finite number",
                                    "look for huge values in the scene, or mend the library");
}

// Segment k of curve c starts at vertex first + k of the `stride` that each curve has.
void put_indices(Build& build, RTCGeometry geometry, size_t curves, uint32_t segments, uint32_t stride) {
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, curves * segments));
    build.check_device();
    parallel(curves, [=](size_t curve) {
        for (uint32_t k = 0; k < segments; ++k) indices[curve * segments + k] = uint32_t(curve * stride + k);
    });
    build.stats.curve_bytes += curves * segments * 4;
}

// What Embree traces in place of the cubics: straight pieces between points on them.
std::shared_ptr<RTCGeometryTy> make_pieces(Build& build, CurveBuild& item) {
    const MarramOutput& output = item.output;
    const uint32_t pieces = item.curves.pieces;
    const size_t cvs = output.cvs_per_curve;
    const uint32_t per_curve = (output.cvs_per_curve - 1) * pieces;
    if (output.curve_count > std::numeric_limits<uint32_t>::max() / (uint64_t(per_curve) + 1))
        item.procedural->refuse("its curves need more than 2^32 vertices when they are cut into pieces",
                                "set film.curve_pieces = 0, or use fewer strands");
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), RTC_GEOMETRY_TYPE_FLAT_LINEAR_CURVE);
    std::shared_ptr<RTCGeometryTy> owner(geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); });
    rtcSetGeometryTimeStepCount(geometry, output.time_count);
    for (uint32_t t = 0; t < output.time_count; ++t) {
        auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t,
                                                                     RTC_FORMAT_FLOAT4, 16,
                                                                     output.curve_count * (per_curve + 1)));
        build.check_device();
        tbb::parallel_for(size_t{0}, item.patches.size(), [&](size_t i) {
            const MarramPatch& patch = item.patches[i];
            const size_t first = 4 * patch.first_curve * (cvs + 2);
            write_pieces({item.vertices[t] + first, patch.curve_count, output.cvs_per_curve, output.basis},
                         item.vertices[0] + first, pieces,
                         vertices + 4 * patch.first_curve * (per_curve + 1));
        });
        build.stats.curve_bytes += output.curve_count * (per_curve + 1) * 16;
        if (output.shape == MARRAM_ROUND) add_round_pieces(build.world, item.curves, vertices);
    }
    put_indices(build, geometry, output.curve_count, per_curve, per_curve + 1);
    return owner;
}

uint64_t segments_of(const CurveBuild& item) {
    return item.output.curve_count * (item.output.cvs_per_curve - 1);
}

// Each hit in the scene waits for the filter that round pieces need, so that these are to be most of what there is.
bool round_pieces_pay(const std::vector<CurveBuild>& items) {
    uint64_t all = 0, round = 0;
    for (const CurveBuild& item : items) {
        all += segments_of(item);
        if (item.output.shape == MARRAM_ROUND) round += segments_of(item);
    }
    return 2 * round >= all;
}

// How far all curves are from pieces.
ChordErrors chord_errors(const CurveBuild& item, const BuildSettings& settings) {
    const ChordLimit limit{settings.tolerance, settings.view.pixel_angle, settings.view.position};
    const uint32_t cvs = item.output.cvs_per_curve;
    const auto of_patches = [&](const tbb::blocked_range<size_t>& patches, ChordErrors errors) {
        for (size_t i = patches.begin(); i < patches.end(); ++i)
            for (uint32_t t = 0; t < item.output.time_count; ++t) {
                const MarramPatch& patch = item.patches[i];
                add_chord_errors({item.vertices[t] + 4 * patch.first_curve * (cvs + 2), patch.curve_count,
                                  cvs, item.output.basis},
                                 limit, errors);
            }
        return errors;
    };
    return tbb::parallel_reduce(tbb::blocked_range<size_t>(0, item.patches.size()), ChordErrors{}, of_patches,
                                greater_of);
}

// How many pieces a segment is traced as: what is told, or by the tolerance and what pays; 0: the cubic.
uint32_t choose_pieces(Build& build, const CurveBuild& item, bool round_pay) {
    const MarramOutput& output = item.output;
    if (output.shape == MARRAM_ORIENTED_RIBBON) return 0;
    if (!may_be_pieces(output, build.settings)) return uint32_t(build.settings.curve_pieces);
    const uint32_t most =
        output.shape == MARRAM_ROUND && !round_pay ? 0 : most_that_pay(output.shape, output.time_count);
    const uint32_t pieces = most > 0 ? pieces_for(chord_errors(item, build.settings), most) : 0;
    build.stats.chosen[item.procedural->name() + ".curve_pieces"] = pieces;
    return pieces;
}

// Gives the curves to Embree: as they are, or as pieces.
void attach_curves(Build& build, CurveBuild& item, unsigned id, bool round_pay) {
    const MarramOutput& output = item.output;
    item.curves.pieces = choose_pieces(build, item, round_pay);
    std::shared_ptr<RTCGeometryTy> traced = item.geometry;
    if (item.curves.pieces > 0)
        traced = make_pieces(build, item);
    else
        put_indices(build, traced.get(), output.curve_count, output.cvs_per_curve - 1,
                    output.cvs_per_curve + 2);
    rtcCommitGeometry(traced.get());
    rtcAttachGeometryByID(build.world.scene.get(), traced.get(), id);
}

// What a procedural reports, and where it is kept.
struct ReportedStage {
    std::string_view key;
    double BuildStats::*seconds;
};
constexpr ReportedStage reported_stages[] = {
    {"thread_seconds.expand", &BuildStats::expand}, {"thread_seconds.gusts", &BuildStats::gusts},
    {"thread_seconds.shield", &BuildStats::shield}, {"thread_seconds.bend", &BuildStats::bend},
    {"thread_seconds.jiggle", &BuildStats::jiggle}, {"thread_seconds.collide", &BuildStats::collide}};

struct ReportedCount {
    std::string_view key;
    uint64_t BuildStats::*count;
};
constexpr ReportedCount reported_counts[] = {{"collision.contacts", &BuildStats::contacts},
                                             {"collision.pushed_out", &BuildStats::pushed_out},
                                             {"collision.unresolved", &BuildStats::unresolved},
                                             {"collision.skipped_pushes", &BuildStats::skipped_pushes},
                                             {"collision.dips", &BuildStats::dips},
                                             {"memory.bytes", &BuildStats::curve_extra_bytes}};

// Wall seconds of the tessellation are shared out by the thread seconds that the procedural reports.
void account(Build& build, CurveBuild& item, double wall) {
    BuildStats& stats = build.stats;
    const auto report = item.procedural->report();
    double sum = 0.0;
    for (const auto& [key, value] : report)
        for (const ReportedStage& stage : reported_stages) sum += key == stage.key ? value : 0.0;
    if (!(sum > 0.0)) stats.expand += wall;
    for (const auto& [key, value] : report) {
        for (const ReportedStage& stage : reported_stages)
            if (key == stage.key && sum > 0.0) stats.*stage.seconds += wall * value / sum;
        for (const ReportedCount& entry : reported_counts)
            if (key == entry.key) stats.*entry.count += uint64_t(value);
        constexpr std::string_view chosen = "chosen.";
        if (key.starts_with(chosen))
            stats.chosen[item.procedural->name() + "." + key.substr(chosen.size())] = value;
        if (key == "seconds.roots") stats.expand += value;
        if (key == "seconds.chain") stats.collide += value;
        if (key == "collision.goal_angle") stats.goal_angle += value;
        if (key == "collision.turned_angle") stats.turned_angle += value;
    }
    stats.collision_reached = stats.goal_angle > 0.0 ? stats.turned_angle / stats.goal_angle : 1.0;
    for (std::string& warning : item.procedural->take_warnings())
        stats.warnings.push_back(std::move(warning));
}

// Has one procedural make its curves.
CurveBuild make_curves(Build& build, Procedural& procedural, uint32_t keys) {
    CurveBuild item{};
    item.procedural = &procedural;
    build.progress.fraction = 0.0;
    build.progress.phase = "expanding";
    LentMeshes lent(build.world, build.geometry, build.times(keys));
    item.output = procedural.begin(lent.frame(build.settings, true));
    const double asked = wall_seconds();
    item.patches.resize(item.output.patch_count);
    tbb::parallel_for(uint32_t{0}, item.output.patch_count,
                      [&](uint32_t i) { item.patches[i] = procedural.patch(i); });
    for (const MarramPatch& p : item.patches)
        build.stats.patch_bounds.emplace_back(Vec3f(p.lower), Vec3f(p.upper));
    build.stats.expand += wall_seconds() - asked;
    check_output(procedural, item.output);
    check_patches(item);
    if (item.output.time_count != 1 && item.output.time_count != keys)
        procedural.refuse("it hands over another number of motion samples than asked", "mend the library");
    allocate(build, item);
    const double begin = wall_seconds();
    std::atomic<uint32_t> done{0};
    tbb::parallel_for(uint32_t{0}, item.output.patch_count, [&](uint32_t index) {
        if (build.cancel.load(std::memory_order_relaxed)) throw Cancelled{};
        tessellate_patch(item, index);
        build.progress.fraction = double(++done) / double(item.output.patch_count);
    });
    account(build, item, wall_seconds() - begin);
    return item;
}

} // namespace

void add_curves(Build& build, const std::vector<uint32_t>& keys) {
    std::vector<CurveBuild> items;
    for (size_t i = 0; i < keys.size(); ++i)
        if (const auto& procedural = build.geometry.procedurals[i]; procedural->type().kind == MARRAM_CURVES)
            items.push_back(make_curves(build, *procedural, keys[i]));
    const double begin = wall_seconds();
    const bool round_pay = round_pieces_pay(items);
    for (CurveBuild& item : items) {
        const auto id = unsigned(build.world.meshes.size() + build.world.curves.size());
        if (build.settings.curves_bvh && item.output.curve_count > 0)
            attach_curves(build, item, id, round_pay);
        build.curves.push_back(item.geometry);
        build.world.curves.push_back(std::move(item.curves));
    }
    build.stats.curves_bvh += wall_seconds() - begin;
}

} // namespace marram
