// SPDX-License-Identifier: Apache-2.0
// Shapes of the dunes of a mass desert: size, crest and profile of each of the eight kinds.
//
// Size. The height H is uniform in its range. For barchans and domes W = 8.6 H + 8.8 m is the width across
// the wind and L = 5.5 H + 10.8 m the length from the stoss foot to the brink (regression lines through field
// barchans). For the others:
//     barchanoid, transverse, seif   width or length is the crest's, uniform in `ridge_length`
//     star                           3 to 5 arms, each 4 to 6 H long; W = L = 10 H
//     parabolic                      W as above, arms 1.2 W long upwind
//     nabkha                         W = 5 H, a tail of 6 H downwind
// The horns of a barchan reach `horn_length` W downwind of the brink, each up to 30 % longer or shorter. Its
// crest consists of two elliptic arcs. The widths of a barchanoid ridge's crescents vary by up to 35 %.
//
// Profile. Slip faces are straight at `slip_angle`. A windward side is a smoothstep from the brink to the
// foot; its steepest slope is 1.5 H/L. If that is less than `windward_angle`, the side is steepened by a flat
// part at the brink, at most 1/7 of L long. With the regression lines, H = 4 to 8 m reach 12 degrees and
// lower dunes less (2 m: 9), as in the field. A seif and the arms of a star have a slip face over the upper
// 0.55 of both sides and a plinth below, a parabola that runs out flat. All slices of a barchan along the
// wind are scaled copies of the middle one, smaller towards the horns: where the brink is x downwind of its
// middle, the fraction f = 1 - x / depth gives the height f H and the windward length f L, so stoss foot and
// brink meet at the horns. (Brink and windward foot have such shapes in the field: Sauermann et al., "The
// shape of the barchan dunes of Southern Morocco", Geomorphology 36, 2000.) This requires widths measured
// along the wind: the windward side is stretched along the wind, by 2 for barchans and by 1.5 for ridges
// (outer_slope_stretch; larger factors make flanks as steep as slip faces: with 2, H = 5 m reaches 29 degrees
// there). The flanks extend beyond the crest, which is 0.93 W wide. For H = 2 to 20 m, W is within 6 % of its
// line. L, measured where the surface is 0.002 H high, is 3 % short. DuneShape's distance to a curved crest
// is not the exact distance (see dune_shape.cpp); slope_width is set to its value at the stoss foot. A slip
// face is within 1 degree of `slip_angle` in the middle. It is up to 2 degrees steeper where the crest bends
// and up to 4 in the joints of a barchanoid. `crest_radius` rounds crests over about a grid cell, to hide
// grid steps in light and shadow.
#include "procedural/terrain/mass/mass_shapes.h"

#include <algorithm>
#include <array>

