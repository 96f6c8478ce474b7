// SPDX-License-Identifier: Apache-2.0
// Output files that are whole or not there: what is written goes to `<name>.partial-<pid>.<ext>` in the same
// folder, is flushed to the disk, and takes the real name in one step. A failure on the way leaves an
// existing output as it was.
#pragma once

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>

namespace marram {

// Throws InputError unless `path` can be written: its folder exists and a file can be made in it, and what
// stands under the name, if anything, is an ordinary file that may be written. Makes and removes an empty
// file to be sure. For refusing before hours of rendering.
void check_writable(const std::string& path);

// Where a file of that name lies or would lie: absolute, symbolic links followed, also to what is not there yet.
std::filesystem::path destination_of(const std::string& path);

// Removes what unfinished AtomicFiles have written so far: for a process that is about to end without unwinding.
void remove_partial_files();

class AtomicFile {
  public:
    explicit AtomicFile(const std::string& path); // check_writable(path)
    ~AtomicFile();                                // removes the partial file unless committed
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    const std::string& partial() const { return partial_; } // where to write
    void commit();                                          // once, after the partial file has been closed

  private:
    std::string path_;   // as given, for messages
    std::string target_; // symbolic links followed
    std::string partial_;
};

// A stream of bytes into an AtomicFile. A full disk is an InputError from write() or commit().
class AtomicWriter {
  public:
    explicit AtomicWriter(const std::string& path);
    ~AtomicWriter();
    AtomicWriter(const AtomicWriter&) = delete;
    AtomicWriter& operator=(const AtomicWriter&) = delete;

    void write(const void* bytes, size_t count);
    void write(std::string_view text) { write(text.data(), text.size()); }
    void commit();

  private:
    std::string path_;
    AtomicFile file_;
    std::FILE* stream_ = nullptr;
};

} // namespace marram
