// SPDX-License-Identifier: Apache-2.0
// Small worlds for tests, built directly with Embree as in core/world.
#pragma once

#include "core/geometry/world.h"
#include "core/plugin/embree.h"
#include "core/trace/curve_pieces.h"
#include "core/trace/round_pieces.h"

#include <cmath>
#include <cstring>
#include <functional>

namespace marram::testing {

using Cv = Eigen::Vector4d; // x, y, z, radius

class WorldBuilder {
  public:
    explicit WorldBuilder(std::vector<double> times = {0.0}) {
        world.device = {rtcNewDevice(nullptr), rtcReleaseDevice};
        world.scene = {rtcNewScene(world.device.get()), rtcReleaseScene};
        rtcSetSceneFlags(world.scene.get(), MARRAM_SCENE_FILTER);
        world.times = std::move(times);
    }

    // positions: [time][vertex]
    void mesh(std::vector<std::vector<Vec3f>> positions, std::vector<std::array<uint32_t, 3>> triangles,
              int material = 0, int light = -1, std::vector<std::vector<Vec3f>> normals = {}) {
        MeshGeometry mesh;
        mesh.material = material;
        mesh.light = light;
        mesh.positions = std::move(positions);
        mesh.normals = std::move(normals);
        mesh.triangles = std::move(triangles);
        const RTCGeometry geometry = rtcNewGeometry(world.device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryTimeStepCount(geometry, static_cast<unsigned>(mesh.positions.size()));
        for (size_t t = 0; t < mesh.positions.size(); ++t) {
            void* buffer = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, static_cast<unsigned>(t),
                                                   RTC_FORMAT_FLOAT3, 12, mesh.positions[t].size());
            std::memcpy(buffer, mesh.positions[t].data(), 12 * mesh.positions[t].size());
            for (const Vec3f& p : mesh.positions[t]) world.bounds.extend(p);
        }
        void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12,
                                                mesh.triangles.size());
        std::memcpy(indices, mesh.triangles.data(), 12 * mesh.triangles.size());
        attach(geometry, static_cast<unsigned>(world.meshes.size()));
        world.meshes.push_back(std::move(mesh));
    }

