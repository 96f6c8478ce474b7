// SPDX-License-Identifier: Apache-2.0
#include "core/shot/farm/pack.h"

#include "core/image/atomic_file.h"
#include "core/scene/edit.h"
#include "core/scene/value_text.h"
#include "core/shot/scene/scene_files.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <tuple>
#include <utility>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

// A file and its copy, relative to the packed folder.
struct PackedFile {
    std::string from, to;
    uint64_t digest = 0;
};

// The files of one value of the scene.
struct PackedValue {
    std::string key;  // to set it
    std::string name; // its new value
    std::string old;  // the path to open, of the whole sequence or of all tiles
    Place place;
    std::vector<PackedFile> files;
    bool is_library = false; // it stays as it is
};

std::string lower(std::string text) {
    std::ranges::transform(text, text.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    return text;
}

std::string name_of(const std::string& path) { return fs::path(path).filename().string(); }

std::string packed_text(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    std::string text(std::istreambuf_iterator<char>(in), {});
    if (!in) throw InputError({file}, "cannot be read", "check that it exists and that you may read it");
    return text;
}

// Gives each file a name in the packed folder. Names that differ only in case count as the same: the folder
// may go to a system that knows no difference.
class PackedNames {
  public:
    explicit PackedNames(std::string root) : root_(std::move(root)) {}

    // Sets `to` of the files, which belong together, and returns the name of all: `pattern` in their folder.
    std::string place(std::vector<PackedFile>& files, const std::string& pattern) {
        const bool alone = files.size() == 1 && name_of(files[0].from) == pattern;
        if (alone)
            if (const auto same = contents_.find(content_of(files[0])); same != contents_.end())
                return files[0].to = same->second;
        for (int i = 1;; ++i) {
            const std::string folder = i == 1 ? root_ : fmt::format("{}/{}", root_, i);
            const auto is_free = [&](const PackedFile& file) {
                const std::string to = folder + "/" + name_of(file.from);
                const auto known = taken_.find(lower(to));
                return known == taken_.end() || known->second == std::pair(to, file.digest);
            };
            if (!std::ranges::all_of(files, is_free)) continue;
            for (PackedFile& file : files) {
                file.to = folder + "/" + name_of(file.from);
                taken_[lower(file.to)] = {file.to, file.digest};
                contents_.try_emplace(content_of(file), file.to);
            }
            return folder + "/" + pattern;
        }
    }

  private:
    // Readers go by the extension, so it is part of what a file is.
    static std::tuple<uint64_t, uintmax_t, std::string> content_of(const PackedFile& file) {
        std::error_code error;
        return {file.digest, fs::file_size(file.from, error), fs::path(file.from).extension().string()};
    }

    std::string root_;
    std::map<std::string, std::pair<std::string, uint64_t>> taken_; // by path in lower case: path, digest
    std::map<std::tuple<uint64_t, uintmax_t, std::string>, std::string> contents_;
};

void check_library(const NamedFiles& named, const std::string& text, const PackRequest& request) {
    const std::string name =
        value_in_scene(text, request.scene, {}, named.key).value_or("").substr(1); // without its first quote
    std::error_code error;
    const bool beside = fs::exists(fs::path(request.scene).parent_path() / name_of(named.value->text), error);
    if (name.find_first_of("/\\") == std::string::npos && !beside) return;
    throw InputError(
        named.value->place,
        fmt::format("the scene names the library \"{}\": a library is code, and is not packed",
                    named.value->text),
        "install it where the folder goes, name its folder in MARRAM_PLUGIN_PATH, and name it in "
        "the scene without a folder");
}

// The values to change, and the files to copy. Throws InputError for files that cannot be read.
std::vector<PackedValue> packed_values(const Shot& shot, const std::string& text,
                                       const PackRequest& request) {
    std::vector<PackedValue> values;
    std::vector<std::string> all;
    for (const NamedFiles& named : named_files(shot)) {
        PackedValue value{named.key, "", named.value->text, named.value->place, {}, named.is_library()};
        const std::string before = value_in_scene(text, request.scene, {}, named.key).value_or("");
        if (before.starts_with('{')) value.key += ".file"; // of a volume
        if (value.is_library)
            check_library(named, text, request);
        else
            for (const std::string& file : named.files) value.files.push_back({file, "", 0});
        for (const PackedFile& file : value.files) all.push_back(file.from);
        values.push_back(std::move(value));
    }
    std::ranges::sort(all);
    all.erase(std::unique(all.begin(), all.end()), all.end());
    const std::vector<uint64_t> digests = content_digests(all);
    const std::string scene_name = name_of(request.scene);
    PackedNames names(scene_name == "files" ? "named_files" : "files");
    for (PackedValue& value : values) {
        for (PackedFile& file : value.files) {
            file.digest = digests[size_t(std::ranges::lower_bound(all, file.from) - all.begin())];
            if (file.digest == 0)
                throw InputError(value.place, fmt::format("the file \"{}\" cannot be read", file.from),
                                 "check that it exists and that you may read it");
        }
        if (!value.is_library) value.name = names.place(value.files, name_of(value.old));
    }
    return values;
}

bool is_unfinished(const fs::path& path) {
    return path.filename().string().find(".marram-writing-") != std::string::npos;
}

// The states that simulations have left, as files to copy.
std::vector<PackedFile> packed_states(const Shot& shot, const PackRequest& request) {
    std::vector<PackedFile> files;
    if (!request.states) return files;
    const fs::path from = shot.state_folder;
    const std::string to = name_of(default_state_folder(request.scene));
    std::error_code error;
    for (fs::recursive_directory_iterator entry(from, error), end; !error && entry != end;
         entry.increment(error))
        if (entry->is_regular_file() && !is_unfinished(entry->path()))
            files.push_back(
                {entry->path().string(), (to / entry->path().lexically_relative(from)).generic_string(), 0});
    if (files.empty())
        throw InputError({from.string()}, "there are no states of simulations",
                         "render or bake the scene first, or leave --states out");
    std::ranges::sort(files, {}, &PackedFile::from);
    std::vector<std::string> all;
    for (const PackedFile& file : files) all.push_back(file.from);
    const std::vector<uint64_t> digests = content_digests(all);
    for (size_t i = 0; i < files.size(); ++i) files[i].digest = digests[i];
    return files;
}

// The folder to make, with links resolved. Throws InputError unless it can be made.
fs::path checked_folder(const std::string& folder) {
    if (folder.empty()) throw InputError({"--output"}, "the folder has no name", "give it one");
    fs::path path = destination_of(folder);
    if (!path.has_filename()) path = path.parent_path();
    std::error_code error;
    if (fs::exists(path, error)) {
        if (!fs::is_directory(path, error))
            throw InputError({folder}, "is a file", "name a folder to be made");
        if (!fs::is_empty(path, error))
            throw InputError({folder}, "this folder is not empty", "name another, or empty it");
    } else if (!fs::is_directory(path.parent_path(), error)) {
        throw InputError({folder},
                         fmt::format("the folder \"{}\" does not exist", path.parent_path().string()),
                         "make it, or choose another output");
    }
    return path;
}

// A folder beside the one to make, removed unless it is renamed. It is locked (flock) while it is in use: a
// killed process leaves its folder behind, unlocked, and the next one that packs to the same target removes
// it, as in core/image/atomic_file.h. On a file system without such locks nothing is removed.
class PackingFolder {
  public:
    explicit PackingFolder(const fs::path& target) : target_(target) {
        remove_abandoned();
        std::error_code error;
        std::random_device random;
        do {
            path_ = target.string() + fmt::format("{}{:08x}", mark, random());
            if (lock_ >= 0) ::close(std::exchange(lock_, -1));
            if (!fs::create_directory(path_, error)) continue;
            lock_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
            if (lock_ < 0) error.assign(errno, std::generic_category());
        } while (!error && !is_locked());
        if (error) fail(target.string(), error);
    }
    ~PackingFolder() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
        ::close(lock_);
    }
    PackingFolder(const PackingFolder&) = delete;
    PackingFolder& operator=(const PackingFolder&) = delete;

    const fs::path& path() const { return path_; }

    // Replaces an empty folder of the target's name. All bytes are on the disk before.
    void rename_to_target() {
        ::syncfs(lock_);
        std::error_code error;
        fs::rename(path_, target_, error);
        if (error) fail(target_.string(), error);
        path_.clear();
    }

    [[noreturn]] static void fail(const std::string& path, const std::error_code& error) {
        throw InputError({path}, fmt::format("cannot be written ({})", error.message()),
                         "check the permissions of its folder, the disk and its free space");
    }

  private:
    static constexpr const char* mark = ".marram-packing-";

    // Not if another process is removing it. Without locks nobody does.
    bool is_locked() const {
        if (::flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
        struct stat open {
        }, named{};
        return ::fstat(lock_, &open) == 0 && ::stat(path_.c_str(), &named) == 0 &&
               open.st_dev == named.st_dev && open.st_ino == named.st_ino;
    }
    void remove_abandoned() const {
        const std::string begin = name_of(target_.string()) + mark;
        std::error_code error;
        std::vector<fs::path> found;
        for (fs::directory_iterator it(target_.parent_path(), error), end; !error && it != end;
             it.increment(error)) {
            const std::string name = it->path().filename().string();
            if (name.starts_with(begin) && name.size() == begin.size() + 8) found.push_back(it->path());
        }
        for (const fs::path& path : found) {
            const int folder = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
            if (folder < 0) continue;
            if (::flock(folder, LOCK_EX | LOCK_NB) == 0) fs::remove_all(path, error);
            ::close(folder);
        }
    }

    fs::path target_, path_;
    int lock_ = -1;
};

void copy_file(const PackedFile& file, const fs::path& folder) {
    const fs::path to = folder / file.to;
    std::error_code error;
    fs::create_directories(to.parent_path(), error);
    if (!error) fs::copy_file(file.from, to, error);
    struct stat status {};
    if (!error && ::stat(file.from.c_str(), &status) == 0) {
        const std::array<timespec, 2> times = {status.st_atim, status.st_mtim};
        (void)::utimensat(AT_FDCWD, to.c_str(), times.data(), 0);
    }
    if (error) PackingFolder::fail(to.string(), error);
}

// Reads the packed scene as the machine that gets it will, and compares its files with those that were read.
void check_packed(const std::string& scene, const fs::path& folder, const std::vector<PackedValue>& values,
                  const PackRequest& request, const std::atomic<bool>& cancel) {
    Overrides overrides;
    overrides.allowed_libraries = request.overrides.allowed_libraries;
    const Shot shot = load_shot(scene, overrides, cancel);
    const std::vector<NamedFiles> named = named_files(shot);
    const auto fail = [](const Place& place, const std::string& file) {
        throw InputError(place, fmt::format("the packed scene does not read the same file as \"{}\"", file),
                         "pack it again if the file has changed meanwhile, else report it as a defect");
    };
    for (size_t i = 0; i < values.size(); ++i) {
        const PackedValue& value = values[i];
        if (value.is_library) continue;
        if (i >= named.size() || named[i].files.size() != value.files.size()) fail(value.place, value.old);
        for (size_t k = 0; k < value.files.size(); ++k)
            if (fs::path(named[i].files[k]) != folder / value.files[k].to)
                fail(value.place, value.files[k].from);
    }
}

// The bytes on the disk are those that were read before.
void check_copies(const std::vector<PackedFile>& files, const fs::path& folder) {
    std::vector<std::string> copies;
    for (const PackedFile& file : files) copies.push_back((folder / file.to).string());
    const std::vector<uint64_t> digests = content_digests(copies);
    for (size_t i = 0; i < files.size(); ++i)
        if (digests[i] != files[i].digest)
            throw InputError({files[i].from}, "has changed while it was copied", "pack the scene again");
}

} // namespace

