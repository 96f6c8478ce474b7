// SPDX-License-Identifier: Apache-2.0
#include "core/compare/flip.h"

#include "core/math/color.h"
#include "core/math/vec.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace marram {
namespace {

constexpr double pixels_a_degree = 67.02;
constexpr double colour_exponent = 0.7, feature_exponent = 0.5;
// Differences up to `knee` of the maximum are mapped to 0 ... `knee_to`.
constexpr double knee = 0.4, knee_to = 0.95;
constexpr double feature_width = 0.082; // degrees

using Colour = std::array<double, 3>;
using Plane = std::vector<float>;
using Planes = std::array<Plane, 3>;

struct Size {
    int width, height;
    size_t pixels() const { return size_t(width) * size_t(height); }
};

// ---- colour spaces, for D65 -----------------------------------------------------------------------------------------

constexpr Colour white = {0.950428545, 1.0, 1.088900371};

Colour xyz_of(const Colour& rgb) {
    return {0.4123907993 * rgb[0] + 0.3575843394 * rgb[1] + 0.1804807884 * rgb[2],
            0.2126390059 * rgb[0] + 0.7151686788 * rgb[1] + 0.0721923154 * rgb[2],
            0.0193308187 * rgb[0] + 0.1191947798 * rgb[1] + 0.9505321522 * rgb[2]};
}

Colour rgb_of(const Colour& xyz) {
    return {3.2409699419 * xyz[0] - 1.5373831776 * xyz[1] - 0.4986107603 * xyz[2],
            -0.9692436363 * xyz[0] + 1.8759675015 * xyz[1] + 0.0415550574 * xyz[2],
            0.0556300797 * xyz[0] - 0.2039769589 * xyz[1] + 1.0569715142 * xyz[2]};
}

// Linear RGB to brightness, red-green and blue-yellow, in the units of L*a*b*.
Colour ycxcz_of(const Colour& rgb) {
    const Colour p = xyz_of(rgb);
    const double x = p[0] / white[0], y = p[1] / white[1], z = p[2] / white[2];
    return {116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)};
}

Colour rgb_of_ycxcz(const Colour& c) {
    const double y = (c[0] + 16.0) / 116.0, x = y + c[1] / 500.0, z = y - c[2] / 200.0;
    return rgb_of({x * white[0], y * white[1], z * white[2]});
}

Colour lab_of(const Colour& rgb) {
    const Colour p = xyz_of(rgb);
    const auto f = [](double t) {
        constexpr double delta = 6.0 / 29.0;
        return t > delta * delta * delta ? std::cbrt(t) : t / (3.0 * delta * delta) + 4.0 / 29.0;
    };
    const double x = f(p[0] / white[0]), y = f(p[1] / white[1]), z = f(p[2] / white[2]);
    return {116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)};
}

Colour hunt_adjusted(const Colour& lab) { return {lab[0], 0.01 * lab[0] * lab[1], 0.01 * lab[0] * lab[2]}; }

