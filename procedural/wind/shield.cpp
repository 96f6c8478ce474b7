// SPDX-License-Identifier: Apache-2.0
// After the talk, section 4: from each CV P of the rest strand a ray is traced upwind, from P to P - w
// offset. If it hits a triangle, P is sheltered. The sheltered fraction alpha of the CVs scales the envelope
// by 1 - shield alpha.
//
// The strand's own skin counts like any other mesh. A root lies on it, so its ray starts above the skin,
// offset along the normal by the rounding error of a position: 2^-20 of the largest coordinate, eight ulp. So
// a root on the windward side is free and one on the lee side is not. Other CVs need no offset.
//
// wake: an obstacle at distance d shelters by 1 - d / wake, and not at all beyond. spread: the mean over
// directions that cover the cone evenly (a Fibonacci lattice on the spherical cap), so that shadows have soft
// edges without noise. Each CV rotates and shifts the lattice by its index, the same for all strands:
// together the CVs of a strand sample the cone more densely, which halves the number of rays. No wind comes
// out of the ground: directions from below the strand's own skin count only if the wind itself comes from
// lower still.
#include "procedural/wind/shield.h"

#include "procedural/abi/param.h"

#include <algorithm>
#include <array>
#include <string>

namespace marram {
namespace {

constexpr std::array shielding_values = {
    param::keyable(
        param::number("shielding.shield", "", "none", 0, 1,
                      "share of the wind that a fully sheltered strand loses; absent: no shielding")),
    param::number("shielding.offset", "m", "none", 1e-9, max_wind_input,
                  "distance upwind in which meshes shelter; default: 10 m"),
    param::choice("shielding.shield_per", "none", "curve|cv",
                  "curve (default): one value a strand; cv: one value a CV"),
    param::number(
        "shielding.wake", "m", "none", 1e-9, max_wind_input,
        "distance behind a mesh after which shelter has faded to nothing; default: it does not fade"),
    param::number("shielding.wake_heights", "", "none", 1e-9, max_wind_input,
                  "the same, in heights of the mesh (its extent in y)"),
    param::number(
        "shielding.spread", "deg", "none", 0, 89,
        "half angle of the cone of directions that wind comes from, for soft edges; default: 0, one "
        "direction"),
    param::integer("shielding.rays", "", "none", 1, 1024,
                   "rays a CV in that cone; default: as many as the tolerance asks for", "1|4|16|64|256",
                   "seconds.shield"),
};

} // namespace

std::span<const MarramParam> shielding_params() { return shielding_values; }

std::optional<Shielding> read_shielding(const Values& values) {
    const auto given = [&](const char* name) { return values.has(name); };
    if (!given("wind.shielding.shield")) {
        for (const MarramParam& param : shielding_values) {
            const std::string name = std::string("wind.") + param.name;
            if (values.has(name))
                throw SceneFault("shielding.no_strength", values.at(name).place,
                                 name + " has no effect without shielding.shield",
                                 "add wind.shielding.shield = 1");
        }
        return std::nullopt;
    }
    Shielding shielding;
    shielding.shield = values.number("wind.shielding.shield");
    shielding.offset = given("wind.shielding.offset") ? values.number("wind.shielding.offset") : 10.0;
    shielding.per_cv = given("wind.shielding.shield_per") && values.text("wind.shielding.shield_per") == "cv";
    if (given("wind.shielding.wake")) shielding.wake = values.number("wind.shielding.wake");
    if (given("wind.shielding.wake_heights")) {
        if (shielding.wake)
            throw SceneFault("shielding.two_wakes", values.at("wind.shielding.wake_heights").place,
                             "shielding has both wake and wake_heights", "keep one of them");
        shielding.wake_heights = values.number("wind.shielding.wake_heights");
    }
    if (given("wind.shielding.spread")) shielding.spread = radians(values, "wind.shielding.spread");
    shielding.rays = 0;
    if (given("wind.shielding.rays")) {
        if (!(shielding.spread > 0.0))
            throw SceneFault("shielding.rays_without_spread", values.at("wind.shielding.rays").place,
                             "shielding.rays needs a cone", "add shielding.spread = 10, or remove rays");
        shielding.rays = values.integer("wind.shielding.rays");
    }
    if (shielding.shield == 0.0 && !values.keyframes("wind.shielding.shield")) return std::nullopt;
    return shielding;
}

int cone_rays(const Shielding& shielding, double length, double turn, bool many_reference_segments,
              double tolerance, bool& enough) {
    constexpr double most = 1024.0, wide = 2.5 * pi / 180.0;
    const double cone = 0.75 * -std::expm1(-shielding.spread / wide);
    const double factor = (shielding.per_cv ? 1.6 : 1.0) * (many_reference_segments ? 2.0 : 1.0);
    const double share = cone * factor * length * shielding.shield * std::min(turn, 1.0) / tolerance;
    const double rays = std::max(1.0, std::ceil(std::pow(share, 1.0 / 0.8)));
    enough = rays <= most;
    return int(std::min(rays, most));
}

std::vector<double> obstacle_heights(const Colliders& colliders) {
    std::vector<double> heights(colliders.meshes.size(), 0.0);
    for (size_t i = 0; i < heights.size(); ++i) {
        const MarramMesh* mesh = colliders.meshes[i];
        if (!mesh || mesh->vertex_count == 0) continue;
        const float* positions = mesh->positions[mesh->time_count > 1 ? colliders.time_index : 0];
        float low = positions[1], high = low;
        for (size_t v = 0; v < mesh->vertex_count; ++v) {
            low = std::min(low, positions[3 * v + 1]);
            high = std::max(high, positions[3 * v + 1]);
        }
        heights[i] = double(high) - double(low);
    }
    return heights;
}

namespace {

// Upwind directions that cover the cone: equal parts of its solid angle, rotated by the golden angle. [ray *
// cvs + CV]: the lattices of the CVs are shifted against each other by the sequence of M. Roberts, "The
// Unreasonable Effectiveness of Quasirandom Sequences" (2018), multiples of 1 / p and 1 / p^2 with p^3 = p +
// 1.
std::vector<Vec3f> upwind_directions(const Shielding& shielding, const Vec3d& wind, int cvs) {
    if (!(shielding.spread > 0.0)) return {Vec3d(-wind).cast<float>()};
    Vec3d tangent, bitangent;
    const Vec3d axis = -wind;
    orthonormal_basis(axis, tangent, bitangent);
    constexpr double plastic = 1.32471795724474602596;
    const double golden = pi * (3.0 - std::sqrt(5.0)), cap = 1.0 - std::cos(shielding.spread);
    std::vector<Vec3f> directions;
    for (int i = 0; i < shielding.rays; ++i)
        for (int k = 0; k < cvs; ++k) {
            const double shift = std::fmod((k + 0.5) / plastic, 1.0);
            const double turn = golden * i + 2.0 * pi * std::fmod(k / (plastic * plastic), 1.0);
            const double z = 1.0 - cap * (i + shift) / shielding.rays;
            const double r = std::sqrt(std::max(1.0 - z * z, 0.0));
            const Vec3d d = axis * z + (tangent * std::cos(turn) + bitangent * std::sin(turn)) * r;
            directions.push_back(d.cast<float>());
        }
    return directions;
}

// Collects rays and traces them in batches.
class Tracer {
  public:
    Tracer(const Shielding& shielding, const Colliders& colliders, std::span<const double> heights)
        : shielding_(shielding), colliders_(colliders), heights_(heights) {}

