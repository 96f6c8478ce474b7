// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/literal.h"

#include "core/plugin/embree.h"
#include "tests/oracle/noise.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <span>

namespace marram::bench {
namespace {

bool blocked(const Colliders& colliders, const Vec3f& from, const Vec3f& direction, float near, float far) {
    RTCRay ray;
    ray.org_x = from.x();
    ray.org_y = from.y();
    ray.org_z = from.z();
    ray.dir_x = direction.x();
    ray.dir_y = direction.y();
    ray.dir_z = direction.z();
    ray.tnear = near;
    ray.tfar = far;
    ray.time = colliders.time;
    ray.mask = ~0U;
    ray.id = 0;
    ray.flags = 0;
    marram_occluded1(colliders.scene, &ray);
    return ray.tfar < 0.0F;
}

float gust_at(const GustField& field, const Vec3f& p) {
    float sum = 0.0F;
    for (const Influence& gust : field.influences) {
        const Vec3f x = gust.to_unit.cast<float>() * (p - gust.center.cast<float>());
        const float t = x.norm();
        if (t < 1.0F) sum += float(gust.weight) * float((*gust.ramp)(double(t)));
    }
    return sum;
}

float sheltered(const Wind& wind, const Colliders& colliders, std::span<const Vec3f> strand) {
    const Vec3f w = wind.direction.cast<float>();
    const auto offset = float(wind.shielding->offset);
    int hits = 0;
    for (const Vec3f& p : strand) hits += blocked(colliders, p - w * offset, w, 0.0F, offset * 0.999F);
    return float(hits) / float(strand.size());
}

// Rotates all points after k about point k.
void turn_rest(std::span<Vec3f> points, size_t k, const Eigen::Quaternionf& turn) {
    for (size_t i = k + 1; i < points.size(); ++i) points[i] = points[k] + turn * (points[i] - points[k]);
}

Eigen::Quaternionf part_of(const Vec3f& from, const Vec3f& to, float share) {
    const Eigen::AngleAxisf whole(Eigen::Quaternionf::FromTwoVectors(from, to));
    return Eigen::Quaternionf(Eigen::AngleAxisf(whole.angle() * share, whole.axis()));
}

void bend(const Wind& wind, float envelope, std::span<Vec3f> points) {
    const oracle::Fractal noise{wind.noise.frequency, wind.noise.octaves, wind.noise.lacunarity,
                                wind.noise.gain, wind.noise.seed};
    const Vec3d root = points[0].cast<double>();
    const auto last = float(points.size() - 1);
    double along = 0.0;
    for (size_t k = 0; k + 1 < points.size(); ++k) {
        const Vec3d ripple = oracle::fractal_noise(noise, root + wind.direction * (along * wind.waviness)) *
                             wind.noise_amplitude;
        along += double((points[k + 1] - points[k]).norm());
        const float share = std::clamp(
            float(wind.global_rotate * wind.ramp_rotate(double(float(k) / last))) * envelope, 0.0F, 1.0F);
        turn_rest(points, k,
                  part_of(points.back() - points[k], (wind.direction + ripple).cast<float>(), share));
    }
}

void collide(const Colliders& colliders, int steps, std::span<const Vec3f> target, std::span<Vec3f> points) {
    for (size_t k = 0; k + 1 < points.size(); ++k) {
        const Vec3f from = points[k + 1] - points[k];
        const float length = from.norm();
        const Vec3f to = target[k + 1] - points[k];
        const Eigen::AngleAxisf whole(Eigen::Quaternionf::FromTwoVectors(from, to));
        Eigen::Quaternionf last = Eigen::Quaternionf::Identity();
        for (int i = 1; i <= steps; ++i) {
            const Eigen::Quaternionf turn(
                Eigen::AngleAxisf(whole.angle() * float(i) / float(steps), whole.axis()));
            if (blocked(colliders, points[k], (turn * from) / length, 0.0F, length)) break;
            last = turn;
        }
        turn_rest(points, k, last);
    }
}

// Springs of a strand from the last frame's target to this one's.
void swing(const Jiggle& jiggle, double fps, std::span<const Vec3f> from, std::span<const Vec3f> to,
           std::span<Vec3f> x, std::span<Vec3f> v) {
    constexpr double longest = 0.5; // radians
    const auto last = double(to.size() - 1);
    double stiffest = 0.0;
    for (const double value : jiggle.stiffness.values()) stiffest = std::max(stiffest, value);
    const int steps = int(std::ceil(2.0 * pi * jiggle.frequency * stiffest / fps / longest));
    const float dt = 1.0F / float(fps * steps);
    x[0] = to[0];
    for (size_t k = 1; k < to.size(); ++k) {
        const auto omega = float(2.0 * pi * jiggle.frequency * jiggle.stiffness(double(k) / last));
        for (int i = 1; i <= steps; ++i) {
            const Vec3f target = from[k] + (to[k] - from[k]) * (float(i) / float(steps));
            v[k] += dt * (omega * omega * (target - x[k]) - 2.0F * float(jiggle.damping) * omega * v[k]);
            x[k] += dt * v[k];
        }
    }
}

} // namespace

std::vector<float> shelter_literally(const Wind& wind, const Colliders& colliders,
                                     const LiteralStrands& strands) {
    std::vector<float> shelter(strands.count());
    tbb::parallel_for(size_t(0), shelter.size(), [&](size_t i) {
        const auto cvs = size_t(strands.cvs);
        shelter[i] = sheltered(wind, colliders, {strands.rest.data() + i * cvs, cvs});
    });
    return shelter;
}

void simulate_literally(const Wind& wind, double fps, const GustField& field, const Colliders& colliders,
                        const std::vector<float>& shelter, bool shown, LiteralStrands& strands) {
    const auto cvs = size_t(strands.cvs);
    const bool begins = strands.swung.empty();
    strands.pose.resize(strands.rest.size());
    strands.target.resize(strands.rest.size());
    strands.swung.resize(strands.rest.size());
    strands.velocity.resize(strands.rest.size(), Vec3f::Zero());
    constexpr size_t grain = 64;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, strands.count(), grain), [&](const auto& range) {
        std::vector<Vec3f> bent(cvs);
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const auto of = [&](auto& list) { return std::span(list.data() + i * cvs, cvs); };
            const std::span<const Vec3f> rest = of(strands.rest);
            float gust = 0.0F;
            for (const Vec3f& p : rest) gust += gust_at(field, p) / float(cvs);
            const float envelope = std::clamp(float(wind.calm) + gust, 0.0F, 1.0F) *
                                   (1.0F - float(wind.shielding->shield) * shelter[i]);
            std::copy(rest.begin(), rest.end(), bent.begin());
            bend(wind, envelope, bent);
            const std::span<Vec3f> target = of(strands.target), swung = of(strands.swung);
            if (begins)
                std::copy(bent.begin(), bent.end(), swung.begin());
            else
                swing(*wind.jiggle, fps, target, bent, swung, of(strands.velocity));
            std::copy(bent.begin(), bent.end(), target.begin());
            if (!shown) continue;
            for (size_t k = 0; k + 1 < cvs; ++k)
                bent[k + 1] =
                    bent[k] + (swung[k + 1] - swung[k]).normalized() * (rest[k + 1] - rest[k]).norm();
            const std::span<Vec3f> pose = of(strands.pose);
            std::copy(rest.begin(), rest.end(), pose.begin());
            collide(colliders, wind.collision->rotation_steps, bent, pose);
        }
    });
}

void blow_literally(const Wind& wind, const GustField& field, const Colliders& colliders,
                    LiteralStrands& strands) {
    const auto cvs = size_t(strands.cvs);
    strands.pose.resize(strands.rest.size());
    constexpr size_t grain = 64;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, strands.count(), grain), [&](const auto& range) {
        std::vector<Vec3f> bent(cvs);
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const std::span<const Vec3f> rest(strands.rest.data() + i * cvs, cvs);
            const std::span<Vec3f> pose(strands.pose.data() + i * cvs, cvs);
            float gust = 0.0F;
            for (const Vec3f& p : rest) gust += gust_at(field, p) / float(cvs);
            const float envelope = std::clamp(float(wind.calm) + gust, 0.0F, 1.0F) *
                                   (1.0F - float(wind.shielding->shield) * sheltered(wind, colliders, rest));
            std::copy(rest.begin(), rest.end(), bent.begin());
            bend(wind, envelope, bent);
            std::copy(rest.begin(), rest.end(), pose.begin());
            collide(colliders, wind.collision->rotation_steps, bent, pose);
        }
    });
}

} // namespace marram::bench
