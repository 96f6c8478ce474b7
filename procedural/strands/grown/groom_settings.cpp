// SPDX-License-Identifier: Apache-2.0
// groom: hair, fur or grass that grows on a mesh.
//
// What it models. Roots are distributed over the rest surface with the requested evenness (roots.h). The
// shape of each strand follows from hashes of its root (strand_shape.h). Strands move with the surface and
// are blown by the scene's wind (procedural/wind). Density, length, width, lean, arc, curl, clump, frizz and
// wind are maxima: NAME_by scales them over the surface by a product of ramps over attributes of the mesh and
// over images. A strand keeps its id and shape when the density changes elsewhere, when the frame changes,
// and when unrelated parameters change. With lod, fewer and wider strands are made where they are narrower
// than the tolerance in pixels (level_of_detail.h; scenes/coast.toml).
//
//     [[procedural]]
//     type = "groom"
//     name = "grass"
//     on = "hill"
//     material = "blade"
//     density = 8000                  # or count = 200000
//     length = [0.15, 0.35]
//     lean = 10
//     arc = 60
//     width = 0.004
//     width_profile = [[0, 1], [0.6, 0.8], [1, 0]]
//     cvs = 6
//     shape = "ribbon"
//     density_by_slope = [[30, 1], [40, 0]]
//     lean_by = [{ attribute = "moist", ramp = [[0, 0.2], [1, 1]] }]   # of a generated mesh
//     frizz_by = [{ image = "frizz.png" }]                             # by the uv at the root
//     wind.speed = 5                  # overrides the scene's wind for this groom
#include "procedural/strands/grown/groom_settings.h"

#include "core/math/digest.h"
#include "core/math/udim.h"
#include "procedural/abi/param.h"
#include "procedural/wind/canopy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>

