// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/material_checks.h"

#include "core/math/udim.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <tuple>

namespace marram {
namespace {

// Geometry that a material is assigned to: a mesh of the scene, or the output of a procedural.
struct MaterialUse {
    const Item& item;
    const Procedural* procedural; // nullptr for a mesh of the scene
    bool is_mesh, moves;
};

// The material itself and, if it is a blend, all materials that it blends, recursively.
std::vector<size_t> blended_materials(const Shot& shot, size_t material) {
    std::vector<size_t> parts = {material};
    for (size_t i = 0; i < parts.size(); ++i)
        if (const auto* blend = std::get_if<BlendSettings>(&shot.materials[parts[i]].settings))
            for (const int part : blend->materials)
                if (std::ranges::find(parts, size_t(part)) == parts.end()) parts.push_back(size_t(part));
    return parts;
}

// Errors and warnings for a material on a mesh.
void check_on_mesh(const Item& material, const MaterialUse& use, std::vector<Problem>& warnings) {
    const auto shader = std::ranges::find(shaders(), material.type, &ShaderDescription::name);
    if (shader->strands_only)
        throw InputError(use.item.params.at("material").place,
                         fmt::format("'{}' of type {} works on strands only, but '{}' is a mesh",
                                     material.name, material.type, use.item.name),
                         "give it another material, such as one of type surface");
    if (material.type == "sand" && use.moves)
        warnings.push_back(
            {use.item.place,
             fmt::format("'{}' moves: its sand's ripples and glints stay where they are in the world",
                         use.item.name),
             "", "material.moving_sand"});
}

bool is_black(const Material& material) {
    return !material.mapped && evaluate(bsdf_at(material, ShadingPoint{}), Vec3f::UnitZ()).value.isZero(0.0F);
}

// A line for a shadow catcher whose material reflects nothing: a shadow is a share of what it reflects.
void check_catcher(const Shot& shot, size_t mesh, std::vector<Problem>& warnings) {
    const SceneMesh& catcher = shot.geometry.meshes[mesh];
    if (!catcher.shadow_catcher || catcher.material < 0) return;
    for (const size_t part : blended_materials(shot, size_t(catcher.material)))
        if (const Material& material = shot.materials[part];
            !std::holds_alternative<BlendSettings>(material.settings) && !is_black(material))
            return;
    const Item& item = shot.description.materials[size_t(catcher.material)];
    warnings.push_back(
        {item.place, fmt::format("'{}' reflects nothing, so '{}' catches no shadow", item.name, catcher.name),
         "give it a color", "material.black_catcher"});
}

// The attributes that a material reads, as pairs of parameter and attribute name.
std::vector<std::pair<const char*, std::string>> wanted_attributes_of(const Material& material) {
    std::vector<std::pair<const char*, std::string>> wanted;
    if (!material.tint_attribute.empty()) wanted.emplace_back("tint", material.tint_attribute);
    if (const auto* blend = std::get_if<BlendSettings>(&material.settings))
        wanted.emplace_back("attribute", blend->attribute);
    return wanted;
}

void check_attributes(const Item& material, const Material& settings, const MaterialUse& use) {
    for (const auto& [parameter, wanted] : wanted_attributes_of(settings)) {
        const Place& place = material.params.at(parameter).place;
        if (!use.procedural)
            throw InputError(
                place,
                fmt::format("'{}' reads an attribute, but the mesh '{}' has none", material.name,
                            use.item.name),
                fmt::format("leave {} out, or use the material on what a procedural makes", parameter));
        std::vector<std::string> known;
        for (const MarramAttribute& attribute : use.procedural->attributes())
            if (attribute.components == 1) known.emplace_back(attribute.name);
        if (std::ranges::find(known, wanted) == known.end())
            throw InputError(place,
                             fmt::format("'{}' has no attribute '{}' of one number to {} by", use.item.name,
                                         wanted, std::string_view(parameter) == "tint" ? "tint" : "blend"),
                             known.empty() ? fmt::format("leave {} out", parameter)
                                           : fmt::format("choose among {}", fmt::join(known, ", ")));
    }
}

// Whether the curves that a procedural takes from a file have the attribute root_uv.
bool file_has_root_uv(const Shot& shot, const Item& procedural) {
    const ParamValue* curves = procedural.params.find("curves");
    if (!curves) return false;
    const auto named = std::ranges::find(shot.geometry.curves, curves->text, &SceneCurves::name);
    return named != shot.geometry.curves.end() &&
           std::ranges::any_of(named->attributes, [](const AttributeValues& attribute) {
               return attribute.name == "root_uv" && attribute.components == 2 &&
                      attribute.rate == MARRAM_PER_CURVE;
           });
}

[[noreturn]] void reject_image(const Item& material, const Item& procedural) {
    const char* map = "color_map";
    for (const char* other : {"roughness_map", "specular_map"})
        if (!material.params.has(map)) map = other;
    throw InputError(material.params.at(map).place,
                     fmt::format("'{}' has an image, but the strands of '{}' have no uv at their roots",
                                 material.name, procedural.name),
                     "grow them on a mesh that has uvs, or leave the image out");
}

// Images on strands are looked up at the uv of their roots, so the mesh below must have uvs. Meshes made by
// procedurals are checked after the world is built, see check_root_uvs().
void check_root_uv(const Shot& shot, const Item& material, const MaterialUse& use) {
    const auto attributes = use.procedural->attributes();
    const bool has = std::ranges::any_of(attributes, [](const MarramAttribute& attribute) {
        return std::string_view(attribute.name) == "root_uv" && attribute.components == 2;
    });
    const ParamValue* mesh = use.item.params.find("on");
    const auto named = mesh ? std::ranges::find(shot.geometry.meshes, mesh->text, &SceneMesh::name)
                            : shot.geometry.meshes.end();
    const bool without = named != shot.geometry.meshes.end() && named->mesh.uvs.empty();
    if (!has || (without && !file_has_root_uv(shot, use.item))) reject_image(material, use.item);
}

} // namespace

std::vector<Problem> check_materials(const Shot& shot) {
    std::vector<Problem> warnings;
    const std::vector<Item>& materials = shot.description.materials;
    // A tinted material may also be on meshes, which have no attributes, if it is on some procedural, too.
    std::vector<bool> on_procedural(materials.size());
    for (const auto& procedural : shot.geometry.procedurals)
        if (procedural->material >= 0)
            for (const size_t part : blended_materials(shot, size_t(procedural->material)))
                on_procedural[part] = true;
    const auto check = [&](int material, const MaterialUse& use) {
        if (material < 0) return;
        for (const size_t part : blended_materials(shot, size_t(material))) {
            if (use.is_mesh) check_on_mesh(materials[part], use, warnings);
            if (!use.is_mesh && shot.materials[part].mapped) check_root_uv(shot, materials[part], use);
            const bool blend = std::holds_alternative<BlendSettings>(shot.materials[part].settings);
            if (use.procedural || blend || !on_procedural[part])
                check_attributes(materials[part], shot.materials[part], use);
        }
    };
    for (size_t i = 0; i < shot.description.meshes.size(); ++i) { // instances share their mesh's material
        const SceneMesh& mesh = shot.geometry.meshes[i];
        const bool moves = std::ranges::any_of(shot.geometry.meshes, [&](const SceneMesh& other) {
            return &other.object() == &mesh && other.moves();
        });
        check(mesh.material, {shot.description.meshes[i], nullptr, true, moves});
        check_catcher(shot, i, warnings);
    }
    for (size_t i = 0; i < shot.geometry.procedurals.size(); ++i) {
        const Procedural& procedural = *shot.geometry.procedurals[i];
        check(procedural.material,
              {shot.description.procedurals[i], &procedural, procedural.kind() == MARRAM_MESH, false});
    }
    return warnings;
}

void check_root_uvs(const Shot& shot, const World& world) {
    for (size_t i = 0; i < shot.geometry.procedurals.size(); ++i) {
        const Procedural& procedural = *shot.geometry.procedurals[i];
        const Item& item = shot.description.procedurals[i];
        const ParamValue* on = item.params.find("on");
        if (procedural.kind() == MARRAM_MESH || procedural.material < 0 || !on ||
            file_has_root_uv(shot, item))
            continue;
        const auto mesh = std::ranges::find(world.meshes, on->text, &MeshGeometry::name);
        if (mesh == world.meshes.end() ||
            !world.growth_surface(uint32_t(mesh - world.meshes.begin())).uvs.empty())
            continue;
        for (const size_t part : blended_materials(shot, size_t(procedural.material)))
            if (shot.materials[part].mapped) reject_image(shot.description.materials[part], item);
    }
}

namespace {

using UvSquare = std::pair<int, int>;

// Calls visit(uv) at the centroids of the n^2 equal triangles that a triangle is divided into.
template <typename Visit>
void visit_centroids(const Vec2f& a, const Vec2f& b, const Vec2f& c, int n, Visit&& visit) {
    const auto at = [&](float i, float j) {
        return Vec2f(a + (i * (b - a) + j * (c - a)) / static_cast<float>(n));
    };
    constexpr float third = 1.0F / 3.0F;
    for (int i = 0; i < n; ++i)
        for (int j = 0; i + j < n; ++j) {
            visit(at(float(i) + third, float(j) + third));
            if (i + j + 1 < n) visit(at(float(i) + 2.0F * third, float(j) + 2.0F * third));
        }
}

// The unit squares of scaled uv that a geometry uses: by the centroids of triangles (those that exceed a
// square are divided), by the roots of strands.
std::set<UvSquare> uv_squares(const World& world, size_t geometry, const Vec2f& scale) {
    constexpr size_t max_squares = 4096;
    constexpr float most_pieces = 64.0F; // of the side of a triangle
    std::set<UvSquare> squares;
    const auto add = [&](const Vec2f& uv) {
        if (uv.allFinite() && uv.cwiseAbs().maxCoeff() < 1e6F && squares.size() < max_squares)
            squares.emplace(int(std::floor(uv.x())), int(std::floor(uv.y())));
    };
    if (geometry < world.meshes.size()) {
        const MeshGeometry& mesh = world.meshes[geometry];
        if (mesh.uvs.empty()) return squares;
        const auto scaled = [&](uint32_t v) { return Vec2f(mesh.uvs[v].cwiseProduct(scale)); };
        for (const auto& [ia, ib, ic] : mesh.triangles) {
            if (squares.size() >= max_squares) break;
            const Vec2f a = scaled(ia), b = scaled(ib), c = scaled(ic);
            const float extent = (a.cwiseMax(b).cwiseMax(c) - a.cwiseMin(b).cwiseMin(c)).maxCoeff();
            const float pieces = extent > 1.0F ? std::min(std::ceil(2.0F * extent), most_pieces) : 1.0F;
            visit_centroids(a, b, c, int(pieces), add);
        }
        return squares;
    }
    const CurveGeometry& curves = world.curves[geometry - world.meshes.size()];
    const AttributeValues* uvs = find_attribute(curves.attributes, "root_uv");
    if (curves.lazy) return squares; // nobody knows yet where its strands stand
    for (size_t i = 0; uvs && uvs->components == 2 && i + 1 < uvs->values.size(); i += 2)
        add(Vec2f(uvs->values[i], uvs->values[i + 1]).cwiseProduct(scale));
    return squares;
}

std::string tile_name(const UvSquare& square) {
    const auto& [u, v] = square;
    return u >= 0 && u < 10 && v >= 0 ? fmt::format("{}", udim_number(u, v))
                                      : fmt::format("uv ({}, {})", u, v);
}

// A warning if an image lacks tiles that are used, or is a single tile that repeats over others, unless
// map_scale asks for that.
std::optional<Problem> tile_warning(const Item& material, const ParamValue& image,
                                    const std::set<UvSquare>& squares, const std::string& geometry) {
    if (!has_udim(image.text)) {
        const std::string pattern = udim_pattern(image.text);
        const bool alone = squares.empty() || (squares.size() == 1 && squares.contains({0, 0}));
        const bool repeats_as_told =
            material.params.text("map_wrap") != "auto" || material.params.vec2("map_scale") != Vec2d::Ones();
        if (pattern.empty() || alone || repeats_as_told) return std::nullopt;
        return Problem{
            image.place,
            fmt::format("\"{}\" is named as one tile, and repeats over the other squares of the uv of '{}'",
                        image.text, geometry),
            fmt::format("write \"{}\" for all tiles, or map_wrap = \"repeat\"", pattern), "image.one_tile"};
    }
    std::set<UvSquare> there;
    for (const UdimTile& tile : udim_tiles(image.text)) there.emplace(tile.u, tile.v);
    std::vector<std::string> missing;
    for (const UvSquare& square : squares)
        if (!there.contains(square) && missing.size() < 10) missing.push_back(tile_name(square));
    if (missing.empty()) return std::nullopt;
    return Problem{image.place,
                   fmt::format("\"{}\" has no tile {}, which '{}' uses: it is black there", image.text,
                               fmt::join(missing, ", "), geometry),
                   fmt::format("add the file, or move the uvs{}",
                               material.params.vec2("map_scale") == Vec2d::Ones() ? "" : " or map_scale"),
                   "image.missing_tile"};
}

} // namespace

std::vector<Problem> check_tiles(const Shot& shot, const World& world) {
    std::vector<Problem> warnings;
    for (size_t geometry = 0; geometry < world.meshes.size() + world.curves.size(); ++geometry) {
        const bool is_mesh = geometry < world.meshes.size();
        const auto& [name, index] =
            is_mesh ? std::tie(world.meshes[geometry].name, world.meshes[geometry].material)
                    : std::tie(world.curves[geometry - world.meshes.size()].name,
                               world.curves[geometry - world.meshes.size()].material);
        if (index < 0) continue;
        for (const size_t part : blended_materials(shot, size_t(index))) {
            std::optional<std::set<UvSquare>> squares;
            for (const char* map : {"color_map", "roughness_map", "specular_map"}) {
                const Item& material = shot.description.materials[part];
                const ParamValue* image = material.params.find(map);
                if (!image || image->text.empty() || !material.params.has(map)) continue;
                if (!has_udim(image->text) && udim_pattern(image->text).empty()) continue;
                if (!squares)
                    squares = uv_squares(world, geometry, material.params.vec2("map_scale").cast<float>());
                std::optional<Problem> warning = tile_warning(material, *image, *squares, name);
                if (warning && std::ranges::find(warnings, *warning) == warnings.end())
                    warnings.push_back(*std::move(warning));
            }
        }
    }
    return warnings;
}

} // namespace marram
