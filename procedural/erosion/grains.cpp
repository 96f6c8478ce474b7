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
// Cost. Eight arcs are checked for empty space at a time, and 64 rays are traced together. A grain around a ball of
// 1.5 10^6 triangles takes 2 us of one core, for 0.8 hits, 5 landings on sand and 3.4 rays, of which Embree takes
// 0.6 us (build/rock_erosion speed). On rough rock without sand a chord takes 0.4 us, of which Embree takes 0.25 us
// (build/grains speed).
#include "procedural/erosion/grains.h"

#include "core/math/clock.h"
#include "core/math/hash.h"
#include "procedural/erosion/grain_tracer.h"
#include "procedural/erosion/sobol.h"
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
constexpr size_t grain_window = 64;                        // rays traced together
constexpr uint64_t least_block = 4096, most_block = 65536; // grains per task
constexpr uint32_t start_places = 32;     // in each direction of the start plane, for the order of grains
constexpr double longest_arc = 1e6;       // s
constexpr double min_rebound_sine = 0.01; // minimum sine between a rebound and the surface

int64_t grain_quanta(double energy) { return int64_t(energy / grain_quantum + 0.5); } // energy: 0 or more
double grain_energy(const Vec3d& v) { return 0.5 * v.squaredNorm(); }

struct GrainCounts {
    std::array<uint64_t, 6> left{};
    uint64_t settled = 0, spent = 0, given_up = 0, worn_hits = 0, other_hits = 0, sand_hits = 0, grazes = 0,
             rays = 0;
    int64_t started = 0, flight = 0, sand = 0, rock = 0, ended = 0, worn = 0;
};

struct GrainState {
    Vec3d x, v;
};

enum class ArcEnd { lands, leaves, goes_on, gives_up };

// A grain on an arc, which runs from one event to the next if nothing is hit.
struct Grain {
    Vec3d x, v, acceleration;                        // at the start of the arc
    double first_chord_time = 0.0, chord_time = 0.0; // duration of the first chord and of the others, s
    double end = 0.0;                                // of the arc, s after its start
    double length = 0.0;                             // of the arc, m, at most
    GrainState end_state;                            // of an arc with drag
    ArcEnd at_end = ArcEnd::goes_on;
    GrainSide side = GrainSide::downwind;  // by which it leaves
    uint32_t chord = 0;                    // the next one, and
    double chord_t0 = 0.0, chord_t1 = 0.0; // its ends while a ray traces it, s
    uint64_t path = 0;
    int64_t energy = 0; // quanta after the last event
    uint32_t hits = 0, landings = 0;
    uint64_t segments = 0; // chords of the arcs before, traced or not
};

// ---- the stream ----

double grain_unit(const GrainTracer& tracer, uint64_t path, int dimension) {
    return sobol_point(uint32_t(path), dimension, tracer.shifts[size_t(dimension)]);
}

EventSeeds event_seeds(uint32_t seed, uint32_t event) {
    const uint64_t key = hash(seed, 0x6576ULL + event);
    return {uint32_t(key), {uint32_t(hash(key, 1)), uint32_t(hash(key, 2))}};
}

// Two random numbers for event k of a path: Sobol dimensions 0 and 1 at an index that is Owen-shuffled for each event.
std::array<double, 2> event_numbers(const GrainTracer& tracer, uint64_t path, uint32_t event) {
    const EventSeeds seeds = event < tracer.event_seeds.size() ? tracer.event_seeds[event]
                                                               : event_seeds(tracer.settings.seed, event);
    const uint32_t index = owen_shuffle(uint32_t(path), seeds.order);
    return {sobol_point(index, 0, seeds.scrambling[0]), sobol_point(index, 1, seeds.scrambling[1])};
}

// sqrt(-2 ln(1 - u)): 1 - u is exact, as u is a multiple of 2^-32.
double rayleigh(double u) { return std::sqrt(-2.0 * std::log(1.0 - u)); }

// The paths of a block, in an order in which neighbours start near each other, so that they hit near each other:
// memory that one has read is then in the cache for the next.
std::vector<uint32_t> ordered_paths(const GrainTracer& tracer, uint64_t first, uint64_t end) {
    const auto place = [&](uint64_t path) {
        const auto at = [&](int dimension) {
            return uint32_t(grain_unit(tracer, path, dimension) * double(start_places));
        };
        const uint32_t across = at(0), up = at(1);
        return across * start_places + (across % 2 == 0 ? up : start_places - 1 - up);
    };
    std::vector<uint16_t> places(end - first);
    std::array<uint32_t, start_places * start_places + 1> starts{};
    for (uint64_t path = first; path < end; ++path) {
        places[path - first] = uint16_t(place(path));
        ++starts[places[path - first] + 1U];
    }
    for (size_t k = 1; k < starts.size(); ++k) starts[k] += starts[k - 1];
    std::vector<uint32_t> order(end - first);
    for (uint64_t path = first; path < end; ++path) order[starts[places[path - first]]++] = uint32_t(path);
    return order;
}

