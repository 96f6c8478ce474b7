// SPDX-License-Identifier: Apache-2.0
// ruin: wind-blown sand around a mesh. The wind scours the sand in front of walls and deposits drifts behind
// them and in rooms.
//
// Model. H is the height of a wall above the sand at its foot, at most 30 m. All geometry is found by tracing
// rays through a copy of the mesh in the wind frame.
// - Faces. Rays run along lines parallel to the wind, half a cell apart. Each line has horizontal rays at up
//   to 192 heights, half a cell apart or less (more if that needs over 192), from the lowest sand at the mesh
//   to 30 m above the highest. All hits are collected; the number of solids that contain the ray identifies
//   the outer faces. Hits of one line that follow each other upwards form a face; an opening does not split a
//   face unless it is taller than the part below. The top is refined to 1/128 of the ray spacing. A face
//   counts only if it stands on the sand: the gap below is at most 1.5 rays or a quarter of its height.
//   Windward faces must be steeper than 55 degrees; below that no reversed vortex forms (Tsoar 1983, wind
//   tunnel tests of echo and climbing dunes). Lee faces must be steeper than 34 degrees, where the flow
//   separates and no sand lies.
// - Effective H. A wall narrower than high makes a vortex of its width: H = min(height, width), with the
//   width across the wind. (A shadow dune is as high as half the width of its obstacle times tan(repose):
//   Hesp 1981.) Flow that separates at an obstacle upwind reattaches within 6 heights (Kroy, Sauermann and
//   Herrmann 2002): only the part of a face above that shelter counts. H is averaged along the wall over a
//   distance H.
// - Scour, d = distance upwind of the face (Tsoar 1983): depth min(scour_depth, 0.4 tan 32) H (1 - d / 0.4 H)
//   c for d < 0.4 H, where c is the cosine of the angle between the wind and the horizontal normal of the
//   face. Sand at the rim slides in at 32 degrees, which also shapes the pit at the ends of a wall. Scour is
//   limited to the sand that is there: bedrock is exposed, not eroded.
// - Echo dune, where the reversed vortex drops that sand: from 0.4 H to 2 H, crest of 0.16 H c at 0.8 H,
//   cubic slopes of at most 31 and 11 degrees.
// - Drift, x = distance behind a lee face: drift_height H (1 - smooth(x / L)), L = drift_length H, smooth(u)
//   = u^2 (3 - 2 u). Its sides converge downwind: they move in by min(H, width / 2) x / L, so a narrow drift
//   tapers to a point and a wide one stays wide.
// - Rooms. A sample is enclosed by walls of height h (powers of two from 0.25 to 16 m) depending on how many
//   of 16 horizontal rays at h above the sand, and at 0.25 m, hit the mesh from outside within 8 h: 0 for up
//   to 10 hits, 1 for 15 or more, smooth between. h is the height that maximises this weight times h. One
//   sample in each half-metre block is traced, plus those that a wall separates from it. Enclosed neighbours
//   without a wall between them form a room. Its sand is filled up to one level: its mean height + inside *
//   drift * (mean h). The weight, blurred over half a metre, blends this with drifts and scour. A court wider
//   than 16 times the height of its walls is open ground.
// - Deposits are limited to slopes of 32 degrees, except where the ground below is steeper: the lower
//   envelope of cones over the samples, computed by sweeps. Neither this nor the rim of a pit reaches through
//   a wall. Both are smoothed over three samples. Triangles of the grid then stay within 34 degrees on level
//   sand, and within 36 on dunes of 15 degrees.
// - The zones extend into the mesh by at most 1.5 cells, so that the interpolated surface meets the face at
//   the right height.
//
// Sand budget, in whole units of sand. T is the sand that scour removes, W the sand that all deposits need.
// Deposits get B = T + supply (W - T), distributed proportionally and exactly: sum after = sum before + (B -
// T). supply = 0: no sand is added, and deposits are scaled down by T / W. If T > W (deposits outside of the
// terrain), only W is removed. The scale is the same for the whole mesh: parts that should not exchange sand
// need layers of their own.
//
// Limits. The wind has one direction; dunes do not shelter. A wall set back on top of another does not add to
// its height. Scour extends around corners only as far as its rim slides in. The mesh does not move: if its
// foot is exposed it stands in its pit, and sand may rise inside it. If the terrain below is steep, a fusion
// layer above lets the sand slide to repose. The mesh must be closed for its inside to be known. A single
// sheet counts as a wall without thickness, and so does every hit of a ray that does not end outside.
//
// Domain. Cells and vertices of any finite size; triangles with a vertex beyond 2^20 m or with an invalid
// index are ignored. scour, scour_depth, drift, drift_height, inside, supply: 0 to 1; drift_length: 0.25 to
// 20; values are clamped. Zones below two cells are not resolved: good scour needs H of at least 5 cells.
// Cost. Rays: lines times heights, and up to 70 for each traced sample within the box of the mesh, most of
// them for rooms. Nine rooms of 10 m on 0.25 m cells: 0.75 us of one core a sample of the box around all
// zones. Outside the box sand is copied. The sweeps are serial, everything else is parallel.
#include "procedural/terrain/ruin.h"

#include "core/math/digest.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <new>
#include <numeric>
#include <optional>
#include <utility>

