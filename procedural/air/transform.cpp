// SPDX-License-Identifier: Apache-2.0
// Fourier transforms of eight columns at once, one per SIMD lane.
//
// Stockham's self-sorting form (C. Van Loan, "Computational Frameworks for the Fast Fourier Transform", 1992,
// section 1.7), decimation in frequency. A pass of radix r over n = r m values with stride s reads a_j = x[q
// + s (p + m j)], j = 0 ... r - 1, and writes
//
//   y[q + s (r p + k)] = w_n^(p k) sum over j of a_j w_r^(j k),  w_n = exp(-2 pi i / n),  p < m, q < s
//
// then continues with n = m and s = r s. Radices 4, 2, 3 and 5 are unrolled; any other prime factor p takes
// p^2 operations. So all lengths work, but those with large primes are slow: use good_size() if the length is
// free.
//
// Error: about 1e-7 sqrt(log2 n) of the root mean square. Twiddles are computed in double.
// Cost: 5 n log2 n operations in floats, eight columns at once: 0.5 ns a value and pass of radix 4 (AVX2).
#include "procedural/air/transform.h"

#include "core/math/vec.h"

#include <cmath>

namespace marram {

Transform::Transform(int size) : size_(size) {
    std::vector<int> radices;
    int rest = size;
    for (const int r : {4, 2, 3, 5})
        for (; rest % r == 0; rest /= r) radices.push_back(r);
    for (int r = 7; rest > 1; r += 2)
        for (; rest % r == 0; rest /= r) radices.push_back(r);
    int n = size, stride = 1;
    for (const int radix : radices) {
        const int count = n / radix;
        passes_.push_back({radix, count, stride, twiddles_.size()});
        for (int p = 0; p < count; ++p)
            for (int k = 1; k < radix; ++k) {
                const double angle = -2.0 * pi * double(int64_t(p) * k % n) / n;
                twiddles_.push_back({float(std::cos(angle)), float(std::sin(angle))});
            }
        for (int k = 0; k < radix; ++k) {
            const double angle = -2.0 * pi * k / radix;
            twiddles_.push_back({float(std::cos(angle)), float(std::sin(angle))});
        }
        n = count;
        stride *= radix;
    }
}

int Transform::good_size(int size) {
    for (int n = std::max(size, 1);; ++n) {
        int rest = n;
        for (const int r : {2, 3, 5})
            while (rest % r == 0) rest /= r;
        if (rest == 1) return n;
    }
}

struct TransformPasses {
    using Pass = Transform::Pass;
    using Twiddle = Transform::Twiddle;

    static MARRAM_INLINE WideComplex add(const WideComplex& a, const WideComplex& b) {
        return {a.re + b.re, a.im + b.im};
    }
    static MARRAM_INLINE WideComplex sub(const WideComplex& a, const WideComplex& b) {
        return {a.re - b.re, a.im - b.im};
    }
    static MARRAM_INLINE WideComplex mul(const WideComplex& a, const Twiddle& w) {
        return {a.re * w.re - a.im * w.im, a.re * w.im + a.im * w.re};
    }
    // a + s i b
    static MARRAM_INLINE WideComplex add_i(const WideComplex& a, const WideComplex& b, float s) {
        return {a.re - s * b.im, a.im + s * b.re};
    }
    static MARRAM_INLINE WideComplex scaled(const WideComplex& a, float s) { return {a.re * s, a.im * s}; }

