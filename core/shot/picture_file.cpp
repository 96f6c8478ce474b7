// SPDX-License-Identifier: Apache-2.0
#include "core/shot/picture_file.h"
#include "core/math/file_types.h"

#include "core/math/problem.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace marram {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> channel_names(const FilmLayer& layer) {
    if (layer.kind == LayerKind::attribute) return attribute_channels(layer.channels);
    const auto known = std::ranges::find(built_in_layers(), layer.kind, &BuiltInLayer::kind);
    std::vector<std::string> names;
    for (const char c : known->channel_names)
        if (c != ' ') names.emplace_back(1, c);
    return names;
}

// Beauty and alpha interleaved as RGBA, as viewers expect.
std::vector<float> rgba_of(const Film& film) {
    const FilmLayer *beauty = find_layer(film, "beauty"), *alpha = find_layer(film, "alpha");
    std::vector<float> rgba(size_t(film.width) * film.height * 4);
    for (size_t i = 0; i < size_t(film.width) * film.height; ++i) {
        std::copy_n(beauty->values.data() + 3 * i, 3, rgba.data() + 4 * i);
        rgba[4 * i + 3] = alpha->values[i];
    }
    return rgba;
}

// Whether half floats can hold the picture: no value exceeds the largest half, and the mean is high enough
// (or 0) that the smallest step of a half, 2^-24, is at most 2^-14 of it.
bool fits_half(const std::vector<float>& values) {
    constexpr float greatest = 65504.0F;
    constexpr double dimmest = 0x1p-10;
    double sum = 0.0;
    for (const float v : values) {
        if (std::abs(v) > greatest) return false;
        sum += double(std::abs(v));
    }
    return sum == 0.0 || sum >= dimmest * double(values.size());
}

} // namespace

std::vector<std::string> attribute_channels(uint32_t components) {
    switch (components) {
    case 1:
        return {"Y"};
    case 2:
        return {"U", "V"};
    case 3:
        return {"X", "Y", "Z"};
    default:
        return {"R", "G", "B", "A"};
    }
}

void check_picture_name(const std::string& path) {
    const std::string extension = extension_of(path);
    if (!is_one_of(extension, picture_files))
        throw InputError({path}, "a picture cannot be written in the format '" + extension + "'",
                         "name it " + listed_files(picture_files));
}

std::string partial_name(const std::string& path) {
    const fs::path p(path);
    return (p.parent_path() / (p.stem().string() + ".partial" + p.extension().string())).string();
}

PictureLayers picture_layers(const Film& film) {
    PictureLayers picture{rgba_of(film), {}};
    picture.layers = {
        {"", {"R", "G", "B", "A"}, picture.rgba.data(), fits_half(find_layer(film, "beauty")->values)}};
    for (const FilmLayer& layer : film.layers)
        if (layer.kind != LayerKind::beauty && layer.kind != LayerKind::alpha)
            picture.layers.push_back({layer.name, channel_names(layer), layer.values.data(),
                                      layer.kind == LayerKind::albedo || layer.kind == LayerKind::normal});
    return picture;
}

void save_picture(const std::string& path, const Film& film, double exposure,
                  const std::vector<Metadata>& metadata) {
    const int width = int(film.width), height = int(film.height);
    if (extension_of(path) == ".png") {
        if (film.transparent)
            write_png(path, width, height, 4, rgba_of(film).data(), exposure, metadata);
        else
            write_png(path, width, height, 3, find_layer(film, "beauty")->values.data(), exposure, metadata);
        return;
    }
    write_exr(path, width, height, picture_layers(film).layers, metadata);
}

std::vector<Metadata> picture_metadata(const Film& film, const std::string& scene, double frame,
                                       double seconds, const std::string& digest) {
    const SampleCount samples = count_samples(film);
    return {{"Software", std::string("marram " MARRAM_VERSION)},
            {"marram:scene", scene},
            {frame_key, frame},
            {"marram:samples", int(samples.max)},
            {"marram:mean_samples", samples.mean},
            {"marram:seconds", seconds},
            {"marram:version", std::string(MARRAM_VERSION)},
            {digest_key, digest}};
}

void remove_partial(const std::string& picture) {
    std::error_code error;
    const std::string partial = partial_name(picture);
    if (fs::exists(partial, error) && read_metadata(partial, digest_key) == unfinished)
        fs::remove(partial, error);
}

void check_partial_name(const std::string& partial) {
    std::error_code error;
    if (fs::exists(partial, error) && read_metadata(partial, digest_key) != unfinished)
        throw InputError({partial}, "this file would be overwritten by an unfinished picture",
                         "move it, or choose another output");
}

} // namespace marram
