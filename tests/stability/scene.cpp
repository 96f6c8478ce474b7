// SPDX-License-Identifier: Apache-2.0
#include "tests/stability/scene.h"

#include "tests/oracle/contact.h"
#include "tests/oracle/promise.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

namespace marram::stability {

Body body_of(const std::vector<oracle::Triangle>& triangles) {
    Body body;
    for (const oracle::Triangle& t : triangles) {
        const auto first = uint32_t(body.positions.size());
        body.triangles.push_back({first, first + 1, first + 2});
        for (const Vec3d& p : {t.a, t.b, t.c}) body.positions.push_back(p.cast<float>());
    }
    return body;
}

Body moved(Body body, double scale, const Vec3d& by) {
    for (Vec3f& p : body.positions) p = (p.cast<double>() * scale + by).cast<float>();
    for (auto& positions : body.later)
        for (Vec3f& p : positions) p = (p.cast<double>() * scale + by).cast<float>();
    return body;
}

namespace {

struct Device { // shared by all scenes: creating it takes longer than most of them
    RTCDevice device = rtcNewDevice("start_threads=0,set_affinity=0");
    ~Device() { rtcReleaseDevice(device); }
};
RTCDevice shared_device() {
    static const Device shared;
    return shared.device;
}

} // namespace

Scene::Scene(std::vector<Body> bodies) : bodies_(std::move(bodies)) {
    constexpr size_t spare = 2; // Embree reads 16 bytes past the end
    uint32_t samples = 1;
    for (Body& body : bodies_) {
        samples = std::max(samples, uint32_t(body.later.size() + 1));
        body.triangles.reserve(body.triangles.size() + spare);
        body.positions.reserve(body.positions.size() + spare);
        for (auto& positions : body.later) positions.reserve(positions.size() + spare);
        names_.push_back("body" + std::to_string(names_.size()));
        pointers_.push_back({body.positions.data()->data()});
        for (auto& positions : body.later) pointers_.back().push_back(positions.data()->data());
    }
    frame_.device = shared_device();
    RTCScene scene = rtcNewScene(frame_.device);
    for (size_t i = 0; i < bodies_.size(); ++i) {
        Body& body = bodies_[i];
        RTCGeometry geometry = rtcNewGeometry(frame_.device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryTimeStepCount(geometry, unsigned(pointers_[i].size()));
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                   body.triangles.data(), 0, 12, body.triangles.size());
        for (size_t t = 0; t < pointers_[i].size(); ++t)
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, unsigned(t), RTC_FORMAT_FLOAT3,
                                       pointers_[i][t], 0, 12, body.positions.size());
        rtcSetGeometryMask(geometry, MARRAM_ALL_ROLES | MARRAM_NAMED); // Embree 4: 1 by default
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene, geometry, unsigned(i));
        rtcReleaseGeometry(geometry);
        lent_.push_back({names_[i].c_str(), uint32_t(i), MARRAM_ALL_ROLES, uint32_t(body.positions.size()),
                         uint32_t(body.triangles.size()), uint32_t(pointers_[i].size()), pointers_[i].data(),
                         nullptr, body.triangles.data()->data(), nullptr});
    }
    rtcCommitScene(scene);
    for (uint32_t t = 0; t < samples; ++t) {
        times_.push_back(samples > 1 ? 1.0 + 0.5 * t / (samples - 1) : 1.0);
        std::vector<oracle::Triangle> all;
        for (const Body& body : bodies_) {
            const std::vector<Vec3f>& p = t == 0 || body.later.empty() ? body.positions : body.later[t - 1];
            for (const auto& corners : body.triangles)
                all.push_back({p[corners[0]].cast<double>(), p[corners[1]].cast<double>(),
                               p[corners[2]].cast<double>()});
        }
        sets_.emplace_back(std::move(all));
    }
    frame_.colliders = scene;
    frame_.fps = 24.0;
    frame_.frame = frame_.bind_frame = 1.0;
    frame_.time_count = samples;
    frame_.times = times_.data();
    frame_.stage = MARRAM_FINAL;
    frame_.mesh_count = uint32_t(lent_.size());
    frame_.meshes = lent_.data();
}

Scene::~Scene() { rtcReleaseScene(frame_.colliders); }

namespace {

void fill(const std::vector<Curve>& curves, WideVector<Wide3f>& out) {
    const size_t cvs = curves[0].size();
    for (size_t i = 0; i < out.size() / cvs * lanes; ++i)
        for (size_t k = 0; k < cvs; ++k) {
            const Vec3d& p = curves[std::min(i, curves.size() - 1)][k];
            Wide3f& cv = out[i / lanes * cvs + k];
            cv.x[i % lanes] = float(p.x());
            cv.y[i % lanes] = float(p.y());
            cv.z[i % lanes] = float(p.z());
        }
}

} // namespace

