// SPDX-License-Identifier: Apache-2.0
#include "core/shot/farm/claim.h"

#include "core/image/atomic_file.h"
#include "core/math/problem.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr double renewals = 5.0;   // within a lease
constexpr size_t max_claim = 4096; // bytes; a longer file is no claim
constexpr auto poll = std::chrono::milliseconds(20);
constexpr auto folder_time_kept = std::chrono::seconds(10);
constexpr const char* kind = "marram claim";
// While another process looks whether our claim is a stale one, it has another name.
constexpr int tries_without_name = 10;
constexpr auto between_tries = std::chrono::milliseconds(30);

// Claims of this process, for remove_claims(): name and text.
constinit std::mutex held_lock;
std::set<std::pair<std::string, std::string>> held_claims;
std::atomic<bool> any_held{false};

std::string line_of(const char* path) {
    std::ifstream in(path);
    std::string line;
    std::getline(in, line);
    return line;
}

// Processes of two containers on one machine cannot see each other: they count as two machines.
std::string this_machine() {
    std::array<char, 256> space{};
    const std::string boot = line_of("/proc/sys/kernel/random/boot_id");
    const ssize_t size = ::readlink("/proc/self/ns/pid", space.data(), space.size());
    if (boot.empty() || size <= 0) return "";
    return boot + " " + std::string(space.data(), size_t(size));
}

struct ProcessState {
    char state = '?';
    uint64_t started = 0;
};

// From /proc/PID/stat: "PID (NAME) S ...", the time of start is field 22.
std::optional<ProcessState> process_state(int64_t pid) {
    const std::string line = line_of(fmt::format("/proc/{}/stat", pid).c_str());
    const size_t name_end = line.rfind(')');
    if (name_end == std::string::npos || name_end + 2 >= line.size()) return {};
    ProcessState found{line[name_end + 2], 0};
    size_t at = name_end + 1;
    constexpr int fields_after_name = 20; // until the time of start
    for (int i = 0; i < fields_after_name && at != std::string::npos; ++i)
        at = line.find(' ', at + (i > 0 ? 1 : 0));
    if (at == std::string::npos) return {};
    found.started = std::strtoull(line.c_str() + at, nullptr, 10);
    return found;
}

bool is_dead(const ClaimHolder& holder) {
    if (holder.pid <= 0 || holder.pid > INT32_MAX) return false;
    if (::kill(pid_t(holder.pid), 0) != 0 && errno == ESRCH) return true;
    const std::optional<ProcessState> state = process_state(holder.pid);
    if (!state) return false; // some systems show other users' processes to nobody
    const bool ended = state->state == 'Z' || state->state == 'X';
    return ended || (holder.started != 0 && state->started != holder.started);
}

std::optional<ClaimHolder> parse_claim(const std::string& text) {
    const json value = json::parse(text, nullptr, false);
    if (!value.is_object() || value.value("kind", json()) != kind) return {};
    const auto text_of = [&](const char* key) {
        const json& one = value.value(key, json());
        return one.is_string() ? one.get<std::string>() : std::string();
    };
    const auto number_of = [&](const char* key) {
        constexpr double most = 9007199254740992.0; // 2^53
        const json& one = value.value(key, json());
        const double number = one.is_number() ? one.get<double>() : 0.0;
        return number >= 0.0 && number <= most ? number : 0.0;
    };
    ClaimHolder holder{text_of("host"),           text_of("machine"),
                       int64_t(number_of("pid")), uint64_t(number_of("started")),
                       text_of("token"),          number_of("lease")};
    constexpr double max_lease = 1e6; // s
    if (holder.token.empty() || !(holder.lease > 0.0) || holder.lease > max_lease) return {};
    return holder;
}

std::string named(const ClaimHolder* holder) {
    if (!holder) return "a process that has not written its name";
    return fmt::format("process {} of {}", holder->pid, holder->host);
}

int64_t nanoseconds(const timespec& time) { return int64_t(time.tv_sec) * 1'000'000'000 + time.tv_nsec; }

// Sets the time of change to now: to that of the server, if there is one.
bool touch(int descriptor) {
    const std::array<timespec, 2> now = {{{0, UTIME_NOW}, {0, UTIME_NOW}}};
    return ::futimens(descriptor, now.data()) == 0;
}

bool write_all(int descriptor, const std::string& text) {
    size_t done = 0;
    while (done < text.size()) {
        const ssize_t more = ::write(descriptor, text.data() + done, text.size() - done);
        if (more < 0 && errno == EINTR) continue;
        if (more <= 0) return false;
        done += size_t(more);
    }
    return ::fsync(descriptor) == 0;
}

std::string read_all(int descriptor) {
    std::string text(max_claim + 1, '\0');
    size_t done = 0;
    while (done < text.size()) {
        const ssize_t more = ::pread(descriptor, text.data() + done, text.size() - done, off_t(done));
        if (more < 0 && errno == EINTR) continue;
        if (more <= 0) break;
        done += size_t(more);
    }
    text.resize(done);
    return text;
}

// A file of this name, open for reading: opening it also asks an NFS server for its present attributes.
class OpenClaim {
  public:
    explicit OpenClaim(const std::string& file)
        : descriptor_(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK)),
          error_(descriptor_ < 0 ? errno : 0) {}
    ~OpenClaim() {
        if (descriptor_ >= 0) ::close(descriptor_);
    }
    OpenClaim(const OpenClaim&) = delete;
    OpenClaim& operator=(const OpenClaim&) = delete;

    int descriptor() const { return descriptor_; }
    int error() const { return error_; } // 0: it is open

  private:
    int descriptor_, error_;
};

