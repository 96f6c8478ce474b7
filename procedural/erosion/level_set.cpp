// SPDX-License-Identifier: Apache-2.0
// Rock as a level set. Signed distance phi (metres, negative in rock) on a sparse grid of cubic voxels of
// edge h, stored by OpenVDB in a narrow band of 3 h on both sides of the surface. Of the plug-in, only this
// file and its headers level_set_*.h include OpenVDB.
//
// Mesh. One vertex in each cell of eight voxels that the surface crosses, and one quad around each edge whose
// ends have opposite signs (surface nets: S. Gibson, "Constrained Elastic Surface Nets", MICCAI 1998). A
// vertex starts at the mean of the crossings of its cell's edges and is moved onto the surface by two Newton
// steps along the gradient, at least 0.02 h inside its cell, so that no triangle collapses: up to 0.035 h off
// the surface, 0.004 h rms (build/rock_erosion mesh). A sphere of radius R is within h^2 / (8 R) besides.
// Normals are the gradient by central differences. OpenVDB's volumeToMesh takes as long and lies closer, but
// wear needs the vertex of each cell, and the same bits at any thread count.
//
// Wear. d(x) >= 0 is the depth in metres along the normal, given at the vertices, at most h per pass. A voxel
// of the band takes d from its closest point on the surface, p = x - phi grad(phi): a mean of the vertices
// within 2 h of p, weighted by (1 - r^2 / 4 h^2)^2 and by the agreement of their normals. Then phi += d. As d
// is constant along normals, |grad phi| deviates from 1 only by the slope of d along the surface:
//     |grad (phi + d)|^2 = 1 + |grad_s d|^2.
// Each pass makes the values distances again (level_set_distances.h).
//
// Rock is never added: a voxel beside the surface never falls below its value before the pass. So along every
// grid edge the crossing moves inward or stays.
//
// Error: see build/rock_erosion (tests/bench). A sphere worn at constant speed: order 1 to 2 in h. A plane at
// any angle to the grid wears uniformly within 0.02 h per voxel of depth. Ridges thinner than h vanish.
//
// Determinism: each leaf (8 x 8 x 8 voxels) is processed into its own memory, and results are concatenated in
// leaf order. So results are bitwise the same for any number of threads.
//
// Cost on one core: 0.4 us per voxel of the band and pass, 0.6 us per vertex for the mesh. A ball in a grid
// of 512^3 with 3 10^6 voxels and 750,000 vertices takes 1.2 s and 0.4 s (half of it on two cores), and 7 s
// to build from a mesh. Memory: 26 bytes per voxel, three times that during wear.
#include "procedural/erosion/level_set.h"

#include "procedural/erosion/level_set_distances.h"

