// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/local_wind.h"

#include "procedural/abi/ramp_table.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace marram {
namespace {

// c(q) / q of local_wind.h, from q^2.
MARRAM_INLINE VDouble scully_over_q(const VDouble& squared, double core) {
    return (2.0 / core) / (squared * (1.0 / (core * core)) + 1.0);
}

// R v of eight v.
MARRAM_INLINE Wide3d rotated(const Eigen::Matrix3d& r, const Wide3d& v) {
    return {v.x * r(0, 0) + v.y * r(0, 1) + v.z * r(0, 2), v.x * r(1, 0) + v.y * r(1, 1) + v.z * r(1, 2),
            v.x * r(2, 0) + v.y * r(2, 1) + v.z * r(2, 2)};
}

MARRAM_INLINE VDouble largest(const Wide3d& x) { return vmax(vmax(vabs(x.x), vabs(x.y)), vabs(x.z)); }

// The field's influence s at t, 0 outside.
MARRAM_INLINE VDouble influence(const PlacedField& field, const VDouble& t) {
    return select(t < 1.0, evaluate(field.ramp, t) * field.weight, 0.0);
}

MARRAM_INLINE Wide3d with_vortex(const FieldAt& at, const Wide3d& p, const Wide3d& v) {
    const PlacedField& field = *at.field;
    const Wide3d x = rotated(at.to_unit, p - splat3(at.center.data()));
    const VDouble rr = dot(x, x);
    const VDouble t = field.shape == FieldShape::box ? largest(x) : vsqrt(rr);
    if (!any(t < 1.0)) return v;
    const VDouble share = influence(field, t);
    Wide3d f = splat3(field.velocity.data());
    if (field.swirl != 0.0) {
        const VDouble turn = scully_over_q(x.x * x.x + x.z * x.z, field.core) * field.swirl;
        f = f + Wide3d{x.z * turn, VDouble{}, -x.x * turn}; // y axis cross x
    }
    if (field.pull != 0.0) f = f - x * (scully_over_q(rr, field.core) * field.pull);
    const Wide3d world = rotated(at.axes, f);
    return v + (field.replaces ? world - v : world) * share;
}

MARRAM_INLINE Wide3d with_grid(const FieldAt& at, const Wide3d& p, const Wide3d& v) {
    const PlacedField& field = *at.field;
    const bool staggered = field.velocities->staggered;
    Wide3d changed = v;
    VDouble inside; // influence in the box
    GridPlaces places;
    bool reached = false;
    for (const SamplesAt& samples : at.grids) {
        if (!samples.samples) break;
        if (!samples.in_the_same_box) {
            const Wide3d x = rotated(samples.to_unit, p - splat3(samples.center.data()));
            const VDouble t = largest(x);
            reached = any(t < 1.0);
            if (!reached) continue;
            inside = influence(field, t);
            places = grid_places(samples.samples->counts, staggered, x);
        }
        if (!reached) continue;
        const VDouble share = inside * samples.share;
        const Wide3d world = rotated(at.axes, velocities_at(*samples.samples, staggered, places));
        changed = changed + (field.replaces ? world - v : world) * share;
    }
    return changed;
}

// mean: V of local_wind.h.
MARRAM_INLINE Wide3d with_image(const FieldAt& at, const Wide3d& p, const Wide3d& v, const Wide3d& mean) {
    const PlacedField& field = *at.field;
    const Wide3d x = rotated(at.to_unit, p - splat3(at.center.data()));
    const VDouble t = vmax(vabs(x.x), vabs(x.z));
    if (!any(t < 1.0)) return v;
    VFloat value[2];
    plan_values<2>(*field.map, x.x, x.z, value);
    const VDouble along = to_double(value[0]), across = to_double(value[1]);
    const Wide3d f = mean * along + Wide3d{-mean.z, VDouble{}, mean.x} * across;
    return v + (f - (field.replaces ? v : mean)) * influence(field, t);
}

MARRAM_INLINE Wide3d with_curves(const FieldAt& at, const Wide3d& p, const Wide3d& v, const Wide3d& mean) {
    const PlacedField& field = *at.field;
    const Wide3d x = rotated(at.to_unit, p - splat3(at.center.data()));
    const VLong inside = vmax(vabs(x.x), vabs(x.z)) < 1.0;
    if (!any(inside)) return v;
    VFloat value[4]; // times the influence
    plan_values<4>(*field.map, x.x, x.z, value);
    const VDouble weight = select(inside, splat(field.weight), splat(0.0)), share = to_double(value[0]);
    const VDouble speed = vsqrt(mean.x * mean.x + mean.z * mean.z);
    Wide3d turned = {to_double(value[1]) * speed - mean.x * share, VDouble{},
                     to_double(value[2]) * speed - mean.z * share};
    if (field.replaces) turned = turned + (mean - v) * to_double(value[3]);
    return v + turned * weight;
}

MARRAM_INLINE Wide3d with_field(const FieldAt& at, const Wide3d& p, const Wide3d& v, const Wide3d& mean) {
    switch (at.field->shape) {
    case FieldShape::grid:
        return with_grid(at, p, v);
    case FieldShape::image:
        return with_image(at, p, v, mean);
    case FieldShape::curves:
        return with_curves(at, p, v, mean);
    default:
        return with_vortex(at, p, v);
    }
}

MARRAM_HOT void wind_of_blocks(const LocalWind& wind, std::span<const FieldAt> fields, Strands& strands) {
    const Ramp& response = wind.response;
    const Wide3d direction = splat3(wind.direction.data()), undisturbed = direction * splat(wind.speed);
    const float mean_response = float(std::clamp(response(wind.speed), 0.0, 1.0));
    const bool once = !strands.wind_unsheltered.empty();
    for (int i = 0; i < strands.blocks; ++i) {
        const Wide3f* const rest = strands.rest.data() + size_t(i) * size_t(strands.cvs);
        Wide3d before_fields = undisturbed;
        if (wind.ground.air) {
            const Wide3d root = to_double(rest[0]);
            VDouble rise{}, reach{};
            for (int k = 1; k < strands.cvs; ++k) {
                const Wide3d way = to_double(rest[k]) - root;
                rise = vmax(rise, way.y);
                reach = vmax(reach, dot(way, way));
            }
            const VDouble above = vmax(rise * 0.5, vsqrt(reach) * 0.1);
            before_fields =
                wind_over_ground(wind.ground, wind.reference, root, above, wind.speed * wind.direction);
        }
        for (int k = 0; k < (wind.at_cvs ? strands.cvs : 1); ++k) {
            const Wide3d p = to_double(rest[k]);
            const auto with_fields = [&](Wide3d v) MARRAM_ALWAYS_INLINE {
                for (const FieldAt& field : fields) v = with_field(field, p, v, undisturbed);
                return v;
            };
            const Wide3d v = with_fields(before_fields);
            const Wide3d d = v - undisturbed;
            const VLong changed = dot(d, d) > 0.0;
            const VDouble length = vsqrt(dot(v, v));
            const VLong turned = changed & (length > 0.0);
            const VDouble strength = vmin(vmax(evaluate(response, length), 0.0), 1.0);
            const size_t at = strands.wind_at(i, k);
            strands.wind_direction[at] = select(turned, v * (1.0 / select(turned, length, 1.0)), direction);
            strands.wind_speed[at] = to_float(length);
            const VFloat sheltered = to_float(select(changed, strength, splat(double(mean_response))));
            strands.wind_response[at] = sheltered;
            if (!once) continue;
            const Wide3d level = with_fields(undisturbed);
            const VFloat there = to_float(vmin(vmax(evaluate(response, vsqrt(dot(level, level))), 0.0), 1.0));
            strands.wind_unsheltered[at] = vmax(sheltered, there);
        }
    }
}

} // namespace

