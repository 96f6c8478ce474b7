// SPDX-License-Identifier: Apache-2.0
// Wind erosion of rock, level by level. Finer levels keep the shape of the coarse level and add detail.
//
// The first level has voxels of edge h_0 = voxel 2^(levels - 1), the last of edge `voxel`. A pass: extract
// the mesh of the level set, trace grains for the wear rate (m a year, grains.h), divide it by hardness
// (hardness.h, mean over a voxel), multiply by a time step, and move the surface inward (level_set.h).
//
// First level. The time step is chosen so that 99.9 % of the vertices lose at most 0.9 voxels; the rest is
// clamped to one voxel. Passes run until all years are simulated, at most `max_passes`.
//
// Finer levels keep the coarse shape C and add detail that its voxels could not hold. With H the voxel size
// of C and m = detail H:
//   start    the rock at this resolution, intersected with C grown outward by m. So unworn surface is that
//            of the original rock, sharp.
//   passes   psi(v) is the signed distance of a vertex v from C, B a blur over the surface with sigma = H, w
//            the wear rate over hardness. A pass removes
//                d(v) = max(B psi, 0) / (passes left) * (w + e) / (B w + e),   e = 5 % of the mean of B w,
//            with the quotient at most 3. The blur of the quotient is about 1, so that B psi goes to 0:
//            places with more wear or softer rock become deeper, places with less wear protrude, and their
//            mean is C. Where C lost less than H / 4, d is reduced in proportion: sheltered faces are kept.
//   end      three passes with quotient 1 remove the rest of B psi.
// So a coarse level is the smoothed finer level, within a tolerance: the distance of C from the finer
// surface, blurred by a Gaussian of sigma = H / 2, is at most 0.15 H (rms) and H / 2 (99 % of the vertices),
// measured one octave and three octaves apart (erosion_test.cpp, build/rock_erosion).
//
// Noise of the grains: rates are blurred over an edge length before use, among vertices with similar normals.
// Each pass has different random numbers.
//
// Edges. Where a wearing face meets one that does not wear, the edge must recede with the wearing face: the
// removed volume is the union of what each face loses. But a vertex on the edge receives half as many hits,
// and would be left as a fin. So a vertex v loses at least the depth that brings it below the plane of a
// neighbour u that has worn by d_u:
//   d_v >= (d_u + n_u . (v - u)) / n_u . n_v,   if the two are convex and 0.2 < n_u . n_v < 0.9,
// over three rings of neighbours, in all passes but the last three of a finer level.
//
// Detached pieces are removed at the end of each level; the largest is kept.
//
// Determinism: results are bitwise the same for any number of threads, provided that RockWear is
// deterministic.
//
// Limits. Years matter only on the first level: finer levels depend on the ratio of wear between neighbouring
// places, not on its amount. Rock thinner than a voxel of the first level is lost there, and so on all
// levels. Cavities within the rock are filled. Hardness is that of places in the scene, not of the rock: a
// mesh that moves from frame to frame is eroded anew in each, through other strata.
//
// Cost of a pass: tracing, 2 s on one core for 10^6 grains around a ball of 1.5 10^6 triangles, and 2.5 s on
// one core for the level set in a grid of 512^3 (build/marram_bench). A finer level takes 8 passes; the
// first as many as its depth of wear in voxels.
#include "procedural/erosion/erosion.h"

#include "core/math/clock.h"
#include "core/math/hash.h"
#include "procedural/abi/parallel.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <type_traits>

namespace marram {
namespace {

constexpr double longest_step = 0.9;    // voxels a pass
constexpr double step_quantile = 0.999; // of the vertex rates; sets the time step
constexpr int edge_rings = 3;
constexpr double min_edge_cosine = 0.2, max_edge_cosine = 0.9;
constexpr int noise_blur = 3;  // iterations, for the rates
constexpr int level_blur = 12; // iterations: sigma = 2 edges = a voxel of the level before
constexpr int shaping_passes = 5, settling_passes = 3;
constexpr double max_wear_ratio = 3.0, wear_floor_fraction = 0.05;
constexpr double worn_voxels = 0.25; // of the level before: detail fades below this depth of wear

// Neighbours of vertices along mesh edges. Each is listed twice, as each edge has two triangles.
class SurfaceNeighbours {
  public:
    explicit SurfaceNeighbours(const LevelMesh& mesh)
        : mesh_(mesh), first_(mesh.vertex_count() + 1, 0), of_(2 * mesh.triangles.size()) {
        for (const uint32_t v : mesh.triangles) first_[v + 1] += 2;
        for (size_t v = 0; v + 1 < first_.size(); ++v) first_[v + 1] += first_[v];
        std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
        for (size_t t = 0; t < mesh.triangles.size(); t += 3)
            for (size_t c = 0; c < 3; ++c) {
                const uint32_t v = mesh.triangles[t + c];
                of_[next[v]++] = mesh.triangles[t + (c + 1) % 3];
                of_[next[v]++] = mesh.triangles[t + (c + 2) % 3];
            }
    }

