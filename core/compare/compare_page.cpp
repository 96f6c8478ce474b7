// SPDX-License-Identifier: Apache-2.0
#include "core/compare/compare_page.h"

#include "core/compare/page_style.h"
#include "core/compare/page_tables.h"
#include "core/compare/page_view.h"
#include "core/page/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace page {
namespace {

struct Size {
    int width = 0, height = 0;
};

// CSS size of a box for pictures of this size: an integer multiple of the size, at least `least` screen
// pixels wide or high, but at most the window width and 80 % of its height. Pictures with an aspect ratio
// above 8 : 1 are stretched, because otherwise they would be too thin to see.
struct Shape {
    std::string width, ratio;
    bool enlarged = false, stretched = false;
};

Shape shape_of(Size size, int least) {
    const int longer = std::max(size.width, size.height), scale = std::max(1, (least + longer - 1) / longer);
    double w = double(size.width) * scale, h = double(size.height) * scale;
    Shape shape;
    shape.stretched = std::max(w, h) > 8.0 * std::min(w, h);
    shape.enlarged = scale > 1 || shape.stretched;
    if (shape.stretched) (w < h ? w : h) = std::max(w, h) / 8.0;
    shape.width = fmt::format("min(100cqw,{:.0f}px,{:.2f}vh)", w, 80.0 * w / h);
    shape.ratio = fmt::format("{:.0f}/{:.0f}", w, h);
    return shape;
}

std::string figure(const Shape& shape, const char* kinds, const std::string& more, const std::string& inside,
                   const std::string& below) {
    return fmt::format("<figure style=\"width:max(min(100cqw,15em),{0})\">\n<div class=\"box{1}{2}\"{3} "
                       "style=\"width:{0};aspect-ratio:{4}\">\n{5}</div>\n{6}</figure>\n",
                       shape.width, shape.enlarged ? " pixelated" : "", kinds, more, shape.ratio, inside,
                       below);
}

std::string caption(const std::string& html) { return "<figcaption>" + html + "</figcaption>\n"; }

std::string image(const Pixels& rgb, Size size, const std::string& what, const char* kind) {
    return fmt::format("<img src=\"{}\" alt=\"{}\" class=\"{}\">\n",
                       data_url(png_bytes(size.width, size.height, 3, rgb.data(), 0.0)), escaped(what), kind);
}

// A frame around a region of the shown part.
std::string frame(const Region& framed, const Region& shown) {
    const auto percent = [](int part, int whole) { return 100.0 * part / whole; };
    return fmt::format(
        "<span class=\"frame\" style=\"left:{:.4f}%;top:{:.4f}%;width:{:.4f}%;height:{:.4f}%\">"
        "</span>\n",
        percent(framed.x - shown.x, shown.width), percent(framed.y - shown.y, shown.height),
        percent(framed.width, shown.width), percent(framed.height, shown.height));
}

// ---- one of the two pictures ----------------------------------------------------------------------------------------

// A picture as up to three images by exposure, or one image of a data layer.
struct Side {
    const char* name; // "A", "B"
    const char* what;
    std::vector<std::pair<const char*, Pixels>> parts;
};

Side side_of(const char* name, const char* what, const Picture::Layer& layer, const Picture::Layer& reference,
             const Exposures* exposures) {
    Side side{name, what, {}};
    if (!exposures) {
        side.parts.emplace_back("base", map_linearly(layer, reference));
        return side;
    }
    side.parts.emplace_back("base", exposed(layer, *exposures, Part::base));
    if (exposures->highlights != 0)
        side.parts.emplace_back("highlights", exposed(layer, *exposures, Part::highlights));
    if (exposures->shadows != 0)
        side.parts.emplace_back("shadows", exposed(layer, *exposures, Part::shadows));
    return side;
}

std::string images(const Side& side, int width, const Region& region) {
    std::string out;
    for (const auto& [kind, rgb] : side.parts)
        out += image(region.width == width && region.y == 0 &&
                             rgb.size() == 3 * size_t(width) * size_t(region.height)
                         ? rgb
                         : cut(rgb, width, region),
                     {region.width, region.height}, out.empty() ? side.what : "", kind);
    return fmt::format("<div class=\"side {}\">\n{}</div>\n", side.name[0] == 'A' ? "a" : "b", out);
}

std::string controls(const std::string& id, bool light, bool framed, const Exposures& exposures) {
    std::string out = fmt::format(
        "<div class=\"controls\" data-for=\"{}\"><span><button data-show=\"a\">A</button><button "
        "data-show=\"b\">B</button><button data-show=\"swap\">swap</button><button "
        "data-show=\"slider\">slider</button><input type=\"range\" class=\"where\" min=\"0\" max=\"100\" "
        "step=\"0.1\" value=\"50\" aria-label=\"where A ends and B begins\"></span>\n",
        id);
    if (light)
        out +=
            fmt::format("<span><label>exposure <input type=\"range\" class=\"stops\" min=\"{}\" max=\"{}\" "
                        "step=\"0.25\" value=\"0\"></label><output></output><button "
                        "data-reset>reset</button></span>\n",
                        std::min(exposures.highlights, -4), exposures.shadows + 4);
    if (framed) out += "<span><button data-frame aria-pressed=\"true\">frame</button></span>\n";
    return out + "</div>\n";
}

std::string stops(int by) { return fmt::format("{} stop{}", std::abs(by), std::abs(by) == 1 ? "" : "s"); }

std::string percent(double share) {
    return share > 0.0 && share < 1e-4 ? "less than 0.01 %" : fmt::format("{:.2g} %", 100.0 * share);
}

// Text about the exposure shown, and about the light that no exposure shows.
std::string exposure_words(const Exposures& e) {
    std::string out = e.base == 0
                          ? "Base exposure: 0 stops, as the files say."
                          : fmt::format("Base exposure: {} {} than the files say (&times; {:.3g}).",
                                        stops(e.base), e.base > 0 ? "brighter" : "darker", std::exp2(e.base));
    if (e.highlights != 0)
        out += fmt::format(" White there: {} of A's pixels, {} of B's; they show their light {}.",
                           percent(e.white_test), percent(e.white_reference),
                           e.lost > 0.0 ? fmt::format("down to {} darker, where {} of all stay clipped",
                                                      stops(e.highlights), percent(e.lost))
                                        : fmt::format("within {} darker", stops(e.highlights)));
    return out;
}

std::string pair(const std::string& id, const Side& test, const Side& reference, Size size,
                 const std::string& framed, const std::string& words) {
    const Region whole{0, 0, size.width, size.height};
    const Shape shape = shape_of(size, 480);
    return figure(
        shape, " pair",
        fmt::format(" id=\"{}\" data-shows=\"slider\" aria-label=\"A and B, with a line that divides "
                    "them\"",
                    id),
        images(reference, size.width, whole) + images(test, size.width, whole) +
            "<span class=\"divider\"></span>\n" + framed +
            "<span class=\"which left\"></span><span class=\"which right\"></span>\n",
        caption("A, judged, and B, reference. " + words +
                (shape.stretched
                     ? fmt::format(" Stretched: it is {} &times; {} pixels.", size.width, size.height)
                     : "")));
}

// ---- how much they differ -------------------------------------------------------------------------------------------

// Legend of a heat map: histogram of the values, colours and scale.
std::string legend(const std::vector<float>& values, double white, double most, const std::string& what) {
    constexpr int bars = 64, height = 56;
    std::array<size_t, bars> counts{};
    for (const float v : values) ++counts[size_t(std::clamp(double(v) / white * bars, 0.0, bars - 1.0))];
    const double top = std::log10(1.0 + double(*std::max_element(counts.begin(), counts.end())));
    std::string out =
        fmt::format("<svg viewBox=\"0 0 {} {}\" preserveAspectRatio=\"none\" class=\"histogram\" "
                    "role=\"img\" aria-label=\"histogram of {}\">\n",
                    bars, height, escaped(what));
    for (int i = 0; i < bars; ++i) {
        const double h = std::log10(1.0 + double(counts[size_t(i)])) / top * height;
        out +=
            fmt::format("<rect x=\"{}\" y=\"{:.1f}\" width=\"0.9\" height=\"{:.1f}\"><title>{} pixels from "
                        "{:.3g}</title></rect>\n",
                        i, height - h, h, counts[size_t(i)], white * i / bars);
    }
    out += fmt::format("</svg>\n<div class=\"scale\" style=\"background:{}\"></div>\n<div class=\"ticks\">",
                       heat_gradient());
    for (int i = 0; i < 4; ++i) out += fmt::format("<span>{:.3g}</span>", white * i / 4);
    return out + fmt::format("<span>{:.3g}{}</span></div>\n", white, most > white ? " and more" : "");
}

struct Map {
    std::string name, words; // HTML
    double white = 0.0;
    std::vector<float> values;
    Pixels rgb;
};

Map map_of(const std::string& name, const std::string& words, std::vector<float> values, double white) {
    Map map{name, words, white, std::move(values), {}};
    map.rgb = heat_map(map.values, map.white);
    return map;
}

std::string map_figure(const Map& map, Size size, const std::string& framed) {
    const double most = double(*std::max_element(map.values.begin(), map.values.end()));
    return figure(shape_of(size, 480), " map", "", image(map.rgb, size, map.name, "heat") + framed,
                  legend(map.values, map.white, most, map.name) +
                      caption(fmt::format("{}, {:.3g} at most. Bars: how many pixels, on a logarithmic axis.",
                                          map.words, most)));
}

// ---- where it is worst ----------------------------------------------------------------------------------------------

std::string where_words(const ScaleResult* square, const Region& at, const Picture& picture,
                        const std::string& most) {
    const std::string place =
        at.width == 1 && at.height == 1
            ? fmt::format("pixel ({}, {})", at.x, at.y)
            : fmt::format("{} &times; {} pixels at ({}, {})", at.width, at.height, at.x, at.y);
    if (!square) return fmt::format("Framed: {}, with the most of {}.", place, most);
    return fmt::format(
        "Framed: {}, off by {:.3g} standard deviations in {}, the limit is {:.3g}{}.", place, square->worst,
        channel_of(*square, picture), square->limit,
        square->fails() ? "" : "; only the whole picture fails, and this square is closest to its limit");
}

std::string worst_place(const Region& framed, Size size, const Side& test, const Side& reference,
                        const std::vector<Map>& maps, const std::string& words) {
    const Region shown = context_of(framed, size.width, size.height);
    const Size part{shown.width, shown.height};
    const Shape shape = shape_of(part, 360);
    const std::string around = frame(framed, shown);
    std::string out =
        fmt::format("<h3>Where it is worst</h3>\n<p>{} Shown: the {} &times; {} pixels around.</p>\n"
                    "<div class=\"views\">\n<div class=\"group\">\n",
                    words, part.width, part.height);
    for (const Side* side : {&test, &reference})
        out += figure(shape, " crop", "", images(*side, size.width, shown) + around,
                      caption(side->name[0] == 'A' ? "A, judged" : "B, reference"));
    out += "</div>\n<div class=\"group\">\n";
    for (const Map& map : maps)
        out += figure(shape, " crop", "",
                      image(cut(map.rgb, size.width, shown), part, map.name + ", magnified", "heat") + around,
                      caption(map.name));
    return out + "</div>\n</div>\n";
}

std::string layer_section(const Picture::Layer& a, const Picture::Layer& b, const Comparison& c,
                          const Picture& picture, size_t number) {
    const bool proper = b.name.empty();
    const Size size{c.width, c.height};
    const Exposures exposures = proper ? exposures_of(a, b, c.display) : Exposures{};
    const Exposures* light = proper ? &exposures : nullptr;
    const Side test = side_of("A", "A: judged", a, b, light),
               reference = side_of("B", "B: reference", b, b, light);
    std::vector<float> apart = differences(a, b);
    const double white = heat_white(apart);
    std::vector<Map> maps;
    if (white > 0.0)
        maps.push_back(
            map_of("difference", "Difference of a pixel's worst channel", std::move(apart), white));
    if (white > 0.0 && proper)
        maps.push_back(
            map_of("FLIP", "FLIP, the difference that is seen: 0 none, 1 black and white", c.flip, 1.0));
    // The worst square of the noise test, if it fails: FLIP of a noisy picture finds the noisiest place.
    const ScaleResult* square = proper ? failing_square(c.scales) : nullptr;
    Region worst;
    std::string framed;
    if (!maps.empty()) {
        worst = square ? region_of(*square, c.width, c.height)
                       : worst_region(maps.back().values, c.width, c.height);
        framed = frame(worst, {0, 0, c.width, c.height});
    }
    const std::string id = fmt::format("pair{}", number);
    std::string out = fmt::format("<section{}><h2>{}</h2>\n",
                                  light ? fmt::format(" data-exposed=\"base\" data-highlights=\"{}\" "
                                                      "data-shadows=\"{}\"",
                                                      exposures.highlights, exposures.shadows)
                                        : "",
                                  proper ? "The picture" : escaped(b.name));
    if (number == 0)
        out += "<p class=\"small\">Drag across the picture to move the line, click to swap. With the pointer "
               "on it: "
               "<kbd>space</kbd> swap, <kbd>A</kbd> <kbd>B</kbd> one, <kbd>S</kbd> both, <kbd>&larr;</kbd> "
               "<kbd>&rarr;</kbd> line, <kbd>+</kbd> <kbd>&minus;</kbd> <kbd>0</kbd> exposure, <kbd>F</kbd> "
               "frame.</p>\n";
    out += controls(id, proper, !maps.empty(), exposures) + "<div class=\"views\">\n" +
           pair(id, test, reference, size, framed,
                light          ? exposure_words(exposures)
                : maps.empty() ? "Black to white: the range of B's numbers. No number differs."
                               : "Black to white: the range of B's numbers.");
    if (!maps.empty()) out += "<div class=\"group\">\n"; // keeps the maps side by side
    for (const Map& map : maps) out += map_figure(map, size, framed);
    out += maps.empty() ? "</div>\n" : "</div>\n</div>\n";
    if (maps.empty()) return out + (proper ? "<p>No number differs.</p>\n</section>\n" : "</section>\n");
    return out +
           worst_place(worst, size, test, reference, maps,
                       where_words(square, worst, picture, proper ? "FLIP" : "the difference")) +
           "</section>\n";
}

// SVG filters whose tables the script sets.
std::string filters() {
    std::string out = "<svg class=\"filters\" aria-hidden=\"true\">\n";
    for (const char* name : {"base", "highlights", "shadows"}) {
        out += fmt::format("<filter id=\"expose-{}\" x=\"0\" y=\"0\" width=\"100%\" height=\"100%\" "
                           "color-interpolation-filters=\"sRGB\"><feComponentTransfer>",
                           name);
        for (const char channel : {'R', 'G', 'B'})
            out += fmt::format("<feFunc{0} type=\"table\" tableValues=\"0 1\"></feFunc{0}>", channel);
        out += "</feComponentTransfer></filter>\n";
    }
    return out + "</svg>\n";
}

} // namespace
} // namespace page

