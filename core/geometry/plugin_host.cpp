// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/plugin_host.h"

#include "core/image/image.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cstring>
#include <deque>
#include <filesystem>
#include <new>

namespace marram {
namespace {

ParamType type_of(MarramParamType type) {
    switch (type) {
    case MARRAM_BOOLEAN:
        return ParamType::boolean;
    case MARRAM_INTEGER:
        return ParamType::integer;
    case MARRAM_NUMBER:
        return ParamType::number;
    case MARRAM_VEC2:
        return ParamType::vec2;
    case MARRAM_VEC3:
        return ParamType::vec3;
    case MARRAM_RANGE:
        return ParamType::range;
    case MARRAM_COLOR:
        return ParamType::color;
    case MARRAM_TEXT:
        return ParamType::text;
    case MARRAM_CHOICE:
        return ParamType::choice;
    case MARRAM_RAMP:
        return ParamType::ramp;
    case MARRAM_IMAGE:
        return ParamType::image;
    case MARRAM_MESH_NAME:
        return ParamType::reference;
    case MARRAM_KEYS:
        return ParamType::keys;
    case MARRAM_UNAVAILABLE:
        return ParamType::unavailable;
    case MARRAM_PARAM_TYPE_COUNT:
        break;
    }
    return ParamType::unavailable;
}

ParamSpec spec_of(const MarramParam& param) {
    ParamSpec spec{param.name,    type_of(param.type), param.unit,    param.initial,
                   param.minimum, param.maximum,       param.choices, param.help};
    if (spec.type == ParamType::reference) spec.choices = "mesh|procedural"; // what it makes may be a mesh
    return spec;
}

constexpr std::string_view wind_prefix = "wind.";

// Values in the contract's form, with the storage that they point into.
class ContractValues {
  public:
    void add(const MarramParam& param, std::string name, const ParamValue& value) {
        MarramValue& out = values_.emplace_back();
        out.name = names_.emplace_back(std::move(name)).c_str();
        out.type = param.type;
        out.numbers = value.numbers.data();
        out.number_count = value.numbers.size();
        out.text = value.text.c_str();
        out.place = places_.emplace_back(to_string(value.place)).c_str();
        if (param.type == MARRAM_IMAGE) out.image = image(value);
    }
    const MarramValue* data() const { return values_.data(); }
    uint32_t size() const { return static_cast<uint32_t>(values_.size()); }

