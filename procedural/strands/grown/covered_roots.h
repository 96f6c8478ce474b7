// SPDX-License-Identifier: Apache-2.0
// Roots that another mesh covers, such as grass under a house: a strand there has no room, and collision can
// only report it.
//
// A root is covered if a colliding mesh
//
//     crosses the line from just below the skin to the strand's start, root_offset() above it, or
//     encloses that start: of six rays in opposite pairs at least five cross the mesh an odd number of times,
//     and most of the six meet the back of a face of it first.
//     So a closed mesh encloses what is inside of it, and an open one, such as a dome, nothing. A room or a
//     sky, whose faces look inwards, encloses nothing inside of it.
//
// A face in the lower half of that line that looks the way of the strand does not cover it, unless its mesh
// encloses the root: the strand stands on it, as grass does on ground in the same plane as its skin.
//
// Roots are placed once a shot. So only meshes that do not move can cover roots, and only on a mesh that does
// not move. Instances of a mesh have its roots: one that is covered on the mesh is free on an instance. So
// all roots of a mesh with instances stay, and a warning tells of those that are covered on the mesh itself.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/wind/strands.h"

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// The meshes of the frame that can cover roots on `skin`; empty if that moves.
std::vector<const MarramMesh*> covering_meshes(const MarramFrame& frame, std::span<const MarramMesh> meshes,
                                               const MarramMesh& skin);

bool has_instances(const MarramFrame& frame, std::span<const MarramMesh> meshes, const MarramMesh& skin);

// Digest of the positions and triangles of meshes; 0 if there are none.
uint64_t digest_of_meshes(std::span<const MarramMesh* const> meshes);

struct Cover {
    std::string mesh;
    uint64_t roots = 0;
    Vec3d place = Vec3d::Zero(); // of the first
};

// Finds covered roots. Cost: a short ray a root, and six rays that cross all meshes for those within the
// bounds of one.
class RootCover {
  public:
    RootCover(RTCDevice device, std::vector<const MarramMesh*> meshes);
    ~RootCover();
    RootCover(const RootCover&) = delete;
    RootCover& operator=(const RootCover&) = delete;

    // The index of the mesh that covers a root, or -1. root: on the skin; start: of its strand. Thread-safe.
    int covered_by(const Vec3d& root, const Vec3d& start) const;
    const MarramMesh& mesh(int index) const { return *meshes_[size_t(index)]; }

  private:
    int enclosing(const Vec3d& point) const; // the index of a mesh, or -1

    std::vector<const MarramMesh*> meshes_;
    std::vector<Eigen::AlignedBox3d> bounds_;
    RTCDevice device_;
    RTCScene scene_;
};

} // namespace marram
