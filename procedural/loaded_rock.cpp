// SPDX-License-Identifier: Apache-2.0
#include "procedural/loaded_rock.h"

#include "core/math/own_library.h"
#include "procedural/abi/entry_points.h"
#include "procedural/erosion/rock_library.h"

#include <stdexcept>
#include <string>
#include <type_traits>

namespace marram {
namespace {

// Loads the library at the first call. Throws std::runtime_error if it cannot.
const MarramProcedural& rock_table() {
    static const auto& library =
        load_own_library<RockLibrary>("libmarram_rock.so", rock_library_entry, MARRAM_VERSION);
    return library.rock;
}

MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    if (!can_create(host, out)) return MARRAM_ERROR;
    const MarramStatus status =
        guarded(known_part(host), RockDeclaration::name, RockDeclaration::memory_remedy, [] {
            try {
                rock_table();
            } catch (const std::runtime_error& error) {
                throw SceneFault("rock.library", "",
                                 std::string("the library of rocks cannot be loaded (") + error.what() + ")",
                                 "build it with scenes/setup marram_rock, or install Marram again");
            }
        });
    return status == MARRAM_OK ? rock_table().create(host, values, out) : status;
}

// Passes the call of a member function of an instance on. There is an instance only if the library is loaded.
template <auto member>
struct PassOn;
template <typename Result, typename... Arguments,
          Result (*MarramProcedural::*member)(MarramInstance*, Arguments...)>
struct PassOn<member> {
    static Result call(MarramInstance* instance, Arguments... arguments) {
        if (instance) return (rock_table().*member)(instance, arguments...);
        if constexpr (!std::is_void_v<Result>) return MARRAM_ERROR;
    }
};

} // namespace

// Passes on what EntryPoints<RockInstance> has: a member that RockInstance gets needs a line here.
MarramProcedural LoadedRock::table() {
    MarramProcedural procedural = declared<RockDeclaration>(MARRAM_MESH);
    procedural.create = create;
    procedural.update = PassOn<&MarramProcedural::update>::call;
    procedural.prepare = PassOn<&MarramProcedural::prepare>::call;
    procedural.begin = PassOn<&MarramProcedural::begin>::call;
    procedural.mesh = PassOn<&MarramProcedural::mesh>::call;
    procedural.report = PassOn<&MarramProcedural::report>::call;
    procedural.destroy = PassOn<&MarramProcedural::destroy>::call;
    return procedural;
}

} // namespace marram
