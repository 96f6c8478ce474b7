// SPDX-License-Identifier: Apache-2.0
#include "core/scene/path_map.h"

#include "core/math/text.h"
#include "core/scene/suggest.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace marram {
namespace {

using nlohmann::json;

bool has_drive(std::string_view path) {
    return path.size() >= 2 && std::isalpha(static_cast<unsigned char>(path[0])) && path[1] == ':';
}

// A path in parts. The first of an absolute one is "/", that of a share "//".
std::vector<std::string> parts_of(const std::string& path, PathFormat format) {
    std::string text = path;
    if (format == PathFormat::windows) std::ranges::replace(text, '\\', '/');
    std::vector<std::string> parts;
    if (format == PathFormat::windows && text.starts_with("//"))
        parts.emplace_back("//");
    else if (text.starts_with('/'))
        parts.emplace_back("/");
    for (std::string& part : split(text, '/'))
        if (!part.empty() && part != ".") parts.push_back(std::move(part));
    return parts;
}

bool same_part(const std::string& a, const std::string& b, PathFormat format) {
    if (format == PathFormat::posix) return a == b;
    return std::ranges::equal(a, b, [](unsigned char x, unsigned char y) {
        return std::tolower(x) == std::tolower(y); // of ASCII: the others keep their case in the C locale
    });
}

// ---- Files of rules -------------------------------------------------------------------------------------

// Where the values of a JSON text begin. A parser of its own keeps places and no values: nlohmann-json's tree
// has none.
class JsonPlaces {
  public:
    JsonPlaces(const std::string& file, const std::string& text) : file_(file), text_(text) {}

    // The place of the value that a path of keys and indices ("path_mapping_rules", "0", "source_path") leads
    // to, or of the last one on the way.
    Place find(const std::vector<std::string>& path) {
        at_ = 0;
        blanks();
        size_t found = at_;
        for (const std::string& step : path) {
            if (!enter(step)) break;
            found = at_;
        }
        return place_of(file_, text_, found);
    }

  private:
    void blanks() { at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size()); }
    std::string string() {
        const size_t begin = at_++;
        while (at_ < text_.size() && text_[at_] != '"') at_ += text_[at_] == '\\' ? 2 : 1;
        at_ = std::min(at_ + 1, text_.size());
        return json::parse(text_.substr(begin, at_ - begin)).get<std::string>();
    }
    void skip_value() {
        int depth = 0;
        do {
            const char c = text_[at_];
            depth += c == '{' || c == '[' ? 1 : c == '}' || c == ']' ? -1 : 0;
            if (c == '"')
                string();
            else if (c == '{' || c == '[' || c == '}' || c == ']' || depth > 0)
                ++at_;
            else
                at_ = std::min(text_.find_first_of(",]} \t\r\n", at_), text_.size());
        } while (depth > 0 && at_ < text_.size());
    }
    // Moves to the value of this key or index, of the last one if a key is there twice. False: there is none.
    bool enter(const std::string& step) {
        const bool object = text_[at_] == '{';
        if (!object && text_[at_] != '[') return false;
        ++at_;
        size_t found = std::string::npos;
        for (size_t index = 0;; ++index) {
            blanks();
            if (at_ >= text_.size() || text_[at_] == '}' || text_[at_] == ']') break;
            std::string name = std::to_string(index);
            if (object) {
                name = string();
                blanks();
                ++at_; // :
                blanks();
            }
            if (name == step) found = at_;
            skip_value();
            blanks();
            if (at_ < text_.size() && text_[at_] == ',') ++at_;
        }
        if (found != std::string::npos) at_ = found;
        return found != std::string::npos;
    }

    const std::string& file_;
    const std::string& text_;
    size_t at_ = 0;
};

constexpr const char* rules_key = "path_mapping_rules";
constexpr const char* version = "pathmapping-1.0";
constexpr const char* example = "write {\"version\": \"pathmapping-1.0\", \"path_mapping_rules\": [...]}";
constexpr size_t max_bytes = size_t(16) << 20;

std::string text_of_rules(const std::string& file) {
    std::error_code error;
    if (!std::filesystem::exists(file, error))
        throw InputError({file}, "there is no such file of path mappings", "check the path");
    if (std::filesystem::is_directory(file, error))
        throw InputError({file}, "this is a directory", "name a file of path mappings (JSON)");
    std::ifstream in(file, std::ios::binary);
    std::string text(max_bytes + 1, '\0');
    in.read(text.data(), std::streamsize(text.size()));
    text.resize(size_t(std::max<std::streamsize>(in.gcount(), 0)));
    if (!in.is_open() || in.bad())
        throw InputError({file}, "the file of path mappings cannot be read", "check its permissions");
    if (text.size() > max_bytes)
        throw InputError({file}, "is larger than 16 MB", "name a file of path mappings (JSON)");
    text.erase(0, byte_order_mark(file, text));
    return text;
}

// Reads the rules one by one, and collects the mistakes.
class RuleReader {
  public:
    RuleReader(const std::string& file, const std::string& text) : places_(file, text) {}

