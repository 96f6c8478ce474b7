// SPDX-License-Identifier: Apache-2.0
// Measures the wear by traced grains against closed forms, and prints tables.
//
//     grains plates        plates at seven angles, both laws
//     grains errors        sphere, step and cavity: error over paths, and its slope
//     grains step          wear behind a step, strip by strip
//     grains speed [n]     chords of grains a second against Embree alone on a ray for each; n^2 quadrilaterals (710)
#include "tests/unit/erosion/grain_cases.h"

#include "core/math/hash.h"

#include <tbb/global_control.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

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

// A rough rock of n^2 quadrilaterals.
GrainShape rough_rock(uint32_t n) {
    GrainShape shape = grain_plate({-1.0, 0.0, -1.0}, {2.0, 0.0, 0.0}, {0.0, 0.0, 2.0}, n, n);
    for (size_t k = 0; k < shape.vertices.size(); k += 3) {
        const double x = shape.vertices[k], z = shape.vertices[k + 2];
        const double r = std::hypot(x, z);
        shape.vertices[k + 1] =
            float(0.8 * std::exp(-4.0 * r * r) + 0.05 * std::sin(23.0 * x) * std::sin(31.0 * z) +
                  0.002 * unit_double(hash(1, k)));
    }
    return shape;
}

// CPU seconds, so that other processes do not count.
double cpu_seconds(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

void print_speed(uint32_t n) {
    GrainScene scene;
    const unsigned id = scene.add(rough_rock(n));
    scene.commit();
    const WornMesh mesh = scene.worn(id);
    std::printf("speed: %zu triangles, 2^18 grains, chords per CPU second in millions; bare: Embree alone on "
                "a ray for "
                "each chord\n%8s %10s %10s %10s %10s %8s\n",
                mesh.triangle_count, "threads", "chords", "rays", "traced", "bare", "ratio");
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        for (const double drag : {0.0, 0.2})
            for (uint32_t round = 0; round < 2; ++round) {
                GrainSettings s;
                s.paths = 1 << 18, s.drag_time = drag, s.seed = round;
                const double begin = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID);
                const GrainResult alone = traced(scene, mesh, s);
                const double seconds = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID) - begin;
                std::atomic<int64_t> nanoseconds{0};
                GrainHooks hooks;
                hooks.rays = [&](std::span<const RTCRayHit> rays) {
                    thread_local std::vector<RTCRayHit> copy;
                    copy.assign(rays.begin(), rays.end());
                    const double start = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
                    for (RTCRayHit& ray : copy) marram_intersect1(scene.get(), &ray, 0);
                    nanoseconds += int64_t(1e9 * (cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - start));
                };
                const double chords = 1e-6 * double(traced(scene, mesh, s, hooks).report.rays);
                const double rate = chords / seconds, bare = chords / (1e-9 * double(nanoseconds));
                std::printf("%8d %10.0f %10.0f %10.2f %10.2f %8.2f%s\n", threads, 1e6 * chords,
                            double(alone.report.rays), rate, bare, rate / bare,
                            drag > 0.0 ? "  with drag" : "");
                std::fflush(stdout);
            }
    }
}

} // namespace
} // namespace marram::testing

int main(int argc, char** argv) {
    using namespace marram::testing;
    const auto asked = [&](const char* name) { return argc < 2 || std::strcmp(argv[1], name) == 0; };
    if (asked("plates")) print_plates();
    if (asked("step")) print_step();
    if (asked("speed")) print_speed(argc > 2 ? uint32_t(std::atoi(argv[2])) : 710);
    if (asked("errors")) print_errors();
}
