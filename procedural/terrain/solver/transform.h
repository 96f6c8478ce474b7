// SPDX-License-Identifier: Apache-2.0
// Fourier transforms of eight columns at once. The page is in transform.cpp.
#pragma once

#include "core/math/simd.h"

#include <vector>

namespace marram {

struct alignas(lanes * 4) WideComplex {
    VFloat re, im;
};

// A plan for one length; made once, then used from any thread.
class Transform {
  public:
    explicit Transform(int size);

    int size() const { return size_; }
    // X_k = sum over j of x_j exp(-2 pi i j k / size), of `size` values in `data`. `scratch` holds as many. Returns whichever of the
    // two holds the result. Inverse (without 1 / size): hand in and take out values with re and im swapped.
    WideComplex* run(WideComplex* data, WideComplex* scratch) const;

    // The next length from `size` on that has no prime factors but 2, 3 and 5.
    static int good_size(int size);

  private:
    struct Pass {
        int radix, count, stride; // butterflies of `radix`; twiddle indices; values that share a twiddle
        size_t twiddles;          // index of the first
    };
    struct Twiddle {
        float re, im;
    };
    friend struct TransformPasses;

    int size_;
    std::vector<Pass> passes_;
    std::vector<Twiddle> twiddles_; // per pass: count * (radix - 1), then radix roots of unity
};

} // namespace marram
