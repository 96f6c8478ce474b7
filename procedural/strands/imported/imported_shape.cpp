// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/imported/imported_shape.h"

#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

namespace marram {
namespace {

bool same_triangle(const Surface& a, const Surface& b, uint32_t triangle) {
    for (size_t i = 0; i < 3; ++i) {
        const size_t v = 3 * size_t(a.triangles[3 * size_t(triangle) + i]);
        for (size_t k = v; k < v + 3; ++k)
            if (a.positions[k] != b.positions[k] || (a.normals && b.normals && a.normals[k] != b.normals[k]))
                return false;
    }
    return true;
}

// Rigid transforms of eight strands from their file to their current place: p -> rotation (p - from) + to.
struct alignas(64) RigidTransform8 {
    VDouble rotation[3][3];
    Wide3d from, to;
};

void set_transform(RigidTransform8& transform, int lane, const Eigen::Matrix3d& rotation, const Vec3d& from,
                   const Vec3d& to) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) transform.rotation[i][j][lane] = rotation(i, j);
    set_lane(transform.from, lane, from);
    set_lane(transform.to, lane, to);
}

// Transforms the CVs of eight strands into SIMD lanes. `source`: pointers to their first CVs.
void transform_cvs(const RigidTransform8& transform, const float* const* source, int cvs, Wide3f* rest,
                   VFloat* radius, double width_scale) {
    for (int k = 0; k < cvs; ++k) {
        Wide3d p{};
        for (int lane = 0; lane < lanes; ++lane) {
            const float* v = source[lane] + 4 * k;
            p.x[lane] = double(v[0]);
            p.y[lane] = double(v[1]);
            p.z[lane] = double(v[2]);
            radius[k][lane] = float(double(v[3]) * width_scale);
        }
        const Wide3d d = p - transform.from;
        const auto row = [&](int i) {
            return transform.rotation[i][0] * d.x + transform.rotation[i][1] * d.y +
                   transform.rotation[i][2] * d.z;
        };
        rest[k] = to_float(Wide3d{row(0), row(1), row(2)} + transform.to);
    }
}

// Computes u of every CV from the rest strands; 0 everywhere if a strand has no length.
void set_u(int cvs, const Wide3f* rest, VDouble* u) {
    u[0] = VDouble{};
    for (int k = 0; k + 1 < cvs; ++k) {
        const Wide3d d = to_double(rest[k + 1]) - to_double(rest[k]);
        u[k + 1] = u[k] + vsqrt(dot(d, d));
    }
    const VDouble length = u[cvs - 1];
    const VLong some = length > 0.0;
    const VDouble scale = select(some, 1.0 / select(some, length, 1.0), 0.0);
    for (int k = 0; k < cvs; ++k) u[k] *= scale;
}

float component(const MarramAttribute& attribute, uint64_t element, uint32_t i) {
    return attribute.values[element * attribute.components + i];
}

double wind_share_of(const ImportInstance& instance, uint64_t curve) {
    double share = 1.0;
    for (const CurveFactor& factor : instance.settings.wind_by)
        if (const MarramAttribute* attribute = instance.curves.find(factor.name))
            share *= std::clamp(factor.ramp(double(component(*attribute, curve, 0))), 0.0, 1.0);
    return share;
}

// A ribbon's normal: the file's "normal", else the component of the skin's normal perpendicular to the
// strand.
Vec3d ribbon_normal(const MarramAttribute* given, uint64_t cv, const Eigen::Matrix3d& rotation,
                    const Vec3d& tangent, const Vec3d& skin_normal) {
    if (given) {
        const Vec3d n = rotation * Vec3d(double(component(*given, cv, 0)), double(component(*given, cv, 1)),
                                         double(component(*given, cv, 2)));
        if (n.squaredNorm() > 0.0) return n.normalized();
    }
    if (!(tangent.squaredNorm() > 0.0)) return skin_normal;
    const Vec3d t = tangent.normalized();
    Vec3d n = skin_normal - t * t.dot(skin_normal);
    if (n.norm() > 1e-6) return n.normalized();
    Vec3d unused;
    orthonormal_basis<double>(t, n, unused);
    return n;
}

// Sets the radii from the scene's width.
void set_radii_from_width(const ImportSettings& settings, int cvs, const VDouble* u, VFloat* radius) {
    for (int k = 0; k < cvs; ++k)
        for (int lane = 0; lane < lanes; ++lane)
            radius[k][lane] =
                float(0.5 * *settings.width * settings.width_scale * settings.width_profile(u[k][lane]));
}

} // namespace

