// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/plugin/marram_plugin.h"

#include <cstddef>

namespace marram {

// What libmarram_rock.so exports: core/math/own_library.h.
struct RockLibrary {
    const char* version;
    size_t size;
    MarramProcedural rock;
};
inline constexpr const char* rock_library_entry = "marram_rock_library";

} // namespace marram
