// SPDX-License-Identifier: Apache-2.0
// Finds the faces of a mesh on lines along the wind, joins those of neighbouring lines to walls, and measures
// their effective H.
#include "procedural/terrain/ruin/ruin_faces.h"

#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

namespace marram {
namespace {

constexpr double ruin_shelter = 6.0;     // reattachment length, in heights
constexpr int ruin_most_heights = 192;   // rays on one line
constexpr int ruin_most_lines = 1 << 15; // along the wind
const double ruin_windward_cosine = std::cos(55.0 * degree), ruin_lee_cosine = std::cos(34.0 * degree);
const double ruin_windward_run = 1.0 / std::tan(55.0 * degree), ruin_lee_run = 1.0 / std::tan(34.0 * degree);

// Bilinear height of the terrain below; clamped to the border outside.
struct RuinGround {
    const Domain& domain;
    const Fields& below;

    double at(const Vec2d& p) const {
        const double x = std::clamp((p.x() - domain.x0) / domain.cell, 0.0, double(domain.nx - 1));
        const double z = std::clamp((p.y() - domain.z0) / domain.cell, 0.0, double(domain.nz - 1));
        const int i = std::min(int(x), std::max(domain.nx - 2, 0)),
                  j = std::min(int(z), std::max(domain.nz - 2, 0));
        const int i1 = std::min(i + 1, domain.nx - 1), j1 = std::min(j + 1, domain.nz - 1);
        const auto h = [&](int a, int b) { return below.height(domain.index(a, b)); };
        const double u = x - i, v = z - j;
        return (1 - v) * ((1 - u) * h(i, j) + u * h(i1, j)) + v * ((1 - u) * h(i, j1) + u * h(i1, j1));
    }
};

struct RuinHit {
    double s, upright, cosine; // |n_y|, |n . wind| / |n_xz|
    bool enters;
};

struct RuinHeights {
    double first = 0.0, step = 1.0;
    int count = 0;
    double at(int k) const { return first + k * step; }
};

// All hits along one line.
void ruin_trace(const RuinMesh& mesh, double y, double t, std::vector<RuinMesh::Hit>& found,
                std::vector<RuinHit>& hits) {
    const double margin = 1.0 + 0x1p-10 * (mesh.upper().x() - mesh.lower().x());
    const double begin = mesh.lower().x() - margin;
    mesh.hits({begin, y, t}, {1.0, 0.0, 0.0}, mesh.upper().x() + margin - begin, found);
    hits.clear();
    for (const RuinMesh::Hit& hit : found) {
        const Vec3d& n = hit.normal;
        const double level = std::hypot(n.x(), n.z());
        if (level > 0.0)
            hits.push_back({begin + hit.at, std::abs(n.y()), std::abs(n.x()) / level, n.x() < 0.0});
    }
    // Hits closer than the rounding of positions count as coincident.
    const double rounding = 0x1p-21 * std::max(mesh.upper().x() - begin, std::abs(begin));
    for (size_t k = 1; k < hits.size(); ++k)
        if (hits[k].enters && !hits[k - 1].enters && hits[k].s - hits[k - 1].s <= rounding)
            std::swap(hits[k], hits[k - 1]);
}

// Finds the outer faces: hits where the number of solids containing the ray changes from or to 0. An exit at
// depth 0, and any hit of a line that does not end outside, is a sheet: both a windward and a lee face.
template <typename Take>
void ruin_outer_faces(const std::vector<RuinHit>& hits, Take&& take) {
    int depth = 0;
    for (const RuinHit& hit : hits) depth = hit.enters ? depth + 1 : std::max(depth - 1, 0);
    const bool sheets = depth != 0;
    depth = 0;
    for (const RuinHit& hit : hits) {
        const bool sheet = sheets || (!hit.enters && depth == 0);
        const bool outer = hit.enters ? depth == 0 : depth == 1;
        if (!sheet) depth += hit.enters ? 1 : -1;
        if (sheet || (outer && hit.enters)) take(hit, true);
        if (sheet || (outer && !hit.enters)) take(hit, false);
    }
}

struct RuinPoint {
    double s, y, cosine;
};
using RuinChain = std::vector<RuinPoint>;

// Adds a hit to the chain that it continues, or starts a new chain.
void ruin_link(std::vector<RuinChain>& chains, const RuinPoint& point, double run, double step) {
    RuinChain* best = nullptr;
    double nearest = infinity;
    for (RuinChain& chain : chains) {
        const RuinPoint& top = chain.back();
        const double gap = point.y - top.y, away = std::abs(point.s - top.s);
        if (!(gap > 0.5 * step)) continue; // same ray
        if (gap > std::max(1.5 * step, top.y - chain.front().y)) continue;
        if (away > run * gap + 0.05 * step || away >= nearest) continue;
        best = &chain, nearest = away;
    }
    if (best)
        best->push_back(point);
    else
        chains.push_back({point});
}

class RuinFaceFinder {
  public:
    RuinFaceFinder(const RuinMesh& mesh, const RuinGround& ground) : mesh_(mesh), ground_(ground) {
        set_heights();
        set_lines();
    }

