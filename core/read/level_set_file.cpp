// SPDX-License-Identifier: Apache-2.0
#include "core/read/level_set_file.h"
#include "core/image/atomic_file.h"
#include "core/math/own_library.h"
#include "core/read/mesh_reader.h"
#include "core/read/vdb/load_library.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace marram {
namespace {

constexpr double max_voxel_over_extent = 0.01; // of the largest side of a mesh: voxels are not larger
constexpr double max_voxels_away = 0x1p17;     // from the origin, where floats resolve 0.8 % of a voxel
constexpr double min_voxel = 2e-5;             // m; OpenVDB takes a volume below 3e-15 m^3 for none

// The edge of a square that is as large as two triangles on average.
double choose_voxel(std::span<const Vec3f> positions, std::span<const std::array<uint32_t, 3>> triangles) {
    double area = 0.0;
    Eigen::AlignedBox3d box;
    for (const auto& t : triangles) {
        const Vec3d a = positions[t[0]].cast<double>(), b = positions[t[1]].cast<double>(),
                    c = positions[t[2]].cast<double>();
        area += 0.5 * (b - a).cross(c - a).norm();
        box.extend(a).extend(b).extend(c);
    }
    return std::min(std::sqrt(2.0 * area / double(triangles.size())),
                    max_voxel_over_extent * box.sizes().maxCoeff());
}

} // namespace

const LevelSetLibrary& level_set_library(const std::string& path) {
    try {
        static const auto& loaded = load_own_library<LevelSetLibrary>(
            "libmarram_level_set.so", "marram_level_set_library", MARRAM_VERSION);
        return loaded;
    } catch (const std::runtime_error& error) {
        throw InputError({path},
                         std::string("the library that reads and writes .vdb files cannot be loaded (") +
                             error.what() + ")",
                         "build it with scenes/setup marram_level_set, or install Marram again");
    }
}

Mesh read_vdb(const std::string& path, std::string& bytes) {
    return level_set_library(path).read(path, bytes);
}

bool is_closed(const MeshGeometry& mesh) {
    const std::vector<uint32_t> first = weld(mesh.positions.at(0));
    std::vector<std::pair<uint64_t, int>> edges; // smaller and larger end; direction
    edges.reserve(3 * mesh.triangles.size());
    for (const auto& t : mesh.triangles)
        for (size_t k = 0; k < 3; ++k) {
            const uint64_t a = first[t[k]], b = first[t[(k + 1) % 3]];
            if (a != b) edges.emplace_back(std::min(a, b) << 32 | std::max(a, b), a < b ? 1 : -1);
        }
    std::sort(edges.begin(), edges.end());
    for (size_t i = 0; i < edges.size();) {
        int sum = 0;
        const uint64_t edge = edges[i].first;
        for (; i < edges.size() && edges[i].first == edge; ++i) sum += edges[i].second;
        if (sum != 0) return false;
    }
    return !edges.empty();
}

void write_level_set(const std::string& path, const MeshGeometry& mesh) {
    const std::vector<Vec3f>& positions = mesh.positions.at(0);
    if (!is_closed(mesh))
        throw InputError({path}, fmt::format("'{}' is no closed surface, and has no inside", mesh.name),
                         "bake it to .ply or .obj");
    const double voxel = choose_voxel(positions, mesh.triangles);
    double farthest = 0.0;
    for (const Vec3f& p : positions) farthest = std::max(farthest, double(p.cwiseAbs().maxCoeff()));
    if (!(voxel >= min_voxel))
        throw InputError(
            {path},
            fmt::format("'{}' needs voxels of {:g} m, the least is {:g} m", mesh.name, voxel, min_voxel),
            "scale the scene up");
    if (!(farthest <= max_voxels_away * voxel))
        throw InputError({path},
                         fmt::format("'{}' is {:g} m from the origin, {:.2g} voxels", mesh.name, farthest,
                                     farthest / voxel),
                         "move it to within 131072 voxels of the origin");
    const std::string bytes = level_set_library(path).bytes(path, mesh, voxel);
    AtomicFile file(path);
    file.write(bytes);
    file.commit();
}

} // namespace marram
