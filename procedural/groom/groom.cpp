// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/groom.h"

#include "core/math/clock.h"
#include "procedural/contract_checks.h"

#include "procedural/groom/description.h"
#include "procedural/groom/past.h"
#include "procedural/groom/pilot.h"
#include "procedural/groom/roots.h"
#include "procedural/groom/strand_shape.h"
#include "procedural/wind/chain.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <new>
#include <optional>
#include <string>

namespace marram {
namespace {

constexpr std::array attributes = {
    MarramAttribute{"root_normal", 3, 0, 0, "surface normal at the root"},
    MarramAttribute{"root_uv", 2, 0, 0, "surface uv at the root"},
    MarramAttribute{"id", 1, 0, 1,
                    "a number below 2^24 that stays with the strand, whatever grows elsewhere"},
    MarramAttribute{"envelope", 1, 1, 0, "share of the wind that reaches a CV"},
    MarramAttribute{"gust", 1, 1, 0, "sum of the gusts at a CV; 1 is a whole one"},
    MarramAttribute{"shield", 1, 1, 0, "sheltered share of a CV, or of its strand (see wind.shielding)"},
};
enum AttributeIndex : uint32_t { root_normal, root_uv, id, envelope, gust, sheltered };

// CVs that one patch aims at: enough to hide the cost of a task, few enough to stay in a core's cache.
constexpr int patch_cvs = 4096;

int strands_a_patch(int cvs) { return std::clamp((patch_cvs / cvs + lanes - 1) / lanes * lanes, lanes, 512); }

struct Worker { // what a thread keeps from patch to patch
    Strands strands;
    ChainScratch chain;
};

// What the tolerance's choices depend on, beside the description.
struct TurnedFor {
    double frame, first, last, tolerance;
    MarramStage stage;
    bool operator==(const TurnedFor&) const = default;
};

struct GroomInstance {
    MarramHost host{};
    Groom groom;
    Wind wind; // both with what the tolerance has chosen for the frame
    struct {
        bool cvs = false, rays = false, step = false;
    } left_open; // to the tolerance
    std::optional<TurnedFor> turned_for;
    std::vector<std::string> out_of_reach; // warnings about dials

    std::vector<Root> roots;
    std::vector<float> bind_positions;
    bool placed = false;
    double placing_seconds = 0.0, chain_seconds = 0.0; // wall time within begin
    size_t placing_bytes = 0;

    bool begun = false;              // a frame, without a fault
    std::optional<double> announced; // the frame whose work was said to be long
    MarramFrame frame{};
    const MarramMesh* mesh = nullptr;
    uint32_t placed_vertices = 0, placed_triangles = 0; // of the mesh that the roots were placed on
    uint32_t time_count = 1;
    ChainFrame chain;
    ColliderTrees trees;
    PastSkin past;
    bool gusts_fixed = false;
    std::vector<float> width_profile; // [cvs], half of it: radius of a strand 1 wide

    tbb::enumerable_thread_specific<Worker> workers;

    GrowthPoses poses(uint32_t time) const {
        const uint32_t t = std::min(time, mesh->time_count - 1);
        const Surface now{mesh->positions[t], mesh->normals ? mesh->normals[t] : nullptr, mesh->triangles,
                          mesh->uvs, mesh->triangle_count};
        const Surface bind{bind_positions.data(), nullptr, mesh->triangles, mesh->uvs, mesh->triangle_count};
        return {bind, now};
    }
    uint32_t patch_count() const {
        const auto size = uint64_t(strands_a_patch(groom.cvs));
        return uint32_t((roots.size() + size - 1) / size);
    }
    std::span<const Root> patch_roots(uint32_t patch) const {
        const auto size = size_t(strands_a_patch(groom.cvs));
        const size_t first = size_t(patch) * size;
        return std::span(roots).subspan(first, std::min(size, roots.size() - first));
    }
};

GroomInstance& self(MarramInstance* instance) { return *reinterpret_cast<GroomInstance*>(instance); }

// Nothing is thrown across the border.
template <typename Body>
MarramStatus guarded(const MarramHost& host, Body&& body) {
    try {
        return body();
    } catch (const SceneFault& fault) {
        host.message(host.user, MARRAM_FAULT, fault.place.c_str(), fault.what());
    } catch (const std::bad_alloc&) {
        host.message(host.user, MARRAM_FAULT, "",
                     "the groom does not fit into memory: lower its density or count");
    } catch (const std::exception& error) {
        host.message(host.user, MARRAM_FAULT, "", error.what());
    }
    return MARRAM_ERROR;
}

// The groom's own parameters and behind them the wind's as "wind.<name>". Names must live as long as the library.
const std::vector<MarramParam>& all_params() {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> list;
        for (const MarramParam& param : wind_params()) list.push_back(std::string("wind.") + param.name);
        return list;
    }();
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list(groom_params().begin(), groom_params().end());
        for (size_t i = 0; i < wind_params().size(); ++i) {
            list.push_back(wind_params()[i]);
            list.back().name = names[i].c_str();
        }
        return list;
    }();
    return params;
}

