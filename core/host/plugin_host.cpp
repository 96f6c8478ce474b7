// SPDX-License-Identifier: Apache-2.0
#include "core/host/plugin_host.h"

#include "core/geometry/scene_mesh.h"

#include "core/math/digest.h"
#include "core/math/known_part.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

namespace marram {
namespace {

// A text field of a message; "" if its sender does not know the field or leaves it NULL.
#define MARRAM_TEXT_OF(message, field)                                                                       \
    (MARRAM_HAS(message, field) && (message)->field ? (message)->field : "")

// User data of MarramStates' callbacks.
struct Store {
    StateStore& states;
    std::optional<StoredState> loaded{};
    std::exception_ptr thrown{};
};

MarramStatus load_state(void* user, double frame, MarramState* out) {
    Store& store = *static_cast<Store*>(user);
    try {
        store.loaded = store.states.load(frame);
    } catch (...) {
        store.thrown = std::current_exception();
        return MARRAM_ERROR;
    }
    MarramState state{};
    state.size = sizeof state;
    static const char nothing = 0; // an empty state must not be NULL
    if (store.loaded) {
        state.frame = store.loaded->frame;
        state.data = store.loaded->data.empty() ? &nothing : store.loaded->data.data();
        state.byte_count = store.loaded->data.size();
    }
    if (!is_sized(out)) return MARRAM_ERROR;
    fill_known_part(state, out);
    return MARRAM_OK;
}

MarramStatus store_state(void* user, const MarramState* given) {
    Store& store = *static_cast<Store*>(user);
    if (!given || !is_sized(given)) return MARRAM_ERROR;
    const MarramState state = known_part(given);
    if (!std::isfinite(state.frame) || (state.byte_count > 0 && !state.data)) return MARRAM_ERROR;
    try {
        store.states.store(state.frame, state.data, state.byte_count);
        return MARRAM_OK;
    } catch (...) {
        store.thrown = std::current_exception();
        return MARRAM_ERROR;
    }
}

} // namespace

Procedural::Procedural(std::shared_ptr<PluginLibrary> library, const Item& item, const ParamSet& wind,
                       const std::atomic<bool>& cancel, std::shared_ptr<const CurveAttributes> curves)
    : library_(std::move(library)), name_(item.name), place_(item.place), type_(library_->find(item.type)),
      cancel_(&cancel),
      curve_attributes_(curves ? std::move(curves) : std::make_shared<const CurveAttributes>()) {
    if (!type_)
        throw InputError(item.place,
                         "the library '" + library_->path() + "' has no procedural '" + item.type + "'",
                         "see `marram info` for what it has");
    if (!type_->unusable.empty())
        throw InputError(item.place, "'" + item.type + "' cannot be used: " + type_->unusable,
                         "use a library and a program of the same version");
    host_ = {sizeof(MarramHost), this, on_message, on_cancelled, on_progress};
    try {
        update(item, wind, MARRAM_EVERYTHING);
    } catch (...) {
        if (instance_) type_->calls.destroy(instance_);
        throw;
    }
}

Procedural::~Procedural() {
    if (instance_) type_->calls.destroy(instance_);
}

void Procedural::take_names(const ContractValues& values) {
    meshes_ = values.names_of(MARRAM_MESH_NAME);
    curves_ = values.names_of(MARRAM_CURVES_NAME);
}

void Procedural::read_dependencies(const Item& item, const ParamSet& wind) {
    take_names(ContractValues(*type_, item, wind, *curve_attributes_));
    place_ = item.place;
    roles = role_bits(item.params);
}

uint32_t Procedural::update(const Item& item, const ParamSet& wind, uint32_t inputs) {
    const ContractValues values(*type_, item, wind, *curve_attributes_);
    place_ = item.place; // messages begin with it
    take_names(values);
    const uint64_t digest = Digest()
                                .add(library_->name())
                                .add(library_->version())
                                .add(type_->calls.name)
                                .add(values.digest())
                                .value();
    if (instance_ && digest == digest_ && inputs == MARRAM_NOTHING) return MARRAM_NOTHING;
    uint32_t changed = MARRAM_EVERYTHING;
    const MarramValues list = values.list();
    volumes_.insert(volumes_.end(), values.volumes().begin(), values.volumes().end());
    forget_faults();
    if (instance_ && type_->calls.update) {
        const MarramUpdate update{sizeof(MarramUpdate), &list, inputs};
        check(type_->calls.update(instance_, &update, &changed));
    } else {
        MarramInstance* made = nullptr;
        check(type_->calls.create(&host_, &list, &made));
        if (instance_) type_->calls.destroy(instance_);
        instance_ = made;
        static std::atomic<uint64_t> count = 0;
        instance_number_ = ++count;
    }
    digest_ = digest;
    volumes_ = values.volumes();
    file_warnings_ = values.warnings();
    read_attributes();
    return changed;
}

void Procedural::read_attributes() {
    attributes_ = type_->attributes;
    if (type_->calls.attributes_of) {
        MarramAttributeList list{};
        list.size = sizeof list;
        check(type_->calls.attributes_of(instance_, &list));
        attributes_ = known_parts(list.attributes, list.count, list.stride);
    }
    attribute_names_.clear(); // the procedural may free its own
    for (MarramAttribute& attribute : attributes_) {
        if (!attribute.name) refuse("it has an attribute without a name", "fix the library");
        attribute.name = attribute_names_.emplace_back(attribute.name).c_str();
        attribute.help = attribute_names_.emplace_back(attribute.help ? attribute.help : "").c_str();
    }
}

void Procedural::forget_faults() {
    const std::lock_guard lock(messages_lock_);
    faults_.clear();
    thrown_ = nullptr;
}

bool Procedural::refers_to_mesh(const std::string& mesh) const {
    return std::ranges::find(meshes_, mesh, &GeometryName::name) != meshes_.end();
}

bool Procedural::refers_to_curves(const std::string& curves) const {
    return std::ranges::find(curves_, curves, &GeometryName::name) != curves_.end();
}

// Called through the procedural's C code, where no exception may pass: check() throws it later.
void Procedural::on_message(void* user, const MarramMessage* message) {
    Procedural& procedural = *static_cast<Procedural*>(user);
    const std::lock_guard lock(procedural.messages_lock_);
    try {
        const std::string place = MARRAM_TEXT_OF(message, place), what = MARRAM_TEXT_OF(message, what),
                          remedy = MARRAM_TEXT_OF(message, remedy), id = MARRAM_TEXT_OF(message, id);
        Problem problem{place.empty() ? procedural.place_ : parse_place(place), what, remedy, id};
        if (message->severity == MARRAM_FAULT) {
            if (remedy.empty()) problem.fix = "see `marram info`";
            procedural.faults_.push_back(std::move(problem));
        } else if (message->severity == MARRAM_INFO) {
            note(problem);
        } else {
            std::vector<Problem>& list = message->severity == MARRAM_COMMON_WARNING
                                             ? procedural.common_warnings_
                                             : procedural.warnings_;
            list.push_back(std::move(problem));
        }
    } catch (...) {
        procedural.thrown_ = std::current_exception();
    }
}

int Procedural::on_cancelled(void* user) {
    const Procedural& procedural = *static_cast<Procedural*>(user);
    return procedural.cancel_->load(std::memory_order_relaxed) && procedural.cancellable_ ? 1 : 0;
}

void Procedural::on_progress(void* user, double share, const char* words) {
    const Procedural& procedural = *static_cast<Procedural*>(user);
    try {
        if (procedural.progress_ && *procedural.progress_) (*procedural.progress_)(share, words ? words : "");
    } catch (...) { // progress is not essential
    }
}

void Procedural::check(MarramStatus status) {
    if (status == MARRAM_OK) return;
    if (status == MARRAM_CANCELLED) throw Cancelled{};
    const std::lock_guard lock(messages_lock_);
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    if (faults_.empty())
        faults_.push_back(
            {place_, "the procedural '" + name_ + "' failed without saying why", "ask its author"});
    throw InputError(faults_); // not cleared: another thread may fail at the same time
}

void Procedural::prepare(const MarramFrame& frame, StateStore& states, const PrepareProgress& progress) {
    forget_faults();
    Store store{states};
    const MarramStates lent{sizeof(MarramStates), &store, load_state, store_state};
    progress_ = &progress;
    const MarramStatus status = type_->calls.prepare(instance_, &frame, &lent);
    progress_ = nullptr;
    for (Problem& warning : states.take_warnings()) {
        const std::lock_guard lock(messages_lock_);
        warnings_.push_back(std::move(warning));
    }
    if (status == MARRAM_ERROR && store.thrown) std::rethrow_exception(store.thrown);
    check(status);
}

MarramOutput Procedural::begin(const MarramFrame& frame) {
    forget_faults();
    MarramOutput output{};
    output.size = sizeof output;
    check(type_->calls.begin(instance_, &frame, &output));
    if (output.kind != type_->calls.kind)
        refuse("it hands over another kind of output than it declares", "fix the library");
    return output;
}

MarramPatch Procedural::patch(uint32_t index) {
    MarramPatch patch{};
    patch.size = sizeof patch;
    check(type_->calls.patch(instance_, index, &patch));
    return patch;
}

void Procedural::tessellate(uint32_t index, const MarramPatchBuffers& buffers) {
    check(type_->calls.tessellate(instance_, index, &buffers));
}

void Procedural::mesh(MarramMeshBuffers& buffers) { check(type_->calls.mesh(instance_, &buffers)); }

void Procedural::pose(double frame, float* positions) {
    check(type_->calls.pose(instance_, frame, positions));
}

MarramOutput Procedural::begin_view(const MarramView& view) {
    forget_faults();
    MarramOutput output{};
    output.size = sizeof output;
    output.kind = MARRAM_MESH;
    check(type_->calls.begin_view(instance_, &view, &output));
    return output;
}

void Procedural::view_mesh(MarramMeshBuffers& buffers) { check(type_->calls.view_mesh(instance_, &buffers)); }

std::vector<std::pair<std::string, double>> Procedural::report() {
    std::vector<std::pair<std::string, double>> entries;
    if (!type_->calls.report) return entries;
    type_->calls.report(
        instance_,
        [](void* user, const char* path, double value) {
            if (path)
                static_cast<std::vector<std::pair<std::string, double>>*>(user)->emplace_back(path, value);
        },
        &entries);
    return entries;
}

std::string Procedural::text_of(MarramStatus (*call)(MarramInstance*, void (*)(void*, const char*), void*)) {
    std::string text;
    if (!call) return text;
    forget_faults();
    check(call(
        instance_,
        [](void* user, const char* piece) {
            if (piece) *static_cast<std::string*>(user) += piece;
        },
        &text));
    return text;
}

std::string Procedural::describe() { return text_of(type_->calls.describe); }

std::string Procedural::summarize() { return text_of(type_->calls.summarize); }

std::vector<Procedural::Gust> Procedural::gusts() {
    std::vector<Gust> list;
    if (!type_->calls.gusts) return list;
    forget_faults();
    check(type_->calls.gusts(
        instance_,
        [](void* user, const double center[3], double radius, double strength) {
            static_cast<std::vector<Gust>*>(user)->push_back({Vec3d(center), radius, strength});
        },
        &list));
    return list;
}

static_assert(sizeof(Vec3d) == 3 * sizeof(double)); // points are passed as they are

std::vector<Procedural::Air> Procedural::air(const std::vector<Vec3d>& points) {
    std::vector<Air> list;
    if (!type_->calls.air || points.empty()) return list;
    forget_faults();
    check(type_->calls.air(
        instance_, points.size(), points.front().data(),
        [](void* user, const double velocity[3], const double noise[3], double share) {
            static_cast<std::vector<Air>*>(user)->push_back({Vec3d(velocity), Vec3d(noise), share});
        },
        &list));
    return list;
}

std::vector<Procedural::ShelterRay> Procedural::shelter_rays(const std::vector<Vec3d>& cvs,
                                                             const Vec3d& root_normal) {
    std::vector<ShelterRay> list;
    if (!type_->calls.shelter_rays || cvs.empty()) return list;
    forget_faults();
    check(type_->calls.shelter_rays(
        instance_, uint32_t(cvs.size()), cvs.front().data(), root_normal.data(),
        [](void* user, uint32_t cv, const double from[3], const double to[3], double shelter) {
            static_cast<std::vector<ShelterRay>*>(user)->push_back({cv, Vec3d(from), Vec3d(to), shelter});
        },
        &list));
    return list;
}

std::vector<Problem> Procedural::take_warnings() {
    const std::lock_guard lock(messages_lock_);
    return std::exchange(warnings_, {});
}

std::vector<Problem> Procedural::take_common_warnings() {
    const std::lock_guard lock(messages_lock_);
    return std::exchange(common_warnings_, {});
}

void Procedural::store_exception(std::exception_ptr thrown) {
    const std::lock_guard lock(messages_lock_);
    thrown_ = std::move(thrown);
}

void Procedural::refuse(const std::string& what, const std::string& fix) const {
    throw InputError(place_, "procedural '" + name_ + "': " + what, fix);
}

} // namespace marram
