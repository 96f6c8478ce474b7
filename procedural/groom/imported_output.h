// SPDX-License-Identifier: Apache-2.0
// Imported strands from the lent curves into lanes for SIMD, and from there to the host's buffers.
#pragma once

#include "procedural/groom/imported_instance.h"

#include <span>
#include <vector>

namespace marram {

// Those that are computed, of strands on a mesh.
std::span<const MarramAttribute> computed_attributes();

// The attributes that strands of these settings have: ours, and the file's, whose names point into `settings`.
std::vector<MarramAttribute> import_attribute_list(const ImportSettings& settings);

// Curves of a patch that have one CV count.
struct ImportBatch {
    const ImportInstance& instance;
    const ImportPatch& patch;
    std::span<const uint32_t> curves; // relative to the patch
    uint32_t cvs;

    uint64_t vertex(uint32_t curve) const { // relative to the patch's first
        return instance.curves.first_vertex(patch.first + curve) - instance.curves.first_vertex(patch.first);
    }
    uint64_t cv(uint32_t curve) const {
        return instance.curves.first_cv(patch.first + curve) - instance.curves.first_cv(patch.first);
    }
};

// How the chain gets their rest strands. The batch is copied; what it refers to and the clock must outlive it.
Expand import_expand(const ImportBatch& batch, StageClock& clock);

// One motion sample into the patch's buffers: four floats a vertex, phantoms at both ends included; three a normal.
void write_import_vertices(const ImportBatch& batch, const Strands& strands, float* out);
void write_import_normals(const ImportBatch& batch, const Strands& strands, float* out);

// What is computed, of a batch; and what comes from the file, of a whole patch.
void write_import_attributes(const ImportBatch& batch, const Strands& strands,
                             const MarramPatchBuffers& buffers);
void write_file_attributes(const ImportInstance& instance, const ImportPatch& patch,
                           const MarramPatchBuffers& buffers);

} // namespace marram
