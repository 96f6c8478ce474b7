// SPDX-License-Identifier: Apache-2.0
// dune: a dune along each curve that `along` names. The shape is described in dune_shape.cpp; this file makes
// it a layer.
//
// A dune's height is a thickness of sand (or of bedrock, see `target`) and is combined with the layers below
// by `combine`. Dunes of one layer that meet are joined by a smooth maximum over `smooth` metres. The layer's
// share is the dune's mask, which falls off from the crest over `max_dist`. Outside the dune the share is 0
// and nothing changes.
//
// With `attributes` the layer outputs masks named after the layer: NAME.mask, NAME.outer and NAME.inner
// (windward slope and slip face), NAME.dist (metres to the crest), NAME.dir_x and NAME.dir_z (unit vector
// towards the crest).
//
//     [[curves]]
//     name = "ridge"
//     type = "points"
//     points = [[-30, 0, -8], [-5, 0, 6], [25, 0, -4]]
//
//     [[procedural.layer]]
//     type = "dune"
//     along = "ridge"
//     max_height = 4
//     slope_width = 16
#include "procedural/terrain/dune/dune_layer.h"

#include "core/math/hash.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/dune/dune_shape.h"
#include "procedural/terrain/shape_layer.h"

#include <fmt/format.h>

namespace marram {

namespace {

DuneSettings read_dune(const LayerContext& context) {
    const LayerValues& values = context.values;
    DuneSettings s;
    s.max_height = values.number("max_height");
    s.main_curve_shape = values.ramp("main_curve_shape");
    s.slope_width = values.number("slope_width");
    s.outer_slope_mult = values.number("outer_slope_mult");
    s.inner_slope_mult = values.number("inner_slope_mult");
    if (values.has("inner_slope_angle")) s.inner_slope_angle = values.number("inner_slope_angle") * degree;
    s.outer_slope_fall_off_along_curve = values.ramp("outer_slope_fall_off_along_curve");
    s.inner_slope_fall_off_along_curve = values.ramp("inner_slope_fall_off_along_curve");
    s.outer_slope_shape = values.ramp("outer_slope_shape");
    s.inner_slope_shape = values.ramp("inner_slope_shape");
    s.outer_slope_stretch = values.number("outer_slope_stretch");
    s.outer_slope_turn = values.number("outer_slope_turn") * degree;
    s.crest_radius = values.has("crest_radius") ? values.number("crest_radius") : context.domain.cell;
    s.boundary_noise = values.number("boundary_noise");
    s.boundary_noise_length = values.number("boundary_noise_length");
    if (values.has("max_dist")) s.max_dist = values.number("max_dist");
    s.mask_fall_off = values.ramp("mask_fall_off");
    s.crest_push = values.ramp("crest_push");
    s.crest_pinch = values.ramp("crest_pinch");
    s.smoothing = values.number("smoothing");
    s.search_accuracy = values.number("search_accuracy");
    s.flip = values.boolean("flip");
    return s; // the seed is set per curve
}

// Warns about ramps that make a step in the surface. They are valid input for DuneShape.
void warn_of_steps(const LayerContext& context, const DuneSettings& s) {
    const double outer = s.outer_slope_shape(0.0),
                 inner = s.inner_slope_angle > 0.0 ? 1.0 : s.inner_slope_shape(0.0);
    if (outer != inner)
        context.warn(context.values.place("outer_slope_shape"),
                     "the two slopes do not meet at the crest: their ramps begin with different values",
                     "begin both with the same");
    if (s.outer_slope_shape(1.0) != 0.0)
        context.warn(context.values.place("outer_slope_shape"),
                     "the outer slope ends in a step: its ramp is not 0 at 1", "end it with [1, 0]");
    if (!(s.inner_slope_angle > 0.0) && s.inner_slope_shape(1.0) != 0.0)
        context.warn(context.values.place("inner_slope_shape"),
                     "the inner slope ends in a step: its ramp is not 0 at 1", "end it with [1, 0]");
}

class DuneLayer : public ShapeLayer {
  public:
    explicit DuneLayer(const LayerContext& context)
        : ShapeLayer(read_shape(context)), smooth_(context.values.number("smooth")),
          gives_attributes_(context.values.boolean("attributes")) {
        domain_ = context.domain;
        if (context.values.has("name")) name_ = context.values.text("name");
        DuneSettings settings = read_dune(context);
        warn_of_steps(context, settings);
        const auto seed = uint64_t(context.values.integer("seed"));
        for (const DrawnCurve& curve : context.curves(context.values.text("along"))) {
            std::vector<Vec2d> points;
            for (const Vec3d& p : curve.points) points.emplace_back(p.x(), p.z());
            settings.seed = dune_noise_seed(context.seed, seed, dunes_.size());
            dunes_.emplace_back(points, curve.closed, settings);
            if (dunes_.back().empty())
                throw SceneFault("terrain.dune_curve", context.values.place("along"),
                                 "a curve of '" + context.values.text("along") +
                                     "' has fewer than two different points",
                                 "draw a dune with two points or more");
        }
    }

    std::vector<std::string> mask_names() const override { return names_of(gives_attributes_, name_); }

