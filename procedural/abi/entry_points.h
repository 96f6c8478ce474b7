// SPDX-License-Identifier: Apache-2.0
// The C entry points of a procedural, made from a class. What any procedural needs of the host is checked
// here; a class checks what only it needs, such as MarramFrame.pose_curves. It throws SceneFault with what is
// wrong, and Cancelled where the host has asked it to stop. No exception crosses the C interface.
//
// The class derives from Instance and has the members
//     static constexpr const char *name, *help;  // `name`: the type in scene files
//     static constexpr const char* memory_remedy;         // the remedy if memory runs out
//     static params();                           // its MarramParam
//     static report_entries();                   // its MarramReportEntry
//     void take(std::span<const MarramValue>);   // stores checked values, or throws and changes nothing
//     uint32_t update(std::span<const MarramValue>, uint32_t inputs); // takes others; returns a MarramChange
//     MarramOutput begin(LentFrame);             // the frame's output
//     void report(const ReportSink&);            // statistics since begin
// and, for its MarramAttribute, one or both of
//     static type_attributes();                  // those of every instance
//     attribute_list() const;                    // all of this instance, if its values add some
// Curves:
//     uint32_t patch_count() const, time_count; bool oriented() const; // of the output
//     MarramPatch patch(uint32_t index) const;   // its bounds
//     void tessellate(uint32_t index, const MarramPatchBuffers&); // from any thread
// Meshes:
//     void mesh(MarramMeshBuffers&);
// If it has them:
//     static item_types();                       // MarramItemType of list elements
//     bool prepares() const; void prepare(const LentFrame&, const MarramStates*); // simulates up to the frame
//     MarramOutput begin_view(const MarramView&); bool view_begun() const; void view_mesh(MarramMeshBuffers&);
//     std::vector<std::string> described() const; // as MarramProcedural.describe
//     std::string summary() const;               // as MarramProcedural.summarize
//     std::vector<GustSphere> random_gusts() const; // as MarramProcedural.gusts
//     std::vector<AirSample> air_at(std::span<const double> points) const; // as MarramProcedural.air
//     std::vector<ShelterRay> shelter_rays(std::span<const double> cvs, const double* root_normal) const;
#pragma once

#include "procedural/abi/border.h"

#include <cmath>

namespace marram {

template <typename P>
concept HasItems = requires {
    P::item_types();
};
template <typename P>
concept HasTypeAttributes = requires {
    P::type_attributes();
};

// What the static members of P declare, without functions.
template <typename P>
MarramProcedural declared(MarramOutputKind kind) {
    MarramProcedural procedural{};
    procedural.name = P::name;
    procedural.help = P::help;
    procedural.kind = kind;
    procedural.params = P::params().data();
    procedural.param_count = uint32_t(P::params().size());
    procedural.param_stride = sizeof(MarramParam);
    procedural.attribute_stride = sizeof(MarramAttribute);
    if constexpr (HasTypeAttributes<P>) {
        procedural.attributes = P::type_attributes().data();
        procedural.attribute_count = uint32_t(P::type_attributes().size());
    }
    if constexpr (HasItems<P>) {
        procedural.item_types = P::item_types().data();
        procedural.item_type_count = uint32_t(P::item_types().size());
        procedural.item_type_stride = sizeof(MarramItemType);
    }
    return procedural;
}

template <typename P>
class EntryPoints {
    static constexpr bool is_curves = requires(P & p) { p.patch_count(); };
    static constexpr bool has_attribute_list = requires(const P& p) { p.attribute_list(); };

  public:
    using Declaration = P;
    static MarramProcedural table() {
        MarramProcedural procedural = declared<P>(is_curves ? MARRAM_CURVES : MARRAM_MESH);
        procedural.create = create;
        procedural.update = update;
        procedural.begin = begin;
        procedural.report = report;
        procedural.destroy = destroy;
        if constexpr (has_attribute_list) procedural.attributes_of = attributes_of;
        if constexpr (is_curves) {
            procedural.patch = patch;
            procedural.tessellate = tessellate;
        } else {
            procedural.mesh = mesh;
        }
        if constexpr (requires(P & p) { p.prepares(); }) procedural.prepare = prepare;
        if constexpr (requires(P & p, const MarramView& view) { p.begin_view(view); }) {
            procedural.begin_view = begin_view;
            procedural.view_mesh = view_mesh;
        }
        if constexpr (requires(const P& p) { p.described(); }) procedural.describe = describe;
        if constexpr (requires(const P& p) { p.summary(); }) procedural.summarize = summarize;
        if constexpr (requires(const P& p) { p.random_gusts(); }) procedural.gusts = gusts;
        if constexpr (requires(const P& p) { p.air_at({}); }) procedural.air = air;
        if constexpr (requires(const P& p) { p.shelter_rays({}, nullptr); })
            procedural.shelter_rays = shelter_rays;
        return procedural;
    }

