// SPDX-License-Identifier: Apache-2.0
// The functions of core/plugin/marram_host.h for values by name, which core/scene reads and checks.
// Setting a value takes microseconds, whatever the lengths of lists; finishing takes microseconds a value. All
// errors are mistakes of the host, except host.memory.
#include "core/host_values/declarations.h"
#include "core/host_values/interface.h"
#include "core/math/known_part.h"
#include "core/scene/param_types.h"
#include "core/scene/suggest.h"
#include "core/scene/values.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>

namespace marram {
namespace {

// A value that the host has set.
struct Setting {
    ParamValue value;
    MarramValue parts{}; // its grid, placement, volume and attributes
};

// What is wrong with the last value of a name.
struct Complaint {
    std::string name;
    Problem problem;
};

// An element of a list: "layer[2]".
struct Element {
    std::string place;
    const ItemSchema* item = nullptr; // its type, if elements of the list have types
};

// Where a name is declared.
struct Owner {
    const std::vector<ParamSpec>* specs; // nullptr: the type of the element is not set yet
    const ListSchema* list;              // whose elements have types; nullptr: not in such a list
    std::string element;                 // of this list: "layer[0]"
    std::string declared;                // "edit[].id" of "layer[0].edit[1].id"
    bool is_type() const { return list && declared == "type"; }
};

// The position after the `[12]` at `open`, npos if there is none. Leading zeros are invalid, so that an
// element has only one name.
size_t end_of_index(std::string_view name, size_t open) {
    if (open >= name.size() || name[open] != '[') return std::string::npos;
    const size_t end = std::min(name.find_first_not_of("0123456789", open + 1), name.size());
    const size_t digits = end - open - 1;
    const bool good = digits > 0 && digits < 10 && (digits == 1 || name[open + 1] != '0');
    return good && name.substr(end).starts_with(']') ? end + 1 : std::string::npos;
}

// Calls visit(begin, end) for each `[12].` of the name; `end` is that of the bracket.
void each_index(std::string_view name, auto visit) {
    for (size_t open = name.find('['); open != std::string::npos; open = name.find('[', open + 1))
        if (const size_t end = end_of_index(name, open); end < name.size() && name[end] == '.')
            visit(open, end);
}

// "gusts.control[12].shape" -> "gusts.control[].shape"
std::string declared_name(std::string_view name) {
    std::string declared;
    size_t done = 0;
    each_index(name, [&](size_t open, size_t end) {
        declared.append(name, done, open - done).append("[]");
        done = end;
    });
    return declared.append(name, done);
}

// Removes what is in an element: names that begin with "layer[2].".
void erase_within(auto& map, const std::string& element) {
    const std::string first = element + ".", end = element + "/"; // the character after the point
    map.erase(map.lower_bound(first), map.lower_bound(end));
}

bool is_grid(const ParamSpec& spec) { return spec.type == ParamType::image || spec.type == ParamType::table; }
bool is_volume(const ParamSpec& spec) { return spec.type == ParamType::volume; }
bool is_read_by_host(const ParamSpec& spec) { return is_grid(spec) || is_volume(spec); }

std::string remedy_for(const ParamSpec& spec) {
    return is_grid(spec)     ? "read the file, and hand it over by marram_set_grid()"
           : is_volume(spec) ? "read the files, and hand them over by marram_set_volume()"
                             : "give " + wanted(spec);
}

// Checks what a scene checks later than when it reads a value: empty names, zero bytes in texts.
bool is_good(const ParamValue& value) {
    const ParamSpec& spec = *value.spec;
    const MarramTypeForm* form = marram_type_form(contract_type(spec));
    size_t index = 0;
    return value.text.find('\0') == std::string::npos &&
           marram_value_fault(form, spec.minimum, spec.maximum, spec.choices.c_str(), value.numbers.data(),
                              value.numbers.size(), value.text.c_str(), &index) == MARRAM_GOOD;
}

// Calls take(number): whole numbers are integers, as in a scene.
void number_to(double x, auto take) {
    if (x == std::floor(x) && std::fabs(x) < 0x1p53)
        take(static_cast<int64_t>(x));
    else
        take(x);
}

toml::array array_of(const double* numbers, size_t count) {
    toml::array array;
    array.reserve(count);
    for (size_t i = 0; i < count; ++i) number_to(numbers[i], [&](auto x) { array.push_back(x); });
    return array;
}

toml::table key_of(const double* numbers, size_t) {
    toml::table key{{"translate", array_of(numbers + 1, 3)},
                    {"rotate", array_of(numbers + 4, 3)},
                    {"scale", array_of(numbers + 7, 3)}};
    number_to(numbers[0], [&](auto frame) { key.insert("frame", frame); });
    return key;
}

// { <name> = [...], interpolation = "..." } with items of `each` numbers, of which the last may be shorter.
toml::table items_of(const char* name, const double* numbers, size_t count, size_t each,
                     const char* interpolation, auto make) {
    toml::array items;
    for (size_t i = 0; i < count; i += each) items.push_back(make(numbers + i, std::min(each, count - i)));
    return toml::table{{name, std::move(items)},
                       {"interpolation", std::string(interpolation ? interpolation : "")}};
}

// A value's node as value_table() would return it.
toml::table table_of(auto node) { return toml::table{{"value", std::move(node)}}; }

} // namespace
} // namespace marram

