// SPDX-License-Identifier: Apache-2.0
// The tables and parameters of scene files, and the image layers, as text made from their declarations: what
// `marram info` prints.
#pragma once

#include "core/manual/completion.h"
#include "core/shot/shot.h"

#include <string>
#include <vector>

namespace marram {

// Each subject once, "layers" first.
std::vector<std::string> reference_subjects(const PluginSet& plugins);

// All tables with this subject, "" for all subjects. Empty if there is none.
std::string reference_text(const PluginSet& plugins, const std::string& subject);

CompletionWords completion_words(const PluginSet& plugins);

} // namespace marram
