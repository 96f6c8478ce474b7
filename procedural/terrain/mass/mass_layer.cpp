// SPDX-License-Identifier: Apache-2.0
// MassLayer: the dunes of a mass desert on a terrain's grid, and their export as scene text.
//
// Merging. Overlapping thicknesses a and b are merged by the smooth maximum of layer.h over k, with
//     1/k = 1/merge + 1/(2a) + 1/(2b)
// k goes to 0 with either thickness, so a dune changes nothing beyond its foot, and k has no crease. The
// operation is commutative but not associative: dunes are merged in order of id.
//
// Export. With `list`, `marram info SCENE` prints each dune, edits applied, as [[curves]] and a layer of type
// dune. The text can replace the layer (below [[procedural]], as TOML requires) and be edited further.
// Heights match within 1e-4 of the dune's height (curves are floats) if the ground has no sand below the
// dunes, or if they do not overlap. With sand below, drawn dunes are combined with it one by one, so overlaps
// differ: they cannot be merged with each other first. With "replace" the feet of drawn dunes do not fade.
#include "procedural/terrain/mass/mass_desert.h"

#include "core/math/digest.h"
#include "procedural/abi/parallel.h"
#include "procedural/terrain/dune/dune_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>

namespace marram {

MassLayer::Placed MassLayer::placed(const MassDune& dune) {
    Placed placed;
    placed.id = dune.id;
    placed.lower = Vec2d::Constant(infinity);
    placed.upper = -placed.lower;
    std::vector<DuneShape> arms;
    Digest digest;
    for (const std::vector<Vec2d>& crest : dune.crests) {
        DuneShape made(crest, false, dune.settings);
        if (made.empty()) continue;
        digest.add(made.digest());
        placed.lower = placed.lower.cwiseMin(made.lower());
        placed.upper = placed.upper.cwiseMax(made.upper());
        arms.push_back(std::move(made));
    }
    placed.digest = digest.value();
    placed.arms = std::make_shared<const std::vector<DuneShape>>(std::move(arms));
    return placed;
}

const MassLayer::Placed* MassLayer::same_as(const MassDune& dune) const {
    const auto found = std::ranges::lower_bound(dunes_, dune.id, {}, &MassDune::id);
    if (found == dunes_.end() || found->id != dune.id || found->crests != dune.crests ||
        !(found->settings == dune.settings))
        return nullptr;
    const auto there = std::ranges::lower_bound(placed_, dune.id, {}, &Placed::id);
    return there != placed_.end() && there->id == dune.id ? &*there : nullptr;
}

MassLayer::MassLayer(const ShapeSettings& shape, const Domain& domain, std::vector<MassDune> dunes,
                     double merge, const MassLayer* before)
    : ShapeLayer(shape), merge_(merge), dunes_(std::move(dunes)) {
    domain_ = domain;
    std::vector<Placed> all(dunes_.size());
    marram::parallel_for(size_t(0), all.size(), [&](size_t i) {
        const Placed* same = before ? before->same_as(dunes_[i]) : nullptr;
        all[i] = same ? *same : placed(dunes_[i]);
    });
    const Vec2d begin(domain.x0, domain.z0), end(domain.x(domain.nx - 1), domain.z(domain.nz - 1));
    for (Placed& placed : all)
        if ((placed.lower.array() <= end.array()).all() && (placed.upper.array() >= begin.array()).all())
            placed_.push_back(std::move(placed));
    bin();
}

// Bins dunes by tile with a counting sort; each tile lists its dunes in order of id.
void MassLayer::bin() {
    const int columns = (domain_.nx + Tiles::side - 1) / Tiles::side,
              rows = (domain_.nz + Tiles::side - 1) / Tiles::side;
    tile_begin_.assign(size_t(columns) * size_t(rows) + 1, 0);
    const double tile = Tiles::side * domain_.cell;
    const auto visit = [&](const Placed& placed, auto&& add) {
        const auto at = [&](double x, double begin, int count) {
            return int(std::clamp(std::floor((x - begin) / tile), 0.0, double(count - 1)));
        };
        for (int row = at(placed.lower.y(), domain_.z0, rows); row <= at(placed.upper.y(), domain_.z0, rows);
             ++row)
            for (int c = at(placed.lower.x(), domain_.x0, columns);
                 c <= at(placed.upper.x(), domain_.x0, columns); ++c)
                add(size_t(row) * size_t(columns) + size_t(c));
    };
    for (const Placed& placed : placed_) visit(placed, [&](size_t t) { ++tile_begin_[t + 1]; });
    std::partial_sum(tile_begin_.begin(), tile_begin_.end(), tile_begin_.begin());
    in_tile_.resize(tile_begin_.back());
    std::vector<uint32_t> next(tile_begin_.begin(), tile_begin_.end() - 1);
    for (size_t i = 0; i < placed_.size(); ++i)
        visit(placed_[i], [&](size_t t) { in_tile_[next[t]++] = uint32_t(i); });
}

bool MassLayer::touches(const Rect& rect) const {
    const int columns = (domain_.nx + Tiles::side - 1) / Tiles::side;
    for (int row = rect.j0 / Tiles::side; row <= (rect.j1 - 1) / Tiles::side; ++row)
        for (int column = rect.i0 / Tiles::side; column <= (rect.i1 - 1) / Tiles::side; ++column) {
            const size_t tile = size_t(row) * size_t(columns) + size_t(column);
            if (tile_begin_[tile] != tile_begin_[tile + 1]) return true;
        }
    return false;
}

// Merges one dune into samples [i0, i1) of row j. The row always starts at the tile's column `begin`,
// independent of i0, because the start affects the rounding of positions.
void MassLayer::add_row(const DuneShape& dune, int begin, int i0, int i1, int j, double* own) const {
    const double z = domain_.z(j);
    if (z < dune.lower().y() || z > dune.upper().y()) return;
    const auto column = [&](double x) {
        return std::clamp((x - domain_.x0) / domain_.cell, -1.0, double(domain_.nx));
    };
    const int first = std::max(begin, int(std::floor(column(dune.lower().x())))),
              end = std::min(i1, int(std::floor(column(dune.upper().x()))) + 2);
    if (first >= end || end <= i0) return;
    std::array<double, Tiles::side> height, mask;
    dune.row(domain_.x(first), z, domain_.cell, end - first, height.data(), mask.data());
    for (int i = std::max(first, i0); i < end; ++i)
        own[i - i0] = merged_thickness(own[i - i0], height[size_t(i - first)], merge_);
}

void MassLayer::shape(int i0, int i1, int j, double* own, double* share) const {
    const int columns = (domain_.nx + Tiles::side - 1) / Tiles::side;
    for (int begin = i0 / Tiles::side * Tiles::side; begin < i1; begin += Tiles::side) {
        const size_t tile = size_t(j / Tiles::side) * size_t(columns) + size_t(begin / Tiles::side);
        const int from = std::max(begin, i0), to = std::min(begin + Tiles::side, i1);
        for (uint32_t n = tile_begin_[tile]; n < tile_begin_[tile + 1]; ++n)
            for (const DuneShape& dune : *placed_[in_tile_[n]].arms)
                add_row(dune, begin, from, to, j, own + (from - i0));
    }
    // The weight is 0 where the thickness is 0. In mode "replace" it grows smoothly with the thickness, so
    // that the foot has no step.
    const bool fades = settings().mode == Combine::replace;
    const double full = fades ? settings().smooth : 0.0;
    for (int k = 0; k < i1 - i0; ++k) {
        const double t = own[k] < full ? own[k] / full : double(own[k] > 0.0);
        share[k] = t * t * (3.0 - 2.0 * t);
    }
}

std::vector<std::pair<std::string, double>> MassLayer::report() const {
    std::vector<std::pair<std::string, double>> list;
    if (!lists_) return list;
    for (const MassDune& dune : dunes_) {
        const std::string name = "dune[" + std::to_string(dune.id) + "].";
        list.emplace_back(name + "x", dune.at.x());
        list.emplace_back(name + "z", dune.at.y());
        list.emplace_back(name + "height", dune.height);
    }
    return list;
}

namespace {

// The largest distance between corresponding points of two resampled crests; infinity if their point counts
// differ.
double crests_apart(const DuneShape& a, const DuneShape& b) {
    const std::vector<Vec2d> of_a = a.crest(), of_b = b.crest();
    if (of_a.size() != of_b.size()) return infinity;
    double apart = 0.0;
    for (size_t i = 0; i < of_a.size(); ++i) apart = std::max(apart, (of_a[i] - of_b[i]).norm());
    return apart;
}

// Settings that resample a crest with float points, as in a scene, at the same places. Crests are close to a
// whole number of spacings long, so rounding could add or drop a point; a tiny change of the spacing prevents
// this.
DuneSettings settings_of_drawn(const std::vector<Vec2d>& crest, const DuneSettings& settings) {
    const DuneShape own(crest, false, settings);
    std::vector<Vec2d> floats;
    for (const Vec2d& p : crest) floats.push_back(p.cast<float>().cast<double>());
    DuneSettings best = settings;
    double nearest = infinity;
    for (const double change : {0.0, -1e-6, 1e-6, -1e-5, 1e-5, -1e-4, 1e-4}) {
        DuneSettings tried = settings;
        tried.search_accuracy = std::max(settings.search_accuracy * (1.0 + change), 1.0);
        tried.smoothing = settings.smoothing / (1.0 + change);
        const double apart = crests_apart(own, DuneShape(floats, false, tried));
        if (apart < nearest) best = tried, nearest = apart;
    }
    // In this layer the mask is 1 on the whole dune, even where a stretched slope extends beyond the foot.
    // Match that.
    best.mask_fall_off = Ramp();
    best.max_dist = own.reach();
    return best;
}

} // namespace

std::string MassLayer::described(size_t index, const Fields& below) const {
    std::string text;
    if (!lists_) return text;
    // On ground without sand all modes except "replace" keep the merged thickness of the dunes.
    bool bare = !settings().bedrock && settings().mode != Combine::replace;
    for (size_t sample = 0; bare && sample < domain_.count(); ++sample) bare = below.sand[sample] == 0;
    constexpr const char* modes[] = {"add", "maximum", "replace", "smooth_maximum"}; // [Combine]
    const char* mode = bare ? "smooth_maximum" : modes[size_t(settings().mode)];
    const char* target = settings().bedrock ? "bedrock" : settings().level ? "level" : "sand";
    for (const MassDune& dune : dunes_)
        for (size_t arm = 0; arm < dune.crests.size(); ++arm) {
            const std::string name = fmt::format("dune_{}_{}_{}", index, dune.id, arm);
            std::string points;
            for (size_t line = 0; const Vec2d& p : dune.crests[arm]) { // lines of at most 100 columns
                constexpr size_t max_columns = 98, head = 10;          // head: "points = ["
                const std::string point = fmt::format("[{}, 0, {}]", p.x(), p.y());
                const bool breaks = !points.empty() && line + point.size() > max_columns;
                points += (points.empty() ? "" : breaks ? ",\n    " : ", ") + point;
                line = (points.size() == point.size() ? head : breaks ? 4 : line + 2) + point.size();
            }
            DuneSettings drawn = settings_of_drawn(dune.crests[arm], dune.settings);
            if (settings().mode == Combine::replace)
                drawn.max_dist = 0.0; // otherwise it would replace sand beyond the foot
            text += fmt::format("\n# {} {} at {:.6g}, {:.6g}\n[[curves]]\nname = \"{}\"\ntype = \"points\"\n"
                                "points = [{}]\n\n[[procedural.layer]]\ntype = \"dune\"\nalong = \"{}\"\n{}",
                                mass_kind_name(dune.kind), dune.id, dune.at.x(), dune.at.y(), name, points,
                                name, dune_text(drawn, dune.noise_seed));
            text += fmt::format("target = \"{}\"\ncombine = \"{}\"\nsmooth = {}\n", target, mode,
                                bare ? merge_ : settings().smooth);
            if (!settings().mask.empty()) text += fmt::format("mask = \"{}\"\n", settings().mask);
        }
    return text;
}

Tiles MassLayer::changed_since(const TerrainLayer& before, const Domain& domain) const {
    const auto* old = dynamic_cast<const MassLayer*>(&before);
    if (!old || old->merge_ != merge_ || !(old->settings() == settings()) || !(old->domain_ == domain_))
        return Tiles(domain, true);
    Tiles tiles(domain);
    auto now = placed_.begin(), then = old->placed_.begin();
    const auto add = [&](const Placed& placed) { tiles.add_box(placed.lower, placed.upper); };
    while (now != placed_.end() || then != old->placed_.end()) {
        const bool only_now = then == old->placed_.end() || (now != placed_.end() && now->id < then->id);
        const bool only_then = now == placed_.end() || (then != old->placed_.end() && then->id < now->id);
        if (only_now) {
            add(*now++);
        } else if (only_then) {
            add(*then++);
        } else {
            if (now->digest != then->digest) add(*now), add(*then);
            ++now, ++then;
        }
    }
    return tiles;
}

} // namespace marram
