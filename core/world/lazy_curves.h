// SPDX-License-Identifier: Apache-2.0
// Lazy curves: a patch is its box until a ray enters it. Then it is tessellated, and its BVH built, once, by
// whoever comes first; others wait. So what no ray meets is never made. (Bounded lazy procedurals: Cook,
// Carpenter, Catmull, "The Reyes Image Rendering Architecture", 1987, section 3; Embree's tutorial
// lazy_geometry.)
//
// Embree's scene has a user geometry whose primitives are the boxes. The callback of a box traces the ray in
// the scene of the patch, whose geometries share their vertices with CurveGeometry: these lie in reserved
// memory, at the same indices as eager ones, so a hit stands for the same primitive and is shaded by the same
// code.
//
// Curves have the bits of eager ones, since tessellate() is idempotent, and a ray has the same hits. What
// depends on all curves of a procedural (the number of straight pieces; whether those that two keys follow
// are parts of their own, curve_parts.h) is chosen from at most 64 patches: those nearest to the camera, and
// some of all others.
//
// A picture has the same bits where these choices are the same, as they are if the film sets curve_pieces and
// motion_keys. But where two straight pieces of a ribbon are hit at the same distance, at their corner (one
// ray of 30,000), the one with the smaller number counts, and of eager ones any, unless there are round
// pieces (round_pieces.h): a picture must not depend on when a patch is built. Cubics have no such rule: no
// picture has shown one that ties, but for two grooms at the same place.
//
// Boxes of patches overlap, and a ray is traced in each: half as fast as in one BVH. So after a pass, patches
// that were built are merged into the world's own scene, once they are half as many as those merged before.
// That scene's BVH is built anew, with the memory that this takes.
//
// With a budget (BuildSettings::memory), patches that rays have met least recently are evicted when the
// process comes near it: between two samples, when no thread traces a ray. They are built again when a ray
// meets them, to the same bits. Patches are merged only where the merged BVH fits as well. A ray whose
// patches do not fit with those of all other threads ends the frame with an error.
//
// Where curves move, a ray at the very edge of one may be hit in the BVH of a patch and missed in a merged
// one. So such a picture may depend, that little, on the memory that there is: one pixel differs between
//     marram render scenes/default.toml --size 320x180 --spp 4 --set film.geometry=lazy [--memory 600M]
// Curves that do not move have shown no difference.
//
// Traps: a thread that waits for a patch must not hold one; a thread that builds one must not take up another
// task of the renderer, which could meet the same patch (tbb::this_task_arena::isolate). An error cannot
// leave the callback: raise_failure() throws it, and the samples that were traced since are worth nothing. A
// cancelled frame keeps its samples, so patches are built to their end all the same.
//
// Costs a call and a second traversal for each box that a ray enters. Declared boxes are loose, as nobody
// knows yet how strands lie; so a patch that is built has the box of its contents tested first.
#pragma once

#include "core/world/curve_memory.h"
#include "core/world/curve_parts.h"

#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace marram {

class LazyWorld;

// The curves of one procedural. Its own address is the user data of Embree's geometry.
class LazyCurves {
  public:
    // item: with its patches' boxes; those it has looked at are made already. traced: all of it in reserved
    // memory. set: index in World::curves, where they are already. end_key_hit_id: what hits name as geometry of
    // those traced with two keys, if there are parts.
    LazyCurves(const Build& build, LazyWorld& world, CurveBuild item, TracedVertices traced, uint32_t set,
               uint32_t end_key_hit_id, bool spans);
    ~LazyCurves();
    LazyCurves(const LazyCurves&) = delete;
    LazyCurves& operator=(const LazyCurves&) = delete;

    // Attaches the boxes to the world scene.
    void attach(Build& build);

    // No ray may be traced meanwhile.
    uint64_t merged_patches() const { return merged_patches_; }
    uint64_t unmerged_patches() const { return unmerged_patches_; }
    void merge(RTCScene scene); // then commit it
    void restore_round_marks(); // after that
    double merged_reach() const { return merged_reach_; }
    uint64_t largest_patch_bytes() const;
    uint64_t merged_bvh_bytes() const; // about, also while it is built, if all built patches were merged

    // Patches that can be evicted, with the turn in which a ray met them last (LazyWorld::turn). No ray may be
    // traced while they are.
    struct Built {
        uint32_t met = 0, index = 0;
        LazyCurves* curves = nullptr;
    };
    void list_built(std::vector<Built>& patches);
    void evict(uint32_t index);
    void evict_merged(RTCScene scene); // then commit it

    // Adds what procedurals report, and the bytes of patches that were built.
    void add_to(BuildStats& stats) const;

