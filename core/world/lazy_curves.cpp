// SPDX-License-Identifier: Apache-2.0
#include "core/world/lazy_curves.h"

#include "core/geometry/cubic.h"
#include "core/geometry/reserved_memory.h"
#include "core/math/clock.h"
#include "core/math/resident_memory.h"
#include "core/trace/curve_pieces.h"
#include "core/trace/round_pieces.h"
#include "core/world/curve_memory.h"
#include "core/world/lent_geometry.h"

#include <fmt/format.h>
#include <malloc.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

namespace marram {
namespace {

// Least number of patches a thread for which there must be memory: rays of a few pixels meet more, but evicting
// is what makes room.
constexpr uint64_t patches_at_once = 8;

// Whether a ray meets a box.
bool meets(const Box3f& box, const RTCRay& ray) {
    const double origin[3] = {ray.org_x, ray.org_y, ray.org_z},
                 direction[3] = {ray.dir_x, ray.dir_y, ray.dir_z};
    double from = ray.tnear, to = ray.tfar;
    for (int axis = 0; axis < 3; ++axis) {
        const double inverse = 1.0 / direction[axis];
        const double a = (double(box.min()[axis]) - origin[axis]) * inverse,
                     b = (double(box.max()[axis]) - origin[axis]) * inverse;
        // Not a number (0 / 0: in the plane of a side): the axis does not decide.
        from = std::max(from, a < b ? a : b < a ? b : from);
        to = std::min(to, a < b ? b : b < a ? a : to);
    }
    return from <= to;
}

// The box of some vertices and of their curves, which leave the hull of Catmull-Rom vertices.
Box3f box_of(const TracedVertices& traced, const CurveBuild& item, bool pieces) {
    Box3f box;
    float radius = 0.0F, step = 0.0F; // step: largest from a vertex to the next but one
    for (const float* vertices : traced.vertices)
        for (size_t v = 0; v < traced.vertex_count; ++v) {
            const auto at = [&](size_t i) { return Vec3f::Map(vertices + 4 * i); };
            box.extend(at(v));
            radius = std::max(radius, std::abs(vertices[4 * v + 3]));
            if (v + 2 < traced.vertex_count) step = std::max(step, (at(v + 2) - at(v)).cwiseAbs().maxCoeff());
        }
    // An oriented ribbon's half-width is a cubic through its ends; Catmull-Rom radii leave their hull too.
    float more = 2.0F * radius;
    // The Bezier points of a Catmull-Rom segment are this far from its ends.
    if (!pieces && item.output.basis == MARRAM_CATMULL_ROM) more += step / 6.0F;
    more += 0x1p-20F * std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff());
    return {box.min().array() - more, box.max().array() + more};
}

// Rays find only what is in the box: refuses curves that leave it, by the balls at the ends of their
// segments.
void check_box(const CurveBuild& item, const MarramPatch& patch) {
    const CurveLayout layout = item.layout();
    const Box3f box = padded_box(patch);
    const std::array<double, 4> weights = cubic_basis(item.output.basis, 0.0).value;
    for (const float* vertices : item.vertices)
        for (uint64_t c = patch.first_curve; c < patch.first_curve + patch.curve_count; ++c)
            for (uint32_t k = 0; k < layout.cvs(c); ++k) {
                const float* v = vertices + 4 * (layout.first_vertex(c) + k);
                const Vec4f point = float(weights[0]) * Vec4f::Map(v) +
                                    float(weights[1]) * Vec4f::Map(v + 4) +
                                    float(weights[2]) * Vec4f::Map(v + 8);
                const Vec3f axis = point.head<3>(), radius = Vec3f::Constant(std::abs(point[3]));
                if (!box.contains(Vec3f(axis - radius)) || !box.contains(Vec3f(axis + radius)))
                    item.procedural->refuse(
                        fmt::format("its curve {} leaves the box of its patch, and rays would miss it", c),
                        "film.geometry = \"eager\", or fix the library");
            }
}

} // namespace

