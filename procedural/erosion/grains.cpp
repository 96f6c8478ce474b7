// SPDX-License-Identifier: Apache-2.0
// Wear of rock by wind-blown sand, computed like path tracing: grains start upwind, fly, hit, wear the
// surface, rebound.
//
// The stream. Q = transport (kg of sand per year and metre of width) crosses a plane upwind of the scene's
// box. With h above the ground and H = height, the flux falls as exp(-h / H): Q / H exp(-h / H) kg per year
// and m^2. (Measured profiles are exponential over most of their mass: Anderson 1986; Kok, Parteli, Michaels
// and Karam 2012, who give H of 2 to 5 cm over sand. Over stony ground grains bounce twice as high or more:
// Bridges et al. 2005.) For an exponential flux of freely falling grains, vertical velocities w must be
// normal with variance g H at every height: exp(-(w^2 / 2 + g h) / (g H)) depends only on the energy of a
// hop. So flight does not change the distribution, and each height is crossed upwards as often as downwards.
// With H = 0.1 m, w is about 1 m/s: at 3 to 10 m/s grains descend at 6 to 18 degrees (5 to 15 are measured:
// Kok et al. 2012). These angles wear horizontal ground, and horizontal faces less than steep ones.
// Horizontal speed:
//     v(h) = bed_speed + (speed - bed_speed) (1 - exp(-h / speed_height)).
// Speed grows with height and flux falls, so that the energy flux on a post is greatest above its base: this
// is how pedestals form (Anderson 1986). With r = speed_height / H the maximum is at
//     h = -speed_height ln((speed / (speed - bed_speed)) / (1 + 2 / r)).
//
// Flight. dv/dt = -g y + (v_air - v) / drag_time, v_air = v(h) along the wind. An arc leads from one event to
// the next. Without drag it is a parabola, and ends where it leaves the box or meets level sand: roots of
// polynomials. With drag v_air is constant in an arc, which has one chord:
//     x(t) = x + V t + (v - V) tau (1 - exp(-t / tau)),   V = v_air - g tau y   (tau = drag_time; V: final velocity).
// Rays follow chords of arcs. The sagitta of a chord of duration dt is at most |a| dt^2 / 8, limited by
// path_error. The first chord from a surface lasts at most v.n / -a.n, half a hop over the plane of that
// surface; a longer one would enter it. Obstacles do not affect the air: eddies in a lee do not drag grains.
//
// Empty space (empty_space.h). A chord that stays in a ball with nothing in it needs no ray. Where chords
// begin and end does not depend on what is known of empty space, so the result is the same bits without it.
//
// Wear of a hit at the angle A to the surface, for E = v^2 / 2 (J per kg of sand), in m^3 of rock per kg of
// sand:
//     max(E sin^n A - Ec, 0) / energy_per_volume,   Ec = threshold_speed^2 / 2,   n = angle_exponent.
// n = 0: in proportion to the total energy (Anderson 1986), n = 2: to that normal to the surface, as brittle
// rock wears (Sklar and Dietrich 2004). Below the threshold grains rebound without wear (Bridges et al.
// 2005). energy_per_volume = k s^2 / (2 Y) with tensile strength s, Young's modulus Y and k about 1e6 (Sklar
// and Dietrich 2004). s = 10 MPa, Y = 50 GPa give 1e9 J/m^3, and for the default stream 0.5 mm a year where a
// windward face wears most; 0.03 to 1.6 mm a year are measured on rocks in the field. The
// wear rate of a surface is this times the flux through it. The flux, proportional to sin A, comes from the
// number of hits.
//
// Rebound. Velocity normal to the surface is multiplied by -normal_restitution, along it by
// tangent_restitution (0.5 to 0.9 are measured on rock). Then scatter times a random unit vector is added to
// the unit direction, at the same speed; directions into the surface are mirrored. A grain that lands on sand
// is replaced by one that leaves: in a stream in equilibrium their numbers are equal (Kok et al. 2012). It
// leaves along the surface at bed_speed, and normal to it at w >= 0 with density w exp(-w^2 / (2 g H)), the
// flux of the normal distribution above. So level sand neither weakens nor strengthens the stream. A grain
// that has hit rock before leaves sand with at most the energy of its landing: otherwise sand under an
// overhang would send up more energy than it receives.
//
// A grain ends where it leaves the box (counted for each side), settles, reaches a limit, or cannot reach the
// threshold any more: without drag and sand, E + g (y - lowest) < Ec. The box is the scene's bounds, within
// `reach` of the worn meshes' bounds; grains above it are kept, as they fall back. The start plane is its
// upwind side, widened by its length times tan(spread). Over level sand (ground) it is 2 H further upwind, or
// the box's length if that is less.
//
// Accounting. Energies are rounded to 2^-20 J/kg at each event, and all sums use 64-bit integers: they
// balance exactly and are bitwise the same for any number of threads. The quanta of a hit are distributed to
// the corners of its triangle by barycentric weights, rounded so that their sum is preserved. A vertex has a
// third of the area of its triangles: depth = quanta 2^-20 mass_per_grain / (energy_per_volume area), the
// mean of the rate weighted by the hat function.
//
// Random numbers. Path i starts at point i of the five-dimensional Sobol sequence (Joe and Kuo 2008),
// Owen-scrambled by hashes of the seed. Event k of a path reuses the first two dimensions, scrambled and
// shuffled by hashes of the seed and k (Burley 2020): sobol.h.
//
// Ray origins are offset from a surface by the error bound of the hit point, 2 U (c + l q): grain_hits.cpp.
// Segments overlap by the rounding of their ends, so that no hit is missed between two segments.
//
// Limits. Grains do not collide or spin, and have one size; rock does not change during a trace. Meshes are
// read at their first motion sample.
//
// Order. The paths of a task are traced in the order of their places on the start plane. Of 8 10^6 grains around
// 1.5 10^6 triangles this saves an eighth of the time, as neighbours hit near each other.
//
// Cost. Sixteen grains leave sand, begin arcs and fly through empty space together, eight hit rock. A grain around a ball of
// 1.5 10^6 triangles has 0.8 hits, 5 landings on sand and 2.4 rays; build/marram_bench prints what it takes,
// and what a chord on rough rock takes, beside Embree alone.
#include "procedural/erosion/grains.h"

