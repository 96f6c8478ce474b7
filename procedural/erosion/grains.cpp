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
// Flight. dv/dt = -g y + (v_air - v) / drag_time, v_air = v(h) along the wind. An arc leads from one event to the
// next. Without drag it is a parabola, and ends where it leaves the box or meets level sand: roots of polynomials.
// With drag v_air is constant in an arc, which has one chord:
//     x(t) = x + V t + (v - V) tau (1 - exp(-t / tau)),   V = v_air - g tau y   (tau = drag_time; V: final velocity).
// Rays follow chords of arcs. The sagitta of a chord of duration dt is at most |a| dt^2 / 8, limited by path_error.
// The first chord from a surface lasts at most v.n / -a.n, half a hop over the plane of that surface; a longer one
// would enter it. Obstacles do not affect the air: eddies in a lee do not drag grains.
//
// Empty space (empty_space.h). A chord that stays in a ball with nothing in it needs no ray. Where chords begin and
// end does not depend on what is known of empty space, so the result is the same bits without it.
//
// Wear of a hit at the angle A to the surface, for E = v^2 / 2 (J per kg of sand), in m^3 of rock per kg of sand:
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
// Ray origins are offset from a surface by the error bound of the hit point: 2 U (c + l q), with U = 2^-23, c
// the largest coordinate, l the triangle's extent, q = |e1| |e2| / |e1 x e2|, as derived in
// core/geometry/hit.cpp. Segments overlap by the rounding of their ends, so that no hit is missed between two
// segments.
//
// Limits. Grains do not collide or spin, and have one size; rock does not change during a trace. Meshes are
// read at their first motion sample.
//
// Order. The paths of a task are traced in the order of their places on the start plane. Of 8 10^6 grains around
// 1.5 10^6 triangles this saves an eighth of the time, as neighbours hit near each other.
//
// Cost. Eight grains leave sand, begin arcs and are checked for empty space together. A grain around a ball of
// 1.5 10^6 triangles takes 1.8 us of one core, for 0.8 hits, 5 landings on sand and 2.4 rays, of which Embree takes
// 0.6 us (build/rock_erosion speed). On rough rock without sand a chord takes 0.5 us, of which Embree takes 0.3 us
// (build/grains speed).
#include "procedural/erosion/grains.h"

