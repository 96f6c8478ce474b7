// SPDX-License-Identifier: Apache-2.0
// A mesh of the scene and how it moves: its transform, and the shapes that it goes through where it deforms.
#pragma once

#include "core/geometry/mesh.h"
#include "core/math/params.h"
#include "core/math/transform.h"
#include "core/plugin/marram_plugin.h"
#include "core/scene/description.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

// A mesh's vertices and normals at a frame, object space.
struct MeshShape {
    double frame = 0.0;
    std::vector<Vec3f> positions, normals; // normals: as Mesh::normals
};

// MarramRole bits, of what role_params() declares.
uint32_t role_bits(const ParamSet& params);

struct SceneMesh {
    std::string name;
    Mesh mesh; // object space; read it as object().mesh
    KeyedTransform transform;
    int material = -1;
    int light = -1;
    // Of a mesh that deforms, by ascending frame, two or more, with mesh's triangles and as many vertices. From each to the next
    // vertices go straight; before the first and after the last they rest.
    std::vector<MeshShape> shapes{};
    uint32_t roles = MARRAM_ALL_ROLES;

    // Another mesh, shown once more: `transform` takes it, as it stands in the world, to where the instance stands. Mesh and shapes are
    // the other's.
    const SceneMesh* instance_of = nullptr;

    const SceneMesh& object() const { return instance_of ? *instance_of : *this; }
    Eigen::Affine3d to_world(double frame) const; // from object space
    bool moves() const;                           // false: the same at every frame
    bool moves_within(double begin, double end) const;

    // Frames between the two at which its way may bend: of its shapes, and of its transform's keys. Ascending.
    std::vector<double> bends_within(double begin, double end) const;

    // Some vertices at a frame, world space.
    std::vector<Vec3d> vertices_at(std::span<const size_t> vertices, double frame) const;
    // All of them, with Embree's 16 spare bytes behind; unit normals, none where the mesh has none. Cost: 5 ns a vertex and processor.
    std::vector<Vec3f> positions_at(double frame) const;
    std::vector<Vec3f> normals_at(double frame) const;

    uint64_t digest() const; // of all that it holds but name, material and light
};

// Puts the instances of meshes, which the scene's items describe one for one, behind the meshes. Throws InputError. The vector may be moved,
// not grown.
void add_instances(std::vector<SceneMesh>& meshes, std::span<const Item> items);

} // namespace marram