    static std::vector<std::string> names_of(bool gives_attributes, const std::string& name) {
        std::vector<std::string> names;
        if (gives_attributes)
            for (const char* what : {".mask", ".outer", ".inner", ".dist", ".dir_x", ".dir_z"})
                names.push_back(name + what);
        return names;
    }

    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override {
        ShapeLayer::evaluate(rect, below, out);
        if (!gives_attributes_) return;
        for (int j = rect.j0; j < rect.j1; ++j)
            for (int i = rect.i0; i < rect.i1; ++i) {
                const DuneSample s = highest({domain_.x(i), domain_.z(j)});
                const double values[] = {s.mask, s.outer,          s.inner,
                                         s.dist, s.sample_dir.x(), s.sample_dir.y()};
                for (size_t m = 0; m < out.masks.size(); ++m)
                    out.masks[m][domain_.index(i, j)] = float(values[m]);
            }
    }

    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override {
        const auto* old = dynamic_cast<const DuneLayer*>(&before);
        if (!old || old->smooth_ != smooth_ || !(old->settings() == settings())) return Tiles(domain, true);
        Tiles tiles(domain);
        for (size_t d = 0; d < std::max(dunes_.size(), old->dunes_.size()); ++d) {
            const DuneShape* now = d < dunes_.size() ? &dunes_[d] : nullptr;
            const DuneShape* then = d < old->dunes_.size() ? &old->dunes_[d] : nullptr;
            if (now && then && now->digest() == then->digest()) continue;
            if (now) tiles.add_box(now->lower(), now->upper());
            if (then) tiles.add_box(then->lower(), then->upper());
        }
        return tiles;
    }

  private:
    static bool inside(const DuneShape& dune, const Vec2d& p) {
        return (p.array() >= dune.lower().array()).all() && (p.array() <= dune.upper().array()).all();
    }

    // The sample of the highest dune at p.
    DuneSample highest(const Vec2d& p) const {
        DuneSample best;
        for (const DuneShape& dune : dunes_) {
            if (!inside(dune, p)) continue;
            const DuneSample sample = dune.sample(p);
            if (sample.mask > best.mask || sample.height > best.height) best = sample;
        }
        return best;
    }

    bool meets(const DuneShape& dune, int i0, int i1, int j0, int j1) const { // [i0, i1) x [j0, j1)
        return domain_.x(i1 - 1) >= dune.lower().x() && domain_.x(i0) <= dune.upper().x() &&
               domain_.z(j1 - 1) >= dune.lower().y() && domain_.z(j0) <= dune.upper().y();
    }

    bool touches(const Rect& rect) const override {
        return std::any_of(dunes_.begin(), dunes_.end(), [&](const DuneShape& dune) {
            return meets(dune, rect.i0, rect.i1, rect.j0, rect.j1);
        });
    }

    void shape(int i0, int i1, int j, double* own, double* share) const override {
        std::array<double, Tiles::side> height{}, mask{};
        for (const DuneShape& dune : dunes_) {
            if (!meets(dune, i0, i1, j, j + 1)) continue;
            dune.row(domain_.x(i0), domain_.z(j), domain_.cell, i1 - i0, height.data(), mask.data());
            for (int k = 0; k < i1 - i0; ++k) {
                const double h = height[size_t(k)], m = mask[size_t(k)];
                if (!(m > 0.0)) continue;
                own[k] = merged_thickness(own[k], h, smooth_);
                share[k] = std::max(share[k], m);
            }
        }
    }

