// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/groom_output.h"

#include <algorithm>
#include <array>

namespace marram {
namespace {

constexpr std::array attributes = {
    MarramAttribute{"root_normal", 3, MARRAM_PER_CURVE, 0, "surface normal at the root", nullptr, 0},
    MarramAttribute{"root_uv", 2, MARRAM_PER_CURVE, 0, "surface uv at the root", nullptr, 0},
    MarramAttribute{
        "id", 1, MARRAM_PER_CURVE, 1,
        "a number below 2^24 that identifies the strand and does not change when other strands do", nullptr,
        0},
    MarramAttribute{"envelope", 1, MARRAM_PER_CV, 0, "share of the wind that reaches a CV", nullptr, 0},
    MarramAttribute{"gust", 1, MARRAM_PER_CV, 0, "sum of the gusts at a CV; 1: the full strength of one gust",
                    nullptr, 0},
    MarramAttribute{"shield", 1, MARRAM_PER_CV, 0,
                    "sheltered share of a CV, or of its strand (see wind.shielding)", nullptr, 0},
    MarramAttribute{"contact", 1, MARRAM_PER_CV, 1, contact_help, nullptr, 0},
};
enum AttributeIndex : uint32_t { root_normal, root_uv, id, envelope, gust, sheltered, touched };

} // namespace

std::span<const MarramAttribute> groom_attributes() { return attributes; }

bool asks_for_contact(const MarramPatchBuffers& buffers) {
    return std::ranges::count(std::span(buffers.attributes, buffers.attribute_count), touched) > 0;
}

void write_vertices(const GroomInstance& instance, const GroomPatch& patch, const Strands& strands,
                    float* out) {
    const int cvs = strands.cvs;
    const std::vector<float>& profile = instance.radius_profile;
    for (size_t i = 0; i < patch.roots.size(); ++i) {
        const Wide3f* pose = strands.pose.data() + (i / lanes) * size_t(cvs);
        const auto lane = int(i % lanes);
        const float factor = patch.width_factors.empty() ? 1.0F : patch.width_factors[i];
        const float width = factor * float(strands.width[i / lanes][lane]);
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

void write_attribute(const GroomInstance& instance, const GroomPatch& patch, const Strands& strands,
                     uint32_t which, float* out) {
    const SkinPoses poses = instance.poses(0);
    const std::span<const Root> roots = patch.roots;
    // Of blades: the speed at a CV over that of the wind.
    const double strongest = instance.groom.blade ? wind_response(instance.wind) : 0.0;
    const float scale = strongest > 0.0 ? float(1.0 / strongest) : 1.0F;
    const Eigen::Matrix3d linear = patch.mesh_instance.transform(0).linear();
    for (size_t i = 0; i < roots.size(); ++i) {
        const Vec3d weights = root_weights(instance.groom.seed, roots[i]);
        if (which == root_normal) {
            Vec3d n = frame_at(poses.now, roots[i].triangle, weights).normal;
            if (patch.mesh_instance.is_instance) n = (linear * n).normalized();
            for (int axis = 0; axis < 3; ++axis) out[3 * i + size_t(axis)] = float(n[axis]);
        } else if (which == root_uv) {
            const Vec2d uv = poses.now.uv(roots[i].triangle, weights);
            out[2 * i] = float(uv.x());
            out[2 * i + 1] = float(uv.y());
        } else if (which == id) {
            out[i] = float(root_hash(instance.groom.seed, roots[i], Purpose::id) >> 40);
        } else {
            const WideVector<VFloat>& values = which == envelope    ? strands.envelope
                                               : which == gust      ? strands.gust
                                               : which == sheltered ? strands.shield
                                                                    : strands.contact;
            const VFloat* e = values.data() + (i / lanes) * size_t(strands.cvs);
            for (int k = 0; k < strands.cvs; ++k)
                out[i * size_t(strands.cvs) + size_t(k)] =
                    which == envelope ? std::min(e[k][int(i % lanes)] * scale, 1.0F) : e[k][int(i % lanes)];
        }
    }
}

} // namespace marram
