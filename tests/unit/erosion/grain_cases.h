// SPDX-License-Identifier: Apache-2.0
// Scenes for wear by sand, with known results. For the tests and for build/grains, which prints tables of
// them.
#pragma once

#include "procedural/erosion/grains.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

namespace marram::testing {

struct GrainShape {
    std::vector<float> vertices;
    std::vector<uint32_t> triangles;
    void add(const Vec3d& p) {
        for (int k = 0; k < 3; ++k) vertices.push_back(float(p[k]));
    }
};

// A grid of nu x nv cells over the parallelogram at `corner` with edges u and v.
inline GrainShape grain_plate(const Vec3d& corner, const Vec3d& u, const Vec3d& v, uint32_t nu = 1,
                              uint32_t nv = 1) {
    GrainShape shape;
    for (uint32_t j = 0; j <= nv; ++j)
        for (uint32_t i = 0; i <= nu; ++i) shape.add(corner + double(i) / nu * u + double(j) / nv * v);
    for (uint32_t j = 0; j < nv; ++j)
        for (uint32_t i = 0; i < nu; ++i) {
            const uint32_t a = j * (nu + 1) + i, b = a + 1, c = a + nu + 1, d = c + 1;
            for (const uint32_t k : {a, b, d, a, d, c}) shape.triangles.push_back(k);
        }
    return shape;
}

// twist: by this many sides from ring to ring. At -1 the diagonals of the quads run along the meridians.
inline GrainShape grain_sphere(const Vec3d& centre, double radius, uint32_t rings, uint32_t sides = 0,
                               double twist = 0.0) {
    GrainShape shape;
    if (sides == 0) sides = 2 * rings;
    for (uint32_t j = 0; j <= rings; ++j)
        for (uint32_t i = 0; i < sides; ++i) {
            const double a = pi * j / rings, b = 2.0 * pi * (i + twist * j) / sides;
            shape.add(centre +
                      radius * Vec3d(std::sin(a) * std::cos(b), std::cos(a), std::sin(a) * std::sin(b)));
        }
    for (uint32_t j = 0; j < rings; ++j)
        for (uint32_t i = 0; i < sides; ++i) {
            const uint32_t a = j * sides + i, b = j * sides + (i + 1) % sides, c = a + sides, d = b + sides;
            for (const uint32_t k : {a, b, d, a, d, c}) shape.triangles.push_back(k);
        }
    return shape;
}

class GrainScene {
  public:
    GrainScene() : device_(rtcNewDevice("set_affinity=0,start_threads=0")), scene_(rtcNewScene(device_)) {}
    ~GrainScene() {
        rtcReleaseScene(scene_);
        rtcReleaseDevice(device_);
    }
    GrainScene(const GrainScene&) = delete;
    GrainScene& operator=(const GrainScene&) = delete;

    // quads: each two triangles a b c and a c d of the shape are one of Embree's quads, d a b c.
    unsigned add(GrainShape shape, bool quads = false) {
        shapes_.push_back(std::make_unique<GrainShape>(std::move(shape)));
        GrainShape& kept = *shapes_.back();
        const size_t vertices = kept.vertices.size() / 3, triangles = kept.triangles.size() / 3;
        kept.vertices.resize(kept.vertices.size() + 4); // Embree reads 16 bytes from each vertex
        const RTCGeometry geometry =
            rtcNewGeometry(device_, quads ? RTC_GEOMETRY_TYPE_QUAD : RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                   kept.vertices.data(), 0, 12, vertices);
        if (quads) {
            auto* to = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0,
                                                                      RTC_FORMAT_UINT4, 16, triangles / 2));
            for (size_t t = 0; t + 1 < triangles; t += 2)
                for (const size_t c : {5, 0, 1, 2}) *to++ = kept.triangles[3 * t + c];
        } else {
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                       kept.triangles.data(), 0, 12, triangles);
        }
        rtcSetGeometryMask(geometry, 0xffffffffU); // Embree 4: 1 by default
        rtcCommitGeometry(geometry);
        const unsigned id = rtcAttachGeometry(scene_, geometry);
        rtcReleaseGeometry(geometry);
        return id;
    }
    void commit() { rtcCommitScene(scene_); }
    RTCScene get() const { return scene_; }
    WornMesh worn(unsigned id) const {
        const GrainShape& shape = *shapes_.at(id);
        return {id, shape.vertices.data(), shape.vertices.size() / 3 - 1, shape.triangles.data(),
                shape.triangles.size() / 3};
    }

  private:
    RTCDevice device_;
    RTCScene scene_;
    std::vector<std::unique_ptr<GrainShape>> shapes_;
};

