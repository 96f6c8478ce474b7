// SPDX-License-Identifier: Apache-2.0
// Scour, echo dune and drift as functions of the distance to a face, and how the zones of several faces
// combine.
#include "procedural/terrain/ruin/ruin_zones.h"

namespace marram {
namespace {

constexpr double ruin_scour_reach = 0.4; // in H
constexpr double ruin_echo_crest = 0.8, ruin_echo_height = 0.16;

} // namespace

double RuinZones::scour(double d, const RuinFace& face) const {
    const double reach = ruin_scour_reach * face.height;
    if (!(d < reach)) return 0.0;
    const double depth = std::min(settings_.scour_depth * face.height, ruin_slope * reach);
    return settings_.scour * face.cosine * depth * (1.0 - std::max(d, 0.0) / reach);
}

double RuinZones::echo(double d, const RuinFace& face) const {
    if (!(d > ruin_scour_reach * face.height && d < ruin_echo_reach * face.height)) return 0.0;
    const double u = d / face.height; // in H
    const double rise = u < ruin_echo_crest
                            ? ruin_smooth((u - ruin_scour_reach) / (ruin_echo_crest - ruin_scour_reach))
                            : ruin_smooth((ruin_echo_reach - u) / (ruin_echo_reach - ruin_echo_crest));
    return settings_.scour * face.cosine *
           std::min(ruin_echo_height * face.height * rise, ruin_slope * face.to_end);
}

double RuinZones::drift(double x, const RuinFace& face) const {
    const double taper = std::min(face.height, 0.5 * face.width),
                 whole = settings_.drift_length * face.height;
    if (!(x < whole)) return 0.0;
    const double to_edge = face.to_end - taper * x / whole; // across the wind
    if (!(to_edge > 0.0)) return 0.0;
    const double length = whole * std::min(1.0, face.to_end / taper);
    const double height = settings_.drift_height * face.height * (1.0 - ruin_smooth(x / length));
    return settings_.drift * std::min(height, ruin_slope * to_edge);
}

// The nearest windward face downwind gives scour and echo dune, the nearest lee face upwind a drift. Either
// is blocked by a face of the other kind in between.
RuinShape RuinZones::at(const RuinLine& line, double s) const {
    const RuinFace *front = nullptr, *passed = nullptr, *behind = nullptr, *ahead = nullptr;
    for (const RuinFace& face : line.windward) {
        if (face.s > s) {
            front = &face;
            break;
        }
        passed = &face;
    }
    for (const RuinFace& face : line.lee) {
        if (face.s >= s) {
            ahead = &face;
            break;
        }
        behind = &face;
    }
    RuinShape shape;
    if (passed && ahead && !(behind && behind->s > passed->s)) { // inside a solid: pad zones from both sides
        const double in = s - passed->s, out = ahead->s - s;
        if (in <= pad(*passed)) shape.scour = scour(0.0, *passed);
        if (out <= pad(*ahead)) shape.deposit = drift(0.0, *ahead);
        return shape;
    }
    double ramp = 1.0; // fades out the drift towards the deepest scour
    if (front && !(ahead && ahead->s < front->s)) {
        const double d = front->s - s;
        shape.scour = scour(d, *front);
        shape.deposit = echo(d, *front);
        if (front->height > 0.0) ramp = std::min(1.0, d / (ruin_scour_reach * front->height));
    }
    if (behind && !(passed && passed->s > behind->s))
        shape.deposit = std::max(shape.deposit, ramp * drift(s - behind->s, *behind));
    return shape;
}

RuinShape ruin_between_lines(const RuinLines& lines, const RuinZones& zones, double s, double t) {
    const double q = (t - lines.first) / lines.step;
    if (!(q > -1.0 && q < double(lines.lines.size()))) return {};
    const double floor = std::floor(q), u = q - floor;
    const auto line = [&](double k) {
        return k >= 0.0 && k < double(lines.lines.size()) ? zones.at(lines.lines[size_t(k)], s) : RuinShape{};
    };
    const RuinShape a = line(floor), b = line(floor + 1.0);
    return {(1.0 - u) * a.scour + u * b.scour, (1.0 - u) * a.deposit + u * b.deposit};
}

} // namespace marram
