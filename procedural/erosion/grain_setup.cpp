// SPDX-License-Identifier: Apache-2.0
// Setup and result of a trace of grains: checks of the settings, the box, conversion of quanta to depths. The
// model is documented in grains.cpp.
#include "procedural/erosion/grain_tracer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace marram {
namespace {

constexpr double grain_most_heights = 12.0; // maximum start height in units of H: all but 6e-6 of the flux

bool grain_is_near(const Vec3d& p) { return p.cwiseAbs().maxCoeff() < max_grain_coordinate; }

struct WindBounds {
    Vec3d low = Vec3d::Constant(infinity), high = Vec3d::Constant(-infinity); // s, y, t
    void add(const Vec3d& p, const GrainBox& box) {
        const Vec3d q(p.dot(box.along), p.y(), p.dot(box.across));
        low = low.cwiseMin(q), high = high.cwiseMax(q);
    }
};

// Distance to the first hit of a ray, or infinity. direction: unit.
double first_hit(const GrainTracer& tracer, const Vec3d& from, const Vec3d& direction, double length) {
    RTCRayHit ray{};
    ray.ray.org_x = float(from.x()), ray.ray.org_y = float(from.y()), ray.ray.org_z = float(from.z());
    ray.ray.dir_x = float(direction.x()), ray.ray.dir_y = float(direction.y()),
    ray.ray.dir_z = float(direction.z());
    ray.ray.tfar = float(length);
    ray.ray.mask = tracer.settings.ray_mask;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(tracer.scene, &ray, 1);
    return ray.hit.geomID != RTC_INVALID_GEOMETRY_ID ? double(ray.ray.tfar) : infinity;
}

// Height of the ground along the start plane: the highest mesh slightly downwind of the plane, or base. If a
// horizontal ray just below that height hits something, it is the side of an object, not ground.
void find_ground(const GrainTracer& tracer, GrainBox& box) {
    box.ground.resize(grain_profile);
    const double little = 1e-4 * box.size, high = box.y1 + 10.0 * little;
    for (int k = 0; k < grain_profile; ++k) {
        const double t = box.t0 + (k + 0.5) / grain_profile * (box.t1 - box.t0);
        Vec3d from = (box.s0 + little) * box.along + t * box.across;
        from.y() = high;
        double y = high - first_hit(tracer, from, -Vec3d::UnitY(), high - box.y0 + little);
        from -= little * box.along;
        from.y() = std::max(y - little, box.base);
        if (!(y > box.base) || first_hit(tracer, from, box.along, little) < infinity) y = box.base;
        if (y > box.base) // a mesh: start above it, whatever the rounding of its coordinates
            y += 8.0 * grain_step * std::max(from.cwiseAbs().maxCoeff(), std::abs(high));
        box.ground[size_t(k)] = y;
    }
}

} // namespace

