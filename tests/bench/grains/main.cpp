// SPDX-License-Identifier: Apache-2.0
// Measures the wear by traced grains against closed forms, and prints tables. Their speed:
// build/marram_bench.
//
//     grains plates        plates at seven angles, both laws
//     grains errors        sphere, step and cavity: error over paths, and its slope
//     grains step          wear behind a step, strip by strip
#include "tests/unit/erosion/grain_cases.h"

#include <cstdio>
#include <cstring>

namespace marram::testing {
namespace {

void print_plates() {
    std::printf("plates: wear over the closed form, 2^20 grains\n%8s %12s %12s\n", "angle", "n = 0", "n = 2");
    for (const double angle : {10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0})
        std::printf("%8.0f %12.6f %12.6f\n", angle, plate_ratio(angle * degree, 0.0, 1 << 20, 1),
                    plate_ratio(angle * degree, 2.0, 1 << 20, 1));
}

void print_errors() {
    const std::vector<double> dense = cavity_wear(100ULL << 16, 99);
    struct Case {
        const char* name;
        std::function<double(uint64_t, uint32_t)> error;
    };
    const Case cases[] = {
        {"sphere", [](uint64_t n, uint32_t seed) { return sphere_error(n, seed); }},
        {"step", [](uint64_t n, uint32_t seed) { return step_error(step_wear(n, seed)); }},
        {"plain", [](uint64_t n, uint32_t seed) { return step_error(step_wear(n, seed, 0.0)); }},
        {"cavity", [&](uint64_t n, uint32_t seed) { return relative_error(cavity_wear(n, seed), dense); }},
    };
    const std::vector<uint64_t> paths = {1 << 10, 1 << 12, 1 << 14, 1 << 16};
    std::printf("errors: relative, area-weighted, seed 1; slope: of the root mean square of 16 seeds\n%8s",
                "");
    for (const uint64_t n : paths) std::printf(" %10llu", static_cast<unsigned long long>(n));
    std::printf(" %8s\n", "slope");
    for (const Case& c : cases) {
        std::printf("%8s", c.name);
        for (const uint64_t n : paths) std::printf(" %10.6f", c.error(n, 1));
        std::printf(" %8.2f\n", error_slope(c.error, paths, 16));
        std::fflush(stdout);
    }
}

void print_step() {
    const StepWear step = step_wear(1 << 20, 1);
    std::printf("step: mm a year behind a step of 0.1 m, 2^20 grains\n%8s %12s %12s\n", "m", "wear",
                "closed");
    for (size_t k = 0; k < step.wear.size(); ++k)
        std::printf("%8.3f %12.6f %12.6f\n", 0.05 * (double(k) + 0.5), 1e3 * step.wear[k],
                    1e3 * step.expected[k]);
}

} // namespace
} // namespace marram::testing

int main(int argc, char** argv) {
    using namespace marram::testing;
    const auto asked = [&](const char* name) { return argc < 2 || std::strcmp(argv[1], name) == 0; };
    if (asked("plates")) print_plates();
    if (asked("step")) print_step();
    if (asked("errors")) print_errors();
}
