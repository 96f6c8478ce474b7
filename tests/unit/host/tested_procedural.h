// SPDX-License-Identifier: Apache-2.0
// A small host for tests: it lends a ground that moves, a boulder and a line, and calls each procedural of
// our library with settings that make it do all that it can.
#pragma once

#include "tests/unit/world/build_scene.h"

#include "core/host/plugin_library.h"
#include "core/plugin/marram_host.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace marram::testing {

inline constexpr uint32_t times_there = 3;
inline constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();

struct Messages {
    std::vector<std::string> faults; // ids
    std::string last;                // text of the last one
    std::mutex mutex;
    static void take(void* user, const MarramMessage* message) {
        if (message->severity != MARRAM_FAULT) return;
        const std::scoped_lock lock(static_cast<Messages*>(user)->mutex); // from any thread
        auto& list = static_cast<Messages*>(user)->faults;
        list.emplace_back(message->id);
        static_cast<Messages*>(user)->last = message->what;
        EXPECT_NE(list.back(), "");
        EXPECT_STRNE(message->what, "");
        EXPECT_EQ(list.back().find("internal"), std::string::npos) << message->what;
    }
};

// A lent mesh in Embree, at the motion samples. It moves along x; bad_pose spoils the result of pose().
struct LentMesh {
    std::string name;
    std::vector<float> positions[times_there], uvs;
    std::vector<uint32_t> triangles;
    const float* steps[times_there] = {};
    std::vector<float> attribute_values;
    MarramAttribute attribute{};

    LentMesh(std::string its_name, const Mesh& mesh, bool moves, const double* times)
        : name(std::move(its_name)) {
        for (uint32_t t = 0; t < times_there; ++t) {
            for (const Vec3f& p : mesh.positions)
                positions[t].insert(positions[t].end(),
                                    {p.x() + (moves ? 0.01F * float(times[t]) : 0.0F), p.y(), p.z()});
            positions[t].resize(positions[t].size() + 4); // Embree reads past the end
            steps[t] = positions[t].data();
        }
        for (const auto& triangle : mesh.triangles)
            triangles.insert(triangles.end(), triangle.begin(), triangle.end());
        for (const Vec2f& uv : mesh.uvs) uvs.insert(uvs.end(), {uv.x(), uv.y()});
        attribute_values.assign(mesh.positions.size(), 0.5F);
        attribute = {"rock", 1, MARRAM_PER_VERTEX, 0, "", attribute_values.data(), 0};
        time_count = moves ? times_there : 1;
        vertices = uint32_t(mesh.positions.size());
    }
    uint32_t time_count = 1, vertices = 0;

    MarramMesh lent(uint32_t id) const {
        MarramMesh mesh{};
        mesh.name = name.c_str();
        mesh.geometry_id = id;
        mesh.roles = MARRAM_ALL_ROLES;
        mesh.vertex_count = vertices;
        mesh.triangle_count = uint32_t(triangles.size() / 3);
        mesh.time_count = time_count;
        mesh.positions = steps;
        mesh.triangles = triangles.data();
        mesh.uvs = uvs.empty() ? nullptr : uvs.data();
        mesh.attributes = &attribute;
        mesh.attribute_count = 1;
        mesh.attribute_stride = sizeof attribute;
        mesh.topology = 7;
        return mesh;
    }
    void attach(RTCDevice device, RTCScene scene, uint32_t id) const {
        const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryTimeStepCount(geometry, time_count);
        for (uint32_t t = 0; t < time_count; ++t)
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, t, RTC_FORMAT_FLOAT3, steps[t], 0,
                                       12, vertices);
        std::memcpy(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12,
                                            triangles.size() / 3),
                    triangles.data(), triangles.size() * sizeof(uint32_t));
        rtcSetGeometryMask(geometry, MARRAM_ALL_ROLES | MARRAM_NAMED);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene, geometry, id);
        rtcReleaseGeometry(geometry);
    }
};