void local_wind(const LocalWind& wind, Strands& strands) {
    strands.wind_at_cvs = wind.at_cvs;
    const int points = wind.at_cvs ? strands.cvs : 1; // of a strand
    const size_t size = size_t(strands.blocks) * size_t(points);
    strands.wind_direction.resize(size);
    strands.wind_response.resize(size);
    strands.wind_speed.resize(size);
    strands.wind_unsheltered.resize(wind.shielded && wind.ground.air ? size : 0);
    Vec3d lower = Vec3d::Constant(infinity), upper = -lower;
    for (int i = 0; i < strands.blocks; ++i)
        for (int k = 0; k < points; ++k) {
            const Wide3f& p = strands.rest[size_t(i) * size_t(strands.cvs) + size_t(k)];
            for (int lane = 0; lane < lanes; ++lane) {
                const Vec3d point(double(p.x[lane]), double(p.y[lane]), double(p.z[lane]));
                lower = lower.cwiseMin(point);
                upper = upper.cwiseMax(point);
            }
        }
    std::vector<FieldAt> near; // usually none or one
    for (const FieldAt& field : wind.fields)
        if ((field.lower.array() <= upper.array()).all() && (field.upper.array() >= lower.array()).all())
            near.push_back(field);
    wind_of_blocks(wind, near, strands);
}

} // namespace marram
