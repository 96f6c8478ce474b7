// SPDX-License-Identifier: Apache-2.0
// One path from the camera: path.cpp describes the estimator.
#pragma once

#include "core/math/color.h"
#include "core/render/sampler.h"
#include "core/render/shading_inputs.h"

#include <optional>

namespace marram {

// Vertex 0, for the layers.
struct FirstHit {
    bool found = false;
    SurfacePoint point;
    Vec3f albedo = Vec3f::Zero(), normal = Vec3f::Zero();
};

// Light at a point on a shadow catcher, by sampling one light: luminance of what it scatters to the camera,
// and of what it would without shadows. Not weighted with BSDF sampling: the ratio of the sums is wanted, and
// only where light sampling finds light.
struct CaughtLight {
    float lit = 0.0F, full = 0.0F;
};

// Radiance of a path: direct (scattered at one vertex or none) and indirect (at more).
struct PathRadiance {
    Vec3f direct = Vec3f::Zero(), indirect = Vec3f::Zero();
    float cut_throughput = 0.0F;       // luminance of the throughput of a path that max_depth ends
    std::optional<CaughtLight> caught; // the camera ray hit a shadow catcher
};

inline float luminance(const Vec3f& rgb) { return marram::luminance(rgb[0], rgb[1], rgb[2]); }

inline constexpr uint32_t time_set = 1; // of the sampler's numbers: the time of the camera ray

// The radiance along a camera ray, and its first hit. luminance_stddev: see FilmPixel.
PathRadiance trace_path(const RenderContext& context, Ray ray, float luminance_stddev, const Sampler& sampler,
                        FirstHit& first, RayCounts& counts);

} // namespace marram