void expand_imported(const ImportInstance& instance, const SkinPoses* skin, const float* vertices,
                     uint64_t first, std::span<const uint32_t> curves, uint32_t cvs, Strands& strands) {
    const ImportSettings& settings = instance.settings;
    const LentCurves& lent = instance.curves;
    const uint64_t first_vertex = lent.first_vertex(first);
    const auto& collision = instance.wind.collision;
    const bool moves = lent.curves.moves != 0;
    const MarramAttribute* given_normal = lent.find("normal");
    if (given_normal && (given_normal->components != 3 || given_normal->rate != MARRAM_PER_CV))
        given_normal = nullptr;
    Eigen::Matrix3d rotations[lanes];
    Vec3d root_normals[lanes];
    for (int block = 0; block < strands.blocks; ++block) {
        const size_t at = size_t(block) * cvs;
        RigidTransform8 transform;
        const float* source[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            const uint32_t c = curves[std::min(size_t(block) * lanes + size_t(lane), curves.size() - 1)];
            const float* v = vertices + 4 * (lent.first_vertex(first + c) + 1 - first_vertex);
            source[lane] = v;
            Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
            Vec3d from = Vec3d::Zero(), to = Vec3d::Zero(), noise_origin = cv_at(v);
            Vec3d root_normal = cv_at(v + 4) - cv_at(v); // for unbound strands
            root_normal =
                root_normal.squaredNorm() > 0.0 ? Vec3d(root_normal.normalized()) : Vec3d(Vec3d::UnitY());
            if (skin) {
                const RootBinding& root_binding = instance.binding.root_bindings[first + c];
                const SurfaceFrame now = frame_at(skin->now, root_binding.triangle, root_binding.weights);
                const Vec3d foot = skin->now.point(root_binding.triangle, root_binding.weights);
                root_normal = now.normal;
                double height = double(root_binding.height);
                if (moves) {
                    height = root_height(cv_at(v), foot, now.normal, instance.binding.rounding);
                } else if (!same_triangle(skin->bind, skin->now, root_binding.triangle)) {
                    const SurfaceFrame bind =
                        frame_at(skin->bind, root_binding.triangle, root_binding.weights);
                    rotation = axes_of(now) * axes_of(bind).transpose();
                    from = skin->bind.point(root_binding.triangle, root_binding.weights);
                    to = foot;
                }
                noise_origin = rotation * (noise_origin - from) + to; // before raising, as for grown strands
                if (collision) {
                    const double radius = settings.width ? 0.5 * *settings.width * settings.width_scale *
                                                               settings.width_profile(0.0)
                                                         : double(v[3]) * settings.width_scale;
                    const double length = curve_length(v, cvs);
                    const double lift = root_offset(*collision, length, radius) - height;
                    if (lift > 0.0 && length > 0.0) to += lift * now.normal;
                }
            }
            if (instance.wind.noise_at_bind_frame)
                noise_origin = cv_at(instance.bind_pose() + 4 * (lent.first_vertex(first + c) + 1));
            set_transform(transform, lane, rotation, from, to);
            rotations[lane] = rotation;
            root_normals[lane] = root_normal;
            set_lane(strands.noise_origin[size_t(block)], lane, noise_origin);
            set_lane(strands.root_normal[size_t(block)], lane, root_normal);
            if (strands.has_wind_share)
                strands.wind_share[size_t(block)][lane] = float(wind_share_of(instance, first + c));
        }
        transform_cvs(transform, source, int(cvs), &strands.rest[at], &strands.radius[at],
                      settings.width_scale);
        set_u(int(cvs), &strands.rest[at], &strands.u[at]);
        if (settings.width) set_radii_from_width(settings, int(cvs), &strands.u[at], &strands.radius[at]);
        strands.width[size_t(block)] = to_double(strands.radius[at]) * 2.0;
        if (!strands.oriented) continue;
        for (int lane = 0; lane < lanes; ++lane) {
            const uint32_t c = curves[std::min(size_t(block) * lanes + size_t(lane), curves.size() - 1)];
            for (uint32_t k = 0; k < cvs; ++k) {
                const uint32_t a = std::min(k, cvs - 2);
                const Vec3d tangent =
                    rotations[lane] * (cv_at(source[lane] + 4 * (a + 1)) - cv_at(source[lane] + 4 * a));
                const Vec3d n = ribbon_normal(given_normal, lent.first_cv(first + c) + k, rotations[lane],
                                              tangent, root_normals[lane]);
                set_lane(strands.rest_normal[at + k], lane, n);
            }
        }
    }
}

