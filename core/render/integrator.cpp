// SPDX-License-Identifier: Apache-2.0
// The estimator. A path x0 (camera), x1, x2, ... carries the throughput beta = prod f cos / p of the
// directions drawn so far. At each vertex the light that arrives directly is the integral of f cos L over
// directions, estimated twice and weighted by the power heuristic (Veach, "Robust Monte Carlo Methods for
// Light Transport Simulation", 1997):
//
//   once by drawing a direction of a light (density l):
//     beta f cos L / l . l^2 / (l^2 + p^2), if nothing is in the way;
//   once by going on along the shader's draw (density p):
//     beta' L . p^2 / (l^2 + p^2), if it meets a light.
//
// What the camera sees directly has nothing to be weighed against and counts whole; so does light that only
// one of the two can reach. Russian roulette ends a path with probability 1 - max(beta) and divides what goes
// on by max(beta).
//
// Roulette also decides whether anything in the way of a light is looked for at all: if nothing were, luminance C would be
// added to a sample whose own spread is S, the pixel's standard deviation. C is asked about with probability
// q = min(1, C / (w S)) and then counts 1 / q times. A vertex so adds C (w S - C), at most (w S / 2)^2, to the sample's variance S^2,
// so that clean pixels stay as clean as they are, and the rays of noisy ones go where they matter: time times variance is least
// for q proportional to C / S (Bolin and Meyer, "An error metric for Monte Carlo ray tracing", 1997; Rath et al., "EARS:
// Efficiency-Aware Russian Roulette and Splitting", 2022). What the first vertex adds is well stratified, S overstates its
// noise: w is small there. S comes from earlier passes, which does not bias: whatever it is, the mean over the roulette is
// the same.
//
// A clamp limits what a sample's later vertices add up to: not what the camera or the first surface sees of lights, which is
// well sampled and whose highlights are to stay. Bids of the roulette are kept far below it, or winners would be cut.
//
// A path stands for a cone of light paths, whose width tells textures how much to average: a pixel wide at the camera, and
// from each vertex on as wide as the share of directions that the draw stands for, 1 / p (after Akenine-Moller et al.,
// "Texture Level of Detail Strategies for Real-Time Ray Tracing", 2019). Curvature is left out.
//
// Random numbers, four to a set: 0 film and lens, 1 time (in set 0 where there is no lens), then two a vertex, one for the lights
// and the roulette, one for the shader; a vertex's sets are fixed, whatever it draws.
//
// Passes of 1, 3, 12, 16, 16, ... samples over the whole image show something early; a pixel belongs to one task in each, which
// adds its samples in their order. Where passes end is fixed, and so is all that is decided there: a render that stops within a
// pass, even at other pixels than before, goes on to the same bits.
#include "core/render/integrator.h"

#include "core/math/clock.h"
#include "core/math/color.h"
#include "core/math/hash.h"
#include "core/render/adaptive.h"
#include "core/render/sampler.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>

