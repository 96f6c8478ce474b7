// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/local_wind.h"

#include "procedural/abi/param.h"
#include "procedural/abi/ramp_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr double fastest = 1e6; // m/s

constexpr std::array params = {
    param::choice(
        "field[].shape", "sphere", "sphere|box",
        "where the wind differs: a sphere of radius 1 m or a box of half side 1 m, before its transform"),
    param::keys("field[].transform", "{}", "its place, rotation and scale, keyed"),
    param::keyable(param::vec3("field[].velocity", "m/s", "[0, 0, 0]", -fastest, fastest,
                               "wind inside, in the field's own axes")),
    param::keyable(param::number("field[].swirl", "m/s", "0", -fastest, fastest,
                                 "wind about the field's y axis, greatest at the core")),
    param::keyable(
        param::number("field[].pull", "m/s", "0", -fastest, fastest,
                      "wind towards the field's centre, greatest at the core; below 0: away from it")),
    param::number("field[].core", "", "0.3", 0.01, 1,
                  "where swirl and pull are greatest, as a share of its size"),
    param::keyable(param::number("field[].weight", "", "1", 0, 1, "scale of its influence")),
    param::choice("field[].mode", "add", "add|replace", "it is added to the wind, or takes its place"),
    param::ramp("field[].ramp", "", "{ knots = [[0, 1], [0.5, 1], [1, 0]], interpolation = \"smooth\" }", 0,
                1, "influence from the centre (0) to the surface (1), where it is 0"),
};

// c(q) / q of local_wind.h, from q^2.
MARRAM_INLINE VDouble scully_over_q(const VDouble& squared, double core) {
    return (2.0 / core) / (squared * (1.0 / (core * core)) + 1.0);
}

// R v of eight v.
MARRAM_INLINE Wide3d rotated(const Eigen::Matrix3d& r, const Wide3d& v) {
    return {v.x * r(0, 0) + v.y * r(0, 1) + v.z * r(0, 2), v.x * r(1, 0) + v.y * r(1, 1) + v.z * r(1, 2),
            v.x * r(2, 0) + v.y * r(2, 1) + v.z * r(2, 2)};
}

MARRAM_INLINE Wide3d with_field(const FieldAt& at, const Wide3d& p, const Wide3d& v) {
    const PlacedField& field = *at.field;
    const Wide3d x = rotated(at.to_unit, p - splat3(at.center.data()));
    const VDouble rr = dot(x, x);
    const VDouble t = field.box ? vmax(vmax(vabs(x.x), vabs(x.y)), vabs(x.z)) : vsqrt(rr);
    const VLong inside = t < 1.0;
    if (!any(inside)) return v;
    const VDouble share = select(inside, evaluate(field.ramp, t) * field.weight, 0.0);
    Wide3d f = splat3(field.velocity.data());
    if (field.swirl != 0.0) {
        const VDouble turn = scully_over_q(x.x * x.x + x.z * x.z, field.core) * field.swirl;
        f = f + Wide3d{x.z * turn, VDouble{}, -x.x * turn}; // y axis cross x
    }
    if (field.pull != 0.0) f = f - x * (scully_over_q(rr, field.core) * field.pull);
    const Wide3d world = rotated(at.axes, f);
    return v + (field.replaces ? world - v : world) * share;
}

MARRAM_HOT void wind_of_blocks(const LocalWind& wind, std::span<const FieldAt> fields, Strands& strands) {
    const Ramp& response = wind.response;
    const Wide3d direction = splat3(wind.direction.data()), undisturbed = direction * splat(wind.speed);
    const float mean_response = float(std::clamp(response(wind.speed), 0.0, 1.0));
    const bool once = !strands.wind_unsheltered.empty();
    for (int i = 0; i < strands.blocks; ++i) {
        const Wide3f* const rest = strands.rest.data() + size_t(i) * size_t(strands.cvs);
        const Wide3d p = to_double(rest[0]);
        const auto with_fields = [&](Wide3d v) MARRAM_ALWAYS_INLINE {
            for (const FieldAt& field : fields) v = with_field(field, p, v);
            return v;
        };
        Wide3d v = undisturbed;
        if (wind.ground.air) {
            VDouble rise{}, reach{};
            for (int k = 1; k < strands.cvs; ++k) {
                const Wide3d way = to_double(rest[k]) - p;
                rise = vmax(rise, way.y);
                reach = vmax(reach, dot(way, way));
            }
            const VDouble above = vmax(rise * 0.5, vsqrt(reach) * 0.1);
            v = wind_over_ground(wind.ground, wind.reference, p, above, wind.speed * wind.direction);
        }
        v = with_fields(v);
        const Wide3d d = v - undisturbed;
        const VLong changed = dot(d, d) > 0.0;
        const VDouble length = vsqrt(dot(v, v));
        const VLong turned = changed & (length > 0.0);
        const VDouble strength = vmin(vmax(evaluate(response, length), 0.0), 1.0);
        strands.wind_direction[size_t(i)] =
            select(turned, v * (1.0 / select(turned, length, 1.0)), direction);
        strands.wind_speed[size_t(i)] = to_float(length);
        const VFloat sheltered = to_float(select(changed, strength, splat(double(mean_response))));
        strands.wind_response[size_t(i)] = sheltered;
        if (!once) continue;
        const Wide3d level = with_fields(undisturbed);
        const VFloat there = to_float(vmin(vmax(evaluate(response, vsqrt(dot(level, level))), 0.0), 1.0));
        strands.wind_unsheltered[size_t(i)] = vmax(sheltered, there);
    }
}

} // namespace

