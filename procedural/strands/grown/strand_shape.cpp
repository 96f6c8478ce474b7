// SPDX-License-Identifier: Apache-2.0
// A strand is laid out in its root's frame: N the surface normal, A the tangent towards which it leans,
// S = N x A. The lean angle of its centre line grows along it, theta(u) = lean + arc u. With s = L/(n-1)
//
//     C_k = C_{k-1} + s (sin theta A + cos theta N),    theta at the segment's middle.
//
// Curl, clump and frizz displace C_k sideways:
//
//     curl    r(u) (cos psi E + sin psi S),  r(u) = radius u,  psi = phase + 2 pi turns u,
//             E = dC/dtheta direction
//     clump   (centre - root) amount profile(u), projected on the surface; levels add up, each measured from
//             the centre of the next finer clump, so that a fine clump moves as a whole
//     frizz   amplitude u (noise_x A + noise_y S), gradient noise along the strand
//
// Each segment is then laid out with length s in the direction of the displaced difference. So curl and frizz
// shorten a strand's reach but not its length, and all segments are equally long.
//
// With guides, C_k is their blend (guides.h), in the same frame with A the skin's tangent; E = S x the line's
// direction, unit.
//
// Clumps are the cells of a jittered lattice in the bind pose (S. Worley, "A Cellular Texture Basis
// Function", SIGGRAPH 1996): a root belongs to the nearest of the points in the 27 lattice cells around it.
#include "procedural/strands/grown/strand_shape.h"

