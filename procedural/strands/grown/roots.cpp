// SPDX-License-Identifier: Apache-2.0
// Poisson disc sampling of roots on a triangle mesh: parallel and deterministic.
//
// Candidates are sampled uniformly on each triangle; each has a priority from a hash. A candidate is kept if
// no kept candidate of higher priority is within the radius r: the result of dart throwing in the order of
// priority. The rule depends only on nearby candidates, so it is evaluated in rounds, by any number of
// threads in any order: a candidate with the highest priority among its undecided neighbours is kept, one
// next to a kept candidate of higher priority is dropped, and all others wait.
//
// The number of candidates for a density d follows from the kinetics of random sequential adsorption of
// discs: with coverage c = (number per unit area) * pi r^2 / 4 and attempts t in the same unit,
//     dc/dt = phi(c),   phi(c) = 1 - 4 c + 6 sqrt(3)/pi c^2 + (40/(sqrt(3) pi) - 176/(3 pi^2)) c^3 + O(c^4)
// (P. Schaaf and J. Talbot, "Surface exclusion effects in adsorption processes", J. Chem. Phys. 91, 1989),
// accurate to 1 % up to the coverage used here. So a density needs only one pass, and other parts of the mesh
// have no influence. A count samples more candidates and keeps the highest priorities, which equals stopping
// the throws at that number.
//
// Neighbours: candidates are sorted by grid cell, row by row along x. Cells are r/2 long in x and 2r wide in
// y and z. So neighbours within r lie in the candidate's row and in the three rows adjoining its half of the
// cell, in runs of five cells. The runs advance along the array together with the candidate.
#include "procedural/strands/grown/roots.h"

#include "procedural/abi/parallel.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

namespace marram {
namespace {

// Minimum distance at spacing 1, times the square root of the density. Larger values need many more attempts
// per root: 1.7 here, 2.4 at 0.6, 9 at 0.7.
constexpr double full_distance = 0.5;
constexpr double full_coverage = full_distance * full_distance * pi / 4.0;

// Attempts per kept disc up to coverage c: the integral of dc / phi(c), divided by c.
double attempts_per_disc(double coverage) {
    if (coverage <= 0.0) return 1.0;
    constexpr int steps = 256;
    constexpr double b2 = 3.30797, b3 = 1.40688;
    double attempts = 0.0;
    for (int i = 0; i < steps; ++i) {
        const double c = coverage * (i + 0.5) / steps;
        attempts += 1.0 / (1.0 - 4.0 * c + b2 * c * c + b3 * c * c * c);
    }
    return attempts / steps;
}

// A cell's key holds its indices z, y and x, from the most to the least significant bits.
constexpr int x_bits = 23, row_bits = 20;
constexpr double x_unit = 0.5, row_unit = 2.0; // size of a cell along x, and along y and z, in units of r
constexpr double max_rows = double((1U << row_bits) - 4); // along y and z; x has the bits for as much
constexpr int in_cell_steps = 1023;                       // positions within a cell have 10 bits per axis

struct [[gnu::packed]] Candidate { // packed, because there are millions for a moment
    uint64_t cell;
    Root root;
    uint32_t in_cell;
};
static_assert(sizeof(Candidate) == 20);

bool in_order(const Candidate& a, const Candidate& b) {
    if (a.cell != b.cell) return a.cell < b.cell;
    if (a.root.triangle != b.root.triangle) return a.root.triangle < b.root.triangle;
    return a.root.index < b.root.index;
}

// Sorts by in_order with an in-place radix sort: distributes candidates into buckets of cells and recurses
// (P. McIlroy, K. Bostic, M. McIlroy, "Engineering Radix Sort", Computing Systems 6, 1993). Takes about half
// the time of a comparison sort. In place, because a second list would set the peak memory of root placement.
void sort_by_cell(std::span<Candidate> list) {
    constexpr size_t few = 32, many = 16384; // few: comparison sort; many: buckets in parallel
    uint64_t least = ~uint64_t{0}, most = 0;
    for (const Candidate& c : list) {
        least = std::min<uint64_t>(least, c.cell);
        most = std::max<uint64_t>(most, c.cell);
    }
    if (list.size() <= few || least == most) return std::sort(list.begin(), list.end(), in_order);
    const int bits = std::min(int(std::bit_width(list.size())), 12);
    const int shift = std::max(int(std::bit_width(most - least)) - bits, 0);
    const auto bucket = [&](const Candidate& c) { return size_t((c.cell - least) >> shift); };
    std::vector<size_t> begin((size_t(1) << bits) + 1, 0);
    for (const Candidate& c : list) ++begin[bucket(c) + 1];
    for (size_t b = 1; b < begin.size(); ++b) begin[b] += begin[b - 1];
    std::vector<size_t> next(begin.begin(), begin.end() - 1); // where a bucket's next candidate goes
    for (size_t b = 0; b < next.size(); ++b)
        while (next[b] < begin[b + 1]) {
            Candidate moved = list[next[b]];
            for (size_t to = bucket(moved); to != b; to = bucket(moved)) std::swap(moved, list[next[to]++]);
            list[next[b]++] = moved;
        }
    const auto sort_bucket = [&](size_t b) {
        const size_t count = begin[b + 1] - begin[b];
        if (count > 1) sort_by_cell(list.subspan(begin[b], count));
    };
    if (list.size() > many)
        marram::parallel_for(size_t{0}, next.size(), sort_bucket);
    else
        for (size_t b = 0; b < next.size(); ++b) sort_bucket(b);
}

// Lower numbers have higher priority. Equal 64-bit hashes are very unlikely, but both candidates would wait
// for each other; the order of the list decides between them.
uint64_t priority(uint32_t seed, Root root) { return root_hash(seed, root, Purpose::priority); }

struct DiscGrid {
    Vec3d origin;
    double unit = 1.0; // metres, >= radius

