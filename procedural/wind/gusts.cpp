// SPDX-License-Identifier: Apache-2.0
// See gusts.h for definitions, draws and costs. Derived here: the bounds and the culling.
//
// Bounds. An influence is not zero only if |x_a| <= 1 for x = M (P - C), and |x| < 1 for spheres. With the
// columns s_a r_a of M^-1 (a rotation r times scales s), P - C = sum over a of x_a s_a r_a. So along world
// axis j a box extends by sum over a of |s_a r_aj|, and a sphere by the root of the sum of squares of the
// same. The rows of M need no inverse of a matrix that may be flat to 1e-12: row a is r_a / s_a, and r_a is
// column a over its length.
//
// Rounding. x is computed with errors of a few 1e-16 of |M| |P - C|. The bounds are widened by 1e-12 of their
// size and of the centre's coordinates, so they are conservative with a margin of three digits, and culling
// changes no bit.
#include "procedural/wind/gusts.h"

#include "core/math/hash.h"
#include "procedural/abi/param.h"
#include "procedural/abi/ramp_table.h"
#include "procedural/wind/air_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace marram {
namespace {

constexpr double longest = 1e6;        // frames
constexpr double max_lumps = 0.9;      // see gusts.h
constexpr double shortest_fade = 1.0;  // frames
constexpr double bounds_slack = 1e-12; // see above
constexpr double latest_frame = 1e12;  // repetitions cannot be told apart at later frames
constexpr double max_draws = 4e6;      // gusts times repetitions tested for one time: about a second
constexpr double upright_limit =
    0.999; // for a steeper wind the horizontal direction across it is ill-defined

constexpr const char* smooth_fall = "{ knots = [[0, 1], [1, 0]], interpolation = \"smooth\" }";

constexpr std::array gust_values = {
    param::integer("gusts.num_gusts", "", "0", 0, 1000000,
                   "gusts in each period: spheres that travel with the wind"),
    param::range("gusts.radius_range", "m", "[2, 4]", 0, max_wind_input,
                 "smallest and largest radius of a gust"),
    param::range("gusts.radius_noise_range", "", "[0, 0.3]", 0, max_lumps,
                 "noise on the radius of a gust, as a fraction of the radius; 0: a sphere"),
    param::range("gusts.speed_range", "m/s", "none", 0, max_wind_input,
                 "slowest and fastest gust; default: see relative_speed_range"),
    param::range("gusts.relative_speed_range", "", "none", 0, 100,
                 "slowest and fastest gust, over the speed of the wind, also of one whose speed has keys; "
                 "default: 1"),
    param::range("gusts.start_frame_range", "frames", "none", -longest, longest,
                 "when a gust crosses the plane upwind, at full strength; default: any time of the period"),
    param::range("gusts.life_range", "frames", "[120, 240]", 0, longest,
                 "shortest and longest time from its start to its end"),
    param::range(
        "gusts.decay_range", "frames", "[24, 48]", 0, longest,
        "fade-out time at the end of the life, at least 1 frame; also the fade-in time before the start"),
    param::number("gusts.period", "frames", "240", 0, longest,
                  "the gusts repeat after this time; 0: they come once"),
    param::boolean("gusts.redraw", "false",
                   "true: new random gusts in each period; false: the same gusts in each period, for loops"),
    param::vec3("gusts.center", "m", "none", -max_wind_input, max_wind_input,
                "point that gusts pass; default: the middle of the bounds of all meshes at bind_frame"),
    param::vec2(
        "gusts.extent", "m", "none", 0, max_wind_input,
        "width and height of the plane that gusts start from; default: those of the bounds of all meshes"),
    param::number("gusts.distance", "m", "none", -max_wind_input, max_wind_input,
                  "distance of that plane, upwind of the centre; default: just outside these bounds"),
    param::ramp("gusts.ramp", "", smooth_fall, 0, 1,
                "influence from the centre (0) to the surface (1), where it is 0"),
    param::keyable(param::number("gusts.strength", "", "1", 0, 10, "scale of the influence of these gusts")),
    param::integer("gusts.seed", "", "0", 0, 2147483647, "seed of the gusts"),
    param::choice(
        "gusts.control[].shape", "sphere", "sphere|box",
        "a gust placed by hand: a sphere of radius 1 m or a box of half side 1 m, before its transform"),
    param::keys("gusts.control[].transform", "{}", "its place, rotation and scale, keyed"),
    param::vec3(
        "gusts.control[].inner", "", "none", 0, 1,
        "half sides of the inner box, where the influence is full, as shares of the outer box; default: 0.5"),
    param::ramp("gusts.control[].ramp", "", smooth_fall, 0, 1,
                "influence from the centre or inner box (0) to the surface (1), where it is 0"),
    param::keyable(param::number("gusts.control[].strength", "", "1", -10, 10,
                                 "scale of its influence; below 0 it reduces the wind")),
};

// ---- Reading ----

Ramp gust_ramp(const Values& values, const std::string& name) {
    return falling_ramp(values, name, "gusts.ramp_jumps", "gusts.ramp_end");
}

GustControl read_control(const Values& values, const std::string& prefix) {
    GustControl control;
    control.box = values.text(prefix + "shape") == "box";
    const MarramValue& keys = values.at(prefix + "transform");
    control.transform = KeyedTransform(std::span(keys.numbers, keys.number_count), keys.text);
    const std::string inner = prefix + "inner";
    if (values.has(inner) && !control.box)
        throw SceneFault("gusts.inner_of_sphere", values.at(inner).place, inner + " applies to boxes only",
                         "remove it, or make it a box");
    control.inner = values.has(inner) ? values.vec3(inner) : Vec3d::Constant(0.5);
    control.ramp = gust_ramp(values, prefix + "ramp");
    control.strength = values.number(prefix + "strength");
    return control;
}

double longest_fade(const Gusts& gusts) {
    return std::min(std::max(gusts.decay.y(), shortest_fade), gusts.life.y());
}

void check_period(const Gusts& gusts, const Values& values) {
    const std::string place = values.at("wind.gusts.period").place;
    if (gusts.period == 0.0) return;
    if (gusts.period < 1.0)
        throw SceneFault("gusts.short_period", place, "wind.gusts.period is shorter than a frame",
                         "give at least 1 frame, or 0 for gusts that do not repeat");
    const double window =
        gusts.start_frame.y() - gusts.start_frame.x() + gusts.life.y() + longest_fade(gusts);
    if (gusts.num_gusts * (window / gusts.period + 1.0) > max_draws)
        throw SceneFault("gusts.too_many", place, "wind.gusts has more than 4000000 gusts at a time",
                         "use fewer, shorter lives or a longer period");
}

void read_speed(const Values& values, Gusts& gusts) {
    constexpr const char *own = "wind.gusts.speed_range", *relative = "wind.gusts.relative_speed_range";
    gusts.speed_is_relative = !values.has(own);
    if (gusts.speed_is_relative) {
        gusts.speed = values.has(relative) ? values.range(relative) : Vec2d::Ones();
        return;
    }
    gusts.speed = values.range(own);
    const std::string place = values.at(own).place;
    if (values.has(relative))
        throw SceneFault("gusts.two_speeds", place, "wind.gusts has two speeds",
                         "keep speed_range or relative_speed_range");
    if (values.keyframes("wind.speed") || values.has("wind.record"))
        throw SceneFault("gusts.speed_in_keyed_wind", place,
                         "wind.gusts.speed_range is constant, and the wind's speed is not",
                         "give relative_speed_range in place of it, such as [0.9, 1.1]");
}

void read_procedural(const Values& values, Gusts& gusts) {
    gusts.radius = values.range("wind.gusts.radius_range");
    gusts.radius_noise = values.range("wind.gusts.radius_noise_range");
    read_speed(values, gusts);
    gusts.life = values.range("wind.gusts.life_range");
    gusts.decay = values.range("wind.gusts.decay_range");
    gusts.period = values.number("wind.gusts.period");
    if (values.has("wind.gusts.start_frame_range"))
        gusts.start_frame = values.range("wind.gusts.start_frame_range");
    else if (gusts.period > 0.0)
        gusts.start_frame = Vec2d(0.0, gusts.period);
    else
        throw SceneFault("gusts.no_start", values.at("wind.gusts.period").place,
                         "wind.gusts.period is 0 and wind.gusts.start_frame_range is missing",
                         "give a start_frame_range or a period");
    check_period(gusts, values);
    gusts.redraw = values.boolean("wind.gusts.redraw");
    gusts.strength = values.number("wind.gusts.strength");
    gusts.ramp = gust_ramp(values, "wind.gusts.ramp");
    gusts.seed = static_cast<uint32_t>(values.integer("wind.gusts.seed"));
    if (values.has("wind.gusts.center")) gusts.center = values.vec3("wind.gusts.center");
    if (values.has("wind.gusts.extent")) gusts.extent = values.range("wind.gusts.extent");
    if (values.has("wind.gusts.distance")) gusts.distance = values.number("wind.gusts.distance");
}

// ---- Influences at a time ----

struct CrosswindAxes { // the two unit directions perpendicular to the wind
    Vec3d level, upright;
};

CrosswindAxes across(const Vec3d& w) {
    const Vec3d up = std::abs(w.y()) > upright_limit ? Vec3d::UnitX() : Vec3d::UnitY();
    const Vec3d level = up.cross(w).normalized();
    return {level, w.cross(level)};
}

enum class Draw : uint64_t { across, up, radius, radius_noise, speed, start_frame, life, decay, lump_seed };

double draw(uint64_t key, Draw what) { return unit_double(hash(key, uint64_t(what))); }
double draw(uint64_t key, Draw what, const Vec2d& range) {
    return range.x() + (range.y() - range.x()) * draw(key, what);
}

double smooth_step(double y) { return y * y * (3.0 - 2.0 * y); }

// Widens the bounds as derived above.
void set_bounds(Influence& influence, const Vec3d& half) {
    const Vec3d reach = half + bounds_slack * (half + influence.center.cwiseAbs());
    influence.lower = influence.center - reach;
    influence.upper = influence.center + reach;
}

// The plane that gusts start from, across the wind at one time.
struct GustPlane {
    Vec3d origin; // its centre
    CrosswindAxes sides;
};

GustPlane plane_across(const Gusts& gusts, const Vec3d& w) {
    return {*gusts.center - *gusts.distance * w, across(w)};
}

struct GustContext { // data shared by all gusts
    const Gusts& gusts;
    const GustCarrier& wind;
    GustPlane plane; // of all gusts that start while the wind has not changed
    double fps;
};

// How far the air has come; asked for once for all gusts at one time.
struct AirAt {
    double frame;
    Vec3d displacement;
};
AirAt air_at(const GustCarrier& wind, double frame) {
    return {frame, wind.path ? wind.path->displacement(frame) : Vec3d::Zero()};
}

// The influences at one time that overlap a box. `lower` and `upper` bound the centres of all influences,
// also those outside: the order of the tree, and so of the sums, does not depend on which influences are
// kept.
struct ActiveInfluences {
    const Eigen::AlignedBox3d& within;
    std::vector<Influence> kept{};
    Vec3d lower = Vec3d::Constant(infinity), upper = -lower;

