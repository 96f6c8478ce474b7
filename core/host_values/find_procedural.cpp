// SPDX-License-Identifier: Apache-2.0
// The functions of core/plugin/marram_host.h that find a procedural in a library. Cost: microseconds, and the
// loading of the library.
#include "core/host_values/declarations.h"
#include "core/host_values/interface.h"
#include "core/math/known_part.h"
#include "core/scene/suggest.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>

namespace marram {
namespace {

MarramStatus refuse(const MarramHost* host, const char* id, std::string what, std::string fix) {
    say(host, {{}, std::move(what), std::move(fix), id});
    return MARRAM_ERROR;
}

MarramStatus find(const MarramLibrary* given, uint32_t embree_major, const std::string& name,
                  const MarramHost* host, MarramProcedural* out, size_t size) {
    if (const auto fault = library_fault(given, embree_major))
        return refuse(host, "host.library", "the library " + fault->what, fault->fix);
    const MarramLibrary library = known_part(given);
    const size_t stride = library.procedural_stride;
    std::vector<std::string> names;
    for (uint32_t i = 0; library.procedurals && i < library.procedural_count; ++i) {
        const auto* one = MARRAM_AT(MarramProcedural, library.procedurals, stride, i);
        if (!one->name) continue;
        names.emplace_back(one->name);
        if (names.back() != name) continue;
        const std::string why = known_type(known_parts(one, 1, uint32_t(stride))[0]).unusable;
        if (!why.empty())
            return refuse(host, "host.procedural", fmt::format("{} cannot be used: {}", in_quotes(name), why),
                          "use a library and a host of one version");
        std::memset(out, 0, size);
        std::memcpy(out, one, std::min(size, stride));
        return MARRAM_OK;
    }
    const std::string near = nearest(name, names);
    return refuse(host, "host.procedural", fmt::format("the library has no procedural {}", in_quotes(name)),
                  near.empty() ? "see `marram info` for what it has"
                               : fmt::format("did you mean {}?", in_quotes(near)));
}

} // namespace
} // namespace marram

using namespace marram;

MarramStatus marram_find_procedural_for(uint32_t embree_major, const MarramLibrary* library, const char* name,
                                        const MarramHost* host, MarramProcedural* out, size_t size) {
    if (!name || !out) return MARRAM_ERROR;
    return guarded([&] { return find(library, embree_major, name, host, out, size); },
                   [&] {
                       say(host, "host.memory", "", "the declarations do not fit into memory", "free memory");
                       return MARRAM_ERROR;
                   });
}

MarramStatus marram_load_procedural_for(uint32_t embree_major, const char* path, const char* name,
                                        const MarramHost* host, MarramProcedural* out, size_t size) {
    void* library = path ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : nullptr;
    void* symbol = library ? dlsym(library, MARRAM_ENTRY_POINT) : nullptr;
    if (const auto entry = reinterpret_cast<MarramLibraryFunction>(symbol))
        return marram_find_procedural_for(embree_major, entry(MARRAM_ABI_VERSION), name, host, out, size);
    const char* why = path ? dlerror() : "no path";
    say(host, "host.library", "", why ? why : "it has no procedurals",
        "give the path of a procedural library");
    if (library) dlclose(library);
    return MARRAM_ERROR;
}
