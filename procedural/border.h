// SPDX-License-Identifier: Apache-2.0
// Shared code of the procedurals' entry points: no exception crosses the C ABI, and values are checked before
// they are read.
#pragma once

#include "core/math/digest.h"
#include "core/math/known_part.h"
#include "core/math/vec.h"
#include "procedural/contract_checks.h"
#include "procedural/parallel.h"
#include "procedural/values.h"

#include <cmath>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Runs the body of a call, its loops on the host's executor, and turns exceptions into messages to the
// host. subject: e.g. "groom", for message ids and texts. less: the remedy if memory runs out.
template <typename Body>
MarramStatus guarded(const MarramHost& host, const char* subject, const char* less, Body&& body) {
    const std::string name = subject;
    const ExecutorScope executor(&host);
    try {
        return body();
    } catch (const SceneFault& fault) {
        send(host, MARRAM_FAULT, fault.id.c_str(), fault.place, fault.what(), fault.remedy);
    } catch (const std::bad_alloc&) {
        send(host, MARRAM_FAULT, (name + ".memory").c_str(), "", "there is not enough memory for the " + name,
             less);
    } catch (const UnsetSize& fault) {
        send(host, MARRAM_FAULT, "contract.size", "", fault.what(), "set it to the size of the struct");
    } catch (const std::exception& error) {
        send(host, MARRAM_FAULT, (name + ".internal").c_str(), "", error.what(),
             "report it as a bug of the library");
    }
    return MARRAM_ERROR;
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

// Adds a value: name, numbers, text and grid.
inline void add_value(Digest& digest, const MarramValue& value) {
    digest.add(value.name).add(value.text).add(value.numbers, value.number_count * sizeof(double));
    add_placement(digest, value.placement);
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

// Reports all faults of the values to the host. Returns false if there are any.
inline bool check_values(const MarramHost& host, std::span<const MarramParam> params,
                         std::span<const MarramValue> values, std::span<const MarramItemType> items = {}) {
    const std::vector<ContractFault> faults = value_faults(params, values, items);
    for (const ContractFault& fault : faults)
        send(host, MARRAM_FAULT, "contract.value", fault.place, fault.what, fault.remedy);
    return faults.empty();
}

inline std::vector<MarramValue> values_of(const MarramValues* given) {
    if (!given || (given->count > 0 && !given->first))
        throw SceneFault("contract.null_values", "", "the list of values is NULL",
                         "pass an array of `count` values");
    check_size(given);
    return known_parts(given->first, given->count, given->stride);
}

// The body of create(): checks the values, and take(instance, values) stores them in a new instance.
template <typename Instance, typename Take>
MarramStatus create_instance(const MarramHost& host, const MarramValues* values, MarramInstance** out,
                             std::span<const MarramParam> params, Take&& take,
                             std::span<const MarramItemType> items = {}) {
    const std::vector<MarramValue> list = values_of(values);
    if (!check_values(host, params, list, items)) return MARRAM_ERROR;
    auto instance = std::make_unique<Instance>();
    instance->host = host;
    take(*instance, std::span<const MarramValue>(list));
    *out = reinterpret_cast<MarramInstance*>(instance.release());
    return MARRAM_OK;
}

// The body of update(): checks the values; take(values, inputs) stores them and returns the MarramChange of the
// output. inputs: MarramUpdate.inputs.
template <typename Take>
MarramStatus update_instance(const MarramHost& host, const MarramUpdate* given, uint32_t* changed,
                             std::span<const MarramParam> params, Take&& take,
                             std::span<const MarramItemType> items = {}) {
    if (!given || !changed)
        throw SceneFault("contract.null_update", "", "the update is NULL",
                         "pass an update and a place for the changes");
    const MarramUpdate update = known_part(given);
    const std::vector<MarramValue> list = values_of(update.values);
    if (!check_values(host, params, list, items)) return MARRAM_ERROR;
    *changed = take(std::span<const MarramValue>(list), update.inputs);
    return MARRAM_OK;
}

// Copies the fields of the host's frame that this version knows, and its meshes into `meshes`. Throws
// SceneFault if the frame is invalid.
inline MarramFrame borrowed_frame(const MarramFrame* given, std::vector<MarramMesh>& meshes) {
    if (!given) throw SceneFault("contract.frame", "", "the frame is NULL", "pass a MarramFrame");
    MarramFrame frame = known_part(given);
    meshes = known_parts(frame.meshes, frame.mesh_count, frame.mesh_stride);
    frame.meshes = meshes.data();
    frame.mesh_stride = sizeof(MarramMesh);
    const std::vector<MarramCurves> curves =
        known_parts(frame.curves, frame.curves_count, frame.curves_stride);
    if (const ContractFault fault = frame_fault(frame, meshes, curves); !fault.what.empty())
        throw SceneFault("contract.frame", fault.place, fault.what, fault.remedy);
    return frame;
}

// Poses a mesh of a borrowed frame at any time with MarramFrame.pose. Returns MARRAM_OK or MARRAM_CANCELLED.
// Throws SceneFault if the host fails or returns numbers that are not finite.
inline MarramStatus pose_lent_mesh(const MarramFrame& frame, uint32_t mesh, double time, float* positions,
                                   float* normals) {
    const MarramStatus status = frame.pose(frame.pose_user, mesh, time, positions, normals);
    if (status == MARRAM_CANCELLED) return status;
    const size_t count = 3 * size_t(frame.meshes[mesh].vertex_count);
    const std::string which =
        "the mesh '" + std::string(frame.meshes[mesh].name) + "' at frame " + std::to_string(time);
    if (status != MARRAM_OK)
        throw SceneFault("contract.pose", "", "the host does not pose " + which,
                         "let MarramFrame.pose answer for any time");
    if (!usable_coordinates(positions, count) || (normals && !usable_coordinates(normals, count)))
        throw SceneFault("contract.pose", "", "the host poses " + which + " with numbers that are not finite",
                         "give finite positions and normals");
    return MARRAM_OK;
}

// Gets the transform from a mesh to one of its instances. Status and errors as pose_lent_mesh().
inline MarramStatus place_lent_instance(const MarramFrame& frame, uint32_t mesh, double time,
                                        Eigen::Affine3d& placed) {
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> matrix;
    const MarramStatus status = frame.instance_transform(frame.pose_user, mesh, time, matrix.data());
    if (status == MARRAM_CANCELLED) return status;
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
    return MARRAM_OK;
}

// Poses some curves of a borrowed frame at any time with MarramFrame.pose_curves, which must not be NULL.
// Status and errors as pose_lent_mesh().
inline MarramStatus pose_lent_curves(const MarramFrame& frame, uint32_t curves, double time,
                                     uint64_t first_curve, uint64_t curve_count, std::span<float> vertices) {
    const MarramStatus status =
        frame.pose_curves(frame.pose_user, curves, time, first_curve, curve_count, vertices.data());
    if (status == MARRAM_CANCELLED) return status;
    if (status != MARRAM_OK)
        throw SceneFault("contract.pose", "",
                         "the host does not pose curves at frame " + std::to_string(time),
                         "let MarramFrame.pose_curves answer for any time");
    if (!usable_coordinates(vertices.data(), vertices.size()))
        throw SceneFault("contract.pose", "",
                         "the host poses curves at frame " + std::to_string(time) +
                             " with numbers that are not finite",
                         "give finite vertices");
    return MARRAM_OK;
}

} // namespace marram
