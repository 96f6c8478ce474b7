// SPDX-License-Identifier: Apache-2.0
// The image is rendered in passes of 1, 3, 12, 16, 16, ... samples, so that a preview appears early. In each
// pass one task owns a pixel. The ends of passes are fixed, and what depends on the noise of earlier samples
// is decided only there: a render that stopped within a pass gives a bit-identical result when resumed, and
// films of parts of the picture add up to it.
#include "core/render/integrator.h"

#include "core/math/clock.h"
#include "core/render/adaptive.h"
#include "core/render/layers.h"
#include "core/render/path.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

namespace marram {

namespace {

// Whether sums can hold it.
bool is_summable(const Vec3f& radiance) {
    return radiance.allFinite() && double(radiance.cwiseAbs().maxCoeff()) <= ValueSum::max_term;
}

// Returns the luminance that the clamp removes.
double clamp_indirect(Vec3f& indirect, float limit) {
    const float max_channel = indirect.maxCoeff();
    if (!(limit > 0.0F && max_channel > limit)) return 0.0;
    const float before = luminance(indirect);
    indirect *= limit / max_channel;
    return before - luminance(indirect);
}

Crop crop_of(const RenderSettings& settings, const Film& film) {
    return settings.crop.value_or(Crop{0, 0, film.width, film.height});
}

// x, y: of the picture.
Ray camera_ray(const RenderContext& context, const Crop& crop, uint32_t x, uint32_t y,
               const Sampler& sampler) {
    const auto [film_x, film_y, lens_u, lens_v] = sampler.get_4d(0);
    const bool has_lens = context.camera.has_lens();
    const float time = !context.has_motion_blur ? 0.0F : has_lens ? sampler.get_4d(time_set)[0] : lens_u;
    Ray ray =
        context.camera((x + 0.5 + context.filter(film_x)) / crop.picture_width,
                       (y + 0.5 + context.filter(film_y)) / crop.picture_height, {lens_u, lens_v}, time);
    ray.mask = MARRAM_SEEN_BY_CAMERA;
    return ray;
}

struct Tile {
    uint32_t x0, y0, x1, y1;
};

bool cancelled(const RenderProgress* progress) {
    return progress && progress->cancel && progress->cancel->load(std::memory_order_relaxed);
}

struct Deadline {
    const std::function<double()>& clock;
    std::optional<double> time; // of the clock
    bool passed() const { return time && clock() >= *time; }
};

// Keeps lazy patches for the rays of a thread, and lets go of them now and then.
class KeptPatches {
  public:
    explicit KeptPatches(LazyGeometry* lazy)
        : lazy_(lazy), kept_(lazy ? lazy->keep() : std::shared_lock<tbb::rw_mutex>()) {}
    // Call it when nothing is needed any more of what rays have hit.
    void let_go_if_short() {
        if (!lazy_ || !lazy_->is_short()) return;
        kept_.unlock();
        lazy_->evict_patches();
        kept_.lock();
    }