#include "core/math/clock.h"
#include "core/math/hash.h"
#include "procedural/erosion/grain_flight.h"
#include "procedural/parallel.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace marram {
namespace {

constexpr double grain_margin = 2.0;                       // factor on ray offsets
constexpr double grain_sliver = 1e4;                       // maximum q
constexpr size_t grain_window = 64;                        // rays in a batch, at most
constexpr uint64_t least_block = 4096, most_block = 65536; // grains per task
constexpr double min_rebound_sine = 0.01;                  // minimum sine between a rebound and the surface

int64_t grain_quanta(double energy) { return int64_t(energy / grain_quantum + 0.5); } // energy: 0 or more
double grain_energy(const Vec3d& v) { return 0.5 * v.squaredNorm(); }

struct GrainCounts {
    std::array<uint64_t, 6> left{};
    uint64_t settled = 0, spent = 0, given_up = 0, worn_hits = 0, other_hits = 0, sand_hits = 0, grazes = 0,
             rays = 0;
    int64_t started = 0, flight = 0, sand = 0, rock = 0, ended = 0, worn = 0;
};

// ---- flight ----

double start_of_chord(const Grain& grain, uint32_t chord) {
    return chord == 0 ? 0.0 : grain.first_chord_time + (chord - 1) * grain.chord_time;
}

// Advances grain.chord to the chord that contains the time `clear`, before which nothing is hit; less than grain.end.
void find_chord(Grain& grain, double clear) {
    if (grain.first_chord_time <= clear) {
        const double skipped =
            std::min((clear - grain.first_chord_time) / grain.chord_time, double(1U << 30));
        grain.chord = std::max(grain.chord, 1 + uint32_t(skipped));
    }
    grain.chord_t0 = start_of_chord(grain, grain.chord);
    grain.chord_t1 = std::min(start_of_chord(grain, grain.chord + 1), grain.end);
}

// Sets up the test for empty space from the grain's next chord on. false: none of the arc is left.
bool set_parabola(const Grain& grain, int lane, Parabolas8& out) {
    const double begin = start_of_chord(grain, grain.chord);
    if (!(begin < grain.end)) return false;
    const GrainParabola& p = grain.parabola;
    for (int axis = 0; axis < 3; ++axis)
        out.x[axis][lane] = p.x[axis], out.v[axis][lane] = p.v[axis], out.a[axis][lane] = p.a[axis];
    out.t_max[lane] = p.t_max, out.min_step[lane] = p.min_step, out.clearance[lane] = p.clearance;
    out.t_clear[lane] = float(begin * (1.0 - 0x1p-23)); // not after the begin
    return true;
}

// Sets up a float ray along the chord. false: too far from the origin, or the chord is too long.
bool set_grain_ray(const GrainTracer& tracer, const Grain& grain, RTCRayHit& out) {
    const Vec3d from = state_after(tracer, grain, grain.chord_t0).x;
    const Vec3d to =
        (grain.chord_t1 < grain.end ? state_after(tracer, grain, grain.chord_t1) : grain.end_state).x;
    const Vec3d way = to - from;
    const double length = way.norm(), c = from.cwiseAbs().maxCoeff();
    if (!(length < max_grain_coordinate) || !(c < max_grain_coordinate)) return false;
    const double overlap = length > 0.0 ? std::min(4.0 * grain_step * c / length + 1e-6, 1e3) : 0.0;
    out.ray = {};
    out.ray.org_x = float(from.x()), out.ray.org_y = float(from.y()), out.ray.org_z = float(from.z());
    out.ray.dir_x = float(way.x()), out.ray.dir_y = float(way.y()), out.ray.dir_z = float(way.z());
    out.ray.tfar = float(1.0 + overlap);
    out.ray.mask = tracer.settings.ray_mask;
    out.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    out.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    return true;
}

// ---- hits ----

struct GrainHit {
    Vec3d point, normal; // normal: unit, facing the incoming path
    double offset = 0.0;
    const GrainMesh* mesh = nullptr; // nullptr: it does not wear
    const uint32_t* corners = nullptr;
};

// Geometry in an instance is none of the lent meshes, whatever its id.
unsigned lent_id(const RTCRayHit& ray) {
    return ray.hit.instID[0] == RTC_INVALID_GEOMETRY_ID ? ray.hit.geomID : RTC_INVALID_GEOMETRY_ID;
}

const GrainMesh* worn_mesh(const GrainTracer& tracer, unsigned id) {
    const auto found =
        std::lower_bound(tracer.meshes.begin(), tracer.meshes.end(), id,
                         [](const GrainMesh& mesh, unsigned other) { return mesh.mesh.geometry < other; });
    return found != tracer.meshes.end() && found->mesh.geometry == id ? &*found : nullptr;
}

GrainHit resolve_hit(const GrainTracer& tracer, const RTCRayHit& ray) {
    GrainHit hit;
    const Vec3d origin(ray.ray.org_x, ray.ray.org_y, ray.ray.org_z);
    const Vec3d way(ray.ray.dir_x, ray.ray.dir_y, ray.ray.dir_z);
    const GrainMesh* found = worn_mesh(tracer, lent_id(ray));
    const bool worn = found && ray.hit.primID < found->mesh.triangle_count;
    if (worn) {
        hit.mesh = found;
        hit.corners = found->mesh.triangles + 3 * size_t(ray.hit.primID);
        const auto corner = [&](int k) {
            const float* p = found->mesh.vertices + 3 * size_t(hit.corners[k]);
            return Vec3d(p[0], p[1], p[2]);
        };
        const Vec3d p0 = corner(0), e1 = corner(1) - p0, e2 = corner(2) - p0;
        const double area = e1.cross(e2).norm(), l1 = e1.norm(), l2 = e2.norm();
        hit.normal = area > 0.0 ? Vec3d(e1.cross(e2) / area) : Vec3d(-way.normalized());
        hit.point = p0 + double(ray.hit.u) * e1 + double(ray.hit.v) * e2;
        const double sliver = area > 0.0 ? std::min(l1 * l2 / area, grain_sliver) : grain_sliver;
        hit.offset = hit.point.cwiseAbs().maxCoeff() + std::max(l1, l2) * sliver;
    } else { // not worn: use the hit from Embree
        hit.point = origin + double(ray.ray.tfar) * way;
        const Vec3d normal(ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z);
        const double area = normal.norm();
        hit.normal = area > 0.0 ? Vec3d(normal / area) : Vec3d(-way.normalized());
        hit.offset = 2.0 * (hit.point.cwiseAbs().maxCoeff() + way.norm()) + 4.0 * std::sqrt(area);
    }
    hit.offset *= grain_margin * grain_step;
    if (hit.normal.dot(way) > 0.0) hit.normal = -hit.normal;
    return hit;
}

void add_quanta(int64_t& to, int64_t quanta) {
    if (quanta != 0) std::atomic_ref<int64_t>(to).fetch_add(quanta, std::memory_order_relaxed);
}

void add_wear(GrainTracer& tracer, const GrainHit& hit, const RTCRayHit& ray, int64_t quanta) {
    const double u = std::clamp(double(ray.hit.u), 0.0, 1.0), v = std::clamp(double(ray.hit.v), 0.0, 1.0 - u);
    const auto at1 = int64_t(u * double(quanta) + 0.5), at2 = int64_t(v * double(quanta) + 0.5);
    const size_t first = hit.mesh->first_vertex;
    add_quanta(tracer.vertex_quanta[first + hit.corners[0]], quanta - at1 - at2);
    add_quanta(tracer.vertex_quanta[first + hit.corners[1]], at1);
    add_quanta(tracer.vertex_quanta[first + hit.corners[2]], at2);
    if (!tracer.triangle_quanta.empty())
        add_quanta(tracer.triangle_quanta[hit.mesh->first_triangle + ray.hit.primID], quanta);
}

Vec3d rebound(const GrainTracer& tracer, const Grain& grain, const Vec3d& v, const Vec3d& n) {
    const GrainSettings& s = tracer.settings;
    const double towards = v.dot(n);
    const Vec3d out = s.tangent_restitution * (v - towards * n) - s.normal_restitution * towards * n;
    const double speed = out.norm();
    if (!(speed > 0.0) || s.scatter <= 0.0) return out;
    const auto [u0, u1] = event_numbers(tracer, grain.path, 2 * grain.hits);
    const double z = 2.0 * u0 - 1.0, angle = 2.0 * pi * u1;
    const double r = std::sqrt(std::max(1.0 - z * z, 0.0));
    Vec3d d = out / speed + s.scatter * Vec3d(r * std::cos(angle), r * std::sin(angle), z);
    const double length = d.norm();
    if (!(length > 1e-6)) return out;
    d /= length;
    double rise = d.dot(n);
    if (rise < 0.0) d -= 2.0 * rise * n, rise = -rise;
    if (rise < min_rebound_sine) d = (d + (min_rebound_sine - rise) * n).normalized();
    return speed * d;
}

// ---- events: what becomes of a grain ----

enum class Next : uint8_t { starts_arc, lands, ends };

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
    return Next::ends;
}

