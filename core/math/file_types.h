// SPDX-License-Identifier: Apache-2.0
// The types of files that are read and written, by extension. Checks, messages and readers use these lists;
// what is special about a type is where it is read or written.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

namespace marram {

inline constexpr std::string_view mesh_files[] = {".obj", ".ply", ".vdb"};
inline constexpr std::string_view polyline_files[] = {".obj", ".ply", ".usda"};
inline constexpr std::string_view strand_files[] = {".hair", ".usda", ".ply", ".obj"}; // read and written
inline constexpr std::string_view attribute_files[] = {".usda", ".ply"}; // strand_files with any attributes
inline constexpr std::string_view surface_files[] = {".obj", ".ply"};    // of procedurals, written
inline constexpr std::string_view collider_files[] = {".obj", ".usda"};  // all meshes of a scene, written
inline constexpr std::string_view grid_files[] = {".exr", ".png", ".tif", ".tiff"};
inline constexpr std::string_view picture_files[] = {".exr", ".png"}; // rendered
inline constexpr std::string_view image_files[] = {".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".hdr"};

// In lower case, with the point: ".obj" of "a.OBJ". "": none.
std::string extension_of(std::string_view path);

bool is_one_of(std::string_view extension, std::span<const std::string_view> types);

// ".obj, .ply or .vdb"
std::string listed_files(std::span<const std::string_view> types);

} // namespace marram
