// SPDX-License-Identifier: Apache-2.0
// Turns a mesh that stands on a terrain, such as a ruin, into a height field.
//
// A cell is the square around a sample, without its borders at larger x and z. A triangle that crosses it
// gives the span of heights of its part in the cell, by clipping: a thin wall, even a sheet, leaves no hole
// between cells. The inside of a closed mesh, of either winding, gives the spans between entry and exit of
// the vertical line through the sample. From the ground up, each span that begins at most a quarter of a cell
// above the level reached raises it to its top. If none rises above the ground, the highest buried one above
// bedrock is the top. So sand and wind pass through a door, under a lintel, a roof or an arch.
//
// Error: a wall is wider by at most a cell on either side. An arch that rises from the ground is open where
// its underside is a quarter of a cell above the ground. Nothing overhangs: a leaning part is filled below
// where its underside is less high than that; elsewhere it is left out. Where entries and exits of a line do
// not balance, the inside is not filled (open_samples()); a vertical wall that is missing goes unnoticed.
#include "procedural/terrain/obstacle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

namespace marram {
namespace {

// The part of a polygon where sign (axis - bound) <= 0; empty if it only touches an upper bound (sign 1).
struct ObstaclePolygon {
    std::array<Vec3d, 8> points; // a triangle, cut four times, has at most 7
    size_t count = 0;

