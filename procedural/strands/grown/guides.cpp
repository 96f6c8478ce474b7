// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/guides.h"

#include "core/math/rotation.h"
#include "procedural/abi/param.h"
#include "procedural/strands/binding.h"

#include <nanoflann.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr std::array guide_values = {
    param::curves("guides.curves", "none",
                  "curves that strands grow between, with their shape and length; absent: none"),
    param::integer("guides.blend", "", "3", 1, max_blended, "how many of the nearest guides a strand blends"),
    param::number(
        "guides.parting", "deg", "60", 0, 180,
        "guides whose direction differs from the nearest guide's by more than this are not blended; "
        "180: all are"),
    param::curves("guides.parting_lines", "none",
                  "drawn partings on the skin: no guides beyond them are blended"),
    param::range("guides.length", "", "[1, 1]", 0, 1e6,
                 "shortest and longest strand, in lengths of its guides"),
    param::number(
        "guides.reach", "m", "none", 0, embree_limit,
        "no strands grow farther than this from a guide: their density fades out until 1.5 times this "
        "distance; default: 1.5 times the spacing of the guides"),
    param::choice("guides.wind", "strands", "strands|guides",
                  "what the wind blows: each strand, or only the guides, whose motion the strands blend: "
                  "quicker, less exact",
                  "guides|strands", ""),
};

} // namespace

std::span<const MarramParam> guide_params() { return guide_values; }

std::optional<GuideSettings> parse_guide_settings(const Values& values) {
    if (!values.has("guides.curves")) {
        if (values.has("guides.parting_lines"))
            throw SceneFault("groom.no_guides", values.at("guides.parting_lines").place,
                             "guides.parting_lines is given but no guides.curves",
                             "name the guides, or leave it out");
        return std::nullopt;
    }
    GuideSettings settings;
    settings.curves = values.text("guides.curves");
    settings.place = values.at("guides.curves").place;
    if (values.has("guides.parting_lines")) {
        settings.lines = values.text("guides.parting_lines");
        settings.lines_place = values.at("guides.parting_lines").place;
    }
    settings.blend = values.integer("guides.blend");
    settings.parting = radians(values, "guides.parting");
    settings.length = values.range("guides.length");
    if (values.has("guides.reach")) settings.reach = values.number("guides.reach");
    settings.wind_on_guides = values.text("guides.wind") == "guides";
    return settings;
}

// k-d tree over the guides' roots, to which nanoflann keeps a reference.
struct GuideSet::Tree {
    struct Roots {
        std::vector<Vec3d> points;
        size_t kdtree_get_point_count() const { return points.size(); }
        double kdtree_get_pt(size_t i, size_t axis) const { return points[i][long(axis)]; }
        template <typename Box>
        bool kdtree_get_bbox(Box&) const {
            return false;
        }
    } roots;
    using Index =
        nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Roots>, Roots, 3, uint32_t>;
    Index index;

    explicit Tree(std::vector<Vec3d> points) : roots{std::move(points)}, index(3, roots) {
        index.buildIndex();
    }
};

GuideSet::GuideSet(const GuideSettings& settings, const LentCurves& curves, const float* vertices,
                   const Surface& bind, uint32_t vertex_count, std::vector<std::vector<Vec3d>> parting_lines,
                   const std::function<bool()>& cancelled)
    : settings_(settings), parting_lines_(std::move(parting_lines)) {
    binding_ = bind_strands(curves, vertices, bind, vertex_count, cancelled);
    if (cancelled()) return;
    std::vector<Vec3d> roots;
    for (uint64_t c = 0; c < curves.count(); ++c) {
        const float* v = vertices + 4 * (curves.first_vertex(c) + 1);
        const uint32_t cvs = curves.cvs(c);
        Guide guide{};
        guide.length = curve_length(v, cvs);
        if (!(guide.length > 0.0)) continue;
        const RootBinding& root_binding = binding_.root_bindings[c];
        guide.root = cv_at(v);
        guide.normal = frame_at(bind, root_binding.triangle, root_binding.weights).normal;
        guide.triangle = root_binding.triangle;
        guide.weights = root_binding.weights;
        guide.foot = bind.point(root_binding.triangle, root_binding.weights);
        const Vec3d to_tip = cv_at(v + 4 * (cvs - 1)) - guide.root;
        guide.direction = to_tip.norm() > 1e-9 * guide.length ? Vec3d(to_tip.normalized()) : guide.normal;
        for (uint32_t k = 0; k < cvs; ++k)
            guide.points.emplace_back((cv_at(v + 4 * k) - guide.root).cast<float>());
        longest_ = std::max(longest_, guide.length * settings.length[1]);
        roots.push_back(guide.root);
        guides_.push_back(std::move(guide));
    }
    if (guides_.empty())
        throw SceneFault("groom.no_guides", settings.place,
                         "the curves '" + settings.curves + "' have no guide with a length", "name others");
    tree_ = std::make_shared<const Tree>(std::move(roots));
    reach_ = settings_.reach.value_or(default_reach());
}

