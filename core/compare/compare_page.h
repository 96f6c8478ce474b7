// SPDX-License-Identifier: Apache-2.0
// HTML page that compares two pictures: the verdict, both pictures with swap and slider, difference maps,
// values, the worst region magnified, and the files' metadata. Self-contained: needs no network and no other
// file.
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