    void clip(int axis, double bound, double sign) {
        std::array<Vec3d, 8> kept;
        size_t n = 0;
        for (size_t k = 0; k < count; ++k) {
            const Vec3d &a = points[k], &b = points[(k + 1) % count];
            const double da = sign * (a[axis] - bound), db = sign * (b[axis] - bound);
            if (da <= 0.0) kept[n++] = a;
            if ((da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0)) kept[n++] = a + da / (da - db) * (b - a);
        }
        points = kept, count = n;
        if (sign > 0.0 && std::all_of(points.begin(), points.begin() + long(n),
                                      [&](const Vec3d& p) { return p[axis] >= bound; }))
            count = 0;
    }
};

// Where the vertical line through (x, z) crosses a triangle. On an edge shared by two triangles, one of them
// counts if they lie on either side of it in plan, else both or neither: entries and exits stay balanced.
bool obstacle_crossing(const std::array<Vec3d, 3>& p, double x, double z, double& y) {
    const auto twice_area = [&](const Vec3d& a, const Vec3d& b) {
        // The same bits for both directions of an edge.
        const bool swapped = std::tuple(b.x(), b.z()) < std::tuple(a.x(), a.z());
        const Vec3d &c = swapped ? b : a, &d = swapped ? a : b;
        const double area = (d.x() - c.x()) * (z - c.z()) - (d.z() - c.z()) * (x - c.x());
        return swapped ? -area : area;
    };
    const double area =
        (p[1].x() - p[0].x()) * (p[2].z() - p[0].z()) - (p[1].z() - p[0].z()) * (p[2].x() - p[0].x());
    if (area == 0.0) return false;
    std::array<double, 3> weight{};
    for (size_t k = 0; k < 3; ++k) {
        const Vec3d &a = p[(k + 1) % 3], &b = p[(k + 2) % 3];
        weight[k] = twice_area(a, b) / area;
        if (weight[k] < 0.0) return false;
        if (weight[k] == 0.0) { // on the edge: it belongs to the triangle on one side
            const Vec3d way = area > 0.0 ? Vec3d(b - a) : Vec3d(a - b);
            if (!(way.z() > 0.0 || (way.z() == 0.0 && way.x() < 0.0))) return false;
        }
    }
    y = weight[0] * p[0].y() + weight[1] * p[1].y() + weight[2] * p[2].y();
    return true;
}

} // namespace

Obstacle::Obstacle(const Domain& domain, const MarramMesh& mesh) : cell_(domain.cell) {
    struct Crossing {
        size_t sample;
        double y;
        bool faces_down; // an entry, going up, if the winding is outward
    };
    std::vector<Crossing> crossings;
    const float* const positions = mesh.positions ? mesh.positions[0] : nullptr;
    if (!positions || !mesh.triangles || !(domain.cell > 0.0)) return;
    // Indices of the cells that [low, high] touches, clamped to the grid.
    const auto cells = [&](double low, double high, double origin, int count) {
        const double first = (low - origin) / domain.cell - 0.5, last = (high - origin) / domain.cell + 0.5;
        return std::pair(int(std::clamp(std::ceil(first), 0.0, double(count))),
                         int(std::clamp(std::floor(last) + 1.0, 0.0, double(count))));
    };
    for (size_t f = 0; f < mesh.triangle_count; ++f) {
        std::array<Vec3d, 3> p;
        bool valid = true;
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t v = mesh.triangles[3 * f + k];
            valid = valid && v < mesh.vertex_count;
            if (!valid) break;
            for (int c = 0; c < 3; ++c) p[k][c] = double(positions[3 * size_t(v) + size_t(c)]);
            valid = p[k].allFinite();
        }
        if (!valid) continue;
        const Vec3d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
        const auto [j0, j1] = cells(low.z(), high.z(), domain.z0, domain.nz);
        const bool faces_down = (p[1] - p[0]).cross(p[2] - p[0]).y() < 0.0;
        const double half = 0.5 * domain.cell;
        for (int j = j0; j < j1; ++j) {
            ObstaclePolygon strip;
            std::copy(p.begin(), p.end(), strip.points.begin()), strip.count = 3;
            strip.clip(2, domain.z(j) - half, -1.0), strip.clip(2, domain.z(j) + half, 1.0);
            if (strip.count == 0) continue;
            double left = infinity, right = -infinity;
            for (const Vec3d& q : std::span(strip.points).first(strip.count))
                left = std::min(left, q.x()), right = std::max(right, q.x());
            const auto [first, last] = cells(left, right, domain.x0, domain.nx);
            for (int i = first; i < last; ++i) {
                ObstaclePolygon part = strip;
                part.clip(0, domain.x(i) - half, -1.0), part.clip(0, domain.x(i) + half, 1.0);
                if (part.count == 0) continue;
                double least = infinity, most = -infinity;
                for (const Vec3d& q : std::span(part.points).first(part.count))
                    least = std::min(least, q.y()), most = std::max(most, q.y());
                const size_t sample = domain.index(i, j);
                spans_.push_back({sample, float(least), float(most)});
                double y = 0.0;
                if (obstacle_crossing(p, domain.x(i), domain.z(j), y))
                    crossings.push_back({sample, y, faces_down});
            }
        }
    }
    std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) {
        return std::tuple(a.sample, a.y, a.faces_down) < std::tuple(b.sample, b.y, b.faces_down);
    });
    int inside = 0;
    double entry = 0.0;
    for (size_t k = 0; k < crossings.size(); ++k) {
        const Crossing& crossing = crossings[k];
        if (inside == 0) entry = crossing.y;
        inside += crossing.faces_down ? 1 : -1;
        if (inside == 0) spans_.push_back({crossing.sample, float(entry), float(crossing.y)});
        if (k + 1 == crossings.size() || crossings[k + 1].sample != crossing.sample) {
            open_samples_ += inside != 0;
            inside = 0;
        }
    }
    std::sort(spans_.begin(), spans_.end(), [](const Span& a, const Span& b) {
        return std::tuple(a.sample, a.low, a.high) < std::tuple(b.sample, b.low, b.high);
    });
}

std::vector<Obstacle::Top> Obstacle::tops(const Fields& below) const {
    std::vector<Top> tops;
    const double gap = 0.25 * cell_;
    for (size_t k = 0; k < spans_.size();) {
        const size_t sample = spans_[k].sample;
        const double ground = below.height(sample);
        double top = ground;
        for (; k < spans_.size() && spans_[k].sample == sample; ++k)
            if (double(spans_[k].low) <= top + gap) top = std::max(top, double(spans_[k].high));
        // A buried top still limits how deep the sand can be eroded.
        double buried = -infinity;
        for (size_t n = k; n-- > 0 && spans_[n].sample == sample;)
            if (double(spans_[n].low) <= ground) buried = std::max(buried, double(spans_[n].high));
        if (top > ground)
            tops.push_back({sample, float(top)});
        else if (buried > double(below.bedrock[sample]))
            tops.push_back({sample, float(buried)});
    }
    return tops;
}