  private:
    static P& instance_of(MarramInstance* opaque) { return *reinterpret_cast<P*>(opaque); }

    // Runs the body of a call on an instance. Without one there is no host to report to.
    template <typename Body>
    static MarramStatus call(MarramInstance* opaque, Body&& body) {
        if (!opaque) return MARRAM_ERROR;
        P& instance = instance_of(opaque);
        return guarded(instance.host, P::name, P::memory_remedy, [&] { body(instance); });
    }

    static std::vector<MarramValue> checked_values(const MarramHost& host, const MarramValues* values) {
        if constexpr (HasItems<P>)
            return marram::checked_values(host, values, P::params(), P::item_types());
        else
            return marram::checked_values(host, values, P::params(), {});
    }

    static size_t attribute_count(const P& instance) {
        if constexpr (has_attribute_list)
            return instance.attribute_list().size();
        else
            return P::type_attributes().size();
    }

    static void check_begun(const P& instance) {
        if (!instance.begun)
            throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
    }

    static MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
        if (!can_create(host, out)) return MARRAM_ERROR;
        const MarramHost known = known_part(host);
        return guarded(known, P::name, P::memory_remedy, [&] {
            const std::vector<MarramValue> list = checked_values(known, values);
            auto instance = std::make_unique<P>();
            instance->host = known;
            instance->take(list);
            *out = reinterpret_cast<MarramInstance*>(instance.release());
        });
    }

    static MarramStatus update(MarramInstance* opaque, const MarramUpdate* given, uint32_t* changed) {
        return call(opaque, [&](P& instance) {
            if (!given || !changed)
                throw SceneFault("contract.null_update", "", "the update is NULL",
                                 "pass an update and a place for the changes");
            const MarramUpdate known = known_part(given);
            const std::vector<MarramValue> list = checked_values(instance.host, known.values);
            *changed = instance.update(list, known.inputs);
        });
    }

    static MarramStatus attributes_of(MarramInstance* opaque, MarramAttributeList* out) {
        return call(opaque, [&](P& instance) {
            if (!out)
                throw SceneFault("contract.null_list", "", "the list is NULL", "pass a non-NULL pointer");
            const std::span<const MarramAttribute> attributes = instance.attribute_list();
            const MarramAttributeList list{sizeof(MarramAttributeList), attributes.data(),
                                           uint32_t(attributes.size()), sizeof(MarramAttribute)};
            fill_known_part(list, out);
        });
    }

    static MarramStatus prepare(MarramInstance* opaque, const MarramFrame* frame,
                                const MarramStates* states) {
        return call(opaque, [&](P& instance) {
            if (!instance.prepares()) return;
            instance.begun = false; // until begin() has seen what the simulation changes
            if (!states) return instance.prepare(lent_frame(frame), nullptr);
            const MarramStates known = known_part(states);
            if (!known.load || !known.store)
                throw SceneFault("contract.null_states", "", "the states are NULL",
                                 "pass functions that load and store");
            instance.prepare(lent_frame(frame), &known);
        });
    }

    static MarramStatus begin(MarramInstance* opaque, const MarramFrame* frame, MarramOutput* out) {
        return call(opaque, [&](P& instance) {
            instance.begun = false;
            if (!out)
                throw SceneFault("contract.null_output", "", "the output is NULL", "pass a non-NULL pointer");
            fill_known_part(instance.begin(lent_frame(frame)), out);
            instance.begun = true;
        });
    }

    static void check_patch(const P& instance, uint32_t index) {
        check_begun(instance);
        if (index >= instance.patch_count())
            throw SceneFault("contract.patch_range", "", "there is no patch " + std::to_string(index),
                             "ask for one below MarramOutput.patch_count, " +
                                 std::to_string(instance.patch_count()));
    }

    static MarramStatus patch(MarramInstance* opaque, uint32_t index, MarramPatch* out) {
        return call(opaque, [&](const P& instance) {
            if (!out)
                throw SceneFault("contract.null_patch", "", "the patch is NULL", "pass a non-NULL pointer");
            check_patch(instance, index);
            fill_known_part(instance.patch(index), out);
        });
    }

