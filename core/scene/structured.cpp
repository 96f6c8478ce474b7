// SPDX-License-Identifier: Apache-2.0
// Values with parts: ramps, keyed transforms, points, paths.
#include "core/math/frame_name.h"
#include "core/math/udim.h"
#include "core/scene/libraries.h"
#include "core/scene/param_types.h"
#include "core/scene/suggest.h"
#include "core/scene/values.h"
#include "core/scene/words.h"

#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

namespace marram {
namespace {

constexpr double unbounded = std::numeric_limits<double>::infinity();
// Larger values in transforms are typing mistakes, and floats would lose too much precision.
constexpr double max_frame = 1e6, max_distance = 1e8, max_angle = 1e6, max_scale = 1e6;

bool ascends(const std::vector<double>& numbers, size_t stride) {
    return numbers.size() < 2 * stride ||
           numbers[numbers.size() - stride] > numbers[numbers.size() - 2 * stride];
}

bool read_knot(const toml::node& node, const ParamSpec& spec, const std::string& label,
               std::vector<double>& numbers, Reading& reading) {
    const toml::array* knot = node.as_array();
    if (!knot || knot->size() != 2) {
        reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                       "give [position, value]");
        return false;
    }
    const auto position = read_number(*knot->get(0), -unbounded, unbounded, "the position of " + label,
                                      "give a number", reading);
    const auto number = read_number(*knot->get(1), spec.minimum, spec.maximum, "the value of " + label,
                                    "give a number" + bounds(spec), reading);
    if (!position || !number) return false;
    numbers.insert(numbers.end(), {*position, *number});
    if (ascends(numbers, 2)) return true;
    reading.report(place_of(*knot->get(0), reading), fmt::format("the position of {} does not ascend", label),
                   "sort the knots by position, each position once");
    return false;
}

// Reads translate, rotate and scale of one key of a transform. Omitted ones are the identity.
bool read_key(const toml::table& table, const std::string& label, std::vector<double>& numbers,
              Reading& reading) {
    auto limits = [](const char* unit, double most) {
        return ParamSpec{"", ParamType::vec3, unit, "", -most, most, "", ""};
    };
    auto read = [&](const char* name, double initial, const ParamSpec& spec, bool scalar) {
        if (const toml::node* node = table.get(name))
            return read_numbers(*node, spec, 3, scalar, label + "." + name, numbers, reading);
        numbers.insert(numbers.end(), 3, initial);
        return true;
    };
    bool good = read("translate", 0.0, limits("m", max_distance), false);
    good = read("rotate", 0.0, limits("deg", max_angle), false) && good;
    const bool scales = read("scale", 1.0, limits("", max_scale), true);
    if (!scales) return false;
    for (size_t i = numbers.size() - 3; i < numbers.size(); ++i) {
        if (std::fabs(numbers[i]) >= 1.0 / max_scale) continue;
        reading.report(place_of(*table.get("scale"), reading), fmt::format("{}.scale is (nearly) 0", label),
                       "give a scale other than 0, it may be negative");
        return false;
    }
    return good;
}

bool read_keyed(const toml::array& keys, const std::string& label, ParamValue& value, Reading& reading) {
    const std::vector<std::string> known = {"frame", "translate", "rotate", "scale"};
    bool good = true;
    for (size_t i = 0; i < keys.size(); ++i) {
        const std::string name = fmt::format("key {} of {}", i + 1, label);
        const toml::table* key = keys.get(i)->as_table();
        if (!key) {
            reading.report(place_of(*keys.get(i), reading),
                           fmt::format("{} is {}", name, found(*keys.get(i))),
                           "give { frame = 1, translate = [x, y, z], ... }");
            good = false;
            continue;
        }
        good = only_keys(*key, known, name, reading) && good;
        const toml::node* frame = key->get("frame");
        if (!frame) {
            reading.report(place_of(*key, reading), fmt::format("{} has no frame", name), "add frame = ...");
            good = false;
            continue;
        }
        const auto number = read_number(
            *frame, -max_frame, max_frame, name + ".frame",
            fmt::format("give a number from {} to {}", limit(-max_frame), limit(max_frame)), reading);
        if (!number) return false; // the order of later keys cannot be checked
        std::vector<double> numbers = {*number};
        good = read_key(*key, name, numbers, reading) && good;
        numbers.resize(10);
        value.numbers.insert(value.numbers.end(), numbers.begin(), numbers.end());
        if (ascends(value.numbers, 10)) continue;
        reading.report(place_of(*frame, reading), fmt::format("{}.frame does not ascend", name),
                       "sort the keys by frame, each frame once");
        return false;
    }
    return good;
}

// The frame and the value of one key. Empty after a mistake has been reported.
std::optional<std::pair<double, ParamValue>> read_keyframe(const toml::node& node, const ParamSpec& spec,
                                                           const std::string& label, Reading& reading) {
    const toml::array* key = node.as_array();
    if (!key || key->size() != 2) {
        reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                       "give [frame, value], the value " + wanted(spec));
        return {};
    }
    const auto frame =
        read_number(*key->get(0), -max_frame, max_frame, "the frame of " + label,
                    fmt::format("give a number from {} to {}", limit(-max_frame), limit(max_frame)), reading);
    ParamValue value;
    const bool good =
        row_of(spec.type).read(*key->get(1), spec, "the value of " + label, value, reading) && frame;
    if (!good) return {};
    return std::pair(*frame, std::move(value));
}

