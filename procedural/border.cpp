// SPDX-License-Identifier: Apache-2.0
#include "procedural/border.h"

namespace marram {

void check_patch_buffers(const MarramPatchBuffers* buffers, uint32_t time_count, bool oriented,
                         size_t attribute_count) {
    if (buffers) check_size(buffers);
    bool valid = buffers && buffers->vertices &&
                 (buffers->attribute_count == 0 || (buffers->attributes && buffers->attribute_values));
    for (uint32_t t = 0; valid && t < time_count; ++t) valid = buffers->vertices[t] != nullptr;
    if (valid && oriented) {
        valid = buffers->normals != nullptr;
        for (uint32_t t = 0; valid && t < time_count; ++t) valid = buffers->normals[t] != nullptr;
    }
    for (uint32_t a = 0; valid && a < buffers->attribute_count; ++a) {
        if (buffers->attributes[a] >= attribute_count)
            throw SceneFault("contract.attribute_range", "",
                             "there is no attribute " + std::to_string(buffers->attributes[a]),
                             "ask for 0 to " + std::to_string(attribute_count - 1));
        valid = buffers->attribute_values[a] != nullptr;
    }
    if (!valid)
        throw SceneFault("contract.null_buffer", "", "a buffer is NULL",
                         "give vertices for each motion sample, normals for oriented ribbons, and "
                         "values for each attribute that is asked for");
}

void check_mesh_buffers(const MarramMeshBuffers* buffers, size_t attribute_count) {
    if (buffers) check_size(buffers);
    bool there = buffers && buffers->positions && buffers->positions[0] && buffers->triangles &&
                 (buffers->attribute_count == 0 || (buffers->attributes && buffers->attribute_values));
    for (uint32_t a = 0; there && a < buffers->attribute_count; ++a) {
        if (buffers->attributes[a] >= attribute_count)
            throw SceneFault("contract.attribute_range", "",
                             "there is no attribute " + std::to_string(buffers->attributes[a]),
                             "ask for 0 to " + std::to_string(attribute_count - 1));
        there = buffers->attribute_values[a] != nullptr;
    }
    if (!there)
        throw SceneFault("contract.null_buffer", "", "a buffer is NULL",
                         "pass positions, triangles and a value buffer for each requested attribute");
}

} // namespace marram