    static MARRAM_INLINE void radix2(const Pass& pass, const Twiddle* w, const WideComplex* x,
                                     WideComplex* y) {
        const size_t s = size_t(pass.stride), m = size_t(pass.count) * s;
        for (int p = 0; p < pass.count; ++p, ++w)
            for (size_t q = 0; q < s; ++q) {
                const WideComplex* from = x + size_t(p) * s + q;
                WideComplex* to = y + size_t(p) * 2 * s + q;
                to[s] = mul(sub(from[0], from[m]), *w);
                to[0] = add(from[0], from[m]);
            }
    }
    static MARRAM_INLINE void radix3(const Pass& pass, const Twiddle* w, const WideComplex* x,
                                     WideComplex* y) {
        const size_t s = size_t(pass.stride), m = size_t(pass.count) * s;
        const float half_root3 = 0.86602540378443864676F;
        for (int p = 0; p < pass.count; ++p, w += 2)
            for (size_t q = 0; q < s; ++q) {
                const WideComplex* from = x + size_t(p) * s + q;
                WideComplex* to = y + size_t(p) * 3 * s + q;
                const WideComplex sum = add(from[m], from[2 * m]), difference = sub(from[m], from[2 * m]);
                const WideComplex middle = sub(from[0], scaled(sum, 0.5F));
                to[0] = add(from[0], sum);
                to[s] = mul(add_i(middle, difference, -half_root3), w[0]);
                to[2 * s] = mul(add_i(middle, difference, half_root3), w[1]);
            }
    }
    static MARRAM_INLINE void radix4(const Pass& pass, const Twiddle* w, const WideComplex* x,
                                     WideComplex* y) {
        const size_t s = size_t(pass.stride), m = size_t(pass.count) * s;
        for (int p = 0; p < pass.count; ++p, w += 3)
            for (size_t q = 0; q < s; ++q) {
                const WideComplex* from = x + size_t(p) * s + q;
                WideComplex* to = y + size_t(p) * 4 * s + q;
                const WideComplex a = add(from[0], from[2 * m]), b = sub(from[0], from[2 * m]);
                const WideComplex c = add(from[m], from[3 * m]), d = sub(from[m], from[3 * m]);
                to[0] = add(a, c);
                to[s] = mul(add_i(b, d, -1.0F), w[0]);
                to[2 * s] = mul(sub(a, c), w[1]);
                to[3 * s] = mul(add_i(b, d, 1.0F), w[2]);
            }
    }
    static MARRAM_INLINE void radix5(const Pass& pass, const Twiddle* w, const WideComplex* x,
                                     WideComplex* y) {
        const size_t s = size_t(pass.stride), m = size_t(pass.count) * s;
        const float c1 = 0.30901699437494742410F, s1 = 0.95105651629515357212F; // cos, sin of 72 degrees
        const float c2 = -0.80901699437494742410F, s2 = 0.58778525229247312917F;
        for (int p = 0; p < pass.count; ++p, w += 4)
            for (size_t q = 0; q < s; ++q) {
                const WideComplex* from = x + size_t(p) * s + q;
                WideComplex* to = y + size_t(p) * 5 * s + q;
                const WideComplex a = add(from[m], from[4 * m]), b = sub(from[m], from[4 * m]);
                const WideComplex c = add(from[2 * m], from[3 * m]), d = sub(from[2 * m], from[3 * m]);
                const WideComplex u = add(from[0], add(scaled(a, c1), scaled(c, c2)));
                const WideComplex v = add(from[0], add(scaled(a, c2), scaled(c, c1)));
                const WideComplex e = add(scaled(b, s1), scaled(d, s2));
                const WideComplex f = sub(scaled(b, s2), scaled(d, s1));
                to[0] = add(from[0], add(a, c));
                to[s] = mul(add_i(u, e, -1.0F), w[0]);
                to[2 * s] = mul(add_i(v, f, -1.0F), w[1]);
                to[3 * s] = mul(add_i(v, f, 1.0F), w[2]);
                to[4 * s] = mul(add_i(u, e, 1.0F), w[3]);
            }
    }
    static MARRAM_INLINE void radix_any(const Pass& pass, const Twiddle* w, const WideComplex* x,
                                        WideComplex* y) {
        const size_t s = size_t(pass.stride), m = size_t(pass.count) * s, r = size_t(pass.radix);
        const Twiddle* roots = w + size_t(pass.count) * (r - 1);
        for (int p = 0; p < pass.count; ++p, w += r - 1)
            for (size_t q = 0; q < s; ++q) {
                const WideComplex* from = x + size_t(p) * s + q;
                WideComplex* to = y + size_t(p) * r * s + q;
                for (size_t k = 0; k < r; ++k) {
                    WideComplex sum = from[0];
                    size_t root = 0;
                    for (size_t j = 1; j < r; ++j) {
                        root += k;
                        if (root >= r) root -= r;
                        sum = add(sum, mul(from[j * m], roots[root]));
                    }
                    to[k * s] = k == 0 ? sum : mul(sum, w[k - 1]);
                }
            }
    }
    static MARRAM_INLINE void run(const Pass& pass, const Twiddle* w, const WideComplex* x, WideComplex* y) {
        switch (pass.radix) {
        case 2:
            return radix2(pass, w, x, y);
        case 3:
            return radix3(pass, w, x, y);
        case 4:
            return radix4(pass, w, x, y);
        case 5:
            return radix5(pass, w, x, y);
        default:
            return radix_any(pass, w, x, y);
        }
    }
};

MARRAM_HOT WideComplex* Transform::run(WideComplex* data, WideComplex* scratch) const {
    for (const Pass& pass : passes_) {
        TransformPasses::run(pass, twiddles_.data() + pass.twiddles, data, scratch);
        WideComplex* const result = scratch;
        scratch = data;
        data = result;
    }
    return data;
}

} // namespace marram
