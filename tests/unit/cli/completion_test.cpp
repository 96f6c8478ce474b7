// SPDX-License-Identifier: Apache-2.0
// Completion and man pages: they contain every option of every command, bash completes, and groff prints no
// warning.
#include "core/manual/completion.h"
#include "program.h"

#include <algorithm>
#include <regex>

namespace marram::testing {
namespace {

const std::vector<std::string> commands = {"render", "bake", "info",       "compare", "measure", "sheet",
                                           "view",   "pack", "completion", "man",     "merge"};

bool has_program(const std::string& name) {
    return std::system(("command -v " + name + " > /dev/null 2>&1").c_str()) == 0;
}

std::string printed(const std::vector<std::string>& arguments) {
    const ProgramResult done = marram(arguments, run_copy);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.err, "");
    return done.out;
}

// The options that the program's own help lists. A command of `marram` must also be in `commands` here.
std::set<std::string> options_of(const std::string& command) {
    const std::string help = printed(command.empty() ? std::vector<std::string>{"--help"}
                                                     : std::vector<std::string>{command, "--help"});
    std::set<std::string> options;
    static const std::regex pattern("(^|[\\s,])(--?[a-z][a-z-]*)");
    for (const std::string& line : lines(help)) {
        if (!line.starts_with("  -")) continue; // continues the line before
        const std::string names = line.substr(0, line.find(' ', 2));
        for (std::sregex_iterator match(names.begin(), names.end(), pattern), end; match != end; ++match)
            options.insert((*match)[2]);
    }
    EXPECT_TRUE(options.contains("--help")) << help;
    return options;
}

TEST(Completion, KnowsEveryCommand) {
    const std::string help = printed({"--help"});
    std::vector<std::string> listed;
    bool subcommands = false;
    for (const std::string& line : lines(help)) {
        if (subcommands && line.starts_with("  ") && line[2] != ' ')
            listed.push_back(line.substr(2, line.find(' ', 2) - 2));
        subcommands = subcommands || line == "Subcommands:";
    }
    EXPECT_EQ(std::set<std::string>(listed.begin(), listed.end()),
              std::set<std::string>(commands.begin(), commands.end()))
        << help;
}

TEST(Completion, ScriptsAndPagesHaveEveryOption) {
    const std::string zsh = printed({"completion", "zsh"}), bash = printed({"completion", "bash"});
    EXPECT_TRUE(zsh.starts_with("#compdef marram\n"));
    for (const std::string& command : commands) {
        const std::string page = printed({"man", command});
        EXPECT_TRUE(page.starts_with(".\\\"")) << page;
        const size_t zsh_begin = zsh.find("        " + command + ")\n"),
                     bash_begin = bash.find("        " + command + ")\n");
        ASSERT_NE(zsh_begin, std::string::npos) << command;
        ASSERT_NE(bash_begin, std::string::npos) << command;
        const std::string in_zsh = zsh.substr(zsh_begin, zsh.find(" ;;", zsh_begin) - zsh_begin),
                          in_bash = bash.substr(bash_begin, bash.find(";;", bash_begin) - bash_begin);
        for (const std::string& option : options_of(command)) {
            std::string in_roff = "\\fB";
            for (const char c : option) in_roff += c == '-' ? "\\-" : std::string(1, c);
            EXPECT_CONTAINS(page, in_roff + "\\fR");
            EXPECT_CONTAINS(in_zsh, option);
            EXPECT_TRUE(std::regex_search(in_bash, std::regex("[ \"]" + option + "[ \"]"))) << option << "\n"
                                                                                            << in_bash;
        }
    }
    const std::string page = printed({"man"});
    for (const std::string& command : commands) EXPECT_CONTAINS(page, ".BR marram\\-" + command + " (1)");
    for (const std::string& option : options_of("")) {
        EXPECT_CONTAINS(bash, option);
        EXPECT_CONTAINS(zsh, option);
    }
}

// What bash offers for the last of these words, sorted. The words are split as readline splits them.
class Bash {
  public:
    Bash() {
        folder_.write("script", printed({"completion", "bash"}));
        folder_.write("a scene.toml",
                      SceneText{.more = "[[mesh]]\nname = \"x$(touch y)\"\ntype = \"box\"\n"});
        folder_.write("b.toml", "this is no scene");
        folder_.write("picture.png", "");
        fs::create_directory(folder_ / "folder");
    }

