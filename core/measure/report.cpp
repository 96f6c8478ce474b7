// SPDX-License-Identifier: Apache-2.0
#include "core/measure/report.h"

#include "core/measure/bend_report.h"
#include "core/page/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// Quotes a field of a CSV file (RFC 4180).
std::string field(const std::string& text) {
    if (text.find_first_of(",\"\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
    return out + "\"";
}

bool is_reference(const DialResult& result, size_t i) { return i == result.dial.reference; }

std::string marks(const DialResult& result, size_t i) {
    std::string text;
    if (result.dial.settings[i].own) text += "scene's own";
    if (is_reference(result, i)) text += text.empty() ? "reference" : ", reference";
    if (result.settings[i].front) text += text.empty() ? "front" : ", front";
    return text;
}

std::string error_name(const Dial& dial) {
    switch (dial.error) {
    case DialError::pose:
        return "error, share of a strand's length (rms)";
    case DialError::motion:
        return "error, pixels (99 strands in 100 stay below)";
    case DialError::surface:
        return "error, metres of the surface (rms)";
    case DialError::attribute:
        return "error, of the mesh's first attribute, relative (rms)";
    case DialError::view:
        return "error, pixels (rms)";
    default:
        return "error, relative to the mean (rms)";
    }
}

// ---- plots ----------------------------------------------------------------------------------------------------------

// A logarithmic axis.
struct Axis {
    double low, high; // exponents
    double from, to;  // coordinates in the plot

    double at(double value) const { return from + (std::log10(value) - low) / (high - low) * (to - from); }
};

// The values 1, 2 and 5 times powers of ten within the exponents; only the powers for wide ranges.
std::vector<double> ticks(double low, double high) {
    std::vector<double> values;
    for (double e = std::floor(low); e <= high; e += 1.0)
        for (const double step : {1.0, 2.0, 5.0}) {
            const double value = step * std::pow(10.0, e), at = std::log10(value);
            if ((step == 1.0 || high - low < 2.5) && at >= low - 1e-9 && at <= high + 1e-9)
                values.push_back(value);
        }
    return values;
}

// An axis that covers the values, and at least 0.35 decades to either side of their middle.
Axis axis_over(const std::vector<double>& values, double from, double to) {
    double low = 1e300, high = 1e-300;
    for (const double v : values) {
        low = std::min(low, v);
        high = std::max(high, v);
    }
    if (low > high) low = high = 1.0;
    const double a = std::log10(low), b = std::log10(high), half = std::max(0.56 * (b - a) + 0.05, 0.35);
    return {0.5 * (a + b) - half, 0.5 * (a + b) + half, from, to};
}

constexpr double width = 640, height = 400, left = 74, right = 610, top = 20, bottom = 340;
constexpr double exact_line = bottom - 14; // where errors of 0 are drawn

std::string grid(const Axis& x, const Axis& y, const DialResult& result) {
    const Dial& dial = result.dial;
    std::string out;
    const auto line = [&](double x0, double y0, double x1, double y1) {
        out += fmt::format(
            "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#d5d9de\"/>\n", x0, y0,
            x1, y1);
    };
    const auto text = [&](double px, double py, const char* anchor, const std::string& words) {
        out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>\n", px, py, anchor,
                           escaped(words));
    };
    const auto tick = [](double value) {
        return value >= 0.001 && value < 10000 ? fmt::format("{:g}", value) : fmt::format("{:.0e}", value);
    };
    for (const double value : ticks(x.low, x.high)) {
        line(x.at(value), top, x.at(value), bottom);
        text(x.at(value), bottom + 16, "middle", tick(value));
    }
    for (const double value : ticks(y.low, y.high)) {
        line(left, y.at(value), right, y.at(value));
        text(left - 6, y.at(value) + 4, "end", tick(value));
    }
    text(0.5 * (left + right), bottom + 40, "middle",
         fmt::format("time of {}, relative to {}", dial.time, dial.settings[result.base].label));
    out +=
        fmt::format("<text transform=\"translate(16 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                    0.5 * (top + bottom), escaped(error_name(dial)));
    return out;
}

constexpr double line_height = 14;

struct Label {
    double x, y; // of its point
    double top;  // of its text
    std::string text;

    bool flips() const { return x > right - 90; } // text to the left of its point
    double begin() const { return flips() ? x - 13 - extent() : x + 13; }
    double extent() const { return 7.0 * double(text.size()); }
};

// Places labels beside their points, moved up or down to avoid other labels and points.
void place(std::vector<Label>& labels) {
    for (size_t i = 0; i < labels.size(); ++i) {
        Label& label = labels[i];
        const auto taken = [&](double at) {
            if (at < top - line_height || at > bottom - 2) return true;
            for (size_t k = 0; k < labels.size(); ++k) {
                const Label& other = labels[k];
                const bool beside =
                    label.begin() < other.x + 6 && other.x - 6 < label.begin() + label.extent();
                if (k != i && beside && std::abs(at + 0.5 * line_height - other.y) < 10) return true;
                if (k < i && std::abs(other.top - at) < line_height &&
                    label.begin() < other.begin() + other.extent() &&
                    other.begin() < label.begin() + label.extent())
                    return true;
            }
            return false;
        };
        const double beside = label.y - 0.5 * line_height;
        label.top = beside;
        for (int step = 0; step < 40; ++step) {
            const double at = beside + (step % 2 == 0 ? -1 : 1) * 5.0 * ((step + 1) / 2);
            if (taken(at)) continue;
            label.top = at;
            break;
        }
    }
}

// The content of the plot's <svg> element.
std::string plot(const DialResult& result) {
    std::vector<double> times, errors;
    for (const SettingResult& s : result.settings)
        if (s.refused.empty() && s.ratio > 0.0) { // a time of 0 cannot be drawn on a logarithmic axis
            times.push_back(s.ratio);
            if (s.error > 0.0) errors.push_back(s.error);
        }
    if (times.empty()) return "<text x=\"20\" y=\"40\">nothing was measured</text>\n";
    const Axis x = axis_over(times, left, right), y = axis_over(errors, bottom - 30, top);
    std::string out = grid(x, y, result);
    const auto y_of_error = [&](double error) { return error > 0.0 ? y.at(error) : exact_line; };
    if (std::ranges::any_of(result.settings,
                            [](const SettingResult& s) { return s.refused.empty() && !(s.error > 0.0); }))
        out +=
            fmt::format("<text x=\"{0:.1f}\" y=\"{1:.1f}\" text-anchor=\"end\">0</text>\n"
                        "<line x1=\"{2:.1f}\" y1=\"{3:.1f}\" x2=\"{4:.1f}\" y2=\"{3:.1f}\" stroke=\"#888\" "
                        "stroke-dasharray=\"3 3\"/>\n",
                        left - 6, exact_line + 4, left, exact_line, right);
    // The front, from the fastest setting on.
    std::vector<const SettingResult*> front;
    for (const SettingResult& s : result.settings)
        if (s.front && s.ratio > 0.0) front.push_back(&s);
    std::ranges::sort(front, {}, [](const SettingResult* s) { return s->ratio; });
    out += "<polyline fill=\"none\" stroke=\"#1b6ca8\" stroke-width=\"1.5\" points=\"";
    for (const SettingResult* s : front)
        out += fmt::format("{:.1f},{:.1f} ", x.at(s->ratio), y_of_error(s->error));
    out += "\"/>\n";
    std::vector<Label> labels;
    for (size_t i = 0; i < result.settings.size(); ++i) {
        const SettingResult& s = result.settings[i];
        if (!s.refused.empty() || !(s.ratio > 0.0)) continue;
        const double px = x.at(s.ratio), py = y_of_error(s.error);
        if (result.dial.settings[i].own)
            out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"9\" fill=\"none\" stroke=\"#c2410c\" "
                               "stroke-width=\"2\"/>\n",
                               px, py);
        out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4.5\" fill=\"{}\" stroke=\"#1b6ca8\"/>\n",
                           px, py, s.front ? "#1b6ca8" : "#ffffff");
        labels.push_back({px, py, 0.0, result.dial.settings[i].label});
    }
    place(labels);
    for (const Label& label : labels) {
        const double middle = label.top + 0.5 * line_height;
        out += fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#aab\"/>\n"
                           "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" fill=\"#111\" "
                           "paint-order=\"stroke\" stroke=\"#fff\" stroke-width=\"3\">{}</text>\n",
                           label.x, label.y, label.flips() ? label.x - 11 : label.x + 11, middle,
                           label.flips() ? label.x - 13 : label.x + 13, middle + 4,
                           label.flips() ? "end" : "start", escaped(label.text));
    }
    return out;
}

