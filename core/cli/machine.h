// SPDX-License-Identifier: Apache-2.0
// What the system allows this process: control groups (containers, batch systems) and Slurm.
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

// Bytes that the control groups allow; nullopt: no limit. The kernel kills a process that goes beyond.
std::optional<uint64_t> memory_limit(const std::string& root = "");

// Threads to use where nobody has chosen: `processors`, but no more than the quota, rounded up, and no more
// than SLURM_CPUS_PER_TASK.
int threads_allowed(int processors, const std::string& root = "");

} // namespace marram
