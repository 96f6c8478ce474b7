// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/image/atomic_file.h"
#include "core/measure/measure.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <filesystem>

namespace marram {
namespace {

namespace fs = std::filesystem;

void write_file(const fs::path& path, const std::string& text) {
    AtomicFile writer(path.string(), Links::replace);
    writer.write(text);
    writer.commit();
}

// Writes the report, with "partial" in the file names if the measurement was interrupted. Returns the paths.
std::vector<std::string> write_report(const Measurement& measurement, const fs::path& folder, bool partial) {
    const ExitBlocker exit_blocker;
    const std::string middle = partial ? ".partial" : "";
    std::vector<std::string> written;
    const auto put = [&](const std::string& stem, const std::string& extension, const std::string& text) {
        const fs::path path = folder / (stem + middle + extension);
        write_file(path, text);
        written.push_back(path.string());
    };
    put("measure", ".html", to_html(measurement));
    put("measure", ".csv", to_csv(measurement));
    for (const DialResult& dial : measurement.dials) put(dial.dial.name, ".svg", to_svg(dial));
    return written;
}

void make_folder(const std::string& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (!fs::is_directory(folder))
        throw InputError({folder}, "the folder for the report cannot be made",
                         "name another with --out, or make it");
    for (const char* name : {"measure.html", "measure.csv"})
        check_writable((fs::path(folder) / name).string(), Links::replace);
}

} // namespace

int measure_command(const MeasureOptions& options) {
    Shot shot = open_shot(options);
    make_folder(options.out);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    tbb::task_arena arena(threads);
    const double frame = options.frame.value_or(shot.description.globals.vec2("frames").x());
    const MeasureRequest request{options.scene, options.overrides, frame, options.seconds, options.rounds,
                                 threads,       options.bend_speed};
    MeasureProgress progress(options.seconds);
    Measurement measurement;
    try {
        const ProgressLine line(options.quiet, [&] {
            const auto [phase, fraction] = progress.state();
            return ProgressState{phase, fraction};
        });
        arena.execute([&] { measure(shot, request, progress, interrupted(), measurement); });
    } catch (const Cancelled&) {
        for (const std::string& path : write_report(measurement, options.out, true))
            print_result("{}\n", path);
        throw;
    }
    print_result("{}\n", to_table(measurement));
    for (const std::string& path : write_report(measurement, options.out, false)) print_result("{}\n", path);
    return 0;
}

} // namespace marram
