// SPDX-License-Identifier: Apache-2.0
// The files that a scene names, with the values that name them, and digests of them.
#pragma once

#include "core/shot/shot.h"

#include <cstdint>
#include <string>
#include <vector>

namespace marram {

enum class NamedFileKind {
    single,
    tiles,  // "fur.<UDIM>.png"
    frames, // "hill.####.obj"
};

// The files of one value of the scene.
struct NamedFiles {
    std::string key; // of the value, as --set has it: "mesh.hill.file"
    const ParamValue* value = nullptr;
    NamedFileKind kind = NamedFileKind::single;
    std::vector<std::string> files; // paths to open: one, or those of the tiles or frames
    bool is_library() const { return value->spec->choices == "library"; }
};

// In the order of the description. Pointers into shot.description.
std::vector<NamedFiles> named_files(const Shot& shot);

// A digest of the contents of each file, 0 for one that cannot be read. Files are read in parallel, in
// blocks: a mapped file that another process cuts would end this process.
std::vector<uint64_t> content_digests(const std::vector<std::string>& files);

// A digest of all files. It does not depend on the folders that they lie in, nor on the times of copies: of
// single files and tiles it covers the contents, and the extension or the tile's number. Members of a
// numbered sequence are covered by name without folder, size and time of change: there may be thousands, of
// many GB in all, and to read them again only for their digest would be too slow.
uint64_t files_digest(const std::vector<NamedFiles>& all);

} // namespace marram
