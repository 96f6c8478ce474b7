// SPDX-License-Identifier: Apache-2.0
// mask: a named mask, made by applying a ramp to a property of the terrain below. Layers above multiply their
// weight by it. Grooms, shaders and image layers read it as an attribute of the terrain.
//
//   by = "height"     metres: bedrock + sand
//        "sand"       metres: thickness of the sand
//        "slope"      degrees, central differences over two cells (one at the border)
//        "curvature"  1/m, five-point Laplacian: positive in hollows, negative on crests; 0 at the border
//        "mask"       another mask (`of`)
//        "image"      first channel of a file, stretched over the terrain, bilinear
//        "noise"      Perlin noise, features `wavelength` metres apart; 3 samples in 1000 exceed -1 to 1
//        "distance"   metres to the nearest point of drawn curves (`along`), seen from above
//        "air"        speed of the air along the terrain's wind, over that over level ground: more than 1 on crests,
//                     below 0 where it returns in the lee, and there rising with `above`, metres over the
//                     ground. It is what strands feel by wind.over (ground_air.h). Depends on the whole terrain:
//                     an edit makes it anew
//
// The ramp's values are clamped to 0 ... 1. With `mask` the result is multiplied by another mask.
//
//     [[procedural.layer]]
//     type = "mask"
//     name = "grassy"
//     by = "slope"
//     ramp = [[8, 1], [20, 0]]
#include "procedural/terrain/mask_layer.h"

#include "core/math/hash.h"
#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/air/ground_air.h"
#include "procedural/noise/noise.h"
#include "procedural/terrain/shape_layer.h"
#include "procedural/terrain/stretched_image.h"

#include <algorithm>
#include <array>
#include <span>

namespace marram {

namespace {

enum class MaskBy { height, sand, slope, curvature, mask, image, distance, noise, air };

MaskBy mask_by(std::string_view name) {
    constexpr std::array names = {"height", "sand",     "slope", "curvature", "mask",
                                  "image",  "distance", "noise", "air"};
    for (size_t i = 0; i < names.size(); ++i)
        if (name == names[i]) return MaskBy(i);
    return MaskBy::height;
}

struct CurveSegment {
    Vec2d a, b;
};

// Consecutive segments and their bounding box.
struct SegmentRun {
    std::span<const CurveSegment> segments;
    Eigen::AlignedBox2d box;
};
constexpr size_t segments_per_run = 64;

double distance_to_segment(const Vec2d& p, const CurveSegment& s) {
    const Vec2d along = s.b - s.a;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0.0 ? std::clamp((p - s.a).dot(along) / length2, 0.0, 1.0) : 0.0;
    return (s.a + t * along - p).norm();
}

std::string name_of_mask(const LayerValues& values) {
    if (values.has("name")) {
        check_mask_name(values.text("name"), values.place("name"));
        return values.text("name");
    }
    throw SceneFault("terrain.mask_name", values.place("by"), "the mask has no name",
                     "give it one: name = \"...\"");
}

HeightGrid air_grid(const Domain& domain, const Fields& fields) {
    HeightGrid grid{domain.nx, domain.nz, domain.cell, domain.x0, domain.z0, {}};
    grid.heights.resize(domain.count());
    marram::parallel_for(0, domain.nz, [&](int j) {
        for (int i = 0; i < domain.nx; ++i)
            grid.heights[domain.index(i, j)] = float(fields.height(domain.index(i, j)));
    });
    return coarsened(std::move(grid));
}

class MaskLayer : public TerrainLayer {
  public:
    explicit MaskLayer(const LayerContext& context)
        : domain_(context.domain), wind_(context.wind), above_(context.values.number("above")) {
        const LayerValues& values = context.values;
        name_ = name_of_mask(values);
        by_ = mask_by(values.text("by"));
        ramp_ = values.ramp("ramp");
        if (values.has("mask")) factor_mask_ = required_mask_name(context, "mask");
        const auto need = [&](const char* parameter) {
            if (!values.has(parameter))
                throw SceneFault("terrain.mask_input", values.place("by"),
                                 "a mask by " + values.text("by") + " needs '" + parameter + "'", "give it");
        };
        if (by_ == MaskBy::mask) need("of"), source_mask_ = required_mask_name(context, "of");
        if (by_ == MaskBy::image) need("file"), image_ = StretchedImage(*values.at("file").grid, domain_);
        noise_.frequency = 1.0 / values.number("wavelength");
        noise_.octaves = values.integer("octaves");
        noise_.seed = uint32_t(hash(context.seed, uint64_t(values.integer("seed"))));
        if (by_ == MaskBy::distance) need("along"), read_curves(context.curves(values.text("along")));
        if (by_ == MaskBy::air && !context.steady_wind)
            throw SceneFault("terrain.mask_wind", values.place("by"),
                             "a mask by air needs a wind of one direction along the ground",
                             "give the terrain a wind.direction of its own");
    }

