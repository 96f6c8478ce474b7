// SPDX-License-Identifier: Apache-2.0
// What a finished terrain hands over at its samples: vertices, normals, attributes.
#pragma once

#include "procedural/terrain/ripples.h"
#include "procedural/terrain/terrain_instance.h"

namespace marram {

// The attributes are sand, slope and every mask, and, where a layer makes ripples, these two last.
inline constexpr uint32_t ripples_attribute = 0, wave_attribute = 1; // after the masks

// Names what the layers of `values` will hand out.
void declare_attributes(TerrainInstance& instance, const Values& values);

// Of the height along x and z, from central differences (one-sided at the border).
Vec2d gradient_at(const TerrainInstance& instance, int i, int j);
double slope_at(const TerrainInstance& instance, int i, int j); // degrees

// The mask that each mask attribute is: of two of one name the later one. NULL: none.
std::vector<const float*> mask_values(const TerrainInstance& instance, const Fields& fields);

// The ripples that make the attributes "ripples" and "ripple_wave"; nullptr: none.
const RipplesLayer* ripples_of(const TerrainInstance& instance);
// The index of the first of the two, or as many attributes as there are.
uint32_t first_ripples_attribute(const TerrainInstance& instance);

// What follows is for samples: of all where `samples` is empty, in their order.
void write_vertices(const TerrainInstance& instance, std::span<const uint32_t> samples, float* positions,
                    float* normals, float* uvs); // normals, uvs: NULL where they are not wanted
void write_attribute(const TerrainInstance& instance, uint32_t attribute, std::span<const uint32_t> samples,
                     float* out);
// One of the two of ripples, of which `share` is left to shade; `carried` as of the layer.
void write_ripples(const RipplesLayer& ripples, uint32_t which,
                   std::span<const RipplesLayer::Carried> carried, std::span<const float> share, float* out);

// Throws SceneFault where what a host gives to be filled is not whole.
void check_mesh_buffers(const TerrainInstance& instance, const MarramMeshBuffers* buffers);

// The render mesh for a view, begin_view() and view_mesh() of the contract: the mesher's, cut fine where ripples are displaced (dicing.h). The
// second ends what the first began. Same bits at any thread count.
MarramOutput begin_view(TerrainInstance& instance, const MarramView& view);
void write_view(TerrainInstance& instance, MarramMeshBuffers& buffers);

} // namespace marram
