// SPDX-License-Identifier: Apache-2.0
// Opens image files of the formats that are documented, each by its own reader. Left to itself, OpenImageIO
// passes a file that no reader recognises to all of them, and that of DICOM takes minutes over a large one.
#pragma once

#include <OpenImageIO/imageio.h>

#include <memory>
#include <string>

namespace marram {

// OpenImageIO's name of the format, by the first bytes, "png"; that of TGA, which has no signature, by the
// file's ending. "" for other files, and for what is no ordinary file: opening a pipe would wait for its
// writer.
std::string format_of(const std::string& path);

// nullptr if the file cannot be opened as an image, with the reason on one line.
std::unique_ptr<OIIO::ImageInput> open_format(const std::string& path, const OIIO::ImageSpec& config,
                                              std::string& reason);

} // namespace marram
