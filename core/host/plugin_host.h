// SPDX-License-Identifier: Apache-2.0
// The host side of the contract, for one procedural of a scene. The renderer knows procedurals only through
// core/plugin/marram_plugin.h.
#pragma once

#include "core/host/contract_values.h"
#include "core/host/state_store.h"
#include "core/math/vec.h"

#include <atomic>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace marram {

// Thrown after the caller has cancelled the work.
struct Cancelled {};

// Receives the progress of a preparation: a fraction 0 ... 1, and a text.
using PrepareProgress = std::function<void(double, const std::string&)>;

// One procedural of a scene, from create to destroy.
class Procedural {
  public:
    // Passes the item's values; wind parameters that it does not set come from the scene's wind. Throws
    // InputError with the procedural's objections, and for images, tables and volumes that cannot be
    // read.
    Procedural(std::shared_ptr<PluginLibrary> library, const Item& item, const ParamSet& wind,
               const std::atomic<bool>& cancel, std::shared_ptr<const CurveAttributes> curves = {});
    ~Procedural();
    Procedural(const Procedural&) = delete;
    Procedural& operator=(const Procedural&) = delete;

    const std::string& name() const { return name_; }
    const Place& place() const { return place_; }
    const PluginLibrary& library() const { return *library_; }
    MarramOutputKind kind() const { return type_->calls.kind; }
    const MarramProcedural& calls() const { return type_->calls; }
    const std::vector<MarramAttribute>& attributes() const { return attributes_; }
    // Geometry that its parameters name, each once: it depends on them.
    const std::vector<GeometryName>& meshes() const { return meshes_; }
    const std::vector<GeometryName>& curves() const { return curves_; }
    bool refers_to_mesh(const std::string& mesh) const;
    bool refers_to_curves(const std::string& curves) const;
    bool names(const std::string& geometry) const {
        return refers_to_mesh(geometry) || refers_to_curves(geometry);
    }
    // Digest of its values, the contents of files that they name, and the library's version.
    uint64_t digest() const { return digest_; }

    // Unique to the instance: changes if an update creates it anew.
    uint64_t instance_number() const { return instance_number_; }

    int material = -1;                        // index into the scene's materials
    uint32_t roles = MARRAM_ALL_ROLES;        // of the mesh that it makes
    uint32_t pending_inputs = MARRAM_NOTHING; // MarramChange bits of its dependencies since its last update

    // Each throws InputError with the procedural's message, or Cancelled.
    bool prepares() const { return type_->calls.prepare != nullptr; }
    void prepare(const MarramFrame& frame, StateStore& states, const PrepareProgress& progress);
    MarramOutput begin(const MarramFrame& frame);
    MarramPatch patch(uint32_t index);
    void tessellate(uint32_t index, const MarramPatchBuffers& buffers); // from any thread
    void mesh(MarramMeshBuffers& buffers);
    bool has_pose() const { return type_->calls.pose != nullptr; }
    void pose(double frame, float* positions); // from any thread
    bool has_view() const { return type_->calls.begin_view != nullptr; }
    MarramOutput begin_view(const MarramView& view);
    void view_mesh(MarramMeshBuffers& buffers);
    std::vector<std::pair<std::string, double>> report();
    // Describes what it has generated since begin() as text of a scene; "" if nothing.
    std::string describe();
    // What it does in the shot, in a few lines; "" if it does not say.
    std::string summarize();
    // The random gusts of its wind at the frame that has begun.
    struct Gust {
        Vec3d center;
        double radius, strength;
    };
    std::vector<Gust> gusts();
    // The wind at points of the air, as MarramProcedural.air tells it; empty if it does not.
    struct Air {
        Vec3d velocity, noise;
        double share;
    };
    std::vector<Air> air(const std::vector<Vec3d>& points);
    // The rays that find the shelter of a strand, by its CVs at rest: as MarramProcedural.shelter_rays.
    struct ShelterRay {
        uint32_t cv;
        Vec3d from, to;
        double shelter;
    };
    std::vector<ShelterRay> shelter_rays(const std::vector<Vec3d>& cvs, const Vec3d& root_normal);
    std::vector<Problem> take_warnings();
    // False: it is not told that the work is cancelled, and so comes to its end.
    void set_cancellable(bool cancellable) { cancellable_ = cancellable; }
    // Of the files that its values name.
    const std::vector<Problem>& file_warnings() const { return file_warnings_; }
    std::vector<Problem> take_common_warnings(); // see MARRAM_COMMON_WARNING
    // That its values name. Files are shared: by procedurals, too.
    const std::vector<std::shared_ptr<const VolumeValue>>& volumes() const { return volumes_; }
    // Takes the values of another description of the same procedural. `inputs` (MarramChange): what has
    // changed of the geometry that it depends on. Returns what has changed of its output. A procedural that
    // cannot update is created anew.
    uint32_t update(const Item& item, const ParamSet& wind, uint32_t inputs);
    // Stores the exception of a host function that the procedural has called; thrown if the procedural then
    // fails.
    void store_exception(std::exception_ptr thrown);
    // Takes the place, the roles and the geometry that the item names: they define the graph.
    void read_dependencies(const Item& item, const ParamSet& wind);
    // Rejects the procedural's output: throws InputError.
    [[noreturn]] void refuse(const std::string& what, const std::string& fix) const;

  private:
    std::string text_of(MarramStatus (*call)(MarramInstance*, void (*)(void*, const char*), void*));
    static void on_message(void* user, const MarramMessage* message);
    static int on_cancelled(void* user);
    static void on_progress(void* user, double share, const char* words);
    void check(MarramStatus status);
    void read_attributes();
    void take_names(const ContractValues& values);
    void forget_faults();

    std::shared_ptr<PluginLibrary> library_;
    std::string name_;
    Place place_;
    std::vector<GeometryName> meshes_, curves_;
    uint64_t digest_ = 0;
    const ProceduralType* type_ = nullptr;
    const std::atomic<bool>* cancel_;
    std::atomic<bool> cancellable_{true};
    std::shared_ptr<const CurveAttributes> curve_attributes_; // of the scene's curves
    std::vector<std::shared_ptr<const VolumeValue>> volumes_; // that the instance points to
    const PrepareProgress* progress_ = nullptr;               // while prepare runs
    MarramHost host_{};                                       // lent from create to destroy
    MarramInstance* instance_ = nullptr;
    uint64_t instance_number_ = 0;
    std::vector<MarramAttribute> attributes_; // names point into attribute_names_
    std::deque<std::string> attribute_names_;
    std::exception_ptr thrown_; // of a host function that the procedural has called
    std::mutex messages_lock_;
    std::vector<Problem> faults_;
    std::vector<Problem> warnings_, common_warnings_, file_warnings_;
};

} // namespace marram
