// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/mesh/mesher.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <utility>

namespace marram {
namespace {

double mesher_noise(double x, double z, uint64_t seed) {
    const int64_t i = int64_t(std::floor(x)), j = int64_t(std::floor(z));
    const auto value = [&](int64_t a, int64_t b) {
        return unit_double(hash(hash(seed, uint64_t(i + a)), uint64_t(j + b))) - 0.5;
    };
    const auto smooth = [](double t) { return t * t * (3.0 - 2.0 * t); };
    const double u = smooth(x - double(i)), v = smooth(z - double(j));
    return (value(0, 0) * (1 - u) + value(1, 0) * u) * (1 - v) +
           (value(0, 1) * (1 - u) + value(1, 1) * u) * v;
}

std::vector<float> mesher_hills(const Domain& d) {
    std::vector<float> heights;
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            double h = 0.0, scale = 128.0, size = 60.0;
            for (uint64_t octave = 0; octave < 7; ++octave, scale *= 0.5, size *= 0.45)
                h += size * mesher_noise(i / scale, j / scale, octave);
            heights.push_back(float(h));
        }
    return heights;
}

// Smooth windward flanks, sharp crests, level ground between them.
std::vector<float> mesher_dunes(const Domain& d) {
    std::vector<float> heights;
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            const double phase = (i + 60.0 * mesher_noise(i / 150.0, j / 150.0, 1)) / 130.0;
            const double t = phase - std::floor(phase);
            const double size = std::max(0.0, 14.0 * mesher_noise(i / 300.0, j / 300.0, 2));
            const double profile = t < 0.78 ? 0.5 - 0.5 * std::cos(pi * t / 0.78) : (1.0 - t) / 0.22;
            heights.push_back(float(size * std::max(0.0, profile - 0.12)));
        }
    return heights;
}

// Every edge is used once in each direction or lies on the border of the domain; all triangles face up and
// cover the domain exactly once.
void expect_no_cracks(const Domain& d, const RenderMesh& mesh) {
    std::vector<std::pair<uint32_t, uint32_t>> edges;
    int64_t area = 0;
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        int64_t i[3], j[3];
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t v = mesh.triangles[t + k];
            ASSERT_LT(v, mesh.samples.size());
            ASSERT_LT(mesh.samples[v], d.count());
            i[k] = mesh.samples[v] % uint32_t(d.nx), j[k] = mesh.samples[v] / uint32_t(d.nx);
            edges.push_back({v, mesh.triangles[t + (k + 1) % 3]});
        }
        const int64_t turn = (j[1] - j[0]) * (i[2] - i[0]) - (i[1] - i[0]) * (j[2] - j[0]);
        ASSERT_GT(turn, 0);
        area += turn;
    }
    EXPECT_EQ(area, 2 * int64_t(d.nx - 1) * (d.nz - 1));
    const auto side = [&](uint32_t v, uint32_t w) {
        const int nx = d.nx, a = int(mesh.samples[v]), b = int(mesh.samples[w]);
        const auto both = [](int p, int q, int value) { return p == value && q == value; };
        return both(a % nx, b % nx, 0) || both(a % nx, b % nx, nx - 1) || both(a / nx, b / nx, 0) ||
               both(a / nx, b / nx, d.nz - 1);
    };
    std::sort(edges.begin(), edges.end());
    ASSERT_EQ(std::adjacent_find(edges.begin(), edges.end()), edges.end());
    for (const auto& [v, w] : edges)
        ASSERT_NE(std::binary_search(edges.begin(), edges.end(), std::pair(w, v)), side(v, w));
    std::vector<uint32_t> sorted = mesh.samples; // no duplicate vertices
    std::sort(sorted.begin(), sorted.end());
    EXPECT_EQ(std::adjacent_find(sorted.begin(), sorted.end()), sorted.end());
}