// Strands that nobody will see are allowed, and said.
void warn_of_nothing(const MarramHost& host, const Values& given, const Groom& groom) {
    const auto warn = [&](const char* name, const char* text) {
        host.message(host.user, MARRAM_WARNING, given.at(name).place, text);
    };
    if (groom.width == 0.0) warn("width", "width is 0, no strand will be seen: give the diameter in metres");
    if (std::ranges::all_of(groom.width_profile.values(), [](double share) { return share == 0.0; }))
        warn("width_profile", "width_profile is 0 everywhere, no strand will be seen: raise a value");
    if (groom.length[1] == 0.0) warn("length", "length is 0, no strand will be seen: give metres");
}

MarramStatus create(const MarramHost* host, const MarramValue* values, uint32_t count, MarramInstance** out) {
    if (!host || !host->message || !host->cancelled || !out) return MARRAM_ERROR; // nobody to tell
    return guarded(*host, [&] {
        const std::vector<ContractFault> faults = value_faults(all_params(), values, count);
        for (const ContractFault& fault : faults)
            host->message(host->user, MARRAM_FAULT, fault.place.c_str(), fault.text.c_str());
        if (!faults.empty()) return MARRAM_ERROR;
        auto instance = std::make_unique<GroomInstance>();
        instance->host = *host;
        const Values given(values, count);
        instance->groom = read_groom(given);
        instance->wind = read_wind(given);
        warn_of_nothing(*host, given, instance->groom);
        instance->left_open.cvs = instance->groom.cvs == 0;
        instance->left_open.rays = instance->wind.shielding && instance->wind.shielding->spread > 0.0 &&
                                   instance->wind.shielding->rays == 0;
        instance->left_open.step = instance->wind.jiggle && instance->wind.jiggle->step == 0.0;
        // A turn belongs to a segment of the strand as it is authored: where that is not said, of one of eight CVs.
        constexpr int segments = 7;
        if (instance->left_open.cvs && instance->wind.reference_segments == 0)
            instance->wind.reference_segments = segments;
        *out = reinterpret_cast<MarramInstance*>(instance.release());
        return MARRAM_OK;
    });
}

void find_mesh(GroomInstance& instance) {
    instance.mesh = nullptr;
    for (uint32_t i = 0; i < instance.frame.mesh_count; ++i)
        if (instance.groom.mesh == instance.frame.meshes[i].name) instance.mesh = &instance.frame.meshes[i];
    if (!instance.mesh)
        throw SceneFault(instance.groom.mesh_place, "there is no mesh '" + instance.groom.mesh +
                                                        "' to grow on: name one of the scene's");
}

void check_uvs(const GroomInstance& instance) {
    for (const Masks* masks : {&instance.groom.density_masks, &instance.groom.length_masks})
        if (masks->image && !instance.mesh->uvs)
            throw SceneFault(masks->image->place,
                             "the mesh '" + instance.groom.mesh +
                                 "' has no uvs for this image: give it uvs, or use masks by height or slope");
}

MarramStatus place(GroomInstance& instance) {
    const double begin = wall_seconds();
    instance.bind_positions.resize(3 * size_t(instance.mesh->vertex_count));
    const auto index = uint32_t(instance.mesh - instance.frame.meshes);
    const MarramStatus status = instance.frame.pose(
        instance.frame.pose_user, index, instance.frame.bind_frame, instance.bind_positions.data(), nullptr);
    if (status != MARRAM_OK) return status;
    const auto cancelled = [&] { return instance.host.cancelled(instance.host.user) != 0; };
    PlacedRoots placed = place_roots(instance.groom, instance.poses(0).bind, cancelled);
    instance.roots = std::move(placed.roots);
    instance.placing_bytes = placed.peak_bytes;
    if (cancelled()) return MARRAM_CANCELLED;
    instance.placed = true;
    instance.placed_vertices = instance.mesh->vertex_count;
    instance.placed_triangles = instance.mesh->triangle_count;
    instance.placing_seconds = wall_seconds() - begin;
    return MARRAM_OK;
}

