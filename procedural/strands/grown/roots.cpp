// SPDX-License-Identifier: Apache-2.0
// Poisson disc sampling of roots on a triangle mesh: parallel and deterministic.
//
// Candidates are sampled uniformly on each triangle; each has a priority from a hash. A candidate is kept if
// no kept candidate of higher priority is within the radius r: the result of dart throwing in the order of
// priority. The rule depends only on nearby candidates, so it is evaluated in rounds, by any number of
// threads in any order: a candidate with the highest priority among its undecided neighbours is kept, one
// next to a kept candidate of higher priority is dropped, and all others wait.
//
// The number of candidates for a density follows from the kinetics of random sequential adsorption
// (adsorption.h). So a density needs only one pass, and other parts of the mesh have no influence. A count
// samples more candidates and keeps the highest priorities, which equals stopping the throws at that number.
//
// Neighbours: candidates are sorted by grid cell, row by row along x. Cells are r/2 long in x and 2r wide in
// y and z. So neighbours within r lie in the candidate's row and in the three rows adjoining its half of the
// cell, in runs of five cells. The runs advance along the array together with the candidate.
#include "procedural/strands/grown/roots.h"

#include "procedural/abi/parallel.h"
#include "procedural/strands/grown/adsorption.h"
#include "procedural/strands/grown/density_mask.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <bitset>
#include <cmath>
#include <limits>
#include <numeric>

namespace marram {
namespace {

// Minimum distance at spacing 1, times the square root of the density. Larger values need many more attempts
// per root: 1.7 here, 2.4 at 0.6, 9 at 0.7.
constexpr double full_distance = 0.5;
constexpr double full_coverage = full_distance * full_distance * pi / 4.0;

// A cell's key holds its indices z, y and x, from the most significant bits on.
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
//
// With a level of detail, candidates of a triangle are thrown in the order of their numbers, each triangle's
// at an even rate. So the first of them are found without a look at the others, and are spread more evenly.
struct Priority {
    uint32_t seed = 0;
    const std::vector<uint64_t>* first = nullptr; // [triangle + 1], of all candidates: with a level of detail

