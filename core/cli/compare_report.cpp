// SPDX-License-Identifier: Apache-2.0
#include "core/cli/compare_report.h"

#include "core/cli/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

using Pixels = std::vector<float>; // 3 a pixel, linear

// How a layer's numbers become colours: the picture proper by an exposure, others from their range.
struct Look {
    float low = 0.0F, high = 1.0F;
    bool encoded = true; // numbers that are no light are shown in proportion
};

Look look_of(const Picture::Layer& layer) {
    Look look;
    if (layer.name.empty()) {
        // Nearly white: what 99 of 100 numbers stay below, if that is more than a screen shows.
        Pixels sorted = layer.pixels;
        const auto at = sorted.begin() + long(sorted.size() * 99 / 100);
        std::nth_element(sorted.begin(), at, sorted.end());
        look.high = std::max(1.0F, *at);
        return look;
    }
    const auto [low, high] = std::minmax_element(layer.pixels.begin(), layer.pixels.end());
    look.low = std::min(0.0F, *low);
    look.high = *high > look.low ? *high : look.low + 1.0F;
    look.encoded = layer.name == "albedo";
    return look;
}

Pixels shown(const Picture::Layer& layer, const Look& look) {
    const size_t channels = layer.channels.size(), count = layer.pixels.size() / channels;
    Pixels rgb(3 * count);
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) {
            // Two channels are red and green.
            const float v = channels == 1  ? layer.pixels[i]
                            : c < channels ? layer.pixels[i * channels + c]
                                           : look.low;
            const float share = std::clamp((v - look.low) / (look.high - look.low), 0.0F, 1.0F);
            rgb[3 * i + c] = look.encoded ? share : linear_from_srgb(share);
        }
    return rgb;
}

// Black, violet, orange, white: brighter is more, to those who see no colours too.
std::array<float, 3> heat(double x) {
    static constexpr double stops[][3] = {{0.0, 0.0, 0.02},   {0.23, 0.06, 0.44}, {0.55, 0.16, 0.51},
                                          {0.87, 0.29, 0.41}, {0.99, 0.6, 0.38},  {0.99, 0.99, 0.75}};
    const double at = (x > 0.0 ? std::min(x, 1.0) : 0.0) * 5.0;
    const int i = std::min(int(at), 4);
    std::array<float, 3> rgb{};
    for (size_t c = 0; c < 3; ++c)
        rgb[c] = linear_from_srgb(float(stops[i][c] + (at - i) * (stops[i + 1][c] - stops[i][c])));
    return rgb;
}

Pixels heat_map(const std::vector<float>& values, double white) {
    Pixels rgb;
    for (const float v : values)
        for (const float c : heat(white > 0.0 ? double(v) / white : 0.0)) rgb.push_back(c);
    return rgb;
}

// Each pixel's greatest difference of a channel.
std::vector<float> differences(const Picture::Layer& a, const Picture::Layer& b) {
    const size_t channels = b.channels.size();
    std::vector<float> out(b.pixels.size() / channels);
    for (size_t i = 0; i < b.pixels.size(); ++i) { // of the largest floats the difference is none
        constexpr double largest = 3e38;
        const double apart = std::min(std::abs(double(a.pixels[i]) - double(b.pixels[i])), largest);
        out[i / channels] = std::max(out[i / channels], float(apart));
    }
    return out;
}

struct Box {
    int x, y, width, height;
};

Pixels cut(const Pixels& rgb, int width, const Box& box) {
    Pixels out;
    for (int y = box.y; y < box.y + box.height; ++y) {
        const auto row = rgb.begin() + 3 * (long(y) * width + box.x);
        out.insert(out.end(), row, row + 3 * box.width);
    }
    return out;
}

// The square of 32 pixels with the most of it.
Box worst_region(const std::vector<float>& values, int width, int height) {
    constexpr int side = 32, step = 8;
    Box worst{0, 0, std::min(side, width), std::min(side, height)};
    double most = -1.0;
    for (int y = 0;; y += step) {
        const int top = std::min(y, height - worst.height);
        for (int x = 0;; x += step) {
            const int left = std::min(x, width - worst.width);
            double sum = 0.0;
            for (int j = top; j < top + worst.height; ++j)
                for (int i = left; i < left + worst.width; ++i)
                    sum += double(values[size_t(j) * size_t(width) + size_t(i)]);
            if (sum > most) {
                most = sum;
                worst.x = left;
                worst.y = top;
            }
            if (left >= width - worst.width) break;
        }
        if (top >= height - worst.height) break;
    }
    return worst;
}