// ---- Patches and boxes

void make_patches(ImportInstance& instance) {
    constexpr uint64_t patch_cvs = 4096, patch_curves = 512;
    const LentCurves& lent = instance.curves;
    const float* vertices = instance.bind_pose();
    std::vector<ImportPatch>& patches = instance.patches;
    patches.clear();
    for (uint64_t c = 0; c < lent.count();) {
        uint64_t end = c;
        while (end < lent.count() && end - c < patch_curves &&
               (end == c || lent.first_cv(end + 1) - lent.first_cv(c) <= patch_cvs))
            ++end;
        patches.push_back({c, end - c, 0.0, 0.0, 0.0, {}, {}});
        c = end;
    }
    std::vector<Eigen::AlignedBox3d> boxes(patches.size());
    marram::parallel_for(size_t{0}, patches.size(), [&](size_t p) {
        ImportPatch& patch = patches[p];
        patch.order.resize(patch.count);
        std::iota(patch.order.begin(), patch.order.end(), 0U);
        std::ranges::stable_sort(patch.order, {}, [&](uint32_t i) { return lent.cvs(patch.first + i); });
        for (uint32_t i = 0; i < patch.order.size(); ++i) {
            const auto cvs_of = [&](uint32_t k) { return lent.cvs(patch.first + patch.order[k]); };
            if (i == 0 || cvs_of(i) != cvs_of(i - 1)) patch.runs.push_back({i, i});
            patch.runs.back()[1] = i + 1;
        }
        for (uint64_t c = patch.first; c < patch.first + patch.count; ++c) {
            const float* v = vertices + 4 * (lent.first_vertex(c) + 1);
            double length = 0.0;
            for (uint32_t k = 0; k < lent.cvs(c); ++k) {
                boxes[p].extend(cv_at(v + 4 * k));
                patch.max_radius = std::max(patch.max_radius, double(v[4 * k + 3]));
                if (k == 0) continue;
                const double segment = (cv_at(v + 4 * k) - cv_at(v + 4 * (k - 1))).norm();
                patch.longest_segment = std::max(patch.longest_segment, segment);
                length += segment;
            }
            patch.longest = std::max(patch.longest, length);
        }
    });
    instance.longest_at_bind = 0.0;
    instance.bind_box = {};
    instance.least_cvs = lent.count() > 0 ? UINT32_MAX : 2;
    for (uint64_t c = 0; c < lent.count(); ++c)
        instance.least_cvs = std::min(instance.least_cvs, lent.cvs(c));
    for (size_t p = 0; p < patches.size(); ++p) {
        instance.longest_at_bind = std::max(instance.longest_at_bind, patches[p].longest);
        instance.bind_box.extend(boxes[p]);
    }
}

double longest_in_frame(const ImportInstance& instance) {
    const LentCurves& lent = instance.curves;
    if (!lent.curves.moves) return instance.longest_at_bind;
    return marram::parallel_reduce(
        tbb::blocked_range<uint64_t>(0, lent.count(), 512), instance.longest_at_bind,
        [&](const tbb::blocked_range<uint64_t>& range, double longest) {
            for (uint32_t t = 0; t < lent.curves.time_count; ++t)
                for (uint64_t c = range.begin(); c < range.end(); ++c)
                    longest =
                        std::max(longest, curve_length(instance.vertices(t) + 4 * (lent.first_vertex(c) + 1),
                                                       lent.cvs(c)));
            return longest;
        },
        [](double a, double b) { return std::max(a, b); });
}

namespace {

double max_radius_of(const ImportSettings& settings, double of_file) {
    if (!settings.width) return of_file * settings.width_scale;
    const auto shares = settings.width_profile.values();
    return 0.5 * *settings.width * settings.width_scale * *std::ranges::max_element(shares);
}

// Greatest distance of any part of a strand from its root: see groom_bounds.cpp. Sizes are those on the mesh;
// on an instance all of them scale, with the height to which roots are raised.
double import_reach(const ImportInstance& instance, double longest, double longest_segment, double max_radius,
                    double scale, double max_coordinate) {
    const double radius = max_radius_of(instance.settings, max_radius);
    const double overshoot = instance.basis == MARRAM_CATMULL_ROM ? longest_segment / 3.0 : 0.0;
    double offset = 0.0, clearance = 0.0;
    if (const auto& collision = instance.wind.collision) {
        offset = root_offset(*collision, longest, radius);
        clearance = std::max(collision->clearance.value_or(0.0), offset);
    }
    return scale * (longest + overshoot + radius + offset + clearance) * (1.0 + 1e-5) +
           4.0 * (max_coordinate + scale * longest) * 0x1p-23;
}

} // namespace

