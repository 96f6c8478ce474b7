// SPDX-License-Identifier: Apache-2.0
#include "core/image/oiio/image_input.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>

namespace marram {
namespace {

using namespace std::string_view_literals;

struct Signature {
    std::string_view bytes;
    const char* format;
    size_t at = 0; // position of the bytes
};

constexpr Signature signatures[] = {
    {"\x76\x2f\x31\x01"sv, "openexr"},
    {"\x89PNG"sv, "png"},
    {"II*\0"sv, "tiff"},
    {"MM\0*"sv, "tiff"},
    {"II+\0"sv, "tiff"}, // BigTIFF
    {"MM\0+"sv, "tiff"},
    {"\xff\xd8\xff"sv, "jpeg"},
    {"#?"sv, "hdr"},
    {"P1"sv, "pnm"},
    {"P2"sv, "pnm"},
    {"P3"sv, "pnm"},
    {"P4"sv, "pnm"},
    {"P5"sv, "pnm"},
    {"P6"sv, "pnm"},
    {"PF"sv, "pnm"}, // PFM
    {"Pf"sv, "pnm"},
    {"BM"sv, "bmp"},
    {"GIF8"sv, "gif"},
    {"WEBP"sv, "webp", 8},
    {"SIMPLE"sv, "fits"},
    {"SDPX"sv, "dpx"},
    {"XPDS"sv, "dpx"},
    {"\x80\x2a\x5f\xd7"sv, "cineon"},
    {"\xd7\x5f\x2a\x80"sv, "cineon"},
    {"8BPS"sv, "psd"},
    {"\0\0\0\x0cjP  "sv, "jpeg2000"},
    {"\xff\x4f\xff\x51"sv, "jpeg2000"}, // a bare code stream
    {"DDS "sv, "dds"},
};
constexpr size_t longest_signature = 16;

bool has_ending(const std::string& path, std::string_view wanted) {
    std::string ending = std::filesystem::path(path).extension().string();
    std::ranges::transform(ending, ending.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    return ending == wanted;
}

} // namespace

std::string format_of(const std::string& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) return "";
    std::ifstream file(path, std::ios::binary);
    char head[longest_signature] = {};
    file.read(head, sizeof head);
    const std::string_view bytes(head, size_t(std::max<std::streamsize>(0, file.gcount())));
    for (const Signature& s : signatures)
        if (bytes.size() >= s.at && bytes.substr(s.at).starts_with(s.bytes)) return s.format;
    return has_ending(path, ".tga") ? "targa" : "";
}

std::unique_ptr<OIIO::ImageInput> open_format(const std::string& path, const OIIO::ImageSpec& config,
                                              std::string& reason) {
    const std::string format = format_of(path);
    if (format.empty()) {
        reason = "it begins like none of the formats that are read";
        return nullptr;
    }
    std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::create(format);
    OIIO::ImageSpec spec;
    if (input && input->open(path, spec, config)) return input;
    // Fetched in any case: OpenImageIO prints errors that nobody has asked for when the program ends.
    const std::string own = input ? input->geterror() : "", common = OIIO::geterror();
    const std::string& message = own.empty() ? common : own;
    reason = message.empty() ? "no reason given" : message.substr(0, message.find('\n'));
    return nullptr;
}

} // namespace marram