// Gusts start across the scene's bounds at the shot's first frame, where the scene does not say where.
MarramStatus fix_gusts_once(GroomInstance& instance) {
    if (!instance.wind.gusts || instance.gusts_fixed) return MARRAM_OK;
    Vec3d lower = Vec3d::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
    std::vector<float> positions;
    for (uint32_t i = 0; i < instance.frame.mesh_count; ++i) {
        positions.resize(3 * size_t(instance.frame.meshes[i].vertex_count));
        const MarramStatus status = instance.frame.pose(instance.frame.pose_user, i,
                                                        instance.frame.bind_frame, positions.data(), nullptr);
        if (status != MARRAM_OK) return status;
        for (size_t v = 0; v + 2 < positions.size(); v += 3) {
            const Vec3d p(double(positions[v]), double(positions[v + 1]), double(positions[v + 2]));
            lower = lower.cwiseMin(p);
            upper = upper.cwiseMax(p);
        }
    }
    fix_gusts(*instance.wind.gusts, lower, upper, instance.wind.direction);
    instance.gusts_fixed = true;
    return MARRAM_OK;
}

// Colliders that move make strands move which touch them or stand behind them.
bool meets_moving_meshes(const GroomInstance& instance) {
    if (!instance.wind.collision && !instance.wind.shielding) return false;
    for (uint32_t i = 0; i < instance.frame.mesh_count; ++i)
        if (instance.frame.meshes[i].time_count > 1) return true;
    return false;
}

// How far anything of a strand, its width and its clearance included, may be from its root. `scale`: the greatest coordinate.
// Whatever bends a strand keeps its length, so it stays in a ball about its root. B-splines stay within the hull of their
// CVs (drawn to the tip with the phantom rule too); Catmull-Rom leaves it by less than a third of a segment.
double reach_from_root(const GroomInstance& instance, double scale) {
    const Groom& groom = instance.groom;
    const double length = longest_strand(groom);
    double widest = 0.0;
    for (const float half : instance.width_profile) widest = std::max(widest, double(half));
    const double beyond = groom.basis == MARRAM_CATMULL_ROM ? length / (3.0 * (groom.cvs - 1)) : 0.0;
    double lift = 0.0, clearance = 0.0;
    if (const auto& collision = instance.wind.collision) {
        lift = root_offset(*collision, length, groom.width * instance.width_profile[0]);
        clearance = std::max(collision->clearance.value_or(0.0), lift);
    }
    return (length + beyond + groom.width * widest + lift + clearance) * (1.0 + 1e-5) +
           4.0 * (scale + length + lift) * 0x1p-23;
}

// A box around every strand at every motion sample, whatever the wind does.
Eigen::AlignedBox3d reach_of_strands(const GroomInstance& instance) {
    Eigen::AlignedBox3d box;
    const MarramMesh& mesh = *instance.mesh;
    for (uint32_t time = 0; time < mesh.time_count; ++time)
        for (size_t v = 0; v < mesh.vertex_count; ++v)
            box.extend(Eigen::Map<const Vec3f>(mesh.positions[time] + 3 * v).cast<double>());
    const double reach =
        reach_from_root(instance, std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff()));
    return {box.min().array() - reach, box.max().array() + reach};
}

// A box around every rest CV that gusts are asked for.
Eigen::AlignedBox3d rest_box(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    Eigen::AlignedBox3d box;
    for (uint32_t time = 0; time < mesh.time_count; ++time)
        extend_by_rest(instance.groom, std::span(mesh.positions[time], 3 * size_t(mesh.vertex_count)), box);
    for (const PastSkin::Pose& pose : instance.past.poses)
        extend_by_rest(instance.groom, pose.positions, box);
    return box;
}

std::string short_number(double value) { return fmt::format("{:.3g}", value); }

void warn_of_gusts(const GroomInstance& instance) {
    constexpr size_t much = size_t(1) << 30;
    const size_t bytes = instance.chain.gust_bytes();
    if (bytes < much) return;
    const std::string text = "gusts among the strands take " + std::to_string(bytes >> 20) + " MiB, for " +
                             std::to_string(instance.chain.instants.size()) + " motion samples and " +
                             std::to_string(instance.chain.past_gusts.size()) +
                             " steps of jiggle: lower wind.gusts.num_gusts, radius_range or life_range";
    instance.host.message(instance.host.user, MARRAM_WARNING, instance.groom.mesh_place.c_str(),
                          text.c_str());
}

