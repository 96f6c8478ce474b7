// SPDX-License-Identifier: Apache-2.0
// flat, noise, image: base layers. They start a terrain, or add to all of it.
//
// flat    a constant height or thickness.
// noise   a sum of octaves (noise/noise.h). `amplitude` is three standard deviations: about three samples in a
//         thousand of perlin noise exceed it.
// image   heights from a file. A pixel value v maps to range[0] + v (range[1] - range[0]). The first row is
//         at the smallest z, the first column at the smallest x; pixel centres are half a pixel inside.
//         Interpolation: Catmull-Rom cubic. It passes through the pixels with a continuous slope and
//         overshoots by at most 1/8 of a step. A sample within 1e-6 of a cell of a pixel centre gets exactly
//         that pixel's value.
//         Outside the extent the layer's share is 0; towards the border it falls to 0 over `fade` metres.
//         Holes that a TIFF declares (GDAL's nodata value) are filled from around, with a warning; a value that
//         stands alone, such as -9999, is reported. Non-finite pixels from a host are holes: the share is 0 where
//         any of the 4 x 4 pixels is one. (Marram's own reader rejects such files.)
//         `range`, `size` and `center` are resolved one by one: the scene's value, else the file's (bake
//         writes them: grid_placement.h), else [0, 1] and the terrain's extent. So a baked file can serve as
//         a base again, at its own place, on any terrain.
//
//     [[procedural.layer]]
//     type = "image"
//     file = "heights.exr"
//     size = [512, 512]
//     range = [0, 40]
#include "procedural/terrain/base_layers.h"

#include "core/math/hash.h"
#include "core/math/known_part.h"
#include "procedural/abi/param.h"
#include "procedural/noise/noise.h"
#include "procedural/terrain/shape_layer.h"

#include <fmt/format.h>

#include <array>

namespace marram {

namespace {

constexpr double max_metres = 1e5;
constexpr double min_extent = 1e-3, max_extent = 1e7; // metres, of an image

template <size_t own>
std::array<MarramParam, own + 4> with_shape(std::array<MarramParam, own> params, const char* target) {
    std::array<MarramParam, own + 4> all;
    std::copy(params.begin(), params.end(), all.begin());
    const auto shape = shape_params(target);
    std::copy(shape.begin(), shape.end(), all.begin() + own);
    return all;
}

class FlatLayer : public ShapeLayer {
  public:
    explicit FlatLayer(const LayerContext& context)
        : ShapeLayer(read_shape(context)), height_(context.values.number("height")) {
        domain_ = context.domain;
    }

  private:
    void shape(int i0, int i1, int, double* own, double* share) const override {
        std::fill_n(own, i1 - i0, height_);
        std::fill_n(share, i1 - i0, 1.0);
    }
    double height_;
};

class NoiseLayer : public ShapeLayer {
  public:
    explicit NoiseLayer(const LayerContext& context) : ShapeLayer(read_shape(context)) {
        domain_ = context.domain;
        const LayerValues& values = context.values;
        const std::string kind = values.text("kind");
        noise_.type = kind == "billow"    ? NoiseType::billow
                      : kind == "wavelet" ? NoiseType::wavelet
                                          : NoiseType::perlin;
        noise_.frequency = 1.0 / values.number("wavelength");
        noise_.octaves = values.integer("octaves");
        noise_.gain = values.number("gain");
        noise_.seed = uint32_t(hash(context.seed, uint64_t(values.integer("seed"))));
        constexpr double deviations = 3.0;
        scale_ = values.number("amplitude") / (deviations * perlin_rms_3d);
        offset_ = values.number("offset");
    }