    std::string name_ = "dune";
    double smooth_;
    bool gives_attributes_;
    std::vector<DuneShape> dunes_;
};

const auto dune_values = std::to_array<MarramParam>({
    param::curves("along", "", "the drawn curves: the crest of a dune each"),
    param::number("max_height", "m", "3", 0, 1e4, "height of the crest"),
    param::ramp(
        "main_curve_shape", "",
        "{ knots = [[0, 0], [0.35, 0.9], [0.5, 1], [0.65, 0.9], [1, 0]], interpolation = \"smooth\" }", 0, 10,
        "height along the curve, share of max_height"),
    param::number("slope_width", "m", "12", 1e-3, 1e5, "from the crest to the foot"),
    param::number("outer_slope_mult", "", "1", 0, 100, "factor of slope_width on the outer, windward side"),
    param::number("inner_slope_mult", "", "0.6", 0, 100,
                  "factor of slope_width on the inner side, the slip face"),
    param::number(
        "inner_slope_angle", "deg", "none", 1, 80,
        "makes the slip face straight and this steep, instead of inner_slope_mult and inner_slope_shape"),
    param::ramp("outer_slope_fall_off_along_curve", "", "[[0, 1], [1, 1]]", 0, 10,
                "width of the outer side along the curve"),
    param::ramp("inner_slope_fall_off_along_curve", "", "[[0, 1], [1, 1]]", 0, 10,
                "width of the inner side along the curve"),
    param::ramp("outer_slope_shape", "", "{ knots = [[0, 1], [1, 0]], interpolation = \"smooth\" }", 0, 10,
                "height from the crest (0) to the outer foot (1), share of the crest's"),
    param::ramp("inner_slope_shape", "", "[[0, 1], [0.85, 0.08], [1, 0]]", 0, 10,
                "height from the crest (0) to the inner foot (1), share of the crest's"),
    param::number("outer_slope_stretch", "", "1", 1, 16,
                  "how many times further the outer side reaches along the dune's axis than across it"),
    param::number("outer_slope_turn", "deg", "0", -180, 180,
                  "turns that axis, from x to z; at 0 it is square to the line between the curve's ends"),
    param::number("crest_radius", "m", "none", 0, 1e4,
                  "how far the crest is rounded, so that it shows no steps of the grid; absent: one cell"),
    param::number("boundary_noise", "m", "0", 0, 1e4, "how far the foot wanders in and out"),
    param::number("boundary_noise_length", "m", "8", 1e-3, 1e5, "along the curve, from bulge to bulge"),
    param::number("max_dist", "m", "none", 1e-3, 1e5,
                  "distance from the crest at which mask_fall_off ends; absent: the foot"),
    param::ramp("mask_fall_off", "", "[[0, 1], [1, 1]]", 0, 1,
                "the dune's share from the crest (0) to max_dist (1)"),
    param::ramp("crest_push", "m", "[[0, 0], [1, 0]]", -1e4, 1e4,
                "how far the crest is pushed to the inner side, along the curve"),
    param::ramp("crest_pinch", "", "[[0, 0], [1, 0]]", 0, 10,
                "how much narrower the slopes are towards the crest, along the curve"),
    param::number("smoothing", "", "0.1", 0, 10, "of the drawn curve, in slope widths; 0: corners stay"),
    param::number("search_accuracy", "", "8", 1, 64, "points of the curve within a slope width", "2|4|8|16",
                  "seconds.procedural_meshes"),
    param::boolean("flip", "false",
                   "false: the outer side is on the left along the curve; true: on the right"),
    param::boolean("attributes", "false", "hand out NAME.mask, .outer, .inner, .dist, .dir_x, .dir_z"),
    param::integer("seed", "", "0", 0, 1e9, "another number, another boundary noise"),
});

std::string ramp_text(const char* name, const Ramp& ramp) {
    std::string knots;
    for (size_t k = 0; k < ramp.positions().size(); ++k)
        knots += fmt::format("{}[{}, {}]", k > 0 ? ", " : "", ramp.positions()[k], ramp.values()[k]);
    constexpr const char* interpolations[] = {"constant", "linear", "smooth"}; // [Ramp::Interpolation]
    return fmt::format("{} = {{ knots = [{}], interpolation = \"{}\" }}\n", name, knots,
                       interpolations[size_t(ramp.interpolation())]);
}

} // namespace

uint64_t dune_noise_seed(uint64_t terrain, uint64_t layer, uint64_t curve) {
    return hash(hash(terrain, layer), curve);
}

std::string dune_text(const DuneSettings& s, uint64_t seed) {
    std::string text;
    const auto number = [&](const char* name, double value) {
        text += fmt::format("{} = {}\n", name, value);
    };
    const auto ramp = [&](const char* name, const Ramp& value) { text += ramp_text(name, value); };
    number("max_height", s.max_height);
    ramp("main_curve_shape", s.main_curve_shape);
    number("slope_width", s.slope_width);
    number("outer_slope_mult", s.outer_slope_mult);
    ramp("outer_slope_shape", s.outer_slope_shape);
    ramp("outer_slope_fall_off_along_curve", s.outer_slope_fall_off_along_curve);
    number("outer_slope_stretch", s.outer_slope_stretch);
    number("outer_slope_turn", s.outer_slope_turn / degree);
    number("inner_slope_mult", s.inner_slope_mult);
    if (s.inner_slope_angle > 0.0) number("inner_slope_angle", s.inner_slope_angle / degree);
    ramp("inner_slope_shape", s.inner_slope_shape);
    ramp("inner_slope_fall_off_along_curve", s.inner_slope_fall_off_along_curve);
    number("crest_radius", s.crest_radius);
    number("boundary_noise", s.boundary_noise);
    number("boundary_noise_length", s.boundary_noise_length);
    if (s.max_dist > 0.0) number("max_dist", s.max_dist);
    ramp("mask_fall_off", s.mask_fall_off);
    ramp("crest_push", s.crest_push);
    ramp("crest_pinch", s.crest_pinch);
    number("smoothing", s.smoothing);
    number("search_accuracy", s.search_accuracy);
    text += fmt::format("flip = {}\nseed = {}\n", s.flip, seed);
    return text;
}

LayerType dune_layer_type() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> all(dune_values.begin(), dune_values.end());
        for (const MarramParam& param : shape_params("\"sand\"")) all.push_back(param);
        return all;
    }();
    return {"dune", "a dune along each drawn curve", params,
            [](const LayerContext& context) -> std::unique_ptr<TerrainLayer> {
                return std::make_unique<DuneLayer>(context);
            },
            [](const LayerValues& values) {
                return DuneLayer::names_of(values.boolean("attributes"),
                                           values.has("name") ? values.text("name") : "dune");
            }};
}

} // namespace marram
