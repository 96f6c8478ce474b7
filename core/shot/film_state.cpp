// SPDX-License-Identifier: Apache-2.0
#include "core/shot/film_state.h"

#include "core/image/atomic_file.h"
#include "core/image/words.h"
#include "core/math/digest.h"
#include "core/math/problem.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>

namespace marram {
namespace {

using nlohmann::json;

constexpr std::string_view magic = "marram frame state ",
                           format_version = "5 "; // change it when the words or the JSON change
constexpr size_t checksum_digits = 16;
constexpr const char* damaged = "is damaged or cut short";

// Writes fields to words, or reads them back. A damaged file may hold any words: all are accepted here, and
// the checksum then fails.
struct Packer {
    uint32_t* at;
    void operator()(uint32_t value) { *at++ = value; }
    void operator()(bool value) { *at++ = value ? 1 : 0; }
    void operator()(float value) { *at++ = std::bit_cast<uint32_t>(value); }
    void operator()(Int128 value) {
        for (int i = 0; i < 4; ++i) *at++ = uint32_t(value >> (32 * i));
    }
    template <int unit>
    void operator()(const ExactSum<unit>& sum) {
        (*this)(sum.units());
    }
};
struct Unpacker {
    const uint32_t* at;
    void operator()(uint32_t& value) { value = *at++; }
    void operator()(bool& value) { value = *at++ == 1; }
    void operator()(float& value) { value = std::bit_cast<float>(*at++); }
    void operator()(Int128& value) {
        value = Int128(int32_t(at[3]));
        for (int i = 2; i >= 0; --i) value = value * (Int128(1) << 32) + at[i];
        at += 4;
    }
    template <int unit>
    void operator()(ExactSum<unit>& sum) {
        Int128 units = 0;
        (*this)(units);
        sum = ExactSum<unit>::of_units(units);
    }
};

// Visits all that is kept of the pixels of a row.
template <typename AnyFilm, typename Visit>
void visit_row(AnyFilm& film, uint32_t y, Visit&& visit) {
    const size_t layers = film.layers.size();
    for (size_t i = size_t(y) * film.width; i < size_t(y + 1) * film.width; ++i) {
        for (size_t s = i * film.stride; s < (i + 1) * film.stride; ++s) visit(film.sums[s]);
        for (size_t l = i * layers; l < (i + 1) * layers; ++l) visit(film.counts[l]);
        visit_fields(film.pixel_states[i], visit);
        if (film.catchers.empty()) continue;
        auto& caught = film.catchers[i];
        visit(caught.samples);
        visit(caught.lit);
        visit(caught.full);
    }
}

uint32_t words_of(const Film& film) { // a pixel
    Film one;
    one.width = one.height = 1;
    one.layers = film.layers;
    one.stride = film.stride;
    one.catchers.resize(film.catchers.empty() ? 0 : 1);
    clear(one);
    uint32_t words = 0;
    visit_row(one, 0, [&](const auto& value) { words += sizeof(value) >= sizeof(Int128) ? 4 : 1; });
    return words;
}

void pack_row(const Film& film, uint32_t y, uint32_t* to) { visit_row(film, y, Packer{to}); }

uint64_t checksum_of(const Film& film) {
    std::vector<uint64_t> rows(film.height);
    const size_t words = size_t(film.width) * words_of(film);
    tbb::parallel_for(uint32_t(0), film.height, [&](uint32_t y) {
        std::vector<uint32_t> row(words);
        pack_row(film, y, row.data());
        rows[y] = digest_bytes(row.data(), words * sizeof(uint32_t));
    });
    return Digest().add(rows).value();
}

json to_json(const FilmState& state) {
    json parts = json::array(), layers = json::array();
    for (const FilmPart& p : state.parts)
        parts.push_back({p.x0, p.y0, p.x1, p.y1, p.first_sample, p.end_sample});
    for (const FilmLayer& layer : state.layers)
        layers.push_back({layer.name, int(layer.kind), layer.channels, layer.discrete});
    return {{"scene", state.scene},
            {"frame", state.frame},
            {"size", {state.width, state.height}},
            {"samples", state.samples},
            {"film_digest", state.film_digest},
            {"picture_digest", state.picture_digest},
            {"exposure", state.exposure},
            {"seconds", state.seconds},
            {"transparent", state.transparent},
            {"catches_shadows", state.catches_shadows},
            {"layers", std::move(layers)},
            {"parts", std::move(parts)},
            {"finished", state.finished}};
}

FilmState from_json(const json& from) {
    FilmState state;
    state.scene = from.at("scene");
    state.frame = from.at("frame");
    state.width = from.at("size").at(0);
    state.height = from.at("size").at(1);
    state.samples = from.at("samples");
    state.film_digest = from.at("film_digest");
    state.picture_digest = from.at("picture_digest");
    state.exposure = from.at("exposure");
    state.seconds = from.at("seconds");
    state.transparent = from.at("transparent");
    state.catches_shadows = from.at("catches_shadows");
    state.finished = from.at("finished");
    for (const json& layer : from.at("layers")) {
        FilmLayer& made = state.layers.emplace_back();
        made.name = layer.at(0);
        made.kind = LayerKind(std::clamp(layer.at(1).get<int>(), 0, int(LayerKind::attribute)));
        made.channels = layer.at(2);
        made.discrete = layer.at(3);
    }
    for (const json& p : from.at("parts"))
        state.parts.push_back({p.at(0), p.at(1), p.at(2), p.at(3), p.at(4), p.at(5)});
    return state;
}

// Whether the numbers fit together, so that films can be made of them.
bool is_possible(const FilmState& state) {
    constexpr uint32_t max_size = 65536, max_channels = 4;
    const bool has_size = state.width > 0 && state.height > 0 && state.width <= max_size &&
                          state.height <= max_size && !state.parts.empty();
    return has_size &&
           std::ranges::all_of(state.parts,
                               [&](const FilmPart& p) {
                                   return p.x0 < p.x1 && p.y0 < p.y1 && p.x1 <= state.width &&
                                          p.y1 <= state.height && p.first_sample < p.end_sample;
                               }) &&
           std::ranges::all_of(state.layers, [](const FilmLayer& layer) {
               return layer.channels > 0 && layer.channels <= max_channels;
           });
}

[[noreturn]] void refuse_damaged(const std::string& path) {
    throw InputError({path}, damaged, "render this part of the frame again");
}

// The description but for the checksum of the words.
std::string described(const FilmState& state) {
    const std::string text = to_json(state).dump(-1, ' ', false, json::error_handler_t::replace);
    return fmt::format("{}{}{} {:0{}x} ", magic, format_version, text, digest_bytes(text.data(), text.size()),
                       checksum_digits);
}

// nullopt if the file cannot be opened as a picture.
std::optional<WordsHeader> try_header(const std::string& state) {
    try {
        return read_words_header(state);
    } catch (const InputError&) {
        return std::nullopt;
    }
}

// Whether the file may be a damaged state: it is empty, or begins like a TIFF or BigTIFF.
bool begins_like_tiff(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    char first[4] = {};
    file.read(first, sizeof first);
    const std::string_view begin(first, size_t(file.gcount()));
    return begin.empty() || std::string_view("II*\0", 4).starts_with(begin) ||
           std::string_view("II+\0", 4).starts_with(begin);
}

} // namespace

std::string state_name(const std::string& picture, const PartRequest& part) {
    return picture + "." + part_name(part) + "state.tif";
}

void check_state_overwrite(const std::string& state) {
    std::error_code error;
    if (!std::filesystem::exists(state, error)) return;
    check_writable(state, Links::replace);
    const std::optional<WordsHeader> header = try_header(state);
    const bool is_frame_state = header ? header->description.starts_with(magic) : begins_like_tiff(state);
    if (!is_frame_state)
        throw InputError({state}, "this file would be overwritten by the state of an unfinished frame",
                         "move it, or choose another output");
}

void save_state(const std::string& path, FilmState state, const Film& film) {
    state.layers = film.layers;
    state.transparent = film.transparent;
    state.catches_shadows = !film.catchers.empty();
    WordsHeader header{int(film.width), int(film.height), int(words_of(film)), described(state)};
    header.description += fmt::format("{:0{}x}", checksum_of(film), checksum_digits);
    write_words(path, header, [&](int y, uint32_t* row) { pack_row(film, uint32_t(y), row); });
}

FilmState read_state(const std::string& path) {
    std::error_code none;
    if (!std::filesystem::is_regular_file(path, none))
        throw InputError({path}, std::filesystem::exists(path, none) ? "is no file" : "there is no such file",
                         "give states that `marram render` has written");
    const std::optional<WordsHeader> header = try_header(path);
    if (!header && begins_like_tiff(path)) refuse_damaged(path);
    const std::string text = header ? header->description : "";
    if (!text.starts_with(magic))
        throw InputError(
            {path}, "is not the state of a frame",
            "give states that `marram render` has written with --samples, --crop or --keep-state");
    const size_t begin = magic.size() + format_version.size();
    if (text.substr(magic.size(), format_version.size()) != format_version)
        throw InputError({path}, "is of another version of the program", "render it with this one");
    constexpr size_t checksums = 2 * (1 + checksum_digits); // each after a space
    if (text.size() < begin + checksums) refuse_damaged(path);
    const json parsed = json::parse(text.begin() + long(begin), text.end() - long(checksums), nullptr, false);
    try {
        FilmState state = from_json(parsed);
        if (!is_possible(state) || described(state) != text.substr(0, text.size() - checksum_digits))
            refuse_damaged(path);
        return state;
    } catch (const json::exception&) {
        refuse_damaged(path);
    }
}

Film empty_film(const FilmState& state, const FilmPart& bounds) {
    Film film;
    film.width = bounds.width();
    film.height = bounds.height();
    film.transparent = state.transparent;
    film.layers = state.layers;
    for (FilmLayer& layer : film.layers) {
        layer.sums_offset = film.stride;
        film.stride += sum_count(layer);
    }
    if (state.catches_shadows) film.catchers.resize(size_t(film.width) * film.height);
    clear(film);
    return film;
}

namespace {

// Reads the words row by row, and throws InputError at the end if they are not those that were written.
void read_rows(const std::string& path, const FilmState& state, uint32_t words,
               const std::function<void(int, const uint32_t*)>& row) {
    const FilmPart own = bounds_of(state.parts);
    const std::optional<WordsHeader> header = try_header(path);
    if (!header || header->width != int(own.width()) || header->height != int(own.height()) ||
        header->channels != int(words))
        refuse_damaged(path);
    std::vector<uint64_t> checksums;
    try {
        read_words(path, *header, [&](int y, const uint32_t* from) {
            checksums.push_back(digest_bytes(from, size_t(own.width()) * words * sizeof(uint32_t)));
            row(y, from);
        });
    } catch (const InputError&) {
        refuse_damaged(path);
    }
    const std::string expected =
        described(state) + fmt::format("{:0{}x}", Digest().add(checksums).value(), checksum_digits);
    if (header->description != expected) refuse_damaged(path);
}

} // namespace

void check_sums(const std::string& path, const FilmState& state) {
    read_rows(path, state, words_of(empty_film(state, {0, 0, 1, 1, 0, 1})), [](int, const uint32_t*) {});
}

void add_state(const std::string& path, const FilmState& state, const FilmPart& bounds, Film& film) {
    const FilmPart own = bounds_of(state.parts);
    FilmPart of_row = own;
    of_row.y1 = own.y0 + 1;
    Film row = empty_film(state, of_row);
    read_rows(path, state, words_of(row), [&](int y, const uint32_t* from) {
        visit_row(row, 0, Unpacker{from});
        add_film(film, row, own.x0 - bounds.x0, own.y0 - bounds.y0 + uint32_t(y));
    });
}

std::string load_state(const std::string& path, const std::string& film_digest, const FilmPart& part,
                       Film& film) {
    FilmState state;
    try {
        state = read_state(path);
    } catch (const InputError& error) {
        return error.problems.front().what;
    }
    const auto same_layer = [](const FilmLayer& a, const FilmLayer& b) {
        return a.name == b.name && a.channels == b.channels && a.discrete == b.discrete;
    };
    if (state.film_digest != film_digest || !std::ranges::equal(state.layers, film.layers, same_layer) ||
        state.catches_shadows == film.catchers.empty())
        return "belongs to another scene, size, layer list, frame or program version";
    const FilmPart bounds = bounds_of(state.parts);
    FilmPart same = bounds;
    same.end_sample = part.end_sample;
    if (state.parts.size() > 1 || same != part)
        return fmt::format("has {}, and {} are asked for", to_string(state.parts.front()), to_string(part));
    try {
        add_state(path, state, bounds, film);
    } catch (const InputError& error) {
        clear(film);
        return error.problems.front().what;
    }
    const uint32_t reached = progress_of(film).max;
    if (reached <= part.end_sample) return "";
    clear(film);
    return fmt::format("has {} samples a pixel, more than the {} asked for", reached, part.end_sample);
}

} // namespace marram