    void add(const Influence& influence) {
        lower = lower.cwiseMin(influence.center);
        upper = upper.cwiseMax(influence.center);
        const bool touches = (influence.lower.array() <= within.max().array()).all() &&
                             (influence.upper.array() >= within.min().array()).all();
        if (touches) kept.push_back(influence);
    }
};

// A random gust of one repetition.
struct DrawnGust {
    uint64_t key;
    double start, life, fade, radius; // start: frame within the period
    bool exists() const { return life > 0.0 && std::isfinite(1.0 / radius); }
};

DrawnGust draw_gust(const Gusts& gusts, int64_t repetition, uint64_t index) {
    const uint64_t set = gusts.redraw ? static_cast<uint64_t>(repetition) : 0;
    DrawnGust gust{};
    gust.key = hash(hash(gusts.seed, set), index);
    gust.start = draw(gust.key, Draw::start_frame, gusts.start_frame);
    gust.life = draw(gust.key, Draw::life, gusts.life);
    gust.fade = std::min(std::max(draw(gust.key, Draw::decay, gusts.decay), shortest_fade), gust.life);
    gust.radius = draw(gust.key, Draw::radius, gusts.radius);
    return gust;
}

// Its place in the plane that it starts from, relative to the plane's centre.
Vec3d place_across(const Gusts& gusts, const CrosswindAxes& sides, uint64_t key) {
    return sides.level * ((draw(key, Draw::across) - 0.5) * gusts.extent->x()) +
           sides.upright * ((draw(key, Draw::up) - 0.5) * gusts.extent->y());
}

// Its centre at an age in frames after its start at `born`; `air` is that at this age. A gust is seen from
// its fade-in on. Where it comes from must not depend on a wind to come: its plane is across the wind of
// that time, and it goes towards it as it would in that wind.
Vec3d center_of(const GustContext& passage, const DrawnGust& gust, double born, double age,
                const AirAt& air) {
    const Gusts& gusts = passage.gusts;
    const GustCarrier& wind = passage.wind;
    const double speed = draw(gust.key, Draw::speed, gusts.speed);
    if (!wind.path || wind.path->is_steady_until(air.frame)) {
        const double unit = !gusts.speed_is_relative ? 1.0
                            : wind.path              ? wind.path->speed(air.frame)
                                                     : wind.speed;
        const double travelled = speed * unit * age / passage.fps;
        return passage.plane.origin + place_across(gusts, passage.plane.sides, gust.key) +
               wind.direction * travelled;
    }
    const double seen = born - gust.fade;
    const Vec3d w = wind.path->direction(seen);
    const GustPlane plane = plane_across(gusts, w);
    const Vec3d way =
        air.displacement - wind.path->displacement(seen) - wind.path->speed(seen) * gust.fade * w;
    return plane.origin + place_across(gusts, plane.sides, gust.key) + way * (speed / passage.fps);
}

void add_gust(const GustContext& passage, const AirAt& air, int64_t repetition, uint64_t index,
              ActiveInfluences& out) {
    const Gusts& gusts = passage.gusts;
    const DrawnGust gust = draw_gust(gusts, repetition, index);
    const uint64_t key = gust.key;
    const double life = gust.life, fade = gust.fade, radius = gust.radius;
    const double age = air.frame - gust.start - double(repetition) * gusts.period;
    if (!(gust.exists() && -fade < age && age < life)) return;
    const double swell = smooth_step(std::min(1.0, (age + fade) / fade));
    const double decay = smooth_step(std::min(1.0, (life - age) / fade));
    Influence influence;
    influence.center = center_of(passage, gust, gust.start + double(repetition) * gusts.period, age, air);
    influence.to_unit = Eigen::Matrix3d::Identity() * (1.0 / radius);
    influence.lumps = draw(key, Draw::radius_noise, gusts.radius_noise);
    influence.lump_seed = static_cast<uint32_t>(hash(key, uint64_t(Draw::lump_seed)) >> 32);
    influence.weight = gusts.strength * swell * decay;
    influence.ramp = &gusts.ramp;
    set_bounds(influence, Vec3d::Constant(radius));
    out.add(influence);
}

void add_procedural(const Gusts& gusts, const GustCarrier& wind, double frame, double fps,
                    ActiveInfluences& out) {
    if (gusts.num_gusts == 0 || gusts.strength == 0.0) return;
    const GustContext passage{gusts, wind, plane_across(gusts, wind.direction), fps};
    const AirAt air = air_at(wind, frame);
    int64_t first = 0, last = 0; // repetitions that may be alive
    if (gusts.period > 0.0) {
        first = int64_t(std::ceil((frame - gusts.start_frame.y() - gusts.life.y()) / gusts.period));
        last = int64_t(std::floor((frame - gusts.start_frame.x() + longest_fade(gusts)) / gusts.period));
    }
    for (int64_t repetition = first; repetition <= last; ++repetition)
        for (uint32_t i = 0; i < gusts.num_gusts; ++i) add_gust(passage, air, repetition, i, out);
}

void add_control(const GustControl& control, double frame, ActiveInfluences& out) {
    const Eigen::Affine3d transform = control.transform.at(frame);
    Influence influence;
    influence.center = transform.translation();
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3d column = transform.linear().col(axis);
        const double length = column.stableNorm();
        influence.to_unit.row(axis) = column / length / length;
    }
    if (!influence.to_unit.allFinite() || control.strength == 0.0) return; // no volume, or no effect
    influence.box = control.box;
    influence.inner = control.inner;
    influence.weight = control.strength;
    influence.ramp = &control.ramp;
    const Eigen::Matrix3d sides = transform.linear().cwiseAbs();
    Vec3d half;
    for (int axis = 0; axis < 3; ++axis)
        half[axis] = control.box ? sides.row(axis).sum() : sides.row(axis).stableNorm();
    set_bounds(influence, half);
    out.add(influence);
}

