// SPDX-License-Identifier: Apache-2.0
// Marram's strands in Embree's tutorials: see README.md in this folder. The steps are those of ../README.md.
#include <tutorials/common/scenegraph/scenegraph.h>

#include <common/algorithms/parallel_for.h>
#include <marram/marram_host.h>

#include <deque>
#include <map>

namespace embree {
namespace {

void on_message(void*, const MarramMessage* m) {
    std::cerr << m->place << (*m->place ? ": " : "") << m->what << ": " << m->remedy << std::endl;
}

const MarramHost host = {sizeof host, nullptr, on_message, [](void*) { return 0; }, nullptr};

void ok(MarramStatus status) {
    if (status != MARRAM_OK) throw std::runtime_error("no strands of Marram"); // on_message has said why
}

MarramProcedural load_groom() {
    MarramProcedural groom;
    ok(marram_load_procedural(PLUGIN, "groom", &host, &groom)); // step 1
    return groom;
}

// Settings of the host itself. All others are set by name, as in a scene of Marram.
struct Settings {
    std::map<std::string, double> numbers = {
        {"host.fps", 24},    {"host.frame", 1},   {"host.bind_frame", 1}, {"host.tolerance", 0.001},
        {"host.open", 0},    {"host.close", 0}, // the shutter, frames from the frame: Embree's times 0 and 1
        {"host.samples", 1},                    // over the shutter
        {"host.red", 0.2},   {"host.green", 0.3}, {"host.blue", 0.06}};
    std::string strands; // "host.strands": a file for all CVs, as ../example/host.c writes it
    double operator[](const char* name) const { return numbers.at(name); }
};

Settings read(const std::string& file, MarramHostValues* values) { // step 2: one `name = value` per line
    std::ifstream in(file);
    if (!in) throw std::runtime_error("cannot open " + file);
    Settings settings;
    std::string line;
    for (int number = 1; std::getline(in, line); ++number) {
        std::string name, equal, value;
        std::istringstream words(line);
        if (!(words >> name) || name[0] == '#') continue;
        const std::string place = file + ":" + std::to_string(number);
        const auto own = settings.numbers.find(name);
        if (!(words >> equal) || equal != "=" ||
            !(own != settings.numbers.end() ? words >> own->second : std::getline(words >> std::ws, value)))
            throw std::runtime_error(place + ": give name = value, of the host's own a number");
        marram_values_place(values, place.c_str());
        if (name == "host.strands")
            settings.strands = value;
        else if (own == settings.numbers.end())
            marram_set(values, name.c_str(), value.c_str()); // finish() reports mistakes
    }
    return settings;
}

std::vector<float> packed(const std::vector<avector<Vec3fa>>& steps, bool unit) {
    std::vector<float> floats;
    for (size_t i = 0; !steps.empty() && i < steps[0].size(); ++i) {
        const Vec3fa v = unit ? normalize(steps[0][i]) : steps[0][i];
        floats.insert(floats.end(), {v.x, v.y, v.z});
    }
    floats.reserve(floats.size() + 4); // Embree reads beyond the end of buffers
    return floats;
}

struct Lent {
    struct Mesh {
        std::string name;
        std::vector<float> positions, normals;
        const float *position_sample, *normal_sample;
    };
    std::deque<Mesh> meshes;
    std::vector<MarramMesh> handed;
    RTCScene colliders;
};

// Step 4: lends the triangle meshes as mesh0, mesh1, ... in the order of the scene.
Lent lend(RTCDevice device, const SceneGraph::GroupNode& scene) {
    Lent lent = {{}, {}, rtcNewScene(device)};
    for (const auto& child : scene.children) {
        const auto node = child.dynamicCast<SceneGraph::TriangleMeshNode>();
        if (!node) continue;
        Lent::Mesh& mesh = lent.meshes.emplace_back();
        mesh.name = "mesh" + std::to_string(lent.handed.size());
        if (node->numTimeSteps() != 1) throw std::runtime_error(mesh.name + " moves: meshes have to rest");
        mesh.positions = packed(node->positions, false), mesh.normals = packed(node->normals, true);
        mesh.position_sample = mesh.positions.data(), mesh.normal_sample = mesh.normals.data();
        MarramMesh m = {};
        m.name = mesh.name.c_str(), m.geometry_id = uint32_t(lent.handed.size());
        m.vertex_count = uint32_t(node->numVertices()), m.triangle_count = uint32_t(node->triangles.size());
        m.roles = MARRAM_ALL_ROLES, m.time_count = 1;
        m.positions = &mesh.position_sample;
        m.normals = mesh.normals.empty() ? nullptr : &mesh.normal_sample;
        m.triangles = &node->triangles.data()->v0;
        m.uvs = node->texcoords.empty() ? nullptr : &node->texcoords.data()->x;
        lent.handed.push_back(m);
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                   mesh.position_sample, 0, 12, m.vertex_count);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m.triangles, 0, 12,
                                   m.triangle_count);
        rtcSetGeometryMask(geometry, m.roles | MARRAM_NAMED);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(lent.colliders, geometry, m.geometry_id), rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(lent.colliders);
    return lent;
}

MarramStatus pose(void* user, uint32_t mesh, double, float* positions, float* normals) {
    const Lent::Mesh& lent = static_cast<const Lent*>(user)->meshes[mesh];
    std::copy(lent.positions.begin(), lent.positions.end(), positions);
    if (normals) std::copy(lent.normals.begin(), lent.normals.end(), normals);
    return MARRAM_OK;
}

void add_hair(const MarramProcedural& groom, MarramInstance* grass, const MarramOutput& output,
              const Settings& settings, SceneGraph::GroupNode& scene) {
    if (output.basis != MARRAM_BSPLINE || output.shape == MARRAM_ORIENTED_RIBBON || !output.cvs_per_curve)
        throw std::runtime_error("drawn are B-splines of as many CVs each, round ones and ribbons");
    const size_t cvs = output.cvs_per_curve, vertices = cvs + 2;
    const Vec3fa color{float(settings["host.red"]), float(settings["host.green"]),
                       float(settings["host.blue"])};
    const Ref<SceneGraph::MaterialNode> material = new HairMaterial(0.4F * color, color, 4, 1);
    const auto type = output.shape == MARRAM_ROUND ? RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE
                                                   : RTC_GEOMETRY_TYPE_FLAT_BSPLINE_CURVE;
    Ref<SceneGraph::HairSetNode> hair =
        new SceneGraph::HairSetNode(type, material, BBox1f(0, 1), output.time_count);
    for (auto& step : hair->positions) step.resize(output.curve_count * vertices);
    parallel_for(output.patch_count, [&](uint32_t i) { // step 6
        MarramPatch patch = {sizeof patch, 0, 0, {}, {}};
        ok(groom.patch(grass, i, &patch));
        std::vector<float*> steps;
        for (auto& step : hair->positions) steps.push_back(&step[patch.first_curve * vertices].x);
        const MarramPatchBuffers buffers = {sizeof buffers, steps.data(), nullptr, 0, nullptr, nullptr};
        ok(groom.tessellate(grass, i, &buffers));
    });
    for (size_t c = 0; c < output.curve_count; ++c) // step 7: a segment begins at each CV except the last
        for (size_t k = 0; k + 1 < cvs; ++k)
            hair->hairs.emplace_back(unsigned(c * vertices + k), unsigned(c));
    scene.add(hair.cast<SceneGraph::Node>());
    if (settings.strands.empty()) return;
    std::ofstream out(settings.strands, std::ios::binary);
    for (const auto& step : hair->positions)
        for (int part = 0; part < 2; ++part) // positions, then diameters
            for (size_t i = 0; i < step.size(); ++i) {
                if (i % vertices == 0 || i % vertices == vertices - 1) continue; // not a CV
                const float diameter = 2 * step[i].w;
                out.write(reinterpret_cast<const char*>(part ? &diameter : &step[i].x), part ? 4 : 12);
            }
    if (!out.flush()) throw std::runtime_error("cannot write " + settings.strands);
}

} // namespace

