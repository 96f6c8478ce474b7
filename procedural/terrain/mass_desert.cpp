// SPDX-License-Identifier: Apache-2.0
// mass_desert: a field of many dunes. Each dune is a description (crest curves with DuneSettings) with an id,
// and can be edited individually. Its surface is that of dune_shape.cpp.
//
// Kind. The regime chart follows Wasson and Hyde (Nature 304, 1983): cover c (for the equivalent sand
// thickness) against variability v = 1 - RDP/DP of the wind direction. The chart of the field data has no
// sharp borders; those used here are
//     plants > 0.3             parabolic where c >= 0.35 and v < 0.5, else nabkha
//     v < 0.35                 barchan for c < 0.35, barchanoid for c < 0.65, transverse above
//     v >= 0.35                star for c >= 1.3 - v, else seif for c < 0.65, transverse above
// c and v of each dune deviate by at most `kind_mixing`, so that kinds mix near a border. If the chart gives
// a barchan lower than 1 m, it becomes a dome, because it would have no slip face (the smallest barchans in
// the field are about that high).
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
//
// Place. Each place is a function of the seed and a cell (i, j, k) only, independent of the area and of edits
// of other dunes. The id is that cell, packed: 20 bits of i, 20 of j, 12 of k. Ids are unique within 2^20
// cells in either direction, and exact as doubles.
//     random   stateless dart throwing: 4 darts for every square of the minimum spacing, each with a hashed
//              place, priority and spacing. A dart is accepted if no accepted dart of higher priority is closer
//              than the mean of their spacings. This is evaluated by recursion over neighbours of ever higher
//              priority, so the result is that of the infinite plane. Spacings above 8 times the minimum are
//              clamped to 8 times.
//     cells    a lattice along the wind; neighbours in a row or a column are spacing[0] to spacing[1] apart
//     across   rows across the wind, each shifted sideways and, along the wind, by up to a quarter of the width
//              of the spacing range. In a row, ridges across the wind follow each other at the mean ridge
//              length, seifs and other dunes at the mean spacing
//     along    along each curve, both spacings as arc lengths
// No two dunes are closer than spacing[0]; `along` and `across` measure it along the curve or the row.
//
// Merging. Overlapping thicknesses a and b are merged by the smooth maximum of layer.h over k, with
//     1/k = 1/merge + 1/(2a) + 1/(2b)
// k goes to 0 with either thickness, so a dune changes nothing beyond its foot, and k has no crease. The
// operation is commutative but not associative: dunes are merged in order of id.
//
// The layer generates dunes up to mass_reach() beyond the domain, so that a cropped terrain matches the
// whole. Cost: a dune takes about 10 us to describe and 30 us to resample and to bound, plus the cost of
// DuneShape a sample and segment. 1,013 dunes of 2 to 6 m on 2048^2 samples: 0.05 s and 0.4 s of CPU time on
// two threads.
//
// Export. With `list`, `marram info SCENE` prints each dune, edits applied, as [[curves]] and a layer of type
// dune. The text can replace the layer (below [[procedural]], as TOML requires) and be edited further.
// Heights match within 1e-4 of the dune's height (curves are floats) if the ground has no sand below the
// dunes, or if they do not overlap. With sand below, drawn dunes are combined with it one by one, so overlaps
// differ: they cannot be merged with each other first. With "replace" the feet of drawn dunes do not fade.
//
//     [[procedural.layer]]
//     type = "mass_desert"
//     sand_cover = 0.2
//     height = [2, 6]
//     spacing = [80, 140]
//     [[procedural.layer.edit]]
//     id = 2251801961172992
//     move = [12, -4]
#include "procedural/terrain/mass_desert.h"

#include "core/math/digest.h"
#include "core/math/hash.h"
#include "procedural/terrain/dune_layer.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <unordered_map>

