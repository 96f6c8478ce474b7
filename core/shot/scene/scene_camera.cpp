// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/scene_camera.h"

#include "core/math/transform.h"
#include "core/scene/keyed_values.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace marram {
namespace {

constexpr double allowed_pixels = 0.05; // far below the width of the pixel filter
constexpr size_t max_poses = 65;

void reject_scale(const ParamValue& keys) {
    for (size_t i = 0; i + 9 < keys.numbers.size(); i += 10)
        if (Vec3d(keys.numbers.data() + i + 7) != Vec3d::Ones())
            throw InputError(keys.place, "camera.transform scales, which a camera cannot",
                             "leave scale out, or change camera.fov");
}

// The pose that the renderer interpolates at `share`, from poses equally spaced over 0 ... 1.
CameraPose interpolated_pose(const std::vector<CameraPose>& poses, double share) {
    const double at = share * double(poses.size() - 1);
    const size_t key = std::min(size_t(at), poses.size() - 2);
    const CameraPose &a = poses[key], &b = poses[key + 1];
    const double t = at - double(key);
    return {a.position + t * (b.position - a.position), a.orientation.slerp(t, b.orientation)};
}

// The distance in pixels between the images of two poses: the maximum over the center, corners and edge
// midpoints of the film, and over the shift of position seen at `distance`.
double pixel_distance(const CameraPose& a, const CameraPose& b, const Vec2d& size, double half_height,
                      double distance) {
    const double pixel = 2.0 * half_height / size.y();
    double worst = (a.position - b.position).norm() / distance;
    const Eigen::Quaterniond turn = a.orientation.conjugate() * b.orientation;
    for (const double x : {-1.0, 0.0, 1.0})
        for (const double y : {-1.0, 0.0, 1.0}) {
            const Vec3d d(x * half_height * size.x() / size.y(), y * half_height, -1.0), seen = turn * d;
            if (!(seen.z() < 0.0)) return std::numeric_limits<double>::infinity();
            worst = std::max(worst, (seen.head<2>() / -seen.z() - d.head<2>()).norm());
        }
    return worst / pixel;
}

} // namespace

Camera camera_at(const SceneDescription& description, double frame, double* off) {
    const ParamSet params = values_at(description.camera, frame);
    const Vec3d position = params.vec3("position"), target = params.vec3("target");
    const double distance = (target - position).norm();
    Camera camera;
    camera.vertical_fov = params.number("fov") * degree;
    camera.lens_radius = params.number("lens_radius");
    camera.focus_distance = params.has("focus") ? params.number("focus") : distance;

    const CameraPose looking = look_at(position, target, params.vec3("up"));
    const ParamValue& keys = params.at("transform");
    reject_scale(keys);
    const KeyedTransform transform(keys.numbers, keys.text);
    const auto pose_at = [&](double time) -> CameraPose {
        const Eigen::Affine3d m = transform.at(time);
        return {m * looking.position, (Eigen::Quaterniond(m.linear()) * looking.orientation).normalized()};
    };
    const Vec2d shutter = params.vec2("shutter");
    const double open = frame + shutter.x(), close = frame + shutter.y();
    const auto poses_of = [&](size_t count) {
        std::vector<CameraPose> poses;
        for (size_t i = 0; i < count; ++i)
            poses.push_back(pose_at(open + (close - open) * double(i) / double(count - 1)));
        return poses;
    };
    if (off) *off = 0.0;
    if (!transform.moves_within(open, close)) {
        camera.poses = {pose_at(open)};
        return camera;
    }
    // Test densely: with smooth keys or camera shake the error is not largest halfway between poses.
    constexpr int test_count = 512;
    const Vec2d size = description.film.vec2("size");
    const double half_height = std::tan(0.5 * camera.vertical_fov);
    for (size_t count = 2; count <= max_poses; count = 2 * count - 1) {
        camera.poses = poses_of(count);
        double worst = 0.0;
        for (int i = 0; i <= test_count; ++i) {
            const double share = double(i) / test_count;
            worst = std::max(worst, pixel_distance(interpolated_pose(camera.poses, share),
                                                   pose_at(open + (close - open) * share), size, half_height,
                                                   distance));
        }
        if (off) *off = worst;
        if (worst <= allowed_pixels) break;
    }
    return camera;
}

double median_distance(const SceneDescription& description, double frame, std::span<const Box3f> boxes) {
    const Camera camera = camera_at(description, frame);
    const CameraPose& pose = camera.poses.front();
    const Vec2d size = description.film.vec2("size");
    const double half_height = std::tan(0.5 * camera.vertical_fov);
    std::vector<double> distances;
    for (const Box3f& box : boxes) {
        if (box.isEmpty()) continue;
        const Vec3d seen = pose.orientation.conjugate() * (box.center().cast<double>() - pose.position);
        const double high = half_height * -seen.z();
        if (seen.z() < 0.0 && std::abs(seen.y()) <= high && std::abs(seen.x()) <= high * size.x() / size.y())
            distances.push_back(seen.norm());
    }
    if (distances.empty()) return std::numeric_limits<double>::infinity();
    const auto middle = distances.begin() + long(distances.size() / 2);
    std::ranges::nth_element(distances, middle);
    return *middle;
}

} // namespace marram
