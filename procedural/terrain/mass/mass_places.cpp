// SPDX-License-Identifier: Apache-2.0
// Places of the dunes of a mass desert: four arrangements, from a seed.
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
#include "procedural/terrain/mass/mass_places.h"

#include "procedural/terrain/mass/mass_math.h"

#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>

namespace marram {

namespace {

uint64_t mass_id(int64_t i, int64_t j, int64_t k) {
    constexpr uint64_t half = 1 << 19, mask = (1 << 20) - 1;
    return ((uint64_t(i) + half) & mask) << 32 | ((uint64_t(j) + half) & mask) << 12 | (uint64_t(k) & 0xfff);
}

int64_t mass_cell(double x, double size) { return int64_t(std::floor(x / size)); }

// Stateless dart throwing; see the head of this file.
class MassDarts {
  public:
    explicit MassDarts(const MassSettings& settings)
        : seed_(mass_seed(settings)), spacing_(settings.spacing) {
        constexpr double max_ratio = 8.0;
        spacing_.y() = std::min(spacing_.y(), max_ratio * spacing_.x());
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

} // namespace

void mass_too_many(double about, const std::string& place) {
    throw SceneFault(
        "mass_desert.too_many", place,
        fmt::format("about {:.3g} dunes are asked for; the most is {:.0f}", about, max_mass_dunes),
        "raise spacing, or give a smaller area");
}

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
    if (const double about = mass_count(settings, area); about > max_mass_dunes) mass_too_many(about);
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

} // namespace marram