namespace marram {
namespace {

// A new one also needs a member of Groom, which read_groom() sets; if roots depend on it, its name in
// roots_digest(), or update() keeps old ones (tests/unit/host/update_test.cpp tries each).
constexpr std::array groom_values = {
    param::mesh("on", "", "each",
                "mesh that the strands grow on; a list makes one groom per mesh, with the same parameters"),
    param::number("density", "1/m^2", "none", 0, 1e12, "strands a square metre; this or count"),
    param::integer("count", "", "none", 1, 2000000000,
                   "total number of strands, after masks; this or density"),
    param::image("density_mask", "none", "uv", "scale of the density, by uv"),
    param::ramp("density_by_height", "m", "none", -embree_limit, embree_limit, "scale of the density over y"),
    param::ramp("density_by_slope", "deg", "none", -embree_limit, embree_limit,
                "scale of the density over slope (0: level)"),
    param::choice("image_wrap", "auto", "auto|clamp|repeat",
                  "beyond the border of an image: its last pixels, or the image again; auto: repeat if the "
                  "mesh has uvs "
                  "outside 0 ... 1"),
    param::choice(
        "clear_of", "meshes", "meshes|none",
        "meshes: with collision, strands whose roots are inside or under another mesh that collides are "
        "left out, if neither mesh moves and the inside is that of its faces: a room with flip = true covers "
        "none; all stay if the mesh that they grow on has instances; none: they stay"),
    param::number("spacing", "", "1", 0, 1, "0: random roots; 1: as even as a Poisson disc set"),
    param::range("length", "m", "none", 0, embree_limit,
                 "shortest and longest strand; required unless the strands have guides (then guides.length)"),
    param::image("length_mask", "none", "uv", "scale of the length, by uv"),
    param::ramp("length_by_height", "m", "none", -embree_limit, embree_limit, "scale of the length over y"),
    param::ramp("length_by_slope", "deg", "none", -embree_limit, embree_limit,
                "scale of the length over slope"),
    param::vec3("comb", "", "none", -embree_limit, embree_limit,
                "direction that strands lean to; absent: each strand has its own"),
    param::image(
        "comb_map", "none", "uv",
        "the same by uv: red and green, 0 to 1, are -1 to 1 along u and v; grey (0.5) leaves it to comb"),
    param::number("comb_variation", "deg", "20", 0, 180, "largest deviation from comb"),
    param::number("lean", "deg", "10", 0, 90, "angle between strand and surface normal at the root"),
    param::number("lean_variation", "deg", "5", 0, 90, "largest deviation from lean"),
    param::number("arc", "deg", "20", -720, 720, "additional lean at the tip"),
    param::number("arc_variation", "deg", "10", 0, 360, "largest deviation from arc"),
    param::number("curl.radius", "m", "0", 0, embree_limit, "radius of the helix at the tip"),
    param::number("curl.turns", "", "3", 0, 1000, "turns of the helix over the strand"),
    param::number("clump.size", "m", "0", 0, embree_limit, "mean distance between clumps; 0: none"),
    param::number("clump.amount", "", "0.5", 0, 1, "1: all tips of a clump meet"),
    param::ramp("clump.profile", "", "[[0, 0], [1, 1]]", -embree_limit, embree_limit,
                "pull to the clump from root to tip"),
    param::number("clump.finer[].size", "m", "", 0, embree_limit,
                  "finer clumps inside the previous level: mean distance; smaller than the previous level's"),
    param::number("clump.finer[].amount", "", "0.5", 0, 1, "1: all tips of such a clump meet"),
    param::ramp("clump.finer[].profile", "", "[[0, 0], [1, 1]]", -embree_limit, embree_limit,
                "pull to it from root to tip"),
    param::number("frizz.amplitude", "m", "0", 0, embree_limit, "sideways displacement at the tip"),
    param::number("frizz.frequency", "", "4", 0, 1e4, "waves over the strand"),
    param::number("width", "m", "", 0, embree_limit, "diameter; of a ribbon its width"),
    param::ramp("width_profile", "", "[[0, 1], [1, 0.1]]", -embree_limit, embree_limit,
                "scale of the width from root to tip"),
    param::number("width_variation", "", "0.1", 0, 1, "largest random reduction of the width, as a fraction"),
    param::boolean(
        "lod", "false",
        "level of detail: where strands are narrower than tolerance_pixels, fewer stand for all, as "
        "wide as that; a count is then met within 2 %"),
    param::integer("cvs", "", "8", 0, 1000,
                   "control vertices a strand; 0: as many as show the bend within the tolerance",
                   "5|9|17|33|65", ""),
    param::choice("basis", "bspline", "bspline|catmull-rom",
                  "B-spline is smoother; Catmull-Rom passes through its CVs"),
    param::choice("shape", "round", "round|ribbon|oriented-ribbon",
                  "tube; flat, facing the camera; or flat, with an orientation of its own"),
    param::keyable(param::ramp("envelope", "", "[[0, 1]]", -embree_limit, embree_limit,
                               "share of the wind from root to tip")),
    param::boolean(
        "canopy", "false",
        "the strands are a stand that slows its own wind: less at their roots and inside, more at its edge"),
    param::number(
        "canopy_attenuation", "", "none", 0, Canopy::most_attenuation,
        "how much: the wind falls by exp(-this) from top to ground; default: from the area of the strands"),
    param::integer("seed", "", "0", 0, 2147483647, "seed of the groom"),
};

// Parameters that NAME_by scales: in the order of FactorOf, then density and length.
struct Scaled {
    const char *name, *what;
};
constexpr std::array scaled = {
    Scaled{"wind", "wind"},
    Scaled{"width", "width"},
    Scaled{"lean", "lean"},
    Scaled{"arc", "arc"},
    Scaled{"curl", "curl's radius"},
    Scaled{"clump", "clump's amount"},
    Scaled{"frizz", "frizz's amplitude"},
    Scaled{"density", "density"},
    Scaled{"length", "length"},
};
static_assert(scaled.size() == factor_count + 2);

// NAME_by[].attribute, .image and .ramp of all scaled parameters. Static, because the parameters point to its
// strings.
const std::vector<MarramParam>& factor_params() {
    static const std::vector<std::array<std::string, 6>> texts = [] {
        std::vector<std::array<std::string, 6>> all;
        for (const auto& [name, what] : scaled) {
            const std::string list = std::string(name) + "_by[].";
            all.push_back({list + "attribute", list + "image", list + "ramp",
                           std::string("attribute of the mesh, one number, that scales the ") + what,
                           std::string("or an image by uv, its first channel, that scales the ") + what,
                           std::string("share of the ") + what + " over that number"});
        }
        return all;
    }();
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list;
        for (const auto& t : texts) {
            list.push_back(param::text(t[0].c_str(), "none", t[3].c_str()));
            list.push_back(param::image(t[1].c_str(), "none", "uv", t[4].c_str()));
            list.push_back(
                param::ramp(t[2].c_str(), "", "[[0, 0], [1, 1]]", -embree_limit, embree_limit, t[5].c_str()));
        }
        return list;
    }();
    return params;
}

constexpr const char* groom_ramp_fault = "groom.share_range";

std::optional<Ramp> optional_ramp(const Values& values, std::string_view name) {
    if (!values.has(name)) return {};
    return unit_ramp(values, name, groom_ramp_fault);
}

// Images of one create(), by pixel pointer, channel, and value of missing tiles. The host passes equal images
// with one pointer.
using ScalarImages = std::map<std::tuple<const float*, uint32_t, float>, ScalarImage>;

// The given channel of an image, or its last one if there are fewer. missing: value where an image in tiles
// has none.
std::optional<ScalarImage> optional_image(const Values& values, std::string_view name, ScalarImages& images,
                                          uint32_t channel = 0, float missing = 0.0F) {
    const MarramValue* value = values.find(name);
    if (!value) return {};
    const MarramGrid* image = value->grid;
    if (!image || !image->values || image->nx == 0 || image->ny == 0 || image->components == 0)
        throw SceneFault("contract.no_image", value->place,
                         std::string(name) + ": the image was not handed over", "read it before create()");
    channel = std::min(channel, image->components - 1);
    const std::tuple key(image->values, channel, missing);
    if (const auto same = images.find(key); same != images.end()) return same->second.at_place(value->place);
    return images.emplace(key, ScalarImage(*image, channel, missing, value->place)).first->second;
}

Factors read_factors(const Values& values, const std::string& list, ScalarImages& images) {
    Factors factors;
    while (true) {
        const std::string element = list + "[" + std::to_string(factors.size()) + "].";
        if (!values.has(element + "ramp")) return factors; // the ramp has a default, so every element has one
        Factor factor;
        factor.ramp = unit_ramp(values, element + "ramp", groom_ramp_fault);
        factor.place = values.at(element + "ramp").place;
        factor.image = optional_image(values, element + "image", images);
        if (values.has(element + "attribute")) {
            factor.attribute = values.text(element + "attribute");
            factor.place = values.at(element + "attribute").place;
        }
        if (factor.attribute.empty() != factor.image.has_value())
            throw SceneFault("groom.factor", factor.place,
                             list + (factor.image ? ": both attribute and image are given"
                                                  : ": neither attribute nor image is given"),
                             factor.image ? "make two tables of it, which are multiplied"
                                          : "name an attribute of the mesh, or an image");
        factors.push_back(std::move(factor));
    }
}

Masks read_masks(const Values& values, const std::string& of, ScalarImages& images) {
    return {optional_image(values, of + "_mask", images), optional_ramp(values, of + "_by_height"),
            optional_ramp(values, of + "_by_slope"), read_factors(values, of + "_by", images)};
}

std::vector<Clump> read_clumps(const Values& values) {
    std::vector<Clump> clumps;
    const auto add = [&](const std::string& prefix) {
        const double size = values.number(prefix + "size");
        if (!clumps.empty() && !(size < clumps.back().size && size > 0.0))
            throw SceneFault("groom.clump_sizes", values.at(prefix + "size").place,
                             prefix + "size is not between 0 and the size of the clumps before",
                             "order clumps from coarse to fine");
        if (clumps.size() == max_clumps)
            throw SceneFault("groom.clump_levels", values.at(prefix + "size").place,
                             "clumps have more than " + std::to_string(max_clumps) + " levels",
                             "leave some out");
        clumps.push_back({size, values.number(prefix + "amount"),
                          unit_ramp(values, prefix + "profile", groom_ramp_fault)});
    };
    const bool any = values.number("clump.size") > 0.0;
    if (any) add("clump.");
    for (size_t i = 0;; ++i) {
        const std::string element = "clump.finer[" + std::to_string(i) + "].";
        if (!values.has(element + "size")) return clumps;
        if (!any)
            throw SceneFault("groom.clump_sizes", values.at(element + "size").place,
                             "clump.finer is given, but clump.size is 0",
                             "give clump.size, of the coarsest clumps");
        add(element);
    }
}

void read_roots(const Values& values, ScalarImages& images, Groom& groom) {
    const MarramValue* density = values.find("density");
    const MarramValue* count = values.find("count");
    groom.mesh = values.text("on");
    groom.mesh_place = values.at("on").place;
    if (density && count)
        throw SceneFault("groom.density_and_count", count->place, "both density and count are given",
                         "keep one of them");
    if (!density && !count)
        throw SceneFault("groom.no_density", values.at("on").place, "neither density nor count is given",
                         "add density = strands a square metre, or count");
    if (density) groom.density = density->numbers[0];
    if (count) groom.count = static_cast<uint64_t>(count->numbers[0]);
    groom.count_place = (density ? density : count)->place;
    if (const std::string_view wrap = values.text("image_wrap"); wrap != "auto")
        groom.images_repeat = wrap == "repeat";
    groom.density_masks = read_masks(values, "density", images);
    groom.length_masks = read_masks(values, "length", images);
    groom.spacing = values.number("spacing");
}

} // namespace

