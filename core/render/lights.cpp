// SPDX-License-Identifier: Apache-2.0
// Sampling lights.
//
// One light is chosen, half of the probability spread evenly and half by an estimate of the irradiance it
// causes in the scene, so that none is starved. Densities are per solid angle and contain the choice.
//
// Sun: uniform in the cone of half angle a. 1 - cos a = 2 sin^2(a/2) keeps its digits however small a is; a
// direction at
//   1 - cos = w has sin = sqrt(w (2 - w)). Irradiance E perpendicular to it gives radiance E / (pi sin^2 a).
//   A disc so small that unit vectors in float cannot tell its inside is a delta light.
// Sky: uniform azimuth, height y from a table: equal steps of y are equal solid angles (Archimedes).
// Environment: square blocks of pixels by the integral of the bilinear interpolant over them, uniform in azimuth and cosine
//   inside a block. A pixel's mean is (1 6 1)/8 in both directions, so that it is 0 only where the interpolant is. The coarser
//   a table, the more of it stays in the fastest cache, so blocks are as large as the map allows: with pixels of radiance L_i
//   and solid angle a_i in a block of L, a, an estimate of all of the map has the relative second moment
//     sum over blocks of L a sum(L_i^2 a_i / (L^2 a)) / sum(L a),
//   1 were the density exact, and may have 1 + table_variance. Shadows and shaders vary by far more.
// Emitting meshes: uniform by area over all triangles of the light as they are mid-shutter; a triangle's own
// area enters the
//   density at the ray's time: P(triangle) / area(t) . distance^2 / cos. Uniform point: Turk, "Graphics
//   Gems", 1990.
#include "core/render/lights.h"

#include "core/math/float4.h"

#include <type_traits>