// ---- The tree ----

// Index along a Morton curve through the box of all centres: neighbours in space are close in the tree.
uint64_t curve_key(const Vec3d& center, const Vec3d& lower, const Vec3d& upper) {
    constexpr int bits = 16;
    uint64_t key = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double size = upper[axis] - lower[axis];
        const double share = size > 0.0 ? (center[axis] - lower[axis]) / size : 0.0;
        const auto cell = static_cast<uint64_t>(share * ((1 << bits) - 1));
        for (int bit = 0; bit < bits; ++bit) key |= (cell >> bit & 1) << (3 * bit + axis);
    }
    return key;
}

std::vector<Influence> sorted_along_curve(const ActiveInfluences& alive) {
    std::vector<std::pair<uint64_t, size_t>> order;
    order.reserve(alive.kept.size());
    for (const Influence& influence : alive.kept)
        order.emplace_back(curve_key(influence.center, alive.lower, alive.upper), order.size());
    std::sort(order.begin(), order.end());
    std::vector<Influence> sorted;
    sorted.reserve(order.size());
    for (const auto& [key, index] : order) sorted.push_back(alive.kept[index]);
    return sorted;
}

} // namespace

std::span<const MarramParam> gust_params() { return gust_values; }

std::optional<Gusts> read_gusts(const Values& values) {
    Gusts gusts;
    gusts.num_gusts = static_cast<uint32_t>(values.integer("wind.gusts.num_gusts"));
    if (gusts.num_gusts > 0) read_procedural(values, gusts);
    for (;;) {
        const std::string prefix = "wind.gusts.control[" + std::to_string(gusts.controls.size()) + "].";
        if (!values.has(prefix + "shape")) break;
        gusts.controls.push_back(read_control(values, prefix));
    }
    if (gusts.num_gusts == 0 && gusts.controls.empty()) return {};
    return gusts;
}

