// SPDX-License-Identifier: Apache-2.0
#include "core/math/digest.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace marram {

uint64_t digest_bytes(const void* bytes, size_t count, uint64_t seed) {
    return count == 0 ? seed : XXH3_64bits_withSeed(bytes, count, seed);
}

} // namespace marram
