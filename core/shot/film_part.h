// SPDX-License-Identifier: Apache-2.0
// Parts of a frame that are rendered alone: some of its pixels, some of their samples.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace marram {

// A box of pixels and samples, each from its first to the one after its last. Pixels count from the
// picture's top left, samples from 0.
struct FilmPart {
    uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    uint32_t first_sample = 0, end_sample = 0;

    uint32_t width() const { return x1 - x0; }
    uint32_t height() const { return y1 - y0; }
    bool operator==(const FilmPart&) const = default;
};

// What --crop and --samples ask for; without them, the whole picture.
struct PartRequest {
    bool crops = false, limits_samples = false;
    FilmPart part;
    bool given() const { return crops || limits_samples; }
};

// Parses "X0,Y0,X1,Y1" (X1 and Y1 excluded) and "A-B" (both included). Throws InputError with the column of
// what is not understood.
void parse_crop(const std::string& text, PartRequest& request);
void parse_samples(const std::string& text, PartRequest& request);

// The part of a picture of this size and number of samples. Throws InputError if it goes beyond it.
FilmPart part_of(const PartRequest& request, uint32_t width, uint32_t height, uint32_t samples);

// The same pixels of a picture with so many samples, in parts of no more than `samples_per_part` each.
std::vector<PartRequest> split_samples(const PartRequest& request, uint32_t samples,
                                       uint32_t samples_per_part);

// "crop_0_0_480_270.samples_0_63.", for file names; "" if all is asked for.
std::string part_name(const PartRequest& request);

// "samples 0-63 of pixels 0,0 to 480,270" (X1 and Y1 excluded, as in --crop).
std::string to_string(const FilmPart& part);

bool overlap(const FilmPart& a, const FilmPart& b);

// The smallest part around all; they must not be none.
FilmPart bounds_of(std::span<const FilmPart> parts);

// The samples of `whole` that are in none of `parts`.
std::vector<FilmPart> missing_of(const FilmPart& whole, std::span<const FilmPart> parts);

// The same samples in fewer parts where neighbours fit together.
std::vector<FilmPart> join_neighbours(std::vector<FilmPart> parts);

} // namespace marram
