// SPDX-License-Identifier: Apache-2.0
// The host's own task executor (MarramHost.parallel_for): the same bits as with TBB, and faults and
// cancellation within tasks are reported as elsewhere.
#include "tested_procedural.h"

#include <atomic>
#include <set>
#include <thread>

namespace marram::testing {
namespace {

// Starts four threads for each loop. Threads take the tasks from the last to the first.
struct ThreadsOfTheHost {
    std::atomic<uint64_t> loops{0}, tasks{0};

    static void parallel_for(void* user, uint64_t count, void (*task)(void* data, uint64_t index),
                             void* data) {
        ThreadsOfTheHost& self = *static_cast<ThreadsOfTheHost*>(user);
        ++self.loops;
        self.tasks += count;
        std::atomic<uint64_t> left{count};
        std::vector<std::jthread> threads;
        for (int t = 0; t < 4; ++t)
            threads.emplace_back([&] {
                for (uint64_t k = left.load(); k > 0;)
                    if (left.compare_exchange_weak(k, k - 1)) task(data, k - 1);
            });
    }
};

// Callbacks of one host share `user`: messages and threads are together here.
struct ExecutorUser {
    Messages messages;
    ThreadsOfTheHost threads;
    std::atomic<int> calls_until_cancelled{-1}; // -1: never
};

MarramHost host_of(ExecutorUser& user) {
    MarramHost host{};
    host.size = sizeof host;
    host.user = &user;
    host.message = [](void* to, const MarramMessage* message) {
        Messages::take(&static_cast<ExecutorUser*>(to)->messages, message);
    };
    host.cancelled = [](void* of) -> int {
        std::atomic<int>& left = static_cast<ExecutorUser*>(of)->calls_until_cancelled;
        for (int n = left.load(); n > 0;) // stays 0
            if (left.compare_exchange_weak(n, n - 1)) break;
        return left.load() == 0;
    };
    host.parallel_for = [](void* of, uint64_t count, void (*task)(void*, uint64_t), void* data) {
        ThreadsOfTheHost::parallel_for(&static_cast<ExecutorUser*>(of)->threads, count, task, data);
    };
    return host;
}

// Settings that start many parallel loops.
Settings large_settings_of(const std::string& type) {
    Settings settings = settings_of(type);
    for (auto& [name, text] : settings) {
        if (std::string(name) == "count") text = "20000";
        if (std::string(name) == "paths") text = "100000";
    }
    if (type == "terrain")
        return {{"size", "[40, 40]"},        {"cell", "0.1"},
                {"layer[0].type", "noise"},  {"layer[1].type", "mass_desert"},
                {"layer[2].type", "dune"},   {"layer[2].along", "line"},
                {"layer[3].type", "stones"}, {"layer[4].type", "fusion"},
                {"layer[5].type", "ruin"},   {"layer[5].mesh", "boulder"},
                {"layer[6].type", "mask"},   {"layer[6].name", "high"},
                {"layer[6].by", "height"},   {"layer[7].type", "ripples"}};
    return settings;
}

class ExecutorOfTheHost : public ::testing::Test {
  protected:
    std::shared_ptr<PluginLibrary> library = std::make_shared<PluginLibrary>(default_library, Place{});
    LentWorld world;
};

TEST_F(ExecutorOfTheHost, GivesTheSameBitsAsTbb) {
    for (const ProceduralType& type : library->types()) {
        const std::string name = type.calls.name;
        const Settings settings = large_settings_of(name);
        TestedProcedural plain(type, world, settings);
        plain.create();
        const std::string expected = plain.evaluate();

        ExecutorUser user;
        TestedProcedural called(type, world, settings);
        called.host = host_of(user);
        called.create();
        EXPECT_TRUE(called.evaluate() == expected) << name;
        if (type.calls.begin_view) {
            EXPECT_TRUE(called.view_mesh() == plain.view_mesh()) << name;
        }
        std::printf("%s: %llu loops, %llu tasks\n", name.c_str(),
                    static_cast<unsigned long long>(user.threads.loops.load()),
                    static_cast<unsigned long long>(user.threads.tasks.load()));
        if (name != "strands") { // one curve: nothing to share out
            EXPECT_GT(user.threads.tasks.load(), 8U) << name;
        }
    }
}

TEST_F(ExecutorOfTheHost, IsCancelledWithinTasks) {
    for (const ProceduralType& type : library->types()) {
        ExecutorUser user;
        TestedProcedural called(type, world, large_settings_of(type.calls.name));
        called.host = host_of(user);
        called.create();
        const MarramFrame frame = world.frame();
        std::set<MarramStatus> seen;
        for (int after = 1; after <= 64; after *= 2) {
            user.calls_until_cancelled = after;
            seen.insert(called.begin(frame));
        }
        EXPECT_FALSE(seen.contains(MARRAM_ERROR)) << type.calls.name << ": " << user.messages.last;
        EXPECT_TRUE(seen.contains(MARRAM_CANCELLED)) << type.calls.name;
        user.calls_until_cancelled = -1;
        EXPECT_FALSE(called.evaluate().empty());
    }
}

// An executor that leaves out the last task, calls the first twice and one that does not exist.
TEST_F(ExecutorOfTheHost, IsToldOfTasksThatItLeavesOut) {
    for (const ProceduralType& type : library->types()) {
        ExecutorUser user;
        TestedProcedural called(type, world, large_settings_of(type.calls.name));
        called.host = host_of(user);
        called.host.parallel_for = [](void*, uint64_t count, void (*task)(void*, uint64_t), void* data) {
            for (uint64_t i = 0; i + 1 < count; ++i) task(data, i);
            task(data, count);
            if (count > 1) task(data, 0);
        };
        MarramStatus status = type.calls.create(&called.host, called.good, &called.instance);
        if (status == MARRAM_OK) status = called.begin(world.frame());
        EXPECT_EQ(status, MARRAM_ERROR) << type.calls.name;
        ASSERT_FALSE(user.messages.faults.empty()) << type.calls.name;
        EXPECT_EQ(user.messages.faults.back(), "contract.parallel_for");
    }
}

} // namespace
} // namespace marram::testing
