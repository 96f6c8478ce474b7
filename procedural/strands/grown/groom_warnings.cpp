// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/groom_warnings.h"

#include "core/math/problem.h"
#include "core/math/udim.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace marram {
namespace {

std::string short_number(double value) { return fmt::format("{:.3g}", value); }

} // namespace

// Invisible strands are allowed but reported.
void warn_invisible_strands(const MarramHost& host, const Values& given, const Groom& groom) {
    const auto warn = [&](const char* name, const char* what, const char* remedy) {
        send(host, MARRAM_WARNING, "groom.invisible", given.at(name).place, what, remedy);
    };
    if (groom.width == 0.0)
        warn("width", "width is 0, no strand will be seen", "give the diameter in metres");
    if (std::ranges::all_of(groom.width_profile.values(), [](double share) { return share == 0.0; }))
        warn("width_profile", "width_profile is 0 everywhere, no strand will be seen", "raise a value");
    if (!groom.guides && groom.length[1] == 0.0)
        warn("length", "length is 0, no strand will be seen", "give metres");
}

void warn_of_ignored(const MarramHost& host, const Values& given, const Groom& groom) {
    const auto warn = [&](const std::string& place, const std::string& what, const char* remedy) {
        send(host, MARRAM_WARNING, "groom.ignored", place, what, remedy);
    };
    for (const char* name : {"comb", "comb_map"})
        if (groom.guides && given.has(name))
            warn(given.at(name).place,
                 std::string(name) + " has no effect: guides define the direction of strands",
                 "leave it out, or leave guides out");
    const struct {
        FactorOf of;
        const char* name;
        bool ignored;
        const char* because;
    } factors[] = {
        {of_lean, "lean_by", groom.guides.has_value(), "guides define the shape of strands"},
        {of_arc, "arc_by", groom.guides.has_value(), "guides define the shape of strands"},
        {of_curl, "curl_by", groom.curl_radius == 0.0, "curl.radius is 0"},
        {of_clump, "clump_by", groom.clumps.empty(), "clump.size is 0"},
        {of_frizz, "frizz_by", groom.frizz_amplitude == 0.0, "frizz.amplitude is 0"},
    };
    for (const auto& factor : factors)
        if (factor.ignored && !groom.factors[factor.of].empty())
            warn(groom.factors[factor.of][0].place,
                 std::string(factor.name) + " changes nothing: " + factor.because, "leave it out");
}

// Tiles that the mesh uses and an image lacks; a single tile that repeats over others.
void warn_of_tiles(GroomInstance& instance) {
    const std::vector<ScalarImage*> images = images_of(instance.groom);
    if (images.empty()) return;
    const Surface mesh = instance.poses(0).bind;
    std::set<std::pair<int64_t, int64_t>> squares; // of uv, by the triangles' centroids
    for (uint32_t t = 0; t < mesh.triangle_count; ++t) {
        const Vec2d uv = mesh.uv(t, Vec3d::Constant(1.0 / 3.0));
        if (uv.allFinite() && uv.cwiseAbs().maxCoeff() < 1e6)
            squares.emplace(int64_t(std::floor(uv.x())), int64_t(std::floor(uv.y())));
    }
    const bool repeats =
        instance.groom.images_repeat.value_or(squares.size() > 1 || !squares.contains({0, 0}));
    std::set<std::string> reported; // a file once, whatever its channels
    for (const ScalarImage* image : images) {
        const auto warn = [&](const std::string& what, const std::string& remedy) {
            if (reported.insert(image->file()).second)
                send(instance.host, MARRAM_WARNING, "groom.tiles", image->place(), what, remedy);
        };
        const std::string pattern = udim_pattern(image->file());
        if (!image->tiled() && !pattern.empty() && repeats && !instance.groom.images_repeat)
            warn("\"" + image->file() +
                     "\" is named as one tile, and repeats over the other squares of the uv of '" +
                     instance.groom.mesh + "'",
                 "write \"" + pattern + "\" for all tiles, or image_wrap = \"repeat\"");
        if (!image->tiled()) continue;
        std::string missing;
        for (const auto& [u, v] : squares)
            if (!image->has_tile(u, v))
                missing +=
                    fmt::format("{}{}", missing.empty() ? "" : ", ",
                                u >= 0 && u < 10 && v >= 0 ? std::to_string(udim_number(int(u), int(v)))
                                                           : fmt::format("uv ({}, {})", u, v));
        if (!missing.empty())
            warn("\"" + image->file() + "\" has no tile " + shortened(missing, 100) + ", where '" +
                     instance.groom.mesh + "' has triangles: it is 0 there",
                 "add the files, or move the uvs");
    }
}

void warn_of_no_strands(const GroomInstance& instance) {
    if (instance.roots.empty() && instance.sample.empty())
        send(instance.host, MARRAM_WARNING, "groom.no_strands", instance.groom.count_place,
             "no strands: the density, or the density times the masks, is 0 or almost 0", "raise it");
}

