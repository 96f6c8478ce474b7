// SPDX-License-Identifier: Apache-2.0
// Claims: processes on several machines that share a folder agree on who makes which output. No scheduler and
// no server is needed, only the folder.
//
// The claim of a.exr is the file a.exr.claim beside it. It says who holds it: host, process, a random token.
//
//   Create    The text is written to a temporary file, and link(2) gives it the claim's name: one process
//             succeeds, and nobody sees a claim without its text. An NFS server may do what a client asks and
//             lose the answer; the client then hears that the name is taken. So if link() fails, the count of
//             links tells: 2, and the claim is ours. (O_EXCL is atomic on NFS since version 3, but has
//             neither property; it is used where the file system has no links.)
//   Renew     Every fifth of the lease the holder sets the claim's time of change to "now", which on NFS is
//             the server's now.
//   Judge     Times are compared with the time of a file that was touched in the same folder, never with the
//             clock of a machine: clocks may differ by minutes. A claim is stale if it has not been renewed
//             for its lease, or if its process was on this machine, in this boot, and is dead.
//   Take over The stale claim is renamed to a name of the taker's, and read again: if another taker was
//             faster, it is that one's new claim, and if its holder woke up, it has been renewed. It then
//             gets its name back. Else the claim is created as above.
//   Publish   A holder that was suspended may have lost its claim: held() before the output is saved. That,
//             and looking for the finished output after the claim was taken, is the caller's part.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <thread>

namespace marram {

inline constexpr double default_lease = 60.0; // s

// "a.exr" -> "a.exr.claim".
std::string claim_name(const std::string& output);

// What a claim says.
struct ClaimHolder {
    std::string host;     // for messages
    std::string machine;  // boot and process namespace; "": unknown
    int64_t pid = 0;      // in that namespace
    uint64_t started = 0; // when, in ticks after the boot: another process may get the same pid
    std::string token;    // of this claim alone
    double lease = default_lease;
};
std::string claim_text(const ClaimHolder& holder);
ClaimHolder this_holder(double lease); // this process, with a new token

// A claim that this process holds. A thread renews it.
class Claim {
  public:
    ~Claim(); // removes it, if it is still ours
    Claim(const Claim&) = delete;
    Claim& operator=(const Claim&) = delete;

    // Whether the claim is still ours: reads it, and renews it. Call it before the output is saved.
    bool held();
    // Set when the claim is found lost, or `cancel` is set: work on the output is to end.
    const std::atomic<bool>& stop() const { return stop_; }
    bool lost() const { return lost_; }

  private:
    friend class Claims;
    Claim(std::string file, std::string text, double lease, const std::atomic<bool>& cancel);
    void renew();
    void keep(const std::stop_token& end);

    std::string file_, text_;
    double lease_;
    const std::atomic<bool>& cancel_;
    std::atomic<bool> stop_{false}, lost_{false};
    std::jthread thread_; // the last member: it reads the others
};

// Takes claims.
class Claims {
  public:
    explicit Claims(double lease = default_lease) : lease_(lease) {}

    struct Taken {
        std::unique_ptr<Claim> claim; // nullptr: another holds it
        std::string holder;           // the other: "process 12 of farm3"
        std::string
            taken_over; // from whom and why, if the claim was stale: "process 12 of farm3, which has ended"
    };
    // Does not wait. Throws InputError if a file of the claim's name is none, or the folder cannot be
    // written.
    Taken take(const std::string& output, const std::atomic<bool>& cancel);
    // Removes a stale claim on an output that is finished: its holder ended between saving and removing it.
    void remove_stale(const std::string& output);

  private:
    struct Look { // at a claim
        std::string text;
        int64_t changed = 0; // ns, of the file system
        bool is_file = false, exists = false;
    };
    struct Seen { // of a claim of another
        std::string text;
        int64_t changed = 0;
        std::chrono::steady_clock::time_point first; // seen so
    };
    struct FolderTime {
        int64_t time = 0; // ns
        std::chrono::steady_clock::time_point read;
    };
    static Look look_at(const std::string& file);
    std::string why_stale(const std::string& file, const Look& look, const ClaimHolder* holder);
    int64_t folder_now(const std::string& file);

    double lease_;
    std::map<std::string, Seen> seen_; // by name of the claim
    std::map<std::string, FolderTime> times_;
};

// Removes the claims of this process, for one that ends without unwinding; from any thread.
void remove_claims();

} // namespace marram
