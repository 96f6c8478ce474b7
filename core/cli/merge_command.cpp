// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/image/image_library.h"
#include "core/shot/farm/merge.h"

namespace marram {

int merge_command(const MergeOptions& options) {
    load_image_library();
    const Merged merged = merge_states(options, interrupted());
    for (const std::string& file : merged.files) print_result("{}\n", file);
    for (const FilmPart& part : merged.missing)
        print_message("{}: missing: {}\n", options.output, to_string(part));
    return 0;
}

} // namespace marram