std::span<const MarramParam> field_params() { return params; }

std::vector<PlacedField> read_fields(const Values& values) {
    std::vector<PlacedField> fields;
    for (;;) {
        const std::string prefix = fmt::format("wind.field[{}].", fields.size());
        if (!values.has(prefix + "shape")) return fields;
        PlacedField& field = fields.emplace_back();
        field.box = values.text(prefix + "shape") == "box";
        field.replaces = values.text(prefix + "mode") == "replace";
        const MarramValue& keys = values.at(prefix + "transform");
        field.transform = KeyedTransform(std::span(keys.numbers, keys.number_count), keys.text);
        field.velocity = values.vec3(prefix + "velocity");
        field.swirl = values.number(prefix + "swirl");
        field.pull = values.number(prefix + "pull");
        field.core = values.number(prefix + "core");
        field.weight = values.number(prefix + "weight");
        field.ramp = falling_ramp(values, prefix + "ramp", "field.ramp_jumps", "field.ramp_end");
        field.location = values.at(prefix + "transform").place;
    }
}

double max_added_speed(const PlacedField& field) {
    return field.velocity.norm() + std::abs(field.swirl) + std::abs(field.pull);
}

std::vector<FieldAt> fields_at(std::span<const PlacedField> fields, double frame) {
    std::vector<FieldAt> list;
    for (const PlacedField& field : fields) {
        const Eigen::Affine3d transform = field.transform.at(frame);
        FieldAt at{&field, transform.translation(), {}, {}, {}, {}};
        Vec3d half = Vec3d::Zero();
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3d column = transform.linear().col(axis);
            const double length = column.stableNorm();
            at.axes.col(axis) = column / length;
            at.to_unit.row(axis) = column / length / length;
            half += field.box ? Vec3d(column.cwiseAbs()) : Vec3d(column.cwiseAbs2());
        }
        if (!at.to_unit.allFinite() || field.weight == 0.0) continue; // no volume, or no effect
        if (!field.box) half = half.cwiseSqrt();
        constexpr double slack = 1e-12; // rounding, as of gusts
        const Vec3d reach = half + slack * (half + at.center.cwiseAbs());
        at.lower = at.center - reach;
        at.upper = at.center + reach;
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
        if (!field.transform.moves()) return false;
    }
    return false;
}

void local_wind(const LocalWind& wind, Strands& strands) {
    strands.wind_direction.resize(size_t(strands.blocks));
    strands.wind_response.resize(size_t(strands.blocks));
    strands.wind_speed.resize(size_t(strands.blocks));
    strands.wind_unsheltered.resize(wind.shielded && wind.ground.air ? size_t(strands.blocks) : 0);
    Vec3d lower = Vec3d::Constant(infinity), upper = -lower;
    for (int i = 0; i < strands.blocks; ++i) {
        const Wide3f& p = strands.rest[size_t(i) * size_t(strands.cvs)];
        for (int lane = 0; lane < lanes; ++lane) {
            const Vec3d root(double(p.x[lane]), double(p.y[lane]), double(p.z[lane]));
            lower = lower.cwiseMin(root);
            upper = upper.cwiseMax(root);
        }
    }
    std::vector<FieldAt> near; // usually none or one
    for (const FieldAt& field : wind.fields)
        if ((field.lower.array() <= upper.array()).all() && (field.upper.array() >= lower.array()).all())
            near.push_back(field);
    wind_of_blocks(wind, near, strands);
}

} // namespace marram
