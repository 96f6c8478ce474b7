// SPDX-License-Identifier: Apache-2.0
// Guides: a few curves that a groom's strands, their children, grow between.
//
// What it models. A child's centre line is a blend of the centre lines of the guides nearest to its root,
//
//     D_k = sum w_i T_i (G_i,k - G_i,0) / sum w_i,      w_i = ((R - d_i) / (R d_i))^2
//
// d_i is the distance in the bind pose between the roots of the child and guide i, R that of the nearest
// guide that is no longer blended, and T_i the shortest rotation from the skin's normal at the guide's root
// to that at the child's: R. J. Renka, "Multivariate interpolation of large sets of scattered data", ACM
// Trans. Math. Softw. 14, 1988. A child at the root of a guide equals that guide. The weight of a guide falls
// to 0 before it leaves the set of nearest guides. Guides are resampled to the CV count of the strands,
// equally spaced along them. Lengths are blended with the same weights.
//
// Guides say nothing of skin far from all of them: at a distance from the foot of the nearest guide, strands
// have the full density up to the reach, and from there fade out linearly until 1.5 times the reach. By
// default the reach is 1.5 times the spacing of the guides: nine guides in ten have `blend` others within the
// spacing. A single guide has none, and no limit.
//
// Excluded from the blend are: guides whose skin faces away from the child's; guides whose direction differs
// from that of the nearest guide by more than `parting`, so that hair does not grow across a parting between
// guides; and guides beyond a parting line, which means that the straight line between the roots crosses it,
// seen along the child's normal.
#pragma once

#include "procedural/strands/binding.h"
#include "procedural/strands/lent_curves.h"
#include "procedural/strands/surface.h"

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

inline constexpr int max_blended = 4;

struct GuideSettings {
    std::string curves, place;
    std::string lines, lines_place; // parting lines; "": none
    int blend = 3;                  // guides
    double parting = 0.0;           // radians
    Vec2d length{1.0, 1.0};         // length of children relative to that of their guides
    bool wind_on_guides = false;    // the wind blows the guides, and children follow
    std::optional<double> reach;    // m; empty: from the spacing of the guides
};

std::span<const MarramParam> guide_params();
std::optional<GuideSettings> parse_guide_settings(const Values& values);

// The guides of a child and their weights. Weights sum to 1; unused slots have weight 0.
struct GuideBlend {
    uint32_t guide[max_blended];
    float weight[max_blended];
};

class GuideSet {
  public:
    // `vertices`: of the curves in the bind pose. `bind` must have an area. Guides without length are
    // skipped.
    GuideSet(const GuideSettings& settings, const LentCurves& curves, const float* vertices,
             const Surface& bind, uint32_t vertex_count, std::vector<std::vector<Vec3d>> parting_lines,
             const std::function<bool()>& cancelled);

    size_t count() const { return guides_.size(); }
    double longest_child() const { return longest_; } // of a child, m
    // The blend for a child with this root and normal. Considers at most the 32 nearest guides; if all are
    // excluded, takes the nearest. Memory: 32 bytes per child.
    GuideBlend blend_at(const Vec3d& root, const Vec3d& normal) const;
    double length_of(const GuideBlend& blend) const; // blended length of the guides, m
    double reach() const { return reach_; }          // m; infinite for a single guide
    double default_reach() const;                    // m, by the spacing; infinite likewise
    double density_at(const Vec3d& root) const;      // factor of the density, 0 to 1: see the top

    // Guides with `cvs` equally spaced CVs: offsets from their roots in the bind pose, [guide * cvs + k].
    // Cached; thread-safe.
    std::shared_ptr<const std::vector<Vec3f>> resampled(int cvs) const;
    const Vec3d& normal(size_t guide) const { return guides_[guide].normal; }
    const GuideSettings& settings() const { return settings_; }
    const Binding& binding() const { return binding_; } // of all curves, including those without length
    size_t bytes() const;

    struct Guide {
        Vec3d root, normal, direction; // direction: unit, from root to tip
        Vec3d foot;                    // point of the skin closest to the root
        uint32_t triangle;             // that it is bound to
        Vec3d weights;                 // barycentric
        double length;
        std::vector<Vec3f> points; // offsets from the root
    };
    const Guide& guide(size_t i) const { return guides_[i]; }

  private:
    struct Tree;
    bool crosses_parting_line(const Vec3d& root, const Vec3d& normal, const Vec3d& guide) const;

    GuideSettings settings_;
    Binding binding_;
    std::vector<Guide> guides_;
    std::vector<std::vector<Vec3d>> parting_lines_;
    std::shared_ptr<const Tree> tree_;
    double longest_ = 0.0, reach_ = 0.0;
    mutable std::mutex lock_;
    mutable std::map<int, std::shared_ptr<const std::vector<Vec3f>>> resampled_;
};

// The guides of a patch's strands.
struct Guided {
    const GuideSet& set;
    std::span<const GuideBlend> blends; // [root]
    // At the time of the offsets: the bind pose for guides at rest, else the skin at the motion sample. With
    // the mesh's normals, if it has any.
    Surface skin;
    // Blown guides and the skin's normals at their roots. Empty: guides at rest.
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
