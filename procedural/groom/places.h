// SPDX-License-Identifier: Apache-2.0
// Where a groom's strands stand: on its mesh, and on each instance of it. Roots, guides and what the tolerance chooses are found once. A
// strand of an instance is laid out on the mesh and taken to the instance; from there on it is a strand of its own, in the wind of its
// place. Lengths, widths and heights above the skin are as much larger as the instance is.
#pragma once

#include "procedural/wind/jiggle.h"
#include "procedural/wind/strands.h"

#include <Eigen/Geometry>

#include <span>
#include <vector>

namespace marram {

struct Place {
    const MarramMesh* mesh = nullptr;
    bool is_instance = false; // else nothing below differs from the identity
    // From the groom's mesh, as it stands in the world.
    Eigen::Affine3d at_bind = Eigen::Affine3d::Identity();
    std::vector<Eigen::Affine3d> at_time = {Eigen::Affine3d::Identity()}; // [motion sample], or one
    std::vector<Eigen::Affine3d> at_knot;                                 // [knot of the jiggle's window]

    const Eigen::Affine3d& at(uint32_t time) const {
        return at_time[std::min<size_t>(time, at_time.size() - 1)];
    }
    bool moves() const { return at_time.size() > 1; }
};

// How much larger things are made.
double size_of(const Eigen::Affine3d& placed);
double greatest_size(std::span<const Place> places);

// The box that holds a box when it is taken there.
Eigen::AlignedBox3d placed_box(const Eigen::Affine3d& placed, const Eigen::AlignedBox3d& box);

// The groom's mesh and its instances among the frame's. Throws SceneFault for an instance that the host cannot place.
MarramStatus find_places(const MarramFrame& frame, const MarramMesh& mesh, std::vector<Place>& places);

// How far instances of a mesh have travelled before the frame's first motion sample, m: enough to know how far back to look.
MarramStatus find_travel(const MarramFrame& frame, std::span<const Place> places, double& travel);

// Where instances stood at the knots of the window. moved: whether one of them did.
MarramStatus find_past_places(const MarramFrame& frame, const Jiggle& jiggle, const JiggleWindow& window,
                              std::span<Place> places, bool& moved);

// Takes rest strands to a place. anchor: takes the points that noise is sampled from.
void take_to(const Eigen::Affine3d& placed, const Eigen::Affine3d& anchor, Strands& strands);

} // namespace marram
