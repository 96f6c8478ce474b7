// SPDX-License-Identifier: Apache-2.0
#include "core/view/open_scene.h"

#include "core/image/atomic_file.h"
#include "core/scene/edit.h"

#include <fmt/format.h>

#include <deque>
#include <fstream>
#include <iterator>
#include <utility>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr size_t max_history = 1000;

std::string text_of_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::string text(std::istreambuf_iterator<char>(file), {});
    if (!file) throw InputError({path}, "cannot be read", "check that it exists and that you may read it");
    return text;
}

// Whether a key, or "key=value", is that of a value or of something in it.
bool is_within(const std::string& given, const std::string& key) {
    if (!given.starts_with(key)) return false;
    const char next = given.size() > key.size() ? given[key.size()] : '=';
    return next == '=' || next == '.' || next == '[';
}

// Of a declared parameter that has one. A list of tables, which `value` is then, has none in it.
std::optional<std::string> default_of(const Shot& shot, const std::string& key, const std::string& value) {
    if (value.starts_with("[{") || value.starts_with("[ {")) return "[]";
    for (const auto& group : parameter_groups(shot, {}))
        for (const auto& param : group["params"])
            if (param["key"] == key && param["initial"] != "none" && param["initial"] != "")
                return param["initial"].get<std::string>();
    return {};
}

std::vector<std::string> settings_of(const ChangedValues& values) {
    std::vector<std::string> settings;
    for (const auto& [key, value] : values) settings.push_back(key + "=" + value);
    return settings;
}

} // namespace

OpenScene::OpenScene(std::string file, Overrides overrides, const std::atomic<bool>& stop)
    : file_(std::move(file)), overrides_(std::move(overrides)), stop_(stop) {
    stamps_[file_] = {};
}

std::vector<std::string> OpenScene::settings() const {
    std::vector<std::string> settings = overrides_.settings;
    for (std::string& setting : settings_of(changed())) settings.push_back(std::move(setting));
    return settings;
}

// A view writes no states of simulations beside the scene, unless it is told a folder.
void OpenScene::load_with(const Overrides& overrides) {
    shot_ = std::make_unique<Shot>(load_shot(file_, overrides, stop_));
    if (overrides_.state_folder.empty()) shot_->state_folder.clear();
    ++loads_;
}

void OpenScene::load() {
    stamps_ = stamps_now();
    Overrides overrides = overrides_;
    overrides.settings = settings();
    try {
        load_with(overrides);
    } catch (const InputError& error) {
        for (const Problem& problem : error.problems) { // these may be corrected, or come
            if (!problem.missing_file.empty()) stamps_.try_emplace(problem.missing_file);
            if (!problem.place.file.empty() && !problem.place.file.starts_with("--"))
                stamps_.try_emplace(problem.place.file);
        }
        const Stamps now = stamps_now();
        for (auto& [name, stamp] : stamps_)
            if (stamp == Stamps::mapped_type{}) stamp = now.at(name);
        throw;
    }
    ++revision_;
    read_stamps();
}

void OpenScene::apply(const ChangedValues& values) {
    if (!shot_) throw InputError({file_}, "the scene is not loaded", "correct its mistakes first");
    std::vector<std::string> settings = overrides_.settings;
    for (std::string& setting : settings_of(values)) settings.push_back(std::move(setting));
    if (!update_shot(*shot_, describe_scene(file_, settings, *shot_->plugins))) {
        Overrides overrides = overrides_;
        overrides.settings = settings;
        load_with(overrides);
    }
    read_stamps();
    ++revision_;
}

void OpenScene::add_state(ChangedValues values, uint64_t gesture) {
    if (values == changed()) return;
    apply(values);
    history_.resize(at_ + 1);
    if (gesture != 0 && gesture == gesture_ && at_ > 0) history_.pop_back();
    gesture_ = gesture;
    if (history_.back() != values) history_.push_back(std::move(values));
    if (history_.size() > max_history) history_.erase(history_.begin());
    at_ = history_.size() - 1;
}

