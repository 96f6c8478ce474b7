// SPDX-License-Identifier: Apache-2.0
#include "tests/stability/coat.h"

#include <algorithm>

namespace marram::stability {
namespace {

constexpr int divisions = 20; // 3,200 triangles
constexpr uint64_t strands = 1500;
constexpr int cvs = 9;

Mesh ball(double size, const Vec3d& place) {
    Mesh mesh = sphere_mesh(1.0F, divisions, 0.06F, 9.0F);
    mesh.normals.clear();
    for (Vec3f& p : mesh.positions) p = (p.cast<double>() * size + place).cast<float>();
    return mesh;
}

Groom groom_of(double size, double hair) {
    return plain_coat(strands, cvs, 0.15 * size, 0.25 * size, 0.001 * hair * size);
}

Gusts gusts_of(double size, const Vec3d& place) {
    Gusts gusts;
    gusts.num_gusts = 30;
    gusts.radius = Vec2d(0.3, 0.8) * size;
    gusts.radius_noise = {0.0, 0.5};
    gusts.speed = Vec2d(1.0, 4.0) * size;
    gusts.start_frame = {0.0, 24.0};
    gusts.life = {10.0, 60.0};
    gusts.decay = {2.0, 10.0};
    gusts.period = 48.0;
    gusts.ramp = Ramp(std::vector<double>{0, 1, 1, 0}, "smooth");
    gusts.center = place;
    gusts.extent = Vec2d(2.0, 2.0) * size;
    gusts.distance = 1.5 * size;
    return gusts;
}

Wind wind_of(const CoatSpec& spec) {
    Wind wind = plain_wind(Vec3d(1, -0.2, 0.3), 0.9);
    wind.speed = 6.0 * spec.size;
    wind.response = Ramp(std::vector<double>{0, 0, 6.0 * spec.size, 1}, "linear");
    wind.noise.frequency = 1.5 / spec.size;
    if (spec.gusts) {
        wind.gusts = gusts_of(spec.size, spec.place);
        wind.calm = 0.8;
    }
    if (spec.shielding) {
        wind.shielding.emplace();
        wind.shielding->offset = 0.7 * spec.size;
        wind.shielding->shield = 0.5;
    }
    if (spec.jiggle) {
        wind.jiggle.emplace();
        wind.jiggle->frequency = 3.0;
        wind.jiggle->damping = 0.3;
    }
    if (spec.collision) wind.collision.emplace().offset_scale = spec.offset_scale;
    return wind;
}

} // namespace

Coat::Coat(const CoatSpec& spec) : spec_(spec) {
    std::vector<Mesh> at_origin, here;
    at_origin.push_back(ball(1.0, Vec3d::Zero()));
    here.push_back(ball(spec.size, spec.place));
    std::vector<oracle::Triangle> triangles;
    for (const auto& t : here[0].triangles)
        triangles.push_back({here[0].positions[t[0]].cast<double>(), here[0].positions[t[1]].cast<double>(),
                             here[0].positions[t[2]].cast<double>()});
    set_ = oracle::TriangleSet(std::move(triangles));
    const FurredWorld original(std::move(at_origin));
    roots_ = place_roots(groom_of(1.0, 1.0), original.surface(0), [] { return false; }).roots;
    world_ = std::make_unique<FurredWorld>(std::move(here));
    groom_ = groom_of(spec.size, spec.hair);
    wind_ = wind_of(spec);
    for (int k = 0; k < cvs; ++k)
        profile_.push_back(float(0.5 * groom_.width_profile(double(k) / (cvs - 1))));
    times_ = spec.times.empty() ? std::vector<double>{spec.frame} : spec.times;
    frame_ = world_->frame();
    frame_.frame = spec.frame;
    frame_.time_count = uint32_t(times_.size());
    frame_.times = times_.data();
    const JiggleWindow window =
        spec.jiggle ? jiggle_window(*wind_.jiggle, times_, frame_.fps, 2.0 * longest(), 0.0) : JiggleWindow{};
    chain_ =
        make_chain_frame({wind_, groom_.envelope, frame_, &world_->mesh(0), profile_, groom_.basis, window});
}

RestStrandSource Coat::expand_of(std::span<const Root> roots) const {
    const auto lay_out = [this, roots](Strands& patch) {
        const Surface surface = world_->surface(0);
        expand(groom_, wind_, {surface, surface}, roots, patch);
    };
    return {[lay_out](uint32_t, Strands& patch) { lay_out(patch); },
            [lay_out](int64_t, Strands& patch) { lay_out(patch); }};
}

std::vector<std::vector<Curve>> Coat::poses(std::span<const Root> roots, size_t batch,
                                            ChainScratch& scratch) const {
    std::vector<std::vector<Curve>> result(times_.size());
    Strands patch;
    for (size_t first = 0; first < roots.size(); first += batch) {
        const std::span<const Root> some = roots.subspan(first, std::min(batch, roots.size() - first));
        patch.resize(int(some.size()), cvs, false);
        const RestStrandSource lay_out = expand_of(some);
        if (spec_.jiggle) jiggle_patch(chain_, lay_out, patch, scratch);
        for (uint32_t t = 0; t < times_.size(); ++t) {
            lay_out.at_time(t, patch);
            run_chain(chain_, t, patch, scratch);
            for (int i = 0; i < patch.count; ++i) result[t].push_back(pose_of(patch, i));
        }
    }
    return result;
}

std::vector<Curve> Coat::rest(std::span<const Root> roots) const {
    Strands patch;
    patch.resize(int(roots.size()), cvs, false);
    expand_of(roots).at_time(0, patch);
    std::vector<Curve> curves;
    for (int i = 0; i < patch.count; ++i) curves.push_back(rest_of(patch, i));
    return curves;
}

} // namespace marram::stability