    // Averages with neighbours; `sides`: only with those of similar normals.
    void blur(int times, std::span<double> values, bool sides = false) const {
        repeat(times, values, [this, sides](std::span<const double> from, size_t v) {
            double sum = 0.0, weights = 0.0;
            for (uint32_t n = first_[v]; n < first_[v + 1]; ++n) {
                const double w = sides ? std::max(2.0 * cosine(v, of_[n]) - 1.0, 0.0) : 1.0;
                sum += w * from[of_[n]], weights += w;
            }
            return weights > 0.0 ? 0.5 * (from[v] + sum / weights) : from[v];
        });
    }

    // Raises depths at convex edges to those of the adjacent faces. See "Edges" at the top of the file.
    void wear_edges(std::span<double> depth) const {
        repeat(edge_rings, depth, [this](std::span<const double> from, size_t v) {
            double most = from[v];
            for (uint32_t n = first_[v]; n < first_[v + 1]; ++n) {
                const uint32_t u = of_[n];
                const double agree = cosine(v, u);
                if (!(agree > min_edge_cosine && agree < max_edge_cosine) || from[u] <= most) continue;
                const double above = height(u, v);
                if (above < 0.0 && height(v, u) < 0.0) most = std::max(most, (from[u] + above) / agree);
            }
            return most;
        });
    }

  private:
    void repeat(int times, std::span<double> values, auto&& of) const {
        std::vector<double> other(values.size());
        for (int n = 0; n < times; ++n) {
            marram::parallel_for(tbb::blocked_range<size_t>(0, values.size(), 4096),
                                 [&](const tbb::blocked_range<size_t>& range) {
                                     for (size_t v = range.begin(); v < range.end(); ++v)
                                         other[v] = of(values, v);
                                 });
            std::copy(other.begin(), other.end(), values.begin());
        }
    }
    Vec3d at(const std::vector<float>& list, size_t v) const {
        return {double(list[3 * v]), double(list[3 * v + 1]), double(list[3 * v + 2])};
    }
    double cosine(size_t a, size_t b) const { return at(mesh_.normals, a).dot(at(mesh_.normals, b)); }
    // Height of vertex b over the tangent plane of vertex a.
    double height(size_t a, size_t b) const {
        return at(mesh_.normals, a).dot(at(mesh_.positions, b) - at(mesh_.positions, a));
    }

