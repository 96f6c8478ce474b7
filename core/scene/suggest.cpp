// SPDX-License-Identifier: Apache-2.0
#include "core/scene/suggest.h"

#include <algorithm>
#include <fmt/format.h>

namespace marram {
namespace {

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

// Optimal string alignment distance: three rows of the usual table.
size_t edits(std::string_view a, std::string_view b) {
    std::vector<size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j) last[j] = j;
    for (size_t i = 1; i <= a.size(); ++i) {
        row[0] = i;
        for (size_t j = 1; j <= b.size(); ++j) {
            const bool same = lower(a[i - 1]) == lower(b[j - 1]);
            row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (same ? 0 : 1)});
            const bool swapped =
                i > 1 && j > 1 && lower(a[i - 1]) == lower(b[j - 2]) && lower(a[i - 2]) == lower(b[j - 1]);
            if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
        }
        std::swap(before, last);
        std::swap(last, row);
    }
    return last[b.size()];
}

// Words of other renderers for what is called otherwise here.
struct OtherWord {
    std::string_view other, ours;
};
constexpr OtherWord other_words[] = {
    {"spp", "samples"},       {"aa_samples", "samples"},   {"resolution", "size"},
    {"bounces", "max_depth"}, {"depth", "max_depth"},      {"thickness", "width"},
    {"segments", "cvs"},      {"aperture", "lens_radius"}, {"focal_distance", "focus"},
    {"look_at", "target"},    {"lookat", "target"},        {"eye", "position"},
    {"albedo", "color"},      {"diffuse_color", "color"},  {"fstop", "lens_radius"},
    {"base_color", "color"},
};

} // namespace

std::string nearest(std::string_view name, std::span<const std::string> candidates) {
    for (const OtherWord& word : other_words)
        if (name == word.other && std::ranges::find(candidates, word.ours) != candidates.end())
            return std::string(word.ours);
    const size_t allowed = name.size() <= 3 ? 1 : name.size() <= 7 ? 2 : 3;
    size_t least = allowed + 1;
    std::string best;
    for (const std::string& candidate : candidates) {
        // The distance is at least the difference in length. The test also keeps very long names cheap.
        if (name.size() > candidate.size() + allowed || candidate.size() > name.size() + allowed) continue;
        const size_t distance = edits(name, candidate);
        if (distance >= least || distance >= std::max(name.size(), candidate.size())) continue;
        least = distance;
        best = candidate;
    }
    return best;
}

std::string hint(std::string_view name, std::span<const std::string> candidates, std::string_view noun,
                 size_t most) {
    if (candidates.empty()) return fmt::format("there is no {}", noun);
    const std::string best = nearest(name, candidates);
    if (!best.empty()) return fmt::format("did you mean {}?", in_quotes(best));
    return "known are " + listed(candidates, most);
}

std::string clean(std::string_view text) {
    constexpr size_t longest = 60;
    size_t end = text.size();
    if (end > longest) {
        end = longest;
        while (end > 0 && (text[end] & 0xC0) == 0x80) --end; // not in the middle of a UTF-8 character
    }
    std::string out(text.substr(0, end));
    for (char& c : out)
        if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
    return end < text.size() ? out + "..." : out;
}

std::string in_quotes(std::string_view text) { return fmt::format("\"{}\"", clean(text)); }

std::string listed(std::span<const std::string> words, size_t most) {
    std::string text;
    for (size_t i = 0; i < std::min(most, words.size()); ++i) text += (i ? ", " : "") + clean(words[i]);
    if (words.size() > most) text += fmt::format(" and {} more", words.size() - most);
    return text;
}

std::vector<std::string> split(std::string_view text, char separator) {
    std::vector<std::string> parts;
    for (size_t begin = 0; !text.empty() && begin <= text.size();) {
        const size_t end = std::min(text.find(separator, begin), text.size());
        parts.emplace_back(text.substr(begin, end - begin));
        begin = end + 1;
    }
    return parts;
}

} // namespace marram
