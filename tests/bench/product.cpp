// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/product.h"

#include "core/plugin/embree.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/settings.h"
#include "core/write/curve_export.h"
#include "tests/bench/workload.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cstring>
#include <fstream>
#include <stdexcept>

namespace marram::bench {
namespace {

std::atomic<bool> never{false};

Shot load_talk(const Coat& coat) {
    Overrides overrides;
    overrides.settings = {fmt::format("procedural.fur.count={}", coat.strands),
                          fmt::format("procedural.fur.cvs={}", coat.cvs),
                          fmt::format("procedural.fur.width={}", coat.width), "camera.shutter=[0,0]"};
    return load_shot(MARRAM_SOURCE_DIR "/scenes/talk.toml", overrides, never);
}

} // namespace

Product::Product(const Coat& coat) : coat_(coat) {
    load_seconds_ = seconds_of([&] { scene_ = load_talk(coat); });
}

Product::Frame Product::run(bool traced, double frame) {
    world_ = {};
    BuildSettings settings = build_settings(scene_, frame);
    settings.trace_curves = traced;
    BuildStats stats;
    BuildProgress progress;
    world_ = build_world(scene_.geometry, settings, never, progress, stats);
    return {load_seconds_,
            stats.colliders,
            strand_seconds(stats.report),
            stats.bvh,
            stats.curve_bytes,
            stats.attribute_bytes + uint64_t(stats.report("memory.curve_extra_bytes"))};
}

double Product::bake(const std::string& path, double frame) {
    return seconds_of([&] {
        run(false, frame);
        write_hair(path, world_.curves);
    });
}

Product::Baked Product::load_baked(const std::string& path) {
    struct Header {
        char magic[4];
        uint32_t strands, points, flags, segments;
        char more[108];
    } header;
    static_assert(sizeof header == 128);
    RTCDevice device = world_.device.get();
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE);
    Baked seconds;
    seconds.read = seconds_of([&] {
        std::ifstream file(path, std::ios::binary);
        file.read(reinterpret_cast<char*>(&header), sizeof header);
        constexpr uint32_t points = 2, thickness = 4;
        if (!file || std::memcmp(header.magic, "HAIR", 4) != 0 || header.flags != (points | thickness))
            throw std::runtime_error(path + ": not a file that bake wrote");
        std::vector<float> at(3 * size_t(header.points)), wide(header.points);
        file.read(reinterpret_cast<char*>(at.data()), std::streamsize(sizeof(float) * at.size()));
        file.read(reinterpret_cast<char*>(wide.data()), std::streamsize(sizeof(float) * wide.size()));
        if (!file) throw std::runtime_error(path + ": ends too early");
        const size_t cvs = header.segments + 1, stride = cvs + 2;
        auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 16, header.strands * stride));
        auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, header.strands * (cvs - 1)));
        tbb::parallel_for(size_t(0), size_t(header.strands), [&](size_t strand) {
            float* out = vertices + 4 * strand * stride;
            const auto cv = [&](size_t k) { return at.data() + 3 * (strand * cvs + k); };
            const auto put = [&](size_t slot, const float* a, const float* b, size_t k) { // 2 a - b
                for (size_t axis = 0; axis < 3; ++axis) out[4 * slot + axis] = 2.0F * a[axis] - b[axis];
                out[4 * slot + 3] = 0.5F * wide[strand * cvs + k];
            };
            for (size_t k = 0; k < cvs; ++k) put(k + 1, cv(k), cv(k), k);
            put(0, cv(0), cv(1), 0);
            put(cvs + 1, cv(cvs - 1), cv(cvs - 2), cvs - 1);
            for (size_t k = 0; k + 1 < cvs; ++k)
                indices[strand * (cvs - 1) + k] = unsigned(strand * stride + k);
        });
    });
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, unsigned(world_.meshes.size()));
    rtcReleaseGeometry(geometry);
    for (size_t i = 0; i < world_.meshes.size(); ++i)
        rtcAttachGeometryByID(scene, rtcGetGeometry(world_.colliders.get(), unsigned(i)), unsigned(i));
    seconds.bvh = seconds_of([&] { rtcCommitScene(scene); });
    rtcReleaseScene(scene);
    return seconds;
}

RenderSettings Product::settings() const {
    RenderSettings settings = render_settings(scene_, 1.0);
    settings.samples = 1;
    return settings;
}

double Product::primary_by_integrator() {
    const auto [width, height] = film_size(scene_);
    const std::string beauty = "beauty";
    Film film = make_film(width, height, std::span(&beauty, 1), world_);
    RenderSettings only_seen = settings();
    only_seen.max_depth = 0;
    const Lights lights(scene_.lights, world_);
    return seconds_of([&] {
        render(world_, lights, scene_.materials, camera_at(scene_.description, 1.0), only_seen, film);
    });
}

double Product::primary_by_embree() {
    const auto [width, height] = film_size(scene_);
    constexpr uint32_t tile = 16;
    const uint32_t columns = (width + tile - 1) / tile, rows = (height + tile - 1) / tile;
    const size_t a_tile = tile * tile;
    if (rays_.empty()) {
        const CameraRays camera(camera_at(scene_.description, 1.0), width, height);
        for (uint32_t i = 0; i < columns * rows; ++i)
            for (uint32_t p = 0; p < a_tile; ++p)
                rays_.push_back(camera((i % columns * tile + p % tile + 0.5) / width,
                                       (i / columns * tile + p / tile + 0.5) / height, {0.5F, 0.5F}, 0.0F));
    }
    std::atomic<uint64_t> hits{0};
    const double seconds = seconds_of([&] {
        tbb::parallel_for(uint32_t(0), columns * rows, [&](uint32_t i) {
            uint64_t mine = 0;
            for (size_t r = i * a_tile; r < (i + 1) * a_tile; ++r) {
                const Ray& ray = rays_[r];
                RTCRayHit query;
                query.ray = {ray.origin.x(),
                             ray.origin.y(),
                             ray.origin.z(),
                             ray.tnear,
                             ray.direction.x(),
                             ray.direction.y(),
                             ray.direction.z(),
                             ray.time,
                             ray.tfar,
                             ~0U,
                             0,
                             0};
                query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
                query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
                marram_intersect1(world_.scene.get(), &query, 1);
                mine += query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
            }
            hits += mine;
        });
    });
    if (hits == 0) throw std::runtime_error("the camera sees nothing");
    return seconds;
}

double Product::whole_paths(uint64_t& rays) {
    const auto [width, height] = film_size(scene_);
    const std::string beauty = "beauty";
    Film film = make_film(width, height, std::span(&beauty, 1), world_);
    const Lights lights(scene_.lights, world_);
    return seconds_of([&] {
        const RenderStats stats =
            render(world_, lights, scene_.materials, camera_at(scene_.description, 1.0), settings(), film);
        rays = stats.rays.intersect + stats.rays.occluded;
    });
}

} // namespace marram::bench
