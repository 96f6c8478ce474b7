// SPDX-License-Identifier: Apache-2.0
#include "core/measure/bend_trial.h"

#include "core/measure/session.h"
#include "core/shot/settings.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace marram {
namespace {

constexpr uint64_t max_strands = 300; // of a groom, at regular intervals

std::vector<std::string> joined(std::vector<std::string> first, const std::vector<std::string>& second) {
    first.insert(first.end(), second.begin(), second.end());
    return first;
}

} // namespace

BendTrial::BendTrial(const MeasureRequest& request, double frame, const std::vector<std::string>& changes,
                     std::string groom, const std::atomic<bool>& stop)
    : request_(request), groom_(std::move(groom)), changes_(joined(request.overrides.settings, changes)),
      stop_(stop), shot_(load_with(request, stop, changes)) {
    set_frame(shot_, frame);
    settings_ = build_settings(shot_, frame);
    settings_.shutter_open = settings_.shutter_close = 0.0;
    settings_.stage = MARRAM_BENT;
    settings_.trace_curves = false;
    settings_.attributes.clear();
    settings_.view = {};
    settings_.tolerance = 0.0; // a thousandth of the strands' length
}

Directions BendTrial::bent(const std::vector<std::string>& changes) {
    const SceneDescription description =
        describe_scene(request_.scene, joined(changes_, changes), *shot_.plugins);
    for (size_t i = 0; i < description.procedurals.size(); ++i)
        if (description.procedurals[i].name_in_file() == groom_)
            shot_.geometry.procedurals[i]->update(description.procedurals[i], description.wind,
                                                  MARRAM_NOTHING);
    BuildProgress progress;
    BuildStats stats;
    World world =
        build_world(shot_.geometry, settings_, stop_, progress, stats, std::exchange(kept_, KeptGeometry{}));
    unsolved_ = uint64_t(stats.report("bend.unsolved"));
    const auto ours = [&](const CurveGeometry& curves) {
        return std::ranges::any_of(description.procedurals, [&](const Item& item) {
            return item.name == curves.name && item.name_in_file() == groom_;
        });
    };
    uint64_t count = 0;
    for (const CurveGeometry& curves : world.curves) count += ours(curves) ? curves.curve_count : 0;
    Directions directions;
    weights_.clear();
    positions_.clear();
    strands_ = 0;
    for (const CurveGeometry& curves : world.curves)
        if (ours(curves)) read(curves, std::max(count / max_strands, uint64_t(1)), directions);
    for (double& weight : weights_) weight /= double(strands_);
    kept_ = kept_geometry(std::move(world));
    return directions;
}

// Adds a strand in `every`. Its weights have the sum 1.
void BendTrial::read(const CurveGeometry& curves, uint64_t every, Directions& directions) {
    const CurveLayout layout = curves.layout();
    for (uint64_t c = 0; c < curves.curve_count; c += every) {
        const float* cv = curves.vertices[0] + 4 * (layout.first_vertex(c) + 1); // after a phantom vertex
        const uint32_t cvs = layout.cvs(c);
        std::vector<Vec3d> segments;
        double length = 0.0;
        for (uint32_t k = 0; k + 1 < cvs; ++k) {
            const float* from = cv + size_t(4) * k;
            segments.emplace_back(double(from[4]) - double(from[0]), double(from[5]) - double(from[1]),
                                  double(from[6]) - double(from[2]));
            length += segments.back().norm();
        }
        if (!(length > 0.0)) continue;
        ++strands_;
        double arc = 0.0;
        for (const Vec3d& segment : segments) {
            const double own = segment.norm();
            directions.push_back(own > 0.0 ? Vec3d(segment / own) : Vec3d::Zero());
            weights_.push_back(own / length);
            positions_.push_back((arc + 0.5 * own) / length);
            arc += own;
        }
    }
}

} // namespace marram