[[noreturn]] void fail(const std::string& file, int error) {
    throw InputError({file}, fmt::format("the claim cannot be written ({})", std::strerror(error)),
                     "check the permissions of its folder, the disk and its free space");
}

// Creates the claim. False: the name is taken.
bool create(const std::string& file, const std::string& text) {
    TemporaryFile own(file, file);
    if (!write_all(own.descriptor(), text) || !touch(own.descriptor())) fail(file, errno);
    if (::link(own.name().c_str(), file.c_str()) == 0) return true;
    const int error = errno;
    struct stat status {};
    if (::fstat(own.descriptor(), &status) == 0 && status.st_nlink == 2) return true; // the answer was lost
    if (error == EEXIST) return false;
    if (error != EPERM && error != EOPNOTSUPP && error != ENOSYS && error != EMLINK) fail(file, error);
    const int made = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666); // no links here
    if (made < 0 && errno == EEXIST) return false;
    if (made < 0) fail(file, errno);
    const bool written = write_all(made, text);
    const int why = errno;
    ::close(made);
    if (written) return true;
    ::unlink(file.c_str());
    fail(file, why);
}

// When a claim was last renewed, as its taker has seen it. A renewal after that moves the time by more than a
// lease; file systems round times, and the cache of a client may not have.
struct LastRenewal {
    int64_t time = 0, tolerance = 0; // ns
};

// Takes the claim away if its text is still this, and it has not been renewed since `last`, if that is given.
// False: it keeps its name, or is gone.
bool withdraw(const std::string& file, const std::string& text, std::optional<LastRenewal> last = {}) {
    if (const OpenClaim now(file); now.error() != 0 || read_all(now.descriptor()) != text) return false;
    TemporaryFile moved(file, file); // a name of our own; removed with what gets it
    if (::rename(file.c_str(), moved.name().c_str()) != 0) return false;
    moved.lock_again();
    struct stat status {};
    const bool renewed = last && (::fstat(moved.descriptor(), &status) != 0 ||
                                  std::abs(nanoseconds(status.st_mtim) - last->time) > last->tolerance);
    if (!renewed && read_all(moved.descriptor()) == text) return true;
    // If there is a newer claim, that one counts.
    if (::link(moved.name().c_str(), file.c_str()) != 0 && errno != EEXIST)
        (void)::renameat2(AT_FDCWD, moved.name().c_str(), AT_FDCWD, file.c_str(), RENAME_NOREPLACE);
    return false;
}

} // namespace

std::string claim_name(const std::string& output) { return output + ".claim"; }

std::string claim_text(const ClaimHolder& holder) {
    const json value = {{"kind", kind},          {"host", holder.host},
                        {"pid", holder.pid},     {"machine", holder.machine},
                        {"token", holder.token}, {"started", holder.started},
                        {"lease", holder.lease}};
    return value.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

ClaimHolder this_holder(double lease) {
    std::array<char, 256> host{};
    if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = '?';
    std::random_device random;
    const std::string token = fmt::format("{:08x}{:08x}{:08x}{:08x}", random(), random(), random(), random());
    const std::optional<ProcessState> state = process_state(::getpid());
    return {host.data(), this_machine(), ::getpid(), state ? state->started : 0, token, lease};
}

// ---- A claim that is held -------------------------------------------------------------------------------

Claim::Claim(std::string file, std::string text, double lease, const std::atomic<bool>& cancel)
    : file_(std::move(file)), text_(std::move(text)), lease_(lease), cancel_(cancel) {
    {
        const std::lock_guard guard(held_lock);
        held_claims.emplace(file_, text_);
        any_held = true;
    }
    thread_ = std::jthread([this](const std::stop_token& end) { keep(end); });
}

Claim::~Claim() {
    thread_.request_stop();
    thread_.join();
    try {
        withdraw(file_, text_);
    } catch (const InputError&) { // the folder cannot be written now: the lease will end it
    }
    const std::lock_guard guard(held_lock);
    held_claims.erase({file_, text_});
}

void Claim::renew() {
    for (int tries = 0; tries < tries_without_name; ++tries) {
        const OpenClaim now(file_);
        if (now.error() == 0) {
            if (read_all(now.descriptor()) == text_) {
                (void)touch(now.descriptor()); // if it fails, it is tried again before the lease ends
                return;
            }
            break;
        }
        if (now.error() != ENOENT) return; // the server may come back
        std::this_thread::sleep_for(between_tries);
    }
    lost_ = true;
    stop_ = true;
}

bool Claim::held() {
    if (!lost_) renew();
    return !lost_;
}

void Claim::keep(const std::stop_token& end) {
    auto next = Clock::now();
    const auto between =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(lease_ / renewals));
    for (next += between; !end.stop_requested() && !lost_; std::this_thread::sleep_for(poll)) {
        if (cancel_) stop_ = true;
        if (Clock::now() < next) continue;
        renew();
        next = Clock::now() + between;
    }
}

