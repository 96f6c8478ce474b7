// SPDX-License-Identifier: Apache-2.0
#include "core/host/contract_values.h"

#include "core/image/data_image.h"
#include "core/math/digest.h"
#include "core/math/udim.h"
#include "core/read/grid_placement.h"
#include "core/read/table_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>

namespace marram {
namespace {

// Keeps the first `most` channels of an image.
void keep_channels(Image& image, int most) {
    if (image.channels <= most) return;
    const auto from = size_t(image.channels), to = size_t(most);
    const size_t pixels = image.pixels.size() / from;
    for (size_t i = 0; i < pixels; ++i)
        std::copy_n(image.pixels.data() + i * from, to, image.pixels.data() + i * to);
    image.pixels.resize(pixels * to);
    image.channels = most;
}

// All tiles of an image as one: each unit square of uv from tile (u, v) on has as many pixels.
struct Tiles {
    Image image;
    int u = 0, v = 0, columns = 1, rows = 1;
};

Tiles read_tiles(const ParamValue& value) {
    constexpr double max_values = 1e9; // 4 GB
    const std::vector<UdimTile> files = udim_tiles(value.text);
    if (files.empty())
        throw InputError(value.place, fmt::format("there is no tile of \"{}\"", value.text),
                         "name tiles by 1001 + u + 10 v, or check the path");
    std::vector<Image> images;
    Tiles tiles;
    tiles.u = tiles.v = std::numeric_limits<int>::max();
    int width = 0, height = 0, channels = 0, last_u = 0, last_v = 0;
    for (const UdimTile& file : files) {
        const Image& image = images.emplace_back(read_image(file.file, ColorSpace::linear_data));
        width = std::max(width, image.width);
        height = std::max(height, image.height);
        channels = std::max(channels, std::min(image.channels, 4));
        tiles.u = std::min(tiles.u, file.u);
        tiles.v = std::min(tiles.v, file.v);
        last_u = std::max(last_u, file.u);
        last_v = std::max(last_v, file.v);
    }
    tiles.columns = last_u - tiles.u + 1;
    tiles.rows = last_v - tiles.v + 1;
    if (double(width) * height * channels * tiles.columns * tiles.rows > max_values)
        throw InputError(
            value.place,
            fmt::format("the tiles of \"{}\" cover {} x {} squares of {} x {} pixels, more than 4 GB",
                        value.text, tiles.columns, tiles.rows, width, height),
            "make them smaller, or number them without gaps");
    Image& all = tiles.image;
    all.width = width * tiles.columns;
    all.height = height * tiles.rows;
    all.channels = channels;
    all.pixels.assign(size_t(all.width) * size_t(all.height) * size_t(channels),
                      std::numeric_limits<float>::quiet_NaN());
    for (size_t t = 0; t < files.size(); ++t) {
        const Image& image = images[t];
        const int x0 = (files[t].u - tiles.u) * width, y0 = (last_v - files[t].v) * height;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const size_t from =
                    (size_t(y) * size_t(image.height) / size_t(height)) * size_t(image.width) +
                    size_t(x) * size_t(image.width) / size_t(width);
                float* to = all.pixels.data() +
                            (size_t(y0 + y) * size_t(all.width) + size_t(x0 + x)) * size_t(channels);
                for (int c = 0; c < channels; ++c) // a grey tile among coloured ones
                    to[c] =
                        image.pixels[from * size_t(image.channels) + size_t(std::min(c, image.channels - 1))];
            }
    }
    return tiles;
}

// The declaration of a list element's parameter such as "layer[2].height". nullptr if its type has none.
const MarramParam* declaration_of(const ParamValue& value, const ProceduralItemType& type) {
    const auto found =
        std::ranges::find_if(type.params, [&](const MarramParam& p) { return value.spec->name == p.name; });
    return found == type.params.end() ? nullptr : &*found;
}

constexpr MarramParam type_of_element = {"type", MARRAM_CHOICE, "", "", 0.0, 0.0, "", "", "", "", 0};

} // namespace

