// SPDX-License-Identifier: Apache-2.0
// OpenVDB trusts its files: a damaged one can make it write outside its buffers. So a child process reads the
// file, with limits on its memory and time, and sends what it holds as plain arrays through a pipe. If it
// crashes, the file is damaged.
#pragma once

#include "core/math/problem.h"

#include <openvdb/openvdb.h>

#include <cstddef>
#include <functional>
#include <string>

namespace marram {

// What is wrong with a file, and the remedy.
struct Refusal {
    std::string what, remedy;
};
inline const Refusal damaged_file = {"is damaged", "write it again"};

// The pipe. `send` calls begin_sending() when the file is good; before, it may throw Refusal. The child ends
// if a write fails. A read throws Refusal at the end of the pipe.
void begin_sending(int file);
void write_all(int file, const void* data, size_t count);
void read_all(int file, void* data, size_t count);

// send(pipe, bytes) runs in the child, which has one thread, so OpenVDB's parallel functions must not be
// called; what it throws becomes an error about the file. receive(pipe) runs in this process once the child
// sends, and may throw Refusal. `bytes` are freed. Throws InputError.
void read_in_child_process(const std::string& path, std::string& bytes,
                           const std::function<void(int, std::string&)>& send,
                           const std::function<void(int)>& receive);

// All grids of a file's bytes. For `send`.
openvdb::GridPtrVecPtr grids_of(std::string& bytes);

// "name" (float, fog volume), for messages.
std::string description_of(const openvdb::GridBase& grid);

} // namespace marram