class LentWorld {
  public:
    LentWorld() {
        meshes.emplace_back("ground", plane_mesh(Vec2f(4, 4), 3), true, times);
        meshes.emplace_back("boulder", box_mesh(Vec3f(0.5F, 0.5F, 0.5F)), false, times);
        for (uint32_t id = 0; id < meshes.size(); ++id) meshes[id].attach(device.get(), scene.get(), id);
        rtcCommitScene(scene.get());
        rtcCommitScene(other_scene.get());
        rtcCommitScene(empty_scene.get());
        meshes[0].attach(device.get(), swapped_scene.get(), 1);
        meshes[1].attach(device.get(), swapped_scene.get(), 0);
        rtcCommitScene(swapped_scene.get());
        moved.emplace_back("ground", plane_mesh(Vec2f(4, 4), 3), true, later_times);
        moved[0].attach(device.get(), elsewhere_scene.get(), 0);
        meshes[1].attach(device.get(), elsewhere_scene.get(), 1);
        rtcCommitScene(elsewhere_scene.get());
        for (uint32_t id = 0; id < meshes.size(); ++id)
            meshes[id].attach(device.get(), uncommitted_scene.get(), id);
        meshes[0].attach(device.get(), instances_scene.get(), 0);
        attach_instance(1);
        rtcCommitScene(instances_scene.get());
        for (uint32_t id = 0; id < meshes.size(); ++id) lent[id] = meshes[id].lent(id);
        const float line[] = {-1, 0, 0, 0.1F, 0, 0, 0, 0.1F, 1, 0, 0, 0.1F, 2, 0, 0, 0.1F, 3, 0, 0, 0.1F};
        line_vertices.assign(std::begin(line), std::end(line));
        curve_steps[0] = line_vertices.data();
        curves.name = "line";
        curves.curve_count = 1;
        curves.offsets = offsets;
        curves.time_count = 1;
        curves.vertices = curve_steps;
        curves.basis = MARRAM_LINEAR;
    }

    // The frame points into this object.
    MarramFrame frame() {
        MarramFrame frame{};
        frame.size = sizeof frame;
        frame.fps = 24.0;
        frame.frame = frame.bind_frame = 1.0;
        frame.time_count = times_there;
        frame.times = times;
        frame.stage = MARRAM_FINAL;
        frame.device = device.get();
        frame.colliders = scene.get();
        frame.meshes = lent;
        frame.mesh_count = 2;
        frame.mesh_stride = sizeof(MarramMesh);
        frame.pose = pose;
        frame.pose_user = this;
        frame.curves = &curves;
        frame.curves_count = 1;
        frame.curves_stride = sizeof curves;
        return frame;
    }

    enum class BadPose { none, fails, not_finite };
    BadPose bad_pose = BadPose::none;

    const double times[times_there] = {1.0, 1.25, 1.5};
    std::shared_ptr<RTCDeviceTy> device{rtcNewDevice(nullptr), rtcReleaseDevice},
        other_device{rtcNewDevice(nullptr), rtcReleaseDevice};
    std::shared_ptr<RTCSceneTy> scene{rtcNewScene(device.get()), rtcReleaseScene},
        other_scene{rtcNewScene(other_device.get()), rtcReleaseScene};
    // No meshes, the meshes under each other's ids, with the ground 1 m beside, without rtcCommitScene(),
    // with the boulder as an instance.
    std::shared_ptr<RTCSceneTy> empty_scene{rtcNewScene(device.get()), rtcReleaseScene},
        swapped_scene{rtcNewScene(device.get()), rtcReleaseScene},
        elsewhere_scene{rtcNewScene(device.get()), rtcReleaseScene},
        uncommitted_scene{rtcNewScene(device.get()), rtcReleaseScene},
        instances_scene{rtcNewScene(device.get()), rtcReleaseScene};
    std::vector<LentMesh> meshes = [] {
        std::vector<LentMesh> none;
        none.reserve(2); // pointers must stay valid
        return none;
    }();
    const double later_times[times_there] = {101.0, 101.25, 101.5};
    std::vector<LentMesh> moved;
    MarramMesh lent[2];
    std::vector<float> line_vertices;
    const float* curve_steps[1];
    const uint64_t offsets[2] = {0, 3};
    MarramCurves curves{};

