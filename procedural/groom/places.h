// SPDX-License-Identifier: Apache-2.0
// Where a groom's strands stand: on its mesh, and on each instance of it. Roots, guides and what the tolerance chooses are found once. A
// strand of an instance is laid out on the mesh and taken to the instance; from there on it is a strand of its own, in the wind of its
// place. Lengths, widths and heights above the skin are as much larger as the instance is.
#pragma once

#include "procedural/wind/jiggle.h"
#include "procedural/wind/strands.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <span>
#include <vector>

namespace marram {

struct Place {
    const MarramMesh* mesh = nullptr;
    bool is_instance = false; // else nothing below differs from the identity
    // Transforms from the groom's mesh to this one, both in world space.
    Eigen::Affine3d at_bind = Eigen::Affine3d::Identity();
    std::vector<Eigen::Affine3d> at_time = {Eigen::Affine3d::Identity()}; // [motion sample], or one
    std::vector<Eigen::Affine3d> at_knot;                                 // [knot of the jiggle's window]

    const Eigen::Affine3d& at(uint32_t time) const {
        return at_time[std::min<size_t>(time, at_time.size() - 1)];
    }
    bool moves() const { return at_time.size() > 1; }
};

// The uniform scale of a transform; the greatest of all places. Transforms are similarities: place_lent_instance() checks it.
double uniform_scale(const Eigen::Affine3d& placed);
double greatest_scale(std::span<const Place> places);

// The bounds of the transformed box.
Eigen::AlignedBox3d transformed_box(const Eigen::Affine3d& placed, const Eigen::AlignedBox3d& box);

// The groom's mesh, which is places[0], and its instances among the frame's meshes. Throws SceneFault for an instance that the host cannot place.
MarramStatus find_places(const MarramFrame& frame, const MarramMesh& mesh, std::vector<Place>& places);

// The largest displacement of an instance from the first motion sample to 1, 4, 16, 64 and 256 frames before, m: a rough idea, by the
// logarithm of which the jiggle looks further back. Throws as find_places().
MarramStatus find_travel(const MarramFrame& frame, std::span<const Place> places, double& travel);

// Fills Place::at_knot for the knots of the window. Sets `moved` if one of them is not where it is at the first motion sample. Throws as
// find_places().
MarramStatus find_past_places(const MarramFrame& frame, const Jiggle& jiggle, const JiggleWindow& window,
                              std::span<Place> places, bool& moved);

// Transforms rest strands. anchor: the transform of the points that noise is sampled from.
void transform_strands(const Eigen::Affine3d& placed, const Eigen::Affine3d& anchor, Strands& strands);

} // namespace marram