// Calls visit(sample, corners, u, v) for each triangle and each sample inside it. Barycentric weights of the
// corners: 1 - u - v, u, v.
template <class Visit>
void visit_triangles(const Domain& d, const RenderMesh& mesh, const Visit& visit) {
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        size_t corners[3];
        int i[3], j[3];
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t sample = mesh.samples[mesh.triangles[t + k]];
            corners[k] = sample, i[k] = int(sample) % d.nx, j[k] = int(sample) / d.nx;
        }
        const double area = double(i[1] - i[0]) * (j[2] - j[0]) - double(i[2] - i[0]) * (j[1] - j[0]);
        for (int z = *std::min_element(j, j + 3); z <= *std::max_element(j, j + 3); ++z)
            for (int x = *std::min_element(i, i + 3); x <= *std::max_element(i, i + 3); ++x) {
                const double u = (double(x - i[0]) * (j[2] - j[0]) - double(i[2] - i[0]) * (z - j[0])) / area;
                const double v = (double(i[1] - i[0]) * (z - j[0]) - double(x - i[0]) * (j[1] - j[0])) / area;
                if (u < -1e-9 || v < -1e-9 || u + v > 1.0 + 1e-9) continue; // coordinates are below 2^12
                visit(d.index(x, z), corners, u, v);
            }
    }
}

// |mesh height - sample height| at each sample, maximum over the triangles that contain it; -1 if none does.
std::vector<double> mesher_errors(const Domain& d, const std::vector<float>& heights,
                                  const RenderMesh& mesh) {
    std::vector<double> errors(d.count(), -1.0);
    visit_triangles(d, mesh, [&](size_t sample, const size_t* corners, double u, double v) {
        const double h[] = {heights[corners[0]], heights[corners[1]], heights[corners[2]]};
        const double height = h[0] + u * (h[1] - h[0]) + v * (h[2] - h[0]);
        errors[sample] = std::max(errors[sample], std::abs(height - double(heights[sample])));
    });
    return errors;
}

// Central differences, one-sided at the border.
Vec2d mesher_gradient(const Domain& d, const std::vector<float>& heights, size_t sample) {
    const int i = int(sample % size_t(d.nx)), j = int(sample / size_t(d.nx));
    const int i0 = std::max(i - 1, 0), i1 = std::min(i + 1, d.nx - 1);
    const int j0 = std::max(j - 1, 0), j1 = std::min(j + 1, d.nz - 1);
    return {(double(heights[d.index(i1, j)]) - double(heights[d.index(i0, j)])) / ((i1 - i0) * d.cell),
            (double(heights[d.index(i, j1)]) - double(heights[d.index(i, j0)])) / ((j1 - j0) * d.cell)};
}

// The same for the gradient that the vertices interpolate.
std::vector<double> mesher_gradient_errors(const Domain& d, const std::vector<float>& heights,
                                           const RenderMesh& mesh) {
    std::vector<double> errors(d.count(), -1.0);
    visit_triangles(d, mesh, [&](size_t sample, const size_t* corners, double u, double v) {
        const Vec2d mixed = (1.0 - u - v) * mesher_gradient(d, heights, corners[0]) +
                            u * mesher_gradient(d, heights, corners[1]) +
                            v * mesher_gradient(d, heights, corners[2]);
        errors[sample] = std::max(errors[sample], (mixed - mesher_gradient(d, heights, sample)).norm());
    });
    return errors;
}

void expect_within(const std::vector<double>& errors, double tolerance) {
    const auto [least, most] = std::minmax_element(errors.begin(), errors.end());
    EXPECT_GE(*least, 0.0); // each sample is covered
    EXPECT_LE(*most, tolerance + 1e-10);
}

RenderMesh mesher_run(const Domain& d, const std::vector<float>& heights, double metres, int threads = 2,
                      double gradient = 0.0) {
    RenderMesh mesh;
    MeshTolerance tolerance;
    tolerance.metres = metres, tolerance.gradient = gradient;
    tbb::task_arena(threads).execute([&] { mesh = mesh_terrain(d, heights.data(), tolerance); });
    return mesh;
}

TEST(TerrainMesher, HoldsTheToleranceWithoutCracksAtAnySize) {
    for (const auto& [nx, nz] :
         {std::pair{257, 257}, {2, 2}, {3, 5}, {2, 300}, {66, 2}, {100, 37}, {65, 130}}) {
        const Domain d{nx, nz};
        for (const auto& heights : {mesher_hills(d), mesher_dunes(d)})
            for (const double tolerance : {0.0, 0.05, 0.5}) {
                SCOPED_TRACE(std::to_string(nx) + " x " + std::to_string(nz) + ", " +
                             std::to_string(tolerance));
                const RenderMesh mesh = mesher_run(d, heights, tolerance);
                expect_no_cracks(d, mesh);
                expect_within(mesher_errors(d, heights, mesh), tolerance);
            }
    }
}

