// SPDX-License-Identifier: Apache-2.0
// Copies imported strands from the host's curves to their SIMD layout and from there to the host's buffers.
#pragma once

#include "procedural/strands/imported/imported_instance.h"

#include <span>
#include <vector>

namespace marram {

// The computed attributes of strands on a mesh.
std::span<const MarramAttribute> computed_attributes();

// All attributes of strands with these settings: computed ones and those of the file, whose names point into
// `settings`.
std::vector<MarramAttribute> import_attribute_list(const ImportSettings& settings);
bool asks_for_contact(const ImportInstance& instance, const MarramPatchBuffers& buffers);

// Curves of a patch with equal CV count.
struct ImportBatch {
    const ImportInstance& instance;
    const ImportPatch& patch;
    const MeshInstance& mesh_instance;
    std::span<const uint32_t> curves; // relative to the patch
    uint32_t cvs;

    uint64_t vertex(uint32_t curve) const { // relative to the patch's first vertex
        return instance.curves.first_vertex(patch.first + curve) - instance.curves.first_vertex(patch.first);
    }
    uint64_t cv(uint32_t curve) const {
        return instance.curves.first_cv(patch.first + curve) - instance.curves.first_cv(patch.first);
    }
};

// Callbacks that give the chain the batch's rest strands. The batch is copied; the data it refers to and the
// clock must outlive the result.
RestStrandSource imported_rest_strands(const ImportBatch& batch, StageClock& clock);

// Write one motion sample to the patch's buffers, including the phantom CVs at both ends: four floats per
// vertex, three per normal.
void write_import_vertices(const ImportBatch& batch, const Strands& strands, float* out);
void write_import_normals(const ImportBatch& batch, const Strands& strands, float* out);

// Write the computed attributes of a batch, and the file's attributes of a whole patch.
void write_import_attributes(const ImportBatch& batch, const Strands& strands,
                             const MarramPatchBuffers& buffers);
void write_file_attributes(const ImportInstance& instance, const ImportPatch& patch,
                           const MarramPatchBuffers& buffers);

} // namespace marram
