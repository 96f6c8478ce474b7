// SPDX-License-Identifier: Apache-2.0
// Shared by the stability tests: bodies in an Embree scene as a renderer passes them (with motion samples),
// strands of any shape, and the collision stage on them, checked by the oracle.
#pragma once

#include "procedural/wind/collision/collide.h"
#include "tests/oracle/test_shapes.h"

#include <array>
#include <string>
#include <vector>

namespace marram::stability {

inline const Vec3d x = Vec3d::UnitX(), y = Vec3d::UnitY(), z = Vec3d::UnitZ();
using Curve = std::vector<Vec3d>;
using oracle::Draw;

// Triangles in float, as stored. `later`: positions at further motion samples, equally spaced over the
// shutter.
struct Body {
    std::vector<Vec3f> positions;
    std::vector<std::array<uint32_t, 3>> triangles;
    std::vector<std::vector<Vec3f>> later{};
};
Body body_of(const std::vector<oracle::Triangle>& triangles);
Body moved(Body body, double scale, const Vec3d& by);

class Scene {
  public:
    explicit Scene(std::vector<Body> bodies);
    ~Scene();
    Scene(const Scene&) = delete;
    Scene& operator=(const Scene&) = delete;

    const MarramFrame& frame() const { return frame_; }
    const MarramMesh& mesh(size_t i) const { return lent_[i]; }
    Colliders colliders(uint32_t time = 0) const {
        Colliders colliders = colliders_at(frame_, time);
        ColliderTrees().build_or_reuse(frame_, everywhere(), std::array{&colliders});
        return colliders;
    }
    // The same triangles, rounded to float, for the oracle.
    const oracle::TriangleSet& triangles(uint32_t time = 0) const { return sets_[time]; }

  private:
    std::vector<Body> bodies_;
    std::vector<std::string> names_;
    std::vector<std::vector<const float*>> pointers_; // [body][motion sample]
    std::vector<MarramMesh> lent_;
    std::vector<double> times_;
    std::vector<oracle::TriangleSet> sets_;
    MarramFrame frame_{};
};

// Strands from curves with equal CV counts; pose equal to rest. Unused lanes repeat the last strand.
Strands strands_of(const std::vector<Curve>& rest, double width = 0.0, const Vec3d& normal = Vec3d::UnitY());
void set_pose(Strands& strands, const std::vector<Curve>& pose);
Curve curve_of(const Strands& strands, const WideVector<Wide3f>& cvs, int i);
Curve pose_of(const Strands& strands, int i);
Curve rest_of(const Strands& strands, int i);
bool same_bits(const WideVector<Wide3f>& a, const WideVector<Wide3f>& b);

Curve straight(const Vec3d& root, const Vec3d& step, int cvs);
// A random walk with a drift along `drift`, `length` long.
Curve wandering(Draw& draw, const Vec3d& root, const Vec3d& drift, double length, int cvs, double kinks);

bool is_finite(const Curve& curve);
// Largest length error of a segment, relative to the tolerance in accuracy.md: 1e-5 of the length plus two
// ulps of the largest coordinate.
double worst_length(const Curve& pose, const Curve& rest);

// The oracle's results for strands solved by collide().
struct Verdict {
    long long segments = 0, contacts = 0, pushed_out = 0, unresolved = 0; // as counted by collide()
    long long not_finite = 0;
    long long crossed = 0;      // segments that cross a triangle, in strands without unresolved segments
    long long crossed_all = 0;  // the same, for all strands with a free root
    long long not_repeated = 0; // strands with different bits when solved again, alone
    long long grazes = 0, wrong_contacts = 0, not_free = 0;
    long long missed_ways =
        0; // unresolved segments for which the oracle finds a free direction with the clearance
    long long missed_open = 0;  // ... for which it finds one that crosses nothing
    double contact_error = 0.0; // radians, maximum away from grazes
    double length = 0.0;        // maximum, relative to the tolerance

    Verdict& operator+=(const Verdict& other);
};

// Runs collide() on strands (rest and pose set) at the motion sample, checks the result and leaves it in the
// pose. `judge_contacts`: compare every segment's contact with the oracle (slow: about 1 ms per segment).
Verdict solve(const Scene& scene, Strands& strands, const Collision& settings = {},
              bool judge_contacts = true, uint32_t time = 0);

// Adds the rows of a case. far_away: floats do not resolve the clearance, so unresolved segments are reported
// without a bound.
void report(const std::string& hard_case, const Verdict& verdict, bool far_away = false);

} // namespace marram::stability
