// SPDX-License-Identifier: Apache-2.0
// Small meshes for groom tests.
#pragma once

#include "procedural/strands/surface.h"

#include <vector>

namespace marram {

struct TestSurface {
    std::vector<float> positions, normals, uvs;
    std::vector<uint32_t> triangles;

    Surface surface() const {
        return {positions.data(), normals.empty() ? nullptr : normals.data(), triangles.data(),
                uvs.empty() ? nullptr : uvs.data(), uint32_t(triangles.size() / 3)};
    }
};

// n * n squares over [0, size]^2 in the xz plane; normals point up.
inline TestSurface grid_surface(int n, double size) {
    TestSurface mesh;
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
            mesh.positions.insert(mesh.positions.end(), {float(size * i / n), 0.0F, float(size * j / n)});
            mesh.uvs.insert(mesh.uvs.end(), {float(i) / float(n), float(j) / float(n)});
        }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const auto a = uint32_t(j * (n + 1) + i), b = a + 1, c = a + uint32_t(n) + 1, d = c + 1;
            mesh.triangles.insert(mesh.triangles.end(), {a, c, b, b, c, d});
        }
    return mesh;
}

// A smooth unit sphere, tessellated by longitude and latitude.
inline TestSurface sphere_surface(int n) {
    TestSurface mesh;
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= 2 * n; ++i) {
            const double theta = pi * j / n, phi = pi * i / n;
            const float p[3] = {float(std::sin(theta) * std::cos(phi)), float(std::cos(theta)),
                                float(-std::sin(theta) * std::sin(phi))};
            mesh.positions.insert(mesh.positions.end(), p, p + 3);
            mesh.normals.insert(mesh.normals.end(), p, p + 3);
            mesh.uvs.insert(mesh.uvs.end(), {float(i) / float(2 * n), 1.0F - float(j) / float(n)});
        }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < 2 * n; ++i) {
            const auto a = uint32_t(j * (2 * n + 1) + i), b = a + 1, c = a + uint32_t(2 * n) + 1, d = c + 1;
            mesh.triangles.insert(mesh.triangles.end(), {a, c, b, b, c, d});
        }
    return mesh;
}

} // namespace marram