ContractValues::ContractValues(const ProceduralType& type, const Item& item, const ParamSet& wind,
                               const CurveAttributes& curves)
    : curves_(curves), type_name_(type.calls.name) {
    for (const MarramParam& param : type.params) add_param(param, item, wind);
    for (const ParamList& list : item.params.lists())
        for (size_t i = 0; i < list.size; ++i) {
            const std::string prefix = fmt::format("{}[{}].", list.name, i);
            const ParamValue* kind = item.params.find(prefix + "type");
            const auto one = std::ranges::find_if(type.item_types, [&](const ProceduralItemType& t) {
                return kind && list.name == t.item.list && kind->text == t.item.type;
            });
            if (one == type.item_types.end()) continue; // elements without types: added above
            add(type_of_element, kind->name, *kind);
            for (const ParamValue& value : item.params.all())
                if (value.name.starts_with(prefix) && &value != kind)
                    if (const MarramParam* param = declaration_of(value, *one))
                        add(*param, value.name, value);
        }
}

// Adds a parameter's values: the item's own or, for a wind parameter that it does not set, the scene's.
void ContractValues::add_param(const MarramParam& param, const Item& item, const ParamSet& wind) {
    const std::string_view name = param.name, list = list_of(name);
    const auto add_from = [&](const ParamSet& params, std::string_view prefix) {
        for (const ParamValue& value : params.all())
            // Elements of typed lists may have parameters of the same name.
            if (value.spec->name == name.substr(prefix.size()) &&
                (list.empty() ? value.name == value.spec->name
                              : value.name.starts_with(std::string(list.substr(prefix.size())) + "[")))
                add(param, std::string(prefix) + value.name, value);
    };
    const bool own = list.empty() ? item.params.has(name) : item.params.find_list(list) != nullptr;
    if (own)
        add_from(item.params, "");
    else if (name.starts_with(wind_prefix))
        add_from(wind, wind_prefix);
}

const MarramKeyframes* ContractValues::keyframes(const Keyframes& keys) {
    return &keyframes_.emplace_back(MarramKeyframes{sizeof(MarramKeyframes), uint32_t(keys.count()),
                                                    keys.frames.data(), keys.numbers.data(),
                                                    name_of(keys.interpolation)});
}

void ContractValues::add(const MarramParam& param, std::string name, const ParamValue& value) {
    const MarramParamType type = param.type;
    if (value.keys && !param.keyable)
        throw InputError(value.place,
                         fmt::format("{} has keys, and a {} cannot follow them", name, type_name_),
                         fmt::format("give the {} a constant of its own: {} = ...", type_name_, name));
    MarramValue& out = values_.emplace_back();
    out.name = texts_.emplace_back(std::move(name)).c_str();
    out.type = type;
    out.numbers = value.numbers.data();
    out.number_count = value.numbers.size();
    out.text = value.text.c_str();
    out.place = texts_.emplace_back(to_string(value.place)).c_str();
    if (value.keys) out.keyframes = keyframes(*value.keys);
    if (type == MARRAM_IMAGE) {
        out.grid = image(value);
        if (!has_udim(value.text)) out.placement = placement(value); // tiles lie where their numbers say
    }
    if (type == MARRAM_TABLE) out.grid = table(value, out);
    if (type == MARRAM_VOLUME) out.volume = &volumes_.emplace_back(read_volume_value(value))->volume;
    if (type == MARRAM_CURVES_NAME) add_attributes(out);
}

void ContractValues::add_attributes(MarramValue& out) {
    const auto found = curves_.find(out.text);
    if (found == curves_.end()) return;
    std::vector<MarramAttribute>& list = attributes_.emplace_back();
    for (const AttributeValues& a : found->second)
        list.push_back(
            {a.name.c_str(), a.components, a.rate, a.discrete ? 1U : 0U, "", nullptr, a.animated ? 1U : 0U});
    out.attributes = list.data();
    out.attribute_count = uint32_t(list.size());
    out.attribute_stride = sizeof(MarramAttribute);
}

