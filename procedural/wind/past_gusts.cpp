// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/past_gusts.h"

#include <algorithm>

namespace marram {

PastGusts::PastGusts(const Gusts& gusts, const Vec3d& wind_direction, const Key& key, int64_t first,
                     int64_t last, PastGusts* earlier)
    : gusts_(&gusts), wind_direction_(wind_direction), key_(key), first_(first),
      made_(size_t(std::max<int64_t>(last - first + 1, 0))) {
    const bool same = earlier && earlier->gusts_ == gusts_ && earlier->key_.fps == key.fps &&
                      earlier->key_.step == key.step && earlier->key_.within.min() == key.within.min() &&
                      earlier->key_.within.max() == key.within.max();
    for (size_t i = 0; i < made_.size(); ++i) {
        const int64_t before = same ? first + int64_t(i) - earlier->first_ : -1;
        const bool known = before >= 0 && size_t(before) < earlier->made_.size();
        made_[i] = known ? earlier->made_[size_t(before)] : std::make_shared<Made>();
    }
}

const GustField& PastGusts::at(int64_t past_sample) {
    Made& made = *made_.at(size_t(past_sample - first_));
    std::call_once(made.once, [&] {
        made.field =
            gusts_at(*gusts_, wind_direction_, double(past_sample) * key_.step, key_.fps, key_.within);
        made.bytes = made.field.bytes();
    });
    return made.field;
}

size_t PastGusts::bytes() const {
    size_t sum = made_.capacity() * (sizeof(Made) + sizeof(made_[0]));
    for (const auto& made : made_) sum += made->bytes;
    return sum;
}

} // namespace marram
