// SPDX-License-Identifier: Apache-2.0
// stones: pebbles, boulders and bedrock outcrops, partly buried in the terrain below.
//
//     [[procedural.layer]]
//     type = "stones"
//     density = 0.08                  # a square metre
//     size = [0.4, 3]                 # metres
//     mask = "gravel"
//     [[procedural.layer]]
//     type = "stones"
//     kind = "outcrop"
//     density = 0.0008
//     size = [8, 30]
//     bed = 0.6
//     dip = 12
//
// Place. The plane is divided into squares of area 1 / density, with one stone at a uniform random place in
// each (jittered sampling). Places are independent of each other, and the number of stones in an area varies
// far less than with independent uniform places. The id is the packed square index. All properties of a stone
// are hashes of (seed, id, use), so a stone is the same for any extent of the terrain. A stone exists only if
// its centre is on the terrain.
//
// Size D, the longest axis: N(> D) ~ D^-p within the range `size`, p = size_power, so with u in [0, 1)
//
//   D = D0 (1 - u (1 - (D0 / D1)^p))^(-1/p);  p = 0: D0 (D1 / D0)^u
//
// Fragmentation gives p from 1.4 to 3.5, larger for rock that was broken more often (D. Turcotte, "Fractals
// and fragmentation", Journal of Geophysical Research 91, 1986). The grid cannot resolve stones smaller than
// 4 cells: they are omitted, counted and reported.
//
// Shape. An ellipsoid of half axes a = D / 2, b = 0.6 to 1 of a, c = 1 - `flatness` (+- a fifth) of b, with
// random heading and tilt, gives 13 jittered planes: 1 on top, 5 on the shoulders, 7 around it. Each plane
// touches the ellipsoid and is then moved inwards by up to 30 % (top: 15 %) of its distance from the centre.
// The body below all planes is convex with facets, never a smooth ball. Only its upward-facing surface is
// used. The height of plane n . p = d is
//
//   y_i(x, z) = (d_i - nx x - nz z) / ny,   top = min over i
//
// |n| = 1, ny >= 0.32 (71 degrees: steeper faces would show as grid steps). The minimum is rounded: smin(p,
// q) = min(p, q) - max(k - |p - q|, 0)^2 / 4k with k = roundness c / ny, so that edges are rounded over about
// the same distance on steep and flat faces. Two more surfaces bound the body: the level of the ellipsoid's
// highest point, and a cone of 72 degrees. At the level of the ellipsoid's lowest point the cone's radius is
// 1.5 a less the largest noise displacement. (x, z) are displaced by up to three octaves of noise: amplitude
// `roughness` D at three standard deviations, wavelength 0.35 D, no octave shorter than 2.5 cells. y is
// displaced by 0.7 c / a of that. So facets are not quite level and edges not quite straight.
//
// Burial. y is measured from a plane through the surface below: mean height and slopes at four points D / 4
// from the stone's centre (slopes are limited to 35 degrees). So a stone lies on a slope as on level ground.
// `burial`, uniform in its range, is the fraction of the ellipsoid's height below that plane at the centre.
//
// Outcrops are bodies of the same kind, three times as flat at the same `flatness`, and cut into beds. Beds
// are parallel to one plane through the whole terrain, which dips by `dip` towards `dip_direction`, so the
// ledges of neighbours are at the same level. Bed k lies between s_k and s_k+1, with s = height above the
// dipping plane through the origin and s_k = bed (k + 0.35 (hash - 1/2)). Within a bed f = (s - s_k) / (s_k+1
// - s_k) becomes
//
//   0.12 f + 0.88 smoothstep((f - q) / (1 - q)),  q = 0.5 to 0.8, hashed
//
// which is a tread and a riser. The map is continuous and keeps s_k, so a body changes by less than one bed.
//
// Stones are bedrock: the surface becomes max(surface, top). Where a stone is higher than the bedrock below,
// bedrock is raised to the stone, and the sand becomes thinner by the same amount, down to 0. So there is no
// sand on top of a stone, and the surface above a fully buried stone is unchanged. Sand that a stone replaces
// is removed, not moved: the report's `sand` gives the amount. No sand piles up beside a stone. Overlapping
// stones combine by the maximum.
//
// mask: its value at the stone's centre is the probability of the stone. The decision uses the stone's own
// hash: a stone that exists at 0.3 also exists at 0.4.
//
// Limits. No overhangs: below its widest part a body is a column. Stones of one layer do not rest on each
// other. The tilt is a hash, not an equilibrium. There is no scour; a fusion layer above lets the sand around
// stones slide to repose. Where a slope falls away at more than 35 degrees, a body ends in a wall: a column
// down to the ground.
//
// Reach: the largest stone and three cells. An edit below re-evaluates only the tiles within reach, an edit
// of the layer only the tiles of stones that differ. Cost: 10,490 stones of 0.5 to 4 m on 2048^2 samples:
// 0.01 s to place, 1.0 s to evaluate on two busy cores, with roughness 1.6 s.
#include "procedural/terrain/sand/stones.h"

