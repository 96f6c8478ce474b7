// SPDX-License-Identifier: Apache-2.0
#include "core/render/lights/environment_light.h"

#include "core/math/float4.h"

#include <algorithm>
#include <span>

namespace marram {
namespace {

constexpr double table_variance = 0.005;
constexpr uint32_t max_shift = 6; // blocks of 64 x 64 pixels

// Position of a direction in the image, in pixels from the top left corner. Floats suffice: directions are
// floats too, and the error is below a thousandth of a pixel of the widest image.
Vec2f pixel_of(const EnvironmentLight& map, const Vec3f& d) {
    // angles[1] is the polar angle from +y. It is not computed from its cosine, which loses all precision at
    // the poles.
    const Float4 angles =
        fast_atan2(Float4{d.x(), std::sqrt(d.x() * d.x() + d.z() * d.z())}, Float4{-d.z(), d.y()});
    constexpr float turn = static_cast<float>(2.0 * pi);
    float u = 0.5F + (angles[0] + static_cast<float>(map.rotation)) / turn;
    u -= std::floor(u);
    const float v = angles[1] / static_cast<float>(pi);
    return {u * static_cast<float>(map.image.width), v * static_cast<float>(map.image.height)};
}

size_t cell_of(float at, uint32_t count) {
    return std::min(static_cast<size_t>(at), static_cast<size_t>(count) - 1);
}

// column: -1 to width (wraps around); rows are clamped.
const Vec3f& texel(const EnvironmentLight& map, int64_t column, int64_t row) {
    const int64_t width = map.image.width, height = map.image.height;
    if (column < 0) column += width;
    if (column >= width) column -= width;
    row = std::clamp<int64_t>(row, 0, height - 1);
    return map.image.pixels[static_cast<size_t>(row * width + column)];
}

// Bilinear interpolation; pixel: position from pixel_of.
Vec3f radiance_at(const EnvironmentLight& map, const Vec2f& pixel) {
    const Vec2f at = pixel - Vec2f(0.5F, 0.5F);
    const float left = std::floor(at.x()), above = std::floor(at.y());
    const int64_t column = static_cast<int64_t>(left), row = static_cast<int64_t>(above);
    const float x = at.x() - left, y = at.y() - above;
    const Vec3f &a = texel(map, column, row), &b = texel(map, column + 1, row);
    const Vec3f &c = texel(map, column, row + 1), &d = texel(map, column + 1, row + 1);
    const Vec3f top = a + x * (b - a), bottom = c + x * (d - c);
    return map.strength * (top + y * (bottom - top));
}

// The mean of the bilinear interpolant over each pixel.
std::vector<double> pixel_means(const EnvironmentLight& map) {
    std::vector<double> means(static_cast<size_t>(map.image.width) * map.image.height);
    for (int64_t row = 0; row < map.image.height; ++row)
        for (int64_t column = 0; column < map.image.width; ++column) {
            double sum = 0.0;
            for (int64_t dy = -1; dy <= 1; ++dy)
                for (int64_t dx = -1; dx <= 1; ++dx)
                    sum += mean_of(texel(map, column + dx, row + dy)) * (dx == 0 ? 0.75 : 0.125) *
                           (dy == 0 ? 0.75 : 0.125);
            means[static_cast<size_t>(row * map.image.width + column)] = sum * map.strength;
        }
    return means;
}

// Blocks of 2^shift x 2^shift pixels; the last ones of rows and columns may be smaller.
struct Blocks {
    uint32_t shift;
    size_t columns, rows;
    std::vector<double> light, squares; // sums of L a, L^2 a
};

Blocks empty_blocks(const EnvironmentLight& map, uint32_t shift) {
    const size_t columns = ((size_t(map.image.width) - 1) >> shift) + 1,
                 rows = ((size_t(map.image.height) - 1) >> shift) + 1;
    return {shift, columns, rows, std::vector<double>(columns * rows), std::vector<double>(columns * rows)};
}

// dphi (cos t0 - cos t1) of a block. cosines: polar-angle cosines of the pixel row borders.
double solid_angle(const EnvironmentLight& map, std::span<const double> cosines, uint32_t shift,
                   size_t column, size_t row) {
    const auto border = [&](size_t block, uint32_t pixels) {
        return std::min<size_t>(block << shift, pixels);
    };
    const double share =
        double(border(column + 1, map.image.width) - border(column, map.image.width)) / map.image.width;
    return 2.0 * pi * share *
           (cosines[border(row, map.image.height)] - cosines[border(row + 1, map.image.height)]);
}

Blocks blocks_of_four(const EnvironmentLight& map, std::span<const double> means,
                      std::span<const double> cosines) {
    Blocks sums = empty_blocks(map, 1);
    for (size_t row = 0; row < map.image.height; ++row) {
        const double angle = solid_angle(map, cosines, 0, 0, row);
        for (size_t column = 0; column < map.image.width; ++column) {
            const double mean = means[row * map.image.width + column];
            const size_t at = (row >> 1) * sums.columns + (column >> 1);
            sums.light[at] += mean * angle;
            sums.squares[at] += mean * mean * angle;
        }
    }
    return sums;
}

Blocks coarser(const EnvironmentLight& map, const Blocks& blocks) {
    Blocks sums = empty_blocks(map, blocks.shift + 1);
    for (size_t row = 0; row < blocks.rows; ++row)
        for (size_t column = 0; column < blocks.columns; ++column) {
            const size_t from = row * blocks.columns + column, to = (row >> 1) * sums.columns + (column >> 1);
            sums.light[to] += blocks.light[from];
            sums.squares[to] += blocks.squares[from];
        }
    return sums;
}

// Increase of the relative second moment when sampling by these blocks (environment_light.h).
double added_variance(const EnvironmentLight& map, std::span<const double> cosines, const Blocks& blocks) {
    double total = 0.0, moment = 0.0;
    for (size_t i = 0; i < blocks.light.size(); ++i) {
        if (!(blocks.light[i] > 0.0)) continue;
        const double angle = solid_angle(map, cosines, blocks.shift, i % blocks.columns, i / blocks.columns);
        total += blocks.light[i];
        moment += blocks.squares[i] * (angle / blocks.light[i]);
    }
    return total > 0.0 ? moment / total - 1.0 : 0.0;
}

} // namespace

std::vector<ParamSpec> environment_params() {
    using enum ParamType;
    constexpr double any = std::numeric_limits<double>::infinity();
    return {{"file", image, "", "", -any, any, "", "the image, twice as wide as high, up is up"},
            {"strength", number, "", "1", 0, brightest_light, "", "factor on the image"},
            {"rotation", number, "deg", "0", -36000, 36000, "", "turn about y"},
            seen_by_camera_param()};
}

EnvironmentLight make_environment(const ParamSet& params, const LightImageReader& read) {
    EnvironmentLight light;
    light.image = read(params.at("file"), params.number("strength"));
    light.rotation = params.number("rotation") * degree;
    light.strength = float(params.number("strength"));
    light.visible = params.boolean("seen_by_camera");
    return light;
}

Vec3f environment_radiance(const EnvironmentLight& light, const Vec3f& direction) {
    return radiance_at(light, pixel_of(light, direction));
}

EnvironmentSampler::EnvironmentSampler(const EnvironmentLight& light) : light_(light) {
    const LightImage& image = light.image;
    std::vector<double> cosines(image.height + size_t(1));
    for (size_t row = 0; row < cosines.size(); ++row)
        cosines[row] = std::cos(pi * double(row) / image.height);
    std::vector<double> weights = pixel_means(light);
    columns_ = image.width;
    for (Blocks next = blocks_of_four(light, weights, cosines);
         next.shift <= max_shift && added_variance(light, cosines, next) <= table_variance;
         next = coarser(light, next)) {
        shift_ = next.shift;
        columns_ = next.columns;
        weights = next.light;
    }
    const auto angle = [&](size_t i) {
        return solid_angle(light, cosines, shift_, i % columns_, i / columns_);
    };
    if (shift_ == 0)
        for (size_t i = 0; i < weights.size(); ++i) weights[i] *= angle(i);
    by_block_ = Distribution2D(weights, columns_);
    light_.rotation = std::remainder(light.rotation, 2.0 * pi); // large angles would lose precision
    for (size_t row = 0; row <= weights.size() / columns_; ++row)
        cosines_.push_back(cosines[std::min<size_t>(row << shift_, image.height)]);
    densities_.reserve(weights.size());
    for (size_t i = 0; i < weights.size(); ++i)
        densities_.push_back(
            static_cast<float>(by_block_.probability(i % columns_, i / columns_) / angle(i)));
}

double EnvironmentSampler::power(double) const { return 0.25 * by_block_.total(); }

void EnvironmentSampler::sample(const Vec3d&, float, float a, float b, LightSample& sample) const {
    const uint32_t width = light_.image.width;
    const Distribution2D::Choice at = by_block_.sample(a, b);
    const double top = cosines_[at.row], y = top + at.y * (cosines_[at.row + 1] - top);
    const size_t left = at.column << shift_;
    const double columns = static_cast<double>(std::min<size_t>(size_t(1) << shift_, width - left));
    const float column = static_cast<float>(static_cast<double>(left) + at.x * columns);
    const float azimuth = static_cast<float>(2.0 * pi) * (column / static_cast<float>(width) - 0.5F) -
                          static_cast<float>(light_.rotation);
    const float sine = static_cast<float>(std::sqrt(std::max(0.0, 1.0 - y * y)));
    Float4 sin_azimuth, cos_azimuth;
    fast_sin_cos(Float4{} + azimuth, sin_azimuth, cos_azimuth);
    sample.direction = Vec3f(sine * sin_azimuth[0], static_cast<float>(y), -sine * cos_azimuth[0]);
    const float row = fast_atan2(sine, sample.direction.y()) / static_cast<float>(pi) *
                      static_cast<float>(light_.image.height);
    sample.radiance = radiance_at(light_, {column, row});
    sample.pdf = densities_[at.row * columns_ + at.column];
}

LightRadiance EnvironmentSampler::along_ray(const Vec3f& direction, bool camera_ray) const {
    if (camera_ray && !light_.visible) return {};
    const Vec2f at = pixel_of(light_, direction);
    const size_t column = cell_of(at.x(), light_.image.width), row = cell_of(at.y(), light_.image.height);
    return {radiance_at(light_, at), densities_[(row >> shift_) * columns_ + (column >> shift_)]};
}

} // namespace marram