using namespace marram;

struct MarramHostValues {
    ProceduralType type;
    std::vector<ParamSpec> specs;
    std::vector<ListSchema> lists; // whose elements have types
    std::string place;
    std::map<std::string, Setting> settings;
    std::map<std::string, Element> elements;
    std::map<std::string, size_t> sizes; // of lists, as far as marram_add() knows
    std::vector<Complaint> complaints;
    bool no_memory = false; // since the last finish
    Reading reading;
    // Results of the last finish.
    std::deque<ParamValue> defaults;
    std::vector<MarramValue> all;
    std::deque<MarramKeyframes> keyframes; // of `all`
    MarramValues lent{};

    explicit MarramHostValues(ProceduralType of)
        : type(std::move(of)), specs(specs_of(type.params)), lists(lists_of(type)) {
        for (ParamSpec& spec : specs) spec.each = false; // a host makes an instance for each itself
    }

    Owner owner_of(const std::string& name) const {
        const size_t open = std::min(name.find('['), name.size()), end = end_of_index(name, open);
        const auto list = std::ranges::find(lists, name.substr(0, open), &ListSchema::name);
        if (list == lists.end() || end >= name.size() || name[end] != '.')
            return {&specs, nullptr, "", declared_name(name)};
        Owner owner{nullptr, &*list, name.substr(0, end), declared_name(name.substr(end + 1))};
        const auto element = elements.find(owner.element);
        if (element != elements.end() && element->second.item) owner.specs = &element->second.item->params;
        return owner;
    }

    void complain(const std::string& name, const char* id, std::string what, std::string fix) {
        complaints.push_back({name, {{place}, std::move(what), std::move(fix), id}});
    }

    void forget_complaints(const std::string& name) {
        std::erase_if(complaints, [&](const Complaint& complaint) { return complaint.name == name; });
    }

    std::string see_info() const {
        return fmt::format("see `marram info {}` for what there is", type.calls.name);
    }

    std::string remedy_for_unknown(const Owner& owner) const {
        std::vector<std::string> names;
        std::string inner; // "noise.frequency" if "frequency" was given
        for (const ParamSpec& spec : *owner.specs) {
            names.push_back(spec.name);
            if (inner.empty() && spec.name.ends_with("." + owner.declared)) inner = spec.name;
        }
        const std::string near = nearest(owner.declared, names), &best = near.empty() ? inner : near;
        return best.empty() ? see_info() : fmt::format("did you mean {}?", in_quotes(best));
    }

    // The declaration of a name; nullptr after a complaint.
    const ParamSpec* declaration(const std::string& name, const Owner& owner) {
        if (owner.is_type()) return &owner.list->type;
        if (!owner.specs) {
            complain(name, "host.list", fmt::format("{} is set before the type of its element", clean(name)),
                     fmt::format("set {}.type first, {}", owner.element, wanted(owner.list->type)));
            return nullptr;
        }
        const auto spec = std::ranges::find(*owner.specs, owner.declared, &ParamSpec::name);
        if (spec == owner.specs->end())
            complain(name, "host.name", fmt::format("{} is unknown", clean(name)), remedy_for_unknown(owner));
        else if (spec->type == ParamType::unavailable)
            complain(name, "host.name", fmt::format("{} is not available in this library", spec->name),
                     fmt::format("leave it out ({})", spec->help));
        else
            return &*spec;
        return nullptr;
    }

