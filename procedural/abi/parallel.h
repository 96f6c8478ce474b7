// SPDX-License-Identifier: Apache-2.0
// Parallel loops: on the host's task executor (MarramHost.parallel_for) if it has one, else on TBB. All loops
// of the library use these functions, and give the same result with any executor and number of threads.
//
// Exceptions: the first that a body throws is rethrown when all tasks have returned; tasks that start after
// it do nothing. Loops may be nested. Only OpenVDB's own loops (rock with erosion) always run on TBB, and
// builds of Embree's scenes on the threads of their RTCDevice.
#pragma once

#include "procedural/abi/values.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <concepts>
#include <exception>
#include <mutex>
#include <vector>

namespace marram {

// The host whose executor runs the loops that this thread starts; NULL: TBB.
inline thread_local constinit const MarramHost* executing_host = nullptr;

// Lets the loops of a scope run on the executor of a host, which outlives it.
class ExecutorScope {
  public:
    explicit ExecutorScope(const MarramHost* host) : before_(executing_host) {
        executing_host = host && host->parallel_for ? host : nullptr;
    }
    ~ExecutorScope() { executing_host = before_; }
    ExecutorScope(const ExecutorScope&) = delete;
    ExecutorScope& operator=(const ExecutorScope&) = delete;

  private:
    const MarramHost* before_;
};

// A loop is split into at most this many tasks: enough to balance the load, and few against their overhead.
inline constexpr uint64_t max_tasks = 256;

// Runs body(i) for i below count, at most max_tasks, as tasks of the host's executor. Throws SceneFault if
// the host leaves some out.
template <typename Body>
void run_tasks(const MarramHost& host, uint64_t count, const Body& body) {
    struct Loop {
        const MarramHost& host;
        const Body& body;
        uint64_t count;
        std::array<std::atomic<bool>, max_tasks> started{};
        std::atomic<uint64_t> returned{0};
        std::atomic<bool> failed{false};
        std::mutex mutex;
        std::exception_ptr error{};
    } loop{host, body, count};
    const auto task = [](void* data, uint64_t index) {
        Loop& shared = *static_cast<Loop*>(data);
        if (index >= shared.count || shared.started[index].exchange(true)) return; // a mistake of the host
        const ExecutorScope scope(&shared.host);
        try {
            if (!shared.failed.load(std::memory_order_relaxed)) shared.body(index);
        } catch (...) {
            const std::scoped_lock lock(shared.mutex);
            if (!shared.failed.exchange(true)) shared.error = std::current_exception();
        }
        shared.returned.fetch_add(1, std::memory_order_release);
    };
    host.parallel_for(host.user, count, task, &loop);
    if (loop.error) std::rethrow_exception(loop.error);
    if (loop.returned.load(std::memory_order_acquire) != count)
        throw SceneFault("contract.parallel_for", "",
                         "MarramHost.parallel_for has not called the task for each index",
                         "call it for 0 to count - 1, and return when all calls have returned");
}

// Part k of `parts` equal parts of a range.
template <typename T>
tbb::blocked_range<T> part_of(const tbb::blocked_range<T>& range, uint64_t k, uint64_t parts) {
    const uint64_t size = uint64_t(range.size());
    const auto at = [&](uint64_t i) {
        return T(range.begin() + T(size / parts * i + size % parts * i / parts));
    };
    return {at(k), at(k + 1), range.grainsize()};
}

template <typename T>
uint64_t parts_of(const tbb::blocked_range<T>& range) {
    const uint64_t size = uint64_t(range.size()), grain = std::max<uint64_t>(range.grainsize(), 1);
    return size == 0 ? 0 : std::min((size - 1) / grain + 1, max_tasks);
}

template <typename T, typename Body>
void parallel_for(const tbb::blocked_range<T>& range, const Body& body) {
    const MarramHost* const host = executing_host;
    if (!host) return tbb::parallel_for(range, body);
    if (range.empty()) return;
    const uint64_t parts = parts_of(range);
    run_tasks(*host, parts, [&](uint64_t k) { body(part_of(range, k, parts)); });
}

template <std::integral T, typename Body>
void parallel_for(T first, T last, const Body& body) {
    if (!executing_host) return tbb::parallel_for(first, last, body);
    if (first < last)
        marram::parallel_for(tbb::blocked_range<T>(first, last), [&](const tbb::blocked_range<T>& part) {
            for (T i = part.begin(); i != part.end(); ++i) body(i);
        });
}

// join(a, b) must be associative and commutative to the bit (a maximum, a box, a sum of integers).
template <typename T, typename Value, typename Body, typename Join>
Value parallel_reduce(const tbb::blocked_range<T>& range, const Value& identity, const Body& body,
                      const Join& join) {
    const MarramHost* const host = executing_host;
    if (!host) return tbb::parallel_reduce(range, identity, body, join);
    if (range.empty()) return identity;
    const uint64_t parts = parts_of(range);
    struct Part { // not Value alone: std::vector<bool> packs bits, which threads cannot write side by side
        Value value;
    };
    std::vector<Part> values(parts, Part{identity});
    run_tasks(*host, parts, [&](uint64_t k) { values[k].value = body(part_of(range, k, parts), identity); });
    Value all = identity;
    for (const Part& part : values) all = join(all, part.value);
    return all;
}

// Elements that compare equal must be equal. One thread if the host has an executor.
template <typename Iterator, typename... Less>
void parallel_sort(Iterator begin, Iterator end, const Less&... less) {
    if (executing_host) return std::sort(begin, end, less...);
    tbb::parallel_sort(begin, end, less...);
}

} // namespace marram
