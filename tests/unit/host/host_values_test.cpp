// SPDX-License-Identifier: Apache-2.0
// Compares the values that libmarram_host.so (core/plugin/marram_host.h) makes for any host with those of the
// renderer's own host.
#include "tests/unit/world/build_scene.h"

#include "core/host/contract_values.h"
#include "core/host/plugin_library.h"
#include "core/image/image.h"
#include "core/plugin/marram_host.h"
#include "core/scene/param_types.h"
#include "core/scene/values.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <clocale>
#include <cstddef>
#include <cstring>
#include <limits>
#include <locale>
#include <memory>
#include <optional>
#include <random>

namespace marram::testing {
namespace {

struct MessageLog {
    std::vector<std::string> ids, lines; // "place: what: remedy"
    static void message(void* user, const MarramMessage* m) {
        auto& told = *static_cast<MessageLog*>(user);
        told.ids.emplace_back(m->id);
        told.lines.push_back(fmt::format("{}: {}: {}", m->place, m->what, m->remedy));
    }
    MarramHost host() { return {sizeof(MarramHost), this, message, nullptr, nullptr}; }
};

using HostValues = std::unique_ptr<MarramHostValues, decltype(&marram_values_free)>;

HostValues host_values(const ProceduralType& type) {
    return HostValues(marram_values_new(&type.calls), marram_values_free);
}

// Values of a procedural like `type` with this parameter alone.
HostValues values_of(const MarramParam& param, const ProceduralType& type) {
    MarramProcedural calls = type.calls;
    calls.params = &param;
    calls.param_count = 1;
    calls.param_stride = sizeof param;
    calls.item_types = nullptr;
    calls.item_type_count = 0;
    return HostValues(marram_values_new(&calls), marram_values_free);
}

struct Plain { // a value without its pointers
    int type;
    std::vector<double> numbers;
    std::string text;
    bool grid;
    std::optional<Keyframes> keys;
    bool operator==(const Plain&) const = default;
};

std::optional<Keyframes> keys_of(const MarramValue& value) {
    const MarramKeyframes* keys = value.keyframes;
    if (!keys) return {};
    return Keyframes{{keys->frames, keys->frames + keys->count},
                     {keys->numbers, keys->numbers + keys->count * value.number_count},
                     key_interpolation(keys->interpolation).value()};
}

std::map<std::string, Plain> by_name(const MarramValues* values) {
    std::map<std::string, Plain> found;
    for (uint32_t i = 0; values && i < values->count; ++i) {
        const auto* v = MARRAM_AT(MarramValue, values->first, values->stride, i);
        const bool is_new = found
                                .emplace(v->name, Plain{int(v->type),
                                                        {v->numbers, v->numbers + v->number_count},
                                                        v->text,
                                                        v->grid != nullptr,
                                                        keys_of(*v)})
                                .second;
        EXPECT_TRUE(is_new) << v->name;
    }
    return found;
}

// Compares two sets of values by name, so that a difference names its parameter.
void expect_same(const std::map<std::string, Plain>& ours, const std::map<std::string, Plain>& theirs,
                 const std::string& what) {
    for (const auto& [name, value] : theirs) {
        const auto found = ours.find(name);
        if (found == ours.end()) {
            ADD_FAILURE() << what << ": " << name << " is not there";
            continue;
        }
        EXPECT_EQ(found->second.type, value.type) << what << ": " << name;
        EXPECT_EQ(found->second.numbers, value.numbers) << what << ": " << name;
        if (!value.grid) {
            EXPECT_EQ(found->second.text, value.text) << what << ": " << name;
        }
        EXPECT_EQ(found->second.grid, value.grid) << what << ": " << name;
    }
    for (const auto& [name, value] : ours)
        EXPECT_TRUE(theirs.contains(name)) << what << ": " << name << " is too much";
}

// A valid value for a required parameter, as scene text, as simple as possible. Tables and images are files
// in this folder.
std::string something_for(const MarramParam& param, const std::string& folder) {
    const double number = std::clamp(1.0, param.minimum, param.maximum);
    switch (param.type) {
    case MARRAM_VEC2:
        return fmt::format("[{}, {}]", number, number);
    case MARRAM_VEC3:
    case MARRAM_COLOR:
        return fmt::format("[{}, {}, {}]", number, number, number);
    case MARRAM_RANGE:
        return fmt::format("[{}, {}]", number, number);
    case MARRAM_RAMP:
        return fmt::format("[[0, {}]]", number);
    case MARRAM_KEYS:
        return "{}";
    case MARRAM_TEXT:
        return "\"rock\"";
    case MARRAM_CHOICE:
        return fmt::format(
            "\"{}\"", std::string_view(param.choices).substr(0, std::string_view(param.choices).find('|')));
    case MARRAM_MESH_NAME:
        return "\"ground\"";
    case MARRAM_CURVES_NAME:
        return "\"line\"";
    case MARRAM_IMAGE:
        return fmt::format("\"{}/a.png\"", folder);
    case MARRAM_TABLE:
        return fmt::format("\"{}/a.csv\"", folder);
    case MARRAM_VOLUME:
        return fmt::format("\"{}/a.vdb\"", folder);
    default:
        return fmt::format("{}", number);
    }
}

// One procedural with its required values, set in a scene and by marram_host.h.
class Both {
  public:
    Both(const std::shared_ptr<PluginLibrary>& library, const ProceduralType& type)
        : library_(library), type_(type), values_(host_values(type)) {
        folder_ =
            (std::filesystem::temp_directory_path() / fmt::format("marram_host_{}", ::getpid())).string();
        std::filesystem::create_directories(folder_);
        const uint16_t pixels[4] = {9, 9, 9, 9};
        write_grey_png(folder_ + "/a.png", 2, 2, pixels, {});
        std::ofstream(folder_ + "/a.csv") << "hours,speed,direction\n1,5,90\n";
        table_ = "\n[[procedural]]\ntype = \"" + std::string(type.calls.name) + "\"\nname = \"p\"\n";
        for (const MarramParam& param : type.params)
            if (std::string_view(param.name).find("[].") == std::string_view::npos)
                give(param, param.name, param.name);
    }
    ~Both() { std::filesystem::remove_all(folder_); }