struct GrainResult {
    GrainReport report;
    std::vector<double> vertices, triangles;
};

inline GrainResult traced(const GrainScene& scene, const WornMesh& mesh, const GrainSettings& settings,
                          const GrainHooks& hooks = {}) {
    GrainResult result;
    result.vertices.resize(mesh.vertex_count);
    result.triangles.resize(mesh.triangle_count);
    result.report =
        trace_grains(scene.get(), std::span(&mesh, 1), settings, result.vertices, result.triangles, hooks);
    return result;
}

// Straight level paths with equal speed and uniform flux; grains do not rebound.
inline GrainSettings even_grains(uint64_t paths) {
    GrainSettings s;
    s.paths = paths;
    s.height = 1e7;
    s.transport = 1e12;
    s.speed = s.bed_speed = 8.0;
    s.gravity = 0.0;
    s.threshold_speed = 2.0;
    s.normal_restitution = s.tangent_restitution = 0.0;
    return s;
}
inline double flux_of(const GrainSettings& s) { return s.transport / s.height; } // kg / (year m^2) at h = 0

// ---- plates at an angle to the wind ----

// Wear of a plate at `angle` to the wind, relative to the closed form.
inline double plate_ratio(double angle, double exponent, uint64_t paths, uint32_t seed) {
    GrainScene scene;
    const unsigned id =
        scene.add(grain_plate(Vec3d::Zero(), {std::cos(angle), std::sin(angle), 0.0}, Vec3d(0.0, 0.0, 1.0)));
    scene.commit();
    GrainSettings s = even_grains(paths);
    s.angle_exponent = exponent, s.seed = seed;
    const GrainResult result = traced(scene, scene.worn(id), s);
    const double energy = 0.5 * s.speed * s.speed, least = 0.5 * s.threshold_speed * s.threshold_speed;
    const double wearing = std::max(energy * std::pow(std::sin(angle), exponent) - least, 0.0);
    const double expected = flux_of(s) * std::sin(angle) * wearing / s.energy_per_volume; // area 1 m^2
    return wearing > 0.0 ? result.report.volume / expected : 1.0 + result.report.volume;
}

// ---- sphere ----

// Area-weighted relative L1 error of the wear of the facets, averaged in `bands` around the wind's axis.
inline double sphere_error(uint64_t paths, uint32_t seed, uint32_t rings = 64) {
    GrainScene scene;
    const unsigned id = scene.add(grain_sphere({0.0, 2.0, 0.0}, 1.0, rings));
    scene.commit();
    GrainSettings s = even_grains(paths);
    s.seed = seed;
    const WornMesh mesh = scene.worn(id);
    const GrainResult result = traced(scene, mesh, s);
    constexpr int bands = 16;
    std::array<double, bands> wear{}, expected{};
    for (size_t f = 0; f < mesh.triangle_count; ++f) {
        std::array<Vec3d, 3> p;
        for (int k = 0; k < 3; ++k) {
            const float* v = mesh.vertices + 3 * size_t(mesh.triangles[3 * f + size_t(k)]);
            p[size_t(k)] = Vec3d(v[0], v[1], v[2]);
        }
        Vec3d n = (p[1] - p[0]).cross(p[2] - p[0]);
        const double area = 0.5 * n.norm();
        if (!(area > 1e-12)) continue;
        n /= 2.0 * area;
        const Vec3d middle = (p[0] + p[1] + p[2]) / 3.0 - Vec3d(0.0, 2.0, 0.0);
        if (n.dot(middle) < 0.0) n = -n;
        const double sine = std::max(-n.x(), 0.0);
        const auto band = size_t(std::clamp(int(bands * (1.0 - sine)), 0, bands - 1));
        wear[band] += result.triangles[f] * area;
        expected[band] +=
            area * flux_of(s) * sine * wearing_energy(s, 0.5 * s.speed * s.speed, sine) / s.energy_per_volume;
    }
    double error = 0.0, sum = 0.0;
    for (size_t k = 0; k < bands; ++k) error += std::abs(wear[k] - expected[k]), sum += expected[k];
    return error / sum;
}