    // If the type of an element changes, the values of the previous type are dropped.
    void set_type(const Owner& owner, const std::string& text) {
        const ItemSchema* item = &*std::ranges::find(owner.list->types, text, &ItemSchema::type);
        Element& element = elements.at(owner.element);
        if (element.item == item) return;
        element.item = item;
        erase_within(settings, owner.element);
        erase_within(elements, owner.element);
        erase_within(sizes, owner.element);
    }

    // Stores the value that make(spec) returns. If it returns none and has reported nothing, the complaint is
    // "<name> is <given>".
    MarramStatus set(const std::string& name, std::string_view given, const MarramValue& parts, auto make) {
        forget_complaints(name);
        const Owner owner = owner_of(name);
        const ParamSpec* spec = declaration(name, owner);
        if (!spec) return MARRAM_ERROR;
        reading.problems.clear();
        std::optional<ParamValue> value = make(*spec);
        if (reading.problems.empty() && !(value && is_good(*value)))
            reading.report({}, fmt::format("{} is {}", name, given.empty() ? "empty" : clean(given)),
                           remedy_for(*spec));
        for (Problem& problem : reading.problems)
            complain(name, "host.value", std::move(problem.what), std::move(problem.fix));
        if (!reading.problems.empty()) return MARRAM_ERROR;
        each_index(name,
                   [&](size_t, size_t end) { elements.try_emplace(name.substr(0, end), Element{place}); });
        if (owner.is_type()) set_type(owner, value->text);
        value->name = name;
        value->place = {place};
        settings.insert_or_assign(name, Setting{std::move(*value), parts});
        return MARRAM_OK;
    }

    long add(const std::string& list, const char* item_type) {
        forget_complaints(list);
        const bool typed = std::ranges::find(lists, list, &ListSchema::name) != lists.end();
        const Owner owner = owner_of(list + "[0]."); // of a list without types: "gusts.control[]."
        const auto is_inside = [&](const ParamSpec& spec) { return spec.name.starts_with(owner.declared); };
        const bool known = typed || (owner.specs && std::ranges::any_of(*owner.specs, is_inside));
        if (!known) complain(list, "host.list", fmt::format("{} is no list", clean(list)), see_info());
        if (known && item_type && !typed)
            complain(list, "host.list", fmt::format("elements of {} have no types", list),
                     fmt::format("leave out {}", in_quotes(item_type)));
        if (!known || (item_type && !typed)) return -1;
        size_t& index = sizes[list];
        while (elements.contains(fmt::format("{}[{}]", list, index))) ++index;
        const std::string element = fmt::format("{}[{}]", list, index), type_name = element + ".type";
        if (!typed)
            elements[element] = {place};
        else if (marram_set_text(this, type_name.c_str(), item_type ? item_type : "") != MARRAM_OK)
            return -1;
        return long(index);
    }

    // For every parameter whose name is `declared` + field: the default of `given` + field, unless it was
    // set.
    void fill(const std::vector<ParamSpec>& params, const std::string& declared, const std::string& given,
              const Place& where) {
        for (const ParamSpec& spec : params) {
            if (!spec.name.starts_with(declared) || spec.type == ParamType::unavailable ||
                spec.initial == "none" || spec.name.find(list_mark, declared.size()) != std::string::npos)
                continue;
            std::string name = given + spec.name.substr(declared.size());
            if (settings.contains(name)) continue;
            if (spec.initial.empty() || is_read_by_host(spec)) {
                if (std::ranges::find(complaints, name, &Complaint::name) == complaints.end())
                    reading.report(where, name + " is missing", remedy_for(spec) + ": " + spec.help,
                                   "host.missing");
            } else if (std::optional<ParamValue> value = default_value(spec, name, where, reading)) {
                value->name = std::move(name);
                defaults.push_back(std::move(*value));
            }
        }
    }

    void fill_element(const std::string& name, const Element& element) {
        const size_t open = name.rfind('[');
        const int index = std::stoi(name.substr(open + 1));
        const std::string before = fmt::format("{}[{}]", name.substr(0, open), index - 1);
        if (index > 0 && !elements.contains(before))
            reading.report({element.place}, fmt::format("there is {}, but no {}", name, before),
                           "number elements from 0 without gaps", "host.list");
        const Owner owner = owner_of(name + ".");
        if (owner.specs) fill(*owner.specs, owner.declared, name + ".", {element.place});
    }

