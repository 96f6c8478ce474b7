// SPDX-License-Identifier: Apache-2.0
// Merges states of parts of a frame: the picture has the bits of one render, whatever the parts, their order,
// and the machines and threads that made them, as sums are exact (core/render/film.h).
#pragma once

#include "core/shot/film_state.h"
#include "core/shot/layer_picture.h"

#include <atomic>
#include <string>
#include <vector>

namespace marram {

struct MergeRequest {
    std::vector<std::string> states;
    std::string output;                 // .exr or .png: the picture; .tif: the state of all parts
    std::vector<LayerPicture> pictures; // of layers, as with --png; not with a state
    bool partial = false;               // a picture even where samples are missing, under partial_name()
};

struct Merged {
    std::vector<std::string> files; // written
    std::vector<FilmPart> missing;  // of a picture
};

// Throws InputError, and then nothing is written, for states that are damaged, unfinished, of another frame,
// scene, size or version, or that have a sample twice; and where samples are missing, unless request.partial
// is set or the output is a state; for unwritable files and unknown layers. Throws Cancelled. Memory: one
// film and a row.
// added: the number of states that are in the film.
Merged merge_states(const MergeRequest& request, const std::atomic<bool>& cancel, std::atomic<size_t>& added);

} // namespace marram
