// SPDX-License-Identifier: Apache-2.0
#include "core/shot/film_state.h"

#include "core/image/atomic_file.h"
#include "core/image/doubles.h"
#include "core/math/hash.h"
#include "core/math/problem.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <optional>

namespace marram {
namespace {

constexpr std::string_view magic = "marram frame state ",
                           format_version = "4 "; // change it when the channels change

constexpr uint32_t catcher_channels = 3; // the fields of CatcherSums

uint32_t channels_of(const Film& film) {
    return film.stride + film_pixel_field_count + (film.catchers.empty() ? 0 : catcher_channels);
}

void pack_row(const Film& film, int y, double* to) {
    for (size_t i = size_t(y) * film.width; i < size_t(y + 1) * film.width; ++i) {
        to = std::copy_n(film.sums.data() + i * film.stride, film.stride, to);
        visit_fields(film.pixel_states[i], [&](const auto& value) { *to++ = double(value); });
        if (film.catchers.empty()) continue;
        const CatcherSums& caught = film.catchers[i];
        for (const double sum : {caught.samples, caught.lit, caught.full}) *to++ = sum;
    }
}

// A damaged file may hold any number. Values out of range become 0, and the checksum then fails.
void unpack(double from, uint32_t& to) {
    to = from >= 0.0 && from <= double(UINT32_MAX) ? uint32_t(from) : 0U;
}
void unpack(double from, bool& to) { to = from == 1.0; }
void unpack(double from, double& to) { to = from; }
void unpack(double from, float& to) { to = float(from); }

void unpack_row(const double* from, int y, Film& film) {
    for (size_t i = size_t(y) * film.width; i < size_t(y + 1) * film.width; ++i) {
        std::copy_n(from, film.stride, film.sums.data() + i * film.stride);
        from += film.stride;
        visit_fields(film.pixel_states[i], [&](auto& value) { unpack(*from++, value); });
        if (film.catchers.empty()) continue;
        film.catchers[i] = {from[0], from[1], from[2]};
        from += catcher_channels;
    }
}

uint64_t checksum(const Film& film) {
    std::vector<uint64_t> rows(film.height);
    tbb::parallel_for(uint32_t(0), film.height, [&](uint32_t y) {
        std::vector<double> row(size_t(film.width) * channels_of(film));
        pack_row(film, int(y), row.data());
        for (const double value : row) rows[y] = hash(rows[y], std::bit_cast<uint64_t>(value));
    });
    uint64_t all = 0;
    for (const uint64_t row : rows) all = hash(all, row);
    return all;
}

DoublesHeader header_of(const Film& film, const std::string& samples_digest) {
    return {int(film.width), int(film.height), int(channels_of(film)),
            fmt::format("{}{}{} ", magic, format_version, samples_digest)};
}

// nullopt if the file cannot be opened as a picture.
std::optional<DoublesHeader> try_header(const std::string& state) {
    try {
        return read_doubles_header(state);
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

bool try_read(const std::string& state, const DoublesHeader& header, Film& film) {
    try {
        read_doubles(state, header, [&](int y, const double* row) { unpack_row(row, y, film); });
        return true;
    } catch (const InputError&) {
        return false;
    }
}

} // namespace

std::string state_name(const std::string& picture) { return picture + ".state.tif"; }

void check_state_overwrite(const std::string& state) {
    std::error_code error;
    if (!std::filesystem::exists(state, error)) return;
    check_writable(state, Links::replace);
    const std::optional<DoublesHeader> header = try_header(state);
    const bool is_frame_state = header ? header->description.starts_with(magic) : begins_like_tiff(state);
    if (!is_frame_state)
        throw InputError({state}, "this file would be overwritten by the state of an unfinished frame",
                         "move it, or choose another output");
}

void save_state(const std::string& state, const Film& film, const std::string& samples_digest) {
    DoublesHeader header = header_of(film, samples_digest);
    header.description += fmt::format("{:016x}", checksum(film));
    write_doubles(state, header, [&](int y, double* row) { pack_row(film, y, row); });
}

std::string load_state(const std::string& state, const std::string& samples_digest, uint32_t samples,
                       Film& film) {
    constexpr const char* damaged = "is damaged or cut short";
    const std::optional<DoublesHeader> found = try_header(state);
    if (!found) return damaged;
    const DoublesHeader wanted = header_of(film, samples_digest);
    if (!found->description.starts_with(wanted.description))
        return "belongs to another scene, size, layer list, frame or program version";
    if (found->width != wanted.width || found->height != wanted.height || found->channels != wanted.channels)
        return damaged;
    std::string reason;
    if (!try_read(state, *found, film) ||
        found->description != wanted.description + fmt::format("{:016x}", checksum(film)))
        reason = damaged;
    else if (const uint32_t reached = progress_of(film).max; reached > samples)
        reason = fmt::format("has {} samples a pixel, more than the {} asked for", reached, samples);
    if (!reason.empty()) clear(film);
    return reason;
}

} // namespace marram
