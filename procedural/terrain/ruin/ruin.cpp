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
// Cost. Rays: lines times heights, and some 70 for each traced sample within the box of the mesh, most of
// them for rooms. Nine rooms of 10 m on 0.25 m cells: 0.75 us of one core a sample of the box around all
// zones. Outside the box sand is copied. The sweeps are serial, everything else is parallel.
//
// Files, in the order of the model. ruin_mesh: the copy of the mesh and its rays. ruin_faces: faces and
// effective H. ruin_zones: scour, echo dune, drift. ruin_rooms: rooms. ruin_shaper: the steps on the grid.
// ruin_cones: the slope limit. ruin_budget: the sand budget. This file: the layer and its parameters.
#include "procedural/terrain/ruin/ruin.h"

#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/ruin/ruin_budget.h"
#include "procedural/terrain/ruin/ruin_faces.h"
#include "procedural/terrain/ruin/ruin_shaper.h"
#include "procedural/terrain/ruin/ruin_zones.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

RuinSettings ruin_within_ranges(RuinSettings s) {
    const auto share = [](double v) { return v > 0.0 ? std::min(v, 1.0) : 0.0; };
    s.scour = share(s.scour), s.scour_depth = share(s.scour_depth);
    s.drift = share(s.drift), s.drift_height = share(s.drift_height);
    s.inside = share(s.inside), s.supply = share(s.supply);
    s.drift_length = s.drift_length > 0.25 ? std::min(s.drift_length, 20.0) : 0.25;
    return s;
}

// The bounding rectangle of all zones, in samples.
Rect ruin_touched(const Domain& domain, const RuinMesh& mesh, const RuinSettings& settings) {
    if (mesh.empty() || domain.nx < 1 || domain.nz < 1) return {};
    const Vec3d &low = mesh.lower(), &high = mesh.upper();
    // A face may start a quarter of its height, or 1.5 rays, above the sand (ruin_faces.cpp).
    const double height = std::min(4.0 / 3.0 * (high.y() - low.y()) + domain.cell, ruin_most_height);
    const double side = height + 2.0 * domain.cell;
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
    Rect rect{index(a.x(), domain.x0, domain.nx), index(a.y(), domain.z0, domain.nz),
              index(b.x(), domain.x0, domain.nx), index(b.y(), domain.z0, domain.nz)};
    if (rect.empty()) return {};
    // Blocks of rooms are counted from its corner. Aligned, they do not move when a parameter changes the
    // rectangle.
    const int block = ruin_block_side(domain.cell);
    rect.i0 -= rect.i0 % block, rect.j0 -= rect.j0 % block;
    return rect;
}

void ruin_copy(const Domain& domain, const Rect& rect, const SandUnits* from, SandUnits* to) {
    if (rect.empty()) return;
    marram::parallel_for(rect.j0, rect.j1, [&](int j) {
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
    param::mesh("mesh", "", "", "the mesh that stands in the sand"),
    param::number("scour", "", "1", 0, 1,
                  "strength of scour in front of walls steeper than 55 degrees, and of the echo dune upwind"),
    param::number("scour_depth", "", "0.25", 0, 1,
                  "at the wall, in its heights above the sand; the sand's slope allows 0.26"),
    param::number("drift", "", "1", 0, 1, "how much sand gathers in the lee and in rooms"),
    param::number("drift_length", "", "4", 0.25, 20, "in heights of the wall"),
    param::number("drift_height", "", "0.3", 0, 1, "at the wall, in its heights"),
    param::number("inside", "", "0.2", 0, 1, "rise of the sand in rooms, in heights of their walls"),
    param::number("supply", "", "1", 0, 1,
                  "fraction of the deposited sand not covered by scour that is added from "
                  "outside; 0: no sand is added"),
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
