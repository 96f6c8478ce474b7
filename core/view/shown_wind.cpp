// SPDX-License-Identifier: Apache-2.0
#include "core/view/shown_wind.h"

#include <algorithm>

namespace marram {
namespace {

using nlohmann::json;

constexpr size_t max_rays = 4000; // that a page draws

std::vector<Vec3d> points_of(const AirPlane& plane) {
    std::vector<Vec3d> points;
    for (uint32_t j = 0; j < plane.rows; ++j)
        for (uint32_t i = 0; i < plane.columns; ++i)
            points.push_back(plane.center + plane.u * (2.0 * (i + 0.5) / plane.columns - 1.0) +
                             plane.v * (2.0 * (j + 0.5) / plane.rows - 1.0));
    return points;
}

std::vector<Vec3d> cvs_of(const CurveGeometry& curves, uint64_t strand) {
    const CurveLayout layout = curves.layout();
    const float* at = curves.vertices.front() + 4 * (layout.first_vertex(strand) + 1); // behind the phantom
    std::vector<Vec3d> cvs;
    for (uint64_t k = 0; k < layout.cvs(strand); ++k, at += 4)
        cvs.emplace_back(double(at[0]), double(at[1]), double(at[2]));
    return cvs;
}

} // namespace

void add_air(const Shot& shot, const AirPlane& plane, WireMessage& message) {
    const std::vector<Vec3d> points = points_of(plane);
    for (const auto& procedural : shot.geometry.procedurals) {
        const std::vector<Procedural::Air> air = procedural->air(points);
        if (air.size() != points.size()) continue;
        const size_t offset = message.add(7 * sizeof(float) * air.size());
        auto* to = reinterpret_cast<float*>(message.at(offset));
        for (const Procedural::Air& one : air) {
            for (const Vec3d& vector : {one.velocity, one.noise})
                for (int a = 0; a < 3; ++a) *to++ = float(vector[a]);
            *to++ = float(one.share);
        }
        message.header["air"] = {{"counts", {plane.columns, plane.rows}}, {"offset", offset}};
        return;
    }
}

json rays_message(const Shot& shot, const World& world, size_t part, uint64_t strand) {
    const CurveGeometry& curves = world.curves[part];
    const AttributeValues* const normals = find_attribute(curves.attributes, "root_normal");
    Vec3d normal = Vec3d::UnitY();
    if (normals && normals->values.size() >= 3 * (strand + 1))
        for (int a = 0; a < 3; ++a) normal[a] = double(normals->values[3 * strand + uint64_t(a)]);
    const std::vector<Vec3d> cvs = cvs_of(curves, strand);
    json message = {{"type", "rays"}, {"rest", json::array()}, {"rays", json::array()}, {"shelter", 0.0}};
    for (const Vec3d& cv : cvs) message["rest"].push_back(json_of(cv));
    for (const auto& procedural : shot.geometry.procedurals) {
        if (procedural->name() != curves.name) continue;
        const std::vector<Procedural::ShelterRay> rays = procedural->shelter_rays(cvs, normal);
        double sum = 0.0;
        for (const Procedural::ShelterRay& ray : rays) sum += ray.shelter;
        const size_t every = (rays.size() + max_rays - 1) / max_rays;
        for (size_t i = 0; i < rays.size(); i += every)
            message["rays"].push_back({json_of(rays[i].from), json_of(rays[i].to), rays[i].shelter});
        if (!rays.empty()) message["shelter"] = sum / double(rays.size());
    }
    return message;
}

} // namespace marram