// Work that takes long is announced before it begins, so that who asked for it by mistake need not wait to learn it.
void announce_long_work(GroomInstance& instance) {
    // Thread seconds per CV and motion sample, or step of jiggle. Contact: 1e-6 with 5 CVs a strand, 3e-6 with hundreds.
    constexpr double bend = 0.08e-6, collide = 2e-6, announced = 10.0;
    const double cvs = double(instance.roots.size()) * instance.groom.cvs;
    const double samples = instance.time_count,
                 steps = double(std::max<int64_t>(instance.past.window.count(), 0));
    const bool collides = instance.wind.collision && instance.frame.stage == MARRAM_FINAL;
    const double seconds = cvs * (bend * (samples + steps) + (collides ? collide * samples : 0.0));
    if (seconds < announced || instance.announced == instance.frame.frame) return;
    instance.announced = instance.frame.frame;
    const std::string text =
        fmt::format("{:.3g} CVs, {} a strand, at {} motion samples and {} steps of jiggle take {:.0f} s of "
                    "one processor or "
                    "more: ask for fewer strands or CVs, a larger tolerance, or stronger jiggle.damping",
                    cvs, instance.groom.cvs, samples, steps, seconds);
    instance.host.message(instance.host.user, MARRAM_INFO, instance.groom.mesh_place.c_str(), text.c_str());
}

// A length in the wrong unit: every ray meets every strand, and rendering takes hours.
void warn_of_length(const GroomInstance& instance) {
    constexpr double much = 1e4; // times the mesh
    constexpr size_t many = 100;
    Eigen::AlignedBox3d box;
    for (size_t v = 0; v < instance.mesh->vertex_count; ++v)
        box.extend(Eigen::Map<const Vec3f>(instance.mesh->positions[0] + 3 * v).cast<double>());
    const double length = longest_strand(instance.groom), size = box.diagonal().norm();
    if (instance.roots.size() < many || !(length > much * size)) return;
    const std::string text = fmt::format("strands are up to {:.3g} m long on a mesh of {:.3g} m, and "
                                         "rendering will be slow: check the unit of length",
                                         length, size);
    instance.host.message(instance.host.user, MARRAM_WARNING, instance.groom.mesh_place.c_str(),
                          text.c_str());
}

// Positions are floats: far from the origin strands come to stand on a grid.
void warn_of_rounding(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    float farthest = 0.0F;
    for (size_t i = 0; i < 3 * size_t(mesh.vertex_count); ++i)
        farthest = std::max(farthest, std::abs(mesh.positions[0][i]));
    const double step = double(farthest) * 0x1p-23; // between neighbouring floats
    const double segment = longest_strand(instance.groom) / (instance.groom.cvs - 1);
    const double finest = instance.groom.width > 0.0 ? std::min(instance.groom.width, segment) : segment;
    constexpr double seen = 0.1; // of a width, or of a segment
    if (!(step > seen * finest) || !(finest > 0.0)) return;
    const std::string text = "positions " + short_number(double(farthest)) +
                             " m from the origin are rounded to " + short_number(step) +
                             " m, which shows on strands " + short_number(instance.groom.width) +
                             " m wide with segments of " + short_number(segment) +
                             " m: move the scene to the origin, or use larger units";
    instance.host.message(instance.host.user, MARRAM_WARNING, instance.groom.mesh_place.c_str(),
                          text.c_str());
}

// Whether the skin has moved within the window that jiggle looks back to, at the usual step.
MarramStatus skin_has_moved(GroomInstance& instance, bool& moved) {
    moved = instance.mesh->time_count > 1;
    if (moved) return MARRAM_OK;
    Jiggle jiggle = *instance.wind.jiggle;
    jiggle.step = usual_jiggle_step;
    PastSkin past;
    const MarramStatus status = read_past(instance.frame, uint32_t(instance.mesh - instance.frame.meshes),
                                          jiggle, longest_strand(instance.groom), past);
    moved = past.moves();
    return status;
}

void warn_out_of_reach(GroomInstance& instance, const std::string& what) {
    instance.out_of_reach.push_back(
        what + " is not as exact as the tolerance asks for: set it by hand, or a larger tolerance");
}