    static MarramStatus tessellate(MarramInstance* opaque, uint32_t index,
                                   const MarramPatchBuffers* buffers) {
        return call(opaque, [&](P& instance) {
            instance.stop_if_cancelled();
            check_patch(instance, index);
            check_patch_buffers(buffers, instance.time_count, instance.oriented(), attribute_count(instance));
            instance.tessellate(index, *buffers);
        });
    }

    static MarramStatus mesh(MarramInstance* opaque, MarramMeshBuffers* buffers) {
        return call(opaque, [&](P& instance) {
            check_begun(instance);
            check_mesh_buffers(buffers, attribute_count(instance));
            instance.mesh(*buffers);
        });
    }

    static MarramStatus begin_view(MarramInstance* opaque, const MarramView* given, MarramOutput* out) {
        return call(opaque, [&](P& instance) {
            if (!given || !out)
                throw SceneFault("contract.null_view", "", "the view or the output is NULL", "pass both");
            check_begun(instance);
            fill_known_part(instance.begin_view(checked_view(given)), out);
        });
    }

    static MarramStatus view_mesh(MarramInstance* opaque, MarramMeshBuffers* buffers) {
        return call(opaque, [&](P& instance) {
            if (!instance.begun || !instance.view_begun())
                throw SceneFault("contract.no_view", "", "no view has begun", "call begin_view first");
            check_mesh_buffers(buffers, attribute_count(instance));
            instance.view_mesh(*buffers);
        });
    }

    // A report that fails sends its message, and nothing else.
    static void report(MarramInstance* opaque, void (*sink)(void*, const char*, double), void* user) {
        if (!sink) return;
        call(opaque, [&](P& instance) {
            if (instance.begun) instance.report(ReportSink{sink, user});
        });
    }

    template <typename Sink, typename Text>
    static MarramStatus say(MarramInstance* opaque, Sink* sink, const Text& text) {
        return call(opaque, [&](const P& instance) {
            if (!sink) throw SceneFault("contract.null_sink", "", "the sink is NULL", "pass a function");
            check_begun(instance);
            text(instance);
        });
    }

    static MarramStatus describe(MarramInstance* opaque, void (*sink)(void*, const char*), void* user) {
        return say(opaque, sink, [&](const P& instance) {
            for (const std::string& text : instance.described()) sink(user, text.c_str());
        });
    }

    static MarramStatus summarize(MarramInstance* opaque, void (*sink)(void*, const char*), void* user) {
        return say(opaque, sink, [&](const P& instance) { sink(user, instance.summary().c_str()); });
    }

    static MarramStatus gusts(MarramInstance* opaque, void (*sink)(void*, const double*, double, double),
                              void* user) {
        return say(opaque, sink, [&](const P& instance) {
            for (const auto& gust : instance.random_gusts())
                sink(user, gust.center.data(), gust.radius, gust.strength);
        });
    }

    static void check_points(const double* points, uint64_t count) {
        if (!points && count > 0)
            throw SceneFault("contract.null_points", "", "the points are NULL",
                             "pass three numbers for each");
        constexpr double far = 1e9; // m
        for (uint64_t i = 0; i < 3 * count; ++i)
            if (!(std::abs(points[i]) < far))
                throw SceneFault("contract.far_point", "", "a point is not finite, or 1e9 m away",
                                 "leave it out");
    }

    static MarramStatus air(MarramInstance* opaque, uint64_t count, const double* points,
                            void (*sink)(void*, const double*, const double*, double), void* user) {
        return say(opaque, sink, [&](const P& instance) {
            check_points(points, count);
            for (const auto& one : instance.air_at({points, size_t(count) * 3}))
                sink(user, one.velocity.data(), one.noise.data(), one.share);
        });
    }

    static MarramStatus shelter_rays(MarramInstance* opaque, uint32_t cv_count, const double* cvs,
                                     const double* root_normal,
                                     void (*sink)(void*, uint32_t, const double*, const double*, double),
                                     void* user) {
        return say(opaque, sink, [&](const P& instance) {
            check_points(cvs, cv_count);
            check_points(root_normal, 1);
            for (const auto& ray : instance.shelter_rays({cvs, size_t(cv_count) * 3}, root_normal)) {
                const Vec3d from = ray.from.template cast<double>(), to = ray.to.template cast<double>();
                sink(user, ray.cv, from.data(), to.data(), double(ray.shelter));
            }
        });
    }

    static void destroy(MarramInstance* opaque) { delete reinterpret_cast<P*>(opaque); } // NULL is fine
};

} // namespace marram
