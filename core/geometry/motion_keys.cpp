// SPDX-License-Identifier: Apache-2.0
// Motion keys. Between two of them everything moves along a straight line, whose distance from the true path is, where that is
// smooth, p'' h^2 / 8: it falls with the square of the time between keys. Of meshes the transform is known, and the distance
// computed; of strands it is measured at five instants of the shutter and carried on by that law.
//
// A strand that a collider lets go jumps: no number of keys follows it, and it must not ask for any. It is one whose distance with
// three keys is more than half of that with two; a smooth one's is a quarter. (So is, by mistake, one that swings to and fro within
// one shutter: five instants do not tell.) And a few strands that whip past must not make all
// others dear: the rule holds 99 in 100.
//
// Of a tolerance in pixels, each CV's own distance from the camera decides what it allows there.
#include "core/geometry/build.h"

#include <algorithm>
#include <cmath>

namespace marram {

std::vector<double> motion_times(const BuildSettings& settings, uint32_t keys) {
    const double open = settings.frame + settings.shutter_open,
                 close = settings.frame + settings.shutter_close;
    if (!(open < close)) return {open};
    std::vector<double> times(keys);
    const auto last = double(keys - 1);
    for (uint32_t i = 0; i < keys; ++i) times[i] = (open * (last - i) + close * i) / last;
    times.front() = open;
    times.back() = close;
    return times;
}

namespace {

// Points of a mesh that show how far it is from where it belongs. Of a transform alone both are affine in the point, so in metres the
// corners of its box do. In pixels what is near counts more, which any vertex may be; and each goes its own way where it deforms.
class Looks {
  public:
    Looks(const SceneMesh& mesh, const View& view) : mesh_(mesh) {
        const std::vector<Vec3f>& positions = mesh.mesh.positions;
        constexpr size_t enough = 4096;
        if (!mesh.shapes.empty() || view.pixels_at > 0.0)
            for (size_t i = 0; i < positions.size(); i += 1 + positions.size() / enough)
                vertices_.push_back(i);
        if (!mesh.shapes.empty()) return;
        Eigen::AlignedBox3d box;
        for (const Vec3f& p : positions) box.extend(p.cast<double>());
        for (int i = 0; i < 8 && !box.isEmpty(); ++i)
            corners_.push_back(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
    }

    std::vector<Vec3d> at(double frame) const {
        std::vector<Vec3d> points;
        const Eigen::Affine3d placed = mesh_.transform.at(frame);
        for (const Vec3d& corner : corners_) points.push_back(placed * corner);
        for (const size_t vertex : vertices_) points.push_back(mesh_.vertex_at(vertex, frame));
        return points;
    }

  private:
    const SceneMesh& mesh_;
    std::vector<Vec3d> corners_; // object space
    std::vector<size_t> vertices_;
};

// Shares of the time between two keys at which to look: even motion is worst in the middle, no whole number of turns meets all seven, and
// ways that lead from shape to shape bend at these.
std::vector<double> looked_at(const SceneMesh& mesh, double begin, double end) {
    std::vector<double> shares = {0.118, 0.25, 0.382, 0.5, 0.618, 0.75, 0.882};
    for (const MeshShape& shape : mesh.shapes)
        if (shape.frame > begin && shape.frame < end) shares.push_back((shape.frame - begin) / (end - begin));
    return shares;
}

// Greatest distance of a mesh from where it belongs when drawn with so many keys.
double motion_error(const SceneMesh& mesh, const View& view, uint32_t keys, double open, double close) {
    const Looks looks(mesh, view);
    double worst = 0.0;
    const double step = (close - open) / double(keys - 1);
    for (uint32_t key = 0; key + 1 < keys; ++key) {
        const double begin = open + step * key;
        const std::vector<Vec3d> a = looks.at(begin), b = looks.at(begin + step);
        for (const double t : looked_at(mesh, begin, begin + step)) {
            const std::vector<Vec3d> exact = looks.at(begin + t * step);
            for (size_t i = 0; i < exact.size(); ++i)
                worst = std::max(worst,
                                 (exact[i] - ((1.0 - t) * a[i] + t * b[i])).norm() * view.enlarged(exact[i]));
        }
    }
    return worst;
}

} // namespace

double mesh_motion_error(const SceneGeometry& geometry, const View& view, uint32_t keys, double open,
                         double close) {
    double worst = 0.0;
    for (const SceneMesh& mesh : geometry.meshes)
        if (open < close && mesh.moves_within(open, close))
            worst = std::max(worst, motion_error(mesh, view, keys, open, close));
    return worst;
}

uint32_t motion_keys_for(const SceneGeometry& geometry, double tolerance, const View& view, double open,
                         double close) {
    constexpr uint32_t most = 64;
    uint32_t keys = 2;
    if (!(open < close)) return keys;
    for (const SceneMesh& mesh : geometry.meshes) {
        if (!mesh.moves_within(open, close)) continue;
        while (keys < most && motion_error(mesh, view, keys, open, close) > tolerance)
            keys = std::min(2 * keys - 1, most);
    }
    return keys;
}

void StrandMotion::add(const float* const samples[5], size_t cvs, const View& view) {
    double two = 0.0, three = 0.0;
    for (size_t k = 0; k < cvs; ++k) {
        Vec3d p[5];
        for (int i = 0; i < 5; ++i) p[i] = Eigen::Map<const Vec3f>(samples[i] + 4 * k).cast<double>();
        const double large = view.enlarged(p[2]);
        for (int i = 1; i < 4; ++i)
            two = std::max(two, large * (p[i] - (p[0] + (p[4] - p[0]) * (0.25 * i))).norm());
        three = std::max({three, large * (p[1] - 0.5 * (p[0] + p[2])).norm(),
                          large * (p[3] - 0.5 * (p[2] + p[4])).norm()});
    }
    gaps_.push_back({float(two), float(three)});
}

void StrandMotion::add(const StrandMotion& other) {
    gaps_.insert(gaps_.end(), other.gaps_.begin(), other.gaps_.end());
}

bool StrandMotion::jumps(const Gap& gap, double tolerance) {
    return double(gap.two) > tolerance && gap.three > 0.5F * gap.two;
}

double StrandMotion::jumps(double tolerance) const {
    const auto count =
        std::count_if(gaps_.begin(), gaps_.end(), [&](const Gap& gap) { return jumps(gap, tolerance); });
    return gaps_.empty() ? 0.0 : double(count) / double(gaps_.size());
}

double StrandMotion::left(uint32_t keys, double tolerance) const {
    std::vector<float> gaps;
    for (const Gap& gap : gaps_)
        if (!jumps(gap, tolerance)) gaps.push_back(keys <= 2 ? gap.two : gap.three);
    if (gaps.empty()) return 0.0;
    const auto most = gaps.end() - 1 - long(gaps.size() / 100);
    std::nth_element(gaps.begin(), most, gaps.end());
    return double(*most) * (keys <= 2 ? 1.0 : 4.0 / (double(keys - 1) * double(keys - 1)));
}

uint32_t StrandMotion::keys_for(double tolerance) const {
    constexpr uint32_t last = 64;
    // A few patches are looked at, and others may move faster. Fitted to the scenes: see the README.
    constexpr double spare = 1.25;
    if (spare * left(2, tolerance) <= tolerance) return 2;
    const double three = spare * left(3, tolerance);
    uint32_t keys = 3;
    while (keys < last && three * 4.0 > tolerance * double(keys - 1) * double(keys - 1)) ++keys;
    return keys;
}

} // namespace marram
