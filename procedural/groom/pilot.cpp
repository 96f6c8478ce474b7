// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/pilot.h"

#include "procedural/wind/bend.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace marram {
namespace {

constexpr double spare = 1.25;
constexpr double default_share = 1e-3; // of the longest strand, where the frame asks for no tolerance

double tolerance_of(const PilotGroom& pilot) {
    return pilot.frame.tolerance > 0.0 ? pilot.frame.tolerance : default_share * longest_strand(pilot.groom);
}

std::vector<Root> some_of(std::span<const Root> roots, size_t most) {
    const size_t count = std::min(most, roots.size());
    std::vector<Root> some;
    for (size_t i = 0; i < count; ++i) some.push_back(roots[i * roots.size() / count]);
    return some;
}

// What 99 in 100 stay below; of fewer than a hundred the greatest.
double most_of(std::vector<double>& distances) {
    if (distances.empty()) return 0.0;
    const auto at = distances.end() - 1 - long(distances.size() / 100);
    std::nth_element(distances.begin(), at, distances.end());
    return *at;
}

double distance(const Wide3f& a, const Wide3f& b, int lane) {
    const double x = double(a.x[lane]) - double(b.x[lane]), y = double(a.y[lane]) - double(b.y[lane]),
                 z = double(a.z[lane]) - double(b.z[lane]);
    return std::sqrt(x * x + y * y + z * z);
}

// For each strand the greatest distance of a CV from that of `fine`, which has `every` times as many segments.
double gap(const WideVector<Wide3f>& coarse, const WideVector<Wide3f>& fine, size_t strands, size_t cvs,
           size_t every) {
    const size_t fine_cvs = (cvs - 1) * every + 1;
    std::vector<double> distances;
    for (size_t i = 0; i < strands; ++i) {
        double most = 0.0;
        for (size_t k = 0; k < cvs; ++k)
            most = std::max(most, distance(coarse[i / lanes * cvs + k],
                                           fine[i / lanes * fine_cvs + k * every], int(i % lanes)));
        distances.push_back(most);
    }
    return most_of(distances);
}

void blow(const PilotGroom& pilot, std::span<const Root> roots, int cvs, Strands& strands) {
    strands.resize(int(roots.size()), cvs, false);
    expand(pilot.groom, pilot.wind, {pilot.bind, pilot.bind}, roots, strands);
    const double response = wind_response(pilot.wind);
    for (size_t i = 0; i < strands.envelope.size(); ++i) {
        const double u = double(i % size_t(cvs)) / double(cvs - 1);
        strands.envelope[i] = splat_float(float(std::clamp(pilot.groom.envelope(u), 0.0, 1.0) * response));
    }
    if (response > 0.0 && wind_bends(pilot.wind))
        bend(pilot.wind, pilot.frame.bind_frame, pilot.frame.fps, strands);
    else
        std::copy(strands.rest.begin(), strands.rest.end(), strands.pose.begin());
}

// Where strands have swung to at the frame's first motion sample. Nothing where nothing has moved.
MarramStatus jiggled(const PilotGroom& pilot, std::span<const Root> roots, double step, Strands& strands,
                     WideVector<Wide3f>& pose) {
    pose.clear();
    Wind wind = pilot.wind;
    wind.collision.reset();
    wind.jiggle->step = step;
    MarramFrame frame = pilot.frame;
    frame.time_count = 1;
    PastSkin past;
    const MarramStatus status = read_past(frame, pilot.mesh, *wind.jiggle, longest_strand(pilot.groom), past);
    if (status != MARRAM_OK) return status;
    if (past.window.count() == 0 || !(past.moves() || wind_moves(wind))) return MARRAM_OK;
    const MarramMesh& mesh = frame.meshes[pilot.mesh];
    const ChainFrame chain =
        make_chain_frame({wind, pilot.groom.envelope, frame, mesh, {}, pilot.groom.basis, past.window});
    const Surface now{mesh.positions[0], mesh.normals ? mesh.normals[0] : nullptr, mesh.triangles, mesh.uvs,
                      mesh.triangle_count};
    const Expand lay_out{[&](uint32_t, Strands& out) {
                             expand(pilot.groom, wind, {pilot.bind, now}, roots, out);
                         },
                         [&](int64_t knot, Strands& out) {
                             expand(pilot.groom, wind, {pilot.bind, past.at(knot, mesh)}, roots, out);
                         }};
    ChainScratch scratch;
    jiggle_patch(chain, lay_out, strands, scratch);
    pose = std::move(scratch.jiggled[0]);
    return MARRAM_OK;
}

} // namespace

int cvs_for(const PilotGroom& pilot, bool& enough) {
    constexpr std::array counts = {3, 5, 9, 17, 33};
    constexpr int finest = 65, most = 513;
    const std::vector<Root> roots = some_of(pilot.roots, 512);
    Strands strands;
    blow(pilot, roots, finest, strands);
    const WideVector<Wide3f> fine = strands.pose;
    std::array<double, counts.size()> times_segments{}; // the law's factor, as seen from each number
    for (size_t i = 0; i < counts.size(); ++i) {
        blow(pilot, roots, counts[i], strands);
        const int segments = counts[i] - 1, every = (finest - 1) / segments;
        const double apart = gap(strands.pose, fine, roots.size(), size_t(counts[i]), size_t(every));
        times_segments[i] = apart / (1.0 / segments - 1.0 / (finest - 1)); // the finest is off, too
    }
    enough = true;
    size_t nearest = 0;
    for (int n = counts[0]; n <= most; ++n) {
        while (nearest + 1 < counts.size() && counts[nearest + 1] <= n) ++nearest;
        if (spare * times_segments[nearest] <= tolerance_of(pilot) * (n - 1)) return n;
    }
    enough = false;
    return most;
}

MarramStatus jiggle_step_for(const PilotGroom& pilot, double& step) {
    constexpr double longest = 2.0, shortest = 1.0 / 64.0, looked_at = 1.0;
    step = 0.0;
    const std::vector<Root> roots = some_of(pilot.roots, 128);
    if (roots.empty()) return MARRAM_OK;
    Strands strands;
    const int cvs = pilot.groom.cvs;
    strands.resize(int(roots.size()), cvs, false);
    WideVector<Wide3f> coarse, fine;
    if (const MarramStatus status = jiggled(pilot, roots, looked_at, strands, coarse); status != MARRAM_OK)
        return status;
    if (const MarramStatus status = jiggled(pilot, roots, 0.5 * looked_at, strands, fine);
        status != MARRAM_OK)
        return status;
    if (coarse.empty() || fine.empty()) return MARRAM_OK;
    // With half the step a quarter of the distance is left: three quarters are seen.
    const double apart = gap(coarse, fine, roots.size(), size_t(cvs), 1) / 0.75;
    for (step = longest; step > shortest; step *= 0.5)
        if (spare * apart * step * step <= tolerance_of(pilot) * looked_at * looked_at) break;
    return MARRAM_OK;
}

} // namespace marram