// The box of the feet (closest points on the skin), grown by the reach. A root is at most max_foot_distance
// from its foot, and raising moves it by at most that plus root_offset; hence reach + 2 max_foot_distance.
MarramPatch import_patch_bounds(const ImportInstance& instance, uint32_t index) {
    MarramPatch out{};
    const ImportPatchOnMesh on = instance.patch_at(index);
    const ImportPatch& patch = on.patch;
    const LentCurves& lent = instance.curves;
    out.first_curve = on.first_curve;
    out.curve_count = uint32_t(patch.count);
    Eigen::AlignedBox3d box;
    double longest = patch.longest, segment = patch.longest_segment, max_radius = patch.max_radius;
    const bool moves = lent.curves.moves != 0;
    for (uint32_t t = 0; moves && t < lent.curves.time_count; ++t) // lengths may change
        for (uint64_t c = patch.first; c < patch.first + patch.count; ++c) {
            const float* v = instance.vertices(t) + 4 * (lent.first_vertex(c) + 1);
            longest = std::max(longest, curve_length(v, lent.cvs(c)));
            for (uint32_t k = 0; k < lent.cvs(c); ++k)
                max_radius = std::max(max_radius, double(v[4 * k + 3]));
        }
    if (moves) segment = longest;
    // At least 1: clearances do not shrink with instances.
    const double scale = std::max(max_instance_scale(std::span(&on.mesh_instance, 1)), 1.0);
    double max_foot_distance = 0.0, max_coordinate = 0.0;
    for (uint32_t t = 0; t < instance.time_count; ++t) {
        const Eigen::Affine3d& transform = on.mesh_instance.transform(t);
        for (uint64_t c = patch.first; c < patch.first + patch.count; ++c) {
            const Vec3d root =
                cv_at((moves ? instance.vertices(t) : instance.bind_pose()) + 4 * (lent.first_vertex(c) + 1));
            if (!instance.mesh) {
                box.extend(root);
                continue;
            }
            // Rigid transforms keep the distance between a root and its foot.
            const RootBinding& root_binding = instance.binding.root_bindings[c];
            const Vec3d foot = instance.surface(t).point(root_binding.triangle, root_binding.weights);
            box.extend(on.mesh_instance.is_instance ? Vec3d(transform * foot) : foot);
            if (on.mesh_instance.is_instance) // strands are rounded on the mesh, too
                max_coordinate = std::max(max_coordinate, scale * foot.cwiseAbs().maxCoeff());
            if (moves) box.extend(on.mesh_instance.is_instance ? Vec3d(transform * root) : root);
            max_foot_distance =
                std::max(max_foot_distance, moves ? (root - foot).norm() : double(root_binding.distance));
        }
    }
    max_coordinate =
        std::max({max_coordinate, box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff()});
    const double reach = import_reach(instance, longest, segment, max_radius, scale, max_coordinate) +
                         2.0 * scale * max_foot_distance;
    for (int axis = 0; axis < 3; ++axis) {
        out.lower[axis] = float(box.min()[axis] - reach);
        out.upper[axis] = float(box.max()[axis] + reach);
    }
    return out;
}

Eigen::AlignedBox3d bounds_of_import(const ImportInstance& instance) {
    return marram::parallel_reduce(
        tbb::blocked_range<uint32_t>(0, instance.patch_count()), Eigen::AlignedBox3d(),
        [&](const tbb::blocked_range<uint32_t>& range, Eigen::AlignedBox3d box) {
            for (uint32_t i = range.begin(); i < range.end(); ++i) {
                const MarramPatch patch = import_patch_bounds(instance, i);
                box.extend(Eigen::Map<const Vec3f>(patch.lower).cast<double>());
                box.extend(Eigen::Map<const Vec3f>(patch.upper).cast<double>());
            }
            return box;
        },
        [](const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) { return a.merged(b); });
}

} // namespace marram
