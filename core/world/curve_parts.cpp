// SPDX-License-Identifier: Apache-2.0
#include "core/world/curve_parts.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <numeric>

namespace marram {
namespace {

// Largest distance of a curve's vertices, radii and half-widths from lines between the first and last key, m
// as View::enlarged() enlarges it; stops beyond `limit`.
double two_key_error(const CurveBuild& item, size_t first_vertex, size_t vertices, double limit,
                     const View& view) {
    const size_t last = item.vertices.size() - 1;
    double most = 0.0;
    for (size_t v = first_vertex; v < first_vertex + vertices && most <= limit; ++v) {
        const auto vertex = [&](size_t key) -> Vec4d {
            return Vec4f::Map(item.vertices[key] + 4 * v).cast<double>();
        };
        const auto normal = [&](size_t key) -> Vec3d {
            return Vec3f::Map(item.normals[key] + 3 * v).cast<double>();
        };
        const Vec4d begin = vertex(0), way = vertex(last) - begin;
        for (size_t key = 1; key < last; ++key) {
            const Vec4d at = vertex(key);
            const double t = double(key) / double(last);
            double off = (at - begin - t * way).norm();
            if (!item.normals.empty()) {
                const Vec3d turned = normal(key) - normal(0) - t * (normal(last) - normal(0));
                off = std::max(off, std::abs(at[3]) * turned.norm());
            }
            if (off > 0.0) most = std::max(most, off * view.enlarged(at.head<3>()));
        }
    }
    return most;
}

// A part's primitives, and the first vertex of each.
struct PartIndices {
    std::shared_ptr<std::vector<uint32_t>> primitives = std::make_shared<std::vector<uint32_t>>();
    std::vector<uint32_t> vertices;
};

PartIndices indices_of(const CurveBuild& item, const TracedVertices& traced, bool end_keys_only) {
    const CurveLayout layout = item.curves.layout();
    const bool alike = traced.segments > 0;
    const auto segments_of = [&](uint64_t c) { return alike ? traced.segments : layout.cvs(c) - 1; };
    const auto wanted = [&](uint64_t c) { return (item.curves.end_keys_only[c] != 0) == end_keys_only; };
    size_t count = 0;
    for (uint64_t c = 0; c < layout.curve_count; ++c)
        if (wanted(c)) count += segments_of(c);
    PartIndices indices;
    indices.primitives->reserve(count);
    indices.vertices.reserve(count);
    for (uint64_t c = 0; c < layout.curve_count; ++c) {
        if (!wanted(c)) continue;
        const uint32_t segments = segments_of(c);
        const uint64_t primitive = alike ? c * segments : layout.first_segment(c),
                       vertex = alike ? c * traced.stride : layout.first_vertex(c);
        for (uint32_t k = 0; k < segments; ++k) {
            indices.primitives->push_back(uint32_t(primitive + k));
            indices.vertices.push_back(uint32_t(vertex + k));
        }
    }
    return indices;
}

// Attaches a part with some of the keys, in which it is visible.
void attach_part(Build& build, const TracedVertices& traced, const PartIndices& indices,
                 const std::vector<size_t>& keys, CurvePart part) {
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), traced.type);
    const std::shared_ptr<RTCGeometryTy> owner(geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); });
    rtcSetGeometryTimeStepCount(geometry, unsigned(keys.size()));
    const auto last = float(traced.vertices.size() - 1);
    rtcSetGeometryTimeRange(geometry, float(keys.front()) / last, float(keys.back()) / last);
    for (unsigned t = 0; t < keys.size(); ++t) {
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4,
                                   traced.vertices[keys[t]], 0, 16, traced.vertex_count);
        if (!traced.normals.empty())
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3,
                                       traced.normals[keys[t]], 0, 12, traced.vertex_count);
    }
    const size_t count = indices.vertices.size();
    auto* buffer = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, count));
    build.check_device();
    std::ranges::copy(indices.vertices, buffer);
    build.stats.curve_bytes += count * 4;
    part.primitives = indices.primitives;
    part.owner = traced.geometry;
    const size_t id = build.world.meshes.size() + build.items.size() + build.world.curve_parts.size();
    attach_geometry(build, geometry, unsigned(id));
    build.world.curve_parts.push_back(std::move(part));
}

} // namespace

void attach_geometry(Build& build, RTCGeometry geometry, unsigned id) {
    rtcSetGeometryMask(geometry, MARRAM_CASTS_SHADOWS | MARRAM_SEEN_BY_CAMERA | darkens_catchers);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(build.world.scene.get(), geometry, id);
}

void find_end_key_curves(Build& build, CurveBuild& item) {
    const size_t keys = item.vertices.size();
    if (!build.chooses_keys() || keys <= 2) return;
    const CurveLayout layout = item.curves.layout();
    const double limit = build.settings.tolerance / strand_motion_margin;
    std::vector<char> end_keys_only(layout.curve_count);
    const double most = tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, item.patches.size()), 0.0,
        [&](const auto& patches, double found) {
            for (size_t i = patches.begin(); i < patches.end(); ++i) {
                const MarramPatch& patch = item.patches[i];
                for (uint64_t c = patch.first_curve; c < patch.first_curve + patch.curve_count; ++c) {
                    const double error = two_key_error(item, layout.first_vertex(c), layout.cvs(c) + 2, limit,
                                                       build.settings.view);
                    end_keys_only[c] = error <= limit;
                    if (error <= limit) found = std::max(found, error);
                }
            }
            return found;
        },
        [](double a, double b) { return std::max(a, b); });
    const uint64_t curves = end_keys_only.size(),
                   more = curves - uint64_t(std::ranges::count(end_keys_only, 1));
    build.stats.chosen[item.procedural->name() + ".more_than_two_keys"] = double(more) / double(curves);
    if (8 * more > curves || 2 * more * (keys - 1) > curves) return;
    build.stats.motion_error = std::max(build.stats.motion_error, most);
    build.stats.curve_bytes += layout.segment_count() * std::max(item.curves.pieces, 1U) * 4; // primitives
    item.curves.end_keys_only = std::move(end_keys_only);
}

void attach_parts(Build& build, const CurveBuild& item, const TracedVertices& traced, uint32_t set,
                  bool spans) {
    const size_t last = traced.vertices.size() - 1;
    attach_part(build, traced, indices_of(item, traced, true), {0, last},
                {.curves = set, .end_keys_only = true});
    const PartIndices indices = indices_of(item, traced, false);
    if (indices.vertices.empty()) return;
    if (spans) {
        for (size_t key = 0; key < last; ++key)
            attach_part(build, traced, indices, {key, key + 1}, {.curves = set});
    } else {
        std::vector<size_t> keys(last + 1);
        std::iota(keys.begin(), keys.end(), size_t{0});
        attach_part(build, traced, indices, keys, {.curves = set});
    }
}

} // namespace marram
