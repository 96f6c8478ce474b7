// SPDX-License-Identifier: Apache-2.0
#include "core/read/velocity_file.h"

#include "core/math/problem.h"
#include "core/read/mesh_reader.h"
#include "core/read/vdb/load_library.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <mutex>

namespace marram {
namespace {

constexpr uintmax_t max_file_bytes = uintmax_t(1) << 32;

// What tells a file from what it was.
struct FileStamp {
    std::filesystem::file_time_type written;
    uintmax_t bytes = 0;
    bool operator==(const FileStamp&) const = default;
};

FileStamp stamp_of(const std::string& path) {
    std::error_code error;
    FileStamp stamp;
    stamp.written = std::filesystem::last_write_time(path, error);
    if (!error) stamp.bytes = std::filesystem::file_size(path, error);
    return error ? FileStamp{} : stamp;
}

struct KnownGrid {
    FileStamp stamp;
    std::weak_ptr<const VelocityGrid> grid;
};

} // namespace

std::shared_ptr<const VelocityGrid> read_velocities(const std::string& path, const std::string& grid) {
    static std::mutex lock;
    static std::map<std::pair<std::string, std::string>, KnownGrid> known; // by path and name
    const std::lock_guard guard(lock);
    const FileStamp stamp = stamp_of(path);
    KnownGrid& of_file = known[{path, grid}];
    if (std::shared_ptr<const VelocityGrid> still = of_file.grid.lock(); still && of_file.stamp == stamp)
        return still;
    if (stamp.bytes > max_file_bytes)
        throw InputError({path}, fmt::format("has {} bytes, the limit is {}", stamp.bytes, max_file_bytes),
                         "resample it with larger voxels, or write the velocities alone");
    std::string bytes = read_bytes(path, ".vdb");
    std::shared_ptr<const VelocityGrid> read =
        std::make_shared<const VelocityGrid>(level_set_library(path).velocities(path, grid, bytes));
    of_file = {stamp, read};
    return read;
}

} // namespace marram
