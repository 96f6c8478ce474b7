// SPDX-License-Identifier: Apache-2.0
// Limits of control groups, in folders that look like those of the kernel, and what follows from them for the
// number of threads.
#include "core/cli/machine.h"
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
        ::unsetenv("SLURM_CPUS_PER_TASK");
    }
    void TearDown() override { ::unsetenv("SLURM_CPUS_PER_TASK"); }
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
    Folder folder;
};

TEST_F(Machine, WithoutLimitsHasItsProcessors) {
    EXPECT_EQ(processor_quota(root()), std::nullopt);
    EXPECT_EQ(memory_limit(root()), std::nullopt);
    EXPECT_EQ(threads_allowed(7, root()), 7);
    version_2("/");
    put("sys/fs/cgroup/cpu.max", "max 100000\n");
    put("sys/fs/cgroup/memory.max", "max\n");
    EXPECT_EQ(processor_quota(root()), std::nullopt);
    EXPECT_EQ(memory_limit(root()), std::nullopt);
    EXPECT_EQ(threads_allowed(7, root()), 7);
}

TEST_F(Machine, HasTheSmallestLimitOfItsGroupsUpwards) {
    version_2("/slurm/job_7/step_0");
    put("sys/fs/cgroup/slurm/job_7/step_0/cpu.max", "max 100000\n");
    put("sys/fs/cgroup/slurm/job_7/step_0/memory.max", "8000000000\n");
    put("sys/fs/cgroup/slurm/job_7/cpu.max", "250000 100000\n");
    put("sys/fs/cgroup/slurm/job_7/memory.max", "4000000000\n");
    put("sys/fs/cgroup/slurm/cpu.max", "400000 100000\n");
    put("sys/fs/cgroup/slurm/job_8/cpu.max", "100000 100000\n"); // not above
    EXPECT_EQ(processor_quota(root()), 2.5);
    EXPECT_EQ(memory_limit(root()), 4'000'000'000u);
    EXPECT_EQ(threads_allowed(16, root()), 3) << "rounded up";
    EXPECT_EQ(threads_allowed(2, root()), 2) << "no more than processors";
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
    EXPECT_EQ(threads_allowed(16, root()), 3);
    EXPECT_EQ(memory_limit(root()), std::nullopt);
    put("sys/fs/cgroup/memory/batch/memory.limit_in_bytes", "2147483648\n");
    EXPECT_EQ(memory_limit(root()), 2'147'483'648u);
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