namespace marram {

// Crests are in metres, x downwind and y across, from the dune's place.
namespace {

// The distance from a crest as in dune_shape.cpp, stretched by `stretch` across the wind. `share`: the
// effective value of the ramp `width` there, which must be linear along each segment.
double crest_distance(const std::vector<Vec2d>& crest, const Ramp& width, double stretch, const Vec2d& at,
                      double& share) {
    double length = 0.0, begin = 0.0, sum = 0.0, weighted = 0.0;
    for (size_t i = 0; i + 1 < crest.size(); ++i) length += (crest[i + 1] - crest[i]).norm();
    for (size_t i = 0; i + 1 < crest.size(); ++i) {
        const Vec2d edge = crest[i + 1] - crest[i];
        const double plain = edge.norm();
        if (!(plain > 0.0)) continue;
        const Vec2d wide(edge.x(), stretch * edge.y());
        const double l = wide.norm();
        constexpr int steps = 4; // Simpson's rule: accurate, as the foot is several segments away
        for (int k = 0; k <= steps; ++k) {
            const double t = double(k) / steps;
            const Vec2d to = crest[i] + t * edge - at;
            const double r2 = to.x() * to.x() + stretch * stretch * to.y() * to.y();
            const double weight = (k == 0 || k == steps ? 1.0 : k % 2 ? 4.0 : 2.0) * l / (3.0 * steps);
            const double value = weight / (r2 * r2 * std::sqrt(r2));
            sum += value;
            weighted += value * width((begin + plain * t) / length);
        }
        begin += plain;
    }
    share = weighted / sum;
    return std::pow(0.75 * sum, -0.25);
}

// The slope_width that puts the foot of the slope at `foot`.
double slope_width_to_foot(const std::vector<Vec2d>& crest, const Ramp& width, double stretch,
                           const Vec2d& foot) {
    double share = 1.0;
    const double distance = crest_distance(crest, width, stretch, foot, share);
    return distance / share;
}

Ramp mass_ramp(std::initializer_list<double> knots, std::string_view interpolation = "smooth") {
    return Ramp(std::span(knots.begin(), knots.size()), interpolation);
}

double field_width(double height) { return 8.6 * height + 8.8; }
double field_length(double height) { return 5.5 * height + 10.8; }

// The windward profile: a flat part at the brink, then a smoothstep to the foot.
Ramp windward_profile(const MassSettings& s, double height, double length) {
    constexpr double steepest = 1.75; // maximum slope in units of height / length: a flat part of 1/7
    const double wanted = std::tan(s.windward_angle) * length / height;
    const double factor = wanted > 1.5 ? std::min(wanted, steepest) : 1.5;
    const double flat = 1.0 - 1.5 / factor;
    return mass_ramp({flat, 1.0, 1.0, 0.0});
}

// Stretch of the windward side along the wind, relative to across, of barchans and of ridges.
constexpr double barchan_stretch = 2.0, ridge_stretch = 1.5;

// A point on an elliptic arc from (depth, -width / 2) through (0, 0) to (depth, width / 2), 75 degrees to
// either side.
Vec2d crescent_point(double t, double width, double depth) { // t from -1 to 1
    constexpr double end = 75.0 * degree;
    return {depth * (1.0 - std::cos(end * t)) / (1.0 - std::cos(end)),
            0.5 * width * std::sin(end * t) / std::sin(end)};
}

std::vector<Vec2d> crescent(double width, const Vec2d& depths, int segments) { // depths: of the two halves
    std::vector<Vec2d> crest;
    for (int i = 0; i <= segments; ++i)
        crest.push_back(crescent_point(2.0 * i / segments - 1.0, width, depths[2 * i > segments]));
    return crest;
}

// 1 at the middle of a crescent and 0 at its ends: linear in x from 0 to its depth. One knot for each crest
// point.
Ramp crescent_share(const std::vector<Vec2d>& crest) {
    std::vector<double> arc = {0.0}, knots;
    for (size_t i = 1; i < crest.size(); ++i) arc.push_back(arc.back() + (crest[i] - crest[i - 1]).norm());
    for (size_t i = 0; i < crest.size(); ++i) {
        const double depth = 2 * i > crest.size() ? crest.back().x() : crest.front().x();
        knots.insert(knots.end(), {arc[i] / arc.back(), std::max(1.0 - crest[i].x() / depth, 0.0)});
    }
    return Ramp(knots, "linear");
}

// Stretches the windward side along the wind, independent of the direction of the crest's chord.
void windward_along_wind(MassDune& dune, double stretch) {
    const Vec2d chord = dune.crests[0].back() - dune.crests[0].front();
    dune.settings.outer_slope_stretch = stretch;
    dune.settings.outer_slope_turn = std::atan2(chord.x(), chord.y());
}

// Slices along the wind are scaled copies of the middle one: height and windward length are both proportional
// to 1 - x / depth of the brink. So the windward foot is the brink's ellipse, stretched from `depth` to L +
// depth.
void make_barchan(const MassSettings& s, const MassHash& random, MassDune& dune) {
    const double h = dune.height;
    dune.width = field_width(h);
    dune.length = field_length(h);
    DuneSettings& d = dune.settings;
    constexpr double horn_variation = 0.3; // relative variation of the horns' lengths
    const Vec2d horns(1.0 + horn_variation * random.jitter(MassRandomKey::wave),
                      1.0 + horn_variation * random.jitter(MassRandomKey::wave, 1));
    constexpr double span = 0.93; // crest width as a fraction of W: the flanks extend beyond the crest
    dune.crests = {crescent(span * dune.width, s.horn_length * dune.width * horns, 16)};
    d.main_curve_shape = d.outer_slope_fall_off_along_curve = crescent_share(dune.crests[0]);
    windward_along_wind(dune, barchan_stretch);
    d.slope_width = slope_width_to_foot(dune.crests[0], d.outer_slope_fall_off_along_curve, barchan_stretch,
                                        {-dune.length, 0.0});
    d.outer_slope_shape = windward_profile(s, h, dune.length);
    d.inner_slope_angle = s.slip_angle;
}

// Heights along a ridge: 0 at its ends; within it random between `low` and 1, tapered towards the ends.
Ramp ridge_heights(const MassHash& random, double low) {
    constexpr int inner = 7;
    constexpr std::array<double, inner> taper = {0.6, 0.9, 1.0, 1.0, 1.0, 0.9, 0.6};
    std::array<double, inner> heights;
    for (int i = 0; i < inner; ++i)
        heights[size_t(i)] = taper[size_t(i)] * (low + (1.0 - low) * random(MassRandomKey::crest, i));
    heights[2 + size_t(random(MassRandomKey::crest, inner) * 3.0)] =
        1.0; // one knot has the dune's full height
    std::vector<double> knots = {0.0, 0.0};
    for (int i = 0; i < inner; ++i)
        knots.insert(knots.end(), {(i + 1.0) / (inner + 1.0), heights[size_t(i)]});
    knots.insert(knots.end(), {1.0, 0.0});
    return Ramp(knots, "smooth");
}

// Sideways displacement of a ridge's crest, t in [0, 1]: two sine waves with random parameters; the mean over
// many ridges is 0.
double ridge_wave(const MassHash& random, double length, double sinuosity, double t) {
    const double waves = 1.5 + random(MassRandomKey::wave),
                 second = 2.1 + 0.8 * random(MassRandomKey::wave, 1);
    const double a = 2.0 * pi * (waves * t + random(MassRandomKey::wave, 2));
    const double b = 2.0 * pi * (waves * second * t + random(MassRandomKey::wave, 3));
    return sinuosity * length / waves * (0.7 * std::sin(a) + 0.3 * std::sin(b));
}

constexpr int ridge_segments = 32;

void make_transverse(const MassSettings& s, const MassHash& random, MassDune& dune) {
    dune.width = random.in(s.ridge_length, MassRandomKey::length);
    dune.length = field_length(dune.height);
    std::vector<Vec2d> crest;
    for (int i = 0; i <= ridge_segments; ++i) {
        const double t = double(i) / ridge_segments;
        crest.emplace_back(ridge_wave(random, dune.width, s.sinuosity, t), (t - 0.5) * dune.width);
    }
    dune.crests = {std::move(crest)};
    DuneSettings& d = dune.settings;
    d.main_curve_shape = ridge_heights(random, 0.7);
    windward_along_wind(dune, ridge_stretch);
    d.slope_width = dune.length;
    d.outer_slope_fall_off_along_curve = mass_ramp({0.0, 0.3, 0.12, 1.0, 0.88, 1.0, 1.0, 0.3});
    d.outer_slope_shape = windward_profile(s, dune.height, dune.length);
    d.inner_slope_angle = s.slip_angle;
}

// The joints between crescents of different widths, as fractions of the ridge's width.
std::vector<double> barchanoid_ends(const MassHash& random, int links) {
    std::vector<double> ends = {0.0};
    for (int link = 0; link < links; ++link)
        ends.push_back(ends.back() + 1.0 + 0.35 * random.jitter(MassRandomKey::arm, 8 + link));
    for (double& end : ends) end /= ends.back();
    ends.back() = 1.0;
    return ends;
}

// Two to four crescents joined at their horns. At the joints the crest is lower and points downwind.
void make_barchanoid(const MassSettings& s, const MassHash& random, MassDune& dune) {
    dune.width = random.in(s.ridge_length, MassRandomKey::length);
    dune.length = field_length(dune.height);
    const double wanted = std::clamp(dune.width / (0.8 * field_width(dune.height)), 2.0, 4.0);
    const int links = int(std::lround(wanted));
    constexpr int segments = 8;
    std::vector<Vec2d> crest;
    std::vector<double> heights = {0.0, 0.0}, widths = {0.0, 0.2};
    const std::vector<double> ends = barchanoid_ends(random, links);
    for (int link = 0; link < links; ++link) {
        const double from = ends[size_t(link)], to = ends[size_t(link) + 1], each = (to - from) * dune.width;
        const double depth = s.horn_length * each * (0.8 + 0.4 * random(MassRandomKey::wave, link));
        for (int k = link == 0 ? 0 : 1; k <= segments; ++k) {
            const Vec2d p = crescent_point(2.0 * k / segments - 1.0, each, depth);
            crest.emplace_back(p.x() - depth, p.y() + (0.5 * (from + to) - 0.5) * dune.width);
        }
        const bool last = link + 1 == links;
        heights.insert(heights.end(),
                       {0.5 * (from + to),
                        link == links / 2 ? 1.0 : 0.8 + 0.2 * random(MassRandomKey::crest, link), to,
                        last ? 0.0 : 0.45 + 0.3 * random(MassRandomKey::arm, link)});
        widths.insert(widths.end(), {0.5 * (from + to), 1.0, to, last ? 0.2 : 0.7});
    }
    dune.crests = {std::move(crest)};
    DuneSettings& d = dune.settings;
    d.main_curve_shape = Ramp(heights, "smooth");
    d.outer_slope_fall_off_along_curve = Ramp(widths, "smooth");
    windward_along_wind(dune, ridge_stretch);
    d.slope_width = dune.length;
    d.outer_slope_shape = windward_profile(s, dune.height, dune.length);
    d.inner_slope_angle = s.slip_angle;
}

// A slip face over the upper 0.55 of the height, and a plinth that runs out flat.
Ramp face_and_plinth() {
    constexpr double face = 0.55, share = 0.22; // slip face: fractions of the height and of the width
    constexpr int steps = 24;                   // enough to hide the edges between the linear pieces
    std::vector<double> knots = {0.0, 1.0};
    for (int i = 0; i <= steps; ++i) {
        const double t = double(i) / steps, rest = 1.0 - t;
        knots.insert(knots.end(), {share + (1.0 - share) * t, (1.0 - face) * rest * rest});
    }
    return Ramp(knots, "linear");
}

// Makes both sides equal. Widths are proportional to the height, so that slopes are constant along the crest.
void two_slip_faces(const MassSettings& s, MassDune& dune) {
    DuneSettings& d = dune.settings;
    d.outer_slope_shape = d.inner_slope_shape = face_and_plinth();
    const double steepness = (1.0 - d.outer_slope_shape.values()[1]) / d.outer_slope_shape.positions()[1];
    d.slope_width = steepness * dune.height / std::tan(s.slip_angle);
    d.outer_slope_mult = d.inner_slope_mult = 1.0;
    d.inner_slope_angle = 0.0;
    d.outer_slope_fall_off_along_curve = d.inner_slope_fall_off_along_curve = d.main_curve_shape;
}

void make_seif(const MassSettings& s, const MassHash& random, MassDune& dune) {
    dune.length = random.in(s.ridge_length, MassRandomKey::length);
    std::vector<Vec2d> crest;
    for (int i = 0; i <= ridge_segments; ++i) {
        const double t = double(i) / ridge_segments;
        crest.emplace_back((t - 0.5) * dune.length, ridge_wave(random, dune.length, s.sinuosity, t));
    }
    dune.crests = {std::move(crest)};
    dune.settings.main_curve_shape = ridge_heights(random, 0.75);
    two_slip_faces(s, dune);
    dune.width = 2.0 * dune.settings.slope_width;
}

void make_star(const MassSettings& s, const MassHash& random, MassDune& dune) {
    constexpr int segments = 12;
    const int arms = 3 + int(3.0 * random(MassRandomKey::arm));
    const double first = 2.0 * pi * random(MassRandomKey::arm, 1), sector = 2.0 * pi / arms;
    dune.crests.clear();
    for (int arm = 0; arm < arms; ++arm) {
        const double angle = first + sector * (arm + 0.2 * random.jitter(MassRandomKey::arm, 2 + arm));
        const double bend = 30.0 * degree * random.jitter(MassRandomKey::wave, arm);
        const double length = dune.height * (5.0 + random.jitter(MassRandomKey::arm, 8 + arm));
        std::vector<Vec2d> crest;
        for (int i = 0; i <= segments; ++i) {
            const double t = double(i) / segments;
            crest.push_back(mass_turned({length * t, 0.0}, angle + bend * t));
        }
        dune.crests.push_back(std::move(crest));
    }
    dune.settings.main_curve_shape =
        mass_ramp({0.0, 1.0, 0.2, 0.78, 0.4, 0.58, 0.6, 0.4, 0.8, 0.22, 1.0, 0.0}, "linear");
    two_slip_faces(s, dune);
    dune.width = dune.length = 10.0 * dune.height;
}

// A mound around a short crest across the wind.
void make_dome(const MassSettings&, MassDune& dune) {
    constexpr int segments = 8;
    dune.width = field_width(dune.height);
    std::vector<Vec2d> crest;
    for (int i = 0; i <= segments; ++i)
        crest.emplace_back(0.0, dune.width * 0.3 * (double(i) / segments - 0.5));
    DuneSettings& d = dune.settings;
    d.main_curve_shape = mass_ramp({0.0, 0.9, 0.5, 1.0, 1.0, 0.9});
    d.slope_width = slope_width_to_foot(crest, Ramp(), 1.0, {0.0, 0.5 * dune.width});
    dune.crests = {std::move(crest)};
    d.outer_slope_mult = d.inner_slope_mult = 1.0;
    d.outer_slope_shape = d.inner_slope_shape = mass_ramp({0.0, 1.0, 1.0, 0.0});
    dune.length = field_length(dune.height);
}

// A U-shaped dune whose arms, fixed by plants, point upwind. The slip face is on the outside of its nose.
void make_parabolic(const MassSettings& s, MassDune& dune) {
    dune.width = field_width(dune.height);
    dune.length = field_length(dune.height);
    DuneSettings& d = dune.settings;
    dune.crests = {crescent(0.8 * dune.width, Vec2d::Constant(-1.2 * dune.width), 32)}; // its nose is narrow
    d.main_curve_shape = mass_ramp({0.0, 0.0, 0.25, 0.45, 0.5, 1.0, 0.75, 0.45, 1.0, 0.0});
    d.outer_slope_fall_off_along_curve = mass_ramp({0.0, 0.1, 0.25, 0.3, 0.5, 1.0, 0.75, 0.3, 1.0, 0.1});
    d.slope_width = dune.length;
    d.outer_slope_shape = windward_profile(s, dune.height, dune.length);
    d.inner_slope_angle = s.slip_angle;
}

// A mound around a tuft, with a tail in its lee.
void make_nabkha(const MassSettings&, MassDune& dune) {
    constexpr int segments = 8;
    dune.width = 5.0 * dune.height;
    dune.length = 6.0 * dune.height;
    std::vector<Vec2d> crest;
    for (int i = 0; i <= segments; ++i) crest.emplace_back(dune.length * i / segments, 0.0);
    dune.crests = {std::move(crest)};
    DuneSettings& d = dune.settings;
    d.main_curve_shape = mass_ramp({0.0, 1.0, 1.0, 0.0});
    d.slope_width = 0.5 * dune.width;
    d.outer_slope_mult = d.inner_slope_mult = 1.0;
    d.outer_slope_fall_off_along_curve = d.inner_slope_fall_off_along_curve = mass_ramp({0.0, 1.0, 1.0, 0.3});
    d.outer_slope_shape = d.inner_slope_shape = mass_ramp({0.0, 1.0, 1.0, 0.0});
}

} // namespace

void make_mass_shape(const MassSettings& s, const MassHash& random, MassDune& dune) {
    switch (dune.kind) {
    case MassKind::barchan:
        return make_barchan(s, random, dune);
    case MassKind::barchanoid:
        return make_barchanoid(s, random, dune);
    case MassKind::transverse:
        return make_transverse(s, random, dune);
    case MassKind::seif:
        return make_seif(s, random, dune);
    case MassKind::star:
        return make_star(s, random, dune);
    case MassKind::dome:
        return make_dome(s, dune);
    case MassKind::parabolic:
        return make_parabolic(s, dune);
    case MassKind::nabkha:
        return make_nabkha(s, dune);
    }
}

double mass_reach(const MassSettings& s) {
    const double h = s.height.y(), ridge = s.ridge_length.y();
    // The crest: half a ridge with its waves; half a ridge and the horns of its crescents; a crescent's horns or a
    // parabolic dune's arms; a star's arms. Then the slope is added.
    // The longest of two crescents takes 1.35 / (1.35 + 0.65) of its ridge, and its horns 1.2 horn_length of that.
    constexpr double barchanoid_depth = 1.2 * 1.35 / 2.0;
    const double crest = std::max({ridge * (0.5 + s.sinuosity / 1.5),
                                   ridge * std::hypot(0.5, barchanoid_depth * s.horn_length),
                                   (1.3 + s.horn_length) * field_width(h), 6.0 * h});
    return crest + std::max(2.0 * field_length(h), 2.5 * h / std::tan(s.slip_angle)) + s.boundary_noise;
}

} // namespace marram