#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/Morphology.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/SignedFloodFill.h>
// These are instantiated in OpenVDB's library: not doing so here saves a third of the compile time of this
// file. Without optimisation small members are not inlined, and the library does not export them.
#if defined(__OPTIMIZE__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
extern template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::Int32Tree::RootNodeType>;
extern template class openvdb::Grid<openvdb::FloatTree>;
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace marram {
namespace {

// The narrow band around a checked mesh, in voxels.
FloatGrid::Ptr band_around(std::span<const float> positions, std::span<const uint32_t> triangles,
                           double voxel, float width) {
    std::vector<openvdb::Vec3s> points(positions.size() / 3);
    std::vector<openvdb::Vec3I> faces(triangles.size() / 3);
    for (size_t v = 0; v < points.size(); ++v)
        for (size_t axis = 0; axis < 3; ++axis)
            points[v][int(axis)] = float(double(positions[3 * v + axis]) / voxel);
    for (size_t t = 0; t < faces.size(); ++t)
        for (size_t c = 0; c < 3; ++c) faces[t][int(c)] = triangles[3 * t + c];
    // The library has this adapter precompiled; any other would be compiled here.
    const openvdb::tools::QuadAndTriangleDataAdapter<openvdb::Vec3s, openvdb::Vec3I> mesh(points, faces);
    const auto identity = openvdb::math::Transform::createLinearTransform(1.0);
    return openvdb::tools::meshToVolume<FloatGrid>(mesh, *identity, width, width);
}

// Vertex data for the lookup by voxels: position in its cell, normal, and wear; in voxels.
struct WornVertex {
    Float3 place, normal;
    float depth;
};

// Which cells of a leaf and its neighbours have a vertex: bit k + 8 of row (i, j), i, j, k from -8 to 15.
struct CellRows {
    static constexpr int side = 3 * leaf_side;
    std::array<uint32_t, size_t(side) * side> rows;

    uint32_t& row(int i, int j) { return rows[size_t((i + leaf_side) * side + j + leaf_side)]; }
    uint32_t row(int i, int j) const { return rows[size_t((i + leaf_side) * side + j + leaf_side)]; }

    void find(const Neighbourhood<Int32Tree>& cells) {
        rows.fill(0);
        for (size_t n = 0; n < cells.leaf.size(); ++n) {
            if (!cells.leaf[n]) continue;
            const int32_t* id = cells.leaf[n];
            const int i0 = (int(n) / 9 - 1) * leaf_side, j0 = (int(n) / 3 % 3 - 1) * leaf_side;
            for (int i = i0; i < i0 + leaf_side; ++i)
                for (int j = j0; j < j0 + leaf_side; ++j, id += leaf_side) {
                    uint32_t bits = 0;
                    for (int k = 0; k < leaf_side; ++k) bits |= uint32_t(id[k] >= 0) << k;
                    row(i, j) |= bits << (n % 3 * leaf_side);
                }
        }
    }
};

// Wear at the surface point `place` (in voxels from a leaf's first voxel): weighted mean of the vertices
// around it.
float interpolate_wear(std::span<const WornVertex> vertices, const Neighbourhood<Int32Tree>& cells,
                       const CellRows& rows, const Float3& place, const Float3& normal) {
    const auto cell = [](float x) { return std::clamp(int(std::floor(x)), -6, 13); };
    const int i = cell(place.x), j = cell(place.y), k = cell(place.z);
    for (const int reach : {1, 2}) {
        float sum = 0.0F, weights = 0.0F;
        const uint32_t window = ((2U << (2 * reach)) - 1U) << (k - reach + leaf_side);
        for (int a = i - reach; a <= i + reach; ++a)
            for (int b = j - reach; b <= j + reach; ++b)
                for (uint32_t left = rows.row(a, b) & window; left != 0; left &= left - 1) {
                    const int c = std::countr_zero(left) - leaf_side;
                    const WornVertex& vertex = vertices[size_t(cells.at(a, b, c))];
                    const Float3 away = Float3{float(a), float(b), float(c)} + vertex.place - place;
                    const float near = std::max(1.0F - away.dot(away) * 0.25F, 1e-4F); // radius: 2 voxels
                    const float agree = std::max(normal.dot(vertex.normal), 0.02F);
                    const float w = near * near * agree;
                    sum += w * vertex.depth;
                    weights += w;
                }
        if (weights > 0.0F) return sum / weights;
    }
    return 0.0F;
}

// Midpoint interpolation by the cubic through four voxels.
float midpoint_cubic(float a, float b, float c, float d) { return (9.0F * (b + c) - (a + d)) * 0.0625F; }

// Values of the eight leaves at half the voxel size that cover a leaf: 16 x 16 x 16, minus `offset` (in fine
// voxels).
struct Doubled {
    static constexpr int side = 2 * leaf_side;
    std::array<float, size_t(side) * side * side> values;

    void fill(const Block<2, float>& phi, float offset) {
        const auto along = [](auto&& value, int fine) {
            const int c = fine >> 1;
            return fine & 1 ? midpoint_cubic(value(c - 1), value(c), value(c + 1), value(c + 2)) : value(c);
        };
        std::array<float, size_t(12) * 12 * side> z_done;
        for (int i = -2; i < 10; ++i)
            for (int j = -2; j < 10; ++j)
                for (int k = 0; k < side; ++k)
                    z_done[size_t(((i + 2) * 12 + j + 2) * side + k)] =
                        along([&](int c) { return phi.at(i, j, c); }, k);
        std::array<float, size_t(12) * side * side> y_done;
        for (int i = -2; i < 10; ++i)
            for (int j = 0; j < side; ++j)
                for (int k = 0; k < side; ++k)
                    y_done[size_t(((i + 2) * side + j) * side + k)] =
                        along([&](int c) { return z_done[size_t(((i + 2) * 12 + c + 2) * side + k)]; }, j);
        for (int i = 0; i < side; ++i)
            for (int j = 0; j < side; ++j)
                for (int k = 0; k < side; ++k)
                    values[size_t((i * side + j) * side + k)] =
                        2.0F *
                            along([&](int c) { return y_done[size_t(((c + 2) * side + j) * side + k)]; }, i) -
                        offset;
    }
};

// Catmull-Rom weights of four values, t from 0 to 1 between the middle ones.
std::array<float, 4> cubic_weights(float t) {
    const float t2 = t * t, t3 = t2 * t;
    return {-0.5F * t3 + t2 - 0.5F * t, 1.5F * t3 - 2.5F * t2 + 1.0F, -1.5F * t3 + 2.0F * t2 + 0.5F * t,
            0.5F * t3 - 0.5F * t2};
}

template <typename Accessor>
float tricubic(const Accessor& accessor, const openvdb::Vec3d& place) {
    const Coord cell = Coord::floor(place);
    const auto wx = cubic_weights(float(place[0] - cell[0])), wy = cubic_weights(float(place[1] - cell[1])),
               wz = cubic_weights(float(place[2] - cell[2]));
    float sum = 0.0F;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
            float row = 0.0F;
            for (int k = 0; k < 4; ++k)
                row += wz[size_t(k)] * accessor.getValue(cell.offsetBy(i - 1, j - 1, k - 1));
            sum += wx[size_t(i)] * wy[size_t(j)] * row;
        }
    return sum;
}

// Vertices of the cells that the surface crosses, by leaves; `cells`: the index of each in its leaf, or -1.
std::vector<std::vector<CellVertex>> cell_vertices(const FloatTree& phi, const Leaves& leaves,
                                                   CellLeaves& cells) {
    std::vector<std::vector<CellVertex>> made(leaves.leafCount());
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(phi);
        Block<2, float> block;
        for (size_t n = begin; n < end; ++n) {
            block.gather(Neighbourhood<FloatTree>(accessor, leaves.leaf(n).origin()));
            int32_t* const ids = cells.leaf(n).buffer().data();
            std::fill_n(ids, leaf_voxels, -1);
            const InsideRows<2> rows(block);
            for_voxels([&](int i, int j) { return rows.mixed_cells(i, j); },
                       [&](int i, int j, int k) {
                           std::array<float, 8> corner;
                           std::array<Float3, 8> slope;
                           for (int c = 0; c < 8; ++c) {
                               const int ci = i + (c >> 2), cj = j + (c >> 1 & 1), ck = k + (c & 1);
                               corner[size_t(c)] = block.at(ci, cj, ck);
                               slope[size_t(c)] = central_gradient(block, ci, cj, ck);
                           }
                           ids[(i * leaf_side + j) * leaf_side + k] = int32_t(made[n].size());
                           made[n].push_back(cell_vertex(corner, slope));
                       });
        }
    });
    return made;
}

