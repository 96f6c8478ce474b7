// SPDX-License-Identifier: Apache-2.0
// The border to C, as seen by a procedural: what the host lends, checked, and exceptions turned into
// messages. entry_points.h makes a procedural's entry points on top of it.
#pragma once

#include "core/math/digest.h"
#include "core/math/known_part.h"
#include "core/math/vec.h"
#include "procedural/abi/contract_checks.h"
#include "procedural/abi/parallel.h"
#include "procedural/abi/values.h"

#include <cmath>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Thrown where the host has asked to stop.
struct Cancelled {};

// Thrown where the host has been told what is wrong.
struct Reported {};

// What each instance of a procedural has.
struct Instance {
    MarramHost host{};
    bool begun = false; // a frame has begun without errors

    bool cancelled() const { return host.cancelled(host.user) != 0; }
    void stop_if_cancelled() const {
        if (cancelled()) throw Cancelled();
    }
};

// Statistics to the host, by the paths that its procedural declares.
struct ReportSink {
    void (*sink)(void* user, const char* path, double value) = nullptr;
    void* user = nullptr;
    void operator()(const char* path, double value) const { sink(user, path, value); }
    void operator()(const std::string& path, double value) const { sink(user, path.c_str(), value); }
};

// Sends the message of the exception that is being handled.
MarramStatus report_exception(const MarramHost& host, const std::string& subject, const char* memory_remedy);

// Runs the body of a call, its loops on the host's executor, and turns exceptions into messages to the host.
// subject: e.g. "groom", for message ids and texts. memory_remedy: what to do if memory runs out. Returns
// MARRAM_ERROR without a message if there is no memory for one.
template <typename Body>
MarramStatus guarded(const MarramHost& host, const char* subject, const char* memory_remedy,
                     Body&& body) noexcept {
    try {
        const ExecutorScope executor(&host);
        try {
            body();
            return MARRAM_OK;
        } catch (const Cancelled&) {
            return MARRAM_CANCELLED;
        } catch (const Reported&) {
            return MARRAM_ERROR;
        } catch (...) {
            return report_exception(host, subject, memory_remedy);
        }
    } catch (...) {
        return MARRAM_ERROR;
    }
}

// True if create() has a host with its callbacks and a place for the instance. Reports what is missing if the
// host can receive messages.
inline bool can_create(const MarramHost* host, MarramInstance** out) {
    if (!host || !MARRAM_HAS(host, message) || !host->message) return false; // no host to report to
    const MarramHost known = known_part(host);
    if (!known.cancelled)
        send(known, MARRAM_FAULT, "contract.null_callback", "", "MarramHost.cancelled is NULL",
             "give a function that returns 0");
    if (!out)
        send(known, MARRAM_FAULT, "contract.null_output", "", "there is no place for the instance",
             "pass a non-NULL pointer");
    return known.cancelled && out;
}

// Adds the placement stored in an image's file, if any.
inline void add_placement(Digest& digest, const MarramPlacement* given) {
    if (!given) return;
    const MarramPlacement placement = known_part(given);
    digest.add(&placement, sizeof placement);
}

// Adds where a volume's numbers are, not what they are: volumes are not copied, so an instance needs the new
// place even of the same numbers.
inline void add_volume(Digest& digest, const MarramVolume* given) {
    if (!given) return;
    const MarramVolume volume = known_part(given);
    digest.add(volume.staggered).add(volume.count);
    if (volume.frames) digest.add(volume.frames, volume.count * sizeof(double));
    for (const MarramGrid& grid : known_parts(volume.grids, volume.count, volume.grid_stride))
        digest.add(uint64_t(reinterpret_cast<uintptr_t>(grid.values)))
            .add(grid.nx)
            .add(grid.ny)
            .add(grid.nz)
            .add(grid.origin, sizeof grid.origin)
            .add(grid.axes, sizeof grid.axes);
}

// Adds a value: name, numbers, text, grid and volume.
inline void add_value(Digest& digest, const MarramValue& value) {
    digest.add(value.name).add(value.text).add(value.numbers, value.number_count * sizeof(double));
    add_placement(digest, value.placement);
    add_volume(digest, value.volume);
    if (value.keyframes) {
        const MarramKeyframes keys = known_part(value.keyframes);
        digest.add(keys.frames, keys.count * sizeof(double))
            .add(keys.numbers, keys.count * value.number_count * sizeof(double))
            .add(keys.interpolation);
    }
    if (const MarramGrid* grid = value.grid)
        digest.add(grid->nx)
            .add(grid->ny)
            .add(grid->components)
            .add(grid->values, size_t(grid->nx) * grid->ny * grid->nz * grid->components * sizeof(float));
}

inline uint64_t digest_of_values(std::span<const MarramValue> values) {
    Digest digest;
    for (const MarramValue& value : values) add_value(digest, value);
    return digest.value();
}

// The values that the host passes. All their faults are reported to the host; if there are any, throws
// Reported.
inline std::vector<MarramValue> checked_values(const MarramHost& host, const MarramValues* given,
                                               std::span<const MarramParam> params,
                                               std::span<const MarramItemType> items) {
    if (!given || (given->count > 0 && !given->first))
        throw SceneFault("contract.null_values", "", "the list of values is NULL",
                         "pass an array of `count` values");
    check_size(given);
    std::vector<MarramValue> values = known_parts(given->first, given->count, given->stride);
    const std::vector<ContractFault> faults = value_faults(params, values, items);
    for (const ContractFault& fault : faults)
        send(host, MARRAM_FAULT, "contract.value", fault.place, fault.what, fault.remedy);
    if (!faults.empty()) throw Reported();
    return values;
}

