// SPDX-License-Identifier: Apache-2.0
// Memory of the process: what is free goes back to the system, and what is said when there is none left.
#pragma once

#include <exception>

namespace marram {

// Gives freed memory back to the system. Call it between frames: without it the heaps of several threads grow with every
// frame, by 1 to 8 MB, since the holes that one frame leaves do not fit the next. Takes a few milliseconds.
void release_free_memory();

// From here on a lack of memory that no caller can report (in a library's initialiser, in a thread of a library, a null
// pointer that a library does not check) ends the process with one line and exit code 2. Other crashes stay what they are.
// main.cpp calls it before the initialisers of shared libraries run: it touches nothing that needs one.
void watch_for_lack_of_memory();

// Says that memory has run out, removes temporary files and ends the process with exit code 2. Exit handlers are not run: libraries whose
// threads could not all be started crash in theirs (OpenEXR's, about once in three times).
[[noreturn]] void end_for_lack_of_memory();

// Whether an error is one: no memory, or no thread for want of its stack (which TBB says in words).
bool is_lack_of_memory(const std::exception& error);

} // namespace marram