std::string compare_page(const ComparedFile& test, const ComparedFile& reference,
                         const Comparison& comparison) {
    const std::string verdict = comparison.different() ? "Different"
                                : comparison.equal     ? "Equal"
                                : comparison.alike()   ? "Alike"
                                                       : "Cannot tell";
    std::string out = fmt::format(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}: {} and {}</title>\n"
        "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n{}</head><body><main>\n"
        "<div class=\"verdict {}\"><h1>{}</h1>\n",
        verdict, escaped(test.path), escaped(reference.path), page::style,
        comparison.different() ? "different"
        : comparison.alike()   ? "alike"
                               : "doubt",
        verdict);
    for (const std::string& fault : comparison.faults) out += fmt::format("<p>{}</p>\n", escaped(fault));
    if (!comparison.different() && !comparison.doubt.empty())
        out += fmt::format("<p>{}</p>\n", escaped(comparison.doubt));
    for (const std::string& note : comparison.notes) out += fmt::format("<p>{}</p>\n", escaped(note));
    if (comparison.swapped)
        out += "<p>A carries limits: B is judged by it, and numbers are relative to A.</p>\n";
    if (comparison.alike())
        out +=
            comparison.equal ? "<p>Every number is the same.</p>\n"
            : comparison.has_noise_estimate
                ? "<p>All differences are within the noise given by the pictures' variance, and a difference "
                  "that people would see would have been found.</p>\n"
                : "<p>They look the same. Noise is unknown, so it cannot be tested: " +
                      escaped(comparison.unknown) + ".</p>\n";
    out += fmt::format("<p class=\"files\">A, judged: {}<br>B, reference: {}</p></div>\n", escaped(test.path),
                       escaped(reference.path));
    size_t number = 0;
    for (const Picture::Layer& layer : reference.picture.layers) {
        const Picture::Layer* mine = test.picture.find(layer.name);
        if (layer.name == "variance" || !mine || mine->channels.size() != layer.channels.size()) continue;
        out += page::layer_section(*mine, layer, comparison, reference.picture, number++);
    }
    return out + page::numbers(comparison, reference.picture) + page::metadata(test, reference) +
           page::filters() + page::script + "</main></body></html>\n";
}

} // namespace marram
