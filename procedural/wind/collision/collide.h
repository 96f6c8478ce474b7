// SPDX-License-Identifier: Apache-2.0
// Wind collision: the last stage of Somasundaram's wind (SIGGRAPH 2019 Talks). Strands bend around colliders
// on their way from the rest pose to the bent pose.
#pragma once

#include "procedural/abi/values.h"
#include "procedural/wind/collision/turn.h"
#include "procedural/wind/strands.h"

#include <map>
#include <optional>
#include <span>
#include <string>

namespace marram {

enum class Solver { exact, steps };

struct Collision {
    Solver solver = Solver::exact;
    int rotation_steps = 16;            // of Solver::steps
    std::optional<double> offset_root;  // m; empty: see root_offset()
    std::optional<double> offset_scale; // empty: target CVs are not raised
    std::optional<double> clearance;    // m; empty: the strand's radius
};

std::span<const MarramParam> collision_params();
std::optional<Collision> read_collision(const Values& values); // empty if the scene has no collision

// Height of a strand's root above the skin: collision.offset_root, by default 1 % of the strand's length, but
// at least 1.2 times its radius at the root.
double root_offset(const Collision& collision, double length, double root_radius);

// Where strands have no room.
struct NoRoom {
    uint64_t roots = 0, segments = 0;        // roots that are not free; segments without a free direction
    uint64_t dips = 0;                       // strands whose rendered curve penetrates
    Vec3d place = Vec3d::Constant(infinity); // root of one of these strands: the first by its coordinates
};

struct CollisionCounts {
    uint64_t contacts = 0;           // segments that stopped at a collider
    uint64_t pushed_out = 0;         // segments that started inside a collider and were turned out
    uint64_t unresolved = 0;         // segments without a free direction, and strands whose root is not free
    uint64_t targets_not_raised = 0; // CVs for which offset_scale found no consistent side of the skin
    uint64_t dips = 0; // strands whose rendered curve still penetrates by more than the tolerance
    std::map<std::string, NoRoom> no_room; // by the name of the nearest mesh; "" if none is within a segment
    double goal_angle = 0.0,
           turned_angle = 0.0; // sums over segments: angle to the goal, and the part of it that was turned

    CollisionCounts& operator+=(const CollisionCounts& other);
};

// One solved segment, for tests and debugging.
struct SegmentTrace {
    size_t strand;
    int index;
    Segment segment;
    Turned turned;
    double rounding; // metres by which rounding may reduce the free distance of the next start
};

struct CollideJob {
    const Collision* settings;
    const Colliders* colliders;
    const MarramMesh* skin;                // the mesh that the strands grow on
    std::span<const float> radius_profile; // [cvs], of a strand of width 1; used if strands are not irregular
    MarramBasis basis;                     // of the rendered curve
    double tolerance; // m: maximum penetration of the rendered curve; 0: a thousandth of the strand's length
    std::vector<SegmentTrace>* trace = nullptr;
};

struct CollideScratch {
    TurnScratch turn;
    std::vector<Vec3d> rest, target, swept;
    std::vector<Vec3f> solved;
    std::vector<double> radius;           // of the strand at each CV
    std::vector<double> turn_fraction;    // fraction of its turn that a segment may take
    std::vector<char> segment_pushed_out; // [cvs]: the segment that starts here was turned out
    std::vector<Contact> segment_contact; // [cvs]: of the segment that starts here
    // [cvs]: a lower bound on the distance from the CV, and from the segment that ends there, to every
    // collider
    std::vector<double> free_distance;
    size_t clear_from = 0; // rendered curves of the segments from here on are known to be clear
};

// strands.rest, pose (bent) -> pose. Reads strands.width and, for offset_scale, root_normal. Segments keep
// their rest lengths, rounded as in bend(). Without contact the pose is unchanged, bit for bit.
void collide(const CollideJob& job, Strands& strands, CollideScratch& scratch, CollisionCounts& counts);

} // namespace marram
