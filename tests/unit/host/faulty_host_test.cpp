// SPDX-License-Identifier: Apache-2.0
// Our library with a host that makes mistakes: each mistake is an error with a message that has an id, never
// a crash, and valid calls still work afterwards. Seeded.
#include "tested_procedural.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <random>

namespace marram::testing {
namespace {

void sink_of_air(void*, const double*, const double*, double) {}
void sink_of_rays(void*, uint32_t, const double*, const double*, double) {}

// ---- Values ----

// Values that are certainly wrong, with the data that they point to.
struct WrongValues {
    std::vector<MarramValue> list;
    std::vector<double> numbers;
    std::string text;
    std::vector<double> key_frames, key_numbers;
    MarramKeyframes keys{};
    MarramValues lent{};
    std::string what;
};

// For "layer[4].seed": the declaration in the type of element 4.
const MarramParam* declaration(const ProceduralType& type, const std::vector<MarramValue>& list,
                               const std::string& name) {
    std::string declared;
    for (size_t i = 0; i < name.size(); ++i) {
        declared += name[i];
        while (name[i] == '[' && name[i + 1] != ']') ++i;
    }
    for (const MarramParam& param : type.params)
        if (declared == param.name) return &param;
    const std::string of_type = name.substr(0, name.find("].") + 2) + "type";
    for (const ProceduralItemType& item : type.item_types)
        for (const MarramValue& value : list)
            if (of_type == value.name && std::string_view(value.text) == item.item.type)
                for (const MarramParam& param : item.params)
                    if (declared == std::string(item.item.list) + "[]." + param.name) return &param;
    return nullptr;
}

// Spoils one value. Returns false if this fault does not apply to it.
bool spoil(const ProceduralType& type, WrongValues& wrong, size_t index, int fault) {
    MarramValue& value = wrong.list[index];
    const MarramParam* param = declaration(type, wrong.list, value.name);
    const MarramTypeForm& form = *marram_type_form(value.type);
    const bool is_type = std::string_view(value.name).ends_with("].type"); // of an element
    wrong.numbers.assign(value.numbers, value.numbers + value.number_count);
    wrong.text = value.text;
    wrong.what = fmt::format("{} with fault {}", value.name, fault);
    const bool numeric = param && form.numbers > 0 && !(form.flags & MARRAM_ITEMS);
    const bool named = form.text == MARRAM_CHOICE_TEXT || form.text == MARRAM_NAME_TEXT;
    switch (fault) {
    case 0: // not a number
    case 1:
        if (value.number_count == 0) return false;
        wrong.numbers.back() = fault == 0 ? std::nan("") : HUGE_VAL;
        break;
    case 2: // out of range
        if (!numeric || !(param->maximum < 1e300)) return false;
        wrong.numbers[0] = value.type == MARRAM_BOOLEAN ? 2.0 : 2.0 * std::fabs(param->maximum) + 1.0;
        break;
    case 3: // too small, including negative counts
        if (!numeric || !(param->minimum > -1e300)) return false;
        wrong.numbers[0] = value.type == MARRAM_BOOLEAN ? -1.0 : -2.0 * std::fabs(param->minimum) - 1.0;
        break;
    case 4: // one number too many
        if (value.number_count == 0) return false;
        wrong.numbers.push_back(wrong.numbers.back());
        break;
    case 5: // no numbers, including an empty ramp
        if (value.number_count == 0) return false;
        wrong.numbers.clear();
        break;
    case 6:
        if (value.number_count == 0) return false;
        value.numbers = nullptr;
        return true;
    case 7:
        value.text = nullptr;
        return true;
    case 8: // another type
        if (is_type) return false;
        value.type = MarramParamType((int(value.type) + 1) % MARRAM_PARAM_TYPE_COUNT);
        return true;
    case 9:
        value.name = nullptr;
        return true;
    case 10:
        wrong.text = std::string(value.name) + "x";
        value.name = wrong.text.c_str();
        return true;
    case 11: { // twice
        const MarramValue copy = value;
        wrong.list.push_back(copy);
        return true;
    }
    case 12: // an unknown choice, interpolation or type of element; an empty name
        if (!named && form.text != MARRAM_KEYWORD_TEXT) return false;
        wrong.text = form.text == MARRAM_NAME_TEXT ? "" : "nonsense";
        break;
    case 13: // descending
        if (value.type != MARRAM_RANGE && value.type != MARRAM_RAMP) return false;
        if (value.type == MARRAM_RANGE && wrong.numbers[0] == wrong.numbers[1]) return false;
        if (value.type == MARRAM_RAMP && wrong.numbers.size() < 4) return false;
        std::swap(wrong.numbers[0], wrong.numbers[value.type == MARRAM_RANGE ? 1 : 2]);
        break;
    case 14: // keys
    case 15:
    case 16:
    case 17:
    case 18:
    case 19:
        if (!param || (fault > 14) != (param->keyable != 0)) return false;
        wrong.key_frames = {1.0, 9.0};
        wrong.key_numbers = wrong.numbers;
        wrong.key_numbers.insert(wrong.key_numbers.end(), wrong.numbers.begin(), wrong.numbers.end());
        wrong.keys = {sizeof(MarramKeyframes), 2, wrong.key_frames.data(), wrong.key_numbers.data(),
                      "linear"};
        value.keyframes = &wrong.keys;
        if (fault == 15) wrong.key_frames[1] = 1.0; // twice
        if (fault == 16) wrong.key_numbers.back() = std::nan("");
        if (fault == 17) wrong.keys.interpolation = "cubic";
        if (fault == 18) wrong.keys.frames = nullptr;
        if (fault == 19) wrong.keys.size = 0;
        return true;
    default: // not a whole number
        if (value.type != MARRAM_INTEGER) return false;
        wrong.numbers[0] += 0.5;
        break;
    }
    value.numbers = wrong.numbers.data();
    value.number_count = wrong.numbers.size();
    value.text = wrong.text.c_str();
    return true;
}
constexpr int value_faults_there = 21;

bool make_wrong(const TestedProcedural& called, size_t index, int fault, WrongValues& wrong) {
    wrong.list.clear();
    for (uint32_t i = 0; i < called.good->count; ++i)
        wrong.list.push_back(*MARRAM_AT(MarramValue, called.good->first, called.good->stride, i));
    if (!spoil(called.type, wrong, index, fault)) return false;
    wrong.lent = {sizeof(MarramValues), wrong.list.data(), uint32_t(wrong.list.size()), sizeof(MarramValue)};
    return true;
}

// ---- Frames ----

struct FrameFault {
    const char* what;
    const char* id;
    std::function<void(LentWorld&, MarramFrame&)> spoil; // its changes to the world are undone
    bool traces_only = false;                            // only for procedurals that trace or need poses
};

// Copies of what a fault changes, for one frame.
struct Spoilt {
    MarramMesh meshes[2];
    MarramCurves curves{};
    std::vector<float> floats;
    std::vector<uint32_t> triangles;
    const float* steps[times_there];
    uint64_t offsets[2];
    double times[times_there];
};

std::vector<FrameFault> frame_faults(Spoilt& s) {
    const auto in_mesh = [&s](auto change) {
        return [&s, change](LentWorld& world, MarramFrame& frame) {
            std::copy_n(world.lent, 2, s.meshes);
            change(s.meshes[0], world.meshes[0]);
            frame.meshes = s.meshes;
        };
    };
    const auto in_curves = [&s](auto change) {
        return [&s, change](LentWorld& world, MarramFrame& frame) {
            s.curves = world.curves;
            change(s.curves, world);
            frame.curves = &s.curves;
        };
    };
    const auto in_times = [&s](double a, double b, double c) {
        return [&s, a, b, c](LentWorld&, MarramFrame& frame) {
            s.times[0] = a, s.times[1] = b, s.times[2] = c;
            frame.times = s.times;
        };
    };
    const auto vertex = [&s](float x) {
        return [&s, x](MarramMesh& mesh, const LentMesh& own) {
            s.floats = own.positions[1];
            s.floats[5] = x;
            std::copy_n(own.steps, times_there, s.steps);
            s.steps[1] = s.floats.data();
            mesh.positions = s.steps;
        };
    };
    return {
        {"no pose", "contract.frame", [](LentWorld&, MarramFrame& f) { f.pose = nullptr; }},
        {"no times", "contract.frame", [](LentWorld&, MarramFrame& f) { f.times = nullptr; }},
        {"no samples", "contract.frame", [](LentWorld&, MarramFrame& f) { f.time_count = 0; }},
        {"too many samples", "contract.frame", [](LentWorld&, MarramFrame& f) { f.time_count = 65; }},
        {"unequal steps", "contract.frame", in_times(1.0, 1.1, 1.5)},
        {"equal times", "contract.frame", in_times(1.0, 1.0, 1.0)},
        {"downward times", "contract.frame", in_times(1.5, 1.25, 1.0)},
        {"a time that is none", "contract.frame", in_times(1.0, std::nan(""), 1.5)},
        {"times that cannot be counted", "contract.frame", in_times(1e19, 2e19, 3e19)},
        {"fps 0", "contract.frame", [](LentWorld&, MarramFrame& f) { f.fps = 0.0; }},
        {"fps without an end", "contract.frame", [](LentWorld&, MarramFrame& f) { f.fps = 1e300; }},
        {"a frame that cannot be counted", "contract.frame",
         [](LentWorld&, MarramFrame& f) { f.frame = -1e19; }},
        {"an infinite frame", "contract.frame", [](LentWorld&, MarramFrame& f) { f.frame = HUGE_VAL; }},
        {"no bind frame", "contract.frame", [](LentWorld&, MarramFrame& f) { f.bind_frame = std::nan(""); }},
        {"a negative tolerance", "contract.frame", [](LentWorld&, MarramFrame& f) { f.tolerance = -1.0; }},
        {"an unknown stage", "contract.frame", [](LentWorld&, MarramFrame& f) { f.stage = MarramStage(3); }},
        {"no meshes", "contract.frame", [](LentWorld&, MarramFrame& f) { f.meshes = nullptr; }},
        {"no stride", "contract.frame", [](LentWorld&, MarramFrame& f) { f.mesh_stride = 0; }},
        {"no curves", "contract.frame", [](LentWorld&, MarramFrame& f) { f.curves = nullptr; }},
        {"two devices", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.other_scene.get(); }},
        {"two devices", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.device = w.other_device.get(); }},
        {"colliders without the meshes", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.empty_scene.get(); }},
        {"meshes under other ids", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.swapped_scene.get(); }},
        {"a mesh in another place", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.elsewhere_scene.get(); }},
        {"colliders that are not committed", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.uncommitted_scene.get(); }},
        {"a mesh as an instance", "contract.frame",
         [](LentWorld& w, MarramFrame& f) { f.colliders = w.instances_scene.get(); }},
        {"a struct of nothing", "contract.size", [](LentWorld&, MarramFrame& f) { f.size = sizeof f.size; }},
        {"a mesh without a name", "contract.frame", in_mesh([](MarramMesh& m, auto&) { m.name = nullptr; })},
        {"a mesh without positions", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.positions = nullptr; })},
        {"a mesh without triangles", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.triangles = nullptr; })},
        {"a mesh with two samples of three", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.time_count = 2; })},
        {"a mesh without a sample", "contract.frame", in_mesh([&s](MarramMesh& m, const LentMesh& own) {
             std::copy_n(own.steps, times_there, s.steps);
             s.steps[2] = nullptr;
             m.positions = s.steps;
         })},
        {"a vertex that is no number", "contract.frame", in_mesh(vertex(not_a_number))},
        {"a vertex that is infinite", "contract.frame",
         in_mesh(vertex(-std::numeric_limits<float>::infinity()))},
        {"a vertex that Embree drops", "contract.frame", in_mesh(vertex(1e20F))},
        {"a triangle beyond the vertices", "contract.frame",
         in_mesh([&s](MarramMesh& m, const LentMesh& own) {
             s.triangles = own.triangles;
             s.triangles.back() = own.vertices;
             m.triangles = s.triangles.data();
         })},
        {"a uv that is no number", "contract.frame", in_mesh([&s](MarramMesh& m, const LentMesh& own) {
             s.floats = own.uvs;
             s.floats[1] = not_a_number;
             m.uvs = s.floats.data();
         })},
        {"an instance before its mesh", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.instance_of = 2; })},
        {"an instance of itself", "contract.frame", in_mesh([](MarramMesh& m, auto&) { m.instance_of = 1; })},
        {"an instance of other triangles", "contract.frame",
         in_mesh([&s](MarramMesh&, auto&) { s.meshes[1].instance_of = 1; })},
        {"an instance that nobody places", "contract.frame", in_mesh([&s](MarramMesh& m, auto&) {
             s.meshes[1] = m;
             s.meshes[1].name = "again";
             s.meshes[1].instance_of = 1;
         })},
        {"attributes that are not there", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.attributes = nullptr; })},
        {"attributes without a stride", "contract.frame",
         in_mesh([](MarramMesh& m, auto&) { m.attribute_stride = 0; })},
        {"curves without a name", "contract.frame",
         in_curves([](MarramCurves& c, auto&) { c.name = nullptr; })},
        {"curves without vertices", "contract.frame",
         in_curves([](MarramCurves& c, auto&) { c.vertices = nullptr; })},
        {"curves without CVs", "contract.frame",
         in_curves([](MarramCurves& c, auto&) { c.offsets = nullptr; })},
        {"curves with samples of their own", "contract.frame",
         in_curves([](MarramCurves& c, auto&) { c.time_count = 2; })},
        {"offsets that descend", "contract.frame", in_curves([&s](MarramCurves& c, auto&) {
             s.offsets[0] = 0, s.offsets[1] = 0;
             c.offsets = s.offsets;
         })},
        {"a curve that is no number", "contract.frame", in_curves([&s](MarramCurves& c, LentWorld& w) {
             s.floats = w.line_vertices;
             s.floats[6] = not_a_number;
             s.steps[0] = s.floats.data();
             c.vertices = s.steps;
         })},
        {"no colliders", "contract.no_colliders", [](LentWorld&, MarramFrame& f) { f.colliders = nullptr; },
         true},
        {"a pose that fails", "contract.pose",
         [](LentWorld& w, MarramFrame&) { w.bad_pose = LentWorld::BadPose::fails; }, true},
        {"a pose that is no number", "contract.pose",
         [](LentWorld& w, MarramFrame&) { w.bad_pose = LentWorld::BadPose::not_finite; }, true},
    };
}