// Throws SceneFault if a buffer of a patch is NULL or an attribute does not exist.
void check_patch_buffers(const MarramPatchBuffers* buffers, uint32_t time_count, bool oriented,
                         size_t attribute_count);
// The same for a mesh.
void check_mesh_buffers(const MarramMeshBuffers* buffers, size_t attribute_count);

// The fields of a view that this version knows. Throws SceneFault if it is invalid.
inline MarramView checked_view(const MarramView* given) {
    const MarramView view = known_part(given);
    if (const ContractFault fault = view_fault(view); !fault.what.empty())
        throw SceneFault("contract.view", fault.place, fault.what, fault.remedy);
    return view;
}

// A frame that the host lends, its fields that this version knows.
struct LentFrame {
    MarramFrame frame{}; // points into `meshes`
    std::vector<MarramMesh> meshes;
};

// Throws SceneFault if the frame is invalid.
inline LentFrame lent_frame(const MarramFrame* given) {
    if (!given) throw SceneFault("contract.frame", "", "the frame is NULL", "pass a MarramFrame");
    LentFrame lent{known_part(given), {}};
    MarramFrame& frame = lent.frame;
    lent.meshes = known_parts(frame.meshes, frame.mesh_count, frame.mesh_stride);
    frame.meshes = lent.meshes.data();
    frame.mesh_stride = sizeof(MarramMesh);
    const std::vector<MarramCurves> curves =
        known_parts(frame.curves, frame.curves_count, frame.curves_stride);
    if (const ContractFault fault = frame_fault(frame, lent.meshes, curves); !fault.what.empty())
        throw SceneFault("contract.frame", fault.place, fault.what, fault.remedy);
    if (frame.view) checked_view(frame.view);
    return lent;
}

// Poses a mesh of a lent frame at any time with MarramFrame.pose. Throws SceneFault if the host fails or
// returns numbers that are not finite, Cancelled if it is cancelled.
inline void pose_lent_mesh(const MarramFrame& frame, uint32_t mesh, double time, float* positions,
                           float* normals) {
    const MarramStatus status = frame.pose(frame.pose_user, mesh, time, positions, normals);
    if (status == MARRAM_CANCELLED) throw Cancelled();
    const size_t count = 3 * size_t(frame.meshes[mesh].vertex_count);
    const std::string which =
        "the mesh '" + std::string(frame.meshes[mesh].name) + "' at frame " + std::to_string(time);
    if (status != MARRAM_OK)
        throw SceneFault("contract.pose", "", "the host does not pose " + which,
                         "let MarramFrame.pose answer for any time");
    if (!usable_coordinates(positions, count) || (normals && !usable_coordinates(normals, count)))
        throw SceneFault("contract.pose", "", "the host poses " + which + " with numbers that are not finite",
                         "give finite positions and normals");
}

// The transform from a mesh to one of its instances. Throws as pose_lent_mesh().
inline Eigen::Affine3d place_lent_instance(const MarramFrame& frame, uint32_t mesh, double time) {
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> matrix;
    const MarramStatus status = frame.instance_transform(frame.pose_user, mesh, time, matrix.data());
    if (status == MARRAM_CANCELLED) throw Cancelled();
    Eigen::Affine3d placed;
    placed.affine() = matrix;
    // The scale must be uniform. 1e-6 allows for matrices that were stored as floats.
    const Eigen::Matrix3d squares = placed.linear().transpose() * placed.linear();
    const double squared = squares.trace() / 3.0;
    const bool even =
        squared > 0.0 &&
        (squares - squared * Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <= 1e-6 * squared;
    if (status != MARRAM_OK || !matrix.allFinite() || !even)
        throw SceneFault("contract.instance", "",
                         "the host does not place the instance '" + std::string(frame.meshes[mesh].name) +
                             "' at frame " + std::to_string(time) + ", or does not scale it evenly",
                         "give a finite matrix: turned, and scaled by one number other than 0");
    return placed;
}

// Poses some curves of a lent frame at any time with MarramFrame.pose_curves, which must not be NULL. Throws
// as pose_lent_mesh().
inline void pose_lent_curves(const MarramFrame& frame, uint32_t curves, double time, uint64_t first_curve,
                             uint64_t curve_count, std::span<float> vertices) {
    const MarramStatus status =
        frame.pose_curves(frame.pose_user, curves, time, first_curve, curve_count, vertices.data());
    if (status == MARRAM_CANCELLED) throw Cancelled();
    if (status != MARRAM_OK)
        throw SceneFault("contract.pose", "",
                         "the host does not pose curves at frame " + std::to_string(time),
                         "let MarramFrame.pose_curves answer for any time");
    if (!usable_coordinates(vertices.data(), vertices.size()))
        throw SceneFault("contract.pose", "",
                         "the host poses curves at frame " + std::to_string(time) +
                             " with numbers that are not finite",
                         "give finite vertices");
}

} // namespace marram
