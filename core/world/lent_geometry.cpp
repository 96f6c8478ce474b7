// SPDX-License-Identifier: Apache-2.0
#include "core/world/lent_geometry.h"

#include "core/geometry/embree_buffer.h"
#include "core/host/geometry_graph.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

void copy(const std::vector<Vec3f>& from, float* to) {
    std::memcpy(to, from.data(), from.size() * sizeof(Vec3f));
}

std::vector<MarramAttribute> lent_attributes(const std::vector<AttributeValues>& attributes) {
    std::vector<MarramAttribute> lent;
    for (const AttributeValues& a : attributes)
        lent.push_back(
            {a.name.c_str(), a.components, a.rate, a.discrete ? 1U : 0U, "", a.data(), a.animated ? 1U : 0U});
    return lent;
}

// The fields of a frame that do not depend on lent geometry.
MarramFrame plain_frame(const Build& build, const std::vector<double>& times) {
    const BuildSettings& settings = build.settings;
    MarramFrame frame{};
    frame.size = sizeof frame;
    frame.fps = settings.fps;
    frame.frame = settings.frame;
    frame.bind_frame = settings.bind_frame;
    frame.shot_first = settings.shot_frames.x(), frame.shot_last = settings.shot_frames.y();
    frame.time_count = uint32_t(times.size());
    frame.times = times.data();
    frame.stage = settings.stage;
    frame.tolerance = settings.tolerance;
    frame.device = build.world.device.get();
    return frame;
}

} // namespace

LentGeometry::LentGeometry(Build& build, Procedural& to, std::vector<double> times)
    : geometry_(build.geometry), to_(to), times_(std::move(times)) {
    std::vector<uint32_t> ids;
    for (uint32_t id = 0; id < build.world.meshes.size(); ++id) {
        const MeshGeometry& mesh = build.world.meshes[id];
        // Curves that grow on a mesh also grow on its instances. A procedural that makes a mesh gets only the
        // mesh that it names.
        const bool use_object_name = id < build.geometry.meshes.size() && to.kind() == MARRAM_CURVES;
        const std::string& name = use_object_name ? build.geometry.meshes[id].object().name : mesh.name;
        if (!mesh.positions.empty() && depends_on_mesh(to, name, mesh.roles)) ids.push_back(id);
    }
    lists_.reserve(ids.size() + to.curves().size()); // no reallocation: elements are pointed to
    for (const uint32_t id : ids) lend_mesh(build, id);
    for (const GeometryName& name : to.curves()) lend_curves(build, name.name);
    frame_ = plain_frame(build, times_);
    // What others read is made whole.
    const auto reads_it = [&](const auto& other) { return other->names(to.name()); };
    if (to.kind() == MARRAM_CURVES && std::ranges::none_of(build.geometry.procedurals, reads_it)) {
        frame_.share = build.settings.share;
        camera_ = build.settings.camera;
        if (camera_) {
            view_ = view_of(build, *camera_);
            frame_.view = &view_;
        }
    }
    frame_.colliders = collider_scene(build, ids);
    frame_.meshes = meshes_.data();
    frame_.mesh_count = uint32_t(meshes_.size());
    frame_.mesh_stride = sizeof(MarramMesh);
    frame_.pose = pose;
    frame_.pose_user = this;
    frame_.curves = curves_.data();
    frame_.curves_count = uint32_t(curves_.size());
    frame_.curves_stride = sizeof(MarramCurves);
    frame_.pose_curves = pose_curves;
    frame_.instance_transform = instance_transform;
}

