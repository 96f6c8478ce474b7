// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/image/atomic_file.h"
#include "core/image/run_files.h"
#include "core/image/sheet.h"
#include "core/math/file_types.h"
#include "core/shot/picture_file.h"

#include <fmt/format.h>

#include <atomic>

namespace marram {
namespace {

std::vector<std::string> captions_of(const SheetOptions& options) {
    if (options.captions == "name") return name_captions(options.pictures);
    if (options.captions == "frame") return frame_captions(options.pictures);
    if (options.captions == "none") return std::vector<std::string>(options.pictures.size());
    return sheet_captions(options.pictures);
}

} // namespace

int sheet_command(const SheetOptions& options) {
    if (extension_of(options.output) != ".png")
        throw InputError({options.output}, "a sheet is written as PNG", "name it .png");
    RunFiles files(options.pictures);
    files.write(options.output);
    check_writable(options.output);
    const std::vector<std::string> captions = captions_of(options);
    std::vector<SheetPicture> pictures;
    for (size_t i = 0; i < captions.size(); ++i) pictures.push_back({options.pictures[i], captions[i]});
    std::atomic<size_t> done{0};
    bool has_font = false;
    {
        const ProgressLine line(options.quiet, [&] {
            return ProgressState{"reading", double(done.load()) / double(pictures.size())};
        });
        has_font = write_sheet(options.output, pictures, options.layout, [&](size_t i) {
            if (interrupted()) throw Cancelled();
            done = i;
        });
    }
    if (!has_font)
        print_warning({{options.output},
                       "no font was found, so that there are no captions",
                       "install fonts-dejavu-core, or name a file with --font",
                       "sheet.no_font"});
    print_result("{}\n", options.output);
    return 0;
}

} // namespace marram
