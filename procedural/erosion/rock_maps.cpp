// SPDX-License-Identifier: Apache-2.0
// Images by uv of a rock's wear. The head of rock.cpp documents them.
#include "core/math/vec.h"
#include "procedural/abi/border.h"
#include "procedural/erosion/rock_instance.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace marram {
namespace {

constexpr double inner = 1e-6;        // barycentric: nearer to an edge, a pixel may also be in the neighbour
constexpr double min_reported = 0.01; // of the surface, or of the map

struct UvMap {
    std::vector<float> pixels;
    size_t known = 0, shared = 0; // pixels in a triangle; of those in several
};

// Bakes a vertex attribute, 0 or more, to an image by uv.
UvMap uv_map(const RockInstance& instance, const std::vector<float>& values, int size) {
    UvMap result{std::vector<float>(size_t(size) * size_t(size), 0.0F)};
    std::vector<float>& map = result.pixels;
    std::vector<char> known(map.size(), 0); // 1: on the edge of a triangle, 2: inside one, 3: inside several
    for (size_t f = 0; f + 2 < instance.triangles.size(); f += 3) {
        std::array<Vec2d, 3> p;
        std::array<double, 3> value;
        for (size_t k = 0; k < 3; ++k) {
            const size_t v = instance.triangles[f + k];
            p[k] = Vec2d(instance.uvs[2 * v] * size - 0.5, (1.0 - instance.uvs[2 * v + 1]) * size - 0.5);
            value[k] = values[v];
        }
        const Vec2d a = p[1] - p[0], b = p[2] - p[0];
        const double area = a.x() * b.y() - a.y() * b.x();
        if (!(std::abs(area) > 0.0) || !(std::abs(area) < infinity)) continue;
        const Vec2d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
        const int j0 = int(std::ceil(std::clamp(low.y(), 0.0, double(size)))),
                  j1 = int(std::floor(std::clamp(high.y(), -1.0, size - 1.0)));
        const int i0 = int(std::ceil(std::clamp(low.x(), 0.0, double(size)))),
                  i1 = int(std::floor(std::clamp(high.x(), -1.0, size - 1.0)));
        for (int j = j0; j <= j1; ++j)
            for (int i = i0; i <= i1; ++i) {
                const Vec2d q = Vec2d(i, j) - p[0];
                const double u = (q.x() * b.y() - q.y() * b.x()) / area,
                             v = (a.x() * q.y() - a.y() * q.x()) / area;
                if (u < -1e-9 || v < -1e-9 || u + v > 1.0 + 1e-9) continue;
                const size_t at = size_t(j) * size_t(size) + size_t(i);
                const auto here = float((1.0 - u - v) * value[0] + u * value[1] + v * value[2]);
                map[at] = std::max(map[at], here);
                const bool inside = u > inner && v > inner && u + v < 1.0 - inner;
                known[at] = std::max(known[at], char(!inside ? 1 : known[at] >= 2 ? 3 : 2));
            }
    }
    result.known = map.size() - size_t(std::ranges::count(known, 0));
    result.shared = size_t(std::ranges::count(known, 3));
    for (int round = 0; round < 2; ++round) { // dilate the islands
        const std::vector<char> before = known;
        for (int j = 0; j < size; ++j)
            for (int i = 0; i < size; ++i) {
                const size_t at = size_t(j) * size_t(size) + size_t(i);
                if (before[at]) continue;
                float sum = 0.0F;
                int count = 0;
                for (const auto& [x, y] : {std::pair(i - 1, j), {i + 1, j}, {i, j - 1}, {i, j + 1}}) {
                    if (x < 0 || y < 0 || x >= size || y >= size) continue;
                    const size_t beside = size_t(y) * size_t(size) + size_t(x);
                    if (before[beside]) sum += map[beside], ++count;
                }
                if (count > 0) map[at] = sum / float(count), known[at] = 1;
            }
    }
    return result;
}

// Of the surface: the share whose uvs are outside 0 to 1, or have no area.
double share_off_map(const RockInstance& instance) {
    double off = 0.0, all = 0.0;
    for (size_t f = 0; f + 2 < instance.triangles.size(); f += 3) {
        std::array<Vec3d, 3> p;
        std::array<Vec2d, 3> uv;
        for (size_t k = 0; k < 3; ++k) {
            const size_t v = instance.triangles[f + k];
            p[k] = {instance.positions[3 * v], instance.positions[3 * v + 1], instance.positions[3 * v + 2]};
            uv[k] = {instance.uvs[2 * v], instance.uvs[2 * v + 1]};
        }
        const double area = (p[1] - p[0]).cross(p[2] - p[0]).norm();
        const Vec2d a = uv[1] - uv[0], b = uv[2] - uv[0], middle = (uv[0] + uv[1] + uv[2]) / 3.0;
        all += area;
        const bool on =
            middle.minCoeff() >= 0.0 && middle.maxCoeff() <= 1.0 && a.x() * b.y() != a.y() * b.x();
        if (!on) off += area;
    }
    return all > 0.0 ? off / all : 0.0;
}

void send_map_warnings(const RockInstance& instance, const Values& values, const UvMap& map) {
    const std::string& place = values.at("map").place;
    if (const double off = share_off_map(instance); off > min_reported)
        send(instance.host, MARRAM_WARNING, "rock.off_map", place,
             fmt::format(
                 "{:.0f} % of the surface is not on the map: its uvs are outside 0 to 1, or cover no area",
                 100.0 * off),
             "give the mesh uvs within 0 to 1");
    if (const double shared = double(map.shared) / double(std::max<size_t>(map.known, 1));
        shared > min_reported)
        send(instance.host, MARRAM_WARNING, "rock.uvs_overlap", place,
             fmt::format("{:.0f} % of the map lies in several triangles: the greatest value is kept",
                         100.0 * shared),
             "give the mesh uvs that do not overlap");
}

} // namespace

void make_rock_maps(RockInstance& instance, const Values& values) {
    const int size = values.integer("map");
    if (size > 0 && instance.uvs.empty())
        throw SceneFault("rock.no_uvs", values.at("map").place,
                         fmt::format("the mesh '{}' has no uvs to make a map by", values.text("mesh")),
                         "give the mesh uvs, or leave out map");
    for (size_t k = 0; k < 2; ++k) {
        instance.maps[k].clear();
        if (size > 0) {
            UvMap map = uv_map(instance, k == 0 ? instance.wear : instance.rate, size);
            if (k == 0) send_map_warnings(instance, values, map);
            instance.maps[k] = std::move(map.pixels);
        }
        MarramGrid& grid = instance.grids[k] = {};
        grid.name = rock_attributes[k].name;
        grid.nx = grid.ny = uint32_t(std::max(size, 1));
        grid.nz = grid.components = 1;
        const double pixel = 1.0 / std::max(size, 1);
        grid.origin[0] = 0.5 * pixel, grid.origin[1] = 1.0 - 0.5 * pixel;
        grid.axes[0][0] = pixel, grid.axes[1][1] = -pixel, grid.axes[2][2] = 1.0;
        grid.values = instance.maps[k].data();
    }
}

} // namespace marram
