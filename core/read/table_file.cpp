// SPDX-License-Identifier: Apache-2.0
#include "core/read/table_file.h"

#include "core/read/mesh_reader.h"

#include <csv.h>
#include <fmt/format.h>

#include <algorithm>
#include <exception>
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
        if (parse_number(text, number) != NumberFault::none) {
            const bool has_comma = text.find(',') != std::string_view::npos;
            report(fmt::format("column {} is \"{}\"", column + 1, text.substr(0, 40)),
                   has_comma ? "write decimals with a point, as 3.5" : "give a number");
        }
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

// The first of the separators in the line of names. Programs write semicolons where decimals have commas.
unsigned char separator_of(std::string_view text) {
    const std::string_view names = text.substr(0, text.find_first_of("\r\n"));
    const size_t first = names.find_first_of(",;\t");
    return first == std::string_view::npos ? ',' : static_cast<unsigned char>(names[first]);
}

} // namespace

TableFile read_table_file(const std::string& path) {
    Reader reader;
    reader.path = path;
    const std::string text = read_text(path, ".csv");
    csv_parser parser;
    if (csv_init(&parser, CSV_STRICT | CSV_STRICT_FINI | CSV_APPEND_NULL) != 0) throw std::bad_alloc();
    const std::unique_ptr<csv_parser, void (*)(csv_parser*)> owner(&parser, csv_free);
    const auto check = [&](bool good) {
        if (!good)
            throw InputError({path, reader.line, 0},
                             fmt::format("is not valid CSV: {}", csv_strerror(csv_error(&parser))),
                             "separate numbers by commas or semicolons, a row a line");
    };
    const unsigned char separator = separator_of(text);
    csv_set_delim(&parser, separator);
    std::string line;
    for (size_t begin = 0; begin < text.size(); begin += line.size()) {
        line = text.substr(begin, std::min(text.find('\n', begin), text.size() - 1) + 1 - begin);
        ++reader.line; // the library skips empty lines
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
