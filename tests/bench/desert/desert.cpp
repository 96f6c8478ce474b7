// SPDX-License-Identifier: Apache-2.0
// Speed of the dune solver, of traced grains and of erosion: benchmarks of build/marram_bench.
//
//     dune_step      a step: ns a cell, those of each stage, CPU ns of all cores together; bytes of memory a cell
//                    (a process needs 2 to 3 MB besides, once, which count as its first solver's)
//     grain_rays     grains that wear a rough rock: rays a second, relative to Embree alone on the same rays
//     erosion_pass   a pass on a level set of 512^3 voxels, 10^7 paths, at most one voxel of wear
#include "core/math/clock.h"
#include "core/math/hash.h"
#include "core/math/median.h"
#include "procedural/erosion/erosion.h"
#include "procedural/terrain/solver/solver.h"
#include "tests/unit/erosion/grain_cases.h"
#include "tests/unit/erosion/rock_shapes.h"

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>
#include <tbb/scalable_allocator.h>

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <span>
#include <string>
#include <vector>

namespace marram::bench {
namespace {

double cpu_seconds(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

// ---- Memory of this process, as the system counts it ------------------------------------------------------

// Bytes in use. `peak`: the most since the last reset_peak_memory().
double memory_in_use(bool peak) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.starts_with(peak ? "VmHWM:" : "VmRSS:")) return 1024.0 * std::atof(line.c_str() + 6);
    return std::nan("");
}
void return_freed_memory() {
    mallopt(M_MMAP_THRESHOLD, 1 << 17); // fixed, so that freed arrays are returned to the system
    malloc_trim(0);
    scalable_free(scalable_malloc(1)); // cleaning crashes before the first allocation
    scalable_allocation_command(TBBMALLOC_CLEAN_ALL_BUFFERS, nullptr);
}
// Returns false where the system does not allow it.
bool reset_peak_memory() { return bool(std::ofstream("/proc/self/clear_refs") << 5 << std::flush); }

// ---- Dunes ------------------------------------------------------------------------------------------------

struct DuneCase {
    int size = 1024; // cells along each side
    bool plants = false;
    double wake = 0.0, growth = 0.0; // of plants: DuneSolverSettings::growth
    double turn = 0.0;               // degrees by which the wind turns to either side over the grid
};

// A bed covered with sand, of waves, periodic, wind at 30 degrees to the grid.
void dune_step(benchmark::State& state, const DuneCase& given) {
    const int n = given.size;
    const Domain domain{n, n, 1.0, 0.0, 0.0};
    const double cells = double(domain.count());
    const std::vector<float> rock(domain.count(), 0.0F);
    std::vector<SandUnits> sand(domain.count());
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const double a = 2.0 * pi * i / 32.0, b = 2.0 * pi * j / 64.0;
            sand[domain.index(i, j)] =
                sand_units(5.0 + 1.2 * std::sin(a + std::sin(b)) + 0.3 * std::sin(2 * a + b));
        }
    std::vector<float> plants;
    for (size_t k = 0; given.plants && k < domain.count(); ++k)
        plants.push_back(k / 8 % 7 == 0 ? 0.1F : 0.0F);
    WindField field;
    if (given.turn > 0.0) field.strength.assign(domain.count(), 1.0F);
    for (size_t k = 0; k < field.strength.size(); ++k)
        field.turn.push_back(float(given.turn * degree * std::sin(2.0 * pi * double(k % size_t(n)) / n)));
    DuneSolverSettings settings;
    settings.growth.wake = given.wake, settings.growth.rate = given.growth;

    return_freed_memory();
    const double memory = reset_peak_memory() ? memory_in_use(false) : std::nan("");
    DuneSolver solver(domain, settings, rock.data(), sand.data(), given.plants ? plants.data() : nullptr,
                      field);
    const SandWind wind{std::cos(30.0 * degree), std::sin(30.0 * degree), 0.4};
    for (int warm = 0; warm < 2; ++warm) solver.step(wind, 1e9);
    const DuneTimes before = solver.times();
    std::vector<double> times;
    double cpu = 0.0;
    for (auto _ : state) {
        const double begin = wall_seconds(), cpu_begin = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID);
        solver.step(wind, 1e9);
        times.push_back(wall_seconds() - begin);
        cpu += cpu_seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu_begin;
        state.SetIterationTime(times.back());
    }
    const DuneTimes& after = solver.times();
    const double mean = 1e9 / (cells * double(times.size()));
    state.counters["ns"] = 1e9 / cells * median(times);
    state.counters["goal"] = 40.0;
    state.counters["cpu_ns"] = mean * cpu;
    state.counters["bytes"] = (memory_in_use(true) - memory) / cells;
    state.counters["surface"] = mean * (after.surface - before.surface);
    state.counters["bubbles"] = mean * (after.separation - before.separation);
    state.counters["wakes"] = mean * (after.wake - before.wake);
    state.counters["shear"] = mean * (after.shear - before.shear);
    state.counters["q_sat"] = mean * (after.saturation - before.saturation);
    state.counters["march"] = mean * (after.march - before.march);
    state.counters["slides"] = mean * (after.avalanche - before.avalanche);
}

// ---- Grains -----------------------------------------------------------------------------------------------

// A rough rock of n^2 quadrilaterals.
testing::GrainShape rough_rock(uint32_t n) {
    testing::GrainShape shape =
        testing::grain_plate({-1.0, 0.0, -1.0}, {2.0, 0.0, 0.0}, {0.0, 0.0, 2.0}, n, n);
    for (size_t k = 0; k < shape.vertices.size(); k += 3) {
        const double x = shape.vertices[k], z = shape.vertices[k + 2];
        const double r = std::hypot(x, z);
        shape.vertices[k + 1] =
            float(0.8 * std::exp(-4.0 * r * r) + 0.05 * std::sin(23.0 * x) * std::sin(31.0 * z) +
                  0.002 * unit_double(hash(1, k)));
    }
    return shape;
}

