// SPDX-License-Identifier: Apache-2.0
// Common types of all lights.
#pragma once

#include "core/math/params.h"
#include "core/trace/hit.h"

#include <atomic>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace marram {

// A sampled direction from a point towards a light.
struct LightSample {
    Vec3f radiance = Vec3f::Zero();
    Vec3f direction = Vec3f::UnitY(); // unit, from the point; for lights at infinity
    float pdf = 0.0F;                 // per solid angle, includes the choice of the light; 0: no light
    bool delta = false;               // BSDF sampling cannot hit it: no MIS
    bool at_infinity = true;
    Vec3d target = Vec3d::Zero(); // a point on an emitting mesh, offset by its error
    float rr_u = 0.0F;            // uniform, for shadow-ray roulette: left over from choosing the light
};

// Radiance of a light along a ray.
struct LightRadiance {
    Vec3f radiance = Vec3f::Zero();
    // Of light sampling for this direction, per solid angle. 0: the light is visible, but never sampled here;
    // < 0: the light is not visible along the ray.
    float pdf = -1.0F;
};

// Pixels shared by all copies until one of them is edited. They may be computed at the first access: some
// programs read scenes for their geometry only.
class SharedPixels {
  public:
    using Make = std::function<std::vector<Vec3f>()>;
    SharedPixels() : shared_(std::make_shared<Shared>()) {}
    explicit SharedPixels(Make make) : shared_(std::make_shared<Shared>(std::move(make))) {}

    const std::vector<Vec3f>& get() const {
        if (!shared_->there.load(std::memory_order_acquire)) shared_->compute();
        return shared_->pixels;
    }
    const Vec3f& operator[](size_t i) const { return get()[i]; }
    size_t size() const { return get().size(); }
    auto begin() const { return get().cbegin(); }
    auto end() const { return get().cend(); }
    std::vector<Vec3f>& edit() {
        if (shared_.use_count() > 1) {
            auto own = std::make_shared<Shared>();
            own->pixels = get();
            shared_ = std::move(own);
        }
        get();
        return shared_->pixels;
    }

  private:
    struct Shared {
        Shared() : there(true) {}
        explicit Shared(Make how) : make(std::move(how)) {}
        void compute() {
            const std::lock_guard guard(lock);
            if (there.load()) return;
            pixels = make();
            there.store(true, std::memory_order_release);
        }
        std::vector<Vec3f> pixels;
        std::atomic<bool> there{false};
        std::mutex lock;
        Make make;
    };
    std::shared_ptr<Shared> shared_;
};

// An image for a light: latitude-longitude, rows from the top.
struct LightImage {
    uint32_t width = 0, height = 0;
    SharedPixels pixels; // finite and >= 0
};
// Reads an image, which `strength` will scale. Throws InputError at the parameter's place.
using LightImageReader = std::function<LightImage(const ParamValue& file, double strength)>;

inline double mean_of(const Vec3f& color) { return color.cast<double>().sum() / 3.0; }
inline Vec3f color_of(const ParamSet& params, std::string_view name) {
    return params.vec3(name).cast<float>();
}

// Of lights at infinity. A picture is transparent where the camera would see only lights that are not seen by
// it.
inline ParamSpec seen_by_camera_param() {
    constexpr double any = std::numeric_limits<double>::infinity();
    return {"seen_by_camera",
            ParamType::boolean,
            "",
            "true",
            -any,
            any,
            "",
            "the camera sees it; false: it lights the scene, and where nothing else is seen the picture is "
            "transparent"};
}

// Bounds of parameters: greater values are input errors.
inline constexpr double brightest_light = 1e9; // no product along a path overflows a float
inline constexpr double longest_direction = 1e8;

} // namespace marram