// Sets the dials that the scene leaves to the tolerance, from the description and this frame alone. A renderer may begin a frame twice,
// at other motion samples between the same ends: what was found serves again.
MarramStatus turn_dials(GroomInstance& instance) {
    Groom& groom = instance.groom;
    Wind& wind = instance.wind;
    const auto& open = instance.left_open;
    const MarramFrame& frame = instance.frame;
    const double length = longest_strand(groom);
    const double tolerance = frame.tolerance > 0.0 ? frame.tolerance : 1e-3 * length;
    const TurnedFor now{frame.frame, frame.times[0], frame.times[frame.time_count - 1], tolerance,
                        frame.stage};
    const auto warn = [&] {
        for (const std::string& text : instance.out_of_reach)
            instance.host.message(instance.host.user, MARRAM_WARNING, groom.mesh_place.c_str(), text.c_str());
    };
    if (instance.turned_for == now) {
        warn();
        return MARRAM_OK;
    }
    instance.out_of_reach.clear();
    wind.noise.left_out = octaves_too_fine(wind, length, tolerance);
    const PilotGroom pilot{groom, wind, frame, *instance.mesh, instance.roots, instance.poses(0).bind};
    if (open.cvs) {
        const Choice choice = cvs_for(pilot);
        groom.cvs = int(choice.value);
        if (!choice.enough) warn_out_of_reach(instance, "cvs = " + std::to_string(groom.cvs));
    }
    if (open.rays) {
        bool enough = true;
        wind.shielding->rays = cone_rays(*wind.shielding, length, most_turn(wind),
                                         wind.reference_segments > 2 * groom.cvs, tolerance, enough);
        if (!enough)
            warn_out_of_reach(instance, "wind.shielding.rays = " + std::to_string(wind.shielding->rays));
    }
    instance.width_profile.clear();
    for (int k = 0; k < groom.cvs; ++k)
        instance.width_profile.push_back(float(0.5 * groom.width_profile(double(k) / double(groom.cvs - 1))));
    if (open.step) {
        wind.jiggle->step = usual_jiggle_step;
        if (frame.stage == MARRAM_FINAL) {
            bool moved = false;
            if (const MarramStatus status = skin_has_moved(instance, moved); status != MARRAM_OK)
                return status;
            const Choice choice = jiggle_step_for(pilot, moved);
            wind.jiggle->step = choice.value;
            if (!choice.enough)
                warn_out_of_reach(instance, "wind.jiggle.step = " + std::to_string(choice.value));
        }
    }
    instance.turned_for = now;
    warn();
    return MARRAM_OK;
}

MarramStatus begin(MarramInstance* opaque, const MarramFrame* frame, MarramOutput* out) {
    GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        instance.begun = false;
        if (const std::string fault = out ? frame_fault(frame) : "the output is NULL: give room for it";
            !fault.empty())
            throw SceneFault("", fault);
        const bool traces = instance.wind.collision || instance.wind.shielding;
        if (traces && !frame->colliders)
            throw SceneFault("", "MarramFrame.colliders is NULL: lend the committed scene of all meshes");
        instance.frame = *frame;
        instance.workers.clear();
        instance.placing_seconds = 0.0;
        find_mesh(instance);
        check_uvs(instance);
        if (instance.placed && (instance.mesh->vertex_count != instance.placed_vertices ||
                                instance.mesh->triangle_count != instance.placed_triangles))
            throw SceneFault(instance.groom.mesh_place,
                             "the mesh '" + instance.groom.mesh +
                                 "' has other triangles than when its strands were placed: keep "
                                 "its topology, or make the groom anew");
        if (!instance.placed) {
            const MarramStatus status = place(instance);
            if (status != MARRAM_OK) return status;
        }
        if (const MarramStatus status = fix_gusts_once(instance); status != MARRAM_OK) return status;
        const double open = wall_seconds();
        if (const MarramStatus status = turn_dials(instance); status != MARRAM_OK) return status;
        instance.placing_seconds += wall_seconds() - open;
        const bool blown = frame->stage != MARRAM_REST;
        bool moves = instance.mesh->time_count > 1 ||
                     (blown && (wind_moves(instance.wind) || meets_moving_meshes(instance)));
        instance.past = {};
        if (instance.wind.jiggle && frame->stage == MARRAM_FINAL) {
            const MarramStatus status =
                read_past(instance.frame, uint32_t(instance.mesh - instance.frame.meshes),
                          *instance.wind.jiggle, longest_strand(instance.groom), instance.past);
            if (status != MARRAM_OK) return status;
            // Where nothing has moved nothing swings.
            if (instance.past.moves() || wind_moves(instance.wind))
                moves = true;
            else
                instance.past = {};
        }
        instance.time_count = moves ? frame->time_count : 1;
        instance.frame.time_count = instance.time_count; // what the chain works at
        const double before = wall_seconds();
        instance.chain = {}; // it holds the last frame's trees, which may have to go first
        instance.chain =
            make_chain_frame({instance.wind, instance.groom.envelope, instance.frame, *instance.mesh,
                              instance.width_profile, instance.groom.basis, instance.past.window,
                              instance.wind.collision ? reach_of_strands(instance) : everywhere(),
                              instance.wind.gusts ? rest_box(instance) : everywhere(), &instance.trees});
        warn_of_gusts(instance);
        warn_of_rounding(instance);
        warn_of_length(instance);
        announce_long_work(instance);
        instance.chain_seconds = instance.wind.collision ? wall_seconds() - before : 0.0;
        *out = MarramOutput{};
        out->kind = MARRAM_CURVES;
        out->curve_count = instance.roots.size();
        out->cvs_per_curve = uint32_t(instance.groom.cvs);
        out->patch_count = instance.patch_count();
        out->time_count = instance.time_count;
        out->basis = instance.groom.basis;
        out->shape = instance.groom.shape;
        instance.begun = true;
        return MARRAM_OK;
    });
}

