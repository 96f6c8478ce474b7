// SPDX-License-Identifier: Apache-2.0
// Traces curves as straight pieces: each cubic segment is cut into a few if their chords are close enough to
// it. Fibre bsdfs use the cubic's tangent, surface bsdfs the normal of the piece (hit.cpp).
//
// Embree intersects a ribbon's cubic segment as four pieces of its own, one segment at a time; of straight
// pieces it tests 4 or 8 at once. Tracing takes 6 to 24 % less time, the gain grows with the number of
// strands. Round curves are found as flat pieces, and round_pieces.h computes the entry point; tracing takes
// 20 to 27 % less time (tests/bench/cycles/ball.toml, with film.curve_pieces = 0 and without). Oriented
// ribbons twist along their length and stay cubics.
//
// More pieces need a larger BVH, and each motion key makes it larger and its boxes looser. Relative to the
// cubic:
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
// Therefore max_useful_pieces() is 3 for ribbons and 4 for round curves, half of that with two keys, 1 with
// more. A ribbon's third piece costs as much BVH time as it saves at a few samples per pixel, and wins with
// more samples. Round pieces also need a filter for every hit in the scene: among many more ribbons, the
// grass and stalks of scenes/default.toml, tracing took 6 % longer. They are used if they are at least half
// of the segments.
//
// Bias of ribbons, measured on the hairy ball of tests/bench/cycles with two and with three pieces: the mean
// brightness is within 0.02 % of the cubic's with 10,000 strands, 0.11 with 100,000, 0.16 with 1,000,000. But
// Embree caps a strand's pieces with a half disc that faces the ray. On a thick strand seen end-on it is
// visible where the cubic is not: the sun's direct light alone is 0.8 % darker with 10,000 (1.1 with eight
// pieces; 0.3 if strands are thin at both ends), 0.3 with 100,000, the same with 1,000,000. film.curve_pieces
// = 0 avoids it.
//
// Bias of round curves: where strands overlap, a ray that starts inside a cubic hits its far side, but inside
// pieces it hits nothing. This makes the ball of scenes/golden/fur.toml with hair 0.6 % brighter. Two pieces
// per segment add 0.1 (direct light) to 0.4 %, four 0.05 %.
//
// Between parameters 1/n apart, with second derivatives a and b at its ends, a cubic's distance from its
// chord at the fraction u is
//   u (1 - u) |(2 - u) a + (1 + u) b| / (6 n^2) <= max(|2 a + b|, |a + 2 b|) / (24 n^2) ,
// largest on the first or last of the n pieces. The radius deviates from a linear one in the same way, so all
// four components are included.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace marram {

constexpr uint32_t most_pieces = 4; // as many as Embree's own of a cubic; curves that need more stay cubics

// Vertices laid out as in MarramPatchBuffers: cvs + 2 vertices (x, y, z, radius) per curve.
struct CurveVertices {
    const float* vertices;
    size_t curves;
    uint32_t cvs;
    MarramBasis basis;
};

// Largest chord error allowed at a point: the smaller of half the tolerance (metres) and a quarter of a pixel
// as seen from the camera.
struct ChordLimit {
    double tolerance, pixel_angle;
    Vec3d camera;

    double squared_at(const Vec3d& point) const;
};

// [n - 1]: bound of the error of n pieces per segment, divided by the limit; infinite if the limit is 0.
using ChordErrors = std::array<double, most_pieces>;

ChordErrors max_errors(const ChordErrors& a, const ChordErrors& b);

// Raises `errors` to the largest over all segments. About 40 ns per segment.
void add_chord_errors(const CurveVertices& curves, const ChordLimit& limit, ChordErrors& errors);

// The most pieces that trace faster than the cubic, or as fast in less memory (see above). keys: motion keys,
// at least 1.
uint32_t max_useful_pieces(MarramShape shape, size_t keys);

// The fewest pieces, up to `most`, that are within the limit everywhere; 0: trace the cubic.
uint32_t min_pieces(const ChordErrors& errors, uint32_t most);

// Ends of a straight piece: x, y, z, radius.
struct Chord {
    Vec4d begin, end;
};

Chord chord_of(const Eigen::Matrix4d& segment, MarramBasis basis, uint32_t piece,
               uint32_t pieces); // segment: a column per vertex

// Fraction by which a strand's first piece starts later and its last one ends earlier. Embree caps them with
// half a disc, which thus ends where the strand does. Taken at the first motion key, so that ends move
// linearly between keys.
double end_share(const Chord& at_first_key, bool tip);

// Writes the pieces' vertices at a motion key: (cvs - 1) * pieces + 1 of 4 floats per curve. first_key: the
// same curves' vertices at the first key.
void write_pieces(const CurveVertices& curves, const float* first_key, uint32_t pieces, float* out);

} // namespace marram
