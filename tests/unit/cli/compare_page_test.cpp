// SPDX-License-Identifier: Apache-2.0
// The page of `marram compare --report` in a real browser. Scripts added to copies of it check its content
// and the pixels that it shows.
#include "core/compare/page_view.h"
#include "program.h"

#include <cstdlib>

namespace marram::testing {
namespace {

bool has_browser() { return std::system("command -v chromium >/dev/null") == 0; }

#define NEEDS_BROWSER()                                                                                      \
    if (!has_browser()) GTEST_SKIP() << "there is no chromium to open the page in"

// Chromium's output for a file.
std::string opened(const Folder& folder, const std::string& file, int width, int height,
                   const std::string& options) {
    return output_of(
        fmt::format("HOME='{0}' timeout 120 chromium --headless --no-sandbox --disable-gpu "
                    "--disable-dev-shm-usage --disable-background-networking --hide-scrollbars "
                    "--user-data-dir='{0}profile' --window-size={1},{2} {3} 'file://{4}' 2>/dev/null",
                    folder / "", width, height, options, file));
}

std::string with_script(const Folder& folder, const std::string& page, const std::string& script) {
    return folder.write("driven.html",
                        page + "<script>addEventListener(\"load\", () => {" + script + "});</script>");
}

// A script's checks are check(what, passes?); the result becomes the page's title. The page is loaded in a
// frame, since windows have a minimum width.
void expect_fine(const Folder& folder, const std::string& page, const std::string& script, int width = 1280,
                 int height = 800) {
    with_script(folder, page,
                R"(const faults = []; let checks = 0;
  const check = (what, fine) => { ++checks; if (!fine) faults.push(what); };
  const all = selector => [...document.querySelectorAll(selector)];
  const box = element => element.getBoundingClientRect();
  const near = (a, b) => Math.abs(a - b) < 0.75;
)" + script + R"(
  parent.document.title = faults.length ? "FAULTS: " + faults.join("; ") : `fine: ${checks} checks`;)");
    const std::string frame = folder.write(
        "frame.html", fmt::format("<!doctype html><title>not run</title><iframe src=\"driven.html\" "
                                  "style=\"border:0;width:{}px;height:{}px\"></iframe>",
                                  width, height));
    const std::string dom = opened(folder, frame, 2600, 1200, "--allow-file-access-from-files --dump-dom");
    const size_t title = dom.find("<title>");
    ASSERT_NE(title, std::string::npos) << "the browser did not start";
    const std::string words = dom.substr(title + 7, dom.find("</title>") - title - 7);
    EXPECT_TRUE(words.starts_with("fine: ")) << words;
    std::printf("%s\n", words.c_str());
}

// The linear light that the page shows of A, or of A's crop, alone in the window's corner.
Image seen(const Folder& folder, const std::string& page, const std::string& box, double stops) {
    const std::string path = folder / "seen.png";
    const std::string script = fmt::format(R"(
  const section = document.querySelector("section"), stops = section.querySelector(".stops");
  stops.value = {};
  stops.dispatchEvent(new Event("input"));
  section.querySelector("[data-show=a]").click();
  section.querySelector("[data-frame]").click();
  const shown = section.querySelector("{}");
  section.replaceChildren(shown);
  document.body.replaceChildren(section, document.querySelector(".filters"));
  document.body.style = "margin:0;padding:0";
)",
                                           stops, box);
    opened(folder, with_script(folder, page, script), 480, 600, "--screenshot='" + path + "'");
    return read_image(path);
}

struct Pair {
    int width, height;
    std::vector<float> a, b, variance; // RGB
    Pair(int w, int h, float value)
        : width(w), height(h), a(3 * size_t(w) * size_t(h), value), b(a), variance(a.size(), 1e-4F) {}
    void set(std::vector<float>& rgb, const page::Region& at, std::array<float, 3> colour) const {
        for (int y = at.y; y < at.y + at.height; ++y)
            for (int x = at.x; x < at.x + at.width; ++x)
                std::copy_n(colour.data(), 3, rgb.data() + 3 * (size_t(y) * size_t(width) + size_t(x)));
    }
    // more: metadata of A; other: the name of a layer that holds the same numbers in their order.
    std::string page(const Folder& folder, bool noise = false, const std::vector<Metadata>& more = {},
                     const std::string& other = "") const {
        for (const auto* rgb : {&a, &b}) {
            std::vector<Layer> layers = {{"", {"R", "G", "B"}, rgb->data(), false}};
            if (noise) layers.push_back({"variance", {"R", "G", "B"}, variance.data(), false});
            if (!other.empty()) layers.push_back({other, {"Y"}, rgb->data(), false});
            std::vector<Metadata> metadata = {{"marram:samples", 1024}};
            if (rgb == &a) metadata.insert(metadata.end(), more.begin(), more.end());
            write_exr(folder / (rgb == &a ? "a.exr" : "b.exr"), width, height, layers, metadata);
        }
        const ProgramResult done =
            marram({"compare", folder / "a.exr", folder / "b.exr", "--report", folder / "report"});
        EXPECT_EQ(done.err, "");
        return read_file(folder / "report/compare.html");
    }
};

} // namespace

