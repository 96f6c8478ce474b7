// SPDX-License-Identifier: Apache-2.0
// The state of a frame that was not finished: the film's samples, in a file beside its picture, for --resume to go on with.
//
// A TIFF of doubles (core/image/doubles.h): a pixel holds the film's sums and counts of all layers in their order, then where its
// samples stand, how they are spread and what a clamp took of them (Film::sums, FilmPixel). ImageDescription says "marram frame state", the number of this layout, the digest of
// the frame that it is of, and a checksum of the film that it restores: uncompressed TIFF does not notice that bits have changed.
#pragma once

#include "core/render/film.h"

#include <string>

namespace marram {

// "a.exr" -> "a.exr.state.tif": of two pictures in one folder each has its own.
std::string state_name(const std::string& picture);

// Throws InputError where a picture that is no frame's state stands under the name: it would be overwritten and removed.
void check_state_name(const std::string& state);

// `digest` stands for all that the samples of the film depend on, their number aside.
void save_state(const std::string& state, const Film& film, const std::string& digest);

// Fills a film without samples. Returns why the file is of no use, one line for people, and leaves the film empty: it is damaged,
// of another frame, or has more than `samples` samples a pixel; "" where the film is filled.
std::string load_state(const std::string& state, const std::string& digest, uint32_t samples, Film& film);

} // namespace marram
