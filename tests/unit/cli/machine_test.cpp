// SPDX-License-Identifier: Apache-2.0
// Limits of control groups, in folders that look like those of the kernel, and what follows from them for the
// number of threads and the memory.
#include "core/cli/machine.h"
#include "core/math/resident_memory.h"
#include "program.h"

#include <nlohmann/json.hpp>

#include <cstdlib>

namespace marram::testing {
namespace {

// A folder that holds /proc/self and /sys/fs/cgroup.
class Machine : public ::testing::Test {
  protected:
    void SetUp() override {
        fs::create_directories(folder / "proc/self");
        forget_slurm();
    }
    void TearDown() override { forget_slurm(); }
    static void forget_slurm() {
        ::unsetenv("SLURM_CPUS_PER_TASK");
        ::unsetenv("SLURM_MEM_PER_NODE");
    }
    void version_2(const std::string& group, const std::string& mount = "/sys/fs/cgroup",
                   const std::string& top = "/") {
        folder.write("proc/self/cgroup", "0::" + group + "\n");
        folder.write("proc/self/mountinfo", "22 28 0:20 / /proc rw shared:5 - proc proc rw\n30 23 0:26 " +
                                                top + " " + mount +
                                                " rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n");
    }
    void put(const std::string& path, const std::string& text) {
        fs::create_directories(fs::path(folder / path).parent_path());
        folder.write(path, text);
    }
    std::string root() const { return folder / "."; }
    // A control group of version 2, with files in its cache.
    void put_memory(const std::string& group, const std::string& limit, const std::string& usage,
                    const std::string& inactive, const std::string& active) {
        const std::string path = "sys/fs/cgroup/" + group;
        put(path + "/memory.max", limit + "\n");
        put(path + "/memory.current", usage + "\n");
        put(path + "/memory.stat", "anon 5000\ninactive_anon 70\nactive_anon 80\ninactive_file " + inactive +
                                       "\nactive_file " + active + "\nworkingset_refault_file 90\n");
    }
    Folder folder;
};

constexpr uint64_t unlimited = uint64_t(1) << 62;

TEST_F(Machine, WithoutLimitsHasItsProcessors) {
    EXPECT_EQ(processor_quota(root()), std::nullopt);
    EXPECT_EQ(memory_left(root()), unlimited);
    EXPECT_EQ(threads_allowed(7, root()), 7);
    version_2("/");
    put("sys/fs/cgroup/cpu.max", "max 100000\n");
    put("sys/fs/cgroup/memory.max", "max\n");
    EXPECT_EQ(processor_quota(root()), std::nullopt);
    EXPECT_EQ(memory_left(root()), unlimited);
    EXPECT_EQ(threads_allowed(7, root()), 7);
}

TEST_F(Machine, HasTheSmallestLimitOfItsGroupsUpwards) {
    version_2("/slurm/job_7/step_0");
    put("sys/fs/cgroup/slurm/job_7/step_0/cpu.max", "max 100000\n");
    put("sys/fs/cgroup/slurm/job_7/cpu.max", "250000 100000\n");
    put("sys/fs/cgroup/slurm/cpu.max", "400000 100000\n");
    put("sys/fs/cgroup/slurm/job_8/cpu.max", "100000 100000\n"); // not above
    EXPECT_EQ(processor_quota(root()), 2.5);
    EXPECT_EQ(threads_allowed(16, root()), 3) << "rounded up";
    EXPECT_EQ(threads_allowed(2, root()), 2) << "no more than processors";
}

TEST_F(Machine, HasTheMemoryThatItsGroupsUpwardsLeave) {
    version_2("/slurm/job_7/step_0");
    put_memory("slurm/job_7/step_0", "8000000000", "1000000000", "0", "0");
    put_memory("slurm/job_7", "4000000000", "1500000000", "0", "0");
    put_memory("slurm", "max", "9000000000", "0", "0");
    put_memory("slurm/job_8", "1000", "0", "0", "0"); // not above
    EXPECT_EQ(memory_left(root()), 2'500'000'000u);
    put_memory("slurm/job_7", "4000000000", "1500000000", "200000000", "30000000");
    EXPECT_EQ(memory_left(root()), 2'730'000'000u) << "cached files make room";
    put_memory("slurm", "9100000000", "9000000000", "0", "500");
    EXPECT_EQ(memory_left(root()), 100'000'500u) << "others in the group above count";
}

TEST_F(Machine, HasNoMemoryInAGroupBeyondItsLimit) {
    version_2("/job");
    put_memory("job", "1000000", "1500000", "0", "0");
    EXPECT_EQ(memory_left(root()), 0u);
    put_memory("job", "1000000", "1500000", "600000", "100000");
    EXPECT_EQ(memory_left(root()), 200'000u);
    put_memory("job", "1000000", "0", "600000", "100000");
    EXPECT_EQ(memory_left(root()), 1'000'000u) << "no more than the limit";
}

TEST_F(Machine, HasTheMemoryThatIsAvailable) {
    folder.write("proc/meminfo", "MemTotal:        8000000 kB\nMemFree:          100000 kB\n"
                                 "MemAvailable:    3000000 kB\nBuffers:           20000 kB\n");
    EXPECT_EQ(memory_left(root()), 3'072'000'000u);
    version_2("/job");
    put_memory("job", "4000000000", "1000000000", "0", "0");
    EXPECT_EQ(memory_left(root()), 3'000'000'000u);
    put_memory("job", "max", "1000000000", "0", "0");
    EXPECT_EQ(memory_left(root()), 3'072'000'000u);
    folder.write("proc/meminfo", "MemAvailable: 0 kB\n");
    EXPECT_EQ(memory_left(root()), 0u);
}

TEST_F(Machine, IgnoresFilesOfMemoryThatItCannotRead) {
    for (const char* text : {"", "MemAvailable:\n", "MemAvailable: much kB\n", "MemAvailable 5 kB\n",
                             "MemAvailable: nan kB\n", "MemAvailable: inf kB\n"}) {
        folder.write("proc/meminfo", text);
        EXPECT_EQ(memory_left(root()), unlimited) << text;
    }
    version_2("/job");
    for (const char* limit : {"", "max", "0", "-1", "much", "nan", "inf", "1e300"}) {
        put_memory("job", limit, "1000", "1", "2");
        EXPECT_EQ(memory_left(root()), unlimited) << limit;
    }
    put_memory("job", "5000", "much", "few", "");
    EXPECT_EQ(memory_left(root()), 5000u);
    put_memory("job", "5000", "3000", "1", "2");
    fs::remove(folder / "sys/fs/cgroup/job/memory.stat");
    EXPECT_EQ(memory_left(root()), 2000u);
    fs::remove(folder / "sys/fs/cgroup/job/memory.current");
    EXPECT_EQ(memory_left(root()), 5000u);
}

TEST_F(Machine, MayBeAContainer) {
    version_2("/"); // a name space of its own
    put("sys/fs/cgroup/cpu.max", "10000 100000\n");
    EXPECT_EQ(threads_allowed(16, root()), 1) << "at least one";
    version_2("/docker/abc/part", "/groups", "/docker/abc"); // mounted from there on
    put("groups/part/cpu.max", "200000 100000\n");
    EXPECT_EQ(threads_allowed(16, root()), 2);
    version_2("/../other", "/groups", "/docker/abc"); // not below what is mounted
    put("groups/cpu.max", "500000 100000\n");
    EXPECT_EQ(threads_allowed(16, root()), 5);
}

TEST_F(Machine, MayHaveTheFirstVersion) {
    folder.write("proc/self/cgroup", "9:name=systemd:/\n4:memory:/batch/7\n1:cpu,cpuacct:/batch/7\n0::/\n");
    folder.write("proc/self/mountinfo",
                 "32 30 0:31 / /sys/fs/cgroup/cpu,cpuacct rw - cgroup cgroup rw,cpu,cpuacct\n"
                 "33 30 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n"
                 "34 30 0:33 / /sys/fs/cgroup/cpuset rw - cgroup cgroup rw,cpuset\n");
    put("sys/fs/cgroup/cpu,cpuacct/batch/7/cpu.cfs_quota_us", "300000\n");
    put("sys/fs/cgroup/cpu,cpuacct/batch/7/cpu.cfs_period_us", "100000\n");
    put("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
    put("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
    put("sys/fs/cgroup/memory/batch/7/memory.limit_in_bytes", "9223372036854771712\n");
    put("sys/fs/cgroup/memory/batch/7/memory.usage_in_bytes", "1000\n");
    EXPECT_EQ(threads_allowed(16, root()), 3);
    EXPECT_EQ(memory_left(root()), unlimited);
    put("sys/fs/cgroup/memory/batch/memory.limit_in_bytes", "2147483648\n");
    put("sys/fs/cgroup/memory/batch/memory.usage_in_bytes", "1147483648\n");
    EXPECT_EQ(memory_left(root()), 1'000'000'000u);
    put("sys/fs/cgroup/memory/batch/memory.stat",
        "inactive_file 7\nactive_file 9\ntotal_inactive_file 3000\ntotal_active_file 200\n");
    EXPECT_EQ(memory_left(root()), 1'000'003'200u) << "of all below";
}

TEST_F(Machine, IgnoresWhatItCannotRead) {
    for (const char* text : {"", "cpu", "100000", "-5 100000", "0 0", "nan nan", "1 2 3", "inf 100000"}) {
        version_2("/");
        put("sys/fs/cgroup/cpu.max", text);
        EXPECT_EQ(threads_allowed(5, root()), 5) << text;
    }
    folder.write("proc/self/cgroup", "no colons\n::\n0::relative\n");
    folder.write("proc/self/mountinfo", "short\n - \n1 2 3 - cgroup2\n");
    EXPECT_EQ(threads_allowed(5, root()), 5);
}

TEST_F(Machine, IsSharedByTasksOfSlurm) {
    ::setenv("SLURM_CPUS_PER_TASK", "3", 1);
    EXPECT_EQ(threads_allowed(8, root()), 3);
    EXPECT_EQ(threads_allowed(2, root()), 2);
    for (const char* text : {"", "0", "-1", "many"}) {
        ::setenv("SLURM_CPUS_PER_TASK", text, 1);
        EXPECT_EQ(threads_allowed(8, root()), 8) << text;
    }
}

TEST_F(Machine, HasTheMemoryThatSlurmGivesItsTask) {
    ::setenv("SLURM_MEM_PER_NODE", "100000", 1); // MB
    const double given = 100000.0 * 0x1p20, has = double(resident_bytes());
    EXPECT_NEAR(double(memory_left(root())), given - has, 0.1 * has);
    folder.write("proc/meminfo", "MemAvailable: 3000000 kB\n");
    EXPECT_EQ(memory_left(root()), 3'072'000'000u);
    ::setenv("SLURM_MEM_PER_NODE", "1", 1);
    EXPECT_EQ(memory_left(root()), 0u) << "it has more";
    for (const char* text : {"", "0", "-1", "all"}) {
        ::setenv("SLURM_MEM_PER_NODE", text, 1);
        EXPECT_EQ(memory_left(root()), 3'072'000'000u) << text;
    }
}

TEST_F(Machine, TellsTheProgramItsMemory) {
    const std::string scene = folder.write("a.toml", SceneText{.film = "size = [4, 4]\nsamples = 1\n"});
    const auto budget_of = [&](const std::string& command, const std::vector<std::string>& more) {
        std::vector<std::string> arguments = {command,   scene,
                                              "-o",      folder / (command == "bake" ? "a.hair" : "a.exr"),
                                              "--stats", folder / "s.json"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        const ProgramResult done = marram(arguments);
        EXPECT_EQ(done.code, 0) << done.err;
        return nlohmann::json::parse(read_file(folder / "s.json"))["memory"]["budget_bytes"].get<uint64_t>();
    };
    ::setenv("SLURM_MEM_PER_NODE", "500", 1);
    for (const char* command : {"render", "bake"}) {
        EXPECT_GT(budget_of(command, {}), 0u);
        EXPECT_LE(budget_of(command, {}), uint64_t(501) << 20);
        EXPECT_EQ(budget_of(command, {"--memory", "3G"}), uint64_t(3) << 30) << "what was set by hand counts";
    }
    EXPECT_EQ(budget_of("bake", {"--memory=1.5g"}), uint64_t(3) << 29);
    EXPECT_EQ(budget_of("bake", {"--memory", "700MB"}), uint64_t(700) << 20);
    EXPECT_EQ(budget_of("bake", {"--memory", "2TiB"}), uint64_t(2) << 40);
    EXPECT_EQ(budget_of("bake", {"--memory", "2000000000"}), 2'000'000'000u);
}

// What was set by hand counts.
TEST_F(Machine, TellsTheProgramItsThreads) {
    const std::string scene = folder.write("a.toml", SceneText{.film = "size = [4, 4]\nsamples = 1\n"});
    const auto threads_with = [&](const std::vector<std::string>& more) {
        std::vector<std::string> command = {"render",         scene,     "-o",
                                            folder / "a.exr", "--stats", folder / "s.json"};
        command.insert(command.end(), more.begin(), more.end());
        const ProgramResult done = marram(command);
        EXPECT_EQ(done.code, 0) << done.err;
        return nlohmann::json::parse(read_file(folder / "s.json"))["threads"].get<int>();
    };
    ::setenv("SLURM_CPUS_PER_TASK", "1", 1);
    EXPECT_EQ(threads_with({}), 1);
    EXPECT_EQ(threads_with({"--threads", "3"}), 3);
}

} // namespace
} // namespace marram::testing
