// SPDX-License-Identifier: Apache-2.0
#include "procedural/air/ground_air.h"

#include "core/math/digest.h"
#include "procedural/abi/parallel.h"
#include "procedural/air/separation.h"
#include "procedural/air/shear.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// A field on rows along x instead of along z, or back.
void turn_rows(const float* from, int rows, int columns, size_t from_pitch, float* to, size_t to_pitch) {
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c)
            to[size_t(c) * to_pitch + size_t(r)] = from[size_t(r) * from_pitch + size_t(c)];
}

struct AirRows { // the ground in rows that the wind crosses, and its air
    int rows, columns;
    size_t pitch;
    WideVector<float> height, excess, along, across;
};

AirRows air_of(const HeightGrid& ground, const Vec2d& direction) {
    constexpr size_t slack = 16; // after the last row: loaded but without effect
    const bool turned = std::abs(direction.x()) > std::abs(direction.y());
    const int rows = turned ? ground.nx : ground.nz, columns = turned ? ground.nz : ground.nx;
    const double wind_row = turned ? direction.x() : direction.y(),
                 wind_column = turned ? direction.y() : direction.x();
    const auto pitch = size_t(Shear::pitch(columns));
    AirRows air{rows, columns, pitch, {}, {}, {}, {}};
    for (WideVector<float>* field : {&air.height, &air.excess, &air.along, &air.across})
        field->assign(pitch * size_t(rows) + slack, 0.0F);
    const auto [least, most] = std::ranges::minmax(ground.heights);
    std::vector<float> level(ground.heights.size()); // above the lowest: floats
    std::ranges::transform(ground.heights, level.begin(), [&](float h) { return h - least; });
    if (turned)
        turn_rows(level.data(), ground.nz, ground.nx, size_t(ground.nx), air.height.data(), pitch);
    else
        for (int r = 0; r < rows; ++r)
            std::copy_n(level.data() + size_t(r) * size_t(columns), columns,
                        air.height.data() + size_t(r) * pitch);
    const DownwindGrid course{rows,        columns,        false,
                              ground.cell, wind_row < 0.0, wind_column / std::abs(wind_row)};
    Separation().find(course, {}, air.height.data(), double(most) - double(least), pitch, air.excess.data());
    const int padded_rows = padded_size(rows), padded_columns = padded_size(columns);
    const auto wide = size_t(Shear::pitch(padded_columns));
    WideVector<float> surface(wide * size_t(padded_rows) + slack);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c)
            surface[size_t(r) * wide + size_t(c)] =
                air.height[size_t(r) * pitch + size_t(c)] + air.excess[size_t(r) * pitch + size_t(c)];
    pad_surface(rows, columns, padded_rows, padded_columns, surface.data());
    Shear(padded_rows, padded_columns, ground.cell)
        .perturbation({}, wind_row, wind_column, surface.data(), rows, columns, air.along.data(),
                      air.across.data());
    return air;
}

uint64_t digest_of_shape(const MarramMesh& mesh) {
    return Digest()
        .add(mesh.positions[0], 12 * size_t(mesh.vertex_count))
        .add(mesh.triangles, 12 * size_t(mesh.triangle_count))
        .value();
}

} // namespace

GroundAir::GroundAir(HeightGrid ground) : ground_(std::move(ground)), shape_(ground_.heights.size()) {
    const HeightGrid& g = ground_;
    for (int j = 0; j < g.nz; ++j)
        for (int i = 0; i < g.nx; ++i) {
            const auto slope = [&](int i0, int j0, int i1, int j1) {
                const int steps = (i1 - i0) + (j1 - j0);
                if (steps == 0) return 0.0F;
                return float((double(g.heights[g.index(i1, j1)]) - double(g.heights[g.index(i0, j0)])) /
                             (steps * g.cell));
            };
            shape_[g.index(i, j)] =
                Sample{g.heights[g.index(i, j)], slope(std::max(i - 1, 0), j, std::min(i + 1, g.nx - 1), j),
                       slope(i, std::max(j - 1, 0), i, std::min(j + 1, g.nz - 1))};
        }
}