  private:
    void shape(int i0, int i1, int j, double* own, double* share) const override {
        constexpr int max_blocks = Tiles::side / lanes;
        std::array<Wide3d, max_blocks> points{};
        std::array<Wide3f, max_blocks> values{};
        const int blocks = (i1 - i0 + lanes - 1) / lanes;
        for (int b = 0; b < blocks; ++b)
            for (int k = 0; k < lanes; ++k) {
                points[size_t(b)].x[k] = domain_.x(i0 + b * lanes + k);
                points[size_t(b)].y[k] = 0.0;
                points[size_t(b)].z[k] = domain_.z(j);
            }
        vector_noise(noise_, points.data(), blocks, false, 0.0, values.data());
        for (int k = 0; k < i1 - i0; ++k) {
            own[k] = offset_ + scale_ * double(values[size_t(k / lanes)].x[k % lanes]);
            share[k] = 1.0;
        }
    }
    FractalNoise noise_;
    double scale_, offset_;
};

// Catmull-Rom weights of four pixels, at the fraction t from the second to the third.
std::array<double, 4> cubic_weights(double t) {
    return {t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (-0.5 + 0.5 * t)};
}

class ImageLayer : public ShapeLayer {
  public:
    explicit ImageLayer(const LayerContext& context) : ShapeLayer(read_shape(context)) {
        domain_ = context.domain;
        const LayerValues& values = context.values;
        const MarramGrid& grid = *values.at("file").grid;
        nx_ = int(grid.nx);
        nz_ = int(grid.ny);
        pixels_.resize(size_t(nx_) * size_t(nz_));
        const MarramValue& file = values.at("file");
        const MarramPlacement said = file.placement ? known_part(file.placement) : MarramPlacement{};
        const auto choose = [&](const char* name, uint32_t in_file, const double* files,
                                const Vec2d& otherwise) {
            return values.has(name) ? values.vec2(name) : in_file ? Vec2d(files) : otherwise;
        };
        const Vec2d range = choose("range", said.has_range, said.range, Vec2d(0.0, 1.0));
        for (size_t p = 0; p < pixels_.size(); ++p)
            pixels_[p] =
                float(range.x() + double(grid.values[p * grid.components]) * (range.y() - range.x()));
        for (size_t p = 0; p < pixels_.size(); ++p)
            if (std::isfinite(pixels_[p]) && !(std::abs(double(pixels_[p])) <= max_metres))
                throw SceneFault(
                    "terrain.image_range", values.place("file"),
                    fmt::format("pixel ({}, {}) of the image is a height of {:.3g} m, beyond 100 km",
                                p % size_t(nx_), p / size_t(nx_), double(pixels_[p])),
                    "if it is a hole, declare that value in a TIFF (gdal_edit.py -a_nodata); else give "
                    "another "
                    "range, or scale the image");
        const Vec2d domain_size(domain_.cell * (domain_.nx - 1), domain_.cell * (domain_.nz - 1));
        size_ = choose("size", said.has_extent, said.extent, domain_size);
        const Vec2d center =
            choose("center", said.has_center, said.center, Vec2d(domain_.x0, domain_.z0) + 0.5 * domain_size);
        if (!(size_.allFinite() && center.allFinite() && size_.minCoeff() >= min_extent &&
              size_.maxCoeff() <= max_extent && center.cwiseAbs().maxCoeff() <= max_extent))
            throw SceneFault("terrain.image_placement", file.place,
                             "the file's size or center is out of range", "give size and center");
        begin_ = center - 0.5 * size_;
        fade_ = values.number("fade");
        constexpr double share_of_cell = 1e-6; // far above the rounding of coordinates
        slack_ = share_of_cell * domain_.cell;
    }

  private:
    bool touches(const Rect& rect) const override {
        return domain_.x(rect.i1 - 1) >= begin_.x() - slack_ &&
               domain_.x(rect.i0) <= begin_.x() + size_.x() + slack_ &&
               domain_.z(rect.j1 - 1) >= begin_.y() - slack_ &&
               domain_.z(rect.j0) <= begin_.y() + size_.y() + slack_;
    }

    // Snaps a coordinate to the nearest pixel centre if that is within `slack`.
    static double snapped(double at, double slack) {
        const double nearest = std::nearbyint(at);
        return std::abs(at - nearest) <= slack ? nearest : at;
    }

    double faded(double inside) const { // metres from the border
        if (!(fade_ > 0.0)) return 1.0;
        const double t = std::clamp(inside / fade_, 0.0, 1.0);
        return t * t * (3.0 - 2.0 * t);
    }

