// SPDX-License-Identifier: Apache-2.0
#include "core/cli/frame_state.h"

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

constexpr std::string_view mark = "marram frame state ",
                           layout = "2 "; // another number wherever channels change
// reached, taken, done, luminance, squares, ended_blocks, block_squares, clamped, spread: behind the sums
constexpr uint32_t own_channels = 9;

void pack_row(const Film& film, int y, double* to) {
    for (size_t pixel = size_t(y) * film.width; pixel < size_t(y + 1) * film.width; ++pixel) {
        to = std::copy_n(film.sums.data() + pixel * film.stride, film.stride, to);
        *to++ = double(film.reached[pixel]);
        *to++ = double(film.taken[pixel]);
        *to++ = double(film.done[pixel]);
        *to++ = film.luminance[pixel];
        *to++ = film.squares[pixel];
        *to++ = film.ended_blocks[pixel];
        *to++ = film.block_squares[pixel];
        *to++ = film.clamped[pixel];
        *to++ = double(film.spread[pixel]);
    }
}

void unpack_row(const double* from, int y, Film& film) {
    // A damaged file holds any number; what does not fit is 0 and the checksum tells.
    const auto whole = [](double value) {
        return value >= 0.0 && value <= double(UINT32_MAX) ? uint32_t(value) : 0U;
    };
    for (size_t pixel = size_t(y) * film.width; pixel < size_t(y + 1) * film.width; ++pixel) {
        std::copy_n(from, film.stride, film.sums.data() + pixel * film.stride);
        from += film.stride;
        film.reached[pixel] = whole(*from++);
        film.taken[pixel] = whole(*from++);
        film.done[pixel] = *from++ == 1.0;
        film.luminance[pixel] = *from++;
        film.squares[pixel] = *from++;
        film.ended_blocks[pixel] = *from++;
        film.block_squares[pixel] = *from++;
        film.clamped[pixel] = *from++;
        film.spread[pixel] = float(*from++);
    }
}

uint64_t checksum(const Film& film) {
    std::vector<uint64_t> rows(film.height);
    tbb::parallel_for(uint32_t(0), film.height, [&](uint32_t y) {
        std::vector<double> row(size_t(film.width) * (film.stride + own_channels));
        pack_row(film, int(y), row.data());
        for (const double value : row) rows[y] = hash(rows[y], std::bit_cast<uint64_t>(value));
    });
    uint64_t all = 0;
    for (const uint64_t row : rows) all = hash(all, row);
    return all;
}

DoublesHeader header_of(const Film& film, const std::string& digest) {
    return {int(film.width), int(film.height), int(film.stride + own_channels),
            fmt::format("{}{}{} ", mark, layout, digest)};
}

// nullopt where the file cannot be opened as a picture.
std::optional<DoublesHeader> try_header(const std::string& state) {
    try {
        return read_doubles_header(state);
    } catch (const InputError&) {
        return std::nullopt;
    }
}

// What is left of a damaged state: nothing, or the first bytes of a TIFF or BigTIFF.
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

void check_state_name(const std::string& state) {
    std::error_code error;
    if (!std::filesystem::exists(state, error)) return;
    check_writable(state);
    const std::optional<DoublesHeader> header = try_header(state);
    const bool ours = header ? header->description.starts_with(mark) : begins_like_tiff(state);
    if (!ours)
        throw InputError({state}, "this file stands where an unfinished frame's state would be written",
                         "move it, or choose another output");
}

void save_state(const std::string& state, const Film& film, const std::string& digest) {
    DoublesHeader header = header_of(film, digest);
    header.description += fmt::format("{:016x}", checksum(film));
    write_doubles(state, header, [&](int y, double* row) { pack_row(film, y, row); });
}

std::string load_state(const std::string& state, const std::string& digest, uint32_t samples, Film& film) {
    constexpr const char* damaged = "is damaged or cut short";
    const std::optional<DoublesHeader> found = try_header(state);
    if (!found) return damaged;
    const DoublesHeader wanted = header_of(film, digest);
    if (!found->description.starts_with(wanted.description))
        return "is of another scene, size, layers, frame or version";
    if (found->width != wanted.width || found->height != wanted.height || found->channels != wanted.channels)
        return damaged;
    std::string reason;
    if (!try_read(state, *found, film) ||
        found->description != wanted.description + fmt::format("{:016x}", checksum(film)))
        reason = damaged;
    else if (const uint32_t reached = *std::ranges::max_element(film.reached); reached > samples)
        reason = fmt::format("has {} samples a pixel, more than the {} asked for", reached, samples);
    if (!reason.empty()) clear(film);
    return reason;
}

} // namespace marram
