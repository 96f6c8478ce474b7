// SPDX-License-Identifier: Apache-2.0
// Curves as PLY.
#include "core/math/problem.h"
#include "core/write/curve_export.h"
#include "core/write/export_name.h"
#include "core/write/export_text.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace marram {

namespace {

static_assert(std::endian::native == std::endian::little);

// An attribute of some of the geometries; 0 for the others.
struct PlyAttribute {
    std::string name;
    uint32_t components = 1;
    bool is_whole = false;
};

class PlyCurvesWriter {
  public:
    PlyCurvesWriter(const std::string& path, std::span<const CurveGeometry> curves)
        : curves_(curves), file_(path), path_(path) {}
    void write();

  private:
    void gather(MarramRate rate, std::vector<PlyAttribute>& attributes) const;
    static std::string properties(const std::vector<PlyAttribute>& attributes, std::set<std::string>& taken);
    void write_header();
    void add(float value) { row_.push_back(std::bit_cast<uint32_t>(value)); }
    void add(int32_t value) { row_.push_back(uint32_t(value)); }
    void add(const std::vector<PlyAttribute>& attributes, const CurveGeometry& geometry, size_t i);
    void end_row() {
        if (row_.size() >= row_words) flush();
    }
    void flush() {
        file_.write(row_.data(), row_.size() * sizeof(uint32_t));
        row_.clear();
    }

    static constexpr size_t row_words = size_t(1) << 14;
    std::span<const CurveGeometry> curves_;
    AtomicFile file_;
    const std::string& path_;
    std::vector<PlyAttribute> of_cvs_, of_curves_;
    bool has_normals_ = false;
    std::vector<uint32_t> row_; // every property has 4 bytes
};

bool fits_an_int(float value) { return value == std::floor(value) && value >= -0x1p31F && value < 0x1p31F; }

void PlyCurvesWriter::gather(MarramRate rate, std::vector<PlyAttribute>& attributes) const {
    for (const CurveGeometry& geometry : curves_)
        for (const AttributeValues& attribute : geometry.attributes) {
            if (attribute.rate != rate) continue;
            const bool is_whole = attribute.discrete && std::ranges::all_of(attribute.values, fits_an_int);
            const auto same = std::ranges::find(attributes, attribute.name, &PlyAttribute::name);
            if (same == attributes.end()) {
                attributes.push_back({attribute.name, attribute.components, is_whole});
                continue;
            }
            if (same->components != attribute.components)
                throw InputError({path_},
                                 fmt::format("\"{}\" has {} numbers in \"{}\", {} in curves before",
                                             attribute.name, attribute.components, geometry.name,
                                             same->components),
                                 "write .usda");
            same->is_whole = same->is_whole && is_whole;
        }
}

std::string PlyCurvesWriter::properties(const std::vector<PlyAttribute>& attributes,
                                        std::set<std::string>& taken) {
    std::string text;
    for (const PlyAttribute& attribute : attributes)
        for (uint32_t k = 0; k < attribute.components; ++k)
            text += fmt::format("property {} {}\n", attribute.is_whole ? "int" : "float",
                                unique_name(attribute.components > 1 ? fmt::format("{}_{}", attribute.name, k)
                                                                     : attribute.name,
                                            "attribute", taken));
    return text;
}

void PlyCurvesWriter::write_header() {
    uint64_t cvs = 0, strands = 0;
    for (const CurveGeometry& geometry : curves_) {
        cvs += geometry.layout().cv_count();
        strands += geometry.curve_count;
        has_normals_ = has_normals_ || (!geometry.normals.empty() && geometry.normals[0]);
    }
    if (strands > uint64_t(std::numeric_limits<int32_t>::max()))
        throw InputError({path_}, fmt::format("{} curves, .ply holds 2147483647", strands), "write .usda");
    gather(MARRAM_PER_CV, of_cvs_);
    gather(MARRAM_PER_CURVE, of_curves_);
    // Names that a reader would take for something else.
    std::set<std::string> of_vertex = {"x",         "y",        "z",  "width", "radius", "thickness",
                                       "strand_id", "curve_id", "nx", "ny",    "nz"},
                          of_strand = {"width", "radius", "thickness", "strand_id", "curve_id"};
    file_.write(fmt::format("ply\nformat binary_little_endian 1.0\ncomment baked by Marram: y up, metres\n"
                            "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
                            "property float width\nproperty int strand_id\n",
                            cvs));
    if (has_normals_) file_.write("property float nx\nproperty float ny\nproperty float nz\n");
    file_.write(properties(of_cvs_, of_vertex));
    file_.write(fmt::format("element strand {}\nproperty int strand_id\n", strands));
    file_.write(properties(of_curves_, of_strand));
    file_.write("end_header\n");
}

void PlyCurvesWriter::add(const std::vector<PlyAttribute>& attributes, const CurveGeometry& geometry,
                          size_t i) {
    for (const PlyAttribute& attribute : attributes) {
        const AttributeValues* own = find_attribute(geometry.attributes, attribute.name);
        for (uint32_t k = 0; k < attribute.components; ++k) {
            const float value = own ? own->values[i * attribute.components + k] : 0.0F;
            if (attribute.is_whole)
                add(int32_t(value));
            else
                add(value);
        }
    }
}

void PlyCurvesWriter::write() {
    write_header();
    int32_t strand = 0;
    for (const CurveGeometry& geometry : curves_) {
        const CurveLayout layout = geometry.layout();
        const bool has_normals = !geometry.normals.empty() && geometry.normals[0];
        for (uint64_t c = 0; c < geometry.curve_count; ++c, ++strand) {
            const float* cv = first_cv(geometry, c);
            for (uint32_t i = 0; i < layout.cvs(c); ++i, cv += vertex_floats) {
                for (int axis = 0; axis < 3; ++axis) add(cv[axis]);
                add(2.0F * cv[3]);
                add(strand);
                for (uint64_t k = 0; has_normals_ && k < 3; ++k)
                    add(has_normals ? geometry.normals[0][(layout.first_vertex(c) + 1 + i) * 3 + k] : 0.0F);
                add(of_cvs_, geometry, layout.first_cv(c) + i);
                end_row();
            }
        }
    }
    strand = 0;
    for (const CurveGeometry& geometry : curves_)
        for (uint64_t c = 0; c < geometry.curve_count; ++c, ++strand) {
            add(strand);
            add(of_curves_, geometry, c);
            end_row();
        }
    flush();
    file_.commit();
}

} // namespace

void write_curves_ply(const std::string& path, std::span<const CurveGeometry> curves) {
    check_curves(path, curves);
    PlyCurvesWriter(path, curves).write();
}

} // namespace marram
