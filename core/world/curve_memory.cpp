// SPDX-License-Identifier: Apache-2.0
#include "core/world/curve_memory.h"

#include "core/math/resident_memory.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// Measured; Embree 3.13.
BvhCost cost_of_curves(bool pieces, bool oriented, double keys) {
    if (keys < 2.0) return {pieces ? 31.0 : oriented ? 42.0 : 116.0, 60.0};
    if (keys < 3.0) return {pieces ? 45.0 : 71.0, 80.0};
    return {pieces ? 72.0 + 47.0 * (keys - 3.0) : 148.0 + 57.0 * (keys - 3.0), 88.0};
}
constexpr const char* fewer_strands = "use film.geometry = \"lazy\", or fewer strands, CVs or motion keys";

constexpr BvhCost triangle_cost{64.0, 53.0};

// At least one piece a segment; more are chosen when CVs are known.
uint32_t least_pieces(const Build& build, const MarramOutput& output) {
    if (output.shape == MARRAM_ORIENTED_RIBBON || output.offsets) return 0;
    return build.settings.curve_pieces < 0 ? 1 : uint32_t(build.settings.curve_pieces);
}

// As --memory reads it.
std::string size_text(uint64_t bytes, bool rounds_up) {
    const auto whole = [&](double units) { return rounds_up ? std::ceil(units) : std::floor(units); };
    return bytes < uint64_t(1) << 30 ? fmt::format("{:.0f}M", whole(double(bytes) / 0x1p20))
                                     : fmt::format("{:.1f}G", whole(10.0 * double(bytes) / 0x1p30) / 10.0);
}

uint64_t now_needed(const Build& build) { return resident_bytes() + build.settings.memory.reserved; }

} // namespace

CurveMemory curve_memory(const CurveBuild& item, uint32_t pieces, uint32_t most_keys) {
    const MarramOutput& output = item.output;
    const CurveLayout layout = item.layout();
    const uint64_t keys = output.time_count, segments = layout.segment_count(),
                   primitives = segments * std::max(pieces, 1U);
    CurveMemory memory;
    memory.arrays = layout.vertex_count() * keys * (output.shape == MARRAM_ORIENTED_RIBBON ? 28 : 16) +
                    primitives * sizeof(uint32_t);
    if (pieces > 0) memory.arrays += (primitives + output.curve_count) * keys * 16;
    if (output.offsets) memory.arrays += segments * sizeof(uint32_t);
    for (const uint32_t a : item.attributes)
        memory.arrays += item.value_count(item.procedural->attributes()[a]) * sizeof(float);
    const BvhCost cost = cost_of_curves(pieces > 0, output.shape == MARRAM_ORIENTED_RIBBON,
                                        double(std::min(keys, uint64_t(item.has_parts ? 2 : most_keys))));
    memory.bvh = uint64_t(cost.bvh * double(primitives));
    memory.building = uint64_t(cost.building * double(primitives));
    return memory;
}

BvhCost bvh_of_cubics(MarramShape shape, double keys) {
    return cost_of_curves(false, shape == MARRAM_ORIENTED_RIBBON, keys);
}

uint64_t triangle_bvh_bytes(uint64_t triangles) {
    return uint64_t((triangle_cost.bvh + triangle_cost.building) * double(triangles));
}

void refuse_memory(uint64_t needed, uint64_t limit, const std::string& what_for, bool at_least,
                   const std::string& or_else) {
    throw InputError({"--memory"},
                     fmt::format("the frame needs {} {} for {}, and the process may take {}",
                                 at_least ? "more than" : "about", size_text(needed, true), what_for,
                                 size_text(limit, false)),
                     "allow more, where the machine has it, or " + or_else);
}

bool fits_memory(Build& build, const CurveBuild& item) {
    // Two keys may do for most curves (curve_parts.h).
    const CurveMemory cubics = curve_memory(item, 0, 2),
                      pieces = curve_memory(item, least_pieces(build, item.output), 2),
                      memory = pieces.total() < cubics.total() || build.settings.curve_pieces > 0 ? pieces
                                                                                                  : cubics;
    build.bvh_bytes += build.settings.trace_curves ? memory.bvh + memory.building : 0;
    const uint64_t limit = build.settings.memory.limit;
    if (limit == 0 || (build.refused.empty() && now_needed(build) + memory.arrays + build.bvh_bytes <= limit))
        return true;
    build.unmade_bytes += memory.arrays;
    build.refused.push_back(item.procedural);
    build.items.pop_back();
    return false;
}

bool reads_refused(Build& build, const Procedural& procedural) {
    if (!std::ranges::any_of(build.refused,
                             [&](const Procedural* one) { return procedural.names(one->name()); }))
        return false;
    build.refused.push_back(&procedural);
    return true;
}

void raise_refused(const Build& build) {
    if (!build.refused.empty())
        refuse_memory(now_needed(build) + build.unmade_bytes + build.bvh_bytes, build.settings.memory.limit,
                      "its strands", true, fewer_strands);
}

void check_memory(const Build& build) {
    const uint64_t limit = build.settings.memory.limit;
    if (limit == 0) return;
    uint64_t needed = now_needed(build);
    bool any_eager = false;
    for (const CurveBuild& item : build.items) {
        if (item.lazy || !build.settings.trace_curves) continue;
        any_eager = true;
        const CurveMemory memory = curve_memory(item, item.curves.pieces),
                          cubics = curve_memory(item, 0); // whose arrays are there, but for the indices
        needed += memory.total() - cubics.arrays + item.layout().segment_count() * sizeof(uint32_t);
    }
    uint64_t triangles = 0; // whose BVH is not made yet
    if (build.settings.trace_curves)
        for (const MeshGeometry& mesh : build.world.meshes) triangles += mesh.triangles.size();
    needed += triangle_bvh_bytes(triangles);
    if (needed > limit)
        refuse_memory(needed, limit, any_eager ? "its strands and the BVH" : "its meshes and the BVH", false,
                      any_eager ? fewer_strands : "use fewer triangles");
}

void limit_device(const Build& build) {
    const uint64_t limit = build.settings.memory.limit, needed = now_needed(build);
    if (limit == 0) return;
    if (needed > limit)
        refuse_memory(needed, limit, "the picture and what is loaded", true, "make the picture smaller");
    DeviceState& device = *build.world.device_state;
    device.limit = device.bytes.load() + int64_t(limit - needed);
}

} // namespace marram