ScalarImage::ScalarImage(uint32_t width, uint32_t height, std::vector<float> values, std::string place)
    : place_(std::move(place)) {
    const auto [low, high] = std::ranges::minmax(values);
    pixels_ =
        std::make_shared<const Pixels>(Pixels{width, height, std::move(values), double(low), double(high)});
}

ScalarImage::ScalarImage(const MarramGrid& grid, uint32_t channel, float missing, std::string place)
    : place_(std::move(place)) {
    Pixels pixels{grid.nx, grid.ny, {}, 0.0, 0.0};
    pixels.values.resize(size_t(grid.nx) * grid.ny);
    for (size_t i = 0; i < pixels.values.size(); ++i)
        pixels.values[i] = grid.values[i * grid.components + channel];
    pixels.missing = double(missing);
    pixels.file = grid.name ? grid.name : "";
    if (has_udim(pixels.file)) {
        const double width = grid.axes[0][0], height = -grid.axes[1][1]; // of a pixel
        pixels.columns = std::max(std::lround(grid.nx * width), 1L);
        pixels.rows = std::max(std::lround(grid.ny * height), 1L);
        pixels.u = std::lround(grid.origin[0] - 0.5 * width);
        pixels.v = std::lround(grid.origin[1] + 0.5 * height) - pixels.rows;
        const size_t tile_width = grid.nx / size_t(pixels.columns),
                     tile_height = grid.ny / size_t(pixels.rows);
        for (int64_t row = 0; row < pixels.rows; ++row)
            for (int64_t column = 0; column < pixels.columns; ++column)
                pixels.has_tile.push_back(static_cast<char>(
                    !std::isnan(pixels.values[size_t(pixels.rows - 1 - row) * tile_height * grid.nx +
                                              size_t(column) * tile_width])));
        for (float& value : pixels.values)
            if (std::isnan(value)) value = missing;
    }
    const auto [low, high] = std::ranges::minmax(pixels.values);
    pixels.low = double(low);
    pixels.high = double(high);
    if (!pixels.has_tile.empty()) { // beyond the tiles
        pixels.low = std::min(pixels.low, pixels.missing);
        pixels.high = std::max(pixels.high, pixels.missing);
    }
    pixels_ = std::make_shared<const Pixels>(std::move(pixels));
}