Grain emit_grain(const GrainTracer& tracer, uint64_t path) {
    const GrainSettings& s = tracer.settings;
    const GrainBox& box = tracer.box;
    const double across = grain_unit(tracer, path, 0);
    const double share = -std::expm1(-box.top / s.height);
    const double h = std::min(-s.height * std::log1p(-share * grain_unit(tracer, path, 1)), box.top);
    const auto place = std::min(size_t(across * double(grain_profile)), size_t(grain_profile) - 1);
    const double radius = rayleigh(grain_unit(tracer, path, 2));
    const double rise = tracer.launch * radius * std::cos(2.0 * pi * grain_unit(tracer, path, 3));
    const double yaw = s.spread * (2.0 * grain_unit(tracer, path, 4) - 1.0);
    Grain grain;
    grain.path = path;
    grain.x = box.start * box.along + (box.t0 + across * (box.t1 - box.t0)) * box.across;
    grain.x.y() = box.ground[place] + h;
    grain.v = stream_speed(s, h) * (std::cos(yaw) * box.along + std::sin(yaw) * box.across);
    grain.v.y() = rise;
    grain.energy = grain_quanta(grain_energy(grain.v));
    return grain;
}

// ---- flight ----

GrainState state_after(const GrainTracer& tracer, const Grain& grain, double t) {
    const double tau = tracer.settings.drag_time;
    if (tau <= 0.0) {
        const Vec3d half = 0.5 * t * grain.acceleration;
        return {grain.x + t * (grain.v + half), grain.v + 2.0 * half};
    }
    if (t == 0.0) return {grain.x, grain.v};
    const double x = t / tau,
                 decay = x > 1e-3 ? 1.0 - std::exp(-x) : -std::expm1(-x); // exp takes half the time
    const Vec3d final_velocity = grain.v + tau * grain.acceleration;
    return {grain.x + t * final_velocity + (tau * decay) * (grain.v - final_velocity),
            grain.v + decay * (final_velocity - grain.v)};
}

GrainState end_of_arc(const GrainTracer& tracer, const Grain& grain) {
    return tracer.settings.drag_time > 0.0 && grain.at_end != ArcEnd::gives_up
               ? grain.end_state
               : state_after(tracer, grain, grain.end);
}

// The time at which q + v t + a t^2 / 2 falls to `low`, a <= 0. For q < low: the time of return to q, 0 if v <= 0.
double time_to_fall(double q, double v, double a, double low) {
    const double drop = std::max(q - low, 0.0), root = std::sqrt(v * v - 2.0 * a * drop);
    if (v > 0.0) return a < 0.0 ? (v + root) / -a : infinity;
    if (root > v) return 2.0 * drop / (root - v);
    return drop > 0.0 ? infinity : 0.0;
}

// Time until a point with constant velocity leaves an interval.
double time_to_leave(double q, double v, double low, double high) {
    if (v > 0.0) return std::max(high - q, 0.0) / v;
    return v < 0.0 ? std::max(q - low, 0.0) / -v : infinity;
}

// Without drag an arc is a parabola that ends on level sand or at a side of the box.
void find_arc_end(const GrainTracer& tracer, Grain& grain) {
    const GrainBox& box = tracer.box;
    const double s = grain.x.dot(box.along), t = grain.x.dot(box.across), y = grain.x.y();
    const double vs = grain.v.dot(box.along), vt = grain.v.dot(box.across), vy = grain.v.y(),
                 ay = grain.acceleration.y();
    const double edge = 4.0 * grain_step * (std::abs(s) + std::abs(t) + box.size);
    const auto ends_before = [&](double time, ArcEnd at_end, GrainSide side) {
        if (time < grain.end) grain.end = time, grain.at_end = at_end, grain.side = side;
    };
    ends_before(time_to_leave(s, vs, box.start - edge, box.s1), ArcEnd::leaves,
                vs > 0.0 ? GrainSide::downwind : GrainSide::upwind);
    ends_before(time_to_leave(t, vt, box.t0 - edge, box.t1 + edge), ArcEnd::leaves,
                vt > 0.0 ? GrainSide::right : GrainSide::left);
    if (ay == 0.0 && vy > 0.0)
        ends_before(time_to_leave(y, vy, box.y0, box.y1), ArcEnd::leaves, GrainSide::above);
    if (tracer.settings.ground) // ground > box.y0
        ends_before(time_to_fall(y, vy, ay, *tracer.settings.ground), ArcEnd::lands, GrainSide::below);
    else
        ends_before(time_to_fall(y, vy, ay, box.y0), ArcEnd::leaves, GrainSide::below);
}

