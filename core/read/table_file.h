// SPDX-License-Identifier: Apache-2.0
// Reads tables of numbers from CSV files: a line of column names, then a line of numbers per row. Separated
// by commas, semicolons or tabs, whichever the line of names has first.
#pragma once

#include <string>
#include <vector>

namespace marram {

struct TableFile {
    std::vector<std::string> columns;
    std::vector<float> values; // row by row
};

// Throws InputError with file and line for what is not a number, and for rows of another length.
TableFile read_table_file(const std::string& path);

} // namespace marram
