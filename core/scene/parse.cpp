// SPDX-License-Identifier: Apache-2.0
#include "core/scene/parse.h"
#include "core/math/text.h"
#include "core/scene/suggest.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <tuple>

namespace marram {
namespace {

// Bytes. A scene is a page of text; data belong in separate files.
constexpr size_t max_file = size_t(64) << 20;

std::string read_file(const std::string& file) {
    namespace fs = std::filesystem;
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (status.type() == fs::file_type::not_found)
        throw InputError({file}, "there is no such scene file", "check the path");
    if (status.type() == fs::file_type::directory)
        throw InputError({file}, "this is a directory", "name a scene file in it");
    std::ifstream in(file, std::ios::binary);
    if (!in) {
        const std::string why = error ? error.message() : std::strerror(errno);
        throw InputError({file}, fmt::format("the scene file cannot be opened ({})", why),
                         "check its permissions");
    }
    std::string text, block(1 << 16, '\0');
    while (in.read(block.data(), static_cast<std::streamsize>(block.size())) || in.gcount() > 0) {
        text.append(block, 0, static_cast<size_t>(in.gcount()));
        if (text.size() > max_file)
            throw InputError({file}, "the scene file is larger than 64 MB",
                             "keep data in files that the scene names");
    }
    if (in.bad()) throw InputError({file}, "the scene file cannot be read to its end", "check the disk");
    text.erase(0, byte_order_mark(file, text));
    return text;
}

std::string fix(std::string_view description) {
    auto says = [&](std::string_view words) { return description.find(words) != std::string_view::npos; };
    if (says("redefine")) return "say it once, in one place";
    if (says("utf-8")) return "save the file as UTF-8";
    if (says("nested")) return "take the brackets out";
    if (says("end-of-file")) return "close what is open at the end of the file";
    return "use TOML syntax (key = value, texts in quotes; see toml.io)";
}

} // namespace

std::optional<Place> deep_key(std::string_view text) {
    char quote = 0; // opening quote of the current string; 0: outside of strings
    bool multiline = false;
    int line = 1;
    size_t parts = 1;
    size_t line_start = 0;
    auto triple = [&](size_t i) {
        return i + 2 < text.size() && text[i + 1] == text[i] && text[i + 2] == text[i];
    };
    for (size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (c == '\n') {
            ++line;
            line_start = i + 1;
            if (!multiline) quote = 0; // malformed; the parser will report it
        }
        if (quote) {
            if (c == '\\' && quote == '"' && i + 1 < text.size() && text[i + 1] != '\n') {
                ++i;
            } else if (c == quote && (!multiline || triple(i))) {
                if (multiline) i += 2;
                quote = 0;
                multiline = false;
            }
        } else if (c == '"' || c == '\'') {
            quote = c;
            multiline = triple(i);
            if (multiline) i += 2;
        } else if (c == '#') {
            while (i + 1 < text.size() && text[i + 1] != '\n') ++i;
        } else if (c == '.') {
            if (++parts > max_parts) return Place{{}, line, static_cast<int>(i - line_start) + 1};
        } else if (std::strchr(",=[]{}\n", c)) {
            parts = 1;
        }
    }
    return {};
}

toml::table parse_value(std::string_view text, const std::string& source) {
    if (deep_key(text)) return {};
    try {
        toml::table table = toml::parse(fmt::format("value = {}", text), std::string_view(source));
        if (table.size() == 1) return table;
    } catch (const toml::parse_error&) {
    }
    return {};
}

toml::table parse_scene(Reading& reading) {
    const std::string text = read_file(reading.file);
    if (text.find_first_not_of(" \t\r\n") == std::string::npos)
        throw InputError({reading.file, 1, 1}, "the scene file is empty",
                         "begin with a [camera] and a [[mesh]]");
    if (std::optional<Place> place = deep_key(text))
        throw InputError({reading.file, place->line, place->column},
                         fmt::format("a key has more than {} parts", max_parts), "take the dots out");
    try {
        return toml::parse(text, std::string_view(reading.file));
    } catch (const toml::parse_error& error) {
        std::string what(error.description());
        constexpr std::string_view prefix = "Error while parsing ";
        if (what.starts_with(prefix)) what = fmt::format("mistake in the {}", what.substr(prefix.size()));
        throw InputError(place_of(error.source(), reading), what, fix(what));
    }
}

void throw_problems(Reading& reading) {
    if (reading.problems.empty()) return;
    auto order = [&](const Problem& a, const Problem& b) {
        const bool a_set = a.place.file != reading.file, b_set = b.place.file != reading.file;
        return std::tie(a_set, a.place.line, a.place.column) < std::tie(b_set, b.place.line, b.place.column);
    };
    std::stable_sort(reading.problems.begin(), reading.problems.end(), order);
    throw InputError(std::move(reading.problems));
}

} // namespace marram