// 32 pixels or more about a square.
Box box_around(const ScaleResult& scale, int width, int height) {
    const int side = std::max(32, std::min(scale.size, 64));
    Box box{0, 0, std::min(side, width), std::min(side, height)};
    box.x = std::clamp(scale.x + (scale.size - box.width) / 2, 0, width - box.width);
    box.y = std::clamp(scale.y + (scale.size - box.height) / 2, 0, height - box.height);
    return box;
}

std::string image(const Pixels& rgb, int width, int height, const std::string& what,
                  const std::string& more = "") {
    return fmt::format("<img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\"{}>",
                       data_url(png_bytes(width, height, 3, rgb.data(), 0.0)), width, height, escaped(what),
                       more);
}

// How many pixels differ by how much, the numbers on a logarithmic axis.
std::string histogram(const std::vector<float>& values, double white, const std::string& what) {
    constexpr int bars = 50, width = 600, height = 160;
    std::array<size_t, bars> counts{};
    for (const float v : values)
        ++counts[size_t(white > 0.0 ? std::clamp(double(v) / white * bars, 0.0, bars - 1.0) : 0.0)];
    const double top = std::log10(1.0 + double(*std::max_element(counts.begin(), counts.end())));
    std::string out =
        fmt::format("<svg viewBox=\"0 -6 {} {}\" class=\"histogram\" role=\"img\" aria-label=\"{}\">\n",
                    width, height + 28, escaped(what));
    for (int i = 0; i < bars; ++i) {
        const double h = top > 0.0 ? std::log10(1.0 + double(counts[size_t(i)])) / top * height : 0.0;
        out += fmt::format("<rect x=\"{}\" y=\"{:.1f}\" width=\"{}\" height=\"{:.1f}\"><title>{} pixels from "
                           "{:.3g}</title></rect>\n",
                           i * width / bars, height - h, width / bars - 1, h, counts[size_t(i)],
                           white * i / bars);
    }
    return out + fmt::format(
                     "<text x=\"0\" y=\"{0}\">0</text><text x=\"{1}\" y=\"{0}\" text-anchor=\"middle\">{2}, "
                     "pixels on a logarithmic axis</text><text x=\"{3}\" y=\"{0}\" "
                     "text-anchor=\"end\">{4:.3g}</text></svg>\n",
                     height + 16, width / 2, escaped(what), width, white);
}

std::string pair(const std::string& id, const Pixels& test, const Pixels& reference, int width, int height) {
    return fmt::format("<div class=\"pair\" id=\"{0}\" data-shows=\"slider\" "
                       "style=\"width:min(100%,{1}px);aspect-ratio:{1}/{2}\">\n"
                       "{3}\n{4}\n<span class=\"which\"></span></div>\n"
                       "<p class=\"controls\" data-for=\"{0}\"><button data-show=\"a\">A</button><button "
                       "data-show=\"b\">B</button>"
                       "<button data-show=\"swap\">swap</button><button data-show=\"slider\">slider</button>"
                       "<input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"where A ends "
                       "and B begins\"></p>\n",
                       id, std::max(width, 480), std::max(width, 480) * height / width,
                       image(reference, width, height, "B: reference", " class=\"b\""),
                       image(test, width, height, "A: judged", " class=\"a\""));
}

