// SPDX-License-Identifier: Apache-2.0
// A CV's target is its bent position, in world space; it includes the motion of the root. Between past samples the
// root moves along a line and the offset from the root along a cubic (jiggle_step.h). Skins are mostly keyed at whole
// frames and move along lines between them: where such a motion stops dead, a cubic would swing, and the line is exact. The
// changes D0 and D2 of the target are therefore corrected by what the root's own differ from its change in this step.
#include "procedural/wind/jiggle_filter.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace marram {
namespace {

// The difference of two filtered points is good to about 1e-14 of the strand, 1e-11 of one of 1000 segments.
// Below this fraction of the segment's length its direction has less than two digits.
constexpr double min_direction_ratio = 1e-9;

// Lags below this are set to 0 before they decay into slow subnormal numbers; no float can hold them (the
// smallest is 1e-45 m).
constexpr double min_lag = 1e-60;

using Step = JiggleStep<double>;
using WideStep = JiggleStep<VDouble>;

MARRAM_INLINE Wide3d without_subnormals(const Wide3d& a, const Wide3d& b) {
    const VDouble zero{};
    return {select(vabs(a.x) + vabs(b.x) < min_lag, zero, a.x),
            select(vabs(a.y) + vabs(b.y) < min_lag, zero, a.y),
            select(vabs(a.z) + vabs(b.z) < min_lag, zero, a.z)};
}

MARRAM_INLINE WideStep wide(const Step& step) {
    return {splat(step.c),
            splat(step.s),
            splat(step.d),
            {splat(step.f[0]), splat(step.f[1]), splat(step.f[2])},
            {splat(step.g[0]), splat(step.g[1]), splat(step.g[2])}};
}
MARRAM_INLINE const WideStep& wide(const WideStep& step) { return step; }

// The four samples of a block around a step, [cvs] each.
using FourBlocks = std::array<const Wide3f*, 4>;

struct Changes { // from sample to sample
    Wide3d before, here, after;
};

MARRAM_INLINE Changes changes_of(const FourBlocks& targets, int k) {
    const Wide3d a = to_double(targets[0][k]), b = to_double(targets[1][k]), c = to_double(targets[2][k]),
                 d = to_double(targets[3][k]);
    // At a run's first sample, before which there is none, the target begins with the slope of its first step.
    return {targets[0] == targets[1] ? c - b : b - a, c - b, d - c};
}

struct LagAndVelocity {
    Wide3d lag, velocity;
};

template <typename AnyStep>
MARRAM_INLINE Wide3d stepped_lag(const AnyStep& step, const Wide3d& e, const Wide3d& w, const Changes& by) {
    return e * step.c + w * step.s - by.before * step.f[0] - by.here * step.f[1] - by.after * step.f[2];
}

// The changes of a target, where its root's part is a line.
MARRAM_INLINE Changes straightened(const Changes& target, const Changes& root) {
    return {target.before - (root.before - root.here), target.here, target.after - (root.after - root.here)};
}

// Advances the state of a block by a step.
template <typename AnyStep>
MARRAM_INLINE void advance_cvs(const AnyStep* steps, int cvs, const FourBlocks& targets, Wide3d* lag,
                               Wide3d* velocity) {
    const Changes root = changes_of(targets, 0);
    for (int k = 1; k < cvs; ++k) {
        const WideStep step = wide(steps[k]);
        const Changes by = straightened(changes_of(targets, k), root);
        const Wide3d e = lag[k], w = velocity[k];
        const Wide3d e1 = stepped_lag(step, e, w, by);
        const Wide3d w1 =
            w * step.d - e * step.s + by.before * step.g[0] + by.here * step.g[1] + by.after * step.g[2];
        lag[k] = without_subnormals(e1, w1);
        velocity[k] = without_subnormals(w1, e1);
    }
}

MARRAM_HOT void advance_block(const Step* steps, int cvs, const FourBlocks& targets, Wide3d* lag,
                              Wide3d* velocity) {
    advance_cvs(steps, cvs, targets, lag, velocity);
}
MARRAM_HOT void advance_block(const WideStep* steps, int cvs, const FourBlocks& targets, Wide3d* lag,
                              Wide3d* velocity) {
    advance_cvs(steps, cvs, targets, lag, velocity);
}

template <typename AnyStep>
struct EmitView { // one block
    int cvs;
    const AnyStep* steps; // from the past sample before the pose to it
    double share;         // fraction of the way from that sample to the next
    FourBlocks targets;
    const Wide3f* rest;
    const Wide3d *lag, *velocity;
    Wide3f* pose;
};

MARRAM_INLINE VLong differ(const Wide3d& a, const Wide3d& b) {
    return (a.x != b.x) | (a.y != b.y) | (a.z != b.z);
}
MARRAM_INLINE VLong any_change(const Changes& changes) {
    const Wide3d none{};
    return differ(changes.before, none) | differ(changes.here, none) | differ(changes.after, none);
}

// v scaled to `length`, or `instead` if v is too short to have a direction.
MARRAM_INLINE Wide3d scaled_to(const Wide3d& v, VDouble length, const Wide3d& instead) {
    const VDouble norm = vsqrt(dot(v, v));
    const VLong good = norm > min_direction_ratio * length;
    return select(good, v * (length / select(good, norm, 1.0)), instead);
}

// The cubic through two samples at `t` between them, from the first.
MARRAM_INLINE Wide3d along_cubic(const Changes& by, double t) {
    const Wide3d a1 = (by.before + by.here) * splat(0.5);
    const Wide3d a2 = by.here * splat(1.5) - by.before - by.after * splat(0.5);
    const Wide3d a3 = (by.before + by.after) * splat(0.5) - by.here;
    return ((a3 * splat(t) + a2) * splat(t) + a1) * splat(t);
}

template <typename AnyStep>
MARRAM_INLINE void emit_cvs(const EmitView<AnyStep>& block) {
    const Changes root = changes_of(block.targets, 0);
    const Wide3d root_before = to_double(block.targets[1][0]);
    Wide3d position = to_double(block.rest[0]), rest = position;
    Wide3d filtered{}, target{}; // offsets of CV k from the root
    VLong moves = any_change(root) | differ(root_before, position);
    block.pose[0] = block.rest[0];
    for (int k = 1; k < block.cvs; ++k) {
        const Changes by = changes_of(block.targets, k);
        const Wide3d lag =
            stepped_lag(wide(block.steps[k]), block.lag[k], block.velocity[k], straightened(by, root));
        moves |= any_change(by) | differ(lag, Wide3d{});

        const Changes of_offset{by.before - root.before, by.here - root.here, by.after - root.after};
        const Wide3d next_target =
            (to_double(block.targets[1][k]) - root_before) + along_cubic(of_offset, block.share);
        const Wide3d next_filtered = next_target + lag, next_rest = to_double(block.rest[k]);
        const Wide3d segment = next_rest - rest;
        const VDouble length = vsqrt(dot(segment, segment));
        const Wide3d target_segment = scaled_to(next_target - target, length, segment);
        position = position + scaled_to(next_filtered - filtered, length, target_segment);
        block.pose[k] = to_float(position);
        filtered = next_filtered;
        target = next_target;
        rest = next_rest;
    }
    if (!any(~moves)) return;
    // Strands at rest are copied from the target bit for bit.
    const VInt still = low_32_bits(~moves);
    for (int k = 1; k < block.cvs; ++k) {
        const Wide3f &to = block.targets[1][k], &pose = block.pose[k];
        block.pose[k] = {still ? to.x : pose.x, still ? to.y : pose.y, still ? to.z : pose.z};
    }
}

MARRAM_HOT void emit_block(const EmitView<Step>& block) { emit_cvs(block); }
MARRAM_HOT void emit_block(const EmitView<WideStep>& block) { emit_cvs(block); }

// n rotated by the shortest arc from unit a onto unit b. If they are opposed to within 1e-12 (where the axis
// is only good to 1e-4 and getting worse) n is kept.
MARRAM_INLINE Wide3d turned(const Wide3d& n, const Wide3d& a, const Wide3d& b) {
    const Wide3d axis = cross(a, b);
    const VDouble c = 1.0 + dot(a, b);
    const VLong opposed = c < 1e-12;
    const VDouble along = dot(axis, n) / select(opposed, 1.0, c);
    return select(opposed, n, n * (c - 1.0) + cross(axis, n) + axis * along);
}

MARRAM_HOT void normals_block(int cvs, const Wide3f* bent, const Wide3f* bent_normal, const Wide3f* pose,
                              Wide3f* normal) {
    for (int k = 0; k < cvs; ++k) {
        const int start = std::min(k, cvs - 2); // the tip uses the last segment
        const Wide3d a = to_double(bent[start + 1]) - to_double(bent[start]);
        const Wide3d b = to_double(pose[start + 1]) - to_double(pose[start]);
        const VDouble aa = dot(a, a), bb = dot(b, b);
        const VLong turns = differ(a, b) & (aa > 0.0) & (bb > 0.0);
        const Wide3d unit_a = a * (1.0 / vsqrt(select(turns, aa, 1.0)));
        const Wide3d unit_b = b * (1.0 / vsqrt(select(turns, bb, 1.0)));
        const Wide3d n = to_double(bent_normal[k]);
        normal[k] = to_float(select(turns, turned(n, unit_a, unit_b), n));
    }
}

} // namespace

