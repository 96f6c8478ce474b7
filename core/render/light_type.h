// SPDX-License-Identifier: Apache-2.0
// What all kinds of lights have in common.
#pragma once

#include "core/geometry/hit.h"
#include "core/math/params.h"

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace marram {

// Towards a light, from a point.
struct LightSample {
    Vec3f radiance = Vec3f::Zero();
    Vec3f direction = Vec3f::UnitY(); // unit, from the point; of lights at infinity
    float pdf = 0.0F;                 // solid angle, choice of the light included; 0: nothing arrives
    bool delta = false; // can only be reached this way: no weighting against the shader's sampling
    bool at_infinity = true;
    Vec3d target = Vec3d::Zero(); // a point on an emitting mesh, moved off it by its error
    float unused = 0.0F; // a uniform number, independent of the others: left over from choosing the light
};

// Along a ray.
struct SeenLight {
    Vec3f radiance = Vec3f::Zero();
    float pdf = -1.0F; // with which sampling the light would have chosen the ray; below 0: it is not seen
};

// An image for a light: latitude by longitude, rows from the top; strength scales it. Throws InputError at the parameter's place.
// Pixels that all copies share until one of them is edited. They may be computed when they are first looked at: scenes are read for
// their geometry alone, too.
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

struct LightImage {
    uint32_t width = 0, height = 0;
    SharedPixels pixels; // finite and >= 0
};
using LightImageReader = std::function<LightImage(const ParamValue& file, double strength)>;

inline double mean_of(const Vec3f& color) { return color.cast<double>().sum() / 3.0; }
inline Vec3f color_of(const ParamSet& params, std::string_view name) {
    return params.vec3(name).cast<float>();
}

// Bounds of parameters: beyond these a number is a slip of the pen.
inline constexpr double brightest_light = 1e9; // still a float after any product along a path
inline constexpr double longest_direction = 1e8;

} // namespace marram