std::string svg(const DialResult& result) {
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
        "font-family=\"sans-serif\" font-size=\"12\" fill=\"#444\" role=\"img\" aria-label=\"{2}: time "
        "against error\">\n<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#fff\"/>\n{3}</svg>\n",
        width, height, escaped(result.dial.name), plot(result));
}

// What the scene has.
std::string counts(const Measurement& m) {
    return m.built ? fmt::format("{} strands, {} CVs, {} triangles", m.strands, m.cvs, m.triangles)
                   : std::string("not built");
}

std::string number(double value) { return value == 0.0 ? "0" : fmt::format("{:.3g}", value); }

std::string percent(double share) { return number(100.0 * share) + " %"; }

// What the columns mean.
std::vector<std::string> column_help(const Measurement& m) {
    std::vector<std::string> lines;
    const auto any = [&](auto&& which) { return std::ranges::any_of(m.dials, which); };
    if (any([](const DialResult& result) { return result.dial.error == DialError::pose; }))
        lines.emplace_back(
            "error: root mean square over the strands of the farthest CV from the reference, as a "
            "share of the strand's length. worst: the strand that is farthest off.");
    if (any([](const DialResult& result) { return result.dial.counts_crossing; }))
        lines.emplace_back(
            "contact: its worst is a strand that touches a mesh in one setting and passes it, or "
            "passes it on the other side, in the reference. No tolerance bounds that distance.");
    if (any([](const DialResult& result) { return !result.dial.without_contact.empty(); }))
        lines.emplace_back(
            "beyond: share of the strands that are, after contact, farther than the tolerance from "
            "the reference. Contact branches: a strand slides off a mesh to one side or the other. "
            "So the tolerance bounds each stage from the same input, not the sum of all stages.");
    return lines;
}

} // namespace

