// SPDX-License-Identifier: Apache-2.0
// The entry point of libmarram_rock.so, which procedural/loaded_rock.cpp looks up.
#include "procedural/erosion/rock_library.h"

#include "procedural/abi/entry_points.h"
#include "procedural/erosion/rock_instance.h"

extern "C" __attribute__((visibility("default"))) const marram::RockLibrary* marram_rock_library() {
    using namespace marram;
    static const RockLibrary library{MARRAM_VERSION, sizeof(RockLibrary), EntryPoints<RockInstance>::table()};
    return &library;
}