    Writes writes() const override { return {}; }
    std::vector<std::string> mask_names() const override { return {name_}; }
    double reach() const override {
        if (by_ == MaskBy::air) return infinity;
        return by_ == MaskBy::slope || by_ == MaskBy::curvature ? domain_.cell : 0.0;
    }

    bool evaluate_whole(const Fields& below, const LayerOutput& out,
                        const std::function<bool()>& cancelled) const override {
        GroundAir air(air_grid(domain_, below));
        const GroundAir::At at = air.at({wind_.x(), 0.0, wind_.y()}, false);
        if (cancelled && cancelled()) return false;
        const HeightGrid& grid = air.ground();
        const float* times = factor_mask_.empty() ? nullptr : find_mask(below, factor_mask_);
        marram::parallel_for(0, domain_.nz, [&](int j) {
            // Samples beyond the means take the nearest.
            const double z = std::clamp(domain_.z(j), grid.z0, grid.z0 + (grid.nz - 1) * grid.cell);
            for (int i = 0; i < domain_.nx; i += lanes) {
                VDouble x, speed = splat(1.0);
                for (int lane = 0; lane < lanes; ++lane)
                    x[lane] = std::clamp(domain_.x(std::min(i + lane, domain_.nx - 1)), grid.x0,
                                         grid.x0 + (grid.nx - 1) * grid.cell);
                if (at.air) speed = speed_over_ground(at, x, splat(z), above_);
                for (int lane = 0; lane < std::min(lanes, domain_.nx - i); ++lane)
                    put(i + lane, j, speed[lane], times, out);
            }
        });
        return true;
    }

    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override {
        const float* of = by_ == MaskBy::mask ? find_mask(below, source_mask_) : nullptr;
        const float* times = factor_mask_.empty() ? nullptr : find_mask(below, factor_mask_);
        const auto put_here = [&](int i, int j, double value) { put(i, j, value, times, out); };
        if (by_ == MaskBy::distance) return measure_distances(rect, segments_near(rect), put_here);
        for (int j = rect.j0; j < rect.j1; ++j)
            for (int i = rect.i0; i < rect.i1; ++i)
                put_here(i, j, of ? double(of[domain_.index(i, j)]) : measure(i, j, below));
    }

  private:
    void put(int i, int j, double value, const float* times, const LayerOutput& out) const {
        const size_t sample = domain_.index(i, j);
        const double mask = std::clamp(ramp_(value), 0.0, 1.0);
        out.masks[0][sample] = float(times ? mask * double(times[sample]) : mask);
    }

    void read_curves(const std::vector<DrawnCurve>& curves) {
        for (const DrawnCurve& curve : curves) {
            const size_t count = curve.points.size();
            const auto flat = [&](size_t k) { return Vec2d(curve.points[k].x(), curve.points[k].z()); };
            for (size_t k = 0; k + 1 < count; ++k) segments_.push_back({flat(k), flat(k + 1)});
            if (curve.closed && count > 2) segments_.push_back({flat(count - 1), flat(0)});
            if (count == 1) segments_.push_back({flat(0), flat(0)});
        }
        for (size_t first = 0; first < segments_.size(); first += segments_per_run) {
            SegmentRun& run = runs_.emplace_back();
            run.segments =
                std::span(segments_).subspan(first, std::min(segments_per_run, segments_.size() - first));
            for (const CurveSegment& s : run.segments) run.box.extend(s.a).extend(s.b);
        }
    }