    RTCRayHit ray_of(const Vec3f& p, const Vec3f& d) const {
        RTCRayHit ray;
        ray.ray = {p.x(),
                   p.y(),
                   p.z(),
                   0.0F,
                   d.x(),
                   d.y(),
                   d.z(),
                   colliders_.time,
                   float(shielding_.offset),
                   MARRAM_SHELTERS,
                   0,
                   0};
        ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        return ray;
    }

    // The ray at once, and where it ended.
    ShelterRay trace(uint32_t cv, const Vec3f& p, const Vec3f& d) const {
        RTCRayHit ray = ray_of(p, d);
        if (colliders_.any()) marram_intersect_many(colliders_.scene, &ray, 1);
        const bool hit = ray.hit.geomID != RTC_INVALID_GEOMETRY_ID;
        return {cv, p, p + d * ray.ray.tfar, !hit ? 0.0F : fades() ? shelter(ray) : 1.0F};
    }

    // Adds `share` times the shelter of p in direction d to `out`, at the next flush.
    void add(const Vec3f& p, const Vec3f& d, float share, float* out) {
        rays_[count_] = ray_of(p, d);
        out_[count_] = out;
        share_[count_] = share;
        if (++count_ == most) flush();
    }

    void flush() {
        if (count_ == 0) return;
        const bool fades = this->fades();
        if (fades)
            marram_intersect_many(colliders_.scene, rays_, count_);
        else
            marram_occluded_many(colliders_.scene, &rays_[0].ray, count_, sizeof(RTCRayHit));
        for (unsigned i = 0; i < count_; ++i) {
            const bool hit =
                fades ? rays_[i].hit.geomID != RTC_INVALID_GEOMETRY_ID : rays_[i].ray.tfar < 0.0F;
            if (hit) *out_[i] += share_[i] * (fades ? shelter(rays_[i]) : 1.0F);
        }
        count_ = 0;
    }