std::string numbers(const Comparison& c) {
    std::string out =
        "<table><tr><th>layer</th><th>RMSE</th><th>relative MSE</th><th>PSNR, dB</th><th>greatest "
        "difference</th></tr>\n";
    for (const LayerResult& layer : c.layers)
        out += fmt::format(
            "<tr{}><td>{}</td><td>{:.4g}</td><td>{:.4g}</td><td>{:.2f}</td><td>{:.4g}</td></tr>\n",
            !layer.fault.empty() ? " class=\"bad\"" : "",
            layer.name.empty() ? "picture" : escaped(layer.name), layer.rmse, layer.relative_mse, layer.psnr,
            layer.most);
    out += "</table>\n<table><tr><th>of the picture</th><th>value</th><th>limit</th></tr>\n";
    const auto row = [&](const std::string& what, double value, double limit, bool judged, bool fails) {
        out +=
            fmt::format("<tr{}><td>{}</td><td>{:.4g}</td><td>{}</td></tr>\n", fails ? " class=\"bad\"" : "",
                        what, value, judged ? fmt::format("{:.4g}", limit) : std::string("not judged"));
    };
    row(fmt::format("FLIP, mean ({})", c.flip_kind()), c.flip_mean, c.flip_mean_limit,
        std::isfinite(c.flip_mean_limit), c.flip_mean > c.flip_mean_limit);
    row("FLIP, 99th percentile", c.flip_99, c.flip_99_limit, std::isfinite(c.flip_99_limit),
        c.flip_99 > c.flip_99_limit);
    row("SSIM", c.ssim, c.ssim_limit, c.ssim_limit >= 0.0, c.ssim < c.ssim_limit);
    for (const ScaleResult& s : c.scales)
        row(s.size == 0 ? std::string("standard deviations, whole picture")
                        : fmt::format("standard deviations, worst of {0} &times; {0} pixels at ({1}, {2})",
                                      s.size, s.x, s.y),
            s.worst, s.limit, true, s.fails());
    return out + "</table>\n";
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
    std::string out =
        fmt::format("<table><tr><th></th><th>A</th><th>B</th></tr>\n<tr><td>file</td><td>{0}</td>"
                    "<td>{1}</td></tr>\n<tr><td>size</td><td>{2} &times; {3}</td>"
                    "<td>{2} &times; {3}</td></tr>\n",
                    escaped(a.path), escaped(b.path), a.picture.width, a.picture.height);
    for (const std::string& key : keys) {
        const std::string p = value(x, key), q = value(y, key);
        out += fmt::format("<tr{}><td>{}</td><td>{}</td><td>{}</td></tr>\n", p == q ? "" : " class=\"other\"",
                           escaped(key), escaped(p), escaped(q));
    }
    return out + "</table>\n";
}

