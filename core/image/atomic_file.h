// SPDX-License-Identifier: Apache-2.0
// Output files that are complete or do not exist. An AtomicFile writes to `<stem>.marram-writing-<8 hex
// digits><ext>` in the target's folder. commit() renames it over the target after every byte has reached the
// disk. A failed write never replaces an existing file.
//
// A link that a user names as output is kept, and the file that it points to is replaced. Where the program
// makes up the name itself, a link is not followed: a folder from elsewhere may hold one that points
// anywhere. The file takes its place (Links::replace).
//
// A replaced file passes on its permissions and, where the system allows it, its group.
//
// The temporary file is locked (flock) while it is open. A killed process leaves its file behind, unlocked;
// the next AtomicFile in that folder removes it. If the file system has no locks, nothing is removed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// What happens to a symbolic link of the output's name.
enum class Links { follow, replace };

// Throws InputError unless `path` can be written: its folder exists, its name is short enough, a file can be
// created next to it, and an existing file of that name is a regular, writable file. Creates and removes an
// empty file to test this. Call it before a long render.
void check_writable(const std::string& path, Links links = Links::follow);

// Throws InputError if the last part of `path` is longer than its file system allows (255 bytes on most).
void check_name_length(const std::string& path);

// The absolute path that a file of this name has or would have, with symbolic links resolved, including links
// to files that do not exist yet.
std::filesystem::path destination_of(const std::string& path);

// Removes a symbolic link of this name, not what it points to. For names that the program makes up, before
// other code writes to them.
void remove_link(const std::string& path);

// Removes the temporary files of this process. For a process that ends without unwinding; from any thread.
void remove_temporary_files();

// Makes remove_temporary_files() also call `of_library`: the same function in a library that has its own copy
// of this file.
void also_remove_temporary_files(void (*of_library)());

// A temporary file owned by this object: created, locked, and removed with it. Other code writes to it by its
// path.
class TemporaryFile {
  public:
    // In the folder of `target`, named after it. Throws InputError that names `path`.
    TemporaryFile(const std::string& path, const std::filesystem::path& target);
    ~TemporaryFile();
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;

    const std::string& name() const { return name_; }
    int descriptor() const { return descriptor_; } // open for reading and writing
    // Call once. If it throws std::system_error, the file is still temporary.
    void rename_to(const std::string& target);
    // Call it after a library has replaced the file under this name. Returns false if the file is gone.
    bool lock_again();

  private:
    std::string name_; // "" after rename_to()
    int descriptor_ = -1;
};

// Not thread-safe. A failure (full disk, quota, size limit) is stored and reported by the next write() or
// commit().
class AtomicFile {
  public:
    explicit AtomicFile(const std::string& path, Links links = Links::follow); // check_writable(path, links)
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    // Throws InputError on this or an earlier failure.
    void write(const void* bytes, size_t count);
    void write(std::string_view text) { write(text.data(), text.size()); }

    // For C libraries that write through callbacks: these always succeed, and commit() reports failures.
    void put(const void* bytes, size_t count) noexcept;
    size_t get(void* bytes, size_t count) noexcept; // reads at the current position; returns the bytes read
    void seek(int64_t position) noexcept { position_ = position; }
    int64_t position() const noexcept { return position_; }
    int64_t size() const noexcept;

    // Call once. Throws InputError if any byte did not reach the disk, and leaves the target unchanged.
    void commit();

  private:
    void flush() noexcept;
    void put_at(int64_t position, const void* bytes, size_t count) noexcept;
    void check() const;

    std::string path_;   // as given, for messages
    std::string target_; // the file to replace
    TemporaryFile file_;
    std::vector<char> buffer_; // bytes from buffer_begin_ on
    int64_t buffer_begin_ = 0;
    int64_t position_ = 0;
    int error_ = 0; // errno of the first failure
};

} // namespace marram