// A script added to a copy of the page uses its buttons, slider and pictures.
TEST(ComparePage, StandsAloneAndWorksInABrowser) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [96, 64]\nsamples = 2\nmax_depth = 3\n",
                            .groom = "count = 4000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    const auto rendered = [&](const std::string& name, const std::string& wind) {
        EXPECT_DONE(marram({"render", scene, "-o", folder / name, "--quiet", "--spp", "16", "--aov",
                            "variance,depth", "--set", "wind.speed=" + wind}));
    };
    rendered("a & b.exr", "6");
    rendered("wind.exr", "0");
    const ProgramResult done =
        marram({"compare", folder / "wind.exr", folder / "a & b.exr", "--report", folder / "report"});
    EXPECT_EQ(done.code, 1);
    const std::string path = folder / "report/compare.html";
    EXPECT_CONTAINS(done.out, path);
    const std::string page = read_file(path);
    EXPECT_TRUE(page.find("<h1>Different</h1>") != std::string::npos);
    EXPECT_LT(page.find("<h1>"), page.find("<img")) << "the verdict comes first";
    EXPECT_TRUE(page.find("a &amp; b.exr") != std::string::npos);
    for (const char* part : {"<h2>The picture</h2>", "<h2>alpha</h2>", "<h2>depth</h2>", "FLIP",
                             "Where it is worst", "marram:samples", "Base exposure: ", "<dt>PSNR",
                             "<dt>relative MSE", "the values of A and B differ"})
        EXPECT_TRUE(page.find(part) != std::string::npos) << part;
    EXPECT_EQ(page.find("http"), std::string::npos) << "nothing is fetched";
    NEEDS_BROWSER();
    expect_fine(folder, page, R"(
  check("pictures", document.images.length >= 8);
  for (const image of document.images) check(image.alt, image.complete && image.naturalWidth > 0);
  const fetched = performance.getEntriesByType("resource").filter(entry => !entry.name.startsWith("data:"));
  check("fetched " + fetched.map(entry => entry.name), fetched.length === 0);
  const controls = [...document.querySelectorAll(".controls")];
  check("pairs", controls.length === 3);
  for (const control of controls) {
    const pair = document.getElementById(control.dataset.for), style = getComputedStyle(pair.querySelector(".a"));
    const button = name => control.querySelector(`[data-show=${name}]`), range = control.querySelector("input");
    const words = () => [...pair.querySelectorAll(".which")].map(word => word.textContent).join("");
    const divider = pair.querySelector(".divider"), shown = box(pair);
    const middle = element => box(element).left + box(element).width / 2;
    check("line", near(middle(divider), shown.left + shown.width / 2));
    check("slider at first", style.clipPath.includes("50%") && words() === "AB");
    button("a").click();
    check("a", style.visibility === "visible" && style.clipPath === "none" && words().startsWith("A"));
    button("b").click();
    check("b", style.visibility === "hidden" && words().startsWith("B"));
    button("swap").click();
    check("swapped to a", style.visibility === "visible" && words().startsWith("A"));
    pair.click();
    check("swapped to b", style.visibility === "hidden");
    pair.dispatchEvent(new KeyboardEvent("keydown", {key: " "}));
    check("swapped by the space bar", style.visibility === "visible");
    range.value = 25;
    range.dispatchEvent(new Event("input"));
    check("slider", style.clipPath.includes("75%") && style.visibility === "visible");
    check("line at the slider", near(middle(divider), shown.left + shown.width / 4));
    const point = (target, type, share) => target.dispatchEvent(new PointerEvent(type,
      {bubbles: true, clientX: shown.left + share * shown.width, clientY: shown.top + 9}));
    point(pair, "pointerdown", 0.25);
    point(window, "pointermove", 0.7);
    check("dragged", style.clipPath.includes("30%") && near(middle(divider), shown.left + 0.7 * shown.width));
    point(window, "pointerup", 0.7);
    pair.click();
    check("a drag is no click", words() === "AB");
    point(window, "pointermove", 0.1);
    check("let go", style.clipPath.includes("30%"));
    check("shape", Math.abs(shown.width / shown.height - 1.5) < 0.02 && shown.width === 480);
    const maps = control.closest("section").querySelectorAll(".map");
    check("maps", maps.length > 0);
    for (const map of maps) {
      check("as large as the pair", box(map).width === shown.width && box(map).height === shown.height);
      check("pixels", getComputedStyle(map.querySelector("img")).imageRendering === "pixelated");
      check("legend", map.parentNode.querySelector(".scale") && map.parentNode.querySelectorAll(".ticks span").length === 5);
    }
  }
)");
}