    Candidate candidate(Root root, const Vec3d& p) const {
        uint64_t key = 0;
        uint32_t in_cell = 0;
        for (int axis = 2; axis >= 0; --axis) {
            // A border of four cells keeps neighbours' keys from wrapping.
            const double x = (p[axis] - origin[axis]) / (unit * (axis == 0 ? x_unit : row_unit)) + 4.0;
            const double whole = std::floor(x);
            key = (key << (axis == 0 ? x_bits : row_bits)) | uint64_t(whole);
            in_cell = (in_cell << 10) | uint32_t((x - whole) * in_cell_steps);
        }
        return {key, root, in_cell};
    }
};

// A candidate's position in integer steps of x_unit / 1023; exact.
struct Place3 {
    int64_t x, y, z;
    static constexpr int64_t row_step = int64_t(row_unit / x_unit);

    explicit Place3(const Candidate& c)
        : x(axis(c.cell & ((1U << x_bits) - 1), c.in_cell)),
          y(axis((c.cell >> x_bits) & ((1U << row_bits) - 1), c.in_cell >> 10) * row_step),
          z(axis(c.cell >> (x_bits + row_bits), c.in_cell >> 20) * row_step) {}
    static int64_t axis(uint64_t cell, uint32_t in_cell) {
        return int64_t(cell) * in_cell_steps + int64_t(in_cell & 1023U);
    }
    int64_t squared_distance(const Place3& b) const {
        return (x - b.x) * (x - b.x) + (y - b.y) * (y - b.y) + (z - b.z) * (z - b.z);
    }
};

// The density masks over a surface, relative to `full`. A count depends only on the ratios of mask values, so
// faint masks need no more candidates than strong ones.
struct DensityMask {
    const Groom& groom;
    const Surface& bind;
    double full = 1.0;

