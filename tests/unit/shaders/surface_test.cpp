// SPDX-License-Identifier: Apache-2.0
// Diffuse, grass, sand and surface bsdfs: white materials conserve energy, samples follow the pdf, bsdfs are
// reciprocal, glints and ripples average to the appearance that they replace.
#include "tests/unit/shaders/fibre_cases.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using testing::material_of;
using testing::Random;
using Settings = std::map<std::string, std::string>;

Vec3f unit_vector(double y, double phi) {
    const double r = std::sqrt(std::max(0.0, 1.0 - y * y));
    return Vec3d(r * std::cos(phi), y, r * std::sin(phi)).cast<float>();
}

// A point on the ground, viewed at an angle with this cosine.
ShadingPoint ground_point(double cosine, double phi = 0.7) {
    ShadingPoint point;
    point.sidedness_normal = point.normal = Vec3f::UnitY();
    point.wo = unit_vector(cosine, phi);
    point.footprint = 1e6F; // innumerable glints
    return point;
}

struct Case {
    const char* shader;
    Settings settings;
    double furnace; // tolerance for white
};

std::string case_name(const Case& c) {
    std::string text = c.shader;
    for (const auto& [name, value] : c.settings) text += " " + name + " " + value;
    return text;
}

std::vector<Case> white_cases() {
    std::vector<Case> cases = {{"diffuse", {{"color", "0.6"}, {"transmission", "0.4"}}, 1e-3}};
    for (const char* roughness : {"0.03", "0.1", "0.3", "0.6", "1"})
        for (const char* specular : {"0", "0.04", "0.3"}) {
            cases.push_back(
                {"surface", {{"color", "1"}, {"roughness", roughness}, {"specular", specular}}, 3e-3});
            cases.push_back({"grass",
                             {{"color", "1"},
                              {"transmission_color", "1"},
                              {"roughness", roughness},
                              {"specular", specular}},
                             3e-3});
        }
    for (const char* roughness : {"0", "0.3", "0.8", "1"})
        for (const char* sparkle :
             {"0", "0.05", "1"}) // facets alone spread transmitted light slightly differently from grains
            cases.push_back(
                {"sand",
                 {{"color", "1"}, {"roughness", roughness}, {"sparkle", sparkle}, {"ripple_height", "0"}},
                 sparkle == std::string("1") ? 1.1e-2 : 1e-3});
    return cases;
}

double furnace_by_samples(const Bsdf& bsdf) {
    constexpr int count = 20000;
    double sum = 0.0;
    for (int i = 0; i < count; ++i) {
        const auto part = [&](double step) { // Korobov lattice: powers of the root of x^4 = x + 1
            const double x = 0.5 + step * i;
            return static_cast<float>(x - std::floor(x));
        };
        BsdfSample next;
        if (sample(bsdf, {part(0.8191725134), part(0.6710436067), part(0.5497004779), 0.5F}, next))
            sum += static_cast<double>(next.value.x() / next.pdf) / count;
    }
    return sum;
}

// Grains viewed at a grazing angle are bright in a band along the horizon that is as thin as the angle. Rows
// are spaced by a constant ratio there; directions below the ground are omitted.
double furnace_near_the_horizon(const Bsdf& bsdf) {
    constexpr int rows = 400, columns = 300;
    double sum = 0.0, low = 0.0;
    for (int i = 0; i < rows; ++i) {
        const double high = std::pow(10.0, -6.0 * (1.0 - (i + 1.0) / rows));
        for (int j = 0; j < columns; ++j)
            sum += static_cast<double>(
                       evaluate(bsdf, unit_vector(0.5 * (low + high), 2.0 * pi * (j + 0.5) / columns))
                           .value.x()) *
                   (high - low) * 2.0 * pi / columns;
        low = high;
    }
    return sum;
}

} // namespace

// Uses the shader's own samples. The next tests check that they have their stated pdf.
TEST(Surfaces, WhiteFurnaceAtEveryRoughnessAndAngle) {
    std::map<std::string, double> worst;
    for (const Case& c : white_cases()) {
        const Material material = material_of(c.shader, c.settings);
        for (const double cosine : {1.0, 0.7, 0.3, 0.1, 0.02}) {
            const Bsdf bsdf = bsdf_at(material, ground_point(cosine));
            const bool grains = std::string(c.shader) == "sand";
            const double sum = grains ? furnace_near_the_horizon(bsdf) : furnace_by_samples(bsdf);
            const double off = std::abs(sum - 1.0);
            EXPECT_LT(off, c.furnace) << case_name(c) << " cosine " << cosine << ": " << sum;
            worst[c.shader] = std::max(worst[c.shader], off);
        }
    }
    for (const auto& [shader, off] : worst)
        std::printf("[ furnace ] %s: off by %.1e at most\n", shader.c_str(), off);
}