double GuideSet::default_reach() const {
    const size_t wanted = std::min(size_t(settings_.blend) + 1, guides_.size()); // a guide finds itself, too
    if (wanted < 2) return infinity;
    std::array<uint32_t, max_blended + 1> found{};
    std::array<double, max_blended + 1> squared{};
    std::vector<double> spacings;
    for (const Guide& guide : guides_) {
        const size_t count = tree_->index.knnSearch(guide.root.data(), wanted, found.data(), squared.data());
        spacings.push_back(std::sqrt(*std::max_element(squared.begin(), squared.begin() + long(count))));
    }
    const auto at = spacings.begin() + long(spacings.size() * 9 / 10);
    std::nth_element(spacings.begin(), at, spacings.end());
    return *at > 0.0 ? 1.5 * *at : infinity; // guides that share one root say nothing of the skin around it
}

double GuideSet::density_at(const Vec3d& root) const {
    if (!(reach_ < infinity)) return 1.0;
    uint32_t guide = 0;
    double squared = 0.0;
    tree_->index.knnSearch(root.data(), 1, &guide, &squared);
    const double distance = (guides_[guide].foot - root).norm(); // guides may hover over the skin
    if (distance <= reach_) return 1.0;
    constexpr double end = 1.5; // of the reach
    return std::max(0.0, (end * reach_ - distance) / ((end - 1.0) * reach_));
}

// True if the straight line from a root to a guide's root crosses a parting line, seen along the normal.
bool GuideSet::crosses_parting_line(const Vec3d& root, const Vec3d& normal, const Vec3d& guide) const {
    if (parting_lines_.empty()) return false;
    Vec3d x, y;
    orthonormal_basis<double>(normal, x, y);
    const auto flat = [&](const Vec3d& p) { return Vec2d((p - root).dot(x), (p - root).dot(y)); };
    const auto side = [](const Vec2d& a, const Vec2d& b, const Vec2d& p) {
        return (b - a).x() * (p - a).y() - (b - a).y() * (p - a).x();
    };
    const Vec2d from = Vec2d::Zero(), to = flat(guide);
    const double way = (guide - root).norm();
    for (const std::vector<Vec3d>& line : parting_lines_)
        for (size_t i = 0; i + 1 < line.size(); ++i) {
            const double length = (line[i + 1] - line[i]).norm();
            if ((line[i] - root).norm() > way + length)
                continue; // too far away, e.g. on the other side of a body
            const Vec2d a = flat(line[i]), b = flat(line[i + 1]);
            if ((side(a, b, from) > 0.0) != (side(a, b, to) > 0.0) &&
                (side(from, to, a) > 0.0) != (side(from, to, b) > 0.0))
                return true;
        }
    return false;
}