bool ScalarImage::has_tile(int64_t u, int64_t v) const {
    const int64_t column = u - pixels_->u, row = v - pixels_->v;
    return column >= 0 && row >= 0 && column < pixels_->columns && row < pixels_->rows &&
           pixels_->has_tile[size_t(row * pixels_->columns + column)] != 0;
}

ScalarImage ScalarImage::at_place(std::string place) const {
    ScalarImage other = *this;
    other.place_ = std::move(place);
    return other;
}

double ScalarImage::operator()(double u, double v) const {
    const Pixels& p = *pixels_;
    // The pixels that count, and the position among them: of the whole image, or of a tile.
    int64_t x_begin = 0, y_begin = 0, width = p.width, height = p.height;
    bool repeats = repeats_;
    if (tiled()) {
        constexpr double most = 1e6; // far beyond the last tile
        const double column = std::clamp(std::floor(u), -most, most),
                     row = std::clamp(std::floor(v), -most, most);
        // A border between tiles belongs to the one that is there.
        const bool left = column == u && !has_tile(int64_t(column), int64_t(row)) &&
                          has_tile(int64_t(column) - 1, int64_t(row));
        const bool below = row == v && !has_tile(int64_t(column), int64_t(row)) &&
                           has_tile(int64_t(column), int64_t(row) - 1);
        const int64_t i = int64_t(column) - (left ? 1 : 0), j = int64_t(row) - (below ? 1 : 0);
        if (!has_tile(i, j)) return p.missing;
        width /= p.columns;
        height /= p.rows;
        x_begin = (i - p.u) * width;
        y_begin = (p.rows - 1 - (j - p.v)) * height;
        u -= double(i);
        v -= double(j);
        repeats = false;
    }
    const auto within = [&](double at) { return repeats ? at - std::floor(at) : std::clamp(at, 0.0, 1.0); };
    const auto wrap = [&](int64_t i, int64_t n) {
        return repeats ? ((i % n) + n) % n : std::clamp(i, int64_t(0), n - 1);
    };
    const double x = within(u) * double(width) - 0.5, y = (1.0 - within(v)) * double(height) - 0.5;
    const double x0 = std::floor(x), y0 = std::floor(y), fx = x - x0, fy = y - y0;
    const int64_t i0 = wrap(int64_t(x0), width), i1 = wrap(int64_t(x0) + 1, width);
    const int64_t j0 = wrap(int64_t(y0), height), j1 = wrap(int64_t(y0) + 1, height);
    const auto at = [&](int64_t i, int64_t j) {
        return double(p.values[size_t(y_begin + j) * p.width + size_t(x_begin + i)]);
    };
    const double top = at(i0, j0) + fx * (at(i1, j0) - at(i0, j0));
    const double bottom = at(i0, j1) + fx * (at(i1, j1) - at(i0, j1));
    return top + fy * (bottom - top);
}