    // cvs: [time][curve * n + cv]; normal: one for all oriented ribbons; pieces: straight pieces a segment,
    // 0: the cubic. Call it after all meshes.
    void curves(const std::vector<std::vector<Cv>>& cvs, uint32_t n, MarramShape shape, MarramBasis basis,
                int material = 0, const Vec3f& normal = Vec3f::UnitZ(), uint32_t pieces = 0) {
        CurveGeometry curves;
        curves.material = material;
        curves.shape = shape;
        curves.basis = basis;
        curves.cvs_per_curve = n;
        curves.curve_count = cvs[0].size() / n;
        curves.pieces = pieces;
        const RTCGeometry geometry = rtcNewGeometry(world.device.get(), type_of(shape, basis));
        rtcSetGeometryTimeStepCount(geometry, static_cast<unsigned>(cvs.size()));
        const size_t count = curves.curve_count * (n + 2);
        for (unsigned t = 0; t < cvs.size(); ++t) {
            float* v = static_cast<float*>(
                rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT4, 16, count));
            for (size_t c = 0; c < curves.curve_count; ++c)
                put_curve(cvs[t].data() + c * n, n, v + 4 * c * (n + 2));
            curves.vertices.push_back(v);
            for (const Cv& cv : cvs[t]) {
                const Vec3f r = Vec3f::Constant(static_cast<float>(cv[3])), p = cv.head<3>().cast<float>();
                world.bounds.extend(p - r);
                world.bounds.extend(p + r);
            }
            if (shape != MARRAM_ORIENTED_RIBBON) continue;
            float* normals = static_cast<float*>(
                rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_NORMAL, t, RTC_FORMAT_FLOAT3, 12, count));
            for (size_t i = 0; i < count; ++i) std::memcpy(normals + 3 * i, normal.data(), 12);
            curves.normals.push_back(normals);
        }
        const auto id = static_cast<unsigned>(world.meshes.size() + world.curves.size());
        if (pieces > 0) {
            attach(pieces_of(curves), id);
            world.curve_buffers.emplace_back(geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); });
        } else {
            put_indices(geometry, curves.curve_count, n - 1, n + 2);
            attach(geometry, id);
        }
        world.curves.push_back(std::move(curves));
    }

    World& commit() {
        rtcCommitScene(world.scene.get());
        mark_round_pieces(world);
        return world;
    }

    World world;

  private:
    static RTCGeometryType type_of(MarramShape shape, MarramBasis basis) {
        const bool spline = basis == MARRAM_BSPLINE;
        if (shape == MARRAM_ROUND)
            return spline ? RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE : RTC_GEOMETRY_TYPE_ROUND_CATMULL_ROM_CURVE;
        if (shape == MARRAM_RIBBON)
            return spline ? RTC_GEOMETRY_TYPE_FLAT_BSPLINE_CURVE : RTC_GEOMETRY_TYPE_FLAT_CATMULL_ROM_CURVE;
        return spline ? RTC_GEOMETRY_TYPE_NORMAL_ORIENTED_BSPLINE_CURVE
                      : RTC_GEOMETRY_TYPE_NORMAL_ORIENTED_CATMULL_ROM_CURVE;
    }

    static void put_curve(const Cv* cv, uint32_t n, float* v) {
        const auto put = [&](uint32_t i, const Cv& value) {
            for (int k = 0; k < 4; ++k) v[4 * i + static_cast<uint32_t>(k)] = static_cast<float>(value[k]);
        };
        put(0, 2.0 * cv[0] - cv[1]);
        for (uint32_t i = 0; i < n; ++i) put(i + 1, cv[i]);
        put(n + 1, 2.0 * cv[n - 1] - cv[n - 2]);
    }

    static void put_indices(RTCGeometry geometry, size_t count, uint32_t segments, uint32_t stride) {
        unsigned* index = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, count * segments));
        for (uint32_t c = 0; c < count; ++c)
            for (uint32_t s = 0; s < segments; ++s) *index++ = c * stride + s;
    }

    // The same curves as straight pieces.
    RTCGeometry pieces_of(CurveGeometry& curves) {
        const RTCGeometry geometry = rtcNewGeometry(world.device.get(), RTC_GEOMETRY_TYPE_FLAT_LINEAR_CURVE);
        const uint32_t n = curves.cvs_per_curve, segments = (n - 1) * curves.pieces;
        rtcSetGeometryTimeStepCount(geometry, static_cast<unsigned>(curves.vertices.size()));
        for (unsigned t = 0; t < curves.vertices.size(); ++t) {
            float* v = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t,
                                                                   RTC_FORMAT_FLOAT4, 16,
                                                                   curves.curve_count * (segments + 1)));
            write_pieces({curves.vertices[t], curves.curve_count, n, curves.basis}, curves.vertices[0],
                         curves.pieces, v);
            if (curves.shape == MARRAM_ROUND) add_round_pieces(world, curves, v);
        }
        put_indices(geometry, curves.curve_count, segments, segments + 1);
        return geometry;
    }

    void attach(RTCGeometry geometry, unsigned id) {
        rtcSetGeometryMask(geometry, 0xffffffffU); // Embree 4: 1 by default
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(world.scene.get(), geometry, id);
        rtcReleaseGeometry(geometry);
    }
};

struct Triangles {
    std::vector<Vec3f> positions, normals;
    std::vector<std::array<uint32_t, 3>> triangles;
};

// Vertices on the sphere, anticlockwise from outside, with the sphere's normals.
inline Triangles sphere(const Vec3d& center, double radius, uint32_t columns, uint32_t rows) {
    Triangles mesh;
    for (uint32_t j = 0; j <= rows; ++j)
        for (uint32_t i = 0; i <= columns; ++i) {
            const double theta = pi * j / rows, phi = 2.0 * pi * (i % columns) / columns;
            const Vec3d n(std::sin(theta) * std::cos(phi), std::cos(theta), -std::sin(theta) * std::sin(phi));
            mesh.normals.push_back(n.cast<float>());
            mesh.positions.push_back((center + radius * n).cast<float>());
        }
    for (uint32_t j = 0; j < rows; ++j)
        for (uint32_t i = 0; i < columns; ++i) {
            const uint32_t a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
            if (j > 0) mesh.triangles.push_back({a, c, b});
            if (j + 1 < rows) mesh.triangles.push_back({b, c, d});
        }
    return mesh;
}

// A parallelogram with the normal u x v.
inline Triangles quad(const Vec3d& corner, const Vec3d& u, const Vec3d& v) {
    Triangles mesh;
    for (const Vec3d& p : {corner, Vec3d(corner + u), Vec3d(corner + u + v), Vec3d(corner + v)})
        mesh.positions.push_back(p.cast<float>());
    mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    return mesh;
}

} // namespace marram::testing
