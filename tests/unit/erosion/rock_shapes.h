// SPDX-License-Identifier: Apache-2.0
// Rocks with known wear. For the tests, build/rock_erosion and build/marram_bench.
#pragma once

#include "core/math/vec.h"
#include "procedural/erosion/grains.h"
#include "procedural/erosion/level_set.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace marram::testing {

inline Vec3d vertex_of(const LevelMesh& mesh, size_t v) {
    return {double(mesh.positions[3 * v]), double(mesh.positions[3 * v + 1]),
            double(mesh.positions[3 * v + 2])};
}
inline Vec3d normal_of(const LevelMesh& mesh, size_t v) {
    return {double(mesh.normals[3 * v]), double(mesh.normals[3 * v + 1]), double(mesh.normals[3 * v + 2])};
}
inline void add_vertex(LevelMesh& mesh, const Vec3d& p) {
    for (int axis = 0; axis < 3; ++axis) mesh.positions.push_back(float(p[axis]));
}

// A sphere of `rings` by 2 `rings` faces, without normals.
inline LevelMesh rock_sphere(const Vec3d& centre, double radius, uint32_t rings) {
    LevelMesh mesh;
    const uint32_t sides = 2 * rings;
    for (uint32_t j = 0; j <= rings; ++j)
        for (uint32_t i = 0; i < sides; ++i) {
            const double a = pi * j / rings, b = 2.0 * pi * i / sides;
            const double across = j == 0 || j == rings ? 0.0 : std::sin(a); // one point at each pole
            add_vertex(mesh,
                       centre + radius * Vec3d(across * std::cos(b), std::cos(a), across * std::sin(b)));
        }
    for (uint32_t j = 0; j < rings; ++j)
        for (uint32_t i = 0; i < sides; ++i) {
            const uint32_t a = j * sides + i, b = j * sides + (i + 1) % sides, c = a + sides, d = b + sides;
            for (const uint32_t k : {a, b, d, a, d, c}) mesh.triangles.push_back(k);
        }
    return mesh;
}

// A box rotated about x, then about z; without normals.
inline LevelMesh rock_box(const Vec3d& centre, const Vec3d& half,
                          const Eigen::Matrix3d& turn = Eigen::Matrix3d::Identity()) {
    LevelMesh mesh;
    for (int c = 0; c < 8; ++c)
        add_vertex(mesh, centre + turn * Vec3d(c & 4 ? half.x() : -half.x(), c & 2 ? half.y() : -half.y(),
                                               c & 1 ? half.z() : -half.z()));
    constexpr std::array<std::array<uint32_t, 4>, 6> faces{
        {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}}};
    for (const auto& face : faces)
        for (const size_t k : {0, 1, 2, 0, 2, 3}) mesh.triangles.push_back(face[k]);
    return mesh;
}

// Grains over a plain at height 0, in wind towards `azimuth`.
inline GrainSettings rock_grains(double azimuth, uint64_t paths) {
    GrainSettings grains;
    grains.paths = paths;
    grains.wind = Vec3d(std::cos(azimuth), 0.0, std::sin(azimuth));
    grains.ground = 0.0;
    grains.spread = 8.0 * degree;
    grains.reach = 2.0;
    return grains;
}

struct SphereWear {
    double radius = 0.0, error = 0.0,
           spread = 0.0; // m; error: |mean radius - expected|; spread: greatest minus least radius
    double removed = 0.0, integral = 0.0; // m^3: from volumes, and from depth times area
    int passes = 0;
};

// A unit sphere worn to half its radius, at most 0.6 voxels per pass.
inline SphereWear wear_sphere(double voxel) {
    const LevelMesh sphere = rock_sphere(Vec3d::Zero(), 1.0, 120);
    LevelSet rock = LevelSet::from_mesh(sphere.positions, sphere.triangles, voxel);
    SphereWear result;
    const double before = mesh_volume(rock.mesh());
    for (double gone = 0.0; gone < 0.5 - 1e-12; ++result.passes) {
        const double depth = std::min(0.6 * voxel, 0.5 - gone), area = mesh_area(rock.mesh());
        rock.advance(std::vector<double>(rock.mesh().vertex_count(), depth));
        result.integral += depth * 0.5 * (area + mesh_area(rock.mesh()));
        gone += depth;
    }
    result.removed = before - mesh_volume(rock.mesh());
    double least = 10.0, greatest = 0.0;
    const LevelMesh& mesh = rock.mesh();
    for (size_t v = 0; v < mesh.vertex_count(); ++v) {
        const double r = vertex_of(mesh, v).norm();
        result.radius += r / double(mesh.vertex_count());
        least = std::min(least, r), greatest = std::max(greatest, r);
    }
    result.error = std::abs(result.radius - 0.5);
    result.spread = greatest - least;
    return result;
}

struct PlaneWear {
    double depth = 0.0, mean = 0.0, least = 1e9, greatest = -1e9; // m: nominal depth; error of the faces
};

// A rotated cube with edges of 1 m that loses `voxels_a_pass` in each of 20 passes. Measured in the middle of
// its faces.
inline PlaneWear wear_plane(double turn_x, double turn_z, double voxel, double voxels_a_pass) {
    const Eigen::Matrix3d turn =
        (Eigen::AngleAxisd(turn_z, Vec3d::UnitZ()) * Eigen::AngleAxisd(turn_x, Vec3d::UnitX()))
            .toRotationMatrix();
    const LevelMesh box = rock_box(Vec3d::Zero(), Vec3d::Constant(0.5), turn);
    LevelSet rock = LevelSet::from_mesh(box.positions, box.triangles, voxel);
    PlaneWear result;
    for (int pass = 0; pass < 20; ++pass) {
        rock.advance(std::vector<double>(rock.mesh().vertex_count(), voxels_a_pass * voxel));
        result.depth += voxels_a_pass * voxel;
    }
    const LevelMesh& mesh = rock.mesh();
    size_t count = 0;
    for (size_t v = 0; v < mesh.vertex_count(); ++v) {
        Vec3d p = (turn.transpose() * vertex_of(mesh, v)).cwiseAbs();
        std::sort(p.data(), p.data() + 3);
        if (p[1] > 0.1) continue;
        const double error = p[2] - (0.5 - result.depth);
        result.mean += error, ++count;
        result.least = std::min(result.least, error), result.greatest = std::max(result.greatest, error);
    }
    result.mean /= double(std::max<size_t>(count, 1));
    return result;
}

// Distance between a level and the next finer one, smoothed by half a voxel of the coarse level; in voxels of
// the coarse level.
struct LevelParity {
    double mean = 0.0;                         // positive: the coarse level is outside the smoothed one
    double rms = 0.0, most = 0.0, at_99 = 0.0; // of absolute values; at_99: 99th percentile over vertices
};

inline LevelParity level_parity(LevelSet& coarse, LevelSet& fine) {
    const LevelMesh& mesh = coarse.mesh();
    std::vector<float> distance(mesh.vertex_count());
    smoothed_distance(fine.mesh(), 0.5 * coarse.voxel(), mesh.positions, distance);
    LevelParity parity;
    std::vector<double> all;
    for (const float d : distance) {
        all.push_back(std::abs(double(d)) / coarse.voxel());
        parity.mean += double(d) / coarse.voxel() / double(distance.size());
        parity.rms += all.back() * all.back() / double(distance.size());
    }
    std::sort(all.begin(), all.end());
    parity.rms = std::sqrt(parity.rms);
    parity.most = all.back();
    parity.at_99 = all[size_t(0.99 * double(all.size() - 1))];
    return parity;
}

} // namespace marram::testing