    uint64_t operator()(Root root) const {
        const uint64_t h = root_hash(seed, root, Purpose::priority);
        if (!first) return h;
        const auto count = double((*first)[size_t(root.triangle) + 1] - (*first)[root.triangle]);
        return share_of_all((double(root.index) + unit_double(h)) / count);
    }
    // The priority up to which a share of all candidates is thrown.
    static uint64_t share_of_all(double share) {
        const double scaled = std::ldexp(share, 64);
        return scaled < 0x1p64 ? uint64_t(scaled) : std::numeric_limits<uint64_t>::max();
    }
};

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

// Candidates of all triangles, sorted: those that are wanted, all if that is empty. They are counted first and
// then filled in, so that others take a bit of memory.
std::vector<Candidate> draw_candidates(const DensityMask& mask, const DiscGrid& grid,
                                       const std::vector<uint64_t>& first,
                                       const std::function<bool(Root)>& is_wanted,
                                       const std::function<bool()>& cancelled) {
    constexpr uint64_t block_size = 16384;
    const uint64_t blocks = (first.back() + block_size - 1) / block_size;
    // Calls body(root, number in the block) for every candidate of a block.
    const auto visit = [&](uint64_t block, auto&& body) {
        const uint64_t begin = block * block_size, end = std::min(begin + block_size, first.back());
        auto t = uint32_t(std::upper_bound(first.begin(), first.end(), begin) - first.begin() - 1);
        for (uint64_t i = begin; i < end; ++i) {
            while (i >= first[size_t(t) + 1]) ++t;
            body(Root{t, uint32_t(i - first[t])}, i - begin);
        }
    };
    std::vector<uint64_t> start(blocks + 1, 0);
    std::vector<std::bitset<block_size>> wanted(is_wanted ? blocks : 0);
    marram::parallel_for(uint64_t{0}, blocks, [&](uint64_t block) {
        if (cancelled()) return;
        uint64_t count = std::min(block_size, first.back() - block * block_size);
        if (is_wanted) {
            visit(block, [&](Root root, uint64_t i) { wanted[block][i] = is_wanted(root); });
            count = wanted[block].count();
        }
        start[block + 1] = count;
    });
    for (uint64_t block = 0; block < blocks; ++block) start[block + 1] += start[block];
    if (cancelled()) return {};
    std::vector<Candidate> candidates(start.back());
    marram::parallel_for(uint64_t{0}, blocks, [&](uint64_t block) {
        if (cancelled()) return;
        uint64_t at = start[block];
        visit(block, [&](Root root, uint64_t i) {
            if (is_wanted && !wanted[block][i]) return;
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
bool decide(const std::vector<Candidate>& all, std::vector<std::atomic<uint8_t>>& state,
            const Priority& priority, int64_t squared_radius, size_t begin, size_t end) {
    bool waiting = false;
    NeighbourRuns runs(all, begin);
    for (size_t i = begin; i < end; ++i) {
        if (state[i].load(std::memory_order_relaxed) != undecided) continue;
        uint8_t verdict = kept;
        const Place3 place(all[i]);
        const uint64_t mine = priority(all[i].root);
        runs.visit(i, [&](size_t j) {
            const uint8_t other = state[j].load(std::memory_order_relaxed);
            if (other == dropped || place.squared_distance(Place3(all[j])) >= squared_radius) return true;
            if (other == undecided) { // a kept one has higher priority
                const uint64_t theirs = priority(all[j].root);
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

void keep_spaced(std::vector<Candidate>& candidates, const Priority& priority, double radius_in_units,
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
                return decide(candidates, state, priority, squared_radius, range.begin(), range.end()) || any;
            },
            std::logical_or<>());
    size_t count = 0;
    for (size_t i = 0; i < candidates.size(); ++i)
        if (state[i].load(std::memory_order_relaxed) == kept) candidates[count++] = candidates[i];
    candidates.resize(count);
}

// Keeps the `count` candidates of highest priority, in their order. The hash is uniform, so a histogram of
// its top bits finds the limit; only the bucket that contains the limit is sorted.
void keep_highest_priority(std::vector<Candidate>& candidates, const Priority& priority, uint64_t count) {
    constexpr int bucket_bits = 16;
    std::vector<uint64_t> histogram(size_t(1) << bucket_bits, 0);
    const auto bucket = [&](const Candidate& c) { return priority(c.root) >> (64 - bucket_bits); };
    for (const Candidate& c : candidates) ++histogram[bucket(c)];
    uint64_t before = 0, limit = 0;
    while (before + histogram[limit] < count) before += histogram[limit++];
    std::vector<uint64_t> at_limit;
    for (const Candidate& c : candidates)
        if (bucket(c) == limit) at_limit.push_back(priority(c.root));
    std::ranges::sort(at_limit);
    const uint64_t last = at_limit[count - before - 1];
    std::erase_if(candidates, [&](const Candidate& c) { return priority(c.root) > last; });
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

// asks: what asks for the strands.
void check_count(const Groom& groom, double count, const char* asks, const char* remedy) {
    if (count > 4e8)
        throw SceneFault("groom.too_many", groom.count_place,
                         fmt::format("{} asks for {:.3g} strands", asks, count),
                         std::string("more than 4e8 do not fit: ") + remedy);
}

constexpr const char* fewer = "ask for fewer, or where most are far away add lod = true";

double surface_area(const Surface& bind) {
    double area = 0.0; // summed in order: the same at any thread count
    for (uint32_t t = 0; t < bind.triangle_count; ++t) area += bind.area(t);
    return area;
}

double coverage_of(double spacing) { return full_coverage * spacing * spacing; }

std::vector<float> ranks_of(std::span<const Root> roots, const Priority& priority, double coverage) {
    const KeptByAttempts order(coverage);
    std::vector<float> ranks(roots.size());
    marram::parallel_for(tbb::blocked_range<size_t>(0, roots.size(), 16384), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i)
            ranks[i] = std::min(float(order.kept(std::ldexp(double(priority(roots[i])), -64))),
                                1.0F - 0x1p-24F); // below 1, the share of all
    });
    return ranks;
}

// How many candidates of each triangle are thrown first, as those of `first`: enough for a share of the roots,
// with the exact limits of their priorities. Whether a candidate is kept depends on those of higher priority
// around it, theirs on others: a chain of these that is 16 radii long is met once in 10^11 roots.
struct FirstThrows {
    std::vector<uint64_t> offsets; // [triangle + 1]
    std::vector<uint64_t> limits;  // [triangle]
};

FirstThrows first_throws(const DensityMask& mask, const std::vector<uint64_t>& first, double density,
                         double radius, double coverage, const ShareAround& share) {
    const KeptByAttempts order(coverage);
    const uint32_t count = mask.bind.triangle_count;
    FirstThrows throws{std::vector<uint64_t>(size_t(count) + 1), std::vector<uint64_t>(count)};
    std::vector<double> wanted(count); // roots
    marram::parallel_for(tbb::blocked_range<uint32_t>(0, count, 4096), [&](const auto& range) {
        for (uint32_t t = range.begin(); t < range.end(); ++t) {
            const uint64_t all = first[size_t(t) + 1] - first[t];
            if (all == 0) continue;
            const double of_triangle = share(t, 16.0 * radius), attempts = order.attempts(of_triangle);
            throws.limits[t] = Priority::share_of_all(attempts);
            throws.offsets[size_t(t) + 1] = std::min(uint64_t(attempts * double(all)) + 1, all);
            wanted[t] = of_triangle * density * mask.bind.area(t);
        }
    });
    for (size_t t = 0; t < count; ++t) throws.offsets[t + 1] += throws.offsets[t];
    check_count(mask.groom, std::accumulate(wanted.begin(), wanted.end(), 0.0), "the level of detail",
                "ask for fewer, or raise tolerance_pixels");
    return throws;
}

std::vector<Candidate> spaced_candidates(const DensityMask& mask, double density, double oversampling,
                                         double spacing, const ShareAround& share,
                                         const std::function<bool()>& cancelled, PlacedRoots& placed) {
    const double coverage = coverage_of(spacing);
    const double radius = 2.0 * std::sqrt(coverage / (pi * density));
    const DiscGrid grid = grid_of(mask.bind, radius);
    const std::vector<uint64_t> first =
        candidate_offsets(mask, density * attempts_per_disc(coverage) * oversampling, radius > 0.0);
    Priority priority{mask.groom.seed};
    FirstThrows throws;
    if (share) {
        priority.first = &first;
        throws = first_throws(mask, first, density, radius, coverage, share);
    }
    // Masks thin the roots after spacing: a mask of 0.5 keeps half the strands, and a strand does not depend
    // on masks elsewhere.
    const bool spaced = radius > 0.0;
    std::function<bool(Root)> is_wanted;
    if (share || mask.masked())
        is_wanted = [&](Root root) {
            if (share && priority(root) > throws.limits[root.triangle]) return false;
            return !mask.masked() || (spaced ? mask.at(root) > 0.0 : mask.keeps(root));
        };
    std::vector<Candidate> candidates =
        draw_candidates(mask, grid, share ? throws.offsets : first, is_wanted, cancelled);
    placed.peak_bytes = std::max(placed.peak_bytes, candidates.capacity() * (sizeof(Candidate) + 1));
    if (spaced) {
        keep_spaced(candidates, priority, radius / grid.unit, cancelled);
        if (mask.masked()) std::erase_if(candidates, [&](const Candidate& c) { return !mask.keeps(c.root); });
    }
    if (share) {
        placed.roots = in_space_order(candidates);
        placed.ranks = ranks_of(placed.roots, priority, coverage);
    }
    return candidates;
}

[[noreturn]] void refuse_masks(const Groom& groom) {
    throw SceneFault("groom.masks_too_small", groom.count_place,
                     "the density masks leave no room for " + std::to_string(groom.count) + " strands",
                     "raise the masks or lower count");
}

// The density that a count asks for, where the masks are `mask.full`, which it sets.
double density_for_count(DensityMask& mask, double area) {
    const MaskStatistics statistics = mask_statistics(mask, area);
    if (statistics.most > 0.0) mask.full = statistics.most;
    if (!(statistics.mean > 0.0)) { // the samples may have missed a few triangles
        bool any = false;
        for (uint32_t t = 0; t < mask.bind.triangle_count && !any; ++t) any = may_grow(mask, t);
        if (!any) refuse_masks(mask.groom);
    }
    const double mean = statistics.mean > 0.0 ? statistics.mean / mask.full : 1e-3;
    return double(mask.groom.count) / (area * mean);
}

// Candidates for a count. Starts with as many as the masks' mean suggests, and increases them until enough
// are left.
std::vector<Candidate> counted_candidates(DensityMask mask, double area,
                                          const std::function<bool()>& cancelled, PlacedRoots& placed) {
    const Groom& groom = mask.groom;
    const double first = density_for_count(mask, area);
    double density = first, spacing = groom.spacing;
    const double oversampling =
        1.1 + 8.0 / std::sqrt(double(groom.count)); // eight standard deviations of a random count
    constexpr int tries = 24;
    for (int i = 0; i < tries && !cancelled(); ++i) {
        std::vector<Candidate> candidates =
            spaced_candidates(mask, density, oversampling, spacing, {}, cancelled, placed);
        if (candidates.size() >= groom.count) {
            keep_highest_priority(candidates, {groom.seed}, groom.count);
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
    if (!cancelled()) refuse_masks(groom);
    return {};
}

} // namespace

PlacedRoots place_roots(const Groom& groom, const Surface& bind, const std::function<bool()>& cancelled,
                        const ShareAround& share) {
    const double area = surface_area(bind);
    if (!(area > 0.0))
        throw SceneFault("groom.no_area", groom.mesh_place, "the mesh '" + groom.mesh + "' has no area",
                         "strands need a surface to grow on");
    PlacedRoots placed;
    std::vector<Candidate> candidates;
    DensityMask mask{groom, bind};
    if (groom.count > 0 && !share) {
        check_count(groom, double(groom.count), "count", fewer);
        candidates = counted_candidates(mask, area, cancelled, placed);
    } else if (groom.count > 0 || groom.density > 0.0) {
        const double density = groom.count > 0 ? density_for_count(mask, area) : groom.density;
        if (!share) check_count(groom, density * area, groom.count > 0 ? "count" : "density", fewer);
        candidates = spaced_candidates(mask, density, 1.0, groom.spacing, share, cancelled, placed);
    }
    if (!share) placed.roots = in_space_order(candidates);
    return placed;
}

} // namespace marram