void add_marram_strands(RTCDevice device, SceneGraph::GroupNode& scene, const std::string& file) {
    const MarramProcedural groom = load_groom();
    MarramHostValues* values = marram_values_new(&groom);
    const Settings settings = read(file, values);
    const MarramValues* all = marram_values_finish(values, &host); // step 3
    MarramInstance* grass = nullptr;
    ok(all ? groom.create(&host, all, &grass) : MARRAM_ERROR);
    marram_values_free(values);
    Lent lent = lend(device, scene);
    MarramFrame frame = {};
    frame.size = sizeof frame;
    frame.fps = settings["host.fps"], frame.tolerance = settings["host.tolerance"];
    frame.frame = settings["host.frame"], frame.bind_frame = settings["host.bind_frame"];
    frame.time_count = uint32_t(settings["host.samples"]);
    const double open = settings["host.open"], length = settings["host.close"] - open;
    std::vector<double> times;
    for (uint32_t t = 0; t < frame.time_count; ++t)
        times.push_back(frame.frame + open + length * t / std::max(frame.time_count - 1, 1U));
    frame.times = times.data(), frame.stage = MARRAM_FINAL;
    frame.device = device, frame.colliders = lent.colliders;
    frame.meshes = lent.handed.data(), frame.mesh_count = uint32_t(lent.handed.size());
    frame.mesh_stride = sizeof(MarramMesh), frame.pose = pose, frame.pose_user = &lent;
    MarramOutput output = {};
    output.size = sizeof output;
    ok(groom.begin(grass, &frame, &output)); // step 5
    add_hair(groom, grass, output, settings, scene);
    groom.destroy(grass);
    rtcReleaseScene(lent.colliders);
}

} // namespace embree