// A quad as two triangles around each edge that the surface crosses, by leaves.
std::vector<std::vector<uint32_t>> edge_quads(const FloatTree& phi, const Leaves& leaves,
                                              const Int32Tree& cells, const LevelMesh& mesh) {
    std::vector<std::vector<uint32_t>> faces(leaves.leafCount());
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(phi);
        const openvdb::tree::ValueAccessor<const Int32Tree> cell_accessor(cells);
        Block<1, float> block;
        Block<1, int32_t> ids;
        const auto apart = [&](uint32_t a, uint32_t b) {
            double square = 0.0;
            for (size_t axis = 0; axis < 3; ++axis) {
                const double d = double(mesh.positions[3 * a + axis]) - double(mesh.positions[3 * b + axis]);
                square += d * d;
            }
            return square;
        };
        const auto place = [&](uint32_t v) {
            const float* const q = mesh.positions.data() + 3 * size_t(v);
            return Float3{q[0], q[1], q[2]};
        };
        const auto face = [&](uint32_t a, uint32_t b, uint32_t c) {
            return unit(cross(place(b) - place(a), place(c) - place(a)));
        };
        for (size_t n = begin; n < end; ++n) {
            if (leaves.leaf(n).onVoxelCount() == 0) continue;
            block.gather(Neighbourhood<FloatTree>(accessor, leaves.leaf(n).origin()));
            ids.gather(Neighbourhood<Int32Tree>(cell_accessor, leaves.leaf(n).origin()));
            const InsideRows<1> rows(block);
            const auto faces_from = [&](int i, int j, int k) {
                const bool inside = block.at(i, j, k) < 0.0F;
                for (int axis = 0; axis < 3; ++axis) {
                    const int x = axis == 0, y = axis == 1, z = axis == 2;
                    if ((block.at(i + x, j + y, k + z) < 0.0F) == inside) continue;
                    // Cells around the edge, anticlockwise seen from its upper end: axis, u, v are cyclic.
                    const int ui = axis == 2, uj = axis == 0, uk = axis == 1;
                    const int vi = axis == 1, vj = axis == 2, vk = axis == 0;
                    std::array<int32_t, 4> around{ids.at(i - ui - vi, j - uj - vj, k - uk - vk),
                                                  ids.at(i - vi, j - vj, k - vk), ids.at(i, j, k),
                                                  ids.at(i - ui, j - uj, k - uk)};
                    if (*std::min_element(around.begin(), around.end()) < 0)
                        continue; // at the border of the band
                    if (!inside) std::swap(around[1], around[3]);
                    const auto v = [&](int c) { return uint32_t(around[size_t(c & 3)]); };
                    int start = apart(v(0), v(2)) <= apart(v(1), v(3)) ? 0 : 1;
                    const auto folded = [&](int from) {
                        return face(v(from), v(from + 1), v(from + 2))
                            .dot(face(v(from), v(from + 2), v(from + 3)));
                    };
                    if (folded(start) < 0.0F && folded(1 - start) > 0.0F) start = 1 - start;
                    for (const int c : {0, 1, 2, 0, 2, 3}) faces[n].push_back(v(start + c));
                }
            };
            for_voxels([&](int i, int j) { return rows.crossed_edges(i, j); }, faces_from);
        }
    });
    return faces;
}

} // namespace