size_t JiggleState::bytes() const {
    size_t sum = (lag.capacity() + velocity.capacity()) * sizeof(Wide3d) + shield.capacity() * sizeof(VFloat);
    for (const Target& target : targets) sum += target.pose.capacity() * sizeof(Wide3f);
    return sum;
}

double JiggleFilter::radians_at(double u, double samples) const {
    const double omega = 2.0 * pi * frequency_ * jiggle_.stiffness(u);
    return omega * (samples * jiggle_.step / fps_);
}

VDouble JiggleFilter::radians_at(const VDouble& u, double samples) const {
    VDouble radians;
    for (int lane = 0; lane < lanes; ++lane) radians[lane] = radians_at(u[lane], samples);
    return radians;
}

void JiggleFilter::begin(const Jiggle& jiggle, const JiggleWindow& window, double fps, int cvs, int blocks,
                         std::span<const VDouble> u) {
    jiggle_ = jiggle;
    frequency_ = jiggle.frequency;
    damping_ = jiggle.damping;
    window_ = window;
    fps_ = fps;
    cvs_ = cvs;
    blocks_ = blocks;
    levels_ = std::max<size_t>(window.steps.size(), 1);
    u_.clear();
    const bool same_everywhere = std::ranges::all_of(
        jiggle.stiffness.values(), [&](double value) { return value == jiggle.stiffness.values()[0]; });
    if (!same_everywhere) u_.assign(u.begin(), u.end());
    steps_.resize(levels_ * size_t(cvs));
    wide_steps_.resize(levels_ * u_.size());
    if (jiggle.is_keyed()) return; // set step by step
    std::vector<Step> levels(levels_);
    WideVector<WideStep> wide_levels(levels_);
    for (int k = 1; k < cvs && u_.empty(); ++k) {
        jiggle_steps(jiggle.damping, radians_at(double(k) / double(cvs - 1), 1.0), levels);
        for (size_t level = 0; level < levels_; ++level)
            steps_[level * size_t(cvs) + size_t(k)] = levels[level];
    }
    for (size_t i = 0; i < u_.size(); ++i) {
        jiggle_steps(jiggle.damping, radians_at(u_[i], 1.0), wide_levels);
        for (size_t level = 0; level < levels_; ++level)
            wide_steps_[level * u_.size() + i] = wide_levels[level];
    }
}

