// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/table_file.h"

#include "core/math/problem.h"

#include <csv.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <exception>
#include <fstream>
#include <memory>

namespace marram {
namespace {

struct Reader {
    std::string path;
    TableFile table;
    std::vector<Problem> problems;
    int line = 0;
    bool has_names = false; // the first row has been read
    size_t column = 0;

    std::exception_ptr thrown; // out of memory: must not pass through the library's C code

    static void on_field(void* text, size_t length, void* user) {
        Reader& reader = *static_cast<Reader*>(user);
        try {
            reader.field({static_cast<const char*>(text), length});
        } catch (...) {
            reader.thrown = std::current_exception();
        }
    }
    static void on_row(int, void* user) {
        Reader& reader = *static_cast<Reader*>(user);
        try {
            reader.row();
        } catch (...) {
            reader.thrown = std::current_exception();
        }
    }

    void report(std::string what, std::string fix) {
        constexpr size_t enough = 5;
        if (problems.size() < enough) problems.push_back({{path, line, 0}, std::move(what), std::move(fix)});
    }

    void field(std::string_view text) {
        if (table.values.empty() && !has_names) {
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
        if (has_names && column != table.columns.size())
            report(fmt::format("has {} columns, the first line {}", column, table.columns.size()),
                   "give as many numbers as there are names");
        if (!has_names)
            for (size_t k = 1; k < table.columns.size(); ++k)
                if (std::find(table.columns.begin(), table.columns.begin() + long(k), table.columns[k]) !=
                    table.columns.begin() + long(k))
                    report(fmt::format("has two columns \"{}\"", table.columns[k]),
                           "give each a name of its own");
        column = 0;
        has_names = true;
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
    const auto check = [&](bool good) {
        if (!good)
            throw InputError({path, reader.line, 0},
                             fmt::format("is not valid CSV: {}", csv_strerror(csv_error(&parser))),
                             "separate numbers by commas, a row a line");
    };
    for (std::string line; std::getline(in, line);) {
        ++reader.line; // the library skips empty lines
        if (reader.line == 1 && line.starts_with("\xef\xbb\xbf")) line.erase(0, 3); // UTF-8's mark
        line += '\n';
        check(csv_parse(&parser, line.data(), line.size(), Reader::on_field, Reader::on_row, &reader) ==
              line.size());
    }
    check(csv_fini(&parser, Reader::on_field, Reader::on_row, &reader) == 0);
    if (reader.thrown) std::rethrow_exception(reader.thrown);
    if (reader.table.columns.empty() || reader.table.values.empty())
        reader.report("has no numbers", "give a line of names, then lines of numbers");
    if (!reader.problems.empty()) throw InputError(std::move(reader.problems));
    return std::move(reader.table);
}

} // namespace marram
