// SPDX-License-Identifier: Apache-2.0
// The path tracer: forward paths from the camera, one light sampled at every vertex, multiple importance
// sampling between that and the shader's own sampling, Russian roulette. integrator.cpp opens with the
// estimator.
#pragma once

#include "core/render/camera.h"
#include "core/render/film.h"
#include "core/render/filter.h"
#include "core/render/lights.h"
#include "shaders/shader.h"

#include <atomic>
#include <functional>

namespace marram {

// How light is found: mis is for rendering, the other two are unbiased too and exist to check it.
enum class Strategy { mis, light_sampling, bsdf_sampling };

struct RenderSettings {
    uint32_t samples = 64; // a pixel, at most
    // > 0: a pixel is done once the standard deviation of its mean, and those of its eight neighbours, are below this share of
    // its brightness, or of a tenth of the picture's where that is more. The film must have a layer "variance".
    double noise = 0.0;
    // > 0: rendering stops after this time, with fewer samples: no pixel then has more than one sample more than another (unless
    // samples become twice as slow), those aside that are done by `noise`. Each pixel gets one sample, however long that takes.
    double seconds = 0.0;
    std::function<double()> clock; // seconds, for `seconds`; any thread. Empty: the system's steady clock
    uint32_t max_depth = 16;       // surface interactions a path may have; 0: lights seen directly only
    uint32_t roulette_depth = 4;   // interactions before Russian roulette may end a path
    // > 0: what a sample's path brings from its second interaction on is scaled down where its greatest channel is above this.
    // Takes fireflies, and the light that they stood for (RenderStats::clamped).
    float clamp = 0.0F;
    Filter filter;
    uint64_t seed = 0; // change it with the frame
    Strategy strategy = Strategy::mis;
    uint32_t tile = 16; // pixels; no influence on the result
};

// Shared with whoever watches. cancel and done may be read and written from any thread while render runs.
struct RenderProgress {
    const std::atomic<bool>* cancel = nullptr; // set it and render returns within about 100 ms
    // Of width * height * samples. On a cache line of its own: threads that count would make those that look at cancel wait.
    alignas(64) std::atomic<uint64_t> samples_done{0};
    // Called by render's own thread between two passes, while nobody writes to the film. The layers' pixels are those of
    // whoever resolved last: resolve the film to see where it stands.
    alignas(64) std::function<void(Film&)> between_passes;
};

struct RenderStats {
    RayCounts rays;
    uint64_t dropped_samples = 0; // of this call, whose radiance was not finite: none, unless a light says so
    // Mean luminance of the throughput of paths that settings.max_depth ends, over the samples of this call: the share of the light
    // that is missing where light comes evenly from everywhere.
    double cut_throughput = 0.0;
    bool cancelled = false;
    bool out_of_time = false;  // settings.seconds ended it before its samples were done
    uint32_t most_samples = 0; // that a pixel has taken, in this call and before
    double mean_samples = 0.0;
    double clamped =
        0.0; // the share of the picture's light that settings.clamp took, in this call and before
};

// Renders into the film (make_film) and resolves it. A film that has samples already, since its render was cancelled, out of
// time or asked for fewer, is gone on with where it stands: the bits are those of one go. Not for a film that has more than
// settings.samples, or is of another frame. Runs in the caller's TBB arena; the bits of the result
// depend neither on the number of threads nor on `tile`, but with settings.seconds on how many passes there was time for. materials are indexed by SurfacePoint::material; a
// hit without a material is shaded as diffuse with its defaults.
RenderStats render(const World& world, const Lights& lights, std::span<const Material> materials,
                   const Camera& camera, const RenderSettings& settings, Film& film,
                   RenderProgress* progress = nullptr);

} // namespace marram