#include "core/math/rotation.h"
#include "procedural/abi/ramp_table.h"
#include "procedural/noise/noise.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace marram {
namespace {

// Uniform in [-1, 1].
double symmetric(uint32_t seed, Root root, Purpose purpose) {
    return 2.0 * unit_double(root_hash(seed, root, purpose)) - 1.0;
}

// level 0 is the coarsest.
Vec3d clump_centre(uint32_t seed, size_t level, double size, const Vec3d& p) {
    const Vec3d base = (p / size).array().floor();
    Vec3d best = p;
    double best_distance = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 27; ++i) {
        const Vec3d cell = base + Vec3d(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
        uint64_t h = hash(seed, uint64_t(Purpose::clump) + (uint64_t(level) << 32));
        for (int axis = 0; axis < 3; ++axis)
            h = hash(h, std::bit_cast<uint64_t>(cell[axis] + 0.0)); // + 0.0 turns -0 into 0
        const Vec3d jitter(double(h & 0xffff) * 0x1p-16, double((h >> 16) & 0xffff) * 0x1p-16,
                           double((h >> 32) & 0xffff) * 0x1p-16);
        const Vec3d point = (cell + jitter) * size;
        const double distance = (point - p).squaredNorm();
        if (distance >= best_distance) continue;
        best_distance = distance;
        best = point;
    }
    return best;
}

// Data of eight strands, in SIMD lanes.
struct alignas(64) Roots8 {
    Wide3d origin, along, side, normal; // root, A, S, N
    VDouble length, lean, arc, phase, frizz;
    VDouble curl_share, frizz_share; // factors of the groom's radius and amplitude
    // Offset in m to the centre of each level's clump from that of the next finer one, in the root's frame.
    VDouble clump_along[max_clumps], clump_side[max_clumps];
};

// Angle from the frame's tangent to the direction in which the strand leans.
double azimuth(const Groom& groom, const Surface& bind, Root root, const Vec3d& weights) {
    const double draw = symmetric(groom.seed, root, Purpose::comb);
    if (!groom.combed && !groom.comb_map) return pi * draw;
    const auto p = bind.corners(root.triangle);
    const Vec3d n = plane_normal(p), t = (p[1] - p[0]).stableNormalized();
    Vec3d comb = groom.combed ? groom.comb : Vec3d(Vec3d::Zero());
    if (groom.comb_map) {
        const Vec2d uv = bind.uv(root.triangle, weights);
        const auto [along_u, along_v] = bind.uv_directions(root.triangle);
        const Vec2d map_direction(2.0 * (*groom.comb_map)[0](uv.x(), uv.y()) - 1.0,
                                  2.0 * (*groom.comb_map)[1](uv.x(), uv.y()) - 1.0);
        constexpr double grey = 1.5 / 255.0; // 0.5 lies between two codes of 8 bits
        const Vec3d way = map_direction.x() * along_u + map_direction.y() * along_v;
        if (map_direction.norm() > grey && way.squaredNorm() > 0.0) comb = way.normalized();
    }
    const double x = comb.dot(t), y = comb.dot(n.cross(t));
    // If comb is along the normal, no direction is defined: use a random one.
    const bool defined = std::hypot(x, y) > 1e-6;
    return (defined ? std::atan2(y, x) + groom.comb_variation * draw : pi * draw);
}

// Writes the centre line of a child in its frame to one lane of `centre`.
void set_centre(const Guided& guided, const GuideBlend& blend, std::span<const Vec3f> guides, Root root,
                const Vec3d& weights, int cvs, int lane, Wide3f* centre) {
    const SurfaceFrame frame = frame_at(guided.skin, root.triangle, weights);
    const Eigen::Matrix3d axes = axes_of(frame);
    Eigen::Matrix3d weighted_rotations[max_blended];
    for (int i = 0; i < max_blended; ++i)
        if (blend.weight[i] > 0.0F)
            weighted_rotations[i] =
                double(blend.weight[i]) *
                (axes.transpose() * shortest_rotation(guided.normals.empty()
                                                          ? guided.set.normal(blend.guide[i])
                                                          : guided.normals[blend.guide[i]],
                                                      frame.normal)
                                        .toRotationMatrix());
    for (int k = 0; k < cvs; ++k) {
        Vec3d sum = Vec3d::Zero();
        for (int i = 0; i < max_blended; ++i)
            if (blend.weight[i] > 0.0F)
                sum +=
                    weighted_rotations[i] * guides[blend.guide[i] * size_t(cvs) + size_t(k)].cast<double>();
        set_lane(centre[k], lane, sum);
    }
}

void set_root(const Groom& groom, const Wind& wind, const SkinPoses& poses, Root root,
              const GuideBlend* blend, const Guided* guided, int lane, Roots8& roots, Strands& strands,
              size_t block) {
    const uint32_t seed = groom.seed;
    const Vec3d weights = root_weights(seed, root);
    const SurfaceFrame frame = frame_at(poses.now, root.triangle, weights);
    const Vec3d origin = poses.now.point(root.triangle, weights);
    const Vec3d bind_origin = poses.bind.point(root.triangle, weights);
    const double angle = blend ? 0.0 : azimuth(groom, poses.bind, root, weights);
    const Vec3d along = std::cos(angle) * frame.tangent + std::sin(angle) * frame.bitangent;
    const Vec3d side = frame.normal.cross(along);
    set_lane(roots.along, lane, along);
    set_lane(roots.side, lane, side);
    set_lane(roots.normal, lane, frame.normal);
    set_lane(strands.noise_origin[block], lane, wind.noise_at_bind_frame ? bind_origin : origin);
    set_lane(strands.root_normal[block], lane, frame.normal);
    // The factor of a parameter at this root.
    const auto factor_at_root = [&](FactorOf what) {
        const Factors& factors = groom.factors[what];
        return factors.empty() ? 1.0 : product(factors, poses.bind, root.triangle, weights);
    };
    const double width = groom.width * factor_at_root(of_width) *
                         (1.0 - groom.width_variation * unit_double(root_hash(seed, root, Purpose::width)));
    strands.width[block][lane] = width;

    const Vec2d range = blend ? Vec2d(guided->set.length_of(*blend) * groom.guides->length) : groom.length;
    double length = range[0] + (range[1] - range[0]) * unit_double(root_hash(seed, root, Purpose::length));
    if (groom.length_masks.any()) length *= groom.length_masks(poses.bind, root.triangle, weights);
    if (strands.has_wind_share) {
        strands.wind_share[block][lane] = float(factor_at_root(of_wind));
    }
    roots.length[lane] = length;
    const double offset =
        wind.collision ? root_offset(*wind.collision, length, 0.5 * width * groom.width_profile(0.0)) : 0.0;
    set_lane(roots.origin, lane, origin + offset * frame.normal);
    roots.lean[lane] =
        factor_at_root(of_lean) *
        std::clamp(groom.lean + groom.lean_variation * symmetric(seed, root, Purpose::lean), 0.0, 0.5 * pi);
    roots.arc[lane] =
        factor_at_root(of_arc) * (groom.arc + groom.arc_variation * symmetric(seed, root, Purpose::arc));
    roots.curl_share[lane] = factor_at_root(of_curl);
    roots.frizz_share[lane] = factor_at_root(of_frizz);
    roots.phase[lane] = pi * symmetric(seed, root, Purpose::curl);
    roots.frizz[lane] = unit_double(root_hash(seed, root, Purpose::frizz)) * 0x1p20;
    if (!groom.clumps.empty()) {
        // Computed in the frame of the bind pose, so that it follows the surface when that turns.
        const SurfaceFrame bind = frame_at(poses.bind, root.triangle, weights);
        const double share = factor_at_root(of_clump);
        Vec3d from = bind_origin; // the root, then the centre of its finest clump, ...
        for (size_t level = groom.clumps.size(); level-- > 0;) {
            const Clump& clump = groom.clumps[level];
            const Vec3d centre = clump_centre(seed, level, clump.size, from);
            const Vec3d pull = clump.amount * share * (centre - from);
            const double x = pull.dot(bind.tangent), y = pull.dot(bind.bitangent);
            roots.clump_along[level][lane] = x * std::cos(angle) + y * std::sin(angle);
            roots.clump_side[level][lane] = y * std::cos(angle) - x * std::sin(angle);
            from = centre;
        }
    }
}

// Frizz noise of every CV, in the two directions across the strand.
void frizz_values(const Groom& groom, const Roots8& roots, Strands& strands) {
    const int cvs = strands.cvs;
    for (int k = 0; k < cvs; ++k) {
        const double u = double(k) / double(cvs - 1);
        strands.points[size_t(k)] = {splat(u * groom.frizz_frequency), roots.frizz, splat(0.5)};
    }
    FractalNoise noise;
    noise.seed = groom.seed ^ 0x66726a7aU;
    vector_noise(noise, strands.points.data(), cvs, false, 0.0, strands.values.data());
}

struct ShapeStep { // shared by all strands at CV k
    double u, u_middle, frizz;
    std::array<double, max_clumps> clump;
};

// v scaled to `length`; `instead` if v is 0.
MARRAM_INLINE Wide3d with_length(const Wide3d& v, VDouble length, const Wide3d& instead) {
    const VDouble squared = dot(v, v);
    const VLong some = squared > 1e-300;
    return select(some, v * (length / vsqrt(select(some, squared, 1.0))), instead);
}

// `guides`: centre lines in the frame, or nullptr.
MARRAM_HOT void lay_out(const Groom& groom, const Roots8& roots, const ShapeStep* steps, int cvs,
                        const Wide3f* frizz, const Wide3f* guides, Wide3f* rest, Wide3f* normals) {
    const VDouble segment_length = roots.length / double(cvs - 1);
    const bool curls = groom.curl_radius > 0.0 && groom.curl_turns > 0.0;
    const size_t clumps = groom.clumps.size();
    Wide3d centre{}, previous{}, position{}; // in the frame (A, S, N), from the root
    VDouble phase_sine{}, phase_cosine{};
    if (curls) sincos(roots.phase, phase_sine, phase_cosine);
    rest[0] = to_float(roots.origin);
    for (int k = 1; k < cvs; ++k) {
        VDouble sine, cosine;
        sincos(roots.lean + roots.arc * steps[k].u_middle, sine, cosine);
        Wide3d straight{sine * segment_length, VDouble{}, cosine * segment_length};
        Wide3d across_e{cosine, VDouble{}, -sine}, across_s{VDouble{}, splat(1.0), VDouble{}};
        if (guides) {
            straight = with_length(to_double(guides[k]) - to_double(guides[k - 1]), segment_length, straight);
            across_e = with_length(cross(across_s, straight), splat(1.0), across_e);
            across_s = with_length(cross(straight, across_e), splat(1.0), across_s);
        }
        centre = centre + straight;
        Wide3d displaced = centre;
        for (size_t level = 0; level < clumps; ++level) {
            displaced.x += roots.clump_along[level] * steps[k].clump[level];
            displaced.y += roots.clump_side[level] * steps[k].clump[level];
        }
        if (curls) {
            VDouble s, c;
            sincos(roots.phase + 2.0 * pi * groom.curl_turns * steps[k].u, s, c);
            const VDouble radius = groom.curl_radius * steps[k].u * roots.curl_share;
            displaced = displaced + across_e * (c * radius) + across_s * (s * radius);
        }
        if (frizz) {
            const VDouble amplitude = steps[k].frizz * roots.frizz_share;
            displaced.x += to_double(frizz[k].x) * amplitude;
            displaced.y += to_double(frizz[k].y) * amplitude;
        }
        Wide3d d = displaced - previous;
        const VDouble squared = dot(d, d);
        const VLong usable =
            squared > 1e-24 * segment_length *
                          segment_length; // else the displacements cancel the segment: keep it straight
        d = select(usable, d * (segment_length / vsqrt(select(usable, squared, 1.0))), straight);
        previous = displaced;
        position = position + d;
        rest[k] = to_float(roots.origin + roots.along * position.x + roots.side * position.y +
                           roots.normal * position.z);
        if (normals) { // normal of the blade: the side vector crossed with the segment
            const Wide3d tangent = roots.along * d.x + roots.side * d.y + roots.normal * d.z;
            Wide3d n = cross(roots.side, tangent);
            const VDouble nn = dot(n, n);
            const VLong good = nn > 1e-24 * segment_length * segment_length;
            n = select(good, n * (1.0 / vsqrt(select(good, nn, 1.0))), roots.along);
            normals[k] = to_float(n);
        }
    }
    if (normals) normals[0] = normals[1];
}

} // namespace

