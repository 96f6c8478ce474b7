// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/field/placed_field.h"

#include "core/math/known_part.h"
#include "procedural/abi/param.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace marram {
namespace {

constexpr double fastest = 1e6; // m/s

constexpr std::array params = {
    param::choice(
        "field[].shape", "sphere", field_shapes,
        "where the wind differs: a sphere of radius 1 m or a box of half side 1 m, before its transform; a "
        "grid of velocities; along curves; an image seen from above, over 2 m x 2 m before its transform"),
    param::keys("field[].transform", "{}", "its place, rotation and scale, keyed; not of curves"),
    param::keyable(param::vec3("field[].velocity", "m/s", "[0, 0, 0]", -fastest, fastest,
                               "wind inside a sphere or box, in the field's own axes")),
    param::keyable(param::number("field[].swirl", "m/s", "0", -fastest, fastest,
                                 "wind about the y axis of a sphere or box, greatest at the core")),
    param::keyable(
        param::number("field[].pull", "m/s", "0", -fastest, fastest,
                      "wind towards the centre of a sphere or box, greatest at the core; below 0: away "
                      "from it")),
    param::number("field[].core", "", "0.3", 0.01, 1,
                  "where swirl and pull are greatest, as a share of its size"),
    param::volume("field[].velocities", "none",
                  "velocities of a grid, m/s, from OpenVDB: a vector grid, or vel.x, vel.y and vel.z"),
    param::curves("field[].along", "none",
                  "curves that the wind follows, in the direction in which they are drawn"),
    param::number(
        "field[].reach", "m", "none", 1e-3, 1e6,
        "distance from the curves at which the wind has turned half way; their influence ends at 4 times it"),
    param::image(
        "field[].map", "none", "",
        "wind along (red) and across (green: from +x towards +z) the mean wind, as fractions of its speed"),
    param::keyable(param::number("field[].weight", "", "1", 0, 1, "scale of its influence")),
    param::choice("field[].mode", "add", "add|replace", "it is added to the wind, or takes its place"),
    param::ramp(
        "field[].ramp", "", "none", 0, 1,
        "influence from the centre (0) to the surface (1), where it is 0; of curves over the distance from "
        "them, 1 at 4 times their reach; default: 1 up to 0.5, or of a grid or an image up to 0.9, then "
        "falling"),
};

// Values of one element of the list.
struct FieldValues {
    const Values& values;
    std::string prefix;

    const MarramValue* find(std::string_view name) const { return values.find(prefix + std::string(name)); }
    std::string place(std::string_view name) const { return values.at(prefix + std::string(name)).place; }
    // Defaults have the place of their table in common.
    bool is_given(std::string_view name) const {
        const MarramValue* value = find(name);
        if (!value || !value->place || !*value->place) return false;
        return std::ranges::none_of(params, [&](const MarramParam& param) {
            const std::string_view other = std::string_view(param.name).substr(8); // "field[]."
            const MarramValue* of_other = other == name ? nullptr : find(other);
            return of_other && of_other->place && std::string_view(of_other->place) == value->place;
        });
    }
};

// What only fields of some shapes have.
struct ShapeParam {
    std::string_view name;
    FieldShape shape;
    bool required;
};
constexpr std::array params_of_shapes = {
    ShapeParam{"velocities", FieldShape::grid, true}, ShapeParam{"along", FieldShape::curves, true},
    ShapeParam{"reach", FieldShape::curves, true}, ShapeParam{"map", FieldShape::image, true}};

FieldShape shape_named(std::string_view name) {
    return name == "box"      ? FieldShape::box
           : name == "grid"   ? FieldShape::grid
           : name == "curves" ? FieldShape::curves
           : name == "image"  ? FieldShape::image
                              : FieldShape::sphere;
}

bool is_placed_by_hand(FieldShape shape) { return shape == FieldShape::sphere || shape == FieldShape::box; }

// Throws if a parameter of its shape is missing, or one of another shape is given.
void check_params(const FieldValues& field, FieldShape shape, std::string_view shape_name) {
    const auto refuse = [&](std::string_view name) {
        throw SceneFault(
            "field.no_effect", field.place(name),
            fmt::format("{}{} has no effect on a field of shape \"{}\"", field.prefix, name, shape_name),
            "remove it, or choose another shape");
    };
    for (const ShapeParam& param : params_of_shapes) {
        if (param.shape == shape && param.required && !field.find(param.name))
            throw SceneFault("field.missing", field.place("shape"),
                             fmt::format("{}{} is missing", field.prefix, param.name),
                             fmt::format("a field of shape \"{}\" needs it", shape_name));
        if (param.shape != shape && field.is_given(param.name)) refuse(param.name);
    }
    if (!is_placed_by_hand(shape))
        for (const std::string_view name : {"velocity", "swirl", "pull", "core"})
            if (field.is_given(name)) refuse(name);
    if (shape == FieldShape::curves && field.is_given("transform")) refuse("transform");
}

Ramp read_field_ramp(const FieldValues& field, FieldShape shape) {
    if (field.find("ramp"))
        return falling_ramp(field.values, field.prefix + "ramp", "field.ramp_jumps", "field.ramp_end");
    const double until = shape == FieldShape::grid || shape == FieldShape::image ? 0.9 : 0.5;
    return Ramp(std::array{0.0, 1.0, until, 1.0, 1.0, 0.0}, "smooth");
}

PlacedField read_field(const FieldValues& given) {
    const Values& values = given.values;
    const std::string& prefix = given.prefix;
    PlacedField field;
    const std::string_view shape = values.text(prefix + "shape");
    field.shape = shape_named(shape);
    check_params(given, field.shape, shape);
    field.replaces = values.text(prefix + "mode") == "replace";
    const MarramValue& keys = values.at(prefix + "transform");
    field.transform = KeyedTransform(std::span(keys.numbers, keys.number_count), keys.text);
    field.velocity = values.vec3(prefix + "velocity");
    field.swirl = values.number(prefix + "swirl");
    field.pull = values.number(prefix + "pull");
    field.core = values.number(prefix + "core");
    field.weight = values.number(prefix + "weight");
    field.ramp = read_field_ramp(given, field.shape);
    field.location = keys.place;
    if (field.shape == FieldShape::grid)
        field.velocities =
            std::make_shared<const Velocities>(velocities_of(*values.at(prefix + "velocities").volume));
    if (field.shape == FieldShape::curves) {
        field.location = given.place("along");
        field.along = values.text(prefix + "along");
        field.reach = values.number(prefix + "reach");
    }
    if (field.shape == FieldShape::image)
        field.map =
            std::make_shared<const PlanMap>(image_map(*values.at(prefix + "map").grid, given.place("map")));
    return field;
}

// Axis by axis: R, M = (R scale)^-1, and the half sides of the bounds around the unit box or sphere.
void place_at(const Eigen::Affine3d& transform, FieldAt& at, Vec3d& half) {
    const bool sphere = at.field->shape == FieldShape::sphere;
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3d column = transform.linear().col(axis);
        const double length = column.stableNorm();
        at.axes.col(axis) = column / length;
        at.to_unit.row(axis) = column / length / length;
        half += sphere ? Vec3d(column.cwiseAbs2()) : Vec3d(column.cwiseAbs());
    }
    if (sphere) half = half.cwiseSqrt();
}

