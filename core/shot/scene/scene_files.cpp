// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/scene_files.h"

#include "core/host/volume_value.h"
#include "core/math/digest.h"
#include "core/math/udim.h"
#include "core/shot/scene/scene_meshes.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <filesystem>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr size_t digest_block = size_t(4) << 20; // bytes that one task reads

// Adds the value's files, if it names any.
void add_named(const std::string& owner, const ParamValue& value, const Item* numbered_item,
               std::vector<NamedFiles>& all) {
    NamedFiles named{owner + "." + value.name, &value, NamedFileKind::single, {}};
    switch (value.spec->type) {
    case ParamType::image:
        if (has_udim(value.text)) {
            named.kind = NamedFileKind::tiles;
            for (const UdimTile& tile : udim_tiles(value.text)) named.files.push_back(tile.file);
        } else {
            named.files = {value.text};
        }
        break;
    case ParamType::file:
        if (numbered_item && value.name == "file") {
            named.kind = NamedFileKind::frames;
            for (const auto& [frame, file] : numbered_files(*numbered_item)) named.files.push_back(file);
        } else {
            named.files = {value.text};
        }
        break;
    case ParamType::table:
        named.files = {value.text};
        break;
    case ParamType::volume:
        named.kind = value.numbers.empty() ? NamedFileKind::single : NamedFileKind::frames;
        named.files = volume_files(value);
        break;
    default:
        return;
    }
    all.push_back(std::move(named));
}

// A file that is open for reading.
class InputFile {
  public:
    explicit InputFile(const std::string& path)
        : descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {}
    ~InputFile() {
        if (descriptor_ >= 0) ::close(descriptor_);
    }
    InputFile(const InputFile&) = delete;
    InputFile& operator=(const InputFile&) = delete;

    bool is_open() const { return descriptor_ >= 0; }
    // Reads up to `count` bytes at an offset; fewer at the end of the file. False: the disk fails.
    bool read(char* bytes, size_t& count, size_t offset) const {
        size_t done = 0;
        while (done < count) {
            const ssize_t more = ::pread(descriptor_, bytes + done, count - done, off_t(offset + done));
            if (more < 0 && errno == EINTR) continue;
            if (more < 0) return false;
            if (more == 0) break;
            done += size_t(more);
        }
        count = done;
        return true;
    }

  private:
    int descriptor_;
};

size_t size_of(const std::string& file) {
    std::error_code error;
    const auto size = fs::file_size(file, error);
    return error ? 0 : size_t(size);
}

struct DigestBlock {
    size_t file = 0, offset = 0;
    uint64_t digest = 0;
    bool good = false;
};

void read_block(const std::string& path, DigestBlock& block) {
    const InputFile file(path);
    if (!file.is_open()) return;
    std::vector<char> bytes(digest_block);
    size_t count = bytes.size();
    block.good = file.read(bytes.data(), count, block.offset);
    block.digest = digest_bytes(bytes.data(), count);
}

// The number of a tile is part of what it is; the rest of its name is not.
std::string digest_name(const NamedFiles& named, const std::string& file) {
    if (named.kind == NamedFileKind::single) return fs::path(file).extension().string();
    const std::string pattern = fs::path(named.value->text).filename().string();
    const std::string name = fs::path(file).filename().string();
    constexpr std::string_view marker = "<UDIM>";
    const size_t mark = pattern.rfind(marker);
    const bool is_tile = named.kind == NamedFileKind::tiles && mark < name.size();
    return is_tile ? name.substr(mark, name.size() + marker.size() - pattern.size()) : name;
}

} // namespace

std::vector<NamedFiles> named_files(const Shot& shot) {
    const SceneDescription& scene = shot.description;
    std::vector<NamedFiles> all;
    for (const auto& [kind, items] : {std::pair{"material", &scene.materials},
                                      {"mesh", &scene.meshes},
                                      {"curves", &scene.curves},
                                      {"light", &scene.lights},
                                      {"procedural", &scene.procedurals}})
        for (size_t i = 0; i < items->size(); ++i) {
            const Item& item = (*items)[i];
            if (i > 0 && !item.table_name.empty() && item.table_name == (*items)[i - 1].table_name)
                continue; // made by the same table
            const std::string owner = item.name.empty() ? fmt::format("{}[{}]", kind, i)
                                                        : fmt::format("{}.{}", kind, item.name_in_file());
            const bool numbered = item.params.has("file_frames");
            for (const ParamValue& value : item.params.all())
                add_named(owner, value, numbered ? &item : nullptr, all);
        }
    for (const ParamValue& value : scene.wind.all()) add_named("wind", value, nullptr, all);
    return all;
}

std::vector<uint64_t> content_digests(const std::vector<std::string>& files) {
    std::vector<DigestBlock> blocks;
    for (size_t i = 0; i < files.size(); ++i) {
        const size_t size = size_of(files[i]);
        for (size_t offset = 0; offset == 0 || offset < size; offset += digest_block)
            blocks.push_back({i, offset});
    }
    tbb::parallel_for(size_t(0), blocks.size(),
                      [&](size_t b) { read_block(files[blocks[b].file], blocks[b]); });
    std::vector<uint64_t> digests(files.size());
    std::vector<char> good(files.size(), true);
    for (const DigestBlock& block : blocks) {
        digests[block.file] = Digest().add(digests[block.file]).add(block.digest).value();
        good[block.file] = good[block.file] && block.good;
    }
    for (size_t i = 0; i < files.size(); ++i)
        if (!good[i]) digests[i] = 0;
    return digests;
}

uint64_t files_digest(const std::vector<NamedFiles>& all) {
    std::vector<std::string> read; // each once
    for (const NamedFiles& named : all)
        if (named.kind != NamedFileKind::frames)
            read.insert(read.end(), named.files.begin(), named.files.end());
    std::ranges::sort(read);
    read.erase(std::unique(read.begin(), read.end()), read.end());
    const std::vector<uint64_t> contents = content_digests(read);
    Digest digest;
    for (const NamedFiles& named : all)
        for (const std::string& file : named.files) {
            digest.add(digest_name(named, file));
            if (named.kind == NamedFileKind::frames) {
                std::error_code error;
                digest.add(uint64_t(size_of(file)));
                digest.add(uint64_t(fs::last_write_time(file, error).time_since_epoch().count()));
            } else {
                digest.add(contents[size_t(std::ranges::lower_bound(read, file) - read.begin())]);
            }
        }
    return digest.value();
}

} // namespace marram
