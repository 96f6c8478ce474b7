// SPDX-License-Identifier: Apache-2.0
// What --png says.
#pragma once

#include "core/shot/layer_picture.h"

#include <string>

namespace marram {

// "depth:0-20=depth.####.png": a layer, the values that become black and white, a file. Without a range: "normal=n.png". Throws
// InputError with the column of what is wrong.
LayerPicture parse_layer_picture(const std::string& text);

} // namespace marram
