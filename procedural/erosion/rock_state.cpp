// SPDX-License-Identifier: Apache-2.0
// The state of an eroded rock: its mesh, its attributes, and what it reports.
#include "procedural/abi/state_bytes.h"
#include "procedural/erosion/rock_instance.h"

#include <utility>

namespace marram {
namespace {

constexpr uint64_t rock_state_format = 0x6d617272616d5202; // the last byte is the format version

// Those fields of a GrainReport that a rock reports. Seconds are not kept: they are those of this run.
struct StoredGrainReport {
    uint64_t grains = 0, rays = 0, hits = 0;
    int64_t worn = 0;
    double volume = 0.0;
};

// True if the sizes of the lists match and indices are in range.
bool sizes_and_indices_valid(const RockInstance& rock) {
    const size_t vertices = rock.positions.size() / 3;
    if (rock.positions.size() != 3 * vertices || rock.normals.size() != 3 * vertices ||
        rock.triangles.size() % 3 != 0 || rock.wear.size() != vertices || rock.rate.size() != vertices ||
        rock.hardness.size() != vertices)
        return false;
    for (const uint32_t v : rock.triangles)
        if (v >= vertices) return false;
    return true;
}

} // namespace

std::vector<char> write_rock_state(const RockInstance& rock, uint64_t digest) {
    StateWriter out;
    out.add(rock_state_format);
    out.add(digest);
    RockErosion erosion = rock.erosion;
    erosion.seconds = 0.0;
    out.add(erosion);
    out.add(StoredGrainReport{rock.grains.grains, rock.grains.rays, rock.grains.worn_hits, rock.grains.worn,
                              rock.grains.volume});
    out.add_list(rock.positions);
    out.add_list(rock.normals);
    out.add_list(rock.triangles);
    out.add_list(rock.wear);
    out.add_list(rock.rate);
    out.add_list(rock.hardness);
    return std::move(out.bytes);
}

bool read_rock_state(std::span<const char> bytes, uint64_t digest, RockInstance& instance) {
    StateReader in(bytes);
    uint64_t format = 0, stored_digest = 0;
    RockInstance rock;
    StoredGrainReport grains;
    in.get(format);
    in.get(stored_digest);
    if (format != rock_state_format || stored_digest != digest) return false;
    in.get(rock.erosion);
    in.get(grains);
    in.get_list(rock.positions);
    in.get_list(rock.normals);
    in.get_list(rock.triangles);
    in.get_list(rock.wear);
    in.get_list(rock.rate);
    in.get_list(rock.hardness);
    if (!in.at_end() || !sizes_and_indices_valid(rock)) return false;
    instance.eroded = true;
    instance.erosion = rock.erosion;
    instance.positions = std::move(rock.positions);
    instance.normals = std::move(rock.normals);
    instance.uvs.clear();
    instance.triangles = std::move(rock.triangles);
    instance.wear = std::move(rock.wear);
    instance.rate = std::move(rock.rate);
    instance.hardness = std::move(rock.hardness);
    instance.grains = {};
    instance.grains.grains = grains.grains;
    instance.grains.rays = grains.rays;
    instance.grains.worn_hits = grains.hits;
    instance.grains.worn = grains.worn;
    instance.grains.volume = grains.volume;
    return true;
}

} // namespace marram