namespace marram {

namespace {

constexpr double least_disc = 64.0 * 0x1p-23; // radians; a float direction is off by up to 1 % of that
constexpr size_t sky_cells = 512;
constexpr float ground_blend = 0.1F;
constexpr double table_variance = 0.005;
constexpr uint32_t largest_shift = 6; // blocks of 64 pixels each way

double mean_of(const Vec3f& color) { return color.cast<double>().sum() / 3.0; }

// Column and row, in pixels from the image's top left corner, of a direction. Float: a direction is no more exact, and a
// thousandth of a pixel of the widest image is not seen.
Vec2f pixel_of(const EnvironmentLight& map, const Vec3f& d) {
    // The second is the angle from +y; not by its cosine, which has no digits left at the poles.
    const Float4 angles =
        fast_atan2(Float4{d.x(), std::sqrt(d.x() * d.x() + d.z() * d.z())}, Float4{-d.z(), d.y()});
    constexpr float turn = static_cast<float>(2.0 * pi);
    float u = 0.5F + (angles[0] + static_cast<float>(map.rotation)) / turn;
    u -= std::floor(u);
    const float v = angles[1] / static_cast<float>(pi);
    return {u * static_cast<float>(map.width), v * static_cast<float>(map.height)};
}

size_t cell_of(float at, uint32_t count) {
    return std::min(static_cast<size_t>(at), static_cast<size_t>(count) - 1);
}

// column: at most one beyond either end.
const Vec3f& texel(const EnvironmentLight& map, int64_t column, int64_t row) {
    const int64_t width = map.width, height = map.height;
    if (column < 0) column += width;
    if (column >= width) column -= width;
    row = std::clamp<int64_t>(row, 0, height - 1);
    return map.pixels[static_cast<size_t>(row * width + column)];
}

// pixel: as pixel_of says.
Vec3f radiance_at(const EnvironmentLight& map, const Vec2f& pixel) {
    const Vec2f at = pixel - Vec2f(0.5F, 0.5F);
    const float left = std::floor(at.x()), above = std::floor(at.y());
    const int64_t column = static_cast<int64_t>(left), row = static_cast<int64_t>(above);
    const float x = at.x() - left, y = at.y() - above;
    const Vec3f &a = texel(map, column, row), &b = texel(map, column + 1, row);
    const Vec3f &c = texel(map, column, row + 1), &d = texel(map, column + 1, row + 1);
    const Vec3f top = a + x * (b - a), bottom = c + x * (d - c);
    return map.strength * (top + y * (bottom - top));
}

} // namespace

Vec3f sky_radiance(const SkyLight& sky, const Vec3f& direction) {
    const float y = direction.y();
    Vec3f color;
    if (y >= 0.0F) {
        const float down = 1.0F - std::min(y, 1.0F);
        color = sky.horizon + (1.0F - down * down * down) * (sky.zenith - sky.horizon);
    } else {
        const float t = std::min(-y / ground_blend, 1.0F);
        color = sky.horizon + t * t * (3.0F - 2.0F * t) * (sky.ground - sky.horizon);
    }
    return sky.strength * color;
}

Vec3f environment_radiance(const EnvironmentLight& map, const Vec3f& direction) {
    return radiance_at(map, pixel_of(map, direction));
}

Lights::Sun Lights::make(const SunLight& light) {
    const double half = 0.5 * light.angle, rise = 2.0 * std::sin(0.5 * half) * std::sin(0.5 * half);
    Sun sun{light.direction.normalized(),
            {},
            {},
            half,
            rise,
            light.irradiance,
            1.0F,
            half < least_disc,
            light.visible};
    orthonormal_basis(sun.direction, sun.x, sun.y);
    if (!sun.delta) {
        sun.radiance = light.irradiance / static_cast<float>(pi * std::sin(half) * std::sin(half));
        sun.pdf = static_cast<float>(1.0 / (2.0 * pi * rise));
    }
    return sun;
}

Lights::Sky Lights::make(const SkyLight& light) {
    std::vector<double> weights(sky_cells);
    const auto at = [&](double y) {
        return mean_of(sky_radiance(light, Vec3f(0.0F, static_cast<float>(y), 0.0F)));
    };
    for (size_t i = 0; i < sky_cells; ++i) { // Simpson's rule; positive wherever the sky is
        const double y0 = -1.0 + 2.0 * static_cast<double>(i) / sky_cells, step = 2.0 / sky_cells;
        weights[i] = (at(y0) + 4.0 * at(y0 + 0.5 * step) + at(y0 + step)) / 6.0;
    }
    return {light, Distribution1D(weights)};
}

namespace {

// Of each pixel, the mean of the interpolant.
std::vector<double> pixel_means(const EnvironmentLight& map) {
    std::vector<double> means(static_cast<size_t>(map.width) * map.height);
    for (int64_t row = 0; row < map.height; ++row)
        for (int64_t column = 0; column < map.width; ++column) {
            double sum = 0.0;
            for (int64_t dy = -1; dy <= 1; ++dy)
                for (int64_t dx = -1; dx <= 1; ++dx)
                    sum += mean_of(texel(map, column + dx, row + dy)) * (dx == 0 ? 0.75 : 0.125) *
                           (dy == 0 ? 0.75 : 0.125);
            means[static_cast<size_t>(row * map.width + column)] = sum * map.strength;
        }
    return means;
}

// Blocks of 2^shift pixels each way; the last ones of rows and columns may be smaller.
struct Blocks {
    uint32_t shift;
    size_t columns, rows;
    std::vector<double> light, squares; // sums of L a, L^2 a
};

Blocks empty_blocks(const EnvironmentLight& map, uint32_t shift) {
    const size_t columns = ((size_t(map.width) - 1) >> shift) + 1,
                 rows = ((size_t(map.height) - 1) >> shift) + 1;
    return {shift, columns, rows, std::vector<double>(columns * rows), std::vector<double>(columns * rows)};
}

// dphi (cos t0 - cos t1). cosines: of the borders of the pixels' rows.
double solid_angle(const EnvironmentLight& map, std::span<const double> cosines, uint32_t shift,
                   size_t column, size_t row) {
    const auto border = [&](size_t block, uint32_t pixels) {
        return std::min<size_t>(block << shift, pixels);
    };
    const double share = double(border(column + 1, map.width) - border(column, map.width)) / map.width;
    return 2.0 * pi * share * (cosines[border(row, map.height)] - cosines[border(row + 1, map.height)]);
}

Blocks blocks_of_four(const EnvironmentLight& map, std::span<const double> means,
                      std::span<const double> cosines) {
    Blocks sums = empty_blocks(map, 1);
    for (size_t row = 0; row < map.height; ++row) {
        const double angle = solid_angle(map, cosines, 0, 0, row);
        for (size_t column = 0; column < map.width; ++column) {
            const double mean = means[row * map.width + column];
            const size_t at = (row >> 1) * sums.columns + (column >> 1);
            sums.light[at] += mean * angle;
            sums.squares[at] += mean * mean * angle;
        }
    }
    return sums;
}

Blocks coarser(const EnvironmentLight& map, const Blocks& blocks) {
    Blocks sums = empty_blocks(map, blocks.shift + 1);
    for (size_t row = 0; row < blocks.rows; ++row)
        for (size_t column = 0; column < blocks.columns; ++column) {
            const size_t from = row * blocks.columns + column, to = (row >> 1) * sums.columns + (column >> 1);
            sums.light[to] += blocks.light[from];
            sums.squares[to] += blocks.squares[from];
        }
    return sums;
}

// What sampling by these blocks adds to the relative second moment.
double added_variance(const EnvironmentLight& map, std::span<const double> cosines, const Blocks& blocks) {
    double total = 0.0, moment = 0.0;
    for (size_t i = 0; i < blocks.light.size(); ++i) {
        if (!(blocks.light[i] > 0.0)) continue;
        const double angle = solid_angle(map, cosines, blocks.shift, i % blocks.columns, i / blocks.columns);
        total += blocks.light[i];
        moment += blocks.squares[i] * (angle / blocks.light[i]);
    }
    return total > 0.0 ? moment / total - 1.0 : 0.0;
}

} // namespace

Lights::Environment Lights::make(const EnvironmentLight& light) {
    std::vector<double> cosines(light.height + size_t(1));
    for (size_t row = 0; row < cosines.size(); ++row)
        cosines[row] = std::cos(pi * double(row) / light.height);
    std::vector<double> weights = pixel_means(light);
    uint32_t shift = 0;
    size_t columns = light.width;
    for (Blocks next = blocks_of_four(light, weights, cosines);
         next.shift <= largest_shift && added_variance(light, cosines, next) <= table_variance;
         next = coarser(light, next)) {
        shift = next.shift;
        columns = next.columns;
        weights = next.light;
    }
    const auto angle = [&](size_t i) { return solid_angle(light, cosines, shift, i % columns, i / columns); };
    if (shift == 0)
        for (size_t i = 0; i < weights.size(); ++i) weights[i] *= angle(i);
    Environment map{light, shift, columns, Distribution2D(weights, columns), {}, {}};
    map.image.rotation = std::remainder(light.rotation, 2.0 * pi); // many turns would cost digits
    for (size_t row = 0; row <= weights.size() / columns; ++row)
        map.cosines.push_back(cosines[std::min<size_t>(row << shift, light.height)]);
    map.densities.reserve(weights.size());
    for (size_t i = 0; i < weights.size(); ++i)
        map.densities.push_back(
            static_cast<float>(map.by_block.probability(i % columns, i / columns) / angle(i)));
    return map;
}

Lights::Emitter Lights::make(const MeshLight& light, uint32_t index, const World& world) {
    Emitter emitter;
    emitter.radiance = light.radiance;
    std::vector<double> areas;
    for (uint32_t mesh = 0; mesh < world.meshes.size(); ++mesh) {
        if (world.meshes[mesh].light != static_cast<int>(index)) continue;
        emitter.first_of_mesh.emplace_back(mesh, areas.size());
        for (uint32_t triangle = 0; triangle < world.meshes[mesh].triangles.size(); ++triangle) {
            const float area = mesh_point(world, mesh, triangle, Vec2f::Zero(), 0.5F).area;
            emitter.triangles.push_back({mesh, triangle});
            areas.push_back(std::isfinite(area) ? area : 0.0);
        }
    }
    emitter.by_area = Distribution1D(areas);
    return emitter;
}

double Lights::power(const Table& table, double scene_radius) {
    if (const Sun* sun = std::get_if<Sun>(&table)) {
        const double sine = std::sin(sun->half_angle);
        return mean_of(sun->radiance) * (sun->delta ? 1.0 : pi * sine * sine);
    }
    if (const Sky* sky = std::get_if<Sky>(&table)) return pi * sky->by_height.total() / sky_cells;
    if (const Environment* map = std::get_if<Environment>(&table)) return 0.25 * map->by_block.total();
    const Emitter& emitter = *std::get_if<Emitter>(&table);
    if (emitter.triangles.empty()) return 0.0;
    return mean_of(emitter.radiance) * emitter.by_area.total() / (scene_radius * scene_radius);
}

Lights::Lights(std::span<const LightDescription> descriptions, const World& world) : world_(&world) {
    for (uint32_t i = 0; i < descriptions.size(); ++i) {
        const LightDescription& light = descriptions[i];
        if (const MeshLight* mesh = std::get_if<MeshLight>(&light)) {
            tables_.emplace_back(make(*mesh, i, world));
            continue;
        }
        infinite_.push_back(i);
        if (const SunLight* sun = std::get_if<SunLight>(&light)) tables_.emplace_back(make(*sun));
        if (const SkyLight* sky = std::get_if<SkyLight>(&light)) tables_.emplace_back(make(*sky));
        if (const EnvironmentLight* map = std::get_if<EnvironmentLight>(&light))
            tables_.emplace_back(make(*map));
    }
    const double size =
        world.bounds.isEmpty() ? 1.0 : 0.5 * static_cast<double>(world.bounds.diagonal().norm());
    std::vector<double> powers;
    double total = 0.0;
    for (const Table& table : tables_) total += powers.emplace_back(power(table, size > 0.0 ? size : 1.0));
    if (!(total > 0.0)) return; // nothing shines: nothing to sample
    for (double& p : powers) p = p > 0.0 ? 0.5 / static_cast<double>(powers.size()) + 0.5 * p / total : 0.0;
    choice_ = Distribution1D(powers);
}

void Lights::sample_sun(const Sun& sun, float a, float b, LightSample& sample) {
    sample.delta = sun.delta;
    sample.radiance = sun.radiance;
    sample.pdf = sun.pdf;
    const double w = sun.delta ? 0.0 : sun.rise * a;
    const double sine = std::sqrt(w * (2.0 - w));
    Float4 sin_phi, cos_phi;
    fast_sin_cos(Float4{} + static_cast<float>(2.0 * pi) * b, sin_phi, cos_phi);
    sample.direction =
        (sine * (double(cos_phi[0]) * sun.x + double(sin_phi[0]) * sun.y) + (1.0 - w) * sun.direction)
            .normalized()
            .cast<float>();
}

void Lights::sample_sky(const Sky& sky, float a, float b, LightSample& sample) {
    const Distribution1D::Choice at = sky.by_height.sample(b);
    const double y = -1.0 + 2.0 * (static_cast<double>(at.cell) + at.within) / sky_cells;
    const double sine = std::sqrt(std::max(0.0, 1.0 - y * y)), phi = 2.0 * pi * a;
    sample.direction = Vec3d(sine * std::cos(phi), y, sine * std::sin(phi)).cast<float>();
    sample.radiance = sky_radiance(sky.colors, sample.direction);
    sample.pdf = static_cast<float>(sky.by_height.probability(at.cell) * sky_cells / (4.0 * pi));
}

void Lights::sample_environment(const Environment& map, float a, float b, LightSample& sample) {
    const Distribution2D::Choice at = map.by_block.sample(a, b);
    const double top = map.cosines[at.row], y = top + at.y * (map.cosines[at.row + 1] - top);
    const size_t left = at.column << map.shift;
    const double columns =
        static_cast<double>(std::min<size_t>(size_t(1) << map.shift, map.image.width - left));
    const float column = static_cast<float>(static_cast<double>(left) + at.x * columns);
    const float azimuth =
        static_cast<float>(2.0 * pi) * (column / static_cast<float>(map.image.width) - 0.5F) -
        static_cast<float>(map.image.rotation);
    const float sine = static_cast<float>(std::sqrt(std::max(0.0, 1.0 - y * y)));
    Float4 sin_azimuth, cos_azimuth;
    fast_sin_cos(Float4{} + azimuth, sin_azimuth, cos_azimuth);
    sample.direction = Vec3f(sine * sin_azimuth[0], static_cast<float>(y), -sine * cos_azimuth[0]);
    const float row = fast_atan2(sine, sample.direction.y()) / static_cast<float>(pi) *
                      static_cast<float>(map.image.height);
    sample.radiance = radiance_at(map.image, {column, row});
    sample.pdf = map.densities[at.row * map.columns + at.column];
}

void Lights::sample_emitter(const Emitter& emitter, const Vec3d& from, float time, float a, float b,
                            LightSample& sample) const {
    sample.at_infinity = false;
    if (emitter.triangles.empty()) return;
    const Distribution1D::Choice at = emitter.by_area.sample(a);
    const EmittingTriangle& triangle = emitter.triangles[at.cell];
    const float root = static_cast<float>(std::sqrt(at.within));
    const SurfacePoint point =
        mesh_point(*world_, triangle.mesh, triangle.triangle, {root * (1.0F - b), root * b}, time);
    const Vec3d normal = point.geometric_normal.cast<double>();
    sample.target = point.position + 2.0 * point.error * normal;
    const Vec3d way = from - sample.target;
    const double distance2 = way.squaredNorm(), cosine = way.dot(normal) / std::sqrt(distance2);
    if (!(cosine > 0.0) || !(point.area > 0.0F)) return;
    sample.radiance = emitter.radiance;
    sample.pdf = static_cast<float>(emitter.by_area.probability(at.cell) / point.area * distance2 / cosine);
}

LightSample Lights::sample(const Vec3d& from, float time, const std::array<float, 3>& random) const {
    const Distribution1D::Choice choice = choice_.sample(random[0]);
    const Table& table = tables_[choice.cell];
    LightSample sample;
    const float a = random[1], b = random[2];
    if (const Sun* sun = std::get_if<Sun>(&table)) sample_sun(*sun, a, b, sample);
    if (const Sky* sky = std::get_if<Sky>(&table)) sample_sky(*sky, a, b, sample);
    if (const Environment* map = std::get_if<Environment>(&table)) sample_environment(*map, a, b, sample);
    if (const Emitter* emitter = std::get_if<Emitter>(&table))
        sample_emitter(*emitter, from, time, a, b, sample);
    sample.pdf *= static_cast<float>(choice_.probability(choice.cell));
    sample.unused = static_cast<float>(choice.within);
    return sample;
}

Lights::Seen Lights::seen_along(uint32_t light, const Vec3f& direction, bool visible_only) const {
    const Table& table = tables_[light];
    const float chosen = empty() ? 0.0F : static_cast<float>(choice_.probability(light));
    if (const Sun* sun = std::get_if<Sun>(&table)) {
        const bool inside = (direction.cast<double>() - sun->direction).squaredNorm() <= 2.0 * sun->rise;
        if (sun->delta || !inside || (visible_only && !sun->visible)) return {};
        return {sun->radiance, chosen * sun->pdf};
    }
    if (const Sky* sky = std::get_if<Sky>(&table)) {
        if (visible_only && !sky->colors.visible) return {};
        const double y = std::clamp(static_cast<double>(direction.y()), -1.0, 1.0);
        const size_t cell = std::min(static_cast<size_t>(0.5 * (y + 1.0) * sky_cells), sky_cells - 1);
        return {sky_radiance(sky->colors, direction),
                chosen * static_cast<float>(sky->by_height.probability(cell) * sky_cells / (4.0 * pi))};
    }
    const Environment& map = *std::get_if<Environment>(&table);
    if (visible_only && !map.image.visible) return {};
    const Vec2f at = pixel_of(map.image, direction);
    const size_t column = cell_of(at.x(), map.image.width), row = cell_of(at.y(), map.image.height);
    return {radiance_at(map.image, at),
            chosen * map.densities[(row >> map.shift) * map.columns + (column >> map.shift)]};
}

Lights::Seen Lights::emitted(const SurfacePoint& point, const Vec3f& direction) const {
    if (point.light < 0 || static_cast<size_t>(point.light) >= tables_.size()) return {};
    const Emitter* emitter = std::get_if<Emitter>(&tables_[static_cast<size_t>(point.light)]);
    const float cosine = -point.geometric_normal.dot(direction);
    if (!emitter || !(cosine > 0.0F) || empty()) return {};
    for (const auto& [mesh, first] : emitter->first_of_mesh) {
        if (mesh != point.geometry) continue;
        const double chosen = choice_.probability(static_cast<size_t>(point.light)) *
                              emitter->by_area.probability(first + point.primitive);
        const double distance = point.distance;
        return {emitter->radiance, static_cast<float>(chosen / point.area * distance * distance / cosine)};
    }
    return {};
}

} // namespace marram