// With drag the speed of the air is held constant over one chord, so each chord is an arc.
void find_arc_end_with_drag(const GrainTracer& tracer, Grain& grain) {
    const GrainBox& box = tracer.box;
    grain.end = grain.first_chord_time;
    grain.end_state = state_after(tracer, grain, grain.end);
    const Vec3d& at = grain.end_state.x;
    if (const auto& ground = tracer.settings.ground; ground && at.y() < *ground) {
        grain.at_end = ArcEnd::lands;
        grain.end *= std::clamp((grain.x.y() - *ground) / (grain.x.y() - at.y()), 0.0, 1.0);
        grain.end_state = state_after(tracer, grain, grain.end);
        // Newton's iteration: where the chord meets the sand the curve is still above it, and above what lies on it.
        for (int k = 0; k < 4 && grain.end_state.v.y() < 0.0; ++k) {
            grain.end = std::clamp(grain.end + (grain.end_state.x.y() - *ground) / -grain.end_state.v.y(),
                                   0.0, grain.first_chord_time);
            grain.end_state = state_after(tracer, grain, grain.end);
        }
        return;
    }
    const double s = at.dot(box.along), t = at.dot(box.across);
    const double edge = 4.0 * grain_step * (std::abs(s) + std::abs(t) + box.size);
    const auto leaves_if = [&](bool beyond, GrainSide side) {
        if (beyond) grain.at_end = ArcEnd::leaves, grain.side = side;
    };
    leaves_if(tracer.settings.gravity <= 0.0 && at.y() > box.y1 && grain.end_state.v.y() >= 0.0,
              GrainSide::above);
    leaves_if(at.y() < box.y0, GrainSide::below);
    leaves_if(t > box.t1 + edge, GrainSide::right);
    leaves_if(t < box.t0 - edge, GrainSide::left);
    leaves_if(s < box.start - edge, GrainSide::upwind);
    leaves_if(s > box.s1, GrainSide::downwind);
}

double start_of_chord(const Grain& grain, uint32_t chord) {
    return chord == 0 ? 0.0 : grain.first_chord_time + (chord - 1) * grain.chord_time;
}

// The number of chords up to a time.
double chords_to(const Grain& grain, double time) {
    return time > grain.first_chord_time ? 1.0 + std::ceil((time - grain.first_chord_time) / grain.chord_time)
                                         : 1.0;
}