void remove_claims() {
    if (!any_held.load()) return;
    const std::unique_lock guard(held_lock, std::try_to_lock);
    if (!guard) return;
    for (const auto& [file, text] : held_claims)
        if (const OpenClaim now(file); now.error() == 0 && read_all(now.descriptor()) == text)
            ::unlink(file.c_str());
}

// ---- Taking claims --------------------------------------------------------------------------------------

Claims::Look Claims::look_at(const std::string& file) {
    const OpenClaim now(file);
    if (now.error() == ENOENT) return {};
    struct stat status {};
    const bool is_file =
        now.error() == 0 && ::fstat(now.descriptor(), &status) == 0 && S_ISREG(status.st_mode);
    if (!is_file) return {"", 0, false, true};
    return {read_all(now.descriptor()), nanoseconds(status.st_mtim), true, true};
}

// The time that a file gets which is touched now in the claim's folder. Between two such files the clock that
// only goes forward is good enough.
int64_t Claims::folder_now(const std::string& file) {
    FolderTime& known = times_[fs::path(file).parent_path().string()];
    const auto now = Clock::now();
    if (known.time == 0 || now - known.read > folder_time_kept) {
        const TemporaryFile touched(file, file);
        struct stat status {};
        if (!touch(touched.descriptor()) || ::fstat(touched.descriptor(), &status) != 0) fail(file, errno);
        known = {nanoseconds(status.st_mtim), now};
    }
    return known.time + std::chrono::nanoseconds(now - known.read).count();
}

// "": it is held. Otherwise what is to be said of its holder.
std::string Claims::why_stale(const std::string& file, const Look& look, const ClaimHolder* holder) {
    static const std::string machine = this_machine();
    if (holder && !machine.empty() && holder->machine == machine && is_dead(*holder))
        return "which has ended";
    const double lease = holder ? holder->lease : lease_;
    const std::string silent = fmt::format("which has not renewed its claim for {:g} s", lease);
    Seen& seen = seen_[file];
    if (seen.text != look.text || seen.changed != look.changed)
        seen = {look.text, look.changed, Clock::now()};
    // Also one whose time lies in the future, as clocks of servers are set.
    if (std::chrono::duration<double>(Clock::now() - seen.first).count() > lease) return silent;
    return 1e-9 * double(folder_now(file) - look.changed) > lease ? silent : "";
}

Claims::Taken Claims::take(const std::string& output, const std::atomic<bool>& cancel) {
    const std::string file = claim_name(output);
    Taken taken;
    if (const Look look = look_at(file); look.exists) {
        const std::optional<ClaimHolder> holder = parse_claim(look.text);
        const bool is_other = !look.is_file || (!holder && !look.text.empty());
        if (is_other && look.is_file && 1e-9 * double(folder_now(file) - look.changed) < lease_) {
            taken.holder = named(nullptr); // some systems may show half of its text for a moment
            return taken;
        }
        if (is_other)
            throw InputError({file}, "this file is no claim of marram", "move it, or choose another output");
        const ClaimHolder* const known = holder ? &*holder : nullptr;
        const std::string why = why_stale(file, look, known);
        taken.holder = named(known);
        const LastRenewal last{look.changed, int64_t(0.5e9 * (known ? known->lease : lease_))};
        if (why.empty() || !withdraw(file, look.text, last)) return taken;
        taken.taken_over = fmt::format("{}, {}", taken.holder, why);
    }
    const std::string text = claim_text(this_holder(lease_));
    if (create(file, text)) {
        seen_.erase(file);
        taken.claim.reset(new Claim(file, text, lease_, cancel));
        taken.holder.clear();
        return taken;
    }
    taken.taken_over.clear();
    const std::optional<ClaimHolder> holder = parse_claim(look_at(file).text);
    taken.holder = named(holder ? &*holder : nullptr);
    return taken;
}

void Claims::remove_stale(const std::string& output) {
    const std::string file = claim_name(output);
    const Look look = look_at(file);
    const std::optional<ClaimHolder> holder = parse_claim(look.text);
    if (holder && !why_stale(file, look, &*holder).empty())
        withdraw(file, look.text, LastRenewal{look.changed, int64_t(0.5e9 * holder->lease)});
}

} // namespace marram
