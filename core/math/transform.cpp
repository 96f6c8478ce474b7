// SPDX-License-Identifier: Apache-2.0
#include "core/math/transform.h"

#include "core/math/digest.h"

#include <algorithm>
#include <bit>
#include <cassert>

namespace marram {

KeyedTransform::KeyedTransform(std::span<const double> numbers, std::string_view interpolation)
    : smooth_(interpolation == "smooth") {
    assert(numbers.size() % 10 == 0);
    for (size_t i = 0; i + 9 < numbers.size(); i += 10) {
        const double* k = numbers.data() + i;
        keys_.push_back({k[0], Vec3d(k + 1), Vec3d(k + 4) * degree, Vec3d(k + 7)});
    }
}

Eigen::Affine3d KeyedTransform::at(double frame) const {
    if (keys_.empty()) return Eigen::Affine3d::Identity();
    size_t after = 0;
    while (after < keys_.size() && keys_[after].frame <= frame) ++after;
    Key key = keys_[after == 0 ? 0 : after - 1];
    if (after > 0 && after < keys_.size() && keys_[after - 1].frame < frame) {
        const Key &a = keys_[after - 1], &b = keys_[after];
        double t = (frame - a.frame) / (b.frame - a.frame);
        if (smooth_) t = t * t * (3.0 - 2.0 * t);
        key.translation = a.translation + t * (b.translation - a.translation);
        key.angles = a.angles + t * (b.angles - a.angles);
        key.scale = a.scale + t * (b.scale - a.scale);
    }
    Eigen::Affine3d m = Eigen::Affine3d::Identity();
    const Eigen::Quaterniond rotation = Eigen::AngleAxisd(key.angles.z(), Vec3d::UnitZ()) *
                                        Eigen::AngleAxisd(key.angles.y(), Vec3d::UnitY()) *
                                        Eigen::AngleAxisd(key.angles.x(), Vec3d::UnitX());
    m.linear() = rotation.toRotationMatrix() * key.scale.asDiagonal();
    m.translation() = key.translation;
    return m;
}

bool KeyedTransform::moves() const {
    return std::ranges::any_of(keys_, [&](const Key& key) {
        const Key& first = keys_.front();
        return key.translation != first.translation || key.angles != first.angles || key.scale != first.scale;
    });
}

bool KeyedTransform::moves_within(double begin, double end) const {
    return moves() && keys_.front().frame < end && keys_.back().frame > begin && begin < end;
}

std::vector<double> KeyedTransform::frames() const {
    std::vector<double> all;
    for (const Key& key : keys_) all.push_back(key.frame);
    return all;
}

uint64_t KeyedTransform::digest() const {
    Digest digest;
    for (const Key& key : keys_) {
        digest.add(std::bit_cast<uint64_t>(key.frame));
        for (const Vec3d* v : {&key.translation, &key.angles, &key.scale})
            digest.add(v->data(), 3 * sizeof(double));
    }
    return digest.add(uint64_t(smooth_)).value();
}

} // namespace marram
