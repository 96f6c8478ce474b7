// SPDX-License-Identifier: Apache-2.0
#include "core/cli/machine.h"

#include "core/math/resident_memory.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <sstream>
#include <string_view>
#include <vector>

namespace marram {
namespace {

std::vector<std::string> words_of(const std::string& text) {
    std::istringstream stream(text);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    return words;
}

bool has_item(std::string_view list, std::string_view item) { // of a list with commas
    while (!list.empty()) {
        const size_t end = std::min(list.find(','), list.size());
        if (list.substr(0, end) == item) return true;
        list.remove_prefix(std::min(end + 1, list.size()));
    }
    return false;
}

std::optional<double> parse_number(const std::string& text) {
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || !std::isfinite(value)) return std::nullopt;
    return value;
}

std::optional<double> parse_limit(const std::string& text) { // "max" and what is no number: none
    const std::optional<double> value = parse_number(text);
    return value && *value > 0.0 ? value : std::nullopt;
}

std::vector<std::string> words_of_file(const std::string& path) {
    std::ifstream file(path);
    std::string line;
    std::getline(file, line);
    return words_of(line);
}

std::optional<double> limit_in(const std::string& path) {
    const std::vector<std::string> words = words_of_file(path);
    return words.empty() ? std::nullopt : parse_limit(words[0]);
}

// Of a file with lines such as "inactive_file 4096": the sum of the numbers of these names; nullopt: the file
// has none of them.
std::optional<double> sum_in(const std::string& path, std::initializer_list<std::string_view> names) {
    std::ifstream file(path);
    std::optional<double> sum;
    for (std::string line; std::getline(file, line);) {
        const std::vector<std::string> words = words_of(line);
        if (words.size() < 2 || std::ranges::find(names, words[0]) == names.end()) continue;
        if (const std::optional<double> value = parse_number(words[1])) sum = sum.value_or(0.0) + *value;
    }
    return sum;
}

// The process's control group in a hierarchy: of the controller in version 1, of all in version 2 ("").
std::optional<std::string> group_path(const std::string& root, const std::string& controller) {
    std::ifstream file(root + "/proc/self/cgroup");
    for (std::string line; std::getline(file, line);) { // "4:cpu,cpuacct:/path", "0::/path"
        const size_t first = line.find(':');
        const size_t second = first == std::string::npos ? first : line.find(':', first + 1);
        if (second == std::string::npos) continue;
        const std::string controllers = line.substr(first + 1, second - first - 1);
        if (controller.empty() ? controllers.empty() : has_item(controllers, controller))
            return line.substr(second + 1);
    }
    return std::nullopt;
}

// Folders of the control group and of those above it, as far as they are mounted.
std::vector<std::string> group_folders(const std::string& root, const std::string& controller) {
    const std::optional<std::string> group = group_path(root, controller);
    if (!group) return {};
    std::ifstream file(root + "/proc/self/mountinfo");
    for (std::string line; std::getline(file, line);) {
        // ID PARENT DEVICE ROOT MOUNT_POINT OPTIONS ... - TYPE SOURCE SUPER_OPTIONS
        const size_t dash = line.find(" - ");
        if (dash == std::string::npos) continue;
        const std::vector<std::string> mount = words_of(line.substr(0, dash)),
                                       type = words_of(line.substr(dash + 3));
        if (mount.size() < 5 || type.size() < 3) continue;
        if (controller.empty() ? type[0] != "cgroup2" : type[0] != "cgroup" || !has_item(type[2], controller))
            continue;
        const std::string top = mount[3] == "/" ? "" : mount[3];
        std::string below = group->starts_with(top + "/") ? group->substr(top.size()) : "";
        std::vector<std::string> folders;
        for (;;) {
            folders.push_back(root + mount[4] + below);
            if (below.empty()) return folders;
            below.resize(below.rfind('/') == std::string::npos ? 0 : below.rfind('/'));
        }
    }
    return {};
}

// The smallest limit of the folders.
std::optional<double> smallest(const std::vector<std::string>& folders,
                               const std::function<std::optional<double>(const std::string&)>& limit_of) {
    std::optional<double> least;
    for (const std::string& folder : folders)
        if (const std::optional<double> limit = limit_of(folder); limit && (!least || *limit < *least))
            least = limit;
    return least;
}

std::optional<double> smaller(std::optional<double> a, std::optional<double> b) {
    return a && b ? std::min(*a, *b) : a ? a : b;
}

} // namespace

std::optional<double> processor_quota(const std::string& root) {
    const auto version_2 = [](const std::string& folder) -> std::optional<double> {
        const std::vector<std::string> words = words_of_file(folder + "/cpu.max"); // QUOTA PERIOD
        if (words.size() != 2) return std::nullopt;
        const std::optional<double> quota = parse_limit(words[0]), period = parse_limit(words[1]);
        return quota && period ? std::optional(*quota / *period) : std::nullopt;
    };
    const auto version_1 = [](const std::string& folder) -> std::optional<double> {
        const std::optional<double> quota = limit_in(folder + "/cpu.cfs_quota_us"), // -1: none
            period = limit_in(folder + "/cpu.cfs_period_us");
        return quota && period ? std::optional(*quota / *period) : std::nullopt;
    };
    return smaller(smallest(group_folders(root, ""), version_2),
                   smallest(group_folders(root, "cpu"), version_1));
}

uint64_t memory_left(const std::string& root) {
    constexpr double unlimited = 0x1p62; // version 1 writes the largest multiple of a page
    const auto room = [](std::optional<double> limit, std::optional<double> used,
                         std::optional<double> cached) -> std::optional<double> {
        if (!limit) return std::nullopt;
        const double taken = used.value_or(0.0) - cached.value_or(0.0);
        return std::max(*limit - std::max(taken, 0.0), 0.0);
    };
    const auto version_2 = [&](const std::string& folder) {
        return room(limit_in(folder + "/memory.max"), limit_in(folder + "/memory.current"),
                    sum_in(folder + "/memory.stat", {"inactive_file", "active_file"}));
    };
    const auto version_1 = [&](const std::string& folder) {
        return room(limit_in(folder + "/memory.limit_in_bytes"), limit_in(folder + "/memory.usage_in_bytes"),
                    sum_in(folder + "/memory.stat", {"total_inactive_file", "total_active_file"}));
    };
    double left = smaller(smallest(group_folders(root, ""), version_2),
                          smallest(group_folders(root, "memory"), version_1))
                      .value_or(unlimited);
    if (const std::optional<double> kb = sum_in(root + "/proc/meminfo", {"MemAvailable:"}))
        left = std::min(left, *kb * 0x1p10);
    const char* slurm = std::getenv("SLURM_MEM_PER_NODE"); // 0: all that the node has
    if (const std::optional<double> mb = slurm ? parse_limit(slurm) : std::nullopt)
        left = std::min(left, std::max(*mb * 0x1p20 - double(resident_bytes()), 0.0));
    return uint64_t(std::clamp(left, 0.0, unlimited));
}

int threads_allowed(int processors, const std::string& root) {
    int threads = processors;
    // Compared as double: a quota may be any number.
    if (const std::optional<double> quota = processor_quota(root); quota && std::ceil(*quota) < threads)
        threads = int(std::ceil(*quota));
    const char* slurm = std::getenv("SLURM_CPUS_PER_TASK");
    if (const std::optional<double> limit = slurm ? parse_limit(slurm) : std::nullopt;
        limit && *limit < threads)
        threads = int(*limit);
    return std::max(threads, 1);
}

} // namespace marram