// The most similar name in the folder of a missing file.
std::string nearest_file(const std::filesystem::path& path) {
    namespace fs = std::filesystem;
    constexpr size_t most = 10000;
    std::error_code error;
    std::vector<std::string> names;
    for (fs::directory_iterator it(path.has_parent_path() ? path.parent_path() : ".", error), end;
         !error && it != end && names.size() < most; it.increment(error))
        names.push_back(it->path().filename().string());
    return nearest(path.filename().string(), names);
}

} // namespace

bool read_keyframes(const toml::table& table, const ParamSpec& spec, const std::string& label,
                    ParamValue& value, Reading& reading) {
    const std::vector<std::string> known = {"keys", "interpolation"};
    bool good = only_keys(table, known, label, reading);
    Keyframes keys;
    // What is on or off has nothing in between.
    if (spec.type == ParamType::boolean) keys.interpolation = KeyInterpolation::constant;
    if (const toml::node* node = table.get("interpolation")) {
        const auto names = spec.type == ParamType::boolean ? "constant" : key_interpolations;
        std::string name;
        if (read_choice(*node, split(names, '|'), label + ".interpolation", name, reading))
            keys.interpolation = *key_interpolation(name);
        else
            good = false;
    }
    const toml::node& node = *table.get("keys");
    const toml::array* list = node.as_array();
    if (!list || list->empty()) {
        reading.report(place_of(node, reading), fmt::format("{}.keys is {}", label, found(node)),
                       "give a list of keys, [[frame, value], ...]");
        return false;
    }
    for (size_t i = 0; i < list->size(); ++i) {
        const std::string name = fmt::format("key {} of {}", i + 1, label);
        const toml::node& at = *list->get(i);
        auto key = read_keyframe(at, spec, name, reading);
        good = good && key;
        if (!key) continue;
        auto& [frame, one] = *key;
        if (!keys.frames.empty() && frame <= keys.frames.back()) {
            reading.report(place_of(at, reading), fmt::format("the frame of {} does not ascend", name),
                           "sort the keys by frame, each frame once");
            return false;
        }
        if (!keys.frames.empty() && (one.numbers.size() != value.numbers.size() || one.text != value.text)) {
            reading.report(place_of(at, reading), // only ramps can differ so
                           fmt::format("{} has other knots than the first key", name),
                           "give all keys the same number of knots and the same interpolation");
            return false;
        }
        if (keys.frames.empty()) {
            value.numbers = one.numbers;
            value.text = one.text;
        }
        keys.frames.push_back(frame);
        keys.numbers.insert(keys.numbers.end(), one.numbers.begin(), one.numbers.end());
    }
    if (good) value.keys = std::move(keys);
    return good;
}

