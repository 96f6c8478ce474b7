// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/shot/farm/pack.h"

#include <tbb/global_control.h>

#include <optional>
#include <utility>

namespace marram {

int pack_command(const PackOptions& options) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    size_t(threads_of(options)));
    Shot shot = open_shot(options);
    const ExitBlocker until_it_ends; // an interrupt leaves no half folder
    const PackedScene packed = pack_scene(
        std::move(shot), {options.scene, options.output, options.overrides, options.states}, interrupted());
    print_result("{}\n", packed.scene);
    if (!options.quiet)
        print_message("{}: {} files, {:.3g} MB; checked\n", options.output, packed.files,
                      1e-6 * double(packed.bytes));
    return exit_done;
}

} // namespace marram