TEST(TerrainMesher, HoldsTheGradientAtEverySample) {
    for (const auto& [nx, nz] : {std::pair{200, 180}, {2, 2}, {3, 5}, {2, 300}, {66, 2}, {65, 130}}) {
        const Domain d{nx, nz, 0.5};
        for (const auto& heights : {mesher_hills(d), mesher_dunes(d)})
            for (const double gradient : {0.03, 0.3}) {
                SCOPED_TRACE(std::to_string(nx) + " x " + std::to_string(nz) + ", " +
                             std::to_string(gradient));
                const RenderMesh mesh = mesher_run(d, heights, 0.5, 2, gradient);
                expect_no_cracks(d, mesh);
                expect_within(mesher_errors(d, heights, mesh), 0.5);
                expect_within(mesher_gradient_errors(d, heights, mesh), gradient);
            }
    }
}

// Two planes that meet in a straight foot. With a height tolerance alone triangles cross the foot.
TEST(TerrainMesher, TheGradientKeepsTheNormalsOfAFoot) {
    const Domain d{129, 129};
    std::vector<float> heights;
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) heights.push_back(float(std::max(0.0, 0.5 * (i - 40.3 - 0.37 * j))));
    const auto worst = [&](const RenderMesh& mesh) {
        const auto errors = mesher_gradient_errors(d, heights, mesh);
        return *std::max_element(errors.begin(), errors.end());
    };
    const RenderMesh off = mesher_run(d, heights, 0.2), on = mesher_run(d, heights, 0.2, 2, 0.03);
    EXPECT_GT(worst(off), 0.2);
    EXPECT_LE(worst(on), 0.03 + 1e-10);
    EXPECT_GT(worst(on), 0.02);
    EXPECT_LT(on.triangles.size() / 3, 20U * 129); // refined along the foot, not on the planes
}

TEST(TerrainMesher, WithoutAGradientTheMeshesAreTheSame) {
    const auto digest = [](const RenderMesh& mesh) {
        uint64_t value = 1;
        for (const uint32_t v : mesh.samples) value = hash(value, v);
        for (const uint32_t v : mesh.triangles) value = hash(value, v);
        return value;
    };
    const Domain d{257, 257, 0.5, -20.0, 7.0};
    const auto heights = mesher_hills(d);
    EXPECT_EQ(digest(mesher_run(d, heights, 0.5)), 0xf533896c32f53787U);
    MeshTolerance tolerance;
    tolerance.pixels = 0.5, tolerance.pixel_angle = 1e-3;
    tolerance.cameras = {Vec3d(-30.0, 20.0, 0.0), Vec3d(100.0, 25.0, 80.0)};
    EXPECT_EQ(digest(mesh_terrain(d, heights.data(), tolerance)), 0x7238f56e595dabffU);
}

TEST(TerrainMesher, UsesTheTolerance) {
    const Domain d{257, 257};
    const auto heights = mesher_hills(d);
    const RenderMesh mesh = mesher_run(d, heights, 0.5);
    const auto errors = mesher_errors(d, heights, mesh);
    EXPECT_GT(*std::max_element(errors.begin(), errors.end()), 0.45);
    EXPECT_LT(mesh.triangles.size() / 3, size_t(2 * 256 * 256 / 4));
    EXPECT_LT(mesher_run(d, heights, 2.0).triangles.size(), mesh.triangles.size() / 2);
}

TEST(TerrainMesher, FlatAndTiltedGroundIsTwoTrianglesATile) {
    for (const double slope : {0.0, 0.25}) {
        const Domain d{257, 129};
        std::vector<float> heights;
        for (int j = 0; j < d.nz; ++j)
            for (int i = 0; i < d.nx; ++i) heights.push_back(float(1000.0 + slope * i - 0.125 * slope * j));
        for (const double gradient : {0.0, 1e-300, 0.03}) {
            const RenderMesh mesh = mesher_run(d, heights, 0.0, 2, gradient);
            EXPECT_EQ(mesh.triangles.size() / 3, 2U * 4 * 2);
            expect_no_cracks(d, mesh);
        }
    }
    const Domain small{65, 65};
    EXPECT_EQ(mesher_run(small, std::vector<float>(small.count(), 0.0F), 0.0).triangles.size(), 6U);
}

