// SPDX-License-Identifier: Apache-2.0
#include "core/shot/material_checks.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {
namespace {

// What materials cannot do on a mesh.
void check_on_mesh(const Item& material, const Item& item, bool moves, std::vector<std::string>& warnings) {
    const auto shader = std::ranges::find(shaders(), material.type, &ShaderDescription::name);
    if (shader->strands_only)
        throw InputError(item.params.at("material").place,
                         fmt::format("'{}' is a mesh, and '{}' of type {}, which strands alone can have",
                                     item.name, material.name, material.type),
                         "give it another material, such as one of type surface");
    if (material.type == "sand" && moves)
        warnings.push_back(
            fmt::format("{}: '{}' moves: its sand's ripples and glints stay where they are in the world",
                        to_string(item.place), item.name));
}

} // namespace

// A material tints by an attribute that the curves it is on carry, of one number.
std::vector<std::string> check_materials(const Shot& shot) {
    std::vector<std::string> warnings;
    const auto& materials = shot.description.materials;
    std::vector<const Item*> on_mesh(materials.size());
    std::vector<bool> on_strands(materials.size());
    for (size_t i = 0; i < shot.geometry.meshes.size(); ++i) {
        const SceneMesh& mesh = shot.geometry.meshes[i];
        if (mesh.material < 0) continue;
        on_mesh[size_t(mesh.material)] = &shot.description.meshes[i];
        check_on_mesh(materials[size_t(mesh.material)], shot.description.meshes[i], mesh.moves(), warnings);
    }
    for (size_t i = 0; i < shot.geometry.procedurals.size(); ++i) {
        const Procedural& procedural = *shot.geometry.procedurals[i];
        if (procedural.material < 0) continue;
        if (procedural.type().kind == MARRAM_MESH) {
            on_mesh[size_t(procedural.material)] = &shot.description.procedurals[i];
            check_on_mesh(materials[size_t(procedural.material)], shot.description.procedurals[i], false,
                          warnings);
        } else {
            on_strands[size_t(procedural.material)] = true;
        }
    }
    for (size_t i = 0; i < materials.size(); ++i)
        if (!shot.materials[i].tint.empty() && on_mesh[i] && !on_strands[i])
            throw InputError(
                materials[i].params.at("tint").place,
                fmt::format("'{}' tints by an attribute of strands, but is on the mesh '{}' alone",
                            materials[i].name, on_mesh[i]->name),
                "leave tint out");
    for (const auto& procedural : shot.geometry.procedurals) {
        const MarramProcedural& type = procedural->type();
        if (procedural->material < 0 || type.kind == MARRAM_MESH) continue;
        const std::string& tint = shot.materials[size_t(procedural->material)].tint;
        if (tint.empty()) continue;
        const Item& material = materials[size_t(procedural->material)];
        std::vector<std::string> known;
        for (uint32_t i = 0; i < type.attribute_count; ++i)
            if (type.attributes[i].components == 1) known.emplace_back(type.attributes[i].name);
        if (std::ranges::find(known, tint) == known.end())
            throw InputError(
                material.params.at("tint").place,
                fmt::format("'{}' has no attribute '{}' of one number to tint by", procedural->name(), tint),
                fmt::format("choose among {}", fmt::join(known, ", ")));
    }
    return warnings;
}

} // namespace marram
