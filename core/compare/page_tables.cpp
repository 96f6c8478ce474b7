// SPDX-License-Identifier: Apache-2.0
#include "core/compare/page_tables.h"

#include "core/compare/page_view.h"
#include "core/page/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram::page {
namespace {

std::string cells(std::initializer_list<std::string> numbers) {
    std::string out;
    for (const std::string& number : numbers) out += "<td class=\"number\">" + number + "</td>";
    return out;
}

std::string row(bool fails, const std::string& what, const std::string& more) {
    return fmt::format("<tr{}><td>{}{}</td>{}</tr>\n", fails ? " class=\"bad\"" : "", what,
                       fails ? " (fails)" : "", more);
}

std::string table(std::initializer_list<const char*> heads, const std::string& rows) {
    std::string out = "<div class=\"wide\"><table><tr>";
    for (const char* head : heads)
        out += fmt::format("<th{}>{}</th>", head == *heads.begin() ? "" : " class=\"number\"", head);
    return out + "</tr>\n" + rows + "</table></div>\n";
}

std::string term(const char* name, const char* meaning) {
    return fmt::format("<dt>{}</dt><dd>{}</dd>\n", name, meaning);
}

} // namespace

std::string numbers(const Comparison& c, const Picture& picture) {
    const auto four = [](double v) { return fmt::format("{:.4g}", v); };
    std::string layers, looks, scales, ratios;
    for (const LayerResult& layer : c.layers)
        layers +=
            row(!layer.fault.empty(), layer.name.empty() ? "picture" : escaped(layer.name),
                cells({four(layer.rmse), four(layer.relative_mse), fmt::format("{:.2f}", layer.psnr),
                       four(layer.most),
                       layer.found_from > 0.0 ? fmt::format("{:.2g}", layer.found_from) : std::string()}));
    const auto look = [&](const std::string& what, double value, double limit, bool judged, bool fails) {
        looks += row(fails, what, cells({four(value), judged ? four(limit) : std::string("not judged")}));
    };
    look("FLIP, mean", c.flip_mean, c.flip_mean_limit, std::isfinite(c.flip_mean_limit),
         c.flip_mean > c.flip_mean_limit);
    look("FLIP, 99th percentile", c.flip_99, c.flip_99_limit, std::isfinite(c.flip_99_limit),
         c.flip_99 > c.flip_99_limit);
    look(fmt::format("FLIP, worst 16 &times; 16 pixels, at ({}, {})", c.flip_window_x, c.flip_window_y),
         c.flip_window, c.flip_window_limit, std::isfinite(c.flip_window_limit),
         c.flip_window > c.flip_window_limit);
    look("SSIM", c.ssim, c.ssim_limit, c.ssim_limit >= 0.0, c.ssim < c.ssim_limit);
    for (const ScaleResult& s : c.scales)
        scales += row(s.fails(),
                      s.size == 0   ? std::string("whole picture")
                      : s.size == 1 ? std::string("single pixels")
                                    : fmt::format("{0} &times; {0} pixels", s.size),
                      cells({four(s.worst), four(s.limit),
                             s.size == 0 || s.worst == 0.0 ? "" : fmt::format("({}, {})", s.x, s.y),
                             channel_of(s, picture),
                             c.light > 0.0 ? fmt::format("{:.2g} %", 100.0 * s.limit * s.deviation / c.light)
                                           : std::string()}));
    for (const RatioResult& r : c.ratios)
        ratios +=
            row(r.fails(),
                r.size == 1 ? std::string("single pixels") : fmt::format("{0} &times; {0} pixels", r.size),
                cells({four(r.ratio), four(r.limit)}));
    std::string out =
        "<h2>Numbers</h2>\n<p class=\"small\">Of linear light, for 8-bit pictures too.</p>\n" +
        table({"layer", "RMSE", "relative MSE", "PSNR, dB", "greatest difference", "means found from"},
              layers) +
        table({"looks", "value", "limit"}, looks);
    if (!scales.empty())
        out +=
            table({"noise: worst of", "standard deviations", "limit", "at", "channel", "found from"}, scales);
    if (!ratios.empty()) out += table({"noise: all of", "squared differences / variance", "limit"}, ratios);
    out +=
        "<dl>\n" + term("RMSE", "root of the mean of squared differences of all numbers") +
        term("relative MSE",
             "mean of squared differences, each divided by the square of B&rsquo;s number (and a "
             "hundredth of the squared mean of B, so that black does not count without bound)") +
        term("PSNR",
             "20 log<sub>10</sub>(range / RMSE); the picture&rsquo;s range is 1, or more where B is "
             "brighter; for other layers it runs from the 1st to the 99th percentile of B&rsquo;s values") +
        term("means found from", "the difference of the means of 16 &times; 16 pixels that would have been "
                                 "above the limit: the median "
                                 "over the picture") +
        term("FLIP",
             fmt::format("the difference that is seen when swapping, 0 to 1, {}", c.flip_kind()).c_str()) +
        term("SSIM", "likeness of structure, of luminance as a screen shows it; 1: the same");
    if (!scales.empty())
        out +=
            term("standard deviations", "the difference of two means over a square, divided by its standard "
                                        "deviation from the variance layers; the worst square of each size") +
            term("found from", "the difference of a square&rsquo;s mean that would have been above the "
                               "limit, relative to the mean "
                               "light of B: the median over the squares");
    if (!ratios.empty())
        out += term(
            "squared differences / variance",
            "the mean over the picture&rsquo;s blocks of 16 &times; 16 pixels with noise; at most 1 if the "
            "pictures differ in noise alone");
    return out + "</dl>\n";
}

std::string metadata(const ComparedFile& a, const ComparedFile& b) {
    const auto of = [](const ComparedFile& file) { return read_all_metadata(file.path); };
    const auto x = of(a), y = of(b);
    std::vector<std::string> keys;
    for (const auto* list : {&x, &y})
        for (const auto& [key, value] : *list) keys.push_back(key);
    std::ranges::sort(keys);
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    const auto value = [](const auto& list, const std::string& key) {
        for (const auto& [k, v] : list)
            if (k == key) return v;
        return std::string();
    };
    std::string out = fmt::format(
        "<h2>What the files say</h2>\n<p class=\"small\"><span class=\"mark\">&ne;</span> the values of A "
        "and B differ.</p>\n<table class=\"says\"><tr><th></th><th>A</th><th>B</th></tr>\n"
        "<tr><td>file</td><td>{0}</td><td>{1}</td></tr>\n<tr><td>size</td><td>{2} &times; {3}</td>"
        "<td>{2} &times; {3}</td></tr>\n",
        escaped(a.path), escaped(b.path), a.picture.width, a.picture.height);
    const bool alike = a.picture.read_as == b.picture.read_as;
    out += fmt::format("<tr{}><td>{}colours read as</td><td>{}</td><td>{}</td></tr>\n",
                       alike ? "" : " class=\"other\"", alike ? "" : "&ne;&nbsp;", escaped(a.picture.read_as),
                       escaped(b.picture.read_as));
    for (const std::string& key : keys) {
        const std::string p = value(x, key), q = value(y, key);
        out += fmt::format("<tr{}><td>{}{}</td><td><div>{}</div></td><td><div>{}</div></td></tr>\n",
                           p == q ? "" : " class=\"other\"", p == q ? "" : "&ne;&nbsp;", escaped(key),
                           escaped(p), escaped(q));
    }
    return out + "</table>\n";
}

} // namespace marram::page
