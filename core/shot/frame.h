// SPDX-License-Identifier: Apache-2.0
// Makes one frame of a shot: build, resume, trace, save.
//
//   FrameFiles files = frame_files(...)             names and digests
//   Frame frame{shot, files, layers, ...}
//   World world = build_frame(frame, kept)          procedurals and meshes, ready to trace
//   resume_frame(frame)                             fills the film from the state of an earlier run
//   trace_frame(frame, world, preview)
//   save_frame(frame)                               the picture, or a partial one and the film's state
//
// Nothing is printed here: the caller prints the warnings in Frame::stats and the messages returned.
#pragma once

#include "core/image/image.h"
#include "core/math/clock.h"
#include "core/shot/film_part.h"
#include "core/shot/layer_picture.h"
#include "core/shot/preview.h"
#include "core/shot/shot.h"
#include "core/shot/stats.h"

#include <atomic>
#include <functional>
#include <string>
#include <vector>

namespace marram {

// Options of a run, besides the scene.
struct FrameOptions {
    std::string scene;               // the file, for metadata
    std::vector<std::string> layers; // besides those of the scene
    double seconds = 0.0;            // time limit for tracing a frame; 0: none
    bool resume = false;
    bool keep_state = false; // of finished pictures
    // A state of the whole picture, with all samples before those of the part; #### for the frame; "": none.
    std::string after;
    uint64_t memory = 0; // bytes that the process may take; 0: as many as there are
};

// The names of a frame's files, and digests of what they depend on.
struct FrameFiles {
    double frame = 0.0;
    std::string picture, preview, state; // preview: "" for none
    FilmPart part;                       // what is rendered
    bool is_part = false; // not the whole: only the state is written, for merge_states() in farm/merge.h
    std::vector<LayerPicture> layers; // written with the picture, unless it is interrupted
    std::string digest;               // pictures of the same frame and digest are identical
    // Films with the same film_digest differ only in their number of samples: the one with fewer can be
    // continued.
    std::string film_digest;
};

// A digest of what all frames depend on: the scene file, the settings that override it, the files that the
// scene names (files_digest() in scene/scene_files.h), the layers, the picture's size and the version; not
// the number of samples, and not where files lie: copies of a scene, or mounts of one, in different folders
// give the same digest, so that states of several machines go together.
// Call it once, before rendering: the scene and its files may be edited during the run.
uint64_t shot_digest(const Shot& shot, const FrameOptions& options, const std::vector<std::string>& settings);

// `picture`, `preview` and the files of `layers` are names with #### for the frame.
FrameFiles frame_files(double frame, const Shot& shot, uint64_t digest, const std::string& picture,
                       const std::string& preview, const std::vector<LayerPicture>& layers = {},
                       const PartRequest& part = {});

// The file for which the frame is rendered: the picture, or the state of a part.
inline const std::string& output_of(const FrameFiles& files) {
    return files.is_part ? files.state : files.picture;
}

// Whether an earlier run has finished the picture, and those of layers.
bool is_picture_rendered(const FrameFiles& files);

// The same of the output. A picture has all parts, whose states may have been deleted since.
bool is_rendered(const FrameFiles& files);

// Throws InputError where a part cannot be rendered alone: adaptive sampling would have to know more; and
// where the state of --after is not what comes before it.
void check_parts(const Shot& shot, const FrameOptions& options, const std::vector<FrameFiles>& frames);

// Names of the film's layers: beauty and alpha, the scene's, those of `more`, and those that sampling needs.
std::vector<std::string> layer_names(const Shot& shot, const std::vector<std::string>& more);

// Throws InputError unless the shot has all layers of the scene and of `more`, which messages call `option`.
void check_layers(const Shot& shot, const std::vector<std::string>& more,
                  const std::string& option = "--aov");

// Progress of a frame; may be read while other threads work.
struct FrameProgress {
    BuildProgress build;
    RenderProgress render;
    std::atomic<uint64_t> samples{0}; // to take, of all pixels; 0: not tracing yet
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
    FilmPart part{};
    Film film{};   // of the part's pixels
    Film before{}; // of options.after; empty without
    FrameProgress progress{};
    std::function<void()> between_passes{}; // called by trace_frame(), as the preview's; may be empty
};

// Also sets up the settings and an empty film. kept: geometry kept from the previous frame. Throws InputError
// and Cancelled.
World build_frame(Frame& frame, KeptGeometry kept);

// Fills the film from the state that an earlier run has saved of this frame, if options.resume is set.
struct ResumedFrame {
    std::optional<Problem> refused; // why the state cannot be used: the frame starts from the beginning
    std::string message;            // one line about a state that is used
};
ResumedFrame resume_frame(Frame& frame);

// Returns when all samples are taken, the time limit is reached, or `cancel` is set.
void trace_frame(Frame& frame, const World& world, Preview& preview);

// Writes the film's state between two passes. Throws InputError.
void save_checkpoint(const Frame& frame);

// Writes the current film to the preview's file.
void save_preview(Frame& frame);

// Warnings about a traced frame, including those of the build.
std::vector<Problem> render_warnings(const Frame& frame);

struct SavedFrame {
    std::vector<std::string> layers;    // pictures of layers
    std::string picture;                // its file name, or that of the part's state
    std::optional<Problem> state_error; // why the film's state could not be saved
    bool whole = false;
};

// Writes the picture (under partial_name() if the frame was cancelled) and, unless the frame is complete, the
// film's state. Of a part, the state alone. Throws InputError if the picture cannot be written; the state is
// then saved even if the frame is complete, as its samples may have taken hours.
SavedFrame save_frame(Frame& frame);

// Removes the state and the partial picture that an interrupted run has left, after the frame is complete. A
// state that is wanted, or was kept of the same picture with more samples, stays.
void remove_unfinished(const FrameFiles& files, bool keep_state);

} // namespace marram
