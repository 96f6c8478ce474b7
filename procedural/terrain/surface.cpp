// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/surface.h"

#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"

#include <array>

namespace marram {
namespace {

constexpr size_t own_attribute_count = 2; // before the masks
constexpr std::array attribute_help = {
    "thickness of the sand, m; below 0 beside sand, so that its edge lies between vertices", "steepness, deg",
    "a mask of its layers"};
// Sand thinner than a hundredth of a cell is dust: no dune ends so flat. On coarse grids, thinner than 2 cm.
constexpr double thin_slope = 0.01, thin_limit = 0.02;

bool makes_ripples(const Values& values) {
    for (int layer = 0; layer < layer_count(values); ++layer) {
        const LayerValues own(values, layer);
        if (own.text("type") == "ripples" && own.boolean("on")) return true;
    }
    return false;
}

} // namespace

void declare_attributes(TerrainInstance& instance, const Values& values) {
    instance.attribute_names = {"sand", "slope"};
    for (std::string& name : mask_names(values)) instance.attribute_names.push_back(std::move(name));
    const size_t masks_end = instance.attribute_names.size();
    if (makes_ripples(values)) {
        instance.attribute_names.emplace_back("ripples");
        instance.attribute_names.emplace_back("ripple_wave");
    }
    instance.attributes.clear();
    for (size_t a = 0; a < masks_end; ++a)
        instance.attributes.push_back({instance.attribute_names[a].c_str(), 1, MARRAM_PER_VERTEX, 0,
                                       attribute_help[std::min(a, own_attribute_count)], nullptr, 0});
    if (masks_end == instance.attribute_names.size()) return;
    instance.attributes.push_back({"ripples", 4, MARRAM_PER_VERTEX, 0,
                                   "ripples for shading: slope of the ground along x and z, fraction of "
                                   "their height, angle of repose in radians",
                                   nullptr, 0});
    instance.attributes.push_back({"ripple_wave", 4, MARRAM_PER_VERTEX, 1,
                                   "of all ripples: wavelength and height, m, where the wind goes to, "
                                   "radians from +x to +z, seed",
                                   nullptr, 0});
}

uint32_t first_ripples_attribute(const TerrainInstance& instance) {
    const size_t count = instance.attributes.size();
    return uint32_t(count > 0 && instance.attribute_names.back() == "ripple_wave" ? count - 2 : count);
}

const RipplesLayer* ripples_of(const TerrainInstance& instance) {
    for (size_t layer = instance.stack->work().size(); layer > 0; --layer)
        if (instance.stack->type(layer - 1) == "ripples")
            return static_cast<const RipplesLayer*>(&instance.stack->layer(layer - 1));
    return nullptr;
}

Vec2d gradient_at(const TerrainInstance& instance, int i, int j) {
    const Domain& d = instance.domain;
    const auto rise = [&](int i0, int j0, int i1, int j1) {
        return (double(instance.heights[d.index(i1, j1)]) - double(instance.heights[d.index(i0, j0)])) /
               (((i1 - i0) + (j1 - j0)) * d.cell);
    };
    return {rise(std::max(i - 1, 0), j, std::min(i + 1, d.nx - 1), j),
            rise(i, std::max(j - 1, 0), i, std::min(j + 1, d.nz - 1))};
}

double slope_at(const TerrainInstance& instance, int i, int j) {
    return std::atan(gradient_at(instance, i, j).norm()) / degree;
}

// The thickness of the sand, metres. Interpolation of thicknesses draws the edge of a dune as a staircase of
// cells: it ends at the first bare sample, wherever between the samples the edge is. So a bare sample beside
// sand has the value at which the interpolated thickness is 0 at the edge: the height of the surface,
// extrapolated from the sand around it, minus the rock's (exact for plane surfaces). Dust blends into it, so
// it is continuous in the thicknesses of all samples. Beyond the terrain's border there is nothing to
// extrapolate from.
double sand_at(const TerrainInstance& instance, const Fields& fields, int i, int j) {
    const Domain& d = instance.domain;
    const size_t here = d.index(i, j);
    const double thickness = sand_metres(fields.sand[here]), thin = std::min(thin_slope * d.cell, thin_limit);
    if (thickness >= thin) return thickness;
    const auto beyond_dust = [&](size_t sample) { // 0 for dust, 1 for sand of twice its thickness
        return std::clamp(sand_metres(fields.sand[sample]) / thin - 1.0, 0.0, 1.0);
    };
    constexpr double diagonal_weight = 0.5; // of a neighbour; 1 beside
    double sum = 0.0, weight_sum = 0.0;
    for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di) {
            const int i1 = i + di, j1 = j + dj, i2 = i1 + di, j2 = j1 + dj;
            if (std::min(i2, j2) < 0 || i2 >= d.nx || j2 >= d.nz) continue;
            const size_t next = d.index(i1, j1), second = d.index(i2, j2);
            const double weight = (di != 0 && dj != 0 ? diagonal_weight : 1.0) * beyond_dust(next);
            if (!(weight > 0.0)) continue;
            const double step = fields.height(next) - fields.height(second);
            const double surface = fields.height(next) + beyond_dust(second) * step;
            sum += weight * std::min(surface - double(fields.bedrock[here]), 0.0);
            weight_sum += weight;
        }
    // One whole neighbour suffices; less than that is dust, and fades.
    return thickness + (1.0 - thickness / thin) * sum / std::max(weight_sum, diagonal_weight);
}