const MarramGrid* ContractValues::image(const ParamValue& value) {
    if (const auto known = image_grids_.find(value.text); known != image_grids_.end())
        return known->second; // each file is read once
    std::vector<std::string> notes;
    Tiles tiles;
    if (has_udim(value.text))
        tiles = read_tiles(value);
    else
        tiles.image = read_data_image(value.text, notes);
    Image& image = images_.emplace_back(std::move(tiles.image));
    for (const std::string& note : notes)
        warnings_.push_back({value.place, fmt::format("\"{}\": {}", value.text, note), "", "image.data"});
    keep_channels(image, 4); // the most that a grid has
    MarramGrid& grid = grids_.emplace_back();
    grid.name = value.text.c_str();
    grid.nx = uint32_t(image.width);
    grid.ny = uint32_t(image.height);
    grid.nz = 1;
    grid.components = uint32_t(image.channels);
    grid.axes[0][0] = double(tiles.columns) / image.width;
    grid.axes[1][1] = -double(tiles.rows) / image.height;
    grid.origin[0] = tiles.u + 0.5 * grid.axes[0][0];
    grid.origin[1] = tiles.v + tiles.rows + 0.5 * grid.axes[1][1];
    grid.values = image.pixels.data();
    image_grids_[value.text] = &grid;
    return &grid;
}

const MarramPlacement* ContractValues::placement(const ParamValue& value) {
    const FilePlacement file = read_placement(value.text);
    if (!file.center && !file.size && !file.range) return nullptr;
    MarramPlacement& placement = placements_.emplace_back();
    placement.size = sizeof(MarramPlacement);
    const auto take = [](const std::optional<Vec2d>& from, uint32_t& has, double* to) {
        has = from.has_value();
        if (from) std::copy_n(from->data(), 2, to);
    };
    take(file.center, placement.has_center, placement.center);
    take(file.size, placement.has_extent, placement.extent);
    take(file.range, placement.has_range, placement.range);
    return &placement;
}

const MarramGrid* ContractValues::table(const ParamValue& value, MarramValue& out) {
    TableFile table = read_table_file(value.text);
    MarramGrid& grid = grids_.emplace_back();
    grid.name = value.text.c_str();
    grid.nx = uint32_t(table.columns.size());
    grid.ny = uint32_t(table.values.size() / table.columns.size());
    grid.nz = grid.components = 1;
    for (int axis = 0; axis < 3; ++axis) grid.axes[axis][axis] = 1.0;
    grid.values = numbers_.emplace_back(std::move(table.values)).data();
    out.text = texts_.emplace_back(fmt::format("{}", fmt::join(table.columns, ","))).c_str();
    return &grid;
}

MarramValues ContractValues::list() const {
    return {sizeof(MarramValues), values_.data(), uint32_t(values_.size()), sizeof(MarramValue)};
}

uint64_t ContractValues::digest() const {
    Digest digest;
    for (const MarramValue& value : values_) {
        digest.add(value.name).add(value.numbers, value.number_count * sizeof(double));
        if (const MarramKeyframes* keys = value.keyframes)
            digest.add(keys->frames, keys->count * sizeof(double))
                .add(keys->numbers, keys->count * value.number_count * sizeof(double))
                .add(keys->interpolation);
        for (uint32_t i = 0; i < value.attribute_count; ++i) {
            const MarramAttribute& a = value.attributes[i];
            digest.add(a.name).add(a.components).add(uint64_t(a.rate)).add(a.discrete);
        }
        const MarramGrid* grid = value.grid;
        if (!grid) {
            if (!value.volume) digest.add(value.text);
            continue;
        }
        digest.add(grid->nx).add(grid->ny).add(grid->components);
        if (value.placement) digest.add(value.placement, sizeof(MarramPlacement));
        if (value.type == MARRAM_TABLE) digest.add(value.text); // names of its columns
        digest.add(grid->values, size_t(grid->nx) * grid->ny * grid->nz * grid->components * sizeof(float));
    }
    for (const auto& volume : volumes_) volume->add_to(digest);
    return digest.value();
}

std::vector<GeometryName> ContractValues::names_of(MarramParamType type) const {
    std::vector<GeometryName> names;
    for (const MarramValue& value : values_)
        if (value.type == type && std::ranges::find(names, value.text, &GeometryName::name) == names.end())
            names.push_back({value.text, {value.place}});
    return names;
}

} // namespace marram