  private:
    // Attaches an instance of a scene with this mesh, under the same id inside and outside.
    void attach_instance(uint32_t id) {
        const std::shared_ptr<RTCSceneTy> inner(rtcNewScene(device.get()), rtcReleaseScene);
        meshes[id].attach(device.get(), inner.get(), id);
        rtcCommitScene(inner.get());
        const RTCGeometry instance = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(instance, inner.get());
        rtcSetGeometryMask(instance, ~0U);
        rtcCommitGeometry(instance);
        rtcAttachGeometryByID(instances_scene.get(), instance, id);
        rtcReleaseGeometry(instance);
    }

    static MarramStatus pose(void* user, uint32_t index, double frame, float* positions, float*) {
        const LentWorld& world = *static_cast<LentWorld*>(user);
        if (world.bad_pose == BadPose::fails || index > 1) return MARRAM_ERROR;
        const LentMesh& mesh = world.meshes[index];
        for (size_t v = 0; v < mesh.vertices; ++v) {
            std::copy_n(mesh.steps[0] + 3 * v, 3, positions + 3 * v);
            if (mesh.time_count > 1) positions[3 * v] += 0.01F * float(frame - world.times[0]);
        }
        if (world.bad_pose == BadPose::not_finite) positions[4] = not_a_number;
        return MARRAM_OK;
    }
};

using OwnedValues = std::unique_ptr<MarramHostValues, decltype(&marram_values_free)>;

// Settings that make each procedural do all that it can on the world above, at a small size.
using Settings = std::vector<std::pair<const char*, const char*>>;
inline Settings settings_of(const std::string& type) {
    if (type == "groom")
        return {{"on", "ground"},
                {"count", "60"},
                {"length", "[0.1, 0.3]"},
                {"width", "0.01"},
                {"cvs", "5"},
                {"density_by[0].attribute", "rock"},
                {"wind.speed", "6"},
                {"wind.gusts.num_gusts", "4"},
                {"wind.gusts.radius_range", "[0.3, 1]"},
                {"wind.gusts.control[0].strength", "0.5"},
                {"wind.shielding.shield", "0.5"},
                {"wind.jiggle.frequency", "3"},
                {"wind.collision.solver", "exact"}};
    if (type == "strands")
        return {{"curves", "line"},
                {"on", "ground"},
                {"width", "0.01"},
                {"wind.speed", "6"},
                {"wind.shielding.shield", "0.5"},
                {"wind.jiggle.frequency", "3"},
                {"wind.collision.solver", "exact"}};
    if (type == "terrain")
        return {{"size", "[8, 8]"},           {"cell", "0.5"},
                {"layer[0].type", "noise"},   {"layer[1].type", "dune"},
                {"layer[1].along", "line"},   {"layer[2].type", "ruin"},
                {"layer[2].mesh", "boulder"}, {"layer[3].type", "mask"},
                {"layer[3].name", "high"},    {"layer[3].by", "height"},
                {"layer[4].type", "ripples"}};
    return {{"mesh", "boulder"},  {"sand[0].mesh", "ground"}, {"paths", "200"},
            {"sand_level", "-1"}, {"wind.speed", "10"},       {"winds[0].direction", "[1, 0, 0]"}};
}

// A procedural, called with good and bad arguments.

class TestedProcedural {
  public:
    TestedProcedural(const ProceduralType& type, LentWorld& world)
        : TestedProcedural(type, world, settings_of(type.calls.name)) {}
    TestedProcedural(const ProceduralType& type, LentWorld& world, const Settings& settings)
        : type(type), calls(type.calls), world(world),
          values(marram_values_new(&type.calls), marram_values_free) {
        host = {sizeof(MarramHost), &messages, Messages::take, [](void*) { return 0; }, nullptr, nullptr};
        for (const auto& [name, text] : settings)
            EXPECT_EQ(marram_set(values.get(), name, text), MARRAM_OK) << name;
        good = marram_values_finish(values.get(), &host);
        if (!good) throw std::runtime_error("a good value is refused: " + messages.last);
    }
    ~TestedProcedural() { destroy(); }