#include "core/math/hash.h"
#include "core/math/simd.h"
#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/noise/noise.h"
#include "procedural/terrain/shape_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr double stone_bound = 1.5;         // bounding radius of a body, in half axes a
constexpr double stone_steepest = 0.32;     // minimum ny: 71 degrees
constexpr double stone_cone = 3.0;          // slope of the bounding cone
constexpr double stone_noise_length = 0.35; // wavelength, as a fraction of the size
constexpr double stone_noise_most = 1.65;   // maximum of 3 octaves / amplitude: 1.04 * 1.75 / sqrt(1.3125)
constexpr double stone_slope_limit = 0.7;   // tan(35 degrees)
constexpr double stone_foot = 0.25;         // distance of the ground samples from the centre, / size
constexpr double outcrop_flatness = 1.0 / 3.0;
constexpr int stone_shoulders = 5, stone_sides = 7, stone_planes = 1 + stone_shoulders + stone_sides;

// Keys of the random numbers of one stone.
enum class StoneRandomKey : uint64_t {
    place_x,
    place_z,
    size,
    there,
    burial,
    heading,
    tilt,
    tilt_side,
    width,
    height,
    noise,
    turn,
    plane, // 4 for each plane
    bed = plane + 4 * stone_planes,
    tread
};

struct StoneHash {
    uint64_t word;
    double operator()(StoneRandomKey use, int more = 0) const { // in [0, 1)
        return unit_double(hash(word, uint64_t(use) + uint64_t(more)));
    }
    double in(double low, double high, StoneRandomKey use, int more = 0) const {
        return low + (high - low) * (*this)(use, more);
    }
};

StoneHash stone_hash(uint64_t seed, uint64_t id) { return {hash(hash(seed, 0x73746f6e65), id)}; }

// Squares are numbered from the origin, up to 2^31 in each direction.
uint64_t stone_id(int64_t i, int64_t j) {
    constexpr int64_t half = int64_t(1) << 31;
    return uint64_t(j + half) << 32 | (uint64_t(i + half) & 0xffffffffU);
}

double stone_size(const StoneSettings& settings, double u) {
    const double low = settings.size.x(), ratio = low / settings.size.y(), p = settings.size_power;
    if (!(p > 0.0)) return low * std::pow(ratio, -u);
    return std::min(low * std::pow(1.0 - u * (1.0 - std::pow(ratio, p)), -1.0 / p), settings.size.y());
}

struct StonePlane {
    double gx, gz, top, round; // height: top - gx x - gz z; round: k of the rounded minimum
};

