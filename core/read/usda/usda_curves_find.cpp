// SPDX-License-Identifier: Apache-2.0
// Finds the prims of a USD layer whose curves are read, and says which are not.
#include "core/read/usda/usda_curves.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {

namespace {

struct UsdaFlags {
    std::string_view purpose; // "": none given
    bool is_invisible = false;
    bool blinks = false; // visible at some samples only
};

// The flags of a prim below one with the flags `above`.
UsdaFlags usda_flags(const UsdaPrim& prim, UsdaFlags above) {
    const auto text_of = [](const UsdaValue* value) {
        const auto* texts = value ? std::get_if<std::vector<std::string_view>>(value) : nullptr;
        return texts && texts->size() == 1 ? texts->front() : std::string_view();
    };
    if (const std::string_view purpose = text_of(prim.find("purpose")); !purpose.empty())
        above.purpose = purpose;
    const auto samples = prim.samples("visibility");
    const auto hidden = std::ranges::count_if(
        samples, [&](const auto& sample) { return text_of(sample.second) == "invisible"; });
    const bool always = samples.empty() ? text_of(prim.find("visibility")) == "invisible"
                                        : hidden == std::ranges::ssize(samples);
    above.is_invisible = above.is_invisible || always;
    above.blinks = above.blinks || (hidden > 0 && !always);
    return above;
}

// Curves that are not read, for one reason.
struct UsdaLeftOut {
    std::string reason;
    std::vector<std::string> paths;
};

std::string list_of_paths(const std::vector<std::string>& paths) {
    constexpr size_t most = 4;
    std::string text;
    for (size_t i = 0; i < std::min(paths.size(), most); ++i) text += (i > 0 ? ", " : "") + paths[i];
    return paths.size() > most ? text + fmt::format(" and {} more", paths.size() - most) : text;
}

// A path without the slashes at its end. "/" is above all prims.
std::string_view trimmed_path(std::string_view path) {
    const size_t last = path.find_last_not_of('/');
    return last == std::string_view::npos ? path.substr(0, 1) : path.substr(0, last + 1);
}

// As the value of prims, of the first few.
std::string quoted_paths(const std::vector<std::string>& paths) {
    constexpr size_t most = 4;
    std::string text;
    for (size_t i = 0; i < std::min(paths.size(), most); ++i)
        text += fmt::format("{}\"{}\"", i > 0 ? ", " : "", paths[i]);
    return text + (paths.size() > most ? ", ..." : "");
}

class UsdaCurvesFinder {
  public:
    explicit UsdaCurvesFinder(std::span<const std::string> chosen)
        : chosen_(chosen), has_found_(chosen.size(), 0) {}
    UsdaCurvesFound find(const std::string& path, const UsdaScene& scene);

  private:
    void visit(const UsdaPrim& prim, const std::string& parent, UsdaFlags above, bool is_chosen);
    void leave_out(std::string reason, const std::string& path);
    void warn_of_not_followed(const UsdaScene& scene);
    void warn_of_blinking();
    void check_chosen(const std::string& path) const;