namespace marram {

namespace {

constexpr uint32_t time_set = 1, first_vertex_set = 2, sets_a_vertex = 2;
constexpr float worth_first = 0.3F, worth_later = 0.8F; // w above, at a path's first vertex and at others

float luminance(const Vec3f& rgb) { return marram::luminance(rgb[0], rgb[1], rgb[2]); }

// Everything that is the same for all samples.
struct Frame {
    const World& world;
    const Lights& lights;
    std::span<const Material> materials;
    const RenderSettings& settings;
    CameraRays camera;
    FilterSampler filter;
    Material fallback;
    std::vector<const CurveAttributeValues*> tints;  // [curve geometry]
    std::vector<const CurveAttributeValues*> ids;    // [curves] or nullptr: each strand's own number
    std::vector<const CurveAttributeValues*> layers; // [curve geometry * film layers + layer]
    bool moves;
    float pixel_angle; // radians
    bool wants_albedo = false;
};

// The width of what a path stands for, and by how much it grows a metre.
struct Cone {
    float width = 0.0F, growth = 0.0F;
};

struct FirstHit {
    bool hit = false;
    SurfacePoint point;
    Vec3f albedo = Vec3f::Zero(), normal = Vec3f::Zero();
};

float power_heuristic(float mine, float other) {
    if (!(mine > 0.0F)) return 0.0F;
    const float ratio = other / mine; // squares of densities overflow for small suns
    return 1.0F / (1.0F + ratio * ratio);
}

const Material& material_of(const Frame& frame, int index) {
    const bool known = index >= 0 && static_cast<size_t>(index) < frame.materials.size();
    return known ? frame.materials[static_cast<size_t>(index)] : frame.fallback;
}

void find_attributes(Frame& frame, const Film& film) {
    for (const FilmLayer& layer : film.layers) frame.wants_albedo |= layer.kind == LayerKind::albedo;
    for (const CurveGeometry& curves : frame.world.curves) {
        frame.tints.push_back(find_attribute(curves, material_of(frame, curves.material).tint));
        const CurveAttributeValues* ids = find_attribute(curves, "id");
        frame.ids.push_back(ids && ids->components == 1 && !ids->per_cv ? ids : nullptr);
        for (const FilmLayer& layer : film.layers)
            frame.layers.push_back(layer.kind == LayerKind::attribute ? find_attribute(curves, layer.name)
                                                                      : nullptr);
    }
}

// In uv, of a width along a triangle.
float uv_width(const Frame& frame, const SurfacePoint& at, float width) {
    const MeshGeometry& mesh = frame.world.meshes[at.geometry];
    float area = 0.5F; // of barycentrics, which stand for uvs where a mesh has none
    if (!mesh.uvs.empty()) {
        const auto& corners = mesh.triangles[at.primitive];
        const Vec2f b = mesh.uvs[corners[1]] - mesh.uvs[corners[0]],
                    c = mesh.uvs[corners[2]] - mesh.uvs[corners[0]];
        area = 0.5F * std::abs(b.x() * c.y() - b.y() * c.x());
    }
    return at.area > 0.0F ? width * std::sqrt(area / at.area) : 0.0F;
}

ShadingPoint shading_point(const Frame& frame, const SurfacePoint& at, const Vec3f& wo, float width) {
    ShadingPoint point;
    point.wo = wo;
    point.geometric_normal = at.geometric_normal;
    point.normal = at.normal;
    point.tangent = at.tangent;
    point.uv = at.uv;
    point.fibre = at.shape != PointShape::triangle;
    point.position = at.position;
    point.footprint = width;
    if (!point.fibre) {
        // Along the surface it is longer by the cosine one way: a square of the same area.
        const float onto = std::max(std::abs(at.geometric_normal.dot(wo)), 0.01F);
        point.uv_width = uv_width(frame, at, width / std::sqrt(onto));
        return point;
    }
    point.flat = at.shape != PointShape::round;
    point.h = at.h;
    point.strand_u = at.strand_u;
    const uint32_t curves = at.geometry - static_cast<uint32_t>(frame.world.meshes.size());
    // Strands that carry an id keep their looks when others come and go; an index does not.
    const CurveAttributeValues* ids = frame.ids[curves];
    point.strand = static_cast<uint32_t>(
        hash(curves, ids ? std::bit_cast<uint32_t>(ids->values[at.strand]) : at.strand));
    if (const CurveAttributeValues* tint = frame.tints[curves]) {
        std::array<float, 4> values{};
        attribute_at(frame.world.curves[curves], *tint, at, values.data());
        // A name is no quantity: strands that differ in it are tinted each by a share of its own.
        point.tint = tint->discrete ? unit_float(mix32(std::bit_cast<uint32_t>(values[0]))) : values[0];
    }
    return point;
}

// Light that reaches the point directly, by drawing from the lights.
// `worth`: luminance that is worth a ray.
Vec3f direct_light(const Frame& frame, const SurfacePoint& point, const Bsdf& bsdf, float time,
                   const Vec3f& throughput, float worth, const std::array<float, 3>& random,
                   RayCounts& counts) {
    const LightSample light = frame.lights.sample(point.position, time, random);
    if (!(light.pdf > 0.0F)) return Vec3f::Zero();
    if (frame.settings.strategy == Strategy::shaders_only && !light.delta) return Vec3f::Zero();
    const Vec3f direction = light.at_infinity
                                ? light.direction
                                : Vec3f((light.target - point.position).normalized().cast<float>());
    const BsdfValue scattered = evaluate(bsdf, direction);
    if (!(scattered.value.maxCoeff() > 0.0F)) return Vec3f::Zero();
    const bool alone = light.delta || frame.settings.strategy == Strategy::lights_only;
    const float weight = alone ? 1.0F : power_heuristic(light.pdf, scattered.pdf);
    Vec3f arriving =
        throughput.cwiseProduct(scattered.value).cwiseProduct(light.radiance) * (weight / light.pdf);
    if (const float found = luminance(arriving); found < worth) {
        if (!(light.unused * worth < found)) return Vec3f::Zero();
        arriving *= worth / found;
    }
    const Ray ray =
        light.at_infinity ? spawn(point, direction, time) : spawn_towards(point, light.target, 0.0, time);
    return occluded(frame.world, ray, &counts) ? Vec3f::Zero() : arriving;
}

// The weight of light found along a shader's draw of density `drawn`; below 0: the camera's own ray.
float found_weight(const Frame& frame, float drawn, float light_pdf) {
    if (drawn < 0.0F || frame.settings.strategy == Strategy::shaders_only) return 1.0F;
    if (frame.settings.strategy == Strategy::lights_only && light_pdf > 0.0F) return 0.0F;
    return power_heuristic(drawn, light_pdf);
}

// Luminance that is worth a ray to a light.
float worth(const Frame& frame, float spread, uint32_t depth) {
    if (depth == 0) return spread * worth_first;
    const float bid = spread * worth_later;
    return frame.settings.clamp > 0.0F ? std::min(bid, 0.1F * frame.settings.clamp) : bid;
}

bool survives(Vec3f& throughput, float random) {
    const float chance = std::min(1.0F, throughput.maxCoeff());
    if (!(random < chance)) return false;
    throughput /= chance;
    return true;
}

// What a path brings: seen or scattered by one surface, and by more.
struct Gathered {
    Vec3f direct = Vec3f::Zero(), later = Vec3f::Zero();
    float cut = 0.0F; // luminance of the throughput of a path that max_depth ends
};

// `spread`: of the pixel's samples; 0 where it is not known.
Gathered trace(const Frame& frame, Ray ray, float spread, const Sampler& sampler, FirstHit& first,
               RayCounts& counts) {
    Gathered light;
    Vec3f throughput = Vec3f::Ones();
    float drawn = -1.0F;
    Cone cone{0.0F, frame.pixel_angle};
    SurfacePoint later;
    for (uint32_t depth = 0;; ++depth) {
        SurfacePoint& point = depth == 0 ? first.point : later;
        Vec3f& seen = depth <= 1 ? light.direct : light.later; // along the ray
        if (!intersect(frame.world, ray, point, depth == 0, &counts)) {
            const auto weight = [&](float light_pdf) { return found_weight(frame, drawn, light_pdf); };
            seen +=
                throughput.cwiseProduct(frame.lights.environment_radiance(ray.direction, depth == 0, weight));
            return light;
        }
        if (point.light >= 0) {
            const SeenLight lamp = frame.lights.emitted(point, ray.direction);
            if (lamp.pdf >= 0.0F)
                seen += found_weight(frame, drawn, lamp.pdf) * throughput.cwiseProduct(lamp.radiance);
        }
        const bool last = depth >= frame.settings.max_depth;
        if (depth == 0) {
            first.hit = true;
            first.normal =
                point.geometric_normal.dot(ray.direction) > 0.0F ? Vec3f(-point.normal) : point.normal;
        }
        if (last) light.cut = luminance(throughput);
        if (last && !(depth == 0 && frame.wants_albedo)) return light;
        cone.width += cone.growth * point.distance;
        const Bsdf bsdf = bsdf_at(material_of(frame, point.material),
                                  shading_point(frame, point, -ray.direction, cone.width));
        if (depth == 0 && frame.wants_albedo) first.albedo = albedo(bsdf);
        if (last) return light;
        const uint32_t set = first_vertex_set + sets_a_vertex * depth;
        const auto [where_a, where_b, choice, luck] = sampler.numbers(set);
        if (!frame.lights.empty())
            (depth == 0 ? light.direct : light.later) +=
                direct_light(frame, point, bsdf, ray.time, throughput, worth(frame, spread, depth),
                             {choice, where_a, where_b}, counts);
        BsdfSample next;
        if (!sample(bsdf, sampler.numbers(set + 1), next)) return light;
        throughput = throughput.cwiseProduct(next.value) / next.pdf;
        if (depth + 1 >= frame.settings.roulette_depth && !survives(throughput, luck)) return light;
        drawn = next.pdf;
        cone.growth = std::max(cone.growth, 1.0F / std::sqrt(static_cast<float>(pi) * next.pdf));
        ray = spawn(point, next.wi, ray.time);
    }
}

// The luminance that it takes from `later`.
double clamp(Vec3f& later, float limit) {
    const float most = later.maxCoeff();
    if (!(limit > 0.0F && most > limit)) return 0.0;
    const float before = luminance(later);
    later *= limit / most;
    return before - luminance(later);
}

void add(const double* values, uint32_t channels, double* sums) {
    for (uint32_t c = 0; c < channels; ++c) sums[c] += values[c];
    sums[channels] += 1.0;
}

void add(const Vec3f& color, double* sums) {
    for (int c = 0; c < 3; ++c) sums[c] += static_cast<double>(color[c]);
    sums[3] += 1.0;
}

void add(float value, double* sums) {
    sums[0] += static_cast<double>(value);
    sums[1] += 1.0;
}

void add_attribute(const Frame& frame, const FilmLayer& layer, size_t layer_index, size_t layer_count,
                   const SurfacePoint& point, double* sums) {
    const size_t curves = point.geometry - frame.world.meshes.size();
    const CurveAttributeValues* attribute = frame.layers[curves * layer_count + layer_index];
    if (!attribute) return;
    // Of names a pixel keeps the first that it meets: a mean of two would be a third.
    if (attribute->discrete && sums[layer.channels] > 0.0) return;
    std::array<float, 4> values{};
    attribute_at(frame.world.curves[curves], *attribute, point, values.data());
    const std::array<double, 4> wide = {values[0], values[1], values[2], values[3]};
    add(wide.data(), layer.channels, sums);
}

void add_sample(const Frame& frame, const Vec3f& radiance, const FirstHit& first, const Film& film,
                double* pixel) {
    const bool strand = first.hit && first.point.shape != PointShape::triangle;
    for (size_t i = 0; i < film.layers.size(); ++i) {
        const FilmLayer& layer = film.layers[i];
        double* sums = pixel + layer.first;
        switch (layer.kind) {
        case LayerKind::beauty:
            add(radiance, sums);
            break;
        case LayerKind::variance:
            for (int c = 0; c < 3; ++c) {
                const auto value = static_cast<double>(radiance[c]);
                sums[c] += value;
                sums[c + 3] += value * value;
            }
            sums[6] += 1.0;
            break;
        case LayerKind::alpha:
            add(first.hit ? 1.0F : 0.0F, sums);
            break;
        case LayerKind::albedo:
            add(first.albedo, sums);
            break;
        case LayerKind::normal:
            add(first.normal, sums);
            break;
        case LayerKind::depth:
            if (first.hit) add(first.point.distance, sums);
            break;
        case LayerKind::strand_u:
            if (strand) add(first.point.strand_u, sums);
            break;
        case LayerKind::attribute:
            if (strand) add_attribute(frame, layer, i, film.layers.size(), first.point, sums);
            break;
        }
    }
}

Ray camera_ray(const Frame& frame, const Film& film, uint32_t x, uint32_t y, const Sampler& sampler) {
    const auto [film_x, film_y, a, b] = sampler.numbers(0);
    const bool has_lens = frame.camera.has_lens();
    const float time = !frame.moves ? 0.0F : has_lens ? sampler.numbers(time_set)[0] : a;
    return frame.camera((x + 0.5 + frame.filter(film_x)) / film.width,
                        (y + 0.5 + frame.filter(film_y)) / film.height, {a, b}, time);
}

struct Tile {
    uint32_t x0, y0, x1, y1;
};

bool cancelled(const RenderProgress* progress) {
    return progress && progress->cancel && progress->cancel->load(std::memory_order_relaxed);
}

struct Deadline {
    const std::function<double()>& clock;
    std::optional<double> at; // on the clock
    bool over() const { return at && clock() >= *at; }
};

// The pixel's samples from `begin` to `end`.
void render_pixel(const Frame& frame, uint32_t x, uint32_t y, uint32_t begin, uint32_t end, Film& film,
                  RenderStats& stats) {
    const size_t at = static_cast<size_t>(y) * film.width + x;
    FilmPixel& pixel = film.pixels[at];
    pixel.samples += end - begin;
    double* sums = film.sums.data() + at * film.stride;
    const uint64_t seed = pixel_seed(frame.settings.seed, x, y);
    for (uint32_t s = begin; s < end; ++s) {
        const Sampler sampler(seed, s);
        FirstHit first;
        const Ray ray = camera_ray(frame, film, x, y, sampler);
        Gathered found = trace(frame, ray, pixel.deviation, sampler, first, stats.rays);
        if ((found.direct + found.later).allFinite()) {
            pixel.clamped += clamp(found.later, frame.settings.clamp);
            const Vec3f radiance = found.direct + found.later;
            add_sample(frame, radiance, first, film, sums);
            add_luminance(pixel, luminance(radiance));
        } else {
            ++stats.dropped_samples;
        }
        stats.cut_throughput += double(found.cut);
        if ((s + 1) % film_block == 0) end_block(pixel);
    }
}

// The samples up to `end` of the tile's pixels, each from where it stands.
void render_tile(const Frame& frame, const Tile& tile, uint32_t end, Film& film, RenderStats& stats,
                 RenderProgress* progress, const Deadline& deadline) {
    bool stopped = false;
    for (uint32_t y = tile.y0; y < tile.y1 && !stopped; ++y) {
        uint64_t passed = 0;
        for (uint32_t x = tile.x0; x < tile.x1; ++x) {
            stopped = cancelled(progress) || deadline.over();
            if (stopped) break;
            FilmPixel& pixel = film.pixels[static_cast<size_t>(y) * film.width + x];
            const uint32_t begin = pixel.next_sample;
            if (begin >= end) continue; // this pass had come so far when it was stopped
            pixel.next_sample = end;
            passed += end - begin;
            if (!pixel.converged) render_pixel(frame, x, y, begin, end, film, stats);
        }
        if (progress) progress->samples_done.fetch_add(passed, std::memory_order_relaxed);
    }
}

void add_stats(const RenderStats& more, RenderStats& sum) {
    sum.rays.intersect += more.rays.intersect;
    sum.rays.occluded += more.rays.occluded;
    sum.rays.dropped += more.rays.dropped;
    sum.dropped_samples += more.dropped_samples;
    sum.cut_throughput += more.cut_throughput;
}

void render_pass(const Frame& frame, uint32_t end, Film& film, RenderStats& stats, RenderProgress* progress,
                 const Deadline& deadline) {
    const uint32_t size = std::max(frame.settings.tile, 1U);
    const uint32_t columns = (film.width + size - 1) / size, rows = (film.height + size - 1) / size;
    std::mutex guard;
    const auto body = [&](const tbb::blocked_range<uint32_t>& range) {
        for (uint32_t i = range.begin(); i < range.end(); ++i) {
            const uint32_t x = i % columns * size, y = i / columns * size;
            RenderStats mine;
            render_tile(frame, {x, y, std::min(x + size, film.width), std::min(y + size, film.height)}, end,
                        film, mine, progress, deadline);
            const std::lock_guard lock(guard);
            add_stats(mine, stats);
        }
    };
    tbb::parallel_for(tbb::blocked_range<uint32_t>(0, columns * rows, 1), body, tbb::simple_partitioner());
}

// The first end of a pass beyond `begin`, which is none itself where fewer samples were asked for once.
uint32_t pass_end(uint32_t begin) {
    constexpr uint32_t longest = 16; // samples: a pixel's share of a pass is what a cancel has to wait for
    if (begin >= longest) return (begin / longest + 1) * longest;
    uint32_t end = 1;
    while (end <= begin) end *= 4;
    return end;
}

// Whether pixels are looked at before the pass that begins here: once it has begun they were, and between the ends of passes
// never. Where none has begun it, looking again comes to the same.
bool is_between_passes(uint32_t begin, const Film& film) {
    return begin > 0 && pass_end(begin - 1) == begin && progress_of(film).greatest == begin;
}

// How far a sweep over all pixels goes that is to be over at the deadline: half as far as time would allow, at least one sample
// on, at most to the end of the pass. So the sweep that the deadline cuts is one of a single sample, as long as samples do not
// become twice as slow.
uint32_t sweep_end(const Film& film, uint32_t end, double seconds_left, double seconds_a_sample) {
    const uint32_t begin = progress_of(film).least;
    if (!(seconds_a_sample > 0.0)) return std::min(begin + 1, end); // not known yet: to learn it
    const double pixels = double(
        std::ranges::count(film.pixels, false, &FilmPixel::converged)); // those that still take samples
    const double samples =
        std::max(1.0, std::floor(0.5 * seconds_left / (seconds_a_sample * std::max(pixels, 1.0))));
    return samples < double(end - begin) ? begin + uint32_t(samples) : end;
}

void render_passes(const Frame& frame, Film& film, RenderStats& stats, RenderProgress* progress) {
    constexpr uint32_t enough_to_judge = 16; // samples, of a pixel's variance
    const RenderSettings& settings = frame.settings;
    const std::function<double()> clock = settings.clock ? settings.clock : wall_seconds;
    const double start = clock();
    Deadline deadline{clock, std::nullopt};
    double seconds_a_sample = 0.0; // 0: not known yet
    for (uint32_t begin = progress_of(film).least; begin < settings.samples;) {
        const uint32_t end = std::min(pass_end(begin), settings.samples);
        if (is_between_passes(begin, film)) {
            if (begin > 1) measure_spread(film);
            if (settings.noise > 0.0 && begin >= enough_to_judge && !find_noisy(film, settings.noise)) return;
        }
        while (begin < end) { // sweeps of one pass: more than one only where time runs out
            if (settings.seconds > 0.0 && begin > 0) deadline.at = start + settings.seconds;
            stats.out_of_time = deadline.over();
            if (stats.out_of_time) return;
            const double left = deadline.at ? *deadline.at - clock() : 0.0;
            const uint32_t sweep = deadline.at ? sweep_end(film, end, left, seconds_a_sample) : end;
            const uint64_t had = count_samples(film).total;
            const double before = clock();
            render_pass(frame, sweep, film, stats, progress, deadline);
            stats.cancelled = cancelled(progress);
            if (stats.cancelled) return;
            stats.out_of_time = progress_of(film).least < sweep;
            if (stats.out_of_time) return;
            const uint64_t took = count_samples(film).total - had;
            if (took > 0) seconds_a_sample = (clock() - before) / double(took);
            begin = sweep;
        }
        if (begin < settings.samples && progress && progress->between_passes) progress->between_passes(film);
    }
}

} // namespace

RenderStats render(const World& world, const Lights& lights, std::span<const Material> materials,
                   const Camera& camera, const RenderSettings& settings, Film& film,
                   RenderProgress* progress) {
    Frame frame{world,
                lights,
                materials,
                settings,
                CameraRays(camera, film.width, film.height),
                FilterSampler(settings.filter),
                {},
                {},
                {},
                {},
                world.times.size() > 1 || camera.poses.size() > 1,
                static_cast<float>(2.0 * std::tan(0.5 * camera.vertical_fov) / film.height)};
    find_attributes(frame, film);
    RenderStats stats;
    const uint64_t had = count_samples(film).total;
    if (progress) progress->samples_done = progress_of(film).sum;
    render_passes(frame, film, stats, progress);
    const SampleCount count = count_samples(film);
    stats.most_samples = count.most;
    stats.mean_samples = count.mean;
    if (count.total > had) stats.cut_throughput /= double(count.total - had);
    stats.clamped = clamped_share(film);
    resolve(film);
    return stats;
}

} // namespace marram