// ---- the class ----

struct LevelSet::Data {
    double voxel = 1.0;
    FloatTree::Ptr phi; // in voxels
    // Derived from phi, valid if meshed:
    bool meshed = false;
    LevelMesh mesh;
    Int32Tree::Ptr cells;       // vertex index of the cell whose lower corner is the voxel; -1: none
    std::vector<Float3> places; // vertex positions in their cells, in voxels

    void changed() {
        meshed = false;
        mesh = {};
        cells.reset();
        places.clear();
    }
    void extract();
    void place_vertices(const Leaves& leaves, CellLeaves& cell_leaves,
                        const std::vector<std::vector<CellVertex>>& made);
};

// Numbers the vertices in the order of leaves.
void LevelSet::Data::place_vertices(const Leaves& leaves, CellLeaves& cell_leaves,
                                    const std::vector<std::vector<CellVertex>>& made) {
    const size_t count = leaves.leafCount();
    std::vector<size_t> first(count + 1, 0);
    for (size_t n = 0; n < count; ++n) first[n + 1] = first[n] + made[n].size();
    if (first[count] > size_t(std::numeric_limits<int32_t>::max()))
        throw LevelSetError("the surface has more than 2^31 vertices: take larger voxels");
    mesh.positions.resize(3 * first[count]);
    mesh.normals.resize(3 * first[count]);
    places.resize(first[count]);
    for_leaves(leaves, [&](size_t begin, size_t end) {
        for (size_t n = begin; n < end; ++n) {
            int32_t* const ids = cell_leaves.leaf(n).buffer().data();
            const Coord origin = leaves.leaf(n).origin();
            for (int at = 0; at < leaf_voxels; ++at) {
                if (ids[at] < 0) continue;
                const auto& [place, normal] = made[n][size_t(ids[at])];
                const size_t v = first[n] + size_t(ids[at]);
                ids[at] = int32_t(v);
                places[v] = place;
                float* const p = mesh.positions.data() + 3 * v;
                p[0] = float((double(origin.x() + (at >> 6)) + double(place.x)) * voxel);
                p[1] = float((double(origin.y() + (at >> 3 & 7)) + double(place.y)) * voxel);
                p[2] = float((double(origin.z() + (at & 7)) + double(place.z)) * voxel);
                float* const q = mesh.normals.data() + 3 * v;
                q[0] = normal.x, q[1] = normal.y, q[2] = normal.z;
            }
        }
    });
}