TEST(TerrainMesher, FewerThanTwoByTwoSamplesAreEmpty) {
    const std::vector<float> heights(9, 1.0F);
    for (const auto& [nx, nz] : {std::pair{0, 0}, {1, 9}, {9, 1}})
        EXPECT_TRUE(mesher_run(Domain{nx, nz}, heights, 0.1).triangles.empty());
}

TEST(TerrainMesher, SameBitsAtOneAndTwoThreads) {
    const Domain d{300, 257};
    const auto heights = mesher_hills(d);
    const RenderMesh one = mesher_run(d, heights, 0.1, 1), two = mesher_run(d, heights, 0.1, 2);
    EXPECT_EQ(one.samples, two.samples);
    EXPECT_EQ(one.triangles, two.triangles);
    const RenderMesh three = mesher_run(d, heights, 0.1, 1, 0.3), four = mesher_run(d, heights, 0.1, 2, 0.3);
    EXPECT_EQ(three.samples, four.samples);
    EXPECT_EQ(three.triangles, four.triangles);
}

TEST(TerrainMesher, CameraBoundsTheErrorInPixelsFromEachPosition) {
    const Domain d{257, 257, 0.5, -20.0, 7.0};
    const auto heights = mesher_hills(d);
    MeshTolerance tolerance;
    tolerance.pixels = 0.5, tolerance.pixel_angle = 1e-3;
    tolerance.cameras = {Vec3d(-30.0, 20.0, 0.0), Vec3d(100.0, 25.0, 80.0)};
    const RenderMesh mesh = mesh_terrain(d, heights.data(), tolerance);
    expect_no_cracks(d, mesh);
    const auto errors = mesher_errors(d, heights, mesh);
    double worst = 0.0;
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i)
            for (const Vec3d& camera : tolerance.cameras) {
                const size_t s = d.index(i, j);
                const double distance = (Vec3d(d.x(i), heights[s], d.z(j)) - camera).norm();
                worst = std::max(worst, errors[s] / (distance * tolerance.pixel_angle));
            }
    EXPECT_LE(worst, tolerance.pixels * (1.0 + 1e-9));
    EXPECT_GT(worst, 0.9 * tolerance.pixels);
    tolerance.cameras.pop_back();
    EXPECT_LT(mesh_terrain(d, heights.data(), tolerance).triangles.size(), mesh.triangles.size());
    tolerance.metres = 5.0; // a metric tolerance above all pixel tolerances
    EXPECT_EQ(mesh_terrain(d, heights.data(), tolerance).triangles, mesher_run(d, heights, 5.0).triangles);
}

TEST(TerrainMesher, TheGradientIsRelaxedWhereAPixelIsWiderThanACell) {
    const Domain d{257, 193, 0.5, -20.0, 7.0};
    const auto heights = mesher_hills(d);
    MeshTolerance tolerance;
    tolerance.pixels = 0.5, tolerance.pixel_angle = 0.02,
    tolerance.gradient = 0.3; // a pixel is as wide as a cell at 25 m
    tolerance.cameras = {Vec3d(-30.0, 20.0, 0.0), Vec3d(60.0, 25.0, 40.0)};
    const RenderMesh mesh = mesh_terrain(d, heights.data(), tolerance);
    expect_no_cracks(d, mesh);
    const auto height_errors = mesher_errors(d, heights, mesh);
    const auto errors = mesher_gradient_errors(d, heights, mesh);
    double high = 0.0, worst_near = 0.0, worst_far = 0.0; // relative to the documented bounds
    for (size_t s = 0; s < d.count(); ++s) {
        const Vec3d at(d.x(int(s) % d.nx), heights[s], d.z(int(s) / d.nx));
        double pixel = infinity;
        for (const Vec3d& camera : tolerance.cameras)
            pixel = std::min(pixel, tolerance.pixel_angle * (at - camera).norm());
        double& worst = pixel > d.cell ? worst_far : worst_near;
        worst = std::max(worst, errors[s] / (tolerance.gradient * std::max(1.0, pixel / d.cell)));
        high = std::max(high, height_errors[s] / (tolerance.pixels * pixel));
    }
    for (const double worst : {high, worst_near, worst_far}) EXPECT_LE(worst, 1.0 + 1e-9);
    for (const double worst : {worst_near, worst_far}) EXPECT_GT(worst, 0.9);
    tolerance.cameras = {Vec3d(0.0, 1e6, 0.0)}; // a pixel wider than the whole terrain
    EXPECT_EQ(mesh_terrain(d, heights.data(), tolerance).triangles.size() / 3, 2U * 4 * 3);
}

