// SPDX-License-Identifier: Apache-2.0
// Scripts that complete the command line in a shell: what `marram completion` prints.
#pragma once

#include "core/manual/command_text.h"

#include <string>
#include <vector>

namespace marram {

// Words that complete values and do not depend on a scene.
struct CompletionWords {
    std::vector<std::string> subjects; // arguments of `marram info`
    std::vector<std::string> layers;
};

std::string bash_completion(const ProgramText& text, const CompletionWords& words);
std::string zsh_completion(const ProgramText& text, const CompletionWords& words);

} // namespace marram