double Factor::operator()(const Surface& surface, uint32_t triangle, const Vec3d& weights) const {
    double value = 0.0;
    if (image) {
        const Vec2d uv = surface.uv(triangle, weights);
        value = (*image)(uv.x(), uv.y());
    } else {
        value = surface.value(surface.attributes[index], triangle, weights);
    }
    return std::clamp(ramp(value), 0.0, 1.0);
}

std::pair<double, double> Factor::input_range(const Surface& surface, uint32_t triangle) const {
    if (image) return {image->low(), image->high()};
    const MarramAttribute& values = surface.attributes[index];
    const double a = surface.value(values, triangle, Vec3d::UnitX()),
                 b = surface.value(values, triangle, Vec3d::UnitY()),
                 c = surface.value(values, triangle, Vec3d::UnitZ());
    return {std::min({a, b, c}), std::max({a, b, c})};
}

double product(const Factors& factors, const Surface& bind, uint32_t triangle, const Vec3d& weights) {
    double share = 1.0;
    for (const Factor& factor : factors) share *= factor(bind, triangle, weights);
    return share;
}

std::vector<Factors*> factors_of(Groom& groom) {
    std::vector<Factors*> all = {&groom.density_masks.factors, &groom.length_masks.factors};
    for (Factors& factors : groom.factors) all.push_back(&factors);
    return all;
}