void expand(const Groom& groom, const Wind& wind, const SkinPoses& poses, std::span<const Root> roots,
            Strands& strands, const Guided* guided) {
    const int cvs = strands.cvs;
    const auto rest_guides = guided && guided->offsets.empty() ? guided->set.resampled(cvs) : nullptr;
    const std::span<const Vec3f> guides =
        rest_guides ? std::span(*rest_guides) : (guided ? guided->offsets : std::span<const Vec3f>());
    Wide3f* centres = guided ? strands.values.data() + cvs : nullptr; // after those of frizz
    std::vector<ShapeStep> steps(static_cast<size_t>(cvs));
    for (int k = 0; k < cvs; ++k) {
        const double u = double(k) / double(cvs - 1);
        ShapeStep& step = steps[size_t(k)];
        step = {u, (k - 0.5) / double(cvs - 1), groom.frizz_amplitude * u, {}};
        for (size_t level = 0; level < groom.clumps.size(); ++level)
            step.clump[level] = groom.clumps[level].profile(u);
    }
    const bool frizzy = groom.frizz_amplitude > 0.0;
    for (int block = 0; block < strands.blocks; ++block) {
        Roots8 eight;
        for (int lane = 0; lane < lanes; ++lane) {
            const size_t i = std::min(size_t(block) * lanes + size_t(lane), roots.size() - 1);
            const GuideBlend* blend = guided ? &guided->blends[i] : nullptr;
            set_root(groom, wind, poses, roots[i], blend, guided, lane, eight, strands, size_t(block));
            if (blend)
                set_centre(*guided, *blend, guides, roots[i], root_weights(groom.seed, roots[i]), cvs, lane,
                           centres);
        }
        if (frizzy) frizz_values(groom, eight, strands);
        const size_t first = size_t(block) * size_t(cvs);
        lay_out(groom, eight, steps.data(), cvs, frizzy ? strands.values.data() : nullptr, centres,
                strands.rest.data() + first, strands.oriented ? strands.rest_normal.data() + first : nullptr);
    }
}

double longest_strand(const Groom& groom) { return groom.length[1]; } // masks only shorten

void extend_by_rest(const Groom& groom, std::span<const float> positions, Eigen::AlignedBox3d& box) {
    Eigen::AlignedBox3d roots;
    for (size_t v = 0; v + 2 < positions.size(); v += 3)
        roots.extend(Eigen::Map<const Vec3f>(positions.data() + v).cast<double>());
    if (roots.isEmpty()) return;
    // A rest strand stays in a ball of its length about its root; its CVs are rounded to floats.
    const double max_coordinate =
        std::max(roots.min().cwiseAbs().maxCoeff(), roots.max().cwiseAbs().maxCoeff());
    const double length = longest_strand(groom), reach = length * 1.001 + 1e-6 * (max_coordinate + length);
    box.extend(Vec3d(roots.min().array() - reach));
    box.extend(Vec3d(roots.max().array() + reach));
}

} // namespace marram
