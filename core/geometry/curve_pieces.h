// SPDX-License-Identifier: Apache-2.0
// Curves traced as straight pieces: where each cubic segment, cut into a few, stays near enough to its chords. Fibres that scatter
// along their length are shaded with the cubic's tangents, surfaces with the normals of the pieces (hit.cpp).
//
// Embree draws a ribbon's cubic segment as four pieces of its own, one segment after the other; of straight ones it tests 4 or 8 at
// once. Tracing takes 6 to 24 % less time, the more strands the more. Round ones are found as flat pieces and entered where
// round_pieces.h says; tracing takes 20 to 27 % less time (tests/bench/cycles/ball.toml, with film.curve_pieces = 0 and without).
// Oriented ribbons turn on their way and stay cubics.
//
// More pieces have a larger tree, and each motion key makes it larger and its boxes looser. Against the cubic:
//                                               pieces  tracing   BVH's time   peak memory
//   grass of scenes/default.toml, at rest          2     -13 %       +2 %         -5 %
//                                                  3      -3 %      +43 %        +19 %
//   the same, 2 motion keys                        2      +2 %      +42 %        +58 %
//   ribbons on the hairy ball, 1,000,000, at rest   2     -19 %       +1 %         -7 %
//                                                  3     -18 %      +39 %        +20 %
//                                                  4     -12 %      +83 %        +47 %
//   round fur there, 100,000, at rest               2     -24 %       -5 %         +2 %
//                                                  4     -17 %      +60 %        +15 %
//   the same in wind, 2 motion keys                2     -17 %      +12 %        +28 %
//   the same in more wind, 5 keys                  2       0         -9 %        +53 %
// so most_that_pay() is 3 for ribbons and 4 for round fibres, half of that with two keys, 1 with more. A ribbon's third costs in the
// tree what it gains at a few samples a pixel; with more of them it is ahead. Round pieces also make each hit in the scene wait for a
// filter: among many more ribbons, the grass and stalks of scenes/default.toml, tracing took 6 % longer. They are used where they
// are at least half of the segments.
//
// Ribbons, measured on the hairy ball of tests/bench/cycles with two and with three pieces: the whole picture's brightness is within
// 0.02 % of the cubic's with 10,000 strands, 0.11 with 100,000, 0.16 with 1,000,000. But Embree ends them in half a disc turned to the
// ray, which of a thick strand seen end on shows where the cubic shows nothing: direct light of the sun by itself is 0.8 % darker with
// 10,000 (1.1 with eight pieces; 0.3 where strands are thin at both ends), 0.3 with 100,000, the same with 1,000,000.
// film.curve_pieces = 0 avoids it.
// Round: of a cubic that a ray starts in, where strands overlap, it meets the inside; of pieces nothing. The ball of scenes/golden/fur.toml
// with hair is 0.6 % brighter by that, and 0.1 (direct light) to 0.4 % by two pieces a segment; with four 0.05 %.
//
// Between parameters 1/n apart, where its second derivative goes from a to b, a cubic leaves its chord at the share u of the way by
//   u (1 - u) |(2 - u) a + (1 + u) b| / (6 n^2) <= max(|2 a + b|, |a + 2 b|) / (24 n^2) ,
// most on the first or last of the n pieces. Its radius leaves the linear one likewise: all four components count.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace marram {

constexpr uint32_t most_pieces =
    4; // as Embree's own of a cubic; a segment that would need more is traced as that

// Curves lie as MarramPatchBuffers says: cvs + 2 vertices of x, y, z, radius each.
struct CurveVertices {
    const float* vertices;
    size_t curves;
    uint32_t cvs;
    MarramBasis basis;
};

// What a chord may be off by at a point: half of the tolerance (metres), and a quarter of a pixel seen from the camera.
struct ChordLimit {
    double tolerance, pixel_angle;
    Vec3d camera;

    double squared_at(const Vec3d& point) const;
};

// [n - 1]: how far n pieces a segment are off, over the limit; a bound, and infinite where the limit is 0.
using ChordErrors = std::array<double, most_pieces>;

ChordErrors greater_of(const ChordErrors& a, const ChordErrors& b);

// Raises `errors` to the greatest over all segments. About 40 ns a segment.
void add_chord_errors(const CurveVertices& curves, const ChordLimit& limit, ChordErrors& errors);

// The most pieces that are still traced faster than the cubic, or as fast in less memory; keys: of motion, at least 1. See above.
uint32_t most_that_pay(MarramShape shape, size_t keys);

// The fewest pieces, up to `most`, that keep to the limit everywhere; 0: the cubic.
uint32_t pieces_for(const ChordErrors& errors, uint32_t most);

// A straight piece's ends: x, y, z, radius.
struct Chord {
    Vec4d begin, end;
};

Chord chord_of(const Eigen::Matrix4d& segment, MarramBasis basis, uint32_t piece,
               uint32_t pieces); // segment: a column a vertex

// The share by which a strand's first piece begins later and its last one ends earlier: Embree closes them with half a disc, which
// thus ends where the strand does. Of the first motion key, so that ends stay on straight lines between keys.
double end_share(const Chord& at_first_key, bool tip);

// The pieces' vertices at a motion key: (cvs - 1) * pieces + 1 of 4 floats for each curve. first_key: the same curves' vertices there.
void write_pieces(const CurveVertices& curves, const float* first_key, uint32_t pieces, float* out);

} // namespace marram