TEST(TerrainMesher, ExtremeGradientsTerminate) {
    const auto hills = mesher_hills(Domain{70, 70});
    for (const double cell : {1.0, 1e-300, 1e300, 1e-310, 0.0})
        for (const double gradient : {1e-300, 1e-5, 1e300, double(infinity), std::nan("")})
            for (const float scale : {1.0F, 1e36F, 1e-40F}) {
                const Domain d{70, 70, cell};
                auto heights = hills;
                for (float& h : heights) h *= scale;
                MeshTolerance tolerance;
                tolerance.metres = 1e38, tolerance.gradient = gradient;
                expect_no_cracks(d, mesh_terrain(d, heights.data(), tolerance));
                tolerance.pixels = tolerance.pixel_angle = 1e300;
                tolerance.cameras = {Vec3d(1e308, -1e308, 0.0), Vec3d(0.0, double(heights[0]), 0.0)};
                expect_no_cracks(d, mesh_terrain(d, heights.data(), tolerance));
                tolerance.pixels = tolerance.pixel_angle = 1e-300;
                expect_no_cracks(d, mesh_terrain(d, heights.data(), tolerance));
            }
    const Domain d{70, 70};
    EXPECT_GT(mesher_run(d, hills, 1e9, 2, 1e-300).triangles.size() / 3, 9000U); // each sample is a vertex
    EXPECT_EQ(mesher_run(d, hills, 1e9, 2, 1e300).triangles.size() / 3, 2U * 4);
}

TEST(TerrainMesher, ExtremeParametersTerminate) {
    const Domain d{70, 70};
    auto heights = mesher_hills(d);
    MeshTolerance tolerance;
    tolerance.pixels = 1e300, tolerance.pixel_angle = 1e300;
    tolerance.cameras = {Vec3d(1e308, -1e308, 0.0), Vec3d(0.0, double(heights[0]), 0.0)};
    expect_no_cracks(d, mesh_terrain(d, heights.data(), tolerance));
    tolerance.pixels = tolerance.pixel_angle = 1e-300;
    expect_no_cracks(d, mesh_terrain(d, heights.data(), tolerance));
    for (float& h : heights) h *= 1e36F;
    const RenderMesh mesh = mesher_run(d, heights, 0.0);
    expect_no_cracks(d, mesh);
    expect_no_cracks(d, mesher_run(d, heights, -1.0));
    EXPECT_GT(mesh.triangles.size() / 3, 8000U);
}

TEST(TerrainMesher, PrintsTrianglesAndTime) {
    const Domain d{2048, 2048}, part{512, 512};
    const auto dunes = mesher_dunes(part);
    std::vector<float> heights;
    const auto mirrored = [](int i) { return i % 1024 < 512 ? i % 512 : 511 - i % 512; };
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) heights.push_back(dunes[part.index(mirrored(i), mirrored(j))]);
    MeshTolerance metres, pixels;
    metres.metres = 0.01;
    pixels.pixels = 0.5, pixels.pixel_angle = 0.6 / 1080.0, pixels.cameras = {Vec3d(1024.0, 20.0, -10.0)};
    const auto timed = [&](const char* name, MeshTolerance tolerance, double gradient, int threads) {
        tolerance.gradient = gradient;
        RenderMesh mesh;
        const auto start = std::chrono::steady_clock::now();
        tbb::task_arena(threads).execute([&] { mesh = mesh_terrain(d, heights.data(), tolerance); });
        const double seconds =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        std::printf("dunes 2048 x 2048, %s, gradient %.2f: %zu triangles, %d threads, %.1f ns a sample\n",
                    name, gradient, mesh.triangles.size() / 3, threads, 1e9 * seconds / double(d.count()));
        EXPECT_LT(mesh.triangles.size() / 3, d.count() / 4);
    };
    for (const int threads : {1, 2})
        for (const double gradient : {0.0, 0.03}) {
            timed("0.01 m", metres, gradient, threads);
            timed("half a pixel", pixels, gradient, threads);
        }
}

} // namespace
} // namespace marram