void LentGeometry::lend_mesh(Build& build, uint32_t id) {
    const MeshGeometry& mesh = build.world.meshes[id];
    Lists& list = lists_.emplace_back();
    const auto add = [&](std::vector<Vec3f> vectors, std::vector<const float*>& to) {
        // The floats do not move when posed_ grows.
        to.push_back(components(posed_.emplace_back(std::move(vectors))));
    };
    if (mesh.positions.size() == 1 || mesh.positions.size() == times_.size()) {
        for (const auto& positions : mesh.positions) list.positions.push_back(components(positions));
        for (const auto& normals : mesh.normals) list.normals.push_back(components(normals));
    } else {
        for (const double time : times_) {
            const std::span<const Vec3f> normals =
                mesh.normals.empty() ? std::span<const Vec3f>{} : mesh.normals[0];
            PosedMesh posed = pose_mesh(
                geometry_, {id, build.mesh_procedurals[id], mesh.positions[0], normals, mesh.triangles}, time,
                !mesh.normals.empty());
            add(std::move(posed.positions), list.positions);
            if (!mesh.normals.empty()) add(std::move(posed.normals), list.normals);
        }
    }
    list.attributes = lent_attributes(mesh.attributes);
    for (const GridValues& values : mesh.grids) {
        list.grids.push_back(values.grid);
        list.grids.back().name = values.name.c_str();
        list.grids.back().values = values.values.data();
    }
    MarramMesh lent{};
    lent.name = mesh.name.c_str();
    lent.geometry_id = id;
    lent.roles = mesh.roles;
    lent.vertex_count = uint32_t(mesh.positions[0].size());
    lent.triangle_count = uint32_t(mesh.triangles.size());
    lent.time_count = uint32_t(list.positions.size());
    lent.positions = list.positions.data();
    lent.normals = mesh.normals.empty() ? nullptr : list.normals.data();
    lent.triangles = components(mesh.triangles);
    lent.uvs = components(mesh.uvs);
    lent.attributes = list.attributes.data();
    lent.attribute_count = uint32_t(list.attributes.size());
    lent.attribute_stride = sizeof(MarramAttribute);
    lent.grids = list.grids.data();
    lent.grid_count = uint32_t(list.grids.size());
    lent.grid_stride = sizeof(MarramGrid);
    lent.topology = mesh.topology;
    const std::vector<SceneMesh>& drawn = geometry_.meshes;
    const bool moves = id < drawn.size() ? drawn[id].moves() : build.mesh_procedurals[id]->has_pose();
    lent.moves = lent.time_count > 1 || moves ? 1 : 0;
    if (id < drawn.size() && drawn[id].instance_of) {
        const auto object = uint32_t(drawn[id].instance_of - drawn.data());
        const auto same = std::ranges::find(meshes_, object, &MarramMesh::geometry_id);
        lent.instance_of = uint32_t(same - meshes_.begin()) + 1;
    }
    meshes_.push_back(lent);
    makers_.push_back(build.mesh_procedurals[id]);
}

void LentGeometry::lend_curves(const Build& build, const std::string& name) {
    MarramCurves lent{};
    Lists& list = lists_.emplace_back();
    const auto& drawn = geometry_.curves;
    if (const auto found = std::ranges::find(drawn, name, &SceneCurves::name); found != drawn.end()) {
        lent.name = found->name.c_str();
        lent.curve_count = found->closed.size();
        lent.offsets = found->offsets.data();
        lent.closed = found->closed.data();
        lent.basis = found->basis;
        lent.moves = found->moves() ? 1 : 0;
        list.attributes = lent_attributes(found->attributes);
        if (found->moves_within(times_.front(), times_.back())) {
            for (const double time : times_)
                list.positions.push_back(blended_.emplace_back(found->vertices_at(time)).data());
        } else if (found->moves() || !found->is_in_world()) {
            list.positions.push_back(blended_.emplace_back(found->vertices_at(times_.front())).data());
        } else {
            list.positions.push_back(found->vertices.data());
        }
    } else {
        const auto made = std::ranges::find_if(
            build.items, [&](const CurveBuild& item) { return item.curves.name == name; });
        if (made == build.items.end()) return; // no curves made: the procedural that names them reports that
        const CurveGeometry& curves = made->curves;
        lent.name = made->procedural->name().c_str();
        lent.curve_count = curves.curve_count;
        lent.cvs_per_curve = curves.cvs_per_curve;
        lent.offsets = curves.layout().offsets;
        const size_t own = curves.vertices.size();
        if (own == 1 || own == times_.size()) {
            list.positions.assign(curves.vertices.begin(), curves.vertices.end());
        } else { // at times other than its own keys: linear between its keys
            const size_t floats = 4 * curves.layout().vertex_count();
            for (const double time : times_) {
                const double at =
                    (time - times_.front()) / (times_.back() - times_.front()) * double(own - 1);
                const size_t key = std::min(size_t(at), own - 2);
                const auto share = float(at - double(key));
                std::vector<float>& blended = blended_.emplace_back(floats);
                for (size_t i = 0; i < floats; ++i)
                    blended[i] = curves.vertices[key][i] +
                                 share * (curves.vertices[key + 1][i] - curves.vertices[key][i]);
                list.positions.push_back(blended.data());
            }
        }
        lent.basis = curves.basis;
        lent.moves = own > 1 ? 1 : 0;
        list.attributes = lent_attributes(curves.attributes);
    }
    lent.time_count = uint32_t(list.positions.size());
    lent.vertices = list.positions.data();
    lent.attributes = list.attributes.data();
    lent.attribute_count = uint32_t(list.attributes.size());
    lent.attribute_stride = sizeof(MarramAttribute);
    curves_.push_back(lent);
}