// The targets at sample - size, sample, sample + size and sample + 2 size, made if they are not known yet.
JiggleFilter::Four JiggleFilter::targets(JiggleState& state, int64_t sample, int64_t size,
                                         const BentPoseAt& bent) const {
    const std::array<int64_t, 4> wanted = {std::max(sample - size, state.run.first), sample, sample + size,
                                           sample + 2 * size};
    const auto is_wanted = [&](const JiggleState::Target& target) {
        return target.known && std::ranges::find(wanted, target.sample) != wanted.end();
    };
    Four found{};
    for (size_t i = 0; i < wanted.size(); ++i) {
        auto target = std::ranges::find_if(state.targets,
                                           [&](const auto& t) { return t.known && t.sample == wanted[i]; });
        if (target == state.targets.end()) {
            target = std::ranges::find_if(state.targets, [&](const auto& t) { return !is_wanted(t); });
            target->known = false; // if the next call throws
            target->pose.resize(size_t(blocks_) * size_t(cvs_));
            bent(wanted[i], target->pose);
            target->sample = wanted[i];
            target->known = true;
        }
        found[i] = &target->pose;
    }
    return found;
}

// Coefficients of a step of so many samples, with the current frequency and damping.
void JiggleFilter::set_steps(size_t level, double samples) {
    for (size_t k = 1; k < size_t(cvs_) && u_.empty(); ++k)
        steps_[level * size_t(cvs_) + k] =
            jiggle_step(damping_, radians_at(double(k) / double(cvs_ - 1), samples));
    for (size_t i = 0; i < u_.size(); ++i)
        wide_steps_[level * u_.size() + i] = jiggle_step(damping_, radians_at(u_[i], samples), 1.0);
}

