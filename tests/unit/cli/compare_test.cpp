// SPDX-License-Identifier: Apache-2.0
// `marram compare` as users run it, and its page in a real browser.
#include "program.h"

#include <cstdlib>

namespace marram::testing {
namespace {

Outcome rendered(const Folder& folder, const std::string& scene, const std::string& name,
                 const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"render", scene, "-o",    folder / name,   "--quiet",
                                          "--spp",  "16",  "--aov", "variance,depth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return marram(arguments);
}

} // namespace

TEST(Compare, tells_noise_from_change) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [96, 64]\nsamples = 2\nmax_depth = 3\n",
                            .groom = "count = 4000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    EXPECT_EQ(rendered(folder, scene, "seed.exr", {"--set", "film.seed=5"}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "wind.exr", {"--set", "wind.speed=0"}).code, 0);
    const Outcome same = marram({"compare", folder / "a.exr", folder / "a.exr"});
    EXPECT_EQ(same.code, 0);
    EXPECT_CONTAINS(same.out, "alike: every number is the same");
    const Outcome seed = marram({"compare", folder / "seed.exr", folder / "a.exr"});
    EXPECT_EQ(seed.code, 0) << seed.out;
    EXPECT_CONTAINS(seed.out, "\nalike\n");
    const Outcome wind = marram({"compare", folder / "wind.exr", folder / "a.exr"});
    EXPECT_EQ(wind.code, 1) << wind.out;
    EXPECT_CONTAINS(wind.out, "noise cannot explain it: ");
    EXPECT_CONTAINS(wind.out, "\ndifferent\n");
    EXPECT_EQ(wind.err, "");
}

TEST(Compare, refuses_what_it_cannot_compare) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const auto& [name, size] : {std::pair("a.png", "24x16"), {"b.png", "16x24"}})
        EXPECT_EQ(marram({"render", scene, "-o", folder / name, "--quiet", "--size", size}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    folder.write("text.png", "no picture");
    const auto refused = [&](const std::vector<std::string>& arguments, const std::string& words) {
        const Outcome done = marram(arguments);
        EXPECT_EQ(done.code, 2) << words;
        EXPECT_EQ(done.out, "");
        EXPECT_CONTAINS(done.err, words);
        EXPECT_EQ(lines(done.err).size(), 1U);
    };
    refused({"compare", folder / "a.png", folder / "b.png"}, "a.png: is 24 x 16 pixels, ");
    refused({"compare", folder / "a.png", folder / "a.exr"}, "a.png: has channels R, G, B; ");
    refused({"compare", folder / "a.png", folder / "none.png"}, "none.png: there is no such file");
    refused({"compare", folder / "text.png", folder / "a.png"}, "text.png: is not an image that can be read");
    refused({"compare", folder / "a.png", folder / "a.png", "--report", folder / "a.exr"},
            "a.exr: the folder for the report cannot be made");
    refused({"compare", folder / "a.png"}, "reference is required");
    refused({"compare", folder / "a.png", folder / "b.png", "--report", folder / "page"},
            "a.png: is 24 x 16");
    EXPECT_FALSE(fs::exists(folder / "page")) << "nothing was compared, nothing is there to be read";
    const std::vector<float> grey(24 * 16, 0.5F);
    const Layer layer{"", {"Y"}, grey.data(), true};
    write_exr(folder / "grey.exr", 24, 16, std::span(&layer, 1), {});
    refused({"compare", folder / "grey.exr", folder / "a.png"}, "grey.exr: has channels Y (grey); ");
}

// The page's own buttons, slider and pictures, used by a script that is added to a copy of it.
TEST(Compare, page_stands_alone_and_works_in_a_browser) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [96, 64]\nsamples = 2\nmax_depth = 3\n",
                            .groom = "count = 4000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    EXPECT_EQ(rendered(folder, scene, "a & b.exr").code, 0);
    EXPECT_EQ(rendered(folder, scene, "wind.exr", {"--set", "wind.speed=0"}).code, 0);
    const Outcome done =
        marram({"compare", folder / "wind.exr", folder / "a & b.exr", "--report", folder / "report"});
    EXPECT_EQ(done.code, 1);
    const std::string path = folder / "report/compare.html";
    EXPECT_CONTAINS(done.out, path);
    std::string page = read_file(path);
    EXPECT_TRUE(page.find("<h1>Different</h1>") != std::string::npos);
    EXPECT_LT(page.find("<h1>"), page.find("<img")) << "the verdict comes first";
    EXPECT_TRUE(page.find("a &amp; b.exr") != std::string::npos);
    for (const char* part : {"<h2>The picture</h2>", "<h2>alpha</h2>", "<h2>depth</h2>", "FLIP",
                             "Where it is worst", "marram:samples"})
        EXPECT_TRUE(page.find(part) != std::string::npos) << part;
    EXPECT_EQ(page.find("http"), std::string::npos) << "nothing is fetched";
    if (std::system("command -v chromium >/dev/null") != 0)
        GTEST_SKIP() << "there is no chromium to open the page in";
    page += R"(<script>addEventListener("load", () => {
  const faults = [];
  let checks = 0;
  const check = (what, fine) => { ++checks; if (!fine) faults.push(what); };
  check("pictures", document.images.length >= 8);
  for (const image of document.images) check(image.alt, image.complete && image.naturalWidth > 0);
  const fetched = performance.getEntriesByType("resource").filter(entry => !entry.name.startsWith("data:"));
  check("fetched " + fetched.map(entry => entry.name), fetched.length === 0);
  const controls = [...document.querySelectorAll(".controls")];
  check("pairs", controls.length === 3);
  for (const control of controls) {
    const pair = document.getElementById(control.dataset.for), style = getComputedStyle(pair.querySelector(".a"));
    const button = name => control.querySelector(`[data-show=${name}]`), range = control.querySelector("input");
    const words = () => pair.querySelector(".which").textContent;
    check("slider at first", style.clipPath.includes("50%") && words() === "A | B");
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
    const box = pair.getBoundingClientRect();
    check("shape", Math.abs(box.width / box.height - 1.5) < 0.02);
  }
  document.title = faults.length ? "FAULTS: " + faults.join("; ") : `fine: ${checks} checks`;
});</script>)";
    const std::string driven = folder.write("driven.html", page);
    const std::string dom =
        output_of("HOME='" + (folder / "") +
                  "' timeout 120 chromium --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
                  "--user-data-dir='" +
                  (folder / "profile") + "' --dump-dom 'file://" + driven + "' 2>/dev/null");
    const size_t title = dom.find("<title>");
    ASSERT_NE(title, std::string::npos) << "the browser did not start";
    const std::string words = dom.substr(title + 7, dom.find("</title>") - title - 7);
    EXPECT_TRUE(words.starts_with("fine: ")) << words;
    std::printf("%s\n", words.c_str());
}

} // namespace marram::testing