void move_to(Grain& grain, const Vec3d& x, const Vec3d& v, const Vec3d& normal) {
    grain.x = x, grain.v = v, grain.normal = normal;
}

// The grain landed with velocity v; leave_sand() has replaced it.
Next count_landing(const GrainTracer& tracer, GrainCounts& counts, Grain& grain, const Vec3d& v) {
    const int64_t before = energy_after_flight(counts, grain, v);
    ++counts.sand_hits;
    grain.energy = grain_quanta(grain_energy(grain.v));
    counts.sand += grain.energy - before;
    ++grain.landings;
    if (grain_energy(grain.v) < tracer.settle || !(grain.v.dot(grain.normal) > 0.0))
        return end_grain(counts, grain, grain.v, counts.settled);
    return Next::starts_arc;
}

Next hit_rock(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const GrainHit& hit,
              const RTCRayHit& ray, const Vec3d& v) {
    const GrainSettings& s = tracer.settings;
    const double energy = grain_energy(v), speed = v.norm();
    const int64_t before = energy_after_flight(counts, grain, v);
    ++(hit.mesh ? counts.worn_hits : counts.other_hits);
    if (hit.mesh) {
        const double sine = std::min(-v.dot(hit.normal) / speed, 1.0);
        const int64_t worn = grain_quanta(wearing_energy(s, energy, sine));
        counts.worn += worn;
        add_wear(tracer, hit, ray, worn);
    }
    move_to(grain, hit.point + hit.offset * hit.normal, rebound(tracer, grain, v, hit.normal), hit.normal);
    grain.energy = grain_quanta(grain_energy(grain.v));
    counts.rock += before - grain.energy;
    ++grain.hits;
    const double left = grain_energy(grain.v);
    if (left < tracer.settle || !(grain.v.dot(hit.normal) > 0.0))
        return end_grain(counts, grain, grain.v, counts.settled);
    if (s.drag_time <= 0.0 && !s.ground && s.sand.empty() &&
        left + s.gravity * std::max(grain.x.y() - tracer.box.y0, 0.0) < tracer.threshold)
        return end_grain(counts, grain, grain.v, counts.spent);
    if (grain.hits >= s.most_hits) return end_grain(counts, grain, grain.v, counts.given_up);
    return Next::starts_arc;
}