  private:
    const MarramImage* image(const ParamValue& value) {
        const Image& pixels = pixels_.emplace_back(read_image(value.text, ColorSpace::linear_data));
        return &images_.emplace_back(
            MarramImage{static_cast<uint32_t>(pixels.width), static_cast<uint32_t>(pixels.height),
                        static_cast<uint32_t>(pixels.channels), pixels.pixels.data()});
    }
    std::vector<MarramValue> values_;
    std::deque<std::string> names_, places_;
    std::deque<Image> pixels_;
    std::deque<MarramImage> images_;
};

// Where a parameter's values come from: the item's own, or else, for one of the wind's, what the scene says.
void add_values(const MarramParam& param, const Item& item, const ParamSet& wind, ContractValues& out) {
    const std::string_view name = param.name, list = list_of(name);
    const auto add_from = [&](const ParamSet& params, std::string_view prefix) {
        for (const ParamValue& value : params.all())
            if (value.spec->name == name.substr(prefix.size()))
                out.add(param, std::string(prefix) + value.name, value);
    };
    const bool own = list.empty() ? item.params.has(name) : item.params.find_list(list) != nullptr;
    if (own)
        add_from(item.params, "");
    else if (name.starts_with(wind_prefix))
        add_from(wind, wind_prefix);
}

// "what: what to do" in two.
Problem problem_of(const std::string& place, const std::string& text) {
    const size_t cut = text.find(": ");
    if (cut == std::string::npos) return {{place}, text, "see `marram info`"};
    return {{place}, text.substr(0, cut), text.substr(cut + 2)};
}

} // namespace

PluginLibrary::PluginLibrary(const std::string& path, const Place& place) : path_(path) {
    // A bare name would be looked for in the system's folders instead of here.
    const std::string absolute = std::filesystem::absolute(path).string();
    handle_ = dlopen(absolute.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle_) {
        const std::string reason = dlerror();
        if (reason.find("failed to map segment") != std::string::npos ||
            reason.find("annot allocate memory") != std::string::npos)
            throw std::bad_alloc();
        throw InputError(place, "cannot load the procedural library: " + reason,
                         "build it, or mend its path");
    }
    const auto entry = reinterpret_cast<MarramLibraryFunction>(dlsym(handle_, MARRAM_ENTRY_POINT));
    const std::string fix = "build it against core/plugin/marram_plugin.h of this version";
    if (!entry) {
        dlclose(handle_);
        throw InputError(place, "'" + path + "' has no function " MARRAM_ENTRY_POINT, fix);
    }
    table_ = entry(MARRAM_ABI_VERSION);
    if (!table_ || table_->abi != MARRAM_ABI_VERSION) {
        const std::string found = table_ ? " " + std::to_string(table_->abi) : "";
        dlclose(handle_);
        throw InputError(place,
                         "'" + path + "' speaks another version" + found + " of the contract than " +
                             std::to_string(MARRAM_ABI_VERSION),
                         fix);
    }
}

PluginLibrary::~PluginLibrary() { dlclose(handle_); }

const MarramProcedural* PluginLibrary::find(const std::string& type) const {
    for (uint32_t i = 0; i < table_->procedural_count; ++i)
        if (type == table_->procedurals[i].name) return &table_->procedurals[i];
    return nullptr;
}

std::vector<ParamSpec> wind_specs(const MarramLibrary& library) {
    std::vector<ParamSpec> specs;
    for (uint32_t i = 0; i < library.wind_param_count; ++i) specs.push_back(spec_of(library.wind_params[i]));
    return specs;
}

std::vector<ItemSchema> procedural_schemas(const MarramLibrary& library) {
    std::vector<ItemSchema> schemas;
    for (uint32_t i = 0; i < library.procedural_count; ++i) {
        const MarramProcedural& procedural = library.procedurals[i];
        ItemSchema schema{procedural.name, procedural.help, {}};
        schema.params.push_back(
            {"material", ParamType::reference, "", "none", {}, {}, "material", "default: a plain grey"});
        for (uint32_t p = 0; p < procedural.param_count; ++p) {
            ParamSpec spec = spec_of(procedural.params[p]);
            // A list is its elements, so their defaults stay.
            if (spec.name.starts_with(wind_prefix) && list_of(spec.name).empty()) spec.initial = "none";
            schema.params.push_back(std::move(spec));
        }
        schemas.push_back(std::move(schema));
    }
    return schemas;
}

Procedural::Procedural(std::shared_ptr<PluginLibrary> library, const Item& item, const ParamSet& wind,
                       const std::atomic<bool>& cancel)
    : library_(std::move(library)), name_(item.name), place_(item.place), type_(library_->find(item.type)),
      cancel_(&cancel) {
    if (!type_)
        throw InputError(item.place,
                         "the library '" + library_->path() + "' has no procedural '" + item.type + "'",
                         "see `marram info` for what it has");
    ContractValues values;
    for (uint32_t i = 0; i < type_->param_count; ++i) {
        const MarramParam& param = type_->params[i];
        add_values(param, item, wind, values);
        if (param.type == MARRAM_MESH_NAME && item.params.has(param.name))
            meshes_.push_back(item.params.text(param.name));
    }
    host_ = {this, on_message, on_cancelled};
    check(type_->create(&host_, values.data(), values.size(), &instance_));
}

Procedural::~Procedural() {
    if (instance_) type_->destroy(instance_);
}

void Procedural::on_message(void* user, MarramSeverity severity, const char* place, const char* text) {
    Procedural& procedural = *static_cast<Procedural*>(user);
    const std::lock_guard lock(procedural.messages_lock_);
    const std::string where = *place ? place : to_string(procedural.place_);
    if (severity == MARRAM_FAULT)
        procedural.faults_.push_back(problem_of(where, text));
    else if (severity == MARRAM_INFO) // now, while it helps; a progress line is drawn anew
        fmt::print(stderr, "{}{}: {}\n", isatty(STDERR_FILENO) ? "\r\033[K" : "", where, text);
    else
        procedural.warnings_.push_back(where + ": " + text);
}

int Procedural::on_cancelled(void* user) {
    return static_cast<Procedural*>(user)->cancel_->load(std::memory_order_relaxed) ? 1 : 0;
}

void Procedural::check(MarramStatus status) {
    if (status == MARRAM_OK) return;
    if (status == MARRAM_CANCELLED) throw Cancelled{};
    const std::lock_guard lock(messages_lock_);
    if (faults_.empty())
        faults_.push_back(
            {place_, "the procedural '" + name_ + "' failed without saying why", "ask its author"});
    throw InputError(std::exchange(faults_, {}));
}

MarramOutput Procedural::begin(const MarramFrame& frame) {
    MarramOutput output{};
    check(type_->begin(instance_, &frame, &output));
    if (output.kind != type_->kind)
        refuse("it hands over another kind of output than it declares", "mend the library");
    return output;
}

MarramPatch Procedural::patch(uint32_t index) {
    MarramPatch patch{};
    check(type_->patch(instance_, index, &patch));
    return patch;
}

void Procedural::tessellate(uint32_t index, const MarramPatchBuffers& buffers) {
    check(type_->tessellate(instance_, index, &buffers));
}

void Procedural::mesh(const MarramMeshBuffers& buffers) { check(type_->mesh(instance_, &buffers)); }

std::vector<std::pair<std::string, double>> Procedural::report() {
    std::vector<std::pair<std::string, double>> entries;
    type_->report(
        instance_,
        [](void* user, const char* key, double value) {
            static_cast<std::vector<std::pair<std::string, double>>*>(user)->emplace_back(key, value);
        },
        &entries);
    return entries;
}

std::vector<std::string> Procedural::take_warnings() {
    const std::lock_guard lock(messages_lock_);
    return std::exchange(warnings_, {});
}

void Procedural::refuse(const std::string& what, const std::string& fix) const {
    throw InputError(place_, "procedural '" + name_ + "': " + what, fix);
}

} // namespace marram