void LevelSet::Data::extract() {
    if (meshed) return;
    mesh = {};
    cells = std::make_shared<Int32Tree>(*phi, -1, openvdb::TopologyCopy());
    const Leaves leaves(*phi);
    CellLeaves cell_leaves(*cells);
    place_vertices(leaves, cell_leaves, cell_vertices(*phi, leaves, cell_leaves));
    const std::vector<std::vector<uint32_t>> faces = edge_quads(*phi, leaves, *cells, mesh);
    const size_t count = leaves.leafCount();
    std::vector<size_t> face(count + 1, 0);
    for (size_t n = 0; n < count; ++n) face[n + 1] = face[n] + faces[n].size();
    mesh.triangles.resize(face[count]);
    for_leaves(leaves, [&](size_t begin, size_t end) {
        for (size_t n = begin; n < end; ++n)
            std::copy(faces[n].begin(), faces[n].end(), mesh.triangles.begin() + long(face[n]));
    });
    meshed = true;
}

LevelSet::LevelSet(std::unique_ptr<Data> data) : data_(std::move(data)) {}
LevelSet::LevelSet(LevelSet&&) noexcept = default;
LevelSet& LevelSet::operator=(LevelSet&&) noexcept = default;
LevelSet::~LevelSet() = default;
LevelSet::LevelSet(const LevelSet& other) : data_(std::make_unique<Data>()) {
    data_->voxel = other.data_->voxel;
    data_->phi = std::make_shared<FloatTree>(*other.data_->phi);
}

LevelSet LevelSet::from_mesh(std::span<const float> positions, std::span<const uint32_t> triangles,
                             double voxel) {
    const std::vector<uint32_t> kept = checked_triangles(positions, triangles, voxel);
    const FloatGrid::Ptr grid = band_around(positions, kept, voxel, band);
    auto data = std::make_unique<Data>();
    data->voxel = voxel;
    data->phi = grid->treePtr();
    data->phi->root().setBackground(band, true);
    Leaves leaves(*data->phi);
    trim(*data->phi, leaves);
    return LevelSet(std::move(data));
}

double LevelSet::voxel() const { return data_->voxel; }
bool LevelSet::empty() const { return data_->phi->activeVoxelCount() == 0; }
size_t LevelSet::bytes() const {
    return data_->phi->memUsage() + (data_->cells ? data_->cells->memUsage() : 0);
}

const LevelMesh& LevelSet::mesh() {
    data_->extract();
    return data_->mesh;
}

