// SPDX-License-Identifier: Apache-2.0
// The view-dependent render mesh of a terrain.
#include "procedural/terrain/surface.h"

#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"

#include <fmt/format.h>

#include <array>

namespace marram {
namespace {

// The smallest angle that a pixel of a pinhole camera subtends: that of the corner pixel.
double min_pixel(const MarramView& view) {
    const double up = std::tan(0.5 * view.fov), pixel = 2.0 * up / view.height;
    const double across = up * view.width / view.height;
    return pixel / (1.0 + up * up + across * across);
}

MeshTolerance tolerance_of(const MarramView& view) {
    MeshTolerance tolerance;
    tolerance.metres = view.tolerance;
    // The relative error of shading on level ground is this divided by tan(sun elevation): 3.5 % at 30
    // degrees.
    constexpr double slope = 0.02;
    tolerance.gradient = slope;
    if (view.tolerance > 0.0) return tolerance;
    constexpr double half = 0.5; // a pixel
    tolerance.pixels = view.tolerance_pixels > 0.0 ? view.tolerance_pixels : half;
    tolerance.pixel_angle = min_pixel(view);
    for (uint32_t t = 0; t < view.time_count; ++t) tolerance.cameras.emplace_back(view.positions + 3 * t);
    return tolerance;
}

// The region in which ripples too fine for the grid are displaced.
DisplacedRegion displaced_region(const RipplesLayer& ripples, const MarramView& view) {
    const RipplesLayer::Settings& settings = ripples.settings();
    DisplacedRegion region;
    const double up = std::tan(0.5 * view.fov), across = up * view.width / view.height;
    region.corner = std::atan(std::sqrt(up * up + across * across));
    region.pixel_angle = min_pixel(view);
    if (settings.displaced > 0.0)
        region.reach = settings.ripples.height / (settings.displaced * region.pixel_angle);
    constexpr double sides_per_wavelength =
        8.0; // triangle sides: two to three on the steep third of a ripple
    region.side = settings.ripples.wavelength / sides_per_wavelength;
    for (uint32_t t = 0; t < view.time_count; ++t)
        region.cameras.push_back({Vec3d(view.positions + 3 * t), Vec3d(view.directions + 3 * t)});
    return region;
}

// Sets the values of midpoint vertices to the mean of their two parent vertices, which come first.
void fill_midpoints(const DicedMesh& mesh, uint32_t components, float* values) {
    float* out = values + size_t(mesh.first) * components;
    for (const auto& [a, b] : mesh.midpoints)
        for (uint32_t c = 0; c < components; ++c)
            *out++ = 0.5F * (values[size_t(a) * components + c] + values[size_t(b) * components + c]);
}

// Makes averaged normals unit length.
void normalize_midpoints(const DicedMesh& mesh, float* normals) {
    for (size_t v = mesh.first; v < mesh.first + mesh.midpoints.size(); ++v) {
        Eigen::Map<Vec3f> normal(normals + 3 * v);
        normal.normalize(); // never 0: both parents point up
    }
}

// Displaces vertices by their ripples and adjusts the normals (NULL: none). Output `share`: the fraction of
// the ripples left to shading.
void displace(const RipplesLayer& ripples, const DisplacedRegion& region,
              std::span<const RipplesLayer::RippleInputs> carried, float* positions, float* normals,
              std::span<float> share) {
    constexpr size_t block = 64;
    marram::parallel_for(tbb::blocked_range<size_t>(0, carried.size(), block), [&](const auto& range) {
        std::array<RipplePoint, block> points;
        std::array<double, block> metres{};
        std::array<Vec2d, block> slopes;
        for (size_t first = range.begin(); first < range.end(); first += block) {
            const size_t count = std::min(block, range.end() - first);
            for (size_t k = 0; k < count; ++k) {
                const size_t v = first + k;
                const Vec3d at = Eigen::Map<const Vec3f>(positions + 3 * v).cast<double>();
                const double displaced = region.share(at);
                share[v] = float(1.0 - displaced);
                points[k] = {{at.x(), at.z()},
                             ripples.settings().wind,
                             carried[v].gradient.cast<double>(),
                             displaced * double(carried[v].strength)};
            }
            ripples.field().displacements({points.data(), count}, {metres.data(), count},
                                          {slopes.data(), count});
            for (size_t k = 0; k < count; ++k) {
                if (metres[k] == 0.0 && slopes[k] == Vec2d::Zero()) continue;
                const size_t v = first + k;
                const Vec2d& gradient = points[k].gradient;
                const Vec3d across = Vec3d(-gradient.x(), 1.0, -gradient.y()).normalized();
                for (int axis = 0; axis < 3; ++axis)
                    positions[3 * v + size_t(axis)] += float(metres[k] * across[axis]);
                if (!normals) continue;
                // The gradient of the height changes by slope / across.y, so n = (-g, 1) across.y changes by
                // -slope.
                Eigen::Map<Vec3f> normal(normals + 3 * v);
                normal = (normal.cast<double>() - Vec3d(slopes[k].x(), 0.0, slopes[k].y()))
                             .normalized()
                             .cast<float>();
            }
        }
    });
}

} // namespace

void TerrainView::take(const MarramView& given) {
    const size_t count = given.time_count;
    times.assign(given.times, given.times + count);
    positions.assign(given.positions, given.positions + 3 * count);
    directions.assign(given.directions, given.directions + 3 * count);
    ups.assign(given.ups, given.ups + 3 * count);
    view = given;
    view.times = times.data();
    view.positions = positions.data();
    view.directions = directions.data();
    view.ups = ups.data();
}

namespace {

uint64_t view_digest(uint64_t terrain, const MarramView& view) {
    const size_t bytes = 3 * sizeof(double) * view.time_count;
    const std::array numbers{view.fov, view.tolerance, view.tolerance_pixels};
    return Digest()
               .add(terrain)
               .add(view.positions, bytes)
               .add(view.directions, bytes)
               .add(view.ups, bytes)
               .add(numbers.data(), sizeof numbers)
               .add(view.width)
               .add(view.height)
               .value() |
           1U;
}

MarramOutput make_view(TerrainInstance& instance, const MarramView& view) {
    ViewRenderMesh& seen = instance.seen;
    seen = {};
    RenderMesh mesh = mesh_terrain(instance.domain, instance.heights.data(), tolerance_of(view));
    const RipplesLayer* ripples = ripples_of(instance);
    if (ripples && !ripples->resolved()) seen.region = displaced_region(*ripples, view);
    if (seen.region.reach > 0.0) {
        std::vector<Vec3d> positions(mesh.samples.size());
        for (size_t v = 0; v < positions.size(); ++v) {
            const size_t sample = mesh.samples[v], nx = size_t(instance.domain.nx);
            positions[v] = {instance.domain.x(int(sample % nx)), double(instance.heights[sample]),
                            instance.domain.z(int(sample / nx))};
        }
        seen.mesh = dice(positions, mesh.triangles, seen.region);
        if (seen.mesh.reach < seen.region.reach)
            send(
                instance.host, MARRAM_WARNING, "terrain.displacement", "",
                fmt::format("ripples are displaced within {:.3g} m of the camera, not {:.3g}: there would be "
                            "more than {} million triangles",
                            seen.mesh.reach, seen.region.reach, 16),
                "raise `displaced` of the ripples layer");
        seen.region.reach = seen.mesh.reach;
    } else {
        seen.mesh = {uint32_t(mesh.samples.size()), {}, std::move(mesh.triangles), 0.0};
    }
    seen.samples = std::move(mesh.samples);
    MarramOutput output{};
    output.kind = MARRAM_MESH;
    output.time_count = 1;
    output.vertex_count = uint32_t(seen.samples.size() + seen.mesh.midpoints.size());
    output.triangle_count = uint32_t(seen.mesh.triangles.size() / 3);
    output.has_uvs = output.has_normals = 1;
    return output;
}

} // namespace

// Reuses the output of an unchanged digest: the host may have kept that mesh. If it asks for the mesh,
// write_view() makes it again.
MarramOutput begin_view(TerrainInstance& instance, const MarramView& view) {
    TerrainView& kept = instance.view;
    const uint64_t digest = view_digest(instance.output_digest, view);
    if (kept.output.digest != digest) {
        kept.output = {};
        kept.take(view);
        kept.output = make_view(instance, kept.view);
        kept.output.digest = digest;
    }
    kept.begun = true;
    return kept.output;
}

void write_view(TerrainInstance& instance, MarramMeshBuffers& buffers) {
    if (instance.seen.samples.empty()) make_view(instance, instance.view.view);
    const ViewRenderMesh& seen = instance.seen;
    const DicedMesh& mesh = seen.mesh;
    float* positions = buffers.positions[0];
    float* normals = MARRAM_HAS(&buffers, normals) && buffers.normals ? buffers.normals[0] : nullptr;
    write_vertices(instance, seen.samples, positions, normals, buffers.uvs);
    fill_midpoints(mesh, 3, positions);
    if (normals) fill_midpoints(mesh, 3, normals), normalize_midpoints(mesh, normals);
    if (buffers.uvs) fill_midpoints(mesh, 2, buffers.uvs);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), buffers.triangles);

    const RipplesLayer* ripples = ripples_of(instance);
    const uint32_t first = first_ripples_attribute(instance);
    std::vector<RipplesLayer::RippleInputs> carried;
    std::vector<float> share;
    if (ripples) {
        carried.resize(seen.samples.size() + mesh.midpoints.size());
        share.assign(carried.size(), 1.0F);
        if (!ripples->resolved())
            ripples->carried(instance.stack->fields(), seen.samples, std::span(carried).first(mesh.first));
        for (size_t k = 0; k < mesh.midpoints.size(); ++k) {
            const auto &a = carried[mesh.midpoints[k][0]], &b = carried[mesh.midpoints[k][1]];
            carried[mesh.first + k] = {0.5F * (a.gradient + b.gradient), 0.5F * (a.strength + b.strength)};
        }
        if (seen.region.reach > 0.0) displace(*ripples, seen.region, carried, positions, normals, share);
    }
    for (uint32_t a = 0; a < buffers.attribute_count; ++a) {
        const uint32_t attribute = buffers.attributes[a];
        if (attribute >= first) {
            write_ripples(*ripples, attribute - first, carried, share, buffers.attribute_values[a]);
            continue;
        }
        write_attribute(instance, attribute, seen.samples, buffers.attribute_values[a]);
        fill_midpoints(mesh, 1, buffers.attribute_values[a]);
    }
    instance.seen = {};
    instance.view.begun = false;
}

} // namespace marram
