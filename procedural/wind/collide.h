// SPDX-License-Identifier: Apache-2.0
// Wind collision: the talk's last node. Strands bend around colliders on their way from the rest pose to the wind's.
#pragma once

#include "procedural/values.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/turn.h"

#include <optional>
#include <span>

namespace marram {

enum class Solver { exact, steps };

struct Collision {
    Solver solver = Solver::exact;
    int rotation_steps = 16;            // of Solver::steps
    std::optional<double> offset_root;  // m; absent: see root_offset()
    std::optional<double> offset_scale; // absent: targets are not pushed out
    std::optional<double> clearance;    // m; absent: the strand's radius
};

std::span<const MarramParam> collision_params();
std::optional<Collision> read_collision(const Values& values); // nothing where the scene asks for none

// How far a strand's root stands above the skin: what the scene says, else a hundredth of the strand's length, at least
// 1.2 times its radius there.
double root_offset(const Collision& collision, double length, double root_radius);

struct CollisionCounts {
    uint64_t contacts = 0;       // segments that stopped at a collider
    uint64_t pushed_out = 0;     // segments that started in one and were turned out
    uint64_t unresolved = 0;     // segments without a free direction, and strands whose root is not free
    uint64_t skipped_pushes = 0; // CVs for which offset_scale found no side of the skin to push to
    uint64_t dips = 0;           // strands whose drawn curve still dips in by more than the tolerance
    double goal_angle = 0.0,
           turned_angle = 0.0; // sums: what segments wanted to turn, and how much nearer they came

    CollisionCounts& operator+=(const CollisionCounts& other);
};

// A segment as it was solved, for tests and for the curious.
struct SegmentTrace {
    size_t strand;
    int index;
    Segment segment;
    Turned turned;
    double rounding; // metres by which the next start may be nearer
};

struct CollideJob {
    const Collision* settings;
    const Colliders* colliders;
    const MarramMesh* skin;                // that the strands grow on
    std::span<const float> radius_profile; // [cvs], of a strand 1 wide, where strands are not irregular
    MarramBasis basis;                     // of the drawn curve
    double tolerance; // m: the drawn curve dips in by no more; 0: a thousandth of the strand's length
    std::vector<SegmentTrace>* trace = nullptr;
};

struct CollideScratch {
    TurnScratch turn;
    std::vector<Vec3d> rest, target, swept;
    std::vector<Vec3f> solved;
    std::vector<double> radius;        // of the strand at each CV
    std::vector<double> turn_fraction; // share of its turn that a segment is allowed
    std::vector<char> pushed_out_cvs;  // a segment was turned out
    std::vector<double> clearance;     // of the segment that ends in a CV
    size_t clear_from = 0;             // the first segment of those known to be drawn in open air
};

// strands.rest, pose (bent) -> pose. strands.width and, for offset_scale, root_normal are read. Segments keep their rest
// lengths, rounded as in bend(). Without a contact the pose is what it was, bit for bit.
void collide(const CollideJob& job, Strands& strands, CollideScratch& scratch, CollisionCounts& counts);

} // namespace marram
