// SPDX-License-Identifier: Apache-2.0
// What pages for a browser are made of.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace marram {

// Text that means itself in HTML and SVG.
std::string escaped(const std::string& text);

// "data:image/png;base64,..." so that a page needs nothing beside it.
std::string data_url(std::span<const unsigned char> png);

} // namespace marram
