// SPDX-License-Identifier: Apache-2.0
// What a shader is told about a ray hit: the material there, and its inputs from the attributes of the
// geometry.
#pragma once

#include "core/render/camera.h"
#include "core/render/film.h"
#include "core/render/filter.h"
#include "core/render/integrator.h"
#include "core/render/lights/lights.h"
#include "shaders/shader.h"

#include <array>
#include <span>
#include <vector>

namespace marram {

// Data shared by all samples.
struct RenderContext {
    const World& world;
    const Lights& lights;
    std::span<const Material> materials;
    RenderSettings settings;
    CameraRays camera;
    FilterSampler filter;
    Material default_material;                           // of hits without a material
    std::vector<const AttributeValues*> tint_attributes; // [geometry ID] or nullptr
    std::vector<const AttributeValues*> ids;             // [geometry ID] or nullptr: id of each strand
    std::vector<const AttributeValues*>
        root_uvs; // [geometry ID] or nullptr: surface uv at each strand's root
    std::vector<char>
        uv_tiled; // [geometry ID] true: uvs of a mesh, or at the roots of strands, outside the unit square
    std::vector<std::array<const AttributeValues*, 2>>
        ripples; // [mesh]: both ripple attributes, or nullptr twice
    std::vector<const AttributeValues*>
        layer_attributes; // [geometry ID * film layers + layer] or nullptr: attribute of this layer (AOV)
    bool has_motion_blur;
    float pixel_spread; // metres that a pixel is wide, a metre from the camera, at the image centre
    bool wants_albedo = false;
};

// Sets the attributes in `context` that shading and the film's layers read.
void find_attributes(RenderContext& context, const Film& film);

// The value of an attribute at a ray hit; unused components are 0.
std::array<float, 4> value_at(const RenderContext& context, const AttributeValues& attribute,
                              const SurfacePoint& hit);

// The material at a point. A blend picks one of its two materials by a hash of the position and of the
// direction towards the ray's origin, wo.
const Material& material_at(const RenderContext& context, const SurfacePoint& hit, const Vec3f& wo);

// width: of the ray cone, metres.
ShadingPoint shading_point(const RenderContext& context, const Material& material, const SurfacePoint& hit,
                           const Vec3f& wo, float width);

} // namespace marram
