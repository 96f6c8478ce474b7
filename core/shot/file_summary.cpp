// SPDX-License-Identifier: Apache-2.0
#include "core/shot/file_summary.h"
#include "core/math/file_types.h"

#include "core/image/image.h"
#include "core/read/mesh_file.h"
#include "core/read/strand_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

namespace marram {
namespace {

std::string mesh_text(const std::string& path) {
    std::vector<Problem> warnings;
    const Mesh mesh = load_mesh(path, {.smooth = false, .warnings = &warnings});
    Eigen::AlignedBox3f box;
    for (const Vec3f& position : mesh.positions) box.extend(position);
    std::string text = fmt::format(
        "mesh: {} vertices, {} triangles, {}, {}\nbounds: {}\n", mesh.positions.size(), mesh.triangles.size(),
        mesh.uvs.empty() ? "no uvs" : "uvs", mesh.normals.empty() ? "no normals" : "normals", box_text(box));
    for (const Problem& warning : warnings) text += fmt::format("note: {}\n", to_string(warning));
    return text;
}

std::string range_text(const std::vector<float>& values, const char* unit) {
    const auto [low, high] = std::ranges::minmax(values);
    return low == high ? fmt::format("{:.4g}{}", low, unit)
                       : fmt::format("{:.4g} to {:.4g}{}", low, high, unit);
}

std::string strands_text(const std::string& path) {
    const StrandFile strands = load_strand_file(path, StrandReading{});
    static constexpr std::array drawn = {"B-splines", "Catmull-Rom curves", "polylines"}; // [MarramBasis]
    size_t cvs = 0;
    for (const uint32_t count : strands.counts) cvs += count;
    const StrandSample& first = strands.samples.at(0);
    Eigen::AlignedBox3f box;
    for (const StrandSample& sample : strands.samples)
        for (const Vec3f& point : sample.points) box.extend(point);
    std::string text =
        fmt::format("strands: {} {}, {} CVs in all, {}{}\nbounds: {}\n", strands.counts.size(),
                    drawn[size_t(strands.basis)], cvs,
                    first.widths.empty() ? "no widths" : "widths " + range_text(first.widths, " m"),
                    strands.samples.size() > 1
                        ? fmt::format(", {} samples from frame {:g} to {:g}", strands.samples.size(),
                                      first.frame, strands.samples.back().frame)
                        : "",
                    box_text(box));
    for (const AttributeValues& attribute : strands.attributes)
        text += fmt::format("attribute {}: {} a {}{}\n", attribute.name, attribute.components,
                            attribute.rate == MARRAM_PER_CURVE ? "curve" : "CV",
                            attribute.discrete ? ", discrete" : "");
    for (const std::string& warning : strands.warnings) text += fmt::format("note: {}\n", warning);
    return text;
}

// A file that may hold faces or curves: as a mesh, else as strands.
std::string mesh_or_strands_text(const std::string& path) {
    try {
        return mesh_text(path);
    } catch (const InputError&) {
        const std::exception_ptr as_mesh = std::current_exception();
        try {
            return strands_text(path);
        } catch (const InputError&) {
            std::rethrow_exception(as_mesh);
        }
    }
}

std::string picture_text(const std::string& path) {
    const Image image = read_image(path, ColorSpace::raw_data);
    std::string text = fmt::format("picture: {} x {} pixels, {} channel{}\n", image.width, image.height,
                                   image.channels, image.channels > 1 ? "s" : "");
    for (int c = 0; c < image.channels; ++c) {
        std::vector<float> finite;
        const auto channels = size_t(image.channels);
        for (size_t i = size_t(c); i < image.pixels.size(); i += channels)
            if (std::isfinite(image.pixels[i])) finite.push_back(image.pixels[i]);
        const size_t others = image.pixels.size() / channels - finite.size();
        text += fmt::format("channel {}: {}{}\n", image.channel_names[size_t(c)],
                            finite.empty() ? "no finite value" : range_text(finite, ""),
                            others > 0 ? fmt::format(", {} not finite", others) : "");
    }
    constexpr size_t max_value = 80; // a line of 100 columns
    for (const auto& [key, value] : read_all_metadata(path)) {
        std::string line = value.substr(0, value.find('\n'));
        const bool whole = line.size() == value.size() && line.size() <= max_value;
        if (line.size() > max_value) line.resize(max_value);
        text += fmt::format("{}: {}{}\n", key, line, whole ? "" : " ...");
    }
    return text;
}

} // namespace

std::string box_text(const Eigen::AlignedBox3f& box) {
    if (box.isEmpty()) return "empty";
    const Vec3f size = box.sizes(), center = box.center();
    return fmt::format("{:.4g} x {:.4g} x {:.4g} m around ({:.4g}, {:.4g}, {:.4g})", size.x(), size.y(),
                       size.z(), center.x() + 0.0F, center.y() + 0.0F, center.z() + 0.0F);
}

std::string file_summary(const std::string& path) {
    const std::string extension = extension_of(path);
    const bool may_be_strands = is_one_of(extension, strand_files);
    if (is_one_of(extension, mesh_files))
        return may_be_strands ? mesh_or_strands_text(path) : mesh_text(path);
    if (may_be_strands) return strands_text(path);
    if (is_one_of(extension, image_files)) return picture_text(path);
    return "";
}

} // namespace marram
