// SPDX-License-Identifier: Apache-2.0
// Runs the built program as a user does: in its own folder, on scenes that the tests write.
#pragma once

#include "core/cli/cli.h"
#include "core/image/image.h"
#include "core/image/image_library.h"
#include "core/math/problem.h"
#include "tests/unit/files.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <fcntl.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

namespace marram::testing {

namespace fs = std::filesystem;

inline const std::string program = MARRAM_BINARY_DIR "/marram";

// A temporary folder, removed when the test ends.
class Folder {
  public:
    Folder() {
        std::string pattern = (fs::temp_directory_path() / "marram_cli_XXXXXX").string();
        path_ = ::mkdtemp(pattern.data());
    }
    ~Folder() {
        std::error_code ignored;
        fs::remove_all(path_, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    std::string operator/(const std::string& name) const { return (path_ / name).string(); }
    std::string write(const std::string& name, const std::string& text) const {
        std::ofstream(path_ / name, std::ios::binary) << text;
        return *this / name;
    }
    // Names and contents of all files.
    std::map<std::string, std::string> contents() const {
        std::map<std::string, std::string> all;
        for (const auto& entry : fs::recursive_directory_iterator(path_))
            if (entry.is_regular_file())
                all[fs::relative(entry.path(), path_).string()] = read_file(entry.path());
        return all;
    }
    std::set<std::string> names() const {
        std::set<std::string> all;
        for (const auto& entry : fs::recursive_directory_iterator(path_))
            if (entry.is_regular_file()) all.insert(fs::relative(entry.path(), path_).string());
        return all;
    }

  private:
    fs::path path_;
};

struct ProgramResult {
    int code = -1; // 128 + signal if one ended the process
    std::string out, err;
};

inline int exit_code(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status); }

// argv of the program's name and `arguments`. It points into them.
inline std::vector<char*> argv_of(std::vector<std::string>& arguments) {
    arguments.insert(arguments.begin(), program);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    return argv;
}

inline void run_program(std::vector<std::string> arguments) {
    ::execv(program.c_str(), argv_of(arguments).data());
    ::_exit(127);
}

// Calls what the program's main() calls, in a forked child: this saves half a second of loading libraries.
// Only valid while this process has no threads.
inline void run_copy(std::vector<std::string> arguments) {
    std::vector<char*> argv = argv_of(arguments);
    const int code = marram::run(int(arguments.size()), argv.data());
    std::fflush(nullptr);
    ::_exit(code);
}

using Run = void (*)(std::vector<std::string> arguments);

inline ProgramResult marram(const std::vector<std::string>& arguments, Run run = run_program) {
    const Folder streams;
    const std::string out = streams / "out", err = streams / "err";
    std::fflush(nullptr); // or the child would write it, too
    // Once, here, or each child would load it again.
    if (!arguments.empty() && arguments[0] == "render") load_image_library();
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
        ::dup2(::open(err.c_str(), O_WRONLY | O_CREAT, 0600), STDERR_FILENO);
        run(arguments);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return {exit_code(status), read_file(out), read_file(err)};
}

// Runs the program on a terminal, so that its progress line shows the phase, and sends it a signal once
// `phase` has been drawn `times` times. Returns its exit code.
inline int interrupt_in(const std::string& phase, const std::vector<std::string>& arguments,
                        int signal = SIGINT, int times = 1) {
    int terminal = -1;
    const pid_t child = ::forkpty(&terminal, nullptr, nullptr, nullptr);
    if (child == 0) run_program(arguments);
    std::string seen;
    bool sent = false;
    const auto drawn = [&] {
        int count = 0;
        for (size_t at = seen.find(phase); at != std::string::npos; at = seen.find(phase, at + 1)) ++count;
        return count;
    };
    char buffer[4096];
    for (ssize_t count = 0; (count = ::read(terminal, buffer, sizeof buffer)) > 0;) {
        seen.append(buffer, size_t(count));
        if (sent || drawn() < times) continue;
        ::kill(child, signal);
        sent = true;
    }
    ::close(terminal);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(sent) << "the phase was over before it could be seen: " << seen;
    return exit_code(status);
}

// The output of another program.
inline std::string output_of(const std::string& command) {
    std::FILE* pipe = ::popen(command.c_str(), "r");
    std::string text;
    char buffer[4096];
    for (size_t count = 0; pipe && (count = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;)
        text.append(buffer, count);
    EXPECT_TRUE(pipe && ::pclose(pipe) == 0) << command;
    return text;
}

inline std::vector<std::string> lines(const std::string& text) {
    std::vector<std::string> all;
    for (size_t begin = 0; begin < text.size();) {
        const size_t end = std::min(text.find('\n', begin), text.size());
        all.push_back(text.substr(begin, end - begin));
        begin = end + 1;
    }
    return all;
}

#define EXPECT_CONTAINS(text, part) EXPECT_NE((text).find(part), std::string::npos) << (text)
#define EXPECT_DONE(outcome)                                                                                 \
    do {                                                                                                     \
        const ProgramResult done = (outcome);                                                                \
        EXPECT_EQ(done.code, 0) << done.err;                                                                 \
        EXPECT_EQ(done.err, "");                                                                             \
    } while (0)

// ---- Scenes: a square with grass, in a picture of 24 x 16 -------------------------------------------------

struct SceneText {
    std::string globals = "frames = [1, 10]\n";
    std::string film = "size = [24, 16]\nsamples = 2\nmax_depth = 3\n";
    std::string wind = "speed = 6\n";
    std::string groom = "count = 300\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n";
    std::string more = ""; // further tables

    operator std::string() const {
        return globals + "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0.2, 0]\n[film]\n" + film +
               "[wind]\n" + wind +
               "[[light]]\ntype = \"sky\"\n[[mesh]]\nname = \"ground\"\ntype = \"plane\"\nsize = [2, 2]\n" +
               "[[procedural]]\nname = \"grass\"\ntype = \"groom\"\non = \"ground\"\n" + groom + more;
    }
};

// Compares the pixels of two pictures bit for bit.
inline bool same_picture(const std::string& a, const std::string& b) {
    const Image x = read_image(a), y = read_image(b);
    return x.width == y.width && x.height == y.height && x.channel_names == y.channel_names &&
           std::memcmp(x.pixels.data(), y.pixels.data(), x.pixels.size() * sizeof(float)) == 0;
}

} // namespace marram::testing
