// SPDX-License-Identifier: Apache-2.0
// Guides: a few curves that a groom's strands, their children, grow between.
//
// What it models. A child's centre line is a blend of those of the guides nearest to its root,
//
//     D_k = sum w_i T_i (G_i,k - G_i,0) / sum w_i,      w_i = ((R - d_i) / (R d_i))^2
//
// with d_i the distance of the roots in the bind pose, R that of the first guide that is not blended any more, and T_i the shortest turn
// from the skin's normal at the guide's root to that at the child's: R. J. Renka, "Multivariate interpolation of large sets of scattered
// data", ACM Trans. Math. Softw. 14, 1988. A child that grows where a guide does is that guide; weights fall to 0 as guides cease to be
// among the nearest. Guides are resampled to as many CVs as strands have, equally spaced along them. Lengths are blended likewise.
//
// Not blended are guides whose skin faces away from the child's; guides that point elsewhere than the nearest one by more than
// `parting`, so that hair does not grow across a parting that two sides of guides make; and guides beyond a drawn parting line: the
// straight way between the roots crosses it, seen along the child's normal.
#pragma once

#include "procedural/groom/binding.h"
#include "procedural/groom/lent_curves.h"
#include "procedural/groom/surface.h"

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

inline constexpr int most_blended = 4;

struct GuideSettings {
    std::string curves, place;
    std::string lines, lines_place; // drawn partings; "": none
    int blend = 3;                  // guides
    double parting = 0.0;           // radians
    Vec2d length{1.0, 1.0};         // of children, in lengths of their guides
    bool wind_on_guides = false;    // the wind blows the guides, and children follow
};

std::span<const MarramParam> guide_params();
std::optional<GuideSettings> read_guides(const Values& values);

// What a child is made of. Weights sum to 1; those of unused places are 0.
struct GuideBlend {
    uint32_t guide[most_blended];
    float weight[most_blended];
};

// The turn that takes unit vector a onto b by the shortest arc; about any axis where they are opposed.
Eigen::Matrix3d shortest_turn(const Vec3d& a, const Vec3d& b);

class GuideSet {
  public:
    // `vertices`: of the curves in the bind pose. `bind` has an area. Guides without length are left out.
    GuideSet(const GuideSettings& settings, const LentCurves& curves, const float* vertices,
             const Surface& bind, uint32_t vertex_count, std::vector<std::vector<Vec3d>> parting_lines,
             const std::function<bool()>& cancelled);

    size_t count() const { return guides_.size(); }
    double longest() const { return longest_; } // of a child, m
    // Memory: 32 bytes a child.
    // Looks at the 32 nearest guides at most; where none of them may be blended, the nearest alone.
    GuideBlend blend_at(const Vec3d& root, const Vec3d& normal) const;
    double length_of(const GuideBlend& blend) const; // of the guides, blended

    // Guides with `cvs` CVs equally spaced: offsets from their roots in the bind pose, [guide * cvs + k]. Kept for the next that asks;
    // any thread.
    std::shared_ptr<const std::vector<Vec3f>> resampled(int cvs) const;
    const Vec3d& normal(size_t guide) const { return guides_[guide].normal; }
    const GuideSettings& settings() const { return settings_; }
    const Binding& binding() const { return binding_; } // of all curves, without length too
    size_t bytes() const;

    struct Guide {
        Vec3d root, normal, direction; // direction: unit, from root to tip
        uint32_t triangle;             // that it is bound to
        Vec3d weights;                 // barycentric
        double length;
        std::vector<Vec3f> points; // offsets from the root
    };
    const Guide& guide(size_t i) const { return guides_[i]; }

  private:
    struct Tree;
    bool parted(const Vec3d& root, const Vec3d& normal, const Vec3d& guide) const;

    GuideSettings settings_;
    Binding binding_;
    std::vector<Guide> guides_;
    std::vector<std::vector<Vec3d>> parting_lines_;
    std::shared_ptr<const Tree> tree_;
    double longest_ = 0.0;
    mutable std::mutex lock_;
    mutable std::map<int, std::shared_ptr<const std::vector<Vec3f>>> resampled_;
};

// How a patch's strands are made of guides.
struct Guided {
    const GuideSet& set;
    std::span<const GuideBlend> blends; // [root]
    Surface bind;                       // with the mesh's normals, where it has them
    // Guides as they are blown, and the skin's normals at their roots then; `bind` is the skin at that time. Empty: at rest.
    std::span<const Vec3f> offsets{};
    std::span<const Vec3d> normals{};
};

// Guides at a motion sample.
struct BlownGuides {
    std::vector<Vec3f> offsets;                // [guide * cvs + k], from their roots
    std::vector<Vec3d> normals;                // [guide], of the skin
    std::vector<float> envelope, gust, shield; // [guide * cvs + k]
};

} // namespace marram