// ---- a post: the kink of the energy with height ----

// Height of the most worn strip of a post (in strips of 1 cm), and its height by the documentation in
// grains.cpp.
inline std::array<double, 2> post_kink(uint64_t paths) {
    GrainScene scene;
    const unsigned id =
        scene.add(grain_plate(Vec3d::Zero(), Vec3d(0.0, 0.6, 0.0), Vec3d(0.0, 0.0, 0.1), 60, 1));
    scene.commit();
    GrainSettings s = even_grains(paths);
    const GrainSettings usual;
    s.height = usual.height, s.speed = usual.speed, s.bed_speed = usual.bed_speed;
    s.speed_height = usual.speed_height, s.threshold_speed = 0.0, s.ground = 0.0;
    const GrainResult result = traced(scene, scene.worn(id), s);
    size_t most = 0;
    for (size_t k = 0; k < 60; ++k)
        if (result.triangles[2 * k] + result.triangles[2 * k + 1] >
            result.triangles[2 * most] + result.triangles[2 * most + 1])
            most = k;
    const double r = s.speed_height / s.height;
    const double kink = -s.speed_height * std::log(s.speed / (s.speed - s.bed_speed) / (1.0 + 2.0 / r));
    return {0.01 * (double(most) + 0.5), kink};
}

// ---- a step on a plain: its shadow, along parabolas ----

struct StepWear {
    std::vector<double> wear, expected; // in strips of 5 cm behind the step
    GrainReport report;
};

// Sand up to the step, rock behind it. A grain that lands at d with vertical speed w passed the step's edges
// at x = d and x = d + b upwind, where its height was w x / v - g (x / v)^2 / 2. So for both edges
// w >= h v / x + g x / (2 v). The flux through the plain is q / v w times the normal density of w.
inline StepWear step_wear(uint64_t paths, uint32_t seed, double step = 0.1, uint32_t strips = 40) {
    constexpr double broad = 0.3, strip = 0.05;
    GrainScene scene;
    const Vec3d side(0.0, 0.0, 1.0);
    const unsigned sand = scene.add(grain_plate({-1.5, 0.0, 0.0}, {1.5 - broad, 0.0, 0.0}, side));
    if (step > 0.0) {
        scene.add(grain_plate({-broad, 0.0, 0.0}, {0.0, step, 0.0}, side));
        scene.add(grain_plate({-broad, step, 0.0}, {broad, 0.0, 0.0}, side));
        scene.add(grain_plate({0.0, 0.0, 0.0}, {0.0, step, 0.0}, side));
    } else {
        scene.add(grain_plate({-broad, 0.0, 0.0}, {broad, 0.0, 0.0}, side));
    }
    const unsigned rock = scene.add(grain_plate(Vec3d::Zero(), {strip * strips, 0.0, 0.0}, side, strips, 1));
    scene.commit();
    GrainSettings s;
    s.paths = paths, s.seed = seed;
    s.speed = s.bed_speed = 6.0;
    s.normal_restitution = s.tangent_restitution = 0.0;
    s.threshold_speed = 0.5;
    s.path_error = 1e-3;
    s.ground = -1e-4;
    std::vector<unsigned> sands = {sand};
    if (step <= 0.0) sands.push_back(sand + 1);
    s.sand = sands;
    const GrainResult result = traced(scene, scene.worn(rock), s);
    StepWear out;
    out.report = result.report;
    const double spread = s.gravity * s.height, least = 0.5 * s.threshold_speed * s.threshold_speed;
    const auto density = [&](double d) {
        double energy = least;
        for (const double x :
             {d, step > 0.0 ? d + broad : d}) { // without a step: hops that start on the sand
            const double w = step * s.speed / x + s.gravity * x / (2.0 * s.speed);
            energy = std::max(energy, 0.5 * w * w);
        }
        return flux_of(s) / s.speed / std::sqrt(2.0 * pi * spread) * spread * std::exp(-energy / spread) *
               (energy - least + spread) / s.energy_per_volume;
    };
    for (uint32_t k = 0; k < strips; ++k) {
        out.wear.push_back(0.5 * (result.triangles[2 * k] + result.triangles[2 * k + 1]));
        double mean = 0.0;
        for (int i = 0; i < 64; ++i) mean += density(strip * (k + (i + 0.5) / 64.0)) / 64.0;
        out.expected.push_back(mean);
    }
    return out;
}