#include "core/math/clock.h"
#include "core/math/hash.h"
#include "procedural/abi/parallel.h"
#include "procedural/erosion/grain_hits.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace marram {
namespace {

constexpr size_t max_rays = 40;                         // in a batch
constexpr uint64_t min_block = 4096, max_block = 65536; // grains per task

int64_t grain_quanta(double energy) { return int64_t(energy / grain_quantum + 0.5); } // energy: 0 or more
double grain_energy(const Vec3d& v) { return 0.5 * v.squaredNorm(); }

struct GrainCounts {
    std::array<uint64_t, 6> left{};
    uint64_t settled = 0, spent = 0, given_up = 0, worn_hits = 0, other_hits = 0, sand_hits = 0, grazes = 0,
             rays = 0;
    int64_t started = 0, flight = 0, sand = 0, rock = 0, ended = 0, worn = 0;
};

// ---- flight ----

// To the next chord. false: none of the arc is left.
bool advance_chord(Grain& grain) {
    const double begin = grain.first_chord_time + grain.chord * grain.chord_time; // as in find_rays()
    ++grain.chord;
    grain.parabola.t_clear = float(begin * (1.0 - 0x1p-23)); // not after the begin
    return begin < grain.end.time;
}

// ---- hits ----

void add_quanta(int64_t& to, int64_t quanta) {
    if (quanta != 0) std::atomic_ref<int64_t>(to).fetch_add(quanta, std::memory_order_relaxed);
}

void add_wear(GrainTracer& tracer, const WornPlace& place, int64_t quanta) {
    const double u = std::clamp(place.u, 0.0, 1.0), v = std::clamp(place.v, 0.0, 1.0 - u);
    const auto at1 = int64_t(u * double(quanta) + 0.5), at2 = int64_t(v * double(quanta) + 0.5);
    const size_t first = place.mesh->first_vertex;
    const uint32_t* const corners = place.corners();
    add_quanta(tracer.vertex_quanta[first + corners[0]], quanta - at1 - at2);
    add_quanta(tracer.vertex_quanta[first + corners[1]], at1);
    add_quanta(tracer.vertex_quanta[first + corners[2]], at2);
    if (!tracer.triangle_quanta.empty())
        add_quanta(tracer.triangle_quanta[place.mesh->first_triangle + place.triangle], quanta);
}

// ---- events: what becomes of a grain ----

// At the end of a flight, with velocity v: the energy in quanta. Counts what the flight has gained.
int64_t energy_after_flight(GrainCounts& counts, const Grain& grain, const Vec3d& v) {
    const int64_t energy = grain_quanta(grain_energy(v));
    counts.flight += energy - grain.energy;
    return energy;
}

// `as`: the count of grains that end in this way.
Next end_grain(GrainCounts& counts, const Grain& grain, const Vec3d& v, uint64_t& as) {
    counts.ended += energy_after_flight(counts, grain, v);
    ++as;
    return Next::none;
}

// At a hit of the traced chord.
void set_end(Grain& grain, const GrainHit& hit, const Vec3d& v) {
    grain.end.x = hit.x, grain.end.v = v, grain.end.chords = grain.chord + 1.0;
    grain.normal = hit.normal;
}

// The grain landed, and `leaving` replaces it. false: that settles.
bool count_landing(const GrainTracer& tracer, GrainCounts& counts, Grain& grain, const Vec3d& leaving) {
    const int64_t before = energy_after_flight(counts, grain, grain.end.v);
    ++counts.sand_hits;
    grain.energy = grain_quanta(grain_energy(leaving));
    counts.sand += grain.energy - before;
    ++grain.landings;
    if (grain_energy(leaving) >= tracer.settle && leaving.dot(grain.normal) > 0.0) return true;
    end_grain(counts, grain, leaving, counts.settled);
    return false;
}

Next hit_rock(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const GrainHit& hit,
              const WornPlace& place) {
    const GrainSettings& s = tracer.settings;
    const int64_t before = energy_after_flight(counts, grain, hit.v);
    ++(place.mesh ? counts.worn_hits : counts.other_hits);
    if (place.mesh) {
        const int64_t worn = grain_quanta(wearing_energy(s, grain_energy(hit.v), hit.sine));
        counts.worn += worn;
        add_wear(tracer, place, worn);
    }
    set_end(grain, hit, hit.rebound);
    const double left = grain_energy(hit.rebound);
    grain.energy = grain_quanta(left);
    counts.rock += before - grain.energy;
    ++grain.hits;
    if (left < tracer.settle || !(hit.rebound.dot(hit.normal) > 0.0))
        return end_grain(counts, grain, hit.rebound, counts.settled);
    if (s.drag_time <= 0.0 && !s.ground && s.sand.empty() &&
        left + s.gravity * std::max(hit.x.y() - tracer.box.y0, 0.0) < tracer.threshold)
        return end_grain(counts, grain, hit.rebound, counts.spent);
    if (grain.hits >= s.max_hits) return end_grain(counts, grain, hit.rebound, counts.given_up);
    return Next::start_arc;
}

// The grain continues, slightly above the surface.
Next grazes(GrainCounts& counts, Grain& grain, const GrainHit& hit) {
    ++counts.grazes;
    const double lack = min_rebound_sine * hit.v.norm() - hit.v.dot(hit.normal);
    set_end(grain, hit, lack > 0.0 ? Vec3d(hit.v + lack * hit.normal) : hit.v);
    grain.energy = energy_after_flight(counts, grain, grain.end.v);
    return Next::start_arc;
}

void end_flight(GrainCounts& counts, const Grain& grain) {
    const GrainArcEnd& end = grain.end;
    end_grain(counts, grain, end.v,
              end.how == ArcEnd::gives_up ? counts.given_up : counts.left[size_t(end.side)]);
}

// At the hit of the traced chord.
Next handle_hit(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const GrainHit& hit,
                const WornPlace& place, unsigned id) {
    if (std::binary_search(tracer.sand.begin(), tracer.sand.end(), id)) {
        set_end(grain, hit, hit.v);
        return Next::leave_sand;
    }
    if (hit.sine > 0.0) return hit_rock(tracer, counts, grain, hit, place);
    return grazes(counts, grain, hit); // the chord hits a surface that the path is leaving
}

// Handles grains in batches: sixteen that start, leave sand, begin an arc or fly on, eight that need a ray or
// have hit something, and up to 40 rays. Between two batches a grain waits for what is to be done next. New
// grains start only if nothing else fills a batch, which bounds their number.
class GrainWavefront {
  public:
    GrainWavefront(GrainTracer& tracer, uint64_t first, uint64_t end, GrainCounts& counts)
        : tracer_(tracer), counts_(counts), paths_(ordered_paths(tracer, first, end)), grains_(max_grains),
          rays_(max_rays) {
        for (uint32_t slot = 0; slot < max_grains; ++slot) put(slot, Next::none);
    }