LazyCurves::LazyCurves(const Build& build, LazyWorld& world, CurveBuild item, TracedVertices traced,
                       uint32_t set, uint32_t end_key_hit_id, bool spans)
    : item_(std::move(item)), traced_(std::move(traced)), set_(set),
      curve_id_(uint32_t(build.world.meshes.size()) + set), end_key_hit_id_(end_key_hit_id),
      pieces_(build.world.curves[set].pieces), spans_(spans && item_.has_parts),
      end_key_limit_(end_key_limit(build.settings)), view_(build.settings.view), device_(build.world.device),
      device_state_(build.world.device_state), world_(world),
      patches_(std::make_unique<Patch[]>(item_.patches.size())) {
    memory_ = curve_memory(item_, pieces_);
    for (const uint32_t index : item_.sample_patches) patches_[index].state = tessellated;
    boxes_.resize(item_.patches.size());
    std::iota(boxes_.begin(), boxes_.end(), 0U);
}

// Of what is written of a patch, besides its BVH.
void LazyCurves::forget(uint32_t index) {
    const MarramPatch& of = item_.patches[index];
    const CurveLayout layout = item_.layout();
    const auto give_back = [](float* values, uint64_t begin, uint64_t end, size_t components) {
        ReservedMemory::give_back(values + begin * components, (end - begin) * components * sizeof(float));
    };
    const uint64_t end_curve = of.first_curve + of.curve_count, begin = layout.first_vertex(of.first_curve),
                   end = layout.first_vertex(end_curve);
    for (float* vertices : item_.vertices) give_back(vertices, begin, end, 4);
    for (float* normals : item_.normals) give_back(normals, begin, end, 3);
    if (pieces_ > 0)
        for (float* vertices : traced_.vertices)
            give_back(vertices, first_vertex(of.first_curve), first_vertex(end_curve), 4);
    for (size_t a = 0; a < item_.attributes.size(); ++a) {
        const MarramAttribute& attribute = item_.procedural->attributes()[item_.attributes[a]];
        const bool per_cv = attribute.rate == MARRAM_PER_CV;
        give_back(item_.attribute_values[a], per_cv ? layout.first_cv(of.first_curve) : of.first_curve,
                  per_cv ? layout.first_cv(end_curve) : end_curve, attribute.components);
    }
    Patch& patch = patches_[index];
    bytes_ -= std::exchange(patch.bytes, 0);
    ++evicted_;
    patch.state.store(absent, std::memory_order_relaxed);
}

void LazyCurves::list_built(std::vector<Built>& patches) {
    for (const uint32_t index : boxes_)
        if (patches_[index].state.load(std::memory_order_relaxed) == built)
            patches.push_back({patches_[index].met.load(std::memory_order_relaxed), index, this});
}

void LazyCurves::evict(uint32_t index) {
    Patch& patch = patches_[index];
    rtcReleaseScene(std::exchange(patch.scene, nullptr));
    patch.parts = std::vector<std::unique_ptr<PatchPart>>();
    --unmerged_patches_;
    forget(index);
}

LazyCurves::~LazyCurves() {
    for (size_t i = 0; i < item_.patches.size(); ++i)
        if (patches_[i].scene) rtcReleaseScene(patches_[i].scene);
    if (box_geometry_) rtcReleaseGeometry(box_geometry_);
}

void LazyCurves::attach(Build& build) {
    box_geometry_ = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(box_geometry_, unsigned(boxes_.size()));
    rtcSetGeometryUserData(box_geometry_, this);
    rtcSetGeometryBoundsFunction(box_geometry_, bounds, nullptr);
    rtcSetGeometryIntersectFunction(box_geometry_, intersect);
    rtcSetGeometryOccludedFunction(box_geometry_, occluded);
    attach_geometry(build, box_geometry_, curve_id_);
    build.check_device();
    // IDs of what patches are merged into.
    merged_id_ = unsigned(build.world.meshes.size() + build.items.size() + build.world.curve_parts.size());
    for (const bool end_keys_only : {true, false}) {
        if (end_keys_only && !item_.has_parts) continue;
        for (size_t i = 0; i < part_keys(traced_.vertices.size(), end_keys_only, spans_).size(); ++i)
            build.world.curve_parts.push_back({set_, merged_[end_keys_only ? 1 : 0], end_keys_only});
    }
}

