// SPDX-License-Identifier: Apache-2.0
// The scene that all pages see: kept open, changed value by value, with a history, taken up again when its
// files change, and saved. Only what a change touches is made anew (update_shot). Not thread-safe.
#pragma once

#include "core/shot/shot.h"
#include "core/view/scene_message.h"

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

class OpenScene {
  public:
    // `stop` is polled by loading and by the scene's procedurals; it must outlive this.
    OpenScene(std::string file, Overrides overrides, const std::atomic<bool>& stop);

    // Each of these throws InputError, which lists all mistakes, or Cancelled; the last good state then
    // stays, and the history, too. undo() and redo() do nothing at its ends. shot() may be another object
    // afterwards.
    void load(); // reads all files again
    // Without a value the key has the file's again. Successive calls with the same gesture other than 0 (one
    // drag) make one step of undo.
    void set(const std::string& key, const std::optional<std::string>& value, uint64_t gesture = 0);
    void undo();
    void redo();
    void reset(); // all values back to the file's
    // Writes the changed values into the scene file, which must be without mistakes. Undo goes on to the
    // states before, which then differ from the file; not beyond a value that the file did not have, and that
    // has no default.
    void save();

    // True once for each change: a file differs in time or size from what was read, and is as it was at the
    // previous call, so that its writer has finished. To be polled, about four times a second. A file that is
    // missing has not changed.
    bool files_changed();

    Shot* shot() { return shot_.get(); } // nullptr until a load has succeeded
    const std::string& file() const { return file_; }
    const ChangedValues& changed() const { return history_[at_]; }
    bool can_undo() const { return at_ > 0; }
    bool can_redo() const { return at_ + 1 < history_.size(); }
    std::vector<std::string> settings() const;      // of the command line and the changed ones: key=value
    uint64_t revision() const { return revision_; } // another after each change
    uint64_t loads() const { return loads_; }       // how often all objects of the shot were made anew

  private:
    using Stamps = std::map<std::string, std::pair<std::filesystem::file_time_type, uintmax_t>>; // time, size

    void add_state(ChangedValues values, uint64_t gesture = 0); // the newest of the history
    void apply(const ChangedValues& values);
    void load_with(const Overrides& overrides);
    void rebase_history(const std::string& text); // of the file before it was saved
    void read_stamps();
    Stamps stamps_now() const;

    std::string file_;
    Overrides overrides_;
    const std::atomic<bool>& stop_;
    std::unique_ptr<Shot> shot_;
    std::vector<ChangedValues> history_{{}};
    size_t at_ = 0;        // the present entry of history_
    uint64_t gesture_ = 0; // that made it
    uint64_t revision_ = 0, loads_ = 0;
    Stamps stamps_, seen_; // of the files as they were read; at the last check
};

} // namespace marram
