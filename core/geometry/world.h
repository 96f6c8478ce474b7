// SPDX-License-Identifier: Apache-2.0
// The world of one frame as Embree sees it: two scenes that share the collider geometries. Plain data but for
// `lazy`, built by core/world/build.h and read by the path tracer.
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/geometry/curve_layout.h"
#include "core/geometry/mesh.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <oneapi/tbb/rw_mutex.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <shared_mutex>
#include <string>
#include <vector>

namespace marram {

// A bit of Embree masks, beside those of MarramRole: meshes that cast shadows on shadow catchers. Catchers do
// not have it.
inline constexpr uint32_t darkens_catchers = 1U << 16;

// A mesh at the motion samples of the frame, in world space. Its geometry ID is its index in World::meshes.
struct MeshGeometry {
    std::string name;
    int material = -1; // index into the scene's materials
    int light = -1;    // index into the scene's lights if it emits, else -1
    std::vector<std::array<uint32_t, 3>> triangles;
    std::vector<Vec2f> uvs; // empty, or one per vertex
    std::vector<std::vector<Vec3f>>
        positions; // [time], one (at rest) or more, equally spaced over the shutter; spare bytes behind each
    std::vector<std::vector<Vec3f>> normals;   // [time], unit; empty: facetted
    std::vector<AttributeValues> attributes{}; // per vertex or per face
    std::vector<GridValues> grids{};
    uint32_t roles = MARRAM_ALL_ROLES;
    bool shadow_catcher = false; // the camera sees only the shadows on it
    uint64_t topology = 0;       // digest of its triangles
    uint64_t digest = 0;         // same geometry ID and digest in two frames: the same mesh; 0: unknown
};

// The curves of one procedural. Their geometry ID is World::meshes.size() + their index in World::curves;
// Embree knows them by that ID or, if they have parts, only by those of the parts.
// CurveLayout gives the indices of each curve's vertices and segments. Embree's primitive p is segment p of
// all curves; with n pieces per segment it is piece p % n of segment p / n.
struct CurveGeometry {
    std::string name;
    int material = -1;
    MarramBasis basis = MARRAM_BSPLINE;
    MarramShape shape = MARRAM_ROUND;
    uint64_t curve_count = 0;
    uint64_t all_curves = 0;       // without BuildSettings::share; more than curve_count if it left some out
    uint32_t cvs_per_curve = 0;    // 0: curves differ, see offsets
    std::vector<uint64_t> offsets; // [curve_count + 1] of first CVs; empty if all have as many
    std::vector<uint32_t> curve_of_segment; // if there are offsets
    uint32_t pieces = 0;                    // straight pieces per segment; 0: the cubic (curve_pieces.h)
    std::vector<const float*>
        vertices; // [time] x, y, z, radius; owned by Embree; one (at rest) or more keys of its own
    std::vector<const float*> normals; // [time], 3 floats a vertex; oriented ribbons only
    std::vector<float*>
        round_pieces; // [time] traced pieces: (segments * pieces + 1) vertices per curve; else empty
    std::vector<AttributeValues> attributes;
    std::vector<char>
        end_keys_only; // [curve]: 1 if it is traced with its first and last key; empty: none is, or lazy
    bool lazy = false; // a patch's vertices and attributes are 0 until a ray has met it

