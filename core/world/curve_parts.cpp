// SPDX-License-Identifier: Apache-2.0
#include "core/world/curve_parts.h"

#include <tbb/parallel_for.h>

namespace marram {
namespace {

// True if the CVs of a curve stay within `limit`, m as View::enlarged() enlarges it, of lines from the first
// key to the last.
bool two_keys_follow(const CurveBuild& item, size_t first_vertex, size_t vertices, double limit,
                     const View& view) {
    const size_t last = item.vertices.size() - 1;
    for (size_t v = 4 * first_vertex; v < 4 * (first_vertex + vertices); v += 4) {
        const Vec3d begin = Vec3f::Map(item.vertices[0] + v).cast<double>(),
                    way = Vec3f::Map(item.vertices[last] + v).cast<double>() - begin;
        for (size_t key = 1; key < last; ++key) {
            const Vec3d at = Vec3f::Map(item.vertices[key] + v).cast<double>();
            const double off2 = (at - begin - double(key) / double(last) * way).squaredNorm();
            if (off2 == 0.0) continue;
            const double allowed = limit / view.enlarged(at);
            if (off2 > allowed * allowed) return false;
        }
    }
    return true;
}

// [curve]: 1 if it needs more than two keys.
std::vector<char> curves_that_need_more(const Build& build, const CurveBuild& item) {
    const CurveLayout layout = item.curves.layout();
    const double limit = build.settings.tolerance / strand_motion_margin;
    std::vector<char> more(layout.curve_count);
    tbb::parallel_for(size_t{0}, item.patches.size(), [&](size_t i) {
        const MarramPatch& patch = item.patches[i];
        for (uint64_t c = patch.first_curve; c < patch.first_curve + patch.curve_count; ++c)
            more[c] =
                !two_keys_follow(item, layout.first_vertex(c), layout.cvs(c) + 2, limit, build.settings.view);
    });
    return more;
}

// A part's primitives, and the first vertex of each.
struct PartIndices {
    std::vector<uint32_t> primitives, vertices;
};

PartIndices indices_of(const CurveBuild& item, const TracedVertices& traced, const std::vector<char>& more,
                       char wanted) {
    const CurveLayout layout = item.curves.layout();
    PartIndices indices;
    for (uint64_t c = 0; c < layout.curve_count; ++c) {
        if (more[c] != wanted) continue;
        const uint32_t segments = traced.segments > 0 ? traced.segments : layout.cvs(c) - 1;
        const uint64_t primitive = traced.segments > 0 ? c * segments : layout.first_segment(c),
                       vertex = traced.segments > 0 ? c * traced.stride : layout.first_vertex(c);
        for (uint32_t k = 0; k < segments; ++k) {
            indices.primitives.push_back(uint32_t(primitive + k));
            indices.vertices.push_back(uint32_t(vertex + k));
        }
    }
    return indices;
}

// Attaches a part that moves from one key to another.
void attach_part(Build& build, const TracedVertices& traced, const PartIndices& indices, size_t from,
                 size_t to, CurvePart part) {
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), traced.type);
    const std::shared_ptr<RTCGeometryTy> owner(geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); });
    rtcSetGeometryTimeStepCount(geometry, 2);
    const auto last = float(traced.vertices.size() - 1);
    rtcSetGeometryTimeRange(geometry, float(from) / last, float(to) / last);
    for (unsigned t = 0; t < 2; ++t) {
        const size_t key = t == 0 ? from : to;
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4,
                                   traced.vertices[key], 0, 16, traced.vertex_count);
        if (!traced.normals.empty())
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3,
                                       traced.normals[key], 0, 12, traced.vertex_count);
    }
    const size_t count = indices.vertices.size();
    auto* buffer = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, count));
    build.check_device();
    std::ranges::copy(indices.vertices, buffer);
    build.stats.curve_bytes += count * 8; // with the primitives
    part.primitives = indices.primitives;
    attach_geometry(
        build, geometry,
        unsigned(build.world.meshes.size() + build.items.size() + build.world.curve_parts.size()));
    build.world.curve_parts.push_back(std::move(part));
}

} // namespace

void attach_geometry(Build& build, RTCGeometry geometry, unsigned id) {
    rtcSetGeometryMask(geometry, MARRAM_CASTS_SHADOWS | MARRAM_SEEN_BY_CAMERA | darkens_catchers);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(build.world.scene.get(), geometry, id);
}

bool attach_parts(Build& build, const CurveBuild& item, const TracedVertices& traced, uint32_t set) {
    const size_t keys = traced.vertices.size();
    if (!build.chooses_keys() || keys <= 2) return false;
    const std::vector<char> more = curves_that_need_more(build, item);
    const auto needed = uint64_t(std::ranges::count(more, 1));
    const uint64_t curves = more.size();
    build.stats.chosen[item.procedural->name() + ".more_than_two_keys"] = double(needed) / double(curves);
    if (8 * needed > curves || 2 * needed * (keys - 1) > curves) return false;
    attach_part(build, traced, indices_of(item, traced, more, 0), 0, keys - 1, {set, {}, true});
    if (needed == 0) return true;
    const PartIndices indices = indices_of(item, traced, more, 1);
    for (size_t key = 0; key + 1 < keys; ++key)
        attach_part(build, traced, indices, key, key + 1, {set, {}, false});
    return true;
}

} // namespace marram
