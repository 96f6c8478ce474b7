// SPDX-License-Identifier: Apache-2.0
#include "core/image/picture.h"

#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <set>

namespace marram {
namespace {

// Memory for a comparison, measured with 2 x RGB in float at 1920 x 1080 and 6000 x 4000 pixels: about 200
// bytes a pixel (mostly for FLIP). Each further channel is stored in the image and in its layer, for both
// pictures, and once more while it is compared.
constexpr double bytes_a_pixel = 200.0, bytes_a_channel = 24.0, max_bytes_to_compare = 8.0 * (1 << 30);

void check_header(const std::string& path, const ImageHeader& header) {
    if (header.extent != Extent::whole)
        throw InputError({path},
                         header.extent == Extent::several ? "holds several pictures (parts or pages)"
                                                          : "has pixels that do not fill its frame exactly",
                         "save one whole picture to a file of its own");
    const double bytes = double(header.width) * header.height *
                         (bytes_a_pixel + bytes_a_channel * std::max(0, header.channels - 3));
    if (bytes > max_bytes_to_compare)
        throw InputError(
            {path},
            fmt::format("is {} x {} pixels of {} channels: comparing it would take about {:.0f} GiB "
                        "of memory, more than {:.0f}",
                        header.width, header.height, header.channels, bytes / (1 << 30),
                        max_bytes_to_compare / (1 << 30)),
            "compare it in parts, or scaled down");
}

std::string lower(std::string text) {
    for (char& c : text) c = char(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

// Prefixes of complete R, G, B triples, in upper or lower case: "" or "Beauty.".
std::set<std::string> prefixes_of_colours(const std::vector<std::string>& names) {
    std::set<std::string> lowered, prefixes;
    for (const std::string& name : names) lowered.insert(lower(name));
    for (const std::string& name : names) {
        const std::string prefix = name.substr(0, name.size() - std::min<size_t>(1, name.size()));
        const bool red = lower(name).ends_with('r') && (prefix.empty() || prefix.back() == '.');
        if (red && lower(prefix) != "variance." && lowered.contains(lower(prefix) + "g") &&
            lowered.contains(lower(prefix) + "b"))
            prefixes.insert(prefix);
    }
    return prefixes;
}

// Channel names: as in the file, except that colours (and their alpha) with other names become R, G, B, A.
std::vector<std::string> names_of(const Image& image) {
    std::vector<std::string> names = image.channel_names;
    if (names.size() == 1) return {"Y"};
    const std::set<std::string> prefixes = prefixes_of_colours(names);
    if (prefixes.empty() || (prefixes.size() > 1 && !prefixes.contains(""))) return names;
    const std::string prefix = lower(*prefixes.begin()); // "" comes first
    std::set<std::string> different;
    for (std::string& name : names) {
        for (const char* channel : {"R", "G", "B", "A"})
            if (lower(name) == prefix + lower(channel)) name = channel;
        different.insert(name);
    }
    return different.size() == names.size() ? names : image.channel_names; // both "R" and "r" exist
}

// The layers without pixels, and for each of their channels its index in the file.
struct Plan {
    std::vector<Picture::Layer> layers;
    std::vector<std::vector<size_t>> from;
};

Plan plan_of(const std::vector<std::string>& names) {
    const auto has = [&](const char* name) { return std::ranges::find(names, name) != names.end(); };
    const bool colour = has("R") && has("G") && has("B"),
               grey = names[0] == "Y" && (names.size() == 1 || (names.size() == 2 && names[1] == "A"));
    Plan plan;
    for (size_t c = 0; c < names.size(); ++c) {
        const std::string& whole = names[c];
        const size_t dot = whole.rfind('.');
        std::string name = dot == std::string::npos ? "" : whole.substr(0, dot);
        const std::string channel = dot == std::string::npos ? whole : whole.substr(dot + 1);
        // All channels without a layer name, except the colours or the grey, become layers of their own.
        const bool proper =
            colour ? channel == "R" || channel == "G" || channel == "B" : grey && channel == "Y";
        if (name.empty() && !proper) name = channel == "A" ? "alpha" : channel;
        size_t at = 0;
        while (at < plan.layers.size() && plan.layers[at].name != name) ++at;
        if (at == plan.layers.size()) {
            plan.layers.push_back({name, {}, {}});
            plan.from.emplace_back();
        }
        plan.layers[at].channels.push_back(channel);
        plan.from[at].push_back(c);
    }
    return plan;
}

void fill(Picture& picture, Plan plan, const Image& image) {
    const size_t pixels = size_t(image.width) * size_t(image.height), stride = size_t(image.channels);
    for (size_t l = 0; l < plan.layers.size(); ++l) {
        Picture::Layer& layer = plan.layers[l];
        std::vector<size_t>& from = plan.from[l];
        if (layer.name.empty() && layer.channels.size() == 1) { // grey
            from.insert(from.begin(), 2, from.front());
            layer.channels = {"R", "G", "B"};
            picture.grey = true;
        }
        layer.pixels.reserve(pixels * from.size());
        for (size_t i = 0; i < pixels; ++i)
            for (const size_t c : from) layer.pixels.push_back(image.pixels[i * stride + c]);
        // Colours first, independent of the order in the file (EXR sorts by name).
        if (layer.name.empty() || layer.name == "variance") {
            std::vector<std::string> order = layer.channels;
            const auto rank = [](const std::string& c) {
                return c == "R" ? 0 : c == "G" ? 1 : c == "B" ? 2 : 3;
            };
            std::ranges::stable_sort(order, {}, rank);
            layer.pixels = in_order(layer, order);
            layer.channels = order;
        }
    }
    picture.layers = std::move(plan.layers);
}

// The inverse of write_png(): colour under an alpha of 0, such as a sky behind strands, is stored as it is.
void multiply_by_alpha(Picture& picture) {
    const Picture::Layer* alpha = picture.find("alpha");
    if (!alpha || alpha->channels.size() != 1) return;
    for (Picture::Layer& layer : picture.layers)
        if (layer.name.empty())
            for (size_t i = 0; i < layer.pixels.size(); ++i)
                if (const float a = alpha->pixels[i / layer.channels.size()]; a > 0.0F) layer.pixels[i] *= a;
}

} // namespace

const Picture::Layer* Picture::find(const std::string& name) const {
    for (const Layer& layer : layers)
        if (layer.name == name) return &layer;
    return nullptr;
}

std::vector<float> in_order(const Picture::Layer& layer, const std::vector<std::string>& channels) {
    if (layer.channels == channels) return layer.pixels;
    std::vector<size_t> from;
    for (const std::string& channel : channels)
        from.push_back(size_t(std::ranges::find(layer.channels, channel) - layer.channels.begin()));
    std::vector<float> out(layer.pixels.size());
    for (size_t i = 0; i < out.size(); ++i)
        out[i] = layer.pixels[i / from.size() * from.size() + from[i % from.size()]];
    return out;
}

Picture read_picture(const std::string& path) {
    check_header(path, image_header(path));
    const Image image = read_image(path);
    Picture picture;
    picture.width = image.width;
    picture.height = image.height;
    picture.display = !image.as_in_file;
    picture.half = image.half;
    picture.read_as = image.read_as;
    const std::string samples = read_metadata(path, "marram:samples").value_or("0");
    std::from_chars(samples.data(), samples.data() + samples.size(),
                    picture.samples); // 0 if it is not a number
    picture.limits = read_metadata(path, "marram:limits").value_or("");
    fill(picture, plan_of(names_of(image)), image);
    if (image.straight_alpha) multiply_by_alpha(picture);
    return picture;
}

} // namespace marram