TEST(ComparePage, ShowsDimPicturesAtAnyExposure) {
    NEEDS_BROWSER();
    const Folder folder;
    Pair pictures(60, 40, 1e-3F);
    for (auto* rgb : {&pictures.a, &pictures.b}) {
        pictures.set(*rgb, {8, 8, 4, 4}, {16e-3F, 16e-3F, 16e-3F});
        pictures.set(*rgb, {40, 8, 4, 4}, {2e-6F, 2e-6F, 2e-6F});
    }
    pictures.set(pictures.b, {28, 20, 8, 8}, {0.5e-3F, 0.5e-3F, 0.5e-3F});
    const std::string page = pictures.page(folder);
    EXPECT_CONTAINS(page, "Base exposure: 9 stops brighter");
    for (const double stops : {0.0, 1.0, -4.0, 6.0}) {
        const Image image = seen(folder, page, ".pair", stops); // enlarged 8 times
        ASSERT_EQ(image.width, 480);
        const auto expect = [&](int x, int y, double value) {
            const double light = std::min(value * std::exp2(9.0 + stops), 1.0);
            EXPECT_NEAR(image.pixels[size_t(image.channels) * size_t(8 * y * 480 + 8 * x)], light,
                        0.03 * light + 4e-4)
                << stops << ": " << x << ", " << y;
        };
        expect(20, 20, 1e-3);
        expect(10, 10, 16e-3);
        expect(42, 10, 2e-6);
    }
    for (const double stops : {0.0, -2.0}) {
        const Image image = seen(folder, page, ".crop", stops);
        const double light = 1e-3 * std::exp2(9.0 + stops);
        EXPECT_NEAR(image.pixels[size_t(image.channels) * (200 * 480 + 200)], light, 0.03 * light) << stops;
    }
}

// FLIP is greatest at (48, 4), where noise explains the difference.
TEST(ComparePage, FramesWhatNoiseCannotExplain) {
    NEEDS_BROWSER();
    const Folder folder;
    Pair pictures(64, 40, 0.5F);
    pictures.set(pictures.a, {48, 4, 8, 8}, {0.9F, 0.1F, 0.5F});
    pictures.set(pictures.variance, {48, 4, 8, 8}, {9.0F, 9.0F, 9.0F});
    pictures.set(pictures.a, {24, 16, 4, 4}, {0.55F, 0.5F, 0.5F});
    const std::string page = pictures.page(folder, true);
    EXPECT_CONTAINS(page, "Framed: 2 &times; 2 pixels at (24, 16), off by ");
    EXPECT_CONTAINS(page, " standard deviations in red, ");
    EXPECT_CONTAINS(page, "<td class=\"number\">red</td>");
    expect_fine(folder, page, R"(
  check("frames", all(".frame").length === 7);
  for (const whole of all(".pair, .map")) {
    const frame = box(whole.querySelector(".frame")), shown = box(whole), scale = shown.width / 64;
    check("place", near(frame.left - shown.left, 24 * scale) && near(frame.top - shown.top, 16 * scale));
    check("size", near(frame.width, 2 * scale) && near(frame.height, 2 * scale));
  }
  const crop = document.querySelector(".crop"), frame = box(crop.querySelector(".frame"));
  check("crop", near(frame.width, box(crop).width / 16) && near(frame.left - box(crop).left, box(crop).width * 15 / 32));
  check("line of the frame", getComputedStyle(document.querySelector(".frame")).outlineStyle === "solid");
  document.querySelector("[data-frame]").click();
  check("hidden", all(".frame").every(frame => box(frame).width === 0));
)");
}

