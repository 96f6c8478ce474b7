// SPDX-License-Identifier: Apache-2.0
#include "core/host/report.h"

#include <algorithm>

namespace marram {
namespace {

constexpr std::string_view thread_prefix = "thread_seconds.", wall_prefix = "seconds.";

void combine(Report::Entry& entry, const std::string& procedural, double value) {
    switch (entry.declared.combine) {
    case MARRAM_MAXIMUM:
        entry.value = std::max(entry.value, value);
        break;
    case MARRAM_LAST:
        entry.value = value;
        break;
    case MARRAM_EACH:
        entry.each[procedural] = value;
        break;
    case MARRAM_RATIO: // computed, never reported
        break;
    default:
        entry.value += value;
    }
}

// Whether a path is one of a pattern, in which [] stands for any index and * for any part between dots.
bool matches(std::string_view path, std::string_view pattern) {
    while (!pattern.empty()) {
        if (pattern.starts_with("[]")) {
            const size_t end = path.find(']');
            if (!path.starts_with('[') || end == std::string_view::npos) return false;
            path.remove_prefix(end + 1);
            pattern.remove_prefix(2);
        } else if (pattern.front() == '*') {
            const size_t end = std::min(path.find('.'), path.size());
            if (end == 0) return false;
            path.remove_prefix(end);
            pattern.remove_prefix(1);
        } else {
            if (path.empty() || path.front() != pattern.front()) return false;
            path.remove_prefix(1);
            pattern.remove_prefix(1);
        }
    }
    return path.empty();
}

} // namespace

Report::Entry& Report::entry(std::string_view path) {
    const auto [found, made] = entries_.try_emplace(std::string(path));
    if (made)
        for (const MarramReportEntry& pattern : patterns_)
            if (matches(path, pattern.path)) {
                found->second.declared = pattern;
                break;
            }
    return found->second;
}

void Report::declare(std::span<const MarramReportEntry> entries) {
    for (const MarramReportEntry& declared : entries) {
        const std::string path = declared.path;
        if (path.starts_with(thread_prefix))
            entries_[std::string(wall_prefix) + path.substr(thread_prefix.size())];
        else if (path.find("[]") != std::string::npos || path.find('*') != std::string::npos)
            patterns_.push_back(declared);
        else
            entries_[path].declared = declared;
    }
}

void Report::add(std::string_view path, double value) { combine(entry(path), "", value); }

void Report::add(const std::string& procedural, std::span<const std::pair<std::string, double>> entries,
                 double wall) {
    double threads = 0.0;
    for (const auto& [path, value] : entries)
        if (path.starts_with(thread_prefix)) threads += value;
    if (!(threads > 0.0)) add("seconds.expand", wall);
    for (const auto& [path, value] : entries) {
        if (!path.starts_with(thread_prefix))
            combine(entry(path), procedural, value);
        else if (threads > 0.0)
            add(std::string(wall_prefix) + path.substr(thread_prefix.size()), wall * value / threads);
    }
}

double Report::operator()(std::string_view path) const {
    const auto found = entries_.find(path);
    if (found == entries_.end()) return 0.0;
    const MarramReportEntry& declared = found->second.declared;
    if (declared.combine != MARRAM_RATIO || !declared.path) return found->second.value;
    const auto plain = [&](const char* of) { // a ratio must not refer to ratios
        const auto operand = of ? entries_.find(std::string_view(of)) : entries_.end();
        return operand == entries_.end() ? 0.0 : operand->second.value;
    };
    const double below = plain(declared.denominator);
    return below > 0.0 ? plain(declared.numerator) / below : 1.0;
}

double strand_seconds(const Report& report) {
    double sum = 0.0;
    for (const auto& [path, entry] : report.entries())
        if (path.starts_with(wall_prefix)) sum += entry.value;
    return sum;
}

} // namespace marram
