// SPDX-License-Identifier: Apache-2.0
// Measures ratios against their goals. Both sides of a ratio run in turns in one process; the median ratio
// counts.
//
//     build/marram_bench                                        all
//     build/marram_bench --benchmark_filter=literal             some
//     build/marram_bench --benchmark_out=bench.json             as JSON, too
#include "core/math/median.h"
#include "tests/bench/product.h"
#include "tests/bench/workload.h"

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <memory>

namespace marram::bench {
namespace {

// Runs both sides of a ratio in turns. Counters: the ratio, its goal (an upper bound; 0: none), and both
// times in milliseconds.
template <typename Ours, typename Reference>
void compare(benchmark::State& state, double goal, Ours&& ours, Reference&& reference) {
    std::vector<double> ratios, mine, theirs;
    ours();
    reference();
    for (auto _ : state) {
        const double a = ours(), b = reference();
        state.SetIterationTime(a);
        ratios.push_back(a / b);
        mine.push_back(a);
        theirs.push_back(b);
    }
    state.counters["ratio"] = median(ratios);
    if (goal > 0.0) state.counters["goal"] = goal;
    state.counters["ms"] = 1e3 * median(mine);
    state.counters["reference_ms"] = 1e3 * median(theirs);
}

Workload& workload(const Size& size) {
    static std::map<std::string, std::unique_ptr<Workload>> all;
    auto& one = all[size.name];
    if (!one) one = std::make_unique<Workload>(size);
    return *one;
}

void chain_to_literal(benchmark::State& state, const Size& size, double times_faster) {
    Workload& work = workload(size);
    compare(
        state, 1.0 / times_faster, [&] { return work.run_chain(); }, [&] { return work.run_literally(); });
}

void chain_to_floor(benchmark::State& state, const Size& size) {
    Workload& work = workload(size);
    compare(
        state, 1.0, [&] { return work.run_chain(); }, [&] { return work.run_floor(); });
}

void strands_to_bvh(benchmark::State& state, const Size& size, double goal) {
    Workload& work = workload(size);
    compare(
        state, goal, [&] { return work.run_from_roots(); }, [&] { return work.build_bvh(); });
}

void threads(benchmark::State& state, const Size& size) {
    Workload& work = workload(size);
    compare(
        state, 1.0 / 1.9, [&] { return work.run_chain(); },
        [&] {
            const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
            return work.run_chain();
        });
}

// The same strands on a finer skin.
void density(benchmark::State& state, const Size& fine, const Size& coarse) {
    Workload &a = workload(fine), &b = workload(coarse);
    compare(
        state, 2.0, [&] { return a.run_chain(); }, [&] { return b.run_chain(); });
}

// Frame after frame, from what the frame before has kept.
void sequence_to_literal(benchmark::State& state, const Size& size, double times_faster) {
    Workload& work = workload(size);
    for (int i = 0; i < 3; ++i) work.run_next_frame();
    compare(
        state, 1.0 / times_faster, [&] { return work.run_next_frame(); },
        [&] { return work.run_next_frame_literally(); });
}

// A wind that has keys against one that has none: a frame alone, or the next of a sequence.
void keyed_to_constant(benchmark::State& state, bool alone) {
    Workload &keyed = workload(Tk), &constant = workload(T);
    compare(
        state, 1.02, [&] { return alone ? keyed.run_chain() : keyed.run_next_frame(); },
        [&] { return alone ? constant.run_chain() : constant.run_next_frame(); });
}

// Blades at this Ca against the talk's bend, both with the same noise.
void blade_to_bend(benchmark::State& state, double ca) {
    Workload& work = workload(T0);
    compare(
        state, 1.5, [&] { return work.run_blades(ca); }, [&] { return work.run_bend(); });
}

// Nanoseconds a root, on one thread.
void local(benchmark::State& state, const Size& size, double (Workload::*seconds_of_all)()) {
    Workload& work = workload(size);
    std::vector<double> seconds;
    for (auto _ : state) {
        seconds.push_back((work.*seconds_of_all)());
        state.SetIterationTime(std::max(seconds.back(), 1e-9));
    }
    state.counters["ns_a_root"] = 1e9 * median(seconds) / double(work.strands());
    state.counters["goal"] = 40.0;
}

// Jiggle against the sum of the other stages: a frame alone, and in a sequence of 64 frames (four periods).
void jiggle_to_others(benchmark::State& state, const Size& size) {
    Workload& work = workload(size);
    const auto ratio = [&](auto&& run, int frames) {
        const StageClock before = work.clock();
        for (int i = 0; i < frames; ++i) run();
        const StageClock after = work.clock();
        const double others = after.gusts - before.gusts + after.shield - before.shield + after.bend -
                              before.bend + after.collide - before.collide;
        return (after.jiggle - before.jiggle) / others;
    };
    std::vector<double> alone, sequence, seconds;
    for (int i = 0; i < 3; ++i) work.run_next_frame();
    for (auto _ : state) {
        alone.push_back(ratio([&] { work.run_chain(); }, 3));
        sequence.push_back(ratio([&] { seconds.push_back(work.run_next_frame()); }, 64));
        state.SetIterationTime(seconds.back());
    }
    double sum = 0.0;
    for (const double one : seconds) sum += one;
    state.counters["alone"] = median(alone);
    state.counters["alone_goal"] = 3.0;
    state.counters["sequence"] = median(sequence);
    state.counters["sequence_goal"] = 1.0;
    state.counters["frames_a_second"] = double(seconds.size()) / sum;
}

// Scaling of time and memory from 10^4 to `most` strands, as the exponent of a power law: the talk's scene
// through the plug-in, with a strand width that keeps the coverage constant.
void growth(benchmark::State& state, uint64_t most) {
    struct Row {
        double strands, seconds, bytes;
    };
    std::vector<Row> rows;
    for (auto _ : state) {
        rows.clear();
        for (uint64_t n = 10000; n <= most; n *= 10) {
            Product product({n, 5, 0.009 / std::sqrt(double(n) / 1e4)});
            std::vector<double> seconds;
            Product::Frame frame;
            const int rounds = n <= 100000 ? 9 : n <= 1000000 ? 5 : 2; // the first is a warm-up
            for (int i = 0; i < rounds; ++i) {
                frame = product.run(false);
                if (i > 0) seconds.push_back(frame.strands);
            }
            rows.push_back({double(n), median(seconds), double(frame.curve_bytes + frame.extra_bytes)});
            state.counters["us_a_strand_1e" + std::to_string(int(std::lround(std::log10(n))))] =
                1e6 * rows.back().seconds / double(n);
        }
        state.SetIterationTime(rows.back().seconds);
    }
    const double span = std::log(rows.back().strands / rows.front().strands);
    state.counters["time_exponent"] = std::log(rows.back().seconds / rows.front().seconds) / span;
    state.counters["time_goal"] = 1.03;
    state.counters["memory_exponent"] = std::log(rows.back().bytes / rows.front().bytes) / span;
    state.counters["memory_goal"] = 1.0;
    state.counters["bytes_a_strand"] = rows.back().bytes / rows.back().strands;
}

// Time from the scene file until the first ray can be traced, relative to the same with the curves read from
// a file of `marram bake` in the page cache. Further counters: time and disk space to bake 24 frames.
void live_to_baked(benchmark::State& state, const Coat& coat) {
    Product product(coat);
    const std::string path =
        std::filesystem::temp_directory_path() / ("marram_bench_" + std::to_string(coat.strands) + ".hair");
    const double baking = product.bake(path, 1.0);
    std::vector<double> ratios, live, baked, strands, read;
    product.run(true);
    for (auto _ : state) {
        const Product::Frame frame = product.run(true);
        const Product::Baked from_disk = product.load_baked(path);
        const double same = frame.load + frame.colliders;
        live.push_back(frame.sum());
        baked.push_back(same + from_disk.read + from_disk.bvh);
        ratios.push_back(live.back() / baked.back());
        strands.push_back(frame.strands);
        read.push_back(from_disk.read);
        state.SetIterationTime(live.back());
    }
    state.counters["ratio"] = median(ratios);
    state.counters["goal"] = 1.4;
    state.counters["ms"] = 1e3 * median(live);
    state.counters["reference_ms"] = 1e3 * median(baked);
    state.counters["strands_ms"] = 1e3 * median(strands);
    state.counters["read_ms"] = 1e3 * median(read);
    state.counters["baking_s_24_frames"] = 24.0 * baking;
    state.counters["disk_MB_24_frames"] = 24.0 * double(std::filesystem::file_size(path)) / 1e6;
    std::filesystem::remove(path);
}

// Camera rays per second: the path tracer relative to Embree alone on the same pixels. Also times the rays of
// whole paths.
void primary_rays(benchmark::State& state, const Coat& coat) {
    Product product(coat);
    product.run(true);
    std::vector<double> ratios, ours, bare;
    product.primary_by_embree();
    product.primary_by_integrator();
    for (auto _ : state) {
        ours.push_back(product.primary_by_integrator());
        bare.push_back(product.primary_by_embree());
        ratios.push_back(bare.back() / ours.back());
        state.SetIterationTime(ours.back());
    }
    uint64_t rays = 0;
    const double whole = product.whole_paths(rays);
    const double pixels = 512.0 * 512.0;
    state.counters["rate_ratio"] = median(ratios);
    state.counters["goal"] = 0.8;
    state.counters["ns_a_ray"] = 1e9 * median(ours) / pixels;
    state.counters["bare_ns_a_ray"] = 1e9 * median(bare) / pixels;
    state.counters["whole_paths_ns_a_ray"] = 1e9 * whole / double(rays);
    state.counters["rays_a_path"] = double(rays) / pixels;
}

// Share of each stage in the chain's time, and the cost of the tree that is built at the start of a frame.
void stages(benchmark::State& state, const Size& size) {
    Workload& work = workload(size);
    const StageClock before = work.clock();
    for (auto _ : state) state.SetIterationTime(work.run_chain());
    const StageClock after = work.clock();
    const double gusts = after.gusts - before.gusts, shield = after.shield - before.shield,
                 bend = after.bend - before.bend, collide = after.collide - before.collide;
    const double sum = gusts + shield + bend + collide;
    state.counters["gusts"] = gusts / sum;
    state.counters["shield"] = shield / sum;
    state.counters["bend"] = bend / sum;
    state.counters["collide"] = collide / sum;
    std::vector<double> trees;
    for (int i = 0; i < 5; ++i) trees.push_back(work.make_tree());
    state.counters["tree_ms"] = 1e3 * median(trees);
}

#define RATIO(...) BENCHMARK_CAPTURE(__VA_ARGS__)->UseManualTime()->Unit(benchmark::kMillisecond)
RATIO(chain_to_literal, T, T, 5.0);
RATIO(sequence_to_literal, T, T, 5.0);
RATIO(jiggle_to_others, T, T)->Iterations(3);
RATIO(jiggle_to_others, 100k, T100k)->Iterations(1);
RATIO(keyed_to_constant, alone, true)->Iterations(15);
RATIO(keyed_to_constant, sequence, false)->Iterations(64);
RATIO(blade_to_bend, Ca_tenth, 0.1)->Iterations(25);
RATIO(blade_to_bend, Ca_1, 1.0)->Iterations(25);
RATIO(blade_to_bend, Ca_10, 10.0)->Iterations(25);
RATIO(blade_to_bend, Ca_100, 100.0)->Iterations(25);
#define LOCAL(name, run) BENCHMARK_CAPTURE(local, name, T0, &Workload::run)->UseManualTime()->Iterations(50)
LOCAL(field, run_field);
LOCAL(field_grid, run_field_grid);
LOCAL(field_between_frames, run_field_between_frames);
LOCAL(field_staggered, run_field_staggered);
LOCAL(field_staggered_between_frames, run_field_staggered_between);
LOCAL(field_image, run_field_image);
LOCAL(field_curves, run_field_curves);
LOCAL(ground, run_ground);
RATIO(chain_to_literal, T0, T0, 5.0);
RATIO(chain_to_literal, T2, T2, 4.0);
RATIO(chain_to_literal, D, D, 5.0);
RATIO(chain_to_floor, T0, T0);
RATIO(chain_to_floor, T2, T2);
RATIO(strands_to_bvh, T0, T0, 0.0);
RATIO(strands_to_bvh, F, F, 0.35)->Iterations(3);
RATIO(live_to_baked, T, Coat{10000, 5, 0.009});
RATIO(live_to_baked, F, Coat{1000000, 8, 0.0009})->Iterations(3);
RATIO(threads, T, T);
RATIO(threads, T0, T0);
RATIO(density, T2_to_T0, T2, T0);
RATIO(density, 4M_to_10k, T4M, T10k);
RATIO(growth, to_1e7, 10000000)->Iterations(1);
RATIO(primary_rays, T, Coat{10000, 5, 0.009});
RATIO(stages, T0, T0);
RATIO(stages, T2, T2);
RATIO(stages, D, D);

} // namespace
} // namespace marram::bench

BENCHMARK_MAIN();
