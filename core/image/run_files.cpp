// SPDX-License-Identifier: Apache-2.0
#include "core/image/run_files.h"

#include "core/image/atomic_file.h"
#include "core/math/problem.h"

namespace marram {

RunFiles::RunFiles(const std::vector<std::string>& read) {
    for (const std::string& file : read) known_.emplace(destination_of(file), file);
}

void RunFiles::write(const std::string& file) {
    if (file.empty()) return;
    const auto [other, fresh] = known_.emplace(destination_of(file), file);
    if (!fresh)
        throw InputError({file}, "this would overwrite '" + other->second + "'",
                         "give every file a name of its own");
}

} // namespace marram