// A stone placed on the surface below. Heights are metres above the tangent plane, x and z are relative to
// the centre.
struct StoneBody {
    std::array<StonePlane, stone_planes> planes{};
    double bottom = 0.0, peak = 0.0, cone = 0.0, round = 0.0; // cone: height of the apex
    double level = 0.0, slope_x = 0.0, slope_z = 0.0;         // the tangent plane
    double bound = 0.0, amplitude = 0.0, upwards = 0.0;       // radius; noise amplitude sideways, upwards
    Vec2d at = Vec2d::Zero();
    FractalNoise noise;
    double noise_y = 0.0;
};

MARRAM_INLINE VDouble stone_smin(VDouble a, VDouble b, double k) {
    const VDouble h = vmax(k - vabs(a - b), 0.0);
    return vmin(a, b) - h * h * (0.25 / k);
}

// Heights of the top above the tangent plane, at eight points relative to the centre.
MARRAM_INLINE VDouble stone_tops(const StoneBody& body, VDouble x, VDouble z) {
    VDouble top = stone_smin(body.cone - stone_cone * vsqrt(x * x + z * z), splat(body.peak), body.round);
    for (const StonePlane& p : body.planes) top = stone_smin(top, p.top - p.gx * x - p.gz * z, p.round);
    return top;
}

struct StoneRow {
    double x[Tiles::side], nx[Tiles::side], ny[Tiles::side], nz[Tiles::side], top[Tiles::side];
};

// Heights of the top above the tangent plane for `count` samples of a row; -infinity outside the body.
MARRAM_HOT void stone_row(const StoneBody& body, double z, int count, StoneRow& row) {
    for (int k = 0; k < count; k += lanes) {
        const VDouble x = vload(row.x + k), nx = vload(row.nx + k), ny = vload(row.ny + k),
                      nz = vload(row.nz + k);
        const VDouble own = stone_tops(body, x + nx, splat(z) + nz);
        const VDouble top = select(own >= body.bottom, own + ny, -infinity);
        vstore(row.top + k, top);
    }
}

double stone_height(const Fields& below, const Domain& d, double x, double z) { // bilinear
    const double u = std::clamp((x - d.x0) / d.cell, 0.0, d.nx - 1.0),
                 v = std::clamp((z - d.z0) / d.cell, 0.0, d.nz - 1.0);
    const int i = std::min(int(u), std::max(d.nx - 2, 0)), j = std::min(int(v), std::max(d.nz - 2, 0));
    const int right = std::min(i + 1, d.nx - 1), down = std::min(j + 1, d.nz - 1);
    const auto mixed = [&](int row) {
        const double a = below.height(d.index(i, row)), b = below.height(d.index(right, row));
        return a + (u - i) * (b - a);
    };
    return mixed(j) + (v - j) * (mixed(down) - mixed(j));
}

// The tangent plane of the ground that a stone lies on.
struct StoneGround {
    double height, slope_x, slope_z;
};

StoneGround stone_ground(const Fields& below, const Domain& d, const Stone& stone) {
    const double far = std::max(stone_foot * stone.size, d.cell), x = stone.at.x(), z = stone.at.y();
    const double west = stone_height(below, d, x - far, z), east = stone_height(below, d, x + far, z),
                 north = stone_height(below, d, x, z - far), south = stone_height(below, d, x, z + far);
    StoneGround ground{0.25 * ((west + east) + (north + south)), (east - west) / (2.0 * far),
                       (south - north) / (2.0 * far)};
    const double steep = std::hypot(ground.slope_x, ground.slope_z);
    const double share = steep > stone_slope_limit ? stone_slope_limit / steep : 1.0;
    ground.slope_x *= share, ground.slope_z *= share;
    return ground;
}