bool concerns(const FrameFault& fault, const std::string& type) {
    return !fault.traces_only || type == "groom" || type == "strands" ||
           (type == "rock" && std::string_view(fault.id) == "contract.no_colliders");
}

// ---- Tests ----

class FaultyHost : public ::testing::Test {
  protected:
    std::shared_ptr<PluginLibrary> library = std::make_shared<PluginLibrary>(default_library, Place{});
    LentWorld world;
};

TEST_F(FaultyHost, IsToldOfWrongValues) {
    size_t told = 0;
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        called.create();
        const std::string before = called.evaluate();
        WrongValues wrong;
        for (uint32_t i = 0; i < called.good->count; ++i)
            for (int fault = 0; fault < value_faults_there; ++fault) {
                if (!make_wrong(called, i, fault, wrong)) continue;
                MarramInstance* none = nullptr;
                called.expect_error(called.calls.create(&called.host, &wrong.lent, &none), "contract.value",
                                    wrong.what);
                EXPECT_EQ(none, nullptr);
                const MarramUpdate update{sizeof(MarramUpdate), &wrong.lent, MARRAM_NOTHING};
                uint32_t changed = 0;
                called.expect_error(called.calls.update(called.instance, &update, &changed), "contract.value",
                                    wrong.what);
                ++told;
            }
        EXPECT_EQ(called.evaluate(), before) << type.calls.name; // nothing was changed
    }
    EXPECT_GT(told, 1000u);
}