// The grain continues, slightly above the surface.
Next grazes(GrainCounts& counts, Grain& grain, const GrainHit& hit, const Vec3d& v) {
    ++counts.grazes;
    const double lack = min_rebound_sine * v.norm() - v.dot(hit.normal);
    move_to(grain, hit.point + hit.offset * hit.normal, lack > 0.0 ? Vec3d(v + lack * hit.normal) : v,
            hit.normal);
    grain.energy = energy_after_flight(counts, grain, grain.v);
    return Next::starts_arc;
}

// At the end of an arc that hit nothing.
Next end_arc(GrainCounts& counts, Grain& grain) {
    grain.segments += uint64_t(grain.chords);
    const GrainState& end = grain.end_state;
    if (grain.at_end == ArcEnd::gives_up) return end_grain(counts, grain, end.v, counts.given_up);
    if (grain.at_end == ArcEnd::leaves)
        return end_grain(counts, grain, end.v, counts.left[size_t(grain.side)]);
    const bool lands = grain.at_end == ArcEnd::lands;
    move_to(grain, end.x, end.v, lands ? Vec3d(Vec3d::UnitY()) : Vec3d(Vec3d::Zero()));
    return lands ? Next::lands : Next::starts_arc;
}

// At the hit of the traced chord.
Next handle_hit(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const RTCRayHit& ray) {
    grain.segments += grain.chord + 1;
    const GrainHit hit = resolve_hit(tracer, ray);
    const double share = std::clamp(double(ray.ray.tfar), 0.0, 1.0);
    const Vec3d v = state_after(tracer, grain, grain.chord_t0 + share * (grain.chord_t1 - grain.chord_t0)).v;
    if (std::binary_search(tracer.sand.begin(), tracer.sand.end(), lent_id(ray))) {
        move_to(grain, hit.point + hit.offset * hit.normal, v, hit.normal);
        return Next::lands;
    }
    if (v.dot(hit.normal) < 0.0) return hit_rock(tracer, counts, grain, hit, ray, v);
    return grazes(counts, grain, hit, v); // the chord hits a surface that the path is leaving
}