    void trace() {
        for (uint64_t steps = 1;; ++steps) {
            if (steps % 64 == 0 && tracer_.hooks.cancelled && tracer_.hooks.cancelled()) return;
            if (!handle_batch()) return;
        }
    }

  private:
    // A batch of rays, less than a batch on each stack, and a batch that starts.
    static constexpr size_t max_grains = max_rays + lanes + 5 * grains_at_once;
    struct TracedHit {
        uint32_t slot;
        const RTCRayHit* ray;
        WornPlace place;
    };

    size_t waiting(Next next) const { return waiting_[size_t(next)]; }
    void put(uint32_t slot, Next next) { stacks_[size_t(next)][waiting_[size_t(next)]++] = slot; }
    void put_batch(GrainBatch batch) {
        for (size_t k = 0; k < batch.size(); ++k) put(batch_slots_[k], next_[k]);
    }

    // false: all grains have ended.
    bool handle_batch() {
        if (waiting(Next::trace_ray) >= lanes)
            set_rays();
        else if (waiting(Next::fly) >= grains_at_once)
            follow_arcs();
        else if (waiting(Next::leave_sand) >= grains_at_once)
            leave_sand();
        else if (waiting(Next::start_arc) >= grains_at_once)
            start_arcs();
        else if (waiting(Next::end_flight) >= grains_at_once)
            end_flights();
        else if (next_path_ < paths_.size())
            emit_grains();
        else if (waiting(Next::leave_sand) > 0)
            leave_sand();
        else if (waiting(Next::start_arc) > 0)
            start_arcs();
        else if (waiting(Next::fly) > 0)
            follow_arcs();
        else if (waiting(Next::trace_ray) > 0)
            set_rays();
        else if (!ray_queue_.empty())
            trace_rays();
        else if (waiting(Next::end_flight) > 0)
            end_flights();
        else
            return false;
        return true;
    }