// The same with uniform steps over the sphere, without the sampler, for lobes wider than the steps.
TEST(Surfaces, WhiteFurnaceByQuadratureAndDensitiesOfOne) {
    double worst = 0.0, most = 0.0, least = 1.0;
    for (const Case& c : white_cases()) {
        const bool sharp = std::string(c.shader) == "grass" || std::string(c.shader) == "surface";
        if (sharp && c.settings.at("roughness") < std::string("0.3")) continue;
        const Material material = material_of(c.shader, c.settings);
        for (const double cosine : {0.9, 0.4}) {
            const Bsdf bsdf = bsdf_at(material, ground_point(cosine));
            double sum = 0.0, density = 0.0;
            constexpr int rows = 400, columns = 400;
            for (int i = 0; i < rows; ++i)
                for (int j = 0; j < columns; ++j) {
                    const BsdfValue at = evaluate(
                        bsdf, unit_vector(-1.0 + 2.0 * (i + 0.5) / rows, 2.0 * pi * (j + 0.5) / columns));
                    sum += static_cast<double>(at.value.x()) * 4.0 * pi / (rows * columns);
                    density += static_cast<double>(at.pdf) * 4.0 * pi / (rows * columns);
                }
            worst = std::max(worst, std::abs(sum - 1.0));
            most = std::max(most, density);
            least = std::min(least, density);
        }
    }
    std::printf("[ furnace ] by quadrature: off by %.1e; densities integrate to %.4f ... %.4f\n", worst,
                least, most);
    EXPECT_LT(worst, 4e-3);
    EXPECT_LT(most, 1.0 + 1e-3);
    EXPECT_GT(least, 0.95); // rough gloss samples some directions below the surface, which are rejected
}

TEST(Surfaces, SamplesFollowTheDensity) {
    const std::vector<Case> cases = {
        {"diffuse", {{"color", "[0.3, 0.5, 0.1]"}, {"transmission", "[0.2, 0.3, 0.1]"}}, 0},
        {"surface", {{"color", "0.3"}, {"roughness", "0.4"}, {"specular", "0.3"}}, 0},
        {"surface", {{"color", "0.8"}, {"roughness", "0.8"}}, 0},
        {"grass", {{"roughness", "0.4"}, {"specular", "0.2"}}, 0},
        {"sand", {{"sparkle", "1"}}, 0},
        {"sand", {{"sparkle", "0"}, {"roughness", "1"}}, 0},
    };
    double worst = -1e9;
    for (const Case& c : cases)
        for (const double cosine : {0.9, 0.5, 0.2}) {
            const Material material = material_of(c.shader, c.settings);
            const Bsdf bsdf = bsdf_at(material, ground_point(cosine));
            constexpr int rows = 16, columns = 16, fine = 32, count = 200000;
            std::vector<double> expected(rows * columns + 1, 0.0), seen(rows * columns + 1, 0.0);
            double whole = 0.0;
            for (int i = 0; i < rows * fine; ++i)
                for (int j = 0; j < columns * fine; ++j) {
                    const double y = -1.0 + 2.0 * (i + 0.5) / (rows * fine),
                                 phi = 2.0 * pi * (j + 0.5) / (columns * fine);
                    const double share = 4.0 * pi / (rows * fine * columns * fine) *
                                         static_cast<double>(evaluate(bsdf, unit_vector(y, phi)).pdf);
                    expected[static_cast<size_t>(i / fine * columns + j / fine)] += count * share;
                    whole += share;
                }
            expected.back() = count * std::max(0.0, 1.0 - whole); // sampled below the surface
            Random random{7};
            for (int k = 0; k < count; ++k) {
                BsdfSample next;
                if (!sample(bsdf, random.four(), next)) {
                    seen.back() += 1.0;
                    continue;
                }
                double phi = std::atan2(next.wi.z(), next.wi.x());
                if (phi < 0.0) phi += 2.0 * pi;
                const int i = std::clamp(static_cast<int>(0.5 * (next.wi.y() + 1.0) * rows), 0, rows - 1);
                const int j = std::clamp(static_cast<int>(phi / (2.0 * pi) * columns), 0, columns - 1);
                seen[static_cast<size_t>(i * columns + j)] += 1.0;
            }
            double statistic = 0.0;
            int cells = 0;
            for (size_t at = 0; at < expected.size(); ++at) {
                if (expected[at] < 20.0) continue;
                statistic += (seen[at] - expected[at]) * (seen[at] - expected[at]) / expected[at];
                ++cells;
            }
            const double excess = (statistic - cells) / std::sqrt(2.0 * cells);
            worst = std::max(worst, excess);
            EXPECT_LT(excess, 5.0) << case_name(c) << " cosine "
                                   << cosine; // standard deviations of chi-square
        }
    std::printf("[ density ] worst chi square %.1f deviations above its mean\n", worst);
}

