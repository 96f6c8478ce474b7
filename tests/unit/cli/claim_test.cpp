// SPDX-License-Identifier: Apache-2.0
// Claims: several processes that share a folder make each output once. Times of claims are set by hand, so
// that no test waits for a lease.
#include "program.h"

#include "core/shot/farm/claim.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <random>
#include <thread>

namespace marram::testing {
namespace {

const std::atomic<bool> never_cancelled{false};

// A folder with a claim of another process.
class ClaimTest : public ::testing::Test {
  protected:
    Claims::Taken take(double lease = 60.0) const {
        Claims claims(lease);
        return claims.take(output, never_cancelled);
    }
    void write_claim(const ClaimHolder& holder) const { folder.write("a.exr.claim", claim_text(holder)); }
    static ClaimHolder elsewhere() {
        ClaimHolder holder = this_holder(60.0);
        holder.host = "farm3";
        holder.machine = "another boot";
        return holder;
    }
    // Sets the claim's time of change, relative to now by the file system's clock.
    void set_age(double seconds) const {
        const std::string now = folder.write("now", "");
        struct stat status {};
        ASSERT_EQ(::stat(now.c_str(), &status), 0);
        timespec time = status.st_mtim;
        time.tv_sec -= time_t(seconds);
        const timespec both[2] = {time, time}; // some FUSE file systems set none if one is left out
        ASSERT_EQ(::utimensat(AT_FDCWD, claim.c_str(), both, 0), 0);
        fs::remove(now);
    }
    std::string text() const { return read_file(claim); }
    // Runs it in a forked process, which then waits to be killed. Returns once it has run.
    static pid_t in_child(const std::function<void()>& work) {
        int ready[2];
        EXPECT_EQ(::pipe(ready), 0);
        const pid_t child = ::fork();
        if (child == 0) {
            work();
            (void)!::write(ready[1], "x", 1);
            for (;;) ::pause();
        }
        char byte = 0;
        EXPECT_EQ(::read(ready[0], &byte, 1), 1);
        ::close(ready[0]);
        ::close(ready[1]);
        return child;
    }
    static void end(pid_t child, bool reap = true) {
        ::kill(child, SIGKILL);
        if (reap) ::waitpid(child, nullptr, 0);
    }
    Folder folder;
    std::string output = folder / "a.exr", claim = folder / "a.exr.claim";
};

TEST_F(ClaimTest, IsHeldByOneAndRemovedAtTheEnd) {
    {
        const Claims::Taken first = take(), second = take();
        ASSERT_TRUE(first.claim);
        EXPECT_FALSE(second.claim);
        EXPECT_CONTAINS(second.holder, fmt::format("process {} of ", ::getpid()));
        EXPECT_TRUE(first.claim->held());
        EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr.claim"}));
        struct stat status {};
        EXPECT_EQ(::stat(claim.c_str(), &status), 0);
        EXPECT_EQ(status.st_nlink, 1U);
    }
    EXPECT_TRUE(folder.names().empty());
    EXPECT_TRUE(take().claim);
}

TEST_F(ClaimTest, OfADeadProcessOfThisMachineIsTakenOverAtOnce) {
    static std::unique_ptr<Claim> held; // in the child
    const pid_t child = in_child([&] { held = take().claim; });
    const std::string before = text();
    EXPECT_FALSE(take().claim); // it lives
    end(child, false);          // dead, but its parent has not asked for it
    for (Claims::Taken taken; !taken.claim;) taken = take();
    ::waitpid(child, nullptr, 0);
    EXPECT_TRUE(folder.names().empty());
    folder.write("a.exr.claim", before);
    const Claims::Taken taken = take();
    ASSERT_TRUE(taken.claim);
    EXPECT_EQ(taken.taken_over,
              fmt::format("process {} of {}, which has ended", child, this_holder(1.0).host));
    EXPECT_NE(text(), before);
}

// A pid is used again.
TEST_F(ClaimTest, IsNotThatOfAnotherProcessOfThisNumber) {
    ClaimHolder holder = this_holder(60.0);
    write_claim(holder);
    EXPECT_FALSE(take().claim);
    ++holder.started;
    write_claim(holder);
    EXPECT_TRUE(take().claim);
}

TEST_F(ClaimTest, OfAnotherMachineLastsForItsLease) {
    ClaimHolder holder = elsewhere();
    holder.pid = 999'999'999; // says nothing here
    write_claim(holder);
    EXPECT_FALSE(take().claim);
    set_age(50.0);
    EXPECT_FALSE(take(1.0).claim) << "the lease is the holder's";
    set_age(70.0);
    const Claims::Taken taken = take();
    ASSERT_TRUE(taken.claim);
    EXPECT_CONTAINS(taken.taken_over, "of farm3, which has not renewed its claim for 60 s");
}

// Only times of the file system are compared: the clocks of machines may differ by minutes. A claim from the
// future, as after a server's clock was set back, is stale when it has stayed the same for its lease.
TEST_F(ClaimTest, FromTheFutureIsStaleWhenItStaysTheSame) {
    ClaimHolder holder = elsewhere();
    holder.lease = 0.2;
    write_claim(holder);
    set_age(-600.0);
    Claims claims;
    EXPECT_FALSE(claims.take(output, never_cancelled).claim);
    set_age(-601.0); // renewed
    EXPECT_FALSE(claims.take(output, never_cancelled).claim);
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_TRUE(claims.take(output, never_cancelled).claim);
}

TEST_F(ClaimTest, IsRenewed) {
    const Claims::Taken taken = take(0.5);
    set_age(1000.0);
    const auto old = fs::last_write_time(claim);
    while (fs::last_write_time(claim) == old) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_TRUE(taken.claim->held());
    EXPECT_FALSE(taken.claim->lost());
}

// A holder that was suspended finds another's claim, and leaves it there.
TEST_F(ClaimTest, ThatWasTakenOverIsLost) {
    Claims::Taken taken = take();
    const std::string others = claim_text(elsewhere());
    folder.write("b", others);
    fs::rename(folder / "b", claim);
    EXPECT_FALSE(taken.claim->held());
    EXPECT_TRUE(taken.claim->lost());
    EXPECT_TRUE(taken.claim->stop());
    taken.claim.reset();
    EXPECT_EQ(text(), others);
}

TEST_F(ClaimTest, IsLostWithoutBeingAsked) {
    Claims::Taken taken = take(0.1);
    fs::remove(claim);
    while (!taken.claim->stop()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_TRUE(taken.claim->lost());
}

// Another taker holds it under a name of its own for a moment, sees that it is not stale, and puts it back.
TEST_F(ClaimTest, SurvivesAMomentWithoutItsName) {
    Claims::Taken taken = take();
    fs::rename(claim, folder / "moved");
    std::thread back([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(60));
        fs::rename(folder / "moved", claim);
    });
    EXPECT_TRUE(taken.claim->held());
    back.join();
}

TEST_F(ClaimTest, StopsWithAnInterrupt) {
    std::atomic<bool> cancel{false};
    Claims claims;
    const Claims::Taken taken = claims.take(output, cancel);
    EXPECT_FALSE(taken.claim->stop());
    cancel = true;
    while (!taken.claim->stop()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_FALSE(taken.claim->lost());
    remove_claims();
    EXPECT_TRUE(folder.names().empty());
}

TEST_F(ClaimTest, IsNeverAFileOfTheUser) {
    for (const char* text : {"my notes", "{\"kind\": \"marram claim\"}", "{}", "\xff\xfe"}) {
        folder.write("a.exr.claim", text);
        set_age(1000.0);
        EXPECT_THROW(take(), InputError) << text;
        EXPECT_EQ(read_file(claim), text);
    }
    fs::remove(claim);
    fs::create_directory(claim);
    EXPECT_THROW(take(), InputError);
    fs::remove(claim);
    fs::create_symlink(folder.write("notes", "x"), claim);
    EXPECT_THROW(take(), InputError);
    fs::remove(claim);
    folder.write("a.exr.claim", ""); // created where there are no links, by one that died before it wrote
    EXPECT_FALSE(take().claim);
    set_age(1000.0);
    EXPECT_TRUE(take().claim);
}

TEST_F(ClaimTest, OnWhatIsFinishedIsRemovedIfItIsStale) {
    Claims claims;
    claims.remove_stale(output);
    const auto is_left = [&] {
        claims.remove_stale(output);
        return fs::exists(claim);
    };
    write_claim(elsewhere());
    EXPECT_TRUE(is_left());
    set_age(70.0);
    EXPECT_FALSE(is_left());
    folder.write("a.exr.claim", "notes");
    set_age(70.0);
    EXPECT_TRUE(is_left());
}

TEST_F(ClaimTest, HoldsAnyNumbers) {
    for (const char* number : {"1e300", "-5", "null", "[]", "18446744073709551615", "0"}) {
        std::string text = claim_text(elsewhere());
        const size_t at = text.find("\"pid\":") + 6;
        text.replace(at, text.find_first_of(",}", at) - at, number);
        folder.write("a.exr.claim", text);
        EXPECT_FALSE(take().claim) << text;
    }
}

// Many takers of one stale claim, again and again: one gets it.
TEST_F(ClaimTest, IsTakenOverByOneOfMany) {
    constexpr int takers = 6, rounds = 40;
    for (int round = 0; round < rounds; ++round) {
        ClaimHolder dead = elsewhere();
        write_claim(dead);
        set_age(1000.0);
        std::vector<pid_t> children;
        int go[2], done[2], leave[2];
        ASSERT_TRUE(::pipe(go) == 0 && ::pipe(done) == 0 && ::pipe(leave) == 0);
        const auto wait_for = [](const int(&pipe)[2]) { // until the parent closes it
            char byte = 0;
            ::close(pipe[1]);
            (void)!::read(pipe[0], &byte, 1);
        };
        for (int i = 0; i < takers; ++i) {
            const pid_t child = ::fork();
            if (child == 0) {
                wait_for(go);
                Claims claims;
                const Claims::Taken taken = claims.take(output, never_cancelled);
                (void)!::write(done[1], "x", 1);
                wait_for(leave); // a dead one's claim would be taken over
                ::_exit(!taken.claim ? 0 : taken.claim->held() ? 1 : 2); // and leaves its claim
            }
            children.push_back(child);
        }
        const auto close_both = [](const int(&pipe)[2]) {
            ::close(pipe[0]);
            ::close(pipe[1]);
        };
        close_both(go);
        char byte = 0;
        for (int i = 0; i < takers; ++i) EXPECT_EQ(::read(done[0], &byte, 1), 1);
        close_both(leave);
        close_both(done);
        int won = 0;
        for (const pid_t child : children) {
            int status = 0;
            ::waitpid(child, &status, 0);
            EXPECT_NE(exit_code(status), 2);
            won += exit_code(status) == 1 ? 1 : 0;
        }
        EXPECT_EQ(won, 1) << "round " << round;
        EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr.claim"}));
    }
}

} // namespace

// ---- marram render --claim ------------------------------------------------------------------------------

namespace {

const SceneText claimed_grass{.globals = "frames = [1, 12]\n",
                              .film = "size = [24, 16]\nsamples = 4\nmax_depth = 3\n"};

class RenderWithClaims : public ::testing::Test {
  protected:
    std::vector<std::string> command(const std::vector<std::string>& more = {}) const {
        std::vector<std::string> all = {"render",  scene,       "-o", folder / "f.####.exr",
                                        "--claim", "--threads", "1"};
        all.insert(all.end(), more.begin(), more.end());
        return all;
    }
    pid_t start(const std::string& out, const std::vector<std::string>& more = {}) const {
        const pid_t child = ::fork();
        if (child == 0) {
            ::dup2(::open((logs / out).c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600), STDOUT_FILENO);
            ::dup2(::open((logs / "err").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600), STDERR_FILENO);
            run_program(command(more));
        }
        return child;
    }
    static std::string picture(int frame) { return fmt::format("f.{:04}.exr", frame); }
    std::set<std::string> pictures() const {
        std::set<std::string> names = {"scene.toml"};
        for (int frame = 1; frame <= 12; ++frame) names.insert(picture(frame));
        return names;
    }
    // As often as processes have said that they wrote it.
    std::map<std::string, int> said() const {
        std::map<std::string, int> counts;
        for (const std::string& name : logs.names())
            if (name != "err")
                for (const std::string& line : lines(read_file(logs / name)))
                    ++counts[fs::path(line).filename().string()];
        return counts;
    }
    Folder folder, logs;
    std::string scene = folder.write("scene.toml", claimed_grass);
};

TEST_F(RenderWithClaims, SharesFrames) {
    std::vector<pid_t> children;
    for (int i = 0; i < 3; ++i) children.push_back(start(fmt::format("{}", i)));
    for (const pid_t child : children) {
        int status = 0;
        ::waitpid(child, &status, 0);
        EXPECT_EQ(exit_code(status), 0) << read_file(logs / "err");
    }
    EXPECT_EQ(folder.names(), pictures());
    for (int frame = 1; frame <= 12; ++frame) EXPECT_EQ(said()[picture(frame)], 1) << frame;
    ClaimHolder dead = this_holder(60.0); // ended between saving and removing its claim
    ++dead.started;
    folder.write("f.0005.exr.claim", claim_text(dead));
    const ProgramResult again = marram(command({"--quiet"}));
    EXPECT_EQ(folder.names(), pictures());
    EXPECT_EQ(again.code, 0) << again.err;
    EXPECT_EQ(again.out, "");
}

// Eight processes, of which a third are killed at random moments and started again.
TEST_F(RenderWithClaims, RendersEachFrameOnceWhenProcessesAreKilled) {
    constexpr int processes = 8;
    std::mt19937 random(5);
    std::map<pid_t, int> running; // to its number
    int killed = 0, started = 0;
    const auto begin = [&] {
        const int number = started++;
        running[start(fmt::format("{}", number), {"--spp", "64"})] = number;
    };
    for (int i = 0; i < processes; ++i) begin();
    const auto reap = [&](int options) {
        int status = 0;
        const pid_t child = ::waitpid(-1, &status, options);
        if (child <= 0) return false;
        running.erase(child);
        EXPECT_EQ(exit_code(status), 0) << read_file(logs / "err");
        return true;
    };
    // Each kill comes after another frame is there, or soon: the test does not depend on the machine's speed.
    while (!running.empty() && killed < 12) {
        std::this_thread::sleep_for(std::chrono::milliseconds(random() % 400));
        while (reap(WNOHANG)) {
        }
        if (running.empty()) break;
        auto victim = running.begin();
        std::advance(victim, random() % running.size());
        if (victim->second % 3 != 0 && random() % 3 != 0) continue;
        ::kill(victim->first, SIGKILL);
        ::waitpid(victim->first, nullptr, 0);
        running.erase(victim);
        ++killed;
        begin();
    }
    while (!running.empty()) reap(0);
    std::set<std::string> names = folder.names();
    std::erase_if(names,
                  [](const std::string& name) { return name.find(".marram-writing-") != std::string::npos; });
    EXPECT_EQ(names, pictures());
    int sum = 0;
    for (const auto& [name, count] : said()) {
        EXPECT_EQ(count, 1) << name;
        sum += count;
    }
    EXPECT_GE(sum, 12 - killed); // one may be killed between saving and saying so
    EXPECT_GT(killed, 0);
    const Folder alone;
    EXPECT_EQ(marram({"render", scene, "-o", alone / "f.####.exr", "--spp", "64", "--quiet"}).code, 0);
    for (int frame = 1; frame <= 12; ++frame)
        EXPECT_TRUE(same_picture(folder / picture(frame), alone / picture(frame))) << frame;
}

// A process that was suspended for longer than its lease does not replace what another has rendered.
TEST_F(RenderWithClaims, DoesNotSaveAFrameThatItHasLost) {
    const pid_t child = start("slow", {"--frame", "3", "--spp", "20000", "--lease", "1"});
    const std::string claim = folder / "f.0003.exr.claim";
    while (!fs::exists(claim)) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ::kill(child, SIGSTOP);
    ClaimHolder other = this_holder(60.0); // lives
    folder.write("other", claim_text(other));
    fs::rename(folder / "other", claim);
    ::kill(child, SIGCONT);
    // It waits for the other; when that has gone without a picture, it renders the frame itself.
    while (read_file(logs / "err").find("waiting for a frame that other processes render: ") ==
           std::string::npos)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(fs::exists(folder / "f.0003.exr"));
    EXPECT_EQ(read_file(claim), claim_text(other));
    ::kill(child, SIGTERM);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_GE(exit_code(status), 128);
    EXPECT_EQ(read_file(claim), claim_text(other));
}

TEST_F(RenderWithClaims, TakesOverWhatAnInterruptedProcessHasBegun) {
    const pid_t child = start("first", {"--frame", "3", "--spp", "65536"});
    const std::string claim = folder / "f.0003.exr.claim", state = folder / "f.0003.exr.state.tif";
    while (!fs::exists(claim)) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    ::kill(child, SIGINT);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(exit_code(status), 130);
    EXPECT_FALSE(fs::exists(claim));
    if (!fs::exists(state)) GTEST_SKIP() << "it had not begun to trace";
    const int samples =
        std::stoi(read_metadata(folder / "f.0003.partial.exr", "marram:samples").value_or("0")) + 9;
    const ProgramResult done = marram(command({"--frame", "3", "--spp", std::to_string(samples)}));
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_CONTAINS(done.err, "resumed at ");
    EXPECT_EQ(folder.names(), (std::set<std::string>{"scene.toml", "f.0003.exr"}));
}

TEST_F(RenderWithClaims, ExcludesWhatNeverFinishes) {
    for (const std::vector<std::string>& more :
         {std::vector<std::string>{"--watch", "--frame", "1"}, {"--seconds", "3"}, {"--lease", "0"}})
        EXPECT_EQ(marram(command(more)).code, 2);
    EXPECT_EQ(marram({"render", scene, "-o", folder / "a.exr", "--lease", "3"}).code, 2);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"scene.toml"}));
}

} // namespace
} // namespace marram::testing