    const LevelMesh& mesh_;
    std::vector<uint32_t> first_, of_;
};

double quantile(std::vector<double> values, double share) {
    if (values.empty()) return 0.0;
    const auto at = values.begin() + long(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

double ordered_mean(std::span<const double> values) {
    double sum = 0.0;
    for (const double value : values) sum += value;
    return values.empty() ? 0.0 : sum / double(values.size());
}

class Eroder {
  public:
    Eroder(const ErosionSettings& settings, const RockWear& wear, const ErosionHooks& hooks)
        : settings_(settings), wear_(wear), hooks_(hooks) {}

    bool cancelled() const { return hooks_.cancelled && hooks_.cancelled(); }
    void report_progress(int level, double share) const {
        if (!hooks_.progress) return;
        const double levels = std::min(settings_.levels, settings_.stop_after);
        hooks_.progress((level + std::clamp(share, 0.0, 1.0)) / levels,
                        fmt::format("level {} of {}", level + 1, levels));
    }

    // Wear rate over hardness at each vertex, m a year. False: cancelled.
    bool rates(const LevelMesh& mesh, double voxel, const SurfaceNeighbours& neighbours,
               std::vector<double>& rate) {
        rate.assign(mesh.vertex_count(), 0.0);
        wear_(mesh, pass_++, rate);
        if (cancelled()) return false;
        for (double& r : rate)
            if (!(r > 0.0) || !std::isfinite(r)) r = 0.0;
        neighbours.blur(noise_blur, rate, true);
        std::vector<double> hardness(rate.size());
        rock_hardness(settings_.hardness, mesh.positions, voxel, hardness);
        for (size_t v = 0; v < rate.size(); ++v) rate[v] /= hardness[v];
        return true;
    }

    // Erodes the first level. False: cancelled.
    bool erode_first_level(ErosionLevel& level, double& years) {
        const double voxel = level.rock.voxel();
        std::vector<double> rate;
        while (years < settings_.years && level.passes < settings_.max_passes && !level.rock.empty()) {
            const LevelMesh& mesh = level.rock.mesh();
            const SurfaceNeighbours neighbours(mesh);
            if (!rates(mesh, voxel, neighbours, rate)) return false;
            const double left = settings_.years - years;
            const double fastest = quantile(rate, step_quantile);
            const double step = fastest * left > longest_step * voxel ? longest_step * voxel / fastest : left;
            for (double& r : rate) r *= step;
            neighbours.wear_edges(rate);
            level.rock.advance(rate);
            years += step;
            ++level.passes;
            report_progress(0, years / settings_.years);
        }
        return true;
    }

    // Erodes a finer level towards the shape `coarse`; coarse_rock: `coarse` before wear. False: cancelled.
    bool erode_finer_level(ErosionLevel& level, const LevelSet& coarse, const LevelSet& coarse_rock,
                           int number) {
        const int passes = shaping_passes + settling_passes;
        std::vector<double> rate, blurred, excess;
        std::vector<float> distance, worn;
        for (int pass = 0; pass < passes && !level.rock.empty(); ++pass) {
            const LevelMesh& mesh = level.rock.mesh();
            const SurfaceNeighbours neighbours(mesh);
            const size_t count = mesh.vertex_count();
            distance.resize(count), worn.resize(count), excess.resize(count);
            coarse.sample(mesh.positions, distance);
            coarse_rock.sample(mesh.positions, worn);
            for (size_t v = 0; v < count; ++v) excess[v] = double(distance[v]);
            neighbours.blur(level_blur, excess);
            const bool shapes = pass < shaping_passes;
            if (shapes) {
                if (!rates(mesh, level.rock.voxel(), neighbours, rate)) return false;
                blurred = rate;
                neighbours.blur(level_blur, blurred);
            } else if (cancelled()) {
                return false;
            }
            const double even = shapes ? wear_floor_fraction * ordered_mean(blurred) : 0.0;
            const double part = 1.0 / (shapes ? shaping_passes - pass : 1);
            for (size_t v = 0; v < count; ++v) {
                const double lost = (double(distance[v]) - double(worn[v])) / (worn_voxels * coarse.voxel());
                const double over = blurred[v] + even;
                const double quotient =
                    shapes && over > 0.0 ? std::min((rate[v] + even) / over, max_wear_ratio) : 1.0;
                excess[v] = std::max(excess[v], 0.0) * std::clamp(lost, 0.0, 1.0) * part * quotient;
            }
            if (shapes) neighbours.wear_edges(excess);
            level.rock.advance(excess);
            ++level.passes;
            report_progress(number, (pass + 1.0) / passes);
        }
        return true;
    }

  private:
    const ErosionSettings& settings_;
    const RockWear& wear_;
    const ErosionHooks& hooks_;
    uint64_t pass_ = 0;
};

using RockScene = std::unique_ptr<std::remove_pointer_t<RTCScene>, decltype(&rtcReleaseScene)>;

// Quads where possible: Embree's tree over them has half as many leaves, and takes half the time to build.
RTCGeometry rock_geometry(RTCDevice device, const LevelMesh& mesh, bool quads) {
    const RTCGeometry geometry =
        rtcNewGeometry(device, quads ? RTC_GEOMETRY_TYPE_QUAD : RTC_GEOMETRY_TYPE_TRIANGLE);
    void* const vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                   3 * sizeof(float), mesh.vertex_count());
    const size_t count = quads ? mesh.triangle_count() / 2 : mesh.triangle_count(), corners = quads ? 4 : 3;
    auto* const indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, quads ? RTC_FORMAT_UINT4 : RTC_FORMAT_UINT3,
        corners * sizeof(uint32_t), count));
    if (!vertices || !indices) {
        rtcReleaseGeometry(geometry);
        throw std::bad_alloc();
    }
    std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<float*>(vertices));
    const uint32_t* const t = mesh.triangles.data();
    if (quads)
        for (size_t k = 0; k < count; ++k)
            for (size_t c = 0; c < 4; ++c) indices[4 * k + c] = t[6 * k + std::array{5, 0, 1, 2}[c]];
    else
        std::copy_n(t, 3 * count, indices);
    rtcSetGeometryMask(geometry, 0xffffffffU);
    rtcCommitGeometry(geometry);
    return geometry;
}

} // namespace

std::string erosion_settings_fault(const ErosionSettings& s) {
    if (s.levels < 1 || s.levels > max_erosion_levels)
        return fmt::format("levels: must be 1 to {}", max_erosion_levels);
    if (s.stop_after < 1) return "stop_after: must be 1 or more";
    if (!(s.voxel > 0.0) || !std::isfinite(s.voxel)) return "voxel: must be above 0";
    if (!(s.years >= 0.0) || !std::isfinite(s.years)) return "years: must be 0 or more";
    if (!(s.detail >= 0.0 && s.detail <= 1.0)) return "detail: must be 0 to 1";
    if (s.max_passes < 0) return "most_passes: must be 0 or more";
    return "";
}

