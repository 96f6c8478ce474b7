// SPDX-License-Identifier: Apache-2.0
// A perspective camera with a thin lens (Potmesil and Chakravarty, "A Lens and Aperture Camera Model", 1981):
// all rays of a film position meet in one point of the focal plane. It looks along its own -z, with y up.
#pragma once

#include "core/trace/hit.h"

#include <cassert>
#include <vector>

namespace marram {

struct CameraPose {
    Vec3d position = Vec3d::Zero();
    Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity(); // camera to world
};

// A pose that looks from `position` at `target`, with `up` towards the top of the image. position - target
// and up must not be parallel.
inline CameraPose look_at(const Vec3d& position, const Vec3d& target, const Vec3d& up) {
    const Vec3d back = (position - target).normalized();
    const Vec3d right = up.cross(back).normalized();
    Eigen::Matrix3d axes;
    axes << right, back.cross(right), back;
    return {position, Eigen::Quaterniond(axes).normalized()};
}

struct Camera {
    std::vector<CameraPose> poses = {
        CameraPose{}};                   // one (static camera), or several equally spaced over the shutter
    double vertical_fov = 40.0 * degree; // radians, 0 < fov < pi
    double lens_radius = 0.0;            // m; 0: pinhole camera
    double focus_distance = 1.0;         // m along the axis; used with a lens only
};

// x, y: 0 ... 1 from the left and top of the image. lens: two numbers 0 ... 1. time: 0 ... 1 of the shutter.
class CameraRays {
  public:
    CameraRays(const Camera& camera, uint32_t width, uint32_t height)
        : camera_(camera), half_height_(std::tan(0.5 * camera.vertical_fov)),
          half_width_(half_height_ * width / height) {
        assert(!camera.poses.empty());
        axes_ = camera.poses.front().orientation.toRotationMatrix();
        position_ = camera.poses.front().position;
    }

    bool has_lens() const { return camera_.lens_radius > 0.0; }

    Ray operator()(double x, double y, const Vec2f& lens, float time) const {
        Vec3d direction((2.0 * x - 1.0) * half_width_, (1.0 - 2.0 * y) * half_height_, -1.0);
        Vec3d start = Vec3d::Zero();
        if (has_lens()) {
            start = on_lens(lens);
            direction = direction * camera_.focus_distance - start;
        }
        Ray ray;
        ray.time = time;
        if (camera_.poses.size() == 1) {
            place(ray, axes_, position_, start, direction);
        } else {
            const double at = static_cast<double>(time) * static_cast<double>(camera_.poses.size() - 1);
            const size_t key = std::min(static_cast<size_t>(at), camera_.poses.size() - 2);
            const CameraPose &a = camera_.poses[key], &b = camera_.poses[key + 1];
            const double t = at - static_cast<double>(key);
            place(ray, a.orientation.slerp(t, b.orientation).toRotationMatrix(),
                  a.position + t * (b.position - a.position), start, direction);
        }
        return ray;
    }

  private:
    static void place(Ray& ray, const Eigen::Matrix3d& axes, const Vec3d& position, const Vec3d& start,
                      const Vec3d& direction) {
        ray.origin = (position + axes * start).cast<float>();
        const Vec3d d = axes * direction;
        ray.direction = (d * (1.0 / d.norm())).cast<float>();
    }

    // Concentric map from the square to the disc: Shirley and Chiu, 1997. It preserves the compactness of
    // strata.
    Vec3d on_lens(const Vec2f& lens) const {
        const double a = 2.0 * static_cast<double>(lens.x()) - 1.0,
                     b = 2.0 * static_cast<double>(lens.y()) - 1.0;
        if (a == 0.0 && b == 0.0) return Vec3d::Zero();
        const bool wide = std::abs(a) > std::abs(b);
        const double r = camera_.lens_radius * (wide ? a : b);
        const double phi = wide ? 0.25 * pi * b / a : 0.5 * pi - 0.25 * pi * a / b;
        return {r * std::cos(phi), r * std::sin(phi), 0.0};
    }

    Camera camera_;
    double half_height_, half_width_;
    Eigen::Matrix3d axes_;
    Vec3d position_;
};

} // namespace marram
