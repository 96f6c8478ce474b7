// SPDX-License-Identifier: Apache-2.0
// The ruin layer: what the wind does to the sand around a mesh that stands in it. The page of the model is in ruin.cpp.
#pragma once

#include "core/plugin/embree.h"
#include "procedural/terrain/layer_types.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace marram {

// H is the height of a wall above the sand at its foot. Any finite values are good; the page states their ranges.
struct RuinSettings {
    double scour = 1.0;        // amount of scour and echo dune
    double scour_depth = 0.25; // at the wall, share of H
    double drift = 1.0;        // amount of drifts in the lee and of sand in rooms
    double drift_length = 4.0; // in H
    double drift_height = 0.3; // at the wall, share of H
    double inside = 0.2;       // rise of the sand in a room, share of the height of its walls
    double supply = 1.0;       // share of what deposits lack that comes from outside; 0: the field is closed
    bool operator==(const RuinSettings&) const = default;
};

// What the layer did. Sand after = sand before + supplied, and given = taken + supplied, both exactly.
struct RuinResult {
    SandUnits taken = 0, given = 0, supplied = 0;
    int windward = 0, lee = 0; // faces found, one a line along the wind
    int rooms = 0;
    bool cancelled = false;
};

// A place in the frame of the wind: s along it, t across it, from the centre of the mesh.
struct RuinFrame {
    Vec2d origin = Vec2d::Zero(), along = Vec2d(1.0, 0.0), across = Vec2d(0.0, 1.0);
    Vec2d world(double s, double t) const { return origin + s * along + t * across; }
    Vec2d frame(const Vec2d& p) const { return {(p - origin).dot(along), (p - origin).dot(across)}; }
};

// The mesh by itself, in the frame of the wind (x = s, y = height, z = t), ready to be traced after the scene that it came from is gone.
class RuinMesh {
  public:
    RuinMesh(const MarramMesh& mesh, const Vec2d& wind, RTCScene scene);

    bool empty() const { return !scene_; }
    const RuinFrame& frame() const { return frame_; }
    const Vec3d& lower() const { return lower_; }
    const Vec3d& upper() const { return upper_; }
    uint64_t digest() const { return digest_; }
    struct Hit {
        double at;    // m along the ray
        Vec3d normal; // unit, outward
    };
    // All hits from `from` within `length` along the unit vector `direction`, the nearest first.
    void hits(const Vec3d& from, const Vec3d& direction, double length, std::vector<Hit>& found) const;
    // The normal of the first one, or 0.
    Vec3d first(const Vec3d& from, const Vec3d& direction, double length) const;
    bool occluded(const Vec3d& from, const Vec3d& direction, double length) const;

  private:
    RuinFrame frame_;
    Vec3d lower_ = Vec3d::Zero(), upper_ = Vec3d::Zero();
    uint64_t digest_ = 0;
    std::shared_ptr<RTCSceneTy> scene_;
};

class RuinLayer : public Layer {
  public:
    // `scene` is only asked for its device; NULL: a device of its own.
    RuinLayer(const Domain& domain, const Vec2d& wind, const MarramMesh& mesh, RTCScene scene,
              const RuinSettings& settings);

    Writes writes() const override { return {.bedrock = false, .sand = true}; }
    double reach() const override { return infinity; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    bool evaluate_whole(const Fields& below, const LayerOutput& out,
                        const std::function<bool()>& cancelled) const override;
    Tiles changed_since(const Layer& before, const Domain& domain) const override;

    // evaluate_whole, with what it did. Where it is cancelled, `sand` is a copy of what is below.
    RuinResult move_sand(const Fields& below, SandUnits* sand, const std::function<bool()>& cancelled) const;
    // Samples that it may change.
    Rect touched() const { return touched_; }

  private:
    Domain domain_;
    RuinSettings settings_; // within their ranges
    RuinMesh mesh_;
    Rect touched_;
};

LayerType ruin_layer_type();

} // namespace marram