void mark_front(DialResult& result) {
    for (size_t i = 0; i < result.settings.size(); ++i) {
        SettingResult& s = result.settings[i];
        s.front = s.refused.empty();
        for (size_t j = 0; j < result.settings.size() && s.front; ++j) {
            const SettingResult& t = result.settings[j];
            if (j == i || !t.refused.empty()) continue;
            const bool no_worse = t.ratio <= s.ratio && t.error <= s.error;
            const bool better = t.ratio < s.ratio || t.error < s.error;
            if (no_worse && better) s.front = false;
        }
    }
}

std::string error_unit(DialError error) {
    if (error == DialError::motion || error == DialError::view) return "px";
    return error == DialError::surface ? "m" : "1";
}

std::string to_table(const Measurement& m) {
    std::string out = fmt::format("{}, frame {:g}: {}, {} threads\n", m.scene, m.frame, counts(m), m.threads);
    for (const DialResult& result : m.dials) {
        const Dial& dial = result.dial;
        out += fmt::format("\n{}: {}\n", dial.name, dial.explain);
        out += fmt::format("  {:<14} {:>10} {:>8} {:>10} {:>10}{}{} {:>7}\n", "setting",
                           dial.time == "strands and BVH" ? "ms" : dial.time + " ms", "ratio", "error",
                           "worst", dial.counts_crossing ? "  crossed" : "",
                           dial.without_contact.empty() ? "" : "   beyond", "rounds");
        for (size_t i = 0; i < result.settings.size(); ++i) {
            const SettingResult& s = result.settings[i];
            if (!s.refused.empty()) {
                out += fmt::format("  {:<14} {}\n", dial.settings[i].label, s.refused);
                continue;
            }
            out += fmt::format("  {:<14} {:>10.4g} {:>8.3g} {:>10} {:>10}", dial.settings[i].label,
                               1e3 * s.seconds, s.ratio, number(s.error), number(s.worst));
            if (dial.counts_crossing) out += fmt::format(" {:>8}", s.crossing);
            if (!dial.without_contact.empty()) out += fmt::format(" {:>8}", percent(s.beyond));
            out += fmt::format(" {:>7}  {}\n", s.rounds, marks(result, i));
        }
        if (!result.rule.empty()) out += "  " + result.rule + "\n";
    }
    for (const std::string& line : column_help(m)) out += "\n" + line + "\n";
    for (const BendResult& bend : m.bends) out += bend_table(bend);
    out += "\nLeft out:\n";
    for (const std::string& why : m.left_out) out += "  " + why + "\n";
    return out;
}

