// SPDX-License-Identifier: Apache-2.0
// Code that uses OpenImageIO is in core/image/oiio, in a shared library that is loaded when a program first
// reads or writes a picture. OpenImageIO depends on 250 libraries, and loading them takes longer than most
// runs that need no picture. The functions are declared in the headers of this folder and called normally.
#pragma once

#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/image/range_png.h"
#include "core/image/sheet.h"
#include "core/image/texture_file.h"
#include "core/image/words.h"

namespace marram {

// The functions that the library exports, by name.
struct ImageLibrary {
    const char* version; // of the release. With `size` (of this struct) it detects another build
    size_t size;
    decltype(&marram::read_image) read_image;
    decltype(&marram::write_exr) write_exr;
    decltype(&marram::png_bytes) png_bytes;
    decltype(&marram::write_png) write_png;
    decltype(&marram::write_grey_png) write_grey_png;
    decltype(&marram::write_grey_tiff) write_grey_tiff;
    decltype(&marram::image_header) image_header;
    decltype(&marram::read_all_metadata) read_all_metadata;
    decltype(&marram::read_metadata) read_metadata;
    decltype(&marram::whole_metadata) whole_metadata;
    decltype(&marram::write_words) write_words;
    decltype(&marram::read_words_header) read_words_header;
    decltype(&marram::read_words) read_words;
    decltype(&marram::write_range_png) write_range_png;
    decltype(&marram::write_sheet) write_sheet;
    decltype(&marram::open_texture_file) open_texture_file;
    decltype(&marram::remove_temporary_files) remove_temporary_files;
};
inline constexpr const char* image_library_entry =
    "marram_image_library"; // the symbol: const ImageLibrary* f()

// Loads the library now, so that errors appear before a long render. Throws InputError if it cannot be
// loaded, std::bad_alloc if memory is short.
void load_image_library();

} // namespace marram
