// SPDX-License-Identifier: Apache-2.0
// ripples: wind ripples, modelled crest by crest where the grid is fine enough to resolve them.
//
//     [[procedural.layer]]
//     type = "ripples"
//     wavelength = 0.11
//     height = 0.008
//
// Where. Ripples have full height on slopes up to 26 degrees and vanish from 30 degrees on (smoothstep over
// the cosine). There are none in the lee (the shadow zone of Werner, "Eolian dunes: computer simulations and
// attractor interpretation", 1995): a sample is fully sheltered if terrain upwind appears more than 15
// degrees above the horizontal, and not sheltered below 10 degrees, which is five to six heights behind a
// crest. The elevation is tested next to the sample (from the gradient), at one wavelength upwind, and then
// at distances that grow by 1/8 up to shelter_reach. A sharp crest between two tests appears up to 1.2
// degrees too low. If the sand is thinner than half the ripple height (the trough), ripples are scaled to the
// sand depth, so the thickness never becomes negative.
//
// The layer. The gradient is that of a uniform cubic B-spline with knots one wavelength apart. Its control
// points are mean heights of the terrain below over that length, so that small-scale relief does not turn the
// ripples. Beyond the terrain's edge the control points are extrapolated linearly. On a slope, a displacement
// d along the normal raises the height by d / cos(slope). The displacement has mean 0 except for sampling
// error: the sand volume is preserved to some thousandths of what the ripples move, not exactly.
//
// Coarse grids. A cell above a sixth of the wavelength cannot resolve the steep side. Then the growth surface
// has no ripples. The terrain outputs the inputs of the ripple model instead: gradient and fraction of full
// height as the attribute "ripples"; wavelength, height, wind and seed as "ripple_wave". The render mesh is
// diced near the camera (dicing.cpp) and displaced there. The material sand shades the fraction that is not
// displaced, with the same crests. Displacement fades to shading over the outer half of its range; the only
// visible difference is that displaced ripples cast shadows on each other. The range ends where ripples are
// `displaced` pixels high. Such ripples lie on the finished terrain, even if other layers follow.
//
// Cost: about 10 to 14 vectors of 8 wave packets a point, and 50 shelter tests.
#include "procedural/terrain/sand/ripples.h"

#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/mesh/lattice.h"
#include "procedural/terrain/shape_layer.h"

#include "core/math/hash.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {

namespace {

// One axis of the spline. Knots outside the grid are extrapolated linearly.
struct RippleKnot {
    int at, from;
    double share, share_from;

    RippleKnot(int knot, int last) : at(knot), from(knot), share(1.0), share_from(0.0) {
        if (knot >= 0 && knot <= last) return;
        at = knot < 0 ? 0 : last;
        from = std::clamp(knot < 0 ? -knot : 2 * last - knot, 0, last);
        share = 2.0, share_from = -1.0;
    }
};

// Mean height of at most 15 by 15 samples around a knot. The window is symmetric at the border too, so
// that planes are preserved.
double ripple_mean(const Fields& below, const Domain& domain, int knot, int a, int b) {
    const int i = a * knot, j = b * knot, half = knot / 2, step = std::max(half / 4, 1);
    const int wide = std::min({half, i, domain.nx - 1 - i}) / step,
              deep = std::min({half, j, domain.nz - 1 - j}) / step;
    double sum = 0.0;
    for (int z = -deep; z <= deep; ++z)
        for (int x = -wide; x <= wide; ++x) sum += below.height(domain.index(i + x * step, j + z * step));
    return sum / ((2.0 * wide + 1.0) * (2.0 * deep + 1.0));
}

} // namespace

// The smooth surface (B-spline) over a rectangle.
struct RipplesLayer::Surface {
    int knot, a0, b0, columns, rows;
    double by_metre;
    std::vector<double> heights;

    Surface(const Rect& rect, const Fields& below, const Domain& domain, int samples)
        : knot(samples), a0(rect.i0 / knot - 1), b0(rect.j0 / knot - 1),
          columns((rect.i1 - 1) / knot + 3 - a0), rows((rect.j1 - 1) / knot + 3 - b0),
          by_metre(1.0 / (knot * domain.cell)) {
        const int last_a = (domain.nx - 1) / knot, last_b = (domain.nz - 1) / knot;
        heights.reserve(size_t(columns) * size_t(rows));
        for (int b = b0; b < b0 + rows; ++b)
            for (int a = a0; a < a0 + columns; ++a) {
                const RippleKnot x(a, last_a), z(b, last_b);
                double height = 0.0;
                for (const auto& [at, share] : {std::pair(z.at, z.share), std::pair(z.from, z.share_from)}) {
                    if (share == 0.0) continue;
                    double row = x.share * ripple_mean(below, domain, knot, x.at, at);
                    if (x.share_from != 0.0)
                        row += x.share_from * ripple_mean(below, domain, knot, x.from, at);
                    height += share * row;
                }
                heights.push_back(height);
            }
    }