// Hits access memory at random. Prefetching saves a quarter of the time on a million triangles.
void prefetch_hits(const GrainTracer& tracer, std::span<const RTCRayHit> rays) {
    const auto worn = [&](const RTCRayHit& ray) -> const GrainMesh* {
        if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return nullptr;
        const GrainMesh* mesh = worn_mesh(tracer, lent_id(ray));
        return mesh && ray.hit.primID < mesh->mesh.triangle_count ? mesh : nullptr;
    };
    for (const RTCRayHit& ray : rays)
        if (const GrainMesh* mesh = worn(ray)) {
            __builtin_prefetch(mesh->mesh.triangles + 3 * size_t(ray.hit.primID));
            if (!tracer.triangle_quanta.empty())
                __builtin_prefetch(&tracer.triangle_quanta[mesh->first_triangle + ray.hit.primID], 1);
        }
    for (const RTCRayHit& ray : rays)
        if (const GrainMesh* mesh = worn(ray))
            for (int k = 0; k < 3; ++k) {
                const size_t v = mesh->mesh.triangles[3 * size_t(ray.hit.primID) + size_t(k)];
                __builtin_prefetch(mesh->mesh.vertices + 3 * v);
                __builtin_prefetch(&tracer.vertex_quanta[mesh->first_vertex + v], 1);
            }
}

// Handles grains in batches: eight that start, leave sand or begin an arc, eight whose arcs are checked for empty space,
// and up to 64 rays. A grain is in one place at a time: a queue of slots, or a lane.
class GrainWavefront {
  public:
    GrainWavefront(GrainTracer& tracer, uint64_t first, uint64_t end, GrainCounts& counts)
        : tracer_(tracer), counts_(counts), paths_(ordered_paths(tracer, first, end)),
          grains_(grain_window + 6 * lanes), rays_(grain_window) {
        for (uint32_t slot = 0; slot < grains_.size(); ++slot) free_.push_back(slot);
    }

    void trace() {
        for (uint64_t steps = 1;; ++steps) {
            if (steps % 64 == 0 && tracer_.hooks.cancelled && tracer_.hooks.cancelled()) return;
            if (ray_queue_.size() + lanes > grain_window) trace_rays();
            fill_lanes();
            if (used_ != all_used && feed()) continue;
            if (used_ == 0) return;
            for (uint32_t done = tracer_.empty.step(parabolas_) & used_; done != 0; done &= done - 1)
                retire_lane(std::countr_zero(done));
        }
    }

  private:
    using Slots = std::vector<uint32_t>;
    static constexpr uint32_t all_used = (1U << lanes) - 1U;

    // Grains on arcs into free lanes.
    void fill_lanes() {
        while (used_ != all_used && !flying_.empty()) {
            const uint32_t slot = flying_.back();
            flying_.pop_back();
            const int lane = std::countr_one(used_);
            if (set_parabola(grains_[slot], lane, parabolas_))
                slot_[size_t(lane)] = slot, used_ |= 1U << lane;
            else
                put(slot, end_arc(counts_, grains_[slot]));
        }
    }

    // Handles a batch, so that more grains fly. false: all grains are in lanes, or have ended.
    bool feed() {
        if (landing_.size() >= lanes)
            leave_sand();
        else if (starting_.size() >= lanes)
            start_arcs();
        else if (next_ < paths_.size())
            emit_grains();
        else if (!landing_.empty())
            leave_sand();
        else if (!starting_.empty())
            start_arcs();
        else if (!ray_queue_.empty())
            trace_rays();
        else
            return false;
        return true;
    }

    // The last slots of a queue, at most eight, and their grains.
    GrainBatch take(Slots& from) {
        const size_t count = std::min(from.size(), size_t(lanes));
        for (size_t k = 0; k < count; ++k) {
            batch_slots_[k] = from.back();
            batch_[k] = &grains_[from.back()];
            from.pop_back();
        }
        return {batch_.data(), count};
    }

