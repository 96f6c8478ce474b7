// SPDX-License-Identifier: Apache-2.0
#include "core/math/problem.h"

#include <atomic>
#include <charconv>
#include <cstdio>
#include <string_view>
#include <system_error>

namespace marram {
namespace {

std::atomic<void (*)(const Problem&)> show_note{nullptr};

// Takes ":digits" from the end of the text. 0: there are none.
int take_number_at_end(std::string_view& text) {
    const size_t colon = text.rfind(':');
    if (colon == std::string_view::npos || colon == 0) return 0;
    const std::string_view digits = text.substr(colon + 1);
    int number = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (error != std::errc{} || end != digits.data() + digits.size() || number <= 0) return 0;
    text = text.substr(0, colon);
    return number;
}

} // namespace

Place parse_place(std::string_view text) {
    const int last = take_number_at_end(text), first = last > 0 ? take_number_at_end(text) : 0;
    return first > 0 ? Place{std::string(text), first, last} : Place{std::string(text), last, 0};
}

void show_notes(void (*show)(const Problem& note)) { show_note = show; }

void note(const Problem& note) {
    if (const auto show = show_note.load())
        show(note);
    else
        std::fprintf(stderr, "%s\n", to_string(note).c_str());
}

} // namespace marram