// The point where a plane touches the unit sphere: one on top, a ring on the shoulders, a ring around the
// sides; jittered.
Vec3d stone_tangent_point(const StoneHash& hash, int plane) {
    const bool top = plane == 0, shoulder = plane <= stone_shoulders;
    const int ring = shoulder ? stone_shoulders : stone_sides, first = shoulder ? 1 : 1 + stone_shoulders;
    const double low = top ? 0.0 : shoulder ? 34.0 : 70.0, high = top ? 26.0 : shoulder ? 62.0 : 89.0;
    const double turn = hash(StoneRandomKey::turn, shoulder) + (plane - first) +
                        hash.in(-0.38, 0.38, StoneRandomKey::plane, 4 * plane);
    const double azimuth = top ? 2.0 * pi * hash(StoneRandomKey::turn, 2) : 2.0 * pi * turn / ring;
    const double polar = hash.in(low, high, StoneRandomKey::plane, 4 * plane + 1) * degree;
    return {std::sin(polar) * std::cos(azimuth), std::cos(polar), std::sin(polar) * std::sin(azimuth)};
}

StoneBody stone_body(const StoneSettings& settings, const Stone& stone, const StoneHash& hash,
                     const StoneGround& ground, double cell) {
    StoneBody body;
    const bool outcrop = settings.kind == StoneKind::outcrop;
    const double a = 0.5 * stone.size, b = a * hash.in(0.6, 1.0, StoneRandomKey::width);
    const double flat = (1.0 - settings.flatness) * hash.in(0.8, 1.2, StoneRandomKey::height);
    const double c = b * std::min(flat, 1.0) * (outcrop ? outcrop_flatness : 1.0);
    const double heading = 2.0 * pi * hash(StoneRandomKey::heading),
                 side = 2.0 * pi * hash(StoneRandomKey::tilt_side);
    const double tilt = settings.tilt * hash(StoneRandomKey::tilt) * (outcrop ? 0.25 : 1.0);
    const Eigen::Matrix3d turned = (Eigen::AngleAxisd(tilt, Vec3d(std::cos(side), 0.0, std::sin(side))) *
                                    Eigen::AngleAxisd(heading, Vec3d::UnitY()))
                                       .toRotationMatrix();
    const Vec3d axes(a, c, b);
    // Half the height of the tilted ellipsoid.
    const double half = axes.cwiseProduct(turned.transpose() * Vec3d::UnitY()).norm();
    const double middle =
        half * (1.0 - 2.0 * hash.in(settings.burial.x(), settings.burial.y(), StoneRandomKey::burial));
    body.round = std::max(settings.roundness, 1e-3) * c; // avoids 0 / 0
    for (int p = 0; p < stone_planes; ++p) {
        // The ellipsoid's normal; planes below the minimum ny are made as steep as allowed.
        const Vec3d normal = (turned * stone_tangent_point(hash, p).cwiseQuotient(axes)).normalized();
        const double level = std::hypot(normal.x(), normal.z());
        const double ny = std::max(normal.y(), stone_steepest);
        const double share = ny > normal.y() ? std::sqrt(1.0 - ny * ny) / level : 1.0;
        const Vec3d n(normal.x() * share, ny, normal.z() * share);
        const double far = axes.cwiseProduct(turned.transpose() * n).norm();
        const double cut = hash.in(0.0, p == 0 ? 0.15 : 0.3, StoneRandomKey::plane, 4 * p + 2);
        body.planes[size_t(p)] = {n.x() / ny, n.z() / ny, middle + far * (1.0 - cut) / ny, body.round / ny};
    }
    body.bottom = middle - half;
    body.peak = middle + half;
    body.amplitude = settings.roughness * stone.size / (3.0 * perlin_rms_3d);
    body.bound = stone_bound * a;
    body.cone = body.bottom + stone_cone * std::max(body.bound - stone_noise_most * body.amplitude, 0.0);
    body.level = ground.height, body.slope_x = ground.slope_x, body.slope_z = ground.slope_z;
    body.at = stone.at;
    const double length = stone_noise_length * stone.size;
    body.noise.frequency = 1.0 / length;
    body.noise.octaves = std::clamp(int(std::floor(std::log2(length / (2.5 * cell)))) + 1, 0, 3);
    if (body.noise.octaves == 0) body.amplitude = 0.0, body.noise.octaves = 1;
    body.upwards = 0.7 * body.amplitude * c / a;
    body.noise.seed = uint32_t(hash.word >> 32);
    body.noise_y = 0.5 * length;
    return body;
}