    bool masked() const { return groom.density_masks.any(); }
    double at(Root root) const {
        const Vec3d weights = root_weights(groom.seed, root);
        return at(root.triangle, weights);
    }
    double at(uint32_t triangle, const Vec3d& weights) const {
        const double share = groom.density_masks(bind, triangle, weights);
        return std::min(share / full, 1.0);
    }
    bool keeps(Root root) const { return unit_double(root_hash(groom.seed, root, Purpose::mask)) < at(root); }
};

// Greatest value of a ramp over an interval: between two ramp points it is monotone.
double greatest(const Ramp& ramp, double low, double high) {
    double most = std::max(ramp(low), ramp(high));
    for (size_t i = 0; i < ramp.positions().size(); ++i)
        if (ramp.positions()[i] > low && ramp.positions()[i] < high) most = std::max(most, ramp.values()[i]);
    return most;
}

// False if the masks are 0 on the whole triangle, so that no candidates are sampled there.
bool may_grow(const DensityMask& mask, uint32_t triangle) {
    const Masks& masks = mask.groom.density_masks;
    const auto p = mask.bind.corners(triangle);
    if (masks.image && masks.image->high() <= 0.0) return false;
    if (masks.by_slope) {
        const Vec3d n = plane_normal(p);
        if ((*masks.by_slope)(std::atan2(std::hypot(n.x(), n.z()), n.y()) / degree) <= 0.0) return false;
    }
    if (masks.by_height) {
        const double low = std::min({p[0].y(), p[1].y(), p[2].y()}),
                     high = std::max({p[0].y(), p[1].y(), p[2].y()});
        if (greatest(*masks.by_height, low, high) <= 0.0) return false;
    }
    for (const Factor& factor : masks.factors) {
        const auto [low, high] = factor.input_range(mask.bind, triangle);
        if (greatest(factor.ramp, low, high) <= 0.0) return false;
    }
    return true;
}

// Mean and greatest mask value over the surface, sampled densely enough to resolve a thousandth of the area.
struct MaskStatistics {
    double mean = 1.0, most = 1.0;
};

MaskStatistics mask_statistics(const DensityMask& mask, double area) {
    if (!mask.masked()) return {};
    constexpr uint32_t points = 1U << 18;
    double sum = 0.0, most = 0.0, passed = 0.0;
    uint32_t sample_count = 0; // one point per area / points, in the order of the triangles
    for (uint32_t t = 0; t < mask.bind.triangle_count; ++t) {
        passed += mask.bind.area(t);
        for (uint32_t i = 0; sample_count < points && (sample_count + 0.5) * area < passed * points;
             ++sample_count, ++i) {
            const double share = mask.at(t, root_weights(~mask.groom.seed, {t, i}));
            sum += share;
            most = std::max(most, share);
        }
    }
    return {sum / points, most};
}

// A Poisson distributed number with mean m from a triangle's hash. It is monotone in m, so a change of
// density does not renumber candidates. Small means invert the distribution, large ones use its normal limit
// (error of the probabilities below 1e-2 at m = 64, which is invisible in a count).
uint64_t poisson(double mean, uint64_t h) {
    const double u = (double(h >> 11) + 0.5) * 0x1p-53;
    if (mean > 64.0) {
        const double v = unit_double(mix64(h + 1));
        const double z = std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * pi * v);
        return uint64_t(std::max(0.0, std::floor(mean + z * std::sqrt(mean) + 0.5)));
    }
    double term = std::exp(-mean), sum = term;
    uint64_t count = 0;
    while (u > sum && term > 0.0) {
        ++count;
        term *= mean / double(count);
        sum += term;
    }
    return count;
}

// First candidate number of every triangle. The kinetics assume independent candidates, so their number is
// Poisson distributed on each triangle. Random roots (spacing 0) are all kept and are spread more evenly:
// area * candidate_density, rounded up or down by the triangle's hash.
std::vector<uint64_t> candidate_offsets(const DensityMask& mask, double candidate_density, bool spaced) {
    const Surface& bind = mask.bind;
    std::vector<uint64_t> first(size_t(bind.triangle_count) + 1, 0);
    marram::parallel_for(tbb::blocked_range<uint32_t>(0, bind.triangle_count, 4096), [&](const auto& range) {
        for (uint32_t t = range.begin(); t < range.end(); ++t) {
            const double mean = mask.masked() && !may_grow(mask, t) ? 0.0 : bind.area(t) * candidate_density;
            const uint64_t h = hash(hash(mask.groom.seed, 0x7472'6961), t);
            first[size_t(t) + 1] = spaced ? poisson(mean, h) : uint64_t(std::floor(mean + unit_double(h)));
        }
    });
    for (size_t t = 0; t < bind.triangle_count; ++t) first[t + 1] += first[t];
    return first;
}

DiscGrid grid_of(const Surface& bind, double radius) {
    Vec3d lower = Vec3d::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
    for (uint32_t t = 0; t < bind.triangle_count; ++t)
        for (const Vec3d& p : bind.corners(t)) {
            lower = lower.cwiseMin(p);
            upper = upper.cwiseMax(p);
        }
    const double extent = (upper - lower).maxCoeff();
    return {lower, std::max({radius, extent / (row_unit * max_rows), std::numeric_limits<double>::min()})};
}

// Candidates of all triangles, sorted. Candidates with mask value 0 are skipped: blocks are counted first and
// then filled, so that skipped ones take no memory.
std::vector<Candidate> draw_candidates(const DensityMask& mask, const DiscGrid& grid,
                                       double candidate_density, bool spaced,
                                       const std::function<bool()>& cancelled) {
    const std::vector<uint64_t> first = candidate_offsets(mask, candidate_density, spaced);
    constexpr uint64_t block_size = 16384;
    const uint64_t blocks = (first.back() + block_size - 1) / block_size;
    // Calls body(root) for every candidate of a block that the masks do not exclude.
    const auto visit = [&](uint64_t block, auto&& body) {
        const uint64_t begin = block * block_size, end = std::min(begin + block_size, first.back());
        auto t = uint32_t(std::upper_bound(first.begin(), first.end(), begin) - first.begin() - 1);
        for (uint64_t i = begin; i < end; ++i) {
            while (i >= first[size_t(t) + 1]) ++t;
            const Root root{t, uint32_t(i - first[t])};
            if (!mask.masked() || mask.at(root) > 0.0) body(root);
        }
    };
    std::vector<uint64_t> start(blocks + 1, 0);
    marram::parallel_for(uint64_t{0}, blocks, [&](uint64_t block) {
        if (cancelled()) return;
        uint64_t count = std::min(block_size, first.back() - block * block_size);
        if (mask.masked()) {
            count = 0;
            visit(block, [&](Root) { ++count; });
        }
        start[block + 1] = count;
    });
    for (uint64_t block = 0; block < blocks; ++block) start[block + 1] += start[block];
    if (cancelled()) return {};
    std::vector<Candidate> candidates(start.back());
    marram::parallel_for(uint64_t{0}, blocks, [&](uint64_t block) {
        if (cancelled()) return;
        uint64_t at = start[block];
        visit(block, [&](Root root) {
            candidates[at++] =
                grid.candidate(root, mask.bind.point(root.triangle, root_weights(mask.groom.seed, root)));
        });
    });
    if (cancelled()) return {};
    sort_by_cell(candidates);
    return candidates;
}

enum : uint8_t { undecided, kept, dropped };

// The runs of candidates around a candidate, one in each of the nine rows around it, advanced together with
// it. A visit needs four of them; the others catch up on demand.
class NeighbourRuns {
  public:
    NeighbourRuns(const std::vector<Candidate>& all, uint64_t from) : all_(all) {
        for (int row = 0; row < 9; ++row) {
            const uint64_t low = all[from].cell + shift(row % 3 - 1, row / 3 - 1) - reach;
            at_[row] =
                size_t(std::lower_bound(all.begin(), all.end(), low,
                                        [](const Candidate& c, uint64_t key) { return c.cell < key; }) -
                       all.begin());
        }
    }
    // Calls visit(j) for every candidate that may be within r of i until it returns false.
    template <typename Visit>
    void visit(size_t i, Visit&& visit) {
        const uint64_t centre = all_[i].cell;
        const int side_y = ((all_[i].in_cell >> 10) & 1023U) > in_cell_steps / 2 ? 1 : -1;
        const int side_z = ((all_[i].in_cell >> 20) & 1023U) > in_cell_steps / 2 ? 1 : -1;
        for (int corner = 0; corner < 4; ++corner) {
            const int dy = corner & 1 ? side_y : 0, dz = corner & 2 ? side_z : 0;
            const uint64_t low = centre + shift(dy, dz) - reach, high = low + 2 * reach;
            size_t& at = at_[(dy + 1) + 3 * (dz + 1)];
            while (at < all_.size() && all_[at].cell < low) ++at;
            for (size_t j = at; j < all_.size() && all_[j].cell <= high; ++j)
                if (j != i && !visit(j)) return;
        }
    }

  private:
    static constexpr uint64_t reach = uint64_t(1.0 / x_unit); // cells along the row
    static uint64_t shift(int64_t dy, int64_t dz) {
        return uint64_t(dz * (int64_t(1) << (x_bits + row_bits)) + dy * (int64_t(1) << x_bits));
    }
    const std::vector<Candidate>& all_;
    size_t at_[9];
};

// One round over a range: decides the candidates that can be decided, and returns whether some are left. The
// states of other threads may be read before or after they change; the result is the same, because a state
// changes only once.
bool decide(const std::vector<Candidate>& all, std::vector<std::atomic<uint8_t>>& state, uint32_t seed,
            int64_t squared_radius, size_t begin, size_t end) {
    bool waiting = false;
    NeighbourRuns runs(all, begin);
    for (size_t i = begin; i < end; ++i) {
        if (state[i].load(std::memory_order_relaxed) != undecided) continue;
        uint8_t verdict = kept;
        const Place3 place(all[i]);
        const uint64_t mine = priority(seed, all[i].root);
        runs.visit(i, [&](size_t j) {
            const uint8_t other = state[j].load(std::memory_order_relaxed);
            if (other == dropped || place.squared_distance(Place3(all[j])) >= squared_radius) return true;
            if (other == undecided) { // a kept one has higher priority
                const uint64_t theirs = priority(seed, all[j].root);
                if (theirs > mine || (theirs == mine && j > i)) return true;
            }
            verdict = other == kept ? dropped : undecided;
            return verdict != dropped;
        });
        if (verdict == undecided)
            waiting = true;
        else
            state[i].store(verdict, std::memory_order_relaxed);
    }
    return waiting;
}

void keep_spaced(std::vector<Candidate>& candidates, uint32_t seed, double radius_in_units,
                 const std::function<bool()>& cancelled) {
    std::vector<std::atomic<uint8_t>> state(candidates.size());
    const double radius = radius_in_units * in_cell_steps / x_unit;
    const auto squared_radius = int64_t(radius * radius);
    const tbb::blocked_range<size_t> all(0, candidates.size(), 8192);
    bool waiting = !candidates.empty();
    while (waiting && !cancelled())
        waiting = marram::parallel_reduce(
            all, false,
            [&](const auto& range, bool any) {
                return decide(candidates, state, seed, squared_radius, range.begin(), range.end()) || any;
            },
            std::logical_or<>());
    size_t count = 0;
    for (size_t i = 0; i < candidates.size(); ++i)
        if (state[i].load(std::memory_order_relaxed) == kept) candidates[count++] = candidates[i];
    candidates.resize(count);
}

// Keeps the `count` candidates of highest priority, in their order. The hash is uniform, so a histogram of
// its top bits finds the limit; only the bucket that contains the limit is sorted.
void keep_highest_priority(std::vector<Candidate>& candidates, uint32_t seed, uint64_t count) {
    constexpr int bucket_bits = 16;
    std::vector<uint64_t> histogram(size_t(1) << bucket_bits, 0);
    const auto bucket = [&](const Candidate& c) { return priority(seed, c.root) >> (64 - bucket_bits); };
    for (const Candidate& c : candidates) ++histogram[bucket(c)];
    uint64_t before = 0, limit = 0;
    while (before + histogram[limit] < count) before += histogram[limit++];
    std::vector<uint64_t> at_limit;
    for (const Candidate& c : candidates)
        if (bucket(c) == limit) at_limit.push_back(priority(seed, c.root));
    std::ranges::sort(at_limit);
    const uint64_t last = at_limit[count - before - 1];
    std::erase_if(candidates, [&](const Candidate& c) { return priority(seed, c.root) > last; });
    candidates.resize(
        std::min<size_t>(candidates.size(), count)); // equal priorities: the list's order decides
}

uint64_t spread_bits(uint64_t x) { // inserts two zeros above each of 21 bits
    x = (x | (x << 32)) & 0x1f00000000ffffULL;
    x = (x | (x << 16)) & 0x1f0000ff0000ffULL;
    x = (x | (x << 8)) & 0x100f00f00f00f00fULL;
    x = (x | (x << 4)) & 0x10c30c30c30c30c3ULL;
    return (x | (x << 2)) & 0x1249249249249249ULL;
}

// Roots in Morton order of the grid's cells: neighbours in the list are close in space.
std::vector<Root> in_space_order(std::vector<Candidate>& candidates) {
    marram::parallel_for(tbb::blocked_range<size_t>(0, candidates.size(), 16384), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const uint64_t cell = candidates[i].cell;
            const uint64_t x = (cell & ((1U << x_bits) - 1)) / 4,
                           y = (cell >> x_bits) & ((1U << row_bits) - 1);
            candidates[i].cell =
                spread_bits(x) | (spread_bits(y) << 1) | (spread_bits(cell >> (x_bits + row_bits)) << 2);
        }
    });
    sort_by_cell(candidates);
    std::vector<Root> roots(candidates.size());
    for (size_t i = 0; i < roots.size(); ++i) roots[i] = candidates[i].root;
    return roots;
}

double surface_area(const Surface& bind) {
    double area = 0.0; // summed in order: the same at any thread count
    for (uint32_t t = 0; t < bind.triangle_count; ++t) area += bind.area(t);
    return area;
}

std::vector<Candidate> spaced_candidates(const DensityMask& mask, double density, double oversampling,
                                         double spacing, const std::function<bool()>& cancelled,
                                         PlacedRoots& placed) {
    const double coverage = full_coverage * spacing * spacing;
    const double radius = 2.0 * std::sqrt(coverage / (pi * density));
    const DiscGrid grid = grid_of(mask.bind, radius);
    std::vector<Candidate> candidates = draw_candidates(
        mask, grid, density * attempts_per_disc(coverage) * oversampling, radius > 0.0, cancelled);
    placed.peak_bytes = std::max(placed.peak_bytes, candidates.capacity() * (sizeof(Candidate) + 1));
    if (radius > 0.0) keep_spaced(candidates, mask.groom.seed, radius / grid.unit, cancelled);
    // Masks thin the roots after spacing: a mask of 0.5 keeps half the strands, and a strand does not depend
    // on masks elsewhere.
    if (mask.masked()) std::erase_if(candidates, [&](const Candidate& c) { return !mask.keeps(c.root); });
    return candidates;
}

// Candidates for a count. Starts with as many as the masks' mean suggests, and increases them until enough
// are left.
std::vector<Candidate> counted_candidates(DensityMask mask, double area,
                                          const std::function<bool()>& cancelled, PlacedRoots& placed) {
    const Groom& groom = mask.groom;
    const auto refuse = [&] {
        throw SceneFault("groom.masks_too_small", groom.count_place,
                         "the density masks leave no room for " + std::to_string(groom.count) + " strands",
                         "raise the masks or lower count");
    };
    const MaskStatistics statistics = mask_statistics(mask, area);
    if (statistics.most > 0.0) mask.full = statistics.most;
    if (!(statistics.mean > 0.0)) { // the samples may have missed a few triangles
        bool any = false;
        for (uint32_t t = 0; t < mask.bind.triangle_count && !any; ++t) any = may_grow(mask, t);
        if (!any) refuse();
    }
    const double mean = statistics.mean > 0.0 ? statistics.mean / mask.full : 1e-3;
    const double first = double(groom.count) / (area * mean);
    double density = first, spacing = groom.spacing;
    const double oversampling =
        1.1 + 8.0 / std::sqrt(double(groom.count)); // eight standard deviations of a random count
    constexpr int tries = 24;
    for (int i = 0; i < tries && !cancelled(); ++i) {
        std::vector<Candidate> candidates =
            spaced_candidates(mask, density, oversampling, spacing, cancelled, placed);
        if (candidates.size() >= groom.count) {
            keep_highest_priority(candidates, groom.seed, groom.count);
            return candidates;
        }
        // Too few. With masks, the mean was too high; without masks, the count is small or thin parts have
        // their two sides within r of each other.
        const double share = double(candidates.size()) / double(groom.count), densest = 1e3 * first;
        if (mask.masked() && density >= densest) break; // would give the same candidates again
        if (mask.masked())
            density = std::min(density * std::clamp(1.1 / share, 1.2, 10.0), densest);
        else
            spacing = i > 8 ? 0.0 : spacing * 0.85;
    }
    if (!cancelled()) refuse();
    return {};
}

} // namespace

PlacedRoots place_roots(const Groom& groom, const Surface& bind, const std::function<bool()>& cancelled) {
    const double area = surface_area(bind);
    if (!(area > 0.0))
        throw SceneFault("groom.no_area", groom.mesh_place, "the mesh '" + groom.mesh + "' has no area",
                         "strands need a surface to grow on");
    PlacedRoots placed;
    std::vector<Candidate> candidates;
    const DensityMask mask{groom, bind};
    if (groom.count > 0) {
        candidates = counted_candidates(mask, area, cancelled, placed);
    } else if (groom.density > 0.0) {
        if (groom.density * area > 4e8)
            throw SceneFault("groom.too_many", groom.count_place,
                             fmt::format("density asks for {:.3g} strands", groom.density * area),
                             "more than 4e8 do not fit, ask for fewer a square metre");
        candidates = spaced_candidates(mask, groom.density, 1.0, groom.spacing, cancelled, placed);
    }
    placed.roots = in_space_order(candidates);
    return placed;
}

} // namespace marram