namespace marram {
namespace {

constexpr double ruin_most_height = 30.0;                       // m
constexpr double ruin_scour_reach = 0.4, ruin_echo_reach = 2.0; // in H
constexpr double ruin_echo_crest = 0.8, ruin_echo_height = 0.16;
constexpr double ruin_shelter = 6.0;      // reattachment length, in heights
constexpr double ruin_farthest = 0x1p20;  // m: float resolution below this is 6 cm or better
constexpr int ruin_most_heights = 192;    // rays on one line
constexpr int ruin_most_lines = 1 << 15;  // along the wind
constexpr double ruin_ray_offset = 0.487; // ray position in its interval: avoids hits on symmetric geometry
const double ruin_slope = std::tan(32.0 * degree);
const double ruin_windward_cosine = std::cos(55.0 * degree), ruin_lee_cosine = std::cos(34.0 * degree);
const double ruin_windward_run = 1.0 / std::tan(55.0 * degree), ruin_lee_run = 1.0 / std::tan(34.0 * degree);

double ruin_smooth(double u) {
    const double v = std::clamp(u, 0.0, 1.0);
    return v * v * (3.0 - 2.0 * v);
}

RuinSettings ruin_within_ranges(RuinSettings s) {
    const auto share = [](double v) { return v > 0.0 ? std::min(v, 1.0) : 0.0; };
    s.scour = share(s.scour), s.scour_depth = share(s.scour_depth);
    s.drift = share(s.drift), s.drift_height = share(s.drift_height);
    s.inside = share(s.inside), s.supply = share(s.supply);
    s.drift_length = s.drift_length > 0.25 ? std::min(s.drift_length, 20.0) : 0.25;
    return s;
}

// ---- the mesh ----

struct RuinTriangles {
    std::vector<float> positions;
    std::vector<uint32_t> triangles;
};

bool ruin_valid_position(const float* p) {
    return std::abs(p[0]) <= ruin_farthest && std::abs(p[1]) <= ruin_farthest &&
           std::abs(p[2]) <= ruin_farthest;
}

// The triangles with three valid vertices: indices in range, positions finite and within ruin_farthest.
std::vector<uint32_t> ruin_valid_triangles(const MarramMesh& mesh) {
    std::vector<uint32_t> good;
    const float* positions = mesh.positions ? mesh.positions[0] : nullptr;
    if (!positions || !mesh.triangles) return good;
    for (size_t f = 0; f < mesh.triangle_count; ++f) {
        const uint32_t* v = mesh.triangles + 3 * f;
        bool in = true;
        for (int k = 0; k < 3; ++k)
            in = in && v[k] < mesh.vertex_count && ruin_valid_position(positions + 3 * v[k]);
        if (in) good.insert(good.end(), v, v + 3);
    }
    return good;
}

Vec2d ruin_centre(const MarramMesh& mesh, const std::vector<uint32_t>& triangles) {
    Vec2d low = Vec2d::Constant(infinity), high = -low;
    for (const uint32_t v : triangles) {
        const float* p = mesh.positions[0] + 3 * size_t(v);
        const Vec2d at(p[0], p[2]);
        low = low.cwiseMin(at), high = high.cwiseMax(at);
    }
    return 0.5 * (low + high);
}

RTCScene ruin_scene_of(const RuinTriangles& mesh, RTCScene beside) {
    const RTCDevice device =
        beside ? rtcGetSceneDevice(beside) : rtcNewDevice("set_affinity=0,start_threads=0");
    if (!device) throw std::bad_alloc();
    const RTCScene scene = rtcNewScene(device);
    // Robust: a ray that hits a shared edge does not miss both triangles.
    rtcSetSceneFlags(scene, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | MARRAM_SCENE_FILTER));
    const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                              3 * sizeof(float), mesh.positions.size() / 3);
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(uint32_t), mesh.triangles.size() / 3);
    if (positions && triangles) {
        std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<float*>(positions));
        std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<uint32_t*>(triangles));
        rtcSetGeometryMask(geometry, MARRAM_NAMED);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcCommitScene(scene);
    }
    rtcReleaseGeometry(geometry);
    rtcReleaseDevice(device); // the scene keeps a reference
    if (positions && triangles) return scene;
    rtcReleaseScene(scene);
    throw std::bad_alloc();
}

RTCRay ruin_ray(const Vec3d& from, const Vec3d& direction, double length) {
    const Vec3f p = from.cast<float>(), d = direction.cast<float>();
    RTCRay ray{};
    ray.org_x = p.x(), ray.org_y = p.y(), ray.org_z = p.z();
    ray.dir_x = d.x(), ray.dir_y = d.y(), ray.dir_z = d.z();
    ray.tnear = 0.0F, ray.tfar = float(length);
    ray.mask = MARRAM_NAMED;
    return ray;
}

} // namespace