// Structs whose size was left at 0.
void expect_sizes_are_asked_for(TestedProcedural& called, const MarramFrame& good_frame) {
    const MarramProcedural& calls = called.calls;
    MarramInstance* instance = nullptr;
    MarramValues values = *called.good;
    values.size = 0;
    called.expect_error(calls.create(&called.host, &values, &instance), "contract.size", "values");
    const MarramUpdate update{0, called.good, MARRAM_NOTHING};
    uint32_t changed = 0;
    called.expect_error(calls.update(called.instance, &update, &changed), "contract.size", "update");
    MarramFrame frame = good_frame;
    frame.size = 0;
    MarramOutput output{};
    output.size = sizeof output;
    called.expect_error(calls.begin(called.instance, &frame, &output), "contract.size", "frame");
    output.size = 0;
    called.expect_error(calls.begin(called.instance, &good_frame, &output), "contract.size", "output");
    output.size = sizeof output;
    ASSERT_EQ(calls.begin(called.instance, &good_frame, &output), MARRAM_OK);
    MarramPatch patch{};
    const MarramPatchBuffers patch_buffers{};
    MarramMeshBuffers mesh_buffers{};
    MarramAttributeList list{};
    if (calls.patch) called.expect_error(calls.patch(called.instance, 0, &patch), "contract.size", "patch");
    if (calls.tessellate)
        called.expect_error(calls.tessellate(called.instance, 0, &patch_buffers), "contract.size", "buffers");
    if (calls.mesh)
        called.expect_error(calls.mesh(called.instance, &mesh_buffers), "contract.size", "buffers");
    if (calls.attributes_of)
        called.expect_error(calls.attributes_of(called.instance, &list), "contract.size", "list");
}