void warn_of_covered_roots(const GroomInstance& instance, std::span<const Cover> covers, uint64_t of) {
    std::string meshes;
    uint64_t covered = 0;
    for (const Cover& cover : covers) {
        covered += cover.roots;
        if (cover.roots > 0)
            meshes += fmt::format("{}{} at '{}', one at ({:.4g}, {:.4g}, {:.4g})", meshes.empty() ? "" : "; ",
                                  cover.roots, cover.mesh, cover.place.x(), cover.place.y(), cover.place.z());
    }
    if (meshes.empty()) return;
    if (instance.covered_roots == 0)
        return send(instance.host, MARRAM_WARNING, "groom.covered", instance.groom.mesh_place,
                    fmt::format("{} of {} strands stay, though another mesh covers their roots, because the "
                                "instances of '{}' have the same strands: {}",
                                covered, of, instance.groom.mesh, meshes),
                    "give the groom a density_mask, write copies of the mesh instead of instances, or give "
                    "the groom clear_of = \"none\"");
    send(instance.host, MARRAM_WARNING, "groom.covered", instance.groom.mesh_place,
         fmt::format("{} of {} strands are left out, because another mesh covers their roots: {}",
                     instance.covered_roots, of, meshes),
         "give the groom clear_of = \"none\" to keep them, or the mesh collides = false");
}

void warn_beyond_guides(const GroomInstance& instance, uint64_t left_out, uint64_t of) {
    if (left_out == 0) return;
    const double reach = instance.guides->reach(), by_spacing = instance.guides->default_reach();
    // A reach much below the spacing is no length to start from.
    const double farther = std::max(2.0 * reach, by_spacing);
    const bool useful = std::isfinite(farther);
    send(instance.host, MARRAM_WARNING, "groom.beyond_guides", instance.groom.guides->place,
         fmt::format(
             "{:.3g} % of the strands ({} of {}) are left out: their roots are beyond the reach of the "
             "guides, {:.3g} m{}",
             100.0 * double(left_out) / double(of), left_out, of, reach,
             instance.groom.guides->reach ? "" : " by their spacing"),
         fmt::format("{} to grow them farther out, add guides, or use a density mask",
                     useful ? fmt::format("give guides.reach = {:.2g}", farther)
                            : std::string("leave out guides.reach")));
}

void warn_of_guides(const GroomInstance& instance, const Binding& binding) {
    if (const RootProblem problem = root_problem(binding, "guides", instance.groom.mesh); !problem.id.empty())
        send(instance.host, MARRAM_WARNING, ("groom.guides_" + problem.id).c_str(),
             instance.groom.guides->place, problem.what, problem.fix);
}

// A length in the wrong unit: every ray meets every strand, and rendering takes hours.
void warn_of_length(const GroomInstance& instance) {
    constexpr double much = 1e4; // times the size of the mesh
    constexpr size_t many = 100;
    Eigen::AlignedBox3d box;
    for (size_t v = 0; v < instance.mesh->vertex_count; ++v)
        box.extend(Eigen::Map<const Vec3f>(instance.mesh->positions[0] + 3 * v).cast<double>());
    const double length = longest_strand(instance.groom), size = box.diagonal().norm();
    if (instance.roots.size() < many || !(length > much * size)) return;
    const std::string what = fmt::format("strands are up to {:.3g} m long on a mesh of {:.3g} m, and "
                                         "rendering will be slow",
                                         length, size);
    instance.warn("groom.length", what, "check the unit of length");
}

// Positions are floats: far from the origin, strands are visibly rounded to a grid.
void warn_of_rounding(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    Eigen::AlignedBox3d on_mesh, box;
    for (size_t v = 0; v < mesh.vertex_count; ++v)
        on_mesh.extend(Eigen::Map<const Vec3f>(mesh.positions[0] + 3 * v).cast<double>());
    if (on_mesh.isEmpty()) return;
    for (const MeshInstance& mesh_instance : instance.mesh_instances)
        box.extend(transformed_box(mesh_instance.transform(0), on_mesh));
    const double farthest = std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff());
    const double float_spacing = farthest * 0x1p-23;
    const double segment = longest_strand(instance.groom) / (instance.groom.cvs - 1);
    const double finest = instance.groom.width > 0.0 ? std::min(instance.groom.width, segment) : segment;
    constexpr double seen = 0.1; // visible rounding, as a fraction of a width or segment
    if (!(float_spacing > seen * finest) || !(finest > 0.0)) return;
    const std::string what = "positions " + short_number(farthest) + " m from the origin are rounded to " +
                             short_number(float_spacing) + " m, which shows on strands " +
                             short_number(instance.groom.width) + " m wide with segments of " +
                             short_number(segment) + " m";
    instance.warn("groom.rounding", what, "move the scene to the origin, or use larger units");
}

} // namespace marram
