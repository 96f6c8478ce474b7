// SPDX-License-Identifier: Apache-2.0
#include "procedural/abi/border.h"

namespace marram {
namespace {

// True if there is a buffer for each attribute that is asked for.
template <typename Buffers>
bool has_attribute_buffers(const Buffers& buffers, size_t attribute_count) {
    if (buffers.attribute_count > 0 && !(buffers.attributes && buffers.attribute_values)) return false;
    bool there = true;
    for (uint32_t a = 0; there && a < buffers.attribute_count; ++a) {
        if (buffers.attributes[a] >= attribute_count)
            throw SceneFault("contract.attribute_range", "",
                             "there is no attribute " + std::to_string(buffers.attributes[a]),
                             "ask for 0 to " + std::to_string(attribute_count - 1));
        there = buffers.attribute_values[a] != nullptr;
    }
    return there;
}

} // namespace

MarramStatus report_exception(const MarramHost& host, const std::string& subject, const char* memory_remedy) {
    const auto fault = [&](const std::string& id, const std::string& what, const char* remedy) {
        send(host, MARRAM_FAULT, id.c_str(), "", what, remedy);
    };
    constexpr const char* bug = "report it as a bug of the library";
    try {
        throw;
    } catch (const SceneFault& error) {
        send(host, MARRAM_FAULT, error.id.c_str(), error.place, error.what(), error.remedy);
    } catch (const std::bad_alloc&) {
        fault(subject + ".memory", "there is not enough memory for the " + subject, memory_remedy);
    } catch (const UnsetSize& error) {
        fault("contract.size", error.what(), "set it to the size of the struct");
    } catch (const std::exception& error) {
        fault(subject + ".internal", error.what(), bug);
    } catch (...) {
        fault(subject + ".internal", "an exception of an unknown type", bug);
    }
    return MARRAM_ERROR;
}

void check_patch_buffers(const MarramPatchBuffers* buffers, uint32_t time_count, bool oriented,
                         size_t attribute_count) {
    if (buffers) check_size(buffers);
    bool there = buffers && buffers->vertices && (!oriented || buffers->normals);
    for (uint32_t t = 0; there && t < time_count; ++t)
        there = buffers->vertices[t] && (!oriented || buffers->normals[t]);
    if (!there || !has_attribute_buffers(*buffers, attribute_count))
        throw SceneFault("contract.null_buffer", "", "a buffer is NULL",
                         "give vertices for each motion sample, normals for oriented ribbons, and "
                         "values for each attribute that is asked for");
}

void check_mesh_buffers(const MarramMeshBuffers* buffers, size_t attribute_count) {
    if (buffers) check_size(buffers);
    const bool there = buffers && buffers->positions && buffers->positions[0] && buffers->triangles;
    if (!there || !has_attribute_buffers(*buffers, attribute_count))
        throw SceneFault("contract.null_buffer", "", "a buffer is NULL",
                         "pass positions, triangles and a value buffer for each requested attribute");
}

} // namespace marram