PosedMesh LentGeometry::posed(uint32_t index, double frame, bool with_normals) const {
    const MarramMesh& mesh = meshes_[index];
    const auto vectors = [&](const float* floats) {
        return std::span(reinterpret_cast<const Vec3f*>(floats), mesh.vertex_count);
    };
    const std::span<const std::array<uint32_t, 3>> triangles(
        reinterpret_cast<const std::array<uint32_t, 3>*>(mesh.triangles), mesh.triangle_count);
    return pose_mesh(geometry_,
                     {mesh.geometry_id, makers_[index], vectors(mesh.positions[0]),
                      mesh.normals ? vectors(mesh.normals[0]) : std::span<const Vec3f>{}, triangles},
                     frame, with_normals);
}

MarramStatus LentGeometry::pose(void* user, uint32_t index, double frame, float* positions, float* normals) {
    LentGeometry& lent = *static_cast<LentGeometry*>(user);
    if (index >= lent.meshes_.size() || !std::isfinite(frame)) return MARRAM_ERROR;
    const MarramMesh& mesh = lent.meshes_[index];
    try {
        const PosedMesh posed = lent.posed(index, frame, normals && mesh.normals);
        copy(posed.positions, positions);
        if (normals && mesh.normals) copy(posed.normals, normals);
        return MARRAM_OK;
    } catch (const Cancelled&) {
        return MARRAM_CANCELLED;
    } catch (...) { // error of the procedural that makes the mesh, or out of memory
        lent.to_.store_exception(std::current_exception());
        return MARRAM_ERROR;
    }
}

MarramStatus LentGeometry::instance_transform(void* user, uint32_t index, double frame, double* matrix) {
    const LentGeometry& lent = *static_cast<LentGeometry*>(user);
    if (index >= lent.meshes_.size() || lent.meshes_[index].instance_of == 0 || !std::isfinite(frame))
        return MARRAM_ERROR;
    const SceneMesh& mesh = lent.geometry_.meshes[lent.meshes_[index].geometry_id];
    Eigen::Map<Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(matrix, 3, 4) =
        mesh.transform.at(frame).matrix().topRows<3>();
    return MARRAM_OK;
}

MarramStatus LentGeometry::pose_curves(void* user, uint32_t index, double frame, uint64_t first,
                                       uint64_t count, float* vertices) {
    LentGeometry& lent = *static_cast<LentGeometry*>(user);
    if (index >= lent.curves_.size() || !std::isfinite(frame)) return MARRAM_ERROR;
    const MarramCurves& curves = lent.curves_[index];
    if (first > curves.curve_count || count > curves.curve_count - first) return MARRAM_ERROR;
    try {
        const auto& drawn = lent.geometry_.curves;
        if (const auto found = std::ranges::find(drawn, std::string_view(curves.name), &SceneCurves::name);
            found != drawn.end()) {
            found->vertices_at(frame, first, count, vertices);
            return MARRAM_OK;
        }
        // Made by a procedural: linear between the motion samples, constant outside of them.
        const CurveLayout layout{curves.curve_count, curves.cvs_per_curve, curves.offsets};
        const size_t begin = 4 * layout.first_vertex(first),
                     size = 4 * layout.first_vertex(first + count) - begin;
        const double open = lent.times_.front(), close = lent.times_.back();
        const double share = close > open ? std::clamp((frame - open) / (close - open), 0.0, 1.0) : 0.0;
        const double at = share * double(curves.time_count - 1);
        const auto key = std::min(size_t(at), size_t(std::max(curves.time_count, 2U) - 2));
        const float *a = curves.vertices[key] + begin,
                    *b = curves.vertices[std::min(key + 1, size_t(curves.time_count - 1))] + begin;
        const auto rest = float(at - double(key));
        for (size_t i = 0; i < size; ++i) vertices[i] = a[i] + rest * (b[i] - a[i]);
        return MARRAM_OK;
    } catch (...) { // out of memory
        lent.to_.store_exception(std::current_exception());
        return MARRAM_ERROR;
    }
}

} // namespace marram