    // The last slots that were put on a stack, as their grains may still be in the cache.
    GrainBatch take(Next next, size_t most) {
        size_t& on_stack = waiting_[size_t(next)];
        const size_t count = std::min(on_stack, most);
        for (size_t k = 0; k < count; ++k) {
            batch_slots_[k] = stacks_[size_t(next)][--on_stack];
            batch_[k] = &grains_[batch_slots_[k]];
        }
        return {batch_.data(), count};
    }

    void emit_grains() {
        const GrainBatch batch = take(Next::none, std::min(paths_.size() - next_path_, grains_at_once));
        for (Grain* grain : batch) grain->path = paths_[next_path_++], grain->hits = grain->landings = 0;
        marram::emit_grains(tracer_, batch, states_);
        for (size_t k = 0; k < batch.size(); ++k)
            counts_.started += batch[k]->energy = grain_quanta(grain_energy(states_.velocity(k)));
        marram::start_arcs(tracer_, batch, states_, next_);
        put_batch(batch);
    }

    void leave_sand() {
        const GrainBatch batch = take(Next::leave_sand, grains_at_once);
        load_grains(batch, states_);
        marram::leave_sand(tracer_, batch, states_);
        uint32_t settle = 0;
        for (size_t k = 0; k < batch.size(); ++k)
            settle |= uint32_t(!count_landing(tracer_, counts_, *batch[k], states_.velocity(k))) << k;
        marram::start_arcs(tracer_, batch, states_, next_);
        for (; settle != 0; settle &= settle - 1) next_[size_t(std::countr_zero(settle))] = Next::none;
        put_batch(batch);
    }

