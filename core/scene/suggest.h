// SPDX-License-Identifier: Apache-2.0
// Words for messages: what the user may have meant, and text of unknown origin made fit to print.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// The candidate nearest to `name` by edits (insert, delete, replace, swap of neighbours; case ignored), or ""
// where none is near enough to be meant: 1 edit up to 3 letters, 2 up to 7, 3 above. The first wins a tie.
std::string nearest(std::string_view name, std::span<const std::string> candidates);

// `did you mean "x"?`, or else `known are a, b, c and 4 more`, or `there is no <noun>` without any
// candidates.
std::string hint(std::string_view name, std::span<const std::string> candidates, std::string_view noun);

// Printable on one line and short: control characters become '?', what is longer than some 60 bytes is cut.
std::string clean(std::string_view text);
std::string in_quotes(std::string_view text);

// "a, b, c and 4 more"
std::string listed(std::span<const std::string> words, size_t most = 8);

// "a|b|c" -> a, b, c; nothing for "".
std::vector<std::string> split(std::string_view text, char separator);

} // namespace marram