    void create() {
        destroy();
        expect_ok(calls.create(&host, good, &instance));
    }
    void destroy() {
        if (instance) calls.destroy(instance);
        instance = nullptr;
    }
    MarramStatus begin(const MarramFrame& frame) {
        output = {};
        output.size = sizeof output;
        return calls.begin(instance, &frame, &output);
    }
    // The whole output for a good frame, as bytes.
    std::string evaluate() {
        expect_ok(begin(world.frame()));
        return calls.kind == MARRAM_CURVES ? curves() : surface(output, calls.mesh);
    }
    size_t first_vertex(uint64_t curve) const {
        return output.offsets ? output.offsets[curve] + 2 * curve : curve * (output.cvs_per_curve + 2);
    }
    std::string view_mesh() {
        MarramOutput seen{};
        seen.size = sizeof seen;
        const MarramView view = good_view();
        expect_ok(calls.begin_view(instance, &view, &seen));
        return surface(seen, calls.view_mesh);
    }

    void expect_ok(MarramStatus status) {
        EXPECT_EQ(status, MARRAM_OK) << calls.name << ": " << messages.last;
        messages.faults.clear();
    }
    // Expects an error and a message that explains it.
    void expect_error(MarramStatus status, const std::string& id, const std::string& what) {
        EXPECT_EQ(status, MARRAM_ERROR) << calls.name << ": " << what;
        ASSERT_FALSE(messages.faults.empty()) << calls.name << ": " << what;
        if (!id.empty()) {
            EXPECT_EQ(messages.faults.back(), id) << calls.name << ": " << what;
        }
        messages.faults.clear();
    }

    MarramView good_view() const {
        static const double position[] = {0, 2, 6}, direction[] = {0, 0, -1}, up[] = {0, 1, 0}, time = 1.0;
        MarramView view{};
        view.size = sizeof view;
        view.frame = 1.0;
        view.time_count = 1;
        view.times = &time, view.positions = position, view.directions = direction, view.ups = up;
        view.fov = 1.0;
        view.width = 64, view.height = 36;
        return view;
    }

    const ProceduralType& type;
    const MarramProcedural& calls;
    LentWorld& world;
    Messages messages;
    MarramHost host{};
    OwnedValues values;
    const MarramValues* good = nullptr;
    MarramInstance* instance = nullptr;
    MarramOutput output{};

  private:
    std::string curves() {
        const size_t floats = 4 * first_vertex(output.curve_count);
        std::vector<std::vector<float>> vertices(output.time_count, std::vector<float>(floats + 4));
        for (uint32_t p = 0; p < output.patch_count; ++p) {
            MarramPatch patch{};
            patch.size = sizeof patch;
            expect_ok(calls.patch(instance, p, &patch));
            std::vector<float*> to;
            for (auto& step : vertices) to.push_back(step.data() + 4 * first_vertex(patch.first_curve));
            const MarramPatchBuffers buffers{
                sizeof(MarramPatchBuffers), to.data(), nullptr, 0, nullptr, nullptr};
            expect_ok(calls.tessellate(instance, p, &buffers));
        }
        std::string bytes;
        for (const auto& step : vertices)
            bytes.append(reinterpret_cast<const char*>(step.data()), floats * sizeof(float));
        EXPECT_EQ(bytes.empty(), output.curve_count == 0);
        return bytes;
    }
    std::string surface(const MarramOutput& out, MarramStatus (*write)(MarramInstance*, MarramMeshBuffers*)) {
        std::vector<float> positions(3 * size_t(out.vertex_count)), uvs(2 * size_t(out.vertex_count)),
            normals(positions.size());
        std::vector<uint32_t> triangles(3 * size_t(out.triangle_count));
        float *steps[] = {positions.data()}, *normal_steps[] = {normals.data()};
        MarramMeshBuffers buffers{};
        buffers.size = sizeof buffers;
        buffers.positions = steps;
        buffers.triangles = triangles.data();
        buffers.uvs = out.has_uvs ? uvs.data() : nullptr;
        buffers.normals = out.has_normals ? normal_steps : nullptr;
        expect_ok(write(instance, &buffers));
        return std::string(reinterpret_cast<const char*>(positions.data()),
                           positions.size() * sizeof(float)) +
               std::string(reinterpret_cast<const char*>(triangles.data()),
                           triangles.size() * sizeof(uint32_t));
    }
};

} // namespace marram::testing