    void start_arcs() {
        const GrainBatch batch = take(Next::start_arc, grains_at_once);
        load_grains(batch, states_);
        marram::start_arcs(tracer_, batch, states_, next_);
        put_batch(batch);
    }

    void follow_arcs() {
        const GrainBatch batch = take(Next::fly, grains_at_once);
        marram::follow_arcs(tracer_, batch, next_);
        put_batch(batch);
    }

    void end_flights() {
        const GrainBatch batch = take(Next::end_flight, grains_at_once);
        for (size_t k = 0; k < batch.size(); ++k)
            end_flight(counts_, *batch[k]), put(batch_slots_[k], Next::none);
    }

    void set_rays() {
        if (ray_queue_.size() + lanes > max_rays) trace_rays();
        const GrainBatch batch = take(Next::trace_ray, lanes);
        const std::span<RTCRayHit> rays = std::span(rays_).subspan(ray_queue_.size(), batch.size());
        const uint32_t fails = marram::set_rays(tracer_, batch, rays);
        size_t count = 0;
        for (size_t k = 0; k < batch.size(); ++k) {
            if ((fails >> k & 1U) != 0) {
                put(batch_slots_[k], end_grain(counts_, *batch[k], batch[k]->v, counts_.given_up));
            } else {
                if (count < k) rays[count] = rays[k];
                ++count, ray_queue_.push_back(batch_slots_[k]);
            }
        }
    }

    void trace_rays() {
        const std::span<RTCRayHit> rays = std::span(rays_).first(ray_queue_.size());
        if (tracer_.hooks.rays) tracer_.hooks.rays(rays);
        size_t prefetched = 0;
        for (size_t k = 0; k < rays.size(); ++k) {
            marram_intersect1(tracer_.scene, &rays[k], 0); // rtcIntersect1M takes a third longer
            const uint32_t slot = ray_queue_[k];
            if (rays[k].hit.geomID != RTC_INVALID_GEOMETRY_ID) {
                hits_.push_back({slot, &rays[k], worn_place(tracer_, rays[k])});
                prefetch_triangle(tracer_, hits_.back().place);
                if (hits_.size() > 1) prefetch_corners(tracer_, hits_[prefetched++].place);
            } else {
                Grain& grain = grains_[slot];
                put(slot, advance_chord(grain) ? Next::fly : Next(grain.parabola.after));
            }
        }
        if (!hits_.empty()) prefetch_corners(tracer_, hits_.back().place);
        counts_.rays += rays.size();
        for (size_t first = 0; first < hits_.size(); first += lanes)
            handle_hits(std::span(hits_).subspan(first, std::min(hits_.size() - first, size_t(lanes))));
        hits_.clear();
        ray_queue_.clear();
    }

    void handle_hits(std::span<const TracedHit> batch) {
        std::array<const RTCRayHit*, lanes> rays;
        std::array<WornPlace, lanes> places;
        for (size_t k = 0; k < batch.size(); ++k)
            batch_[k] = &grains_[batch[k].slot], rays[k] = batch[k].ray, places[k] = batch[k].place;
        std::array<GrainHit, lanes> hits;
        find_hits(tracer_, {batch_.data(), batch.size()}, rays, places, hits);
        for (size_t k = 0; k < batch.size(); ++k)
            put(batch[k].slot,
                handle_hit(tracer_, counts_, *batch_[k], hits[k], places[k], lent_id(*rays[k])));
    }

