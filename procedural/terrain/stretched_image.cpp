// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/stretched_image.h"

#include <algorithm>

namespace marram {

StretchedImage::StretchedImage(const MarramGrid& grid, const Domain& domain, int components)
    : nx_(int(grid.nx)), nz_(int(grid.ny)), components_(components), samples_x_(domain.nx),
      samples_z_(domain.nz) {
    pixels_.resize(size_t(nx_) * size_t(nz_) * size_t(components));
    for (size_t p = 0; p < size_t(nx_) * size_t(nz_); ++p)
        for (int c = 0; c < components; ++c)
            pixels_[p * size_t(components) + size_t(c)] = grid.values[p * grid.components + size_t(c)];
}

double StretchedImage::at(int i, int j, int channel) const {
    const auto place = [](int k, int samples, int pixels) {
        const double share = samples > 1 ? double(k) / (samples - 1) : 0.5;
        return std::clamp(share * pixels - 0.5, 0.0, double(pixels - 1));
    };
    const double x = place(i, samples_x_, nx_), y = place(j, samples_z_, nz_);
    const int a = std::min(int(x), std::max(nx_ - 2, 0)), b = std::min(int(y), std::max(nz_ - 2, 0));
    const int a1 = std::min(a + 1, nx_ - 1), b1 = std::min(b + 1, nz_ - 1);
    const auto value = [&](int c, int r) {
        return double(pixels_[(size_t(r) * size_t(nx_) + size_t(c)) * size_t(components_) + size_t(channel)]);
    };
    const double s = x - a, t = y - b;
    return (1 - t) * ((1 - s) * value(a, b) + s * value(a1, b)) +
           t * ((1 - s) * value(a, b1) + s * value(a1, b1));
}

} // namespace marram
