// SPDX-License-Identifier: Apache-2.0
// The project's rules: which module includes which, what belongs where, and what the plug-in exports.
#include "core/render/lights/lights.h"
#include "core/scene/suggest.h"
#include "program.h"
#include "shaders/shader.h"

#include <algorithm>
#include <cstdio>
#include <ranges>
#include <regex>

namespace marram::testing {
namespace {

const fs::path source = MARRAM_SOURCE_DIR;
const std::string plugin = MARRAM_BINARY_DIR "/libmarram_procedural.so";
const std::string rock_library = MARRAM_BINARY_DIR "/libmarram_rock.so";
const std::string host_library = MARRAM_BINARY_DIR "/libmarram_host.so";

// Which module includes which. A module may always include itself.
const std::map<std::string, std::set<std::string>> rules = {
    {"core/math", {}},
    {"core/plugin", {}},
    {"core/integrations", {"core/plugin"}},
    {"core/scene", {"core/math"}},
    {"core/image", {"core/math"}},
    {"core/host_values", {"core/math", "core/plugin", "core/scene"}},
    {"core/geometry", {"core/math", "core/plugin", "core/scene"}},
    {"core/read", {"core/math", "core/plugin", "core/image", "core/geometry"}},
    {"core/host",
     {"core/math", "core/plugin", "core/scene", "core/host_values", "core/image", "core/geometry",
      "core/read"}},
    {"core/trace", {"core/math", "core/plugin", "core/geometry"}},
    {"core/world", {"core/math", "core/plugin", "core/geometry", "core/host", "core/trace"}},
    {"core/write", {"core/math", "core/image", "core/geometry", "core/read"}},
    {"core/render", {"core/math", "core/geometry", "core/trace", "shaders"}},
    {"core/shot",
     {"core/math", "core/plugin", "core/scene", "core/image", "core/geometry", "core/read", "core/host",
      "core/trace", "core/world", "core/write", "core/render", "shaders"}},
    {"core/page", {"core/math", "core/image"}},
    {"core/compare", {"core/math", "core/image", "core/page"}},
    {"core/measure", {"core/math", "core/trace", "core/world", "core/render", "core/page", "core/shot"}},
    {"core/manual", {"core/math", "core/scene", "core/host", "core/render", "core/shot"}},
    {"core/view",
     {"core/math", "core/scene", "core/image", "core/geometry", "core/world", "core/render", "core/shot",
      "shaders"}},
    {"core/cli",
     {"core/math", "core/scene", "core/image", "core/write", "core/page", "core/shot", "core/compare",
      "core/measure", "core/manual", "core/view"}},
    {"shaders", {"core/math"}},
    {"procedural",
     {"core/math", "core/plugin", "procedural/abi", "procedural/wind", "procedural/strands",
      "procedural/terrain", "procedural/erosion"}},
    {"procedural/abi", {"core/math", "core/plugin"}},
    {"procedural/air", {"core/math", "core/plugin", "procedural/abi"}},
    {"procedural/noise", {"core/math"}},
    {"procedural/wind", {"core/math", "core/plugin", "procedural/abi", "procedural/air", "procedural/noise"}},
    {"procedural/strands",
     {"core/math", "core/plugin", "procedural/abi", "procedural/air", "procedural/noise", "procedural/wind"}},
    {"procedural/terrain",
     {"core/math", "core/plugin", "procedural/abi", "procedural/air", "procedural/noise", "procedural/wind"}},
    {"procedural/erosion",
     {"core/math", "core/plugin", "procedural/abi", "procedural/noise", "procedural/wind"}},
};

// The longest one that matches: they are in ascending order.
std::string module_of(const std::string& path) {
    for (const auto& [module, others] : std::views::reverse(rules))
        if (path.starts_with(module + "/")) return module;
    return "";
}

bool is_source(const fs::path& path) {
    const std::string extension = path.extension().string();
    return extension == ".h" || extension == ".cpp" || extension == ".c";
}

// All files in these folders, as paths relative to the checkout.
std::vector<std::string> files_in(const std::vector<std::string>& folders) {
    std::vector<std::string> files;
    for (const std::string& folder : folders)
        for (const auto& entry : fs::recursive_directory_iterator(source / folder))
            if (entry.is_regular_file()) files.push_back(fs::relative(entry.path(), source).string());
    std::sort(files.begin(), files.end());
    EXPECT_FALSE(files.empty());
    return files;
}

// The project's own terms fit on a page.
TEST(House, HasAShortGlossary) {
    std::ifstream in(source / "procedural/README.md");
    int terms = 0;
    bool glossary = false;
    for (std::string line; std::getline(in, line);) {
        if (line.starts_with("## ")) glossary = line == "## Glossary";
        if (glossary && line.starts_with("| ") && line.find("| word |") == std::string::npos) ++terms;
    }
    EXPECT_GT(terms, 10);
    EXPECT_LE(terms, 30);
}

TEST(House, HasAReadmeForTenMinutes) {
    std::ifstream in(source / "README.md");
    int lines = 0;
    for (std::string line; std::getline(in, line);) ++lines;
    EXPECT_LE(lines, 150);
    for (const char* folder : {"core", "procedural", "scenes", "tests"})
        EXPECT_TRUE(fs::exists(source / folder / "README.md")) << folder;
}

// The scene in README.md renders without a message.
TEST(House, ReadmesSceneRenders) {
    std::ifstream in(source / "README.md");
    std::string scene;
    bool inside = false;
    for (std::string line; std::getline(in, line);) {
        if (inside && line == "```") break;
        if (inside) scene += line + "\n";
        inside = inside || line == "```toml";
    }
    Folder folder;
    const std::string file = folder.write("lawn.toml", scene);
    const ProgramResult result = marram({"render", file, "-o", folder / "a.png", "--frame", "12", "--size",
                                         "64x36", "--spp", "1", "--quiet"});
    EXPECT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.err, "");
}

TEST(House, IncludesOnlyWhatTheDesignAllows) {
    static const std::regex include("\\s*#\\s*include\\s*\"([^\"]+)\".*");
    for (const std::string& file : files_in({"core", "procedural", "shaders"})) {
        if (!is_source(file)) continue;
        const std::string from = module_of(file);
        EXPECT_FALSE(from.empty()) << file << " belongs to no module";
        for (const std::string& line : lines(read_file(source / file))) {
            std::smatch match;
            if (!std::regex_match(line, match, include)) continue;
            // Headers of the contract are installed: they name each other without a folder.
            const std::string beside = (fs::path(file).parent_path() / match[1].str()).string();
            const std::string included =
                from == "core/plugin" && fs::exists(source / beside) ? beside : match[1].str();
            const std::string to = module_of(included);
            EXPECT_TRUE(!to.empty() && (to == from || rules.at(from).contains(to)))
                << file << " includes " << match[1];
            EXPECT_TRUE(fs::exists(source / included)) << file << " includes " << match[1];
        }
    }
}

// The tables of modules in core/README.md and procedural/README.md: "| `read` | what is in it | math, image |".
TEST(House, ReadmesListTheIncludeRules) {
    static const std::regex row("\\| `(\\w+)` \\| .* \\| ([^|]*) \\|");
    size_t listed = 0;
    for (const std::string folder : {"core", "procedural"})
        for (const std::string& line : lines(read_file(source / folder / "README.md"))) {
            std::smatch match;
            const bool is_row = std::regex_match(line, match, row);
            const auto rule = is_row ? rules.find(folder + "/" + match[1].str()) : rules.end();
            if (rule == rules.end()) continue;
            std::set<std::string> written;
            for (const std::string& name : split(match[2].str(), ','))
                if (const std::string module = name.substr(name.find_first_not_of(' ')); module != "-")
                    written.insert(module);
            std::set<std::string> enforced;
            for (const std::string& module : rule->second)
                enforced.insert(module.substr(module.find_last_of('/') + 1));
            EXPECT_EQ(written, enforced) << folder << "/" << match[1];
            ++listed;
        }
    EXPECT_EQ(listed + 2, rules.size()) << "shaders and procedural have no row";
}

// The host may bring its own executor: procedural/abi/parallel.h chooses between it and TBB.
TEST(House, RunsTheLibrarysLoopsInOnePlace) {
    for (const std::string& file : files_in(std::vector<std::string>{"procedural"})) {
        if (!is_source(file) || file == "procedural/abi/parallel.h") continue;
        EXPECT_EQ(read_file(source / file).find("tbb::parallel"), std::string::npos) << file;
    }
}

// Elsewhere a line that cannot be printed would end the run: output.h.
TEST(House, PrintsInOnePlace) {
    static const std::regex prints("fmt::print|\\bf?printf\\(|std::(cout|cerr|clog)|\\bfputs\\(|\\bputs\\(");
    for (const std::string& file : files_in(std::vector<std::string>{"core/cli"}))
        EXPECT_FALSE(!file.starts_with("core/cli/output.") &&
                     std::regex_search(read_file(source / file), prints))
            << file;
}

TEST(House, NamesEmbreeInOnePlace) {
    static const std::regex embree("\\s*#\\s*include\\s*[<\"]embree[0-9]*/.*");
    size_t found = 0;
    for (const std::string& file : files_in({"core", "procedural", "shaders", "tests"})) {
        if (!is_source(file)) continue;
        for (const std::string& line : lines(read_file(source / file))) {
            if (!std::regex_match(line, embree)) continue;
            EXPECT_EQ(file, "core/plugin/embree.h");
            ++found;
        }
    }
    EXPECT_EQ(found, 2u);
}

// In the comment at the head of a file.
bool has_licence(const std::string& text) {
    for (const std::string& line : lines(text)) {
        if (line.find("SPDX-License-Identifier: Apache-2.0") != std::string::npos) return true;
        if (!line.starts_with("//") && !line.starts_with("#") && !line.starts_with("/*")) return false;
    }
    return false;
}

TEST(House, FilesSayTheirLicence) {
    for (const std::string& file : files_in({"core", "procedural", "shaders", "scenes", "tests"})) {
        const fs::path path = source / file;
        const bool script = (fs::status(path).permissions() & fs::perms::owner_exec) != fs::perms::none;
        const bool broken = file.starts_with("tests/broken/") && path.extension() != ".toml";
        if (broken || !(is_source(path) || script || path.extension() == ".toml" ||
                        path.filename() == "CMakeLists.txt"))
            continue;
        EXPECT_TRUE(has_licence(read_file(path))) << file;
    }
    EXPECT_TRUE(has_licence(read_file(source / "CMakeLists.txt")));
}

TEST(House, TopLevelIsAsDesigned) {
    const std::set<std::string> known = {"CMakeLists.txt", "README.md", "core",  "procedural",
                                         "shaders",        "scenes",    "tests", "build"};
    for (const auto& entry : fs::directory_iterator(source)) {
        const std::string name = entry.path().filename().string();
        EXPECT_TRUE(name.starts_with(".") || known.contains(name)) << name;
    }
}

// Unit and default by name, from the table at the head of a page: "//   name  unit  default  meaning", in the
// columns of its heading.
std::map<std::string, std::pair<std::string, std::string>> parameters_on_page(const std::string& file) {
    std::map<std::string, std::pair<std::string, std::string>> found;
    size_t unit = 0, initial = 0, meaning = 0; // columns
    for (const std::string& line : lines(read_file(source / file))) {
        if (unit == 0) {
            if (!line.starts_with("//   parameter ")) continue;
            unit = line.find("unit"), initial = line.find("default"), meaning = line.find("meaning");
            continue;
        }
        if (!line.starts_with("//   ")) break;
        if (line[5] == ' ' || line.find(": as in diffuse") != std::string::npos)
            continue; // continues, or listed there
        const auto column = [&](size_t begin, size_t end) {
            const std::string text = line.substr(std::min(begin, line.size()), end - begin);
            return text.substr(0, text.find_last_not_of(' ') + 1);
        };
        const std::string of = column(unit, initial);
        found[column(5, unit)] = {of == "1" || of == "-" ? "" : of, column(initial, meaning)};
    }
    return found;
}

void expect_page(const std::string& file, std::span<const ParamSpec> params,
                 const std::set<std::string>& elsewhere) {
    const auto page = parameters_on_page(file);
    std::set<std::string> declared;
    for (const ParamSpec& spec : params) {
        declared.insert(spec.name);
        if (elsewhere.contains(spec.name)) continue;
        ASSERT_TRUE(page.contains(spec.name)) << file << " does not list " << spec.name;
        const auto& [unit, initial] = page.at(spec.name);
        EXPECT_EQ(unit, spec.unit) << file << ": " << spec.name;
        const std::string written = spec.initial.empty() ? "required" : spec.initial;
        EXPECT_EQ(initial, written) << file << ": " << spec.name;
    }
    for (const auto& [name, columns] : page)
        EXPECT_TRUE(declared.contains(name)) << file << " lists " << name << ", which is not declared";
}

TEST(House, PagesListTheParametersThatAreDeclared) {
    const std::set<std::string> of_strands = {"color_map", "map_scale", "map_wrap", "root_color",
                                              "tip_color", "variation", "tint",     "tint_color"};
    for (const ShaderDescription& shader : shaders())
        expect_page("shaders/" + shader.name + ".h", shader.params,
                    shader.name == "diffuse" ? std::set<std::string>() : of_strands);
    for (const LightType& light : light_types())
        expect_page(light.name == "daylight" ? "shaders/daylight.h"
                                             : "core/render/lights/" + light.name + "_light.h",
                    light.params, {});
}

TEST(Plugin, ExportsItsEntryPointAlone) {
    for (const auto& [library, entry] :
         {std::pair(plugin, " T marram_library"), std::pair(rock_library, " T marram_rock_library")}) {
        const std::vector<std::string> symbols = lines(output_of("nm -D --defined-only " + library));
        ASSERT_EQ(symbols.size(), 1u) << fmt::format("{}", fmt::join(symbols, "\n"));
        EXPECT_TRUE(symbols[0].ends_with(entry)) << symbols[0];
    }
}

TEST(HostLibrary, ExportsWhatItsHeaderDeclares) {
    static const std::regex declaration("MARRAM_HOST_API [^;{]*?\\b(marram_\\w+)\\(");
    const std::string header = read_file(source / "core/plugin/marram_host.h");
    std::set<std::string> declared, exported;
    for (std::sregex_iterator match(header.begin(), header.end(), declaration), end; match != end; ++match)
        declared.insert((*match)[1]);
    for (const std::string& line : lines(output_of("nm -D --defined-only " + host_library)))
        exported.insert(line.substr(line.rfind(' ') + 1));
    EXPECT_GT(declared.size(), 10u);
    EXPECT_EQ(exported, declared);
}

TEST(HostLibrary, NeedsNoRenderer) {
    const std::string needed = output_of("readelf -d " + host_library + " | grep NEEDED");
    for (const char* library : {"embree", "tbb", "openvdb", "OpenImageIO", "tinyobjloader"})
        EXPECT_EQ(needed.find(library), std::string::npos) << needed;
}

// A host that replaces malloc or operator new replaces it for the plug-in too.
TEST(Plugin, ImportsItsAllocator) {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "the sanitizer brings its own";
#endif
    const std::vector<std::string> symbols = lines(output_of("nm -D --undefined-only " + plugin));
    for (const char* name : {" malloc@", " free@", " _Znwm@", " _ZdlPvm@"})
        EXPECT_TRUE(std::any_of(symbols.begin(), symbols.end(), [&](const std::string& symbol) {
            return symbol.find(name) != std::string::npos;
        })) << name;
}

TEST(Plugin, KnowsNothingOfTheRenderer) {
    const std::string needed = output_of("readelf -d " + plugin + " | grep NEEDED");
    for (const char* library : {"OpenImageIO", "OpenEXR", "openvdb", "libtinyobjloader", "libtomlplusplus"})
        EXPECT_EQ(needed.find(library), std::string::npos) << needed;
    const std::string symbols = output_of("nm -C " + plugin);
    for (const char* name :
         {"marram::build_world", "marram::load_scene", "marram::read_image", "marram::load_mesh",
          "marram::render(", "marram::make_material", "marram::InputError", "marram::World"})
        EXPECT_EQ(symbols.find(name), std::string::npos) << name;
}

} // namespace
} // namespace marram::testing