    using Words = std::vector<std::string>;
    Words complete(const Words& words) const {
        std::string quoted = "'" + program + "'";
        for (const std::string& word : words) quoted += " '" + word + "'";
        folder_.write(
            "ask", "cd '" + folder_ / "" + "'\n. ./script\nCOMP_WORDS=(" + quoted +
                       ")\nCOMP_CWORD=" + std::to_string(words.size()) +
                       "\n_marram marram\n[ ${#COMPREPLY[@]} = 0 ] || printf '%s\\n' \"${COMPREPLY[@]}\"\n");
        Words found = lines(output_of("bash --norc '" + folder_ / "ask" + "' 2>&1"));
        fs::remove(folder_ / "ask");
        std::sort(found.begin(), found.end());
        return found;
    }

  private:
    Folder folder_;
};

TEST(Completion, BashCompletes) {
    using Words = Bash::Words;
    const Bash bash;
    const auto has = [](const Words& words, const std::string& word) {
        return std::ranges::find(words, word) != words.end();
    };
    EXPECT_EQ(bash.complete({"re"}), Words{"render"});
    EXPECT_EQ(bash.complete({"--v"}), Words{"--version"});
    const Words all = bash.complete({""});
    for (const std::string& command : commands) EXPECT_TRUE(has(all, command)) << command;
    // Options, and the commands that they belong to.
    EXPECT_EQ(bash.complete({"render", "--fra"}), (Words{"--frame", "--frames", "--frames-dialect"}));
    EXPECT_EQ(bash.complete({"compare", "--fra"}), Words{});
    EXPECT_EQ(bash.complete({"bake", "--stage", ""}), (Words{"bent", "final", "rest"}));
    EXPECT_EQ(bash.complete({"bake", "--stage", "=", "fi"}), Words{"final"});
    EXPECT_EQ(bash.complete({"bake", "--stage", "="}), (Words{"bent", "final", "rest"}));
    EXPECT_EQ(bash.complete({"sheet", "--captions", "fr"}), Words{"frame"});
    EXPECT_EQ(bash.complete({"completion", "z"}), Words{"zsh"});
    EXPECT_EQ(bash.complete({"man", "com"}), (Words{"compare", "completion"}));
    EXPECT_EQ(bash.complete({"render", "--spp", ""}), Words{}) << "a number";
    // Files.
    EXPECT_EQ(bash.complete({"render", ""}), (Words{"a scene.toml", "b.toml", "folder"}));
    EXPECT_EQ(bash.complete({"render", "x.toml", "-o", "pi"}), Words{"picture.png"});
    EXPECT_EQ(bash.complete({"compare", "pi"}), Words{"picture.png"});
    EXPECT_EQ(bash.complete({"measure", "x.toml", "--out", ""}), Words{"folder"});
    EXPECT_TRUE(has(bash.complete({"render", "x.toml", ""}), "--resume"));
    // Names that the libraries declare.
    EXPECT_EQ(bash.complete({"info", "groo"}), Words{"groom"});
    EXPECT_TRUE(has(bash.complete({"info", ""}), "grass"));
    EXPECT_TRUE(has(bash.complete({"info", ""}), "b.toml"));
    EXPECT_EQ(bash.complete({"render", "--aov", "dep"}), Words{"depth"});
    EXPECT_EQ(bash.complete({"render", "--aov", "normal,dep"}), Words{"normal,depth"});
    EXPECT_EQ(bash.complete({"render", "--png", "dep"}), Words{"depth"});
    EXPECT_EQ(bash.complete({"render", "--png", "depth", ":", "0-20", "=", "pi"}), Words{"picture.png"});
    EXPECT_EQ(bash.complete({"render", "--png", "depth", ":", "0"}), Words{});
}

TEST(Completion, BashCompletesTheKeysOfTheScene) {
    using Words = Bash::Words;
    const Bash bash;
    EXPECT_EQ(bash.complete({"render", "a scene.toml", "--set", "wind.spee"}), Words{"wind.speed="});
    EXPECT_EQ(bash.complete({"render", "a scene.toml", "--set", "procedural.grass.density_m"}),
              Words{"procedural.grass.density_mask="});
    EXPECT_EQ(bash.complete({"render", "a\\ scene.toml", "--set", "mesh.ground.si"}),
              Words{"mesh.ground.size="});
    for (const char* typed :
         {"mesh.x$(touch y).si", "mesh.x\\$\\(touch\\ y\\).si"}) // a name must run nothing
        EXPECT_EQ(bash.complete({"render", "a scene.toml", "--set", typed}),
                  Words{"mesh.x\\$\\(touch\\ y\\).size="});
    EXPECT_EQ(bash.complete({"render", "b.toml", "--set", "film.sam"}), Words{"film.samples="})
        << "keys of every scene, where this one cannot be read";
    EXPECT_EQ(bash.complete({"render", "--set", "film.samples", "=", "4"}), Words{});
    EXPECT_EQ(bash.complete({"render", "--set", "film.samples", "="}), Words{});
}

// Names come from libraries: whatever they are, the scripts do not run them.
TEST(Completion, NamesRunNothing) {
    const CompletionWords words{{"$(touch y)", "a'b", "plain"}, {"`touch y`", "depth"}};
    ProgramText text;
    text.commands.push_back({"info", "", {}});
    text.commands[0].options.push_back({.names = {"subject"}, .positional = true});
    text.commands[0].options.push_back({.names = {"--aov"}, .value = "NAME,..."});
    const Folder folder;
    folder.write("script", bash_completion(text, words));
    const auto complete = [&](const std::string& typed) {
        return output_of(
            "cd '" + folder / "" + "'; bash --norc -c '. ./script; COMP_WORDS=(marram info " + typed +
            "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _marram; printf \"%s\\n\" \"${COMPREPLY[@]}\"' 2>&1");
    };
    EXPECT_EQ(complete("pla"), "plain\n");
    EXPECT_CONTAINS(complete("\"\""), "$(touch y)\na'b\n");
    EXPECT_EQ(complete("--aov dep"), "depth\n");
    EXPECT_FALSE(fs::exists(folder / "y"));
    EXPECT_CONTAINS(zsh_completion(text, words), "'\\''$(touch y)'\\''");
}

TEST(Completion, ZshTakesItsScript) {
    if (!has_program("zsh")) GTEST_SKIP() << "there is no zsh here";
    const Folder folder;
    folder.write("_marram", printed({"completion", "zsh"}));
    EXPECT_EQ(output_of("zsh -f -n '" + folder / "_marram" + "' 2>&1"), "");
}

TEST(Help, IsACommandToo) {
    EXPECT_EQ(printed({"help"}), printed({"--help"}));
    EXPECT_EQ(printed({"help", "bake"}), printed({"bake", "--help"}));
}

// A subject may be a parameter or a table inside one.
TEST(Info, FindsParametersByName) {
    EXPECT_CONTAINS(printed({"info", "gusts"}), "in [wind]\n    gusts.num_gusts");
    EXPECT_CONTAINS(printed({"info", "aovs"}), "in [film]\n    aovs");
    EXPECT_CONTAINS(printed({"info", "lights"}), "types of [[light]]");
    EXPECT_CONTAINS(printed({"info", "layer"}), "    dune_solver ");
    EXPECT_EQ(marram({"info", "no_such_subject"}).code, 2);
}

// A word with an underscore in a help text is a key, a type or a choice, not an identifier of the code that a
// renaming has left there.
// An installed program has no README: the page of the wind has the formula of the bend.
TEST(Info, ExplainsTheBend) {
    const std::string wind = marram({"info", "wind"}).out, groom = marram({"info", "groom"}).out;
    for (const std::string name : {"noise.amplitude", "waviness", "reference_segments", "calm", "gusts",
                                   "shield", "response(speed)", "global_rotate * ramp_rotate", "envelope"})
        EXPECT_LT(wind.find(name), wind.find("response  ")) << name << "\n" << wind;
    for (const std::string& line : lines(wind.substr(0, wind.find("\n\n"))))
        EXPECT_LE(line.size(), 104U) << line;
    EXPECT_CONTAINS(groom, "blade.species");
    EXPECT_CONTAINS(groom, "hair: modulus 3.9e9");
    EXPECT_CONTAINS(marram({"info"}).out, "response(speed)");
}

TEST(Info, NamesNothingButKeys) {
    const std::string text = printed({"info"});
    static const std::regex word("[a-z]+(_[a-z]+)+");
    std::set<std::string> keys = {"libmarram_procedural", // the library
                                  "dir_x", "dir_z",       // columns of tables
                                  "strand_id"};           // an attribute of .ply files
    const auto add = [&](const std::string& from) {
        for (std::sregex_iterator match(from.begin(), from.end(), word), end; match != end; ++match)
            keys.insert(match->str());
    };
    for (const std::string& line :
         lines(text)) { // "    gusts.num_gusts  integer ...", "target  sand|level|..."
        const size_t begin = line.find_first_not_of(' ');
        if (begin == std::string::npos) continue;
        if (line.starts_with("[[")) add(line.substr(0, line.find(':')));
        const size_t end = line.find("  ", begin);
        add(line.substr(begin, end - begin));
        if (end == std::string::npos) continue;
        const size_t type = line.find_first_not_of(' ', end);
        if (type != std::string::npos) add(line.substr(type, line.find(' ', type) - type));
    }
    for (std::sregex_iterator match(text.begin(), text.end(), word), end; match != end; ++match)
        EXPECT_TRUE(keys.contains(match->str())) << match->str();
}

TEST(InfoKeys, AreWhatSettingsTake) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.wind = "speed = 6\ngusts = { num_gusts = 5, radius_range = [0.3, 1] }\n"});
    const std::vector<std::string> keys = lines(printed({"info", "--keys", scene}));
    EXPECT_TRUE(std::ranges::is_sorted(keys));
    for (const char* key : {"fps", "film.samples", "camera.position", "wind.gusts.num_gusts",
                            "mesh.ground.size", "procedural.grass.length", "procedural.grass.width_profile"})
        EXPECT_TRUE(std::ranges::binary_search(keys, key)) << key;
    const std::vector<std::string> tables = lines(printed({"info", "--keys"}));
    EXPECT_TRUE(std::ranges::includes(keys, tables));
    const auto refuse = [&](const std::string& subject, const std::string& message) {
        const ProgramResult refused = marram({"info", "--keys", subject}, run_copy);
        EXPECT_EQ(refused.code, 2);
        EXPECT_EQ(refused.out, "");
        EXPECT_CONTAINS(refused.err, message);
    };
    refuse("groom", "this is no scene");
    refuse(folder / "none.toml", "none.toml");
    refuse(folder.write("bad.toml", "[wind]\nsped = 1\n"), "bad.toml:2:1");
}

