// SPDX-License-Identifier: Apache-2.0
// A mesh of the scene and its motion: its transform, and the shapes of a deforming mesh.
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

// MarramRole bits, from the parameters that role_params() declares.
uint32_t role_bits(const ParamSet& params);

struct SceneMesh {
    std::string name;
    Mesh mesh; // object space; read it as object().mesh
    KeyedTransform transform;
    int material = -1;
    int light = -1;
    // Of a deforming mesh: two or more, by ascending frame, with the mesh's triangles and as many vertices.
    // Vertices are linear between them, and constant before the first and after the last.
    std::vector<MeshShape> shapes{};
    uint32_t roles = MARRAM_ALL_ROLES;
    bool shadow_catcher = false;

    // The mesh that this one is an instance of. `transform` is applied after that mesh's own transform to
    // world space. Mesh and shapes are the other's.
    const SceneMesh* instance_of = nullptr;

    const SceneMesh& object() const { return instance_of ? *instance_of : *this; }
    Eigen::Affine3d to_world(double frame) const; // from object space
    bool moves() const;                           // false: the same at every frame
    bool moves_within(double begin, double end) const;

    // Frames between the two at which its path may bend: those of shapes and of the transform's keys.
    // Ascending.
    std::vector<double> bends_within(double begin, double end) const;

    // Some vertices at a frame, world space.
    std::vector<Vec3d> vertices_at(std::span<const size_t> vertices, double frame) const;
    // All vertices, with Embree's 16 spare bytes behind; unit normals, empty if the mesh has none. Cost: 5 ns
    // per vertex and processor.
    std::vector<Vec3f> positions_at(double frame) const;
    std::vector<Vec3f> normals_at(double frame) const;

    uint64_t digest() const; // of all members but name, material and light
};

// Appends the instances of meshes; items[i] describes meshes[i]. Throws InputError. Instances point into the
// vector: it may be moved, but must not grow.
void add_instances(std::vector<SceneMesh>& meshes, std::span<const Item> items);

} // namespace marram
