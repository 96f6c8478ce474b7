// SPDX-License-Identifier: Apache-2.0
// procedural/abi/parallel.h with an executor of the host.
#include "procedural/abi/parallel.h"

#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <thread>

namespace marram {
namespace {

MarramHost threaded_host() {
    MarramHost host{};
    host.size = sizeof host;
    host.parallel_for = [](void*, uint64_t count, void (*task)(void*, uint64_t), void* data) {
        std::atomic<uint64_t> next{0};
        std::vector<std::jthread> threads;
        for (int t = 0; t < 3; ++t)
            threads.emplace_back([&] {
                for (uint64_t k = next++; k < count; k = next++) task(data, k);
            });
    };
    return host;
}

TEST(Parallel, PartsCoverARangeOnce) {
    for (const uint64_t size : {0UL, 1UL, 2UL, 255UL, 256UL, 257UL, 1000003UL, ~0UL / 2})
        for (const uint64_t grain : {1UL, 64UL, ~0UL}) {
            const tbb::blocked_range<uint64_t> range(7, 7 + size, grain);
            const uint64_t parts = parts_of(range);
            EXPECT_LE(parts, max_tasks);
            EXPECT_EQ(parts == 0, size == 0);
            uint64_t at = 7;
            for (uint64_t k = 0; k < parts; ++k) {
                EXPECT_EQ(part_of(range, k, parts).begin(), at);
                at = part_of(range, k, parts).end();
                EXPECT_GT(at, part_of(range, k, parts).begin());
            }
            EXPECT_EQ(at, 7 + size);
        }
}

TEST(Parallel, ReducesBools) {
    const MarramHost host = threaded_host();
    const ExecutorScope scope(&host);
    for (size_t round = 0; round < 2000; ++round) {
        const tbb::blocked_range<size_t> range(0, 16);
        EXPECT_TRUE(marram::parallel_reduce(
            range, false,
            [&](const auto& part, bool any) {
                return any || (part.begin() <= round % 16 && round % 16 < part.end());
            },
            std::logical_or<>()));
    }
}

TEST(Parallel, NestsAndRethrows) {
    const MarramHost host = threaded_host();
    const ExecutorScope scope(&host);
    std::atomic<int> sum{0};
    marram::parallel_for(0, 10, [&](int i) { marram::parallel_for(0, i, [&](int) { ++sum; }); });
    EXPECT_EQ(sum, 45);
    EXPECT_THROW(marram::parallel_for(0, 100,
                                      [](int i) {
                                          if (i == 50) throw std::runtime_error("stop");
                                      }),
                 std::runtime_error);
    EXPECT_EQ(executing_host, &host);
}

} // namespace
} // namespace marram