// A million triangles, 2^18 grains. The reference is Embree alone on a ray for each chord of their paths. CPU
// seconds, so that other processes do not count.
void grain_rays(benchmark::State& state, size_t threads, double drag_time) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    testing::GrainScene scene;
    const unsigned id = scene.add(rough_rock(710));
    scene.commit();
    const WornMesh mesh = scene.worn(id);
    GrainSettings grains;
    grains.paths = 1 << 18, grains.drag_time = drag_time;
    std::vector<double> ratios, ours, bare;
    for (auto _ : state) {
        const double begin = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID);
        const testing::GrainResult alone = testing::traced(scene, mesh, grains);
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
        const double chords = double(testing::traced(scene, mesh, grains, hooks).report.rays);
        ours.push_back(1e9 * seconds / chords);
        bare.push_back(double(nanoseconds) / chords);
        ratios.push_back(bare.back() / ours.back());
        state.counters["chords"] = chords;
        state.counters["rays"] = double(alone.report.rays);
        state.SetIterationTime(seconds);
        ++grains.seed;
    }
    state.counters["rate_ratio"] = median(ratios);
    state.counters["goal"] = 0.5;
    state.counters["ns_a_chord"] = median(ours);
    state.counters["bare_ns_a_chord"] = median(bare);
}

// ---- Erosion ----------------------------------------------------------------------------------------------

// A sphere of 0.39 m in a box of 1 m.
void erosion_pass(benchmark::State& state, int size, uint64_t paths) {
    const double voxel = 1.0 / size;
    const LevelMesh sphere = testing::rock_sphere({0.0, 0.4, 0.0}, 200.0 / 512.0, 300);
    RTCDevice device = rtcNewDevice(nullptr);
    const RockScenery scenery{.device = device, .winds = {{testing::rock_grains(0.3, paths), 1.0}}};
    std::vector<double> voxelizing, passes, tracing, advancing, refining;
    for (auto _ : state) {
        const double start = wall_seconds();
        LevelSet rock = LevelSet::from_mesh(sphere.positions, sphere.triangles, voxel);
        voxelizing.push_back(wall_seconds() - start);
        std::vector<double> rate(rock.mesh().vertex_count());
        const double begin = wall_seconds();
        const GrainReport grains = wear_by_grains(scenery, rock.mesh(), 0, rate);
        const double traced = wall_seconds();
        blur_over_surface(rock.mesh(), 3, rate);
        std::vector<double> hardness(rate.size());
        HardnessSettings hard;
        hard.strata.thickness = 0.05;
        hard.noise = 2.0;
        rock_hardness(hard, rock.mesh().positions, voxel, hardness);
        const double most = *std::max_element(rate.begin(), rate.end());
        for (size_t v = 0; v < rate.size(); ++v) rate[v] *= voxel / std::max(most, 1e-30) / hardness[v];
        const double rated = wall_seconds();
        rock.advance(rate);
        const double end = wall_seconds();
        passes.push_back(end - begin), tracing.push_back(traced - begin), advancing.push_back(end - rated);
        rock.refined(0.0);
        refining.push_back(wall_seconds() - end);
        state.SetIterationTime(passes.back());
        state.counters["vertices"] = double(rate.size());
        state.counters["rays_a_path"] = double(grains.rays) / double(grains.grains);
        state.counters["hits_a_path"] = double(grains.worn_hits) / double(grains.grains);
        state.counters["landings_a_path"] = double(grains.sand_hits) / double(grains.grains);
    }
    rtcReleaseDevice(device);
    state.counters["s"] = median(passes);
    state.counters["goal"] = 10.0;
    state.counters["trace_s"] = median(tracing);
    state.counters["advance_s"] = median(advancing);
    state.counters["from_mesh_s"] = median(voxelizing); // not part of a pass
    state.counters["refine_s"] = median(refining);      // to half the voxel size; not part of a pass
}

#define SPEED(name, ...) BENCHMARK_CAPTURE(name, __VA_ARGS__)->UseManualTime()->Unit(benchmark::kMillisecond)
SPEED(dune_step, 256, DuneCase{.size = 256})->Iterations(64);
SPEED(dune_step, 512, DuneCase{.size = 512})->Iterations(16);
SPEED(dune_step, 1024, DuneCase{})->Iterations(8);
SPEED(dune_step, 2048, DuneCase{.size = 2048})->Iterations(8);
SPEED(dune_step, 4096, DuneCase{.size = 4096})->Iterations(8);
SPEED(dune_step, plants, DuneCase{.plants = true})->Iterations(8);
SPEED(dune_step, wakes, DuneCase{.plants = true, .wake = 2.1})->Iterations(8);
SPEED(dune_step, growing, DuneCase{.plants = true, .wake = 2.1, .growth = 1.0 / seconds_per_year})
    ->Iterations(8);
SPEED(dune_step, two_winds, DuneCase{.turn = 7.5})->Iterations(8);
SPEED(dune_step, four_winds, DuneCase{.turn = 22.5})->Iterations(8);
SPEED(grain_rays, one_thread, 1, 0.0)->Iterations(3);
SPEED(grain_rays, two_threads, 2, 0.0)->Iterations(3);
SPEED(grain_rays, one_thread_drag, 1, 0.2)->Iterations(3);
SPEED(grain_rays, two_threads_drag, 2, 0.2)->Iterations(3);
SPEED(erosion_pass, 512, 512, 10'000'000)->Iterations(5);

} // namespace
} // namespace marram::bench
