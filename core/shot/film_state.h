// SPDX-License-Identifier: Apache-2.0
// The state of an unfinished frame: the film's sample sums, in a file beside its picture, from which --resume
// continues.
//
// The file is a TIFF of doubles (core/image/doubles.h). A pixel holds the sums and counts of all layers in
// their order (Film::sums), then the fields of FilmPixel, then CatcherSums if the film has them
// (Film::catchers). ImageDescription is "marram frame state", the format version, samples_digest
// (FrameFiles) and a checksum of the restored film: uncompressed TIFF does not detect changed bits.
#pragma once

#include "core/render/film.h"

#include <string>

namespace marram {

// "a.exr" -> "a.exr.state.tif", distinct for each picture of a folder.
std::string state_name(const std::string& picture);

// Throws InputError if a file of this name exists that is not a frame state: it would be overwritten and
// removed.
void check_state_overwrite(const std::string& state);

// samples_digest covers everything that the film's samples depend on, except their number.
void save_state(const std::string& state, const Film& film, const std::string& samples_digest);

// Fills an empty film and returns "". If the file cannot be used, returns one line that says why and leaves
// the film empty: the file is damaged, belongs to another frame, or has more than `samples` samples per
// pixel.
std::string load_state(const std::string& state, const std::string& samples_digest, uint32_t samples,
                       Film& film);

} // namespace marram
