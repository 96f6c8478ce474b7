// SPDX-License-Identifier: Apache-2.0
#include "core/host/state_store.h"

#include "core/image/atomic_file.h"
#include "core/math/digest.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <utility>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view ending = ".state";

// Precedes the data. Little-endian, as are all machines that Embree runs on.
struct Header {
    std::array<char, 8> magic{'m', 'a', 'r', 'r', 'a', 'm', 'S', '1'};
    uint64_t digest = 0, frame_bits = 0, byte_count = 0, checksum = 0;
};

// Names of procedurals may contain any character.
std::string as_file_name(std::string name) {
    for (char& c : name)
        if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_') c = '_';
    return name.substr(0, 100);
}

std::optional<double> frame_of(const fs::path& file) {
    const std::string name = file.filename().string();
    if (!name.ends_with(ending)) return {};
    const char* end = name.data() + name.size() - ending.size();
    double frame = 0.0;
    const auto [at, error] = std::from_chars(name.data(), end, frame);
    if (error != std::errc() || at != end) return {};
    return frame;
}

// Empty if the file is not as it was written, with the reason in `why`.
std::optional<StoredState> read(const std::string& file, uint64_t digest, double frame, Problem& why) {
    why = {{file}, "is damaged and is left out", "remove it", "state.damaged"};
    errno = 0;
    std::ifstream in(file, std::ios::binary);
    if (!in.is_open()) {
        why = {{file},
               fmt::format("cannot be read ({}) and is left out", std::strerror(errno)),
               "check its permissions",
               "state.unreadable"};
        return {};
    }
    Header header;
    const Header expected;
    if (!in.read(reinterpret_cast<char*>(&header), sizeof header) || header.magic != expected.magic ||
        header.digest != digest || header.frame_bits != std::bit_cast<uint64_t>(frame))
        return {};
    std::error_code error;
    if (fs::file_size(file, error) != sizeof header + header.byte_count || error) return {};
    StoredState state{frame, std::vector<char>(header.byte_count)};
    if (!in.read(state.data.data(), std::streamsize(state.data.size()))) return {};
    if (digest_bytes(state.data.data(), state.data.size(), digest) != header.checksum) return {};
    return state;
}

} // namespace

StateStore::StateStore(const std::string& folder, const std::string& name, uint64_t digest)
    : digest_(digest) {
    if (!folder.empty())
        folder_ = (fs::path(folder) / fmt::format("{}-{:016x}", as_file_name(name), digest)).string();
}

std::string StateStore::file_of(double frame) const {
    return (fs::path(folder_) / fmt::format("{}{}", frame, ending)).string();
}

std::optional<StoredState> StateStore::in_memory(double frame) const {
    const auto next = memory_.upper_bound(frame);
    if (next == memory_.begin()) return {};
    return StoredState{std::prev(next)->first, std::prev(next)->second};
}

std::optional<StoredState> StateStore::load(double frame) {
    if (folder_.empty()) return in_memory(frame);
    std::error_code error;
    if (fs::is_symlink(folder_, error)) // one that came with the scene may point anywhere
        throw InputError({folder_}, "is a symbolic link, where a folder of states belongs",
                         "remove it, or name another folder with --state");
    fs::create_directories(folder_, error); // now, not after hours of simulation
    if (error)
        throw InputError({folder_}, "cannot make this folder for states: " + error.message(),
                         "name another with --state");
    std::optional<StoredState> unwritten = in_memory(frame);
    std::vector<double> frames;
    for (fs::directory_iterator it(folder_, error), end; !error && it != end; it.increment(error))
        if (const std::optional<double> found = frame_of(it->path());
            found && *found <= frame && it->path() == file_of(*found) && it->is_regular_file(error))
            frames.push_back(*found);
    std::ranges::sort(frames, std::greater<>());
    for (const double candidate : frames) {
        if (unwritten && unwritten->frame >= candidate) break;
        Problem why;
        if (std::optional<StoredState> state = read(file_of(candidate), digest_, candidate, why))
            return state;
        warnings_.push_back(std::move(why));
    }
    return unwritten;
}

void StateStore::store(double frame, const void* data, size_t byte_count) {
    const char* bytes = static_cast<const char*>(data);
    if (!folder_.empty()) {
        try {
            write(frame, data, byte_count);
            return;
        } catch (const InputError& error) { // what was computed is worth more than the file
            if (memory_.empty()) {
                Problem& warning = warnings_.emplace_back(error.problems.front());
                warning.fix += "; until it can be written, only the newest state is kept, in memory";
                warning.id = "state.unwritten";
            }
            memory_.clear();
        }
    }
    memory_[frame].assign(bytes, bytes + byte_count);
}

void StateStore::write(double frame, const void* data, size_t byte_count) const {
    AtomicFile file(file_of(frame), Links::replace);
    Header header;
    header.digest = digest_;
    header.frame_bits = std::bit_cast<uint64_t>(frame);
    header.byte_count = byte_count;
    header.checksum = digest_bytes(data, byte_count, digest_);
    file.write(&header, sizeof header);
    file.write(data, byte_count);
    file.commit();
}

std::vector<Problem> StateStore::take_warnings() { return std::exchange(warnings_, {}); }

} // namespace marram
