// SPDX-License-Identifier: Apache-2.0
// Bakes a frame: settings to build it without motion; then writes its strands, or the surface or grids of a
// terrain.
//
//   check_baked_formats(settings), check_baked_attributes(shot, settings.attributes)
//   World world = build_world(shot.geometry, build_settings_for_bake(shot, settings, frame), ...)
//   write_baked(shot, world, settings, file)
#pragma once

#include "core/shot/shot.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct BakeSettings {
    std::string output;                  // its extension chooses the format
    std::string colliders;               // .obj or .usda; "" for none
    std::string what;                    // "terrain" (or rock), "strands"; "": as the format prefers
    std::optional<Vec2d> range;          // low, high: heights in metres that are black and white in a .png
    std::string stage = "final";         // of the strands: rest, bent, final
    std::vector<std::string> attributes; // of curves, besides id
};

// Throws InputError for a format that is not written, or cannot hold what the settings name, and for an empty
// range.
void check_baked_formats(const BakeSettings& settings);

// Throws InputError if the format holds strands and the scene makes none. After check_baked_formats().
void check_baked_strands(const Shot& shot, const BakeSettings& settings);

// Throws InputError for a name that is not an attribute of any curves of the scene.
void check_baked_attributes(const Shot& shot, const std::vector<std::string>& names);

BuildSettings build_settings_for_bake(const Shot& shot, const BakeSettings& settings, double frame);

// The mesh whose grids write_baked() writes as an image. file: as for write_baked(). Throws InputError if
// there is none, or more than one.
const MeshGeometry& mesh_of_heights(const World& world, const std::string& file);

// Writes the strands. For the formats of images, and for .obj and .ply of a scene without strands, writes the
// only mesh with grids; for .ply also if the scene has both. file: settings.output with the number of the
// frame. Throws InputError if the world has nothing for this format, if settings.attributes are asked of a
// surface, or if the file cannot be written. settings.what decides between strands and a surface where a
// format holds both. Returns warnings: that the scene has the other as well, and heights outside
// settings.range.
std::vector<Problem> write_baked(const Shot& shot, const World& world, const BakeSettings& settings,
                                 const std::string& file);

// file: settings.colliders with the number of the frame; "" writes nothing.
void write_colliders(const World& world, const std::string& file, double fps);

} // namespace marram