Strands strands_of(const std::vector<Curve>& rest, double width, const Vec3d& normal) {
    Strands strands;
    strands.resize(int(rest.size()), int(rest[0].size()), false);
    fill(rest, strands.rest);
    strands.pose = strands.rest;
    std::fill(strands.envelope.begin(), strands.envelope.end(), splat_float(1.0F));
    for (int i = 0; i < strands.blocks; ++i) {
        strands.width[size_t(i)] = splat(width);
        strands.root_normal[size_t(i)] = splat3(normal.data());
        const Wide3f& root = strands.rest[size_t(i) * size_t(strands.cvs)];
        strands.noise_origin[size_t(i)] = to_double(root);
    }
    return strands;
}

void set_pose(Strands& strands, const std::vector<Curve>& pose) { fill(pose, strands.pose); }

Curve curve_of(const Strands& strands, const WideVector<Wide3f>& cvs, int i) {
    Curve curve;
    for (int k = 0; k < strands.cvs; ++k) {
        const Wide3f& cv = cvs[size_t(i / lanes) * size_t(strands.cvs) + size_t(k)];
        curve.emplace_back(double(cv.x[i % lanes]), double(cv.y[i % lanes]), double(cv.z[i % lanes]));
    }
    return curve;
}
Curve pose_of(const Strands& strands, int i) { return curve_of(strands, strands.pose, i); }
Curve rest_of(const Strands& strands, int i) { return curve_of(strands, strands.rest, i); }

bool same_bits(const WideVector<Wide3f>& a, const WideVector<Wide3f>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Wide3f)) == 0;
}

Curve straight(const Vec3d& root, const Vec3d& step, int cvs) {
    Curve curve;
    for (int k = 0; k < cvs; ++k) curve.push_back(root + k * step);
    return curve;
}

Curve wandering(Draw& draw, const Vec3d& root, const Vec3d& drift, double length, int cvs, double kinks) {
    Curve curve{root};
    Vec3d direction = drift;
    for (int k = 1; k < cvs; ++k) {
        direction += kinks * draw.in_cube();
        curve.push_back(curve.back() + direction.stableNormalized() * (length / (cvs - 1)));
    }
    return curve;
}

bool is_finite(const Curve& curve) {
    return std::all_of(curve.begin(), curve.end(), [](const Vec3d& p) { return p.allFinite(); });
}

double worst_length(const Curve& pose, const Curve& rest) {
    double worst = 0.0;
    for (size_t k = 0; k + 1 < rest.size(); ++k) {
        double largest = 0.0;
        for (const Curve* curve : {&pose, &rest})
            for (const size_t i : {k, k + 1}) largest = std::max(largest, (*curve)[i].cwiseAbs().maxCoeff());
        const float f = float(largest);
        const double ulp = double(std::nextafter(f, std::numeric_limits<float>::infinity())) - double(f);
        const double was = (rest[k + 1] - rest[k]).stableNorm(), is = (pose[k + 1] - pose[k]).stableNorm();
        worst = std::max(worst, std::abs(is - was) / (1e-5 * was + 2.0 * ulp));
    }
    return worst;
}

Verdict& Verdict::operator+=(const Verdict& other) {
    segments += other.segments;
    contacts += other.contacts;
    pushed_out += other.pushed_out;
    unresolved += other.unresolved;
    not_finite += other.not_finite;
    crossed += other.crossed;
    crossed_all += other.crossed_all;
    not_repeated += other.not_repeated;
    grazes += other.grazes;
    wrong_contacts += other.wrong_contacts;
    not_free += other.not_free;
    missed_ways += other.missed_ways;
    missed_open += other.missed_open;
    contact_error = std::max(contact_error, other.contact_error);
    length = std::max(length, other.length);
    return *this;
}