// Maps the height above the dipping plane to the height of its ledge.
double stone_ledge(double s, double bed, const StoneHash& beds) {
    const auto hashed = [&](double k, StoneRandomKey use) {
        return unit_double(hash(hash(beds.word, uint64_t(use)), uint64_t(int64_t(k))));
    };
    const auto border = [&](double k) { return bed * (k + 0.35 * (hashed(k, StoneRandomKey::bed) - 0.5)); };
    double k = std::floor(s / bed);
    if (s < border(k)) k -= 1.0;
    if (s >= border(k + 1.0)) k += 1.0;
    const double low = border(k), high = border(k + 1.0), f = (s - low) / (high - low);
    const double q = 0.5 + 0.3 * hashed(k, StoneRandomKey::tread);
    const double t = std::clamp((f - q) / (1.0 - q), 0.0, 1.0);
    return low + (high - low) * (0.12 * f + 0.88 * t * t * (3.0 - 2.0 * t));
}

void stone_noise(const StoneBody& body, double z, int count, StoneRow& row) {
    std::array<Wide3d, Tiles::side / lanes> points{};
    std::array<Wide3f, Tiles::side / lanes> values{};
    const int blocks = (count + lanes - 1) / lanes;
    for (int k = 0; k < blocks * lanes; ++k) {
        points[size_t(k / lanes)].x[k % lanes] = row.x[k];
        points[size_t(k / lanes)].y[k % lanes] = body.noise_y;
        points[size_t(k / lanes)].z[k % lanes] = z;
    }
    vector_noise(body.noise, points.data(), blocks, false, 0.0, values.data());
    for (int k = 0; k < blocks * lanes; ++k) {
        const Wide3f& v = values[size_t(k / lanes)];
        row.nx[k] = body.amplitude * double(v.x[k % lanes]);
        row.ny[k] = body.upwards * double(v.y[k % lanes]);
        row.nz[k] = body.amplitude * double(v.z[k % lanes]);
    }
}

void stone_check(double count, const std::string& place) {
    if (!(count <= max_stones))
        throw SceneFault("stones.too_many", place, fmt::format("{:g} stones are too many", count),
                         fmt::format("lower the density: {:g} on a terrain is the most", max_stones));
}

} // namespace

Stones place_stones(const StoneSettings& settings, double smallest, const Vec2d& lower, const Vec2d& upper,
                    const std::string& place) {
    Stones stones;
    if (!(settings.density > 0.0) || !((upper - lower).minCoeff() > 0.0)) return stones;
    const double side = std::sqrt(1.0 / settings.density);
    const Vec2d low = (lower / side).array().floor().matrix(), high = (upper / side).array().floor().matrix();
    const Vec2d many = high - low + Vec2d::Ones();
    stone_check(many.x() * many.y(), place);
    const auto i0 = int64_t(low.x()), j0 = int64_t(low.y());
    const auto columns = int64_t(many.x()), rows = int64_t(many.y());
    std::vector<Stones> found(static_cast<size_t>(rows));
    marram::parallel_for(int64_t(0), rows, [&](int64_t r) {
        Stones& row = found[size_t(r)];
        for (int64_t i = i0; i < i0 + columns; ++i) {
            const uint64_t id = stone_id(i, j0 + r);
            const StoneHash hash = stone_hash(settings.seed, id);
            const Vec2d at = side * Vec2d(double(i) + hash(StoneRandomKey::place_x),
                                          double(j0 + r) + hash(StoneRandomKey::place_z));
            if (!((at - lower).minCoeff() >= 0.0 && (upper - at).minCoeff() > 0.0)) continue;
            const double size = stone_size(settings, hash(StoneRandomKey::size));
            if (size >= smallest)
                row.list.push_back({id, at, size});
            else
                ++row.too_small;
        }
    });
    size_t count = 0;
    for (const Stones& row : found) count += row.list.size();
    stones.list.reserve(count);
    for (const Stones& row : found) {
        stones.list.insert(stones.list.end(), row.list.begin(), row.list.end());
        stones.too_small += row.too_small;
    }
    return stones;
}

