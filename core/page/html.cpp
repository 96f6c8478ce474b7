// SPDX-License-Identifier: Apache-2.0
#include "core/page/html.h"

namespace marram {

std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
        switch (c) {
        case '&':
            out += "&amp;";
            break;
        case '<':
            out += "&lt;";
            break;
        case '>':
            out += "&gt;";
            break;
        case '"':
            out += "&quot;";
            break;
        default:
            out += c;
        }
    }
    return out;
}

std::string data_url(std::span<const unsigned char> png) {
    static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out = "data:image/png;base64,";
    for (size_t i = 0; i < png.size(); i += 3) {
        const size_t left = png.size() - i;
        const uint32_t bits = uint32_t(png[i]) << 16 | (left > 1 ? uint32_t(png[i + 1]) << 8 : 0U) |
                              (left > 2 ? uint32_t(png[i + 2]) : 0U);
        out += digits[bits >> 18];
        out += digits[bits >> 12 & 63];
        out += left > 1 ? digits[bits >> 6 & 63] : '=';
        out += left > 2 ? digits[bits & 63] : '=';
    }
    return out;
}

} // namespace marram
