// SPDX-License-Identifier: Apache-2.0
// A contact sheet: pictures in rows and columns, with captions below them.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace marram {

struct SheetPicture {
    std::string file, caption; // "": none
};

struct SheetLayout {
    int columns = 0;       // 0: about as many columns as rows
    int width = 1920;      // of the sheet in pixels
    double exposure = 0.0; // stops; for pictures that are linear in their files
    std::string font{};    // a name or a file; "": the first of `fonts` that is found
    // From Debian's fonts-dejavu-core, fonts-liberation and fonts-freefont-ttf.
    std::vector<std::string> fonts = {"DejaVuSans", "LiberationSans-Regular", "FreeSans"};
};

// Captions for pictures: frame numbers, if the metadata of all pictures have the same scene and different
// frames. Otherwise file names, without folder and extension if that keeps them unique.
std::vector<std::string> sheet_captions(const std::vector<std::string>& files);

// The two kinds of captions: frames (from metadata, else the last number in the name, else the name), or
// names.
std::vector<std::string> frame_captions(const std::vector<std::string>& files);
std::vector<std::string> name_captions(const std::vector<std::string>& files);

// Writes an 8-bit sRGB PNG, completely or not at all; its bytes depend only on the pictures, the arguments
// and the font. Pictures are scaled to the width of a column, or to twice that as height if they would be
// higher. Captions that are too long are cut in the middle. Pictures are read one after the other; `at` is
// called with the index of each. Throws InputError for a picture that cannot be read or has no colours, a
// layout that leaves no room, and a given font that cannot be read. Returns false if no font was found
// and so there are no captions.
bool write_sheet(const std::string& output, const std::vector<SheetPicture>& pictures,
                 const SheetLayout& layout, const std::function<void(size_t)>& at = {});

} // namespace marram
