// SPDX-License-Identifier: Apache-2.0
// Round fibres traced as straight pieces. Embree finds those that a ray may enter, as flat ones, which have the same silhouette;
// where the ray enters is computed here, in double, while Embree traverses (it calls a filter function with each hit).
//
// A piece is all points within r of its axis, r linear between its two corners: a cone, with a ball at either end so that bent
// strands have no gaps. A ray meets it where it enters; of a piece that it starts in it meets nothing.
//
// Embree orders flat pieces by the depth at which the ray passes the axis. The ray enters a piece of length l no more than l + r
// before that. So Embree goes on until `reach`, the greatest l + r, behind the nearest hit of whatever kind: nothing is lost whose
// axis lies behind another strand's or below the skin. Asking every piece instead finds the same (tests/run -R RoundPieces -V).
//
// Cost: in fur the reach takes a few percent of the time at most (a reach of 4 r instead was no faster beyond the noise of timing);
// among much else they cost more, see curve_pieces.h. Error: a few roundings of double, but for what Embree decides in
// float, the silhouette; where a strand tapers by k = dr / dlength, and for rays closer than k to its direction, the silhouette is that
// of the cone's thin end. The pieces' corners are rounded to float.
#pragma once

#include "core/geometry/world.h"
#include "core/plugin/embree.h"

namespace marram {

// A straight piece's ends: x, y, z, radius.
struct RoundPiece {
    Vec4d begin, end;
};

// Where a ray enters a piece.
struct Entry {
    double t = 0.0;
    double along = 0.0; // share of the axis; 0 or 1 where it is the ball at that end
};

// False where it does not, at t >= tnear. direction: unit.
bool enter(const RoundPiece& piece, const Vec3d& origin, const Vec3d& direction, double tnear, Entry& entry);

// Makes the world trace them: vertices as write_pieces of curve_pieces.h writes them at the next motion key. They stay in use.
void add_round_pieces(World& world, CurveGeometry& curves, float* vertices);

// To be called after the scene was committed. Embree leaves out flat pieces whose axis a ray meets within 2 r of its start. It reads
// vertices while it traverses: with radii below 0 it leaves out what is 2 r behind the start, which may not be entered anyway.
void mark_round_pieces(World& world);

// As rtcIntersect1 and rtcOccluded1, in a world that has such pieces: World::reach > 0. Of a hit piece hit.u is Entry::along, and t
// is that in double; elsewhere t is ray.tfar.
void intersect_round(const World& world, RTCRayHit& query, bool coherent, double& t);
void occluded_round(const World& world, RTCRay& query);

} // namespace marram