bool read_ramp(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading) {
    const std::vector<std::string> known = {"knots", "interpolation"},
                                   ways = {"linear", "smooth", "constant"};
    const toml::table* table = node.as_table();
    const toml::node* list = table ? table->get("knots") : &node;
    bool good = !table || only_keys(*table, known, label, reading);
    value.text = "linear";
    if (const toml::node* way = table ? table->get("interpolation") : nullptr)
        good = read_choice(*way, ways, label + ".interpolation", value.text, reading) && good;
    const toml::array* knots = list ? list->as_array() : nullptr;
    if (!knots || knots->empty()) {
        const toml::node& wrong = list ? *list : node;
        reading.report(place_of(wrong, reading),
                       list ? fmt::format("{} is {}", label, found(wrong))
                            : fmt::format("{} has no knots", label),
                       "give " + wanted(spec));
        return false;
    }
    for (size_t i = 0; i < knots->size(); ++i)
        good = read_knot(*knots->get(i), spec, fmt::format("knot {} of {}", i + 1, label), value.numbers,
                         reading) &&
               good;
    return good;
}

bool read_keys(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading) {
    const toml::table* table = node.as_table();
    if (!table) {
        reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                       "give " + wanted(spec));
        return false;
    }
    value.text = "linear";
    const toml::node* keys = table->get("keys");
    if (!keys) {
        const std::vector<std::string> known = {"translate", "rotate", "scale", "keys"};
        bool good = only_keys(*table, known, label, reading);
        value.numbers = {0.0}; // frame of the only key, without effect
        return read_key(*table, label, value.numbers, reading) && good;
    }
    const std::vector<std::string> known = {"keys", "interpolation"}, ways = {"linear", "smooth"};
    bool good = only_keys(*table, known, label, reading);
    if (const toml::node* way = table->get("interpolation"))
        good = read_choice(*way, ways, label + ".interpolation", value.text, reading) && good;
    if (!keys->is_array() || keys->as_array()->empty()) {
        reading.report(place_of(*keys, reading), fmt::format("{}.keys is {}", label, found(*keys)),
                       "give a list of { frame = 1, translate = [x, y, z], ... }");
        return false;
    }
    return read_keyed(*keys->as_array(), label, value, reading) && good;
}

bool read_points(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading) {
    const toml::array* list = node.as_array();
    if (!list || list->empty()) {
        reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                       "give " + wanted(spec));
        return false;
    }
    bool good = true;
    for (size_t i = 0; i < list->size(); ++i)
        good = read_numbers(*list->get(i), spec, 3, false, fmt::format("point {} of {}", i + 1, label),
                            value.numbers, reading) &&
               good;
    return good;
}