  private:
    LazyGeometry* lazy_;
    std::shared_lock<tbb::rw_mutex> kept_;
};

// Renders the samples [begin, end) of a pixel.
void render_pixel(const RenderContext& context, uint32_t x, uint32_t y, uint32_t begin, uint32_t end,
                  Film& film, RenderStats& stats, KeptPatches& kept) {
    const size_t pixel_index = static_cast<size_t>(y) * film.width + x;
    FilmPixel& pixel = film.pixel_states[pixel_index];
    pixel.samples += end - begin;
    const Crop crop = crop_of(context.settings, film);
    const uint64_t seed = pixel_seed(context.settings.seed, crop.x + x, crop.y + y);
    for (uint32_t s = begin; s < end; ++s) {
        kept.let_go_if_short();
        const Sampler sampler(seed, s);
        FirstHit first;
        const Ray ray = camera_ray(context, crop, crop.x + x, crop.y + y, sampler);
        PathRadiance path = trace_path(context, ray, pixel.luminance_stddev, sampler, first, stats.rays);
        if (is_summable(path.direct + path.indirect)) {
            pixel.clamped_luminance_sum.add(clamp_indirect(path.indirect, context.settings.indirect_clamp));
            const Vec3f radiance = path.direct + path.indirect;
            add_sample(context, radiance, first, s, film, pixel_index);
            float noise = luminance(radiance);
            if (path.caught) { // its noise is the shadow's
                CatcherSums& caught = film.catchers[pixel_index];
                caught.samples.add(1.0);
                caught.lit.add(double(path.caught->lit));
                caught.full.add(double(path.caught->full));
                noise += path.caught->lit;
            }
            add_luminance(pixel, noise);
        } else {
            ++stats.nonfinite_samples;
        }
        stats.cut_throughput += double(path.cut_throughput);
        if (context.settings.noise_threshold > 0.0 && (s + 1) % samples_per_block == 0) end_block(pixel);
    }
}

// Renders the samples up to `end` of the pixels of a tile; each pixel continues at its next sample.
void render_tile(const RenderContext& context, const Tile& tile, uint32_t end, Film& film, RenderStats& stats,
                 RenderProgress* progress, const Deadline& deadline) {
    bool stopped = false;
    LazyGeometry* const lazy = context.world.lazy.get();
    for (uint32_t y = tile.y0; y < tile.y1 && !stopped; ++y) {
        uint64_t advanced = 0; // samples
        KeptPatches kept(lazy);
        for (uint32_t x = tile.x0; x < tile.x1; ++x) {
            stopped = cancelled(progress) || deadline.passed() || (lazy && lazy->failed());
            if (stopped) break;
            FilmPixel& pixel = film.pixel_states[static_cast<size_t>(y) * film.width + x];
            const uint32_t begin = pixel.next_sample;
            if (begin >= end) continue; // completed by an earlier render() that stopped within this pass
            pixel.next_sample = end;
            advanced += end - begin;
            if (!pixel.converged) render_pixel(context, x, y, begin, end, film, stats, kept);
        }
        if (progress) progress->samples_done.fetch_add(advanced, std::memory_order_relaxed);
    }
}

void add_stats(const RenderStats& more, RenderStats& sum) {
    sum.rays.intersect += more.rays.intersect;
    sum.rays.occluded += more.rays.occluded;
    sum.rays.invalid += more.rays.invalid;
    sum.nonfinite_samples += more.nonfinite_samples;
    sum.cut_throughput += more.cut_throughput;
}

void render_pass(const RenderContext& context, uint32_t end, Film& film, RenderStats& stats,
                 RenderProgress* progress, const Deadline& deadline) {
    const uint32_t size = std::max(context.settings.tile, 1U);
    const uint32_t columns = (film.width + size - 1) / size, rows = (film.height + size - 1) / size;
    std::mutex guard;
    const auto body = [&](const tbb::blocked_range<uint32_t>& range) {
        for (uint32_t i = range.begin(); i < range.end(); ++i) {
            const uint32_t x = i % columns * size, y = i / columns * size;
            RenderStats tile_stats;
            render_tile(context, {x, y, std::min(x + size, film.width), std::min(y + size, film.height)}, end,
                        film, tile_stats, progress, deadline);
            const std::lock_guard lock(guard);
            add_stats(tile_stats, stats);
        }
    };
    tbb::parallel_for(tbb::blocked_range<uint32_t>(0, columns * rows, 1), body, tbb::simple_partitioner());
    if (context.world.lazy) context.world.lazy->raise_failure();
}

// First end of a pass after `begin`. `begin` lies inside a pass if an earlier render asked for fewer samples.
uint32_t pass_end(uint32_t begin) {
    constexpr uint32_t max_length = 16; // max pass length in samples; bounds how long a cancel waits
    if (begin >= max_length) return (begin / max_length + 1) * max_length;
    uint32_t end = 1;
    while (end <= begin) end *= 4;
    return end;
}

// Whether every pixel has come to this sample. What depends on earlier samples is decided only here, so that
// a resumed render repeats it identically.
bool all_at(uint32_t sample, const Film& film) { return progress_of(film).max == sample; }

// End of the next partial pass, at most `end`. A partial pass is planned to use half the time left. It
// overruns only if samples become twice as slow, or if it is already down to one sample.
uint32_t partial_pass_end(const Film& film, uint32_t end, double seconds_left, double seconds_per_sample) {
    const uint32_t begin = progress_of(film).min;
    if (!(seconds_per_sample > 0.0))
        return std::min(begin + 1, end); // cost unknown: take one sample to measure it
    const double unconverged_pixels =
        double(std::ranges::count(film.pixel_states, false, &FilmPixel::converged));
    const double samples = std::max(
        1.0, std::floor(0.5 * seconds_left / (seconds_per_sample * std::max(unconverged_pixels, 1.0))));
    return samples < double(end - begin) ? begin + uint32_t(samples) : end;
}

// The film of the pilot samples of a part of the picture: the part, and what is near enough to count in
// update_luminance_stddev(). Samples that the part has are not traced again.
struct Pilot {
    Crop crop;
    uint32_t x = 0, y = 0; // of the part in it
    Film film{};

