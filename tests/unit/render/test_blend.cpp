// SPDX-License-Identifier: Apache-2.0
// Two materials on one mesh, blended by an attribute: the mean is their mixture, and where the ramp is 0 or 1
// only one is used.
#include "core/render/integrator.h"
#include "tests/unit/render/world_builder.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

using testing::Triangles;
using testing::WorldBuilder;

Material grey_material(float value) {
    DiffuseSettings settings;
    settings.color.color = Vec3f::Constant(value);
    return {settings, ""};
}

// A square from x = -1 to 1 whose attribute rises from 0 to 1. The ramp rises from a quarter to three
// quarters.
TEST(Blend, IsTheMixtureThatTheRampSays) {
    WorldBuilder builder;
    const Triangles square = testing::quad({-1.0, -1.0, 0.0}, {2.0, 0.0, 0.0}, {0.0, 2.0, 0.0});
    builder.mesh({square.positions}, square.triangles, 2);
    AttributeValues sand{"sand", 1, MARRAM_PER_VERTEX, {}};
    for (const Vec3f& p : square.positions) sand.values.push_back(0.5F * (p.x() + 1.0F));
    builder.world.meshes[0].attributes = {sand};
    BlendSettings blend;
    blend.materials[0] = 0;
    blend.materials[1] = 3; // another blend, of black and black
    blend.attribute = "sand";
    constexpr double knots[] = {0.25, 0.0, 0.75, 1.0};
    blend.ramp = Ramp(knots, "linear");
    BlendSettings inner = blend;
    inner.materials[0] = inner.materials[1] = 1;
    const std::vector<Material> materials = {
        grey_material(0.8F), grey_material(0.0F), {blend, ""}, {inner, ""}};
    Camera camera;
    camera.poses = {look_at({0.0, 0.0, 100.0}, Vec3d::Zero(), Vec3d::UnitY())};
    camera.vertical_fov = 2.0 * std::atan(1.0 / 100.0);
    RenderSettings settings;
    settings.samples = 4096;
    settings.max_depth = 1;
    settings.filter = {FilterKind::box, 0.5};
    constexpr uint32_t size = 16;
    const std::vector<std::string> names = {"beauty", "albedo", "sand"};
    const World& world = builder.commit();
    Film film = make_film(size, size, names, world);
    const std::vector<LightDescription> sky = {SkyLight{}};
    render(world, Lights(sky, world), materials, camera, settings, film, nullptr);
    for (uint32_t x = 0; x < size; ++x) {
        const double attribute = (x + 0.5) / size, share = std::clamp((attribute - 0.25) * 2.0, 0.0, 1.0);
        const size_t at = (size / 2) * size + x;
        EXPECT_NEAR(film.layers[2].values[at], attribute, 2e-3) << x;
        // Four standard deviations of a fraction in 4,096 samples; none where only one material is used.
        const double allowed = 1e-3 + (share > 0.0 && share < 1.0 ? 0.8 * 4.0 * 0.5 / 64.0 : 0.0);
        EXPECT_NEAR(film.layers[1].values[3 * at], 0.8 * (1.0 - share), allowed) << x;
    }
}

} // namespace
} // namespace marram
