// SPDX-License-Identifier: Apache-2.0
// Loads a library of this project when it is first needed: code that few runs need and that takes long to load or to
// build, because of what it depends on. dlopen() finds it by LD_LIBRARY_PATH or by the RUNPATH of the caller, which CMakeLists.txt
// sets to the folder of our libraries.
#pragma once

#include <dlfcn.h>

#include <cstring>
#include <stdexcept>
#include <string>

namespace marram {

// Functions: what the library exports, a struct that begins with
//     const char* version;  // of the release
//     size_t size;          // of the struct: detects another build
// These two never change their place. entry: the name of the only function that the library exports, const Functions* f().
// The library is never closed, so its objects stay valid. Throws
// std::runtime_error with the reason if it cannot be loaded.
template <typename Functions>
const Functions& load_own_library(const char* file, const char* entry, const char* version) {
    const auto loaded = [](void* found) {
        if (!found) throw std::runtime_error(::dlerror());
        return found;
    };
    void* const library = loaded(::dlopen(file, RTLD_LAZY | RTLD_LOCAL));
    const auto functions = reinterpret_cast<const Functions* (*)()>(loaded(::dlsym(library, entry)));
    const Functions& found = *functions();
    if (std::strcmp(found.version, version) != 0)
        throw std::runtime_error(std::string("it is of version ") + found.version + ", not " + version);
    if (found.size != sizeof(Functions)) throw std::runtime_error("it is of another build");
    return found;
}

} // namespace marram