    RuinLines survey();
    double ground(double s, double t) const { return ground_.at(mesh_.frame().world(s, t)); }

  private:
    void set_heights();
    void set_lines();
    void trace_line(int l, RuinLine& line) const;
    std::optional<RuinFace> foot(const RuinChain& chain, bool windward, double t) const;
    double refined_top(const RuinChain& chain, bool windward, double t) const;

    const RuinMesh& mesh_;
    RuinGround ground_;
    RuinHeights heights_;
    RuinLines lines_;
};

// Sets ray heights from the lowest and highest sand under the box of the mesh.
void RuinFaceFinder::set_heights() {
    const Domain& d = ground_.domain;
    const Vec3d &low = mesh_.lower(), &high = mesh_.upper();
    Vec2d a = Vec2d::Constant(infinity), b = -a;
    for (const double s : {low.x(), high.x()})
        for (const double t : {low.z(), high.z()}) {
            a = a.cwiseMin(mesh_.frame().world(s, t));
            b = b.cwiseMax(mesh_.frame().world(s, t));
        }
    const auto index = [&](double metres, double origin, int count) {
        return int(std::clamp((metres - origin) / d.cell, 0.0, double(count - 1)));
    };
    double least = infinity, most = -infinity;
    for (int j = index(a.y(), d.z0, d.nz); j <= std::min(index(b.y(), d.z0, d.nz) + 1, d.nz - 1); ++j)
        for (int i = index(a.x(), d.x0, d.nx); i <= std::min(index(b.x(), d.x0, d.nx) + 1, d.nx - 1); ++i) {
            const double h = ground_.below.height(d.index(i, j));
            least = std::min(least, h), most = std::max(most, h);
        }
    const double from = std::max(low.y(), least - d.cell);
    const double to = std::min(high.y(), most + ruin_most_height + d.cell);
    if (!(to > from)) return;
    heights_.count = int(std::clamp(std::ceil((to - from) / (0.5 * d.cell)), 1.0, double(ruin_most_heights)));
    heights_.step = (to - from) / heights_.count;
    heights_.first = from + ruin_ray_offset * heights_.step;
}

// Sets lines across the mesh, at most twice the largest height beyond the terrain: lines farther out cannot
// affect it.
void RuinFaceFinder::set_lines() {
    const Domain& d = ground_.domain;
    double least = infinity, most = -infinity;
    for (const double x : {d.x(0), d.x(d.nx - 1)})
        for (const double z : {d.z(0), d.z(d.nz - 1)}) {
            const double t = mesh_.frame().frame({x, z}).y();
            least = std::min(least, t), most = std::max(most, t);
        }
    const double from = std::max(mesh_.lower().z(), least - 2.0 * ruin_most_height);
    const double width = std::min(mesh_.upper().z(), most + 2.0 * ruin_most_height) - from;
    if (!(width > 0.0) || heights_.count == 0) return;
    const double count =
        std::clamp(std::ceil(width / (0.5 * ground_.domain.cell)), 1.0, double(ruin_most_lines));
    lines_.step = width / count;
    lines_.first = from + ruin_ray_offset * lines_.step;
    lines_.lines.resize(size_t(count));
}

// Finds the top of a face by bisection between its highest hit and the next ray above.
double RuinFaceFinder::refined_top(const RuinChain& chain, bool windward, double t) const {
    const RuinPoint& last = chain.back();
    const double run = windward ? ruin_windward_run : ruin_lee_run, reach = (run + 0.05) * heights_.step;
    const double sign = windward ? 1.0 : -1.0;
    double low = last.y, high = last.y + heights_.step;
    for (int k = 0; k < 7; ++k) {
        const double middle = 0.5 * (low + high);
        const bool meets = mesh_.occluded({last.s - sign * reach, middle, t}, {sign, 0.0, 0.0}, 2.0 * reach);
        (meets ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

std::optional<RuinFace> RuinFaceFinder::foot(const RuinChain& chain, bool windward, double t) const {
    size_t first = 0;
    const auto above = [&](size_t k) { return chain[k].y - ground(chain[k].s, t); };
    while (first < chain.size() && !(above(first) > 0.0)) ++first;
    RuinFace foot;
    if (first == chain.size()) { // the top may still be above the sand, between two rays
        first = chain.size() - 1;
        foot.s = chain[first].s;
    } else if (first == 0) {
        foot.s = chain[0].s;
    } else {
        const double below = above(first - 1), over = above(first);
        foot.s = chain[first - 1].s + (chain[first].s - chain[first - 1].s) * (-below / (over - below));
    }
    foot.ground = ground(foot.s, t);
    foot.top = refined_top(chain, windward, t);
    foot.height = foot.top - foot.ground;
    const double gap = chain[first].y - foot.ground;
    if (!(foot.height > 0.0) || gap > std::max(1.5 * heights_.step, 0.25 * foot.height)) return std::nullopt;
    double sum = 0.0;
    for (size_t k = first; k < chain.size(); ++k) sum += chain[k].cosine;
    foot.cosine = sum / double(chain.size() - first);
    return foot;
}

void RuinFaceFinder::trace_line(int l, RuinLine& line) const {
    const double t = lines_.first + l * lines_.step;
    std::vector<RuinMesh::Hit> found;
    std::vector<RuinHit> hits;
    std::vector<RuinChain> windward, lee;
    for (int k = 0; k < heights_.count; ++k) {
        const double y = heights_.at(k);
        ruin_trace(mesh_, y, t, found, hits);
        ruin_outer_faces(hits, [&](const RuinHit& hit, bool faces_wind) {
            if (faces_wind && hit.upright < ruin_windward_cosine)
                ruin_link(windward, {hit.s, y, hit.cosine}, ruin_windward_run, heights_.step);
            if (!faces_wind && hit.upright < ruin_lee_cosine)
                ruin_link(lee, {hit.s, y, hit.cosine}, ruin_lee_run, heights_.step);
        });
    }
    const auto gather = [&](const std::vector<RuinChain>& chains, bool faces_wind,
                            std::vector<RuinFace>& feet) {
        for (const RuinChain& chain : chains)
            if (std::optional<RuinFace> face = foot(chain, faces_wind, t)) {
                face->line = l;
                feet.push_back(*face);
            }
        std::stable_sort(feet.begin(), feet.end(),
                         [](const RuinFace& a, const RuinFace& b) { return a.s < b.s; });
    };
    gather(windward, true, line.windward);
    gather(lee, false, line.lee);
}

// Reduces the height of windward faces by the part that lies in the shelter of lee faces upwind on the same
// line.
void ruin_shelter_line(RuinLine& line) {
    for (RuinFace& face : line.windward) {
        double air = face.ground;
        for (const RuinFace& upwind : line.lee) {
            if (!(upwind.s < face.s)) break;
            const double height = std::min(upwind.top - upwind.ground, ruin_most_height);
            air = std::max(air, upwind.ground + height - (face.s - upwind.s) / ruin_shelter);
        }
        face.height = std::max(face.top - air, 0.0);
    }
}

// Thickness of the solid behind each windward face and in front of each lee face: the distance to the next
// face of the other kind.
void ruin_measure_thickness(RuinLine& line) {
    for (RuinFace& face : line.windward)
        for (RuinFace& behind : line.lee) {
            if (behind.s < face.s) continue;
            face.thickness = behind.s - face.s;
            behind.thickness =
                behind.thickness > 0.0 ? std::min(behind.thickness, face.thickness) : face.thickness;
            break;
        }
}

// Groups faces of neighbouring lines into walls, with union-find.
class RuinWalls {
  public:
    RuinWalls(RuinLines& lines, std::vector<RuinFace> RuinLine::*kind) : step_(lines.step) {
        std::vector<size_t> begin;
        for (RuinLine& line : lines.lines) {
            begin.push_back(feet_.size());
            for (RuinFace& foot : line.*kind) feet_.push_back(&foot);
        }
        begin.push_back(feet_.size());
        parent_.resize(feet_.size());
        std::iota(parent_.begin(), parent_.end(), size_t(0));
        for (size_t l = 0; l + 2 < begin.size(); ++l) join_lines(begin[l], begin[l + 1], begin[l + 2]);
    }

    void measure();

  private:
    size_t root(size_t k) {
        while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
        return k;
    }
    // Faces up to 4 line steps apart in s are joined: the wall may be up to 76 degrees oblique to the wind.
    void join_lines(size_t a, size_t b, size_t c) {
        for (size_t p = a; p < b; ++p)
            for (size_t q = b; q < c; ++q) {
                if (std::abs(feet_[p]->s - feet_[q]->s) > 4.0 * step_) continue;
                const size_t x = root(p), y = root(q);
                parent_[std::max(x, y)] = std::min(x, y);
            }
    }
    void smooth(const std::vector<RuinFace*>& wall) const;

    double step_;
    std::vector<RuinFace*> feet_; // in order of lines
    std::vector<size_t> parent_;
};

// Averages H along the wall over a distance H.
void RuinWalls::smooth(const std::vector<RuinFace*>& wall) const {
    std::vector<double> mean(wall.size());
    marram::parallel_for(size_t(0), wall.size(), [&](size_t k) {
        const int reach = int(0.5 * wall[k]->height / step_);
        double sum = 0.0, count = 0.0;
        const auto take = [&](size_t n) {
            if (std::abs(wall[n]->line - wall[k]->line) > reach) return false;
            sum += wall[n]->height, count += 1.0;
            return true;
        };
        for (size_t n = k; n < wall.size() && take(n); ++n) {
        }
        for (size_t n = k; n > 0 && take(n - 1); --n) {
        }
        mean[k] = sum / count;
    });
    for (size_t k = 0; k < wall.size(); ++k) wall[k]->height = mean[k];
}

void RuinWalls::measure() {
    std::vector<std::vector<RuinFace*>> walls(feet_.size());
    for (size_t k = 0; k < feet_.size(); ++k) walls[root(k)].push_back(feet_[k]);
    for (const std::vector<RuinFace*>& wall : walls) {
        if (wall.empty()) continue;
        const int first = wall.front()->line, last = wall.back()->line;
        for (RuinFace* foot : wall) {
            foot->width = (last - first + 1) * step_;
            foot->to_end = (std::min(foot->line - first, last - foot->line) + 0.5) * step_;
            foot->height = std::min({foot->height, foot->width, ruin_most_height});
        }
        smooth(wall);
    }
}

RuinLines RuinFaceFinder::survey() {
    marram::parallel_for(size_t(0), lines_.lines.size(), [&](size_t l) {
        RuinLine& line = lines_.lines[l];
        trace_line(int(l), line);
        ruin_shelter_line(line);
        ruin_measure_thickness(line);
    });
    RuinWalls(lines_, &RuinLine::windward).measure();
    RuinWalls(lines_, &RuinLine::lee).measure();
    return std::move(lines_);
}

} // namespace

RuinLines ruin_find_faces(const RuinMesh& mesh, const Domain& domain, const Fields& below) {
    return RuinFaceFinder(mesh, RuinGround{domain, below}).survey();
}

} // namespace marram