StonesLayer::StonesLayer(const StoneSettings& settings, const Domain& domain, const std::string& place)
    : settings_(settings), domain_(domain),
      stones_(place_stones(settings, min_cells * domain.cell, {domain.x0, domain.z0},
                           {domain.x(domain.nx - 1), domain.z(domain.nz - 1)}, place)) {
    double largest = 0.0;
    for (const Stone& stone : stones_.list) largest = std::max(largest, stone.size);
    // Distance from the farthest sample of a body to the farthest ground samples it reads.
    if (largest > 0.0) reach_ = (0.5 * stone_bound + stone_foot) * largest + 3.0 * domain.cell;
    bin();
}

// Bins stones by the tiles they may overlap.
void StonesLayer::bin() {
    const Tiles tiles(domain_);
    const auto each = [&](auto&& act) {
        for (size_t s = 0; s < stones_.list.size(); ++s) {
            const Stone& stone = stones_.list[s];
            const double bound = 0.5 * stone_bound * stone.size, tile = Tiles::side * domain_.cell;
            const auto column = [&](double x) {
                return int(std::clamp(std::floor((x - domain_.x0) / tile), 0.0, tiles.columns() - 1.0));
            };
            const auto row = [&](double z) {
                return int(std::clamp(std::floor((z - domain_.z0) / tile), 0.0, tiles.rows() - 1.0));
            };
            // One cell of margin, so that rounding cannot miss a tile.
            const double wide = bound + domain_.cell;
            for (int r = row(stone.at.y() - wide); r <= row(stone.at.y() + wide); ++r)
                for (int c = column(stone.at.x() - wide); c <= column(stone.at.x() + wide); ++c)
                    act(size_t(r) * size_t(tiles.columns()) + size_t(c), uint32_t(s));
        }
    };
    tile_begin_.assign(size_t(tiles.columns()) * size_t(tiles.rows()) + 1, 0);
    each([&](size_t tile, uint32_t) { ++tile_begin_[tile + 1]; });
    for (size_t t = 1; t < tile_begin_.size(); ++t) tile_begin_[t] += tile_begin_[t - 1];
    in_tile_.resize(tile_begin_.back());
    std::vector<uint32_t> next = tile_begin_;
    each([&](size_t tile, uint32_t stone) { in_tile_[next[tile]++] = stone; });
}

void StonesLayer::raise(const Rect& rect, const Fields& below, const float* mask, uint32_t index,
                        float* bedrock) const {
    const Stone& stone = stones_.list[index];
    const StoneHash hash = stone_hash(settings_.seed, stone.id);
    if (mask) {
        const auto near = [&](double metres, int count) {
            return int(std::clamp(std::round(metres / domain_.cell), 0.0, count - 1.0));
        };
        const size_t at = domain_.index(near(stone.at.x() - domain_.x0, domain_.nx),
                                        near(stone.at.y() - domain_.z0, domain_.nz));
        if (!(hash(StoneRandomKey::there) < double(mask[at]))) return;
    }
    const StoneBody body =
        stone_body(settings_, stone, hash, stone_ground(below, domain_, stone), domain_.cell);
    const StoneHash beds = stone_hash(settings_.seed, ~uint64_t(0));
    const Vec2d dip = std::tan(settings_.dip) * settings_.dip_direction;
    const auto first = [&](double metres, int low, int high) {
        return int(std::clamp(std::ceil(metres / domain_.cell), double(low), double(high)));
    };
    const int j0 = first(stone.at.y() - body.bound - domain_.z0, rect.j0, rect.j1),
              j1 = first(stone.at.y() + body.bound - domain_.z0, rect.j0, rect.j1),
              i0 = first(stone.at.x() - body.bound - domain_.x0, rect.i0, rect.i1),
              i1 = first(stone.at.x() + body.bound - domain_.x0, rect.i0, rect.i1);
    StoneRow row{};
    for (int j = j0; j < j1; ++j) {
        const double z = domain_.z(j) - stone.at.y();
        for (int k = 0; k < Tiles::side; ++k) row.x[k] = domain_.x(i0 + k) - stone.at.x();
        if (body.amplitude > 0.0) stone_noise(body, z, i1 - i0, row);
        stone_row(body, z, i1 - i0, row);
        for (int k = 0; k < i1 - i0; ++k) {
            if (!(row.top[k] > -infinity) || std::hypot(row.x[k], z) > body.bound) continue;
            double top = body.level + body.slope_x * row.x[k] + body.slope_z * z + row.top[k];
            if (settings_.kind == StoneKind::outcrop) {
                const double fall = -dip.dot(Vec2d(domain_.x(i0 + k), domain_.z(j)));
                top = fall + stone_ledge(top - fall, settings_.bed, beds);
            }
            float& to = bedrock[domain_.index(i0 + k, j)];
            to = std::max(to, float(top));
        }
    }
}

void StonesLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (rect.empty()) return;
    const size_t width = size_t(rect.i1 - rect.i0);
    for (int j = rect.j0; j < rect.j1; ++j)
        std::copy_n(below.bedrock + domain_.index(rect.i0, j), width,
                    out.bedrock + domain_.index(rect.i0, j));
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(below, settings_.mask);
    const int columns = Tiles(domain_).columns();
    for (int r = rect.j0 / Tiles::side; r <= (rect.j1 - 1) / Tiles::side; ++r)
        for (int c = rect.i0 / Tiles::side; c <= (rect.i1 - 1) / Tiles::side; ++c) {
            const Rect part{std::max(rect.i0, c * Tiles::side), std::max(rect.j0, r * Tiles::side),
                            std::min(rect.i1, (c + 1) * Tiles::side),
                            std::min(rect.j1, (r + 1) * Tiles::side)};
            const size_t tile = size_t(r) * size_t(columns) + size_t(c);
            for (uint32_t k = tile_begin_[tile]; k < tile_begin_[tile + 1]; ++k)
                raise(part, below, mask, in_tile_[k], out.bedrock);
        }
    for (int j = rect.j0; j < rect.j1; ++j) {
        const size_t row = domain_.index(rect.i0, j);
        for (size_t s = row; s < row + width; ++s) {
            const double raised = double(out.bedrock[s]) - double(below.bedrock[s]);
            out.sand[s] =
                raised > 0.0 ? std::max(below.sand[s] - sand_units(raised), SandUnits(0)) : below.sand[s];
        }
    }
}

Tiles StonesLayer::changed_since(const TerrainLayer& before, const Domain& domain) const {
    const auto* other = dynamic_cast<const StonesLayer*>(&before);
    if (!other || other->domain_ != domain_ || domain != domain_) return Tiles(domain, true);
    // Effects of density, size and size_power show in the list of stones; any other setting changes every
    // stone.
    StoneSettings same = other->settings_;
    same.density = settings_.density, same.size = settings_.size, same.size_power = settings_.size_power;
    const bool shape = !(same == settings_);
    Tiles tiles(domain);
    const auto add = [&](const Stone& stone) {
        const Vec2d wide = Vec2d::Constant(0.5 * stone_bound * stone.size);
        tiles.add_box(stone.at - wide, stone.at + wide);
    };
    const std::vector<Stone>&a = stones_.list, &b = other->stones_.list;
    size_t i = 0, j = 0;
    while (i < a.size() || j < b.size()) {
        const bool left = j == b.size() || (i < a.size() && a[i].id <= b[j].id);
        const bool right = i == a.size() || (j < b.size() && b[j].id <= a[i].id);
        const bool kept = left && right && !shape && a[i] == b[j];
        if (left && !kept) add(a[i]);
        if (right && !kept) add(b[j]);
        i += left, j += right;
    }
    return tiles;
}