bool read_path(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading) {
    namespace fs = std::filesystem;
    auto fail = [&](std::string what, std::string fix) {
        reading.report(place_of(node, reading), std::move(what), std::move(fix));
        return false;
    };
    const auto* text = node.as_string();
    if (!text || text->get().empty() || text->get().find('\0') != std::string::npos)
        return fail(fmt::format("{} is {}", label, found(node)), "give " + wanted(spec));
    const bool library = spec.choices == "library";
    const fs::path folder = fs::path(reading.file).parent_path();
    const std::string name = reading.paths.apply(text->get());
    const fs::path path = library ? fs::path(library_path(folder.string(), name)) : folder / name;
    const bool mapped = name != text->get();
    const std::string shown =
        in_quotes(name) + (mapped ? fmt::format(" (mapped from {})", in_quotes(text->get())) : "");
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (status.type() == fs::file_type::not_found) {
        if (spec.choices == "numbered" && has_frame_mark(name)) {
            value.text = path.string(); // one file per frame: checked when read
            return true;
        }
        if (spec.choices == "uv" && has_udim(name) && !udim_tiles(path.string()).empty()) {
            value.text = path.string();
            return true;
        }
        if (has_udim(name))
            return spec.choices == "uv"
                       ? fail(fmt::format("{}: there is no tile of {}", label, shown),
                              "name tiles by 1001 + u + 10 v, or check the path, it is relative to the scene "
                              "file's folder")
                       : fail(fmt::format(
                                  "{}: {} is in tiles, but this image is not looked up by the uv of a mesh",
                                  label, shown),
                              "name one file");
        const std::string near = nearest_file(path);
        fail(fmt::format("{}: there is no file {}", label, shown),
             !near.empty() ? fmt::format("did you mean {}?", in_quotes(near))
             : mapped      ? "check what the path is mapped to"
             : library     ? "check the path, relative to the scene file's folder, or MARRAM_PLUGIN_PATH"
                           : "check the path, it is relative to the scene file's folder");
        reading.problems.back().missing_file = path.string();
        return false;
    }
    if (status.type() == fs::file_type::directory)
        return fail(fmt::format("{}: {} is a directory", label, shown), "name a file in it");
    if (!error && status.type() != fs::file_type::regular) // opening a pipe would block
        return fail(fmt::format("{}: {} is no file but a pipe or device", label, shown), "name a file");
    if (error)
        return fail(fmt::format("{}: {} cannot be read ({})", label, shown, error.message()),
                    "check the path");
    if (!std::ifstream(path))
        return fail(fmt::format("{}: {} cannot be read", label, shown), "check its permissions");
    value.text = path.string();
    return true;
}

namespace {

// The frames of numbered files: whole numbers.
bool read_file_frames(const toml::node& node, const std::string& label, ParamValue& value, Reading& reading) {
    constexpr double latest = 1e6, max_files = 4096.0;
    ParamSpec frames{.name = label, .type = ParamType::range, .minimum = -latest, .maximum = latest};
    if (!read_numbers(node, frames, 2, true, label, value.numbers, reading)) return false;
    const double first = value.numbers[0], last = value.numbers[1];
    const bool whole = first == std::floor(first) && last == std::floor(last);
    if (whole && first <= last && last - first < max_files) return true;
    reading.report(
        place_of(node, reading), fmt::format("{} is [{:g}, {:g}]", label, first, last),
        fmt::format("give the first and the last frame, whole numbers, at most {:g} frames", max_files));
    return false;
}

} // namespace

bool read_volume(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading) {
    const toml::table* table = node.as_table();
    const toml::node* file = table ? table->get("file") : &node;
    if (table && !only_keys(*table, std::vector<std::string>{"file", "frames", "grid"}, label, reading))
        return false;
    if (!file) {
        reading.report(place_of(node, reading), fmt::format("{} names no file", label),
                       "give " + wanted(spec));
        return false;
    }
    ParamSpec path = spec;
    path.choices = "numbered";
    if (!read_path(*file, path, table ? label + ".file" : label, value, reading)) return false;
    const toml::node* frames = table ? table->get("frames") : nullptr;
    if (frames && !read_file_frames(*frames, label + ".frames", value, reading)) return false;
    const bool numbered_files = has_frame_mark(value.text);
    if (numbered_files != (frames != nullptr)) {
        reading.report(place_of(frames ? *frames : *file, reading),
                       frames ? fmt::format("{}.file is one file for all frames", label)
                              : fmt::format("{} is a sequence without frames", label),
                       frames ? "put a #### where the frame's number belongs, or leave frames out"
                              : "give { file = \"a.####.vdb\", frames = [first, last] }");
        return false;
    }
    if (const toml::node* grid = table ? table->get("grid") : nullptr) {
        if (!grid->is_string() || grid->as_string()->get().empty()) {
            reading.report(place_of(*grid, reading), fmt::format("{}.grid is {}", label, found(*grid)),
                           "give the grid's name, in quotes");
            return false;
        }
        value.texts = {grid->as_string()->get()};
    }
    return true;
}

} // namespace marram
