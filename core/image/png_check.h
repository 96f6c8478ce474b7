// SPDX-License-Identifier: Apache-2.0
// Whether a PNG file is whole. The PNG library prints its own complaints to stderr, so it is only given files that it has
// nothing to complain about.
#pragma once

#include <string>

namespace marram {

// "" for a file that is no PNG (does not begin like one) or a whole one: a header first, every chunk inside the file and its
// checksum right, the end chunk there. Else what is wrong with it. Reads the whole file; about 1 GB/s.
std::string png_fault(const std::string& path);

} // namespace marram
