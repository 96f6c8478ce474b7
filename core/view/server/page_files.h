// SPDX-License-Identifier: Apache-2.0
// The files of the page, compiled into the library: core/view/page, and those of three.js.
#pragma once

#include <span>
#include <string_view>

namespace marram {

struct PageFile {
    std::string_view name, type, bytes;
};
std::span<const PageFile> page_files();

} // namespace marram