constexpr double unbounded = 1e30; // m

// An image has no height: it is unbounded along its y axis.
void unbound_height(const Eigen::Affine3d& transform, Vec3d& half) {
    half += Vec3d((transform.linear().col(1).cwiseAbs().array() > 0.0).select(unbounded, Vec3d::Zero()));
}

void place_samples(const Eigen::Affine3d& transform, double frame, FieldAt& at) {
    const Velocities& velocities = *at.field->velocities;
    const VelocityTimes times = velocity_times(velocities, frame);
    at.lower = Vec3d::Constant(infinity), at.upper = -at.lower;
    const auto add = [&](SamplesAt& of, size_t index, double share) {
        const VelocitySamples& samples = velocities.grids[index];
        const Eigen::Matrix3d box = transform.linear() * samples.half;
        of = {&samples, share, transform * samples.center, box.inverse()};
        const Vec3d half = box.cwiseAbs().rowwise().sum();
        at.lower = at.lower.cwiseMin(of.center - half);
        at.upper = at.upper.cwiseMax(of.center + half);
        if (!of.to_unit.allFinite()) at.to_unit = of.to_unit; // no volume
    };
    add(at.grids[0], times.first, 1.0 - times.share);
    if (!(times.share > 0.0)) return;
    add(at.grids[1], times.second, times.share);
    const SamplesAt &first = at.grids[0], &second = at.grids[1];
    at.grids[1].in_the_same_box = first.samples->counts == second.samples->counts &&
                                  first.center == second.center && first.to_unit == second.to_unit;
}

} // namespace

std::span<const MarramParam> field_params() { return params; }

MarramParam ignored_field_param() {
    MarramParam param = params[0];
    param.name = "wind.field[].shape";
    param.help = "noticed only: fields move strands, and nothing else";
    return param;
}

void tell_of_ignored_fields(const MarramHost& host, const Values& values, const std::string& who) {
    for (size_t i = 0;; ++i) {
        const MarramValue* value = values.find(fmt::format("wind.field[{}].shape", i));
        if (!value) return;
        send(host, MARRAM_INFO, "field.ignored", value->place ? value->place : "",
             fmt::format("{} not moved by wind.field[{}]", who, i), "fields of the wind move strands only");
    }
}

std::vector<PlacedField> read_fields(const Values& values) {
    std::vector<PlacedField> fields;
    for (;;) {
        const FieldValues field{values, fmt::format("wind.field[{}].", fields.size())};
        if (!field.find("shape")) return fields;
        fields.push_back(read_field(field));
    }
}

