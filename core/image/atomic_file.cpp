// SPDX-License-Identifier: Apache-2.0
#include "core/image/atomic_file.h"

#include "core/math/problem.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <optional>
#include <set>
#include <system_error>

namespace marram {

namespace {

namespace fs = std::filesystem;

constexpr size_t buffer_bytes = size_t(1) << 20;
constexpr std::string_view mark = ".marram-writing-"; // followed by 8 hex digits and the target's extension
constexpr size_t mark_digits = 8;

// Temporary files of this process, for remove_temporary_files().
constinit std::mutex open_lock;
std::set<std::string> open_files;
std::atomic<void (*)()> of_library{nullptr};
std::atomic<bool> any_open{false}; // also false before `open_files` is constructed

[[noreturn]] void refuse_output(const std::string& path, const std::string& what, const std::string& fix) {
    throw InputError(Place{path}, what, fix);
}

[[noreturn]] void refuse_output(const std::string& path, const char* what, int error) {
    const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG || error == EIO;
    const char* fix = full                    ? "check the disk, its free space and your limits"
                      : error == ENAMETOOLONG ? "give it a shorter name"
                                              : "check the permissions of the file and its folder";
    refuse_output(path, std::string(what) + " (" + std::strerror(error) + ")", fix);
}

fs::path resolve(const std::string& path, Links links) {
    std::error_code error;
    return links == Links::follow && fs::is_symlink(path, error) ? destination_of(path) : fs::path(path);
}

fs::path folder_of(const fs::path& target) {
    return target.has_parent_path() ? target.parent_path() : fs::path(".");
}

size_t longest_name(const fs::path& folder) {
    const long limit = ::pathconf(folder.c_str(), _PC_NAME_MAX);
    return limit > 0 ? size_t(limit) : size_t(NAME_MAX);
}

void check_folder(const std::string& path, const fs::path& target) {
    const fs::path folder = folder_of(target);
    std::error_code error;
    if (!fs::exists(folder, error))
        refuse_output(path, "the folder \"" + folder.string() + "\" does not exist",
                      "make it, or choose another output");
    if (!fs::is_directory(folder, error))
        refuse_output(path, "\"" + folder.string() + "\" is not a folder", "choose another output");
}

void check_existing(const std::string& path, const fs::path& target) {
    std::error_code error;
    const fs::file_status status = fs::symlink_status(target, error); // a link that is left is replaced
    if (!fs::exists(status) || fs::is_symlink(status)) return;
    if (fs::is_directory(status)) refuse_output(path, "is a folder", "give the name of a file to write");
    if (!fs::is_regular_file(status))
        refuse_output(path, "is not an ordinary file and cannot be replaced",
                      "give the name of a file to write");
    if (::access(target.c_str(), W_OK) != 0)
        refuse_output(path, "exists and may not be written",
                      "change its permissions, or choose another output");
}

fs::path checked_target(const std::string& path, Links links) {
    if (path.empty()) refuse_output("output", "no file name is given", "give the name of a file to write");
    const fs::path target = resolve(path, links);
    if (!target.has_filename()) refuse_output(path, "is a folder", "give the name of a file to write");
    check_folder(path, target);
    check_name_length(path);
    check_existing(path, target);
    return target;
}

// "a.exr" -> "a.marram-writing-3f2a91c0.exr". If the name would be too long, the stem is cut, but never
// inside a UTF-8 character.
std::string temporary_name(const fs::path& target) {
    uint32_t random = 0;
    if (::getrandom(&random, sizeof random, GRND_NONBLOCK) != ssize_t(sizeof random))
        random = uint32_t(::getpid()) * 2654435761U;
    static std::atomic<uint32_t> serial{0};
    char digits[mark_digits + 1];
    std::snprintf(digits, sizeof digits, "%08x", random + serial++);
    std::string extension = target.extension().string();
    constexpr size_t longest_extension = 16; // a longer one is not a file type
    if (extension.size() > longest_extension) extension.clear();
    const std::string tail = std::string(mark) + digits + extension;
    std::string stem = target.stem().string();
    const size_t most = longest_name(folder_of(target));
    size_t keep = std::min(stem.size(), most > tail.size() ? most - tail.size() : 0);
    while (keep > 0 && keep < stem.size() && (static_cast<unsigned char>(stem[keep]) & 0xc0U) == 0x80U)
        --keep;
    return (target.parent_path() / (stem.substr(0, keep) + tail)).string();
}

bool is_temporary_name(std::string_view name) {
    const size_t at = name.rfind(mark);
    if (at == std::string_view::npos) return false;
    const std::string_view tail = name.substr(at + mark.size());
    const bool ends = tail.size() == mark_digits || (tail.size() > mark_digits && tail[mark_digits] == '.');
    return ends && tail.find('.', mark_digits + 1) == std::string_view::npos &&
           tail.substr(0, mark_digits).find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

// Permissions of the file that will be replaced; those that the umask leaves if there is none.
std::optional<struct stat> replaced_file(const std::string& target) {
    struct stat status {};
    const bool exists = ::lstat(target.c_str(), &status) == 0 && S_ISREG(status.st_mode);
    return exists ? std::optional(status) : std::nullopt;
}

// Where the group cannot be kept, another gets no more than everyone.
void keep_permissions(int descriptor, const std::string& target) {
    const std::optional<struct stat> old = replaced_file(target);
    if (!old) return;
    mode_t mode = old->st_mode & 0777U;
    struct stat now {};
    const bool same_group = ::fstat(descriptor, &now) == 0 && now.st_gid == old->st_gid;
    if (!same_group && ::fchown(descriptor, uid_t(-1), old->st_gid) != 0)
        mode &= ~mode_t(070) | ((mode & 07U) << 3U);
    (void)::fchmod(descriptor, mode); // some file systems have none
}

bool same_file(int descriptor, const std::string& name) {
    struct stat open {
    }, named{};
    return ::fstat(descriptor, &open) == 0 && ::stat(name.c_str(), &named) == 0 &&
           open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

// True if we own the file: it is locked, and its name still refers to it. On a file system without locks we
// own it as well, since no process can take it from us there.
bool claim(int descriptor, const std::string& name) {
    if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
    return same_file(descriptor, name);
}

// Removes temporary files in the folder that no process has locked.
void sweep(const fs::path& folder) {
    std::error_code error;
    std::vector<std::string> found;
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
        if (is_temporary_name(it->path().filename().string())) found.push_back(it->path().string());
    for (const std::string& name : found) {
        const int file = ::open(name.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
        if (file < 0) continue;
        if (::flock(file, LOCK_EX | LOCK_NB) == 0 && same_file(file, name)) ::unlink(name.c_str());
        ::close(file);
    }
}

} // namespace

fs::path destination_of(const std::string& path) {
    std::error_code error;
    fs::path at = fs::absolute(path, error);
    if (error) return path;
    constexpr int max_links = 40; // the limit of Linux
    for (int links = 0; links < max_links && fs::is_symlink(at, error); ++links) {
        const fs::path next = fs::read_symlink(at, error);
        if (error) break;
        at = at.parent_path() / next;
    }
    const fs::path canonical = fs::weakly_canonical(at, error);
    return error ? at.lexically_normal() : canonical;
}

void check_name_length(const std::string& path) {
    const fs::path target(path);
    const size_t most = longest_name(folder_of(target)), size = target.filename().string().size();
    if (size > most)
        refuse_output(path,
                      "the name has " + std::to_string(size) + " bytes, the limit is " + std::to_string(most),
                      "give it a shorter name");
}

void check_writable(const std::string& path, Links links) {
    const TemporaryFile file(path, checked_target(path, links));
}

void remove_link(const std::string& path) {
    std::error_code error;
    if (fs::is_symlink(path, error)) fs::remove(path, error);
}

void also_remove_temporary_files(void (*remove)()) { of_library = remove; }

void remove_temporary_files() {
    if (const auto others = of_library.load()) others();
    if (!any_open.load()) return;
    const std::unique_lock guard(open_lock, std::try_to_lock); // the crashed thread may hold the lock
    if (guard)
        for (const std::string& name : open_files) ::unlink(name.c_str());
}

TemporaryFile::TemporaryFile(const std::string& path, const fs::path& target) {
    // A name may be taken, or another process may remove the file before it is locked.
    constexpr int max_tries = 100;
    // Until it replaces a private file, it is no more open than that.
    const std::optional<struct stat> old = replaced_file(target);
    const mode_t mode = old ? (old->st_mode & 0666U) | 0600U : 0666U;
    for (int tries = 0; tries < max_tries; ++tries) {
        name_ = temporary_name(target);
        descriptor_ = ::open(name_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, mode);
        if (descriptor_ < 0 && errno == EEXIST) continue;
        if (descriptor_ < 0) refuse_output(path, "cannot be written", errno);
        if (claim(descriptor_, name_)) {
            const std::lock_guard guard(open_lock);
            open_files.insert(name_);
            any_open = true;
            return;
        }
        ::close(descriptor_);
    }
    refuse_output(path, "cannot be written", EEXIST);
}

TemporaryFile::~TemporaryFile() {
    if (!name_.empty()) {
        ::unlink(name_.c_str());
        const std::lock_guard guard(open_lock);
        open_files.erase(name_);
    }
    ::close(descriptor_);
}

void TemporaryFile::rename_to(const std::string& target) {
    keep_permissions(descriptor_, target);
    if (std::rename(name_.c_str(), target.c_str()) != 0)
        throw std::system_error(errno, std::generic_category());
    const std::lock_guard guard(open_lock);
    open_files.erase(name_);
    name_.clear();
}

bool TemporaryFile::lock_again() {
    const int file = ::open(name_.c_str(), O_RDWR | O_CLOEXEC);
    if (file < 0) return false;
    ::close(descriptor_);
    descriptor_ = file;
    return claim(descriptor_, name_);
}

AtomicFile::AtomicFile(const std::string& path, Links links)
    : path_(path), target_(checked_target(path, links).string()), file_(path, target_) {
    sweep(folder_of(target_));
    buffer_.reserve(buffer_bytes);
}

void AtomicFile::put_at(int64_t position, const void* bytes, size_t count) noexcept {
    const char* from = static_cast<const char*>(bytes);
    while (count > 0 && error_ == 0) {
        const ssize_t written = ::pwrite(file_.descriptor(), from, count, position);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) {
            error_ = written < 0 ? errno : EIO;
            return;
        }
        from += written;
        position += written;
        count -= size_t(written);
    }
}

void AtomicFile::flush() noexcept {
    put_at(buffer_begin_, buffer_.data(), buffer_.size());
    buffer_.clear();
}

void AtomicFile::put(const void* bytes, size_t count) noexcept {
    if (position_ != buffer_begin_ + int64_t(buffer_.size()) || buffer_.size() + count > buffer_bytes) {
        flush();
        buffer_begin_ = position_;
    }
    if (count > buffer_bytes) {
        put_at(position_, bytes, count);
        buffer_begin_ = position_ + int64_t(count);
    } else {
        const char* from = static_cast<const char*>(bytes);
        buffer_.insert(buffer_.end(), from, from + count); // within the reserved capacity
    }
    position_ += int64_t(count);
}

size_t AtomicFile::get(void* bytes, size_t count) noexcept {
    flush();
    buffer_begin_ = position_;
    const ssize_t read = ::pread(file_.descriptor(), bytes, count, position_);
    if (read <= 0) return 0;
    position_ += read;
    return size_t(read);
}

int64_t AtomicFile::size() const noexcept {
    struct stat status {};
    const int64_t stored = ::fstat(file_.descriptor(), &status) == 0 ? int64_t(status.st_size) : 0;
    return std::max(stored, buffer_begin_ + int64_t(buffer_.size()));
}

void AtomicFile::check() const {
    if (error_ != 0) refuse_output(path_, "could not be written", error_);
}

void AtomicFile::write(const void* bytes, size_t count) {
    put(bytes, count);
    check();
}

void AtomicFile::commit() {
    flush();
    // Network file systems, and those that delay writes, report a full disk only here.
    if (error_ == 0 && ::fsync(file_.descriptor()) != 0) error_ = errno;
    check();
    try {
        file_.rename_to(target_);
    } catch (const std::system_error& error) {
        refuse_output(path_, "could not be replaced", error.code().value());
    }
}

} // namespace marram
