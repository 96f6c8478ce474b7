// SPDX-License-Identifier: Apache-2.0
// --list prints the options of `marram render` for each golden. Otherwise renders goldens anew and shows,
// before anything is replaced, the old picture, the new one and their differences: one page and one line on
// the terminal for each. Replaces the files only with --write. Started by tests/golden/update.
#include "core/compare/compare_page.h"
#include "core/image/atomic_file.h"
#include "core/math/problem.h"
#include "tests/golden/goldens.h"

#include <fmt/format.h>

#include <filesystem>

namespace marram::golden {
namespace {

namespace fs = std::filesystem;

// Writes a page that shows both. Returns the line for the terminal.
std::string show(const Golden& golden, const std::string& before, const std::string& after,
                 const fs::path& folder) {
    ComparedFile a{after, {}}, b{before, {}};
    Comparison comparison;
    try {
        a.picture = read_picture(after);
        b.picture = read_picture(before);
        comparison = compare_pictures(a.picture, b.picture, after, before);
    } catch (const InputError& error) { // of another size, or damaged: --write replaces it
        return fmt::format("CANNOT BE COMPARED with what was ({}): {}", error.problems.front().what, after);
    }
    const std::string page = (folder / (golden.name + ".html")).string();
    AtomicFile writer(page);
    writer.write(compare_page(a, b, comparison));
    writer.commit();
    return fmt::format("{}: {}", comparison.alike() ? "alike" : "DIFFERENT, " + comparison.faults.front(),
                       page);
}

int run(const std::vector<std::string>& names, bool writes, const fs::path& folder) {
    fs::create_directories(folder);
    size_t bytes = 0;
    for (const Golden& golden : goldens()) {
        const std::string before = path_of(golden);
        const bool chosen = names.empty() || std::ranges::find(names, golden.name) != names.end();
        if (chosen) {
            const std::string after = (folder / (golden.name + ".exr")).string();
            write(made(golden), after, golden);
            fmt::print("{:<12} {}\n", golden.name,
                       fs::exists(before) ? show(golden, before, after, folder) : "new: " + after);
            std::fflush(stdout);
            if (writes) { // atomically
                fs::copy_file(after, before + ".new", fs::copy_options::overwrite_existing);
                fs::rename(before + ".new", before);
            }
        }
        if (fs::exists(before)) bytes += fs::file_size(before);
    }
    fmt::print("scenes/golden: {:.1f} of 6 MiB\n", double(bytes) / double(1 << 20));
    fmt::print("{}\n",
               writes ? "written" : "nothing was replaced: look at the pages, then run again with --write");
    return bytes <= size_t(6) << 20 ? 0 : 1;
}

// Prints each golden as options of `marram render`, separated by tabs.
void list() {
    for (const Golden& golden : goldens()) {
        fmt::print("{}\t{}\t--frame\t{}", golden.name, golden.scene, golden.frame);
        for (const std::string& change : golden.changes) fmt::print("\t--set\t{}", change);
        if (!golden.layers.empty()) fmt::print("\t--aov\t{}", fmt::join(golden.layers, ","));
        fmt::print("\n");
    }
}

} // namespace
} // namespace marram::golden

int main(int argc, char** argv) {
    std::vector<std::string> names;
    bool writes = false, lists = false;
    for (int i = 1; i < argc; ++i) {
        if (std::string(argv[i]) == "--write")
            writes = true;
        else if (std::string(argv[i]) == "--list")
            lists = true;
        else
            names.emplace_back(argv[i]);
    }
    if (lists) {
        marram::golden::list();
        return 0;
    }
    try {
        for (const std::string& name : names) marram::golden::golden_named(name);
        return marram::golden::run(names, writes, "golden");
    } catch (const std::exception& error) {
        fmt::print(stderr, "{}\n", error.what());
        return 2;
    }
}
