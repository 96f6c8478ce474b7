// SPDX-License-Identifier: Apache-2.0
// Values are written into the text of a scene, and nothing else changes.
#include "core/scene/edit.h"
#include "core/scene/parse.h"
#include "scene_test.h"
#include "tests/unit/files.h"

#include <algorithm>
#include <bit>
#include <gtest/gtest.h>
#include <random>

namespace marram {
namespace {

using Changes = std::vector<std::string>;

std::string edit(const std::string& text, const Changes& settings) {
    return edited_scene(text, "a.toml", settings);
}

// The mistakes of an edit, one per line; empty if there is none.
std::string edit_mistakes(const std::string& text, const Changes& settings) {
    std::string lines;
    try {
        edit(text, settings);
    } catch (const InputError& error) {
        for (const Problem& problem : error.problems) lines += to_string(problem) + "\n";
    }
    return lines;
}

// The tree that load_scene reads with these settings.
toml::table tree_of(const std::string& text, const Changes& settings = {}) {
    Reading reading;
    reading.file = "a.toml";
    toml::table root = toml::parse(text, std::string_view(reading.file));
    apply_settings(root, settings, reading);
    for (const Problem& problem : reading.problems) ADD_FAILURE() << to_string(problem);
    return root;
}

std::vector<std::filesystem::path> scene_files() {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(MARRAM_SOURCE_DIR "/scenes"))
        if (entry.path().extension() == ".toml") files.push_back(entry.path());
    std::ranges::sort(files);
    return files;
}

// A value that has a text of its own: its address as of --set, where it is, and its node.
struct Value {
    std::string address;
    size_t begin = 0, end = 0;
    const toml::node* node = nullptr;
};

// Offsets of the places of toml++, whose columns are code points.
class Places {
  public:
    explicit Places(const std::string& text) : text_(text) {
        for (size_t at = 0; at < text.size(); ++at)
            if (text[at] == '\n') lines_.push_back(at + 1);
    }
    size_t offset(const toml::source_position& place) const {
        size_t at = lines_[place.line - 1];
        for (size_t column = 1; column < place.column && at < text_.size(); ++column)
            at += std::max(1, std::countl_one(static_cast<unsigned char>(text_[at])));
        return at;
    }

