// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_library.h"

extern "C" const marram::ImageLibrary* marram_image_library() {
    static const marram::ImageLibrary library = {
        .version = MARRAM_VERSION,
        .size = sizeof(marram::ImageLibrary),
        .read_image = marram::read_image,
        .write_exr = marram::write_exr,
        .png_bytes = marram::png_bytes,
        .write_png = marram::write_png,
        .write_grey_png = marram::write_grey_png,
        .write_grey_tiff = marram::write_grey_tiff,
        .image_header = marram::image_header,
        .read_all_metadata = marram::read_all_metadata,
        .read_metadata = marram::read_metadata,
        .whole_metadata = marram::whole_metadata,
        .write_words = marram::write_words,
        .read_words_header = marram::read_words_header,
        .read_words = marram::read_words,
        .write_range_png = marram::write_range_png,
        .write_sheet = marram::write_sheet,
        .open_texture_file = marram::open_texture_file,
        .remove_temporary_files = marram::remove_temporary_files,
    };
    return &library;
}