    std::vector<PathRule> read(const json& root) {
        if (!root.is_object()) {
            report({}, "is no object", example);
        } else {
            const auto known = root.find("version");
            if (known == root.end())
                report({}, "has no version", example);
            else if (*known != version)
                report({"version"}, fmt::format("the version is {}, not \"{}\"", shown(*known), version),
                       example);
            const auto list = root.find(rules_key);
            if (list == root.end())
                report({}, fmt::format("has no {}", rules_key), example);
            else if (!list->is_array())
                report({rules_key}, fmt::format("{} is no list", rules_key), example);
            else
                for (size_t i = 0; i < list->size(); ++i) read_rule((*list)[i], i);
        }
        if (!problems_.empty()) throw InputError(std::move(problems_));
        return std::move(rules_);
    }

  private:
    static std::string shown(const json& value) {
        if (value.is_structured()) return value.is_array() ? "a list" : "an object";
        return clean(value.dump(-1, ' ', false, json::error_handler_t::replace));
    }
    void report(const std::vector<std::string>& path, std::string what, std::string fix) {
        problems_.push_back({places_.find(path), std::move(what), std::move(fix)});
    }
    void read_rule(const json& rule, size_t index) {
        const std::vector<std::string> path = {rules_key, std::to_string(index)};
        if (!rule.is_object())
            return report(path, fmt::format("rule {} is no object", index + 1),
                          "give source_path_format, source_path and destination_path");
        const size_t before = problems_.size();
        const std::string format = text(rule, path, index, "source_path_format"),
                          from = text(rule, path, index, "source_path"),
                          to = text(rule, path, index, "destination_path");
        if (problems_.size() > before) return;
        std::string upper = format;
        std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return char(std::toupper(c)); });
        if (upper != "POSIX" && upper != "WINDOWS") {
            auto at = path;
            at.emplace_back("source_path_format");
            return report(at,
                          fmt::format("source_path_format of rule {} is {}", index + 1, in_quotes(format)),
                          "write \"POSIX\" or \"WINDOWS\"");
        }
        rules_.push_back({upper == "POSIX" ? PathFormat::posix : PathFormat::windows, from, to});
    }
    std::string text(const json& rule, std::vector<std::string> path, size_t index, const char* key) {
        const auto value = rule.find(key);
        if (value == rule.end()) {
            report(path, fmt::format("rule {} has no {}", index + 1, key), "add it, a text in quotes");
            return "";
        }
        path.emplace_back(key);
        if (value->is_string() && !value->get_ref<const std::string&>().empty())
            return value->get<std::string>();
        report(path, fmt::format("{} of rule {} is {}", key, index + 1, shown(*value)),
               "give a path, a text in quotes");
        return "";
    }

    JsonPlaces places_;
    std::vector<PathRule> rules_;
    std::vector<Problem> problems_;
};

} // namespace

std::string PathMap::apply(const std::string& path) const {
    const PathRule* best = nullptr;
    size_t most = 0;
    std::vector<std::string> rest;
    for (const PathRule& rule : rules) {
        const std::vector<std::string> from = parts_of(rule.from, rule.format),
                                       parts = parts_of(path, rule.format);
        if (from.empty() || from.size() > parts.size() || (best && from.size() <= most)) continue;
        bool same = true;
        for (size_t i = 0; i < from.size() && same; ++i) same = same_part(from[i], parts[i], rule.format);
        if (!same) continue;
        best = &rule;
        most = from.size();
        rest.assign(parts.begin() + std::ptrdiff_t(from.size()), parts.end());
    }
    if (!best) return path;
    std::string to = best->to;
    for (const std::string& part : rest) to += (to.ends_with('/') ? "" : "/") + part;
    return to;
}

PathRule parse_path_rule(const std::string& text) {
    const size_t equals = text.find('=');
    const std::string from = text.substr(0, equals),
                      to = equals == std::string::npos ? "" : text.substr(equals + 1);
    if (equals == std::string::npos || parts_of(from, PathFormat::posix).empty() || to.empty())
        throw InputError(
            {"--map " + text}, "is no mapping of paths",
            "write FROM=TO, such as /studio/show=/mnt/show; paths with an = go into a --map-file");
    const bool windows = from.find('\\') != std::string::npos || has_drive(from);
    return {windows ? PathFormat::windows : PathFormat::posix, from, to};
}

std::vector<PathRule> read_path_rules(const std::string& file) {
    const std::string text = text_of_rules(file);
    try {
        return RuleReader(file, text).read(json::parse(text));
    } catch (const json::parse_error& error) {
        // The byte, from 1, of the last character read: of the one that is wrong.
        throw InputError(place_of(file, text, std::min(error.byte > 0 ? error.byte - 1 : 0, text.size())),
                         error.byte > text.size() ? "the JSON ends in the middle" : "this is no JSON",
                         example);
    } catch (const json::exception&) {
        throw InputError({file}, "this is no JSON", example);
    }
}

} // namespace marram