// The image multiplies the color; the tint blends the result towards tint_color.
TEST(Surfaces, TintLiesOverTheImage) {
    struct Paint : Texture {
        Vec3f at(const Vec2f&, float, Wrap) const override { return {0.5F, 0.25F, 0.0F}; }
    };
    const Material material = make_material(
        "surface",
        testing::params_of("surface", {{"color", "[0.8, 0.8, 0.8]"},
                                       {"specular", "0"},
                                       {"color_map", "\"any.png\""},
                                       {"tint", "\"gust\""},
                                       {"tint_color", "[0.1, 0.2, 0.9]"}}),
        [](const std::string&, TextureContent, const Place&) { return std::make_shared<Paint>(); });
    ShadingPoint point = ground_point(0.8);
    for (const float tint : {0.0F, 0.5F, 1.0F}) {
        point.tint_weight = tint;
        const Vec3f expected = (1.0F - tint) * Vec3f(0.4F, 0.2F, 0.0F) + tint * Vec3f(0.1F, 0.2F, 0.9F);
        EXPECT_LT((albedo(bsdf_at(material, point)) - expected).norm(), 1e-3F) << tint;
    }
}

TEST(Surfaces, LightMayBeFollowedEitherWay) {
    for (const Case& c : white_cases()) {
        Settings settings = c.settings;
        settings["color"] = "[0.6, 0.3, 0.1]";
        const Material material = material_of(c.shader, settings);
        Random random{3};
        double worst = 0.0;
        for (int i = 0; i < 500; ++i) {
            const Vec3f a = unit_vector(2.0 * random() - 1.0, 2.0 * pi * random());
            Vec3f b = unit_vector(2.0 * random() - 1.0, 2.0 * pi * random());
            if (i % 2 == 0) // near the mirror direction, where the gloss is
                b = (Vec3f(-a.x(), a.y(), -a.z()) + 0.1F * b).normalized();
            if (std::min(std::abs(a.y()), std::abs(b.y())) < 0.01F) continue;
            ShadingPoint from_a = ground_point(1.0), from_b = from_a;
            from_a.wo = a;
            from_b.wo = b;
            const Vec3f there = evaluate(bsdf_at(material, from_a), b).value / std::abs(b.y());
            const Vec3f back = evaluate(bsdf_at(material, from_b), a).value / std::abs(a.y());
            worst =
                std::max(worst, static_cast<double>((there - back).norm() / std::max(there.norm(), 1e-3F)));
        }
        EXPECT_LT(worst, 1e-3) << case_name(c);
    }
}

TEST(Grass, LetsTheShareThroughThatIsAskedAndFiltersIt) {
    const Material blade = material_of("grass", {{"color", "[0.4, 0.6, 0.2]"},
                                                 {"transmission", "0.3"},
                                                 {"transmission_color", "[1, 0.5, 0.25]"},
                                                 {"specular", "0"}});
    const Bsdf bsdf = bsdf_at(blade, ground_point(0.6));
    Vec3d back = Vec3d::Zero(), through = Vec3d::Zero();
    constexpr int rows = 200, columns = 100;
    for (int i = 0; i < rows; ++i)
        for (int j = 0; j < columns; ++j) {
            const Vec3f wi = unit_vector(-1.0 + 2.0 * (i + 0.5) / rows, 2.0 * pi * (j + 0.5) / columns);
            (wi.y() > 0.0F ? back : through) +=
                4.0 * pi / (rows * columns) * evaluate(bsdf, wi).value.cast<double>();
        }
    EXPECT_LT((back - 0.7 * Vec3d(0.4, 0.6, 0.2)).norm(), 1e-3);
    EXPECT_LT((through - 0.3 * Vec3d(0.4, 0.3, 0.05)).norm(), 1e-3);
}

// The halves of a folded blade are separate planes: no light is lost at any offset and any angle.
TEST(Grass, LosesNothingByItsFold) {
    double worst = 0.0;
    for (const char* fold : {"20", "60"})
        for (const float h : {-1.0F, -0.4F, 0.7F})
            for (const double cosine : {0.9, 0.4}) {
                const Material blade = material_of(
                    "grass",
                    {{"color", "1"}, {"transmission_color", "1"}, {"fold", fold}, {"roughness", "0.6"}});
                ShadingPoint point = ground_point(cosine);
                point.fibre = point.flat = true;
                point.tangent = Vec3f::UnitX();
                point.h = h;
                worst = std::max(worst, std::abs(furnace_by_samples(bsdf_at(blade, point)) - 1.0));
            }
    std::printf("[ furnace ] folded grass: off by %.1e at most\n", worst);
    EXPECT_LT(worst, 4e-3);
}