bool find_grain_box(GrainTracer& tracer) {
    const GrainSettings& s = tracer.settings;
    GrainBox box;
    const Vec3d level(s.wind.x(), 0.0, s.wind.z());
    const double largest = level.cwiseAbs().maxCoeff();
    if (!(largest > 0.0)) return false;
    box.along = (level / largest).normalized();
    box.across = box.along.cross(Vec3d::UnitY());
    WindBounds worn, whole;
    for (const GrainMesh& mesh : tracer.meshes)
        for (size_t k = 0; k < mesh.mesh.triangle_count * 3; ++k) {
            const float* p = mesh.mesh.vertices + 3 * size_t(mesh.mesh.triangles[k]);
            if (const Vec3d at(p[0], p[1], p[2]); grain_is_near(at)) worn.add(at, box);
        }
    RTCBounds bounds{};
    rtcGetSceneBounds(tracer.scene, &bounds);
    if (!(worn.low.x() <= worn.high.x()) || !(bounds.lower_x <= bounds.upper_x)) return false;
    for (int k = 0; k < 8; ++k)
        whole.add({k & 1 ? bounds.upper_x : bounds.lower_x, k & 2 ? bounds.upper_y : bounds.lower_y,
                   k & 4 ? bounds.upper_z : bounds.lower_z},
                  box);
    const Vec3d reach = Vec3d::Constant(s.reach);
    const Vec3d low = whole.low.cwiseMax(worn.low - reach), high = whole.high.cwiseMin(worn.high + reach);
    const double coordinate = std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());
    box.size = (high - low).norm();
    if (!(box.size > 0.0) || !(coordinate < max_grain_coordinate)) return false;
    const double slack = 8.0 * grain_step * coordinate + 1e-6 * box.size;
    box.y0 = low.y() - slack, box.y1 = high.y() + slack;
    if (s.ground) box.y0 = std::min(box.y0, *s.ground - slack), box.y1 = std::max(box.y1, *s.ground);
    box.base = s.ground.value_or(box.y0);
    box.s0 = low.x() - slack, box.s1 = high.x() + slack;
    box.start = box.s0 - (s.ground ? std::min(2.0 * s.height, box.s1 - box.s0) : 0.0);
    const double length = box.s1 - box.start, aside = length * std::tan(s.spread) + slack;
    box.t0 = low.z() - aside, box.t1 = high.z() + aside;
    const double time = s.gravity > 0.0 ? length / s.bed_speed : 0.0; // infinite if bed_speed is 0
    const double drop = s.gravity > 0.0 ? time * (4.0 * tracer.launch + 0.5 * s.gravity * time) : 0.0;
    box.size = Vec3d(length, box.y1 - box.y0, box.t1 - box.t0).norm();
    find_ground(tracer, box);
    const double lowest = *std::min_element(box.ground.begin(), box.ground.end());
    box.top = std::min(grain_most_heights * s.height, std::max(box.y1 - lowest, slack) + drop);
    tracer.sag =
        s.path_error > 0.0 ? s.path_error : std::min(0.05 * s.height, 0.01 * (worn.high - worn.low).norm());
    tracer.sag = std::max(tracer.sag, 1e-12 * box.size);
    tracer.chord_time = s.gravity > 0.0 ? std::sqrt(8.0 * tracer.sag / s.gravity) : longest_arc;
    tracer.share = -std::expm1(-box.top / s.height);
    tracer.box = std::move(box);
    return true;
}

// Of the box in which grains fly, and what is above it, as far as there is anything. The more paths, the more
// rays a fine grid saves.
void find_empty_space(GrainTracer& tracer) {
    const GrainBox& box = tracer.box;
    RTCBounds bounds{};
    rtcGetSceneBounds(tracer.scene, &bounds);
    Eigen::AlignedBox3d whole(Vec3d(bounds.lower_x, bounds.lower_y, bounds.lower_z),
                              Vec3d(bounds.upper_x, bounds.upper_y, bounds.upper_z));
    Eigen::AlignedBox3d flown;
    for (int k = 0; k < 4; ++k)
        flown.extend((k & 1 ? box.s1 : box.start) * box.along + (k & 2 ? box.t1 : box.t0) * box.across);
    const double slack =
        0x1p-16 * (box.size + flown.min().cwiseAbs().maxCoeff() + flown.max().cwiseAbs().maxCoeff());
    flown.min() -= Vec3d::Constant(slack), flown.max() += Vec3d::Constant(slack);
    flown.min().y() = box.y0 - slack, flown.max().y() = std::max(whole.max().y(), box.y1) + slack;
    whole.min() -= Vec3d::Constant(slack), whole.max() += Vec3d::Constant(slack);
    const double cells = 0.5 * std::cbrt(double(tracer.settings.paths));
    tracer.empty = EmptySpace(tracer.scene, whole.intersection(flown), int(std::clamp(cells, 4.0, 64.0)));
}

