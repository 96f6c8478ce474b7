// SPDX-License-Identifier: Apache-2.0
#include "core/view/value_packing.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace marram {
namespace {

using nlohmann::json;

struct RangeOfValues {
    float lower = std::numeric_limits<float>::infinity(), upper = -lower;
    void add(float value) {
        if (!std::isfinite(value)) return;
        lower = std::min(lower, value);
        upper = std::max(upper, value);
    }
    uint16_t steps(float value) const {
        const double size = double(upper) - double(lower);
        if (!(size > 0.0) || !(value > lower)) return 0; // not a number: lower
        return uint16_t(std::min((double(value) - double(lower)) / size, 1.0) * 65535.0 + 0.5);
    }
};

// The attribute with one number for each strand or CV.
const AttributeValues* values_of_strands(const CurveGeometry& curves, const std::string& name) {
    const AttributeValues* const found = find_attribute(curves.attributes, name);
    if (!found || found->components != 1) return nullptr;
    const CurveLayout layout = curves.layout();
    const uint64_t count = found->rate == MARRAM_PER_CURVE ? curves.curve_count
                           : found->rate == MARRAM_PER_CV  ? layout.vertex_count() - 2 * curves.curve_count
                                                           : 0;
    return count > 0 && found->values.size() == count ? found : nullptr;
}

// Calls use(value) for each vertex of the chosen strands first ... last - 1: those before the first and after
// the last CV repeat its value.
template <typename Use>
void each_strand_value(const CurveGeometry& curves, const StrandPart& part, const AttributeValues& values,
                       size_t first, size_t last, Use&& use) {
    const CurveLayout layout = curves.layout();
    for (size_t i = first; i < last; ++i) {
        const uint64_t strand = part.strands[i], cvs = layout.cvs(strand);
        const bool per_cv = values.rate == MARRAM_PER_CV;
        const float* const at =
            values.values.data() + (per_cv ? layout.first_vertex(strand) - 2 * strand : strand);
        for (uint64_t k = 0; k < cvs + 2; ++k) use(per_cv ? at[std::clamp<uint64_t>(k, 1, cvs) - 1] : at[0]);
    }
}

const AttributeValues* values_of_mesh(const MeshGeometry& mesh, const std::string& name) {
    const AttributeValues* const found = find_attribute(mesh.attributes, name);
    const bool fits = found && found->components == 1 && found->rate == MARRAM_PER_VERTEX &&
                      found->values.size() == mesh.positions.front().size();
    return fits ? found : nullptr;
}

} // namespace

json drawable_values(const Shot& shot) {
    json list = json::array();
    std::set<std::string> known;
    const auto add = [&](const std::string& name, const std::string& help, bool discrete) {
        if (known.insert(name).second)
            list.push_back({{"name", name}, {"help", help}, {"discrete", discrete}});
    };
    for (const auto& procedural : shot.geometry.procedurals)
        for (const MarramAttribute& a : procedural->attributes())
            if (a.components == 1 && a.name != std::string_view("id"))
                add(a.name, a.help ? a.help : "", a.discrete != 0);
    return list;
}

void add_values(const World& world, const StrandSelection& selection, const std::vector<DrawnMesh>& drawn,
                const std::string& name, WireMessage& message) {
    RangeOfValues range;
    for (size_t c = 0; c < selection.parts.size(); ++c)
        if (const AttributeValues* const values = values_of_strands(world.curves[c], name))
            each_strand_value(world.curves[c], selection.parts[c], *values, 0,
                              selection.parts[c].strands.size(), [&](float value) { range.add(value); });
    for (size_t i = 0; i < drawn.size(); ++i)
        if (const AttributeValues* const values = values_of_mesh(world.meshes[i], name))
            for (const uint32_t vertex : drawn[i].vertices) range.add(values->values[vertex]);
    if (!(range.lower <= range.upper)) range.lower = range.upper = 0.0F;
    const auto make_room = [&](size_t count) { return message.add(count * sizeof(uint16_t)); };
    const auto at = [&](size_t offset) { return reinterpret_cast<uint16_t*>(message.at(offset)); };
    for (size_t c = 0; c < selection.parts.size(); ++c) {
        const AttributeValues* const values = values_of_strands(world.curves[c], name);
        const StrandPart& part = selection.parts[c];
        for (size_t i = 0; values && i < part.chunks.size(); ++i) {
            const StrandChunk& chunk = part.chunks[i];
            const size_t offset = make_room(chunk.vertices);
            uint16_t* out = at(offset);
            each_strand_value(world.curves[c], part, *values, chunk.first, chunk.last,
                              [&](float value) { *out++ = range.steps(value); });
            message.header["parts"][c]["chunks"][i]["values"] = offset;
        }
    }
    message.header["mesh_values"] = json::array();
    for (size_t i = 0; i < drawn.size(); ++i) {
        const AttributeValues* const values = values_of_mesh(world.meshes[i], name);
        if (!values) continue;
        const size_t offset = make_room(drawn[i].vertices.size());
        std::ranges::transform(drawn[i].vertices, at(offset),
                               [&](uint32_t vertex) { return range.steps(values->values[vertex]); });
        message.header["mesh_values"].push_back({{"index", i}, {"offset", offset}});
    }
    message.header["values"] = {{"name", name}, {"lower", range.lower}, {"upper", range.upper}};
}

} // namespace marram
