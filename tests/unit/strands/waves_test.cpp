// SPDX-License-Identifier: Apache-2.0
// Waves over a field of wheat, measured from the tips of its stalks by correlation in space and time: how fast they
// travel, and how far apart they are, beside the gusts that make them.
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace marram::testing {
namespace {

constexpr double field_side = 40.0, gust_speed = 6.0, fps = 24.0; // m, m/s
constexpr int bins = 80, lanes_across = 16; // of 0.5 m along the wind and 2.5 m across it
constexpr double bin = field_side / bins;

std::string wheat_field(const std::string& wind, const std::string& stalks) {
    return "\n[wind]\nspeed = 6\ndirection = [1, 0, 0]\ncalm = 0.3\n"
           "gusts = { num_gusts = 60, radius_range = [2, 4], life_range = [300, 300], decay_range = 24, "
           "period = 96, "
           "center = [0, 0.5, 0], extent = [60, 1], distance = 40 }\n" +
           wind + mesh("field", "plane", "size = [40, 40]\n") +
           "[[procedural]]\ntype = \"groom\"\nname = \"wheat\"\non = \"field\"\ndensity = 5\nspacing = "
           "0.8\nlength = 0.68\n"
           "lean = 2\nlean_variation = 2\narc = 5\narc_variation = 5\nwidth = 0.005\nwidth_profile = [[0, "
           "1]]\n"
           "width_variation = 0\ncvs = 6\n" +
           stalks;
}

using TipField = std::array<std::array<double, bins>, lanes_across>; // mean way along the wind, less its mean

// Of frames first, first + step, ... In a scene rendered in order, jiggle goes on from frame to frame.
std::vector<TipField> tips_over_time(const std::string& text, int count, int step) {
    TestScene scene(text), still("\n[wind]\n" + text.substr(text.find("speed = 6") + 10));
    const auto tips = [](TestScene& of, double frame, bool roots) {
        of.settings.frame = frame;
        const World world = of.build();
        const CurveGeometry& curves = world.curves.front();
        std::vector<Vec3f> points;
        const size_t stride = curves.cvs_per_curve + 2;
        for (size_t c = 0; c < curves.curve_count; ++c)
            points.emplace_back(curves.vertices[0] + 4 * (c * stride + (roots ? 1 : curves.cvs_per_curve)));
        return points;
    };
    const std::vector<Vec3f> roots = tips(scene, 1.0, true), rest = tips(still, 1.0, false);
    std::vector<TipField> fields;
    for (int i = 0; i < count; ++i) {
        const std::vector<Vec3f> now = tips(scene, 1.0 + i * step, false);
        TipField& field = fields.emplace_back();
        std::array<std::array<int, bins>, lanes_across> counts{};
        double mean = 0.0;
        for (size_t c = 0; c < now.size(); ++c) {
            const auto at = [](double x, int n) {
                return size_t(std::clamp(int((x / field_side + 0.5) * n), 0, n - 1));
            };
            const size_t along = at(double(roots[c].x()), bins),
                         across = at(double(roots[c].z()), lanes_across);
            const double way = double(now[c].x()) - double(rest[c].x());
            field[across][along] += way;
            ++counts[across][along];
            mean += way / double(now.size());
        }
        for (size_t j = 0; j < lanes_across; ++j)
            for (size_t b = 0; b < bins; ++b)
                field[j][b] = counts[j][b] > 0 ? field[j][b] / counts[j][b] - mean : 0.0;
    }
    return fields;
}

// Correlation of fields `later` apart in time, with a shift of so many bins along the wind.
double correlation(const std::vector<TipField>& fields, size_t later, int shift) {
    double sum = 0.0, first = 0.0, second = 0.0;
    for (size_t t = 0; t + later < fields.size(); ++t)
        for (size_t j = 0; j < lanes_across; ++j)
            for (int b = 0; b + shift < bins; ++b) {
                const double a = fields[t][j][size_t(b)], c = fields[t + later][j][size_t(b + shift)];
                sum += a * c, first += a * a, second += c * c;
            }
    return sum / std::sqrt(first * second);
}

// m/s: the shift that correlates best, by a parabola through the best three.
double wave_speed(const std::vector<TipField>& fields, size_t later, double seconds) {
    std::vector<double> values;
    for (int shift = 0; shift < bins / 2; ++shift) values.push_back(correlation(fields, later, shift));
    const auto best = size_t(std::max_element(values.begin() + 1, values.end() - 1) - values.begin());
    const double a = values[best - 1], b = values[best], c = values[best + 1];
    return (double(best) + 0.5 * (a - c) / (a - 2.0 * b + c)) * bin / seconds;
}

// m: twice the shift at which the correlation in space is least.
double wave_spacing(const std::vector<TipField>& fields) {
    int least = 1;
    for (int shift = 1; shift < bins / 2; ++shift)
        if (correlation(fields, 0, shift) < correlation(fields, 0, least)) least = shift;
    return 2.0 * least * bin;
}

TEST(Waves, TravelAndLieApartAsTheGustsThatMakeThem) {
    constexpr int frames = 24, step = 3, later = 4;
    const std::string still_air = "noise = { amplitude = 0 }\n";
    const auto wheat =
        tips_over_time(wheat_field(still_air + "jiggle = { damping = 0.15 }\n",
                                   "canopy = true\ncanopy_attenuation = 2.5\nbend = \"blade\"\nblade = { "
                                   "frequency = 2.5, mass = 0.005, drag = 1 }\n"),
                       frames, step);
    // Strands that show the gusts themselves: they turn with the envelope, at once.
    const auto gusts =
        tips_over_time(wheat_field(still_air + "response = [[0, 0], [6, 0.2]]\n", ""), frames, step);
    const double seconds = later * step / fps;
    const double speed = wave_speed(wheat, later, seconds), of_gusts = wave_speed(gusts, later, seconds);
    const double spacing = wave_spacing(wheat), apart = wave_spacing(gusts);
    std::printf(
        "waves of wheat travel at %.2f m/s, gusts at %.2f (set: %.2f); they are %.1f m apart, gusts %.1f\n",
        speed, of_gusts, gust_speed, spacing, apart);
    std::printf("correlation after %.2f s: %.3f of wheat, %.3f of gusts\n", seconds,
                correlation(wheat, later, int(std::lround(speed * seconds / bin))),
                correlation(gusts, later, int(std::lround(of_gusts * seconds / bin))));
    EXPECT_NEAR(of_gusts, gust_speed, 0.05 * gust_speed);
    EXPECT_NEAR(speed, of_gusts, 0.05 * of_gusts);
    EXPECT_NEAR(spacing, apart, 0.25 * apart);
}

} // namespace
} // namespace marram::testing