    // Adds one element to each list without types.
    void add_elements() {
        std::set<std::string> lists;
        for (const MarramParam& param : type_.params)
            if (const std::string list(list_of(param.name)); !list.empty()) lists.insert(list);
        for (const std::string& list : lists) {
            std::string entries;
            EXPECT_EQ(marram_add(values_.get(), list.c_str(), nullptr), 0) << list;
            for (const MarramParam& param : type_.params)
                if (list_of(param.name) == list && *param.initial == '\0') {
                    const std::string field = std::string(param.name).substr(list.size() + 3);
                    entries += (entries.empty() ? "" : ", ") + field + " = " + something_for(param, folder_);
                    set(param, fmt::format("{}[0].{}", list, field));
                }
            table_ += fmt::format("{} = [{{ {} }}]\n", list, entries);
        }
    }
    // Adds one element of each type to each list with types; lists inside these get an element, too.
    void add_typed_elements() {
        int index = 0;
        for (const ProceduralItemType& item : type_.item_types) {
            const std::string list = item.item.list;
            table_ += fmt::format("[[procedural.{}]]\ntype = \"{}\"\n", list, item.item.type);
            EXPECT_EQ(marram_add(values_.get(), item.item.list, item.item.type), index);
            const std::string prefix = fmt::format("{}[{}].", list, index++);
            std::map<std::string, std::string> lists; // inside it
            for (const MarramParam& param : item.params) {
                const std::string inner(list_of(param.name)), field = param.name;
                if (inner.empty()) {
                    give(param, field, prefix + field);
                    continue;
                }
                std::string& entries = lists[inner];
                if (*param.initial != '\0') continue;
                const std::string name = field.substr(inner.size() + 3);
                entries += (entries.empty() ? "" : ", ") + name + " = " + something_for(param, folder_);
                set(param, fmt::format("{}{}[0].{}", prefix, inner, name));
            }
            for (const auto& [inner, entries] : lists) {
                table_ += fmt::format("{} = [{{ {} }}]\n", inner, entries);
                if (entries.empty()) {
                    EXPECT_EQ(marram_add(values_.get(), (prefix + inner).c_str(), nullptr), 0);
                }
            }
        }
    }

    std::map<std::string, Plain> of_the_renderer() {
        Schema schema = scene_schema();
        schema.wind = wind_specs(*library_);
        schema.procedurals = procedural_schemas(*library_);
        const SceneDescription description = load_scene(
            write_scene(
                mesh("ground", "plane") +
                "\n[[curves]]\nname = \"line\"\ntype = \"points\"\npoints = [[0, 0, 0], [1, 0, 0]]\n" +
                table_),
            {}, schema);
        const CurveAttributes none;
        const ContractValues values(type_, description.procedurals.at(0), description.wind, none);
        const MarramValues list = values.list();
        return by_name(&list);
    }
    std::map<std::string, Plain> of_the_helper() {
        MessageLog told;
        const MarramHost host = told.host();
        const MarramValues* values = marram_values_finish(values_.get(), &host);
        for (const std::string& line : told.lines) ADD_FAILURE() << line;
        return by_name(values);
    }

  private:
    void give(const MarramParam& param, const std::string& key, const std::string& name) {
        if (*param.initial != '\0') return;
        table_ += fmt::format("{} = {}\n", key, something_for(param, folder_));
        set(param, name);
    }
    void set(const MarramParam& param, const std::string& name) {
        static const float pixels[4] = {0.5F, 0.5F, 0.5F, 0.5F};
        static const MarramGrid grid{"a", 2, 2, 1, 1, {}, {}, pixels};
        if (param.type == MARRAM_IMAGE || param.type == MARRAM_TABLE)
            EXPECT_EQ(marram_set_grid(values_.get(), name.c_str(), &grid, nullptr, "a"), MARRAM_OK) << name;
        else
            EXPECT_EQ(marram_set(values_.get(), name.c_str(), something_for(param, folder_).c_str()),
                      MARRAM_OK)
                << name;
    }