    std::span<const std::string> chosen_;
    std::vector<char> has_found_; // [chosen]
    std::vector<const UsdaPrim*> ancestors_;
    UsdaCurvesFound found_;
    std::vector<UsdaLeftOut> left_out_;
    std::vector<std::string> all_; // paths of all curves that can be chosen
    std::vector<std::string> other_curves_;
    std::vector<std::string> blinking_; // paths of curves that are read
};

void UsdaCurvesFinder::leave_out(std::string reason, const std::string& path) {
    auto same = std::ranges::find(left_out_, reason, &UsdaLeftOut::reason);
    if (same == left_out_.end()) same = left_out_.insert(left_out_.end(), {std::move(reason), {}});
    same->paths.push_back(path);
}

void UsdaCurvesFinder::visit(const UsdaPrim& prim, const std::string& parent, UsdaFlags above,
                             bool is_chosen) {
    if (!is_usda_def(prim)) return;
    const std::string path = fmt::format("{}/{}", parent, prim.name);
    ancestors_.push_back(&prim);
    UsdaFlags flags = usda_flags(prim, above);
    std::vector<size_t> matches;
    for (size_t i = 0; i < chosen_.size(); ++i)
        if (const std::string_view one = trimmed_path(chosen_[i]);
            one == path || one == prim.name || (one == "/" && parent.empty()))
            matches.push_back(i);
    is_chosen = is_chosen || !matches.empty();
    if (is_chosen && !chosen_.empty()) flags = {}; // the user's choice counts, not flags
    const size_t before = all_.size();
    if (prim.type == "BasisCurves") {
        all_.push_back(path);
        if (!is_chosen)
            leave_out("are not among prims", path);
        else if (flags.is_invisible)
            leave_out("are invisible", path);
        else if (flags.purpose == "guide" || flags.purpose == "proxy")
            leave_out(fmt::format("have the purpose {}", flags.purpose), path);
        else {
            found_.prims.push_back({path, ancestors_});
            if (flags.blinks) blinking_.push_back(path);
        }
    }
    if (is_chosen && (prim.type == "HermiteCurves" || prim.type == "NurbsCurves"))
        other_curves_.push_back(path);
    for (const UsdaPrim& child : prim.children) visit(child, path, flags, is_chosen);
    if (all_.size() > before)
        for (const size_t i : matches) has_found_[i] = 1;
    ancestors_.pop_back();
}

void UsdaCurvesFinder::warn_of_not_followed(const UsdaScene& scene) {
    for (const UsdaNotFollowed& one : scene.layer().not_followed) {
        const int line = scene.place(one.at).line;
        const std::string times = one.count > 1 ? fmt::format("{} times, first in line {}", one.count, line)
                                                : fmt::format("line {}", line);
        found_.warnings.push_back(fmt::format(
            "\"{}\" ({}) is not followed: {}", one.what, times,
            one.what == "connect"
                ? "attributes have the values of this file"
                : "what it brings is missing; usdcat --flatten -o NAME.usda writes one file with all of it"));
    }
}

void UsdaCurvesFinder::warn_of_blinking() {
    if (blinking_.empty()) return;
    const bool one = blinking_.size() == 1;
    found_.warnings.push_back(fmt::format(
        "{} of curves {} visibility over time, which is not followed, and {} read at all times: {}: "
        "prims = [{}] reads {} without this line",
        one ? "1 prim" : fmt::format("{} prims", blinking_.size()), one ? "changes its" : "change their",
        one ? "is" : "are", list_of_paths(blinking_), quoted_paths(blinking_), one ? "it" : "them"));
}

// Every choice must have found curves.
void UsdaCurvesFinder::check_chosen(const std::string& path) const {
    for (size_t i = 0; i < chosen_.size(); ++i) {
        if (has_found_[i]) continue;
        const std::string whole = fmt::format("/{}", trimmed_path(chosen_[i]));
        if (std::ranges::any_of(all_, [&](const std::string& curves) {
                return curves == whole || curves.starts_with(whole + "/");
            }))
            throw InputError(
                {path}, fmt::format("prims has \"{}\", which is a path without its first slash", chosen_[i]),
                fmt::format("write \"{}\"", whole));
        throw InputError({path},
                         fmt::format("prims has \"{}\", which is or holds no BasisCurves", chosen_[i]),
                         all_.empty() ? "leave it out" : "choose among " + list_of_paths(all_));
    }
}

UsdaCurvesFound UsdaCurvesFinder::find(const std::string& path, const UsdaScene& scene) {
    for (const UsdaPrim& prim : scene.layer().prims) visit(prim, "", {}, chosen_.empty());
    warn_of_not_followed(scene);
    check_chosen(path);
    warn_of_blinking();
    for (const UsdaLeftOut& one : left_out_)
        if (one.reason != "are not among prims") // the user's own choice
            found_.warnings.push_back(
                fmt::format("the curves {} are left out, as they {}; prims = [\"{}\"] reads them",
                            list_of_paths(one.paths), one.reason, one.paths[0]));
    if (!other_curves_.empty())
        found_.warnings.push_back(fmt::format("{} prims of HermiteCurves or NurbsCurves are not read: {}",
                                              other_curves_.size(), list_of_paths(other_curves_)));
    if (!found_.prims.empty()) return std::move(found_);
    if (all_.empty())
        throw InputError({path}, "has no BasisCurves of its own",
                         "export curves into this file: references and variants are not followed");
    throw InputError({path},
                     fmt::format("the curves {} are left out, as they {}", list_of_paths(left_out_[0].paths),
                                 left_out_[0].reason),
                     fmt::format("name those to read: prims = [\"{}\"]", left_out_[0].paths[0]));
}

} // namespace

UsdaCurvesFound find_usda_curves(const std::string& path, const UsdaScene& scene,
                                 std::span<const std::string> chosen) {
    return UsdaCurvesFinder(chosen).find(path, scene);
}

} // namespace marram
