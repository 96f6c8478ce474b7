// SPDX-License-Identifier: Apache-2.0
// The subcommands of `marram`. Each returns the process's exit code and throws InputError and Cancelled.
//
// To add one: its options here, its function in a file of its own, and its parser in cli.cpp.
#pragma once

#include "core/cli/exit_codes.h"
#include "core/image/display.h"
#include "core/image/sheet.h"
#include "core/manual/command_text.h"
#include "core/shot/bake.h"
#include "core/shot/farm/merge.h"
#include "core/shot/film_part.h"
#include "core/shot/frame_list.h"
#include "core/shot/layer_picture.h"
#include "core/shot/shot.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct CommonOptions {
    std::string scene;
    Overrides overrides;
    int threads = 0;     // 0: as many as threads_allowed()
    uint64_t memory = 0; // bytes; 0: what there is
    std::string stats;   // JSON file, "" for none
    bool quiet = false;
};

int threads_of(const CommonOptions& options);

// Bytes that the process may take. Without --memory that changes: it is what the process has in RAM now and
// memory_left().
uint64_t memory_of(const CommonOptions& options);

void print_warnings(const Shot& shot, bool uses_lights = true); // those of its files and values

// Loads the scene and prints its warnings.
Shot open_shot(const CommonOptions& options, bool uses_lights = true);

struct RenderOptions : CommonOptions {
    std::string output = "marram.png";
    FrameRequest frames;
    std::vector<std::string> layers;    // besides those of the scene
    std::vector<LayerPicture> pictures; // of --png; their layers are added to the film
    bool resume = false;
    std::optional<double> lease; // s, of claims on frames, which other processes leave out
    bool watch = false;          // render anew when a file of the scene is saved, until an interrupt
    std::string preview;         // "" for none
    std::optional<DisplayAddress> display; // of the viewer that shows the frames in work
    double seconds = 0.0;                  // time limit for tracing a frame; 0: none
    bool keep_state = false;
    PartRequest part;
    uint32_t samples_per_task = 0; // a frame in parts of so many; 0: whole, or `part`
    bool list = false;             // render nothing, print what is there
    std::string after;             // FrameOptions::after
    double checkpoint = 0.0;       // largest age of the saved state, seconds; 0: none is saved
};

struct BakeOptions : CommonOptions, BakeSettings {
    FrameRequest frames; // default: the scene's first frame
};

struct MeasureOptions : CommonOptions {
    std::string out = "measure"; // folder
    std::optional<double> frame;
    double seconds = 110.0; // time budget
    int rounds = 7;
    double bend_speed = 0.0; // m/s; 0: the scene's largest
};

struct CompareOptions {
    std::string test, reference;
    std::string report; // folder, "" for none
};

struct InfoOptions {
    std::string subject;               // "" for everything
    std::vector<std::string> settings; // --set, of a scene
    bool keys = false;                 // print only the keys that --set can change
    std::vector<std::string> allowed_libraries;
    PathMap paths;
};

struct MergeOptions : MergeRequest {
    bool quiet = false;
};

struct SheetOptions {
    std::vector<std::string> pictures;
    std::string output = "sheet.png";
    std::string captions = "auto"; // name, frame, none
    SheetLayout layout;
    bool quiet = false;
};

struct ViewOptions : CommonOptions {
    uint16_t port = 0; // 0: any that is free
    bool opens = true; // the address in a browser
};

struct PackOptions : CommonOptions {
    std::string output;  // folder
    bool states = false; // with those of simulations
};

struct ManOptions {
    std::string command; // "": the page of the program
    std::string folder;  // write pages as files to this folder; "": print the page
};

int render_command(const RenderOptions& options);
int bake_command(const BakeOptions& options);
int measure_command(const MeasureOptions& options);
int view_command(const ViewOptions& options);
int compare_command(const CompareOptions& options); // 0 alike, 1 different
int info_command(const InfoOptions& options);
int merge_command(const MergeOptions& options);
int pack_command(const PackOptions& options);
int sheet_command(const SheetOptions& options);
int completion_command(const std::string& shell, const ProgramText& text); // "bash" or "zsh"
int man_command(const ManOptions& options, const ProgramText& text);

} // namespace marram