void check_patch(const GroomInstance& instance, uint32_t index) {
    if (!instance.begun) throw SceneFault("", "no frame has begun: call begin first");
    if (index >= instance.patch_count())
        throw SceneFault("", "there is no patch " + std::to_string(index) + ": ask for 0 to " +
                                 std::to_string(int64_t(instance.patch_count()) - 1));
}

void check_buffers(const GroomInstance& instance, const MarramPatchBuffers* buffers) {
    bool there = buffers && buffers->vertices &&
                 (buffers->attribute_count == 0 || (buffers->attributes && buffers->attribute_values));
    for (uint32_t t = 0; there && t < instance.time_count; ++t) there = buffers->vertices[t] != nullptr;
    if (there && instance.groom.shape == MARRAM_ORIENTED_RIBBON) {
        there = buffers->normals != nullptr;
        for (uint32_t t = 0; there && t < instance.time_count; ++t) there = buffers->normals[t] != nullptr;
    }
    for (uint32_t a = 0; there && a < buffers->attribute_count; ++a) {
        if (buffers->attributes[a] >= attributes.size())
            throw SceneFault("", "there is no attribute " + std::to_string(buffers->attributes[a]) +
                                     ": ask for 0 to " + std::to_string(attributes.size() - 1));
        there = buffers->attribute_values[a] != nullptr;
    }
    if (!there)
        throw SceneFault(
            "", "a buffer is NULL: give vertices for each motion sample, normals for oriented ribbons, and "
                "values for each attribute that is asked for");
}

void find_bounds(const GroomInstance& instance, uint32_t index, MarramPatch* out) {
    const std::span<const Root> roots = instance.patch_roots(index);
    out->first_curve = uint64_t(roots.data() - instance.roots.data());
    out->curve_count = uint32_t(roots.size());
    Vec3d lower = Vec3d::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
    const uint32_t poses = std::min(instance.time_count, instance.mesh->time_count);
    for (uint32_t time = 0; time < poses; ++time) {
        const Surface now = instance.poses(time).now;
        for (const Root root : roots) {
            const Vec3d p = now.point(root.triangle, root_weights(instance.groom.seed, root));
            lower = lower.cwiseMin(p);
            upper = upper.cwiseMax(p);
        }
    }
    const double reach =
        reach_from_root(instance, std::max(lower.cwiseAbs().maxCoeff(), upper.cwiseAbs().maxCoeff()));
    for (int axis = 0; axis < 3; ++axis) {
        out->lower[axis] = float(lower[axis] - reach);
        out->upper[axis] = float(upper[axis] + reach);
    }
}

MarramStatus patch(MarramInstance* opaque, uint32_t index, MarramPatch* out) {
    const GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        if (!out) throw SceneFault("", "the patch is NULL: give room for it");
        check_patch(instance, index);
        find_bounds(instance, index, out);
        return MARRAM_OK;
    });
}

// One motion sample of a patch: CVs with the phantoms at both ends, four floats each.
void write_vertices(const GroomInstance& instance, std::span<const Root> roots, const Strands& strands,
                    float* out) {
    const int cvs = strands.cvs;
    const std::vector<float>& profile = instance.width_profile;
    for (size_t i = 0; i < roots.size(); ++i) {
        const Wide3f* pose = strands.pose.data() + (i / lanes) * size_t(cvs);
        const auto lane = int(i % lanes);
        const auto width = float(strand_width(instance.groom, roots[i]));
        float* strand = out + i * size_t(cvs + 2) * 4;
        for (int k = 0; k < cvs; ++k) {
            float* v = strand + 4 * (k + 1);
            v[0] = pose[k].x[lane];
            v[1] = pose[k].y[lane];
            v[2] = pose[k].z[lane];
            v[3] = width * profile[size_t(k)];
        }
        float* tip = strand + 4 * (cvs + 1);
        for (int c = 0; c < 4; ++c) {
            strand[c] = 2.0F * strand[4 + c] - strand[8 + c];
            tip[c] = 2.0F * tip[c - 4] - tip[c - 8];
        }
    }
}