RuinMesh::RuinMesh(const MarramMesh& mesh, const Vec2d& wind, RTCScene scene) {
    const double speed = wind.stableNorm();
    if (speed > 0.0 && std::isfinite(speed)) frame_.along = wind / speed;
    frame_.across = Vec2d(-frame_.along.y(), frame_.along.x());
    const std::vector<uint32_t> good = ruin_valid_triangles(mesh);
    if (good.empty()) return;
    frame_.origin = ruin_centre(mesh, good);
    RuinTriangles own;
    std::vector<uint32_t> renumbered(mesh.vertex_count, UINT32_MAX);
    lower_ = Vec3d::Constant(infinity), upper_ = -lower_;
    for (const uint32_t v : good) {
        if (renumbered[v] == UINT32_MAX) {
            renumbered[v] = uint32_t(own.positions.size() / 3);
            const float* p = mesh.positions[0] + 3 * size_t(v);
            const Vec2d flat = frame_.frame(Vec2d(p[0], p[2]));
            for (const double c : {flat.x(), double(p[1]), flat.y()}) own.positions.push_back(float(c));
            const Vec3d at(own.positions.end()[-3], own.positions.end()[-2], own.positions.end()[-1]);
            lower_ = lower_.cwiseMin(at), upper_ = upper_.cwiseMax(at);
        }
        own.triangles.push_back(renumbered[v]);
    }
    digest_ = Digest()
                  .add(own.positions)
                  .add(own.triangles)
                  .add(&frame_.origin, sizeof(Vec2d))
                  .add(&frame_.along, sizeof(Vec2d))
                  .value();
    scene_ = std::shared_ptr<RTCSceneTy>(ruin_scene_of(own, scene), [](RTCScene s) { rtcReleaseScene(s); });
}

namespace {

// Filter function: records a hit and rejects it, so that the ray continues.
void ruin_record_hit(const RTCFilterFunctionNArguments* args) {
    if (args->valid[0] == 0) return;
    constexpr size_t most = 4096; // limits the work of one ray
    auto& found = *static_cast<std::vector<RuinMesh::Hit>*>(marram_query_of(args));
    const Vec3d n(RTCHitN_Ng_x(args->hit, args->N, 0), RTCHitN_Ng_y(args->hit, args->N, 0),
                  RTCHitN_Ng_z(args->hit, args->N, 0));
    const double length = n.stableNorm();
    if (length > 0.0 && found.size() < most)
        found.push_back({double(RTCRayN_tfar(args->ray, args->N, 0)), n / length});
    args->valid[0] = 0;
}

} // namespace

void RuinMesh::hits(const Vec3d& from, const Vec3d& direction, double length, std::vector<Hit>& found) const {
    found.clear();
    RTCRayHit query{};
    query.ray = ruin_ray(from, direction, length);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1_filtered(scene_.get(), &query, 0, ruin_record_hit, &found);
    // At equal distance the entering hit comes first, so that touching solids count as one.
    std::sort(found.begin(), found.end(), [&](const Hit& a, const Hit& b) {
        return a.at != b.at ? a.at < b.at : a.normal.dot(direction) < b.normal.dot(direction);
    });
}

Vec3d RuinMesh::first(const Vec3d& from, const Vec3d& direction, double length) const {
    RTCRayHit query{};
    query.ray = ruin_ray(from, direction, length);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(scene_.get(), &query, 0);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return Vec3d::Zero();
    return Vec3d(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z).stableNormalized();
}

bool RuinMesh::occluded(const Vec3d& from, const Vec3d& direction, double length) const {
    RTCRay ray = ruin_ray(from, direction, length);
    marram_occluded1(scene_.get(), &ray);
    return ray.tfar < 0.0F;
}

