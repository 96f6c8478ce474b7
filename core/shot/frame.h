// SPDX-License-Identifier: Apache-2.0
// One frame of a shot on its way to its files: built, resumed, traced, saved.
//
//   FrameFiles files = frame_files(...)             names and digests
//   Frame frame{shot, files, layers, ...}
//   World world = build_frame(frame, kept)          procedurals and meshes, ready to trace
//   resume_frame(frame)                             the film, with what an earlier run has left
//   trace_frame(frame, world, preview)
//   save_frame(frame)                               the picture, or a partial one and the film's state
//
// Nothing is printed here: whoever makes a frame prints Frame::stats' warnings and what the functions return.
#pragma once

#include "core/image/image.h"
#include "core/math/clock.h"
#include "core/shot/layer_picture.h"
#include "core/shot/preview.h"
#include "core/shot/shot.h"
#include "core/shot/stats.h"

#include <atomic>
#include <string>
#include <vector>

namespace marram {

// What a run of frames asks for beside the scene.
struct FrameOptions {
    std::string scene;               // the file, for metadata
    std::vector<std::string> layers; // besides those of the scene
    double seconds = 0.0;            // for tracing a frame; 0: no limit
    bool resume = false;
};

// The names of a frame's files, and what they depend on.
struct FrameFiles {
    double frame = 0.0;
    std::string picture, preview, state; // preview: "" for none
    std::vector<LayerPicture> layers;    // written with the picture, unless it is interrupted
    std::string digest;                  // two pictures of one frame with one digest are the same picture
    std::string samples_digest; // of two films with one, that with fewer samples can become the other
};

// A digest of what all frames depend on: the scene file, the settings that override it, the files that the scene names (by size and
// time), the layers, the version. Not the number of samples. Ask once, before frames are rendered: a scene file that is
// edited meanwhile is not what they are made of.
uint64_t shot_digest(const Shot& shot, const FrameOptions& options, const std::vector<std::string>& settings);

// `picture`, `preview` and the files of `layers` are names with #### for the frame.
FrameFiles frame_files(double frame, const Shot& shot, uint64_t digest, const std::string& picture,
                       const std::string& preview, const std::vector<LayerPicture>& layers = {});

// Whether an earlier run has left the whole picture, and those of its layers.
bool is_rendered(const FrameFiles& files);

// Throws InputError where a file that is no unfinished picture stands under its name.
void check_partial_name(const std::string& partial);

// Names of the film's layers: the scene's, those asked for, and those that sampling needs.
std::vector<std::string> layer_names(const Shot& shot, const std::vector<std::string>& more);

// Throws InputError unless the shot can fill all layers. More are named by `more`, which messages call `option`.
void check_layers(const Shot& shot, const std::vector<std::string>& more,
                  const std::string& option = "--aov");

// How far a frame is; read while other threads work.
struct FrameProgress {
    BuildProgress build;
    RenderProgress render;
    std::atomic<uint64_t> samples{0}; // of all pixels; 0: not tracing yet
};

struct Frame {
    Shot& shot;
    const FrameOptions& options;
    const FrameFiles& files;
    std::vector<std::string> layers;
    const std::atomic<bool>& cancel;
    FrameStats& stats;
    double begin = wall_seconds();
    RenderSettings settings{};
    Film film{};
    FrameProgress progress{};
};

// Throws InputError and Cancelled. Sets up the settings and an empty film as well. kept: what the frame before has left.
World build_frame(Frame& frame, KeptGeometry kept);

// Fills the film with what an earlier run has left of this frame, if the options ask for it.
struct ResumedFrame {
    std::string message;  // one line for people; "" if there is no state
    bool refused = false; // the state is of no use: the frame begins anew
};
ResumedFrame resume_frame(Frame& frame);

// Returns when all samples are there, time is up, or `cancel` is set.
void trace_frame(Frame& frame, const World& world, Preview& preview);

// Writes what the film holds by now to the preview's file.
void save_preview(Frame& frame);

// What to say of a traced frame beside the build's warnings.
std::vector<std::string> render_warnings(const Frame& frame);

struct SavedFrame {
    std::vector<std::string> layers; // pictures of layers
    std::string picture;             // the name it got
    std::string no_state; // why the film's state could not be saved; "" where it could, or need not
    bool whole = false;
};

// Writes the picture, under a name that says partial if the frame was cancelled, and the film's state unless it is whole. Throws
// InputError where the picture cannot be written; a whole frame's state is saved then: the samples may be hours of work.
SavedFrame save_frame(Frame& frame);

// Removes what an earlier, unfinished run has left of a frame that is whole now.
void remove_unfinished(const FrameFiles& files);

} // namespace marram
