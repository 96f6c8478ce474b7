// SPDX-License-Identifier: Apache-2.0
// Wind fields that a person draws.
//
// Image: the first two channels are the local wind along and across the wind's direction (across: from +x
// towards +z), as fractions of its shear velocity; (1, 0) changes nothing. The image is stretched over the
// terrain, bilinear.
//
// Curves: the wind follows them, in the direction in which they are drawn. With phi the angle from the wind
// to the curve and w the weights of air/guides.h, the wind turns by
//
//   (integral of phi w over all curves) / (pi / reach + integral of w over all curves)
//
// On a long straight curve the wind turns by reach / (reach + cell) of its angle, nearly all; at a distance d
// by reach / (reach + d), so that at the distance reach half of its angle is left.
//
// Cost: samples times segments. Segments, but the last of a curve, are two cells long or more.
#include "procedural/terrain/wind_field.h"

#include "procedural/abi/parallel.h"
#include "procedural/terrain/stretched_image.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// Throws if the field is not finite, is stronger than 10, or turns the wind by more than max_turn; the
// message has the coordinates.
void check_wind_field(const WindField& field, const Domain& domain, const std::string& place) {
    size_t most = 0;
    for (size_t k = 0; k < field.turn.size(); ++k) {
        if (!std::isfinite(field.turn[k]) || !std::isfinite(field.strength[k]) || field.strength[k] > 10.0F)
            throw SceneFault(
                "terrain.wind_field", place,
                fmt::format("the wind field is not finite, or stronger than 10 times the wind, at "
                            "({:g}, {:g})",
                            domain.x(int(k % size_t(domain.nx))), domain.z(int(k / size_t(domain.nx)))),
                "correct the image");
        if (std::abs(field.turn[k]) > std::abs(field.turn[most])) most = k;
    }
    const double turn = double(field.turn[most]) / degree;
    if (std::abs(turn) * degree > WindField::max_turn * (1.0 + 1e-6))
        throw SceneFault(
            "terrain.wind_field", place,
            fmt::format("the wind field turns the wind by {:.1f} degrees at ({:g}, {:g}), more than {:g}",
                        turn, domain.x(int(most % size_t(domain.nx))),
                        domain.z(int(most / size_t(domain.nx))), WindField::max_turn / degree),
            "keep its curves or image closer to the wind's direction");
}

Eigen::AlignedBox2d box_of(const Domain& domain) {
    return {Vec2d(domain.x(0), domain.z(0)), Vec2d(domain.x(domain.nx - 1), domain.z(domain.nz - 1))};
}

} // namespace

WindField wind_field_of_image(const MarramGrid& grid, const Domain& domain, const std::string& place) {
    if (grid.components < 2)
        throw SceneFault("terrain.wind_field", place, "a wind field needs two channels, the image has one",
                         "give the wind along and across its direction as red and green");
    const StretchedImage image(grid, domain, 2);
    WindField field;
    field.turn.resize(domain.count());
    field.strength.resize(domain.count());
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double along = image.at(i, j, 0), across = image.at(i, j, 1);
            field.strength[domain.index(i, j)] = float(std::hypot(along, across));
            field.turn[domain.index(i, j)] =
                along == 0.0 && across == 0.0 ? 0.0F : float(std::atan2(across, along));
        }
    check_wind_field(field, domain, place);
    return field;
}

WindField wind_field_along(const std::vector<DrawnCurve>& curves, double reach, const Domain& domain,
                           const Vec2d& wind, const std::string& place) {
    const std::vector<GuideSegment> segments = guide_segments(curves, domain.cell, box_of(domain));
    std::vector<double> angles; // of the segments, radians from the wind
    for (const GuideSegment& s : segments) {
        const Vec2d along = s.b - s.a;
        angles.push_back(std::atan2(wind.x() * along.y() - wind.y() * along.x(), wind.dot(along)));
    }
    if (segments.empty())
        throw SceneFault("terrain.wind_field", place, "the curves of the wind field have no length",
                         "give each two different points or more");
    WindField field;
    field.turn.resize(domain.count());
    field.strength.assign(domain.count(), 1.0F);
    marram::parallel_for(0, domain.nz, [&](int j) {
        for (int i = 0; i < domain.nx; ++i) {
            const Vec2d p(domain.x(i), domain.z(j));
            double weights = pi / reach, turns = 0.0;
            for (size_t s = 0; s < segments.size(); ++s) {
                const double w = guide_weight(p, segments[s], domain.cell);
                weights += w, turns += w * angles[s];
            }
            field.turn[domain.index(i, j)] = float(turns / weights);
        }
    });
    check_wind_field(field, domain, place);
    return field;
}

} // namespace marram