    struct Disc { // contains a rectangle
        Vec2d centre;
        double diameter;
    };
    Disc disc_about(const Rect& rect) const {
        const Vec2d a(domain_.x(rect.i0), domain_.z(rect.j0)),
            b(domain_.x(rect.i1 - 1), domain_.z(rect.j1 - 1));
        return {0.5 * (a + b), (b - a).norm() * (1.0 + 1e-12)};
    }

    // Segments that may be nearest to some sample of the rectangle: their distance to its centre is at most
    // the smallest such distance plus the rectangle's diagonal.
    std::vector<CurveSegment> segments_near(const Rect& rect) const {
        if (runs_.empty()) return {};
        const Disc disc = disc_about(rect);
        std::vector<double> lower; // lower bound of the distance to each run
        for (const SegmentRun& run : runs_) lower.push_back(run.box.exteriorDistance(disc.centre));
        double nearest = infinity;
        const auto look_at = [&](size_t r) {
            for (const CurveSegment& s : runs_[r].segments)
                nearest = std::min(nearest, distance_to_segment(disc.centre, s));
        };
        look_at(size_t(std::min_element(lower.begin(), lower.end()) - lower.begin()));
        for (size_t r = 0; r < runs_.size(); ++r)
            if (lower[r] * (1.0 - 1e-12) <= nearest) look_at(r);
        std::vector<CurveSegment> near;
        for (size_t r = 0; r < runs_.size(); ++r)
            if (lower[r] * (1.0 - 1e-12) <= nearest + disc.diameter)
                keep_near(disc, nearest, runs_[r].segments, near);
        return near;
    }

    static void keep_near(const Disc& disc, double nearest, std::span<const CurveSegment> from,
                          std::vector<CurveSegment>& near) {
        for (const CurveSegment& s : from)
            if (distance_to_segment(disc.centre, s) <= nearest + disc.diameter) near.push_back(s);
    }

    // Calls put(i, j, distance) for all samples. Halves the rectangle recursively: a smaller one has fewer
    // candidate segments.
    void measure_distances(const Rect& rect, const std::vector<CurveSegment>& near, const auto& put) const {
        constexpr int smallest = 4; // samples a side
        constexpr size_t few = 4;   // segments
        const int nx = rect.i1 - rect.i0, nz = rect.j1 - rect.j0;
        if (near.size() <= few || std::max(nx, nz) <= smallest) {
            for (int j = rect.j0; j < rect.j1; ++j)
                for (int i = rect.i0; i < rect.i1; ++i) {
                    double nearest = infinity;
                    for (const CurveSegment& s : near)
                        nearest = std::min(nearest, distance_to_segment({domain_.x(i), domain_.z(j)}, s));
                    put(i, j, nearest);
                }
            return;
        }
        Rect halves[2] = {rect, rect};
        if (nx >= nz)
            halves[0].i1 = halves[1].i0 = rect.i0 + nx / 2;
        else
            halves[0].j1 = halves[1].j0 = rect.j0 + nz / 2;
        for (const Rect& half : halves) {
            const Disc disc = disc_about(half);
            double nearest = infinity;
            for (const CurveSegment& s : near)
                nearest = std::min(nearest, distance_to_segment(disc.centre, s));
            std::vector<CurveSegment> nearer;
            keep_near(disc, nearest, near, nearer);
            measure_distances(half, nearer, put);
        }
    }

    double slope(int i, int j, const Fields& below) const {
        const int west = std::max(i - 1, 0), east = std::min(i + 1, domain_.nx - 1),
                  north = std::max(j - 1, 0), south = std::min(j + 1, domain_.nz - 1);
        const auto rise = [&](int i0, int j0, int i1, int j1) {
            const int steps = (i1 - i0) + (j1 - j0);
            return steps == 0 ? 0.0
                              : (below.height(domain_.index(i1, j1)) - below.height(domain_.index(i0, j0))) /
                                    (steps * domain_.cell);
        };
        return std::atan(std::hypot(rise(west, j, east, j), rise(i, north, i, south))) / degree;
    }

