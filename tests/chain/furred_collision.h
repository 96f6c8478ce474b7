// SPDX-License-Identifier: Apache-2.0
// Strands on a mesh, blown and collided, and their checks by the oracle.
#pragma once

#include "tests/chain/furred_world.h"
#include "tests/oracle/collide.h"
#include "tests/oracle/promise.h"

#include <array>
#include <cmath>

namespace marram {

inline oracle::TriangleSet triangle_set(const std::vector<Mesh>& meshes) {
    std::vector<oracle::Triangle> triangles;
    for (const Mesh& mesh : meshes)
        for (const auto& t : mesh.triangles)
            triangles.push_back({mesh.positions[t[0]].cast<double>(), mesh.positions[t[1]].cast<double>(),
                                 mesh.positions[t[2]].cast<double>()});
    return oracle::TriangleSet(std::move(triangles));
}

inline double angle_between(const Vec3d& a, const Vec3d& b) {
    return std::atan2(a.cross(b).norm(), a.dot(b));
}

struct FurOptions {
    uint64_t count = 1000;
    int cvs = 8;
    Vec2d length{0.18, 0.26};
    double width = 0.004;
    Vec3d wind = Vec3d::UnitX();
    double global_rotate = 1.0;
    Collision collision{};
    MarramBasis basis = MARRAM_BSPLINE;
    double tolerance = 0.001; // metres
};

// Blown (bent) and then collided.
struct Fur {
    Wind wind;
    Groom groom;
    std::vector<float> profile;
    std::vector<Strands> patches;
    CollisionCounts counts;
    std::vector<SegmentTrace> trace; // strand numbers are continuous over the patches

    std::vector<Vec3d> strand(size_t i) const {
        const Strands& s = patches[i / 512];
        std::vector<Vec3d> cvs;
        for (int k = 0; k < s.cvs; ++k) {
            const Wide3f& p = s.pose[i % 512 / lanes * size_t(s.cvs) + size_t(k)];
            const auto lane = int(i % lanes);
            cvs.emplace_back(double(p.x[lane]), double(p.y[lane]), double(p.z[lane]));
        }
        return cvs;
    }
    std::vector<double> radii(size_t i) const {
        std::vector<double> r;
        for (const float half : profile)
            r.push_back(patches[i / 512].width[i % 512 / lanes][int(i % lanes)] * double(half));
        return r;
    }
    size_t count() const {
        size_t n = 0;
        for (const Strands& s : patches) n += size_t(s.count);
        return n;
    }
};

inline Fur blow(const FurredWorld& world, const FurOptions& options, bool traced) {
    Fur fur;
    fur.groom = plain_coat(options.count, options.cvs, options.length[0], options.length[1], options.width);
    fur.groom.basis = options.basis;
    fur.wind = plain_wind(options.wind, options.global_rotate);
    fur.wind.collision = options.collision;
    for (int k = 0; k < options.cvs; ++k)
        fur.profile.push_back(float(0.5 * fur.groom.width_profile(double(k) / (options.cvs - 1))));
    fur.patches = grow(fur.groom, fur.wind, world.surface(0));
    const Ramp whole;
    ChainFrame chain =
        make_chain_frame({fur.wind, whole, world.frame(), &world.mesh(0), fur.profile, options.basis});
    chain.frame.stage = MARRAM_BENT;
    ChainScratch scratch;
    const Colliders colliders = world.colliders();
    size_t first = 0;
    for (Strands& strands : fur.patches) {
        run_chain(chain, 0, strands, scratch);
        const size_t traces = fur.trace.size();
        const CollideJob job{&*fur.wind.collision,
                             &colliders,
                             &world.mesh(0),
                             fur.profile,
                             options.basis,
                             options.tolerance,
                             traced ? &fur.trace : nullptr};
        collide(job, strands, scratch.collide, fur.counts);
        for (size_t i = traces; i < fur.trace.size(); ++i) fur.trace[i].strand += first;
        first += size_t(strands.count);
    }
    return fur;
}

} // namespace marram
