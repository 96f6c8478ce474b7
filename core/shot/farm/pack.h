// SPDX-License-Identifier: Apache-2.0
// Packs a scene and all files that it names into one folder, which renders to the same bits elsewhere:
//
//   DIR/SCENE.toml       the scene's text with other names of files; all else keeps its bytes
//   DIR/files/hill.png   the files, by their own names
//   DIR/files/2/hill.png another file of the same name
//   DIR/SCENE.states     states of simulations, on request
#pragma once

#include "core/shot/shot.h"

#include <atomic>
#include <cstdint>
#include <string>

namespace marram {

struct PackRequest {
    std::string scene;   // file
    std::string folder;  // to be made; an empty one may be there
    Overrides overrides; // with which the shot was loaded; its settings are written into the packed scene
    bool states = false; // with those that simulations have left
};

struct PackedScene {
    std::string scene;  // path of the packed scene
    size_t files = 0;   // beside the scene; equal ones are stored once
    uint64_t bytes = 0; // of them
};

// Copies keep their time of change, numbers of frames and of tiles. All is written to a folder beside
// request.folder, loaded again and compared with what was read, and then renamed: the folder is complete or
// not there. A library is code, and is never copied: one that the scene names without a folder stays named,
// any other is refused. Throws InputError, and Cancelled between two files; neither leaves anything behind.
// What a killed process has left beside the same folder is removed.
PackedScene pack_scene(Shot shot, const PackRequest& request, const std::atomic<bool>& cancel);

} // namespace marram
