// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/image/image_library.h"
#include "core/shot/farm/merge.h"

#include <atomic>

namespace marram {

int merge_command(const MergeOptions& options) {
    load_image_library();
    RunProgress run(options.quiet);
    std::atomic<size_t> added{0};
    Merged merged;
    {
        const RunProgress::Watch watch(run, [&] {
            return ProgressState{"merging", double(added.load()) / double(options.states.size()), true};
        });
        merged = merge_states(options, interrupted(), added);
    }
    for (const std::string& file : merged.files) print_result("{}\n", file);
    for (const FilmPart& part : merged.missing)
        print_message("{}: missing: {}\n", options.output, to_string(part));
    run.finish();
    return exit_done;
}

} // namespace marram