    GrainTracer& tracer_;
    GrainCounts& counts_;
    std::vector<uint32_t> paths_;
    size_t next_path_ = 0; // of them
    std::vector<Grain> grains_;
    std::vector<RTCRayHit> rays_;
    std::vector<TracedHit> hits_;
    std::vector<uint32_t> ray_queue_;
    std::array<std::array<uint32_t, max_grains>, next_count>
        stacks_{}; // of slots of grains; Next::none: free ones
    std::array<size_t, next_count> waiting_{};
    Grains16 states_{};
    std::array<Grain*, grains_at_once> batch_{};
    std::array<uint32_t, grains_at_once> batch_slots_{};
    NextOfGrains next_{};
};

void add_counts(GrainReport& report, const GrainCounts& c) {
    for (size_t k = 0; k < 6; ++k) report.left[k] += c.left[k];
    report.settled += c.settled, report.spent += c.spent, report.given_up += c.given_up;
    report.worn_hits += c.worn_hits, report.other_hits += c.other_hits, report.sand_hits += c.sand_hits;
    report.grazes += c.grazes, report.rays += c.rays;
    report.started += c.started, report.flight += c.flight, report.sand += c.sand;
    report.rock += c.rock, report.ended += c.ended, report.worn += c.worn;
}

} // namespace

uint64_t GrainReport::ended_grains() const {
    uint64_t sum = settled + spent + given_up;
    for (const uint64_t side : left) sum += side;
    return sum;
}

double wearing_energy(const GrainSettings& s, double energy, double sine) {
    const double n = s.angle_exponent;
    const double share = n == 2.0 ? sine * sine : n == 0.0 ? 1.0 : std::pow(std::max(sine, 0.0), n);
    return std::max(energy * share - 0.5 * s.threshold_speed * s.threshold_speed, 0.0);
}

GrainReport trace_grains(RTCScene scene, std::span<const WornMesh> meshes, const GrainSettings& settings,
                         std::span<double> wear, std::span<double> triangle_wear, const GrainHooks& hooks) {
    if (const std::string fault = grain_settings_fault(settings); !fault.empty())
        throw std::invalid_argument(fault);
    const double begin = wall_seconds();
    GrainTracer tracer;
    tracer.scene = scene, tracer.settings = settings, tracer.hooks = hooks;
    tracer.threshold = 0.5 * settings.threshold_speed * settings.threshold_speed;
    tracer.settle = 0.5 * settings.settle_speed * settings.settle_speed;
    tracer.launch = std::sqrt(settings.gravity * settings.height);
    tracer.sand.assign(settings.sand.begin(), settings.sand.end());
    std::sort(tracer.sand.begin(), tracer.sand.end());
    take_worn_meshes(tracer, meshes, wear.size(), triangle_wear.size());
    for (uint32_t k = 0; k < tracer.event_seeds.size(); ++k)
        tracer.event_seeds[k] = event_seeds(settings.seed, k);
    for (size_t d = 0; d < 5; ++d) tracer.shifts[d] = uint32_t(hash(settings.seed, 0x6772ULL + d));
    std::fill(wear.begin(), wear.end(), 0.0);
    std::fill(triangle_wear.begin(), triangle_wear.end(), 0.0);
    GrainReport report;
    if (!scene || !find_grain_box(tracer)) return report;
    find_empty_space(tracer);
    const uint64_t block = std::clamp(std::bit_ceil(settings.paths / 64), min_block, max_block);
    const uint64_t blocks = (settings.paths + block - 1) / block;
    std::vector<GrainCounts> counts(blocks);
    const auto stopped = [&] { return hooks.cancelled && hooks.cancelled(); };
    marram::parallel_for(uint64_t(0), blocks, [&](uint64_t k) {
        if (!stopped())
            GrainWavefront(tracer, k * block, std::min((k + 1) * block, settings.paths), counts[k]).trace();
    });
    for (const GrainCounts& c : counts) add_counts(report, c);
    report.grains = settings.paths;
    report.cancelled = report.ended_grains() != report.grains;
    const double width = tracer.box.t1 - tracer.box.t0;
    report.mass_per_grain = settings.transport * width * tracer.share / double(settings.paths);
    const double volume = report.mass_per_grain * grain_quantum / settings.energy_per_volume;
    report.volume = double(report.worn) * volume;
    if (!report.cancelled) write_wear(tracer, volume, wear, triangle_wear);
    report.seconds = wall_seconds() - begin;
    return report;
}

} // namespace marram
