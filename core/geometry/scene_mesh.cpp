// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/scene_mesh.h"

#include "core/geometry/embree_buffer.h"
#include "core/math/digest.h"
#include "core/math/problem.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <utility>

namespace marram {
namespace {

// Two arrays of vertices or normals, and the weight of the second.
struct Between {
    const std::vector<Vec3f>*first, *second;
    double share;

    Vec3d operator()(size_t i) const {
        const Vec3d a = (*first)[i].cast<double>();
        return share > 0.0 ? Vec3d(a + share * ((*second)[i].cast<double>() - a)) : a;
    }
};

Between between(const SceneMesh& mesh, double frame, std::vector<Vec3f> MeshShape::*what,
                const std::vector<Vec3f>& at_rest) {
    const std::vector<MeshShape>& shapes = mesh.object().shapes;
    if (shapes.empty()) return {&at_rest, &at_rest, 0.0};
    const auto next = std::ranges::upper_bound(shapes, frame, {}, &MeshShape::frame);
    if (next == shapes.begin()) return {&(shapes.front().*what), &(shapes.front().*what), 0.0};
    if (next == shapes.end()) return {&(shapes.back().*what), &(shapes.back().*what), 0.0};
    const MeshShape &a = *(next - 1), &b = *next;
    return {&(a.*what), &(b.*what), (frame - a.frame) / (b.frame - a.frame)};
}

// An Embree buffer filled with make(i).
template <typename Make>
std::vector<Vec3f> buffer_of(size_t size, Make&& make) {
    std::vector<Vec3f> buffer = embree_buffer<Vec3f>(size);
    tbb::parallel_for(size_t(0), size, [&](size_t i) { buffer[i] = make(i); });
    return buffer;
}

} // namespace

Eigen::Affine3d SceneMesh::to_world(double frame) const {
    return instance_of ? transform.at(frame) * instance_of->to_world(frame) : transform.at(frame);
}

bool SceneMesh::moves() const {
    return transform.moves() || (instance_of ? instance_of->moves() : shapes.size() > 1);
}

bool SceneMesh::moves_within(double begin, double end) const {
    return transform.moves_within(begin, end) || (instance_of && instance_of->moves_within(begin, end)) ||
           (shapes.size() > 1 && shapes.front().frame < end && shapes.back().frame > begin && begin < end);
}

std::vector<double> SceneMesh::bends_within(double begin, double end) const {
    std::vector<double> bends = transform.frames();
    for (const MeshShape& shape : object().shapes) bends.push_back(shape.frame);
    if (instance_of) std::ranges::copy(instance_of->transform.frames(), std::back_inserter(bends));
    std::erase_if(bends, [&](double frame) { return !(frame > begin && frame < end); });
    std::ranges::sort(bends);
    bends.erase(std::unique(bends.begin(), bends.end()), bends.end());
    return bends;
}

std::vector<Vec3d> SceneMesh::vertices_at(std::span<const size_t> vertices, double frame) const {
    const Eigen::Affine3d placed = to_world(frame);
    const Between at = between(*this, frame, &MeshShape::positions, object().mesh.positions);
    std::vector<Vec3d> points;
    points.reserve(vertices.size());
    for (const size_t vertex : vertices) points.push_back(placed * at(vertex));
    return points;
}

std::vector<Vec3f> SceneMesh::positions_at(double frame) const {
    const Eigen::Affine3d placed = to_world(frame);
    const std::vector<Vec3f>& positions = object().mesh.positions;
    const Between at = between(*this, frame, &MeshShape::positions, positions);
    return buffer_of(positions.size(), [&](size_t i) -> Vec3f { return (placed * at(i)).cast<float>(); });
}

std::vector<Vec3f> SceneMesh::normals_at(double frame) const {
    const Eigen::Matrix3d turned =
        to_world(frame).linear().inverse().transpose(); // outward stays outward, mirrored or not
    const std::vector<Vec3f>& normals = object().mesh.normals;
    const Between at = between(*this, frame, &MeshShape::normals, normals);
    return buffer_of(normals.size(), [&](size_t i) -> Vec3f {
        const Vec3d normal = turned * at(i);
        // Halfway between opposite normals the mean is 0: use that of the previous shape.
        return (normal.squaredNorm() > 0.0 ? normal : Vec3d(turned * (*at.first)[i].cast<double>()))
            .normalized()
            .cast<float>();
    });
}

namespace {

// Eigen's vectors are just their numbers, though C++ does not call them trivially copyable.
template <typename T>
std::string_view bytes_of(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

} // namespace

uint32_t role_bits(const ParamSet& params) {
    uint32_t roles = 0;
    for (const auto& [name, bit] : {std::pair{"collides", MARRAM_COLLIDES},
                                    {"shelters", MARRAM_SHELTERS},
                                    {"casts_shadows", MARRAM_CASTS_SHADOWS},
                                    {"seen_by_camera", MARRAM_SEEN_BY_CAMERA}})
        if (!params.has(name) || params.boolean(name)) roles |= bit;
    return roles;
}

uint64_t SceneMesh::digest() const {
    Digest digest;
    if (instance_of)
        return digest.add(instance_of->digest())
            .add(transform.digest())
            .add(roles)
            .add(shadow_catcher)
            .value();
    digest.add(bytes_of(mesh.positions))
        .add(bytes_of(mesh.normals))
        .add(bytes_of(mesh.uvs))
        .add(bytes_of(mesh.triangles))
        .add(transform.digest());
    for (const MeshShape& shape : shapes)
        digest.add(std::bit_cast<uint64_t>(shape.frame))
            .add(bytes_of(shape.positions))
            .add(bytes_of(shape.normals));
    return digest.add(roles).add(shadow_catcher).value();
}

void add_instances(std::vector<SceneMesh>& meshes, std::span<const Item> items) {
    const auto count_of = [](const Item& item) {
        const ParamList* list = item.params.find_list("instances");
        return list ? list->size : 0;
    };
    size_t count = meshes.size();
    for (const Item& item : items) count += count_of(item);
    meshes.reserve(count); // no reallocation: instances point to meshes
    for (size_t m = 0; m < items.size(); ++m)
        for (size_t i = 0; i < count_of(items[m]); ++i) {
            const ParamValue& keys = items[m].params.at("instances[" + std::to_string(i) + "].transform");
            SceneMesh instance{meshes[m].name + "[" + std::to_string(i) + "]",
                               {},
                               KeyedTransform(keys.numbers, keys.text),
                               meshes[m].material};
            instance.roles = meshes[m].roles;
            instance.shadow_catcher = meshes[m].shadow_catcher;
            instance.instance_of = &meshes[m];
            const Place& place = keys.given ? keys.place : items[m].place;
            for (const Item& item : items)
                if (item.name == instance.name)
                    throw InputError(item.place, "the mesh \"" + item.name + "\" has the name of an instance",
                                     "give it another name");
            if (meshes[m].light >= 0)
                throw InputError(place, "the mesh \"" + meshes[m].name + "\" has a light and instances",
                                 "write a mesh and a light for each");
            for (size_t k = 7; k + 2 < keys.numbers.size(); k += 10) { // x, y, z of each key's scale
                const double x = keys.numbers[k];
                bool even = std::abs(keys.numbers[k + 1]) == std::abs(x) &&
                            std::abs(keys.numbers[k + 2]) == std::abs(x);
                for (size_t axis = 0; axis < 3; ++axis) // no axis may pass 0 between keys
                    even = even && (keys.numbers[k + axis] > 0.0) == (keys.numbers[7 + axis] > 0.0);
                if (!even || x == 0.0)
                    throw InputError(place,
                                     "the scale of an instance is 0, changes its sign, or is not uniform",
                                     "give one number thrice, such as scale = [2, 2, 2]");
            }
            meshes.push_back(std::move(instance));
        }
}

} // namespace marram
