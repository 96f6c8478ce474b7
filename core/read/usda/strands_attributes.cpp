// SPDX-License-Identifier: Apache-2.0
#include "core/read/usda/strands_reader.h"

#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"
#include "core/read/strand_join.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

namespace marram {

Interpolation UsdaStrandsReader::interpolation_of(const UsdaPrim& prim, const UsdaAttribute& attribute,
                                                  Interpolation otherwise) const {
    const std::string_view given = prim.metadata_of(attribute.name, "interpolation");
    if (given.empty()) return otherwise;
    if (given == "constant") return Interpolation::constant;
    if (given == "uniform") return Interpolation::uniform;
    if (given == "varying" || given == "faceVarying") return Interpolation::varying;
    if (given == "vertex") return Interpolation::vertex;
    scene_.fail(
        attribute.at,
        fmt::format("the interpolation \"{}\" of \"{}\" is not known", given.substr(0, 32), attribute.name),
        "write constant, uniform, varying or vertex");
}

// USD's default if the file gives none, or else the one that their number fits.
Interpolation UsdaStrandsReader::width_interpolation(const UsdaCvs& cvs, const UsdaCurvesPrim& prim,
                                                     const UsdaAttribute& widths, std::string_view name,
                                                     size_t count) const {
    const Interpolation usual = interpolation_of(
        prim.self(), widths, name == "widths" ? Interpolation::vertex : Interpolation::constant);
    if (!prim.self().metadata_of(widths.name, "interpolation").empty()) return usual;
    for (const Interpolation one : {usual, Interpolation::constant, Interpolation::uniform,
                                    Interpolation::varying, Interpolation::vertex})
        if (count == expected(cvs, one)) return one;
    return usual;
}

size_t UsdaStrandsReader::expected(const UsdaCvs& cvs, Interpolation interpolation) const {
    switch (interpolation) {
    case Interpolation::constant:
        return 1;
    case Interpolation::uniform:
        return cvs.curve_count();
    case Interpolation::varying:
        return cvs.joint_count();
    case Interpolation::vertex:
        break;
    }
    return cvs.vertex_count();
}

Numbers UsdaStrandsReader::interpolate_to_cvs(const UsdaCvs& cvs, const Numbers& values, size_t components,
                                              Interpolation interpolation, bool discrete) const {
    if (interpolation == Interpolation::vertex) return cvs.of_vertices(values, components, discrete);
    if (interpolation == Interpolation::varying) return cvs.of_joints(values, components, discrete);
    if (interpolation == Interpolation::uniform) return cvs.of_curves(values, components);
    Numbers all;
    all.reserve(cvs.cv_count() * components);
    for (size_t cv = 0; cv < cvs.cv_count(); ++cv) all.insert(all.end(), values.begin(), values.end());
    return all;
}

// Replaces values by those that the indices select; false if there are no indices.
bool UsdaStrandsReader::expand(const UsdaPrim& prim, const UsdaAttribute& attribute, size_t components,
                               Numbers& values) const {
    const std::string name = fmt::format("{}:indices", attribute.name);
    size_t at = attribute.at;
    const auto* indices = scene_.elements<std::vector<int64_t>>(prim, name, &at);
    if (!indices) return false;
    if (counts_change_) indices = &std::get<std::vector<int64_t>>(*held(prim, name));
    Numbers expanded;
    expanded.reserve(indices->size() * components);
    const size_t count = values.size() / components;
    for (const int64_t index : *indices) {
        if (index < 0 || uint64_t(index) >= count)
            scene_.fail(at,
                        fmt::format("the index {} of \"{}\" names none of its {} values", index,
                                    attribute.name, count),
                        "export the curves anew");
        expanded.insert(expanded.end(), values.begin() + std::ptrdiff_t(size_t(index) * components),
                        values.begin() + std::ptrdiff_t((size_t(index) + 1) * components));
    }
    values = std::move(expanded);
    return true;
}

// Points, vectors and normals are transformed with their prim.
void UsdaStrandsReader::place_values(const UsdaCurvesPrim& prim, std::string_view type,
                                     Numbers& values) const {
    const bool is_point = type.starts_with("point3"), is_vector = type.starts_with("vector3"),
               is_normal = type.starts_with("normal3");
    if (!is_point && !is_vector && !is_normal) return;
    const UsdaTransform place = placing(prim.ancestors, times_.front());
    if (place == UsdaTransform::Identity()) return;
    const Eigen::Matrix3d linear = place.topLeftCorner<3, 3>();
    if (is_normal && !(std::abs(linear.determinant()) > 0.0)) return;
    const Eigen::Matrix3d across = is_normal ? Eigen::Matrix3d(linear.inverse().transpose()) : linear;
    for (size_t i = 0; i + 2 < values.size(); i += 3) {
        Eigen::Map<Vec3d> v(values.data() + i);
        const double length = v.norm();
        v = (across * v).eval();
        if (is_point) v += place.topRightCorner<3, 1>();
        if (is_normal && v.norm() > 0.0) v *= length / v.norm();
    }
}

void UsdaStrandsReader::read_attribute(const UsdaCvs& cvs, const UsdaCurvesPrim& prim,
                                       const UsdaAttribute& attribute, std::string name,
                                       Interpolation otherwise, StrandFile& part) {
    const UsdaPrim& self = prim.self();
    const auto samples = self.samples(attribute.name);
    const UsdaValue* value = held(self, attribute.name);
    if (!value) return;
    const auto left_out = [&](const std::string& why) {
        warn(fmt::format("\"{}\" of \"{}\" is left out: {}", attribute.name, prim.path, why));
    };
    Numbers values;
    AttributeValues result;
    uint64_t folded = 0;
    if (const auto* numbers = std::get_if<Numbers>(value)) {
        values = *numbers;
    } else if (const auto* whole = std::get_if<std::vector<int64_t>>(value)) {
        values.reserve(whole->size());
        for (const int64_t one : *whole) values.push_back(double(integer_to_float(one, folded)));
        result.discrete = true;
    } else {
        return left_out("it holds text");
    }
    size_t components = usda_type_width(attribute.type);
    int64_t element_size = 1;
    if (const std::string_view given = self.metadata_of(attribute.name, "elementSize"); !given.empty())
        if (parse_whole(given, 1, 4, element_size) != WholeFault::none) components = 0;
    components *= size_t(element_size);
    if (components < 1 || components > 4) return left_out("an attribute has 1 to 4 numbers");
    const Interpolation interpolation = interpolation_of(self, attribute, otherwise);
    const bool has_indices = expand(self, attribute, components, values);
    const size_t count = values.size() / components;
    if (interpolation == Interpolation::constant && count != 1 && !has_indices)
        return left_out(fmt::format("it has {} values but constant interpolation", count));
    if (count != expected(cvs, interpolation) || values.size() % components != 0)
        scene_.fail(attribute.at,
                    fmt::format("\"{}\" has {} values but its interpolation needs {}", attribute.name, count,
                                expected(cvs, interpolation)),
                    "export the curves anew");
    place_values(prim, attribute.type, values);
    if (samples.size() > 1 && !counts_change_ &&
        std::ranges::any_of(samples, [&](const auto& sample) { return *sample.second != *value; }))
        warn(fmt::format("\"{}\" of \"{}\" animates: its first sample is taken", attribute.name, prim.path));
    if (folded > 0)
        warn(fmt::format("\"{}\" of \"{}\" has {} whole numbers beyond 2^24, which no float holds: they are "
                         "folded into 24 bits, two may become one",
                         attribute.name, prim.path, folded));

    const bool per_curve =
        interpolation == Interpolation::constant || interpolation == Interpolation::uniform;
    if (name == "st" && interpolation == Interpolation::uniform && components == 2 &&
        self.find("primvars:root_uv") == nullptr)
        name = "root_uv";
    result.name = std::move(name);
    result.components = uint32_t(components);
    result.rate = per_curve ? MARRAM_PER_CURVE : MARRAM_PER_CV;
    if (interpolation == Interpolation::constant) {
        const Numbers one = values;
        values.clear();
        for (size_t c = 0; c < cvs.curve_count(); ++c) values.insert(values.end(), one.begin(), one.end());
    } else if (!per_curve) {
        values = interpolate_to_cvs(cvs, values, components, interpolation, result.discrete);
    }
    result.values.reserve(values.size());
    for (const double number : values) {
        if (!std::isfinite(float(number)))
            scene_.fail(attribute.at, fmt::format("\"{}\" is not finite", attribute.name),
                        "write finite numbers that a float holds");
        result.values.push_back(float(number));
    }
    if (part.attributes.size() == max_strand_attributes)
        scene_.fail(attribute.at,
                    fmt::format("\"{}\" has more than {} primvars", prim.path, max_strand_attributes),
                    "leave out those that nobody uses");
    part.attributes.push_back(std::move(result));
}

void UsdaStrandsReader::read_attributes(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, StrandFile& part) {
    constexpr std::string_view head = "primvars:", indices = ":indices";
    const UsdaPrim& self = prim.self();
    std::set<std::string_view> done;
    for (const UsdaAttribute& attribute : self.attributes) {
        if (!done.insert(attribute.name).second) continue; // samples and value are two statements
        if (attribute.name == "ids" && !self.find("primvars:id"))
            read_attribute(cvs, prim, attribute, "id", Interpolation::uniform, part);
        if (attribute.name == "normals" && !self.find("primvars:normals"))
            read_attribute(cvs, prim, attribute, "normal", Interpolation::vertex, part);
        if (!attribute.name.starts_with(head) || attribute.name.size() == head.size()) continue;
        const std::string_view name = attribute.name.substr(head.size());
        const bool of_another = name.ends_with(indices) &&
                                self.find(attribute.name.substr(0, attribute.name.size() - indices.size()));
        if (name == "widths" || of_another) continue;
        read_attribute(cvs, prim, attribute, name == "normals" ? "normal" : std::string(name),
                       Interpolation::constant, part);
    }
    std::set<std::string> names;
    for (const AttributeValues& attribute : part.attributes)
        if (!names.insert(attribute.name).second)
            scene_.fail(self.at,
                        fmt::format("two primvars of \"{}\" are called \"{}\"", prim.path, attribute.name),
                        "rename one");
}

} // namespace marram