std::shared_ptr<GroundAir> GroundAir::over(const MarramMesh& mesh) {
    static std::mutex mutex; // of `known`
    static std::vector<std::pair<uint64_t, std::weak_ptr<GroundAir>>> known;
    const uint64_t digest = digest_of_shape(mesh);
    const auto find = [&]() -> std::shared_ptr<GroundAir> {
        std::erase_if(known, [](const auto& entry) { return entry.second.expired(); });
        for (const auto& [other, air] : known)
            if (other == digest)
                if (std::shared_ptr<GroundAir> found = air.lock()) return found;
        return nullptr;
    };
    {
        const std::lock_guard lock(mutex);
        if (std::shared_ptr<GroundAir> found = find()) return found;
    }
    auto made = std::make_shared<GroundAir>(heights_from_above(mesh));
    const std::lock_guard lock(mutex);
    if (std::shared_ptr<GroundAir> found = find()) return found; // another thread was first
    known.emplace_back(digest, made);
    return made;
}

std::shared_ptr<const GroundAir::Table> GroundAir::table(double angle) {
    {
        const std::lock_guard lock(mutex_);
        if (const auto found = tables_.find(angle); found != tables_.end()) return found->second;
    }
    const Vec2d direction(std::cos(angle), std::sin(angle));
    const AirRows air = air_of(ground_, direction);
    const bool turned = air.rows == ground_.nx && std::abs(direction.x()) > std::abs(direction.y());
    auto made = std::make_shared<Table>(ground_.heights.size());
    for (int j = 0; j < ground_.nz; ++j)
        for (int i = 0; i < ground_.nx; ++i) {
            const size_t at = turned ? size_t(i) * air.pitch + size_t(j) : size_t(j) * air.pitch + size_t(i);
            // Across is towards (-d_z, d_x) in rows along x, else to the other side.
            (*made)[ground_.index(i, j)] =
                Sample{air.along[at], turned ? air.across[at] : -air.across[at], air.excess[at]};
        }
    const std::lock_guard lock(mutex_);
    constexpr size_t most_tables = 48; // those of a wind that turns are 24
    if (tables_.size() >= most_tables)
        std::erase_if(tables_, [](const auto& entry) { return entry.second.use_count() == 1; });
    return tables_.emplace(angle, made).first->second;
}

GroundAir::At GroundAir::at(const Vec3d& direction, bool turns) {
    const Vec2d level(direction.x(), direction.z());
    const double length = level.norm();
    if (!(length > 0.0) || ground_.heights.empty()) return {};
    At at{this, nullptr, nullptr, 0.0, level / length};
    const double angle = std::atan2(at.direction.y(), at.direction.x());
    if (!turns) {
        at.first = at.second = table(angle);
        return at;
    }
    constexpr double apart = 15.0 * degree;
    constexpr int directions = 24;
    const double index = std::floor(angle / apart);
    const auto direction_at = [&](int k) { return ((k % directions + directions) % directions) * apart; };
    at.part = std::clamp(angle / apart - index, 0.0, 1.0);
    at.first = table(direction_at(int(index)));
    at.second = table(direction_at(int(index) + 1));
    return at;
}

size_t GroundAir::bytes() const {
    const std::lock_guard lock(mutex_);
    return ground_.heights.capacity() * sizeof(float) + shape_.capacity() * sizeof(Sample) +
           tables_.size() * ground_.heights.size() * sizeof(Table::value_type);
}