    std::shared_ptr<PluginLibrary> library_;
    const ProceduralType& type_;
    HostValues values_;
    std::string folder_, table_;
};

std::shared_ptr<PluginLibrary> own_library() {
    return std::make_shared<PluginLibrary>(default_library, Place{});
}

// For every parameter of every procedural, the helper fills in the same defaults as the renderer's host.
TEST(HostValues, AreTheDeclaredDefaults) {
    const auto library = own_library();
    ASSERT_EQ(library->types().size(), 4u);
    for (const ProceduralType& type : library->types()) {
        Both both(library, type);
        const auto ours = both.of_the_helper(), theirs = both.of_the_renderer();
        EXPECT_GT(theirs.size(), 5u);
        expect_same(ours, theirs, type.calls.name);
    }
}

TEST(HostValues, OfElementsAreTheDeclaredDefaultsToo) {
    const auto library = own_library();
    size_t typed = 0;
    for (const ProceduralType& type : library->types()) {
        Both both(library, type);
        both.add_elements();
        both.add_typed_elements();
        const auto ours = both.of_the_helper(), theirs = both.of_the_renderer();
        expect_same(ours, theirs, type.calls.name);
        for (const auto& [name, value] : theirs) typed += name.ends_with("].type");
    }
    EXPECT_GT(typed, 10u);
}

// The scene loader and the helper accept and refuse the same texts: seeded changes of the declared defaults
// and of others.
TEST(HostValues, ReadWhatAScenesLoaderReads) {
    const auto library = own_library();
    std::mt19937 random(20240607);
    const std::string letters = "0123456789+-.eE_[]{},= '\"k";
    const std::vector<std::string> more = {
        "{ keys = [{ frame = 1, translate = [0, 1, 0] }, { frame = 9, scale = 2 }], interpolation = "
        "\"smooth\" }",
        "{ translate = [1, 2, 3], rotate = [0, 90, 0], scale = [1, 2, 0.5] }",
        "{ knots = [[0, 0.25], [0.5, 1.0,], [1, 0]], interpolation = 'constant' }",
        "{ keys = [[1, 0.5], [24, 0.75]], interpolation = \"smooth\" }",
        "{ keys = [[1, [1, 0, 0]], [24.5, [0, 0, 1]]] }",
        "[[0, 1], [1, 0]]",
        "[0.5, 1]",
        "1_0.2_5e-1",
        "-12",
        "true"};
    const std::vector<ItemSchema> schemas = procedural_schemas(*library);
    size_t taken = 0, refused = 0, keyed = 0;
    for (const ProceduralType& type : library->types())
        for (const MarramParam& param : type.params) {
            const bool is_text = param.type == MARRAM_TEXT || param.type == MARRAM_CHOICE ||
                                 param.type == MARRAM_MESH_NAME || param.type == MARRAM_CURVES_NAME;
            const bool is_file =
                param.type == MARRAM_IMAGE || param.type == MARRAM_TABLE || param.type == MARRAM_VOLUME;
            if (is_text || is_file || std::string_view(param.name).find("[].") != std::string_view::npos)
                continue;
            ParamSpec spec;
            for (const ItemSchema& schema : schemas)
                for (const ParamSpec& one : schema.params)
                    if (schema.type == type.calls.name && one.name == param.name) spec = one;
            const HostValues values = values_of(param, type);
            for (int round = 0; round < 80; ++round) {
                const size_t kind = random() % (more.size() + 4);
                std::string text = kind < more.size() ? more[kind] : param.initial;
                for (size_t edits = random() % 3; edits > 0; --edits) {
                    const size_t at = random() % (text.size() + 1);
                    const char letter = letters[random() % letters.size()];
                    if (random() % 2 == 0 || at == text.size())
                        text.insert(at, 1, letter);
                    else if (random() % 2 == 0)
                        text[at] = letter;
                    else
                        text.erase(at, 1);
                }
                Reading reading;
                spec.initial = text;
                const auto theirs = default_value(spec, "v", Place{}, reading);
                const bool good = marram_set(values.get(), param.name, text.c_str()) == MARRAM_OK;
                EXPECT_EQ(good, theirs.has_value()) << param.name << " = " << text;
                (good ? taken : refused) += 1;
                if (!good || !theirs) continue;
                const auto ours = by_name(marram_values_finish(values.get(), nullptr));
                ASSERT_TRUE(ours.contains(param.name));
                EXPECT_EQ(ours.at(param.name).numbers, theirs->numbers) << param.name << " = " << text;
                EXPECT_EQ(ours.at(param.name).text, theirs->text) << param.name << " = " << text;
                EXPECT_EQ(ours.at(param.name).keys, theirs->keys) << param.name << " = " << text;
                keyed += theirs->keys ? 1 : 0;
            }
        }
    EXPECT_GT(keyed, 30u);
    EXPECT_GT(taken, 500u);
    EXPECT_GT(refused, 500u);
}

const ProceduralType& groom_of(const PluginLibrary& library) { return *library.find("groom"); }

// Some hosts split lines at "=" and keep the blanks.
TEST(HostValues, MayHaveBlanksAround) {
    const auto library = own_library();
    const HostValues values = host_values(groom_of(*library));
    for (const char* needed : {"length", "width"})
        EXPECT_EQ(marram_set(values.get(), needed, " 0.1"), MARRAM_OK) << needed;
    EXPECT_EQ(marram_set(values.get(), "count", " 12 "), MARRAM_OK);
    const std::vector<std::array<const char*, 3>> texts = {{"on", " \"the ground\"\t", "the ground"},
                                                           {"shape", "  ribbon ", "ribbon"},
                                                           {"basis", "bspline\r\n", "bspline"}};
    for (const auto& [name, given, text] : texts) {
        EXPECT_EQ(marram_set(values.get(), name, given), MARRAM_OK) << name;
        EXPECT_EQ(by_name(marram_values_finish(values.get(), nullptr))[name].text, text);
    }
    EXPECT_EQ(marram_set(values.get(), "shape", " rib bon "), MARRAM_ERROR);
}

TEST(HostValues, TellEveryMistakeAtOnce) {
    const auto library = own_library();
    const HostValues values = host_values(groom_of(*library));
    MarramHostValues* v = values.get();
    marram_values_place(v, "host.c:7");
    const double downwards[] = {1, 0.5}, empty[] = {0};
    EXPECT_EQ(marram_set(v, "wind.spede", "3"), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "frequency", "3"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_number(v, "count", 2.5), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "seed", "-1"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_numbers(v, "length", downwards, 2), MARRAM_ERROR);
    EXPECT_EQ(marram_set_text(v, "shape", "ribon"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_ramp(v, "envelope", empty, 0, "linear"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_ramp(v, "clump.profile", downwards, 2, "cubic"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_number(v, "on", 1), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "density_mask", "\"a.png\""), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "wind.gusts.control[1].strength", "1"), MARRAM_OK); // without an element 0
    EXPECT_EQ(marram_set(v, "wind.gusts.control[1].strenght", "1"), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "wind.gusts.control[01].strength", "1"), MARRAM_ERROR);
    EXPECT_EQ(marram_add(v, "wind.gusts", nullptr), -1);
    EXPECT_EQ(marram_add(v, "density_by", "dune"), -1);
    EXPECT_EQ(marram_set(v, "width", "0.01"), MARRAM_OK);
    MessageLog told;
    const MarramHost host = told.host();
    EXPECT_EQ(marram_values_finish(v, &host), nullptr);
    const std::vector<std::string> expected = {
        "host.c:7: wind.spede is unknown: did you mean \"wind.speed\"?",
        "host.c:7: frequency is unknown: did you mean \"frizz.frequency\"?",
        "host.c:7: count is 2.5: give a whole number from 1 to 2e9",
        "host.c:7: seed is -1: give a whole number from 0 to",
        "host.c:7: length runs from 1 down to 0.5: give the lower number first",
        "host.c:7: shape is the text \"ribon\": did you mean \"ribbon\"?",
        "host.c:7: envelope is an empty list: give [[position, value], ...]",
        "host.c:7: clump.profile.interpolation is the text \"cubic\": known are linear, smooth, constant",
        "host.c:7: on is 1: give the name of a mesh or a procedural",
        "host.c:7: density_mask is \"a.png\": read the file, and hand it over by marram_set_grid()",
        "host.c:7: wind.gusts.control[1].strenght is unknown: did you mean "
        "\"wind.gusts.control[].strength\"?",
        "host.c:7: wind.gusts.control[01].strength is unknown: did you mean "
        "\"wind.gusts.control[].strength\"?",
        "host.c:7: wind.gusts is no list: see `marram info groom` for what there is",
        "host.c:7: elements of density_by have no types: leave out \"dune\"",
        "host.c:7: there is wind.gusts.control[1], but no wind.gusts.control[0]: number elements from 0 "
        "without gaps"};
    ASSERT_EQ(told.lines.size(), expected.size()) << fmt::format("{}", fmt::join(told.lines, "\n"));
    for (size_t i = 0; i < expected.size(); ++i)
        EXPECT_TRUE(told.lines[i].starts_with(expected[i])) << told.lines[i];

    // An error is dropped with its cause; a missing value is reported once nothing else is wrong with it.
    for (const char* name : {"wind.spede", "frequency", "count", "seed", "length", "envelope",
                             "clump.profile", "on", "density_mask", "wind.gusts.control[1].strenght",
                             "wind.gusts.control[01].strength", "wind.gusts", "density_by"})
        marram_reset(v, name);
    EXPECT_EQ(marram_set_text(v, "shape", "ribbon"), MARRAM_OK);
    EXPECT_EQ(marram_add(v, "wind.gusts.control", nullptr), 0);
    told = {};
    EXPECT_EQ(marram_values_finish(v, &host), nullptr);
    ASSERT_EQ(told.ids, std::vector<std::string>{"host.missing"});
    EXPECT_TRUE(
        told.lines[0].starts_with(": on is missing: give the name of a mesh or a procedural, in quotes: "))
        << told.lines[0];
    EXPECT_EQ(marram_set_text(v, "on", "ground"), MARRAM_OK);
    EXPECT_EQ(marram_set_number(v, "length", 0.5), MARRAM_OK);
    told = {};
    const auto good = by_name(marram_values_finish(v, &host));
    EXPECT_TRUE(told.lines.empty());
    EXPECT_EQ(good.at("length").numbers, (std::vector<double>{0.5, 0.5}));
    EXPECT_EQ(good.at("shape").text, "ribbon");
    EXPECT_EQ(good.at("wind.gusts.control[1].strength").numbers, std::vector<double>{1});
}

TEST(HostValues, OfTypedElementsNeedTheirType) {
    const auto library = own_library();
    const HostValues values = host_values(*library->find("terrain"));
    MarramHostValues* v = values.get();
    EXPECT_EQ(marram_set(v, "layer[0].amplitude", "3"), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "layer[0].type", "nois"), MARRAM_ERROR);
    MessageLog told;
    const MarramHost host = told.host();
    EXPECT_EQ(marram_values_finish(v, &host), nullptr);
    ASSERT_EQ(told.lines.size(), 2u);
    EXPECT_TRUE(told.lines[0].starts_with(
        ": layer[0].amplitude is set before the type of its element: set layer[0].type first, one of "))
        << told.lines[0];
    EXPECT_EQ(told.lines[1], ": layer[0].type is the text \"nois\": did you mean \"noise\"?");
    EXPECT_EQ(marram_set(v, "layer[0].type", "\"noise\""), MARRAM_OK);
    EXPECT_EQ(marram_set(v, "layer[0].amplitude", "3"), MARRAM_OK);
    const auto noise = by_name(marram_values_finish(v, nullptr));
    EXPECT_EQ(noise.at("layer[0].type").text, "noise");
    EXPECT_EQ(noise.at("layer[0].amplitude").numbers, std::vector<double>{3});
    // Changing the type drops the values of the previous type.
    EXPECT_EQ(marram_set_text(v, "layer[0].type", "ripples"), MARRAM_OK);
    const auto ripples = by_name(marram_values_finish(v, nullptr));
    EXPECT_EQ(ripples.at("layer[0].type").text, "ripples");
    EXPECT_FALSE(ripples.contains("layer[0].amplitude"));
    EXPECT_TRUE(ripples.contains("layer[0].wavelength"));
}

TEST(HostValues, PassAttributesOfCurves) {
    const auto library = own_library();
    const ProceduralType& type = *library->find("strands");
    MessageLog told;
    const MarramHost host = told.host();
    const HostValues values = host_values(type);
    const MarramAttribute wet{"wet", 1, MARRAM_PER_CURVE, 0, "", nullptr, 0};
    ASSERT_EQ(marram_set_curves(values.get(), "curves", "file", &wet, 1), MARRAM_OK);
    for (const char* other : {"width", "on", "shape"}) { // not names of curves
        EXPECT_EQ(marram_set_curves(values.get(), other, "file", &wet, 1), MARRAM_ERROR) << other;
        marram_reset(values.get(), other);
    }
    const double knots[] = {0, 1, 1, 0};
    EXPECT_EQ(marram_set_keys(values.get(), "envelope", knots, 4, "linear"), MARRAM_ERROR); // it is a ramp
    EXPECT_EQ(marram_set_ramp(values.get(), "envelope", knots, 4, "linear"), MARRAM_OK);
    const MarramValues* all = marram_values_finish(values.get(), &host);
    ASSERT_NE(all, nullptr);
    MarramHost whole = host;
    whole.cancelled = [](void*) { return 0; };
    MarramInstance* strands = nullptr;
    ASSERT_EQ(type.calls.create(&whole, all, &strands), MARRAM_OK);
    MarramAttributeList list{};
    list.size = sizeof list;
    ASSERT_EQ(type.calls.attributes_of(strands, &list), MARRAM_OK);
    bool found = false;
    for (uint32_t i = 0; i < list.count; ++i)
        found = found ||
                std::string_view(MARRAM_AT(MarramAttribute, list.attributes, list.stride, i)->name) == "wet";
    EXPECT_TRUE(found);
    type.calls.destroy(strands);
}

TEST(HostValues, ReadEveryTypeOfTheContract) {
    const auto library = own_library();
    for (int type = 0; type < MARRAM_PARAM_TYPE_COUNT; ++type) {
        const MarramTypeForm& form = *marram_type_form(MarramParamType(type));
        ASSERT_NE(form.name, nullptr) << type;
        EXPECT_TRUE(param_type_of(form.name)) << form.name << ": not in core/scene/param_types.cpp";
        if (form.components > 0 || type == MARRAM_VOLUME) continue; // only as a grid, as a volume
        if (type == MARRAM_UNAVAILABLE) continue;
        std::string written = form.numbers == 1 ? "1" : form.numbers == 2 ? "[0, 1]" : "[0, 1, 2]";
        if (form.flags & MARRAM_ZERO_OR_ONE) written = "true";
        if (form.flags & MARRAM_ITEMS) written = form.numbers == 2 ? "[[0, 1]]" : "{ translate = [0, 1, 2] }";
        if (form.text != MARRAM_NO_TEXT && form.numbers == 0) written = "name";
        const MarramParam param{"p", MarramParamType(type), "", "", -10, 10, "name|other", "", "", ""};
        const HostValues values = values_of(param, groom_of(*library));
        EXPECT_EQ(marram_set(values.get(), "p", written.c_str()), MARRAM_OK) << form.name;
        const auto found = by_name(marram_values_finish(values.get(), nullptr));
        ASSERT_EQ(found.count("p"), 1u) << form.name;
        EXPECT_EQ(found.at("p").type, type);
    }
    EXPECT_EQ(marram_type_form(MARRAM_PARAM_TYPE_COUNT), nullptr);
}

// NULL for every argument in turn, and texts that would be wrong only later in a scene.
TEST(HostValues, RefuseWhatIsMissing) {
    const auto library = own_library();
    const HostValues values = host_values(groom_of(*library));
    MarramHostValues* v = values.get();
    const double number = 1;
    EXPECT_EQ(marram_values_new(nullptr), nullptr);
    MarramProcedural none{};
    EXPECT_EQ(marram_values_new(&none), nullptr);
    marram_values_free(nullptr);
    marram_values_place(nullptr, "a");
    marram_values_place(v, nullptr);
    marram_reset(nullptr, "on");
    marram_reset(v, nullptr);
    marram_reset(v, "never.set");
    EXPECT_EQ(marram_values_finish(nullptr, nullptr), nullptr);
    EXPECT_EQ(marram_add(nullptr, "layer", nullptr), -1);
    EXPECT_EQ(marram_add(v, nullptr, nullptr), -1);
    for (MarramHostValues* of : {v, static_cast<MarramHostValues*>(nullptr)})
        for (const char* name : {"on", static_cast<const char*>(nullptr)}) {
            if (of && name) continue;
            EXPECT_EQ(marram_set(of, name, "1"), MARRAM_ERROR);
            EXPECT_EQ(marram_set_number(of, name, 1), MARRAM_ERROR);
            EXPECT_EQ(marram_set_numbers(of, name, &number, 1), MARRAM_ERROR);
            EXPECT_EQ(marram_set_text(of, name, "a"), MARRAM_ERROR);
            EXPECT_EQ(marram_set_ramp(of, name, &number, 1, "linear"), MARRAM_ERROR);
            EXPECT_EQ(marram_set_keys(of, name, &number, 1, "linear"), MARRAM_ERROR);
            EXPECT_EQ(marram_set_grid(of, name, nullptr, nullptr, nullptr), MARRAM_ERROR);
            EXPECT_EQ(marram_set_volume(of, name, nullptr, nullptr), MARRAM_ERROR);
            EXPECT_EQ(marram_set_curves(of, name, "a", nullptr, 0), MARRAM_ERROR);
        }
    EXPECT_EQ(marram_set(v, "on", nullptr), MARRAM_ERROR);
    EXPECT_EQ(marram_set_text(v, "on", nullptr), MARRAM_ERROR);
    EXPECT_EQ(marram_set_curves(v, "on", nullptr, nullptr, 0), MARRAM_ERROR);
    EXPECT_EQ(marram_set_numbers(v, "length", nullptr, 1), MARRAM_ERROR);
    EXPECT_EQ(marram_set_ramp(v, "envelope", nullptr, 2, "linear"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_ramp(v, "envelope", nullptr, 0, nullptr), MARRAM_ERROR);
    EXPECT_EQ(marram_set_keys(v, "envelope", nullptr, 10, "linear"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_grid(v, "density_mask", nullptr, nullptr, "a"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_text(v, "on", ""), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "on", "\"a\\u0000b\""), MARRAM_ERROR); // a zero byte would end the name
    EXPECT_EQ(marram_values_finish(v, nullptr), nullptr);
}

// The helper passes them on; the library checks their numbers.
TEST(HostValues, MayBeVolumes) {
    const auto library = own_library();
    const ProceduralType& groom = groom_of(*library);
    const HostValues values = host_values(groom);
    MarramHostValues* v = values.get();
    for (const char* needed : {"length", "width"}) EXPECT_EQ(marram_set(v, needed, "0.1"), MARRAM_OK);
    EXPECT_EQ(marram_set(v, "count", "12"), MARRAM_OK);
    EXPECT_EQ(marram_set(v, "on", "ground"), MARRAM_OK);
    const char* name = "wind.field[0].velocities";
    std::vector<float> numbers(24, 1.0F);
    MarramGrid grids[2] = {{"a", 2, 2, 2, 3, {}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, numbers.data()}};
    grids[1] = grids[0];
    const double frames[] = {1.0, 2.0};
    MarramVolume volume{sizeof volume, 2, sizeof(MarramGrid), grids, frames, 0};
    EXPECT_EQ(marram_set(v, name, "\"a.vdb\""), MARRAM_ERROR); // this library reads no files
    EXPECT_EQ(marram_set_volume(v, "length", &volume, "a.vdb"), MARRAM_ERROR);
    EXPECT_EQ(marram_set(v, "length", "0.1"), MARRAM_OK);
    EXPECT_EQ(marram_set_volume(v, name, &volume, "a.vdb"), MARRAM_OK);
    EXPECT_EQ(marram_set(v, "wind.field[0].shape", "grid"), MARRAM_OK);
    const auto refusal = [&] {
        MessageLog told;
        MarramHost host = told.host();
        host.cancelled = marram_never_cancelled;
        const MarramValues* all = marram_values_finish(v, &host);
        MarramInstance* instance = nullptr;
        if (all && groom.calls.create(&host, all, &instance) == MARRAM_OK) groom.calls.destroy(instance);
        return fmt::format("{}", fmt::join(told.lines, "\n"));
    };
    EXPECT_EQ(refusal(), "");
    const auto expect_fault = [&](const char* fault) {
        EXPECT_NE(refusal().find(fault), std::string::npos) << fault << ": " << refusal();
    };
    numbers[7] = std::nanf("");
    expect_fault("grid 0 has vectors that are not finite");
    numbers[7] = 1.0F;
    grids[1].axes[2][2] = 0.0;
    expect_fault("grid 1 has a place that is not usable");
    grids[1] = grids[0];
    grids[1].components = 2;
    expect_fault("grid 1 does not have");
    grids[1].components = 3;
    volume.frames = nullptr;
    expect_fault("several grids without frames");
    const double backwards[] = {2.0, 1.0};
    volume.frames = backwards;
    expect_fault("does not ascend in frames");
    volume.frames = frames;
    volume.size = offsetof(MarramVolume, staggered); // an older host
    EXPECT_EQ(refusal(), "");
    volume.size = 0;
    EXPECT_EQ(marram_set_volume(v, name, &volume, "a.vdb"), MARRAM_ERROR);
}

TEST(HostValues, AreLentAsTheyWereHandedOver) {
    const auto library = own_library();
    const HostValues values = host_values(groom_of(*library));
    MarramHostValues* v = values.get();
    const float pixels[2] = {0, 1};
    MarramGrid grid{"mask", 2, 1, 1, 5, {}, {}, pixels};
    MarramPlacement placement{};
    placement.size = sizeof placement;
    EXPECT_EQ(marram_set_grid(v, "density_mask", &grid, &placement, "mask.png"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_grid(v, "length", &grid, &placement, "mask.png"), MARRAM_ERROR);
    grid.components = 1;
    marram_values_place(v, "host.txt:3");
    EXPECT_EQ(marram_set_grid(v, "density_mask", &grid, &placement, "mask.png"), MARRAM_OK);
    marram_values_place(v, "host.txt:4");
    const double length[] = {0.1, 0.3};
    const double keys[] = {7, 0.5, 0, 0.5, 0, 90, 0, 1, 2, -1, 9, 0, 0, 0, 0, 0, 0, 1, 1, 1};
    EXPECT_EQ(marram_set_numbers(v, "length", length, 2), MARRAM_OK);
    EXPECT_EQ(marram_set_number(v, "width", 0.01), MARRAM_OK);
    EXPECT_EQ(marram_set_number(v, "count", 3), MARRAM_OK);
    EXPECT_EQ(marram_set_text(v, "on", "ground"), MARRAM_OK);
    const char* transform = "wind.gusts.control[0].transform";
    EXPECT_EQ(marram_set_keys(v, transform, keys, 19, "smooth"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_keys(v, transform, keys, 20, "constant"), MARRAM_ERROR);
    EXPECT_EQ(marram_set_keys(v, transform, keys, 20, "smooth"), MARRAM_OK);
    EXPECT_EQ(marram_set_ramp(v, "envelope", length, 2, "constant"), MARRAM_OK);
    MessageLog told;
    const MarramHost host = told.host();
    const MarramValues* all = marram_values_finish(v, &host);
    ASSERT_NE(all, nullptr) << fmt::format("{}", fmt::join(told.lines, "\n"));
    const auto found = by_name(all);
    EXPECT_EQ(found.at("length").numbers, std::vector<double>(length, length + 2));
    EXPECT_EQ(found.at("count").numbers, std::vector<double>{3});
    EXPECT_EQ(found.at(transform).numbers, std::vector<double>(keys, keys + 20));
    EXPECT_EQ(found.at(transform).text, "smooth");
    EXPECT_EQ(found.at("envelope").numbers, std::vector<double>(length, length + 2));
    EXPECT_EQ(found.at("envelope").text, "constant");
    std::map<std::string, std::string> places;
    for (uint32_t i = 0; i < all->count; ++i) {
        const auto* one = MARRAM_AT(MarramValue, all->first, all->stride, i);
        places[one->name] = one->place;
        if (one->name != std::string("density_mask")) continue;
        EXPECT_EQ(one->grid, &grid);
        EXPECT_EQ(one->placement, &placement);
        EXPECT_STREQ(one->text, "mask.png");
    }
    EXPECT_EQ(places.at("density_mask"), "host.txt:3");
    EXPECT_EQ(places.at("width"), "host.txt:4");
    EXPECT_EQ(places.at("wind.gusts.control[0].strength"), "host.txt:4"); // the place of its element
    EXPECT_EQ(places.at("seed"), "");
}

// A decimal comma, in the locale of the C and of the C++ library, changes neither values nor messages.
TEST(HostValues, DoNotDependOnTheLocale) {
    struct Comma : std::numpunct<char> {
        char do_decimal_point() const override { return ','; }
        char do_thousands_sep() const override { return '.'; }
        std::string do_grouping() const override { return "\3"; }
    };
    const auto library = own_library();
    const auto run = [&] {
        const HostValues values = host_values(groom_of(*library));
        MarramHostValues* v = values.get();
        EXPECT_EQ(marram_set(v, "length", "[0.125, 1.5e-1]"), MARRAM_OK);
        EXPECT_EQ(marram_set(v, "width", "0.01"), MARRAM_OK);
        EXPECT_EQ(marram_set(v, "count", "12345"), MARRAM_OK);
        EXPECT_EQ(marram_set(v, "on", "a"), MARRAM_OK);
        std::map<std::string, Plain> all = by_name(marram_values_finish(v, nullptr));
        EXPECT_EQ(all.at("length").numbers, (std::vector<double>{0.125, 0.15}));
        EXPECT_EQ(marram_set(v, "width", "0,01"), MARRAM_ERROR);
        EXPECT_EQ(marram_set_number(v, "count", 12345.5), MARRAM_ERROR);
        MessageLog told;
        const MarramHost host = told.host();
        marram_values_finish(v, &host);
        return std::pair(all, told.lines);
    };
    const auto plain = run();
    EXPECT_EQ(plain.second.size(), 2u);
    const std::locale before = std::locale::global(std::locale(std::locale(), new Comma));
    const std::string c_locale = std::setlocale(LC_ALL, nullptr);
    for (const char* name : {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8"}) // if the machine has one of them
        if (std::setlocale(LC_ALL, name)) break;
    const auto commas = run();
    std::setlocale(LC_ALL, c_locale.c_str());
    std::locale::global(before);
    EXPECT_TRUE(commas == plain) << fmt::format("{}", fmt::join(commas.second, "\n"));
}

// A search through all elements for each of them would take minutes.
TEST(HostValues, MayHaveThousandsOfElements) {
    const auto library = own_library();
    const HostValues terrain = host_values(*library->find("terrain")),
                     grass = host_values(groom_of(*library));
    for (const char* name : {"length", "width", "count"})
        EXPECT_EQ(marram_set_number(grass.get(), name, 1), MARRAM_OK) << name;
    EXPECT_EQ(marram_set(grass.get(), "on", "a"), MARRAM_OK);
    constexpr int count = 10000;
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < count; ++i) {
        const std::string layer = fmt::format("layer[{}]", i),
                          gust = fmt::format("wind.gusts.control[{}]", i);
        ASSERT_EQ(marram_add(terrain.get(), "layer", "noise"), i);
        ASSERT_EQ(marram_set_number(terrain.get(), (layer + ".amplitude").c_str(), i), MARRAM_OK);
        ASSERT_EQ(marram_set(terrain.get(), (layer + ".amplitud").c_str(), "1"), MARRAM_ERROR);
        ASSERT_EQ(marram_add(grass.get(), "wind.gusts.control", nullptr), i);
        ASSERT_EQ(marram_set(grass.get(), (gust + ".strength").c_str(), "0.5"), MARRAM_OK);
    }
    const auto all = by_name(marram_values_finish(grass.get(), nullptr));
    EXPECT_EQ(all.at("wind.gusts.control[9999].strength").numbers, std::vector<double>{0.5});
    EXPECT_GT(all.size(), 3u * count);
    MessageLog told;
    const MarramHost host = told.host();
    EXPECT_EQ(marram_values_finish(terrain.get(), &host), nullptr);
    EXPECT_EQ(told.lines.size(), size_t(count));
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    EXPECT_LT(seconds.count(), 60.0);
}

// Deep nesting, control characters, huge numbers and random bytes, as names and as values.
TEST(HostValues, SurviveGarbage) {
    const auto library = own_library();
    std::mt19937 random(7);
    const std::string quotes(3, '\'');
    std::string dots = "a";
    for (int i = 0; i < 100000; ++i) dots += ".a";
    std::vector<std::string> texts = {std::string(100000, '['),
                                      std::string(100000, '{'),
                                      std::string(1000000, '9'),
                                      std::string(1000000, 'x'),
                                      "{ " + dots + " = 1 }",
                                      dots,
                                      quotes,
                                      quotes + "\n" + dots + " = " + quotes,
                                      "\"\"\"",
                                      "1\nb = 2",
                                      "{}\n[value.a]",
                                      "[1]\n[[value]]",
                                      "1e999",
                                      "nan",
                                      "-inf",
                                      "99999999999999999999",
                                      "0x7fffffffffffffff",
                                      "1979-05-27T07:32:00Z",
                                      "\x01\x02\x7f",
                                      "\xff\xfe\xc0\x80",
                                      "\"\\ud800\"",
                                      "# only a comment",
                                      "",
                                      " ",
                                      "\r",
                                      "[[[[0, 1]]]]",
                                      "layer[0]",
                                      "%s%n"};
    const std::string letters = "[]{}=.,\"'\\#\n0e-+_a";
    for (int i = 0; i < 400; ++i) {
        std::string& text = texts.emplace_back();
        for (size_t size = random() % 40; size > 0; --size)
            text += i % 2 == 0 ? char(1 + random() % 255) : letters[random() % letters.size()];
    }
    const std::vector<std::string> fields = {
        "on",       "count",          "length",        "shape",
        "envelope", "density_mask",   "mesh",          "wind.gusts.control[0].transform",
        "curves",   "wind.direction", "layer[0].type", "layer[0].amplitude"};
    const double numbers[10] = {1e308, -1e308, std::numeric_limits<double>::quiet_NaN(), 0, 1, 2, 3, 4, 5, 6};
    for (const ProceduralType& type : library->types()) {
        const HostValues values = host_values(type);
        MarramHostValues* v = values.get();
        for (const std::string& text : texts) {
            for (const std::string& field : fields) {
                marram_set(v, field.c_str(), text.c_str());
                marram_set_text(v, field.c_str(), text.c_str());
            }
            const char* field = fields[random() % fields.size()].c_str();
            marram_set(v, text.c_str(), "1");
            marram_set_numbers(v, field, numbers, random() % 10);
            marram_set_ramp(v, field, numbers, random() % 10, text.c_str());
            marram_set_keys(v, field, numbers, 10, text.c_str());
            marram_set_curves(v, field, text.c_str(), nullptr, 1);
            marram_add(v, text.c_str(), text.c_str());
            marram_add(v, "layer", text.c_str());
            marram_set(v, ("layer[0]." + text).c_str(), "1");
            marram_set(v, (text + "[0].a").c_str(), "1");
            marram_set(v, ("wind.gusts.control[" + text + "].strength").c_str(), "1");
            marram_reset(v, text.c_str());
        }
        MessageLog told;
        const MarramHost host = told.host();
        EXPECT_EQ(marram_values_finish(v, &host), nullptr) << type.calls.name;
        EXPECT_GT(told.lines.size(), 100u);
        for (const std::string& line : told.lines) {
            EXPECT_EQ(line.find_first_of("\n\r\x01\x7f"), std::string::npos) << line;
            EXPECT_LT(line.size(), 2000u) << line;
        }
        EXPECT_EQ(std::ranges::count(told.ids, "host.memory"), 0);
    }
}

TEST(HostValues, ReportThatMemoryIsShort) {
    const auto library = own_library();
    const HostValues values = host_values(groom_of(*library));
    const double number = 1;
    EXPECT_EQ(marram_set_numbers(values.get(), "length", &number, SIZE_MAX / 4), MARRAM_ERROR);
    MessageLog told;
    const MarramHost host = told.host();
    EXPECT_EQ(marram_values_finish(values.get(), &host), nullptr);
    EXPECT_EQ(std::ranges::count(told.ids, "host.memory"), 1);
    told = {};
    EXPECT_EQ(marram_values_finish(values.get(), &host), nullptr);
    EXPECT_EQ(std::ranges::count(told.ids, "host.memory"), 0); // said once
}

TEST(HostValues, FindAProcedural) {
    MessageLog told;
    const MarramHost host = told.host();
    MarramProcedural found;
    MarramProcedural one = groom_of(*own_library()).calls; // its texts are freed with the library
    const MarramParam param{"p",    MarramParamType(MARRAM_PARAM_TYPE_COUNT), "", "0", 0, 1, "", "", nullptr,
                            nullptr};
    one.name = "groom", one.help = "", one.params = &param, one.param_count = 0,
    one.param_stride = sizeof param;
    MarramLibrary library{MARRAM_ABI_VERSION, MARRAM_EMBREE_MAJOR, sizeof(MarramLibrary), "l", "1"};
    library.procedurals = &one, library.procedural_count = 1, library.procedural_stride = sizeof one;
    EXPECT_EQ(marram_find_procedural(&library, "groom", &host, &found), MARRAM_OK);
    EXPECT_EQ(found.create, one.create);
    EXPECT_TRUE(told.lines.empty());
    EXPECT_EQ(marram_load_procedural(default_library.c_str(), "groom", &host, &found), MARRAM_OK);
    EXPECT_STREQ(found.name, "groom");
    EXPECT_EQ(marram_load_procedural("/nowhere/lib.so", "groom", &host, &found), MARRAM_ERROR);
    EXPECT_EQ(marram_load_procedural(nullptr, "groom", &host, &found), MARRAM_ERROR);
    EXPECT_EQ(marram_load_procedural(default_library.c_str(), nullptr, &host, &found), MARRAM_ERROR);
    EXPECT_EQ(told.ids, (std::vector<std::string>{"host.library", "host.library"}));
    EXPECT_TRUE(told.lines[0].ends_with(": give the path of a procedural library")) << told.lines[0];
    const auto refuses = [&](const MarramLibrary* given, const char* name, const std::string& line) {
        told = {};
        EXPECT_EQ(marram_find_procedural(given, name, &host, &found), MARRAM_ERROR);
        ASSERT_EQ(told.lines.size(), 1u) << line;
        EXPECT_EQ(told.lines[0], line);
    };
    refuses(nullptr, "groom",
            fmt::format(": the library speaks another version of the contract than {}: build both with one "
                        "marram_plugin.h",
                        MARRAM_ABI_VERSION));
    refuses(&library, "grom", ": the library has no procedural \"grom\": did you mean \"groom\"?");
    MarramLibrary other = library;
    other.embree_major = MARRAM_EMBREE_MAJOR + 1;
    refuses(
        &other, "groom",
        fmt::format(
            ": the library was built with Embree {}, this host with Embree {}: build both with one Embree",
            MARRAM_EMBREE_MAJOR + 1, MARRAM_EMBREE_MAJOR));
    other = library;
    other.procedural_stride = 0;
    refuses(&other, "groom", ": the library has an array whose stride is 0: give the size of its elements");
    other.size = 0;
    refuses(&other, "groom",
            ": the library has not set MarramLibrary.size: set it to the size of the struct");
    one.param_count = 1;
    refuses(
        &library, "groom",
        ": \"groom\" cannot be used: its parameter p has a type that this version of the contract does not "
        "know: use a library and a host of one version");
    one.param_count = 0, one.begin = nullptr;
    refuses(&library, "groom",
            ": \"groom\" cannot be used: it lacks a function that the contract asks for: use a library and a "
            "host of one "
            "version");
}

// Structs of a host that was compiled with an older header are smaller, those of a newer one larger.
TEST(HostValues, WorkWithHostsOfOtherHeaders) {
    const auto library = own_library();
    MarramProcedural one = groom_of(*library).calls;
    MarramLibrary lent{MARRAM_ABI_VERSION, MARRAM_EMBREE_MAJOR, sizeof(MarramLibrary), "l", "1"};
    lent.procedurals = &one, lent.procedural_count = 1, lent.procedural_stride = sizeof one;
    struct {
        MarramProcedural known;
        char more[64];
    } larger;
    const size_t old_size = offsetof(MarramProcedural, item_types);
    for (const size_t size : {old_size, sizeof larger}) {
        std::memset(&larger, 0x55, sizeof larger);
        ASSERT_EQ(
            marram_find_procedural_for(MARRAM_EMBREE_MAJOR, &lent, "groom", nullptr, &larger.known, size),
            MARRAM_OK);
        EXPECT_EQ(larger.known.create, one.create);
        const char* bytes = reinterpret_cast<const char*>(&larger);
        const size_t copied = std::min(size, sizeof one);
        EXPECT_EQ(std::count(bytes + copied, bytes + size, 0), std::ptrdiff_t(size - copied));
        EXPECT_EQ(std::count(bytes + size, bytes + sizeof larger, 0x55),
                  std::ptrdiff_t(sizeof larger - size));
        const HostValues values(marram_values_new_for(&larger.known, size), marram_values_free);
        ASSERT_NE(values, nullptr);
        EXPECT_EQ(marram_set(values.get(), "count", "7"), MARRAM_OK);
    }
    // The attributes of curves have the stride that the host gives.
    struct {
        MarramAttribute known;
        double more;
    } attributes[2] = {{{"wet", 1, MARRAM_PER_CURVE}, 0}, {{"dry", 1, MARRAM_PER_CURVE}, 0}};
    const HostValues values = host_values(*library->find("strands"));
    EXPECT_EQ(
        marram_set_curves_for(values.get(), "curves", "line", &attributes[0].known, 2, sizeof *attributes),
        MARRAM_OK);
    EXPECT_EQ(marram_set(values.get(), "width", "0.01"), MARRAM_OK);
    const MarramValues* all = marram_values_finish(values.get(), nullptr);
    ASSERT_NE(all, nullptr);
    int found = 0;
    for (uint32_t i = 0; i < all->count; ++i) {
        const auto* value = MARRAM_AT(MarramValue, all->first, all->stride, i);
        if (value->attribute_count == 0) continue;
        const auto* second = MARRAM_AT(MarramAttribute, value->attributes, value->attribute_stride, 1);
        EXPECT_STREQ(second->name, "dry");
        ++found;
    }
    EXPECT_EQ(found, 1);
}

TEST(HostHelper, LendsMeshesThatDoNotMove) {
    const float positions[6] = {0, 1, 2, 3, 4, 5}, normals[6] = {0, 1, 0, 1, 0, 0};
    const float *const position_steps[1] = {positions}, *const normal_steps[1] = {normals};
    MarramMesh meshes[2] = {marram_static_mesh("one", 3, position_steps, 1, nullptr, 0),
                            marram_static_mesh("two", 4, position_steps, 2, nullptr, 0)};
    meshes[1].normals = normal_steps;
    const double time = 7.0;
    MarramFrame frame = marram_default_frame(&time, 1);
    marram_lend_static(&frame, meshes, 2);
    EXPECT_EQ(frame.frame, 7.0);
    ASSERT_EQ(frame.mesh_count, 2u);
    float p[6] = {}, n[6] = {};
    EXPECT_EQ(frame.pose(frame.pose_user, 0, 1.0, p, n), MARRAM_OK);
    EXPECT_EQ(std::vector<float>(p, p + 4), (std::vector<float>{0, 1, 2, 0}));
    EXPECT_EQ(std::vector<float>(n, n + 2), (std::vector<float>{0, 0})); // it has none
    EXPECT_EQ(frame.pose(frame.pose_user, 1, -5.0, p, n), MARRAM_OK);
    EXPECT_TRUE(std::equal(p, p + 6, positions) && std::equal(n, n + 6, normals));
    EXPECT_EQ(frame.pose(frame.pose_user, 1, -5.0, p, nullptr), MARRAM_OK);
}

TEST(HostHelper, CountsTheSegmentsOfCurves) {
    MarramOutput output{};
    EXPECT_EQ(marram_segment_count(&output), 0u);
    output.curve_count = 2;
    output.cvs_per_curve = 3;
    std::vector<uint32_t> indices(marram_segment_count(&output));
    marram_segment_indices(&output, indices.data());
    EXPECT_EQ(indices, (std::vector<uint32_t>{0, 1, 5, 6})); // 3 + 2 vertices a curve
    const uint64_t offsets[3] = {0, 2, 6};
    output.offsets = offsets, output.cvs_per_curve = 0;
    indices.assign(marram_segment_count(&output), 0);
    marram_segment_indices(&output, indices.data());
    EXPECT_EQ(indices, (std::vector<uint32_t>{0, 4, 5, 6}));
}

} // namespace
} // namespace marram::testing
