// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/table_file.h"

#include "core/math/problem.h"

#include <csv.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <memory>

namespace marram {
namespace {

struct Reader {
    std::string path;
    TableFile table;
    std::vector<Problem> problems;
    int line = 1;
    size_t column = 0;

    static void on_field(void* text, size_t length, void* user) {
        static_cast<Reader*>(user)->field({static_cast<const char*>(text), length});
    }
    static void on_row(int, void* user) { static_cast<Reader*>(user)->row(); }

    void report(std::string what, std::string fix) {
        constexpr size_t enough = 5;
        if (problems.size() < enough) problems.push_back({{path, line, 0}, std::move(what), std::move(fix)});
    }

    void field(std::string_view text) {
        if (line == 1) {
            table.columns.emplace_back(text);
            return;
        }
        float number = 0.0F;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
        if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(number))
            report(fmt::format("column {} is \"{}\"", column + 1, text.substr(0, 40)), "give a number");
        table.values.push_back(number);
        ++column;
    }

    void row() {
        if (line > 1 && column != table.columns.size())
            report(fmt::format("has {} columns, the first line {}", column, table.columns.size()),
                   "give as many numbers as there are names");
        column = 0;
        ++line;
    }
};

} // namespace

TableFile read_table_file(const std::string& path) {
    Reader reader;
    reader.path = path;
    std::ifstream in(path, std::ios::binary);
    if (!in) throw InputError({path}, "cannot be read", "check its permissions");
    csv_parser parser;
    if (csv_init(&parser, CSV_STRICT | CSV_STRICT_FINI | CSV_APPEND_NULL) != 0) throw std::bad_alloc();
    const std::unique_ptr<csv_parser, void (*)(csv_parser*)> owner(&parser, csv_free);
    std::array<char, 1 << 16> block;
    const auto check = [&](bool good) {
        if (!good)
            throw InputError({path, reader.line, 0},
                             fmt::format("is no CSV: {}", csv_strerror(csv_error(&parser))),
                             "separate numbers by commas, a row a line");
    };
    while (in.read(block.data(), block.size()) || in.gcount() > 0) {
        const auto count = size_t(in.gcount());
        check(csv_parse(&parser, block.data(), count, Reader::on_field, Reader::on_row, &reader) == count);
    }
    check(csv_fini(&parser, Reader::on_field, Reader::on_row, &reader) == 0);
    if (reader.table.columns.empty() || reader.table.values.empty())
        reader.report("has no numbers", "give a line of names, then lines of numbers");
    if (!reader.problems.empty()) throw InputError(std::move(reader.problems));
    return std::move(reader.table);
}

} // namespace marram