  private:
    static constexpr unsigned most = 256;

    bool fades() const { return shielding_.wake || shielding_.wake_heights; }

    float shelter(const RTCRayHit& found) const {
        const unsigned id = found.hit.geomID;
        const double wake = shielding_.wake        ? *shielding_.wake
                            : id < heights_.size() ? *shielding_.wake_heights * heights_[id]
                                                   : 0.0;
        const auto d = double(found.ray.tfar);
        return wake > 0.0 ? float(std::clamp(1.0 - d / wake, 0.0, 1.0)) : 0.0F;
    }

    const Shielding& shielding_;
    const Colliders& colliders_;
    std::span<const double> heights_;
    alignas(16) RTCRayHit rays_[most];
    float* out_[most];
    float share_[most];
    unsigned count_ = 0;
};

// Calls use(CV, its number in its strand, origin, direction, share of the CV's rays) for each ray.
template <typename Use>
void each_ray(const Shielding& shielding, const Vec3d& wind, const Strands& strands, Use&& use) {
    const auto cvs = size_t(strands.cvs), all = size_t(strands.count) * cvs;
    const std::vector<Vec3f> directions = upwind_directions(shielding, wind, strands.cvs);
    const size_t sets = directions.size() == 1 ? 1 : cvs;
    const Vec3f upwind = -wind.cast<float>();
    std::vector<Vec3f> open;
    for (size_t cv = 0; cv < all; ++cv) {
        const size_t i = cv / cvs, k = cv % cvs;
        const auto lane = int(i % lanes);
        const Wide3d& up = strands.root_normal[i / lanes];
        const Vec3f normal(float(up.x[lane]), float(up.y[lane]), float(up.z[lane]));
        const float lowest = std::min(upwind.dot(normal), 0.0F);
        const Wide3f& p = strands.rest[i / lanes * cvs + k];
        Vec3f origin(p.x[lane], p.y[lane], p.z[lane]);
        if (k == 0) {
            constexpr float rounding = 0x1p-20F;
            origin += rounding * origin.cwiseAbs().maxCoeff() * normal;
        }
        open.clear();
        for (size_t j = k % sets; j < directions.size(); j += sets)
            if (sets == 1 || directions[j].dot(normal) >= lowest) open.push_back(directions[j]);
        if (open.empty()) open.push_back(upwind);
        const float share = 1.0F / float(open.size());
        for (const Vec3f& d : open) use(cv, k, origin, d, share);
    }
}

} // namespace

std::vector<ShelterRay> shelter_rays(const Shielding& shielding, const Vec3d& wind,
                                     const Colliders& colliders, std::span<const double> heights,
                                     const Strands& strand) {
    const Tracer tracer(shielding, colliders, heights);
    std::vector<ShelterRay> rays;
    each_ray(shielding, wind, strand, [&](size_t, size_t k, const Vec3f& origin, const Vec3f& d, float) {
        rays.push_back(tracer.trace(uint32_t(k), origin, d));
    });
    return rays;
}

void shield(const Shielding& shielding, const Vec3d& wind, const Colliders& colliders,
            std::span<const double> heights, Strands& strands) {
    std::fill(strands.shield.begin(), strands.shield.end(), VFloat{});
    if (!colliders.any()) return;
    const auto cvs = size_t(strands.cvs);
    Tracer tracer(shielding, colliders, heights);
    each_ray(shielding, wind, strands,
             [&](size_t cv, size_t k, const Vec3f& origin, const Vec3f& d, float share) {
                 const size_t i = cv / cvs;
                 VFloat& shelter = strands.shield[i / lanes * cvs + k];
                 tracer.add(origin, d, share, reinterpret_cast<float*>(&shelter) + i % lanes);
             });
    tracer.flush();
    if (shielding.per_cv) return;
    for (int block = 0; block < strands.blocks; ++block) {
        VFloat* alpha = strands.shield.data() + size_t(block) * cvs;
        VFloat sum{};
        for (size_t k = 0; k < cvs; ++k) sum += alpha[k];
        for (size_t k = 0; k < cvs; ++k) alpha[k] = sum * (1.0F / float(cvs));
    }
}

} // namespace marram
