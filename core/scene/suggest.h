// SPDX-License-Identifier: Apache-2.0
// Helpers for messages: suggestions for misspelled names, and printing text of unknown origin.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// The candidate nearest to `name` by edits (insert, delete, replace, swap of neighbours; case ignored), or ""
// if none is near enough: 1 edit for up to 3 letters, 2 for up to 7, 3 above. The first wins a tie. Some
// words of other renderers are known: "spp" is near "samples".
std::string nearest(std::string_view name, std::span<const std::string> candidates);

// `did you mean "x"?`, or else `known are a, b, c and 4 more`. `there is no <noun>` if there are no
// candidates.
std::string hint(std::string_view name, std::span<const std::string> candidates, std::string_view noun,
                 size_t most = 8);

// Makes text printable on one line: control characters become '?', and it is cut after about 60 bytes.
std::string clean(std::string_view text);
std::string in_quotes(std::string_view text);

inline constexpr size_t all_words = 100; // of a list that nothing else prints: types, choices

// "a, b, c and 4 more"
std::string listed(std::span<const std::string> words, size_t most = 8);

// "a|b|c" -> a, b, c; empty for "".
std::vector<std::string> split(std::string_view text, char separator);

} // namespace marram