inline double step_error(const StepWear& step) {
    double error = 0.0, sum = 0.0;
    for (size_t k = 0; k < step.wear.size(); ++k)
        error += std::abs(step.wear[k] - step.expected[k]), sum += step.expected[k];
    return error / sum;
}

// ---- a cavity that grains rebound in ----

// Mean wear of each of 4 x 4 fields of the five walls: back, floor, roof, sides.
inline std::vector<double> cavity_wear(uint64_t paths, uint32_t seed, GrainReport* report = nullptr) {
    constexpr uint32_t cells = 4;
    GrainScene scene;
    GrainShape all;
    const auto add = [&](const Vec3d& corner, const Vec3d& u, const Vec3d& v) {
        const GrainShape wall = grain_plate(corner, u, v, cells, cells);
        const auto first = uint32_t(all.vertices.size() / 3);
        all.vertices.insert(all.vertices.end(), wall.vertices.begin(), wall.vertices.end());
        for (const uint32_t k : wall.triangles) all.triangles.push_back(first + k);
    };
    const Vec3d x(1.0, 0.0, 0.0), y(0.0, 0.5, 0.0), z(0.0, 0.0, 0.5);
    add(x, y, z), add(Vec3d::Zero(), x, z), add(y, x, z), add(Vec3d::Zero(), x, y), add(z, x, y);
    const unsigned id = scene.add(std::move(all));
    scene.commit();
    GrainSettings s;
    s.paths = paths, s.seed = seed;
    s.height = 0.3, s.speed = s.bed_speed = 10.0, s.threshold_speed = 0.5, s.ground = 0.0;
    const GrainResult result = traced(scene, scene.worn(id), s);
    if (report) *report = result.report;
    std::vector<double> fields(5 * cells * cells);
    for (size_t k = 0; k < fields.size(); ++k)
        fields[k] = 0.5 * (result.triangles[2 * k] + result.triangles[2 * k + 1]);
    return fields;
}

inline double relative_error(const std::vector<double>& a, const std::vector<double>& b) {
    double error = 0.0, sum = 0.0;
    for (size_t k = 0; k < a.size(); ++k) error += std::abs(a[k] - b[k]), sum += std::abs(b[k]);
    return error / sum;
}

// Slope of log(RMS error over seeds) over log(paths), by least squares.
inline double error_slope(const std::function<double(uint64_t, uint32_t)>& error,
                          std::span<const uint64_t> paths, uint32_t seeds) {
    double n = 0.0, sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
    for (const uint64_t count : paths) {
        double square = 0.0;
        for (uint32_t seed = 0; seed < seeds; ++seed) {
            const double e = error(count, seed + 1);
            square += e * e / seeds;
        }
        const double x = std::log(double(count)), y = 0.5 * std::log(square);
        n += 1.0, sx += x, sy += y, sxx += x * x, sxy += x * y;
    }
    return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

} // namespace marram::testing
