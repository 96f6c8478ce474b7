// SPDX-License-Identifier: Apache-2.0
// The stability run's report: a row for every hard case of accuracy.md, printed as one table when all tests are done.
#pragma once

#include <string>

namespace marram::stability {

// Adds a row and fails the running test where the error exceeds the bound or is no number. unit: of both.
void row(const std::string& hard_case, double worst_error, double bound, const std::string& unit);

// Counts that must be 0.
void none(const std::string& hard_case, long long count, const std::string& what);

// A figure that is reported and bounded by nothing.
void figure(const std::string& hard_case, double value, const std::string& unit);

} // namespace marram::stability
