// SPDX-License-Identifier: Apache-2.0
// States of simulations in a folder that may have come from anywhere.
#include "core/host/state_store.h"

#include "core/math/problem.h"
#include "tests/unit/files.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

class StateFolder : public ::testing::Test {
  protected:
    StateFolder() {
        std::string name = (fs::temp_directory_path() / "marram_state_XXXXXX").string();
        folder = ::mkdtemp(name.data());
    }
    ~StateFolder() override { fs::remove_all(folder); }

    StateStore open() const { return {(folder / "d.states").string(), "desert", 7}; }
    std::string path(const char* name) const {
        return (folder / "d.states/desert-0000000000000007" / name).string();
    }
    static std::string get(const fs::path& file) { return marram::read_file(file); }

    fs::path folder;
};

TEST_F(StateFolder, LinksAreNotFollowed) {
    StateStore states = open();
    EXPECT_FALSE(states.load(3.0));
    const fs::path victim = folder / "victim";
    std::ofstream(victim) << "precious";
    fs::create_symlink(victim, path("3.state"));
    fs::create_symlink(folder / "nowhere", path("4.state"));
    states.store(3.0, "three", 5);
    states.store(4.0, "four", 4);
    EXPECT_EQ(get(victim), "precious");
    EXPECT_FALSE(fs::exists(folder / "nowhere"));
    EXPECT_FALSE(fs::is_symlink(path("3.state")));
    const auto found = open().load(3.5);
    ASSERT_TRUE(found);
    EXPECT_EQ(std::string(found->data.begin(), found->data.end()), "three");

    fs::rename(folder / "d.states/desert-0000000000000007", folder / "elsewhere");
    fs::create_directory_symlink(folder / "elsewhere", folder / "d.states/desert-0000000000000007");
    StateStore linked = open();
    try {
        linked.load(3.0);
        ADD_FAILURE() << "the folder is a link";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("is a symbolic link"), std::string::npos) << error.what();
    }
}

TEST_F(StateFolder, UnreadableStatesAreNotCalledDamaged) {
    StateStore states = open();
    states.load(1.0);
    states.store(1.0, "one", 3);
    states.store(2.0, "two", 3);
    std::ofstream(path("2.state"), std::ios::app) << "x";
    StateStore later = open();
    EXPECT_EQ(later.load(2.0)->frame, 1.0);
    const std::vector<Problem> damaged = later.take_warnings();
    ASSERT_EQ(damaged.size(), 1U);
    EXPECT_NE(to_string(damaged[0]).find("2.state: is damaged and is left out: remove it"), std::string::npos)
        << to_string(damaged[0]);
    fs::permissions(path("2.state"), fs::perms::none);
    fs::permissions(folder, fs::perms::all);
    const uid_t user = ::geteuid(), nobody = 65534;
    ASSERT_EQ(::seteuid(user == 0 ? nobody : user), 0); // the superuser reads it all the same
    EXPECT_EQ(later.load(2.0)->frame, 1.0);
    ASSERT_EQ(::seteuid(user), 0);
    const std::vector<Problem> unreadable = later.take_warnings();
    ASSERT_EQ(unreadable.size(), 1U);
    EXPECT_NE(to_string(unreadable[0]).find("cannot be read (Permission denied)"), std::string::npos)
        << to_string(unreadable[0]);
}

} // namespace
} // namespace marram