void LazyCurves::bounds(const RTCBoundsFunctionArguments* args) {
    const auto& self = *static_cast<const LazyCurves*>(args->geometryUserPtr);
    const Box3f box = padded_box(self.item_.patches[self.boxes_[args->primID]]);
    *args->bounds_o = {box.min().x(), box.min().y(), box.min().z(), 0.0F,
                       box.max().x(), box.max().y(), box.max().z(), 0.0F};
}

void LazyCurves::intersect(const RTCIntersectFunctionNArguments* args) {
    auto& self = *static_cast<LazyCurves*>(args->geometryUserPtr);
    if (args->valid[0] == 0) return;
    auto& query = *reinterpret_cast<RTCRayHit*>(args->rayhit);
    const Patch* patch = self.patch_for_ray(self.boxes_[args->primID], query.ray);
    if (!patch) return;
    const RTCHit before = query.hit;
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    intersect_patch(args, patch->scene, patch->reach, query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        query.hit = before;
        return;
    }
    const PatchPart& part = *patch->parts[query.hit.geomID];
    query.hit.primID = curve_primitive(part, query.hit.primID).primitive;
    query.hit.geomID = part.end_keys_only ? self.end_key_hit_id_ : self.curve_id_;
}

void LazyCurves::occluded(const RTCOccludedFunctionNArguments* args) {
    auto& self = *static_cast<LazyCurves*>(args->geometryUserPtr);
    if (args->valid[0] == 0) return;
    auto& ray = *reinterpret_cast<RTCRay*>(args->ray);
    if (const Patch* patch = self.patch_for_ray(self.boxes_[args->primID], ray))
        occluded_patch(args, patch->scene, patch->reach, ray);
}

const LazyCurves::Patch* LazyCurves::patch_for_ray(uint32_t index, const RTCRay& ray) {
    Patch& patch = patches_[index];
    uint32_t state = patch.state.load(std::memory_order_acquire);
    while (state != built) {
        if (state == failed) return nullptr;
        if (state == building) {
            patch.state.wait(building, std::memory_order_acquire);
            state = patch.state.load(std::memory_order_acquire);
            continue;
        }
        if (!patch.state.compare_exchange_strong(state, building, std::memory_order_acquire)) continue;
        const bool is_tessellated = state == tessellated;
        try {
            tbb::this_task_arena::isolate([&] { build(index, is_tessellated); });
            state = built;
        } catch (...) {
            world_.fail(std::current_exception());
            state = failed;
        }
        patch.state.store(state, std::memory_order_release);
        patch.state.notify_all();
    }
    if (!meets(patch.box, ray)) return nullptr;
    if (const uint32_t turn = world_.turn(); patch.met.load(std::memory_order_relaxed) != turn)
        patch.met.store(turn, std::memory_order_relaxed);
    return &patch;
}

// The vertices of one patch: pointers to its first, and how many.
TracedVertices LazyCurves::traced_of(uint32_t index) const {
    const MarramPatch& patch = item_.patches[index];
    const uint64_t first = first_vertex(patch.first_curve);
    TracedVertices traced = traced_;
    traced.vertex_count = first_vertex(patch.first_curve + patch.curve_count) - first;
    for (float*& vertices : traced.vertices) vertices += 4 * first;
    for (float*& normals : traced.normals) normals += 3 * first;
    return traced;
}

