// SPDX-License-Identifier: Apache-2.0
#include "core/cli/farm_options.h"

#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/math/problem.h"
#include "core/scene/suggest.h"
#include "core/shot/frame_list.h"

#include <CLI/CLI.hpp>

#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

namespace marram {
namespace {

constexpr std::array<std::pair<const char*, LogFormat>, 3> log_formats = {
    {{"text", LogFormat::text}, {"time", LogFormat::time}, {"json", LogFormat::json}}};

constexpr std::array<std::pair<const char*, FrameDialect>, 4> frame_dialects = {
    {{"marram", FrameDialect::marram},
     {"opencue", FrameDialect::opencue},
     {"openjd", FrameDialect::openjd},
     {"fileseq", FrameDialect::fileseq}}};

constexpr std::array<std::pair<const char*, ProgressStyle>, 6> progress_styles = {
    {{"auto", ProgressStyle::automatic},
     {"plain", ProgressStyle::plain},
     {"openjd", ProgressStyle::openjd},
     {"alf", ProgressStyle::alf},
     {"json", ProgressStyle::json},
     {"none", ProgressStyle::none}}};

template <typename Choices>
std::vector<std::string> names_of(const Choices& choices) {
    std::vector<std::string> names;
    for (const auto& [name, value] : choices) names.emplace_back(name);
    return names;
}

// The choice of this name. The parser has checked that there is one.
template <typename Choices>
auto choice_of(const Choices& choices, const std::string& name) {
    auto found = choices.front().second;
    for (const auto& [known, value] : choices)
        if (name == known) found = value;
    return found;
}

// set: called with the value of `option` if the command line has it as "OPTION VALUE" or "OPTION=VALUE".
template <typename Choices, typename Set>
void find_option(int argc, const char* const* argv, std::string_view option, const Choices& choices,
                 Set set) {
    for (int i = 1; i < argc; ++i) {
        std::string_view value = argv[i];
        if (!value.starts_with(option)) continue;
        value.remove_prefix(option.size());
        if (value.empty() && i + 1 < argc)
            value = argv[i + 1];
        else if (value.starts_with('='))
            value.remove_prefix(1);
        else
            continue;
        for (const auto& [name, choice] : choices)
            if (value == name) set(choice);
    }
}

// "8G", "1.5GiB", "500000000" -> bytes. CLI::AsSizeValue reads 010 as 8, -1 as 2^64 - 1 and Gb (gigabits) as
// GB, and has no fractions.
uint64_t parse_bytes(const std::string& text) {
    constexpr std::string_view units = "KMGT"; // powers of 1024
    constexpr double min = 0x1p20, max = 0x1p60;
    const auto refuse = [&](const std::string& what) {
        throw InputError({"--memory " + (text.empty() ? "\"\"" : clean(text))}, what,
                         "give a number of bytes, or one with K, M, G or T, such as 8G or 500M");
    };
    double bytes = 0.0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, bytes, std::chars_format::fixed);
    std::string_view unit(stop, size_t(end - stop));
    if (!unit.empty() && unit != "B") {
        const size_t power = units.find(char(std::toupper(static_cast<unsigned char>(unit[0]))));
        if (power == std::string_view::npos) refuse("is no size");
        unit.remove_prefix(1);
        if (!unit.empty() && unit != "B" && unit != "iB") refuse("is no size");
        bytes = std::ldexp(bytes, 10 * int(power + 1));
    }
    if (error != std::errc{} || !std::isfinite(bytes)) refuse("is no size");
    if (bytes < min) refuse("is less than 1M, in which nothing runs");
    if (bytes > max) refuse("is more than any machine has");
    return uint64_t(bytes);
}

} // namespace

void set_message_options(int argc, const char* const* argv) {
    find_option(argc, argv, "--log", log_formats, set_log_format);
    find_option(argc, argv, "--progress", progress_styles, set_progress_style);
}

void add_log(CLI::App& program) {
    for (CLI::App* command : program.get_subcommands({}))
        command
            ->add_option_function<std::string>(
                "--log", [](const std::string&) {}, // set_message_options() has taken it
                "messages on stderr as lines of text, such lines with the time (UTC) before them, or a JSON "
                "object a line: time, level, id, file, line, column, and what and fix of a mistake or "
                "warning, else text")
            ->check(CLI::IsMember(names_of(log_formats)))
            ->default_str("text");
}

void add_progress(CLI::App& command) {
    command
        .add_option_function<std::string>(
            "--progress", [](const std::string&) {},
            "progress of the whole run; auto: a line on a terminal; the others on stdout, at least every 10 "
            "s, also while a frame is built: a percentage (plain), openjd_progress and openjd_status lines, "
            "ALF_PROGRESS lines, or a JSON object a line; frames count alike, of each the build is the first "
            "tenth; 100 % is printed when the last file is closed")
        ->check(CLI::IsMember(names_of(progress_styles)))
        ->default_str("auto");
}

void add_frame_lists(CLI::App& command, FrameRequest& frames) {
    command
        .add_option_function<std::string>(
            "--frames-dialect",
            [&frames](const std::string& name) { frames.dialect = choice_of(frame_dialects, name); },
            "how --frames reads 1-10:2: as a step (openjd), frames in an interleaved order (opencue) or a "
            "staggered one (fileseq), all frames of the range; ranges may go backwards in these: 10-1x-3")
        ->check(CLI::IsMember(names_of(frame_dialects)))
        ->default_str("marram");
    command.add_flag("--skip-outside", frames.skip_outside,
                     "leave out frames that are not in the scene's range, with a line; if none is left, "
                     "nothing is written, and the exit code is 0");
}

CLI::Option* add_checkpoint(CLI::App& command, double& seconds) {
    return command
        .add_option(
            "--checkpoint", seconds,
            "while tracing, save the film's state (OUT.exr.state.tif) so often that a process that is killed "
            "at any moment loses no more than this time and that of a save, or one sample a pixel where "
            "that takes longer, and the build; --resume goes on to the same bits")
        ->type_name("SECONDS")
        ->excludes(command.get_option("--watch"));
}

void add_memory(CLI::App& command, uint64_t& bytes) {
    command
        .add_option_function<std::string>(
            "--memory", [&bytes](const std::string& text) { bytes = parse_bytes(text); },
            "memory that the process may take, such as 8G or 500M; default: what the control group "
            "(container), Slurm and the machine leave")
        ->type_name("SIZE");
}

} // namespace marram
