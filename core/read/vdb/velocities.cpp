// SPDX-License-Identifier: Apache-2.0
// Velocities of OpenVDB grids. The child process (child_process.h) chooses the grid and sends all samples of
// the box of its active voxels, row by row; this one checks them.
#include "core/read/vdb/velocities.h"

#include "core/read/vdb/child_process.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

namespace marram {
namespace {

using openvdb::FloatGrid;
using openvdb::Vec3DGrid;
using openvdb::Vec3SGrid;

// What the child process sends before the samples.
struct VelocityHeader {
    double matrix[16]; // from voxels to metres, row vectors
    int32_t least[3];  // coordinates of the first voxel
    uint32_t counts[3];
    uint32_t staggered;
};

// A vector grid, or three grids of floats.
struct Source {
    std::string name;
    openvdb::GridBase::Ptr vectors;
    FloatGrid::Ptr parts[3];
};

// ---- The child process ----

bool is_vectors(const openvdb::GridBase& grid) {
    return grid.isType<Vec3SGrid>() || grid.isType<Vec3DGrid>();
}

std::vector<Source> sources_of(const openvdb::GridPtrVec& grids) {
    std::vector<Source> sources;
    for (const openvdb::GridBase::Ptr& grid : grids) {
        const std::string name = grid->getName();
        if (is_vectors(*grid)) sources.push_back({name, grid, {}});
        if (!grid->isType<FloatGrid>() || !name.ends_with(".x")) continue;
        Source source{name.substr(0, name.size() - 2), {}, {openvdb::gridPtrCast<FloatGrid>(grid), {}, {}}};
        for (const openvdb::GridBase::Ptr& other : grids)
            for (int axis = 1; axis < 3; ++axis)
                if (other->isType<FloatGrid>() && other->getName() == source.name + (axis == 1 ? ".y" : ".z"))
                    source.parts[axis] = openvdb::gridPtrCast<FloatGrid>(other);
        if (source.parts[1] && source.parts[2]) sources.push_back(std::move(source));
    }
    return sources;
}

std::string names_of(const std::vector<Source>& sources) {
    std::string names;
    for (const Source& source : sources)
        names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", source.name);
    return names;
}

Source chosen_source(const openvdb::GridPtrVec& grids, const std::string& name) {
    std::vector<Source> sources = sources_of(grids);
    if (sources.empty()) {
        std::string others;
        for (const openvdb::GridBase::Ptr& grid : grids)
            others += (others.empty() ? "" : ", ") + description_of(*grid);
        throw Refusal{others.empty() ? "holds no grids" : "holds no velocities, but " + others,
                      "write a grid of 3D vectors, or three grids of floats vel.x, vel.y and vel.z"};
    }
    const auto choose = [&](auto fits) -> std::optional<Source> {
        if (std::ranges::count_if(sources, fits) != 1) return {};
        return *std::ranges::find_if(sources, fits);
    };
    if (!name.empty()) {
        if (auto named = choose([&](const Source& s) { return s.name == name; })) return *named;
        throw Refusal{fmt::format("does not hold one vector grid \"{}\", but {}", name, names_of(sources)),
                      "name one of these"};
    }
    if (sources.size() == 1) return sources.front();
    const auto usual = [](const Source& s) {
        return s.name == "v" || s.name == "vel" || s.name == "velocity";
    };
    if (auto named = choose(usual)) return *named;
    throw Refusal{fmt::format("holds several vector grids, {}", names_of(sources)),
                  "name one: { file = \"...\", grid = \"vel\" }"};
}

openvdb::Mat4R matrix_of(const openvdb::GridBase& grid) {
    if (!grid.transform().isLinear()) throw Refusal{"has a transform that is not linear", "resample it"};
    return grid.transform().baseMap()->getAffineMap()->getMat4();
}

// Where the first sample of part `axis` is from that of part 0, in voxels of that part.
openvdb::Vec3R offset_of(const openvdb::Mat4R& first, const openvdb::Mat4R& other) {
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            if (!(std::abs(first(row, column) - other(row, column)) <=
                  1e-6 * std::abs(first(row, row)) + 1e-9 * std::abs(first(row, column))))
                return openvdb::Vec3R(1e9);
    return first.inverse().transform(openvdb::Vec3R(other(3, 0), other(3, 1), other(3, 2)));
}

// Sets matrix and `staggered`. Three grids have one transform, or each is half a voxel down its own axis from
// one.
void place(const Source& source, VelocityHeader& header) {
    openvdb::Mat4R matrix = matrix_of(source.vectors ? *source.vectors : *source.parts[0]);
    header.staggered = source.vectors && source.vectors->getGridClass() == openvdb::GRID_STAGGERED;
    if (!source.vectors) {
        const openvdb::Vec3R y = offset_of(matrix, matrix_of(*source.parts[1])),
                             z = offset_of(matrix, matrix_of(*source.parts[2]));
        constexpr double slack = 1e-3; // voxels
        const auto is = [](const openvdb::Vec3R& offset, double a, double b, double c) {
            return (offset - openvdb::Vec3R(a, b, c)).length() < slack;
        };
        header.staggered = is(y, 0.5, -0.5, 0.0) && is(z, 0.5, 0.0, -0.5);
        if (!header.staggered && !(is(y, 0, 0, 0) && is(z, 0, 0, 0)))
            throw Refusal{
                fmt::format("has grids \"{0}.x\", \"{0}.y\" and \"{0}.z\" that are neither in the same place "
                            "nor on the faces of the same voxels",
                            source.name),
                "merge them into one vector grid"};
        if (header.staggered) matrix.preTranslate(openvdb::Vec3R(0.5, 0.0, 0.0));
    }
    std::copy_n(matrix.asPointer(), 16, header.matrix);
}

void bound(const Source& source, VelocityHeader& header) {
    openvdb::CoordBBox box;
    if (source.vectors) box = source.vectors->evalActiveVoxelBoundingBox();
    for (const FloatGrid::Ptr& part : source.parts)
        if (part && !part->tree().empty()) box.expand(part->evalActiveVoxelBoundingBox());
    if (box.empty())
        throw Refusal{fmt::format("has no active voxels in \"{}\"", source.name), "write it again"};
    double samples = 1.0;
    int64_t counts[3];
    for (int axis = 0; axis < 3; ++axis) {
        counts[axis] = int64_t(box.max()[axis]) - int64_t(box.min()[axis]) + 1;
        samples *= double(counts[axis]);
        header.least[axis] = box.min()[axis];
        header.counts[axis] = uint32_t(counts[axis]);
    }
    if (!(samples <= double(max_velocity_samples)))
        throw Refusal{fmt::format("covers {} x {} x {} voxels, {:.3g} GB; the limit is {} voxels, {:.3g} GB",
                                  counts[0], counts[1], counts[2], 12e-9 * samples, max_velocity_samples,
                                  12e-9 * double(max_velocity_samples)),
                      "resample it with larger voxels, or crop it"};
}

// get(voxel): its velocity.
void send_rows(int pipe, const VelocityHeader& header, auto get) {
    std::vector<float> row(3 * size_t(header.counts[0]));
    for (uint32_t k = 0; k < header.counts[2]; ++k)
        for (uint32_t j = 0; j < header.counts[1]; ++j) {
            for (uint32_t i = 0; i < header.counts[0]; ++i) {
                const openvdb::Vec3d v =
                    get(openvdb::Coord(header.least[0] + int32_t(i), header.least[1] + int32_t(j),
                                       header.least[2] + int32_t(k)));
                for (int axis = 0; axis < 3; ++axis) row[3 * size_t(i) + size_t(axis)] = float(v[axis]);
            }
            write_all(pipe, row.data(), row.size() * sizeof(float));
        }
}

void send_velocities(int pipe, std::string& bytes, const std::string& name) {
    const openvdb::GridPtrVecPtr grids = grids_of(bytes);
    const Source source = chosen_source(*grids, name);
    VelocityHeader header{};
    place(source, header);
    bound(source, header);
    begin_sending(pipe);
    write_all(pipe, &header, sizeof header);
    if (source.vectors && source.vectors->isType<Vec3SGrid>()) {
        auto values = openvdb::gridPtrCast<Vec3SGrid>(source.vectors)->getConstAccessor();
        send_rows(pipe, header,
                  [&](const openvdb::Coord& at) { return openvdb::Vec3d(values.getValue(at)); });
    } else if (source.vectors) {
        auto values = openvdb::gridPtrCast<Vec3DGrid>(source.vectors)->getConstAccessor();
        send_rows(pipe, header, [&](const openvdb::Coord& at) { return values.getValue(at); });
    } else {
        FloatGrid::ConstAccessor parts[3] = {source.parts[0]->getConstAccessor(),
                                             source.parts[1]->getConstAccessor(),
                                             source.parts[2]->getConstAccessor()};
        send_rows(pipe, header, [&](const openvdb::Coord& at) {
            return openvdb::Vec3d(parts[0].getValue(at), parts[1].getValue(at), parts[2].getValue(at));
        });
    }
}

// ---- The parent ----

VelocityGrid receive_velocities(int pipe) {
    VelocityHeader header;
    read_all(pipe, &header, sizeof header);
    const auto at = [&](int row, int column) { return header.matrix[4 * row + column]; };
    VelocityGrid grid;
    grid.staggered = header.staggered != 0;
    double samples = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        grid.counts[size_t(axis)] = header.counts[axis];
        samples *= double(header.counts[axis]);
        grid.axes.col(axis) = Vec3d(at(axis, 0), at(axis, 1), at(axis, 2));
    }
    if (!(samples >= 1.0) || !(samples <= double(max_velocity_samples))) throw damaged_file;
    grid.origin = Vec3d(at(3, 0), at(3, 1), at(3, 2));
    for (int axis = 0; axis < 3; ++axis) grid.origin += double(header.least[axis]) * grid.axes.col(axis);
    constexpr double farthest = 1e18; // m, as of meshes
    if (!(grid.axes.cwiseAbs().maxCoeff() <= farthest) || !(grid.origin.cwiseAbs().maxCoeff() <= farthest) ||
        !grid.axes.inverse().allFinite())
        throw Refusal{"has a transform that is not usable", "check its voxel size and its place"};
    grid.values.resize(3 * size_t(samples));
    read_all(pipe, grid.values.data(), grid.values.size() * sizeof(float));
    for (size_t k = 0; k < grid.values.size(); ++k)
        if (!(std::abs(double(grid.values[k])) <= max_velocity)) {
            const size_t sample = k / 3, nx = header.counts[0], ny = header.counts[1];
            throw Refusal{fmt::format("has the velocity {:g} m/s in voxel ({}, {}, {})", grid.values[k],
                                      int64_t(sample % nx) + header.least[0],
                                      int64_t(sample / nx % ny) + header.least[1],
                                      int64_t(sample / nx / ny) + header.least[2]),
                          fmt::format("write finite velocities below {:g} m/s", max_velocity)};
        }
    return grid;
}

} // namespace

VelocityGrid read_velocity_grid(const std::string& path, const std::string& name, std::string& bytes) {
    VelocityGrid grid;
    read_in_child_process(
        path, bytes, [&](int pipe, std::string& given) { send_velocities(pipe, given, name); },
        [&](int pipe) { grid = receive_velocities(pipe); });
    return grid;
}

} // namespace marram