    CurveLayout layout() const {
        return {curve_count, cvs_per_curve, offsets.empty() ? nullptr : offsets.data()};
    }
};

// Some primitives of a CurveGeometry as an Embree geometry of their own (core/world/curve_parts.h). Its ID is
// World::meshes.size() + World::curves.size() + its index in World::curve_parts.
struct CurvePart {
    uint32_t curves = 0; // index in World::curves
    // [of the part]: primitive of the CurveGeometry; nullptr: the same
    std::shared_ptr<const std::vector<uint32_t>> primitives;
    bool end_keys_only = false;             // moves linearly from the first key to the last
    std::shared_ptr<RTCGeometryTy> owner{}; // of the vertices
};

// Some curves of a built patch as a geometry of the patch's own scene (core/world/lazy_curves.h): its user
// data.
struct PatchPart {
    uint32_t curves = 0;          // index in World::curves
    uint32_t first_primitive = 0; // of the patch in that CurveGeometry
    std::vector<uint32_t>
        primitives{};           // [of the part]: primitive of the CurveGeometry; empty: from the first on
    bool end_keys_only = false; // as CurvePart
};

// The lazy curves of a world, which change while rays are traced (core/world/lazy_curves.h).
class LazyGeometry {
  public:
    virtual ~LazyGeometry() = default;
    // Whether something has failed while rays were traced, which raise_failure() then throws: samples that
    // were traced since may be wrong.
    bool failed() const { return failed_.load(std::memory_order_relaxed); }
    virtual void raise_failure() = 0;
    // Call between passes, when no ray is traced: later ones are faster.
    virtual void merge_built_patches() = 0;
    // Held from tracing a ray to the last look at what it hit: no patch is evicted meanwhile.
    [[nodiscard]] std::shared_lock<tbb::rw_mutex> keep() { return std::shared_lock(in_use_); }
    // Whether patches are to be evicted, as memory is short. Ask it often: let go of keep(), call
    // evict_patches(), and take keep() again.
    bool is_short() const { return short_.load(std::memory_order_relaxed); }
    virtual void evict_patches() = 0;
    double reach = 0.0; // as World::reach, of what has become part of the world's own scene

  protected:
    std::atomic<bool> failed_{false}, short_{false};
    tbb::rw_mutex in_use_; // a thread that waits to write goes first
};

struct DeviceState;

// Key: the geometry IDs of the meshes in the scene, ascending.
using ColliderScenes = std::map<std::vector<uint32_t>, std::shared_ptr<RTCSceneTy>>;

struct World {
    std::shared_ptr<RTCDeviceTy> device;
    std::shared_ptr<DeviceState> device_state; // the device's
    ColliderScenes collider_scenes;            // of growth surfaces, one for each set that is traced
    std::shared_ptr<RTCSceneTy> colliders;     // all meshes; empty if no strands are made
    std::shared_ptr<RTCSceneTy>
        scene; // meshes as the camera sees them, and curves: rays are traced against it
    double frame = 0.0;
    // Motion sample times in frames, equally spaced, as many as any geometry has; ray time 0 ... 1 runs from
    // first to last.
    std::vector<double> times;
    std::vector<MeshGeometry> meshes; // as the camera sees them: render meshes if there are any
    std::map<uint32_t, MeshGeometry> growth_surfaces; // by geometry ID, of meshes with a render mesh
    std::vector<CurveGeometry> curves;
    std::vector<CurvePart> curve_parts;
    bool filtered = false; // hits are (round_pieces.h): there are round pieces, or lazy straight ones
    double reach = 0.0;    // largest length + radius of a round piece, m (round_pieces.h)
    Box3f bounds;          // of meshes, and of the boxes of patches, at every motion sample
    std::vector<std::shared_ptr<RTCGeometryTy>> curve_buffers; // [curves] own what it points into
    std::shared_ptr<LazyGeometry> lazy;                        // nullptr: all curves were made before

    // The mesh that strands grow on and collide with.
    const MeshGeometry& growth_surface(uint32_t mesh) const {
        const auto found = growth_surfaces.find(mesh);
        return found != growth_surfaces.end() ? found->second : meshes[mesh];
    }
};

// What Embree's IDs of a hit on a curve stand for.
struct CurvePrimitive {
    uint32_t curves;    // index in World::curves
    uint32_t primitive; // of that CurveGeometry
    bool end_keys_only; // see CurvePart
};

inline CurvePrimitive curve_primitive(const World& world, uint32_t geometry, uint32_t primitive) {
    const size_t index = geometry - world.meshes.size();
    if (index < world.curves.size()) return {uint32_t(index), primitive, false};
    const CurvePart& part = world.curve_parts[index - world.curves.size()];
    return {part.curves, part.primitives ? (*part.primitives)[primitive] : primitive, part.end_keys_only};
}

inline CurvePrimitive curve_primitive(const PatchPart& part, uint32_t primitive) {
    return {part.curves,
            part.primitives.empty() ? part.first_primitive + primitive : part.primitives[primitive],
            part.end_keys_only};
}

} // namespace marram
