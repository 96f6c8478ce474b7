// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/output.h"
#include "core/compare/compare_page.h"
#include "core/compare/windows.h"
#include "core/image/atomic_file.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <filesystem>
#include <new>

namespace marram {
namespace {

namespace fs = std::filesystem;

// Checks, before the pictures are read, that the page does not overwrite one of them, also through a link.
void check_page(const CompareOptions& options) {
    if (options.report.empty()) return;
    const fs::path page = fs::path(options.report) / "compare.html";
    for (const std::string& picture : {options.test, options.reference}) {
        std::error_code not_there;
        if (fs::equivalent(page, picture, not_there))
            throw InputError({page.string()}, "the report would overwrite '" + picture + "'",
                             "name another folder with --report");
    }
}

std::string make_report_folder(const std::string& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (!fs::is_directory(folder))
        throw InputError({folder}, "the folder for the report cannot be made",
                         "name another with --report, or make it");
    return (fs::path(folder) / "compare.html").string();
}

void print_reading(const Picture& a, const Picture& b, const Comparison& c) {
    if (a.read_as != "linear" || b.read_as != "linear")
        print_result("{:<12} A {}, B {}\n", "read as", a.read_as, b.read_as);
    if (c.swapped) print_result("{:<12} A carries limits: B is judged by it\n", "golden");
}

// What the tests of noise would have found.
void print_power(const Comparison& c) {
    if (c.light > 0.0) {
        print_result("{:<12} differences of the mean by size, in % of the picture's light:", "found from");
        for (const ScaleResult& s : c.scales)
            print_result(" {} {:.2g}", s.size == 0 ? std::string("whole") : fmt::format("{}", s.size),
                         100.0 * s.limit * s.deviation / c.light);
        print_result("\n");
    }
    if (c.ratios.empty()) return;
    print_result("{:<12} squared differences relative to the variance (limit) by size:", "over all");
    for (const RatioResult& r : c.ratios) print_result(" {} {:.3g} ({:.3g})", r.size, r.ratio, r.limit);
    print_result("\n");
}

void print(const Comparison& c) {
    for (const LayerResult& layer : c.layers)
        print_result("{:<12} RMSE {:.4g}, relative MSE {:.4g}, PSNR {:.2f} dB, at most {:.4g}{}\n",
                     layer.name.empty() ? "picture" : layer.name, layer.rmse, layer.relative_mse, layer.psnr,
                     layer.most,
                     layer.name.empty()       ? ", of linear light"
                     : layer.found_from > 0.0 ? fmt::format(", means of {} found from {:.2g}",
                                                            window_text(c.width, c.height), layer.found_from)
                                              : "");
    print_result("{:<12} mean {:.4g}, 99th percentile {:.4g}, worst window {:.4g} at ({}, {}) ({})\n", "FLIP",
                 c.flip_mean, c.flip_99, c.flip_window, c.flip_window_x, c.flip_window_y, c.flip_kind());
    print_result("{:<12} {:.5g}\n", "SSIM", c.ssim);
    if (!c.scales.empty()) {
        print_result("{:<12} standard deviations (limit) by size:", "noise");
        for (const ScaleResult& s : c.scales)
            print_result(" {} {:.3g} ({:.3g})",
                         s.size == 0 ? std::string("whole") : fmt::format("{}", s.size), s.worst, s.limit);
        print_result("\n");
        print_power(c);
    } else {
        print_result("{:<12} not known: {}\n", "noise", c.unknown);
    }
    for (const std::string& note : c.notes) print_result("{}\n", note);
    for (const std::string& fault : c.faults) print_result("{}\n", fault);
    print_result("{}\n", c.different() ? "different"
                         : c.equal     ? "alike: every number is the same"
                         : c.alike()   ? "alike"
                                       : "cannot tell: " + c.doubt);
}

int compare_files(const CompareOptions& options) {
    ComparedFile test{options.test, read_picture(options.test)},
        reference{options.reference, read_picture(options.reference)};
    const Comparison comparison =
        compare_pictures(test.picture, reference.picture, options.test, options.reference);
    const std::string page = options.report.empty() ? "" : make_report_folder(options.report);
    if (!page.empty()) check_writable(page, Links::replace);
    print_reading(test.picture, reference.picture, comparison);
    print(comparison);
    if (!page.empty()) {
        const std::string text = compare_page(test, reference, comparison);
        AtomicFile writer(page, Links::replace);
        writer.write(text);
        writer.commit();
        print_result("{}\n", page);
    }
    return comparison.different() ? exit_different : comparison.alike() ? exit_done : exit_bad_input;
}

} // namespace

int compare_command(const CompareOptions& options) {
    check_page(options);
    try {
        return compare_files(options);
    } catch (const std::bad_alloc&) {
        throw InputError({options.test},
                         "comparing it with " + options.reference + " does not fit into memory",
                         "compare them in parts, or scaled down");
    }
}

} // namespace marram