constexpr const char* style = R"(<style>
body{font:15px/1.5 sans-serif;max-width:72em;margin:0 auto 3em;padding:0 1em;color:#222;background:#fff}
.verdict{padding:.6em 1em;margin:1em 0;border-left:.6em solid} .alike{background:#e8f4ea;border-color:#2e7d32}
.different{background:#fdecea;border-color:#b3261e} .verdict h1{margin:0;font-size:1.5em}
.pair{position:relative;overflow:hidden;background:#888;cursor:pointer} .pair img{position:absolute;left:0;top:0;width:100%;height:100%}
.which{position:absolute;left:.4em;bottom:.3em;background:#000a;color:#fff;padding:0 .5em;font-size:13px}
.controls button{margin-right:.4em} .controls input{width:min(24em,50%);vertical-align:middle}
figure{display:inline-block;margin:.5em 1em .5em 0;max-width:100%} figure img{max-width:100%;height:auto;display:block}
img.magnified{image-rendering:pixelated;width:256px;height:auto} figcaption{font-size:13px;color:#555}
table{border-collapse:collapse;margin:.6em 0} td,th{padding:.15em .8em;text-align:left;border-bottom:1px solid #ddd}
tr.bad td{background:#fdecea} tr.other td{background:#fff7e0}
.histogram{display:block;margin:.8em 0;max-width:40em;width:100%;fill:#5a3d8a;font-size:12px} .histogram text{fill:#444}
</style>
)";

// Swap on a click or the space bar, a slider that uncovers, and either alone.
constexpr const char* script = R"(<script>
for (const controls of document.querySelectorAll(".controls")) {
  const pair = document.getElementById(controls.dataset.for), top = pair.querySelector(".a");
  const which = pair.querySelector(".which"), range = controls.querySelector("input");
  let state = "slider", swapped = false;
  const draw = () => {
    pair.dataset.shows = state === "swap" ? (swapped ? "b" : "a") : state;
    top.style.visibility = pair.dataset.shows === "b" ? "hidden" : "visible";
    top.style.clipPath = state === "slider" ? `inset(0 ${100 - range.value}% 0 0)` : "none";
    which.textContent = {a: "A: judged", b: "B: reference", slider: "A | B"}[pair.dataset.shows];
  };
  const swap = () => { swapped = state === "swap" ? !swapped : pair.dataset.shows !== "b"; state = "swap"; draw(); };
  for (const button of controls.querySelectorAll("button"))
    button.addEventListener("click", () => {
      if (button.dataset.show === "swap") swap(); else { state = button.dataset.show; draw(); }
    });
  range.addEventListener("input", () => { state = "slider"; draw(); });
  pair.addEventListener("click", swap);
  pair.tabIndex = 0;
  pair.addEventListener("keydown", event => { if (event.key === " ") { event.preventDefault(); swap(); } });
  draw();
}
</script>
)";

std::string layer_section(const Picture::Layer& a, const Picture::Layer& b, const Comparison& c,
                          size_t number) {
    const Look look = look_of(b);
    const Pixels test = shown(a, look), reference = shown(b, look);
    const std::vector<float> apart = differences(a, b);
    const double most = double(*std::max_element(apart.begin(), apart.end()));
    const int w = c.width, h = c.height;
    std::string out = fmt::format("<h2>{}</h2>\n", b.name.empty() ? "The picture" : escaped(b.name));
    if (b.name.empty() && look.high > 1.0F)
        out += fmt::format("<p>Shown {:.1f} stops darker.</p>\n", std::log2(double(look.high)));
    out += pair(fmt::format("pair{}", number), test, reference, w, h);
    const auto figure = [&](const Pixels& rgb, const Box& box, const std::string& words, bool magnified) {
        out += fmt::format(
            "<figure>{}<figcaption>{}</figcaption></figure>\n",
            image(cut(rgb, w, box), box.width, box.height, words, magnified ? " class=\"magnified\"" : ""),
            escaped(words));
    };
    const Box whole{0, 0, w, h};
    const Pixels map = heat_map(apart, most);
    figure(map, whole, fmt::format("difference, white: {:.3g}", most), false);
    std::vector<float> judged = apart;
    if (b.name.empty()) {
        figure(heat_map(c.flip, 1.0), whole, "FLIP, white: 1", false);
        judged = c.flip;
    }
    out += histogram(apart, most, "difference");
    if (b.name.empty()) out += histogram(c.flip, 1.0, "FLIP");
    // By noise where it is known: FLIP of a noisy picture finds the noisiest place.
    const ScaleResult* scale = b.name.empty() ? c.worst_scale() : nullptr;
    const Box worst = scale && scale->size > 0 && scale->worst > 0.0 ? box_around(*scale, w, h)
                                                                     : worst_region(judged, w, h);
    out += fmt::format("<h3>Where it is worst: {} &times; {} pixels at ({}, {})</h3>\n", worst.width,
                       worst.height, worst.x, worst.y);
    figure(test, worst, "A", true);
    figure(reference, worst, "B", true);
    figure(map, worst, "difference", true);
    return out;
}

} // namespace

std::string compare_page(const ComparedFile& test, const ComparedFile& reference,
                         const Comparison& comparison) {
    const std::string verdict = comparison.alike() ? (comparison.equal ? "Equal" : "Alike") : "Different";
    std::string out = fmt::format(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}: {} and {}</title>\n"
        "<meta name=\"viewport\" content=\"width=device-width\">\n{}</head><body>\n"
        "<div class=\"verdict {}\"><h1>{}</h1>\n",
        verdict, escaped(test.path), escaped(reference.path), style,
        comparison.alike() ? "alike" : "different", verdict);
    for (const std::string& fault : comparison.faults) out += fmt::format("<p>{}</p>\n", escaped(fault));
    if (comparison.alike())
        out += comparison.equal ? "<p>Every number is the same.</p>\n"
               : comparison.knows_noise
                   ? "<p>What differs is what their noise explains, as they know it.</p>\n"
                   : "<p>They look the same. Whether noise explains what differs nobody can tell: " +
                         escaped(comparison.unknown) + ".</p>\n";
    out += fmt::format("<p>A, judged: {}<br>B, reference: {}</p></div>\n", escaped(test.path),
                       escaped(reference.path));
    size_t number = 0;
    for (const Picture::Layer& layer : reference.picture.layers) {
        const Picture::Layer* mine = test.picture.find(layer.name);
        if (layer.name == "variance" || !mine || mine->channels.size() != layer.channels.size()) continue;
        out += layer_section(*mine, layer, comparison, number++);
    }
    return out + "<h2>Numbers</h2>\n" + numbers(comparison) + "<h2>What the files say</h2>\n" +
           metadata(test, reference) + script + "</body></html>\n";
}

} // namespace marram
