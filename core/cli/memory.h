// SPDX-License-Identifier: Apache-2.0
// Memory of the process: returning freed memory to the system, and the message when memory runs out.
#pragma once

#include <exception>

namespace marram {

// From this call on, blocks of 1 MB and more are returned to the system as soon as they are freed. Otherwise
// glibc raises that limit up to 32 MB as blocks are freed, the buffers of a frame come from the heaps of its
// threads, and in one run of three the peak of a sequence is 3 % above that of the others. Costs less than
// 1 % in page faults.
void return_large_blocks_when_freed();

// Returns freed memory to the system. Call it between frames: otherwise fragmentation makes the heaps of
// several threads grow by 1 to 8 MB per frame. Takes a few milliseconds.
void release_free_memory();

// From this call on, a lack of memory that no caller can report (in a library's initialiser, in a thread of a
// library, a null pointer that a library does not check) ends the process with one line and exit code 2.
// Other crashes are not affected. A stack of less than 1 MiB is enlarged or, where that is not allowed, ends
// the process likewise. main.cpp calls it before the initialisers of shared libraries run, so it must not
// depend on any of them.
void watch_for_lack_of_memory();

// Prints that memory has run out, removes temporary files and ends the process with exit code 2. Exit
// handlers are not run: those of libraries that could not start all their threads may crash (OpenEXR's does,
// in about one of three cases).
[[noreturn]] void end_for_lack_of_memory();

// The same after is_lack_of_memory(): that of a thread may come from the limit on processes, and is then
// called so.
[[noreturn]] void end_for_lack_of_memory_or_threads();

// Whether an error means lack of memory: std::bad_alloc, or a thread that could not be started for lack of
// memory, which TBB reports by the text of strerror().
bool is_lack_of_memory(const std::exception& error);

} // namespace marram
