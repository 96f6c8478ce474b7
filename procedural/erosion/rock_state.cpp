// SPDX-License-Identifier: Apache-2.0
// The state of an eroded rock: its mesh, its attributes, and what it reports.
#include "procedural/abi/state_bytes.h"
#include "procedural/erosion/rock_instance.h"

#include <utility>

namespace marram {
namespace {

constexpr uint64_t rock_state_format = 0x6d617272616d5202; // the last byte is the format version

void visit_fields(auto& rock, auto& erosion, auto& visit) {
    visit(erosion, rock.grains.grains, rock.grains.rays, rock.grains.worn_hits, rock.grains.worn,
          rock.grains.volume, rock.positions, rock.normals, rock.triangles, rock.wear, rock.rate,
          rock.hardness);
}

// True if the sizes of the lists match and indices are in range.
bool sizes_and_indices_valid(const RockSurface& rock) {
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

std::vector<char> write_rock_state(const RockSurface& rock, uint64_t digest) {
    RockErosion erosion = rock.erosion;
    erosion.seconds = 0.0; // of this run
    StateWriter out;
    out(rock_state_format, digest);
    visit_fields(rock, erosion, out);
    return std::move(out.bytes);
}

bool read_rock_state(std::span<const char> bytes, uint64_t digest, RockSurface& rock) {
    StateReader in(bytes);
    uint64_t format = 0, stored_digest = 0;
    in(format, stored_digest);
    if (format != rock_state_format || stored_digest != digest) return false;
    RockSurface stored;
    visit_fields(stored, stored.erosion, in);
    if (!in.at_end() || !sizes_and_indices_valid(stored)) return false;
    stored.eroded = true;
    rock = std::move(stored);
    return true;
}

} // namespace marram
