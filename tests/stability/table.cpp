// SPDX-License-Identifier: Apache-2.0
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <vector>

namespace marram::stability {
namespace {

struct Row {
    std::string hard_case, worst, bound, unit;
    bool holds;
};

std::vector<Row>& rows() {
    static std::vector<Row> all;
    return all;
}

std::string text(double value) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.2g", value);
    return buffer;
}

class Table : public ::testing::Environment {
    void TearDown() override {
        size_t widest = 9;
        for (const Row& r : rows()) widest = std::max(widest, r.hard_case.size());
        const int wide = int(widest);
        std::printf("\n%-*s  %11s  %9s  %s\n", wide, "hard case", "worst error", "bound", "unit");
        for (const Row& r : rows())
            std::printf("%-*s  %11s  %9s  %s%s\n", wide, r.hard_case.c_str(), r.worst.c_str(),
                        r.bound.c_str(), r.unit.c_str(), r.holds ? "" : "   EXCEEDED");
        std::printf("\n");
    }
};

// gtest takes ownership.
[[maybe_unused]] const ::testing::Environment* const table = ::testing::AddGlobalTestEnvironment(new Table);

} // namespace

void row(const std::string& hard_case, double worst_error, double bound, const std::string& unit) {
    const bool holds = worst_error <= bound; // false for a NaN
    rows().push_back({hard_case, text(worst_error), text(bound), unit, holds});
    EXPECT_TRUE(holds) << hard_case << ": " << worst_error << " " << unit << " exceeds " << bound;
}

void none(const std::string& hard_case, long long count, const std::string& what) {
    row(hard_case, double(count), 0.0, what);
}

void figure(const std::string& hard_case, double value, const std::string& unit) {
    rows().push_back({hard_case, text(value), "", unit, true});
}

} // namespace marram::stability