TEST(ManPages, AreRoffWithoutWarnings) {
    const Folder folder;
    std::vector<std::string> expected = {folder / "man/marram.1"};
    for (const std::string& command : commands) expected.push_back(folder / ("man/marram-" + command + ".1"));
    std::vector<std::string> written = lines(printed({"man", "--out", folder / "man"}));
    std::sort(expected.begin(), expected.end());
    std::sort(written.begin(), written.end());
    EXPECT_EQ(written, expected);
    EXPECT_EQ(read_file(folder / "man/marram-render.1"), printed({"man", "render"}));
    if (!has_program("groff")) GTEST_SKIP() << "there is no groff here";
    for (const std::string& page : written)
        for (const char* device : {"utf8", "ascii"})
            EXPECT_EQ(output_of(fmt::format("groff -man -ww -K utf8 -T {} -rLL=72n '{}' 2>&1 > /dev/null",
                                            device, page)),
                      "")
                << page;
    const std::string text =
        output_of("groff -man -T ascii -P -c -P -b -P -u '" + folder / "man/marram-render.1" + "'");
    EXPECT_CONTAINS(text, "marram-render - render a scene to pictures");
    EXPECT_CONTAINS(text, "--frames LIST");
    EXPECT_CONTAINS(text, "-o, --output FILE");
    EXPECT_CONTAINS(text, "such as wind.speed=4");
}

TEST(ManPages, AreOfCommandsThatAre) {
    const ProgramResult refused = marram({"man", "rendr"}, run_copy);
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(refused.out, "");
    EXPECT_CONTAINS(refused.err, "rendr");
    const Folder folder;
    const std::string file = folder.write("file", "");
    EXPECT_EQ(marram({"man", "--out", file}, run_copy).code, 2);
    EXPECT_EQ(read_file(file), "");
}

} // namespace
} // namespace marram::testing
