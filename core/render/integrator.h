// SPDX-License-Identifier: Apache-2.0
// Unidirectional path tracer: paths start at the camera, with next-event estimation at every vertex, multiple
// importance sampling (MIS) of lights and BSDFs, and Russian roulette. Vertex 0 is the first hit.
// path.cpp describes the estimator, integrator.cpp the passes over the picture.
#pragma once

#include "core/render/camera.h"
#include "core/render/film.h"
#include "core/render/filter.h"
#include "core/render/lights/lights.h"
#include "shaders/shader.h"

#include <atomic>
#include <functional>
#include <optional>

namespace marram {

// Strategy for direct light. mis is for rendering; the other two are also unbiased and serve as checks.
enum class Strategy { mis, light_sampling, bsdf_sampling };

// A film that is part of a larger picture. Its pixels have the rays and random numbers that they have there.
struct Crop {
    uint32_t x = 0, y = 0; // of the film's top left pixel in the picture
    uint32_t picture_width = 0, picture_height = 0;
};

struct RenderSettings {
    uint32_t samples = 64; // the film gets those from first_sample to before this one, or fewer if adaptive
    // > 0: adaptive sampling. A pixel has converged when the standard error of its mean is at most this
    // fraction of its brightness (or of a tenth of the picture's mean brightness, if that is greater), and
    // the same holds for its eight neighbours. The film needs a layer "variance".
    double noise_threshold = 0.0;
    // > 0: time limit. Rendering stops after this time with fewer samples. Near the limit, passes shrink to
    // one sample, so the sample counts of unconverged pixels differ by at most one (more only if the cost of
    // a sample doubles within a pass). Every pixel gets at least one sample, even if that takes longer.
    double seconds = 0.0;
    std::function<double()> clock; // seconds, for `seconds`; called from any thread. Empty: the steady clock
    uint32_t max_depth = 12;       // maximum vertices of a path that scatter; 0: directly visible lights only
    uint32_t roulette_depth = 4;   // vertices that scatter before Russian roulette may end a path
    // > 0: clamps the indirect light (scattered at two or more vertices) of each sample: it is scaled so that
    // its largest channel is at most this. Removes fireflies; biased: the image loses that energy
    // (RenderStats::clamped_fraction).
    float indirect_clamp = 0.0F;
    Filter filter;
    uint64_t seed = 0; // use a different seed for each frame
    Strategy strategy = Strategy::mis;
    uint32_t tile = 16; // pixels; does not affect the result
    // Only the film's part of the picture is traced, with the samples of the whole bit for bit (but for
    // adaptive sampling, which does not know neighbours beyond the film's edges without `before`).
    std::optional<Crop> crop;
    // Number of the film's first sample. Earlier ones are in other films (add_film).
    uint32_t first_sample = 0;
    // The film of the whole picture with all samples before first_sample: which pixels have converged, and
    // how noisy they are. Without it, a film that begins later or is a part of the picture traces pilot
    // samples that say how noisy it is, and are not added to it. Adaptive sampling with first_sample > 0
    // needs it, and then one round at a time is traced (samples_per_round, adaptive.h). What it says of its
    // pixels is brought up to date.
    Film* before = nullptr;
};

// Progress of a render. cancel and samples_done may be read and written from any thread while render() runs.
struct RenderProgress {
    const std::atomic<bool>* cancel = nullptr; // if set, render() returns within about 100 ms
    // Samples that pixels have taken, or skipped because they had converged, out of width * height * (samples
    // - first_sample).
    // On its own cache line: threads that update it would slow down those that read cancel.
    alignas(64) std::atomic<uint64_t> samples_done{0};
    // Called by the thread that runs render(), between two passes, when no thread writes to the film. The
    // values of the layers are those of the last resolve(): resolve the film to get its current state.
    alignas(64) std::function<void(Film&)> between_passes;
    // If above 0, passes are split so that it is called about twice in this time, or after each sample a
    // pixel.
    double seconds_between_passes = 0.0;
};

struct RenderStats {
    RayCounts rays;
    // Discarded samples of this call, not finite or above ValueSum::max_term: 0 unless a light is.
    uint64_t nonfinite_samples = 0;
    // Mean luminance of the throughput of paths that settings.max_depth ends, over the samples of this call:
    // the fraction of light that is missing under uniform illumination.
    double cut_throughput = 0.0;
    bool cancelled = false;
    bool out_of_time = false; // settings.seconds stopped the render early
    uint32_t max_samples = 0; // maximum over pixels, in this and previous calls
    double mean_samples = 0.0;
    // Fraction of the picture's light that settings.indirect_clamp removed, in this and previous calls.
    double clamped_fraction = 0.0;
};

// Renders into the film (see make_film) and resolves it. A film that already has samples (its render was
// cancelled, ran out of time or requested fewer samples) is continued; the result is bit-identical to a
// single render. The film must not have more than settings.samples and must be of the same frame. Runs in the
// caller's TBB arena. The result does not depend on the number of threads or on `tile`, bit for bit, but with
// settings.seconds on the number of passes that fit in the time. materials are indexed by
// SurfacePoint::material; a hit without a material is shaded as diffuse with default parameters.
RenderStats render(const World& world, const Lights& lights, std::span<const Material> materials,
                   const Camera& camera, const RenderSettings& settings, Film& film,
                   RenderProgress* progress = nullptr);

} // namespace marram
