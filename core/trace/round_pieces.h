// SPDX-License-Identifier: Apache-2.0
// Traces round curves as straight pieces. Embree finds the pieces that a ray may enter, as flat ones, which
// have the same silhouette. The entry point is computed here, in double, while Embree traverses: it calls a
// filter function with each hit.
//
// A piece is all points within r of its axis, with r linear between its two corners: a cone, with a ball at
// each end so that bent strands have no gaps. A ray hits a piece where it enters it; a ray that starts inside
// does not hit it.
//
// Embree orders flat pieces by the depth at which the ray passes the axis. The ray enters a piece of length l
// at most l + r before that. So traversal continues to `reach`, the largest l + r, beyond the nearest hit of
// any kind: no piece is missed whose axis is behind another strand's or below the skin. Testing every piece
// gives the same result (tests/run -R RoundPieces -V).
//
// Cost: in fur the reach takes a few percent of the time at most (a reach of 4 r was not measurably faster);
// among many other curves round pieces cost more, see curve_pieces.h. Error: a few roundings of double,
// except for what Embree decides in float, the silhouette. If a strand tapers by k = dr / dlength, then for
// rays at an angle below k to its direction the silhouette is that of the cone's thin end. The pieces'
// corners are rounded to float.
#pragma once

#include "core/geometry/world.h"
#include "core/plugin/embree.h"

namespace marram {

// Ends of a straight piece: x, y, z, radius.
struct RoundPiece {
    Vec4d begin, end;
};

// Where a ray enters a piece.
struct Entry {
    double t = 0.0;
    double along = 0.0; // fraction of the axis; 0 or 1: the ball at that end
};

// Finds the entry at t >= tnear; false if there is none. direction: unit.
bool enter(const RoundPiece& piece, const Vec3d& origin, const Vec3d& direction, double tnear, Entry& entry);

// Adds round pieces to the world: vertices as written by write_pieces (curve_pieces.h), at the next motion
// key. They stay in use.
void add_round_pieces(World& world, CurveGeometry& curves, float* vertices);

// Largest length + radius of the pieces of some curves at a motion key, m.
double reach_of(const float* vertices, size_t curves, size_t pieces);

// The same for the scene of a patch, whose vertices these are.
void mark_round_vertices(float* vertices, size_t count);

// Call after the scene is committed. Embree ignores flat pieces whose axis a ray meets within 2 r of its
// start. It reads vertices during traversal: with negative radii it ignores pieces within 2 r behind the
// start instead, which the ray cannot enter anyway.
void mark_round_pieces(World& world);

// Like rtcIntersect1 and rtcOccluded1, in a world with round pieces (World::filtered). For a hit on a
// piece, hit.u is Entry::along and t is Entry::t in double; else t is ray.tfar.
void intersect_round(const World& world, RTCRayHit& query, bool coherent, double& t);
void occluded_round(const World& world, RTCRay& query);

// Goes on with a query in the scene of a lazy patch, from the callback of its box. reach: of its round
// pieces, 0 if there are none. Geometries of the patch have a PatchPart as user data.
void intersect_patch(const RTCIntersectFunctionNArguments* args, RTCScene patch, double reach,
                     RTCRayHit& hit);
void occluded_patch(const RTCOccludedFunctionNArguments* args, RTCScene patch, double reach, RTCRay& ray);

} // namespace marram
