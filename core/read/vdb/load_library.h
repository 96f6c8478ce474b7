// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/read/vdb/level_set_library.h"

namespace marram {

// libmarram_level_set.so, loaded on first use. Throws InputError about the file `path` if it cannot be
// loaded.
const LevelSetLibrary& level_set_library(const std::string& path);

} // namespace marram