namespace {

// ---- faces ----

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

// A face on one line. `height` starts as top - ground and becomes the effective H.
struct RuinFace {
    double s = 0.0, ground = 0.0, top = 0.0, cosine = 1.0;
    double height = 0.0;              // m
    double width = 0.0, to_end = 0.0; // m: width of the wall; distance to its nearer end
    double thickness = 0.0;           // m: of the solid behind (windward) or in front (lee)
    int line = 0;
};

// The faces on one line, both kinds sorted by s.
struct RuinLine {
    std::vector<RuinFace> windward, lee;
};

struct RuinLines {
    double first = 0.0, step = 1.0; // line l is at t = first + l step
    std::vector<RuinLine> lines;
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
void ruin_sort_hits(const std::vector<RuinHit>& hits, Take&& take) {
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
        ruin_sort_hits(hits, [&](const RuinHit& hit, bool faces_wind) {
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
    tbb::parallel_for(size_t(0), wall.size(), [&](size_t k) {
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
    tbb::parallel_for(size_t(0), lines_.lines.size(), [&](size_t l) {
        RuinLine& line = lines_.lines[l];
        trace_line(int(l), line);
        ruin_shelter_line(line);
        ruin_measure_thickness(line);
    });
    RuinWalls(lines_, &RuinLine::windward).measure();
    RuinWalls(lines_, &RuinLine::lee).measure();
    return std::move(lines_);
}

// ---- the shapes of the zones ----

struct RuinShape {
    double scour = 0.0, deposit = 0.0; // m: to remove, to add
};

class RuinZones {
  public:
    RuinZones(const RuinSettings& settings, double cell) : settings_(settings), pad_(1.5 * cell) {}
    RuinShape at(const RuinLine& line, double s) const;

  private:
    double echo(double d, const RuinFace& face) const;
    double scour(double d, const RuinFace& face) const;
    double drift(double x, const RuinFace& face) const;
    double pad(const RuinFace& face) const { return std::min(pad_, 0.5 * face.thickness); }

    const RuinSettings& settings_;
    double pad_; // m: how far zones extend into the mesh
};

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

// ---- on the grid ----

// The samples of a rectangle.
struct RuinGrid {
    Rect rect;
    int nx = 0, nz = 0;
    std::vector<double> ground, scour, deposit; // m
    std::vector<double> level, floor, cap;      // m: used by the sweeps
    std::vector<char> wall_x, wall_z, solid;    // wall to the next sample in x, z; inside a solid
    std::vector<double> room, walls;            // enclosure, 0 to 1; height of the walls, m

    explicit RuinGrid(const Rect& r)
        : rect(r), nx(r.i1 - r.i0), nz(r.j1 - r.j0), ground(count()), scour(count()), deposit(count()),
          level(count()), floor(count()), cap(count()), wall_x(count()), wall_z(count()), solid(count()),
          room(count()), walls(count()) {}
    size_t count() const { return size_t(nx) * size_t(nz); }
    size_t at(int i, int j) const { return size_t(j) * size_t(nx) + size_t(i); }
};

// Lower envelope of cones on a grid: level = min over seeds of level(seed) + rise * (distance in cells). Each
// sample stores its seed and passes it to neighbours without a wall between (distance transform: Danielsson
// 1980). Levels only fall, never below `floor`. Only values below `cap` are accepted.
class RuinCones {
  public:
    RuinCones(RuinGrid& grid, double rise) : grid_(grid), rise_(rise), seed_(grid.count()) {
        std::iota(seed_.begin(), seed_.end(), size_t(0));
        base_ = grid.level;
    }
    void settle() {
        constexpr int most = 32; // rounds: enough for a path around 32 corners
        for (int round = 0; round < most; ++round) {
            bool fell = false;
            for (const int d : {0, 1, 2, 3}) fell = sweep(d & 1, d & 2) || fell;
            if (!fell) return;
        }
    }

  private:
    bool sweep(bool right, bool down);
    bool take(size_t k, int i, int j, size_t from);

    RuinGrid& grid_;
    double rise_;
    std::vector<size_t> seed_;
    std::vector<double> base_; // the level of a seed
};

// Takes the seed of a neighbour if it gives a lower level. Returns true if the level fell.
bool RuinCones::take(size_t k, int i, int j, size_t from) {
    double& level = grid_.level[k];
    const double most = std::min(level, grid_.cap[k]);
    if (!(grid_.level[from] < most)) return false;
    const size_t seed = seed_[from], nx = size_t(grid_.nx);
    if (seed == seed_[k]) return false;
    const double x = double(i) - double(seed % nx), z = double(j) - double(seed / nx);
    const double v = base_[seed] + rise_ * std::sqrt(x * x + z * z);
    if (!(v < most)) return false;
    if (v > grid_.floor[k]) {
        level = v, seed_[k] = seed;
        return true;
    }
    if (!(grid_.floor[k] < most)) return false;
    level = base_[k] = grid_.floor[k], seed_[k] = k;
    return true;
}

// One pass in the given directions. Returns true if any level fell.
bool RuinCones::sweep(bool right, bool down) {
    bool fell = false;
    const auto nx = size_t(grid_.nx);
    for (int y = 0; y < grid_.nz; ++y) {
        const int j = down ? y : grid_.nz - 1 - y;
        for (int x = 0; x < grid_.nx; ++x) {
            const int i = right ? x : grid_.nx - 1 - x;
            const size_t k = grid_.at(i, j);
            if (!(grid_.level[k] > grid_.floor[k])) continue; // already at the floor
            if (i > 0 && !grid_.wall_x[k - 1]) fell = take(k, i, j, k - 1) || fell;
            if (i + 1 < grid_.nx && !grid_.wall_x[k]) fell = take(k, i, j, k + 1) || fell;
            if (j > 0 && !grid_.wall_z[k - nx]) fell = take(k, i, j, k - nx) || fell;
            if (j + 1 < grid_.nz && !grid_.wall_z[k]) fell = take(k, i, j, k + nx) || fell;
        }
    }
    return fell;
}

struct RuinRoom {
    double share = 0.0, walls = 0.0; // enclosure, 0 to 1; height of the walls, m
};

class RuinShaper {
  public:
    RuinShaper(const Domain& domain, const Fields& below, const RuinMesh& mesh, const RuinSettings& settings,
               const Rect& rect)
        : domain_(domain), below_(below), mesh_(mesh), settings_(settings), grid_(rect) {}

    // False: cancelled.
    bool shape(RuinResult& result, const std::function<bool()>& cancelled);
    const RuinGrid& grid() const { return grid_; }

  private:
    Vec2d place(int i, int j) const {
        return mesh_.frame().frame({domain_.x(grid_.rect.i0 + i), domain_.z(grid_.rect.j0 + j)});
    }
    bool near(const Vec2d& p, double margin) const {
        return p.x() >= mesh_.lower().x() - margin && p.x() <= mesh_.upper().x() + margin &&
               p.y() >= mesh_.lower().z() - margin && p.y() <= mesh_.upper().z() + margin;
    }
    template <typename F>
    void rows(F&& f) {
        tbb::parallel_for(0, grid_.nz, [&](int j) {
            for (int i = 0; i < grid_.nx; ++i) f(i, j, grid_.at(i, j));
        });
    }
    void read(const RuinLines& lines);
    void find_walls();
    bool within(const Vec2d& p, double y) const;
    bool wall(const Vec2d& p, const Vec2d& q, double y) const;
    RuinRoom room_at(const Vec2d& p, double ground) const;
    double level_of(const std::vector<size_t>& room) const;
    double around(const Vec2d& p, double y, double reach) const;
    bool hits_front_faces(const Vec2d& p, double y, double reach) const;
    void find_rooms();
    void fill_rooms(RuinResult& result);
    std::vector<size_t> flood(size_t first, std::vector<char>& seen) const;
    void smooth_field(std::vector<double>& field);
    void collapse_pit_rim();
    void limit_deposit_slope();

    const Domain& domain_;
    const Fields& below_;
    const RuinMesh& mesh_;
    const RuinSettings& settings_;
    RuinGrid grid_;
};

void RuinShaper::read(const RuinLines& lines) {
    const RuinZones zones(settings_, domain_.cell);
    rows([&](int i, int j, size_t k) {
        const size_t sample = domain_.index(grid_.rect.i0 + i, grid_.rect.j0 + j);
        const Vec2d p = place(i, j);
        const RuinShape shape = ruin_between_lines(lines, zones, p.x(), p.y());
        grid_.ground[k] = below_.height(sample);
        grid_.scour[k] = std::min(shape.scour, sand_metres(below_.sand[sample]));
        grid_.deposit[k] = shape.deposit;
    });
}

bool RuinShaper::wall(const Vec2d& p, const Vec2d& q, double y) const {
    const Vec2d way = q - p;
    const double length = way.norm();
    return mesh_.occluded({p.x(), y, p.y()}, {way.x() / length, 0.0, way.y() / length}, length);
}

// True if a point is inside a solid: rays upwards and downwind both have more exits than entries.
bool RuinShaper::within(const Vec2d& p, double y) const {
    static thread_local std::vector<RuinMesh::Hit> found;
    for (const Vec3d& way : {Vec3d(0.0, 1.0, 0.0), Vec3d(1.0, 0.0, 0.0)}) {
        mesh_.hits({p.x(), y, p.y()}, way, ruin_farthest, found);
        int left = 0;
        for (const RuinMesh::Hit& hit : found) left += hit.normal.dot(way) > 0.0 ? 1 : -1;
        if (left <= 0) return false;
    }
    return true;
}

// Tests for walls between neighbouring samples, a tenth of a cell above the higher one.
void RuinShaper::find_walls() {
    const double above = 0.1 * domain_.cell;
    rows([&](int i, int j, size_t k) {
        const Vec2d p = place(i, j);
        grid_.solid[k] = near(p, 0.0) && within(p, grid_.ground[k] + above);
    });
    rows([&](int i, int j, size_t k) {
        const Vec2d p = place(i, j);
        if (!near(p, 2.0 * domain_.cell)) return;
        const auto look = [&](int i1, int j1, std::vector<char>& walls) {
            if (i1 >= grid_.nx || j1 >= grid_.nz) return;
            const size_t n = grid_.at(i1, j1);
            walls[k] = grid_.solid[k] || grid_.solid[n] ||
                       wall(p, place(i1, j1), std::max(grid_.ground[k], grid_.ground[n]) + above);
        };
        look(i + 1, j, grid_.wall_x);
        look(i, j + 1, grid_.wall_z);
    });
}

constexpr int ruin_directions = 16, ruin_open = 10, ruin_enclosed = 15; // numbers of rays
constexpr double ruin_least_room = 0.25, ruin_tallest_room = 16.0;      // m: wall heights above the sand

// Horizontal directions. The first few are far apart, so that a few rays identify open ground.
const std::array<Vec3d, ruin_directions> ruin_ray_directions = [] {
    std::array<Vec3d, ruin_directions> round;
    for (int n = 0; n < ruin_directions; ++n) {
        const int turn = (n * 7) % ruin_directions;
        const double angle = 2.0 * pi * (turn + ruin_ray_offset) / ruin_directions;
        round[size_t(n)] = Vec3d(std::cos(angle), 0.0, std::sin(angle));
    }
    return round;
}();

// Enclosure of a point, 0 to 1, from the number of rays (of 16) that hit the mesh.
double RuinShaper::around(const Vec2d& p, double y, double reach) const {
    int met = ruin_directions;
    for (const Vec3d& way : ruin_ray_directions)
        if (!mesh_.occluded({p.x(), y, p.y()}, way, reach) && --met <= ruin_open) return 0.0;
    return ruin_smooth(double(met - ruin_open) / (ruin_enclosed - ruin_open));
}

// True if most of the faces hit are front-facing. From inside a solid most would be back-facing.
bool RuinShaper::hits_front_faces(const Vec2d& p, double y, double reach) const {
    int faces = 0;
    for (const Vec3d& way : ruin_ray_directions) {
        const double away = mesh_.first({p.x(), y, p.y()}, way, reach).dot(way);
        faces += int(away < 0.0) - int(away > 0.0);
    }
    return faces > 0;
}

// First tests enclosure near the sand, within the reach of the tallest walls. Then finds the wall height with
// the largest enclosure * height.
RuinRoom RuinShaper::room_at(const Vec2d& p, double ground) const {
    const double top = mesh_.upper().y() - ground;
    RuinRoom best;
    if (!(top > ruin_least_room)) return best;
    const double least = around(p, ground + ruin_least_room, 8.0 * std::min(top, ruin_tallest_room));
    if (!(least > 0.0)) return best;
    for (double h = ruin_tallest_room; h >= ruin_least_room; h *= 0.5) {
        if (!(h < top && h > best.share * best.walls)) continue;
        const double share = std::min(least, around(p, ground + h, 8.0 * h));
        if (share * h > best.share * best.walls && hits_front_faces(p, ground + h, 8.0 * h))
            best = {share, h};
    }
    return best;
}

// Traces one sample in each block of half a metre, and the samples that a wall separates from it.
void RuinShaper::find_rooms() {
    const int side = int(std::clamp(std::floor(0.5 / domain_.cell), 1.0, 16.0));
    const auto parted = [&](int i, int j, int i1, int j1) { // path along the row, then the column
        for (int x = i; x < i1; ++x)
            if (grid_.wall_x[grid_.at(x, j)]) return true;
        for (int z = j; z < j1; ++z)
            if (grid_.wall_z[grid_.at(i1, z)]) return true;
        return false;
    };
    tbb::parallel_for(0, (grid_.nz + side - 1) / side, [&](int row) {
        for (int j = row * side; j < std::min((row + 1) * side, grid_.nz); ++j)
            for (int i = 0; i < grid_.nx; ++i) {
                const size_t k = grid_.at(i, j);
                const Vec2d p = place(i, j);
                if (!near(p, 0.0) || grid_.solid[k]) continue;
                const int i0 = i / side * side, j0 = row * side;
                const size_t first = grid_.at(i0, j0);
                const bool known =
                    k != first && near(place(i0, j0), 0.0) && !grid_.solid[first] && !parted(i0, j0, i, j);
                const RuinRoom room =
                    known ? RuinRoom{grid_.room[first], grid_.walls[first]} : room_at(p, grid_.ground[k]);
                grid_.room[k] = room.share, grid_.walls[k] = room.walls;
            }
    });
}

// Flood fill: all samples of the room that contains `first`.
std::vector<size_t> RuinShaper::flood(size_t first, std::vector<char>& seen) const {
    std::vector<size_t> room{first};
    seen[first] = 1;
    const auto nx = size_t(grid_.nx);
    const auto add = [&](size_t k, char parted) {
        if (parted || seen[k] || !(grid_.room[k] > 0.0)) return;
        seen[k] = 1;
        room.push_back(k);
    };
    for (size_t n = 0; n < room.size(); ++n) {
        const size_t k = room[n], i = k % nx, j = k / nx;
        if (i > 0) add(k - 1, grid_.wall_x[k - 1]);
        if (i + 1 < nx) add(k + 1, grid_.wall_x[k]);
        if (j > 0) add(k - nx, grid_.wall_z[k - nx]);
        if (j + 1 < size_t(grid_.nz)) add(k + nx, grid_.wall_z[k]);
    }
    return room;
}

// The sand level of a room: its mean height plus a fraction of the mean height of its walls.
double RuinShaper::level_of(const std::vector<size_t>& room) const {
    double ground = 0.0, walls = 0.0, sum = 0.0;
    for (const size_t k : room) {
        sum += grid_.room[k];
        ground += grid_.room[k] * grid_.ground[k], walls += grid_.room[k] * grid_.walls[k];
    }
    return (ground + settings_.inside * settings_.drift * walls) / sum;
}

void RuinShaper::fill_rooms(RuinResult& result) {
    if (!(settings_.inside * settings_.drift > 0.0)) return;
    find_rooms();
    std::vector<char> seen(grid_.count());
    std::vector<double>& level = grid_.walls; // reused: sand level * enclosure
    for (size_t k = 0; k < grid_.count(); ++k) {
        if (seen[k] || !(grid_.room[k] > 0.0)) continue;
        const std::vector<size_t> room = flood(k, seen);
        const bool counts = room.size() >= 4; // fewer samples: just a corner
        result.rooms += counts;
        const double rises = level_of(room);
        for (const size_t n : room) {
            if (!counts) grid_.room[n] = 0.0;
            level[n] = grid_.room[n] * rises;
        }
    }
    if (result.rooms == 0) return;
    // Enclosure is quantised by rays and blocks: blur it over half a metre, with at most 64 passes of 3
    // samples.
    const int times = int(std::clamp(0.5 / (domain_.cell * domain_.cell), 1.0, 64.0));
    for (int n = 0; n < times; ++n) smooth_field(grid_.room), smooth_field(level);
    rows([&](int, int, size_t k) {
        const double share = grid_.room[k];
        if (!(share > 0x1p-20)) return; // negligible: a millionth of a deposit
        const double rise = std::max(level[k] / share - grid_.ground[k], 0.0);
        grid_.scour[k] *= 1.0 - share;
        grid_.deposit[k] += share * (rise - grid_.deposit[k]);
    });
}

// Lets sand at the rim of the scour slide into the pit.
void RuinShaper::collapse_pit_rim() {
    rows([&](int i, int j, size_t k) {
        const size_t sample = domain_.index(grid_.rect.i0 + i, grid_.rect.j0 + j);
        grid_.cap[k] = grid_.ground[k];
        grid_.floor[k] = grid_.ground[k] - sand_metres(below_.sand[sample]);
        grid_.level[k] = grid_.scour[k] > 0.0 ? grid_.ground[k] - grid_.scour[k] : infinity;
    });
    RuinCones(grid_, ruin_slope * domain_.cell).settle();
    rows([&](int, int, size_t k) { grid_.scour[k] = std::max(grid_.ground[k] - grid_.level[k], 0.0); });
    smooth_field(grid_.scour);
    rows([&](int, int, size_t k) {
        grid_.scour[k] = std::min(grid_.scour[k], grid_.ground[k] - grid_.floor[k]);
    });
}

// Smooths with weights 1, 2, 1 along rows and then columns, but not across walls. Without it triangles at the
// tips and creases of cones would be up to sqrt(2) times as steep as the cones.
void RuinShaper::smooth_field(std::vector<double>& field) {
    const auto pass = [&](size_t stride, const std::vector<char>& walls, auto&& inner) {
        std::copy(field.begin(), field.end(), grid_.level.begin());
        rows([&](int i, int j, size_t k) {
            const auto [has_before, has_after] = inner(i, j);
            const double own = grid_.level[k];
            const double before = has_before && !walls[k - stride] ? grid_.level[k - stride] : own;
            const double after = has_after && !walls[k] ? grid_.level[k + stride] : own;
            field[k] = 0.25 * before + 0.5 * own + 0.25 * after;
        });
    };
    pass(1, grid_.wall_x, [&](int i, int) { return std::pair(i > 0, i + 1 < grid_.nx); });
    pass(size_t(grid_.nx), grid_.wall_z, [&](int, int j) { return std::pair(j > 0, j + 1 < grid_.nz); });
}

// Limits deposits to the angle of repose.
void RuinShaper::limit_deposit_slope() {
    rows([&](int, int, size_t k) {
        grid_.floor[k] = grid_.ground[k] - grid_.scour[k];
        grid_.cap[k] = infinity;
        grid_.level[k] = grid_.floor[k] + grid_.deposit[k];
    });
    RuinCones(grid_, ruin_slope * domain_.cell).settle();
    rows([&](int, int, size_t k) { grid_.deposit[k] = grid_.level[k] - grid_.floor[k]; });
    smooth_field(grid_.deposit);
}

bool RuinShaper::shape(RuinResult& result, const std::function<bool()>& cancelled) {
    const auto stop = [&] { return cancelled && cancelled(); };
    RuinFaceFinder surveyor(mesh_, RuinGround{domain_, below_});
    RuinLines lines = surveyor.survey();
    if (stop()) return false;
    for (const RuinLine& line : lines.lines) {
        result.windward += int(line.windward.size());
        result.lee += int(line.lee.size());
    }
    read(lines);
    find_walls();
    if (stop()) return false;
    fill_rooms(result);
    if (stop()) return false;
    collapse_pit_rim();
    if (stop()) return false;
    limit_deposit_slope();
    return !stop();
}

// ---- the sand budget ----

__extension__ using RuinWide = unsigned __int128;

// part * all / whole, rounded down; part <= whole, whole > 0.
SandUnits ruin_prorated(SandUnits part, SandUnits all, SandUnits whole) {
    return SandUnits(RuinWide(part) * RuinWide(all) / RuinWide(whole));
}

// Scales counts so that their sum is exactly `all`, by differences of the scaled running sum. sum(counts) =
// whole >= all. No count grows.
void ruin_scale(std::vector<SandUnits>& counts, SandUnits all, SandUnits whole) {
    if (all == whole) return;
    SandUnits running = 0, before = 0;
    for (SandUnits& count : counts) {
        if (count == 0) continue;
        running += count;
        const SandUnits now = ruin_prorated(running, all, whole);
        count = now - before;
        before = now;
    }
}

SandUnits ruin_sum(const std::vector<SandUnits>& counts) {
    return std::accumulate(counts.begin(), counts.end(), SandUnits(0));
}

void ruin_balance_sand(const RuinGrid& grid, const Domain& domain, double supply, SandUnits* sand,
                       RuinResult& result) {
    std::vector<SandUnits> taken(grid.count()), given(grid.count());
    const auto sample = [&](size_t k) {
        return domain.index(grid.rect.i0 + int(k % size_t(grid.nx)), grid.rect.j0 + int(k / size_t(grid.nx)));
    };
    for (size_t k = 0; k < grid.count(); ++k) {
        if (grid.scour[k] > 0.0) taken[k] = std::min(sand_units(grid.scour[k]), sand[sample(k)]);
        if (grid.deposit[k] > 0.0) given[k] = sand_units(grid.deposit[k]);
    }
    const SandUnits from = ruin_sum(taken), wanted = ruin_sum(given);
    result.taken = std::min(from, wanted);
    result.supplied = SandUnits(std::floor(supply * double(wanted - result.taken)));
    result.supplied = std::min(result.supplied, wanted - result.taken); // the double may have rounded up
    result.given = result.taken + result.supplied;
    if (from > 0) ruin_scale(taken, result.taken, from);
    if (wanted > 0) ruin_scale(given, result.given, wanted);
    for (size_t k = 0; k < grid.count(); ++k)
        if (taken[k] != given[k]) sand[sample(k)] += given[k] - taken[k];
}

// The bounding rectangle of all zones, in samples.
Rect ruin_touched(const Domain& domain, const RuinMesh& mesh, const RuinSettings& settings) {
    if (mesh.empty() || domain.nx < 1 || domain.nz < 1) return {};
    const Vec3d &low = mesh.lower(), &high = mesh.upper();
    const double height = std::min(high.y() - low.y(), ruin_most_height), side = height + 2.0 * domain.cell;
    Vec2d a = Vec2d::Constant(infinity), b = -a;
    for (const double s : {low.x() - ruin_echo_reach * height - side,
                           high.x() + std::max(settings.drift_length, 1.0) * height + side})
        for (const double t : {low.z() - side, high.z() + side}) {
            a = a.cwiseMin(mesh.frame().world(s, t));
            b = b.cwiseMax(mesh.frame().world(s, t));
        }
    const auto index = [&](double metres, double origin, int count) {
        return int(std::clamp(std::ceil((metres - origin) / domain.cell), 0.0, double(count)));
    };
    return {index(a.x(), domain.x0, domain.nx), index(a.y(), domain.z0, domain.nz),
            index(b.x(), domain.x0, domain.nx), index(b.y(), domain.z0, domain.nz)};
}

void ruin_copy(const Domain& domain, const Rect& rect, const SandUnits* from, SandUnits* to) {
    if (rect.empty()) return;
    tbb::parallel_for(rect.j0, rect.j1, [&](int j) {
        const size_t first = domain.index(rect.i0, j);
        std::copy_n(from + first, size_t(rect.i1 - rect.i0), to + first);
    });
}

} // namespace

RuinLayer::RuinLayer(const Domain& domain, const Vec2d& wind, const MarramMesh& mesh, RTCScene scene,
                     const RuinSettings& settings)
    : domain_(domain), settings_(ruin_within_ranges(settings)), mesh_(mesh, wind, scene),
      touched_(ruin_touched(domain_, mesh_, settings_)) {}

void RuinLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (out.sand) ruin_copy(domain_, rect, below.sand, out.sand);
}

RuinResult RuinLayer::move_sand(const Fields& below, SandUnits* sand,
                                const std::function<bool()>& cancelled) const {
    ruin_copy(domain_, {0, 0, domain_.nx, domain_.nz}, below.sand, sand);
    RuinResult result;
    if (touched_.empty() || !(domain_.cell > 0.0)) return result;
    RuinShaper shaper(domain_, below, mesh_, settings_, touched_);
    if (!shaper.shape(result, cancelled)) {
        result.cancelled = true;
        return result;
    }
    ruin_balance_sand(shaper.grid(), domain_, settings_.supply, sand, result);
    return result;
}

bool RuinLayer::evaluate_whole(const Fields& below, const LayerOutput& out,
                               const std::function<bool()>& cancelled) const {
    return !out.sand || !move_sand(below, out.sand, cancelled).cancelled;
}

Tiles RuinLayer::changed_since(const TerrainLayer& before, const Domain& domain) const {
    const auto* other = dynamic_cast<const RuinLayer*>(&before);
    if (!other || other->domain_ != domain_ || domain != domain_) return Tiles(domain, true);
    Tiles tiles(domain);
    if (other->settings_ == settings_ && other->mesh_.digest() == mesh_.digest()) return tiles;
    for (const Rect& r : {touched_, other->touched_})
        if (!r.empty())
            tiles.add_box({domain.x(r.i0), domain.z(r.j0)}, {domain.x(r.i1 - 1), domain.z(r.j1 - 1)});
    return tiles;
}

namespace {

constexpr std::array ruin_params = {
    MarramParam{"mesh", MARRAM_MESH_NAME, "", "", 0, 0, "", "the mesh that stands in the sand"},
    MarramParam{"scour", MARRAM_NUMBER, "", "1", 0, 1, "",
                "strength of scour in front of walls steeper than 55 degrees, and of the echo dune upwind"},
    MarramParam{"scour_depth", MARRAM_NUMBER, "", "0.25", 0, 1, "",
                "at the wall, in its heights above the sand; the sand's slope allows 0.26"},
    MarramParam{"drift", MARRAM_NUMBER, "", "1", 0, 1, "", "how much sand gathers in the lee and in rooms"},
    MarramParam{"drift_length", MARRAM_NUMBER, "", "4", 0.25, 20, "", "in heights of the wall"},
    MarramParam{"drift_height", MARRAM_NUMBER, "", "0.3", 0, 1, "", "at the wall, in its heights"},
    MarramParam{"inside", MARRAM_NUMBER, "", "0.2", 0, 1, "",
                "rise of the sand in rooms, in heights of their walls"},
    MarramParam{"supply", MARRAM_NUMBER, "", "1", 0, 1, "",
                "fraction of the deposited sand not covered by scour that is added from "
                "outside; 0: no sand is added"},
};

std::unique_ptr<TerrainLayer> ruin_make(const LayerContext& context) {
    const LayerValues& values = context.values;
    RuinSettings settings;
    settings.scour = values.number("scour");
    settings.scour_depth = values.number("scour_depth");
    settings.drift = values.number("drift");
    settings.drift_length = values.number("drift_length");
    settings.drift_height = values.number("drift_height");
    settings.inside = values.number("inside");
    settings.supply = values.number("supply");
    const MarramMesh& mesh = context.mesh(values.text("mesh"));
    auto layer = std::make_unique<RuinLayer>(context.domain, context.wind, mesh, context.scene, settings);
    if (layer->touched().empty() && context.warn)
        context.warn(values.place("mesh"), "the mesh '" + values.text("mesh") + "' is not on the terrain",
                     "move it, or make the terrain larger");
    return layer;
}

} // namespace

LayerType ruin_layer_type() {
    return {"ruin", "a mesh stands in the sand: scour in front of walls, drifts behind them and in rooms",
            ruin_params, ruin_make};
}

} // namespace marram
