// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/imported/imported_output.h"

#include "procedural/abi/border.h"
#include "procedural/strands/imported/imported_shape.h"

#include <algorithm>
#include <array>

namespace marram {
namespace {

enum ImportAttribute : uint32_t {
    import_root_normal,
    import_root_uv,
    import_id,
    import_envelope,
    import_gust,
    import_sheltered,
    import_contact,
    import_attribute_count
};

constexpr std::array computed_attribute_list = {
    MarramAttribute{"root_normal", 3, MARRAM_PER_CURVE, 0, "surface normal at the root", nullptr, 0},
    MarramAttribute{"root_uv", 2, MARRAM_PER_CURVE, 0, "surface uv at the root", nullptr, 0},
    MarramAttribute{"id", 1, MARRAM_PER_CURVE, 1, "a number below 2^24 of the strand", nullptr, 0},
    MarramAttribute{"envelope", 1, MARRAM_PER_CV, 0, "share of the wind that reaches a CV", nullptr, 0},
    MarramAttribute{"gust", 1, MARRAM_PER_CV, 0, "sum of the gusts at a CV; 1: the full strength of one gust",
                    nullptr, 0},
    MarramAttribute{"shield", 1, MARRAM_PER_CV, 0,
                    "sheltered share of a CV, or of its strand (see wind.shielding)", nullptr, 0},
    MarramAttribute{"contact", 1, MARRAM_PER_CV, 1, contact_help, nullptr, 0},
};
static_assert(computed_attribute_list.size() == import_attribute_count);

// True if the attribute comes from the file: "id" if the file has one, root_normal and root_uv only without a
// mesh. The attributes of the wind are always computed.
bool from_file(const ImportSettings& settings, const MarramAttribute& computed) {
    const std::string_view name = computed.name;
    const bool of_surface = name == "root_normal" || name == "root_uv";
    if (name != "id" && !(of_surface && settings.mesh.empty())) return false;
    return std::ranges::any_of(settings.passed_attributes, [&](const PassedAttribute& a) {
        return a.name == name && a.components == computed.components && a.rate == computed.rate;
    });
}

constexpr uint32_t id_salt = 0x69647321U;

float id_of(uint32_t seed, uint64_t curve) {
    return float(mix64(curve * 0x9e3779b97f4a7c15ULL ^ mix64((uint64_t(seed) << 32) | id_salt)) >> 40);
}

// True for root_uv if the mesh has no uvs but the file has this attribute.
bool uv_only_in_file(const ImportInstance& instance, uint32_t computed) {
    if (computed != import_root_uv || !instance.mesh || instance.mesh->uvs) return false;
    const MarramAttribute* found = instance.curves.find(computed_attribute_list[computed].name);
    return found && found->components == 2 && found->rate == MARRAM_PER_CURVE;
}

void write_computed_attribute(const ImportBatch& batch, const Strands& strands, uint32_t which, float* out) {
    const ImportInstance& instance = batch.instance;
    const auto cvs = size_t(batch.cvs);
    for (size_t i = 0; i < batch.curves.size(); ++i) {
        const uint32_t c = batch.curves[i];
        const uint64_t curve = batch.patch.first + c;
        const auto lane = int(i % lanes);
        if (which == import_root_normal) {
            const Wide3d& n = strands.root_normal[i / lanes];
            out[3 * size_t(c)] = float(n.x[lane]);
            out[3 * size_t(c) + 1] = float(n.y[lane]);
            out[3 * size_t(c) + 2] = float(n.z[lane]);
        } else if (which == import_root_uv) {
            const RootBinding& root_binding = instance.binding.root_bindings[curve];
            const Vec2d uv = instance.bind_surface().uv(root_binding.triangle, root_binding.weights);
            out[2 * size_t(c)] = float(uv.x());
            out[2 * size_t(c) + 1] = float(uv.y());
        } else if (which == import_id) {
            out[c] = id_of(instance.settings.seed, curve);
        } else {
            const WideVector<VFloat>& from = which == import_envelope    ? strands.envelope
                                             : which == import_gust      ? strands.gust
                                             : which == import_sheltered ? strands.shield
                                                                         : strands.contact;
            float* to = out + batch.cv(c);
            for (size_t k = 0; k < cvs; ++k) to[k] = from[i / lanes * cvs + k][lane];
        }
    }
}

// Copies an attribute of the file; 0 if these curves do not have it.
void write_passed_attribute(const ImportInstance& instance, const ImportPatch& patch,
                            const MarramAttribute& declared, float* out) {
    const LentCurves& lent = instance.curves;
    const MarramAttribute* found = lent.find(declared.name);
    const bool per_cv = declared.rate == MARRAM_PER_CV;
    const uint64_t first = per_cv ? lent.first_cv(patch.first) : patch.first;
    const uint64_t count = per_cv ? lent.first_cv(patch.first + patch.count) - first : patch.count;
    const size_t n = declared.components;
    if (found && found->components == n && found->rate == declared.rate)
        std::copy_n(found->values + first * n, count * n, out);
    else
        std::fill_n(out, count * n, 0.0F);
}

} // namespace

std::span<const MarramAttribute> computed_attributes() { return computed_attribute_list; }

std::vector<MarramAttribute> import_attribute_list(const ImportSettings& settings) {
    std::vector<MarramAttribute> list;
    for (const MarramAttribute& computed : computed_attribute_list) {
        const bool of_surface =
            std::string_view(computed.name) == "root_normal" || std::string_view(computed.name) == "root_uv";
        if (!(of_surface && settings.mesh.empty()) && !from_file(settings, computed))
            list.push_back(computed);
    }
    for (const PassedAttribute& a : settings.passed_attributes)
        if (std::ranges::none_of(list, [&](const MarramAttribute& other) { return a.name == other.name; }))
            list.push_back({a.name.c_str(), a.components, a.rate, a.discrete, "as in the file", nullptr, 0});
    return list;
}

RestStrandSource imported_rest_strands(const ImportBatch& batch, StageClock& clock) {
    const ImportInstance& instance = batch.instance;
    const auto first_float = 4 * instance.curves.first_vertex(batch.patch.first);
    const auto expand_on = [&instance, batch](const Surface* now, const float* vertices, Strands& strands) {
        if (!now)
            return expand_imported(instance, nullptr, vertices, batch.patch.first, batch.curves, batch.cvs,
                                   strands);
        const SkinPoses skin{instance.bind_surface(), *now};
        expand_imported(instance, &skin, vertices, batch.patch.first, batch.curves, batch.cvs, strands);
    };
    const auto take_to_instance = [&instance, batch](const Eigen::Affine3d& transform, Strands& strands) {
        transform_strands(batch.mesh_instance, transform, instance.wind.noise_at_bind_frame, strands);
    };
    const auto past_transform = [&instance, batch](int64_t past_sample) -> const Eigen::Affine3d& {
        return batch.mesh_instance.past_transform(size_t(past_sample - instance.past.window.first));
    };
    return {
        [&instance, batch, expand_on, take_to_instance, first_float, &clock](uint32_t time,
                                                                             Strands& strands) {
            const StageTimer timer(clock.expand);
            const bool moves = instance.curves.curves.moves != 0;
            const float* vertices = (moves ? instance.vertices(time) : instance.bind_pose()) + first_float;
            const Surface now = instance.mesh ? instance.surface(time) : Surface{};
            expand_on(instance.mesh ? &now : nullptr, vertices, strands);
            take_to_instance(batch.mesh_instance.transform(time), strands);
        },
        [&instance, batch, expand_on, take_to_instance, past_transform,
         first_float](int64_t past_sample, Strands& strands) { // timed as jiggle
            const MarramFrame& frame = instance.frame;
            std::vector<float> then;
            const float* vertices = instance.bind_pose() + first_float;
            if (instance.curves.curves.moves) {
                const ImportPatch& patch = batch.patch;
                then.resize(4 * (instance.curves.first_vertex(patch.first + patch.count)) - first_float);
                pose_lent_curves(frame, instance.curves.index, instance.wind.jiggle->frame_of(past_sample),
                                 patch.first, patch.count, then);
                vertices = then.data();
            }
            const Surface now = instance.mesh ? instance.past.at(past_sample, *instance.mesh) : Surface{};
            expand_on(instance.mesh ? &now : nullptr, vertices, strands);
            take_to_instance(past_transform(past_sample), strands);
        },
        [&instance, batch, expand_on, first_float](Strands& strands) {
            const Surface at_bind = instance.mesh ? instance.bind_surface() : Surface{};
            expand_on(instance.mesh ? &at_bind : nullptr, instance.bind_pose() + first_float, strands);
        },
        [&instance, past_transform](int64_t a, int64_t b) {
            return !instance.curves.curves.moves &&
                   (!instance.mesh || (instance.past.same_at(a, b) &&
                                       past_transform(a).matrix() == past_transform(b).matrix()));
        },
        (instance.mesh && instance.mesh->time_count > 1) || instance.curves.curves.time_count > 1 ||
            batch.mesh_instance.moves(),
        (instance.mesh && has_a_past(*instance.mesh)) || instance.curves.curves.moves != 0 ||
            batch.mesh_instance.moved()};
}

void write_import_vertices(const ImportBatch& batch, const Strands& strands, float* out) {
    const auto cvs = size_t(batch.cvs);
    for (size_t i = 0; i < batch.curves.size(); ++i) {
        const size_t first = i / lanes * cvs;
        const auto lane = int(i % lanes);
        float* strand = out + 4 * batch.vertex(batch.curves[i]);
        for (size_t k = 0; k < cvs; ++k) {
            const Wide3f& p = strands.pose[first + k];
            float* v = strand + 4 * (k + 1);
            v[0] = p.x[lane];
            v[1] = p.y[lane];
            v[2] = p.z[lane];
            v[3] = strands.radius[first + k][lane];
        }
        float* tip = strand + 4 * (cvs + 1);
        for (int c = 0; c < 4; ++c) {
            strand[c] = 2.0F * strand[4 + c] - strand[8 + c];
            tip[c] = 2.0F * tip[c - 4] - tip[c - 8];
        }
    }
}

void write_import_normals(const ImportBatch& batch, const Strands& strands, float* out) {
    const auto cvs = int(batch.cvs);
    for (size_t i = 0; i < batch.curves.size(); ++i) {
        const Wide3f* normal = strands.pose_normal.data() + i / lanes * size_t(cvs);
        const auto lane = int(i % lanes);
        float* strand = out + 3 * batch.vertex(batch.curves[i]);
        for (int k = 0; k < cvs + 2; ++k) {
            const Wide3f& n = normal[std::clamp(k - 1, 0, cvs - 1)];
            strand[3 * k] = n.x[lane];
            strand[3 * k + 1] = n.y[lane];
            strand[3 * k + 2] = n.z[lane];
        }
    }
}

void write_import_attributes(const ImportBatch& batch, const Strands& strands,
                             const MarramPatchBuffers& buffers) {
    const ImportInstance& instance = batch.instance;
    for (uint32_t a = 0; a < buffers.attribute_count; ++a) {
        const MarramAttribute& declared = instance.attributes[buffers.attributes[a]];
        for (uint32_t computed = 0; computed < import_attribute_count; ++computed)
            if (declared.name == computed_attribute_list[computed].name &&
                !uv_only_in_file(instance, computed)) // compares pointers to the same constant
                write_computed_attribute(batch, strands, computed, buffers.attribute_values[a]);
    }
}

bool asks_for_contact(const ImportInstance& instance, const MarramPatchBuffers& buffers) {
    return std::ranges::any_of(std::span(buffers.attributes, buffers.attribute_count), [&](uint32_t a) {
        return instance.attributes[a].name == computed_attribute_list[import_contact].name;
    });
}

void write_file_attributes(const ImportInstance& instance, const ImportPatch& patch,
                           const MarramPatchBuffers& buffers) {
    for (uint32_t a = 0; a < buffers.attribute_count; ++a) {
        const MarramAttribute& declared = instance.attributes[buffers.attributes[a]];
        bool is_computed = false;
        for (uint32_t computed = 0; computed < import_attribute_count; ++computed)
            is_computed = is_computed || (declared.name == computed_attribute_list[computed].name &&
                                          !uv_only_in_file(instance, computed));
        if (!is_computed) write_passed_attribute(instance, patch, declared, buffers.attribute_values[a]);
    }
}

} // namespace marram
