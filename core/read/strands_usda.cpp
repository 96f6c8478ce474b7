// SPDX-License-Identifier: Apache-2.0
// Reads strands from USD layers; strand_file.h says what is supported.
#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"
#include "core/read/strand_join.h"
#include "core/read/usda/strands_reader.h"
#include "core/read/usda/usda_cvs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

namespace marram {

namespace {

// Relative to a curve's length; for rotating transforms relative to the curves' size.
constexpr double max_deviation = 1e-3;
constexpr uint32_t max_pieces = 8; // per cubic
constexpr int most_depth = 8;      // of bisection between two samples of a transform

} // namespace

// ---- Prims, and values over time

double UsdaStrandsReader::time_codes_a_second() const {
    double rate = 24.0; // USD's default
    for (const std::string_view key : {"framesPerSecond", "timeCodesPerSecond"}) {
        const std::string_view given = find_metadata(scene_.layer().metadata, key);
        if (!given.empty() && (parse_number(given, rate) != NumberFault::none || !(rate > 0.0)))
            throw InputError({path_}, fmt::format("{} is \"{}\"", key, given.substr(0, 32)),
                             "give a number above 0, such as 24");
    }
    return rate;
}

// The time samples if there are any, else the value for every time.
UsdaSeries UsdaStrandsReader::series(const UsdaPrim& prim, std::string_view name) const {
    UsdaSeries series;
    const auto add = [&](double time, const UsdaValue& value) {
        const auto* numbers = std::get_if<Numbers>(&value);
        if (!numbers)
            scene_.fail(series.of->at, fmt::format("\"{}\" has the type {}", name, series.of->type),
                        "export the curves anew");
        series.samples.emplace_back(time, numbers);
    };
    for (const auto& [time, value] : prim.samples(name, &series.of)) add(time, *value);
    if (!series.is_there())
        if (const UsdaValue* value = prim.find(name, &series.of)) add(0.0, *value);
    return series;
}

// Linear between samples; constant before the first and after the last.
const Numbers& UsdaStrandsReader::value_at(const UsdaSeries& series, double time, Numbers& between) const {
    const auto next =
        std::ranges::upper_bound(series.samples, time, {}, &std::pair<double, const Numbers*>::first);
    if (next == series.samples.begin()) return *next->second;
    const Numbers& a = *(next - 1)->second;
    if (next == series.samples.end() || (next - 1)->first == time) return a;
    const Numbers& b = *next->second;
    if (counts_change_) return a;
    if (a.size() != b.size())
        scene_.fail(series.of->at,
                    fmt::format("\"{}\" has {} numbers at time {} and {} at {}", series.of->name, a.size(),
                                (next - 1)->first, b.size(), next->first),
                    "export as many curves and vertices at every frame");
    const double share = (time - (next - 1)->first) / (next->first - (next - 1)->first);
    between.resize(a.size());
    for (size_t i = 0; i < a.size(); ++i) between[i] = a[i] + share * (b[i] - a[i]);
    return between;
}

UsdaTransform UsdaStrandsReader::placing(const std::vector<const UsdaPrim*>& ancestors, double time) const {
    UsdaTransform placing = scene_.root();
    for (const UsdaPrim* one : ancestors) placing = scene_.transform_of(*one, placing, time);
    return placing;
}

// True if points in the box that move linearly from `begin` to `end` stay close enough to where the
// transforms put them.
bool UsdaStrandsReader::is_linear_within(const std::vector<const UsdaPrim*>& ancestors,
                                         const Eigen::AlignedBox3d& box, double begin, double end) const {
    const UsdaTransform a = placing(ancestors, begin), b = placing(ancestors, end);
    const double size = (a.topLeftCorner<3, 3>() * box.sizes().asDiagonal()).norm();
    for (const double share :
         {0.5, 0.21, 0.83}) { // unevenly spaced, so that a whole turn in between is detected
        const UsdaTransform way = placing(ancestors, begin + share * (end - begin)) - (a + share * (b - a));
        for (int corner = 0; corner < 8; ++corner) {
            const Vec3d p = box.corner(Eigen::AlignedBox3d::CornerType(corner));
            const Vec3d off = way.topLeftCorner<3, 3>() * p + way.topRightCorner<3, 1>();
            if (!(off.norm() <= max_deviation * size)) return false;
        }
    }
    return true;
}

void UsdaStrandsReader::bisect(const std::vector<const UsdaPrim*>& ancestors, const Eigen::AlignedBox3d& box,
                               double begin, double end, int depth, std::set<double>& times) const {
    const double middle = 0.5 * (begin + end);
    if (depth == 0 || !(middle > begin && middle < end) || is_linear_within(ancestors, box, begin, end))
        return;
    times.insert(middle);
    bisect(ancestors, box, begin, middle, depth - 1, times);
    bisect(ancestors, box, middle, end, depth - 1, times);
}

// A transform with many samples multiplies the points: rejected if they would need much more memory than the
// file.
void UsdaStrandsReader::check_room(size_t times, uint64_t floats) const {
    const double bytes = double(times) * double(floats) * sizeof(float),
                 most = std::max(256e6, 64.0 * double(bytes_.size()));
    if (bytes > most)
        throw InputError(
            {path_}, fmt::format("its curves at each of {} times would take {:.0f} MB", times, 1e-6 * bytes),
            "leave the transform's time samples out, and give the curves a transform with keys in "
            "the scene");
}

void UsdaStrandsReader::find_times() {
    std::set<double> times;
    uint64_t floats = 0;                                               // per sample
    std::map<std::vector<const UsdaPrim*>, Eigen::AlignedBox3d> moved; // key: the ancestors that transform it
    for (const UsdaCurvesPrim& prim : prims_) {
        const UsdaSeries points = series(prim.self(), "points");
        if (!points.is_there())
            scene_.fail(prim.self().at, fmt::format("the curves \"{}\" have no points", prim.path),
                        "write them into this file: references are not followed");
        const Numbers& first = *points.samples.front().second;
        size_t most = 0;
        for (const auto& [time, value] : points.samples) most = std::max(most, value->size());
        floats += most / 3 * 4;
        if (counts_change_) { // each time has its own values of all attributes
            for (const auto& [time, value] : prim.self().samples("curveVertexCounts")) times.insert(time);
            for (const UsdaAttribute& attribute : prim.self().attributes)
                if (attribute.name.starts_with("primvars:"))
                    floats += most / 3 * usda_type_width(attribute.type);
        }
        for (const UsdaSeries& one : {points, series(prim.self(), widths_name(prim.self()))})
            if (one.samples.size() > 1)
                for (const auto& [time, value] : one.samples) times.insert(time);
        std::vector<const UsdaPrim*> ancestors;
        bool moves = false;
        for (const UsdaPrim* one : prim.ancestors) {
            if (!one->find("xformOpOrder")) continue;
            ancestors.push_back(one);
            moves = moves || scene_.transform_times(*one).size() > 1;
        }
        if (!moves) continue;
        Eigen::AlignedBox3d& box = moved[ancestors];
        for (size_t i = 0; i + 2 < first.size(); i += 3) box.extend(Vec3d(first.data() + i));
    }
    std::set<double> between;
    for (const auto& [ancestors, box] : moved) {
        std::set<double> own;
        for (const UsdaPrim* one : ancestors)
            for (const double time : scene_.transform_times(*one)) own.insert(time);
        times.insert(own.begin(), own.end());
        check_room(times.size(), floats);
        for (auto next = counts_change_ ? own.end() : own.begin();
             next != own.end() && std::next(next) != own.end() && !box.isEmpty(); ++next)
            bisect(ancestors, box, *next, *std::next(next), most_depth, between);
    }
    times.merge(between);
    check_room(times.size(), floats);
    times_.assign(times.begin(), times.end());
    if (times_.empty()) times_.push_back(0.0);
}

// Whether the curves or their vertices are not the same at all times.
bool UsdaStrandsReader::has_changing_counts() const {
    for (const UsdaCurvesPrim& prim : prims_) {
        for (const auto& [time, value] : prim.self().samples("curveVertexCounts"))
            if (*value != *prim.self().find("curveVertexCounts")) return true;
        const UsdaSeries points = series(prim.self(), "points");
        for (const auto& [time, value] : points.samples)
            if (value->size() != points.samples.front().second->size()) return true;
    }
    return false;
}

// The value for every time, or the earliest; of counts that change the sample of the take's time, which holds
// until the next.
const UsdaValue* UsdaStrandsReader::held(const UsdaPrim& prim, std::string_view name) const {
    const auto samples = prim.samples(name);
    if (samples.empty()) return prim.find(name);
    if (!counts_change_) return samples.front().second;
    const UsdaPrim::Samples around = prim.samples_around(name, times_.front());
    return around.before ? &around.before->second : &around.after->second;
}

// ---- Curves

Numbers UsdaStrandsReader::placed_points(const UsdaCurvesPrim& prim, const UsdaSeries& points,
                                         double time) const {
    Numbers between;
    const Numbers& given = value_at(points, time, between);
    const UsdaTransform place = placing(prim.ancestors, time);
    const bool rests = place == UsdaTransform::Identity();
    Numbers placed = &given == &between ? std::move(between) : given;
    for (size_t i = 0; i + 2 < placed.size(); i += 3) {
        Eigen::Map<Vec3d> p(placed.data() + i);
        if (!rests) p = (place.topLeftCorner<3, 3>() * p + place.topRightCorner<3, 1>()).eval();
        if (!(p.array().abs() <= max_curve_coordinate).all())
            scene_.fail(points.of->at,
                        fmt::format("point {} of \"{}\" {}", i / 3, prim.path,
                                    p.allFinite() ? "is beyond 1e8 m" : "is not three finite numbers"),
                        "write finite numbers, and scale the curves down");
    }
    return placed;
}

// Cuts cubics into the fewest equal pieces that keep the curves near the file's; false: there are none.
bool UsdaStrandsReader::cut_evenly(UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points,
                                   StrandFile& part) {
    for (uint32_t pieces = 1;; pieces *= 2) {
        cvs.cut(pieces);
        part.deviation = 0.0;
        bool is_near = true;
        for (const double time : times_) {
            const Numbers vertices = placed_points(prim, points, time);
            const UsdaCvs::Deviation off = cvs.deviation(vertices, cvs.of_vertices(vertices, 3, false));
            part.deviation = std::max(part.deviation, off.distance);
            is_near = is_near && off.share <= max_deviation;
            if (!is_near && pieces < max_pieces) break;
        }
        if (is_near || pieces == max_pieces) return is_near;
    }
}

void UsdaStrandsReader::cut(UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points,
                            StrandFile& part) {
    if (cvs.keeps_vertices() || cut_evenly(cvs, prim, points, part)) return;
    bool has_corners = false;
    for (const double time : times_) has_corners = cvs.mark_corners(placed_points(prim, points, time));
    if (has_corners && cut_evenly(cvs, prim, points, part)) return;
    warn(
        fmt::format("the curves \"{}\" differ from the file's by up to {:.2g} m", prim.path, part.deviation));
}

std::vector<float> UsdaStrandsReader::widths_at(const UsdaCvs& cvs, const UsdaCurvesPrim& prim,
                                                const UsdaSeries& widths, std::string_view name,
                                                double time) const {
    Numbers between;
    const Numbers& given = value_at(widths, time, between);
    if (given.empty()) return {};
    const Interpolation interpolation = width_interpolation(cvs, prim, *widths.of, name, given.size());
    if (given.size() != expected(cvs, interpolation))
        scene_.fail(widths.of->at,
                    fmt::format("\"{}\" has {} widths, its interpolation needs {}", prim.path, given.size(),
                                expected(cvs, interpolation)),
                    "export the curves anew");
    const double scale =
        std::cbrt(std::abs(placing(prim.ancestors, time).topLeftCorner<3, 3>().determinant()));
    for (size_t i = 0; i < given.size(); ++i)
        if (!(given[i] >= 0.0) || !(given[i] * scale <= max_curve_coordinate))
            scene_.fail(widths.of->at,
                        fmt::format("width {} of \"{}\" is not a finite number of 0 or more", i, prim.path),
                        "write diameters");
    const Numbers spread_out = interpolate_to_cvs(cvs, given, 1, interpolation, false);
    std::vector<float> floats(spread_out.size());
    for (size_t i = 0; i < floats.size(); ++i) // a cubic may overshoot below 0
        floats[i] = float(std::max(spread_out[i], 0.0) * scale);
    return floats;
}

void UsdaStrandsReader::read_samples(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points,
                                     StrandFile& part) {
    const std::string_view name = widths_name(prim.self());
    const UsdaSeries widths = series(prim.self(), name);
    for (const double time : times_) {
        StrandSample& sample = part.samples.emplace_back();
        sample.frame = time * frames_per_time_;
        const Numbers placed = cvs.of_vertices(placed_points(prim, points, time), 3, false);
        sample.points.resize(placed.size() / 3);
        for (size_t i = 0; i < placed.size(); ++i) sample.points.front().data()[i] = float(placed[i]);
        if (widths.is_there()) sample.widths = widths_at(cvs, prim, widths, name, time);
        if (sample.widths.size() != part.samples.front().widths.size())
            scene_.fail(widths.of->at, fmt::format("\"{}\" has widths at some times only", prim.path),
                        "export them at every frame");
    }
}

StrandFile UsdaStrandsReader::read_prim(const UsdaCurvesPrim& prim) {
    StrandFile part;
    const UsdaCurveKind kind = usda_curve_kind(scene_, prim.self());
    const UsdaSeries points = series(prim.self(), "points");
    Numbers between;
    const size_t numbers = value_at(points, times_.front(), between).size();
    if (numbers % 3 != 0)
        scene_.fail(points.of->at, fmt::format("the points of \"{}\" are no three numbers each", prim.path),
                    "export the curves anew");
    UsdaCvs cvs(kind,
                usda_curve_counts(scene_, prim.self(), prim.path, kind, numbers / 3,
                                  held(prim.self(), "curveVertexCounts")),
                has_mixed_bases_);
    cut(cvs, prim, points, part);
    if (kind.wrap == UsdaCurveWrap::periodic)
        warn(fmt::format("the curves \"{}\" are closed: they are opened where they begin", prim.path));
    part.counts = cvs.cv_counts();
    part.basis = cvs.basis();
    read_samples(cvs, prim, points, part);
    read_attributes(cvs, prim, part);
    if (!prim.self().samples("velocities").empty() || prim.self().find("velocities"))
        if (times_.size() == 1 && !counts_change_)
            warn(fmt::format("the velocities of \"{}\" are not used: export its points at several frames",
                             prim.path));
    return part;
}

// ---- The whole file

void UsdaStrandsReader::drop_equal_samples(StrandFile& all) const {
    const StrandSample& first = all.samples.front();
    const bool moves = std::ranges::any_of(all.samples, [&](const StrandSample& sample) {
        return sample.points != first.points || sample.widths != first.widths;
    });
    if (!moves) all.samples.resize(1);
}

// B-splines cannot be joined to curves through points: they become such curves.
void UsdaStrandsReader::find_bases() {
    std::set<MarramBasis> bases;
    for (const UsdaCurvesPrim& prim : prims_)
        bases.insert(UsdaCvs(usda_curve_kind(scene_, prim.self()), {}).basis());
    has_mixed_bases_ = bases.size() > 1 && bases.contains(MARRAM_BSPLINE);
    if (has_mixed_bases_)
        warn("its prims have B-splines and other curves: the B-splines become Catmull-Rom curves, as the "
             "others are drawn; export them to files of their own to keep them");
}

// All prims at times_; without curves there are no samples.
StrandFile UsdaStrandsReader::read_prims() {
    StrandFile all;
    for (const UsdaCurvesPrim& prim : prims_) {
        StrandFile part = read_prim(prim);
        if (part.counts.empty()) continue;
        for (std::string& lack : join_strands(scene_.place(prim.self().at), prim.path, std::move(part), all))
            warn(std::move(lack));
    }
    return all;
}

StrandFile UsdaStrandsReader::read_takes() {
    const std::vector<double> times = std::move(times_);
    std::vector<StrandFile> takes;
    for (const double time : times) {
        times_ = {time};
        StrandFile& take = takes.emplace_back(read_prims());
        if (std::ranges::any_of(take.counts, [](uint32_t count) { return count > 1; })) {
            remove_short_curves(path_, take);
            for (std::string& warning : take.warnings) warn(std::move(warning));
            take.warnings.clear();
        } else {
            take = {};
            take.samples.resize(1);
        }
        take.samples.front().frame = time * frames_per_time_;
    }
    const auto full =
        std::ranges::find_if(takes, [](const StrandFile& take) { return !take.counts.empty(); });
    if (full == takes.end())
        throw InputError({path_}, "its BasisCurves have no curves", "check that the strands were exported");
    match_attributes(takes);
    StrandFile all = *full;
    all.takes = std::move(takes);
    return all;
}

StrandFile UsdaStrandsReader::read() {
    UsdaCurvesFound found = find_usda_curves(path_, scene_, reading_.prims);
    prims_ = std::move(found.prims);
    warnings_ = std::move(found.warnings);
    find_bases();
    counts_change_ = has_changing_counts();
    find_times();
    StrandFile all = counts_change_ ? read_takes() : read_prims();
    if (all.samples.empty())
        throw InputError({path_}, "its BasisCurves have no curves", "check that the strands were exported");
    if (!counts_change_) drop_equal_samples(all);
    all.warnings = std::move(warnings_);
    if (!counts_change_) remove_short_curves(path_, all);
    return all;
}

StrandFile read_usda_strands(const std::string& file, std::string_view bytes, const StrandReading& reading) {
    return UsdaStrandsReader(file, bytes, reading).read();
}

} // namespace marram