    double curvature(int i, int j, const Fields& below) const {
        if (i == 0 || j == 0 || i == domain_.nx - 1 || j == domain_.nz - 1) return 0.0;
        const auto height = [&](int a, int b) { return below.height(domain_.index(a, b)); };
        return (height(i - 1, j) + height(i + 1, j) + height(i, j - 1) + height(i, j + 1) -
                4.0 * height(i, j)) /
               (domain_.cell * domain_.cell);
    }

    double noise_at(double x, double z) const {
        constexpr double deviations = 3.0;
        const Wide3d point{splat(x), splat(0.0), splat(z)};
        Wide3f value{};
        vector_noise(noise_, &point, 1, false, 0.0, &value);
        return double(value.x[0]) / (deviations * perlin_rms_3d);
    }

    double measure(int i, int j, const Fields& below) const {
        const size_t sample = domain_.index(i, j);
        switch (by_) {
        case MaskBy::height:
            return below.height(sample);
        case MaskBy::sand:
            return sand_metres(below.sand[sample]);
        case MaskBy::slope:
            return slope(i, j, below);
        case MaskBy::curvature:
            return curvature(i, j, below);
        case MaskBy::image:
            return image_.at(i, j);
        case MaskBy::noise:
            return noise_at(domain_.x(i), domain_.z(j));
        case MaskBy::mask:
        case MaskBy::distance:
            break; // handled in evaluate()
        case MaskBy::air:
            break; // in evaluate_whole()
        }
        return 0.0;
    }

    Domain domain_;
    Vec2d wind_;
    double above_; // m
    std::string name_, source_mask_, factor_mask_;
    MaskBy by_;
    Ramp ramp_;
    StretchedImage image_;
    std::vector<CurveSegment> segments_;
    std::vector<SegmentRun> runs_; // cover segments_
    FractalNoise noise_;
};

constexpr std::array mask_params = {
    param::choice("by", "", "height|sand|slope|curvature|mask|image|distance|noise|air", "input of the ramp"),
    param::ramp("ramp", "", "[[0, 0], [1, 1]]", -1e9, 1e9,
                "m, deg, 1/m, 0 to 1 or relative speed -> the mask"),
    param::text("of", "none", "the mask, by mask"),
    param::image("file", "none", "", "the image, by image"),
    param::curves("along", "none", "the curves, by distance"),
    param::number("wavelength", "m", "5", 1e-3, 1e6, "by noise: of the coarsest octave"),
    param::number("above", "m", "0.3", 0, 1e4, "by air: height above the ground"),
    param::integer("octaves", "", "3", 1, 16, "by noise: each half as long as the one before"),
    param::integer("seed", "", "0", 0, 1e9, "by noise: random seed"),
    param::text("mask", "none", "name of a mask that it is multiplied by"),
};

} // namespace

// Rejects the names of built-in attributes and grids, and names that cannot be part of a comma-separated
// list.
void check_mask_name(const std::string& name, const std::string& place) {
    for (const char* taken : {"sand", "slope", "height", "bedrock", "ripples", "ripple_wave"})
        if (name == taken)
            throw SceneFault("terrain.mask_name", place,
                             "'" + name + "' is the name of a built-in terrain attribute",
                             "give the mask another name");
    const auto bad = [](char c) { return static_cast<unsigned char>(c) < ' ' || c == ','; };
    if (name.empty() || std::any_of(name.begin(), name.end(), bad))
        throw SceneFault("terrain.mask_name", place,
                         "the name of a mask is empty or holds a comma or a line break", "give it another");
}

LayerType mask_layer_type() {
    return {"mask", "a mask by height, slope, sand, the air, an image, or the distance to curves",
            mask_params,
            [](const LayerContext& context) -> std::unique_ptr<TerrainLayer> {
                return std::make_unique<MaskLayer>(context);
            },
            [](const LayerValues& values) { return std::vector<std::string>{name_of_mask(values)}; }};
}

} // namespace marram
