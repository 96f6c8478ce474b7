// SPDX-License-Identifier: Apache-2.0
#include "core/cli/scene_options.h"

#include "core/shot/farm/claim.h"

#include <string>
#include <utility>
#include <vector>

namespace marram {

void add_path_map(CLI::App& command, PathMap& paths) {
    using Texts = std::vector<std::string>;
    command
        .add_option_function<Texts>(
            "--map",
            [&paths](const Texts& texts) {
                for (size_t i = 0; i < texts.size(); ++i)
                    paths.rules.insert(paths.rules.begin() + std::ptrdiff_t(i), parse_path_rule(texts[i]));
            },
            "where files lie on this machine: names in the scene that begin with the folder FROM are read "
            "from TO; the longest FROM counts")
        ->type_name("FROM=TO")
        ->allow_extra_args(false);
    command
        .add_option_function<Texts>(
            "--map-file",
            [&paths](const Texts& files) {
                for (const std::string& file : files)
                    for (PathRule& rule : read_path_rules(file)) paths.rules.push_back(std::move(rule));
            },
            "such mappings from a file, OpenJD's pathmapping-1.0 (JSON)")
        ->type_name("FILE")
        ->allow_extra_args(false);
}

void add_parts(CLI::App& command, RenderOptions& options) {
    const auto samples = [&options](const std::string& text) { parse_samples(text, options.part); };
    command
        .add_option_function<std::string>(
            "--samples", samples,
            "only the samples with these numbers, the first is 0, to a state for `marram merge`, "
            "OUT.exr.samples_0_63.state.tif; any ranges, on any machines, give the bits of one render. "
            "With film.noise one round of 16 at a time, and --after")
        ->type_name("A-B")
        ->excludes("--seconds", "--png");
    const auto crop = [&options](const std::string& text) { parse_crop(text, options.part); };
    command
        .add_option_function<std::string>(
            "--crop", crop,
            "only these pixels, from left and top to right and bottom, which are excluded, to a state for "
            "`marram merge`")
        ->type_name("X0,Y0,X1,Y1")
        ->excludes("--seconds", "--png");
    command
        .add_option("--samples-per-task", options.samples_per_task,
                    "all samples in such parts, of so many: `--claim` shares the parts of a frame, "
                    "scenes/farm makes a task of each")
        ->type_name("N")
        ->check(CLI::Range(1, 65536))
        ->excludes("--samples", "--seconds", "--png");
    command.add_flag("--list", options.list,
                     "render nothing, and print what is there, a JSON object a frame: frame, picture, there "
                     "(finished, of this scene and these settings); with parts also those, with samples, "
                     "state, there");
    const auto after = [&options](const std::string& file) {
        if (file.empty())
            throw InputError({"--after"}, "the file has no name", "give a state, or leave --after out");
        options.after = file;
    };
    command
        .add_option_function<std::string>(
            "--after", after,
            "with --samples: a state of the whole picture with all samples before these, such as `marram "
            "merge` writes to a .tif; film.noise needs it, and others save four samples")
        ->type_name("STATE");
    command.add_flag("--keep-state", options.keep_state,
                     "a finished picture keeps its state, OUT.exr.state.tif, from which --resume goes on to "
                     "a higher --spp, and which `marram merge` takes");
}

CLI::Option* add_claim(CLI::App& command, RenderOptions& options) {
    CLI::Option* claim = command
                             .add_flag_callback(
                                 "--claim",
                                 [&options] {
                                     options.resume = true;
                                     if (!options.lease) options.lease = default_lease;
                                 },
                                 "share the frames with other processes of the same command in this folder: "
                                 "each is claimed by a "
                                 "file beside its picture, so that no frame is rendered twice; ends when all "
                                 "pictures are there. "
                                 "Like --resume it leaves out and goes on with what was begun")
                             ->excludes(command.get_option("--watch"))
                             ->excludes(command.get_option("--seconds"));
    return command
        .add_option(
            "--lease", options.lease,
            "seconds after which the claim of a process that has gone silent, on another machine, is taken "
            "over; default: 60")
        ->type_name("SECONDS")
        ->needs(claim);
}

void add_pack_options(CLI::App& command, PackOptions& options) {
    command
        .add_option(
            "-o,--output", options.output,
            "folder to be made: the scene, with the values of --set, and its files in files/; it renders "
            "to the same bits wherever it lies. Sequences are copied whole, as they are read when a scene is "
            "opened")
        ->required()
        ->type_name("DIR");
    command.add_flag("--states", options.states, "also the states that simulations have left (--state)");
}

} // namespace marram
