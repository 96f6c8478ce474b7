// SPDX-License-Identifier: Apache-2.0
// ripples: wind ripples, crest by crest, where the grid is fine enough to hold them.
//
//     [[procedural.layer]]
//     type = "ripples"
//     wavelength = 0.11
//     height = 0.008
//
// Where. Full height up to 26 degrees, none from 30 degrees on (cosines, smooth step). In the lee none: the
// sand upwind seen under more than 15 degrees above the horizon (the shadow of Werner, "Eolian dunes:
// computer simulations and attractor interpretation", 1995) shelters wholly, below 10 degrees, five to six
// heights behind a crest, not at all. It is looked for beside the sample, by the gradient, at a distance of one wavelength, and each time an
// eighth further, up to shelter_reach; a sharp crest between two such places is seen up to 1.2 degrees too
// low. Where the sand is thinner than half the height, the trough, ripples are no higher than the sand is
// deep, so that it never goes below 0.
//
// The layer. The gradient is that of a uniform cubic B-spline whose knots are one wavelength apart, its
// points means of what is below over that length: ripples and grains of the ground do not turn ripples. At
// the terrain's edge the points go on linearly. On a slope the displacement along the normal d is d /
// cos(slope) upwards. What is added has the mean 0 but for its sampling: the volume of sand is kept to some
// thousandths of what the ripples move, not to the last unit.
//
// Coarse grids. A cell above a sixth of the wavelength cannot hold the steep side. The growth surface then stays without ripples, and
// the terrain hands out what they need to know (gradient, share of the height) as the attribute "ripples", and wavelength, height, wind and seed
// as "ripple_wave". The render mesh is cut fine near the camera (dicing.cpp) and displaced there; the material sand shades the share that is not
// displaced: the same crests, and where the one passes into the other, over the outer half of the distance, nothing shows but the shadows
// of ripples on each other, which displacement has. It ends where ripples are `displaced` pixels high. They lie on the finished
// terrain, also where layers follow.
//
// Cost: about 10 to 14 vectors of 8 packets a point, and 50 places for the shelter.
#include "procedural/terrain/ripples.h"

#include "procedural/terrain/lattice.h"
#include "procedural/terrain/shape_layer.h"

#include "core/math/hash.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {

namespace {

// One axis of the spline: knots beyond the last continue those within on a straight line.
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

// Mean height of samples around a knot, nine by nine at most; at the border as many on either side, so that
// a plane stays one.
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

// The smooth surface over a rectangle.
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
    // At the border a knot stands for others up to three knots away along each axis, half a knot of samples
    // around them.
    return std::max(5.0 * knot_ * domain_.cell, settings_.shelter_reach + 2.0 * domain_.cell);
}

// 1: free; 0: in the lee.
double RipplesLayer::shelter(const Fields& below, const Vec2d& gradient, int i, int j) const {
    constexpr double low = 0.17632698070846498, high = 0.26794919243112270; // tangents of 10 and 15 degrees
    const double own = below.height(domain_.index(i, j));
    const double length = settings_.wind.norm();
    if (!(length > 0.0)) return 1.0;
    const Vec2d back = settings_.wind / (-length * domain_.cell); // samples a metre
    double steepest = -gradient.dot(settings_.wind) / length;     // what is next to it
    for (double d = settings_.ripples.wavelength; d <= settings_.shelter_reach && steepest < high;
         d *= 1.125) {
        // Beyond the border the ground goes on as high as it is there.
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

// Share of their height that ripples have at a sample, but for what the slope leaves of it.
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
                           std::span<Carried> out) const {
    if (!(settings_.ripples.height > 0.0)) return;
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(terrain, settings_.mask);
    const Tiles all(domain_, true);
    const auto tile_of = [&](size_t sample) {
        const size_t i = sample % size_t(domain_.nx), j = sample / size_t(domain_.nx);
        return j / Tiles::side * size_t(all.columns()) + i / Tiles::side;
    };
    // Which of `samples` lie in each tile: those of tile t are order[begins[t]] ... order[begins[t + 1] - 1].
    std::vector<uint32_t> begins(size_t(all.columns()) * size_t(all.rows()) + 1, 0), order(samples.size());
    for (const uint32_t sample : samples) ++begins[tile_of(sample) + 1];
    for (size_t t = 1; t < begins.size(); ++t) begins[t] += begins[t - 1];
    std::vector<uint32_t> next(begins.begin(), begins.end() - 1);
    for (uint32_t k = 0; k < samples.size(); ++k) order[next[tile_of(samples[k])]++] = k;
    tbb::parallel_for(size_t(0), next.size(), [&](size_t t) {
        if (!samples.empty() && begins[t] == begins[t + 1]) return;
        const Rect rect = all.rect(int(t % size_t(all.columns())), int(t / size_t(all.columns())));
        const Surface surface(rect, terrain, domain_, knot_);
        const auto at = [&](int i, int j) {
            const Vec2d gradient = surface.gradient(i, j);
            return Carried{gradient.cast<float>(), float(strength(terrain, mask, gradient, i, j))};
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
    std::array<double, Tiles::side> metres, upright; // upright: metres upwards for one along the normal
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
    MarramParam{"wavelength", MARRAM_NUMBER, "m", "0.11", 1e-4, 1e6, "",
                "from crest to crest, along the surface"},
    MarramParam{"height", MARRAM_NUMBER, "m", "0.008", 0, 1e5, "", "from trough to crest; 0: none"},
    MarramParam{"repose", MARRAM_NUMBER, "deg", "34", 5, 80, "",
                "angle of repose: how far ripples on a slope turn downhill"},
    MarramParam{"shelter_reach", MARRAM_NUMBER, "m", "30", 0, 1e6, "",
                "distance in which a crest upwind shelters; 0: no lee"},
    MarramParam{
        "displaced", MARRAM_NUMBER, "px", "2", 0, 1e6, "",
        "how high ripples are on the film where displacement ends and shading goes on alone; 0: shading "
        "only",
        "8|4|2|1|0.5", "seconds.view"},
    MarramParam{"mask", MARRAM_TEXT, "", "none", 0, 0, "", "name of a mask that the height is multiplied by"},
    MarramParam{"seed", MARRAM_INTEGER, "", "0", 0, 2147483647, "", "another draw of the same ripples"},
};

std::unique_ptr<Layer> make_ripples(const LayerContext& context) {
    const LayerValues& values = context.values;
    RipplesLayer::Settings settings;
    settings.ripples.wavelength = values.number("wavelength");
    settings.ripples.height = values.number("height");
    settings.ripples.repose = values.number("repose") * degree;
    // 24 bits, so that a float attribute holds it.
    settings.ripples.seed = hash(context.seed, uint64_t(values.number("seed"))) & 0xffffffU;
    settings.displaced = values.number("displaced");
    settings.wind = context.wind;
    settings.shelter_reach = values.number("shelter_reach");
    if (values.has("mask")) settings.mask = mask_named(context, "mask");
    return std::make_unique<RipplesLayer>(settings, context.domain);
}

} // namespace

LayerType ripples_layer_type() {
    return {"ripples", "wind ripples on the sand, crest by crest", ripple_values, make_ripples};
}

} // namespace marram
