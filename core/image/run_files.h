// SPDX-License-Identifier: Apache-2.0
// A check that a run overwrites none of its own files.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace marram {

// The files of one run. No file may be both read and written, or written twice.
class RunFiles {
  public:
    explicit RunFiles(const std::vector<std::string>& read);
    void write(const std::string& file); // "": no file; throws InputError if it would overwrite another

  private:
    std::map<std::filesystem::path, std::string> known_; // by path with links resolved
};

} // namespace marram