void write_normals(const Strands& strands, size_t count, float* out) {
    const int cvs = strands.cvs;
    for (size_t i = 0; i < count; ++i) {
        const Wide3f* normal = strands.pose_normal.data() + (i / lanes) * size_t(cvs);
        const auto lane = int(i % lanes);
        float* strand = out + i * size_t(cvs + 2) * 3;
        for (int k = 0; k < cvs + 2; ++k) {
            const Wide3f& n = normal[std::clamp(k - 1, 0, cvs - 1)];
            strand[3 * k] = n.x[lane];
            strand[3 * k + 1] = n.y[lane];
            strand[3 * k + 2] = n.z[lane];
        }
    }
}

void write_attribute(const GroomInstance& instance, std::span<const Root> roots, const Strands& strands,
                     uint32_t which, float* out) {
    const GrowthPoses poses = instance.poses(0);
    for (size_t i = 0; i < roots.size(); ++i) {
        const Vec3d weights = root_weights(instance.groom.seed, roots[i]);
        if (which == root_normal) {
            const Vec3d n = frame_at(poses.now, roots[i].triangle, weights).normal;
            for (int axis = 0; axis < 3; ++axis) out[3 * i + size_t(axis)] = float(n[axis]);
        } else if (which == root_uv) {
            const Vec2d uv = poses.now.uv(roots[i].triangle, weights);
            out[2 * i] = float(uv.x());
            out[2 * i + 1] = float(uv.y());
        } else if (which == id) {
            out[i] = float(root_hash(instance.groom.seed, roots[i], Purpose::id) >> 40);
        } else if (which == envelope || which == gust || which == sheltered) {
            const WideVector<VFloat>& values = which == envelope ? strands.envelope
                                               : which == gust   ? strands.gust
                                                                 : strands.shield;
            const VFloat* e = values.data() + (i / lanes) * size_t(strands.cvs);
            for (int k = 0; k < strands.cvs; ++k)
                out[i * size_t(strands.cvs) + size_t(k)] = e[k][int(i % lanes)];
        }
    }
}

Expand expand_of(const GroomInstance& instance, std::span<const Root> roots, StageClock& clock) {
    return {[&instance, roots, &clock](uint32_t time, Strands& strands) {
                const StageTimer timer(clock.expand);
                expand(instance.groom, instance.wind, instance.poses(time), roots, strands);
            },
            [&instance, roots](int64_t knot, Strands& strands) { // on the jiggle's clock
                const GrowthPoses then{instance.poses(0).bind, instance.past.at(knot, *instance.mesh)};
                expand(instance.groom, instance.wind, then, roots, strands);
            }};
}

MarramStatus tessellate(MarramInstance* opaque, uint32_t index, const MarramPatchBuffers* buffers) {
    GroomInstance& instance = self(opaque);
    if (instance.host.cancelled(instance.host.user)) return MARRAM_CANCELLED;
    return guarded(instance.host, [&] {
        check_patch(instance, index);
        check_buffers(instance, buffers);
        Worker& worker = instance.workers.local();
        const std::span<const Root> roots = instance.patch_roots(index);
        Strands& strands = worker.strands;
        strands.resize(int(roots.size()), instance.groom.cvs, instance.groom.shape == MARRAM_ORIENTED_RIBBON);
        const Expand lay_out = expand_of(instance, roots, worker.chain.clock);
        if (instance.past.window.count() > 0) jiggle_patch(instance.chain, lay_out, strands, worker.chain);
        for (uint32_t time = 0; time < instance.time_count; ++time) {
            // Later motion samples of a resting mesh share its rest strands.
            if (time < instance.mesh->time_count) lay_out.at_time(time, strands);
            run_chain(instance.chain, time, strands, worker.chain);
            const StageTimer timer(worker.chain.clock.write);
            write_vertices(instance, roots, strands, buffers->vertices[time]);
            if (strands.oriented) write_normals(strands, roots.size(), buffers->normals[time]);
            if (time > 0) continue;
            for (uint32_t a = 0; a < buffers->attribute_count; ++a)
                write_attribute(instance, roots, strands, buffers->attributes[a],
                                buffers->attribute_values[a]);
        }
        return MARRAM_OK;
    });
}

