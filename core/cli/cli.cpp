// SPDX-License-Identifier: Apache-2.0
#include "core/cli/cli.h"

#include "core/cli/commands.h"
#include "core/cli/exit_codes.h"
#include "core/cli/farm_options.h"
#include "core/cli/interrupt.h"
#include "core/cli/machine.h"
#include "core/cli/memory.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/cli/scene_options.h"
#include "core/math/resident_memory.h"
#include "core/scene/suggest.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <tbb/task_arena.h>

#include <charconv>
#include <cmath>
#include <csignal>
#include <functional>
#include <sstream>

namespace marram {
namespace {

// Parses "WxH".
std::pair<uint32_t, uint32_t> parse_size(const std::string& text) {
    uint32_t width = 0, height = 0;
    const char* end = text.data() + text.size();
    const auto a = std::from_chars(text.data(), end, width);
    bool good = a.ec == std::errc{} && a.ptr != end && *a.ptr == 'x';
    if (good) {
        const auto b = std::from_chars(a.ptr + 1, end, height);
        good = b.ec == std::errc{} && b.ptr == end;
    }
    if (!good)
        throw InputError({"--size " + text}, "this is no size",
                         "give width and height in pixels, such as 800x450");
    return {width, height};
}

// Parses "LOW,HIGH".
Vec2d parse_range(const std::string& text) {
    Vec2d range;
    const char *at = text.data(), *end = at + text.size();
    for (int i = 0; i < 2; ++i) {
        const auto [stop, error] = std::from_chars(at, end, range[i]);
        if (error != std::errc{} || !std::isfinite(range[i]) ||
            (i == 0 ? stop == end || *stop != ',' : stop != end))
            throw InputError({"--range " + text}, "is not two numbers",
                             "write LOW,HIGH in metres, such as 0,40");
        at = i == 0 ? stop + 1 : stop;
    }
    return range;
}

// CLI11's own check reads "" as 0, and accepts NaN within any bounds.
CLI::Validator number_between(double low, double high) {
    return {[low, high](std::string& text) {
                double value = 0.0;
                const auto [end, error] =
                    std::from_chars(text.data() + text.starts_with('+'), text.data() + text.size(), value);
                const bool good =
                    error == std::errc{} && end == text.data() + text.size() && value >= low && value <= high;
                return good ? std::string()
                            : fmt::format("'{}' is no number from {:g} to {:g}", text, low, high);
            },
            fmt::format("{:g} to {:g}", low, high)};
}

struct Texts { // options that are checked after parsing
    std::string size, layers, attributes, shell, range, display;
    std::vector<std::string> pictures, merged_pictures;
    uint32_t samples = 0;
    double frame = 0.0;
};

void add_allow_library(CLI::App& command, std::vector<std::string>& libraries) {
    command
        .add_option("--allow-library", libraries,
                    "let the scene load this library, whose code then runs; those in the folders of "
                    "MARRAM_PLUGIN_PATH and of the program need no permission")
        ->type_name("FILE")
        ->allow_extra_args(false);
}

void add_settings(CLI::App& command, std::vector<std::string>& settings) {
    command.add_option("--set", settings, "change any key of the scene, such as wind.speed=4")
        ->type_name("KEY=VALUE")
        ->allow_extra_args(false);
}

void add_scene(CLI::App& command, CommonOptions& options) {
    command.add_option("scene", options.scene, "scene file (.toml)")->required();
    add_settings(command, options.overrides.settings);
    add_allow_library(command, options.overrides.allowed_libraries);
    add_path_map(command, options.overrides.paths);
    command
        .add_option("--threads", options.threads,
                    "threads to use; default: one a processor, as far as "
                    "its affinity, control group (container) and SLURM_CPUS_PER_TASK allow")
        ->check(CLI::Range(1, 1024));
    command
        .add_option("--state", options.overrides.state_folder,
                    "folder where simulations keep their states; default: SCENE.states beside the scene")
        ->type_name("DIR");
    command.add_flag("--quiet", options.quiet, "no progress line");
}

void add_stats(CLI::App& command, CommonOptions& options) {
    command
        .add_option("--stats", options.stats,
                    "write statistics of the run to this JSON file: an object, or a list of one object a "
                    "frame for several "
                    "frames; #### in its name: an object a frame, each in a file of its own")
        ->type_name("FILE");
}

std::vector<std::string> split(const std::string& text) {
    std::vector<std::string> parts;
    for (size_t begin = 0; begin <= text.size() && !text.empty();) {
        const size_t end = std::min(text.find(',', begin), text.size());
        parts.push_back(text.substr(begin, end - begin));
        begin = end + 1;
    }
    return parts;
}

struct Commands {
    RenderOptions render;
    BakeOptions bake;
    MeasureOptions measure;
    CompareOptions compare;
    InfoOptions info;
    MergeOptions merge;
    SheetOptions sheet;
    ViewOptions view;
    PackOptions pack;
    ManOptions man;
    Texts texts;
    std::function<int()> chosen;
};

constexpr const char* frames_help =
    "frames and ranges, a step after an x, such as 1-24 or 1-100x5,120; after a y the frames that this step "
    "leaves out; default: those of the scene where the output has a #### for their numbers, else its first";

void add_render(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand("render", "render a scene to pictures");
    c.render.overrides.makes_pictures = true;
    add_scene(*command, c.render);
    add_memory(*command, c.render.memory);
    add_stats(*command, c.render);
    add_progress(*command);
    add_frame_lists(*command, c.render.frames);
    command->add_option("-o,--output", c.render.output, "picture, .exr or .png; #### stands for the frame")
        ->type_name("FILE")
        ->capture_default_str()
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
    CLI::Option* frame = command->add_option("--frame", c.texts.frame, "frame, also a fraction of one")
                             ->check(number_between(-latest_frame, latest_frame));
    command->add_option("--frames", c.render.frames.list, frames_help)->type_name("LIST")->excludes(frame);
    command->add_option("--spp", c.texts.samples, "samples a pixel")->check(CLI::Range(1, 65536));
    command
        ->add_option("--seconds", c.render.seconds,
                     "time for tracing a frame: it ends with fewer samples where they would take longer; "
                     "--resume goes on")
        ->check(number_between(1e-3, 1e9));
    command->add_option("--size", c.texts.size, "size of the picture")->type_name("WxH");
    command
        ->add_option("--aov", c.texts.layers,
                     "image layers besides the scene's: " + names_of_extra_layers() + ", or an attribute")
        ->type_name("NAME,...");
    command
        ->add_option(
            "--png", c.texts.pictures,
            "a layer as a PNG of its own, the values from BLACK to WHITE as black to white, such as "
            "depth:0-20=depth.####.png; normals and what goes from 0 to 1 need no range; an EXR holds "
            "the layer as well")
        ->type_name("LAYER:BLACK-WHITE=FILE")
        ->allow_extra_args(false);
    command
        ->add_option(
            "--preview", c.render.preview,
            "picture to watch while a frame renders, .exr or .png: written after the first pass, then "
            "less and less often")
        ->type_name("FILE");
    command
        ->add_option("--display", c.texts.display,
                     "show the picture and its layers while they refine in the viewer tev, which listens at "
                     "127.0.0.1:14158 by default")
        ->type_name("HOST:PORT");
    CLI::Option* resume = command->add_flag(
        "--resume", c.render.resume,
        "leave out frames whose picture is there, whole, and of this scene; go on with those that were "
        "interrupted or out of time");
    add_parts(*command, c.render);
    command
        ->add_flag("--watch", c.render.watch,
                   "render one frame, and again whenever the scene or a file that it names has been saved, "
                   "until Ctrl-C; mistakes are printed, and the picture stays")
        ->excludes(resume)
        ->excludes("--samples", "--samples-per-task", "--crop", "--keep-state", "--list");
    add_checkpoint(*command, c.render.checkpoint)->check(number_between(1e-3, 1e9));
    add_claim(*command, c.render)->check(number_between(1.0, 86400.0));
    command->callback([&c, command, frame] {
        const bool one_frame = frame->count() > 0;
        if (command->count("--spp") > 0) c.render.overrides.samples = c.texts.samples;
        c.render.layers = split(c.texts.layers);
        const bool displays = command->count("--display") > 0;
        c.chosen = [&c, one_frame, displays] {
            if (one_frame) c.render.frames.frame = c.texts.frame;
            if (!c.texts.size.empty()) c.render.overrides.size = parse_size(c.texts.size);
            for (const std::string& text : c.texts.pictures)
                c.render.pictures.push_back(parse_layer_picture(text));
            if (displays) c.render.display = parse_display(c.texts.display);
            return render_command(c.render);
        };
    });
}

void add_bake(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand("bake", "write a scene's strands, terrain or rock to a file");
    add_scene(*command, c.bake);
    add_memory(*command, c.bake.memory);
    add_stats(*command, c.bake);
    add_progress(*command);
    add_frame_lists(*command, c.bake.frames);
    command
        ->add_option(
            "-o,--output", c.bake.output,
            "strands: .hair, .usda (several frames in one file, unless its name has a ####), .ply or "
            ".obj; a terrain's or rock's surface: .ply, or .obj where no strands are made; a rock as a level "
            "set: .vdb; a terrain's height: .png (16 bits), .tif, .tiff or .exr (with all its grids)")
        ->required()
        ->type_name("FILE");
    CLI::Option* frame = command
                             ->add_option("--frame", c.bake.frames.frame,
                                          "frame, also a fraction of one; default: the scene's first")
                             ->check(number_between(-latest_frame, latest_frame));
    command
        ->add_option("--frames", c.bake.frames.list,
                     "several frames, such as 1-24, 1-100x5,120 or 1-100y5 (those that 1-100x5 leaves out); "
                     "#### in a file's name stands for the frame")
        ->type_name("LIST")
        ->excludes(frame);
    command
        ->add_option(
            "--what", c.bake.what,
            "of a scene with both: the surface of its terrain or rock, or its strands; default for .obj: "
            "strands, for .ply: a terrain")
        ->check(CLI::IsMember({"terrain", "strands"}));
    command
        ->add_option(
            "--range", c.texts.range,
            ".png only: the heights in metres that are black and white; default: the lowest and highest of "
            "all frames baked, whose heights are kept until then; beyond 1 GiB frames are built twice")
        ->type_name("LOW,HIGH");
    command
        ->add_option("--stage", c.bake.stage,
                     "stage of the strands to write: at rest, bent by wind, or final (with collisions)")
        ->check(CLI::IsMember({"rest", "bent", "final"}))
        ->capture_default_str();
    command
        ->add_option("--colliders", c.bake.colliders,
                     "write all meshes as well, .obj, or .usda with their attributes")
        ->type_name("FILE");
    command
        ->add_option("--attributes", c.texts.attributes,
                     "curve attributes to write besides id, .usda and .ply only")
        ->type_name("NAME,...");
    command->callback([&c] {
        c.bake.attributes = split(c.texts.attributes);
        if (!c.texts.range.empty()) c.bake.range = parse_range(c.texts.range);
        c.chosen = [&c] { return bake_command(c.bake); };
    });
}

void add_measure(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand("measure", "measure time and error of a scene's quality settings");
    add_scene(*command, c.measure);
    command
        ->add_option("--out", c.measure.out,
                     "folder for the report: measure.html, measure.csv, a plot a dial")
        ->type_name("DIR")
        ->capture_default_str();
    command
        ->add_option("--frame", c.measure.frame, "frame, also a fraction of one; default: the scene's first")
        ->check(number_between(-latest_frame, latest_frame));
    command->add_option("--seconds", c.measure.seconds, "about how long it may take; more is more exact")
        ->check(number_between(1.0, 1e6))
        ->capture_default_str();
    command
        ->add_option("--rounds", c.measure.rounds,
                     "how often each setting is measured at most; 1 is quick, and its times are less exact")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    command
        ->add_option(
            "--bend-speed", c.measure.bend_speed,
            "largest wind speed, m/s, at which blades are compared with the dials of the bend; default: the "
            "scene's largest")
        ->check(number_between(1e-3, 1e3));
    command->callback([&c] { c.chosen = [&c] { return measure_command(c.measure); }; });
}

void add_compare(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand("compare", "whether two pictures are alike: exit code 0 alike, 1 "
                                                      "different, 2 they cannot be compared, or noise is "
                                                      "too great to tell");
    command->add_option("test", c.compare.test, "picture to test")->required()->type_name("A");
    command->add_option("reference", c.compare.reference, "what it is compared with")
        ->required()
        ->type_name("B");
    command
        ->add_option("--report", c.compare.report,
                     "folder for a page with both, their differences and the verdict")
        ->type_name("DIR")
        ->check([](const std::string& folder) {
            return folder.empty() ? std::string("the folder for the report has no name") : std::string();
        });
    command->callback([&c] { c.chosen = [&c] { return compare_command(c.compare); }; });
}

void add_view(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand(
        "view", "open a scene in the browser: play its strands, change its values, render");
    c.view.overrides.makes_pictures = true;
    add_scene(*command, c.view);
    add_memory(*command, c.view.memory);
    command->get_option("--state")->description(
        "folder where simulations keep their states; default: they stay in memory");
    command->add_option("--port", c.view.port, "port of this machine to serve at; 0: any that is free")
        ->type_name("PORT")
        ->check(CLI::Range(0, 65535))
        ->capture_default_str();
    command->add_flag("!--no-open", c.view.opens, "only print the address");
    command->callback([&c] { c.chosen = [&c] { return view_command(c.view); }; });
}

void add_info(CLI::App& app, Commands& c) {
    CLI::App* command =
        app.add_subcommand("info", "list procedurals, shaders and parameters, or describe a scene or a file");
    command
        ->add_option("subject", c.info.subject,
                     "a procedural, shader or table (wind: with the formula by which strands bend), a scene "
                     "file, or a "
                     "file of a mesh, strands or a picture; default: everything")
        ->check([](const std::string& subject) {
            return subject.empty() ? std::string("it is empty: leave it out to list everything") : "";
        });
    add_settings(*command, c.info.settings);
    command->add_flag("--keys", c.info.keys,
                      "only the keys that --set changes, of a scene or of every scene, one a line");
    add_allow_library(*command, c.info.allowed_libraries);
    add_path_map(*command, c.info.paths);
    command->callback([&c] { c.chosen = [&c] { return info_command(c.info); }; });
}

void add_merge(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand(
        "merge", "states of parts of a frame (render --samples, --crop, --keep-state) to its picture");
    command->add_option("states", c.merge.states, "states, in any order")->required()->type_name("STATE");
    command
        ->add_option("-o,--output", c.merge.output,
                     "picture, .exr or .png: with the bits of one render; or .tif: the state of all parts")
        ->required()
        ->type_name("FILE");
    command
        ->add_option("--png", c.texts.merged_pictures, "a layer as a PNG of its own, as in `marram render`")
        ->type_name("LAYER:BLACK-WHITE=FILE")
        ->allow_extra_args(false);
    command->add_flag("--partial", c.merge.partial,
                      "a picture even where samples are missing, under a name that says partial");
    command->add_flag("--quiet", c.merge.quiet, "no progress line");
    add_progress(*command);
    command->callback([&c] {
        c.chosen = [&c] {
            for (const std::string& text : c.texts.merged_pictures)
                c.merge.pictures.push_back(parse_layer_picture(text));
            return merge_command(c.merge);
        };
    });
}

void add_sheet(CLI::App& app, Commands& c) {
    CLI::App* command =
        app.add_subcommand("sheet", "many pictures on one, in rows and columns, with captions");
    command->add_option("pictures", c.sheet.pictures, "pictures, in this order")
        ->required()
        ->type_name("FILE");
    command->add_option("-o,--output", c.sheet.output, "the sheet, .png")
        ->type_name("FILE")
        ->capture_default_str();
    command
        ->add_option("--columns", c.sheet.layout.columns, "pictures in a row; default: about as many as rows")
        ->check(CLI::Range(1, 1000));
    command->add_option("--width", c.sheet.layout.width, "width of the sheet, pixels")
        ->check(CLI::Range(48, 65535))
        ->capture_default_str();
    command
        ->add_option("--captions", c.sheet.captions,
                     "names of files, or frames; auto: frames where the pictures are frames of one scene")
        ->check(CLI::IsMember({"auto", "name", "frame", "none"}))
        ->capture_default_str();
    command
        ->add_option("--font", c.sheet.layout.font,
                     "font of the captions; default: DejaVu Sans, or what is there")
        ->type_name("FILE");
    command
        ->add_option("--exposure", c.sheet.layout.exposure,
                     "stops, for pictures of linear light (EXR); default: 0")
        ->check(number_between(-100.0, 100.0));
    command->add_flag("--quiet", c.sheet.quiet, "no progress line");
    command->callback([&c] { c.chosen = [&c] { return sheet_command(c.sheet); }; });
}

void add_completion(CLI::App& app, Commands& c) {
    CLI::App* command =
        app.add_subcommand("completion", "print a script that completes command lines in a shell");
    command->add_option("shell", c.texts.shell, "the shell")
        ->required()
        ->check(CLI::IsMember({"bash", "zsh"}));
    command->callback([&c, &app] {
        c.chosen = [&c, &app] { return completion_command(c.texts.shell, program_text(app, exit_codes)); };
    });
}

void add_pack(CLI::App& app, Commands& c) {
    CLI::App* command =
        app.add_subcommand("pack", "copy a scene and all files that it names into one folder");
    add_scene(*command, c.pack);
    add_pack_options(*command, c.pack);
    command->callback([&c] { c.chosen = [&c] { return pack_command(c.pack); }; });
}

// Call it after all others: it lists their names.
void add_man(CLI::App& app, Commands& c) {
    CLI::App* command = app.add_subcommand("man", "print a manual page, for `man -l -`");
    std::vector<std::string> names;
    for (const CLI::App* other : app.get_subcommands({})) names.push_back(other->get_name());
    command->add_option("command", c.man.command, "the command; default: the program")
        ->check(CLI::IsMember(names));
    command->add_option("--out", c.man.folder, "write the page, or all of them, to this folder instead")
        ->type_name("DIR");
    command->callback(
        [&c, &app] { c.chosen = [&c, &app] { return man_command(c.man, program_text(app, exit_codes)); }; });
}

int report(const InputError& error) {
    print_problems(error.problems);
    report_failure(error.what());
    return exit_bad_input;
}

// Prints what CLI11 has to say to --help and --version.
int print_help(const CLI::App& app, const CLI::ParseError& error) {
    std::ostringstream text;
    const int code = app.exit(error, text, text);
    write_result(text.str());
    check_results();
    return code;
}

// CLI11 would say that a subcommand is required, not that this is none.
void check_command(const CLI::App& app, int argc, char** argv) {
    std::vector<std::string> commands = {"help"};
    for (const CLI::App* command : app.get_subcommands({})) commands.push_back(command->get_name());
    const bool help = argc > 2 && argv[1] == std::string_view("help");
    if (argc < 2) return;
    const std::string name = argv[help ? 2 : 1];
    if (name.starts_with('-') || std::ranges::find(commands, name) != commands.end()) return;
    throw InputError({"marram"}, fmt::format("there is no command {}", in_quotes(name)),
                     hint(name, commands, "command"));
}

} // namespace

int threads_of(const CommonOptions& options) {
    return options.threads > 0 ? options.threads
                               : threads_allowed(tbb::this_task_arena::max_concurrency()); // by affinity
}

uint64_t memory_of(const CommonOptions& options) {
    return options.memory > 0 ? options.memory : resident_bytes() + memory_left();
}

void print_warnings(const Shot& shot, bool uses_lights) {
    for (const Problem& warning : warnings_of(shot)) print_warning(warning);
    for (const Problem& warning : light_warnings_of(shot))
        if (uses_lights) print_warning(warning);
}

Shot open_shot(const CommonOptions& options, bool uses_lights) {
    Shot shot = load_shot(options.scene, options.overrides, interrupted());
    print_warnings(shot, uses_lights);
    return shot;
}

int run(int argc, char** argv) {
    CLI::App app("Wind on hair, fur and grass, applied while the renderer tessellates its scene.", "marram");
    app.set_version_flag("--version", "marram " MARRAM_VERSION);
    app.require_subcommand(1);
    keep_running_without_reader();
    Commands commands;
    add_render(app, commands);
    add_bake(app, commands);
    add_view(app, commands);
    add_info(app, commands);
    add_compare(app, commands);
    add_measure(app, commands);
    add_merge(app, commands);
    add_sheet(app, commands);
    add_pack(app, commands);
    add_completion(app, commands);
    add_man(app, commands);
    add_log(app);
    set_message_options(argc, argv);
    show_notes(print_note);
    try {
        check_command(app, argc, argv);
        std::vector<char*> arguments(argv, argv + argc);
        if (argc > 1 && arguments[1] == std::string_view("help")) { // help COMMAND: COMMAND --help
            static std::string option = "--help";
            arguments.erase(arguments.begin() + 1);
            arguments.resize(std::min<size_t>(arguments.size(), 2));
            arguments.push_back(option.data());
        }
        app.parse(int(arguments.size()), arguments.data());
    } catch (const InputError& error) {
        return report(error);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() != 0)
            return report(
                InputError({"marram"}, error.what(), "see `marram --help` and `marram COMMAND --help`"));
        try {
            return print_help(app, error);
        } catch (const InputError& unwritten) {
            return report(unwritten);
        }
    }
    std::signal(SIGXFSZ, SIG_IGN); // exceeding the file size limit becomes a failed write, which is reported
    watch_interrupts();
    try {
        const int code = commands.chosen();
        check_results();
        return code;
    } catch (const InputError& error) {
        return report(error);
    } catch (const Cancelled&) {
        return interrupt_exit_code();
    } catch (const std::exception& error) {
        if (is_lack_of_memory(error)) {
            flush_results();
            end_for_lack_of_memory_or_threads();
        }
        return report(InputError({"marram"}, error.what(), "report it as a defect, with the scene"));
    }
}

} // namespace marram
