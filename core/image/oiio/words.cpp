// SPDX-License-Identifier: Apache-2.0
#include "core/image/words.h"

#include "core/image/oiio/image_input.h"
#include "core/image/oiio/image_output.h"
#include "core/math/problem.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <memory>
#include <vector>

namespace marram {

namespace {

constexpr int rows_a_strip = 64; // handed to OpenImageIO at a time

[[noreturn]] void refuse_state(const std::string& path, const std::string& what, const std::string& message,
                               const std::string& fix) {
    const std::string line = message.substr(0, message.find('\n'));
    throw InputError({path}, what + " (" + (line.empty() ? "no reason given" : line) + ")", fix);
}

std::unique_ptr<OIIO::ImageInput> open(const std::string& path) {
    OIIO::ImageSpec config;
    // A fourth channel is not alpha: do not multiply by it.
    config.attribute("oiio:UnassociatedAlpha", 1);
    std::string why;
    std::unique_ptr<OIIO::ImageInput> input = open_format(path, config, why);
    if (!input) refuse_state(path, "cannot be read", why, "remove it");
    return input;
}

WordsHeader header_of(const OIIO::ImageSpec& spec) {
    const bool words = spec.format == OIIO::TypeDesc::UINT32 && !spec.deep && spec.depth <= 1;
    return {spec.width, spec.height, words ? spec.nchannels : 0,
            spec.get_string_attribute("ImageDescription")};
}

OIIO::ImageSpec spec_of(const WordsHeader& header) {
    OIIO::ImageSpec spec(header.width, header.height, header.channels, OIIO::TypeDesc::UINT32);
    for (int c = 0; c < header.channels; ++c) spec.channelnames[size_t(c)] = fmt::format("value{}", c);
    spec.alpha_channel = -1; // the default names would make the fourth channel alpha
    spec.attribute("compression", "none");
    spec.attribute("ImageDescription", header.description);
    spec.attribute("DateTime", ""); // else OpenImageIO writes the current time, and files differ
    return spec;
}

} // namespace

void write_words(const std::string& path, const WordsHeader& header,
                 const std::function<void(int, uint32_t*)>& row) {
    assert(header.width > 0 && header.height > 0 && header.channels > 0);
    ImageWriter writer(path, spec_of(header), "tiff", Links::replace);
    const size_t stride = size_t(header.width) * size_t(header.channels);
    std::vector<uint32_t> strip(stride * size_t(std::min(rows_a_strip, header.height)));
    for (int begin = 0; begin < header.height; begin += rows_a_strip) {
        const int end = std::min(begin + rows_a_strip, header.height);
        for (int y = begin; y < end; ++y) row(y, strip.data() + stride * size_t(y - begin));
        writer.write_rows(begin, end, OIIO::TypeDesc::UINT32, strip.data());
    }
    writer.commit();
}

WordsHeader read_words_header(const std::string& path) { return header_of(open(path)->spec()); }

void read_words(const std::string& path, const WordsHeader& header,
                const std::function<void(int, const uint32_t*)>& row) {
    const std::unique_ptr<OIIO::ImageInput> input = open(path);
    const WordsHeader found = header_of(input->spec());
    if (found.width != header.width || found.height != header.height || found.channels != header.channels ||
        found.description != header.description)
        refuse_state(path, "has changed while it was read", "another header", "try again");
    const size_t stride = size_t(header.width) * size_t(header.channels);
    std::vector<uint32_t> strip(stride * size_t(std::min(rows_a_strip, header.height)));
    for (int begin = 0; begin < header.height; begin += rows_a_strip) {
        const int end = std::min(begin + rows_a_strip, header.height);
        // For a truncated file OpenImageIO sets an error but returns success.
        if (!input->read_scanlines(0, 0, begin, end, 0, 0, header.channels, OIIO::TypeDesc::UINT32,
                                   strip.data()) ||
            input->has_error())
            refuse_state(path, "cannot be read to its end", input->geterror(), "remove it");
        for (int y = begin; y < end; ++y) row(y, strip.data() + stride * size_t(y - begin));
    }
}

} // namespace marram
