// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/lent_curves.h"

#include "core/math/known_part.h"
#include "procedural/abi/parallel.h"

#include <fmt/format.h>

#include <atomic>
#include <cmath>

namespace marram {
namespace {

[[noreturn]] void refuse_lent(const char* id, const std::string& place, std::string_view name,
                              const std::string& what, const std::string& remedy) {
    throw SceneFault(id, place, fmt::format("the curves '{}' {}", name, what), remedy);
}

void check_layout(const LentCurves& lent, std::string_view name, const std::string& place,
                  uint32_t time_count) {
    const MarramCurves& curves = lent.curves;
    const auto refuse = [&](const std::string& what, const std::string& remedy) {
        refuse_lent("contract.curves", place, name, what, remedy);
    };
    if (curves.time_count != 1 && curves.time_count != time_count)
        refuse(fmt::format("have {} motion samples", curves.time_count),
               fmt::format("give 1 or the frame's {}", time_count));
    bool valid = curves.vertices != nullptr;
    for (uint32_t t = 0; valid && t < curves.time_count; ++t)
        valid = curves.vertices[t] != nullptr || curves.curve_count == 0;
    if (!valid) refuse("have vertices that are NULL", "pass non-NULL vertex pointers");
    if (curves.curve_count > UINT32_MAX) refuse("are more than 2^32", "split them");
    if (curves.offsets && curves.offsets[0] != 0)
        refuse("have offsets that do not begin with 0", "offsets[0] must be 0");
    for (uint64_t c = 0; curves.offsets && c < curves.curve_count; ++c)
        if (curves.offsets[c + 1] < curves.offsets[c] + 2 ||
            curves.offsets[c + 1] - curves.offsets[c] > (1U << 24))
            refuse(fmt::format("have offsets that give curve {} no usable number of CVs", c),
                   "give 2 to 2^24 a curve");
    if (!curves.offsets && curves.curve_count > 0 &&
        (curves.cvs_per_curve < 2 || curves.cvs_per_curve > (1U << 24)))
        refuse(fmt::format("have {} CVs a curve", curves.cvs_per_curve), "give 2 to 2^24");
    for (const MarramAttribute& a : lent.attributes)
        if (!a.name || !a.values || a.components < 1 || a.components > 4 ||
            (a.rate != MARRAM_PER_CURVE && a.rate != MARRAM_PER_CV))
            refuse("have an attribute without name or values, or not 1 to 4 floats a curve or CV",
                   "fill it in");
}

} // namespace

LentCurves find_curves(const MarramFrame& frame, std::string_view name, const std::string& place) {
    LentCurves lent;
    const std::vector<MarramCurves> all = known_parts(frame.curves, frame.curves_count, frame.curves_stride);
    for (uint32_t i = 0; i < all.size(); ++i) {
        if (!all[i].name || name != all[i].name) continue;
        lent.curves = all[i];
        lent.index = i;
        lent.attributes = known_parts(all[i].attributes, all[i].attribute_count, all[i].attribute_stride);
        check_layout(lent, name, place, frame.time_count);
        const size_t floats = 4 * (lent.cv_count() + 2 * lent.count());
        for (uint32_t t = 0; t < lent.curves.time_count; ++t) {
            const float* v = lent.curves.vertices[t];
            std::atomic<bool> usable{true};
            marram::parallel_for(tbb::blocked_range<size_t>(0, floats, 1 << 16), [&](const auto& range) {
                bool good = true;
                for (size_t k = range.begin(); k < range.end(); ++k)
                    good &= std::abs(v[k]) < float(embree_limit);
                if (!good) usable = false;
            });
            if (!usable)
                refuse_lent("contract.curves", place, name, "are not finite", "give finite vertices");
        }
        return lent;
    }
    throw SceneFault("strands.no_curves", place, fmt::format("there are no curves '{}'", name),
                     "name those of a [[curves]]");
}

} // namespace marram
