// SPDX-License-Identifier: Apache-2.0
// Fourier transforms of eight columns at once. See transform.cpp for the algorithm.
#pragma once

#include "core/math/simd.h"

#include <vector>

namespace marram {

struct alignas(lanes * 4) WideComplex {
    VFloat re, im;
};

// A plan for one length. Create it once; run() is thread-safe.
class Transform {
  public:
    explicit Transform(int size);

    int size() const { return size_; }
    // X_k = sum over j of x_j exp(-2 pi i j k / size), for `size` values in `data`; `scratch` has the same
    // size. Returns the one of the two that holds the result. Inverse (without 1 / size): swap re and im of
    // input and output.
    WideComplex* run(WideComplex* data, WideComplex* scratch) const;

    // The smallest length >= `size` with no prime factors except 2, 3 and 5.
    static int good_size(int size);

  private:
    struct Pass {
        int radix, count, stride; // radix; number of twiddle indices; number of values per twiddle
        size_t twiddles;          // index of the first twiddle
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