void LazyCurves::build(uint32_t index, bool is_tessellated) {
    const double begin = wall_seconds();
    world_.check_budget();
    Patch& patch = patches_[index];
    const MarramPatch& of = item_.patches[index];
    const CurveLayout layout = item_.layout();
    if (!is_tessellated) tessellate_patch(item_, index);
    chain_time_ += uint64_t(1e9 * (wall_seconds() - begin));
    check_box(item_, of);
    const TracedVertices traced = traced_of(index);
    const size_t keys = traced.vertices.size();
    uint64_t bytes =
        (layout.first_vertex(of.first_curve + of.curve_count) - layout.first_vertex(of.first_curve)) * keys *
        (traced.normals.empty() ? 16 : 28);
    patch.reach = 0.0;
    if (pieces_ > 0) {
        bytes += traced.vertex_count * keys * 16;
        const size_t first = 4 * layout.first_vertex(of.first_curve);
        for (size_t t = 0; t < keys; ++t) {
            write_pieces(
                {item_.vertices[t] + first, of.curve_count, item_.output.cvs_per_curve, item_.output.basis},
                item_.vertices[0] + first, pieces_, traced.vertices[t]);
            if (item_.output.shape == MARRAM_ROUND)
                patch.reach =
                    std::max(patch.reach, reach_of(traced.vertices[t], of.curve_count, traced.segments));
        }
    }
    std::vector<char> marks(of.curve_count);
    if (item_.has_parts) mark_end_key_curves(item_, of, end_key_limit_, view_, marks.data());
    RTCScene scene = rtcNewScene(device_.get());
    patch.scene = scene;
    rtcSetSceneFlags(scene, MARRAM_SCENE_FILTER);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    for (const char end_keys_only : {char(1), char(0)}) {
        PartIndices indices = part_indices(item_, traced, of.first_curve, marks, end_keys_only);
        if (indices.vertices.empty()) continue;
        const uint32_t first = indices.primitives.front();
        const bool all = !item_.has_parts;
        for (const std::vector<size_t>& with : part_keys(keys, end_keys_only != 0, spans_)) {
            const auto geometry = part_geometry(device_.get(), traced, indices.vertices, with);
            PatchPart& part = *patch.parts.emplace_back(std::make_unique<PatchPart>());
            part = {set_, first, all ? std::vector<uint32_t>{} : indices.primitives, end_keys_only != 0};
            rtcSetGeometryUserData(geometry.get(), &part);
            rtcSetGeometryMask(geometry.get(), curve_mask);
            rtcCommitGeometry(geometry.get());
            rtcAttachGeometryByID(scene, geometry.get(), unsigned(patch.parts.size() - 1));
            bytes += indices.vertices.size() * (all ? 4 : 8);
        }
    }
    for (const uint32_t a : item_.attributes) {
        const MarramAttribute& attribute = item_.procedural->attributes()[a];
        bytes += attribute.components * sizeof(float) *
                 (attribute.rate == MARRAM_PER_CV
                      ? layout.first_cv(of.first_curve + of.curve_count) - layout.first_cv(of.first_curve)
                      : of.curve_count);
    }
    rtcCommitScene(scene);
    raise(*device_state_);
    patch.box = box_of(traced, item_, pieces_ > 0);
    if (patch.reach > 0.0)
        for (size_t t = 0; t < keys; ++t) mark_round_vertices(traced.vertices[t], traced.vertex_count);
    ++(patch.builds++ == 0 ? built_ : rebuilt_);
    ++unmerged_patches_;
    patch.bytes = bytes;
    bytes_ += bytes;
    build_time_ += uint64_t(1e9 * (wall_seconds() - begin));
}

void LazyCurves::merge(RTCScene scene) {
    std::vector<uint32_t> vertices[2];
    for (const auto& primitives : merged_) primitives->clear();
    merged_patches_ = unmerged_patches_ = 0;
    for (uint32_t i = 0; i < item_.patches.size(); ++i) {
        Patch& patch = patches_[i];
        const uint32_t state = patch.state.load(std::memory_order_relaxed);
        if (state != built && state != merged) continue;
        ++merged_patches_;
        patch.state.store(merged, std::memory_order_relaxed);
        if (patch.scene) rtcReleaseScene(std::exchange(patch.scene, nullptr));
        patch.parts = std::vector<std::unique_ptr<PatchPart>>();
        merged_reach_ = std::max(merged_reach_, patch.reach);
        const MarramPatch& of = item_.patches[i];
        if (patch.reach > 0.0) // Embree wants radii that are not negative when it builds
            for_vertices_of(of, [](float* radius) { *radius = std::abs(*radius); });
        std::vector<char> marks(of.curve_count);
        if (item_.has_parts) mark_end_key_curves(item_, of, end_key_limit_, view_, marks.data());
        for (const char end_keys_only : {char(1), char(0)}) {
            const PartIndices indices = part_indices(item_, traced_, of.first_curve, marks, end_keys_only);
            const auto first = uint32_t(first_vertex(of.first_curve));
            for (const uint32_t vertex : indices.vertices)
                vertices[size_t(end_keys_only)].push_back(first + vertex);
            std::ranges::copy(indices.primitives, std::back_inserter(*merged_[size_t(end_keys_only)]));
        }
    }
    detach_merged(scene);
    unsigned id = merged_id_;
    for (const bool end_keys_only : {true, false}) {
        if (end_keys_only && !item_.has_parts) continue;
        for (const std::vector<size_t>& with : part_keys(traced_.vertices.size(), end_keys_only, spans_)) {
            const std::vector<uint32_t>& of_part = vertices[end_keys_only ? 1 : 0];
            if (!of_part.empty()) {
                const auto geometry = part_geometry(device_.get(), traced_, of_part, with);
                rtcSetGeometryMask(geometry.get(), curve_mask);
                rtcCommitGeometry(geometry.get());
                rtcAttachGeometryByID(scene, geometry.get(), id);
                attached_.push_back(id);
            }
            ++id;
        }
    }
    update_boxes();
}

