// SPDX-License-Identifier: Apache-2.0
// The bend of a groom of blades, as text, rows of a table and a section of a page.
#pragma once

#include "core/measure/bend.h"

#include <string>
#include <vector>

namespace marram {

std::string bend_table(const BendResult& bend);
std::string bend_html(const BendResult& bend);

struct BendSetting {
    std::string label; // "grass: own dials, 3.2 m/s"
    BendError error;   // degrees
    bool own = false;  // of the scene's own dials
};
std::vector<BendSetting> bend_settings(const BendResult& bend);

} // namespace marram