// The two halves of a blade are tilted outwards, each towards its own side, seen from above and from below.
TEST(Grass, IsFoldedAlongItsMiddle) {
    const Material blade = material_of("grass", {{"fold", "30"}, {"specular", "0"}});
    for (const float wo_y : {0.8F, -0.8F}) {
        ShadingPoint point;
        point.fibre = point.flat = true;
        point.tangent = Vec3f::UnitX();
        point.sidedness_normal = point.normal = Vec3f::UnitY();
        point.wo = Vec3f(0.0F, wo_y, 0.6F);
        for (const float h : {-1.0F, 1.0F}) {
            point.h = h;
            const CoatedBsdf bsdf = std::get<CoatedBsdf>(bsdf_at(blade, point));
            const Vec3f facing = (wo_y < 0.0F ? -1.0F : 1.0F) * point.normal;
            EXPECT_NEAR(bsdf.normal.dot(facing), std::cos(30 * degree), 1e-6);
            EXPECT_GT(h * bsdf.normal.dot(point.tangent.cross(facing)), 0.49F);
        }
    }
}

namespace {

const SandSettings& sand_of(const Material& material) { return std::get<SandSettings>(material.settings); }

} // namespace

TEST(Sand, GlintsAverageToTheFacetsTheyStandFor) {
    const Material sand = material_of("sand");
    Random random{11};
    for (const float width : {0.0005F, 0.003F, 0.02F, 0.3F})
        for (const float chance : {1e-4F, 3e-3F, 0.2F}) {
            double sum = 0.0, squares = 0.0;
            constexpr int count = 200000;
            for (int i = 0; i < count; ++i) {
                const Vec3d place(100.0 * random(), 0.0, 100.0 * random());
                const Vec3f half = unit_vector(0.3 + 0.7 * random(), 2.0 * pi * random());
                const double g = static_cast<double>(glint(sand_of(sand), place, width, half, chance));
                ASSERT_TRUE(std::isfinite(g) && g >= 0.0);
                sum += g;
                squares += g * g;
            }
            const double mean = sum / count, deviation = std::sqrt((squares / count - mean * mean) / count);
            EXPECT_LT(std::abs(mean - 1.0), 5.0 * deviation + 1e-4) << width << " " << chance;
        }
}

// Between frames the camera comes 1 % closer and the light turns by 0.1 degrees: the same glints are visible.
// Independent glints would differ by their full standard deviation.
TEST(Sand, GlintsDoNotFlicker) {
    const Material sand = material_of("sand");
    Random random{12};
    double moved = 0.0, spread = 0.0;
    constexpr int count = 50000;
    for (int i = 0; i < count; ++i) {
        const Vec3d place(10.0 * random(), 0.0, 10.0 * random());
        const double y = 0.5 + 0.5 * random(), phi = 2.0 * pi * random();
        const float width = 0.002F + 0.02F * random();
        const float here = glint(sand_of(sand), place, width, unit_vector(y, phi), 1e-3F);
        const float next =
            glint(sand_of(sand), place, 0.99F * width, unit_vector(y, phi + 0.1 * degree), 1e-3F);
        moved += std::pow(static_cast<double>(next - here), 2.0);
        spread += std::pow(static_cast<double>(here - 1.0F), 2.0);
    }
    std::printf("[ glints ] change from frame to frame %.3f of their deviation\n", std::sqrt(moved / spread));
    EXPECT_LT(std::sqrt(moved / spread), 0.1);
    EXPECT_GT(spread / count, 0.1);
}

// The ripples on level ground at a position.
Ripple ripple_on_ground(const Material& sand, const Vec3d& at, const Footprint& seen) {
    ShadingPoint point;
    point.normal = point.sidedness_normal = Vec3f::UnitY();
    point.position = at;
    return ripple_at(sand_of(sand), point, seen);
}