void LazyCurves::detach_merged(RTCScene scene) {
    for (const unsigned id : std::exchange(attached_, {})) rtcDetachGeometry(scene, id);
}

// Of patches that are not merged.
void LazyCurves::update_boxes() {
    boxes_.clear();
    for (uint32_t i = 0; i < item_.patches.size(); ++i)
        if (patches_[i].state.load(std::memory_order_relaxed) != merged) boxes_.push_back(i);
    rtcSetGeometryUserPrimitiveCount(box_geometry_, unsigned(boxes_.size()));
    rtcCommitGeometry(box_geometry_);
}

void LazyCurves::evict_merged(RTCScene scene) {
    detach_merged(scene);
    for (const auto& primitives : merged_) *primitives = std::vector<uint32_t>();
    for (uint32_t i = 0; i < item_.patches.size(); ++i)
        if (patches_[i].state.load(std::memory_order_relaxed) == merged) forget(i);
    merged_patches_ = 0;
    update_boxes();
}

void LazyCurves::restore_round_marks() {
    for (size_t i = 0; i < item_.patches.size(); ++i)
        if (patches_[i].state.load(std::memory_order_relaxed) == merged && patches_[i].reach > 0.0)
            for_vertices_of(item_.patches[i], [](float* radius) { *radius = -std::abs(*radius); });
}

uint64_t LazyCurves::largest_patch_bytes() const {
    const CurveLayout layout = item_.layout();
    uint64_t largest = 0; // vertices
    for (const MarramPatch& patch : item_.patches)
        largest = std::max<uint64_t>(largest, layout.first_vertex(patch.first_curve + patch.curve_count) -
                                                  layout.first_vertex(patch.first_curve));
    return uint64_t(double(memory_.total()) * double(largest) / double(layout.vertex_count()));
}

uint64_t LazyCurves::merged_bvh_bytes() const {
    const double share = double(unmerged_patches_ + merged_patches_) / double(item_.patches.size());
    return uint64_t(share * double(memory_.bvh + memory_.building));
}

uint64_t LazyCurves::first_vertex(uint64_t curve) const {
    return traced_.segments > 0 ? curve * traced_.stride : item_.layout().first_vertex(curve);
}

template <typename Visit>
void LazyCurves::for_vertices_of(const MarramPatch& patch, Visit&& visit) {
    const uint64_t begin = first_vertex(patch.first_curve),
                   end = first_vertex(patch.first_curve + patch.curve_count);
    for (float* vertices : traced_.vertices)
        for (uint64_t v = begin; v < end; ++v) visit(vertices + 4 * v + 3);
}

void LazyWorld::raise_failure() {
    if (failed()) std::rethrow_exception(thrown_);
}

void LazyWorld::merge_built_patches() {
    uint64_t more = 0, merged = 0;
    for (const auto& one : curves) more += one->unmerged_patches(), merged += one->merged_patches();
    if (2 * more <= merged) return;
    if (limit_ > 0) {
        uint64_t bytes = resident_bytes();
        for (const auto& one : curves) bytes += one->merged_bvh_bytes();
        if (bytes > high_) return;
    }
    const double begin = wall_seconds();
    for (const auto& one : curves) one->merge(scene_.get());
    malloc_trim(0); // scenes of patches were allocated by all threads: none could use what another has freed
    commit();
    for (const auto& one : curves) {
        one->restore_round_marks();
        reach = std::max(reach, one->merged_reach());
    }
    merging += wall_seconds() - begin;
}