    void lend(const ParamValue& value, const MarramValue& parts) {
        static const double nothing = 0.0;
        MarramValue& out = all.emplace_back(parts);
        out.name = value.name.c_str();
        out.type = contract_type(*value.spec);
        out.numbers = value.numbers.empty() ? &nothing : value.numbers.data();
        out.number_count = value.numbers.size();
        out.text = value.text.c_str();
        out.place = value.place.file.c_str();
        if (value.keys)
            out.keyframes = &keyframes.emplace_back(MarramKeyframes{
                sizeof(MarramKeyframes), uint32_t(value.keys->count()), value.keys->frames.data(),
                value.keys->numbers.data(), name_of(value.keys->interpolation)});
    }

    // Runs a function of the C interface. An exception sets no_memory, which marram_values_finish() reports.
    void guard(auto work) noexcept {
        guarded(work, [&] { no_memory = true; });
    }

    MarramStatus guarded_set(const char* name, std::string_view given, const MarramValue& parts, auto make) {
        MarramStatus status = MARRAM_ERROR;
        guard([&] { status = set(name, given, parts, make); });
        return status;
    }

    // nullptr after reporting what is wrong.
    const MarramValues* finish(const MarramHost* host) {
        all.clear();
        keyframes.clear();
        defaults.clear();
        reading.problems.clear();
        fill(specs, "", "", {});
        for (const auto& [name, element] : elements) fill_element(name, element);
        for (const Complaint& complaint : complaints) say(host, complaint.problem);
        for (Problem& problem : reading.problems) {
            if (problem.id.empty()) problem.id = "host.value"; // of a default
            say(host, problem);
        }
        if (!complaints.empty() || !reading.problems.empty()) return nullptr;
        for (const auto& [name, setting] : settings) lend(setting.value, setting.parts);
        for (const ParamValue& value : defaults) lend(value, {});
        lent = {sizeof lent, all.data(), uint32_t(all.size()), sizeof(MarramValue)};
        return &lent;
    }
};

namespace {

// Sets the value of a table that make(spec) returns, see value_table(). complete: no argument is missing.
MarramStatus set_table(MarramHostValues* values, const char* name, bool complete, std::string_view given,
                       auto make, const MarramValue& parts = {}) {
    if (!values || !name || !complete) return MARRAM_ERROR;
    const auto read = [&](const ParamSpec& spec) {
        const toml::table table = is_read_by_host(spec) ? toml::table() : make(spec);
        const toml::node* node = table.get("value");
        return node ? read_value(*node, spec, name, values->reading) : std::nullopt;
    };
    return values->guarded_set(name, given, parts, read);
}

} // namespace

MarramHostValues* marram_values_new_for(const MarramProcedural* type, size_t size) {
    const auto make = [&]() -> MarramHostValues* {
        ProceduralType known = known_type(known_parts(type, 1, uint32_t(size))[0]);
        return known.unusable.empty() ? new MarramHostValues(std::move(known)) : nullptr;
    };
    return type ? guarded(make, [] { return nullptr; }) : nullptr;
}

void marram_values_free(MarramHostValues* values) { delete values; }

void marram_values_place(MarramHostValues* values, const char* place) {
    if (values && place) values->guard([&] { values->place = place; });
}

MarramStatus marram_set(MarramHostValues* values, const char* name, const char* toml) {
    return set_table(values, name, toml, toml ? toml : "",
                     [&](const ParamSpec& spec) { return value_table(spec, toml); });
}

MarramStatus marram_set_number(MarramHostValues* values, const char* name, double number) {
    return marram_set_numbers(values, name, &number, 1);
}

MarramStatus marram_set_numbers(MarramHostValues* values, const char* name, const double* numbers,
                                size_t count) {
    return set_table(values, name, numbers || count == 0, "numbers", [&](const ParamSpec& spec) {
        if (count != 1) return table_of(array_of(numbers, count));
        const double x = numbers[0];
        if (spec.type == ParamType::boolean && (x == 0.0 || x == 1.0)) return table_of(x == 1.0);
        toml::table table;
        number_to(x, [&](auto number) { table = table_of(number); });
        return table;
    });
}