TEST_F(FaultyHost, IsToldOfNullPointers) {
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        const MarramProcedural& calls = called.calls;
        MarramInstance* instance = nullptr;
        const MarramValues none{sizeof(MarramValues), nullptr, 3, sizeof(MarramValue)};
        MarramValues no_stride = *called.good;
        no_stride.stride = 0;
        called.expect_error(calls.create(&called.host, nullptr, &instance), "contract.null_values",
                            "no values");
        called.expect_error(calls.create(&called.host, &none, &instance), "contract.null_values", "no list");
        called.expect_error(calls.create(&called.host, &no_stride, &instance), "contract.value", "no stride");
        called.expect_error(calls.create(&called.host, called.good, nullptr), "contract.null_output",
                            "no place");
        MarramHost host = called.host;
        host.cancelled = nullptr;
        called.expect_error(calls.create(&host, called.good, &instance), "contract.null_callback",
                            "no cancelled()");
        host.message = nullptr; // no message callback
        EXPECT_EQ(calls.create(&host, called.good, &instance), MARRAM_ERROR);
        EXPECT_EQ(calls.create(nullptr, called.good, &instance), MARRAM_ERROR);
        host = called.host;
        host.size = sizeof host.size;
        EXPECT_EQ(calls.create(&host, called.good, &instance), MARRAM_ERROR);
        EXPECT_EQ(instance, nullptr);

        // No instance, as after a failed create().
        MarramFrame frame = world.frame();
        MarramOutput output{};
        output.size = sizeof output;
        uint32_t changed = 0;
        const MarramUpdate update{sizeof(MarramUpdate), called.good, MARRAM_NOTHING};
        EXPECT_EQ(calls.begin(nullptr, &frame, &output), MARRAM_ERROR);
        EXPECT_EQ(calls.update(nullptr, &update, &changed), MARRAM_ERROR);
        if (calls.prepare) {
            EXPECT_EQ(calls.prepare(nullptr, &frame, nullptr), MARRAM_ERROR);
        }
        if (calls.patch) {
            EXPECT_EQ(calls.patch(nullptr, 0, nullptr), MARRAM_ERROR);
        }
        if (calls.tessellate) {
            EXPECT_EQ(calls.tessellate(nullptr, 0, nullptr), MARRAM_ERROR);
        }
        if (calls.mesh) {
            EXPECT_EQ(calls.mesh(nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.begin_view) {
            EXPECT_EQ(calls.begin_view(nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.view_mesh) {
            EXPECT_EQ(calls.view_mesh(nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.attributes_of) {
            EXPECT_EQ(calls.attributes_of(nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.describe) {
            EXPECT_EQ(calls.describe(nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.summarize) {
            EXPECT_EQ(calls.summarize(nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.gusts) {
            EXPECT_EQ(calls.gusts(nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.air) {
            EXPECT_EQ(calls.air(nullptr, 0, nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        if (calls.shelter_rays) {
            EXPECT_EQ(calls.shelter_rays(nullptr, 0, nullptr, nullptr, nullptr, nullptr), MARRAM_ERROR);
        }
        calls.report(nullptr, nullptr, nullptr);
        calls.destroy(nullptr);

        called.create();
        called.expect_error(calls.begin(called.instance, nullptr, &output), "contract.frame", "no frame");
        called.expect_error(calls.begin(called.instance, &frame, nullptr), "contract.null_output",
                            "no output");
        called.expect_error(calls.update(called.instance, nullptr, &changed), "contract.null_update",
                            "no update");
        called.expect_error(calls.update(called.instance, &update, nullptr), "contract.null_update",
                            "no place");
        if (calls.attributes_of)
            called.expect_error(calls.attributes_of(called.instance, nullptr), "contract.null_list",
                                "no list");
        expect_sizes_are_asked_for(called, frame);
        const std::string before = called.evaluate();
        calls.report(called.instance, nullptr, nullptr);
        if (calls.describe)
            called.expect_error(calls.describe(called.instance, nullptr, nullptr), "contract.null_sink",
                                "no sink");
        if (calls.summarize)
            called.expect_error(calls.summarize(called.instance, nullptr, nullptr), "contract.null_sink",
                                "no sink");
        if (calls.gusts)
            called.expect_error(calls.gusts(called.instance, nullptr, nullptr), "contract.null_sink",
                                "no sink");
        if (calls.air) {
            const double point[3] = {0.0, 0.0, 0.0};
            called.expect_error(calls.air(called.instance, 1, point, nullptr, nullptr), "contract.null_sink",
                                "no sink");
            called.expect_error(calls.air(called.instance, 1, nullptr, sink_of_air, nullptr),
                                "contract.null_points", "no points");
            const double far[3] = {0.0, std::nan(""), 0.0};
            called.expect_error(calls.air(called.instance, 1, far, sink_of_air, nullptr),
                                "contract.far_point", "no number");
            EXPECT_EQ(calls.air(called.instance, 0, nullptr, sink_of_air, nullptr), MARRAM_OK);
        }
        if (calls.shelter_rays) {
            const double cvs[6] = {0.0, 0.0, 0.0, 0.0, 1.0, 0.0};
            called.expect_error(calls.shelter_rays(called.instance, 2, cvs, cvs + 3, nullptr, nullptr),
                                "contract.null_sink", "no sink");
            called.expect_error(
                calls.shelter_rays(called.instance, 2, nullptr, cvs + 3, sink_of_rays, nullptr),
                "contract.null_points", "no CVs");
            called.expect_error(calls.shelter_rays(called.instance, 2, cvs, nullptr, sink_of_rays, nullptr),
                                "contract.null_points", "no normal");
            EXPECT_EQ(calls.shelter_rays(called.instance, 0, nullptr, cvs + 3, sink_of_rays, nullptr),
                      MARRAM_OK);
        }
        if (calls.mesh)
            called.expect_error(calls.mesh(called.instance, nullptr), "contract.null_buffer", "no buffers");
        if (calls.tessellate)
            called.expect_error(calls.tessellate(called.instance, 0, nullptr), "contract.null_buffer",
                                "no buffers");
        EXPECT_EQ(called.evaluate(), before);
    }
}

TEST_F(FaultyHost, IsToldOfWrongFrames) {
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        Spoilt spoilt;
        for (const FrameFault& fault : frame_faults(spoilt)) {
            if (!concerns(fault, type.calls.name)) continue;
            called.create(); // poses are read only after create()
            MarramFrame frame = world.frame();
            fault.spoil(world, frame);
            called.expect_error(called.begin(frame), fault.id, fault.what);
            world.bad_pose = LentWorld::BadPose::none;
        }
        called.create();
        const std::string before = called.evaluate();
        for (const FrameFault& fault : frame_faults(spoilt)) {
            if (!concerns(fault, type.calls.name) || std::string_view(fault.id) != "contract.frame") continue;
            MarramFrame frame = world.frame();
            fault.spoil(world, frame);
            called.expect_error(called.begin(frame), fault.id, fault.what);
        }
        EXPECT_EQ(called.evaluate(), before) << type.calls.name;
    }
}

// Embree does not need a mesh without triangles, and does not survive a question for an id that it does not
// have.
TEST_F(FaultyHost, NeedNotAttachMeshesWithoutTriangles) {
    const std::shared_ptr<RTCSceneTy> boulder_alone(rtcNewScene(world.device.get()), rtcReleaseScene);
    world.meshes[1].attach(world.device.get(), boulder_alone.get(), 1);
    rtcCommitScene(boulder_alone.get());
    MarramMesh meshes[2] = {world.lent[0], world.lent[1]};
    meshes[0].triangle_count = 0;
    MarramFrame frame = world.frame();
    frame.meshes = meshes;
    frame.colliders = boulder_alone.get();
    for (const uint32_t id : {0u, 5000u, 4000000000u})
        for (const ProceduralType& type : library->types()) {
            if (type.calls.kind == MARRAM_CURVES) continue; // they grow on it
            meshes[0].geometry_id = id;
            TestedProcedural called(type, world);
            called.create();
            called.expect_ok(called.begin(frame));
        }
}

// Buffers of a frame that began before prepare() may be too small for what prepare() makes.
TEST_F(FaultyHost, BeginsAFrameAfterItsPreparation) {
    for (const ProceduralType& type : library->types()) {
        if (std::string_view(type.calls.name) != "rock") continue;
        Settings settings = settings_of(type.calls.name);
        settings.insert(settings.end(), {{"levels", "1"}, {"voxel", "0.1"}, {"years", "10"}});
        TestedProcedural called(type, world, settings);
        called.create();
        const MarramFrame frame = world.frame();
        called.expect_ok(called.begin(frame));
        called.expect_ok(called.calls.prepare(called.instance, &frame, nullptr));
        MarramMeshBuffers buffers{};
        buffers.size = sizeof buffers;
        called.expect_error(called.calls.mesh(called.instance, &buffers), "contract.no_frame", "no begin");
    }
}

TEST_F(FaultyHost, IsToldOfStatesThatAreNotThere) {
    Settings settings = settings_of("rock");
    settings.insert(settings.end(), {{"levels", "1"}, {"voxel", "0.1"}, {"years", "10"}});
    TestedProcedural called(*library->find("rock"), world, settings);
    called.create();
    const MarramFrame frame = world.frame();
    MarramStates states{};
    called.expect_error(called.calls.prepare(called.instance, &frame, &states), "contract.size", "no size");
    states.size = offsetof(MarramStates, store); // of a host that knows no more
    states.load = [](void*, double, MarramState*) {
        ADD_FAILURE() << "called beyond the size";
        return MARRAM_ERROR;
    };
    called.expect_error(called.calls.prepare(called.instance, &frame, &states), "contract.null_states",
                        "no functions");
}

// A host that cancels begin() at any of its questions, and begins again: what was half chosen is chosen anew.
TEST_F(FaultyHost, MayCancelAFrameAnywhere) {
    static std::atomic<int> questions; // until it cancels
    Settings settings = settings_of("groom");
    settings.insert(settings.end(), {{"cvs", "0"}, {"wind.shielding.spread", "20"}});
    const auto make = [&] {
        auto called = std::make_unique<TestedProcedural>(*library->find("groom"), world, settings);
        called->host.cancelled = [](void*) { return questions.fetch_sub(1) <= 0 ? 1 : 0; };
        questions = 1 << 30;
        called->create();
        return called;
    };
    const std::string whole = make()->evaluate();
    size_t cancelled = 0;
    for (int at = 0;; at += 1 + at / 8) { // the first ones, then ever fewer
        const auto called = make();
        questions = at;
        const MarramStatus status = called->begin(world.frame());
        questions = 1 << 30;
        ASSERT_EQ(called->evaluate(), whole) << "cancelled at question " << at;
        if (status == MARRAM_OK) break;
        EXPECT_EQ(status, MARRAM_CANCELLED);
        ++cancelled;
    }
    EXPECT_GT(cancelled, 3u);
}

TEST_F(FaultyHost, IsToldOfCallsOutOfOrder) {
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        const MarramProcedural& calls = called.calls;
        called.create();
        const auto sink = [](void*, const char*, double) {};
        MarramPatch patch{};
        patch.size = sizeof patch;
        float* none[1] = {nullptr};
        MarramPatchBuffers buffers{sizeof(MarramPatchBuffers), none, nullptr, 0, nullptr, nullptr};
        MarramMeshBuffers mesh_buffers{};
        mesh_buffers.size = sizeof mesh_buffers;
        mesh_buffers.positions = none;
        const MarramView view = called.good_view();
        MarramOutput output{};
        output.size = sizeof output;
        const auto too_early = [&] {
            calls.report(called.instance, sink, nullptr);
            if (calls.patch)
                called.expect_error(calls.patch(called.instance, 0, &patch), "contract.no_frame", "patch");
            if (calls.tessellate)
                called.expect_error(calls.tessellate(called.instance, 0, &buffers), "contract.no_frame",
                                    "tessellate");
            if (calls.mesh)
                called.expect_error(calls.mesh(called.instance, &mesh_buffers), "contract.no_frame", "mesh");
            if (calls.begin_view)
                called.expect_error(calls.begin_view(called.instance, &view, &output), "contract.no_frame",
                                    "begin_view");
            if (calls.describe)
                called.expect_error(calls.describe(
                                        called.instance, [](void*, const char*) {}, nullptr),
                                    "contract.no_frame", "describe");
            if (calls.summarize)
                called.expect_error(calls.summarize(
                                        called.instance, [](void*, const char*) {}, nullptr),
                                    "contract.no_frame", "summarize");
            if (calls.gusts)
                called.expect_error(
                    calls.gusts(
                        called.instance, [](void*, const double*, double, double) {}, nullptr),
                    "contract.no_frame", "gusts");
            const double point[3] = {0.0, 1.0, 0.0};
            if (calls.air)
                called.expect_error(calls.air(called.instance, 1, point, sink_of_air, nullptr),
                                    "contract.no_frame", "air");
            if (calls.shelter_rays)
                called.expect_error(
                    calls.shelter_rays(called.instance, 1, point, point, sink_of_rays, nullptr),
                    "contract.no_frame", "shelter_rays");
            if (calls.view_mesh)
                called.expect_error(calls.view_mesh(called.instance, &mesh_buffers), "contract.no_view",
                                    "view_mesh");
        };
        too_early();
        const std::string before = called.evaluate();
        if (calls.view_mesh) { // view_mesh needs a begin_view each time
            called.expect_error(calls.view_mesh(called.instance, &mesh_buffers), "contract.no_view",
                                "view_mesh");
            const std::string seen = called.view_mesh();
            called.expect_error(calls.view_mesh(called.instance, &mesh_buffers), "contract.no_view",
                                "view_mesh");
            EXPECT_EQ(called.view_mesh(), seen);
            called.expect_ok(calls.begin_view(called.instance, &view, &output));
            called.expect_ok(called.begin(world.frame())); // a new frame has no view yet
            called.expect_error(calls.view_mesh(called.instance, &mesh_buffers), "contract.no_view",
                                "view_mesh");
            called.expect_ok(calls.begin_view(called.instance, &view, &output));
            const MarramUpdate nothing{sizeof(MarramUpdate), called.good, 0};
            uint32_t changed = 0;
            called.expect_ok(calls.update(called.instance, &nothing, &changed));
            called.expect_error(calls.view_mesh(called.instance, &mesh_buffers), "contract.no_view",
                                "view_mesh");
        }
        MarramFrame frame = world.frame();
        frame.fps = -1.0;
        called.expect_error(called.begin(frame), "contract.frame",
                            "a bad frame"); // it also ends the frame that had begun
        too_early();
        called.expect_ok(called.begin(world.frame()));
        called.expect_ok(called.begin(world.frame())); // twice is allowed
        EXPECT_EQ(called.evaluate(), before);
        const MarramUpdate update{sizeof(MarramUpdate), called.good, MARRAM_EVERYTHING};
        uint32_t changed = 0;
        called.expect_ok(calls.update(called.instance, &update, &changed));
        too_early();
        EXPECT_EQ(called.evaluate(), before);
    }
}

TEST_F(FaultyHost, IsToldOfWrongBuffers) {
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        const MarramProcedural& calls = called.calls;
        called.create();
        const std::string before = called.evaluate();
        float* none[times_there] = {};
        const uint32_t beyond = 1000;
        float value = 0;
        float *values[] = {&value}, *no_values[] = {nullptr};
        const uint32_t first = 0;
        if (calls.tessellate) {
            std::vector<float> room(4 * called.first_vertex(called.output.curve_count) + 4);
            float* steps[times_there] = {room.data(), room.data(), room.data()};
            const auto refuses = [&](const MarramPatchBuffers& buffers, const char* id) {
                called.expect_error(calls.tessellate(called.instance, 0, &buffers), id, id);
            };
            refuses({sizeof(MarramPatchBuffers), nullptr, nullptr, 0, nullptr, nullptr},
                    "contract.null_buffer");
            refuses({sizeof(MarramPatchBuffers), none, nullptr, 0, nullptr, nullptr}, "contract.null_buffer");
            refuses({sizeof(MarramPatchBuffers), steps, nullptr, 1, nullptr, values}, "contract.null_buffer");
            refuses({sizeof(MarramPatchBuffers), steps, nullptr, 1, &first, nullptr}, "contract.null_buffer");
            refuses({sizeof(MarramPatchBuffers), steps, nullptr, 1, &first, no_values},
                    "contract.null_buffer");
            refuses({sizeof(MarramPatchBuffers), steps, nullptr, 1, &beyond, values},
                    "contract.attribute_range");
            MarramPatch patch{};
            patch.size = sizeof patch;
            for (const uint32_t index : {called.output.patch_count, 0xFFFFFFFFU}) {
                called.expect_error(calls.patch(called.instance, index, &patch), "contract.patch_range",
                                    "patch");
                const MarramPatchBuffers buffers{
                    sizeof(MarramPatchBuffers), steps, nullptr, 0, nullptr, nullptr};
                called.expect_error(calls.tessellate(called.instance, index, &buffers),
                                    "contract.patch_range", "patch");
            }
            called.expect_error(calls.patch(called.instance, 0, nullptr), "contract.null_patch", "patch");
        } else {
            std::vector<float> positions(3 * size_t(called.output.vertex_count));
            std::vector<uint32_t> triangles(3 * size_t(called.output.triangle_count));
            float* steps[] = {positions.data()};
            for (int fault = 0; fault < 6; ++fault) {
                MarramMeshBuffers buffers{};
                buffers.size = sizeof buffers;
                buffers.positions = fault == 0 ? nullptr : fault == 1 ? none : steps;
                buffers.triangles = fault == 2 ? nullptr : triangles.data();
                buffers.attribute_count = 1;
                buffers.attributes = fault == 3 ? nullptr : fault == 4 ? &beyond : &first;
                buffers.attribute_values = fault == 5 ? no_values : values;
                called.expect_error(calls.mesh(called.instance, &buffers),
                                    fault == 4 ? "contract.attribute_range" : "contract.null_buffer", "mesh");
            }
        }
        EXPECT_EQ(called.evaluate(), before);
    }
}

TEST_F(FaultyHost, IsToldOfWrongViews) {
    TestedProcedural called(*library->find("terrain"), world);
    called.create();
    called.evaluate();
    const double bad[] = {std::nan(""), 0, 0}, zero[] = {0, 0, 0};
    const std::vector<std::function<void(MarramView&)>> faults = {
        [](MarramView& v) { v.times = nullptr; },
        [](MarramView& v) { v.time_count = 0; },
        [](MarramView& v) { v.time_count = 65; },
        [](MarramView& v) { v.positions = nullptr; },
        [](MarramView& v) { v.directions = nullptr; },
        [](MarramView& v) { v.ups = nullptr; },
        [&](MarramView& v) { v.positions = bad; },
        [&](MarramView& v) { v.directions = bad; },
        [&](MarramView& v) { v.directions = zero; },
        [&](MarramView& v) { v.ups = zero; },
        [](MarramView& v) { v.fov = 0.0; },
        [](MarramView& v) { v.fov = 4.0; },
        [](MarramView& v) { v.fov = std::nan(""); },
        [](MarramView& v) { v.width = 0; },
        [](MarramView& v) { v.height = 0; },
        [](MarramView& v) { v.tolerance = -1.0; },
        [](MarramView& v) { v.tolerance_pixels = HUGE_VAL; },
        [](MarramView& v) { v.size = sizeof v.size; }};
    const std::string before = called.view_mesh();
    for (size_t i = 0; i < faults.size(); ++i) {
        MarramView view = called.good_view();
        faults[i](view);
        MarramOutput output{};
        output.size = sizeof output;
        called.expect_error(called.calls.begin_view(called.instance, &view, &output),
                            view.size == sizeof view ? "contract.view" : "contract.size",
                            fmt::format("view {}", i));
    }
    MarramOutput output{};
    called.expect_error(called.calls.begin_view(called.instance, nullptr, &output), "contract.null_view",
                        "no view");
    EXPECT_EQ(called.view_mesh(), before);
}

// Good and bad calls in any order: each succeeds, or is an error with a message; a good frame gives the same
// result at the end as at the beginning.
TEST_F(FaultyHost, OfAnyKindDoesNoHarm) {
    std::mt19937 random(20250118);
    const auto any = [&](size_t count) { return size_t(random() % count); };
    for (const ProceduralType& type : library->types()) {
        TestedProcedural called(type, world);
        const MarramProcedural& calls = called.calls;
        Spoilt spoilt;
        const std::vector<FrameFault> faults = frame_faults(spoilt);
        WrongValues wrong;
        called.create();
        const std::string before = called.evaluate();
        size_t errors = 0;
        const auto note = [&](MarramStatus status, const char* what) {
            EXPECT_NE(status, MARRAM_CANCELLED) << what;
            EXPECT_EQ(status == MARRAM_ERROR, !called.messages.faults.empty())
                << type.calls.name << ": " << what;
            errors += status == MARRAM_ERROR;
            called.messages.faults.clear();
        };
        for (int step = 0; step < 400; ++step) {
            uint32_t changed = 0;
            switch (any(8)) {
            case 0:
                if (any(4) == 0) called.create();
                break;
            case 1: { // a value left out: allowed if it may be absent
                WrongValues less;
                for (uint32_t i = 0; i < called.good->count; ++i)
                    if (any(40) > 0)
                        less.list.push_back(
                            *MARRAM_AT(MarramValue, called.good->first, called.good->stride, i));
                less.lent = {sizeof(MarramValues), less.list.data(), uint32_t(less.list.size()),
                             sizeof(MarramValue)};
                const MarramUpdate update{sizeof(MarramUpdate), &less.lent, uint32_t(any(8))};
                note(calls.update(called.instance, &update, &changed), "update with less");
                break;
            }
            case 2: {
                if (!make_wrong(called, any(called.good->count), int(any(value_faults_there)), wrong)) break;
                const MarramUpdate update{sizeof(MarramUpdate), &wrong.lent, uint32_t(any(8))};
                note(calls.update(called.instance, &update, &changed), wrong.what.c_str());
                break;
            }
            case 3:
            case 4: {
                MarramFrame frame = world.frame();
                frame.frame += double(any(3));
                frame.stage = MarramStage(any(3));
                const FrameFault& fault = faults[any(faults.size())];
                if (any(2) == 0) fault.spoil(world, frame);
                if (calls.prepare && any(2) == 0)
                    note(calls.prepare(called.instance, &frame, nullptr), "prepare");
                note(called.begin(frame), fault.what);
                world.bad_pose = LentWorld::BadPose::none;
                break;
            }
            case 5: {
                MarramView view = called.good_view();
                if (any(2) == 0) view.fov = -1.0;
                MarramOutput seen{};
                seen.size = any(4) == 0 ? sizeof seen.size : sizeof seen;
                if (calls.begin_view) note(calls.begin_view(called.instance, &view, &seen), "begin_view");
                break;
            }
            case 6: {
                MarramPatch patch{};
                patch.size = any(4) == 0 ? sizeof patch.size : sizeof patch;
                if (calls.patch) note(calls.patch(called.instance, uint32_t(any(3)), &patch), "patch");
                if (calls.mesh) note(calls.mesh(called.instance, nullptr), "mesh");
                break;
            }
            default:
                calls.report(
                    called.instance, [](void*, const char*, double) {}, nullptr);
                if (calls.tessellate)
                    note(calls.tessellate(called.instance, uint32_t(any(3)), nullptr), "tessellate");
                if (calls.view_mesh) note(calls.view_mesh(called.instance, nullptr), "view_mesh");
                break;
            }
        }
        EXPECT_GT(errors, 100u);
        const MarramUpdate update{sizeof(MarramUpdate), called.good, MARRAM_EVERYTHING};
        uint32_t changed = 0;
        called.expect_ok(calls.update(called.instance, &update, &changed));
        EXPECT_EQ(called.evaluate(), before) << type.calls.name;
    }
}

} // namespace
} // namespace marram::testing