namespace {

constexpr double contact_bound = 1e-4; // rad, accuracy.md

// Compares a segment solved by collide() with the oracle in the same state.
void judge(const SegmentTrace& trace, const oracle::TriangleSet& set, Verdict& verdict) {
    const Segment& s = trace.segment;
    const Turned& turned = trace.turned;
    if (turned.outcome == Outcome::unresolved) {
        verdict.missed_ways +=
            turned.clearance >= 0.0 && s.clearance > 0.0 &&
            oracle::any_free_direction(s.pivot, s.length, s.clearance, set, 2000).has_value();
        verdict.missed_open +=
            oracle::any_free_direction(s.pivot, s.length, 1e-5 * s.length, set, 2000).has_value();
        return;
    }
    // The resulting direction is free with its stated clearance, up to rounding.
    const double slack = 1e-6 * turned.clearance + 1e-9 * s.length;
    if (!oracle::is_free(s.pivot, turned.direction, s.length, std::max(turned.clearance - slack, 0.0), set)) {
        ++verdict.not_free;
        const double is = set.nearest(s.pivot, s.pivot + turned.direction * s.length).closest.distance;
        std::printf("    not free: length %.9g, clearance asked %.9g, claimed %.9g, kept %.9g, pivot's %.9g, "
                    "outcome %d, "
                    "pushed out %d\n",
                    s.length, s.clearance, turned.clearance, is,
                    set.nearest(s.pivot, s.pivot).closest.distance, int(turned.outcome),
                    int(turned.pushed_out));
    }
    if (turned.pushed_out) return;
    const Arc arc = arc_of(s);
    const oracle::Contact contact =
        oracle::first_contact(s.pivot, s.from, arc.capsule.normal, arc.angle, s.length, s.clearance, set,
                              1e-7 * s.length + 1e-6 * s.clearance);
    if (contact.grazes(contact_bound)) {
        ++verdict.grazes;
        return;
    }
    const double error = std::abs(contact.angle - turned.turned_angle);
    verdict.contact_error = std::max(verdict.contact_error, error);
    verdict.wrong_contacts += !(error <= contact_bound);
}

CollisionCounts run(const Scene& scene, uint32_t time, Strands& strands, const Collision& settings,
                    std::vector<SegmentTrace>* trace) {
    const Colliders colliders = scene.colliders(time);
    std::vector<float> radius_profile(size_t(strands.cvs));
    for (int k = 0; k < strands.cvs; ++k)
        radius_profile[size_t(k)] = float(0.5 * (1.0 - 0.8 * k / (strands.cvs - 1)));
    const CollideJob job{&settings, &colliders, &scene.mesh(0), radius_profile, MARRAM_BSPLINE, 0.0, trace};
    CollideScratch scratch;
    CollisionCounts counts;
    collide(job, strands, scratch, counts);
    return counts;
}

// Solves strand i in a batch of its own.
bool repeats_alone(const Scene& scene, uint32_t time, const Strands& given, const Strands& solved, int i,
                   const Collision& settings) {
    Strands alone = strands_of({rest_of(given, i)});
    alone.width[0] = splat(given.width[size_t(i / lanes)][i % lanes]);
    const Wide3d& normal = given.root_normal[size_t(i / lanes)];
    const Vec3d n(normal.x[i % lanes], normal.y[i % lanes], normal.z[i % lanes]);
    alone.root_normal[0] = splat3(n.data());
    set_pose(alone, {pose_of(given, i)});
    run(scene, time, alone, settings, nullptr);
    return pose_of(alone, 0) == pose_of(solved, i);
}

} // namespace

Verdict solve(const Scene& scene, Strands& strands, const Collision& settings, bool judge_contacts,
              uint32_t time) {
    Verdict verdict;
    const Strands given = strands;
    const oracle::TriangleSet& set = scene.triangles(time);
    Strands traced = given;
    std::vector<SegmentTrace> trace;
    run(scene, time, traced, settings, &trace);
    const CollisionCounts counts = run(scene, time, strands, settings, nullptr);
    verdict.segments = (long long)strands.count * (strands.cvs - 1);
    verdict.contacts = (long long)counts.contacts;
    verdict.pushed_out = (long long)counts.pushed_out;
    verdict.unresolved = (long long)counts.unresolved;
    std::vector<bool> unresolved(size_t(strands.count)), solved(size_t(strands.count));
    for (const SegmentTrace& segment : trace) {
        solved[segment.strand] = true;
        if (segment.turned.outcome == Outcome::unresolved) unresolved[segment.strand] = true;
        if (judge_contacts) judge(segment, set, verdict);
    }
    for (int i = 0; i < strands.count; ++i) {
        const Curve pose = pose_of(strands, i), rest = rest_of(strands, i);
        if (!is_finite(pose)) {
            ++verdict.not_finite;
            continue;
        }
        verdict.length = std::max(verdict.length, worst_length(pose, rest));
        verdict.not_repeated += !repeats_alone(scene, time, given, strands, i, settings);
        if (!solved[size_t(i)]) continue; // the root is not free, or the strand has zero length
        const int crossed = oracle::crossed_segments(pose, set);
        verdict.crossed_all += crossed;
        verdict.crossed += unresolved[size_t(i)] ? 0 : crossed;
    }
    return verdict;
}

void report(const std::string& hard_case, const Verdict& v, bool far_away) {
    std::printf(
        "  %s: %lld segments, %lld contacts, %lld pushed out, %lld unresolved (missed %lld, open %lld), %lld "
        "crossed, %lld with unresolved ones, %lld grazes, %lld wrong contacts, %lld not free\n",
        hard_case.c_str(), v.segments, v.contacts, v.pushed_out, v.unresolved, v.missed_ways, v.missed_open,
        v.crossed, v.crossed_all, v.grazes, v.wrong_contacts, v.not_free);
    none(hard_case + ": not finite", v.not_finite, "strands");
    none(hard_case + ": crosses a triangle", v.crossed, "segments");
    none(hard_case + ": other bits when solved alone", v.not_repeated, "strands");
    row(hard_case + ": lengths", v.length, 1.0, "of allowed");
    row(hard_case + ": contact angle", v.contact_error, contact_bound, "rad");
    none(hard_case + ": nearer than its clearance", v.not_free, "segments");
    if (far_away)
        figure(hard_case + ": unresolved", double(v.unresolved), "segments");
    else
        none(hard_case + ": unresolved although a direction is free", v.missed_open, "segments");
}

} // namespace marram::stability