void LazyWorld::set_budget(const MemoryBudget& memory) {
    const uint64_t limit = memory.limit;
    if (limit == 0) return;
    malloc_trim(0); // what the build has freed
    const uint64_t used = resident_bytes() + memory.reserved, room = limit - std::min(used, limit);
    for (const auto& one : curves) largest_patch_ = std::max(largest_patch_, one->largest_patch_bytes());
    const uint64_t at_once =
        largest_patch_ * patches_at_once * uint64_t(tbb::this_task_arena::max_concurrency());
    if (room < at_once)
        refuse_memory(used + at_once, limit, "a few patches of strands a thread", false, "use fewer threads");
    limit_ = limit;
    // For what is built until no ray is traced: one that grazes a lawn meets dozens of patches.
    high_ = limit - std::min(std::max(room / 8, 8 * at_once), room / 4);
    low_ = high_ - room / 16;
    // BVHs of small scenes reserve memory that they do not touch: what is resident decides.
    device_state_->limit = std::numeric_limits<int64_t>::max();
}

void LazyWorld::check_budget() {
    builds_.fetch_add(1, std::memory_order_relaxed);
    if (limit_ == 0) return;
    const uint64_t used = resident_bytes();
    if (used > high_) short_.store(true, std::memory_order_relaxed);
    if (used + largest_patch_ > limit_)
        refuse_memory(limit_ + 2 * (limit_ - high_), limit_, "the strands that rays meet at the same time",
                      false, "use fewer threads");
}

void LazyWorld::evict_patches() {
    const std::unique_lock lock(in_use_);
    if (!short_.exchange(false, std::memory_order_relaxed)) return;
    try {
        tbb::this_task_arena::isolate([&] { evict(low_); }); // it may commit the scene, and holds the lock
    } catch (...) {
        fail(std::current_exception());
    }
}

// Those that were met least recently first, an eighth of all at a time: how much memory each gives back is
// known only afterwards.
void LazyWorld::evict(uint64_t down_to) {
    std::vector<LazyCurves::Built> patches;
    for (const auto& one : curves) one->list_built(patches);
    std::ranges::stable_sort(patches, {}, &LazyCurves::Built::met);
    const size_t step = patches.size() / 8 + 1;
    for (size_t i = 0; i < patches.size();) {
        for (const size_t end = std::min(i + step, patches.size()); i < end; ++i)
            patches[i].curves->evict(patches[i].index);
        malloc_trim(0); // scenes of patches were allocated by all threads
        if (resident_bytes() <= down_to) return;
    }
    if (std::ranges::none_of(curves, [](const auto& one) { return one->merged_patches() > 0; })) return;
    for (const auto& one : curves) one->evict_merged(scene_.get());
    commit();
    malloc_trim(0);
}

// Embree wants radii that are not negative when it builds.
void LazyWorld::commit() {
    for (const auto& [vertices, count] : round_pieces)
        for (size_t i = 0; i < count; ++i) vertices[4 * i + 3] = std::abs(vertices[4 * i + 3]);
    rtcCommitScene(scene_.get());
    raise(*device_state_);
    for (const auto& [vertices, count] : round_pieces) mark_round_vertices(vertices, count);
}

void LazyWorld::fail(std::exception_ptr exception) {
    const std::lock_guard guard(lock_);
    if (!thrown_) thrown_ = std::move(exception);
    failed_ = true;
}

void LazyCurves::add_to(BuildStats& stats) const {
    stats.patches += item_.patches.size();
    stats.built_patches += built_;
    stats.rebuilt_patches += rebuilt_;
    stats.evicted_patches += evicted_;
    stats.curve_bytes += bytes_;
    stats.lazy_thread_seconds += 1e-9 * double(build_time_);
    const int threads = tbb::this_task_arena::max_concurrency();
    take_report(stats, *item_.procedural, 1e-9 * double(chain_time_) / std::max(threads, 1));
}

LazyWorld::~LazyWorld() {
    for (Procedural* procedural : procedurals) procedural->set_cancellable(true);
}

void add_lazy_stats(const World& world, BuildStats& stats) {
    if (!world.lazy) return;
    const auto& lazy = static_cast<const LazyWorld&>(*world.lazy);
    for (const auto& curves : lazy.curves) curves->add_to(stats);
    stats.lazy_merging = lazy.merging;
}

} // namespace marram