// Starts an arc at grain.x with grain.v. normal: of the surface that the grain leaves, or zero.
void start_arc(const GrainTracer& tracer, Grain& grain, const Vec3d& normal) {
    const GrainSettings& s = tracer.settings;
    grain.acceleration = Vec3d(0.0, -s.gravity, 0.0);
    if (s.drag_time > 0.0) {
        const double h = std::max(grain.x.y() - s.ground.value_or(tracer.box.base), 0.0);
        grain.acceleration += (stream_speed(s, h) * tracer.box.along - grain.v) / s.drag_time;
    }
    const double a = s.drag_time > 0.0 ? grain.acceleration.norm() : s.gravity, v = grain.v.norm();
    grain.chord_time = a > 0.0 ? std::sqrt(8.0 * tracer.sag / a) : longest_arc;
    if (v > 0.0) grain.chord_time = std::min(grain.chord_time, 1.01 * tracer.box.size / v);
    grain.first_chord_time = grain.chord_time;
    const double falls = -grain.acceleration.dot(normal);
    if (falls > 0.0)
        grain.first_chord_time = std::min(grain.first_chord_time, std::max(grain.v.dot(normal), 0.0) / falls);
    grain.chord = grain.first_chord_time > 0.0 ? 0 : 1;
    grain.end = longest_arc, grain.at_end = ArcEnd::goes_on;
    if (s.drag_time > 0.0)
        find_arc_end_with_drag(tracer, grain);
    else
        find_arc_end(tracer, grain);
    const double left = double(s.most_segments) - double(grain.segments);
    if (chords_to(grain, grain.end) > left) {
        grain.end = left > 0.0 ? start_of_chord(grain, uint32_t(left)) : 0.0;
        grain.at_end = ArcEnd::gives_up;
    }
    grain.length = (v + 0.5 * a * grain.end) * grain.end;
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

bool is_outside_horizontally(const GrainTracer& tracer, const Vec3d& p) {
    const GrainBox& box = tracer.box;
    const double s = p.dot(box.along), t = p.dot(box.across);
    return !(s >= box.start && s <= box.s1 && t >= box.t0 && t <= box.t1);
}

// Sets up the test for empty space from the grain's next chord on. false: none of the arc is left.
bool set_parabola(const GrainTracer& tracer, const Grain& grain, int lane, Parabolas8& out) {
    const double begin = start_of_chord(grain, grain.chord);
    if (!(begin < grain.end)) return false;
    // From there on, so that floats are fine enough for its times.
    const GrainState from = state_after(tracer, grain, begin);
    const bool drags = tracer.settings.drag_time > 0.0; // then the only chord, which is straight
    const Vec3d x = from.x - tracer.empty.low(),
                v = drags ? Vec3d((grain.end_state.x - grain.x) / grain.end) : from.v;
    const Vec3d a = drags ? Vec3d::Zero() : grain.acceleration;
    const double ball = drags ? 0.0 : tracer.sag;
    for (int axis = 0; axis < 3; ++axis) {
        out.x[axis][lane] = float(x[axis]);
        out.v[axis][lane] = float(v[axis]);
        out.a[axis][lane] = float(a[axis]);
    }
    out.t_max[lane] = float(grain.end - begin);
    // With drag a chord may leave the box. What is outside is not known to be empty.
    const bool needs_ray =
        tracer.hooks.rays || (drags && (is_outside_horizontally(tracer, grain.x) ||
                                        is_outside_horizontally(tracer, grain.end_state.x)));
    out.min_step[lane] = needs_ray ? float(infinity) : float(0.125 * std::min(grain.chord_time, grain.end));
    out.clearance[lane] =
        float(ball + 0x1p-20 * (x.cwiseAbs().maxCoeff() + grain.length)); // rounding of floats
    out.t_clear[lane] = 0.0F;
    return true;
}

// Sets up a float ray along the chord. false: too far from the origin, or the chord is too long.
bool set_grain_ray(const GrainTracer& tracer, const Grain& grain, RTCRayHit& out) {
    const Vec3d from = state_after(tracer, grain, grain.chord_t0).x;
    const Vec3d to =
        (grain.chord_t1 < grain.end ? state_after(tracer, grain, grain.chord_t1) : end_of_arc(tracer, grain))
            .x;
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

// Velocity of the grain that leaves sand instead of one that lands with velocity v.
Vec3d ejection_velocity(const GrainTracer& tracer, const Grain& grain, const Vec3d& v, const Vec3d& n) {
    const auto [u0, u1] = event_numbers(tracer, grain.path, 2 * grain.landings + 1);
    const double rise = tracer.launch * rayleigh(u0);
    const double yaw = tracer.settings.spread * (2.0 * u1 - 1.0);
    Vec3d level = std::cos(yaw) * tracer.box.along + std::sin(yaw) * tracer.box.across;
    level -= level.dot(n) * n;
    const double length = level.norm();
    Vec3d out = rise * n;
    if (length > 1e-6) out += tracer.settings.bed_speed / length * level;
    const double limit = v.norm(), speed = out.norm();
    return grain.hits > 0 && speed > limit ? Vec3d(limit / speed * out) : out;
}

// ---- one grain, one segment ----

bool ends(GrainCounts& counts, const Grain& grain, const Vec3d& v, uint64_t& as) {
    const int64_t energy = grain_quanta(grain_energy(v));
    counts.flight += energy - grain.energy;
    counts.ended += energy;
    ++as;
    return false;
}

bool lands(const GrainTracer& tracer, GrainCounts& counts, Grain& grain, const Vec3d& at, const Vec3d& v,
           const Vec3d& n) {
    const int64_t before = grain_quanta(grain_energy(v));
    counts.flight += before - grain.energy;
    ++counts.sand_hits;
    grain.x = at, grain.v = ejection_velocity(tracer, grain, v, n);
    grain.energy = grain_quanta(grain_energy(grain.v));
    counts.sand += grain.energy - before;
    ++grain.landings;
    if (grain_energy(grain.v) < tracer.settle || !(grain.v.dot(n) > 0.0))
        return ends(counts, grain, grain.v, counts.settled);
    start_arc(tracer, grain, n);
    return true;
}

bool hit_rock(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const GrainHit& hit,
              const RTCRayHit& ray, const Vec3d& v) {
    const GrainSettings& s = tracer.settings;
    const double energy = grain_energy(v), speed = v.norm();
    const int64_t before = grain_quanta(energy);
    counts.flight += before - grain.energy;
    ++(hit.mesh ? counts.worn_hits : counts.other_hits);
    if (hit.mesh) {
        const double sine = std::min(-v.dot(hit.normal) / speed, 1.0);
        const int64_t worn = grain_quanta(wearing_energy(s, energy, sine));
        counts.worn += worn;
        add_wear(tracer, hit, ray, worn);
    }
    grain.x = hit.point + hit.offset * hit.normal;
    grain.v = rebound(tracer, grain, v, hit.normal);
    grain.energy = grain_quanta(grain_energy(grain.v));
    counts.rock += before - grain.energy;
    ++grain.hits;
    const double left = grain_energy(grain.v);
    if (left < tracer.settle || !(grain.v.dot(hit.normal) > 0.0))
        return ends(counts, grain, grain.v, counts.settled);
    if (s.drag_time <= 0.0 && !s.ground && s.sand.empty() &&
        left + s.gravity * std::max(grain.x.y() - tracer.box.y0, 0.0) < tracer.threshold)
        return ends(counts, grain, grain.v, counts.spent);
    if (grain.hits >= s.most_hits) return ends(counts, grain, grain.v, counts.given_up);
    start_arc(tracer, grain, hit.normal);
    return true;
}

// The grain continues, slightly above the surface.
void grazes(const GrainTracer& tracer, GrainCounts& counts, Grain& grain, const GrainHit& hit,
            const Vec3d& v) {
    ++counts.grazes;
    const double lack = min_rebound_sine * v.norm() - v.dot(hit.normal);
    grain.x = hit.point + hit.offset * hit.normal;
    grain.v = lack > 0.0 ? Vec3d(v + lack * hit.normal) : v;
    const int64_t energy = grain_quanta(grain_energy(grain.v));
    counts.flight += energy - grain.energy;
    grain.energy = energy;
    start_arc(tracer, grain, hit.normal);
}

// At the end of an arc that hit nothing. false: the grain has ended.
bool end_arc(const GrainTracer& tracer, GrainCounts& counts, Grain& grain) {
    GrainState end = end_of_arc(tracer, grain);
    grain.segments += uint64_t(std::min(chords_to(grain, grain.end), 0x1p40));
    if (grain.at_end == ArcEnd::gives_up) return ends(counts, grain, end.v, counts.given_up);
    if (grain.at_end == ArcEnd::leaves) return ends(counts, grain, end.v, counts.left[size_t(grain.side)]);
    if (grain.at_end == ArcEnd::lands) {
        end.x.y() = *tracer.settings.ground;
        return lands(tracer, counts, grain, end.x, end.v, Vec3d::UnitY());
    }
    grain.x = end.x, grain.v = end.v;
    start_arc(tracer, grain, Vec3d::Zero());
    return true;
}

// Handles the traced chord. false: the grain has ended.
bool advance(GrainTracer& tracer, GrainCounts& counts, Grain& grain, const RTCRayHit& ray) {
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        ++grain.chord;
        return true;
    }
    grain.segments += grain.chord + 1;
    const GrainHit hit = resolve_hit(tracer, ray);
    const double share = std::clamp(double(ray.ray.tfar), 0.0, 1.0);
    const Vec3d v = state_after(tracer, grain, grain.chord_t0 + share * (grain.chord_t1 - grain.chord_t0)).v;
    if (std::binary_search(tracer.sand.begin(), tracer.sand.end(), lent_id(ray)))
        return lands(tracer, counts, grain, hit.point + hit.offset * hit.normal, v, hit.normal);
    if (v.dot(hit.normal) < 0.0) return hit_rock(tracer, counts, grain, hit, ray, v);
    grazes(tracer, counts, grain, hit, v); // the chord hits a surface that the path is leaving
    return true;
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

// Checks arcs for empty space in eight lanes, queues those that need rays, and traces these in batches.
class GrainWavefront {
  public:
    GrainWavefront(GrainTracer& tracer, uint64_t first, uint64_t end, GrainCounts& counts)
        : tracer_(tracer), counts_(counts), paths_(ordered_paths(tracer, first, end)),
          grains_(grain_window + lanes), rays_(grains_.size()) {
        for (uint32_t slot = 0; slot < grains_.size(); ++slot) free_.push_back(slot);
    }

    void trace() {
        uint32_t used = 0; // bits of lanes
        for (uint64_t steps = 1;; ++steps) {
            if (steps % 1024 == 0 && tracer_.hooks.cancelled && tracer_.hooks.cancelled()) return;
            for (int lane = 0; lane < lanes && ray_queue_.size() < grain_window; ++lane)
                if ((used >> lane & 1U) == 0 && load(lane)) used |= 1U << lane;
            if (ray_queue_.size() >= grain_window || used == 0) {
                if (ray_queue_.empty()) return;
                trace_rays();
                if (tracer_.hooks.cancelled && tracer_.hooks.cancelled()) return;
                continue;
            }
            for (uint32_t done = tracer_.empty.step(parabolas_) & used; done != 0; done &= done - 1) {
                const int lane = std::countr_zero(done);
                if (!retire_lane(lane)) used &= ~(1U << lane);
            }
        }
    }

  private:
    // The next grain into a lane. false: there is none at present.
    bool load(int lane) {
        while (true) {
            if (!ready_.empty()) {
                slot_[lane] = ready_.back();
                ready_.pop_back();
            } else if (next_ < paths_.size()) {
                slot_[lane] = free_.back();
                free_.pop_back();
                Grain& grain = grains_[slot_[lane]] = emit_grain(tracer_, paths_[next_++]);
                counts_.started += grain.energy;
                start_arc(tracer_, grain, Vec3d::Zero());
            } else {
                return false;
            }
            if (refill_lane(lane)) return true;
        }
    }

    // Sets up a lane for the rest of its grain's arc, or the next arc. false: the grain has ended.
    bool refill_lane(int lane) {
        Grain& grain = grains_[slot_[lane]];
        while (true) {
            if (set_parabola(tracer_, grain, lane, parabolas_)) return true;
            if (!end_arc(tracer_, counts_, grain)) break;
        }
        free_.push_back(slot_[lane]);
        return false;
    }

    // false: the lane is free.
    bool retire_lane(int lane) {
        Grain& grain = grains_[slot_[lane]];
        if (parabolas_.t_clear[lane] < parabolas_.t_max[lane]) { // near something
            find_chord(grain, start_of_chord(grain, grain.chord) + double(parabolas_.t_clear[lane]));
            if (set_grain_ray(tracer_, grain, rays_[ray_queue_.size()])) {
                ray_queue_.push_back(slot_[lane]);
            } else {
                ends(counts_, grain, grain.v, counts_.given_up);
                free_.push_back(slot_[lane]);
            }
            return false;
        }
        if (end_arc(tracer_, counts_, grain)) return refill_lane(lane);
        free_.push_back(slot_[lane]);
        return false;
    }

    void trace_rays() {
        const std::span<RTCRayHit> batch = std::span(rays_).first(ray_queue_.size());
        if (tracer_.hooks.rays) tracer_.hooks.rays(batch);
        marram_intersect_many(tracer_.scene, batch.data(), unsigned(batch.size()));
        counts_.rays += batch.size();
        prefetch_hits(tracer_, batch);
        for (size_t k = 0; k < batch.size(); ++k)
            (advance(tracer_, counts_, grains_[ray_queue_[k]], batch[k]) ? ready_ : free_)
                .push_back(ray_queue_[k]);
        ray_queue_.clear();
    }

    GrainTracer& tracer_;
    GrainCounts& counts_;
    std::vector<uint32_t> paths_;
    size_t next_ = 0; // of them
    std::vector<Grain> grains_;
    std::vector<RTCRayHit> rays_;
    std::vector<uint32_t> free_, ready_, ray_queue_; // slots
    std::array<uint32_t, lanes> slot_{};
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
    const double share = -std::expm1(-tracer.box.top / settings.height);
    const double width = tracer.box.t1 - tracer.box.t0;
    report.mass_per_grain = settings.transport * width * share / double(settings.paths);
    const double volume = report.mass_per_grain * grain_quantum / settings.energy_per_volume;
    report.volume = double(report.worn) * volume;
    if (!report.cancelled) write_wear(tracer, volume, wear, triangle_wear);
    report.seconds = wall_seconds() - begin;
    return report;
}

} // namespace marram