MarramStatus marram_set_text(MarramHostValues* values, const char* name, const char* text) {
    return set_table(values, name, text, text ? text : "",
                     [&](const ParamSpec&) { return table_of(std::string(text)); });
}

MarramStatus marram_set_ramp(MarramHostValues* values, const char* name, const double* knots,
                             size_t number_count, const char* interpolation) {
    return set_table(values, name, knots || number_count == 0, "a ramp", [&](const ParamSpec& spec) {
        if (spec.type != ParamType::ramp) return toml::table();
        return table_of(items_of("knots", knots, number_count, 2, interpolation, array_of));
    });
}

MarramStatus marram_set_keys(MarramHostValues* values, const char* name, const double* numbers,
                             size_t number_count, const char* interpolation) {
    const bool whole = number_count % 10 == 0;
    return set_table(values, name, numbers || number_count == 0,
                     whole ? "a list of keys" : "a list of keys that have not ten numbers each",
                     [&](const ParamSpec& spec) {
                         if (spec.type != ParamType::keys || !whole) return toml::table();
                         return table_of(items_of("keys", numbers, number_count, 10, interpolation, key_of));
                     });
}

MarramStatus marram_set_grid(MarramHostValues* values, const char* name, const MarramGrid* grid,
                             const MarramPlacement* placement, const char* text) {
    if (!values || !name) return MARRAM_ERROR;
    MarramValue parts{};
    parts.grid = grid;
    parts.placement = placement;
    const auto make = [&](const ParamSpec& spec) -> std::optional<ParamValue> {
        if (!is_grid(spec)) return {};
        const uint32_t most = marram_type_form(contract_type(spec))->components;
        if (grid && grid->values && grid->nx && grid->ny && grid->nz && grid->components &&
            grid->components <= most)
            return ParamValue{&spec, "", {}, text ? text : "", {}, {}, true};
        values->reading.report(
            {}, fmt::format("{} is an image or table without values", name),
            fmt::format("fill in all fields of the grid, with at most {} components", most));
        return {};
    };
    return values->guarded_set(name, "a grid", parts, make);
}

MarramStatus marram_set_volume(MarramHostValues* values, const char* name, const MarramVolume* volume,
                               const char* text) {
    if (!values || !name) return MARRAM_ERROR;
    MarramValue parts{};
    parts.volume = volume;
    const auto make = [&](const ParamSpec& spec) -> std::optional<ParamValue> {
        if (!is_volume(spec)) return {};
        if (volume && is_sized(volume) && known_part(volume).grids && known_part(volume).count > 0)
            return ParamValue{&spec, "", {}, text ? text : "", {}, {}, true};
        values->reading.report({}, fmt::format("{} is a volume without grids", name),
                               "fill in all fields of the volume, and its size");
        return {};
    };
    return values->guarded_set(name, "a volume", parts, make);
}

MarramStatus marram_set_curves_for(MarramHostValues* values, const char* name, const char* curves,
                                   const MarramAttribute* attributes, uint32_t attribute_count, size_t size) {
    MarramValue parts{};
    parts.attributes = attributes;
    parts.attribute_count = attributes ? attribute_count : 0;
    parts.attribute_stride = uint32_t(size);
    const auto make = [&](const ParamSpec& spec) {
        const bool fits = contract_type(spec) == MARRAM_CURVES_NAME;
        return fits ? table_of(std::string(curves)) : toml::table();
    };
    return set_table(values, name, curves, "a name of curves", make, parts);
}

void marram_reset(MarramHostValues* values, const char* name) {
    if (!values || !name) return;
    values->guard([&] {
        values->forget_complaints(name);
        if (!values->owner_of(name).is_type()) values->settings.erase(name); // a type has no default
    });
}

long marram_add(MarramHostValues* values, const char* list, const char* type) {
    if (!values || !list) return -1;
    long index = -1;
    values->guard([&] { index = values->add(list, type); });
    return index;
}

const MarramValues* marram_values_finish(MarramHostValues* values, const MarramHost* host) {
    if (!values) return nullptr;
    const MarramValues* lent = nullptr;
    values->guard([&] { lent = values->finish(host); });
    if (!std::exchange(values->no_memory, false)) return lent;
    say(host, "host.memory", "", "the values do not fit into memory", "set fewer elements");
    return nullptr;
}
