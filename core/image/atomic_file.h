// SPDX-License-Identifier: Apache-2.0
// Output files that are whole or not there. An AtomicFile writes to `<stem>.marram-writing-<8 hex digits><ext>` in the
// target's folder and renames it over the target in commit(), after every byte has reached the disk. A failed write never
// replaces an existing file.
//
// The temporary file is locked (flock) while it is open. A process that is killed leaves its file behind, unlocked; the
// next AtomicFile in that folder removes it. Where a file system has no locks nothing is removed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// Throws InputError unless `path` can be written: its folder exists, its name is short enough, a file can be made beside it,
// and what stands under the name, if anything, is an ordinary file that may be written. Creates and removes an empty file to
// be sure. Call it before hours of rendering.
void check_writable(const std::string& path);

// Throws InputError where the last part of `path` is longer than its file system allows (255 bytes on most).
void check_name_length(const std::string& path);

// Where a file of that name lies or would lie: absolute, symbolic links followed, also to what is not there yet.
std::filesystem::path destination_of(const std::string& path);

// Removes the temporary files of this process: for a process that is about to end without unwinding. Any thread.
void remove_temporary_files();

// From now on it also calls this: the function of that name in a library that holds a copy of this file.
void also_remove_temporary_files(void (*of_library)());

// A temporary file that is ours alone: created, locked, removed with the object. Others write to it by its path.
class TemporaryFile {
  public:
    // Beside `target`, named after it. Throws InputError, which names `path`.
    TemporaryFile(const std::string& path, const std::filesystem::path& target);
    ~TemporaryFile();
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;

    const std::string& name() const { return name_; }
    int descriptor() const { return descriptor_; } // open for reading and writing
    void
    rename_to(const std::string& target); // once; throws std::system_error, and the file is still temporary
    // After a library has replaced the file under its name. False: the file is gone.
    bool lock_again();

  private:
    std::string name_; // "" once renamed
    int descriptor_ = -1;
};

// Not thread-safe. A failure (full disk, quota, size limit) is remembered and reported by write() or commit().
class AtomicFile {
  public:
    explicit AtomicFile(const std::string& path); // check_writable(path)
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    // Throws InputError on this or an earlier failure.
    void write(const void* bytes, size_t count);
    void write(std::string_view text) { write(text.data(), text.size()); }

    // For libraries of C that write through callbacks: they are told that all went well, commit() tells the truth.
    void put(const void* bytes, size_t count) noexcept;
    size_t get(void* bytes, size_t count) noexcept; // reads at the position; how many bytes there were
    void seek(int64_t position) noexcept { position_ = position; }
    int64_t position() const noexcept { return position_; }
    int64_t size() const noexcept;

    // Once. Throws InputError where any byte did not reach the disk, and leaves the target as it was.
    void commit();

  private:
    void flush() noexcept;
    void put_at(int64_t position, const void* bytes, size_t count) noexcept;
    void check() const;

    std::string path_;   // as given, for messages
    std::string target_; // symbolic links followed
    TemporaryFile file_;
    std::vector<char> buffer_; // bytes that follow buffer_begin_
    int64_t buffer_begin_ = 0;
    int64_t position_ = 0;
    int error_ = 0; // errno of the first failure
};

} // namespace marram
