// SPDX-License-Identifier: Apache-2.0
// Files are complete or absent, wherever the disk gets full. A limit on the file size (RLIMIT_FSIZE) stands
// for the full disk: it cuts a write at an exact byte.
#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/image/words.h"
#include "core/math/problem.h"
#include "tests/unit/files.h"

#include <gtest/gtest.h>

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <functional>
#include <iterator>

namespace marram {
namespace {

namespace fs = std::filesystem;

class SizeLimit {
  public:
    explicit SizeLimit(size_t bytes) {
        std::signal(SIGXFSZ, SIG_IGN); // as the program does
        ::getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit limit{bytes, before_.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~SizeLimit() { ::setrlimit(RLIMIT_FSIZE, &before_); }

  private:
    rlimit before_{};
};

class AtomicFiles : public ::testing::Test {
  protected:
    AtomicFiles() {
        std::string name = (fs::temp_directory_path() / "marram_XXXXXX").string();
        folder = ::mkdtemp(name.data());
    }
    ~AtomicFiles() override { fs::remove_all(folder); }

    std::string path(const char* name) const { return (folder / name).string(); }
    static std::string get(const std::string& path) { return marram::read_file(path); }
    size_t count() const { return size_t(std::distance(fs::directory_iterator(folder), {})); }

    // Writes with every size limit that is too small, then with the smallest sufficient one.
    void expect_whole_or_not_there(const char* name,
                                   const std::function<void(const std::string&)>& write) const {
        const std::string file = path(name), old = "what stood there before";
        write(file);
        const std::string whole = get(file);
        ASSERT_GT(whole.size(), 20U);
        ASSERT_LT(whole.size(), 20000U) << "make it smaller: every byte is tried";
        size_t refused = 0;
        for (size_t room = 0; room < whole.size(); ++room) {
            std::ofstream(file, std::ios::binary) << old;
            try {
                const SizeLimit limit(room);
                write(file);
                ADD_FAILURE() << name << ": no fault with room for " << room << " of " << whole.size();
            } catch (const InputError& error) {
                refused += std::string(error.what()).find(file) == 0;
            }
            ASSERT_EQ(get(file), old) << room;
        }
        EXPECT_EQ(refused, whole.size()) << "each fault names the file";
        const SizeLimit limit(whole.size());
        write(file);
        EXPECT_EQ(get(file), whole);
        EXPECT_EQ(count(), 1U);
        fs::remove(file);
    }

    fs::path folder;
};

TEST_F(AtomicFiles, AreWholeOrNotThereAtEveryByte) {
    constexpr int width = 5, height = 3;
    float pixels[3 * width * height];
    for (int i = 0; i < 3 * width * height; ++i) pixels[i] = float(i % 7) * 0.13F;
    const Layer layers[] = {{"", {"R", "G", "B"}, pixels, true}, {"n", {"X", "Y", "Z"}, pixels, false}};
    const Metadata metadata[] = {{"marram:scene", std::string("scene.toml")}, {"marram:frame", 1.0}};
    expect_whole_or_not_there(
        "a.exr", [&](const std::string& file) { write_exr(file, width, height, layers, metadata); });
    expect_whole_or_not_there(
        "a.png", [&](const std::string& file) { write_png(file, width, height, 3, pixels, 0.0, metadata); });
    expect_whole_or_not_there("a.tif", [&](const std::string& file) {
        write_words(file, {width, height, 3, "a state"}, [&](int y, uint32_t* row) {
            for (int i = 0; i < 3 * width; ++i) row[i] = uint32_t(y * 1000 + i);
        });
    });
    expect_whole_or_not_there("a.txt", [](const std::string& file) {
        AtomicFile text(file);
        for (int i = 0; i < 100; ++i) text.write("a line of text\n");
        text.commit();
    });
}

TEST_F(AtomicFiles, OfMoreThanTheBufferAreCutToo) {
    const std::string block(300001, 'x'), file = path("large.txt");
    for (const size_t room : {0U, 1U, 300000U, 1048576U, 1048577U, 3000009U}) {
        const SizeLimit limit(room);
        const auto write = [&] {
            AtomicFile text(file);
            for (int i = 0; i < 10; ++i) text.write(block);
            text.commit();
        };
        EXPECT_THROW(write(), InputError) << room;
        EXPECT_EQ(count(), 0U);
    }
    AtomicFile text(file);
    for (int i = 0; i < 10; ++i) text.write(block);
    text.seek(1000000);
    text.put("yyy", 3);
    text.commit();
    std::string expected;
    for (int i = 0; i < 10; ++i) expected += block;
    expected.replace(1000000, 3, "yyy");
    EXPECT_TRUE(get(file) == expected);
}

// A child that creates a file and waits to be killed, or is killed at once.
pid_t child_with_file(const std::string& file) {
    int ready[2];
    EXPECT_EQ(::pipe(ready), 0);
    const pid_t child = ::fork();
    if (child == 0) {
        AtomicFile unfinished(file);
        unfinished.write("half");
        if (::write(ready[1], "x", 1) == 1) ::pause();
        ::_exit(1);
    }
    char byte = 0;
    EXPECT_EQ(::read(ready[0], &byte, 1), 1);
    ::close(ready[0]);
    ::close(ready[1]);
    return child;
}

void kill_and_wait(pid_t child) {
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
}

TEST_F(AtomicFiles, LeftByKilledProcessesAreRemovedByTheNextWriter) {
    std::vector<pid_t> killed;
    for (const char* name : {"a.exr", "b.toml", "c"}) killed.push_back(child_with_file(path(name)));
    const pid_t living = child_with_file(path("d.exr"));
    for (const pid_t child : killed) kill_and_wait(child);
    EXPECT_EQ(count(), 4U);
    const std::string mine = path("a.marram-writing-notes.exr"); // not a temporary file
    std::ofstream(mine) << "a user's file";
    EXPECT_NO_THROW(check_writable(path("e.exr")));
    EXPECT_EQ(count(), 5U) << "nothing is written yet";
    AtomicFile next(path("e.exr"));
    next.write("whole");
    next.commit();
    EXPECT_EQ(count(), 3U) << "the living one's, the user's, and the new one";
    EXPECT_TRUE(fs::exists(mine));
    kill_and_wait(living);
    AtomicFile another(path("e.exr"));
    another.commit();
    EXPECT_EQ(count(), 2U);
}

TEST_F(AtomicFiles, MayHaveNamesAsLongAsTheFileSystemAllows) {
    const std::string longest(251, 'n'), too_long(252, 'n');
    AtomicFile file(path((longest + ".exr").c_str()));
    file.write("x");
    file.commit();
    EXPECT_EQ(count(), 1U);
    try {
        check_writable(path((too_long + ".exr").c_str()));
        ADD_FAILURE() << "256 bytes are too many";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("256 bytes, the limit is 255: give it a shorter name"),
                  std::string::npos)
            << error.what();
    }
}

void write_text(const std::string& file, const std::string& text, Links links = Links::follow) {
    AtomicFile writer(file, links);
    writer.write(text);
    writer.commit();
}

TEST_F(AtomicFiles, KeepThePermissionsOfWhatTheyReplace) {
    const auto mode = [](const std::string& file) { return int(fs::status(file).permissions()); };
    const mode_t before = ::umask(022);
    for (const int wanted : {0664, 0600, 0640, 0755}) {
        const std::string file = path("a.txt");
        write_text(file, "old");
        fs::permissions(file, fs::perms(wanted));
        {
            AtomicFile writer(file);
            for (const auto& entry : fs::directory_iterator(folder))
                EXPECT_EQ(mode(entry.path()) & ~wanted & 077, 0) << "private until it is whole";
            writer.write("new");
            writer.commit();
        }
        EXPECT_EQ(get(file), "new");
        EXPECT_EQ(mode(file), wanted);
    }
    write_text(path("b.txt"), "new");
    EXPECT_EQ(mode(path("b.txt")), 0644);
    ::umask(before);
}

// A link that the user names is kept, and its file replaced; where the program makes up the name it is the
// other way round.
TEST_F(AtomicFiles, FollowOnlyLinksThatTheUserNames) {
    const std::string link = path("link"), victim = path("victim"), nowhere = path("nowhere");
    write_text(victim, "old");
    fs::create_symlink(victim, link);
    write_text(link, "followed");
    EXPECT_TRUE(fs::is_symlink(link));
    EXPECT_EQ(get(victim), "followed");
    write_text(link, "replaced", Links::replace);
    EXPECT_FALSE(fs::is_symlink(link));
    EXPECT_EQ(get(link), "replaced");
    EXPECT_EQ(get(victim), "followed");
    fs::remove(link);
    fs::create_symlink(nowhere, link);
    write_words(link, {1, 1, 1, "a state"}, [](int, uint32_t* row) { row[0] = 5; });
    EXPECT_FALSE(fs::exists(nowhere));
    EXPECT_TRUE(fs::is_regular_file(fs::symlink_status(link)));
    fs::remove(link);
    fs::create_symlink(folder, link); // to a folder
    write_text(link, "replaced", Links::replace);
    EXPECT_EQ(get(link), "replaced");
    remove_link(link);
    EXPECT_EQ(get(link), "replaced") << "it is no link";
    fs::create_symlink(victim, path("other"));
    remove_link(path("other"));
    EXPECT_FALSE(fs::is_symlink(path("other")));
    EXPECT_EQ(get(victim), "followed");
}

} // namespace
} // namespace marram
