// SPDX-License-Identifier: Apache-2.0
// Parameters of mass_desert in a scene: names, ranges, and the layer that is made from their values.
#include "procedural/terrain/mass/mass_parameters.h"

#include "core/math/hash.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/mass/mass_places.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace marram {

namespace {

constexpr double min_height = 1e-3, most_height = 1e3, min_spacing = 0.1, max_spacing = 1e6; // metres

constexpr std::array<std::string_view, 8> mass_kinds = {"barchan", "barchanoid", "transverse", "seif",
                                                        "star",    "dome",       "parabolic",  "nabkha"};

constexpr auto mass_values = std::to_array<MarramParam>({
    param::choice(
        "arrangement", "\"random\"", "random|along|across|cells",
        "random with minimum spacing; along curves; in rows across the wind; on a jittered lattice"),
    param::curves("along", "none", "arrangement along: the curves"),
    param::boolean("follow", "false",
                   "arrangement along: dunes are oriented across the curve instead of across the wind"),
    param::choice("kind", "\"regime\"",
                  "regime|barchan|barchanoid|transverse|seif|star|dome|parabolic|nabkha",
                  "regime: by sand_cover, wind_variability and plants"),
    param::number("sand_cover", "", "0.2", 0, 1, "how much sand there is: 0 bare ground, 1 sand everywhere"),
    param::number("wind_variability", "", "0.1", 0, 1,
                  "1 - RDP/DP: 0: one wind direction; 1: all directions"),
    param::number("plants", "", "0", 0, 1, "share of the ground that plants cover"),
    param::number("kind_mixing", "", "0.05", 0, 1,
                  "largest random deviation of a dune's cover and variability"),
    param::range("height", "m", "[2, 6]", min_height, most_height, "lowest and highest dune"),
    param::range("spacing", "m", "[80, 140]", min_spacing, max_spacing,
                 "distance between the middles of neighbours; none are nearer than the first"),
    param::range("ridge_length", "m", "[150, 300]", min_spacing, max_spacing,
                 "crest of transverse, barchanoid and seif dunes"),
    param::number("density", "", "1", 0, 1, "share of the places that hold a dune"),
    param::number("dispersion", "deg", "8", 0, 180, "standard deviation of the dunes' orientation"),
    param::number("slip_angle", "deg", "33", 1, 80, "slope of slip faces"),
    param::number("windward_angle", "deg", "12", 0, 60,
                  "steepest part of windward sides, as far as their length allows"),
    param::number("horn_length", "", "0.3", 0.05, 2,
                  "of a barchan or a crescent of a barchanoid, share of its width"),
    param::number("sinuosity", "", "0.08", 0, 1, "how far ridges wave, share of a wave's length"),
    param::number("crest_radius", "m", "none", 0, 1e4,
                  "how far crests are rounded, so that they show no steps of the grid; absent: one cell"),
    param::number("boundary_noise", "m", "0", 0, 1e4, "amplitude of the noise on the dune's foot line"),
    param::number("boundary_noise_length", "m", "20", 1e-3, 1e5, "along the crest, from bulge to bulge"),
    param::number("merge", "m", "1", 0, 1e4, "difference in height below which overlapping dunes blend"),
    param::vec2("area_low", "m", "none", -1e8, 1e8,
                "corner of the area, x and z; absent: all of the terrain"),
    param::vec2("area_high", "m", "none", -1e8, 1e8, "its other corner"),
    param::integer("seed", "", "0", 0, 1e9, "random seed of the dunes"),
    param::boolean("list", "false", "report each dune's id with its x, z and height, for edits"),
    param::number("edit[].id", "", "", 0, 0x1p52, "the dune that is edited"),
    param::vec2("edit[].move", "m", "[0, 0]", -1e6, 1e6, "x and z"),
    param::number("edit[].rotate", "deg", "0", -360, 360, "from x to z"),
    param::number("edit[].scale", "", "1", 0.01, 100, "of all its lengths"),
    param::number("edit[].height_factor", "", "1", 0, 100, "of its height alone"),
    param::boolean("edit[].remove", "false", "leave it out"),
});

std::vector<DuneEdit> read_edits(const LayerValues& values) {
    std::vector<DuneEdit> edits;
    while (true) {
        const std::string element = "edit[" + std::to_string(edits.size()) + "].";
        if (!values.has(element + "id")) return edits;
        edits.push_back({uint64_t(values.number(element + "id")), values.vec2(element + "move"),
                         values.number(element + "rotate") * degree, values.number(element + "scale"),
                         values.number(element + "height_factor"), values.boolean(element + "remove")});
    }
}

void read_curves(const LayerContext& context, MassSettings& settings) {
    const bool along = settings.arrangement == MassArrangement::along;
    if (along != context.values.has("along"))
        throw SceneFault("mass_desert.along", context.values.place("arrangement"),
                         along ? "the arrangement is along curves, but none are named"
                               : "curves are named, but the arrangement is not along",
                         "give arrangement = \"along\" and along = \"NAME\", or neither");
    if (!along) return;
    for (const DrawnCurve& curve : context.curves(context.values.text("along"))) {
        std::vector<Vec2d>& points = settings.curves.emplace_back();
        for (const Vec3d& p : curve.points) points.emplace_back(p.x(), p.z());
        if (curve.closed && !points.empty()) points.push_back(points.front());
    }
}

MassArrangement arrangement_named(std::string_view name) {
    return name == "along"    ? MassArrangement::along
           : name == "across" ? MassArrangement::across
           : name == "cells"  ? MassArrangement::cells
                              : MassArrangement::random;
}

MassSettings read_mass(const LayerContext& context) {
    const LayerValues& values = context.values;
    MassSettings s;
    s.arrangement = arrangement_named(values.text("arrangement"));
    const auto kind = std::ranges::find(mass_kinds, values.text("kind"));
    if (kind != mass_kinds.end()) s.kind = MassKind(kind - mass_kinds.begin());
    s.sand_cover = values.number("sand_cover");
    s.wind_variability = values.number("wind_variability");
    s.plants = values.number("plants");
    s.kind_mixing = values.number("kind_mixing");
    s.height = values.vec2("height");
    s.spacing = values.vec2("spacing");
    s.ridge_length = values.vec2("ridge_length");
    s.density = values.number("density");
    s.dispersion = values.number("dispersion") * degree;
    s.slip_angle = values.number("slip_angle") * degree;
    s.windward_angle = values.number("windward_angle") * degree;
    s.horn_length = values.number("horn_length");
    s.sinuosity = values.number("sinuosity");
    s.crest_radius = values.has("crest_radius") ? values.number("crest_radius") : context.domain.cell;
    s.boundary_noise = values.number("boundary_noise");
    s.boundary_noise_length = values.number("boundary_noise_length");
    s.wind = context.wind;
    s.seed = hash(context.seed, uint64_t(values.integer("seed")));
    s.terrain_seed = context.seed;
    s.follow = values.boolean("follow");
    read_curves(context, s);
    s.edits = read_edits(values);
    return s;
}

// The area of the scene; by default the terrain plus mass_reach() on all sides.
MassArea read_area(const LayerContext& context, const MassSettings& settings) {
    const Domain& domain = context.domain;
    const Vec2d margin = Vec2d::Constant(mass_reach(settings));
    MassArea area{Vec2d(domain.x0, domain.z0) - margin,
                  Vec2d(domain.x(domain.nx - 1), domain.z(domain.nz - 1)) + margin};
    if (context.values.has("area_low")) area.lower = context.values.vec2("area_low");
    if (context.values.has("area_high")) area.upper = context.values.vec2("area_high");
    const char* given = context.values.has("area_low") ? "area_low" : "area_high";
    if (!(area.lower.x() < area.upper.x() && area.lower.y() < area.upper.y()))
        throw SceneFault("mass_desert.area", context.values.place(given),
                         "the area is empty: its lower corner is not below its upper one",
                         "give area_low the smaller x and z, within the terrain");
    return area;
}

void warn_of_lost_edits(const LayerContext& context, const MassSettings& settings,
                        const std::vector<MassDune>& dunes) {
    for (size_t e = 0; e < settings.edits.size(); ++e) {
        const DuneEdit& edit = settings.edits[e];
        const auto found = std::ranges::lower_bound(dunes, edit.id, {}, &MassDune::id);
        if (edit.remove || (found != dunes.end() && found->id == edit.id)) continue;
        const bool removed = std::ranges::any_of(
            settings.edits, [&](const DuneEdit& other) { return other.remove && other.id == edit.id; });
        if (!removed)
            context.warn(context.values.place("edit[" + std::to_string(e) + "].id"),
                         fmt::format("no dune has the id {}", edit.id),
                         "take an id of this seed and arrangement");
    }
}

std::unique_ptr<TerrainLayer> make_mass_layer(const LayerContext& context) {
    const MassSettings settings = read_mass(context);
    const MassArea area = read_area(context, settings);
    if (const double about = mass_count(bounded_mass_settings(settings), area); about > max_mass_dunes)
        mass_too_many(about, context.values.place("spacing"));
    std::vector<MassDune> dunes = generate_dunes(settings, area.lower, area.upper);
    warn_of_lost_edits(context, settings, dunes);
    const Domain& domain = context.domain;
    const Vec2d low(domain.x0, domain.z0), high(domain.x(domain.nx - 1), domain.z(domain.nz - 1));
    const bool any_inside = std::ranges::any_of(dunes, [&](const MassDune& dune) {
        return (dune.at.array() >= low.array()).all() && (dune.at.array() <= high.array()).all();
    });
    const bool removed =
        std::ranges::any_of(settings.edits, [](const DuneEdit& edit) { return edit.remove; });
    if (dunes.empty() && !removed)
        context.warn(context.values.place("spacing"), "mass_desert has no dune: there is no room for one",
                     "lower spacing, or enlarge size or its area");
    else if (!dunes.empty() && !any_inside)
        context.warn(context.values.place("spacing"), "no dune of mass_desert stands on the terrain",
                     "lower spacing, move its area onto the terrain, or take another seed");
    auto layer = std::make_unique<MassLayer>(read_shape(context), context.domain, std::move(dunes),
                                             context.values.number("merge"),
                                             dynamic_cast<const MassLayer*>(context.before));
    layer->list_dunes(context.values.boolean("list"));
    return layer;
}

} // namespace

std::string_view mass_kind_name(MassKind kind) { return mass_kinds[size_t(kind)]; }

MassSettings bounded_mass_settings(MassSettings s) {
    const auto range = [](Vec2d& r, double low, double high) {
        r.x() = std::clamp(r.x(), low, high);
        r.y() = std::clamp(r.y(), r.x(), high);
    };
    range(s.height, min_height, most_height);
    range(s.spacing, min_spacing, max_spacing);
    range(s.ridge_length, min_spacing, max_spacing);
    s.slip_angle = std::clamp(s.slip_angle, 1.0 * degree, 80.0 * degree);
    s.windward_angle = std::clamp(s.windward_angle, 0.0, 60.0 * degree);
    s.horn_length = std::clamp(s.horn_length, 0.05, 2.0);
    s.sinuosity = std::clamp(s.sinuosity, 0.0, 1.0);
    return s;
}

LayerType mass_desert_layer_type() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> all(mass_values.begin(), mass_values.end());
        for (const MarramParam& param : shape_params("\"sand\"")) all.push_back(param);
        return all;
    }();
    return {"mass_desert", "many dunes, each of which can be edited", params, make_mass_layer};
}

} // namespace marram
