// SPDX-License-Identifier: Apache-2.0
#include "tests/chain/furred_world.h"

namespace marram {

FurredWorld::FurredWorld(std::vector<Mesh> meshes, std::vector<std::vector<Positions>> later)
    : meshes_(std::move(meshes)), later_(std::move(later)) {
    later_.resize(meshes_.size());
    frame_.device = rtcNewDevice("start_threads=0,set_affinity=0");
    RTCScene scene = rtcNewScene(frame_.device);
    size_t samples = 1;
    for (size_t i = 0; i < meshes_.size(); ++i) {
        Mesh& mesh = meshes_[i];
        mesh.triangles.reserve(mesh.triangles.size() + 2); // Embree reads 16 bytes past the end
        names_.push_back("mesh" + std::to_string(i));
        std::vector<const float*>& pointers = pointers_.emplace_back();
        const auto lend = [&](Positions& positions) {
            positions.reserve(positions.size() + 2);
            pointers.push_back(positions.data()->data());
        };
        lend(mesh.positions);
        for (Positions& positions : later_[i]) lend(positions);
        samples = std::max(samples, pointers.size());
    }
    for (size_t i = 0; i < meshes_.size(); ++i) {
        Mesh& mesh = meshes_[i];
        const std::vector<const float*>& pointers = pointers_[i];
        RTCGeometry geometry = rtcNewGeometry(frame_.device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryTimeStepCount(geometry, unsigned(pointers.size()));
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                   mesh.triangles.data(), 0, 12, mesh.triangles.size());
        for (unsigned t = 0; t < pointers.size(); ++t)
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT3, pointers[t], 0,
                                       12, mesh.positions.size());
        rtcSetGeometryMask(geometry, MARRAM_ALL_ROLES | MARRAM_NAMED); // Embree 4: 1 by default
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene, geometry, unsigned(i));
        rtcReleaseGeometry(geometry);
        lent_.push_back({names_[i].c_str(), uint32_t(i), MARRAM_ALL_ROLES, uint32_t(mesh.positions.size()),
                         uint32_t(mesh.triangles.size()), uint32_t(pointers.size()), pointers.data(), nullptr,
                         mesh.triangles.data()->data(), nullptr});
    }
    for (size_t t = 0; t < samples; ++t)
        times_.push_back(samples > 1 ? 0.5 * double(t) / double(samples - 1) : 0.0);
    rtcCommitScene(scene);
    frame_.colliders = scene;
    frame_.fps = 24.0;
    frame_.frame = frame_.bind_frame = 1.0;
    frame_.time_count = uint32_t(times_.size());
    frame_.times = times_.data();
    frame_.stage = MARRAM_FINAL;
    frame_.mesh_count = uint32_t(lent_.size());
    frame_.meshes = lent_.data();
}

FurredWorld::~FurredWorld() {
    rtcReleaseScene(frame_.colliders);
    rtcReleaseDevice(frame_.device);
}

Surface FurredWorld::surface(size_t i, uint32_t time) const {
    const MarramMesh& m = lent_[i];
    return {m.positions[m.time_count > 1 ? time : 0], nullptr, m.triangles, nullptr, m.triangle_count};
}

Groom plain_coat(uint64_t count, int cvs, double shortest, double longest, double width) {
    Groom groom;
    groom.count = count;
    groom.cvs = cvs;
    groom.length = {shortest, longest};
    groom.lean = 20 * degree;
    groom.lean_variation = 10 * degree;
    groom.arc = 35 * degree;
    groom.width = width;
    groom.width_profile = Ramp(std::vector<double>{0, 1, 1, 0.15}, "linear");
    groom.seed = 1;
    return groom;
}

std::vector<Strands> grow(const Groom& groom, const Wind& wind, const SkinPoses& poses, size_t most) {
    std::vector<Root> roots = place_roots(groom, poses.bind, [] { return false; }).roots;
    roots.resize(std::min(roots.size(), most));
    std::vector<Strands> patches;
    constexpr size_t patch = 512;
    for (size_t first = 0; first < roots.size(); first += patch) {
        const size_t count = std::min(patch, roots.size() - first);
        Strands& strands = patches.emplace_back();
        strands.resize(int(count), groom.cvs, groom.shape == MARRAM_ORIENTED_RIBBON);
        expand(groom, wind, poses, std::span(roots).subspan(first, count), strands);
    }
    return patches;
}

Wind plain_wind(const Vec3d& direction, double global_rotate) {
    Wind wind;
    wind.direction = direction.normalized();
    wind.speed = 6.0;
    wind.response = Ramp(std::vector<double>{0, 0, 6, 1}, "linear");
    wind.global_rotate = global_rotate;
    wind.ramp_rotate = Ramp(std::vector<double>{0, 0.2, 1, 1}, "linear");
    wind.noise_amplitude = 0.5;
    wind.noise.frequency = 1.5;
    wind.noise.octaves = 2;
    return wind;
}

} // namespace marram
