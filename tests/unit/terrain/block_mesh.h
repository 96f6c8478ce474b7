// SPDX-License-Identifier: Apache-2.0
// A mesh of boxes and slanted walls, for tests of what stands in the sand.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace marram {

// Boxes and slanted walls, rotated about the y axis through the origin.
struct BlockMesh {
    std::vector<float> positions;
    std::vector<uint32_t> triangles;
    double turn = 0.0;

    void corner(double x, double y, double z) {
        const double c = std::cos(turn), s = std::sin(turn);
        for (const double v : {c * x - s * z, y, s * x + c * z}) positions.push_back(float(v));
    }
    // `run`: horizontal distance from the foot to the top of the face at the lower x.
    void box(double x0, double x1, double y0, double y1, double z0, double z1, double run = 0.0) {
        const auto first = uint32_t(positions.size() / 3);
        for (const double y : {y0, y1})
            for (const double z : {z0, z1})
                for (const double x : {x0, x1}) corner(x == x0 && y == y1 ? x0 + run : x, y, z);
        for (const auto& f :
             {std::array{0U, 1U, 3U, 2U}, std::array{4U, 6U, 7U, 5U}, std::array{0U, 4U, 5U, 1U},
              std::array{2U, 3U, 7U, 6U}, std::array{0U, 2U, 6U, 4U}, std::array{1U, 5U, 7U, 3U}})
            for (const unsigned k : {0U, 1U, 2U, 0U, 2U, 3U}) triangles.push_back(first + f[k]);
    }
    // A vertical sheet without thickness, from (x0, z0) to (x1, z1).
    void sheet(double x0, double z0, double x1, double z1, double y0, double y1) {
        const auto first = uint32_t(positions.size() / 3);
        for (const double y : {y0, y1}) corner(x0, y, z0), corner(x1, y, z1);
        for (const unsigned k : {0U, 1U, 2U, 1U, 3U, 2U}) triangles.push_back(first + k);
    }
    // Valid until the next change.
    MarramMesh mesh() const {
        sample = positions.data();
        MarramMesh mesh{};
        mesh.name = "blocks";
        mesh.vertex_count = uint32_t(positions.size() / 3);
        mesh.triangle_count = uint32_t(triangles.size() / 3);
        mesh.time_count = 1;
        mesh.positions = &sample;
        mesh.triangles = triangles.data();
        return mesh;
    }
    mutable const float* sample = nullptr;
};

} // namespace marram