  private:
    const std::string& text_;
    std::vector<size_t> lines_{0};
};

// All values in a tree, lists and inline tables as well as what is in them. Those of an item without a name are left
// out: --set cannot reach them.
void find_values(const toml::node& node, const std::string& address, const Places& places,
                 std::vector<Value>& values) {
    const toml::table* table = node.as_table();
    const toml::array* list = node.as_array();
    const bool has_headers = list && list->is_array_of_tables() && !list->get(0)->as_table()->is_inline();
    if (!has_headers && (!table || table->is_inline()))
        values.push_back(
            {address, places.offset(node.source().begin), places.offset(node.source().end), &node});
    for (size_t i = 0; list && i < list->size(); ++i) {
        const toml::node& element = *list->get(i);
        if (!has_headers || address.find('.') != std::string::npos)
            find_values(element, address + "[" + std::to_string(i) + "]", places, values);
        else if (const auto name = (*element.as_table())["name"].value<std::string>())
            find_values(element, address + "." + *name, places, values);
    }
    if (!table) return;
    for (const auto& [key, inner] : *table)
        if (key.str() != "name" && key.str() != "type") // later settings find items by them
            find_values(inner, address + (address.empty() ? "" : ".") + std::string(key.str()), places,
                        values);
}

std::vector<Value> values_of(const toml::table& tree, const std::string& text) {
    std::vector<Value> values;
    find_values(tree, "", Places(text), values);
    return values;
}

// Another value of the same kind.
std::string other_value(const toml::node& node) {
    if (node.is_boolean()) return node.as_boolean()->get() ? "false" : "true";
    if (node.is_string()) return "\"another, # = \\\" text\"";
    if (const toml::array* list = node.as_array()) { // two elements more
        std::string text = "[7, # one\n [8, 9],";
        for (size_t i = 0; i < list->size(); ++i) text += " 'é'" + std::string(",");
        return text + "\n]";
    }
    if (node.is_table()) return "{ other = [1, 2] }";
    return node.is_integer() ? "-123456789" : "1.25e-3";
}

TEST(EditScene, KeepsEveryByteOfScenesWithoutAChange) {
    ASSERT_GT(scene_files().size(), 30u);
    for (const auto& file : scene_files()) {
        const std::string text = read_file(file);
        EXPECT_EQ(edit(text, {}), text) << file;
        const toml::table tree = tree_of(text);
        Changes settings;
        for (const Value& value : values_of(tree, text))
            settings.push_back(value.address + "=" + text.substr(value.begin, value.end - value.begin));
        EXPECT_GT(settings.size(), 20u) << file;
        EXPECT_EQ(edit(text, settings), text) << file;
    }
}

TEST(EditScene, ReplacesAValueOfAnySceneAndNothingElse) {
    size_t count = 0;
    for (const auto& file : scene_files()) {
        const std::string text = read_file(file);
        const toml::table tree = tree_of(text);
        for (const Value& value : values_of(tree, text)) {
            if (value.address.find('[') != std::string::npos && count++ % 8 != 0) continue; // thousands
            const std::string other = other_value(*value.node), setting = value.address + "=" + other;
            const std::string result = edit(text, {setting});
            EXPECT_EQ(result, text.substr(0, value.begin) + other + text.substr(value.end))
                << file << " " << setting;
            EXPECT_EQ(tree_of(result), tree_of(text, {setting})) << file << " " << setting;
        }
    }
}

// Every line of `text` in order is a line of `longer`, which may have more.
bool has_lines_of(const std::string& longer, const std::string& text) {
    std::istringstream all(longer), some(text);
    for (std::string wanted, line; std::getline(some, wanted);) {
        do
            if (!std::getline(all, line)) return false;
        while (line != wanted);
    }
    return true;
}

TEST(EditScene, AddsKeysToEveryTableOfScenes) {
    for (const auto& file : scene_files()) {
        const std::string text = read_file(file);
        const toml::table tree = tree_of(text);
        std::vector<std::string> tables = {"",    "camera.", "film.", "wind.", "wind.gusts.", "wind.noise.",
                                           "air."};
        for (const char* kind : {"light", "material", "mesh", "curves", "procedural"})
            if (const toml::array* items = tree[kind].as_array())
                for (const toml::node& item : *items)
                    if (const auto name = (*item.as_table())["name"].value<std::string>()) {
                        tables.push_back(std::string(kind) + "." + *name + ".");
                        tables.push_back(tables.back() + "transform.");
                        tables.push_back(tables[tables.size() - 2] + "clump.");
                    }
        Changes settings;
        for (const std::string& table : tables) settings.push_back(table + "new_key=[1, 'é']");
        for (const std::string& setting : settings)
            EXPECT_EQ(tree_of(edit(text, {setting})), tree_of(text, {setting})) << file << " " << setting;
        const std::string result = edit(text, settings);
        EXPECT_EQ(tree_of(result), tree_of(text, settings)) << file;
        std::string inline_tables_left_out; // their lines change
        std::istringstream lines(text);
        for (std::string line; std::getline(lines, line);)
            if (line.find('{') == std::string::npos) inline_tables_left_out += line + "\n";
        EXPECT_TRUE(has_lines_of(result, inline_tables_left_out)) << file << "\n" << result;
    }
}

TEST(EditScene, RandomEditsOfScenesGiveTheTreesOfSettings) {
    std::mt19937 random(7);
    auto below = [&](size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(random); };
    const std::vector<std::string> news = {"1",
                                           "-2.5e3",
                                           "bare text",
                                           "'it''s'",
                                           "[1, # one\n  2]",
                                           "{ a = 1, b.c = [2, { d = 3 }] }",
                                           "\"\"\"two\nlines # \"\" \"\"\"",
                                           "1979-05-27 07:32:00",
                                           "[[1, 2], [3, 4], [5, 6]]",
                                           "[{ a = 1 }, { b = 2 }]",
                                           "true"};
    const auto files = scene_files();
    for (int sequence = 0; sequence < 120; ++sequence) {
        const auto& file = files[size_t(sequence) % files.size()];
        const std::string original = read_file(file);
        std::string text = original;
        Changes settings;
        for (int step = 0; step < 6; ++step) {
            const toml::table tree = tree_of(text);
            const std::vector<Value> values = values_of(tree, text);
            std::string address = values[below(values.size())].address;
            if (below(3) == 0 && !address.ends_with("]"))
                address = address.substr(0, address.rfind('.') + 1) +
                          std::vector{"new", "new.key", "\"new\""}[below(3)];
            settings.push_back(address + "=" + news[below(news.size())]);
            Reading reading;
            toml::table expected = toml::parse(text);
            apply_settings(expected, {settings.back()}, reading);
            if (!reading.problems.empty()) { // a key below a number
                EXPECT_NE(edit_mistakes(text, {settings.back()}), "");
                settings.pop_back();
                continue;
            }
            text = edit(text, {settings.back()});
            ASSERT_EQ(tree_of(text), expected) << file << " " << settings.back() << "\n" << text;
        }
        EXPECT_EQ(edit(original, settings), text) << file;
        EXPECT_EQ(tree_of(text), tree_of(original, settings)) << file;
    }
}

// The hard formats at once.
const std::string hard_text =
    "# é\n'a b' = \"x # \\\" = ]\" # c\na.b.c=1\na.b.d = { e = [1, {f=2}, [3, 4]], g.h = 'é' } # ü\n"
    "l = [ # ]\n 1, # one\n \"\"\"two\n\\\"\"\" # \"\"\"\"\", # two\n '''x''''',\n]\n"
    "\t[ wind . 'noise' ] # x\n\tt = 07:32:00\n\td = 1979-05-27 07:32:00Z # y\n\n# z\n"
    "[[wind.gusts.control]]\ns = 1\n[wind.gusts.control.in]\nx = 0x1F\n[[wind.gusts.control]]\n"
    "s = -inf\n\n[[mesh]]\nname = \"m.n\"\nsize = [\n  1_0, 2e3,\n]\nnone = {}\n";

TEST(EditScene, EditsOfMutatedTextsGiveTheTreesOfSettings) {
    std::mt19937 random(3);
    auto below = [&](size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(random); };
    const std::string pieces = "[]{}=.,\"'#\n\r\t ax1\\";
    const std::vector<std::string> news = {
        "1", "{}", "[]", "{ x = 1, e.f = [2] }", "a b", "[{ s = 1 }, { t = 2 }]"};
    const std::vector<std::string> keys = {"a b",
                                           "a.b.c",
                                           "a.b.new",
                                           "a.b",
                                           "a",
                                           "a.b.d",
                                           "a.b.d.e",
                                           "a.b.d.e[1].f",
                                           "a.b.d.e[1].new",
                                           "a.b.d.g",
                                           "a.b.d.g.h",
                                           "a.b.d.g.new",
                                           "l",
                                           "l[1]",
                                           "new",
                                           "wind",
                                           "wind.new",
                                           "wind.noise",
                                           "wind.noise.d",
                                           "wind.gusts",
                                           "wind.gusts.new.key",
                                           "wind.gusts.control",
                                           "wind.gusts.control[0]",
                                           "wind.gusts.control[1].s",
                                           "wind.gusts.control[0].in.new",
                                           "wind.gusts.control[1].in.new",
                                           "film.new",
                                           "mesh.m.n.size",
                                           "mesh.m.n.size[1]",
                                           "mesh.m.n.none.new",
                                           "mesh.m.n.new"};
    size_t edits = 0;
    for (int i = 0; i < 600; ++i) {
        std::string text = hard_text;
        for (size_t count = below(4); count > 0; --count) {
            const size_t at = below(text.size()), kind = below(3);
            if (kind == 0) text.erase(at, 1 + below(4));
            if (kind == 1) text.insert(at, 1, pieces[below(pieces.size())]);
            if (kind == 2) text[at] = pieces[below(pieces.size())];
        }
        const Changes settings = {keys[below(keys.size())] + "=" + news[below(news.size())]};
        Reading reading;
        toml::table expected;
        try {
            expected = toml::parse(text);
        } catch (const toml::parse_error&) {
            EXPECT_THROW(edit(text, settings), InputError);
            continue;
        }
        apply_settings(expected, settings, reading);
        const std::string lines = edit_mistakes(text, settings);
        EXPECT_TRUE(reading.problems.empty() || !lines.empty()) << text;
        if (!reading.problems.empty()) continue;
        ++edits;
        if (lines.empty() && !settings[0].ends_with("={}")) {
            EXPECT_EQ(toml::parse(edit(text, settings)), expected) << settings[0] << "\n" << text;
        }
        // Only an element that is made by headers cannot become another value than a table.
        EXPECT_TRUE(lines.empty() || settings[0].starts_with("wind.gusts.control[0]=")) << lines << text;
    }
    EXPECT_GT(edits, 150u);
}

struct Case {
    std::string text;
    Changes settings;
    std::string result;
};

void check(const std::vector<Case>& cases) {
    for (const Case& one : cases) {
        std::string shown;
        for (const std::string& setting : one.settings) shown += setting + "; ";
        try {
            EXPECT_EQ(edit(one.text, one.settings), one.result) << shown;
        } catch (const InputError& error) {
            ADD_FAILURE() << shown << error.what();
        }
    }
}

TEST(EditScene, ReplacesValuesOfAllFormats) {
    check({
        {"[wind]\nspeed = 4 # m/s\n", {"wind.speed=5.5"}, "[wind]\nspeed = 5.5 # m/s\n"},
        {"[wind]\r\nspeed =\t4\t# m/s\r\nx = 1",
         {"wind.speed=[1,\n 2]"},
         "[wind]\r\nspeed =\t[1,\r\n 2]\t# m/s\r\nx = 1"},
        {"a = 1", {"a=2"}, "a = 2"},
        {"a = 1\r\nb = 2\r\n", {"a='''x\ny'''", "b={ c = 1 }"}, "a = '''x\r\ny'''\r\nb = { c = 1 }\r\n"},
        {"\xef\xbb\xbf# é\na = 'é' # ü\n", {"a=ö"}, "\xef\xbb\xbf# é\na = \"ö\" # ü\n"},
        {"t = { s = 'é, ü', a = 1, b = 2 } # é\n",
         {"t.b=3", "t.a=4"},
         "t = { s = 'é, ü', a = 4, b = 3 } # é\n"},
        {"a = \"x \\\" # y\" # z\n", {"a=1"}, "a = 1 # z\n"},
        {"a = 'x # \\' # z\n", {"a=1"}, "a = 1 # z\n"},
        {"a = '' # z\n", {"a=1"}, "a = 1 # z\n"},
        {"a = \"\"\"x\n\\\"\"\" # \"\"y\"\"\"\"\" # z\nb = 1\n", {"a=1"}, "a = 1 # z\nb = 1\n"},
        {"a = '''x\n\\' # ''y''''' # z\nb = 1\n", {"a=1"}, "a = 1 # z\nb = 1\n"},
        {"a = 1979-05-27 07:32:00 # z\nb = 07:32:00\nc = 1979-05-27\n",
         {"a=1979-05-28", "b=08:00:00", "c=1"},
         "a = 1979-05-28 # z\nb = 08:00:00\nc = 1\n"},
        {"a = 0x10\nb = 4e2\nc = -inf\nd = 1_000\n",
         {"a=16", "b=nan", "c=inf", "d=1001"},
         "a = 0x10\nb = nan\nc = inf\nd = 1001\n"},
        {"a = 0.50\nb = 4.0\n", {"a=0.5", "b=4"}, "a = 0.50\nb = 4\n"},
        {"a = [ # first ]\n  1, # one\n  [2, 'x]'], # two\n]\n",
         {"a=[3, [2, 'y']]"},
         "a = [ # first ]\n  3, # one\n  [2, 'y'], # two\n]\n"},
        {"a = [ # first ]\n  1, # one\n  2, # two\n] # end\nb = 1\n", {"a=[3]"}, "a = [3] # end\nb = 1\n"},
        {"a = [1, 2]\n", {"a[1]=7", "a[0]=[6]"}, "a = [[6], 7]\n"},
        {"noise.octaves = 3\n\"noise\".'x y' = 4\n",
         {"noise.octaves=5", "noise.x y=6"},
         "noise.octaves = 5\n\"noise\".'x y' = 6\n"},
        {"[wind]\nnoise.octaves=3\n", {"wind.noise.octaves=5"}, "[wind]\nnoise.octaves=5\n"},
        {"[wind.noise]\noctaves = 3\n", {"wind.noise.octaves=5"}, "[wind.noise]\noctaves = 5\n"},
        {"[ wind . \"noise\" ] # x\noctaves = 3\n",
         {"wind.noise.octaves=5"},
         "[ wind . \"noise\" ] # x\noctaves = 5\n"},
        {"wind = { noise = { octaves = 3 } }\n",
         {"wind.noise.octaves=5"},
         "wind = { noise = { octaves = 5 } }\n"},
        {"wind = { noise.octaves = 3, x = 1 }\n",
         {"wind.noise={ octaves = 5, calm = 1 }"},
         "wind = { noise.octaves = 5, x = 1, noise.calm = 1 }\n"},
        {"wind = { noise.octaves = 3, x = 1 }\n", {"wind.noise=5"}, "wind = { x = 1, noise = 5 }\n"},
        {"[[mesh]]\nname = 'a'\nsize = 1\n\n[[mesh]]\nname = \"b.c\"\nsize = 2\n",
         {"mesh.b.c.size=3"},
         "[[mesh]]\nname = 'a'\nsize = 1\n\n[[mesh]]\nname = \"b.c\"\nsize = 3\n"},
        {"[[procedural]]\nname = 'x'\n[[procedural.layer]]\ntype = 'noise'\na = "
         "1\n[[procedural.layer]]\ntype = 'dune'\na = 1\n"
         "[[procedural]]\nname = 'y'\n[[procedural.layer]]\ntype = 'dune'\na = 1\n",
         {"procedural.x.layer.dune.a=2", "procedural.y.layer[0].a=3"},
         "[[procedural]]\nname = 'x'\n[[procedural.layer]]\ntype = 'noise'\na = "
         "1\n[[procedural.layer]]\ntype = 'dune'\na = 2\n"
         "[[procedural]]\nname = 'y'\n[[procedural.layer]]\ntype = 'dune'\na = 3\n"},
        {"[[procedural]]\nname = 'fur'\non = ['a', 'b']\nlength = 1\n",
         {"procedural.fur.length=2"},
         "[[procedural]]\nname = 'fur'\non = ['a', 'b']\nlength = 2\n"},
    });
}

TEST(EditScene, AddsValuesInTheStyleOfTheFile) {
    check({
        {"", {"a=1"}, "a = 1\n"},
        {"# x\n", {"a=1"}, "# x\na = 1\n"},
        {"# x", {"a=1"}, "# x\na = 1"},
        {"# x\n\n[wind]\n", {"a=1"}, "# x\na = 1\n\n[wind]\n"},
        {"[wind]\nspeed=1\n", {"a=1"}, "a=1\n\n[wind]\nspeed=1\n"},
        {"a = 1\n\n# of wind\n[wind]\n", {"b=x"}, "a = 1\nb = \"x\"\n\n# of wind\n[wind]\n"},
        {"[wind]\n", {"wind.speed=1"}, "[wind]\nspeed = 1\n"},
        {"[wind]", {"wind.speed=1"}, "[wind]\nspeed = 1"},
        {"[wind] # x\n\tspeed=1 # y\n\n# z\n[film]\n",
         {"wind.calm=2", "film.samples=4"},
         "[wind] # x\n\tspeed=1 # y\n\tcalm=2\n\n# z\n[film]\nsamples=4\n"},
        {"[wind]\nspeed = 1 # y\n          # goes on\n# z\n[film]\n",
         {"wind.calm=2"},
         "[wind]\nspeed = 1 # y\n          # goes on\ncalm = 2\n# z\n[film]\n"},
        {"[wind]\r\nspeed = 1\r\n",
         {"wind.calm=2", "wind.noise.octaves=3"},
         "[wind]\r\nspeed = 1\r\ncalm = 2\r\nnoise = { octaves = 3 }\r\n"},
        {"[wind]\nnoise.octaves = 1\nspeed = 1\n",
         {"wind.noise.loop=[1, 2]"},
         "[wind]\nnoise.octaves = 1\nnoise.loop = [1, 2]\nspeed = 1\n"},
        {"[wind]\nnoise = { octaves = 1 } # x\n",
         {"wind.noise.loop=[1, 2]"},
         "[wind]\nnoise = { octaves = 1, loop = [1, 2] } # x\n"},
        {"[wind]\nnoise={octaves=1}\n",
         {"wind.noise.loop=[1, 2]"},
         "[wind]\nnoise={octaves=1, loop=[1, 2]}\n"},
        {"a = { }\nb = {}\n",
         {"a.x=1", "b.y=\"a b\"", "b.z=3"},
         "a = { x = 1 }\nb = { y = \"a b\", z = 3 }\n"},
        {"w = { n.a = 1, x = [1] }\n", {"w.n.b=2", "w.y=3"}, "w = { n.a = 1, x = [1], n.b = 2, y = 3 }\n"},
        {"k = [{ a = 1 }, {}]\n", {"k[0].b=2", "k[1].c=3"}, "k = [{ a = 1, b = 2 }, { c = 3 }]\n"},
        {"[wind.noise]\noctaves = 1\n", {"wind.speed=2"}, "[wind]\nspeed = 2\n\n[wind.noise]\noctaves = 1\n"},
        {"a = 1\n\n# of noise\n# too\n[wind.noise]\n",
         {"wind.speed=2"},
         "a = 1\n\n[wind]\nspeed = 2\n\n# of noise\n# too\n[wind.noise]\n"},
        {"# x\n[wind.noise]\n",
         {"wind={ speed = 2, noise = {} }"},
         "[wind]\nspeed = 2\n\n# x\n[wind.noise]\n"},
        {"[wind]\n[wind.noise]\noctaves = 1\n",
         {"wind.speed=2"},
         "[wind]\nspeed = 2\n[wind.noise]\noctaves = 1\n"},
        {"[[mesh]]\nname = 'a'\n\n[mesh.wind.noise]\nx = 1\n\n[[mesh]]\nname = 'b'\n",
         {"mesh.a.wind.speed=1", "mesh.b.wind.speed=2"},
         "[[mesh]]\nname = 'a'\n\n[mesh.wind]\nspeed = 1\n\n[mesh.wind.noise]\nx = 1\n\n[[mesh]]\nname = "
         "'b'\nwind = { speed = 2 }\n"},
        {"[camera]\nfov = 1\n\n# a light\n[[light]]\n",
         {"wind.speed=1", "film.samples=2"},
         "[camera]\nfov = 1\n\n[film]\nsamples = 2\n\n[wind]\nspeed = 1\n\n# a light\n[[light]]\n"},
        {"fps = 1\n# more = 2\n\n[[light]]\n",
         {"camera.fov=1"},
         "fps = 1\n# more = 2\n\n[camera]\nfov = 1\n\n[[light]]\n"},
        {"fps = 1\n# a light\n[[light]]\n",
         {"camera.fov=1"},
         "fps = 1\n\n[camera]\nfov = 1\n\n# a light\n[[light]]\n"},
        {"# x\n\n[[light]]\n", {"film.samples=1"}, "# x\n\n[film]\nsamples = 1\n\n[[light]]\n"},
        {"[[light]]\n",
         {"film.samples=1", "flim.a=2"},
         "[film]\nsamples = 1\n\n[[light]]\n\n[flim]\na = 2\n"},
        {"[camera]\nfov = 1",
         {"film={ size = [1, 2], a.b = 3 }"},
         "[camera]\nfov = 1\n\n[film]\na = { b = 3 }\nsize = [1, 2]"},
        {"[camera]\nfov = 1\n",
         {"wind.noise.octaves=2"},
         "[camera]\nfov = 1\n\n[wind]\nnoise = { octaves = 2 }\n"},
        {"a = 1\n", {"x y=a\"b\\\t"}, "a = 1\n\"x y\" = \"a\\\"b\\\\\"\n"},
    });
}

TEST(EditScene, TakesOutWhatIsSetToAnEmptyTable) {
    check({
        {"a = 1\nb = 2 # x\n# y\nc = 3", {"b={}", "c={}"}, "a = 1\n# y\n"},
        {"[wind]\nnoise = { a = 1, b = 2, c = 3 }\n",
         {"wind.noise.a={}"},
         "[wind]\nnoise = { b = 2, c = 3 }\n"},
        {"[wind]\nnoise = { a = 1, b = 2, c = 3 }\n",
         {"wind.noise.b={}"},
         "[wind]\nnoise = { a = 1, c = 3 }\n"},
        {"[wind]\nx = 1\nnoise = { a = 1, b = 2, c = 3 }\n",
         {"wind.noise.c={}", "wind.noise.b={}", "wind.noise.a={}"},
         "[wind]\nx = 1\n"},
        {"[wind]\nx = 1\n\n# n\n[wind.noise]\na = 1\n# b\nb = 2\n\n[film]\n",
         {"wind.noise={}"},
         "[wind]\nx = 1\n\n# n\n[film]\n"},
        {"[wind]\nx = 1\n", {"wind.y={}", "wind.z.y={}"}, "[wind]\nx = 1\n"},
        {"k = [{ a = 1 }]\n", {"k[0].a={}"}, "k = [{ }]\n"},
        {"[wind]\nx = 1\n[[wind.gusts.control]]\na = 1\n[[wind.gusts.control]]\na = 2\n\n[film]\n",
         {"wind.gusts.control=[]"},
         "[wind]\nx = 1\ngusts = { control = [] }\n[film]\n"},
        {"[wind.gusts]\nx = 1\n[[wind.gusts.control]]\na = 1\n",
         {"wind.gusts.control=[{ a = 2 }]"},
         "[wind.gusts]\nx = 1\n[[wind.gusts.control]]\na = 2\n"},
        {"[wind]\nspeed = 1\nnoise.a = 2\n",
         {"wind={ calm = 3, noise = { b = 4 } }"},
         "[wind]\ncalm = 3\nnoise = { b = 4 }\n"},
    });
}

TEST(EditScene, TheEditedFileDescribesTheSameScene) {
    const Schema schema = test_schema();
    const Folder folder;
    for (const char* name : {"mesh.obj", "other.obj", "sky.exr"}) folder.write(name, "");
    const std::string file = folder.write("scene.toml", full_scene);
    const Changes settings = {"fps=30",
                              " film.samples = 4 ",
                              "film.filter=box",
                              "wind.speed=8",
                              "wind.noise.octaves=7",
                              "wind.gusts.control=[{ strength = 3 }, { shape = \"box\" }]",
                              "wind.gusts.control[1].strength=-2",
                              "light.sun.angle=2",
                              "mesh.hill.file=other.obj",
                              "mesh.lamp.001.radius=9",
                              "mesh.lamp.001.transform.keys[1].frame=3",
                              "procedural.grass.wind.noise.frequency=5",
                              "procedural.grass.length=[0.2, 0.3]"};
    const SceneDescription expected = load_scene(file, settings, schema);
    const SceneDescription scene =
        load_scene(folder.write("edited.toml", edited_scene(full_scene, file, settings)), {}, schema);
    auto compare = [](const ParamSet& a, const ParamSet& b) {
        ASSERT_EQ(a.all().size(), b.all().size());
        for (const ParamValue& value : a.all()) {
            const ParamValue& other = b.at(value.name);
            EXPECT_EQ(value.given, other.given) << value.name;
            EXPECT_EQ(value.numbers, other.numbers) << value.name;
            EXPECT_EQ(value.text, other.text) << value.name;
            EXPECT_EQ(value.texts, other.texts) << value.name;
        }
    };
    compare(expected.globals, scene.globals);
    compare(expected.camera, scene.camera);
    compare(expected.film, scene.film);
    compare(expected.wind, scene.wind);
    for (size_t i = 0; i < scene.lights.size(); ++i)
        compare(expected.lights[i].params, scene.lights[i].params);
    for (size_t i = 0; i < scene.meshes.size(); ++i)
        compare(expected.meshes[i].params, scene.meshes[i].params);
    compare(expected.procedurals[0].params, scene.procedurals[0].params);
}

TEST(EditScene, ExplainsItsMistakes) {
    EXPECT_EQ(edit_mistakes("a = \n", {}).find("a.toml:1:"), 0u) << edit_mistakes("a = \n", {});
    EXPECT_NE(edit_mistakes("a = 1\n", {"a.b=1", "b=2", "mesh.hill.size=1", "c"})
                  .find("--set a.b=1: a is no table: set it as a whole\n"
                        "--set mesh.hill.size=1: no mesh is named \"hill\": there is no mesh with a name in "
                        "the scene\n"
                        "--set c: there is no value: write key=value"),
              std::string::npos);
    EXPECT_NE(edit_mistakes("a = 1\n", {"a=\xff"}), "");
    EXPECT_NE(edit_mistakes("\xff\xfe", {}), "");
    std::string dots = "a";
    for (int i = 0; i < 50000; ++i) dots += ".a";
    EXPECT_NE(edit_mistakes(dots + " = 1\n", {}), "");
    // The other element is known as two headers only: there is no text of it for a list.
    EXPECT_EQ(
        edit_mistakes("[[k]]\na = 1\n[[k]]\na = 2\n", {"k[1]=3"}),
        "--set k[1]=3: the value has no place in the text of the scene: write it into the file by hand\n");
}

TEST(EditScene, NamesWithEqualsSignsAreReached) {
    check({{"[[mesh]]\nname = 'a=b'\nx = 1\n[[mesh]]\nname = 'a'\nx = 1\n",
            {"mesh.a=b.x=2", "mesh.a.y=p=q"},
            "[[mesh]]\nname = 'a=b'\nx = 2\n[[mesh]]\nname = 'a'\nx = 1\ny = \"p=q\"\n"}});
}

} // namespace
} // namespace marram