TEST(ComparePage, ShowsTheSmallestSquareThatFails) {
    const auto scale = [](int size, double worst) { return ScaleResult{size, worst, 5.0, size, 0, 1}; };
    const auto shown = [](const std::vector<ScaleResult>& scales) {
        const ScaleResult* square = page::failing_square(scales);
        return square ? square->size : -1;
    };
    EXPECT_EQ(shown({scale(1, 4.0), scale(2, 6.0), scale(4, 90.0), scale(0, 100.0)}), 2);
    EXPECT_EQ(shown({scale(1, 4.0), scale(2, 4.5), scale(4, 2.0), scale(0, 100.0)}), 2) << "the nearest";
    EXPECT_EQ(shown({scale(1, 4.0), scale(2, 4.5), scale(0, 1.0)}), -1);
    EXPECT_EQ(shown({}), -1);
    const page::Region at = page::region_of(ScaleResult{64, 9.0, 5.0, 64, 0, 0}, 100, 50);
    EXPECT_EQ(at.width, 36) << "ends with the picture";
    EXPECT_EQ(at.height, 50);
    const page::Region around = page::context_of({1900, 1070, 4, 4}, 1920, 1080);
    EXPECT_EQ(around.width, 240);
    EXPECT_EQ(around.x, 1680);
    EXPECT_EQ(around.y, 840);
}

TEST(ComparePage, FitsTheWindow) {
    NEEDS_BROWSER();
    const Folder folder;
    Pair tall(1, 3000, 0.2F);
    tall.set(tall.a, {0, 2000, 1, 5}, {1.0F, 0.0F, 0.0F});
    expect_fine(folder, tall.page(folder), R"(
  for (const shown of all(".box")) {
    check("not higher", box(shown).height <= innerHeight);
    check("not wider", box(shown).width <= innerWidth);
    check("to be seen", box(shown).width >= 24 && box(shown).height >= 24);
  }
  const frame = box(document.querySelector(".pair .frame")), shown = box(document.querySelector(".pair"));
  check("frame", frame.top <= shown.top + shown.height * 2000 / 3000 && frame.bottom >= shown.top + shown.height * 2004 / 3000);
)");
    Pair wide(640, 360, 0.2F);
    wide.set(wide.a, {600, 300, 9, 9}, {1.0F, 0.0F, 0.0F});
    const std::string hostile =
        "</td><script>window.broken = 1</script>\"'\n\xff\xfe&amp;" + std::string(5000, 'x');
    const std::string layer = "<script>window.broken = 2</script>\"'&" + std::string(120, 'l');
    const std::string page = wide.page(folder, true, {{"</div><b>&\"'", hostile}}, layer);
    for (const int width : {360, 400, 1280, 2560})
        expect_fine(folder, page,
                    R"(
  check(`window of ${innerWidth}`, innerWidth === )" +
                        std::to_string(width) +
                        R"();
  check(`${document.documentElement.scrollWidth} wide`, document.documentElement.scrollWidth <= innerWidth);
  for (const element of all("h1, h2, p, .box, figcaption, .says td, dd, button, input"))
    check("beyond the edge: " + element.outerHTML.slice(0, 60), box(element).right <= innerWidth + 0.5 && box(element).left >= 0);
  for (const table of all(".wide")) check("scrolls", getComputedStyle(table).overflowX === "auto");
  check("metadata is text", window.broken === undefined && document.body.textContent.includes("window.broken = 1"));
  check("a layer's name is text", all("h2").some(head => head.textContent.includes("<script>window.broken = 2")));
  check("its length", all(".says td").every(cell => box(cell).height < 250));
)",
                    width);
}

} // namespace marram::testing
