// SPDX-License-Identifier: Apache-2.0
// Helpers for writing HTML pages.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace marram {

// Escapes text for HTML and SVG.
std::string escaped(const std::string& text);

// Encodes a PNG as "data:image/png;base64,...", so that a page needs no other file.
std::string data_url(std::span<const unsigned char> png);

} // namespace marram
