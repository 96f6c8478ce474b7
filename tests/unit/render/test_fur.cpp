// SPDX-License-Identifier: Apache-2.0
// Multiple scattering in fur against a plain random walk: a separate loop over intersect, spawn and the
// fibre's values, with fresh random numbers, an eighth of the directions uniform over the sphere, no light
// sampling and no roulette. The picture is compared in bands: numbers that are correlated from fibre to fibre
// move light within the fur, and can leave its mean unchanged.
// leave the whole as it was.
#include "tests/unit/render/world_builder.h"
#include "tests/unit/shaders/default_params.h"

#include "core/render/integrator.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <random>

namespace marram {
namespace {

using testing::Cv;
using testing::Triangles;
using testing::WorldBuilder;

constexpr uint32_t side = 32, bands = 4; // pixels; bands of rows
constexpr uint32_t max_depth = 12;

// Fur of 0.2 m, bent and combed to one side, on a brown floor, seen from the side from root to tip, as dense
// as a coat.
World& fur(WorldBuilder& builder, MarramShape shape) {
    const Triangles floor = testing::quad({-3.0, 0.0, 3.0}, {6.0, 0.0, 0.0}, {0.0, 0.0, -6.0});
    builder.mesh({floor.positions}, floor.triangles);
    std::mt19937_64 generator(5);
    std::uniform_real_distribution<double> number(-1.0, 1.0);
    std::vector<Cv> cvs;
    for (int strand = 0; strand < 6000; ++strand) {
        const double x = 0.6 * number(generator), z = 0.3 * number(generator);
        const double lean = 0.08 + 0.03 * number(generator), aside = 0.04 * number(generator);
        for (int i = 0; i < 5; ++i) {
            const double u = 0.25 * i;
            cvs.emplace_back(x + aside * u, 0.2 * u * (1.0 - 0.2 * u), z + lean * u * u,
                             0.0025 * (1.0 - 0.7 * u));
        }
    }
    builder.curves({cvs}, 5, shape, MARRAM_CATMULL_ROM, 1);
    return builder.commit();
}

SkyLight sky() {
    SkyLight sky;
    sky.zenith = {1.2F, 1.5F, 2.0F};
    sky.horizon = {0.6F, 0.4F, 0.3F};
    sky.ground = {0.02F, 0.02F, 0.02F};
    return sky;
}

Camera camera() {
    Camera camera;
    camera.poses = {look_at(Vec3d(0.0, 0.35, 1.6), Vec3d(0.0, 0.08, 0.0), Vec3d::UnitY())};
    camera.vertical_fov = 10.0 * degree;
    return camera;
}

ShadingPoint shading_point(const SurfacePoint& hit, const Vec3f& wo) {
    ShadingPoint point;
    point.wo = wo;
    point.sidedness_normal = hit.geometric_normal;
    point.normal = hit.normal;
    point.tangent = hit.tangent;
    point.uv = hit.uv;
    point.position = hit.position;
    point.fibre = hit.shape != PointShape::triangle;
    point.flat = hit.shape == PointShape::ribbon;
    point.h = hit.h;
    point.strand_u = hit.strand_u;
    return point;
}

// The random numbers for a fibre's longitudinal directions.
enum class Numbers {
    free,
    stepped // the path's first ones, offset by a fixed step at each fibre: a planted fault
};

struct Walk {
    const World& world;
    const std::vector<Material>& materials;
    SkyLight light = sky();
    Numbers numbers = Numbers::free;
    std::mt19937_64 generator{11};

    float number() {
        return std::uniform_real_distribution<float>(0.0F, std::nextafter(1.0F, 0.0F))(generator);
    }

    Vec3f radiance(Ray ray) {
        constexpr float even = 0.25F / static_cast<float>(pi), share = 0.125F;
        Vec3f throughput = Vec3f::Ones();
        float along = number(), turn = number();
        for (uint32_t depth = 0;; ++depth) {
            SurfacePoint hit;
            if (!intersect(world, ray, hit, false))
                return throughput.cwiseProduct(sky_radiance(light, ray.direction));
            if (depth == max_depth) return Vec3f::Zero();
            const Bsdf bsdf =
                bsdf_at(materials[static_cast<size_t>(hit.material)], shading_point(hit, -ray.direction));
            along = next(along, 0.165F);
            turn = next(turn, 0.031F);
            BsdfSample drawn;
            if (number() < share) {
                const float z = 2.0F * number() - 1.0F, r = std::sqrt(1.0F - z * z);
                const float phi = 2.0F * static_cast<float>(pi) * number();
                drawn.wi = Vec3f(r * std::cos(phi), r * std::sin(phi), z).normalized();
                const BsdfValue at = evaluate(bsdf, drawn.wi);
                drawn.value = at.value;
                drawn.pdf = at.pdf;
            } else if (!sample(bsdf, {along, number(), number(), turn}, drawn)) {
                return Vec3f::Zero();
            }
            throughput = throughput.cwiseProduct(drawn.value) / ((1.0F - share) * drawn.pdf + share * even);
            if (!(throughput.maxCoeff() > 0.0F)) return Vec3f::Zero();
            ray = spawn(hit, drawn.wi, ray.time);
        }
    }

