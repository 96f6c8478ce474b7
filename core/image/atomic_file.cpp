// SPDX-License-Identifier: Apache-2.0
#include "core/image/atomic_file.h"

#include "core/math/problem.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <set>

namespace marram {

namespace {

namespace fs = std::filesystem;

constexpr size_t stream_buffer_bytes = size_t(1) << 20;

// Partial files that are there now, for whoever has to end the process.
std::mutex open_lock;
std::set<std::string> open_partials;

[[noreturn]] void refuse(const std::string& path, const std::string& what, const std::string& fix) {
    throw InputError(Place{path}, what, fix);
}

// Where the bytes go: an output that is a symbolic link keeps its link, the file behind it is replaced.
fs::path resolve(const std::string& path) {
    std::error_code error;
    return fs::is_symlink(path, error) ? destination_of(path) : fs::path(path);
}

std::string partial_name(const fs::path& target) {
    fs::path name = target.stem();
    name += ".partial-" + std::to_string(::getpid());
    name += target.extension();
    return (target.parent_path() / name).string();
}

void check_folder(const std::string& path, const fs::path& target) {
    const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
    std::error_code error;
    if (!fs::exists(folder, error))
        refuse(path, "the folder \"" + folder.string() + "\" does not exist",
               "make it, or choose another output");
    if (!fs::is_directory(folder, error))
        refuse(path, "\"" + folder.string() + "\" is not a folder", "choose another output");
}

void check_existing(const std::string& path, const fs::path& target) {
    std::error_code error;
    const fs::file_status status = fs::status(target, error);
    if (!fs::exists(status)) return;
    if (fs::is_directory(status)) refuse(path, "is a folder", "give the name of a file to write");
    if (!fs::is_regular_file(status))
        refuse(path, "is not an ordinary file and cannot be replaced", "give the name of a file to write");
    if (::access(target.c_str(), W_OK) != 0)
        refuse(path, "exists and may not be written", "change its permissions, or choose another output");
}

} // namespace

fs::path destination_of(const std::string& path) {
    std::error_code error;
    fs::path at = fs::absolute(path, error);
    if (error) return path;
    constexpr int most_links = 40; // as Linux follows
    for (int links = 0; links < most_links && fs::is_symlink(at, error); ++links) {
        const fs::path next = fs::read_symlink(at, error);
        if (error) break;
        at = at.parent_path() / next;
    }
    const fs::path canonical = fs::weakly_canonical(at, error);
    return error ? at.lexically_normal() : canonical;
}

void check_writable(const std::string& path) {
    if (path.empty()) refuse("output", "no file name is given", "give the name of a file to write");
    const fs::path target = resolve(path);
    if (!target.has_filename()) refuse(path, "is a folder", "give the name of a file to write");
    check_folder(path, target);
    check_existing(path, target);
    const std::string partial = partial_name(target);
    const int file = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    if (file < 0)
        refuse(path, std::string("cannot be written (") + std::strerror(errno) + ")",
               "check the folder's permissions, or choose another output");
    ::close(file);
    ::unlink(partial.c_str());
}

AtomicFile::AtomicFile(const std::string& path) : path_(path) {
    check_writable(path);
    const fs::path target = resolve(path);
    target_ = target.string();
    partial_ = partial_name(target);
    const std::lock_guard guard(open_lock);
    open_partials.insert(partial_);
}

AtomicFile::~AtomicFile() {
    if (partial_.empty()) return;
    ::unlink(partial_.c_str());
    const std::lock_guard guard(open_lock);
    open_partials.erase(partial_);
}

void AtomicFile::commit() {
    const int file = ::open(partial_.c_str(), O_RDONLY | O_CLOEXEC);
    const bool flushed = file >= 0 && ::fsync(file) == 0;
    const int reason = errno;
    if (file >= 0) ::close(file);
    if (!flushed)
        refuse(path_, std::string("could not be written (") + std::strerror(reason) + ")",
               "check the disk and its free space");
    if (std::rename(partial_.c_str(), target_.c_str()) != 0)
        refuse(path_, std::string("could not be replaced (") + std::strerror(errno) + ")",
               "check the permissions of the file and its folder");
    const std::lock_guard guard(open_lock);
    open_partials.erase(partial_);
    partial_.clear();
}

void remove_partial_files() {
    const std::lock_guard guard(open_lock);
    for (const std::string& partial : open_partials) ::unlink(partial.c_str());
}

AtomicWriter::AtomicWriter(const std::string& path) : path_(path), file_(path) {
    stream_ = std::fopen(file_.partial().c_str(), "wbe");
    if (!stream_)
        refuse(path, std::string("cannot be written (") + std::strerror(errno) + ")",
               "check the folder's permissions, or choose another output");
    std::setvbuf(stream_, nullptr, _IOFBF, stream_buffer_bytes);
}

AtomicWriter::~AtomicWriter() {
    if (stream_) std::fclose(stream_);
}

void AtomicWriter::write(const void* bytes, size_t count) {
    if (count > 0 && std::fwrite(bytes, 1, count, stream_) != count)
        refuse(path_, std::string("could not be written (") + std::strerror(errno) + ")",
               "check the disk and its free space");
}

void AtomicWriter::commit() {
    const bool closed = std::fclose(stream_) == 0;
    const int reason = errno;
    stream_ = nullptr;
    if (!closed)
        refuse(path_, std::string("could not be written (") + std::strerror(reason) + ")",
               "check the disk and its free space");
    file_.commit();
}

} // namespace marram