PackedScene pack_scene(Shot shot, const PackRequest& request, const std::atomic<bool>& cancel) {
    const fs::path target = checked_folder(request.folder);
    const std::string text =
        edited_scene(packed_text(request.scene), request.scene, request.overrides.settings);
    const std::vector<PackedValue> values = packed_values(shot, text, request);
    std::vector<PackedFile> copies = packed_states(shot, request);
    std::vector<std::string> settings;
    for (const PackedValue& value : values) {
        if (!value.is_library) settings.push_back(value.key + "=" + quoted_text(value.name));
        copies.insert(copies.end(), value.files.begin(), value.files.end());
    }
    const std::string packed = edited_scene(text, request.scene, settings);
    std::ranges::sort(copies, {}, &PackedFile::to);
    const auto stored_twice = std::ranges::unique(copies, {}, &PackedFile::to);
    copies.erase(stored_twice.begin(), stored_twice.end());
    { // the packed scene is loaded, too: the memory may be needed
        const Shot read = std::move(shot);
    }

    PackingFolder folder(target);
    tbb::parallel_for(size_t(0), copies.size(), [&](size_t i) {
        if (cancel.load()) throw Cancelled{};
        copy_file(copies[i], folder.path());
    });
    const std::string scene = (folder.path() / name_of(request.scene)).string();
    AtomicFile file(scene);
    file.write(packed);
    file.commit();
    check_copies(copies, folder.path());
    check_packed(scene, folder.path(), values, request, cancel);
    if (cancel.load()) throw Cancelled{};
    folder.rename_to_target();

    PackedScene result{(fs::path(request.folder) / name_of(request.scene)).string(), copies.size(), 0};
    std::error_code error;
    for (const PackedFile& copy : copies) result.bytes += fs::file_size(target / copy.to, error);
    return result;
}

} // namespace marram
