// SPDX-License-Identifier: Apache-2.0
// Shared by the writers of curves only.
#pragma once

#include "core/geometry/world.h"
#include "core/image/atomic_file.h"

#include <fmt/format.h>

#include <iterator>
#include <span>
#include <string>
#include <utility>

namespace marram {

inline constexpr size_t vertex_floats = 4; // x, y, z, radius

// The first CV of a curve at the first motion sample; the others follow, 4 floats each.
inline const float* first_cv(const CurveGeometry& geometry, uint64_t curve) {
    return geometry.vertices[0] + (geometry.layout().first_vertex(curve) + 1) * vertex_floats;
}

template <typename Visit>
void for_each_cv(const CurveGeometry& geometry, Visit visit) {
    for (uint64_t c = 0; c < geometry.curve_count; ++c) {
        const float* cv = first_cv(geometry, c);
        for (uint32_t i = 0; i < geometry.layout().cvs(c); ++i) visit(cv + i * vertex_floats);
    }
}

// Throws InputError for curves that cannot be written: not made, too short, not finite.
void check_curves(const std::string& path, std::span<const CurveGeometry> curves);

// Buffered text output to a file.
class ExportText {
  public:
    explicit ExportText(const std::string& path) : path_(path), file_(path) {
        buffer_.reserve(2 * chunk_bytes);
    }
    template <typename... Values>
    void add(fmt::format_string<Values...> format, Values&&... values) {
        fmt::format_to(std::back_inserter(buffer_), format, std::forward<Values>(values)...);
        if (buffer_.size() >= chunk_bytes) flush();
    }
    // Appends the text of `other`, which serves as a temporary file and is never committed.
    void add_all_of(ExportText& other);
    void commit() {
        flush();
        file_.commit();
    }

  private:
    static constexpr size_t chunk_bytes = size_t(1) << 16; // gathered before it is written
    void flush() {
        file_.write(buffer_.data(), buffer_.size());
        buffer_.clear();
    }

    std::string path_;
    AtomicFile file_;
    fmt::basic_memory_buffer<char> buffer_;
};

} // namespace marram