    Pilot(const Crop& part, const Film& film_of_part, bool has_samples) {
        const uint32_t left = std::min(part.x, stddev_radius), top = std::min(part.y, stddev_radius),
                       right = std::min(part.x + film_of_part.width + stddev_radius, part.picture_width),
                       bottom = std::min(part.y + film_of_part.height + stddev_radius, part.picture_height);
        crop = {part.x - left, part.y - top, part.picture_width, part.picture_height};
        x = left;
        y = top;
        film.width = right - crop.x;
        film.height = bottom - crop.y;
        if (!film_of_part.catchers.empty()) film.catchers.resize(size_t(film.width) * film.height);
        clear(film);
        if (has_samples)
            for_each_pixel(film_of_part,
                           [&](FilmPixel& pixel, size_t i) { pixel = film_of_part.pixel_states[i]; });
    }

    // The pixels of the part, and their indices in its film.
    template <typename Visit>
    void for_each_pixel(const Film& part, Visit&& visit) {
        for (size_t i = 0; i < part.pixel_states.size(); ++i)
            visit(film.pixel_states[(y + i / part.width) * film.width + x + i % part.width], i);
    }
};

// Sets FilmPixel::luminance_stddev, from the pilot samples. False: cancelled.
bool set_luminance_stddev(const RenderContext& context, Film& film, RenderStats& stats,
                          const RenderProgress* progress) {
    const Crop crop = crop_of(context.settings, film);
    const bool whole = film.width == crop.picture_width && film.height == crop.picture_height,
               has_samples = context.settings.first_sample == 0;
    if (whole && has_samples) {
        update_luminance_stddev(film);
        return true;
    }
    Pilot pilot(crop, film, has_samples);
    RenderContext of_pilot = context;
    of_pilot.settings.crop = pilot.crop;
    of_pilot.settings.noise_threshold = 0.0;
    RenderProgress cancel_only;
    if (progress) cancel_only.cancel = progress->cancel;
    const std::function<double()> no_clock;
    RenderStats traced;
    render_pass(of_pilot, pilot_samples, pilot.film, traced, &cancel_only, {no_clock, std::nullopt});
    stats.rays.intersect += traced.rays.intersect;
    stats.rays.occluded += traced.rays.occluded;
    stats.rays.invalid += traced.rays.invalid;
    if (cancelled(progress)) return false;
    update_luminance_stddev(pilot.film);
    pilot.for_each_pixel(film, [&](const FilmPixel& pixel, size_t i) {
        film.pixel_states[i].luminance_stddev = pixel.luminance_stddev;
    });
    return true;
}

// What the samples before the film's first one say of its pixels.
void take_from(Film& before, Film& film, const RenderSettings& settings) {
    if (settings.first_sample == pilot_samples) update_luminance_stddev(before); // later ones have it
    if (settings.noise_threshold > 0.0) mark_converged_pixels(before, settings.noise_threshold);
    const Crop crop = crop_of(settings, film);
    for (size_t i = 0; i < film.pixel_states.size(); ++i) {
        const FilmPixel& from =
            before.pixel_states[(crop.y + i / film.width) * before.width + crop.x + i % film.width];
        film.pixel_states[i].converged = from.converged;
        film.pixel_states[i].luminance_stddev = from.luminance_stddev;
    }
}

// Decides what depends on the samples before `begin`, where all pixels stand. False: nothing is left to do.
bool decide(const RenderContext& context, uint32_t begin, Film& film, RenderStats& stats,
            const RenderProgress* progress) {
    const RenderSettings& settings = context.settings;
    const bool first = begin == settings.first_sample;
    if (first && settings.before)
        take_from(*settings.before, film, settings);
    else if (begin == std::max(settings.first_sample, pilot_samples)) {
        stats.cancelled = !set_luminance_stddev(context, film, stats, progress);
        if (stats.cancelled) return false;
    }
    const bool adapts = settings.noise_threshold > 0.0 && begin > 0 && begin % samples_per_round == 0;
    if (!adapts || (first && !settings.before)) return true;
    if (!first) mark_converged_pixels(film, settings.noise_threshold);
    return std::ranges::any_of(film.pixel_states, [](const FilmPixel& p) { return !p.converged; });
}

void render_passes(const RenderContext& context, Film& film, RenderStats& stats, RenderProgress* progress) {
    const RenderSettings& settings = context.settings;
    const std::function<double()> clock = settings.clock ? settings.clock : wall_seconds;
    const double start = clock();
    Deadline deadline{clock, std::nullopt};
    double seconds_per_sample = 0.0; // 0: not known yet
    constexpr double unlimited = std::numeric_limits<double>::infinity();
    const bool splits_passes = progress && progress->between_passes && progress->seconds_between_passes > 0.0;
    for (uint32_t begin = progress_of(film).min; begin < settings.samples;) {
        const uint32_t end = std::min(pass_end(begin), settings.samples);
        if (all_at(begin, film) && !decide(context, begin, film, stats, progress)) return;
        while (begin < end) { // partial passes: near the deadline, to measure the cost, or to split them
            // The first sample is always completed.
            if (settings.seconds > 0.0 && begin > settings.first_sample)
                deadline.time = start + settings.seconds;
            stats.out_of_time = deadline.passed();
            if (stats.out_of_time) return;
            double left = deadline.time ? *deadline.time - clock() : unlimited;
            if (splits_passes) left = std::min(left, progress->seconds_between_passes);
            const uint32_t partial_end =
                left < unlimited ? partial_pass_end(film, end, left, seconds_per_sample) : end;
            const uint64_t samples_before = count_samples(film).total;
            const double before = clock();
            render_pass(context, partial_end, film, stats, progress, deadline);
            stats.cancelled = cancelled(progress);
            if (stats.cancelled) return;
            stats.out_of_time = progress_of(film).min < partial_end;
            if (stats.out_of_time) return;
            const uint64_t samples_taken = count_samples(film).total - samples_before;
            if (samples_taken > 0) seconds_per_sample = (clock() - before) / double(samples_taken);
            begin = partial_end;
            const bool goes_on = settings.seconds <= 0.0 || clock() < start + settings.seconds;
            if (begin < settings.samples && goes_on && context.world.lazy)
                context.world.lazy->merge_built_patches();
            if (splits_passes && begin < end) progress->between_passes(film);
        }
        if (begin < settings.samples && progress && progress->between_passes) progress->between_passes(film);
    }
}

} // namespace

RenderStats render(const World& world, const Lights& lights, std::span<const Material> materials,
                   const Camera& camera, const RenderSettings& settings, Film& film,
                   RenderProgress* progress) {
    const Crop crop = crop_of(settings, film);
    RenderContext context{
        .world = world,
        .lights = lights,
        .materials = materials,
        .settings = settings,
        .camera = CameraRays(camera, crop.picture_width, crop.picture_height),
        .filter = FilterSampler(settings.filter),
        .has_motion_blur = world.times.size() > 1 || camera.poses.size() > 1,
        .pixel_spread = static_cast<float>(2.0 * std::tan(0.5 * camera.vertical_fov) / crop.picture_height)};
    find_attributes(context, film);
    RenderStats stats;
    const uint64_t samples_before = count_samples(film).total;
    for (FilmPixel& pixel : film.pixel_states)
        pixel.next_sample = std::max(pixel.next_sample, settings.first_sample);
    if (progress)
        progress->samples_done =
            progress_of(film).sum - uint64_t(settings.first_sample) * film.pixel_states.size();
    render_passes(context, film, stats, progress);
    const SampleCount count = count_samples(film);
    stats.max_samples = count.max;
    stats.mean_samples = count.mean;
    if (count.total > samples_before) stats.cut_throughput /= double(count.total - samples_before);
    stats.clamped_fraction = clamped_fraction(film);
    resolve(film);
    return stats;
}

} // namespace marram