MarramStatus mesh(MarramInstance* opaque, const MarramMeshBuffers*) {
    const GroomInstance& instance = self(opaque);
    instance.host.message(instance.host.user, MARRAM_FAULT, "",
                          "a groom makes curves: call tessellate, not mesh");
    return MARRAM_ERROR;
}

// What collision could not do is never hidden.
void tell_of_collisions(const GroomInstance& instance, const CollisionCounts& counts) {
    const auto warn = [&](uint64_t count, const std::string& text) {
        if (count > 0)
            instance.host.message(instance.host.user, MARRAM_WARNING, instance.groom.mesh_place.c_str(),
                                  (std::to_string(count) + text).c_str());
    };
    const std::string of = instance.time_count > 1 ? " (all motion samples together)" : "";
    warn(counts.unresolved,
         " segments or roots have no free direction" + of +
             " and keep the least bad: raise wind.collision.offset_root, or let less stand around them");
    warn(counts.dips,
         " drawn strands dip into a mesh by more than the tolerance" + of +
             ": their roots stand nearer to it than they are thick, or it is too narrow for them");
}

void report(MarramInstance* opaque, void (*sink)(void*, const char*, double), void* user) {
    GroomInstance& instance = self(opaque);
    StageClock sum;
    CollisionCounts counts;
    size_t scratch = 0;
    for (const Worker& worker : instance.workers) {
        sum += worker.chain.clock;
        counts += worker.chain.counts;
        scratch += worker.strands.bytes() + worker.chain.past.bytes();
        for (const auto& pose : worker.chain.jiggled) scratch += pose.capacity() * sizeof(Wide3f);
    }
    tell_of_collisions(instance, counts);
    const Wind& wind = instance.wind;
    if (instance.left_open.cvs) sink(user, "chosen.cvs", instance.groom.cvs);
    if (instance.left_open.rays) sink(user, "chosen.shield_rays", wind.shielding->rays);
    if (instance.left_open.step && instance.past.window.count() > 0)
        sink(user, "chosen.jiggle_step", wind.jiggle->step);
    if (wind.noise.left_out > 0) sink(user, "chosen.octaves", wind.noise.octaves - wind.noise.left_out);
    sink(user, "seconds.roots", instance.placing_seconds);
    sink(user, "seconds.chain", instance.chain_seconds);
    sink(user, "thread_seconds.expand", sum.expand + sum.write);
    sink(user, "thread_seconds.gusts", sum.gusts);
    sink(user, "thread_seconds.shield", sum.shield);
    sink(user, "thread_seconds.jiggle", sum.jiggle);
    sink(user, "thread_seconds.bend", sum.bend);
    sink(user, "thread_seconds.collide", sum.collide);
    sink(user, "collision.contacts", double(counts.contacts));
    sink(user, "collision.pushed_out", double(counts.pushed_out));
    sink(user, "collision.unresolved", double(counts.unresolved));
    sink(user, "collision.skipped_pushes", double(counts.skipped_pushes));
    sink(user, "collision.dips", double(counts.dips));
    sink(user, "collision.goal_angle", counts.goal_angle);
    sink(user, "collision.turned_angle", counts.turned_angle);
    // The most that was there at any time: candidates come and go before there is scratch.
    const size_t lasting = instance.roots.capacity() * sizeof(Root) + instance.bind_positions.capacity() * 4 +
                           instance.past.bytes() + instance.trees.bytes() + instance.chain.gust_bytes() +
                           scratch;
    sink(user, "memory.bytes", double(std::max(lasting, instance.placing_bytes)));
}

void destroy(MarramInstance* opaque) { delete reinterpret_cast<GroomInstance*>(opaque); } // NULL is fine

} // namespace

MarramProcedural groom_procedural() {
    MarramProcedural procedural{};
    procedural.name = "groom";
    procedural.help = "hair, fur or grass that grows on a mesh and bends in the scene's wind";
    procedural.kind = MARRAM_CURVES;
    procedural.params = all_params().data();
    procedural.param_count = uint32_t(all_params().size());
    procedural.attributes = attributes.data();
    procedural.attribute_count = uint32_t(attributes.size());
    procedural.create = create;
    procedural.begin = begin;
    procedural.patch = patch;
    procedural.tessellate = tessellate;
    procedural.mesh = mesh;
    procedural.report = report;
    procedural.destroy = destroy;
    return procedural;
}

} // namespace marram