  private:
    // tessellated: without a BVH. built: has a scene of its own. merged: part of the world's.
    enum State : uint32_t { absent, tessellated, building, built, merged, failed };
    struct Patch {
        std::atomic<uint32_t> state{absent};
        RTCScene scene = nullptr;
        std::vector<std::unique_ptr<PatchPart>> parts{};
        std::atomic<uint32_t> met{0}; // see Built
        uint32_t builds = 0;
        uint64_t bytes = 0; // without its BVH
        double reach = 0.0; // as World::reach
        Box3f box;          // of what is traced, at every motion key: smaller than the one declared before
    };

    // The patch, built; nullptr if the ray misses what is in it, or building has failed.
    const Patch* patch_for_ray(uint32_t index, const RTCRay& ray);
    void build(uint32_t index, bool is_tessellated);
    void forget(uint32_t index);
    void update_boxes();
    void detach_merged(RTCScene scene);
    TracedVertices traced_of(uint32_t index) const;
    uint64_t first_vertex(uint64_t curve) const; // of what is traced
    template <typename Visit>
    void for_vertices_of(const MarramPatch& patch, Visit&& visit); // visit(radius), of what is traced
    static void bounds(const RTCBoundsFunctionArguments* args);
    static void intersect(const RTCIntersectFunctionNArguments* args);
    static void occluded(const RTCOccludedFunctionNArguments* args);

    CurveBuild item_;
    TracedVertices traced_;
    uint32_t set_, curve_id_, end_key_hit_id_, pieces_;
    bool spans_;
    double end_key_limit_;
    View view_;
    std::shared_ptr<RTCDeviceTy> device_;
    std::shared_ptr<DeviceState> device_state_;
    LazyWorld& world_;
    std::unique_ptr<Patch[]> patches_;
    std::vector<uint32_t> boxes_; // [primitive of the boxes' geometry] its patch
    RTCGeometry box_geometry_ = nullptr;
    // Of merged patches, as World::curve_parts knows them: primitives of curves with all keys, and with two.
    std::shared_ptr<std::vector<uint32_t>> merged_[2] = {std::make_shared<std::vector<uint32_t>>(),
                                                         std::make_shared<std::vector<uint32_t>>()};
    unsigned merged_id_ = 0; // the first
    std::vector<unsigned> attached_;
    uint64_t merged_patches_ = 0;
    double merged_reach_ = 0.0;
    // Patches that have been built, how often more than once, and those that are built but not merged; bytes of
    // what is built, without BVHs.
    std::atomic<uint64_t> built_{0}, rebuilt_{0}, unmerged_patches_{0}, bytes_{0};
    uint64_t evicted_ = 0;
    CurveMemory memory_;                                  // of all patches
    std::atomic<uint64_t> chain_time_{0}, build_time_{0}; // ns of threads: tessellate alone, and with the BVH
};

// All lazy curves of a world, and what their procedurals read.
class LazyWorld : public LazyGeometry {
  public:
    LazyWorld(std::shared_ptr<RTCSceneTy> scene, std::shared_ptr<DeviceState> device_state)
        : scene_(std::move(scene)), device_state_(std::move(device_state)) {}
    ~LazyWorld() override;
    void raise_failure() override;
    void merge_built_patches() override;
    void evict_patches() override;
    void fail(std::exception_ptr exception);
    // Call it when the world is built. Throws InputError if not even a few patches fit.
    void set_budget(const MemoryBudget& memory);
    // Before a patch is built. Throws InputError if there is no memory for it.
    void check_budget();
    // Grows as patches are built.
    uint32_t turn() const { return builds_.load(std::memory_order_relaxed) / 16; }

    std::vector<std::shared_ptr<LentGeometry>> lent; // to mesh procedurals, which pose their meshes meanwhile
    std::vector<Procedural*> procedurals;            // that run to their end although the frame is cancelled
    std::vector<std::unique_ptr<LazyCurves>> curves;
    // Vertices of eager round pieces, and how many: their radii are negative (mark_round_pieces) but while the
    // scene is committed.
    std::vector<std::pair<float*, size_t>> round_pieces;
    double merging = 0.0; // seconds

    // Evicts patches until no more than so many bytes are resident, or all are evicted. No ray may be traced.
    void evict(uint64_t down_to);

  private:
    void commit(); // scene_, which has eager round pieces

    // Resident bytes: the budget; from where on, and down to where, patches are evicted. 0: no budget.
    uint64_t limit_ = 0, high_ = 0, low_ = 0;
    uint64_t largest_patch_ = 0; // bytes
    std::atomic<uint32_t> builds_{0};
    std::shared_ptr<RTCSceneTy> scene_;
    std::shared_ptr<DeviceState> device_state_;
    std::mutex lock_;
    std::exception_ptr thrown_; // the first
};

// After rays were traced: what procedurals report of lazy curves, how many patches were built.
void add_lazy_stats(const World& world, BuildStats& stats);

} // namespace marram
