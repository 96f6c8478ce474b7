// SPDX-License-Identifier: Apache-2.0
// The code of the rock is in a library of its own, libmarram_rock.so, which is loaded when the first rock is created: it
// needs OpenVDB, which few scenes do. This library has the rock's declaration and passes calls on.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/erosion/rock_declaration.h"

namespace marram {

// In place of EntryPoints<RockInstance>. create() reports a library that cannot be loaded.
struct LoadedRock {
    using Declaration = RockDeclaration;
    static MarramProcedural table();
};

} // namespace marram