void set_gust_plane(Gusts& gusts, const Vec3d& lower, const Vec3d& upper, const GustCarrier& wind) {
    Vec3d middle = 0.5 * lower + 0.5 * upper, half = 0.5 * upper - 0.5 * lower;
    if (!middle.allFinite() || !half.allFinite() || half.minCoeff() < 0.0) middle = half = Vec3d::Zero();
    if (!gusts.center) gusts.center = middle;
    if (wind.path && wind.path->has_direction_keys()) {
        if (!gusts.extent) gusts.extent = Vec2d::Constant(2.0 * half.norm());
        if (!gusts.distance)
            gusts.distance = (*gusts.center - middle).norm() + half.norm() + gusts.radius.y();
        return;
    }
    const Vec3d& w = wind.direction;
    const CrosswindAxes sides = across(w);
    if (!gusts.extent)
        gusts.extent = 2.0 * Vec2d(sides.level.cwiseAbs().dot(half), sides.upright.cwiseAbs().dot(half));
    if (!gusts.distance)
        gusts.distance = (*gusts.center - middle).dot(w) + w.cwiseAbs().dot(half) + gusts.radius.y();
}

namespace {

// Whether the segment from p to q passes through the box.
bool segment_meets_box(const Vec3d& p, const Vec3d& q, const Eigen::AlignedBox3d& box) {
    double enter = 0.0, leave = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        const double way = q[axis] - p[axis];
        double a = box.min()[axis] - p[axis], b = box.max()[axis] - p[axis];
        if (way == 0.0) {
            if (a > 0.0 || b < 0.0) return false;
            continue;
        }
        a /= way, b /= way;
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
    }
    return enter <= leave;
}