    Vec2d gradient(int i, int j) const {
        double bu[4], su[4], bv[4], sv[4];
        cubic_bspline(double(i % knot) / knot, bu, su);
        cubic_bspline(double(j % knot) / knot, bv, sv);
        const double* first =
            heights.data() + size_t(j / knot - 1 - b0) * size_t(columns) + size_t(i / knot - 1 - a0);
        Vec2d sum = Vec2d::Zero();
        for (int l = 0; l < 4; ++l, first += columns) {
            double row = 0.0, slope = 0.0;
            for (int k = 0; k < 4; ++k) row += bu[k] * first[k], slope += su[k] * first[k];
            sum += Vec2d(bv[l] * slope, sv[l] * row);
        }
        return sum * by_metre;
    }
};

RipplesLayer::RipplesLayer(const Settings& settings, const Domain& domain)
    : settings_(settings), domain_(domain), field_(settings.ripples),
      knot_(int(std::clamp(std::round(settings.ripples.wavelength / domain.cell), 1.0, 0x1p24))) {}

bool RipplesLayer::resolved(const RippleSettings& ripples, const Domain& domain) {
    return domain.cell <= ripples.wavelength / 6.0;
}

double RipplesLayer::reach() const {
    if (!resolved(settings_.ripples, domain_)) return 0.0;
    // Extrapolation at the border reads knots up to three knots away along each axis, each with half a knot
    // of samples around it.
    return std::max(5.0 * knot_ * domain_.cell, settings_.shelter_reach + 2.0 * domain_.cell);
}

