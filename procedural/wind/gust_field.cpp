// SPDX-License-Identifier: Apache-2.0
// The influences at one time: their tree, and their sum at CVs.
#include "procedural/wind/gusts.h"

#include "core/math/hash.h"
#include "procedural/abi/ramp_table.h"

#include <algorithm>
#include <span>

namespace marram {
namespace {

constexpr double lump_cells_per_radius = 1.5; // cells of value noise: about the number of bulges on a side
constexpr uint32_t noise_bits = 24;           // of a lattice value: exact in a float and in a double

void put_box(EightBoxes& boxes, size_t lane, const Vec3d& lower, const Vec3d& upper) {
    const auto i = int(lane);
    boxes.lower.x[i] = lower.x(), boxes.lower.y[i] = lower.y(), boxes.lower.z[i] = lower.z();
    boxes.upper.x[i] = upper.x(), boxes.upper.y[i] = upper.y(), boxes.upper.z[i] = upper.z();
}

WideVector<EightBoxes> empty_nodes(size_t children) {
    const VDouble above = splat(infinity), below = splat(-infinity);
    return WideVector<EightBoxes>((children + lanes - 1) / lanes,
                                  {{above, above, above}, {below, below, below}});
}

double least(VDouble v) {
    double result = v[0];
    for (int i = 1; i < lanes; ++i) result = std::min(result, v[i]);
    return result;
}

} // namespace

void build_tree(GustField& field) {
    const std::vector<Influence>& influences = field.influences;
    if (influences.empty()) return;
    field.levels.push_back(empty_nodes(influences.size()));
    for (size_t i = 0; i < influences.size(); ++i)
        put_box(field.levels[0][i / lanes], i % lanes, influences[i].lower, influences[i].upper);
    while (field.levels.back().size() > 1) {
        const WideVector<EightBoxes>& below = field.levels.back();
        WideVector<EightBoxes> nodes = empty_nodes(below.size());
        for (size_t i = 0; i < below.size(); ++i) {
            const EightBoxes& b = below[i];
            put_box(nodes[i / lanes], i % lanes, {least(b.lower.x), least(b.lower.y), least(b.lower.z)},
                    {-least(-b.upper.x), -least(-b.upper.y), -least(-b.upper.z)});
        }
        field.levels.push_back(std::move(nodes));
    }
}

namespace {

// The influences below a node that overlap a box, in the tree's order.
void collect(const GustField& field, size_t level, size_t node, const Vec3d& lower, const Vec3d& upper,
             std::vector<const Influence*>& out) {
    const EightBoxes& b = field.levels[level][node];
    const VLong touches = (b.lower.x <= upper.x()) & (b.upper.x >= lower.x()) & (b.lower.y <= upper.y()) &
                          (b.upper.y >= lower.y()) & (b.lower.z <= upper.z()) & (b.upper.z >= lower.z());
    if (!any(touches)) return;
    for (int lane = 0; lane < lanes; ++lane) {
        if (!touches[lane]) continue;
        const size_t child = node * lanes + size_t(lane);
        if (level == 0)
            out.push_back(&field.influences[child]);
        else
            collect(field, level - 1, child, lower, upper, out);
    }
}

// ---- Evaluation ----

MARRAM_INLINE VDouble blend(VDouble t, VDouble a, VDouble b) { return a + t * (b - a); }

// nu of gusts.h, for |x| below 2^51.
MARRAM_INLINE VDouble value_noise(const Wide3d& x, uint32_t seed) {
    const VDouble coordinate[3] = {x.x, x.y, x.z};
    VInt cell[3];
    VDouble weight[3];
    for (int axis = 0; axis < 3; ++axis) {
        const VDouble f = coordinate[axis] - vfloor(coordinate[axis], cell[axis]);
        weight[axis] = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    }
    VDouble along_z[2];
    for (uint32_t k = 0; k < 2; ++k) {
        VDouble along_y[2];
        for (uint32_t j = 0; j < 2; ++j) {
            VDouble along_x[2];
            for (uint32_t i = 0; i < 2; ++i) {
                VUint h = mix32(bits_as<VUint>(cell[0]) + (seed + i));
                h = mix32(h + bits_as<VUint>(cell[1]) + j);
                h = mix32(h + bits_as<VUint>(cell[2]) + k);
                along_x[i] = to_double(bits_as<VInt>(h >> (32 - noise_bits))) * (1.0 / (1U << noise_bits));
            }
            along_y[j] = blend(weight[0], along_x[0], along_x[1]);
        }
        along_z[k] = blend(weight[1], along_y[0], along_y[1]);
    }
    return blend(weight[2], along_z[0], along_z[1]);
}

MARRAM_INLINE VDouble box_distance(const Influence& influence, const Wide3d& x) {
    const VDouble size[3] = {vabs(x.x), vabs(x.y), vabs(x.z)};
    VDouble t{};
    for (int axis = 0; axis < 3; ++axis) {
        const double inner = influence.inner[axis];
        const VDouble beyond = vmin((size[axis] - inner) / (1.0 - inner), 1.0);
        t = vmax(select(size[axis] <= inner, 0.0, beyond), t);
    }
    return t;
}

// I(P) of gusts.h. NaN (positions too far away for a double) counts as outside.
MARRAM_INLINE VDouble influence_at(const Influence& influence, const Wide3d& p) {
    const Wide3d d = p - splat3(influence.center.data());
    const Eigen::Matrix3d& m = influence.to_unit;
    const Wide3d x{d.x * m(0, 0) + d.y * m(0, 1) + d.z * m(0, 2),
                   d.x * m(1, 0) + d.y * m(1, 1) + d.z * m(1, 2),
                   d.x * m(2, 0) + d.y * m(2, 1) + d.z * m(2, 2)};
    VDouble t = influence.box ? box_distance(influence, x) : vsqrt(dot(x, x));
    if (!any(t < 1.0)) return VDouble{};
    if (influence.lumps > 0.0)
        t /= 1.0 - influence.lumps * value_noise(x * splat(lump_cells_per_radius), influence.lump_seed);
    return select(t < 1.0, evaluate(*influence.ramp, t) * influence.weight, 0.0);
}

MARRAM_HOT void add_influences(std::span<const Influence* const> influences, std::span<const Wide3f> rest,
                               VFloat* gust) {
    for (size_t k = 0; k < rest.size(); ++k) {
        const Wide3d p = to_double(rest[k]);
        VDouble sum{};
        for (const Influence* influence : influences) sum += influence_at(*influence, p);
        gust[k] += to_float(sum);
    }
}

MARRAM_HOT void bounds_of(std::span<const Wide3f> points, Wide3f& lower, Wide3f& upper) {
    lower = upper = points[0];
    for (const Wide3f& p : points) {
        lower.x = p.x < lower.x ? p.x : lower.x;
        lower.y = p.y < lower.y ? p.y : lower.y;
        lower.z = p.z < lower.z ? p.z : lower.z;
        upper.x = p.x > upper.x ? p.x : upper.x;
        upper.y = p.y > upper.y ? p.y : upper.y;
        upper.z = p.z > upper.z ? p.z : upper.z;
    }
}

} // namespace

size_t GustField::bytes() const {
    size_t sum = influences.capacity() * sizeof(Influence);
    for (const auto& level : levels) sum += level.capacity() * sizeof(EightBoxes);
    return sum;
}

size_t add_gusts(const GustField& field, Strands& strands) {
    if (field.levels.empty() || strands.rest.empty()) return 0;
    Wide3f lower, upper;
    bounds_of(strands.rest, lower, upper);
    const auto low = [](VFloat v) { return least(to_double(v)); };
    const auto high = [](VFloat v) { return -least(-to_double(v)); };
    std::vector<const Influence*> touching;
    collect(field, field.levels.size() - 1, 0, {low(lower.x), low(lower.y), low(lower.z)},
            {high(upper.x), high(upper.y), high(upper.z)}, touching);
    if (!touching.empty()) add_influences(touching, strands.rest, strands.gust.data());
    return touching.size();
}

} // namespace marram
