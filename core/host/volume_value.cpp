// SPDX-License-Identifier: Apache-2.0
#include "core/host/volume_value.h"

#include "core/math/frame_name.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace marram {
namespace {

// Names the first of the missing frames, and counts the rest.
void check_files(const ParamValue& value, const std::vector<std::string>& files,
                 const std::vector<double>& frames) {
    std::string missing;
    size_t count = 0;
    constexpr size_t enough = 5;
    for (size_t i = 0; i < files.size(); ++i)
        if (!std::filesystem::exists(files[i]) && ++count <= enough)
            missing += fmt::format("{}{:g}", missing.empty() ? "" : ", ", frames.empty() ? 0.0 : frames[i]);
    if (count > 0)
        throw InputError(value.place,
                         fmt::format("\"{}\" has no file for {} of {} frames: {}{}", value.text, count,
                                     files.size(), missing, count > enough ? ", ..." : ""),
                         "write them, or give the frames that there are");
}

MarramGrid grid_of(const VelocityGrid& file, const char* name) {
    MarramGrid grid{};
    grid.name = name;
    grid.nx = file.counts[0], grid.ny = file.counts[1], grid.nz = file.counts[2];
    grid.components = 3;
    for (int axis = 0; axis < 3; ++axis) {
        grid.origin[axis] = file.origin[axis];
        for (int k = 0; k < 3; ++k) grid.axes[axis][k] = file.axes(k, axis);
    }
    grid.values = file.values.data();
    return grid;
}

} // namespace

std::vector<std::string> volume_files(const ParamValue& value) {
    if (value.numbers.empty()) return {value.text};
    std::vector<std::string> files;
    for (double frame = value.numbers[0]; frame <= value.numbers[1]; frame += 1.0)
        files.push_back(numbered(value.text, frame));
    return files;
}

std::shared_ptr<const VolumeValue> read_volume_value(const ParamValue& value) {
    auto made = std::make_shared<VolumeValue>();
    const std::vector<std::string> files = volume_files(value);
    if (!value.numbers.empty())
        for (size_t i = 0; i < files.size(); ++i) made->frames.push_back(value.numbers[0] + double(i));
    check_files(value, files, made->frames);
    const std::string name = value.texts.empty() ? "" : value.texts.front();
    double bytes = 0.0;
    for (const std::string& file : files) {
        made->files.push_back(read_velocities(file, name));
        const VelocityGrid& grid = *made->files.back();
        bytes += double(grid.values.size() * sizeof(float));
        if (bytes > max_volume_bytes)
            throw InputError(value.place,
                             fmt::format("\"{}\" takes more than {:g} GB after {} of {} frames", value.text,
                                         1e-9 * max_volume_bytes, made->files.size(), files.size()),
                             "resample it with larger voxels, or give fewer frames");
        if (grid.staggered != made->files.front()->staggered)
            throw InputError({file}, "is staggered and other frames are not, or the other way round",
                             "write all frames alike");
        made->grids.push_back(grid_of(grid, value.text.c_str()));
    }
    made->volume = {sizeof(MarramVolume),
                    uint32_t(made->grids.size()),
                    sizeof(MarramGrid),
                    made->grids.data(),
                    made->frames.empty() ? nullptr : made->frames.data(),
                    made->files.front()->staggered ? 1U : 0U};
    return made;
}

void VolumeValue::add_to(Digest& digest) const {
    digest.add(volume.count).add(volume.staggered).add(frames.data(), frames.size() * sizeof(double));
    for (const auto& file : files)
        digest.add(file->counts.data(), sizeof file->counts)
            .add(file->origin.data(), sizeof file->origin)
            .add(file->axes.data(), sizeof file->axes)
            .add(file->values.data(), file->values.size() * sizeof(float));
}

} // namespace marram
