// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/noise_along.h"

#include "procedural/wind/keyed_wind.h"

#include <cmath>

namespace marram {
namespace {

NoiseTime noise_time(const Wind& wind, double frame, double fps) {
    const double seconds = frame / fps;
    // The lattice repeats after 2^32 cells. Subtracting whole periods keeps the coordinates small.
    const double period = wind.noise.frequency > 0.0 ? 0x1p32 / wind.noise.frequency : 0.0;
    // Other octaves share that period only if lacunarity is an integer, so it is subtracted only where the
    // coordinate would otherwise lose its fraction.
    const auto wrapped = [&](double x) {
        return std::abs(x) * wind.noise.frequency > 0x1p40 ? std::fmod(x, period) : x;
    };
    double speed = wind.speed, cells = wind.evolution * seconds;
    if (wind.keys) {
        const AirPath &air = wind.keys->air, &evolution = wind.keys->evolution;
        speed = air.speed(frame);
        cells = evolution.is_steady_until(frame) ? evolution.speed(frame) * seconds
                                                 : evolution.displacement(frame).x() / fps;
        if (!air.is_steady_until(frame)) {
            const Vec3d offset = air.displacement(frame) / fps;
            return {0.0, offset.unaryExpr(wrapped), std::fmod(cells, 0x1p32)};
        }
    }
    return {wrapped(speed * seconds), Vec3d::Zero(), std::fmod(cells, 0x1p32)};
}

MARRAM_HOT void sample_points(const Wind& wind, const NoiseTime& time, const Wide3d& noise_origin,
                              const VDouble* arc, int count, Wide3d* points) {
    const Wide3d direction = splat3(wind.direction.data());
    for (int k = 0; k < count; ++k)
        points[k] = noise_origin + direction * (arc[k] * wind.waviness - time.travel);
    if (time.offset == Vec3d::Zero()) return;
    const Wide3d offset = splat3(time.offset.data());
    for (int k = 0; k < count; ++k) points[k] = points[k] - offset;
}

void sample_noise(const Wind& wind, const NoiseTime& time, const Wide3d& noise_origin, const VDouble* arc,
                  int count, Wide3d* points, Wide3f* out) {
    const bool evolves = wind.keys ? wind.keys->evolution.moves() : wind.evolution != 0.0;
    sample_points(wind, time, noise_origin, arc, count, points);
    vector_noise(wind.noise, points, count, evolves, time.w, out);
}

} // namespace

NoiseTimes noise_times(const Wind& wind, double frame, double fps) {
    if (!wind.loops) return {noise_time(wind, frame, fps), {}};
    const double length = wind.loop_end - wind.loop_begin;
    const double phase = (frame - wind.loop_begin) / length;
    const double blend = phase - std::floor(phase);
    const double now = wind.loop_begin + blend * length;
    const double norm = 1.0 / std::sqrt(blend * blend + (1.0 - blend) * (1.0 - blend));
    return {noise_time(wind, now, fps), noise_time(wind, now - length, fps), (1.0 - blend) * norm,
            blend * norm};
}

void noise_along(const Wind& wind, const NoiseTimes& times, const Wide3d& noise_origin, const VDouble* arc,
                 int count, Strands& strands) {
    Wide3f* out = strands.values.data();
    Wide3d* points = strands.points.data();
    sample_noise(wind, times.now, noise_origin, arc, count, points, out);
    if (!wind.loops) return;
    Wide3f* earlier = out + count;
    sample_noise(wind, times.earlier, noise_origin, arc, count, points, earlier);
    const VFloat a = splat_float(float(times.weight_now)), b = splat_float(float(times.weight_earlier));
    for (int k = 0; k < count; ++k) out[k] = out[k] * a + earlier[k] * b;
}

} // namespace marram