std::vector<const float*> mask_values(const TerrainInstance& instance, const Fields& fields) {
    std::vector<const float*> values;
    for (size_t a = own_attribute_count; a < first_ripples_attribute(instance); ++a) {
        const float* found = nullptr;
        for (const MaskView& mask : fields.masks)
            if (mask.name == instance.attribute_names[a]) found = mask.values;
        values.push_back(found);
    }
    return values;
}

void write_attribute(const TerrainInstance& instance, uint32_t attribute, std::span<const uint32_t> samples,
                     float* out) {
    const Fields fields = instance.stack->fields();
    const size_t count = samples.empty() ? instance.domain.count() : samples.size();
    if (const uint32_t first = first_ripples_attribute(instance); attribute >= first) {
        const RipplesLayer& ripples = *ripples_of(instance);
        std::vector<RipplesLayer::RippleInputs> carried(count);
        if (!ripples.resolved()) ripples.carried(fields, samples, carried);
        write_ripples(ripples, attribute - first, carried, std::vector<float>(count, 1.0F), out);
        return;
    }
    const float* mask = attribute < own_attribute_count
                            ? nullptr
                            : mask_values(instance, fields)[attribute - own_attribute_count];
    const auto value = [&](size_t sample) {
        if (mask) return mask[sample];
        const int i = int(sample % size_t(instance.domain.nx)), j = int(sample / size_t(instance.domain.nx));
        return float(attribute == 0 ? sand_at(instance, fields, i, j) : slope_at(instance, i, j));
    };
    marram::parallel_for(tbb::blocked_range<size_t>(0, count, 4096), [&](const auto& range) {
        for (size_t k = range.begin(); k < range.end(); ++k) out[k] = value(samples.empty() ? k : samples[k]);
    });
}

void write_vertices(const TerrainInstance& instance, std::span<const uint32_t> samples, float* positions,
                    float* normals, float* uvs) {
    const Domain& d = instance.domain;
    const size_t count = samples.empty() ? d.count() : samples.size();
    marram::parallel_for(tbb::blocked_range<size_t>(0, count, 4096), [&](const auto& range) {
        for (size_t k = range.begin(); k < range.end(); ++k) {
            const size_t sample = samples.empty() ? k : samples[k];
            const int i = int(sample % size_t(d.nx)), j = int(sample / size_t(d.nx));
            positions[3 * k] = float(d.x(i));
            positions[3 * k + 1] = instance.heights[sample];
            positions[3 * k + 2] = float(d.z(j));
            if (normals) {
                const Vec2d gradient = gradient_at(instance, i, j);
                const Vec3f n = Vec3d(-gradient.x(), 1.0, -gradient.y()).normalized().cast<float>();
                std::copy_n(n.data(), 3, normals + 3 * k);
            }
            if (!uvs) continue;
            uvs[2 * k] = float(double(i) / (d.nx - 1));
            uvs[2 * k + 1] = float(1.0 - double(j) / (d.nz - 1));
        }
    });
}

void write_ripples(const RipplesLayer& ripples, uint32_t which,
                   std::span<const RipplesLayer::RippleInputs> carried, std::span<const float> share,
                   float* out) {
    const RipplesLayer::Settings& settings = ripples.settings();
    const std::array wave = {float(settings.ripples.wavelength), float(settings.ripples.height),
                             float(std::atan2(settings.wind.y(), settings.wind.x())),
                             float(settings.ripples.seed)};
    for (size_t k = 0; k < carried.size(); ++k) {
        const RipplesLayer::RippleInputs& at = carried[k];
        const std::array own = {at.gradient.x(), at.gradient.y(), at.strength * share[k],
                                float(settings.ripples.repose)};
        std::copy_n((which == ripples_attribute ? own : wave).data(), 4, out + 4 * k);
    }
}

} // namespace marram