namespace marram {

namespace {

constexpr double least_height = 1e-3, most_height = 1e3, least_spacing = 0.1, most_spacing = 1e6; // metres

constexpr std::array<std::string_view, 8> mass_kinds = {"barchan", "barchanoid", "transverse", "seif",
                                                        "star",    "dome",       "parabolic",  "nabkha"};

// Keys of the random numbers of one dune.
enum class MassRandomKey : uint64_t {
    place_x,
    place_z,
    spacing,
    priority,
    density,
    height,
    angle, // 4
    cover = angle + 4,
    variability,
    length,
    wave,             // 8
    crest = wave + 8, // heights along the crest, 16
    arm = crest + 16, // 16
    noise = arm + 16,
    row,
    stagger
};

// The random numbers of one dune or cell.
struct MassHash {
    uint64_t word;
    double operator()(MassRandomKey use, int more = 0) const { // in [0, 1)
        return unit_double(hash(word, uint64_t(use) + uint64_t(more)));
    }
    double in(const Vec2d& range, MassRandomKey use) const {
        return range.x() + (range.y() - range.x()) * (*this)(use);
    }
    double jitter(MassRandomKey use, int more = 0) const { return 2.0 * (*this)(use, more) - 1.0; }
    // Approximately normal: mean 0, variance 1, bounded by 3.5 (sum of four uniform numbers).
    double normal(MassRandomKey use) const {
        double sum = -2.0;
        for (int i = 0; i < 4; ++i) sum += (*this)(use, i);
        return sum * std::sqrt(3.0);
    }
};

Vec2d mass_turned(const Vec2d& v, double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

// ---- Places ----------------------------------------------------------------------------------------------------------

struct MassPlace {
    uint64_t id;
    Vec2d at;
    double angle; // downwind
};

uint64_t mass_id(int64_t i, int64_t j, int64_t k) {
    constexpr uint64_t half = 1 << 19, mask = (1 << 20) - 1;
    return ((uint64_t(i) + half) & mask) << 32 | ((uint64_t(j) + half) & mask) << 12 | (uint64_t(k) & 0xfff);
}

struct MassArea {
    Vec2d lower, upper;
    bool has(const Vec2d& p) const {
        return (p.array() >= lower.array()).all() && (p.array() < upper.array()).all();
    }
};

uint64_t mass_seed(const MassSettings& settings) {
    return hash(settings.seed, uint64_t(settings.arrangement) + 0x6d617373);
}

int64_t mass_cell(double x, double size) { return int64_t(std::floor(x / size)); }

// Stateless dart throwing; see the head of this file.
class MassDarts {
  public:
    explicit MassDarts(const MassSettings& settings)
        : seed_(mass_seed(settings)), spacing_(settings.spacing) {
        constexpr double most_ratio = 8.0;
        spacing_.y() = std::min(spacing_.y(), most_ratio * spacing_.x());
        const double ratio = spacing_.y() / spacing_.x();
        count_ = std::max(int(std::lround(4.0 * ratio * ratio)), 4);
    }

    double cell() const { return spacing_.y(); }
    int count() const { return count_; }
    const Vec2d& at(int64_t i, int64_t j, int k) { return darts(i, j)[size_t(k)].at; }

    bool stays(int64_t i, int64_t j, int k) {
        Dart& dart = darts(i, j)[size_t(k)];
        if (dart.known == Known::nothing)
            dart.known = has_accepted_rival(i, j, dart) ? Known::goes : Known::stays;
        return dart.known == Known::stays;
    }

  private:
    enum class Known : char { nothing, stays, goes };
    struct Dart {
        Vec2d at;
        double spacing;
        uint64_t priority, id;
        Known known = Known::nothing;
        bool below(const Dart& other) const {
            return priority != other.priority ? priority < other.priority : id < other.id;
        }
    };

    // References stay valid: the map's nodes do not move.
    std::vector<Dart>& darts(int64_t i, int64_t j) {
        std::vector<Dart>& cell = cells_[mass_id(i, j, 0)];
        if (!cell.empty()) return cell;
        for (int k = 0; k < count_; ++k) {
            const uint64_t id = mass_id(i, j, k);
            const MassHash random{hash(seed_, id)};
            const Vec2d at((double(i) + random(MassRandomKey::place_x)) * spacing_.y(),
                           (double(j) + random(MassRandomKey::place_z)) * spacing_.y());
            cell.push_back({at, random.in(spacing_, MassRandomKey::spacing),
                            hash(random.word, uint64_t(MassRandomKey::priority)), id});
        }
        return cell;
    }

    bool has_accepted_rival(int64_t i, int64_t j, const Dart& dart) {
        for (int64_t b = j - 1; b <= j + 1; ++b)
            for (int64_t a = i - 1; a <= i + 1; ++a) {
                const std::vector<Dart>& others = darts(a, b);
                for (int k = 0; k < count_; ++k) {
                    const Dart& other = others[size_t(k)];
                    const double apart = 0.5 * (dart.spacing + other.spacing);
                    if (dart.below(other) && (other.at - dart.at).squaredNorm() < apart * apart &&
                        stays(a, b, k))
                        return true;
                }
            }
        return false;
    }

    uint64_t seed_;
    Vec2d spacing_;
    int count_;
    std::unordered_map<uint64_t, std::vector<Dart>> cells_;
};

void mass_too_many(double about, const std::string& place = "") {
    throw SceneFault(
        "mass_desert.too_many", place,
        fmt::format("about {:.3g} dunes are asked for; the most is {:.0f}", about, most_mass_dunes),
        "raise spacing, or give a smaller area");
}

double mass_wind_angle(const MassSettings& settings) {
    const Vec2d& w = settings.wind;
    return w.allFinite() && w.stableNorm() > 0.0 ? std::atan2(w.y(), w.x()) : 0.0;
}

void random_places(const MassSettings& settings, const MassArea& area, std::vector<MassPlace>& out) {
    MassDarts darts(settings);
    const double cell = darts.cell(), angle = mass_wind_angle(settings);
    for (int64_t j = mass_cell(area.lower.y(), cell); j <= mass_cell(area.upper.y(), cell); ++j)
        for (int64_t i = mass_cell(area.lower.x(), cell); i <= mass_cell(area.upper.x(), cell); ++i)
            for (int k = 0; k < darts.count(); ++k) {
                const Vec2d at = darts.at(i, j, k);
                if (area.has(at) && darts.stays(i, j, k)) out.push_back({mass_id(i, j, k), at, angle});
            }
}

MassKind mass_field_kind(const MassSettings& s) {
    return s.kind ? *s.kind : regime_kind(s.sand_cover, s.wind_variability, s.plants);
}

// A lattice along the wind: pitch and jitter of its nodes, downwind and across, and whether rows are shifted.
struct MassLattice {
    Vec2d pitch, jitter;
    bool rows;
};

MassLattice mass_lattice(const MassSettings& s) {
    const double mean = 0.5 * s.spacing.sum(), free = 0.25 * (s.spacing.y() - s.spacing.x());
    if (s.arrangement == MassArrangement::cells) return {{mean, mean}, {free, free}, false};
    const double ridge = 0.5 * s.ridge_length.sum();
    const MassKind kind = mass_field_kind(s);
    if (kind == MassKind::seif) return {{std::max(ridge, mean), mean}, {free, free}, true};
    const bool ridges = kind == MassKind::transverse || kind == MassKind::barchanoid;
    return {{mean, ridges ? std::max(ridge, mean) : mean}, {free, ridges ? 0.0 : free}, true};
}

void lattice_places(const MassSettings& settings, const MassArea& area, std::vector<MassPlace>& out) {
    const MassLattice lattice = mass_lattice(settings);
    const double angle = mass_wind_angle(settings);
    const uint64_t seed = mass_seed(settings);
    Vec2d low = Vec2d::Constant(infinity), high = -low;
    for (const Vec2d& corner : {area.lower, area.upper, Vec2d(area.lower.x(), area.upper.y()),
                                Vec2d(area.upper.x(), area.lower.y())}) {
        const Vec2d p = mass_turned(corner, -angle).cwiseQuotient(lattice.pitch);
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    // A place lies within one pitch of its cell.
    for (int64_t i = int64_t(std::floor(low.x())) - 1; i <= int64_t(std::floor(high.x())) + 1; ++i) {
        const MassHash row{hash(seed, uint64_t(i))};
        const double shift = lattice.rows ? row(MassRandomKey::stagger) : 0.5;
        for (int64_t j = int64_t(std::floor(low.y())) - 2; j <= int64_t(std::floor(high.y())) + 1; ++j) {
            const uint64_t id = mass_id(i, j, 0);
            const MassHash random{hash(seed, id)};
            const double along =
                lattice.rows ? row.jitter(MassRandomKey::row) : random.jitter(MassRandomKey::place_x);
            const Vec2d p((double(i) + 0.5) * lattice.pitch.x() + along * lattice.jitter.x(),
                          (double(j) + shift) * lattice.pitch.y() +
                              random.jitter(MassRandomKey::place_z) * lattice.jitter.y());
            const Vec2d at = mass_turned(p, angle);
            if (area.has(at)) out.push_back({id, at, angle});
        }
    }
}

// Downwind axis of a dune on curve segment p q, radians from x to z.
double followed_angle(const MassSettings& settings, const Vec2d& p, const Vec2d& q) {
    const double wind = mass_wind_angle(settings);
    if (!settings.follow) return wind;
    Vec2d normal(p.y() - q.y(), q.x() - p.x());
    if (normal.dot(Vec2d(std::cos(wind), std::sin(wind))) < 0.0) normal = -normal;
    return std::atan2(normal.y(), normal.x());
}

void curve_places(const MassSettings& settings, const MassArea& area, std::vector<MassPlace>& out) {
    const double mean = 0.5 * settings.spacing.sum(),
                 free = 0.25 * (settings.spacing.y() - settings.spacing.x());
    for (size_t c = 0; c < settings.curves.size(); ++c) {
        const std::vector<Vec2d>& curve = settings.curves[c];
        double begin = 0.0; // length of the curve up to the segment
        int64_t next = 0;
        for (size_t s = 0; s + 1 < curve.size(); ++s) {
            const double length = (curve[s + 1] - curve[s]).norm();
            if (!std::isfinite(length)) continue;
            while (true) {
                const uint64_t id = mass_id(next, int64_t(c), 0);
                const MassHash random{hash(mass_seed(settings), id)};
                const double to =
                    (double(next) + 0.5) * mean + free * random.jitter(MassRandomKey::place_x) - begin;
                if (to >= length) break;
                ++next;
                const double t = length > 0.0 ? std::max(to, 0.0) / length : 0.0;
                const Vec2d at = curve[s] + t * (curve[s + 1] - curve[s]);
                if (area.has(at)) out.push_back({id, at, followed_angle(settings, curve[s], curve[s + 1])});
            }
            begin += length;
        }
    }
}

// An approximate upper bound of the number of places in the area.
double mass_count(const MassSettings& s, const MassArea& area) {
    const double mean = 0.5 * s.spacing.sum();
    if (s.arrangement == MassArrangement::along) {
        double length = 0.0;
        for (const std::vector<Vec2d>& curve : s.curves)
            for (size_t p = 0; p + 1 < curve.size(); ++p) {
                const double segment = (curve[p + 1] - curve[p]).norm();
                if (std::isfinite(segment)) length += segment;
            }
        return length / mean;
    }
    const Vec2d size = area.upper - area.lower;
    if (s.arrangement == MassArrangement::random) {
        constexpr double packing = 0.7; // dunes per squared mean spacing, in a maximal packing
        const double reach = std::min(mean, 4.5 * s.spacing.x());
        return packing * (size.x() / reach + 1.0) * (size.y() / reach + 1.0);
    }
    const MassLattice lattice = mass_lattice(s);
    const double diagonal = size.norm(); // side of a square that bounds the rotated area
    return (diagonal / lattice.pitch.x() + 1.0) * (diagonal / lattice.pitch.y() + 1.0);
}

std::vector<MassPlace> mass_places(const MassSettings& settings, const MassArea& area) {
    std::vector<MassPlace> places;
    constexpr double farthest = 1e9; // metres: cell indices fit their integers
    if (!area.lower.allFinite() || !area.upper.allFinite() ||
        !(area.lower.array() < area.upper.array()).all() || area.lower.cwiseAbs().maxCoeff() > farthest ||
        area.upper.cwiseAbs().maxCoeff() > farthest)
        return places;
    if (const double about = mass_count(settings, area); about > most_mass_dunes) mass_too_many(about);
    switch (settings.arrangement) {
    case MassArrangement::random:
        random_places(settings, area, places);
        break;
    case MassArrangement::along:
        curve_places(settings, area, places);
        break;
    case MassArrangement::across:
    case MassArrangement::cells:
        lattice_places(settings, area, places);
        break;
    }
    const uint64_t seed = mass_seed(settings);
    std::erase_if(places, [&](const MassPlace& place) {
        return MassHash{hash(seed, place.id)}(MassRandomKey::density) >= settings.density;
    });
    std::ranges::sort(places, {}, &MassPlace::id);
    return places;
}

// ---- Shapes: crests in metres, x downwind and y across, from the dune's place ----------------------------------------------

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

MassKind mass_kind(const MassSettings& s, const MassHash& random, double height) {
    if (s.kind) return *s.kind;
    const double cover = s.sand_cover + s.kind_mixing * random.jitter(MassRandomKey::cover);
    const double variability = s.wind_variability + s.kind_mixing * random.jitter(MassRandomKey::variability);
    const MassKind kind = regime_kind(cover, variability, s.plants);
    constexpr double lowest_barchan = 1.0; // metres: lower barchans have no slip face
    return kind == MassKind::barchan && height < lowest_barchan ? MassKind::dome : kind;
}

void make_shape(const MassSettings& s, const MassHash& random, MassDune& dune) {
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

// Sets smoothing to just round the corners of the polyline, and resampling to about as many segments as it
// has points.
void resample_as_drawn(MassDune& dune) {
    double length = 0.0, segments = 0.0;
    for (const std::vector<Vec2d>& crest : dune.crests)
        for (size_t i = 0; i + 1 < crest.size(); ++i, segments += 1.0)
            length += (crest[i + 1] - crest[i]).norm();
    const double spacing = length / segments, width = dune.settings.slope_width;
    dune.settings.smoothing = 0.5 * spacing / width;
    const double most = dune.kind == MassKind::parabolic ? 24.0 : 8.0; // its nose bends sharply
    dune.settings.search_accuracy = std::clamp(1.25 * width / spacing, 1.0, most);
}

void apply(const DuneEdit& edit, MassDune& dune) {
    dune.at += edit.move;
    dune.angle += edit.rotate;
    for (std::vector<Vec2d>& crest : dune.crests)
        for (Vec2d& p : crest) p *= edit.scale;
    dune.height *= edit.scale * edit.height_factor;
    dune.width *= edit.scale;
    dune.length *= edit.scale;
    dune.settings.slope_width *= edit.scale;
    dune.settings.boundary_noise *= edit.scale;
    dune.settings.boundary_noise_length *= edit.scale;
    dune.settings.max_height = dune.height;
}

MassDune make_dune(const MassSettings& s, const MassPlace& place, const std::vector<const DuneEdit*>& edits) {
    const MassHash random{hash(mass_seed(s), place.id)};
    MassDune dune;
    dune.id = place.id;
    dune.at = place.at;
    dune.angle = place.angle + s.dispersion * random.normal(MassRandomKey::angle);
    dune.height = random.in(s.height, MassRandomKey::height);
    dune.kind = mass_kind(s, random, dune.height);
    dune.settings.max_height = dune.height;
    dune.settings.crest_radius = s.crest_radius;
    dune.settings.boundary_noise = s.boundary_noise;
    dune.settings.boundary_noise_length = s.boundary_noise_length;
    dune.settings.flip =
        true; // crests run from left to right seen along the wind, so the windward side is on their right
    constexpr uint64_t most_seeds = 1'000'000'000; // range of a layer's seed parameter
    dune.noise_seed = hash(random.word, uint64_t(MassRandomKey::noise)) % most_seeds;
    dune.settings.seed = dune_noise_seed(s.terrain_seed, dune.noise_seed, 0);
    make_shape(s, random, dune);
    resample_as_drawn(dune);
    for (const DuneEdit* edit : edits) apply(*edit, dune);
    for (std::vector<Vec2d>& crest : dune.crests)
        for (Vec2d& p : crest) p = dune.at + mass_turned(p, dune.angle);
    return dune;
}

// Clamps settings to the range in which the formulas are valid. Values from a scene are already in range.
MassSettings bounded(MassSettings s) {
    const auto range = [](Vec2d& r, double low, double high) {
        r.x() = std::clamp(r.x(), low, high);
        r.y() = std::clamp(r.y(), r.x(), high);
    };
    range(s.height, least_height, most_height);
    range(s.spacing, least_spacing, most_spacing);
    range(s.ridge_length, least_spacing, most_spacing);
    s.slip_angle = std::clamp(s.slip_angle, 1.0 * degree, 80.0 * degree);
    s.windward_angle = std::clamp(s.windward_angle, 0.0, 60.0 * degree);
    s.horn_length = std::clamp(s.horn_length, 0.05, 2.0);
    s.sinuosity = std::clamp(s.sinuosity, 0.0, 1.0);
    return s;
}

} // namespace

std::string_view mass_kind_name(MassKind kind) { return mass_kinds[size_t(kind)]; }

MassKind regime_kind(double sand_cover, double wind_variability, double plants) {
    constexpr double some_plants = 0.3;
    if (plants > some_plants)
        return sand_cover >= 0.35 && wind_variability < 0.5 ? MassKind::parabolic : MassKind::nabkha;
    if (wind_variability < 0.35)
        return sand_cover < 0.35   ? MassKind::barchan
               : sand_cover < 0.65 ? MassKind::barchanoid
                                   : MassKind::transverse;
    if (sand_cover >= 1.3 - wind_variability) return MassKind::star;
    return sand_cover < 0.65 ? MassKind::seif : MassKind::transverse;
}

std::vector<MassDune> generate_dunes(const MassSettings& given, const Vec2d& lower, const Vec2d& upper) {
    const MassSettings settings = bounded(given);
    std::vector<MassPlace> places = mass_places(settings, {lower, upper});
    std::unordered_map<uint64_t, std::vector<const DuneEdit*>> edits;
    for (const DuneEdit& edit : settings.edits) edits[edit.id].push_back(&edit);
    const auto edits_of = [&](uint64_t id) {
        const auto found = edits.find(id);
        return found == edits.end() ? std::vector<const DuneEdit*>() : found->second;
    };
    std::erase_if(places, [&](const MassPlace& place) {
        return std::ranges::any_of(edits_of(place.id), [](const DuneEdit* edit) { return edit->remove; });
    });
    std::vector<MassDune> dunes(places.size());
    tbb::parallel_for(size_t(0), places.size(),
                      [&](size_t i) { dunes[i] = make_dune(settings, places[i], edits_of(places[i].id)); });
    return dunes;
}

double mass_reach(const MassSettings& s) {
    const double h = s.height.y(), ridge = s.ridge_length.y();
    // The crest: half a ridge with its waves; a crescent's horns or a parabolic dune's arms; a star's arms.
    // Then the slope is added.
    const double crest =
        std::max({ridge * (0.5 + s.sinuosity / 1.5), (1.3 + s.horn_length) * field_width(h), 6.0 * h});
    return crest + std::max(2.0 * field_length(h), 2.2 * h / std::tan(s.slip_angle)) + s.boundary_noise;
}

// ---- The layer -------------------------------------------------------------------------------------------------------

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
    tbb::parallel_for(size_t(0), all.size(), [&](size_t i) {
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
            for (const Vec2d& p : dune.crests[arm])
                points += fmt::format("{}[{}, 0, {}]", points.empty() ? "" : ", ", p.x(), p.y());
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

namespace {

constexpr auto mass_values = std::to_array<MarramParam>({
    {"arrangement", MARRAM_CHOICE, "", "\"random\"", 0, 0, "random|along|across|cells",
     "random with minimum spacing; along curves; in rows across the wind; on a jittered lattice"},
    {"along", MARRAM_CURVES_NAME, "", "none", 0, 0, "", "arrangement along: the curves"},
    {"follow", MARRAM_BOOLEAN, "", "false", 0, 0, "",
     "arrangement along: dunes are oriented across the curve instead of across the wind"},
    {"kind", MARRAM_CHOICE, "", "\"regime\"", 0, 0,
     "regime|barchan|barchanoid|transverse|seif|star|dome|parabolic|nabkha",
     "regime: by sand_cover, wind_variability and plants"},
    {"sand_cover", MARRAM_NUMBER, "", "0.2", 0, 1, "",
     "how much sand there is: 0 bare ground, 1 sand everywhere"},
    {"wind_variability", MARRAM_NUMBER, "", "0.1", 0, 1, "",
     "1 - RDP/DP: 0: one wind direction; 1: all directions"},
    {"plants", MARRAM_NUMBER, "", "0", 0, 1, "", "share of the ground that plants cover"},
    {"kind_mixing", MARRAM_NUMBER, "", "0.05", 0, 1, "",
     "largest random deviation of a dune's cover and variability"},
    {"height", MARRAM_RANGE, "m", "[2, 6]", least_height, most_height, "", "lowest and highest dune"},
    {"spacing", MARRAM_RANGE, "m", "[80, 140]", least_spacing, most_spacing, "",
     "distance between the middles of neighbours; none are nearer than the first"},
    {"ridge_length", MARRAM_RANGE, "m", "[150, 300]", least_spacing, most_spacing, "",
     "crest of transverse, barchanoid and seif dunes"},
    {"density", MARRAM_NUMBER, "", "1", 0, 1, "", "share of the places that hold a dune"},
    {"dispersion", MARRAM_NUMBER, "deg", "8", 0, 180, "", "standard deviation of the dunes' orientation"},
    {"slip_angle", MARRAM_NUMBER, "deg", "33", 1, 80, "", "slope of slip faces"},
    {"windward_angle", MARRAM_NUMBER, "deg", "12", 0, 60, "",
     "steepest part of windward sides, as far as their length allows"},
    {"horn_length", MARRAM_NUMBER, "", "0.3", 0.05, 2, "", "of a barchan, share of its width"},
    {"sinuosity", MARRAM_NUMBER, "", "0.08", 0, 1, "", "how far ridges wave, share of a wave's length"},
    {"crest_radius", MARRAM_NUMBER, "m", "none", 0, 1e4, "",
     "how far crests are rounded, so that they show no steps of the grid; absent: one cell"},
    {"boundary_noise", MARRAM_NUMBER, "m", "0", 0, 1e4, "", "amplitude of the noise on the dune's foot line"},
    {"boundary_noise_length", MARRAM_NUMBER, "m", "20", 1e-3, 1e5, "",
     "along the crest, from bulge to bulge"},
    {"merge", MARRAM_NUMBER, "m", "1", 0, 1e4, "",
     "difference in height below which overlapping dunes blend"},
    {"area_low", MARRAM_VEC2, "m", "none", -1e8, 1e8, "",
     "corner of the area, x and z; absent: all of the terrain"},
    {"area_high", MARRAM_VEC2, "m", "none", -1e8, 1e8, "", "its other corner"},
    {"seed", MARRAM_INTEGER, "", "0", 0, 1e9, "", "random seed of the dunes"},
    {"list", MARRAM_BOOLEAN, "", "false", 0, 0, "",
     "report each dune's id with its x, z and height, for edits"},
    {"edit[].id", MARRAM_NUMBER, "", "", 0, 0x1p52, "", "the dune that is edited"},
    {"edit[].move", MARRAM_VEC2, "m", "[0, 0]", -1e6, 1e6, "", "x and z"},
    {"edit[].rotate", MARRAM_NUMBER, "deg", "0", -360, 360, "", "from x to z"},
    {"edit[].scale", MARRAM_NUMBER, "", "1", 0.01, 100, "", "of all its lengths"},
    {"edit[].height_factor", MARRAM_NUMBER, "", "1", 0, 100, "", "of its height alone"},
    {"edit[].remove", MARRAM_BOOLEAN, "", "false", 0, 0, "", "leave it out"},
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
    if (const double about = mass_count(bounded(settings), area); about > most_mass_dunes)
        mass_too_many(about, context.values.place("spacing"));
    std::vector<MassDune> dunes = generate_dunes(settings, area.lower, area.upper);
    warn_of_lost_edits(context, settings, dunes);
    auto layer = std::make_unique<MassLayer>(read_shape(context), context.domain, std::move(dunes),
                                             context.values.number("merge"),
                                             dynamic_cast<const MassLayer*>(context.before));
    layer->list_dunes(context.values.boolean("list"));
    return layer;
}

} // namespace

LayerType mass_desert_layer_type() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> all(mass_values.begin(), mass_values.end());
        for (const MarramParam& param : shape_params("\"sand\"")) all.push_back(param);
        return all;
    }();
    return {"mass_desert", "many dunes, each of which can be edited", params, make_mass_layer};
}

} // namespace marram
