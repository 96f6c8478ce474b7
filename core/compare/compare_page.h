// SPDX-License-Identifier: Apache-2.0
// One page for a browser about two pictures: the verdict, both with swap and slider, where they differ, how much, the worst place
// magnified, what the files say of themselves. Needs nothing beside it: no network, no other file.
#pragma once

#include "core/compare/compare.h"

#include <string>

namespace marram {

struct ComparedFile {
    std::string path;
    Picture picture;
};

std::string compare_page(const ComparedFile& test, const ComparedFile& reference,
                         const Comparison& comparison);

} // namespace marram
