// SPDX-License-Identifier: Apache-2.0
// Images of data, such as heights, whose files may have holes.
#pragma once

#include "core/image/image.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

// Reads an image of data: values as in the file, integers scaled to 0 ... 1. Pixels with the value that the
// file declares as "no data" are filled smoothly from around, and one line that counts them is added to
// `notes`; likewise for pixels with one value far from all others, such as -9999, which are kept. Throws
// InputError as read_image(), and if all pixels are holes.
Image read_data_image(const std::string& path, std::vector<std::string>& notes);

// The value of holes that a TIFF or BigTIFF declares in its first picture (GDAL's tag 42113, a text; "nan" is
// one). nullopt for other files, without the tag, or if its text is not a number.
std::optional<double> declared_nodata(const std::string& path);

// Fills the pixels marked: means of the known pixels of ever larger squares, interpolated, then relaxed
// towards the mean of the four neighbours. Does nothing if all are marked. Cost: 0.1 us a pixel, 0.5 us a
// marked one.
void fill_pixels(Image& image, const std::vector<char>& marked);

} // namespace marram