bool lend_guides(const MarramFrame& frame, std::span<PlacedField> fields) {
    bool changed = false;
    for (PlacedField& field : fields) {
        if (field.shape != FieldShape::curves) continue;
        const std::vector<MarramCurves> all =
            known_parts(frame.curves, frame.curves_count, frame.curves_stride);
        const auto named = std::ranges::find_if(
            all, [&](const MarramCurves& curves) { return curves.name && field.along == curves.name; });
        if (named == all.end())
            throw SceneFault("field.no_curves", field.location,
                             fmt::format("there are no curves '{}' for the wind to follow", field.along),
                             "name those of a [[curves]]");
        if (named->moves)
            throw SceneFault(
                "field.moving_curves", field.location,
                fmt::format("the curves '{}' move, and the wind can only follow ones that stand still",
                            field.along),
                "name others");
        const std::vector<DrawnCurve> curves = drawn_curves(*named);
        if (field.map && field.map->digest == guide_digest(curves, field.reach, field.ramp)) continue;
        field.map =
            std::make_shared<const PlanMap>(guide_map(curves, field.reach, field.ramp, field.location));
        changed = true;
    }
    return changed;
}

double max_added_speed(const PlacedField& field, double mean_speed) {
    switch (field.shape) {
    case FieldShape::grid:
        return field.velocities->max_speed;
    case FieldShape::curves:
        return 2.0 * mean_speed;
    case FieldShape::image: {
        float most = 0.0F;
        for (const float value : field.map->values) most = std::max(most, std::abs(value));
        return (1.0 + std::sqrt(2.0) * double(most)) * mean_speed;
    }
    default:
        return field.velocity.norm() + std::abs(field.swirl) + std::abs(field.pull);
    }
}

bool field_moves(const PlacedField& field) {
    if (field.shape == FieldShape::grid && field.velocities->grids.size() > 1) return true;
    return field.shape != FieldShape::curves && field.transform.moves();
}

std::string field_text(const PlacedField& field) {
    switch (field.shape) {
    case FieldShape::box:
        return "box";
    case FieldShape::grid: {
        const std::array<int, 3>& n = field.velocities->grids.front().counts;
        const size_t frames = field.velocities->grids.size();
        return fmt::format("grid of {} x {} x {} voxels{}", n[0], n[1], n[2],
                           frames > 1 ? fmt::format(" and {} frames", frames) : "");
    }
    case FieldShape::curves:
        return fmt::format("curves '{}'", field.along);
    case FieldShape::image:
        return fmt::format("image of {} x {} pixels", field.map->nx, field.map->nz);
    default:
        return "sphere";
    }
}

size_t field_bytes(const PlacedField& field) { return field.map ? field.map->bytes() : 0; }

std::vector<FieldAt> fields_at(std::span<const PlacedField> fields, double frame) {
    std::vector<FieldAt> list;
    for (const PlacedField& field : fields) {
        if (field.weight == 0.0) continue; // no effect
        const bool curves = field.shape == FieldShape::curves;
        if (curves && !field.map) continue;
        Eigen::Affine3d transform = curves ? Eigen::Affine3d::Identity() : field.transform.at(frame);
        if (curves) {
            const PlanMap& map = *field.map;
            transform.translation() = Vec3d(map.center.x(), 0.0, map.center.y());
            transform.linear().diagonal() = Vec3d(map.half.x(), 1.0, map.half.y());
        }
        FieldAt at{&field, transform.translation(), {}, {}, {}, {}};
        Vec3d half = Vec3d::Zero();
        place_at(transform, at, half);
        if (field.shape == FieldShape::grid) place_samples(transform, frame, at);
        if (!at.to_unit.allFinite()) continue; // no volume
        if (curves || field.shape == FieldShape::image) unbound_height(transform, half);
        constexpr double slack = 1e-12; // rounding, as of gusts
        if (field.shape == FieldShape::grid) {
            const Vec3d more = slack * (at.upper - at.lower + at.lower.cwiseAbs() + at.upper.cwiseAbs());
            at.lower -= more;
            at.upper += more;
        } else {
            const Vec3d reach = half + slack * (half + at.center.cwiseAbs());
            at.lower = at.center - reach;
            at.upper = at.center + reach;
        }
        list.push_back(at);
    }
    return list;
}

bool field_touches(const PlacedField& field, const Vec2d& frames, const Eigen::AlignedBox3d& box) {
    constexpr double max_times = 1000.0;
    const double length = frames.y() - frames.x(), step = std::max(1.0, length / max_times);
    for (double at = 0.0; at <= length; at += step) {
        for (const FieldAt& now : fields_at({&field, 1}, frames.x() + at))
            if ((now.lower.array() <= box.max().array()).all() &&
                (now.upper.array() >= box.min().array()).all())
                return true;
        if (!field_moves(field)) return false;
    }
    return false;
}

} // namespace marram