void LevelSet::advance(std::span<const double> depth) {
    data_->extract();
    if (depth.size() != data_->mesh.vertex_count())
        throw LevelSetError("the wear must have one value for each vertex of the mesh");
    std::vector<WornVertex> vertices(depth.size());
    for (size_t v = 0; v < depth.size(); ++v) {
        const float* const n = data_->mesh.normals.data() + 3 * v;
        const double cut = depth[v] > 0.0 ? std::min(depth[v] / data_->voxel, 1.0) : 0.0; // NaN becomes 0
        vertices[v] = {data_->places[v], {n[0], n[1], n[2]}, float(cut)};
    }
    FloatTree& tree = *data_->phi;
    openvdb::tools::dilateActiveValues(tree, 1, openvdb::tools::NN_FACE_EDGE, openvdb::tools::IGNORE_TILES);
    Leaves leaves(tree, 2);
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(tree);
        const openvdb::tree::ValueAccessor<const Int32Tree> cell_accessor(*data_->cells);
        Block<1, float> phi;
        CellRows rows;
        for (size_t n = begin; n < end; ++n) {
            const Leaf& leaf = leaves.leaf(n);
            phi.gather(Neighbourhood<FloatTree>(accessor, leaf.origin()));
            const Neighbourhood<Int32Tree> cells(cell_accessor, leaf.origin());
            rows.find(cells);
            float* const to = leaves.getBuffer(n, 1).data();
            for (auto voxel = leaf.beginValueOn(); voxel; ++voxel) {
                const int at = int(voxel.pos()), i = at >> 6, j = at >> 3 & 7, k = at & 7;
                const Float3 normal = unit(central_gradient(phi, i, j, k));
                const Float3 place = Float3{float(i), float(j), float(k)} - normal * phi.at(i, j, k);
                to[at] += interpolate_wear(vertices, cells, rows, place, normal);
            }
        }
    });
    leaves.swapLeafBuffer(1);
    renormalise(tree, leaves, true);
    trim(tree, leaves);
    data_->changed();
    data_->extract();
    if (data_->mesh.triangles.empty()) tree.clear(); // no surface: remove the rest of the band
}

LevelSet LevelSet::refined(double offset) const {
    const float shift = float(std::clamp(offset, 0.0, data_->voxel) / (0.5 * data_->voxel));
    auto data = std::make_unique<Data>();
    data->voxel = 0.5 * data_->voxel;
    data->phi = std::make_shared<FloatTree>(band);
    const Leaves leaves(*data_->phi);
    std::vector<std::unique_ptr<Leaf>> made(8 * leaves.leafCount());
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(*data_->phi);
        Block<2, float> phi;
        Doubled fine;
        for (size_t n = begin; n < end; ++n) {
            const Coord origin = leaves.leaf(n).origin();
            phi.gather(Neighbourhood<FloatTree>(accessor, origin));
            fine.fill(phi, shift);
            for (int part = 0; part < 8; ++part) {
                const int pi = part >> 2, pj = part >> 1 & 1, pk = part & 1;
                const Coord at(2 * origin.x() + 8 * pi, 2 * origin.y() + 8 * pj, 2 * origin.z() + 8 * pk);
                auto leaf = std::make_unique<Leaf>(at, band);
                for (int v = 0; v < leaf_voxels; ++v) {
                    const int i = v >> 6, j = v >> 3 & 7, k = v & 7;
                    const float value = fine.values[size_t(
                        ((8 * pi + i) * Doubled::side + 8 * pj + j) * Doubled::side + 8 * pk + k)];
                    if (std::abs(value) < band)
                        leaf->setValueOn(openvdb::Index(v), value);
                    else
                        leaf->setValueOff(openvdb::Index(v), std::copysign(band, value));
                }
                if (!leaf->isEmpty()) made[8 * n + size_t(part)] = std::move(leaf);
            }
        }
    });
    for (auto& leaf : made)
        if (leaf) data->phi->addLeaf(leaf.release());
    // Sets the sign of the interior, which has no leaves.
    openvdb::tools::signedFloodFill(*data->phi);
    Leaves fine_leaves(*data->phi, 2);
    renormalise(*data->phi, fine_leaves, false);
    trim(*data->phi, fine_leaves);
    return LevelSet(std::move(data));
}

