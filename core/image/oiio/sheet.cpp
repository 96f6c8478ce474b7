// SPDX-License-Identifier: Apache-2.0
#include "core/image/sheet.h"

#include "core/image/picture.h"
#include "core/math/problem.h"

#include <OpenImageIO/imagebufalgo.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

constexpr int gap = 8;                          // pixels between and around pictures
constexpr int narrowest = 32;                   // column, pixels
constexpr int highest = 65535;                  // sheet, pixels
constexpr double max_pixels = 89e6;             // of a sheet: 1 GiB of floats
constexpr float background = 0.02F, ink = 0.7F; // linear light

// Font of the captions.
struct Caption {
    std::string font; // "": no captions
    int size = 0;     // pixels
    int height = 0;   // of the caption line; 0: no captions
};

int width_of(const std::string& text, const Caption& caption) {
    return OIIO::ImageBufAlgo::text_size(text, caption.size, caption.font).width();
}

bool is_font(const std::string& font) {
    const bool found = OIIO::ImageBufAlgo::text_size("0", 16, font).defined();
    (void)OIIO::geterror(); // clears the error, which would be printed at exit
    return found;
}

// Throws InputError if a font was given and cannot be read.
std::string font_of(const SheetLayout& layout) {
    if (!layout.font.empty()) {
        if (!is_font(layout.font))
            throw InputError(
                {"--font " + layout.font}, "this font cannot be read",
                "name a .ttf or .otf file, such as /usr/share/fonts/truetype/dejavu/DejaVuSans.ttf");
        return layout.font;
    }
    const auto found = std::ranges::find_if(layout.fonts, is_font);
    return found == layout.fonts.end() ? "" : *found;
}

// Length in bytes of the UTF-8 character that begins at `at`; 0 if it is invalid.
size_t character_at(const std::string& text, size_t at) {
    const auto byte = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U; };
    const unsigned first = byte(at);
    const size_t length = first < 0x80                    ? 1
                          : first >= 0xc2 && first < 0xe0 ? 2
                          : first >= 0xe0 && first < 0xf0 ? 3
                          : first >= 0xf0 && first < 0xf5 ? 4
                                                          : 0;
    for (size_t i = 1; i < length; ++i)
        if ((byte(at + i) & 0xc0U) != 0x80U) return 0;
    return length;
}

// Splits a text into characters that can be drawn: invalid bytes and control characters become "?".
std::vector<std::string> characters_of(const std::string& text) {
    std::vector<std::string> characters;
    for (size_t at = 0; at < text.size();) {
        const size_t length = character_at(text, at);
        const auto first = static_cast<unsigned char>(text[at]);
        const bool drawn = length > 0 && first >= 32 && first != 127;
        characters.push_back(drawn ? text.substr(at, length) : "?");
        at += std::max<size_t>(1, length);
    }
    return characters;
}

std::string joined(const std::vector<std::string>& characters, size_t begin, size_t end) {
    std::string text;
    for (size_t i = begin; i < end; ++i) text += characters[i];
    return text;
}

// The text if it fits, otherwise its beginning and end with dots between: these distinguish names of a
// sequence.
std::string fitted(const std::string& text, int width, const Caption& caption) {
    const std::vector<std::string> all = characters_of(text);
    std::string whole = joined(all, 0, all.size());
    if (width_of(whole, caption) <= width) return whole;
    size_t fits = 0, fails = all.size();
    const auto cut = [&](size_t kept) {
        return joined(all, 0, kept / 2) + "..." + joined(all, all.size() - (kept - kept / 2), all.size());
    };
    while (fits + 1 < fails) {
        const size_t middle = (fits + fails) / 2;
        (width_of(cut(middle), caption) <= width ? fits : fails) = middle;
    }
    return cut(fits);
}

// A picture's colours, linear, clamped to 0 ... 1: values above white would smear in resampling.
OIIO::ImageBuf colours_of(const std::string& file, double exposure) {
    const Picture picture = read_picture(file);
    const Picture::Layer* layer = picture.find("");
    if (!layer || layer->channels.size() < 3)
        throw InputError({file}, "has no colours", "give pictures with the channels R, G and B, or Y alone");
    const float scale = picture.display ? 1.0F : float(std::exp2(exposure));
    OIIO::ImageBuf buffer(OIIO::ImageSpec(picture.width, picture.height, 3, OIIO::TypeDesc::FLOAT));
    auto* out = static_cast<float*>(buffer.localpixels());
    const size_t channels = layer->channels.size();
    for (size_t i = 0; i < size_t(picture.width) * size_t(picture.height); ++i)
        for (size_t c = 0; c < 3; ++c)
            out[3 * i + c] = std::clamp(layer->pixels[i * channels + c] * scale, 0.0F, 1.0F);
    return buffer;
}