std::vector<ScalarImage*> images_of(Groom& groom) {
    std::vector<ScalarImage*> all;
    for (Masks* masks : {&groom.density_masks, &groom.length_masks})
        if (masks->image) all.push_back(&*masks->image);
    if (groom.comb_map)
        for (ScalarImage& image : *groom.comb_map) all.push_back(&image);
    for (Factors* factors : factors_of(groom))
        for (Factor& factor : *factors)
            if (factor.image) all.push_back(&*factor.image);
    return all;
}

double Masks::operator()(const Surface& bind, uint32_t triangle, const Vec3d& weights) const {
    double share = 1.0;
    if (image) {
        const Vec2d uv = bind.uv(triangle, weights);
        share *= std::clamp((*image)(uv.x(), uv.y()), 0.0, 1.0);
    }
    if (by_height) share *= std::clamp((*by_height)(bind.point(triangle, weights).y()), 0.0, 1.0);
    if (by_slope) {
        const Vec3d normal = plane_normal(bind.corners(triangle));
        const double slope = std::atan2(std::hypot(normal.x(), normal.z()), normal.y()) / degree;
        share *= std::clamp((*by_slope)(slope), 0.0, 1.0);
    }
    for (const Factor& factor : factors) share *= factor(bind, triangle, weights);
    return share;
}

void resolve_attributes(Groom& groom, std::span<const MarramAttribute> attributes) {
    for (Factors* factors : factors_of(groom))
        for (Factor& factor : *factors) {
            if (factor.image) continue;
            const auto found = std::ranges::find_if(
                attributes, [&](const MarramAttribute& a) { return factor.attribute == a.name; });
            if (found == attributes.end()) {
                std::string known;
                for (const MarramAttribute& a : attributes)
                    if (a.components == 1) known += (known.empty() ? "" : ", ") + std::string(a.name);
                throw SceneFault("groom.no_attribute", factor.place,
                                 "the mesh '" + groom.mesh + "' has no attribute '" + factor.attribute + "'",
                                 known.empty() ? "grow on a mesh that has attributes"
                                               : "choose among " + known);
            }
            if (found->components != 1)
                throw SceneFault("groom.wide_attribute", factor.place,
                                 "the attribute '" + factor.attribute + "' has " +
                                     std::to_string(found->components) + " numbers",
                                 "name one that has a single number");
            if (found->animated)
                throw SceneFault("groom.animated_attribute", factor.place,
                                 "the attribute '" + factor.attribute + "' differs from frame to frame",
                                 "strands are placed once: name an attribute that is not animated");
            factor.index = size_t(found - attributes.begin());
        }
}

uint64_t roots_digest(const Values& values) {
    Digest digest;
    const auto add = [&](const MarramValue& value) {
        digest.add(value.name).add(value.text).add(value.numbers, value.number_count * sizeof(double));
        if (const MarramGrid* grid = value.grid)
            digest.add(grid->nx)
                .add(grid->ny)
                .add(grid->components)
                .add(grid->values, size_t(grid->nx) * grid->ny * grid->components * sizeof(float));
    };
    for (const char* name :
         {"on", "density", "count", "density_mask", "density_by_height", "density_by_slope", "image_wrap",
          "spacing", "seed", "lod", "guides.curves", "guides.blend", "guides.parting", "guides.parting_lines",
          "guides.length", "guides.reach", "guides.wind"})
        if (const MarramValue* value = values.find(name)) add(*value);
    const auto add_factors = [&](const std::string& list) {
        for (size_t i = 0; values.has(list + "[" + std::to_string(i) + "].ramp"); ++i)
            for (const char* part : {"attribute", "image", "ramp"})
                if (const MarramValue* value = values.find(list + "[" + std::to_string(i) + "]." + part))
                    add(*value);
    };
    add_factors("density_by");
    if (!values.has("wind.collision.solver") || values.text("wind.collision.solver") == "none" ||
        values.text("clear_of") == "none")
        return digest.value();
    // What the root offset depends on: roots that are covered within it are left out.
    for (const char* name :
         {"clear_of", "wind.collision.solver", "wind.collision.offset_root", "length", "length_mask",
          "length_by_height", "length_by_slope", "width", "width_profile", "width_variation"})
        if (const MarramValue* value = values.find(name)) add(*value);
    add_factors("length_by");
    add_factors("width_by");
    return digest.value();
}