void LevelSet::intersect(const LevelSet& other) {
    if (other.data_->voxel != data_->voxel) throw LevelSetError("the two level sets have different voxels");
    FloatTree& tree = *data_->phi;
    tree.topologyUnion(*other.data_->phi);
    const Leaves leaves(tree);
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(*other.data_->phi);
        for (size_t n = begin; n < end; ++n) {
            Leaf& leaf = leaves.leaf(n);
            float* const phi = leaf.buffer().data();
            const Leaf* const its = accessor.probeConstLeaf(leaf.origin());
            const float tile = its ? 0.0F : accessor.getValue(leaf.origin());
            for (int at = 0; at < leaf_voxels; ++at)
                phi[at] = std::max(phi[at], its ? its->buffer().data()[at] : tile);
        }
    });
    trim(tree, leaves);
    openvdb::tools::signedFloodFill(tree);
    data_->changed();
}

size_t LevelSet::keep_largest() {
    data_->extract();
    const std::vector<double> volumes = piece_volumes(data_->mesh);
    const long pieces = std::count_if(volumes.begin(), volumes.end(), [](double v) { return v > 0.0; });
    if (pieces < 2) return 0;
    std::vector<FloatTree::Ptr> segments;
    openvdb::tools::segmentSDF(*data_->phi, segments);
    if (segments.size() < 2) return 0;
    data_->phi = segments.front(); // the piece with the most voxels
    data_->changed();
    return segments.size() - 1;
}

void LevelSet::sample(std::span<const float> points, std::span<float> distance) const {
    marram::parallel_for(tbb::blocked_range<size_t>(0, distance.size(), 1024), [&](const auto& range) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(*data_->phi);
        for (size_t n = range.begin(); n < range.end(); ++n) {
            const float* const p = points.data() + 3 * n;
            const openvdb::Vec3d place{double(p[0]), double(p[1]), double(p[2])};
            distance[n] = float(double(tricubic(accessor, place / data_->voxel)) * data_->voxel);
        }
    });
}

void smoothed_distance(const LevelMesh& mesh, double sigma, std::span<const float> points,
                       std::span<float> distance) {
    // Three box filters of 3 x 3 x 3 voxels approximate a Gaussian of sigma = sqrt(2) voxels.
    constexpr float wide = 10.0F;
    const double voxel = sigma / std::sqrt(2.0);
    const std::vector<uint32_t> kept = checked_triangles(mesh.positions, mesh.triangles, voxel);
    const FloatGrid::Ptr grid = band_around(mesh.positions, kept, voxel, wide);
    FloatTree& tree = grid->tree();
    Leaves leaves(tree, 1);
    for (int pass = 0; pass < 3; ++pass) {
        for_leaves(leaves, [&](size_t begin, size_t end) {
            const openvdb::tree::ValueAccessor<const FloatTree> accessor(tree);
            Block<1, float> phi;
            for (size_t n = begin; n < end; ++n) {
                phi.gather(Neighbourhood<FloatTree>(accessor, leaves.leaf(n).origin()));
                float* const to = leaves.getBuffer(n, 1).data();
                for (int at = 0; at < leaf_voxels; ++at) {
                    float sum = 0.0F;
                    for (int a = -1; a <= 1; ++a)
                        for (int b = -1; b <= 1; ++b)
                            for (int c = -1; c <= 1; ++c)
                                sum += phi.at((at >> 6) + a, (at >> 3 & 7) + b, (at & 7) + c);
                    to[at] = sum / 27.0F;
                }
            }
        });
        leaves.swapLeafBuffer(1);
    }
    const openvdb::tree::ValueAccessor<const FloatTree> accessor(tree);
    for (size_t n = 0; n < distance.size(); ++n) {
        const openvdb::Vec3d place(double(points[3 * n]) / voxel, double(points[3 * n + 1]) / voxel,
                                   double(points[3 * n + 2]) / voxel);
        distance[n] = float(double(tricubic(accessor, place)) * voxel);
    }
}

} // namespace marram
