// SPDX-License-Identifier: Apache-2.0
// Lights: what a scene says of them, and the tables from which they are sampled. Daylight has a page of its own:
// shaders/daylight.h.
//
//   sun, a disc at infinity, seen and sampled
//     direction    -             [1, 2, 1]           towards it, of any length
//     angle        deg           0.53                its diameter: larger makes shadows softer; 0: parallel rays, not seen
//     irradiance   W/m2          3                   on a plane that faces it, whatever its angle; 3.14 shows white as 1
//
//   sky, a gradient over the whole sphere: it changes fastest near the horizon
//     zenith       W/(m2 sr)     [0.25, 0.45, 0.9]   straight above
//     horizon      W/(m2 sr)     [0.8, 0.87, 0.95]
//     ground       W/(m2 sr)     [0.2, 0.18, 0.15]   below
//     strength     1             1                   factor on all three
//
//   environment, an image all around, sampled by how bright it is where
//     file         -                                 latitude by longitude, twice as wide as high. Rows run from +y down; the
//                                                    middle column is where -z points, +x is to the right of it
//     strength     1             1                   factor: numbers of the file are W/(m2 sr)
//     rotation     deg           0                   about y: turns what is at -z towards -x
//
//   mesh, a mesh that shines from its outer side
//     mesh         -                                 its name
//     radiance     W/(m2 sr)     1                   the same in all directions
//
//   [[light]]
//   name = "studio"
//   type = "environment"
//   file = "../textures/studio.exr"
//   rotation = 30
//
// In a scene: scenes/run scenes/golden/room.toml has a sun and a sky; scenes/run scenes/golden/room.toml --set
// 'light.sky.type="environment"' --set 'light.sky.file="../textures/studio.exr"' an image in the sky's place, --set
// 'light.lamp.radiance=12' a mesh that shines.
//
// To add a light: a struct and a place in LightDescription, its table in Lights, and its case in each
// function of lights.cpp.
#pragma once

#include "core/geometry/hit.h"
#include "core/render/distribution.h"

#include <array>
#include <span>
#include <variant>
#include <vector>

namespace marram {

struct SunLight {
    Vec3d direction = Vec3d::UnitY(); // towards the sun, any length
    double angle = 0.533 * degree;    // angular diameter, radians, 0 ... pi; 0: parallel rays, invisible
    Vec3f irradiance = Vec3f::Ones(); // W/m2 on a plane that faces it, whatever its angle
    bool visible = true;              // to camera rays
};

// Radiance: zenith to horizon as 1 - (1 - y)^3 of the direction's height y (it changes fastest near the
// horizon), ground below, which the horizon blends into over the first 0.1 of -y. Alike colours give exactly
// that colour everywhere.
struct SkyLight {
    Vec3f zenith = Vec3f::Ones(), horizon = Vec3f::Ones(), ground = Vec3f::Ones();
    float strength = 1.0F;
    bool visible = true;
};

// A latitude-longitude image: rows from the top (+y), its centre column where -z points, +x to the right of
// that.
struct EnvironmentLight {
    uint32_t width = 0, height = 0;
    std::vector<Vec3f> pixels; // finite and >= 0
    double rotation = 0.0;     // radians about y: turns the world's image from -z towards -x
    float strength = 1.0F;
    bool visible = true;
};

// The meshes whose MeshGeometry::light is this light's index shine from their front faces.
struct MeshLight {
    Vec3f radiance = Vec3f::Ones();
};

using LightDescription = std::variant<SunLight, SkyLight, EnvironmentLight, MeshLight>;

struct LightSample {
    Vec3f radiance = Vec3f::Zero();
    Vec3f direction = Vec3f::UnitY(); // unit, from the point; of lights at infinity
    float pdf = 0.0F;                 // solid angle, choice of the light included; 0: nothing arrives
    bool delta = false; // can only be reached this way: no weighting against the shader's sampling
    bool at_infinity = true;
    Vec3d target = Vec3d::Zero(); // a point on an emitting mesh, moved off it by its error
    float unused =
        0.0F; // a uniform number, independent of the others: what the choice of the light has left of its own
};

class Lights {
  public:
    Lights() = default;
    // The world must outlive the lights: emitting triangles are read from it.
    Lights(std::span<const LightDescription> descriptions, const World& world);

    bool empty() const { return choice_.empty(); }

    // One light and a point of it, seen from `from`: 3 uniform numbers.
    LightSample sample(const Vec3d& from, float time, const std::array<float, 3>& random) const;

    // What a ray that escapes sees of all lights at infinity. `weight(pdf)` is asked for each light with the
    // density with which sample() would have chosen the direction (0: never). visible_only: camera rays.
    template <typename Weight>
    Vec3f escaped(const Vec3f& direction, bool visible_only, Weight&& weight) const {
        Vec3f sum = Vec3f::Zero();
        for (const uint32_t light : infinite_) {
            const Seen seen = seen_along(light, direction, visible_only);
            if (seen.pdf >= 0.0F) sum += seen.radiance * weight(seen.pdf);
        }
        return sum;
    }

    // What a ray sees of the emitting mesh that it has hit, and the density with which sample() would have
    // chosen it.
    struct Seen {
        Vec3f radiance = Vec3f::Zero();
        float pdf = -1.0F; // below 0: not seen
    };
    Seen emitted(const SurfacePoint& point, const Vec3f& direction) const;

  private:
    struct EmittingTriangle {
        uint32_t mesh, triangle;
    };
    struct Emitter { // one mesh light
        Vec3f radiance;
        std::vector<EmittingTriangle> triangles;
        Distribution1D by_area;
        std::vector<std::pair<uint32_t, size_t>> first_of_mesh; // geometry ID, index of its first triangle
    };
    struct Sun {
        Vec3d direction, x, y;   // orthonormal
        double half_angle, rise; // 1 - cos half_angle
        Vec3f radiance;          // irradiance where delta
        float pdf;
        bool delta, visible;
    };
    struct Sky {
        SkyLight colors;
        Distribution1D by_height;
    };
    struct Environment {
        EnvironmentLight image;
        uint32_t shift; // blocks are 2^shift pixels each way
        size_t columns; // of blocks
        Distribution2D by_block;
        std::vector<double> cosines;  // of the borders of the blocks' rows, from 1 to -1
        std::vector<float> densities; // per solid angle, of each block
    };
    using Table = std::variant<Sun, Sky, Environment, Emitter>;

    static Sun make(const SunLight& light);
    static Sky make(const SkyLight& light);
    static Environment make(const EnvironmentLight& light);
    static Emitter make(const MeshLight& light, uint32_t index, const World& world);
    static double power(const Table& table, double scene_radius);

    Seen seen_along(uint32_t light, const Vec3f& direction, bool visible_only) const;
    static void sample_sun(const Sun& sun, float a, float b, LightSample& sample);
    static void sample_sky(const Sky& sky, float a, float b, LightSample& sample);
    static void sample_environment(const Environment& map, float a, float b, LightSample& sample);
    void sample_emitter(const Emitter& emitter, const Vec3d& from, float time, float a, float b,
                        LightSample& sample) const;

    const World* world_ = nullptr;
    std::vector<Table> tables_;
    std::vector<uint32_t> infinite_;
    Distribution1D choice_;
};

Vec3f sky_radiance(const SkyLight& sky, const Vec3f& direction);
Vec3f environment_radiance(const EnvironmentLight& map, const Vec3f& direction);

} // namespace marram