struct Cell {
    int x = 0, y = 0, width = 0, height = 0; // of the picture
    int caption_y = 0;                       // top of the caption line
};

struct Grid {
    int width = 0, height = 0, column = 0;
    std::vector<Cell> cells;
};

// Computes the layout. Reads only the headers.
Grid grid_of(const std::string& output, const std::vector<SheetPicture>& pictures, const SheetLayout& layout,
             int columns, int column, int line) {
    Grid grid{layout.width, gap, column, {}};
    for (size_t begin = 0; begin < pictures.size(); begin += size_t(columns)) {
        const size_t end = std::min(pictures.size(), begin + size_t(columns));
        int row = 1;
        for (size_t i = begin; i < end; ++i) {
            const ImageHeader header = image_header(pictures[i].file);
            const double scale = std::min(double(column) / header.width, 2.0 * column / header.height);
            Cell cell;
            cell.width = std::clamp(int(std::lround(header.width * scale)), 1, column);
            cell.height = std::clamp(int(std::lround(header.height * scale)), 1, 2 * column);
            cell.x = gap + int(i - begin) * (column + gap) + (column - cell.width) / 2;
            row = std::max(row, cell.height);
            grid.cells.push_back(cell);
        }
        for (size_t i = begin; i < end; ++i) {
            grid.cells[i].y = grid.height + row - grid.cells[i].height; // directly above its caption
            grid.cells[i].caption_y = grid.height + row;
        }
        grid.height += row + line + gap;
        if (grid.height > highest || double(grid.height) * grid.width > max_pixels)
            throw InputError({output},
                             fmt::format("a sheet of {} columns and {} pixels width would be too large",
                                         columns, grid.width),
                             "give more --columns, a smaller --width, or fewer pictures");
    }
    return grid;
}

void draw_caption(OIIO::ImageBuf& sheet, const std::string& text, const Cell& cell, int left, int column,
                  const Caption& caption) {
    if (text.empty() || caption.height == 0) return;
    const float colour[3] = {ink, ink, ink};
    OIIO::ImageBufAlgo::render_text(sheet, left + column / 2, cell.caption_y + caption.height * 3 / 4,
                                    fitted(text, column, caption), caption.size, caption.font, colour,
                                    OIIO::ImageBufAlgo::TextAlignX::Center,
                                    OIIO::ImageBufAlgo::TextAlignY::Baseline);
}

} // namespace

bool write_sheet(const std::string& output, const std::vector<SheetPicture>& pictures,
                 const SheetLayout& layout, const std::function<void(size_t)>& at) {
    const int count = int(pictures.size());
    const int columns =
        std::min(count, layout.columns > 0 ? layout.columns : int(std::ceil(std::sqrt(double(count)))));
    const int column = (layout.width - gap) / columns - gap;
    if (column < narrowest)
        throw InputError({output},
                         fmt::format("{} columns in {} pixels are too narrow", columns, layout.width),
                         fmt::format("give fewer --columns, or a --width of {} or more",
                                     columns * (narrowest + gap) + gap));
    const bool wanted =
        std::ranges::any_of(pictures, [](const SheetPicture& p) { return !p.caption.empty(); });
    Caption caption;
    if (wanted) caption.font = font_of(layout);
    if (!caption.font.empty()) {
        caption.size = std::clamp(column / 20, 11, 24);
        caption.height = caption.size * 3 / 2;
    }
    const Grid grid = grid_of(output, pictures, layout, columns, column, caption.height);
    OIIO::ImageBuf sheet(OIIO::ImageSpec(grid.width, grid.height, 3, OIIO::TypeDesc::FLOAT));
    const float paper[3] = {background, background, background};
    OIIO::ImageBufAlgo::fill(sheet, paper);
    for (size_t i = 0; i < pictures.size(); ++i) {
        if (at) at(i);
        const Cell& cell = grid.cells[i];
        const OIIO::ImageBuf scaled =
            OIIO::ImageBufAlgo::resize(colours_of(pictures[i].file, layout.exposure), "", 0.0F,
                                       OIIO::ROI(0, cell.width, 0, cell.height, 0, 1, 0, 3));
        OIIO::ImageBufAlgo::paste(sheet, cell.x, cell.y, 0, 0, scaled);
        draw_caption(sheet, pictures[i].caption, cell, gap + int(i) % columns * (column + gap), column,
                     caption);
    }
    write_png(output, grid.width, grid.height, 3, static_cast<const float*>(sheet.localpixels()), 0.0);
    return !wanted || !caption.font.empty();
}

} // namespace marram