// Compares slopes with the settings: integrates them along a line to a height, and checks its bounds.
TEST(Sand, RipplesAreAsHighAndAsLongAsAskedAndSteepDownwind) {
    const Material sand = material_of("sand", {{"ripple_height", "0.01"}, {"ripple_length", "0.1"}});
    double height = 0.0, low = 0.0, high = 0.0, steepest = 0.0, rise = 0.0;
    int crests = 0;
    double before = 0.0;
    constexpr double step = 0.0002, length = 40.0;
    for (double x = 0.0; x < length; x += step) {
        const double slope = static_cast<double>(ripple_on_ground(sand, {x, 0.0, 3.0}, {}).slope.x());
        height += step * slope;
        low = std::min(low, height);
        high = std::max(high, height);
        steepest = std::min(steepest, slope);
        rise = std::max(rise, slope);
        crests += before > 0.0 && slope <= 0.0;
        before = slope;
    }
    std::printf("[ ripples ] %.1f mm high at most, %.0f mm from crest to crest, slopes %.2f and %.2f\n",
                1000.0 * (high - low), 1000.0 * length / crests, rise, steepest);
    EXPECT_NEAR(length / crests, 0.1, 0.01);
    EXPECT_GT(high - low, 0.008);
    EXPECT_LT(high - low, 0.02); // heights vary, and the mean of the profile varies with the phase
    EXPECT_GT(-steepest, 2.0 * rise);
}

// At a grazing angle pixels are long: crests parallel to the view stay as sharp as from above, crests across
// it fade.
TEST(Sand, RipplesThatRunAwayStaySharp) {
    const Material sand = material_of("sand", {{"ripple_height", "0.01"}, {"ripple_length", "0.1"}});
    double from_above = 0.0, along_crests = 0.0, across_crests = 0.0;
    for (double x = 0.0; x < 10.0; x += 0.013) {
        const auto slope = [&](const Footprint& seen) {
            return double(ripple_on_ground(sand, {x, 0.0, 3.0}, seen).slope.squaredNorm());
        };
        constexpr float width = 0.01F, length = 0.2F;
        from_above += slope({{width, 0.0F}, {0.0F, width}});
        along_crests += slope({{width, 0.0F}, {0.0F, length}});
        across_crests += slope({{0.0F, width}, {length, 0.0F}});
    }
    std::printf("[ ripples ] at a twentieth: %.3f of their slope along the view, %.1e across it\n",
                along_crests / from_above, across_crests / from_above);
    EXPECT_GT(along_crests, 0.3 * from_above); // crests wander
    EXPECT_LT(across_crests, 0.01 * from_above);
}

// The shader derives that footprint from the ray.
TEST(Sand, RipplesLieAcrossThePixelsTheyAreSeenBy) {
    const Material along = material_of("sand", {{"ripple_direction", "0"}}),
                   across = material_of("sand", {{"ripple_direction", "90"}});
    double spread[2] = {};
    for (double x = 0.0; x < 5.0; x += 0.0131)
        for (const bool away : {false, true}) {
            ShadingPoint point = ground_point(0.05, 1.0);
            point.wo = Vec3f(0.0F, 0.05F, 0.99875F); // along z
            point.position = away ? Vec3d(0.0, 0.0, x) : Vec3d(x, 0.0, 0.0);
            point.footprint = 0.01F;
            const SandBsdf bsdf = std::get<SandBsdf>(bsdf_at(away ? across : along, point));
            spread[away] += double(Vec2f(bsdf.normal.x(), bsdf.normal.z()).squaredNorm());
        }
    EXPECT_GT(spread[0], 50.0 * spread[1]);
    EXPECT_GT(spread[0], 0.1);
}

// A wide pixel has the mean radiance of the narrow pixels in it: mean slope plus additional roughness.
TEST(Sand, RipplesFadeIntoRoughnessWithTheDistance) {
    const Material sand = material_of("sand", {{"sparkle", "0"}});
    double worst = 0.0;
    for (const double sun : {0.9, 0.5, 0.25}) {
        const Vec3f light = unit_vector(sun, 0.0);
        double near = 0.0, far = 0.0;
        constexpr int count = 40000;
        Random random{13};
        for (int i = 0; i < count; ++i) {
            ShadingPoint point = ground_point(0.8, 1.0);
            point.position = Vec3d(5.0 * random(), 0.0, 5.0 * random());
            point.footprint = 0.0F;
            near += static_cast<double>(evaluate(bsdf_at(sand, point), light).value.x()) / count;
            point.footprint = 1.0F;
            far += static_cast<double>(evaluate(bsdf_at(sand, point), light).value.x()) / count;
        }
        worst = std::max(worst, std::abs(far / near - 1.0));
        std::printf("[ ripples ] sun at cosine %.2f: from afar %.4f of the mean from near\n", sun,
                    far / near);
    }
    EXPECT_LT(worst, 0.07); // for the lowest sun, 14 degrees high; 0.03 at 30 degrees
}

} // namespace marram
