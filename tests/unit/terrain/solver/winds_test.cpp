// SPDX-License-Identifier: Apache-2.0
// Winds over time, compared with their definitions.
#include "procedural/terrain/solver/winds.h"

#include <gtest/gtest.h>

#include <cmath>

namespace marram {
namespace {

TEST(DuneWinds, TheCompassHasNorthAtMinusZ) {
    const SandWind north = wind_from(0.0, 1.0), east = wind_from(90.0, 1.0);
    EXPECT_NEAR(north.towards_x, 0.0, 1e-12);
    EXPECT_NEAR(north.towards_z, 1.0, 1e-12); // to the south
    EXPECT_NEAR(east.towards_x, -1.0, 1e-12); // to the west
    EXPECT_NEAR(east.towards_z, 0.0, 1e-12);
}

TEST(DuneWinds, TheLogarithmicLawInverts) {
    EXPECT_NEAR(shear_velocity_of(10.0), 0.4 * 10.0 / std::log(1e4), 1e-12);
    EXPECT_NEAR(wind_speed_of(shear_velocity_of(7.3)), 7.3, 1e-12);
}

TEST(DuneWinds, SequencesRepeat) {
    const WindHistory wind = wind_sequence({{{1, 0, 0.3}, 10.0}, {{0, 1, 0.4}, 0.0}, {{0, 1, 0.5}, 5.0}});
    EXPECT_EQ(wind(0.0).wind.shear_velocity, 0.3);
    EXPECT_EQ(wind(0.0).until, 10.0);
    EXPECT_EQ(wind(10.0).wind.shear_velocity, 0.5);
    EXPECT_EQ(wind(14.9).until, 15.0);
    EXPECT_EQ(wind(15.0).wind.shear_velocity, 0.3);
    double time = 0.0;
    for (int k = 0; k < 10000; ++k) { // time always advances
        const WindSpan span =
            wind_sequence({{{1, 0, 0.3}, 0.1}, {{0, 1, 0.5}, 0.2}, {{0, 1, 0.5}, 0.7}})(time);
        ASSERT_GT(span.until, time);
        time = span.until;
    }
    EXPECT_EQ(wind_sequence({})(3.0).wind.shear_velocity, 0.0);
}

TEST(DuneWinds, ChaosHasItsStatistics) {
    ChaoticWind chaos;
    chaos.towards = 1.0, chaos.spread = 0.4, chaos.mean = 0.33;
    const WindHistory wind = chaotic_wind(chaos);
    double mean = 0.0, x = 0.0, z = 0.0;
    const int count = 40000;
    for (int k = 0; k < count; ++k) {
        const WindSpan span = wind((k + 0.5) * chaos.seconds);
        mean += span.wind.shear_velocity / count;
        x += span.wind.towards_x / count, z += span.wind.towards_z / count;
        ASSERT_EQ(span.wind, wind(span.until - 1.0).wind);
    }
    EXPECT_NEAR(mean, 0.33, 0.005);
    EXPECT_NEAR(std::atan2(z, x), 1.0, 0.01);
    EXPECT_NEAR(std::hypot(x, z), std::exp(-0.08), 0.01); // of a normal distribution: exp(-spread^2 / 2)
    chaos.seed = 1;
    EXPECT_NE(chaotic_wind(chaos)(0.0).wind, wind(0.0).wind);
}

TEST(DuneWinds, RecordsAreReadAndSummed) {
    const WindRecord record{{0.0, 3600.0, 7200.0, 10800.0}, {10.0, 8.0, 0.0, 10.0}, {0.0, 90.0, 10.0, 180.0}};
    const WindHistory wind = recorded_wind(record);
    EXPECT_EQ(wind(0.0).until, 3600.0);
    EXPECT_NEAR(wind(4000.0).wind.towards_x, -1.0, 1e-12);
    EXPECT_EQ(wind(7300.0).wind.shear_velocity, 0.0);
    EXPECT_EQ(wind(10900.0).until, 14400.0);
    EXPECT_EQ(wind(14400.0).wind, wind(0.0).wind);
    const SandPhysics physics;
    const DriftPotential drift = drift_potential(winds_between(wind, 0.0, 14400.0), physics);
    const double strong = physics.saturated_flux(shear_velocity_of(10.0)),
                 weak = physics.saturated_flux(shear_velocity_of(8.0));
    EXPECT_NEAR(drift.dp, (2 * strong + weak) / 4, 1e-12);
    EXPECT_NEAR(drift.rdp, weak / 4, 1e-12);
    EXPECT_NEAR(drift.towards_x, -1.0, 1e-9);
    // In knots: 10 m/s is 19.44, 8 m/s is 15.55.
    EXPECT_NEAR(fryberger_drift(record).dp,
                100.0 * (2 * 19.438 * 19.438 * 7.778 + 15.551 * 15.551 * 3.891) / 4, 20.0);
    EXPECT_NE(drift_text(drift, "kg/(m s)").find("towards 270 deg"), std::string::npos)
        << drift_text(drift, "kg/(m s)");
}

// However short the entries are, few are left, and they move the same sand in the same time.
TEST(DuneWinds, ShortEntriesAreMergedWithTheirSand) {
    const SandPhysics physics;
    for (const double shear : {physics.threshold, 0.3, 1.7})
        EXPECT_NEAR(physics.shear_velocity_of_flux(physics.saturated_flux(shear)), shear, 1e-12);
    for (const double apart : {1e-26, 0.7, 59.0}) {
        WindRecord record;
        const int count = apart < 1e-3 ? 1000 : int(600.0 / apart);
        for (int k = 0; k < count; ++k) {
            record.time.push_back(k * apart);
            record.speed.push_back(k % 5 == 0 ? 2.0 : 8.0 + k % 3);
            record.from.push_back(200.0 + 10.0 * (k % 4));
        }
        for (int k = 0; k < 2; ++k) { // the second is long enough and stays as it is
            record.time.push_back(record.time.back() + 600.0);
            record.speed.push_back(9.0);
            record.from.push_back(90.0);
        }
        const std::vector<TimedWind> all = winds_of(record), merged = merged_winds(all, 60.0, physics);
        EXPECT_LE(merged.size(), 13U);
        EXPECT_EQ(merged.back().wind, all.back().wind);
        double seconds = 0.0;
        for (size_t k = 0; k < merged.size(); ++k) {
            EXPECT_GE(merged[k].seconds, 60.0);
            seconds += merged[k].seconds;
        }
        const DriftPotential before = drift_potential(all, physics), after = drift_potential(merged, physics);
        EXPECT_NEAR(after.rdp, before.rdp, 1e-9 * before.rdp) << apart;
        EXPECT_NEAR(after.towards_x, before.towards_x, 1e-9) << apart;
        EXPECT_NEAR(after.towards_z, before.towards_z, 1e-9) << apart;
        EXPECT_NEAR(seconds, record.time.back() + last_duration(record), 1e-9 * seconds);
    }
    // Too weak to move sand: the mean wind, still below the threshold.
    const std::vector<TimedWind> weak =
        merged_winds(std::vector<TimedWind>(4, {{1.0, 0.0, 0.1}, 30.0}), 60.0, physics);
    ASSERT_EQ(weak.size(), 2U);
    EXPECT_NEAR(weak[0].wind.shear_velocity, 0.1, 1e-12);
    EXPECT_EQ(merged_winds(std::vector<TimedWind>(4, {{}, 30.0}), 60.0, physics)[1].wind.shear_velocity, 0.0);
}

} // namespace
} // namespace marram