ErosionResult erode(std::span<const float> positions, std::span<const uint32_t> triangles,
                    const ErosionSettings& settings, const RockWear& wear, const ErosionHooks& hooks) {
    if (const std::string fault = erosion_settings_fault(settings); !fault.empty())
        throw std::invalid_argument(fault);
    ErosionResult result;
    Eroder eroder(settings, wear, hooks);
    std::optional<LevelSet> rock_before; // level before, without wear
    for (int number = 0; number < std::min(settings.levels, settings.stop_after) && !result.cancelled;
         ++number) {
        const double begin = wall_seconds();
        LevelSet rock = LevelSet::from_mesh(positions, triangles,
                                            std::ldexp(settings.voxel, settings.levels - 1 - number));
        const auto start = [&] {
            if (number == 0) return LevelSet(rock);
            const LevelSet& coarse = result.levels.back().rock;
            LevelSet grown = coarse.refined(settings.detail * coarse.voxel());
            grown.intersect(rock);
            return grown;
        };
        ErosionLevel level{start()};
        level.start = mesh_volume(level.rock.mesh());
        result.cancelled =
            eroder.cancelled() ||
            !(number == 0 ? eroder.erode_first_level(level, result.years)
                          : eroder.erode_finer_level(level, result.levels.back().rock, *rock_before, number));
        if (result.cancelled) break;
        level.removed = level.start - mesh_volume(level.rock.mesh());
        level.pieces = level.rock.keep_largest();
        level.left = mesh_volume(level.rock.mesh());
        level.seconds = wall_seconds() - begin;
        result.levels.push_back(std::move(level));
        rock_before.emplace(std::move(rock));
    }
    if (!result.cancelled) result.given = mesh_volume(rock_before->mesh());
    return result;
}

GrainReport trace_winds(RTCScene scene, const WornMesh& rock, const RockScenery& scenery, uint64_t pass,
                        std::span<double> rate, const std::function<bool()>& cancelled) {
    GrainReport sum;
    std::fill(rate.begin(), rate.end(), 0.0);
    double shares = 0.0;
    for (const RockWind& wind : scenery.winds) shares += wind.share;
    if (!(shares > 0.0)) return sum;
    std::vector<double> one(rate.size());
    for (size_t n = 0; n < scenery.winds.size(); ++n) {
        GrainSettings grains = scenery.winds[n].grains;
        grains.sand = scenery.sand;
        if (pass + n > 0) grains.seed = uint32_t(hash(hash(grains.seed, pass), n));
        const double share = scenery.winds[n].share / shares;
        const GrainReport report =
            trace_grains(scene, std::span(&rock, 1), grains, one, {}, {.cancelled = cancelled, .rays = {}});
        sum.cancelled = sum.cancelled || report.cancelled;
        sum.grains += report.grains, sum.rays += report.rays, sum.worn_hits += report.worn_hits,
            sum.sand_hits += report.sand_hits;
        sum.worn += report.worn, sum.volume += share * report.volume, sum.seconds += report.seconds;
        if (sum.cancelled) break;
        for (size_t v = 0; v < rate.size(); ++v) rate[v] += share * one[v];
    }
    return sum;
}

GrainReport wear_by_grains(const RockScenery& scenery, const LevelMesh& mesh, uint64_t pass,
                           std::span<double> rate, const std::function<bool()>& cancelled) {
    std::fill(rate.begin(), rate.end(), 0.0);
    if (mesh.triangles.empty()) return {};
    const RockScene scene(rtcNewScene(scenery.device), &rtcReleaseScene);
    const bool quads = has_quads(mesh);
    const RTCGeometry rock = rock_geometry(scenery.device, mesh, quads);
    rtcAttachGeometryByID(scene.get(), rock, scenery.rock_id);
    rtcReleaseGeometry(rock);
    for (const auto& [id, geometry] : scenery.others) rtcAttachGeometryByID(scene.get(), geometry, id);
    rtcCommitScene(scene.get());
    const WornMesh worn{scenery.rock_id,       mesh.positions.data(), mesh.vertex_count(),
                        mesh.triangles.data(), mesh.triangle_count(), quads};
    return trace_winds(scene.get(), worn, scenery, pass, rate, cancelled);
}

RockWear grain_wear(RockScenery scenery, std::function<bool()> cancelled) {
    for (const RockWind& wind : scenery.winds)
        if (const std::string fault = grain_settings_fault(wind.grains); !fault.empty())
            throw std::invalid_argument(fault);
    return [scenery = std::move(scenery),
            cancelled = std::move(cancelled)](const LevelMesh& mesh, uint64_t pass, std::span<double> rate) {
        wear_by_grains(scenery, mesh, pass, rate, cancelled);
    };
}

void blur_over_surface(const LevelMesh& mesh, int times, std::span<double> values) {
    SurfaceNeighbours(mesh).blur(times, values);
}

} // namespace marram