void take_worn_meshes(GrainTracer& tracer, std::span<const WornMesh> meshes, size_t wear,
                      size_t triangle_wear) {
    size_t vertices = 0, triangles = 0;
    for (const WornMesh& mesh : meshes) {
        if ((mesh.vertex_count > 0 && !mesh.vertices) || (mesh.triangle_count > 0 && !mesh.triangles))
            throw std::invalid_argument("a worn mesh has no vertices or triangles: pass its arrays");
        for (size_t k = 0; k < 3 * mesh.triangle_count; ++k)
            if (mesh.triangles[k] >= mesh.vertex_count)
                throw std::invalid_argument("a worn mesh has a triangle whose vertices do not exist");
        if (mesh.quads && mesh.triangle_count % 2 != 0)
            throw std::invalid_argument("a worn mesh of quads has an odd number of triangles");
        tracer.meshes.push_back({mesh, vertices, triangles});
        vertices += mesh.vertex_count, triangles += mesh.triangle_count;
    }
    if (wear != vertices || (triangle_wear != 0 && triangle_wear != triangles))
        throw std::invalid_argument(
            "wear has another size than the worn meshes: one value a vertex, or triangle");
    std::sort(tracer.meshes.begin(), tracer.meshes.end(),
              [](const GrainMesh& a, const GrainMesh& b) { return a.mesh.geometry < b.mesh.geometry; });
    tracer.vertex_quanta.assign(vertices, 0);
    tracer.triangle_quanta.assign(triangle_wear != 0 ? triangles : 0, 0);
}

void write_wear(const GrainTracer& tracer, double volume_per_quantum, std::span<double> wear,
                std::span<double> triangle_wear) {
    std::vector<double> areas(wear.size(), 0.0);
    for (const GrainMesh& mesh : tracer.meshes)
        for (size_t f = 0; f < mesh.mesh.triangle_count; ++f) {
            const uint32_t* corners = mesh.mesh.triangles + 3 * f;
            const auto corner = [&](int k) {
                const float* p = mesh.mesh.vertices + 3 * size_t(corners[k]);
                return Vec3d(p[0], p[1], p[2]);
            };
            const Vec3d p0 = corner(0);
            const double area = 0.5 * (corner(1) - p0).cross(corner(2) - p0).norm();
            if (!(area < infinity)) continue;
            for (int k = 0; k < 3; ++k) areas[mesh.first_vertex + corners[k]] += area / 3.0;
            if (const size_t at = mesh.first_triangle + f; !triangle_wear.empty() && area > 0.0)
                triangle_wear[at] = double(tracer.triangle_quanta[at]) * volume_per_quantum / area;
        }
    for (size_t k = 0; k < wear.size(); ++k)
        if (areas[k] > 0.0) wear[k] = double(tracer.vertex_quanta[k]) * volume_per_quantum / areas[k];
}

std::string grain_settings_fault(const GrainSettings& s) {
    struct Bound {
        const char* name;
        double value, low, high;
    };
    constexpr double tiny = 1e-9;
    const Bound bounds[] = {
        {"paths", double(s.paths), 1.0, 0x1p28},
        {"transport", s.transport, 0.0, 1e12},
        {"height", s.height, tiny, 1e9},
        {"speed", s.speed, 0.0, 200.0},
        {"bed_speed", s.bed_speed, 0.0, s.speed},
        {"speed_height", s.speed_height, tiny, 1e9},
        {"spread", s.spread, 0.0, 1.0},
        {"gravity", s.gravity, 0.0, 100.0},
        {"drag_time", s.drag_time, 0.0, 1e9},
        {"path_error", s.path_error, 0.0, 1e9},
        {"energy_per_volume", s.energy_per_volume, 1.0, 1e18},
        {"threshold_speed", s.threshold_speed, 0.0, 1e3},
        {"angle_exponent", s.angle_exponent, 0.0, 16.0},
        {"normal_restitution", s.normal_restitution, 0.0, 1.0},
        {"tangent_restitution", s.tangent_restitution, 0.0, 1.0},
        {"scatter", s.scatter, 0.0, 1.0},
        {"settle_speed", s.settle_speed, 0.0, 1e3},
        {"most_hits", double(s.max_hits), 1.0, 1e6},
        {"most_segments", double(s.max_segments), 1.0, 1e9},
        {"ground", s.ground.value_or(0.0), -1e7, 1e7},
        {"reach", s.reach, 0.0, infinity},
    };
    for (const Bound& b : bounds)
        if (!(b.value >= b.low && b.value <= b.high))
            return fmt::format("{}: must be {:g} to {:g}", b.name, b.low, b.high);
    if (!s.wind.allFinite()) return "wind: must be finite";
    return "";
}

} // namespace marram