GuideBlend GuideSet::blend_at(const Vec3d& root, const Vec3d& normal) const {
    constexpr size_t max_neighbors = 32;
    std::array<uint32_t, max_neighbors> found{};
    std::array<double, max_neighbors> squared{};
    const double min_cosine = std::cos(settings_.parting);
    const auto wanted = size_t(settings_.blend);
    struct Chosen {
        uint32_t guide;
        double distance;
    } chosen[max_blended + 1];
    size_t count = 0, nearest = 0;
    // Query a few neighbours first, and more if most of them are excluded.
    for (size_t ask = 2 * wanted + 2; count <= wanted; ask *= 2) {
        ask = std::min(ask, std::min(max_neighbors, guides_.size()));
        const size_t found_count = tree_->index.knnSearch(root.data(), ask, found.data(), squared.data());
        // Order equally distant guides as in the file, independent of the tree.
        std::array<std::pair<double, uint32_t>, max_neighbors> order;
        for (size_t i = 0; i < found_count; ++i) order[i] = {squared[i], found[i]};
        std::sort(order.begin(), order.begin() + long(found_count));
        count = 0;
        for (size_t i = 0; i < found_count && count <= wanted; ++i) {
            const Guide& guide = guides_[order[i].second];
            if (!(guide.normal.dot(normal) > 0.0) || crosses_parting_line(root, normal, guide.root)) continue;
            if (count == 0) nearest = order[i].second;
            const Guide& first = guides_[nearest];
            if (count > 0 &&
                (shortest_rotation(guide.normal, first.normal).toRotationMatrix() * guide.direction)
                        .dot(first.direction) < min_cosine)
                continue;
            chosen[count++] = {order[i].second, std::sqrt(order[i].first)};
        }
        if (ask == std::min(max_neighbors, guides_.size())) {
            if (count == 0)
                chosen[count++] = {order[0].second,
                                   std::sqrt(order[0].first)}; // all are excluded: take the nearest
            break;
        }
    }
    GuideBlend blend{};
    const size_t blended = std::min(count, wanted);
    // R. Without a further guide: twice the distance of the last blended one.
    const double reach = count > wanted ? chosen[wanted].distance : 2.0 * chosen[blended - 1].distance;
    double sum = 0.0, weights[max_blended] = {};
    for (size_t i = 0; i < blended; ++i) {
        const double d = chosen[i].distance;
        // A root at a guide, up to rounding, takes that guide alone.
        if (!(d > 1e-9 * reach)) {
            blend.guide[0] = chosen[i].guide;
            blend.weight[0] = 1.0F;
            return blend;
        }
        weights[i] = std::pow(std::max(reach - d, 0.0) / (reach * d), 2);
        sum += weights[i];
    }
    if (!(sum > 0.0)) { // all are at the distance R
        for (size_t i = 0; i < blended; ++i) weights[i] = 1.0;
        sum = double(blended);
    }
    for (size_t i = 0; i < blended; ++i) {
        blend.guide[i] = chosen[i].guide;
        blend.weight[i] = float(weights[i] / sum);
    }
    return blend;
}

double GuideSet::length_of(const GuideBlend& blend) const {
    double length = 0.0;
    for (int i = 0; i < max_blended; ++i)
        if (blend.weight[i] > 0.0F) length += double(blend.weight[i]) * guides_[blend.guide[i]].length;
    return length;
}

std::shared_ptr<const std::vector<Vec3f>> GuideSet::resampled(int cvs) const {
    const std::lock_guard lock(lock_);
    auto& kept = resampled_[cvs];
    if (kept) return kept;
    std::vector<Vec3f> all(guides_.size() * size_t(cvs));
    for (size_t g = 0; g < guides_.size(); ++g) {
        const std::vector<Vec3f>& points = guides_[g].points;
        size_t segment = 0;
        double before = 0.0; // arc length up to the segment
        const auto segment_length = [&](size_t i) {
            return (points[i + 1].cast<double>() - points[i].cast<double>()).norm();
        };
        double length = segment_length(0);
        for (int k = 0; k < cvs; ++k) {
            const double s = guides_[g].length * k / (cvs - 1);
            while (segment + 2 < points.size() && before + length < s) {
                before += length;
                length = segment_length(++segment);
            }
            const double t = length > 0.0 ? std::clamp((s - before) / length, 0.0, 1.0) : 0.0;
            all[g * size_t(cvs) + size_t(k)] =
                ((1.0 - t) * points[segment].cast<double>() + t * points[segment + 1].cast<double>())
                    .cast<float>();
        }
        all[g * size_t(cvs) + size_t(cvs - 1)] = points.back();
    }
    kept = std::make_shared<const std::vector<Vec3f>>(std::move(all));
    return kept;
}

size_t GuideSet::bytes() const {
    size_t sum = guides_.capacity() * sizeof(Guide);
    for (const Guide& guide : guides_) sum += guide.points.capacity() * sizeof(Vec3f);
    const std::lock_guard lock(lock_);
    for (const auto& [cvs, points] : resampled_) sum += points->capacity() * sizeof(Vec3f);
    return sum;
}

} // namespace marram
