// SPDX-License-Identifier: Apache-2.0
// Options of commands that read scenes on several machines.
#pragma once

#include "core/cli/commands.h"
#include "core/scene/path_map.h"

#include <CLI/CLI.hpp>

namespace marram {

// --map and --map-file. Rules of --map come first.
void add_path_map(CLI::App& command, PathMap& paths);

// --samples, --crop, --after and --keep-state, after --seconds and --png have been added.
void add_parts(CLI::App& command, RenderOptions& options);

// --claim and --lease, after --resume, --watch and --seconds have been added. Returns --lease.
CLI::Option* add_claim(CLI::App& command, RenderOptions& options);

void add_pack_options(CLI::App& command, PackOptions& options);

} // namespace marram
