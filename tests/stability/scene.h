// SPDX-License-Identifier: Apache-2.0
// What the stability tests share: bodies in an Embree scene, as a renderer lends them (motion samples too), strands of
// any shape, and the collision stage run on them and checked by the oracle.
#pragma once

#include "procedural/wind/collide.h"
#include "tests/oracle/test_shapes.h"

#include <array>
#include <string>
#include <vector>

namespace marram::stability {

inline const Vec3d x = Vec3d::UnitX(), y = Vec3d::UnitY(), z = Vec3d::UnitZ();
using Curve = std::vector<Vec3d>;
using oracle::Draw;

// Triangles as they are stored: floats. `later`: positions at further motion samples, equally spaced over the shutter.
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
        ColliderTrees().give(frame_, everywhere(), std::array{&colliders});
        return colliders;
    }
    // The same triangles, as the floats say, for the oracle.
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

// Strands from curves of equally many CVs, at rest; the pose is what the rest is. Lanes behind the last repeat it.
Strands strands_of(const std::vector<Curve>& rest, double width = 0.0, const Vec3d& normal = Vec3d::UnitY());
void set_pose(Strands& strands, const std::vector<Curve>& pose);
Curve curve_of(const Strands& strands, const WideVector<Wide3f>& cvs, int i);
Curve pose_of(const Strands& strands, int i);
Curve rest_of(const Strands& strands, int i);
bool same_bits(const WideVector<Wide3f>& a, const WideVector<Wide3f>& b);

Curve straight(const Vec3d& root, const Vec3d& step, int cvs);
// A random walk that leans along `drift`, `length` long.
Curve wandering(Draw& draw, const Vec3d& root, const Vec3d& drift, double length, int cvs, double kinks);

bool is_finite(const Curve& curve);
// The worst segment: how far its length is off, as a share of what accuracy.md allows: 1e-5 of the length and two
// units in the last place of the largest coordinate.
double worst_length(const Curve& pose, const Curve& rest);

// What the oracle says of strands that collide() has solved.
struct Verdict {
    long long segments = 0, contacts = 0, pushed_out = 0, unresolved = 0; // as counted by collide()
    long long not_finite = 0;
    long long crossed = 0;      // segments that cross a triangle, of strands in which nothing is unresolved
    long long crossed_all = 0;  // the same of all strands with a free root
    long long not_repeated = 0; // strands whose bits differ when solved again, alone
    long long grazes = 0, wrong_contacts = 0, not_free = 0;
    long long missed_ways =
        0; // unresolved segments for which the oracle has a free direction, keeping the clearance
    long long missed_open = 0;  // ... for which it has one that crosses nothing
    double contact_error = 0.0; // radians, worst away from grazes
    double length = 0.0;        // worst, as a share of what is allowed

    Verdict& operator+=(const Verdict& other);
};

// Runs collide() on strands (rest and pose set) at the motion sample and judges the result. The strands' pose is
// what it made. `judge_contacts`: every segment's contact against the oracle's (slow: about 1 ms a segment).
Verdict solve(const Scene& scene, Strands& strands, const Collision& settings = {},
              bool judge_contacts = true, uint32_t time = 0);

// Rows for a case. far_away: where floats do not resolve the clearance, what is unresolved is a figure without a bound.
void report(const std::string& hard_case, const Verdict& verdict, bool far_away = false);

} // namespace marram::stability
