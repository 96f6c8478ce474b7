// SPDX-License-Identifier: Apache-2.0
#include "core/shot/film_part.h"

#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>

namespace marram {
namespace {

// `count` whole numbers separated by `separator`.
template <size_t count>
std::array<uint32_t, count> numbers_of(const std::string& option, const std::string& text, char separator,
                                       const std::string& fix) {
    std::array<uint32_t, count> numbers{};
    const char *begin = text.data(), *at = begin, *end = at + text.size();
    const auto refuse = [&] {
        throw InputError({option + " " + text, 1, int(at - begin) + 1}, "is not understood from here", fix);
    };
    for (size_t i = 0; i < count; ++i) {
        if (i > 0 && (at == end || *at != separator)) refuse();
        if (i > 0) ++at;
        const auto [after, error] = std::from_chars(at, end, numbers[i]);
        if (error != std::errc{}) refuse();
        at = after;
    }
    if (at != end) refuse();
    return numbers;
}

void subtract(const FilmPart& from, const FilmPart& part, std::vector<FilmPart>& left) {
    if (!overlap(from, part)) return left.push_back(from);
    FilmPart rest = from;
    const auto cut = [&](uint32_t FilmPart::*begin, uint32_t FilmPart::*end) {
        if (rest.*begin < part.*begin) {
            left.push_back(rest);
            left.back().*end = part.*begin;
            rest.*begin = part.*begin;
        }
        if (rest.*end > part.*end) {
            left.push_back(rest);
            left.back().*begin = part.*end;
            rest.*end = part.*end;
        }
    };
    cut(&FilmPart::first_sample, &FilmPart::end_sample);
    cut(&FilmPart::y0, &FilmPart::y1);
    cut(&FilmPart::x0, &FilmPart::x1);
}

// Joins b to a if both differ along one side alone and touch there.
bool join(FilmPart& a, const FilmPart& b) {
    const auto try_side = [&](uint32_t FilmPart::*begin, uint32_t FilmPart::*end) {
        FilmPart moved = b;
        moved.*begin = a.*begin;
        moved.*end = a.*end;
        if (moved != a || (a.*end != b.*begin && b.*end != a.*begin)) return false;
        a.*begin = std::min(a.*begin, b.*begin);
        a.*end = std::max(a.*end, b.*end);
        return true;
    };
    return try_side(&FilmPart::first_sample, &FilmPart::end_sample) ||
           try_side(&FilmPart::x0, &FilmPart::x1) || try_side(&FilmPart::y0, &FilmPart::y1);
}

} // namespace

void parse_crop(const std::string& text, PartRequest& request) {
    const std::string fix = "give the left, top, right and bottom pixel, right and bottom excluded, such as "
                            "--crop 0,0,480,270";
    const auto [x0, y0, x1, y1] = numbers_of<4>("--crop", text, ',', fix);
    if (x0 >= x1 || y0 >= y1) throw InputError({"--crop " + text}, "has no pixels", fix);
    request.crops = true;
    request.part.x0 = x0;
    request.part.y0 = y0;
    request.part.x1 = x1;
    request.part.y1 = y1;
}

void parse_samples(const std::string& text, PartRequest& request) {
    const std::string fix = "give the first and the last, counted from 0, such as --samples 0-63";
    const auto [first, last] = numbers_of<2>("--samples", text, '-', fix);
    if (last < first || last == UINT32_MAX) throw InputError({"--samples " + text}, "has no samples", fix);
    request.limits_samples = true;
    request.part.first_sample = first;
    request.part.end_sample = last + 1;
}

FilmPart part_of(const PartRequest& request, uint32_t width, uint32_t height, uint32_t samples) {
    FilmPart part{0, 0, width, height, 0, samples};
    const FilmPart& asked = request.part;
    if (request.crops) {
        if (asked.x1 > width || asked.y1 > height)
            throw InputError({fmt::format("--crop {},{},{},{}", asked.x0, asked.y0, asked.x1, asked.y1)},
                             fmt::format("goes beyond the picture, which has {} x {} pixels", width, height),
                             fmt::format("stay within 0,0,{},{}, or set another --size", width, height));
        part.x0 = asked.x0;
        part.y0 = asked.y0;
        part.x1 = asked.x1;
        part.y1 = asked.y1;
    }
    if (request.limits_samples) {
        if (asked.end_sample > samples)
            throw InputError(
                {fmt::format("--samples {}-{}", asked.first_sample, asked.end_sample - 1)},
                fmt::format("the picture has {} samples a pixel", samples),
                fmt::format("stay within 0-{}, or give the picture more with --spp", samples - 1));
        part.first_sample = asked.first_sample;
        part.end_sample = asked.end_sample;
    }
    return part;
}

std::vector<PartRequest> split_samples(const PartRequest& request, uint32_t samples,
                                       uint32_t samples_per_part) {
    std::vector<PartRequest> parts;
    for (uint32_t first = 0; first < samples; first += samples_per_part) {
        PartRequest& one = parts.emplace_back(request);
        one.limits_samples = true;
        one.part.first_sample = first;
        one.part.end_sample = first + std::min(samples_per_part, samples - first);
    }
    return parts;
}

std::string part_name(const PartRequest& request) {
    std::string name;
    const FilmPart& part = request.part;
    if (request.crops) name += fmt::format("crop_{}_{}_{}_{}.", part.x0, part.y0, part.x1, part.y1);
    if (request.limits_samples) name += fmt::format("samples_{}_{}.", part.first_sample, part.end_sample - 1);
    return name;
}

std::string to_string(const FilmPart& part) {
    return fmt::format("samples {}-{} of pixels {},{} to {},{}", part.first_sample, part.end_sample - 1,
                       part.x0, part.y0, part.x1, part.y1);
}

bool overlap(const FilmPart& a, const FilmPart& b) {
    return a.first_sample < b.end_sample && b.first_sample < a.end_sample && a.x0 < b.x1 && b.x0 < a.x1 &&
           a.y0 < b.y1 && b.y0 < a.y1;
}

FilmPart bounds_of(std::span<const FilmPart> parts) {
    FilmPart all = parts.front();
    for (const FilmPart& part : parts)
        all = {std::min(all.x0, part.x0),
               std::min(all.y0, part.y0),
               std::max(all.x1, part.x1),
               std::max(all.y1, part.y1),
               std::min(all.first_sample, part.first_sample),
               std::max(all.end_sample, part.end_sample)};
    return all;
}

std::vector<FilmPart> missing_of(const FilmPart& whole, std::span<const FilmPart> parts) {
    std::vector<FilmPart> missing = {whole};
    for (const FilmPart& part : parts) {
        std::vector<FilmPart> left;
        for (const FilmPart& piece : missing) subtract(piece, part, left);
        missing = std::move(left);
    }
    return join_neighbours(std::move(missing));
}

std::vector<FilmPart> join_neighbours(std::vector<FilmPart> parts) {
    for (bool changed = true; changed;) {
        changed = false;
        std::ranges::sort(parts, {}, [](const FilmPart& p) {
            return std::array{p.y0, p.x0, p.first_sample, p.y1, p.x1, p.end_sample};
        });
        for (size_t i = 0; i < parts.size(); ++i)
            for (size_t j = i + 1; j < parts.size();)
                if (join(parts[i], parts[j])) {
                    parts.erase(parts.begin() + long(j));
                    changed = true;
                } else {
                    ++j;
                }
    }
    return parts;
}

} // namespace marram