    void put(uint32_t slot, Next next) {
        (next == Next::ends ? free_ : next == Next::lands ? landing_ : starting_).push_back(slot);
    }

    void emit_grains() {
        const GrainBatch room = take(free_); // never empty: at most 77 slots are elsewhere here
        const size_t count = std::min(room.size(), paths_.size() - next_);
        for (size_t k = count; k < room.size(); ++k) free_.push_back(batch_slots_[k]);
        const GrainBatch batch = room.first(count);
        for (Grain* grain : batch)
            grain->path = paths_[next_++], grain->hits = grain->landings = 0, grain->segments = 0;
        marram::emit_grains(tracer_, batch);
        for (Grain* grain : batch) counts_.started += grain->energy = grain_quanta(grain_energy(grain->v));
        fly(batch);
    }

    void leave_sand() {
        GrainBatch batch = take(landing_);
        std::array<Vec3d, lanes> before;
        for (size_t k = 0; k < batch.size(); ++k) before[k] = batch[k]->v;
        marram::leave_sand(tracer_, batch);
        size_t count = 0;
        for (size_t k = 0; k < batch.size(); ++k) {
            const uint32_t slot = batch_slots_[k];
            if (count_landing(tracer_, counts_, *batch[k], before[k]) == Next::ends)
                free_.push_back(slot);
            else
                batch_[count] = batch[k], batch_slots_[count++] = slot;
        }
        fly(batch.first(count));
    }

    void start_arcs() { fly(take(starting_)); }

    void fly(GrainBatch batch) {
        if (batch.empty()) return;
        marram::start_arcs(tracer_, batch);
        flying_.insert(flying_.end(), batch_slots_.begin(),
                       batch_slots_.begin() + std::ptrdiff_t(batch.size()));
    }

    void retire_lane(int lane) {
        const uint32_t slot = slot_[size_t(lane)];
        Grain& grain = grains_[slot];
        used_ &= ~(1U << lane);
        const double clear = double(parabolas_.t_clear[lane]);
        if (!(clear < grain.end)) {
            put(slot, end_arc(counts_, grain));
            return;
        }
        find_chord(grain, clear); // near something
        if (set_grain_ray(tracer_, grain, rays_[ray_queue_.size()]))
            ray_queue_.push_back(slot);
        else
            put(slot, end_grain(counts_, grain, grain.v, counts_.given_up));
    }

    void trace_rays() {
        const std::span<RTCRayHit> batch = std::span(rays_).first(ray_queue_.size());
        if (tracer_.hooks.rays) tracer_.hooks.rays(batch);
        for (RTCRayHit& ray : batch)
            marram_intersect1(tracer_.scene, &ray, 0); // a stream takes a third longer
        counts_.rays += batch.size();
        prefetch_hits(tracer_, batch);
        for (size_t k = 0; k < batch.size(); ++k) {
            const uint32_t slot = ray_queue_[k];
            if (batch[k].hit.geomID != RTC_INVALID_GEOMETRY_ID)
                put(slot, handle_hit(tracer_, counts_, grains_[slot], batch[k]));
            else
                ++grains_[slot].chord, flying_.push_back(slot);
        }
        ray_queue_.clear();
    }

    GrainTracer& tracer_;
    GrainCounts& counts_;
    std::vector<uint32_t> paths_;
    size_t next_ = 0; // of them
    std::vector<Grain> grains_;
    std::vector<RTCRayHit> rays_;
    Slots free_, landing_, starting_, flying_, ray_queue_;
    std::array<Grain*, lanes> batch_{};
    std::array<uint32_t, lanes> batch_slots_{}, slot_{};
    uint32_t used_ = 0; // bits of lanes
    Parabolas8 parabolas_{};
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

double stream_speed(const GrainSettings& s, double h) {
    return s.bed_speed + (s.speed - s.bed_speed) * (1.0 - std::exp(-h / s.speed_height));
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
    const uint64_t block = std::clamp(std::bit_ceil(settings.paths / 64), least_block, most_block);
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
