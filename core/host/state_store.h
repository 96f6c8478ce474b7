// SPDX-License-Identifier: Apache-2.0
// Stores the states of procedurals' simulations: bytes, labelled with a frame, in files that persist between
// runs.
//
// A state is one file, FOLDER/NAME-DIGEST/FRAME.state, written whole or not at all. The digest covers all
// that the state depends on: the procedural's values, its inputs, the contents of files, the library's
// version; any change starts a new folder. A damaged or unreadable file is skipped with a warning. Links are
// not followed when states are written.
#pragma once

#include "core/math/problem.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace marram {

struct StoredState {
    double frame = 0.0;
    std::vector<char> data;
};

class StateStore {
  public:
    // With folder "" nothing is written: states are kept in memory and are lost with this object.
    StateStore(const std::string& folder, const std::string& name, uint64_t digest);

    // The state with the largest frame <= `frame`; empty if there is none. Cost: reading one file, more only
    // past damaged ones. Makes the folder; throws InputError if it cannot.
    std::optional<StoredState> load(double frame);
    // A file that cannot be written is a warning: the newest such state is kept in memory.
    void store(double frame, const void* data, size_t byte_count);
    std::vector<Problem> take_warnings();

  private:
    std::string file_of(double frame) const;
    std::optional<StoredState> in_memory(double frame) const;
    void write(double frame, const void* data, size_t byte_count) const; // throws InputError

    std::string folder_; // of this digest
    uint64_t digest_;
    std::map<double, std::vector<char>>
        memory_; // with a folder: the newest state, if it could not be written
    std::vector<Problem> warnings_;
};

} // namespace marram
