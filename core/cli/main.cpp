// SPDX-License-Identifier: Apache-2.0
#include "core/cli/cli.h"
#include "core/cli/memory.h"
#include "core/cli/output.h"

static void before_libraries() {
    marram::open_standard_streams(); // first: a library may open files, too
    marram::watch_for_lack_of_memory();
}

// The loader runs this before the initialisers of shared libraries, which allocate 100 MB and start threads.
[[gnu::section(".preinit_array"), gnu::used]] static void (*const preinit_hook)() = before_libraries;

int main(int argc, char** argv) {
    marram::return_large_blocks_when_freed();
    return marram::run(argc, argv);
}