  private:
    float next(float value, float step) {
        if (numbers == Numbers::free) return number();
        value += step;
        return value < 1.0F ? value : value - 1.0F;
    }
};

struct Band {
    double mean = 0.0, variance = 0.0; // of the mean
};
using Bands = std::array<Band, bands>;

// The bands over `rounds` pictures. `value(i)` gives those of the i-th, with its own random numbers.
template <class Value>
Bands over(int rounds, const Value& value) {
    Bands sums;
    for (int i = 0; i < rounds; ++i) {
        const std::array<double, bands> one = value(i);
        for (uint32_t b = 0; b < bands; ++b) {
            sums[b].mean += one[b] / rounds;
            sums[b].variance += one[b] * one[b] / rounds;
        }
    }
    for (Band& band : sums) band.variance = (band.variance - band.mean * band.mean) / (rounds - 1);
    return sums;
}

Bands rendered(const World& world, const std::vector<Material>& materials) {
    const std::vector<LightDescription> described = {sky()};
    const Lights lights(described, world);
    const std::vector<std::string> layers = {"beauty"};
    RenderSettings settings;
    settings.filter = {FilterKind::box, 0.5};
    settings.samples = 16;
    settings.max_depth = max_depth;
    return over(16, [&](int round) {
        settings.seed = static_cast<uint64_t>(round);
        Film film = make_film(side, side, layers, world);
        render(world, lights, materials, camera(), settings, film);
        std::array<double, bands> sums{};
        const std::vector<float>& pixels = film.layers[0].values;
        for (size_t i = 0; i < pixels.size(); ++i)
            sums[i * bands / pixels.size()] += double(pixels[i]) * bands / double(pixels.size());
        return sums;
    });
}

Bands walked(const World& world, const std::vector<Material>& materials, Numbers numbers, uint32_t samples) {
    const CameraRays rays(camera(), side, side);
    Walk walk{world, materials};
    walk.numbers = numbers;
    return over(16, [&](int) {
        std::array<double, bands> sums{};
        for (uint32_t y = 0; y < side; ++y)
            for (uint32_t i = 0; i < side * samples; ++i) {
                const double v = y + walk.number();
                const Ray ray = rays((i % side + double(walk.number())) / side, v / side, {0.5F, 0.5F}, 0.0F);
                sums[y * bands / side] += double(mean(walk.radiance(ray))) * bands / (side * side * samples);
            }
        return sums;
    });
}

class Fur : public ::testing::TestWithParam<MarramShape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, Fur, ::testing::Values(MARRAM_ROUND, MARRAM_RIBBON));

TEST_P(Fur, LightFromFibreToFibreIsThatOfARandomWalk) {
    WorldBuilder builder;
    const World& world = fur(builder, GetParam());
    DiffuseSettings brown;
    brown.color.color = Vec3f(0.35F, 0.22F, 0.15F);
    Material skin;
    skin.settings = brown;
    const std::vector<Material> materials = {
        skin, testing::material_of("hair", {{"color", "[0.6, 0.5, 0.4]"}, {"roughness", "0.35"}})};
    const Bands marram = rendered(world, materials);
    const Bands free = walked(world, materials, Numbers::free, 16);
    const Bands stepped = walked(world, materials, Numbers::stepped, 4);
    double worst = 0.0;
    for (uint32_t b = 0; b < bands; ++b) {
        const double deviation = std::sqrt(marram[b].variance + free[b].variance);
        const double planted = std::sqrt(marram[b].variance + stepped[b].variance);
        std::printf("[ fur ] band %u: %.5f, random walk %.5f, +- %.5f; walk of stepped numbers %.5f\n", b,
                    marram[b].mean, free[b].mean, deviation, stepped[b].mean);
        EXPECT_LT(deviation, 1.5e-2 * free[b].mean);
        EXPECT_NEAR(marram[b].mean, free[b].mean, 4.0 * deviation);
        worst = std::max(worst, std::abs(marram[b].mean - stepped[b].mean) / planted);
    }
    EXPECT_GT(worst, 8.0); // the fault would be found
}

} // namespace
} // namespace marram
