// SPDX-License-Identifier: Apache-2.0
// Parses the option --png.
#pragma once

#include "core/shot/layer_picture.h"

#include <string>

namespace marram {

// "depth:0-20=depth.####.png": a layer, the values mapped to black and white, a file. Without a range:
// "normal=n.png". Throws InputError with the column of the mistake.
LayerPicture parse_layer_picture(const std::string& text);

} // namespace marram
