// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/air_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace marram {
namespace {

// Abscissae and weights on [-1, 1] of the rule with eight points (Abramowitz and Stegun 1964, table 25.4).
constexpr std::array<std::array<double, 2>, 4> gauss = {{{0.183434642495649805, 0.362683783378361983},
                                                         {0.525532409916328986, 0.313706645877887287},
                                                         {0.796666477413626740, 0.222381034453374471},
                                                         {0.960289856497536232, 0.101228536290376259}}};

constexpr double halving_tolerance = 1e-13; // of the way
constexpr int max_halvings = 40;

// The last key up to which nothing has changed; infinity if nothing ever does.
double unchanged_until(const std::optional<Keyframes>& keys) {
    if (keys)
        for (size_t i = 1; i < keys->count(); ++i)
            if (!std::ranges::equal(keys->key(i), keys->key(0))) return keys->frames[i - 1];
    return std::numeric_limits<double>::infinity();
}

} // namespace

AirPath::AirPath(double speed, const Vec3d& direction, std::optional<Keyframes> speeds,
                 std::optional<Keyframes> directions)
    : speed_(speed), direction_(direction), speeds_(std::move(speeds)), directions_(std::move(directions)),
      steady_until_(std::min(unchanged_until(speeds_), unchanged_until(directions_))) {
    if (speeds_) speed_ = speeds_->numbers[0];
    if (directions_) direction_ = Vec3d(directions_->numbers.data());
    if (steady_until_ == std::numeric_limits<double>::infinity()) return;
    std::vector<double> breaks = {steady_until_};
    for (const auto* keys : {&speeds_, &directions_})
        if (*keys)
            for (const double frame : (*keys)->frames)
                if (frame > steady_until_) breaks.push_back(frame);
    std::ranges::sort(breaks);
    breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());
    pieces_.push_back({steady_until_, speed_ * direction_ * steady_until_});
    for (size_t i = 0; i + 1 < breaks.size(); ++i) add_pieces(breaks[i], breaks[i + 1], 0);
}

Vec3d AirPath::direction(double frame) const {
    if (!directions_) return direction_;
    Vec3d w;
    directions_->at(frame, {w.data(), 3});
    return renormalised(w);
}

Vec3d AirPath::integral(double begin, double end) const {
    const double middle = 0.5 * (begin + end), half = 0.5 * (end - begin);
    // No key lies between the ends.
    const size_t of_speed = speeds_ ? speeds_->keys_until(middle) : 0,
                 of_direction = directions_ ? directions_->keys_until(middle) : 0;
    const auto velocity_at = [&](double frame) -> Vec3d {
        double speed = speed_;
        Vec3d w = direction_;
        if (speeds_) speeds_->at(frame, of_speed, {&speed, 1});
        if (!directions_) return speed * w;
        directions_->at(frame, of_direction, {w.data(), 3});
        return (speed / w.norm()) * w;
    };
    Vec3d sum = Vec3d::Zero();
    for (const auto& [x, weight] : gauss)
        sum += weight * (velocity_at(middle - half * x) + velocity_at(middle + half * x));
    return sum * half;
}

// Appends where the piece from `begin` to `end` ends, after halving it as often as it needs.
void AirPath::add_pieces(double begin, double end, int halvings) {
    const double middle = 0.5 * (begin + end);
    const Vec3d whole = integral(begin, end);
    if (directions_ && halvings < max_halvings && begin < middle && middle < end) {
        const Vec3d halves = integral(begin, middle) + integral(middle, end);
        const double way = (end - begin) * std::max(speed(begin), speed(end));
        // Frames are rounded, and with them where on its way the direction is.
        const double rounding = 8.0 * std::numeric_limits<double>::epsilon() *
                                std::max(std::abs(begin), std::abs(end)) * std::max(speed(begin), speed(end));
        if (!((halves - whole).norm() <= halving_tolerance * way + rounding)) {
            add_pieces(begin, middle, halvings + 1);
            add_pieces(middle, end, halvings + 1);
            return;
        }
    }
    pieces_.push_back({end, pieces_.back().displacement + whole});
}

Vec3d AirPath::displacement(double frame) const {
    if (is_steady_until(frame)) return speed_ * direction_ * frame;
    const auto after = std::ranges::upper_bound(pieces_, frame, {}, &Piece::begin);
    const Piece& piece = *(after - 1);
    if (after == pieces_.end()) return piece.displacement + velocity(frame) * (frame - piece.begin);
    return piece.displacement + integral(piece.begin, frame);
}

bool AirPath::moves() const {
    return speeds_ ? std::ranges::any_of(speeds_->numbers, [](double v) { return v != 0.0; }) : speed_ != 0.0;
}

} // namespace marram
