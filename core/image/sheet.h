// SPDX-License-Identifier: Apache-2.0
// A contact sheet: pictures in rows and columns, each with a caption under it.
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
    int columns = 0;       // 0: about as many as rows
    int width = 1920;      // of the sheet, pixels
    double exposure = 0.0; // stops, of pictures that are linear in their files
    std::string font{};    // a name or a file; "": the first of `fonts` that is there
    // Of Debian's fonts-dejavu-core, fonts-liberation and fonts-freefont-ttf.
    std::vector<std::string> fonts = {"DejaVuSans", "LiberationSans-Regular", "FreeSans"};
};

// Captions for pictures: their frames where all carry them in their metadata, of one scene and each another; else the names of their
// files, without folder and extension where that tells them apart.
std::vector<std::string> sheet_captions(const std::vector<std::string>& files);

// The parts of captions: frames alone (metadata, else the last number in the name, else the name), or names alone.
std::vector<std::string> frame_captions(const std::vector<std::string>& files);
std::vector<std::string> name_captions(const std::vector<std::string>& files);

// Writes an 8-bit sRGB PNG, whole or not at all; its bytes depend on the pictures, the arguments and the font alone. Pictures are scaled to
// the width of a column, and fitted into a square of twice that width where they are higher. Captions that are too long are cut in their
// middle. Reads one picture after the other; `at` is told the index of each. Throws InputError for a picture that cannot be
// read or has no colours, a layout that leaves no room, and a font that was named and is none.
// Returns what to warn of: "" or that no font was found, so that there are no captions.
std::string write_sheet(const std::string& output, const std::vector<SheetPicture>& pictures,
                        const SheetLayout& layout, const std::function<void(size_t)>& at = {});

} // namespace marram
