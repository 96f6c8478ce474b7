// SPDX-License-Identifier: Apache-2.0
// Problems of an input: what is wrong, where, and how to fix it. Mistakes of the user are thrown together as
// one InputError; mistakes of the programmer are asserts.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

// A position in a text file. line and column count from 1; 0 means unknown and is not printed.
struct Place {
    std::string file;
    int line = 0;
    int column = 0;
    bool operator==(const Place&) const = default;
};

// Also a warning, which has neither a place nor a fix where there is none.
struct Problem {
    Place place{};
    std::string what{};         // what is wrong
    std::string fix{};          // what to do about it
    std::string id{};           // for programs: "groom.no_mesh"; "": none
    std::string missing_file{}; // if that is what is wrong

    Problem() = default;
    // No aggregate: GCC 12 takes what an exception leaves of one for uninitialised.
    Problem(Place at, std::string wrong, std::string remedy = {}, std::string name = {})
        : place(std::move(at)), what(std::move(wrong)), fix(std::move(remedy)), id(std::move(name)) {}
    bool operator==(const Problem&) const = default;
};

// "file:line:column", "file:line" or "file", as to_string() writes it.
Place parse_place(std::string_view text);

// What is worth knowing at once, such as what a procedural says of its work: shown as show_notes() has set,
// by default as a line on stderr. From any thread.
void note(const Problem& note);
void show_notes(void (*show)(const Problem& note));

inline std::string to_string(const Place& place) {
    std::string text = place.file;
    // Two appends, as GCC 12 warns of an overlapping copy for literal + string (GCC bug 105329).
    if (place.line > 0) text.append(":").append(std::to_string(place.line));
    if (place.line > 0 && place.column > 0) text.append(":").append(std::to_string(place.column));
    return text;
}

// The text, or its beginning and end if it has more than `most` bytes. UTF-8 characters are not split.
inline std::string shortened(const std::string& text, size_t most) {
    if (text.size() <= most) return text;
    const auto continues = [&](size_t i) { return (static_cast<unsigned char>(text[i]) & 0xc0U) == 0x80U; };
    size_t head = most * 3 / 4, tail = text.size() - most / 8;
    while (head > 0 && continues(head)) --head;
    while (tail < text.size() && continues(tail)) ++tail;
    return text.substr(0, head) + " ... " + text.substr(tail);
}

// "file:line:column: what is wrong: what to do", on one line. Long parts, which quote the input, are
// shortened.
inline std::string to_string(const Problem& problem) {
    constexpr size_t longest_part = 400, longest_place = 1000;
    std::string text = shortened(to_string(problem.place), longest_place);
    for (const std::string* part : {&problem.what, &problem.fix}) {
        if (!text.empty() && !part->empty()) text.append(": ");
        text.append(shortened(*part, longest_part));
    }
    for (size_t i = 0; i < text.size(); ++i) {
        char& c = text[i];
        const auto byte = static_cast<unsigned char>(c);
        const bool second = i > 0 && static_cast<unsigned char>(text[i - 1]) == 0xc2U; // U+0080 to U+009F
        if (c == '\n' || c == '\r' || c == '\t')
            c = ' ';
        else if (byte < 32 || byte == 127) // a terminal would interpret it
            c = '?';
        else if (second && byte >= 0x80U && byte <= 0x9fU)
            text.replace(i - 1, 2, "??");
    }
    return text;
}

class InputError : public std::runtime_error {
  public:
    explicit InputError(std::vector<Problem> all)
        : std::runtime_error(all.empty() ? "bad input" : to_string(all.front())), problems(std::move(all)) {}
    InputError(Place place, std::string what, std::string fix)
        : InputError(std::vector<Problem>{{std::move(place), std::move(what), std::move(fix)}}) {}

    std::vector<Problem> problems;
};

// Runs steps and collects their InputErrors, so that all mistakes are reported together.
class ProblemCollector {
  public:
    template <typename Step>
    void operator()(Step&& step) {
        try {
            step();
        } catch (const InputError& error) {
            problems_.insert(problems_.end(), error.problems.begin(), error.problems.end());
        }
    }
    void raise() const {
        if (!problems_.empty()) throw InputError(problems_);
    }

  private:
    std::vector<Problem> problems_;
};

} // namespace marram
