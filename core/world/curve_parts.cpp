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

} // namespace

void attach_geometry(Build& build, RTCGeometry geometry, unsigned id) {
    rtcSetGeometryMask(geometry, curve_mask);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(build.world.scene.get(), geometry, id);
}

double mark_end_key_curves(const CurveBuild& item, const MarramPatch& patch, double limit, const View& view,
                           char* marks) {
    const CurveLayout layout = item.layout();
    double most = 0.0;
    for (uint32_t i = 0; i < patch.curve_count; ++i) {
        const uint64_t c = patch.first_curve + i;
        const double error = two_key_error(item, layout.first_vertex(c), layout.cvs(c) + 2, limit, view);
        marks[i] = error <= limit;
        if (error <= limit) most = std::max(most, error);
    }
    return most;
}

void find_end_key_curves(Build& build, CurveBuild& item) {
    const size_t keys = item.vertices.size();
    if (!build.chooses_keys() || keys <= 2) return;
    const double limit = end_key_limit(build.settings);
    const std::vector<uint32_t> known = item.patches_made_early();
    std::vector<uint64_t> first(known.size() + 1); // of each known patch, its first mark
    for (size_t i = 0; i < known.size(); ++i) first[i + 1] = first[i] + item.patches[known[i]].curve_count;
    std::vector<char> marks(first.back());
    const double most = tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, known.size()), 0.0,
        [&](const auto& range, double found) {
            for (size_t i = range.begin(); i < range.end(); ++i)
                found = std::max(found, mark_end_key_curves(item, item.patches[known[i]], limit,
                                                            build.settings.view, marks.data() + first[i]));
            return found;
        },
        [](double a, double b) { return std::max(a, b); });
    const uint64_t curves = marks.size(), more = curves - uint64_t(std::ranges::count(marks, 1));
    build.stats.chosen[item.procedural->name() + ".more_than_two_keys"] = double(more) / double(curves);
    if (8 * more > curves || 2 * more * (keys - 1) > curves) return;
    build.stats.motion_error = std::max(build.stats.motion_error, most);
    item.has_parts = true;
    if (item.lazy) return;
    build.stats.curve_bytes +=
        item.layout().segment_count() * std::max(item.curves.pieces, 1U) * 4; // primitives
    item.curves.end_keys_only = std::move(marks);
}

PartIndices part_indices(const CurveBuild& item, const TracedVertices& traced, uint64_t first_curve,
                         std::span<const char> marks, char wanted) {
    const CurveLayout layout = item.layout();
    const bool alike = traced.segments > 0;
    const auto segments_of = [&](uint64_t c) { return alike ? traced.segments : layout.cvs(c) - 1; };
    const auto vertex_of = [&](uint64_t c) { return alike ? c * traced.stride : layout.first_vertex(c); };
    size_t count = 0;
    for (size_t i = 0; i < marks.size(); ++i)
        if (marks[i] == wanted) count += segments_of(first_curve + i);
    PartIndices indices;
    indices.primitives.reserve(count);
    indices.vertices.reserve(count);
    for (size_t i = 0; i < marks.size(); ++i) {
        if (marks[i] != wanted) continue;
        const uint64_t c = first_curve + i;
        const uint32_t segments = segments_of(c);
        const uint64_t primitive = alike ? c * segments : layout.first_segment(c),
                       vertex = vertex_of(c) - vertex_of(first_curve);
        for (uint32_t k = 0; k < segments; ++k) {
            indices.primitives.push_back(uint32_t(primitive + k));
            indices.vertices.push_back(uint32_t(vertex + k));
        }
    }
    return indices;
}

std::vector<std::vector<size_t>> part_keys(size_t keys, bool end_keys_only, bool spans) {
    std::vector<std::vector<size_t>> of_parts;
    if (end_keys_only) {
        of_parts.push_back({0, keys - 1});
    } else if (spans) {
        for (size_t key = 0; key + 1 < keys; ++key) of_parts.push_back({key, key + 1});
    } else {
        std::vector<size_t> all(keys);
        std::iota(all.begin(), all.end(), size_t{0});
        of_parts.push_back(std::move(all));
    }
    return of_parts;
}

std::shared_ptr<RTCGeometryTy> part_geometry(RTCDevice device, const TracedVertices& traced,
                                             std::span<const uint32_t> vertices,
                                             const std::vector<size_t>& keys) {
    RTCGeometry geometry = rtcNewGeometry(device, traced.type);
    std::shared_ptr<RTCGeometryTy> owner(geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); });
    rtcSetGeometryTimeStepCount(geometry, unsigned(keys.size()));
    const auto last = float(traced.vertices.size() - 1);
    if (last > 0.0F) rtcSetGeometryTimeRange(geometry, float(keys.front()) / last, float(keys.back()) / last);
    for (unsigned t = 0; t < keys.size(); ++t) {
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4,
                                   traced.vertices[keys[t]], 0, 16, traced.vertex_count);
        if (!traced.normals.empty())
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3,
                                       traced.normals[keys[t]], 0, 12, traced.vertex_count);
    }
    auto* buffer = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, vertices.size()));
    if (buffer) std::ranges::copy(vertices, buffer); // else the device has an error
    return owner;
}

void attach_parts(Build& build, const CurveBuild& item, const TracedVertices& traced, uint32_t set,
                  bool spans) {
    World& world = build.world;
    for (const char end_keys_only : {char(1), char(0)}) {
        PartIndices indices = part_indices(item, traced, 0, item.curves.end_keys_only, end_keys_only);
        if (indices.vertices.empty()) continue;
        const auto primitives = std::make_shared<const std::vector<uint32_t>>(std::move(indices.primitives));
        for (const std::vector<size_t>& keys : part_keys(traced.vertices.size(), end_keys_only != 0, spans)) {
            const auto geometry = part_geometry(world.device.get(), traced, indices.vertices, keys);
            build.check_device();
            build.stats.curve_bytes += indices.vertices.size() * 4;
            const size_t id = world.meshes.size() + build.items.size() + world.curve_parts.size();
            attach_geometry(build, geometry.get(), unsigned(id));
            world.curve_parts.push_back({set, primitives, end_keys_only != 0, traced.geometry});
        }
    }
}

} // namespace marram
