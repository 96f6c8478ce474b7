// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/grid_export.h"

#include "core/image/image.h"

namespace marram {
namespace {

bool is_flat(const GridValues& grid) { return grid.grid.nz == 1 && grid.grid.components == 1; }

bool alike(const GridValues& a, const GridValues& b) {
    return is_flat(b) && a.grid.nx == b.grid.nx && a.grid.ny == b.grid.ny;
}

double length(const double* axis) { return Vec3d(axis).norm(); }

} // namespace

void write_grids(const std::string& path, const MeshGeometry& mesh) {
    if (mesh.grids.empty() || !is_flat(mesh.grids[0]))
        throw InputError({path}, "'" + mesh.name + "' hands out no grid of heights",
                         "bake a procedural that does, such as a terrain");
    const GridValues& first = mesh.grids[0];
    const MarramGrid& grid = first.grid;
    std::vector<Layer> layers = {{"", {"Y"}, first.values.data(), false}};
    for (const GridValues& other : mesh.grids)
        if (alike(first, other)) layers.push_back({"grid", {other.name}, other.values.data(), false});
    const double cell = length(grid.axes[0]), rows = length(grid.axes[1]);
    const Metadata metadata[] = {{"marram:grid", mesh.name},
                                 {"marram:cell", cell},
                                 {"marram:center_x", grid.origin[0] + 0.5 * cell * (grid.nx - 1)},
                                 {"marram:center_z", grid.origin[2] + 0.5 * rows * (grid.ny - 1)},
                                 {"marram:size_x", cell * grid.nx},
                                 {"marram:size_z", rows * grid.ny}};
    write_exr(path, int(grid.nx), int(grid.ny), layers, metadata);
}

} // namespace marram
