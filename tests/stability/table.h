// SPDX-License-Identifier: Apache-2.0
// Report of the stability run: a row for every hard case in accuracy.md, printed as one table after all
// tests.
#pragma once

#include <string>

namespace marram::stability {

// Adds a row; fails the running test if the error exceeds the bound or is NaN. unit: of both.
void row(const std::string& hard_case, double worst_error, double bound, const std::string& unit);

// Counts that must be 0.
void none(const std::string& hard_case, long long count, const std::string& what);

// A value that is reported without a bound.
void figure(const std::string& hard_case, double value, const std::string& unit);

} // namespace marram::stability
