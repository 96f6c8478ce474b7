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
    WindRecord record{{0.0, 3600.0, 7200.0, 10800.0}, {10.0, 8.0, 0.0, 10.0}, {0.0, 90.0, 10.0, 180.0}};
    EXPECT_EQ(wind_record_problem(record), "");
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
    record.time[2] = 100.0;
    EXPECT_NE(wind_record_problem(record), "");
}

} // namespace
} // namespace marram
