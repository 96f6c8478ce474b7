// SPDX-License-Identifier: Apache-2.0
#include "core/image/range_png.h"

#include "core/image/oiio/image_output.h"

#include <fmt/format.h>

#include <cassert>

namespace marram {

void write_range_png(const std::string& path, int width, int height, int channels, const float* pixels,
                     const ValueRange& range, std::span<const Metadata> metadata) {
    assert(width > 0 && height > 0 && channels >= 1 && channels <= 4);
    const int written = channels == 2 ? 3 : channels; // blue stays black
    OIIO::ImageSpec spec(width, height, written, OIIO::TypeDesc::UINT16);
    spec.attribute("oiio:UnassociatedAlpha", 1); // the fourth channel must not scale the others
    for (const auto& [key, value] : metadata)    // PNG metadata is text only
        spec.attribute(key, std::visit([](const auto& v) { return fmt::format("{}", v); }, value));
    ImageWriter writer(path, spec, "png");
    std::vector<uint16_t> row(size_t(width) * size_t(written), 0);
    for (int y = 0; y < height; ++y) {
        const float* from = pixels + size_t(y) * size_t(width) * size_t(channels);
        for (size_t x = 0; x < size_t(width); ++x)
            for (size_t c = 0; c < size_t(channels); ++c)
                row[x * size_t(written) + c] = code_of(double(from[x * size_t(channels) + c]), range);
        writer.write_rows(y, y + 1, OIIO::TypeDesc::UINT16, row.data());
    }
    writer.commit();
}

} // namespace marram