const std::vector<MarramParam>& groom_params() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list(groom_values.begin(), groom_values.end());
        list.insert(list.end(), factor_params().begin(), factor_params().end());
        list.insert(list.end(), guide_params().begin(), guide_params().end());
        list.insert(list.end(), blade_params().begin(), blade_params().end());
        return list;
    }();
    return params;
}

Groom read_groom(const Values& values) {
    Groom groom;
    ScalarImages images;
    read_roots(values, images, groom);
    groom.guides = parse_guide_settings(values);
    if (groom.guides && values.has("length"))
        throw SceneFault("groom.length_of_guides", values.at("length").place,
                         "length is given, but strands have guides",
                         "give guides.length, a factor of the guides' length");
    if (!groom.guides && !values.has("length"))
        throw SceneFault("groom.no_length", values.at("on").place, "length is not given",
                         "add length = [shortest, longest] in metres");
    if (!groom.guides) groom.length = values.range("length");
    groom.combed = values.has("comb");
    if (groom.combed) {
        const Vec3d comb = values.vec3("comb");
        if (!(comb.stableNorm() > 0.0))
            throw SceneFault("groom.zero_comb", values.at("comb").place, "comb is zero",
                             "give a direction, or leave it out");
        groom.comb = comb.stableNormalized();
    }
    if (values.has("comb_map"))
        groom.comb_map = {*optional_image(values, "comb_map", images, 0, 0.5F),
                          *optional_image(values, "comb_map", images, 1, 0.5F)};
    groom.comb_variation = radians(values, "comb_variation");
    groom.lean = radians(values, "lean");
    groom.lean_variation = radians(values, "lean_variation");
    groom.arc = radians(values, "arc");
    groom.arc_variation = radians(values, "arc_variation");
    groom.curl_radius = values.number("curl.radius");
    groom.curl_turns = values.number("curl.turns");
    groom.clumps = read_clumps(values);
    groom.frizz_amplitude = values.number("frizz.amplitude");
    groom.frizz_frequency = values.number("frizz.frequency");
    groom.width = values.number("width");
    groom.width_variation = values.number("width_variation");
    groom.width_profile = values.ramp("width_profile");
    for (const double share : groom.width_profile.values())
        if (share < 0.0)
            throw SceneFault("groom.negative_width", values.at("width_profile").place,
                             "width_profile goes below 0", "a width cannot be negative");
    groom.level_of_detail = values.boolean("lod");
    groom.cvs = values.integer("cvs");
    if (groom.cvs == 1)
        throw SceneFault("groom.one_cv", values.at("cvs").place, "cvs is 1",
                         "a strand needs 2, and 0 takes as many as the tolerance asks for");
    groom.basis = values.text("basis") == "bspline" ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM;
    groom.shape = values.text("shape") == "round"    ? MARRAM_ROUND
                  : values.text("shape") == "ribbon" ? MARRAM_RIBBON
                                                     : MARRAM_ORIENTED_RIBBON;
    groom.envelope = unit_ramp(values, "envelope", groom_ramp_fault);
    for (size_t i = 0; i < factor_count; ++i)
        groom.factors[i] = read_factors(values, std::string(scaled[i].name) + "_by", images);
    groom.seed = static_cast<uint32_t>(values.integer("seed"));
    groom.clear_of_meshes = values.text("clear_of") == "meshes";
    const double mean_length = groom.guides ? 0.0 : 0.5 * (groom.length.x() + groom.length.y());
    groom.blade =
        read_blade(values, {groom.shape != MARRAM_ROUND, groom.width, mean_length, groom.width_profile});
    groom.canopy = values.boolean("canopy");
    groom.canopy_place = values.at("canopy").place;
    if (values.has("canopy_attenuation")) {
        groom.canopy_attenuation = values.number("canopy_attenuation");
        if (!groom.canopy)
            throw SceneFault("groom.no_canopy", values.at("canopy_attenuation").place,
                             "canopy_attenuation is given, and canopy is not true",
                             "add canopy = true, or remove this");
    }
    return groom;
}

} // namespace marram