// Takes frequency and damping at the middle of the step of so many samples that begins at the state's. The
// velocity of a CV is in metres a radian, so it is divided by the frequency.
void JiggleFilter::begin_step(JiggleState& state, int64_t size) {
    if (!jiggle_.is_keyed()) return;
    const double middle = jiggle_.step * (double(state.sample) + 0.5 * double(size));
    if (jiggle_.dampings) damping_ = jiggle_.dampings->at(middle);
    if (!jiggle_.frequencies) return;
    frequency_ = jiggle_.frequencies->at(middle);
    if (state.frequency > 0.0 && state.frequency != frequency_)
        for (Wide3d& velocity : state.velocity) velocity = velocity * splat(state.frequency / frequency_);
    state.frequency = frequency_;
}

void JiggleFilter::advance_by_one_step(JiggleState& state, const BentPoseAt& bent) {
    const int level = window_.level_at(state.run, state.sample);
    const int64_t size = int64_t{1} << level;
    if (jiggle_.is_keyed()) {
        begin_step(state, size);
        set_steps(size_t(level), double(size));
    }
    const Four four = targets(state, state.sample, size, bent);
    for (int i = 0; i < blocks_; ++i) {
        const size_t first = size_t(i) * size_t(cvs_);
        const FourBlocks block{&(*four[0])[first], &(*four[1])[first], &(*four[2])[first],
                               &(*four[3])[first]};
        if (u_.empty())
            advance_block(&steps_[size_t(level) * size_t(cvs_)], cvs_, block, &state.lag[first],
                          &state.velocity[first]);
        else
            advance_block(&wide_steps_[size_t(level) * u_.size() + first], cvs_, block, &state.lag[first],
                          &state.velocity[first]);
    }
    state.sample += size;
}

void JiggleFilter::advance(JiggleState& state, uint32_t phase, double frame, const BentPoseAt& bent) {
    const int64_t until = jiggle_.sample_before(frame);
    const JiggleRun run = window_.run_at(until, phase);
    const size_t size = size_t(blocks_) * size_t(cvs_);
    if (!state.begun || state.run != run || state.sample > until || state.lag.size() != size) {
        state.begun = false; // if a call throws
        for (JiggleState::Target& target : state.targets)
            target.known = target.known && target.pose.size() == size;
        state.lag.assign(size, Wide3d{});
        state.velocity.assign(size, Wide3d{});
        state.run = run;
        state.sample = run.first;
        state.frequency = 0.0;
    }
    state.begun = false;
    while (state.sample < until) advance_by_one_step(state, bent);
    state.begun = true;
}

void JiggleFilter::emit(JiggleState& state, double frame, const Strands& now, const BentPoseAt& bent,
                        WideVector<Wide3f>& pose) {
    assert(now.cvs == cvs_ && now.blocks == blocks_);
    pose.resize(now.pose.size());
    const double share = std::clamp(frame / jiggle_.step - double(state.sample), 0.0, 1.0);
    const Four four =
        targets(state, state.sample, share > 0.0 ? 1 : 0, bent); // at a sample, its target is enough
    const auto cvs = size_t(cvs_);
    begin_step(state, 1);
    part_.resize(cvs);
    wide_part_.resize(u_.size());
    for (size_t k = 1; k < cvs && u_.empty(); ++k)
        part_[k] = jiggle_step(damping_, radians_at(double(k) / double(cvs - 1), share), share);
    for (size_t i = 0; i < u_.size(); ++i)
        wide_part_[i] = jiggle_step(damping_, radians_at(u_[i], share), share);
    for (int i = 0; i < blocks_; ++i) {
        const size_t first = size_t(i) * cvs;
        const auto emit = [&](const auto* steps) {
            emit_block({cvs_,
                        steps,
                        share,
                        {&(*four[0])[first], &(*four[1])[first], &(*four[2])[first], &(*four[3])[first]},
                        &now.rest[first],
                        &state.lag[first],
                        &state.velocity[first],
                        &pose[first]});
        };
        if (u_.empty())
            emit(part_.data());
        else
            emit(&wide_part_[first]);
    }
}

void jiggle_normals(const Strands& now, const WideVector<Wide3f>& pose, WideVector<Wide3f>& normals) {
    normals.resize(now.pose_normal.size());
    for (int i = 0; i < now.blocks; ++i) {
        const size_t first = size_t(i) * size_t(now.cvs);
        normals_block(now.cvs, &now.pose[first], &now.pose_normal[first], &pose[first], &normals[first]);
    }
}

} // namespace marram
