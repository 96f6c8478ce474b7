// SPDX-License-Identifier: Apache-2.0
// What the system allows this process: control groups (containers, batch systems), Slurm and the machine.
//
// Limits of a control group hold for all below it, so the smallest from the process's group up counts. Both
// versions of Linux's control groups are read, wherever they are mounted. A file that is not there, or cannot
// be read, limits nothing.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace marram {

// root: folder that holds /proc and all that is mounted; tests have one of their own.

// Processors that the quota of the control groups allows, such as 2.5; nullopt: no limit.
std::optional<double> processor_quota(const std::string& root = "");

// Bytes that this process may take besides what it has: the smallest of
//   - MemAvailable of the machine,
//   - limit - usage + cached files of each control group (the kernel drops these first),
//   - SLURM_MEM_PER_NODE - what the process has in RAM.
// 2^62 if nothing limits them. A control group's limit counts all its processes, and the kernel kills one of
// them beyond it. Takes about 0.3 ms.
uint64_t memory_left(const std::string& root = "");

// Threads to use where nobody has chosen: `processors`, but no more than the quota, rounded up, and no more
// than SLURM_CPUS_PER_TASK.
int threads_allowed(int processors, const std::string& root = "");

} // namespace marram
