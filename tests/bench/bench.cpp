// SPDX-License-Identifier: Apache-2.0
// Each ratio beside its goal: the two sides take turns in one run, and the median of their ratios counts.
//
//     build/marram_bench                                        all
//     build/marram_bench --benchmark_filter=literal             some
//     build/marram_bench --benchmark_out=bench.json             as JSON, too
#include "tests/bench/workload.h"

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>
#include <memory>

namespace marram::bench {
namespace {

double median(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + long(values.size() / 2), values.end());
    return values[values.size() / 2];
}

// The sides of a ratio in turns. Counters: the ratio, what it should be at most (0: nothing is asked), and both times in
// milliseconds.
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

void density(benchmark::State& state) {
    Workload &coarse = workload(T), &fine = workload(T2);
    compare(
        state, 2.0, [&] { return fine.run_chain(); }, [&] { return coarse.run_chain(); });
}

// Where the chain's time goes, as shares of it, and what the tree costs that is made at the start of a frame.
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
RATIO(chain_to_literal, T2, T2, 4.0);
RATIO(chain_to_floor, T, T);
RATIO(chain_to_floor, T2, T2);
RATIO(strands_to_bvh, T, T, 0.0);
RATIO(strands_to_bvh, F, F, 0.35)->Iterations(3);
RATIO(threads, T, T);
RATIO(stages, T, T);
RATIO(stages, T2, T2);
BENCHMARK(density)->Name("chain_on_T2_to_T")->UseManualTime()->Unit(benchmark::kMillisecond);

} // namespace
} // namespace marram::bench

BENCHMARK_MAIN();
