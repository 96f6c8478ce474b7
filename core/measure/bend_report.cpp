// SPDX-License-Identifier: Apache-2.0
#include "core/measure/bend_report.h"

#include "core/page/html.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

std::string explained(const BendResult& bend) {
    return fmt::format(
        "The blades of {}, against the same strands with bend = \"talk\": angles between their segments in a "
        "steady wind of {:.3g} m/s at most, over {} strands, in degrees. turned: how far the wind turns the "
        "blades. "
        "own: error of the scene's dials. fitted: error of the dials below. Of each the median and what 95 % "
        "stay "
        "below; segments count by length.",
        bend.groom, bend.max_speed, bend.strands);
}

std::string where(const BendRow& row) {
    return row.from == row.to ? fmt::format("{:.3g} m/s", row.from)
                              : fmt::format("{:.2g} to {:.2g} of length", row.from, row.to);
}

// All rows: those of speeds, of the parts of the strands, and both together.
std::vector<std::pair<std::string, BendRow>> rows_of(const BendResult& bend) {
    std::vector<std::pair<std::string, BendRow>> rows;
    for (const BendRow& row : bend.by_speed) rows.emplace_back(where(row), row);
    for (const BendRow& row : bend.by_arc) rows.emplace_back(where(row), row);
    return rows;
}

std::string summary(const BendResult& bend) {
    const std::string unsolved =
        bend.unsolved == 0
            ? ""
            : fmt::format(" Up to {} blades have no stable pose that was found: their errors say little.",
                          bend.unsolved);
    return fmt::format(
               "Over all speeds above 0: own {:.1f}, 95 % below {:.1f}; fitted {:.1f}, 95 % below {:.1f} "
               "degrees.",
               bend.before.median, bend.before.most, bend.after.median, bend.after.most) +
           unsolved;
}

constexpr const char* paste =
    "The fitted dials, lines for [wind], or each with wind. before it for the groom, with bend = \"talk\":";

// Medians over the speed, and what 95 % stay below as dashed lines.
std::string chart(const BendResult& bend) {
    constexpr double width = 640, height = 300, left = 60, right = 610, top = 16, bottom = 250;
    double highest = 1.0;
    for (const BendRow& row : bend.by_speed) highest = std::max({highest, row.before.most, row.after.most});
    const auto x = [&](double speed) { return left + speed / bend.max_speed * (right - left); };
    const auto y = [&](double angle) { return bottom - angle / highest * (bottom - top); };
    std::string out;
    const auto text = [&](double px, double py, const char* anchor, const std::string& words) {
        out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>\n", px, py, anchor,
                           escaped(words));
    };
    const double ten = std::pow(10.0, std::floor(std::log10(highest)));
    const double step = ten * (highest < 2.0 * ten ? 0.2 : highest < 5.0 * ten ? 0.5 : 1.0);
    for (double angle = 0.0; angle <= highest; angle += step) {
        out += fmt::format("<line x1=\"{0}\" y1=\"{2:.1f}\" x2=\"{1}\" y2=\"{2:.1f}\" stroke=\"#d5d9de\"/>\n",
                           left, right, y(angle));
        text(left - 6, y(angle) + 4, "end", fmt::format("{:g}", angle));
    }
    for (int i = 0; i <= 4; ++i)
        text(x(bend.max_speed * i / 4), bottom + 16, "middle", fmt::format("{:.3g}", bend.max_speed * i / 4));
    text(0.5 * (left + right), bottom + 38, "middle",
         "wind, m/s: error of the scene's own dials (orange) and the fitted ones (blue), degrees");
    const auto line = [&](auto&& value, const char* colour, const char* dashes) {
        out += fmt::format("<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"2\"{} points=\"", colour,
                           dashes);
        for (const BendRow& row : bend.by_speed)
            out += fmt::format("{:.1f},{:.1f} ", x(row.from), y(value(row)));
        out += "\"/>\n";
    };
    constexpr const char *orange = "#c2410c", *blue = "#1b6ca8", *dashed = " stroke-dasharray=\"4 4\"";
    line([](const BendRow& row) { return row.before.median; }, orange, "");
    line([](const BendRow& row) { return row.before.most; }, orange, dashed);
    line([](const BendRow& row) { return row.after.median; }, blue, "");
    line([](const BendRow& row) { return row.after.most; }, blue, dashed);
    return fmt::format("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
                       "font-family=\"sans-serif\" font-size=\"12\" fill=\"#444\" role=\"img\" "
                       "aria-label=\"bend of {2}: error over the wind's speed\">\n<rect width=\"{0:.0f}\" "
                       "height=\"{1:.0f}\" fill=\"#fff\"/>\n{3}</svg>\n",
                       width, height, escaped(bend.groom), out);
}

} // namespace

std::string bend_table(const BendResult& bend) {
    std::string out = fmt::format("\nbend: {}\n", explained(bend));
    out += fmt::format("  {:<22} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7}\n", "", "turned", "95 %", "own", "95 %",
                       "fitted", "95 %");
    for (const auto& [label, row] : rows_of(bend))
        out += fmt::format("  {:<22} {:>7.1f} {:>7.1f} {:>7.1f} {:>7.1f} {:>7.1f} {:>7.1f}\n", label,
                           row.turned.median, row.turned.most, row.before.median, row.before.most,
                           row.after.median, row.after.most);
    out += "  " + summary(bend) + "\n  " + paste + "\n";
    for (const std::string& line : bend.dials) out += "    " + line + "\n";
    return out;
}

std::vector<BendSetting> bend_settings(const BendResult& bend) {
    std::vector<BendSetting> settings;
    const auto add = [&](const std::string& at, const BendError& own, const BendError& fitted) {
        settings.push_back({fmt::format("{}: own dials, {}", bend.groom, at), own, true});
        settings.push_back({fmt::format("{}: fitted dials, {}", bend.groom, at), fitted, false});
    };
    for (const auto& [label, row] : rows_of(bend)) add(label, row.before, row.after);
    add("all speeds", bend.before, bend.after);
    return settings;
}

std::string bend_html(const BendResult& bend) {
    std::string out =
        fmt::format("<h2>bend: {}</h2>\n<p>{}</p>\n{}<table>\n<tr><th></th><th>turned</th><th>95 "
                    "%</th><th>own</th><th>95 %</th><th>fitted</th><th>95 %</th></tr>\n",
                    escaped(bend.groom), escaped(explained(bend)), chart(bend));
    for (const auto& [label, row] : rows_of(bend))
        out += fmt::format(
            "<tr><td>{}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}"
            "</td><td>{:.1f}</td></tr>\n",
            escaped(label), row.turned.median, row.turned.most, row.before.median, row.before.most,
            row.after.median, row.after.most);
    return out + fmt::format("</table>\n<p>{}</p>\n<p>{}</p>\n<pre>{}</pre>\n", escaped(summary(bend)),
                             escaped(paste), escaped(fmt::format("{}", fmt::join(bend.dials, "\n"))));
}

} // namespace marram
