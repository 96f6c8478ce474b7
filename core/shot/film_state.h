// SPDX-License-Identifier: Apache-2.0
// The state of a frame, or of a part of it: the film's sample sums, in a file. --resume continues from a
// state beside the picture, unfinished or kept; `marram merge` adds finished ones (farm/merge.h).
//
// The file is a TIFF of words of 32 bits (core/image/words.h) for the pixels of the parts' bounds. A pixel
// holds the sums of all layers in their order (Film::sums, 4 words each), their counts, the fields of
// FilmPixel, then CatcherSums if the film has them. ImageDescription is "marram frame state", the format
// version, FilmState as JSON, and checksums of that and of the words: uncompressed TIFF does not detect
// changed bits.
#pragma once

#include "core/render/film.h"
#include "core/shot/film_part.h"

#include <string>
#include <vector>

namespace marram {

// What a state says of itself: all that is needed to save its picture without the scene.
struct FilmState {
    std::string scene;
    double frame = 0.0;
    uint32_t width = 0, height = 0, samples = 0; // of the whole picture
    std::string film_digest;                     // FrameFiles::film_digest
    std::string picture_digest;                  // FrameFiles::digest, of the picture with `samples`
    double exposure = 0.0;                       // stops
    double seconds = 0.0;                        // that rendering it has taken
    bool transparent = false, catches_shadows = false;
    std::vector<FilmLayer> layers; // without values
    // Finished: the film has all samples of these parts; unfinished: some.
    std::vector<FilmPart> parts;
    bool finished = false;
};

// "a.exr" -> "a.exr.state.tif", distinct for each picture of a folder.
std::string state_name(const std::string& picture, const PartRequest& part = {});

// Throws InputError if a file of this name exists that is not a frame state: it would be overwritten and
// removed.
void check_state_overwrite(const std::string& state);

// film: of the bounds of state.parts. Layers and the like of `state` are taken from the film.
void save_state(const std::string& path, FilmState state, const Film& film);

// Reads the description, not the sums. Throws InputError if the file is not there, no state, of another
// version, or its description is damaged.
FilmState read_state(const std::string& path);

// Throws InputError if the sums are damaged.
void check_sums(const std::string& path, const FilmState& state);

// A film without samples for these parts of a state's picture.
Film empty_film(const FilmState& state, const FilmPart& bounds);

// Adds the samples of the file to a film of `bounds`, which encloses its parts, row by row. Throws InputError
// if it is damaged, and then the film is spoiled.
void add_state(const std::string& path, const FilmState& state, const FilmPart& bounds, Film& film);

// Fills an empty film with an unfinished or finished state of `part` and returns "". If the file cannot be
// used, returns one line that says why and leaves the film empty: the file is damaged, belongs to another
// frame or part, or has more samples.
std::string load_state(const std::string& path, const std::string& film_digest, const FilmPart& part,
                       Film& film);

} // namespace marram