namespace {

// What a wind over ground needs at eight points.
struct GroundSample {
    VDouble height, slope_x, slope_z, along, across, excess;
    VLong inside{};
};

// Bilinear, lane by lane: the loads dominate.
GroundSample sample_ground(const GroundAir::At& at, const Wide3d& p) {
    using Sample = GroundAir::Sample;
    const HeightGrid& g = at.air->ground();
    const Sample *const shape = at.air->shape().data(), *const first = at.first->data(),
                        *const second = at.second->data();
    const size_t right = g.nx > 1 ? 1 : 0, up = g.nz > 1 ? size_t(g.nx) : 0;
    const double per_cell = 1.0 / g.cell;
    const bool between = first != second;
    GroundSample out{};
    for (int lane = 0; lane < lanes; ++lane) {
        constexpr double border = 1e-6; // of a cell: points on the border, rounded
        double x = (p.x[lane] - g.x0) * per_cell, z = (p.z[lane] - g.z0) * per_cell;
        if (!(x >= -border && z >= -border && x <= g.nx - 1 + border && z <= g.nz - 1 + border)) continue;
        x = std::clamp(x, 0.0, double(g.nx - 1)), z = std::clamp(z, 0.0, double(g.nz - 1));
        out.inside[lane] = -1;
        const int i = std::min(int(x), std::max(g.nx - 2, 0)), j = std::min(int(z), std::max(g.nz - 2, 0));
        const auto u = float(x - i), v = float(z - j);
        const size_t corner = g.index(i, j);
        const auto mean = [&](const Sample* field) {
            const Sample* const f = field + corner;
            const Sample low = f[0] + u * (f[right] - f[0]), high = f[up] + u * (f[up + right] - f[up]);
            return low + v * (high - low);
        };
        const Sample ground = mean(shape);
        Sample air = mean(first);
        if (between) air += float(at.part) * (mean(second) - air);
        out.height[lane] = double(ground[0]), out.slope_x[lane] = double(ground[1]),
        out.slope_z[lane] = double(ground[2]);
        out.along[lane] = double(air[0]), out.across[lane] = double(air[1]),
        out.excess[lane] = double(air[2]);
    }
    return out;
}

// f at height z, along and across the wind.
MARRAM_INLINE void relative_wind(const GroundSample& g, const VDouble& z, VDouble& along, VDouble& across) {
    const VDouble stress_along = vmax(g.along + 1.0, 0.0);
    const VDouble stress = vsqrt(stress_along * stress_along + g.across * g.across);
    const VDouble scale = select(stress > 0.0, 1.0 / vsqrt(select(stress > 0.0, stress, 1.0)), 0.0);
    along = stress_along * scale, across = g.across * scale;
    const VLong bubble = g.excess > 0.0;
    const VDouble y = select(bubble, vmin(z / select(bubble, g.excess, 1.0), 1.0), 1.0);
    const VDouble joined = y * y * (3.0 - 2.0 * y);
    along = joined * along - (1.0 - joined) * return_flow;
    across = joined * across;
}

} // namespace

VDouble speed_over_ground(const GroundAir::At& at, const VDouble& x, const VDouble& z, double above) {
    const GroundSample g = sample_ground(at, {x, VDouble{}, z});
    VDouble along, across;
    relative_wind(g, splat(above), along, across);
    return select(g.inside, along, 1.0);
}

Wide3d wind_over_ground(const GroundAir::At& at, const SpeedHeight& reference, const Wide3d& p,
                        const VDouble& above, const Vec3d& velocity) {
    const GroundSample g = sample_ground(at, p);
    const VDouble z = select(g.inside, vmax(p.y + above - g.height, 0.0), above);
    VDouble along, across;
    relative_wind(g, z, along, across);
    const double level = std::hypot(velocity.x(), velocity.z());
    VDouble speed = splat(level);
    if (reference.height > 0.0)
        speed = vlog(z * (1.0 / reference.roughness) + 1.0) *
                (level / std::log1p(reference.height / reference.roughness));
    const double dx = at.direction.x(), dz = at.direction.y();
    const VDouble vx = speed * (along * dx - across * dz), vz = speed * (along * dz + across * dx);
    const VDouble rise = vx * g.slope_x + vz * g.slope_z;
    const VDouble flat = vx * vx + vz * vz, whole = flat + rise * rise;
    const VDouble same_speed = select(whole > 0.0, vsqrt(flat / select(whole > 0.0, whole, 1.0)), 1.0);
    const VDouble share = level > 0.0 ? speed * (1.0 / level) : splat(1.0);
    const Wide3d outside{share * velocity.x(), splat(velocity.y()), share * velocity.z()};
    return select(g.inside, Wide3d{vx * same_speed, rise * same_speed + velocity.y(), vz * same_speed},
                  outside);
}

} // namespace marram
