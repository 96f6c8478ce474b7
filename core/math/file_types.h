// SPDX-License-Identifier: Apache-2.0
// The types of files that are read and written, by extension. Checks, messages and readers use these lists;
// rules of single formats stay in their readers and writers.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

namespace marram {

inline constexpr std::string_view mesh_files[] = {".obj", ".ply", ".vdb"};
inline constexpr std::string_view polyline_files[] = {".obj", ".ply", ".usda"};
inline constexpr std::string_view strand_files[] = {".hair", ".usda", ".ply", ".obj"};
inline constexpr std::string_view image_files[] = {".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".hdr"};

inline constexpr std::string_view baked_strand_files[] = {".hair", ".usda", ".ply", ".obj"};
inline constexpr std::string_view baked_attribute_files[] = {".usda", ".ply"}; // of those, with attributes
inline constexpr std::string_view baked_surface_files[] = {".obj", ".ply"};    // and .vdb, of a rock
inline constexpr std::string_view baked_collider_files[] = {".obj", ".usda"};  // all meshes of a scene
inline constexpr std::string_view baked_grid_files[] = {".exr", ".png", ".tif", ".tiff"};
inline constexpr std::string_view picture_files[] = {".exr", ".png"}; // rendered

// In lower case, with the point: ".obj" of "a.OBJ". "": none.
std::string extension_of(std::string_view path);

bool is_one_of(std::string_view extension, std::span<const std::string_view> types);

// ".obj, .ply or .vdb"
std::string listed_files(std::span<const std::string_view> types);

} // namespace marram