void OpenScene::set(const std::string& key, const std::optional<std::string>& value, uint64_t gesture) {
    if (key.empty() || key.find('=') != std::string::npos)
        throw InputError({"--set " + key}, "this is no key", "see `marram info --keys`");
    ChangedValues values = changed();
    // What was changed within a list or table does not survive it.
    std::erase_if(values,
                  [&](const auto& other) { return is_within(other.first, key) && other.first != key; });
    if (value)
        values[key] = *value;
    else
        values.erase(key);
    add_state(std::move(values), gesture);
}

void OpenScene::undo() {
    if (!can_undo()) return;
    apply(history_[at_ - 1]);
    --at_;
    gesture_ = 0;
}

void OpenScene::redo() {
    if (!can_redo()) return;
    apply(history_[at_ + 1]);
    ++at_;
    gesture_ = 0;
}

void OpenScene::reset() { add_state({}); }

void OpenScene::save() {
    const ChangedValues settings_by_key = changed();
    const std::vector<std::string> settings = settings_of(settings_by_key);
    if (settings.empty()) return;
    if (shot_)
        describe_scene(file_, this->settings(), *shot_->plugins); // else mistakes would hide what is saved
    const std::string before = text_of_file(file_), text = edited_scene(before, file_, settings);
    AtomicFile file(file_);
    file.write(text);
    file.commit();
    stamps_[file_] = stamps_now()[file_];
    rebase_history(before);
    for (const auto& [key, value] : settings_by_key) // the file has them now
        std::erase_if(overrides_.settings, [&](const std::string& given) { return is_within(given, key); });
    apply({});
}

// Each state as changes of the file as it is now, which has those of the present one.
void OpenScene::rebase_history(const std::string& text) {
    const ChangedValues saved = changed();
    std::map<std::string, std::optional<std::string>> old;
    for (const auto& [key, value] : saved) {
        old[key] = value_in_scene(text, file_, overrides_.settings, key);
        if (!old[key] && shot_) old[key] = default_of(*shot_, key, value);
    }
    const auto rebased = [&](const ChangedValues& state) -> std::optional<ChangedValues> {
        ChangedValues now = state;
        for (const auto& [key, value] : old) {
            const auto holds = [&](const auto& one) { return is_within(key, one.first); };
            if (std::ranges::any_of(state, holds)) continue;
            if (!value) return {};
            now[key] = *value;
        }
        std::erase_if(now, [&](const auto& one) {
            const auto same = saved.find(one.first);
            const auto holds = [&](const auto& other) {
                return other.first != one.first && is_within(one.first, other.first);
            };
            return same != saved.end() && same->second == one.second && std::ranges::none_of(now, holds);
        });
        return now;
    };
    std::deque<ChangedValues> states{{}};
    size_t at = 0;
    for (size_t i = at_; i-- > 0; ++at) {
        std::optional<ChangedValues> state = rebased(history_[i]);
        if (!state) break;
        states.push_front(*std::move(state));
    }
    for (size_t i = at_ + 1; i < history_.size(); ++i) {
        std::optional<ChangedValues> state = rebased(history_[i]);
        if (!state) break;
        states.push_back(*std::move(state));
    }
    history_.assign(states.begin(), states.end());
    at_ = at;
    gesture_ = 0;
}

OpenScene::Stamps OpenScene::stamps_now() const {
    Stamps now;
    for (const auto& [name, stamp] : stamps_) {
        std::error_code error;
        const auto time = fs::last_write_time(name, error);
        const uintmax_t size = error ? 0 : fs::file_size(name, error);
        now[name] = error ? stamp : std::pair(time, size); // an editor is replacing it
    }
    return now;
}

void OpenScene::read_stamps() {
    Stamps before = std::exchange(stamps_, {});
    for (const std::string& name : files_read(*shot_, file_)) {
        const auto known = before.find(name);
        stamps_[name] = known == before.end() ? Stamps::mapped_type{} : known->second;
    }
    const Stamps now = stamps_now();
    for (auto& [name, stamp] : stamps_)
        if (!before.contains(name)) stamp = now.at(name);
}

bool OpenScene::files_changed() {
    Stamps now = stamps_now();
    const bool settled = now == std::exchange(seen_, now);
    if (now == stamps_ || !settled) return false;
    stamps_ = std::move(now);
    return true;
}

} // namespace marram
