// SPDX-License-Identifier: Apache-2.0
#include "core/view/mesh_packing.h"

#include "core/math/digest.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <unordered_map>

namespace marram {
namespace {

using nlohmann::json;

// Vertex clustering (Rossignac and Borrel, "Multi-resolution 3D approximations", 1993): the first vertex of
// each cell stands for all of the cell; triangles with two corners in a cell vanish.
DrawnMesh clustered(const MeshGeometry& mesh, double cell) {
    const std::vector<Vec3f>& positions = mesh.positions.front();
    Box3f box;
    for (const Vec3f& p : positions) box.extend(p);
    DrawnMesh drawn;
    std::unordered_map<uint64_t, uint32_t> cells;
    std::vector<uint32_t> corner(positions.size());
    for (size_t i = 0; i < positions.size(); ++i) {
        const Vec3d at = (positions[i] - box.min()).cast<double>() / cell;
        const auto part = [](double x) { return std::min(uint64_t(x), uint64_t((1 << 21) - 1)); };
        const uint64_t key = part(at.x()) | part(at.y()) << 21 | part(at.z()) << 42;
        const auto [found, is_new] = cells.try_emplace(key, uint32_t(drawn.vertices.size()));
        if (is_new) drawn.vertices.push_back(uint32_t(i));
        corner[i] = found->second;
    }
    for (const auto& t : mesh.triangles) {
        const uint32_t a = corner[t[0]], b = corner[t[1]], c = corner[t[2]];
        if (a == b || b == c || c == a) continue;
        const uint32_t least = std::min({a, b, c}); // turned, so that equal ones meet
        drawn.triangles.push_back(least == a   ? std::array{a, b, c}
                                  : least == b ? std::array{b, c, a}
                                               : std::array{c, a, b});
    }
    std::ranges::sort(drawn.triangles);
    drawn.triangles.erase(std::unique(drawn.triangles.begin(), drawn.triangles.end()), drawn.triangles.end());
    return drawn;
}

double area_of(const MeshGeometry& mesh) {
    const std::vector<Vec3f>& p = mesh.positions.front();
    double area = 0.0;
    for (const auto& t : mesh.triangles)
        area += 0.5 * (p[t[1]] - p[t[0]]).cast<double>().cross((p[t[2]] - p[t[0]]).cast<double>()).norm();
    return area;
}

} // namespace

uint64_t topology_of(const MeshGeometry& mesh) {
    if (mesh.topology != 0) return mesh.topology;
    return Digest().add(mesh.triangles).add(mesh.positions.front().size()).value();
}

DrawnMesh drawn_mesh(const MeshGeometry& mesh, size_t max_triangles) {
    DrawnMesh drawn;
    const double area = mesh.triangles.size() > max_triangles ? area_of(mesh) : 0.0;
    if (area > 0.0 && std::isfinite(area)) {
        drawn = clustered(mesh, std::sqrt(2.0 * area / double(max_triangles))); // two triangles a cell
    } else {
        drawn.triangles = mesh.triangles;
        drawn.vertices.resize(mesh.positions.front().size());
        std::iota(drawn.vertices.begin(), drawn.vertices.end(), 0U);
    }
    static std::atomic<uint64_t> last = 0;
    drawn.number = ++last;
    drawn.topology = topology_of(mesh);
    return drawn;
}

json add_mesh_positions(const MeshGeometry& mesh, const DrawnMesh& drawn, WireMessage& message) {
    const auto add = [&](const std::vector<Vec3f>& values) {
        const size_t offset = message.add(drawn.vertices.size() * sizeof(Vec3f));
        auto* out = reinterpret_cast<Vec3f*>(message.at(offset));
        for (const uint32_t vertex : drawn.vertices) *out++ = values[vertex];
        return offset;
    };
    json offsets = {{"positions", add(mesh.positions.front())}, {"normals", -1}};
    if (!mesh.normals.empty()) offsets["normals"] = add(mesh.normals.front());
    return offsets;
}

WireMessage meshes_message(const std::vector<MeshGeometry>& meshes, const std::vector<DrawnMesh>& drawn,
                           const std::vector<Vec3f>& colors) {
    WireMessage message;
    message.header = {{"type", "meshes"}, {"meshes", json::array()}};
    for (size_t i = 0; i < meshes.size(); ++i) {
        const DrawnMesh& shown = drawn[i];
        json entry = add_mesh_positions(meshes[i], shown, message);
        entry["name"] = meshes[i].name;
        entry["color"] = {colors[i].x(), colors[i].y(), colors[i].z()};
        entry["vertices"] = shown.vertices.size();
        entry["triangles"] = shown.triangles.size();
        entry["of"] = meshes[i].triangles.size();
        const size_t offset = message.add(shown.triangles.size() * sizeof shown.triangles[0]);
        if (!shown.triangles.empty())
            std::memcpy(message.at(offset), shown.triangles.data(),
                        shown.triangles.size() * sizeof shown.triangles[0]);
        entry["indices"] = offset;
        message.header["meshes"].push_back(std::move(entry));
    }
    return message;
}

} // namespace marram
