// SPDX-License-Identifier: Apache-2.0
// Output of a finished terrain at its samples: vertices, normals, attributes.
#pragma once

#include "procedural/terrain/sand/ripples.h"
#include "procedural/terrain/terrain_instance.h"

namespace marram {

// The attributes are sand, slope and every mask. If a layer makes ripples, its two attributes come last.
inline constexpr uint32_t ripples_attribute = 0, wave_attribute = 1; // after the masks

// Declares the attributes that the layers of `values` will output.
void declare_attributes(TerrainInstance& instance, const Values& values);

// Gradient of the height along x and z, by central differences (one-sided at the border).
Vec2d gradient_at(const TerrainInstance& instance, int i, int j);
double slope_at(const TerrainInstance& instance, int i, int j); // degrees

// The mask values of each mask attribute. If two masks have the same name, the later one is used. NULL: none.
std::vector<const float*> mask_values(const TerrainInstance& instance, const Fields& fields);

// The layer that outputs the attributes "ripples" and "ripple_wave"; nullptr: none.
const RipplesLayer* ripples_of(const TerrainInstance& instance);
// The index of "ripples", or the number of attributes if there are no ripples.
uint32_t first_ripples_attribute(const TerrainInstance& instance);

// The functions below write values for the given samples, in that order. Empty `samples`: all samples.
void write_vertices(const TerrainInstance& instance, std::span<const uint32_t> samples, float* positions,
                    float* normals, float* uvs); // normals, uvs: may be NULL
void write_attribute(const TerrainInstance& instance, uint32_t attribute, std::span<const uint32_t> samples,
                     float* out);
// Writes one of the two ripple attributes. `share`: fraction of the ripples left to shading, a vertex.
// `carried`: from RipplesLayer::carried().
void write_ripples(const RipplesLayer& ripples, uint32_t which,
                   std::span<const RipplesLayer::RippleInputs> carried, std::span<const float> share,
                   float* out);

// The render mesh of a view; implements begin_view() and view_mesh() of the contract. It is the mesh of
// mesher.h, diced where ripples are displaced (dicing.h). write_view() ends the view that begin_view()
// started. Same bits at any thread count.
MarramOutput begin_view(TerrainInstance& instance, const MarramView& view);
void write_view(TerrainInstance& instance, MarramMeshBuffers& buffers);

} // namespace marram