double hyab(const Colour& a, const Colour& b) {
    return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

// ---- filters, all separable -----------------------------------------------------------------------------------------

using Kernel = std::vector<double>; // odd size, centred

Kernel kernel(int radius, auto&& value) {
    Kernel k;
    for (int i = -radius; i <= radius; ++i) k.push_back(value(double(i)));
    return k;
}

// Convolves rows with `across`, columns with `down`; pixels outside repeat the edge. The inner loops run
// along rows and vectorize.
Plane convolved(const Plane& in, Size size, const Kernel& across, const Kernel& down) {
    const int rx = int(across.size() / 2), ry = int(down.size() / 2);
    const auto width = size_t(size.width);
    Plane half(size.pixels()), out(size.pixels());
    tbb::parallel_for(0, size.height, [&](int y) {
        const float* row = in.data() + size_t(y) * width;
        Plane wide(width + across.size());
        for (int x = -rx; x < size.width + rx; ++x)
            wide[size_t(x + rx)] = row[std::clamp(x, 0, size.width - 1)];
        float* to = half.data() + size_t(y) * width;
        for (size_t i = 0; i < across.size(); ++i) {
            const auto weight = float(across[i]);
            for (size_t x = 0; x < width; ++x) to[x] += weight * wide[x + i];
        }
    });
    tbb::parallel_for(0, size.height, [&](int y) {
        float* to = out.data() + size_t(y) * width;
        for (int i = -ry; i <= ry; ++i) {
            const auto weight = float(down[size_t(i + ry)]);
            const float* from = half.data() + size_t(std::clamp(y + i, 0, size.height - 1)) * width;
            for (size_t x = 0; x < width; ++x) to[x] += weight * from[x];
        }
    });
    return out;
}

// Contrast sensitivity function of a channel: a sum of a sqrt(pi / b) exp(-pi^2 x^2 / b), x in degrees. The
// whole filter is normalized to a sum of 1.
struct Sensitivity {
    double a1, b1, a2, b2;
};
constexpr std::array<Sensitivity, 3> sensitivities = {
    {{1.0, 0.0047, 0.0, 1e-5}, {1.0, 0.0053, 0.0, 1e-5}, {34.1, 0.04, 13.5, 0.025}}};

void filter_by_csf(Planes& planes, Size size) {
    const int radius = int(std::ceil(3.0 * std::sqrt(0.04 / (2.0 * pi * pi)) * pixels_a_degree));
    for (size_t c = 0; c < 3; ++c) {
        const Sensitivity& s = sensitivities[c];
        Plane sum(size.pixels(), 0.0F);
        double whole = 0.0;
        for (const auto& [a, b] : {std::pair(s.a1, s.b1), std::pair(s.a2, s.b2)}) {
            if (a == 0.0) continue;
            const Kernel k = kernel(radius, [b = b](double i) {
                const double x = i / pixels_a_degree;
                return std::exp(-pi * pi * x * x / b);
            });
            const double one = std::accumulate(k.begin(), k.end(), 0.0), weight = a * std::sqrt(pi / b);
            const Plane part = convolved(planes[c], size, k, k);
            for (size_t i = 0; i < sum.size(); ++i) sum[i] += float(weight * double(part[i]));
            whole += weight * one * one;
        }
        for (float& value : sum) value /= float(whole);
        planes[c] = std::move(sum);
    }
}

// Edge and point strength of each pixel, from brightness.
struct Features {
    Plane edge, point;
};

Features features_of(const Plane& brightness, Size size) {
    const double sigma = 0.5 * feature_width * pixels_a_degree;
    const int radius = int(std::ceil(3.0 * sigma));
    const auto gauss = [sigma](double x) { return std::exp(-x * x / (2.0 * sigma * sigma)); };
    const Kernel smooth = kernel(radius, gauss);
    const double smooth_sum = std::accumulate(smooth.begin(), smooth.end(), 0.0);
    // The positive weights of the whole filter sum to 1, the negative ones to -1.
    const auto normalised = [&](Kernel k) {
        double up = 0.0, down = 0.0;
        for (const double v : k) (v > 0.0 ? up : down) += std::abs(v);
        for (double& v : k) v /= (v > 0.0 ? up : down) * smooth_sum;
        return k;
    };
    const Kernel first = normalised(kernel(radius, [&](double x) { return -x * gauss(x); }));
    const Kernel second =
        normalised(kernel(radius, [&](double x) { return (x * x / (sigma * sigma) - 1.0) * gauss(x); }));
    const auto strength = [&](const Kernel& k) {
        Plane x = convolved(brightness, size, k, smooth);
        const Plane y = convolved(brightness, size, smooth, k);
        for (size_t i = 0; i < x.size(); ++i) x[i] = std::hypot(x[i], y[i]);
        return x;
    };
    return {strength(first), strength(second)};
}

// ---- one exposure ---------------------------------------------------------------------------------------------------

double max_color_distance() {
    static const double most =
        std::pow(hyab(hunt_adjusted(lab_of({0.0, 1.0, 0.0})), hunt_adjusted(lab_of({0.0, 0.0, 1.0}))),
                 colour_exponent);
    return most;
}

// Filtered colours of a picture (linear, 0 ... 1), and its features.
struct FilteredPicture {
    std::vector<Colour> lab; // Hunt-adjusted
    Features features;
};

FilteredPicture filtered_picture(const std::vector<Colour>& rgb, Size size) {
    Planes planes;
    for (Plane& plane : planes) plane.resize(size.pixels());
    Plane brightness(size.pixels());
    for (size_t i = 0; i < rgb.size(); ++i) {
        const Colour c = ycxcz_of(rgb[i]);
        for (size_t k = 0; k < 3; ++k) planes[k][i] = float(c[k]);
        brightness[i] = float((c[0] + 16.0) / 116.0);
    }
    filter_by_csf(planes, size);
    FilteredPicture out{std::vector<Colour>(size.pixels()), features_of(brightness, size)};
    for (size_t i = 0; i < rgb.size(); ++i) {
        Colour c = rgb_of_ycxcz({double(planes[0][i]), double(planes[1][i]), double(planes[2][i])});
        for (double& v : c) v = std::clamp(v, 0.0, 1.0);
        out.lab[i] = hunt_adjusted(lab_of(c));
    }
    return out;
}

void accumulate_flip(const std::vector<Colour>& test, const std::vector<Colour>& reference, Size size,
                     std::vector<float>& map) {
    const FilteredPicture a = filtered_picture(test, size), b = filtered_picture(reference, size);
    const double most = max_color_distance();
    for (size_t i = 0; i < map.size(); ++i) {
        const double apart = std::pow(hyab(a.lab[i], b.lab[i]), colour_exponent);
        const double colour = apart < knee * most
                                  ? knee_to / (knee * most) * apart
                                  : knee_to + (apart - knee * most) / (most - knee * most) * (1.0 - knee_to);
        const double edge = std::abs(double(a.features.edge[i]) - double(b.features.edge[i]));
        const double point = std::abs(double(a.features.point[i]) - double(b.features.point[i]));
        const double feature = std::pow(std::max(edge, point) / std::sqrt(2.0), feature_exponent);
        map[i] = std::max(map[i], float(std::pow(std::min(colour, 1.0), 1.0 - std::min(feature, 1.0))));
    }
}

// ---- exposures ------------------------------------------------------------------------------------------------------

// K. Narkowicz' fit of the ACES curve, with the usual exposure factor 0.6.
double tone_mapped(double x) {
    x = 0.6 * std::max(x, 0.0);
    return std::clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
}

// One stop apart for up to 24 stops between brightest and median; for a greater range the step grows.
constexpr int max_exposures = 24;

// Exposures in stops that map the reference's brightest and its median pixel to 0.85. If the median is 0 (a
// small object in front of black), the median of the pixels with light is used.
std::pair<double, double> exposures_of(const std::vector<float>& reference) {
    constexpr double nearly_white = 0.85;
    double low = 0.0, high = 64.0; // tone_mapped() is monotonic
    for (int i = 0; i < 64; ++i)
        (tone_mapped(0.5 * (low + high)) < nearly_white ? low : high) = 0.5 * (low + high);
    std::vector<double> luminances;
    for (size_t i = 0; i + 2 < reference.size(); i += 3)
        luminances.push_back(std::max(
            0.0, luminance(double(reference[i]), double(reference[i + 1]), double(reference[i + 2]))));
    const auto median_from = [&](std::vector<double>::iterator begin) {
        const auto middle = begin + (luminances.end() - begin) / 2;
        std::nth_element(begin, middle, luminances.end());
        return *middle;
    };
    const double greatest = *std::max_element(luminances.begin(), luminances.end());
    if (!(greatest > 0.0)) return {0.0, 0.0};
    double median = median_from(luminances.begin());
    if (!(median > 0.0))
        median = median_from(
            std::partition(luminances.begin(), luminances.end(), [](double l) { return !(l > 0.0); }));
    return {std::log2(low / greatest), std::log2(low / median)};
}

} // namespace

std::vector<float> flip_map(const std::vector<float>& test, const std::vector<float>& reference, int width,
                            int height, Range range) {
    const Size size{width, height};
    std::vector<float> map(size.pixels(), 0.0F);
    std::vector<Colour> a(size.pixels()), b(size.pixels());
    const auto keep = [&](auto&& shown) {
        for (size_t i = 0; i < a.size(); ++i)
            for (size_t c = 0; c < 3; ++c) {
                a[i][c] = shown(double(test[3 * i + c]));
                b[i][c] = shown(double(reference[3 * i + c]));
            }
        accumulate_flip(a, b, size, map);
    };
    if (range == Range::display) {
        keep([](double v) { return std::clamp(v, 0.0, 1.0); });
        return map;
    }
    const auto [first, last] = exposures_of(reference);
    const int count = std::clamp(int(std::ceil(last - first)), 2, max_exposures);
    for (int e = 0; e < count; ++e) {
        const double gain = std::exp2(first + (last - first) * e / (count - 1));
        keep([gain](double v) { return tone_mapped(gain * v); });
    }
    return map;
}

} // namespace marram
