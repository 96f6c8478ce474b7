// SPDX-License-Identifier: Apache-2.0
// CMakeLists.txt lists the files in page_list.inc, as MARRAM_PAGE_FILE(symbol, name, path), and compiles
// this file again when one of core/view/page changes.
#include "core/view/server/page_files.h"

#include <stdexcept>
#include <string>

// The assembler puts the bytes of a file between two symbols.
#define MARRAM_PAGE_FILE(symbol, name, path)                                                                 \
    __asm__(".section .rodata\n" #symbol ":\n.incbin \"" path "\"\n" #symbol "_end:\n.byte 0\n.previous\n"); \
    extern "C" const char symbol[], symbol##_end[];
#include <page_list.inc>
#undef MARRAM_PAGE_FILE

namespace marram {
namespace {

std::string_view type_of(std::string_view name) {
    const std::string_view extension = name.substr(name.rfind('.') + 1);
    if (extension == "html") return "text/html; charset=utf-8";
    if (extension == "css") return "text/css; charset=utf-8";
    if (extension == "js") return "text/javascript; charset=utf-8";
    if (extension == "svg") return "image/svg+xml";
    throw std::logic_error("a file of the page without a type: " + std::string(name));
}

} // namespace

std::span<const PageFile> page_files() {
#define MARRAM_PAGE_FILE(symbol, name, path)                                                                 \
    {name, type_of(name), std::string_view(symbol, size_t(symbol##_end - symbol))},
    static const PageFile files[] = {
#include <page_list.inc>
    };
    return files;
}

} // namespace marram
