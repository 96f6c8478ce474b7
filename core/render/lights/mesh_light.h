// SPDX-License-Identifier: Apache-2.0
// Light: mesh. A mesh that emits from its outer side.
//
//   parameter    unit          default             meaning
//   mesh         -             required            name of the mesh
//   radiance     W/(m^2 sr)    1                   constant over directions, on the outer side
//
//   [[light]]
//   name = "lamp"
//   type = "mesh"
//   mesh = "panel"
//   radiance = 12
//
// Triangles are sampled by their mean area over the shutter, points on them uniformly. The pdf uses the area
// of the triangle at the ray's time: P(triangle) / area(t) . distance^2 / cos. Uniform point on a triangle:
// Turk, "Graphics Gems", 1990.
#pragma once

#include "core/render/distribution.h"
#include "core/render/lights/light_type.h"

#include <utility>

namespace marram {

// Meshes whose MeshGeometry::light is the index of this light emit from their front faces.
struct MeshLight {
    Vec3f radiance = Vec3f::Ones();
};

class MeshSampler {
  public:
    static constexpr bool at_infinity = false;
    // The world must outlive the sampler.
    MeshSampler(const MeshLight& light, uint32_t index, const World& world);
    double power(double scene_radius) const;
    void sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const;
    // At a ray hit. `choice`: probability of choosing this light, a factor of the pdf.
    LightRadiance along_ray(const SurfacePoint& point, const Vec3f& direction, double choice) const;

  private:
    struct Triangle {
        uint32_t mesh, triangle;
    };
    const World* world_;
    Vec3f radiance_;
    std::vector<Triangle> triangles_;
    Distribution1D by_area_;
    std::vector<std::pair<uint32_t, size_t>> first_of_mesh_; // geometry ID, index of its first triangle
};

std::vector<ParamSpec> mesh_light_params();
MeshLight make_mesh_light(const ParamSet& params);

} // namespace marram
