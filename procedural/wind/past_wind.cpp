// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/past_wind.h"

#include "procedural/wind/keyed_wind.h"

#include <algorithm>

namespace marram {

GroundAir::At ground_at(const Wind& wind, double frame, GroundAir* ground) {
    if (!ground) return {};
    if (!wind.keys) return ground->at(wind.direction, false);
    const AirPath& air = wind.keys->air;
    return ground->at(air.direction(frame), air.has_direction_keys());
}

WindAt wind_with_gusts(const Wind& wind, double frame, double fps, bool with_gusts,
                       const Eigen::AlignedBox3d& within, GroundAir* ground) {
    WindAt at;
    if (wind.keys) at.own = std::make_shared<const Wind>(wind_at(wind, frame));
    at.wind = at.own ? at.own.get() : &wind;
    if (wind.gusts && with_gusts)
        at.gusts = gusts_at(*at.wind->gusts, gust_carrier(wind), frame, fps, within);
    at.fields = fields_at(at.wind->fields, frame);
    at.ground = ground_at(wind, frame, ground);
    return at;
}

PastWind::PastWind(const Wind& wind, const Key& key, int64_t first, int64_t last, PastWind* earlier)
    : wind_(&wind), key_(key), first_(first), made_(size_t(std::max<int64_t>(last - first + 1, 0))) {
    const bool same = earlier && earlier->wind_ == wind_ && earlier->key_.fps == key.fps &&
                      earlier->key_.ground == key.ground && earlier->key_.step == key.step &&
                      earlier->key_.within.min() == key.within.min() &&
                      earlier->key_.within.max() == key.within.max();
    for (size_t i = 0; i < made_.size(); ++i) {
        const int64_t before = same ? first + int64_t(i) - earlier->first_ : -1;
        const bool known = before >= 0 && size_t(before) < earlier->made_.size();
        made_[i] = known ? earlier->made_[size_t(before)] : std::make_shared<Made>();
    }
}

const WindAt& PastWind::at(int64_t past_sample) {
    Made& made = *made_.at(size_t(past_sample - first_));
    std::call_once(made.once, [&] {
        made.wind = wind_with_gusts(*wind_, double(past_sample) * key_.step, key_.fps, true, key_.within,
                                    key_.ground.get());
        made.bytes = made.wind.gusts.bytes() + (made.wind.own ? sizeof(Wind) : 0) +
                     made.wind.fields.capacity() * sizeof(FieldAt);
    });
    return made.wind;
}

size_t PastWind::bytes() const {
    size_t sum = made_.capacity() * (sizeof(Made) + sizeof(made_[0]));
    for (const auto& made : made_) sum += made->bytes;
    return sum;
}

} // namespace marram