std::string to_csv(const Measurement& m) {
    std::string out = "dial,setting,timed,seconds,ratio,error,worst,unit,crossed,rounds,own,reference,front,"
                      "refused,beyond\n";
    for (const DialResult& result : m.dials)
        for (size_t i = 0; i < result.settings.size(); ++i) {
            const SettingResult& s = result.settings[i];
            const DialSetting& setting = result.dial.settings[i];
            out += fmt::format("{},{},{},{:.9g},{:.9g},{:.9g},{:.9g},{},{},{},{},{},{},{},{}\n",
                               field(result.dial.name), field(setting.label), field(result.dial.time),
                               s.seconds, s.ratio, s.error, s.worst, error_unit(result.dial.error),
                               result.dial.counts_crossing ? std::to_string(s.crossing) : "", s.rounds,
                               int(setting.own), int(is_reference(result, i)), int(s.front), field(s.refused),
                               result.dial.without_contact.empty() ? "" : fmt::format("{:.9g}", s.beyond));
        }
    for (const BendResult& bend : m.bends)
        for (const BendSetting& setting : bend_settings(bend)) // no times
            out += fmt::format("bend,{},,0,0,{:.9g},{:.9g},deg,,0,{},0,0,,\n", field(setting.label),
                               setting.error.median, setting.error.most, int(setting.own));
    return out;
}

std::string to_svg(const DialResult& result) { return svg(result); }

std::string to_html(const Measurement& m) {
    std::string out = fmt::format(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}: speed against "
        "error</title>\n"
        "<meta name=\"viewport\" content=\"width=device-width\">\n<style>\n"
        "body{{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 "
        "1em;color:#222;background:#fff}}\n"
        "table{{border-collapse:collapse;margin:.5em 0}} td,th{{padding:.15em .8em;text-align:right;"
        "border-bottom:1px solid #ddd}}\n"
        "td:first-child,th:first-child,td:last-child,th:last-child{{text-align:left}}\n"
        "tr.own td{{background:#fff1e8}} svg{{width:100%;max-width:640px;height:auto;display:block}}\n"
        "</style></head><body>\n<h1>Speed against error</h1>\n"
        "<p>{0}, frame {1:g}: {2}, {3} threads. Times are medians of "
        "interleaved "
        "rounds, as ratios to the setting that the axis names, in the same round. Filled points are the "
        "front: "
        "nothing measured "
        "is both faster and more exact. The ring is what the scene has. Colliders at rest keep their search "
        "tree from "
        "round to round, as they do from frame to frame.</p>\n",
        escaped(m.scene), m.frame, counts(m), m.threads);
    for (const DialResult& result : m.dials) {
        const Dial& dial = result.dial;
        out += fmt::format(
            "<h2>{}</h2>\n<p>{}</p>\n{}<table>\n<tr><th>setting</th><th>{} (ms)</th><th>ratio</th>"
            "<th>{}</th><th>worst</th>{}{}<th>rounds</th><th></th></tr>\n",
            escaped(dial.name), escaped(dial.explain), svg(result), escaped(dial.time),
            escaped(error_name(dial)), dial.counts_crossing ? "<th>strands crossed</th>" : "",
            dial.without_contact.empty() ? "" : "<th>beyond</th>");
        for (size_t i = 0; i < result.settings.size(); ++i) {
            const SettingResult& s = result.settings[i];
            out += fmt::format("<tr{}><td>{}</td>", dial.settings[i].own ? " class=\"own\"" : "",
                               escaped(dial.settings[i].label));
            if (!s.refused.empty()) {
                const bool more = dial.counts_crossing || !dial.without_contact.empty();
                out += fmt::format("<td colspan=\"{}\">{}</td></tr>\n", more ? 7 : 6, escaped(s.refused));
                continue;
            }
            out += fmt::format("<td>{:.4g}</td><td>{:.3g}</td><td>{}</td><td>{}</td>", 1e3 * s.seconds,
                               s.ratio, number(s.error), number(s.worst));
            if (dial.counts_crossing) out += fmt::format("<td>{}</td>", s.crossing);
            if (!dial.without_contact.empty()) out += fmt::format("<td>{}</td>", percent(s.beyond));
            out += fmt::format("<td>{}</td><td>{}</td></tr>\n", s.rounds, marks(result, i));
        }
        out += "</table>\n";
        if (!result.rule.empty()) out += fmt::format("<p>{}</p>\n", escaped(result.rule));
    }
    for (const std::string& line : column_help(m)) out += fmt::format("<p>{}</p>\n", escaped(line));
    for (const BendResult& bend : m.bends) out += bend_html(bend);
    out += "<h2>Left out</h2>\n<ul>\n";
    for (const std::string& why : m.left_out) out += fmt::format("<li>{}</li>\n", escaped(why));
    return out + "</ul>\n</body></html>\n";
}

} // namespace marram