std::vector<std::pair<std::string, double>> StonesLayer::report() const {
    return {{"stones", double(stones_.list.size())}, {"too_small", double(stones_.too_small)}};
}

namespace {

constexpr double stone_most_metres = 1e5;
constexpr std::array stones_params = {
    param::choice("kind", "\"stone\"", "stone|outcrop", "outcrop: flat bodies of beds, in ledges"),
    param::number("density", "1/m^2", "0.05", 0, 1e6, "of all sizes"),
    param::vec2("size", "m", "[0.5, 4]", 1e-3, stone_most_metres, "longest axis, least and most"),
    param::number("size_power", "", "2", 0, 6, "exponent p of the size distribution N(> D) ~ D^-p"),
    param::number("flatness", "", "0.4", 0, 0.9, "0: as high as wide"),
    param::vec2("burial", "", "[0.35, 0.65]", 0, 1, "share of the height below the surface"),
    param::number("tilt", "deg", "20", 0, 60, "at most; of outcrops a quarter"),
    param::number("roundness", "", "0.06", 0, 1, "radius of the edges, in half heights"),
    param::number("roughness", "", "0.06", 0, 0.3, "displacement, in sizes"),
    param::number("bed", "m", "0.5", 1e-3, stone_most_metres, "outcrop: mean thickness of a bed"),
    param::number("dip", "deg", "8", 0, 60, "outcrop: of the beds"),
    param::number("dip_direction", "deg", "0", -360, 360, "outcrop: where beds fall to, from x to z"),
    param::text("mask", "none", "name of a mask: the probability of a stone"),
    param::integer("seed", "", "0", 0, 1e9, "another number, other stones"),
};

StoneSettings read_stones(const LayerContext& context) {
    const LayerValues& values = context.values;
    StoneSettings settings;
    settings.kind = values.text("kind") == "outcrop" ? StoneKind::outcrop : StoneKind::stone;
    settings.density = values.number("density");
    settings.size = values.vec2("size");
    settings.size_power = values.number("size_power");
    settings.flatness = values.number("flatness");
    settings.burial = values.vec2("burial");
    settings.tilt = values.number("tilt") * degree;
    settings.roundness = values.number("roundness");
    settings.roughness = values.number("roughness");
    settings.bed = values.number("bed");
    settings.dip = values.number("dip") * degree;
    const double fall = values.number("dip_direction") * degree;
    settings.dip_direction = {std::cos(fall), std::sin(fall)};
    settings.seed = hash(context.seed, uint64_t(values.integer("seed")));
    if (values.has("mask")) settings.mask = required_mask_name(context, "mask");
    for (const char* range : {"size", "burial"})
        if (const Vec2d r = values.vec2(range); !(r.x() <= r.y()))
            throw SceneFault("stones.range", values.place(range),
                             fmt::format("{} = [{:g}, {:g}] ends before it begins", range, r.x(), r.y()),
                             "give the smaller number first");
    return settings;
}

std::unique_ptr<TerrainLayer> make_stones(const LayerContext& context) {
    auto layer =
        std::make_unique<StonesLayer>(read_stones(context), context.domain, context.values.place("density"));
    if (const size_t small = layer->stones().too_small; small > 0 && context.warn)
        context.warn(context.values.place("size"),
                     fmt::format("{} of {} stones are smaller than {:g} cells of {:g} m: they are left out",
                                 small, small + layer->stones().list.size(), StonesLayer::min_cells,
                                 context.domain.cell),
                     "take a finer cell, or larger stones: size, density");
    return layer;
}

} // namespace

LayerType stones_layer_type() {
    return {"stones", "pebbles, boulders and outcrops of rock, half buried", stones_params, make_stones};
}

} // namespace marram