    void shape(int i0, int i1, int j, double* own, double* share) const override {
        const double z = domain_.z(j) - begin_.y();
        if (!(z >= -slack_ && z <= size_.y() + slack_)) return;
        for (int i = i0; i < i1; ++i) {
            const double x = domain_.x(i) - begin_.x();
            if (!(x >= -slack_ && x <= size_.x() + slack_)) continue;
            const double value = at(x / size_.x() * nx_ - 0.5, z / size_.y() * nz_ - 0.5);
            if (!std::isfinite(value)) continue; // a hole
            own[i - i0] = value;
            share[i - i0] = faded(std::min({x, z, size_.x() - x, size_.y() - z}));
        }
    }

    // Interpolated value at pixel coordinates, clamped to the outermost pixel centres.
    double at(double x, double y) const {
        x = snapped(x, slack_ * nx_ / size_.x());
        y = snapped(y, slack_ * nz_ / size_.y());
        x = std::clamp(x, 0.0, double(nx_ - 1));
        y = std::clamp(y, 0.0, double(nz_ - 1));
        const int i = std::min(int(x), std::max(nx_ - 2, 0)), j = std::min(int(y), std::max(nz_ - 2, 0));
        const std::array<double, 4> wx = cubic_weights(x - i), wy = cubic_weights(y - j);
        double sum = 0.0;
        for (int b = 0; b < 4; ++b)
            for (int a = 0; a < 4; ++a) {
                const int column = std::clamp(i + a - 1, 0, nx_ - 1), row = std::clamp(j + b - 1, 0, nz_ - 1);
                const float pixel = pixels_[size_t(row) * size_t(nx_) + size_t(column)];
                sum += wx[size_t(a)] * wy[size_t(b)] * double(pixel);
            }
        return sum;
    }

    std::vector<float> pixels_; // metres
    int nx_, nz_;
    Vec2d begin_, size_;
    double fade_,
        slack_; // metres: samples this close to a pixel centre, or outside the border, count as on it
};

template <typename Made>
std::unique_ptr<TerrainLayer> make_base(const LayerContext& context) {
    return std::make_unique<Made>(context);
}

} // namespace

LayerType flat_layer_type() {
    static const auto params = with_shape<1>(
        {param::number("height", "m", "1", -max_metres, max_metres, "height, or thickness of sand")},
        "\"bedrock\"");
    return {"flat", "the same height everywhere", params, make_base<FlatLayer>};
}

LayerType noise_layer_type() {
    static const auto params = with_shape<7>(
        {param::number("amplitude", "m", "2", 0, max_metres,
                       "three standard deviations of the height about the mean"),
         param::number("offset", "m", "0", -max_metres, max_metres, "the mean"),
         param::number("wavelength", "m", "60", 1e-3, 1e6, "of the coarsest octave"),
         param::integer("octaves", "", "5", 1, 16, "each half as long as the one before"),
         param::number("gain", "", "0.45", 0, 1, "amplitude ratio of an octave to the one before"),
         param::choice("kind", "\"perlin\"", "perlin|billow|wavelet", "billow: rounded heaps"),
         param::integer("seed", "", "0", 0, 1e9, "another number, another noise")},
        "\"bedrock\"");
    return {"noise", "hills of fractal noise", params, make_base<NoiseLayer>};
}

LayerType image_layer_type() {
    static const auto params = with_shape<5>(
        {param::image(
             "file", "", "",
             "EXR, TIFF or PNG; its first channel. Holes (a TIFF's nodata value) are filled from around"),
         param::vec2("size", "m", "none", min_extent, max_extent,
                     "extent in x and z; absent: the file's, else the terrain's"),
         param::vec2("center", "m", "none", -max_extent, max_extent,
                     "x and z; absent: the file's, else the terrain's"),
         param::vec2("range", "m", "none", -max_metres, max_metres,
                     "heights of the values 0 and 1; absent: the file's, else [0, 1]"),
         param::number("fade", "m", "0", 0, 1e6, "width of the fade at the image border")},
        "\"bedrock\"");
    return {"image", "heights from an image", params, make_base<ImageLayer>};
}

} // namespace marram