void fill_obstacle(const Domain& domain, const float* bedrock, const std::vector<Obstacle::Top>& tops,
                   const std::vector<SandUnits>& on_top, SandUnits* sand) {
    constexpr double unknown = -std::numeric_limits<double>::infinity();
    enum class Kind : char { ground, edge, inside };
    std::vector<Kind> kinds(domain.count(), Kind::ground);
    std::vector<double> level(domain.count()); // metres; unknown: not yet filled
    for (size_t k = 0; k < domain.count(); ++k) level[k] = double(bedrock[k]) + sand_metres(sand[k]);
    for (size_t k = 0; k < tops.size(); ++k) {
        kinds[tops[k].sample] = Kind::inside;
        level[tops[k].sample] = double(tops[k].height) + sand_metres(on_top[k]);
    }
    // Calls visit(neighbour) for the up to eight neighbours of a sample.
    const auto each_beside = [&](size_t sample, auto&& visit) {
        const int i = int(sample % size_t(domain.nx)), j = int(sample / size_t(domain.nx));
        for (int b = std::max(j - 1, 0); b <= std::min(j + 1, domain.nz - 1); ++b)
            for (int a = std::max(i - 1, 0); a <= std::min(i + 1, domain.nx - 1); ++a)
                if (a != i || b != j) visit(domain.index(a, b));
    };
    for (const Obstacle::Top& top : tops)
        each_beside(top.sample, [&](size_t beside) {
            if (kinds[beside] == Kind::ground && level[beside] < double(top.height) - domain.cell)
                kinds[top.sample] = Kind::edge;
        });
    std::vector<size_t> unfilled; // of tops
    for (size_t k = 0; k < tops.size(); ++k) {
        bool enclosed = kinds[tops[k].sample] == Kind::inside && on_top[k] > 0;
        double sum = 0.0;
        int count = 0;
        each_beside(tops[k].sample, [&](size_t beside) {
            enclosed = enclosed && kinds[beside] != Kind::edge;
            sum += level[beside], ++count;
        });
        const bool covered =
            sand_metres(on_top[k]) > 0.25 * domain.cell || sum >= count * double(tops[k].height);
        if (!(enclosed && covered)) unfilled.push_back(k);
    }
    for (const size_t k : unfilled) level[tops[k].sample] = unknown;
    std::vector<double> next;
    for (bool first = true; !unfilled.empty(); first = false) {
        next.assign(unfilled.size(), unknown);
        for (size_t n = 0; n < unfilled.size(); ++n) {
            double least = infinity, sum = 0.0;
            int count = 0;
            each_beside(tops[unfilled[n]].sample, [&](size_t beside) {
                if (level[beside] == unknown) return;
                least = std::min(least, level[beside]), sum += level[beside], ++count;
            });
            // The first ring takes the lowest level beside it: sand on the high side of a thin wall must not
            // stick out of its low side. Rings further in take the mean.
            if (count > 0) next[n] = first ? least : sum / count;
        }
        size_t left = 0;
        for (size_t n = 0; n < unfilled.size(); ++n) {
            const size_t k = unfilled[n], sample = tops[k].sample;
            if (next[n] == unknown) {
                unfilled[left++] = k;
                continue;
            }
            level[sample] = next[n];
            const double most = double(tops[k].height) + sand_metres(on_top[k]);
            sand[sample] = sand_units(std::max(std::min(next[n], most) - double(bedrock[sample]), 0.0));
        }
        if (left == unfilled.size()) break; // the mesh covers all of the terrain
        unfilled.resize(left);
    }
}

} // namespace marram