bool control_touches(const GustControl& control, const Vec2d& frames, const Eigen::AlignedBox3d& box) {
    constexpr double max_times = 1000.0;
    const double length = frames.y() - frames.x(), step = std::max(1.0, length / max_times);
    for (double at = 0.0; at <= length; at += step) {
        ActiveInfluences active{box};
        add_control(control, frames.x() + at, active);
        if (!active.kept.empty()) return true;
        if (!control.transform.moves()) return false;
    }
    return false;
}

} // namespace

GustContacts gusts_touching(const Gusts& gusts, const GustCarrier& wind, const Vec2d& frames, double fps,
                            const Eigen::AlignedBox3d& box) {
    constexpr double max_counted = 1e6;
    GustContacts contacts;
    for (const GustControl& control : gusts.controls)
        contacts.controls.push_back(control_touches(control, frames, box));
    if (gusts.num_gusts == 0 || gusts.strength == 0.0) return contacts;
    int64_t first = 0, last = 0; // repetitions that live in these frames
    if (gusts.period > 0.0) {
        const double before = std::ceil((frames.x() - gusts.start_frame.y() - gusts.life.y()) / gusts.period);
        const double after =
            std::floor((frames.y() - gusts.start_frame.x() + longest_fade(gusts)) / gusts.period);
        contacts.counted = (after - before + 1.0) * gusts.num_gusts <= max_counted;
        if (!contacts.counted) return contacts;
        first = int64_t(before), last = int64_t(after);
    }
    contacts.counted = gusts.num_gusts <= max_counted;
    const GustContext passage{gusts, wind, plane_across(gusts, wind.direction), fps};
    const int parts = wind.path ? 16 : 1;
    for (int64_t repetition = first; repetition <= last; ++repetition)
        for (uint32_t i = 0; i < gusts.num_gusts; ++i) {
            const DrawnGust gust = draw_gust(gusts, repetition, i);
            const double born = gust.start + double(repetition) * gusts.period;
            const double from = std::max(frames.x(), born - gust.fade) - born,
                         to = std::min(frames.y(), born + gust.life) - born;
            if (!gust.exists() || !(from <= to)) continue;
            ++contacts.passing;
            const Vec3d reach = Vec3d::Constant(gust.radius);
            const Eigen::AlignedBox3d around(box.min() - reach, box.max() + reach);
            const auto at = [&](int part) {
                const double age = from + (to - from) * part / parts;
                return center_of(passage, gust, born, age, air_at(wind, born + age));
            };
            bool touches = false;
            for (int part = 0; part < parts && !touches; ++part)
                touches = segment_meets_box(at(part), at(part + 1), around);
            contacts.touching += touches;
        }
    return contacts;
}

