// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/groom.h"

#include "core/math/clock.h"
#include "procedural/contract_checks.h"

#include "procedural/groom/groom_bounds.h"
#include "procedural/groom/groom_instance.h"
#include "procedural/groom/groom_output.h"
#include "procedural/groom/groom_settings.h"
#include "procedural/groom/groom_warnings.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <new>
#include <optional>
#include <string>

namespace marram {
namespace {

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
        instance->automatic.cvs = instance->groom.cvs == 0;
        instance->automatic.rays = instance->wind.shielding && instance->wind.shielding->spread > 0.0 &&
                                   instance->wind.shielding->rays == 0;
        instance->automatic.step = instance->wind.jiggle && instance->wind.jiggle->step == 0.0;
        // A turn belongs to a segment of the strand as it is authored: where that is not said, of one of eight CVs.
        constexpr int segments = 7;
        if (instance->automatic.cvs && instance->wind.reference_segments == 0)
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
        if (const MarramStatus status = choose_settings(instance); status != MARRAM_OK) return status;
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
        instance.chain = make_chain_frame(
            {instance.wind, instance.groom.envelope, instance.frame, *instance.mesh, instance.width_profile,
             instance.groom.basis, instance.past.window,
             instance.wind.collision ? bounds_of_strands(instance) : everywhere(),
             instance.wind.gusts ? bounds_at_rest(instance) : everywhere(), &instance.trees});
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
        if (buffers->attributes[a] >= groom_attributes().size())
            throw SceneFault("", "there is no attribute " + std::to_string(buffers->attributes[a]) +
                                     ": ask for 0 to " + std::to_string(groom_attributes().size() - 1));
        there = buffers->attribute_values[a] != nullptr;
    }
    if (!there)
        throw SceneFault(
            "", "a buffer is NULL: give vertices for each motion sample, normals for oriented ribbons, and "
                "values for each attribute that is asked for");
}

MarramStatus patch(MarramInstance* opaque, uint32_t index, MarramPatch* out) {
    const GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        if (!out) throw SceneFault("", "the patch is NULL: give room for it");
        check_patch(instance, index);
        find_patch(instance, index, out);
        return MARRAM_OK;
    });
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
    warn_of_collisions(instance, counts);
    const Wind& wind = instance.wind;
    if (instance.automatic.cvs) sink(user, "chosen.cvs", instance.groom.cvs);
    if (instance.automatic.rays) sink(user, "chosen.shield_rays", wind.shielding->rays);
    if (instance.automatic.step && instance.past.window.count() > 0)
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
    procedural.attributes = groom_attributes().data();
    procedural.attribute_count = uint32_t(groom_attributes().size());
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
