// SPDX-License-Identifier: Apache-2.0
#include "core/render/lights/mesh_light.h"

namespace marram {

std::vector<ParamSpec> mesh_light_params() {
    using enum ParamType;
    constexpr double any = std::numeric_limits<double>::infinity();
    return {{"mesh", reference, "", "", -any, any, "mesh", "the mesh"},
            {"radiance", color, "W/(m^2 sr)", "1", 0, brightest_light, "",
             "the same in all directions, from the outer side"}};
}

MeshLight make_mesh_light(const ParamSet& params) { return {color_of(params, "radiance")}; }

namespace {

// Mean area of a triangle over the shutter, by Simpson's rule on each motion step. Vertices are linear over a
// step, so the area is the length of a quadratic: if it is 0 at the three points, it is 0 throughout, and a
// triangle that ever shines is sampled.
double mean_area(const World& world, uint32_t mesh, uint32_t triangle) {
    const size_t steps = world.meshes[mesh].positions.size() - 1;
    const auto area_at = [&](double time) {
        const float area = mesh_point(world, mesh, triangle, Vec2f::Zero(), static_cast<float>(time)).area;
        return std::isfinite(area) ? static_cast<double>(area) : 0.0;
    };
    if (steps == 0) return area_at(0.0);
    double sum = 0.0;
    for (size_t i = 0; i < 2 * steps + 1; ++i) {
        const double weight = i == 0 || i == 2 * steps ? 1.0 : i % 2 == 1 ? 4.0 : 2.0;
        sum += weight * area_at(static_cast<double>(i) / static_cast<double>(2 * steps));
    }
    return sum / (6.0 * static_cast<double>(steps));
}

} // namespace

MeshSampler::MeshSampler(const MeshLight& light, uint32_t index, const World& world)
    : world_(&world), radiance_(light.radiance) {
    std::vector<double> areas;
    for (uint32_t mesh = 0; mesh < world.meshes.size(); ++mesh) {
        if (world.meshes[mesh].light != static_cast<int>(index)) continue;
        first_of_mesh_.emplace_back(mesh, areas.size());
        for (uint32_t triangle = 0; triangle < world.meshes[mesh].triangles.size(); ++triangle) {
            triangles_.push_back({mesh, triangle});
            areas.push_back(mean_area(world, mesh, triangle));
        }
    }
    by_area_ = Distribution1D(areas);
}

double MeshSampler::power(double scene_radius) const {
    if (triangles_.empty()) return 0.0;
    return mean_of(radiance_) * by_area_.total() / (scene_radius * scene_radius);
}

void MeshSampler::sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const {
    sample.at_infinity = false;
    if (triangles_.empty()) return;
    const Distribution1D::Choice at = by_area_.sample(a);
    const Triangle& triangle = triangles_[at.cell];
    const float root = static_cast<float>(std::sqrt(at.within));
    const SurfacePoint point =
        mesh_point(*world_, triangle.mesh, triangle.triangle, {root * (1.0F - b), root * b}, time);
    const Vec3d normal = point.geometric_normal.cast<double>();
    sample.target = point.position + 2.0 * point.error * normal;
    const Vec3d way = from - sample.target;
    const double distance2 = way.squaredNorm(), cosine = way.dot(normal) / std::sqrt(distance2);
    if (!(cosine > 0.0) || !(point.area > 0.0F)) return;
    sample.radiance = radiance_;
    sample.pdf = static_cast<float>(by_area_.probability(at.cell) / point.area * distance2 / cosine);
}

LightRadiance MeshSampler::along_ray(const SurfacePoint& point, const Vec3f& direction, double choice) const {
    const float cosine = -point.geometric_normal.dot(direction);
    if (!(cosine > 0.0F)) return {};
    for (const auto& [mesh, first] : first_of_mesh_) {
        if (mesh != point.geometry) continue;
        const double chosen = choice * by_area_.probability(first + point.primitive);
        const double distance = point.distance;
        return {radiance_, static_cast<float>(chosen / point.area * distance * distance / cosine)};
    }
    return {};
}

} // namespace marram