bool gusts_move(const Gusts& gusts) {
    const bool sends =
        gusts.num_gusts > 0 && gusts.strength != 0.0 && gusts.radius.y() > 0.0 && gusts.life.y() > 0.0;
    const auto keyed = [](const GustControl& control) {
        return control.transform.moves() && control.strength != 0.0;
    };
    return sends || std::ranges::any_of(gusts.controls, keyed);
}

std::vector<GustSphere> random_gusts_at(const Gusts& gusts, const GustCarrier& wind, double frame,
                                        double fps) {
    ActiveInfluences alive{everywhere()};
    add_procedural(gusts, wind, std::clamp(frame, -latest_frame, latest_frame), fps, alive);
    std::vector<GustSphere> spheres;
    for (const Influence& gust : sorted_along_curve(alive))
        spheres.push_back({gust.center, 1.0 / gust.to_unit(0, 0), gust.weight * (*gust.ramp)(0.0)});
    return spheres;
}

GustField gusts_at(const Gusts& gusts, const GustCarrier& wind, double frame, double fps,
                   const Eigen::AlignedBox3d& within) {
    const double when = std::clamp(frame, -latest_frame, latest_frame);
    ActiveInfluences alive{within};
    add_procedural(gusts, wind, when, fps, alive);
    for (const GustControl& control : gusts.controls) add_control(control, when, alive);
    GustField field;
    field.influences = sorted_along_curve(alive);
    build_tree(field);
    return field;
}

} // namespace marram
