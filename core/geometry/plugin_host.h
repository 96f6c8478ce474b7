// SPDX-License-Identifier: Apache-2.0
// The renderer's end of the contract: loading procedural libraries and talking to what they make. Everything the renderer
// knows of a procedural it learns here, through core/plugin/marram_plugin.h.
#pragma once

#include "core/math/params.h"
#include "core/plugin/marram_plugin.h"
#include "core/scene/description.h"

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace marram {

// A loaded procedural library. Everything taken from its tables points into it.
class PluginLibrary {
  public:
    // Throws InputError, placed at `place`, for a file that is not a library, has no entry point or speaks another ABI.
    PluginLibrary(const std::string& path, const Place& place);
    ~PluginLibrary();
    PluginLibrary(const PluginLibrary&) = delete;
    PluginLibrary& operator=(const PluginLibrary&) = delete;

    const MarramLibrary& table() const { return *table_; }
    const std::string& path() const { return path_; }
    const MarramProcedural* find(const std::string& type) const; // nullptr where the library has no such type

  private:
    std::string path_;
    void* handle_ = nullptr;
    const MarramLibrary* table_ = nullptr;
};

// Declarations of a library as the scene checker wants them. In procedurals the wind's parameters stand as optional ones: what
// a procedural does not say itself is taken from the scene's [wind]; a list of tables of its own replaces the scene's.
std::vector<ParamSpec> wind_specs(const MarramLibrary& library);
std::vector<ItemSchema> procedural_schemas(const MarramLibrary& library);

// Whoever asked for this work wants no more of it.
struct Cancelled {};

// One procedural of a scene, from create to destroy.
class Procedural {
  public:
    // Hands over the item's values and, where it has none of its own, the scene's wind. Throws InputError with what the
    // procedural objects to, and for images that cannot be read.
    Procedural(std::shared_ptr<PluginLibrary> library, const Item& item, const ParamSet& wind,
               const std::atomic<bool>& cancel);
    ~Procedural();
    Procedural(const Procedural&) = delete;
    Procedural& operator=(const Procedural&) = delete;

    const std::string& name() const { return name_; }
    int material = -1; // index into the scene's materials
    const MarramProcedural& type() const { return *type_; }
    const std::vector<std::string>& meshes() const {
        return meshes_;
    } // that its parameters name: it grows on them

    // Each throws InputError with the procedural's own words, or Cancelled.
    MarramOutput begin(const MarramFrame& frame);
    MarramPatch patch(uint32_t index);
    void tessellate(uint32_t index, const MarramPatchBuffers& buffers); // from any thread
    void mesh(const MarramMeshBuffers& buffers);
    std::vector<std::pair<std::string, double>> report();
    std::vector<std::string> take_warnings();
    // An objection of the renderer's own to what was handed over.
    [[noreturn]] void refuse(const std::string& what, const std::string& fix) const;

  private:
    static void on_message(void* user, MarramSeverity severity, const char* place, const char* text);
    static int on_cancelled(void* user);
    void check(MarramStatus status);

    std::shared_ptr<PluginLibrary> library_;
    std::string name_;
    Place place_;
    std::vector<std::string> meshes_;
    const MarramProcedural* type_ = nullptr;
    const std::atomic<bool>* cancel_;
    MarramHost host_{}; // lent from create to destroy
    MarramInstance* instance_ = nullptr;
    std::mutex messages_lock_;
    std::vector<Problem> faults_;
    std::vector<std::string> warnings_;
};

} // namespace marram