// 1: exposed to the wind; 0: fully in the lee.
double RipplesLayer::shelter(const Fields& below, const Vec2d& gradient, int i, int j) const {
    constexpr double low = 0.17632698070846498, high = 0.26794919243112270; // tangents of 10 and 15 degrees
    const double own = below.height(domain_.index(i, j));
    const double length = settings_.wind.norm();
    if (!(length > 0.0)) return 1.0;
    const Vec2d back = settings_.wind / (-length * domain_.cell); // samples a metre
    double steepest = -gradient.dot(settings_.wind) / length;     // next to the sample
    for (double d = settings_.ripples.wavelength; d <= settings_.shelter_reach && steepest < high;
         d *= 1.125) {
        // Beyond the border the ground has the height of the border.
        const double x = std::clamp(i + d * back.x(), 0.0, domain_.nx - 1.0),
                     z = std::clamp(j + d * back.y(), 0.0, domain_.nz - 1.0);
        const int a = std::min(int(x), std::max(domain_.nx - 2, 0)),
                  b = std::min(int(z), std::max(domain_.nz - 2, 0));
        const size_t at = domain_.index(a, b), right = domain_.nx > 1 ? 1 : 0,
                     down = domain_.nz > 1 ? size_t(domain_.nx) : 0;
        const double near = below.height(at) + (x - a) * (below.height(at + right) - below.height(at));
        const double far =
            below.height(at + down) + (x - a) * (below.height(at + down + right) - below.height(at + down));
        steepest = std::max(steepest, (near + (z - b) * (far - near) - own) / d);
    }
    const double t = std::clamp((high - steepest) / (high - low), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// Fraction of the full ripple height at a sample, before the attenuation by slope.
double RipplesLayer::strength(const Fields& below, const float* mask, const Vec2d& gradient, int i,
                              int j) const {
    const size_t sample = domain_.index(i, j);
    const double upright = std::sqrt(1.0 + gradient.squaredNorm());
    const double depth = sand_metres(below.sand[sample]) / (0.5 * settings_.ripples.height * upright);
    double strength = std::min(depth, 1.0);
    if (mask) strength *= double(mask[sample]);
    if (strength > 0.0 && ripples_on_slope(gradient) > 0.0) strength *= shelter(below, gradient, i, j);
    return strength;
}

void RipplesLayer::carried(const Fields& terrain, std::span<const uint32_t> samples,
                           std::span<RippleInputs> out) const {
    if (!(settings_.ripples.height > 0.0)) return;
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(terrain, settings_.mask);
    const Tiles all(domain_, true);
    const auto tile_of = [&](size_t sample) {
        const size_t i = sample % size_t(domain_.nx), j = sample / size_t(domain_.nx);
        return j / Tiles::side * size_t(all.columns()) + i / Tiles::side;
    };
    // Bin `samples` by tile: indices of those in tile t are order[begins[t]] ... order[begins[t + 1] - 1].
    std::vector<uint32_t> begins(size_t(all.columns()) * size_t(all.rows()) + 1, 0), order(samples.size());
    for (const uint32_t sample : samples) ++begins[tile_of(sample) + 1];
    for (size_t t = 1; t < begins.size(); ++t) begins[t] += begins[t - 1];
    std::vector<uint32_t> next(begins.begin(), begins.end() - 1);
    for (uint32_t k = 0; k < samples.size(); ++k) order[next[tile_of(samples[k])]++] = k;
    marram::parallel_for(size_t(0), next.size(), [&](size_t t) {
        if (!samples.empty() && begins[t] == begins[t + 1]) return;
        const Rect rect = all.rect(int(t % size_t(all.columns())), int(t / size_t(all.columns())));
        const Surface surface(rect, terrain, domain_, knot_);
        const auto at = [&](int i, int j) {
            const Vec2d gradient = surface.gradient(i, j);
            return RippleInputs{gradient.cast<float>(), float(strength(terrain, mask, gradient, i, j))};
        };
        for (uint32_t k = begins[t]; k < begins[t + 1]; ++k) {
            const uint32_t sample = samples[order[k]];
            out[order[k]] = at(int(sample % uint32_t(domain_.nx)), int(sample / uint32_t(domain_.nx)));
        }
        for (int j = rect.j0; samples.empty() && j < rect.j1; ++j)
            for (int i = rect.i0; i < rect.i1; ++i) out[domain_.index(i, j)] = at(i, j);
    });
}

void RipplesLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (rect.empty()) return;
    const bool idle = !resolved(settings_.ripples, domain_) || !(settings_.ripples.height > 0.0);
    for (int j = rect.j0; idle && j < rect.j1; ++j)
        std::copy_n(below.sand + domain_.index(rect.i0, j), rect.i1 - rect.i0,
                    out.sand + domain_.index(rect.i0, j));
    if (idle) return;
    const Surface surface(rect, below, domain_, knot_);
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(below, settings_.mask);
    std::array<RipplePoint, Tiles::side> points;
    std::array<double, Tiles::side> metres, upright; // upright: height per metre along the normal
    for (int j = rect.j0; j < rect.j1; ++j)
        for (int i0 = rect.i0; i0 < rect.i1; i0 += Tiles::side) {
            const size_t count = size_t(std::min(rect.i1 - i0, Tiles::side)), row = domain_.index(i0, j);
            for (size_t k = 0; k < count; ++k) {
                const int i = i0 + int(k);
                const Vec2d gradient = surface.gradient(i, j);
                upright[k] = std::sqrt(1.0 + gradient.squaredNorm());
                points[k] = {{domain_.x(i), domain_.z(j)},
                             settings_.wind,
                             gradient,
                             strength(below, mask, gradient, i, j)};
            }
            field_.displacements({points.data(), count}, {metres.data(), count});
            for (size_t k = 0; k < count; ++k) {
                const SandUnits sand = below.sand[row + k];
                out.sand[row + k] = metres[k] == 0.0
                                        ? sand
                                        : std::max(sand + sand_units(metres[k] * upright[k]), SandUnits(0));
            }
        }
}

namespace {

constexpr std::array ripple_values = {
    param::number("wavelength", "m", "0.11", 1e-4, 1e6, "from crest to crest, along the surface"),
    param::number("height", "m", "0.008", 0, 1e5, "from trough to crest; 0: none"),
    param::number("repose", "deg", "34", 5, 80, "angle of repose: how far ripples on a slope turn downhill"),
    param::number("shelter_reach", "m", "30", 0, 1e6,
                  "how far downwind a crest shelters the sand; 0: no lee"),
    param::number("displaced", "px", "2", 0, 1e6,
                  "ripple height on the film below which ripples are shaded instead of displaced; 0: shading "
                  "only",
                  "8|4|2|1|0.5", "seconds.view"),
    param::text("mask", "none", "name of a mask that the height is multiplied by"),
    param::integer("seed", "", "0", 0, 2147483647, "random seed of the ripples"),
};

std::unique_ptr<TerrainLayer> make_ripples(const LayerContext& context) {
    const LayerValues& values = context.values;
    RipplesLayer::Settings settings;
    settings.ripples.wavelength = values.number("wavelength");
    settings.ripples.height = values.number("height");
    settings.ripples.repose = values.number("repose") * degree;
    // 24 bits: exact in a float attribute.
    settings.ripples.seed = hash(context.seed, uint64_t(values.number("seed"))) & 0xffffffU;
    settings.displaced = values.number("displaced");
    settings.wind = context.wind;
    settings.shelter_reach = values.number("shelter_reach");
    if (values.has("mask")) settings.mask = required_mask_name(context, "mask");
    return std::make_unique<RipplesLayer>(settings, context.domain);
}

} // namespace

LayerType ripples_layer_type() {
    return {"ripples", "wind ripples on the sand, crest by crest", ripple_values, make_ripples};
}

} // namespace marram
