// SPDX-License-Identifier: Apache-2.0
// Resolves each strand against the colliders, segment by segment from root to tip. A segment starts in its
// rest direction, rotated by all earlier turns, and rotates by the shortest arc towards its target CV until
// it gets there or touches a collider. Its start is free because the segment before it was resolved; the root
// is above the skin.
//
// free_distance[k] is a lower bound on the distance from CV k, and from the segment that ends there, to every
// collider. Storing a CV rounds it to floats, which moves its segment by no more than the CV itself. So each
// CV's bound is that of the previous one, minus the rounding. Rounding uses it up, fastest far from the
// origin; when too little is left, it is measured again, also at the root if the first turn reports
// not_clear.
//
// The rendered cubic deviates from its control polygon (rendered_segment.h). A strand whose cubic penetrates
// a collider by more than the tolerance is solved again with smaller turns; if that does not help, it is laid
// straight.
#include "procedural/wind/collision/collide.h"

#include "core/math/rotation.h"
#include "procedural/abi/param.h"
#include "procedural/wind/collision/near.h"
#include "procedural/wind/collision/rendered_segment.h"
#include "procedural/wind/collision/skin.h"

#include <algorithm>
#include <array>
#include <string>

namespace marram {
namespace {

constexpr std::array collision_values = {
    param::choice("collision.solver", "none", "exact|steps|none",
                  "exact: rotate until the first contact; steps: rotate in a fixed number of steps; none or "
                  "absent: no collision"),
    param::integer("collision.rotation_steps", "", "none", 1, 1e6,
                   "number of steps if solver is steps; default: 16", "4|16|64|256", "seconds.collide"),
    param::number("collision.offset_root", "m", "none", 0, max_wind_input,
                  "height of roots above the skin; default: 1 % of the strand's length, at least 1.2 radii"),
    param::keyable(param::number(
        "collision.offset_scale", "", "none", 0, 10,
        "minimum height of a CV above the skin, as a fraction of its rest height; default: none")),
    param::number("collision.clearance", "m", "none", 0, max_wind_input,
                  "distance that strands keep from meshes; default: their radius"),
};

} // namespace

std::span<const MarramParam> collision_params() { return collision_values; }

std::optional<Collision> read_collision(const Values& values) {
    if (!values.has("wind.collision.solver")) {
        for (const MarramParam& param : collision_values) {
            const std::string name = std::string("wind.") + param.name;
            if (values.has(name))
                throw SceneFault("collision.no_solver", values.at(name).place,
                                 name + " has no effect without a solver",
                                 "add wind.collision.solver = \"exact\"");
        }
        return std::nullopt;
    }
    if (values.text("wind.collision.solver") == "none") return std::nullopt; // a groom may switch it off
    Collision collision;
    collision.solver = values.text("wind.collision.solver") == "steps" ? Solver::steps : Solver::exact;
    if (values.has("wind.collision.rotation_steps")) {
        if (collision.solver != Solver::steps)
            throw SceneFault("collision.steps_of_exact", values.at("wind.collision.rotation_steps").place,
                             "rotation_steps belongs to solver = \"steps\"",
                             "remove it, exact contact has no steps");
        collision.rotation_steps = values.integer("wind.collision.rotation_steps");
    }
    const auto take = [&](const char* name, std::optional<double>& out) {
        if (values.has(name)) out = values.number(name);
    };
    take("wind.collision.offset_root", collision.offset_root);
    take("wind.collision.offset_scale", collision.offset_scale);
    take("wind.collision.clearance", collision.clearance);
    return collision;
}

double root_offset(const Collision& collision, double length, double root_radius) {
    return collision.offset_root.value_or(std::max(0.01 * length, 1.2 * root_radius));
}

namespace {

// By x, then y, then z: of many places the same one is named, whatever the threads.
bool comes_before(const Vec3d& a, const Vec3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

} // namespace

CollisionCounts& CollisionCounts::operator+=(const CollisionCounts& other) {
    contacts += other.contacts;
    pushed_out += other.pushed_out;
    unresolved += other.unresolved;
    targets_not_raised += other.targets_not_raised;
    dips += other.dips;
    for (const auto& [mesh, theirs] : other.no_room) {
        NoRoom& mine = no_room[mesh];
        mine.roots += theirs.roots;
        mine.segments += theirs.segments;
        mine.dips += theirs.dips;
        if (comes_before(theirs.place, mine.place)) mine.place = theirs.place;
    }
    goal_angle += other.goal_angle;
    turned_angle += other.turned_angle;
    return *this;
}

namespace {

Vec3d lane_of(const Wide3f& v, int lane) { return {double(v.x[lane]), double(v.y[lane]), double(v.z[lane])}; }

struct StrandJob {
    size_t strand;
    const double* radius; // [cvs]
    double offset;        // height of the root above the skin
    double rounding;      // bound on the rounding of a stored coordinate; a CV moves by less than twice this
    double tolerance;
};

// The entry of the mesh that is nearest to p. root: of the strand.
NoRoom& no_room_at(const CollideJob& job, CollisionCounts& counts, const Vec3d& p, double radius,
                   const Vec3d& root) {
    const NearestTriangle nearest =
        job.colliders->tree ? nearest_triangle(*job.colliders, p, radius) : NearestTriangle{};
    NoRoom& found = counts.no_room[nearest.mesh ? nearest.mesh->name : ""];
    if (comes_before(root, found.place)) found.place = root;
    return found;
}

// Radii of a strand at its CVs; returns the root's.
double read_radii(const CollideJob& job, const Strands& strands, size_t strand, std::vector<double>& radius) {
    const auto cvs = size_t(strands.cvs);
    const size_t block = strand / lanes;
    const int lane = int(strand % lanes);
    if (strands.irregular) {
        for (size_t k = 0; k < cvs; ++k) radius[k] = double(strands.radius[block * cvs + k][lane]);
        return radius[0];
    }
    const double width = strands.width[block][lane], first = double(job.radius_profile[0]);
    const double at_root = width * first;
    for (size_t k = 0; k < cvs; ++k)
        radius[k] = first > 0.0 ? at_root * double(job.radius_profile[k]) / first
                                : width * double(job.radius_profile[k]); // the profile is 0 at the root
    return at_root;
}

// The distance to keep at CV k; the solver uses less if the segment's start is already closer.
double wanted_clearance(const CollideJob& job, const StrandJob& strand, size_t k) {
    const double asked = job.settings->clearance.value_or(strand.radius[k]);
    // Reserve for the float rounding of 16 CVs, at most half of the root offset; matters far from the origin.
    const double rounding_reserve = std::min(16.0 * strand.rounding, 0.5 * strand.offset);
    return std::max({asked, 0.125 * strand.offset, rounding_reserve});
}

// Clearance at the start of a segment: at most `wanted`, and less than its distance from every triangle.
double measured_clearance(const Colliders& colliders, const Vec3d& start, double wanted) {
    const NearestTriangle nearest = nearest_triangle(colliders, start, wanted * 1.25);
    return nearest.mesh ? std::min(wanted, 0.8 * nearest.distance) : wanted;
}

// Progress of the solution: start of the next segment, and the rotation that carries the rest strand there.
struct Progress {
    Vec3d start;
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
    double free_distance = 0.0; // of the start
    bool turned = false;        // some segment has turned
};

// The next segment. False: it has zero length, so nothing turns.
bool next_segment(const CollideScratch& scratch, const Progress& progress, size_t k, Segment& segment) {
    const std::vector<Vec3d>& rest = scratch.rest;
    const Vec3d d = rest[k + 1] - rest[k];
    const double length = d.norm();
    if (!(length > 0.0)) return false;
    const Vec3d from = progress.turned ? Vec3d(progress.rotation * (d / length)) : Vec3d(d / length);
    const Vec3d to_target = scratch.target[k + 1] - progress.start;
    const Vec3d goal =
        to_target.squaredNorm() > 1e-24 * length * length ? Vec3d(to_target.normalized()) : from;
    const Vec3d lean = progress.rotation * (rest.back() - rest[k]);
    segment = {progress.start, from, goal, lean, length, progress.free_distance};
    if (scratch.turn_fraction[k] < 1.0) {
        const Arc arc = arc_of(segment);
        const double angle = arc.angle * scratch.turn_fraction[k];
        segment.goal = arc.capsule.direction(std::cos(angle), std::sin(angle)).normalized();
    }
    return true;
}

// Stores the end of segment k and advances to it. While nothing has turned, CVs are copied from the rest
// strand; while the strand reaches all targets, they are copied from the targets, bit for bit.
void advance(CollideScratch& scratch, Progress& progress, size_t k, const Segment& segment,
             const Vec3d& direction) {
    const bool still = !progress.turned && direction == segment.from;
    Vec3d end = progress.start + direction * segment.length;
    const Vec3d target = scratch.target[k + 1].cast<float>().cast<double>(); // as it will be stored
    const double slack = 1e-5 * segment.length + 0x1p-23 * end.cwiseAbs().maxCoeff();
    if (still)
        end = scratch.rest[k + 1];
    else if (direction == segment.goal && (target - end).norm() <= slack &&
             (scratch.target[k] == progress.start || k == 0))
        end = target;
    if (!still) {
        progress.rotation = (shortest_rotation(segment.from, direction) * progress.rotation).normalized();
        progress.turned = true;
    }
    scratch.solved[k + 1] = end.cast<float>();
    // Rounding moves the CV; subtract that and the error of computing it from the free distance.
    const Vec3d stored = scratch.solved[k + 1].cast<double>();
    const double moved = (stored - (progress.start + direction * segment.length)).norm();
    progress.free_distance -= moved + 1e-10 * segment.length + 0x1p-50 * stored.cwiseAbs().maxCoeff();
    scratch.free_distance[k + 1] = std::max(progress.free_distance, 0.0);
    progress.start = stored;
}

RenderedSegment rendered_segment(const CollideJob& job, const StrandJob& strand,
                                 const CollideScratch& scratch, size_t k) {
    const std::vector<Vec3f>& p = scratch.solved;
    const auto at = [&](size_t i) { return Vec3d(p[i].cast<double>()); };
    const auto second_difference = [&](size_t i) {
        return i == 0 || i + 1 == p.size() ? Vec3d(Vec3d::Zero())
                                           : Vec3d(at(i - 1) - 2.0 * at(i) + at(i + 1));
    };
    return {at(k),
            at(k + 1),
            second_difference(k),
            second_difference(k + 1),
            strand.radius[k],
            strand.radius[k + 1],
            job.basis == MARRAM_BSPLINE};
}

// Looks ahead: moves all segments from k on to their targets and tests the region that they sweep. True: it
// is clear, so the strand is solved; this is usual for the upper part of a strand. False: something may be
// near; scratch.solved and scratch.free_distance beyond k must be computed again.
bool solve_remaining_without_contact(const CollideJob& job, const StrandJob& strand, const Progress& so_far,
                                     size_t k, CollideScratch& scratch, CollisionCounts& counts) {
    Progress progress = so_far;
    scratch.swept.clear();
    scratch.swept.push_back(progress.start);
    double arc_padding = 0.0, goal_angle = 0.0;
    for (size_t i = k; i + 1 < scratch.rest.size(); ++i) {
        Segment segment;
        if (!next_segment(scratch, progress, i, segment)) {
            scratch.solved[i + 1] = scratch.solved[i];
            continue;
        }
        const double cosine = std::clamp(segment.from.dot(segment.goal), -1.0, 1.0);
        scratch.swept.push_back(progress.start + segment.from * segment.length);
        scratch.swept.push_back(progress.start + segment.goal * segment.length);
        // The arc lies in the triangle of its end points and the intersection of their tangents. Beyond 120
        // degrees that point is too far away; the region is padded by the segment's length instead.
        constexpr double min_cosine = -0.5;
        if (cosine > min_cosine)
            scratch.swept.push_back(progress.start +
                                    (segment.from + segment.goal) * (segment.length / (1.0 + cosine)));
        else
            arc_padding = std::max(arc_padding, segment.length);
        goal_angle += std::acos(cosine);
        advance(scratch, progress, i, segment, segment.goal);
    }
    double offset = 0.0; // of the rendered cubics from the polygon, with their radii
    for (size_t i = k; i + 1 < scratch.rest.size(); ++i) {
        const RenderedSegment rendered = rendered_segment(job, strand, scratch, i);
        offset = std::max(offset, rendered.max_offset() + std::max(rendered.r0, rendered.r1));
    }
    SearchRegion region(std::max(arc_padding + so_far.free_distance, offset) * (1.0 + 1e-9));
    if (scratch.swept.size() <= SearchRegion::max_points) {
        for (const Vec3d& p : scratch.swept) region.add(p);
    } else {
        Eigen::AlignedBox3d box;
        for (const Vec3d& p : scratch.swept) box.extend(p);
        for (int i = 0; i < 8; ++i) region.add(box.corner(Eigen::AlignedBox3d::CornerType(i)));
    }
    if (!region_is_clear(*job.colliders, region, scratch.turn)) return false;
    counts.goal_angle += goal_angle;
    counts.turned_angle += goal_angle;
    scratch.clear_from = k;
    return true;
}

// Solves one strand into scratch.solved. False: its root is not free.
bool solve_strand(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch,
                  CollisionCounts& counts) {
    const size_t n = scratch.rest.size();
    const bool exact = job.settings->solver == Solver::exact;
    const double min_clearance = 2.0 * strand.rounding; // storing may move a CV by this distance
    Progress progress;
    progress.start = scratch.rest[0];
    progress.free_distance =
        exact ? wanted_clearance(job, strand, 0) : 0.0; // unless a collider is closer, see below
    scratch.solved[0] = progress.start.cast<float>();
    scratch.free_distance[0] = progress.free_distance;
    scratch.clear_from = n;
    // Looking ahead costs about one solve of the remaining segments; it is retried only after 1/12 of them is
    // solved, so all tries together cost at most about 12 solves of the strand.
    constexpr size_t lookahead_divisor = 12;
    size_t next_look = 0;
    bool look_ahead = true;
    for (size_t k = 0; k + 1 < n; ++k) {
        // If rounding leaves the root no usable clearance, looking ahead may still prove the whole strand
        // clear.
        const bool ahead =
            k > 0 ? look_ahead && !job.trace && k >= next_look : progress.free_distance <= min_clearance;
        if (exact && ahead) {
            if (solve_remaining_without_contact(job, strand, progress, k, scratch, counts)) {
                std::fill(scratch.segment_pushed_out.begin() + long(k), scratch.segment_pushed_out.end(),
                          char(false));
                std::fill(scratch.segment_contact.begin() + long(k), scratch.segment_contact.end(),
                          Contact::none);
                return true;
            }
            next_look = k + std::max<size_t>(1, (n - k) / lookahead_divisor);
        }
        Segment segment;
        scratch.segment_pushed_out[k] = false;
        scratch.segment_contact[k] = Contact::none;
        if (!next_segment(scratch, progress, k, segment)) {
            scratch.solved[k + 1] = scratch.solved[k];
            scratch.free_distance[k + 1] = progress.free_distance;
            continue;
        }
        Turned turned;
        if (exact) {
            const double wanted = wanted_clearance(job, strand, k);
            segment.clearance = std::min(progress.free_distance, wanted);
            if (segment.clearance < std::max(min_clearance, 1e-6 * segment.length))
                segment.clearance = measured_clearance(*job.colliders, segment.pivot, wanted);
            segment.clearance_unverified = progress.start == scratch.rest[0];
            segment.test_ray_first = k > 0;
            turned = segment.clearance > min_clearance
                         ? turn_exactly(*job.colliders, segment, scratch.turn)
                         : Turned{segment.from, Outcome::unresolved, false, 0.0};
            if (turned.outcome == Outcome::not_clear) {
                segment.clearance = measured_clearance(*job.colliders, segment.pivot, segment.clearance);
                if (!(segment.clearance > min_clearance)) return false;
                segment.clearance_unverified = false;
                turned = turn_exactly(*job.colliders, segment, scratch.turn);
            }
            progress.free_distance = turned.clearance;
        } else {
            turned = turn_by_steps(*job.colliders, segment, job.settings->rotation_steps);
        }
        look_ahead = turned.outcome == Outcome::arrived;
        scratch.segment_pushed_out[k] = turned.pushed_out;
        scratch.segment_contact[k] = turned.outcome == Outcome::unresolved ? Contact::unresolved
                                     : turned.outcome == Outcome::contact || turned.pushed_out
                                         ? Contact::contact
                                         : Contact::none;
        counts.contacts += turned.outcome == Outcome::contact;
        counts.pushed_out += turned.pushed_out && turned.outcome != Outcome::unresolved;
        if (turned.outcome == Outcome::unresolved) {
            ++counts.unresolved;
            ++no_room_at(job, counts, segment.pivot, segment.length, scratch.rest[0]).segments;
        }
        counts.goal_angle += turned.goal_angle;
        counts.turned_angle += std::clamp(
            turned.turned_angle, 0.0, turned.goal_angle); // no progress if it was pushed away from its goal
        if (job.trace) job.trace->push_back({strand.strand, int(k), segment, turned, strand.rounding});
        advance(scratch, progress, k, segment, turned.direction);
    }
    return true;
}

// Of the first segment whose rendered cubic penetrates a collider by more than the tolerance: its CV with the
// sharper kink; -1: none.
int penetrating_cv(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch) {
    for (size_t k = 0; k < std::min(scratch.clear_from, scratch.solved.size() - 1); ++k) {
        const RenderedSegment rendered = rendered_segment(job, strand, scratch, k);
        if (penetrates_collider(*job.colliders, rendered, scratch.free_distance[k + 1], strand.tolerance,
                                scratch.turn))
            return int(rendered.d0.squaredNorm() >= rendered.d1.squaredNorm() ? k : k + 1);
    }
    return -1;
}

// The last resort: one straight segment for the whole strand, turned out from its mean direction. Without
// kinks the cubic is straight, too.
bool solve_as_straight_line(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch) {
    const std::vector<Vec3d>& rest = scratch.rest;
    double length = 0.0;
    for (size_t k = 1; k < rest.size(); ++k) length += (rest[k] - rest[k - 1]).norm();
    const Vec3d reach = rest.back() - rest.front();
    if (!(reach.squaredNorm() > 1e-12 * length * length)) return false;
    const double clearance = measured_clearance(*job.colliders, rest[0], wanted_clearance(job, strand, 0));
    const Vec3d from = reach.normalized();
    const Turned turned =
        turn_exactly(*job.colliders, {rest[0], from, from, Vec3d::Zero(), length, clearance}, scratch.turn);
    if (turned.outcome == Outcome::unresolved) return false;
    double along = 0.0;
    for (size_t k = 0; k < rest.size(); ++k) {
        if (k > 0) along += (rest[k] - rest[k - 1]).norm();
        scratch.solved[k] = (rest[0] + turned.direction * along).cast<float>();
        scratch.free_distance[k] = turned.clearance - 2.0 * strand.rounding;
    }
    scratch.clear_from = rest.size();
    return penetrating_cv(job, strand, scratch) < 0;
}

// Solves a strand again with other turn fractions. Returns whether it is resolved.
bool solve_again(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch) {
    CollideJob quiet = job;
    quiet.trace = nullptr;
    CollisionCounts again;
    return solve_strand(quiet, strand, scratch, again) && again.unresolved == 0;
}

// Gives reduced turns back, from root to tip, each as far as the rendered curve stays outside: bisects its
// fraction. So a curve that penetrates by little more than the tolerance is moved by little, and the pose
// changes gradually with the tolerance. A fraction is found to 1/256.
void restore_turns(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch) {
    constexpr int steps = 8;
    std::vector<Vec3f> solved = scratch.solved;
    for (double& fraction : scratch.turn_fraction) {
        double low = fraction, high = 1.0;
        for (int i = 0; i < steps && low < 1.0; ++i) {
            fraction = i == 0 ? 1.0 : 0.5 * (low + high);
            const bool outside =
                solve_again(job, strand, scratch) && penetrating_cv(job, strand, scratch) < 0;
            (outside ? low : high) = fraction;
            if (outside) solved = scratch.solved;
        }
        fraction = low;
    }
    scratch.solved = solved;
}

// Solves again with smaller turns until the rendered curve stays outside. A kink is reduced by turning less
// at its segment; if that segment had to be turned out, by turning less before it. With no turn at all the
// result is the rest strand. The turns are first halved, then restored as far as possible.
void remove_penetration(const CollideJob& job, const StrandJob& strand, CollideScratch& scratch,
                        CollisionCounts& counts) {
    constexpr int tries = 64;
    constexpr double smallest = 1.0 / 32.0;
    for (int i = 0;; ++i) {
        // The segment that starts at the penetrating CV: turning it less straightens the curve there.
        int segment = penetrating_cv(job, strand, scratch);
        if (segment < 0) {
            if (i > 0) restore_turns(job, strand, scratch);
            return;
        }
        if (i == tries) break;
        while (segment >= 0 &&
               (scratch.turn_fraction[size_t(segment)] == 0.0 || scratch.segment_pushed_out[size_t(segment)]))
            --segment;
        if (segment < 0) break; // the rest shape itself penetrates
        double& fraction = scratch.turn_fraction[size_t(segment)];
        fraction = fraction > smallest ? 0.5 * fraction : 0.0;
        const std::vector<Vec3f> before = scratch.solved;
        if (solve_again(job, strand, scratch)) continue;
        scratch.solved = before; // a segment has no free direction: undo
        break;
    }
    const std::vector<Vec3f> curved = scratch.solved;
    if (solve_as_straight_line(job, strand, scratch)) return;
    scratch.solved = curved;
    ++counts.dips;
    const int at = std::max(penetrating_cv(job, strand, scratch), 0);
    ++no_room_at(job, counts, curved[size_t(at)].cast<double>(), 2.0 * strand.radius[0] + strand.offset,
                 scratch.rest[0])
          .dips;
}

void collide_strand(const CollideJob& job, Strands& strands, size_t i, CollideScratch& scratch,
                    CollisionCounts& counts) {
    const auto cvs = size_t(strands.cvs);
    const size_t block = i / lanes;
    const int lane = int(i % lanes);
    const Wide3f* rest = strands.rest.data() + block * cvs;
    Wide3f* pose = strands.pose.data() + block * cvs;
    double max_coordinate = 0.0, strand_length = 0.0;
    for (size_t k = 0; k < cvs; ++k) {
        scratch.rest[k] = lane_of(rest[k], lane);
        scratch.target[k] = lane_of(pose[k], lane);
        scratch.turn_fraction[k] = 1.0;
        if (k > 0) strand_length += (scratch.rest[k] - scratch.rest[k - 1]).norm();
        max_coordinate = std::max(max_coordinate, scratch.rest[k].cwiseAbs().maxCoeff());
    }
    if (!(strand_length > 0.0)) return;
    StrandJob strand{};
    strand.strand = i;
    const double root_radius = read_radii(job, strands, i, scratch.radius);
    strand.radius = scratch.radius.data();
    strand.offset = root_offset(*job.settings, strand_length, root_radius);
    strand.rounding = 0x1p-24 * (max_coordinate + strand_length);
    strand.tolerance = job.tolerance > 0.0 ? job.tolerance : 1e-3 * strand_length;
    if (job.settings->offset_scale && job.skin) {
        const Vec3d root_normal(strands.root_normal[block].x[lane], strands.root_normal[block].y[lane],
                                strands.root_normal[block].z[lane]);
        double along = strand.offset;
        uint32_t hint = no_triangle;
        for (size_t k = 1; k < cvs; ++k) {
            along += (scratch.rest[k] - scratch.rest[k - 1]).norm();
            // A CV's rest height is at most its arc length from the skin. If no collider lies within
            // offset_scale times that length of the path rest to target, the target is high enough. This
            // avoids raising targets that hang over the edge of an open skin.
            SearchRegion swept(*job.settings->offset_scale * along * (1.0 + 1e-6));
            swept.add(scratch.rest[k]);
            swept.add(scratch.target[k]);
            if (region_is_clear(*job.colliders, swept, scratch.turn)) continue;
            counts.targets_not_raised += !raise_to_min_height(
                *job.colliders, *job.skin, scratch.rest[k], root_normal, along * (1.0 + 1e-6),
                *job.settings->offset_scale, hint, scratch.target[k]);
        }
    }
    if (!solve_strand(job, strand, scratch, counts)) {
        // The root is not free: keep the rest shape.
        ++counts.unresolved;
        ++no_room_at(job, counts, scratch.rest[0], strand_length, scratch.rest[0]).roots;
        for (size_t k = 0; k < cvs; ++k) scratch.solved[k] = scratch.rest[k].cast<float>();
        std::ranges::fill(scratch.segment_contact, Contact::unresolved);
    } else if (job.settings->solver == Solver::exact) {
        remove_penetration(job, strand, scratch, counts);
    }
    if (strands.oriented) { // normals follow from the bent pose's segments to the solved ones
        Wide3f* normal = strands.pose_normal.data() + block * cvs;
        for (size_t k = 0; k < cvs; ++k) {
            const size_t a = std::min(k, cvs - 2);
            const Vec3d bent = lane_of(pose[a + 1], lane) - lane_of(pose[a], lane);
            const Vec3d now = (scratch.solved[a + 1] - scratch.solved[a]).cast<double>();
            if (!(bent.squaredNorm() > 0.0 && now.squaredNorm() > 0.0)) continue;
            const Vec3d turned = shortest_rotation(bent, now) * lane_of(normal[k], lane);
            normal[k].x[lane] = float(turned.x());
            normal[k].y[lane] = float(turned.y());
            normal[k].z[lane] = float(turned.z());
        }
    }
    for (size_t k = 0; k < cvs; ++k) {
        pose[k].x[lane] = scratch.solved[k].x();
        pose[k].y[lane] = scratch.solved[k].y();
        pose[k].z[lane] = scratch.solved[k].z();
    }
    if (!strands.has_contact) return;
    for (size_t k = 0; k < cvs; ++k)
        strands.contact[block * cvs + k][lane] = float(scratch.segment_contact[k > 0 ? k - 1 : 0]);
}

} // namespace

void collide(const CollideJob& job, Strands& strands, CollideScratch& scratch, CollisionCounts& counts) {
    if (!job.colliders->any()) return;
    const auto cvs = size_t(strands.cvs);
    scratch.rest.resize(cvs);
    scratch.target.resize(cvs);
    scratch.solved.resize(cvs);
    scratch.radius.resize(cvs);
    scratch.turn_fraction.resize(cvs);
    scratch.segment_pushed_out.assign(cvs, false);
    scratch.segment_contact.assign(cvs, Contact::none);
    scratch.free_distance.resize(cvs);
    for (size_t i = 0; i < size_t(strands.count); ++i) collide_strand(job, strands, i, scratch, counts);
}

} // namespace marram
