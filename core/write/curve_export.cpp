// SPDX-License-Identifier: Apache-2.0
#include "core/write/curve_export.h"
#include "core/math/file_types.h"

#include "core/math/problem.h"
#include "core/read/hair_format.h"
#include "core/write/export_name.h"
#include "core/write/export_text.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <set>
#include <span>

namespace marram {

namespace {

[[noreturn]] void refuse(const std::string& path, const std::string& what, const std::string& fix) {
    throw InputError(Place{path}, what, fix);
}

} // namespace

void check_curves(const std::string& path, std::span<const CurveGeometry> curves) {
    for (const CurveGeometry& geometry : curves) {
        if (geometry.curve_count == 0) continue;
        if (geometry.vertices.empty() || !geometry.vertices[0])
            refuse(path, fmt::format("the curves of \"{}\" were not made", geometry.name),
                   "build the frame first");
        const CurveLayout layout = geometry.layout();
        for (uint64_t c = 0; c < geometry.curve_count; ++c)
            if (layout.cvs(c) < 2)
                refuse(path, fmt::format("the curves of \"{}\" have {} CVs", geometry.name, layout.cvs(c)),
                       "a curve needs at least 2");
        for (uint64_t c = 0; c < geometry.curve_count; ++c)
            for (uint64_t i = 0; i < layout.cvs(c) * vertex_floats; ++i)
                if (!std::isfinite(first_cv(geometry, c)[i]))
                    refuse(path, fmt::format("curve {} of \"{}\" is not finite", c, geometry.name),
                           "report this: it is an error of the renderer");
    }
}

void ExportText::add_all_of(ExportText& other) {
    flush();
    other.flush();
    const int64_t size = other.file_.size();
    other.file_.seek(0);
    std::vector<char> bytes(size_t(1) << 20);
    for (int64_t left = size; left > 0;) {
        const size_t count = other.file_.get(bytes.data(), bytes.size());
        if (count == 0) refuse(path_, "what was written for it cannot be read back", "check the disk");
        file_.write(bytes.data(), count);
        left -= int64_t(count);
    }
}

std::string unique_name(const std::string& name, const char* fallback, std::set<std::string>& taken) {
    std::string clean;
    for (char c : name) {
        const bool digit = c >= '0' && c <= '9';
        const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
        if (clean.empty() && digit) clean = "_";
        clean += digit || letter ? c : '_';
    }
    if (clean.empty()) clean = fallback;
    std::string unique = clean;
    for (int number = 1; !taken.insert(unique).second; ++number) unique = fmt::format("{}_{}", clean, number);
    return unique;
}

namespace {

// ---- HAIR

HairHeader hair_header(const std::string& path, std::span<const CurveGeometry> curves) {
    HairHeader header;
    header.flags = hair_points | hair_thickness;
    uint64_t strands = 0, points = 0;
    bool first = true;
    for (const CurveGeometry& geometry : curves) {
        if (geometry.curve_count == 0) continue;
        const CurveLayout layout = geometry.layout();
        for (uint64_t c = 0; c < (layout.offsets ? layout.curve_count : 1); ++c) {
            const uint32_t segments = layout.cvs(c) - 1;
            if (segments > std::numeric_limits<uint16_t>::max())
                refuse(path,
                       fmt::format("the curves of \"{}\" have {} CVs, .hair holds 65536", geometry.name,
                                   segments + 1),
                       "write .usda");
            if (first) header.default_segments = segments;
            if (segments != header.default_segments) header.flags |= hair_segments;
            first = false;
        }
        strands += geometry.curve_count;
        points += layout.cv_count();
    }
    if (points > std::numeric_limits<uint32_t>::max())
        refuse(path, fmt::format("{} points, .hair holds 4294967295", points),
               "write .usda, or fewer curves");
    header.strands = uint32_t(strands);
    header.points = uint32_t(points);
    return header;
}

// Writes `count` floats for each CV of all curves, set by `pick(cv, to)`.
template <typename Pick>
void write_cvs(AtomicFile& writer, std::span<const CurveGeometry> curves, size_t count, Pick pick) {
    std::vector<float> row;
    for (const CurveGeometry& geometry : curves)
        for (uint64_t c = 0; c < geometry.curve_count; ++c) {
            const float* cv = first_cv(geometry, c);
            const uint32_t cvs = geometry.layout().cvs(c);
            row.resize(cvs * count);
            for (size_t i = 0; i < cvs; ++i) pick(cv + i * vertex_floats, row.data() + i * count);
            writer.write(row.data(), row.size() * sizeof(float));
        }
}

} // namespace

void write_hair(const std::string& path, std::span<const CurveGeometry> curves) {
    check_curves(path, curves);
    const HairHeader header = hair_header(path, curves);
    AtomicFile writer(path);
    writer.write(&header, sizeof(header));
    if (header.flags & hair_segments)
        for (const CurveGeometry& geometry : curves) {
            for (uint64_t c = 0; c < geometry.curve_count; ++c) {
                const auto segments = uint16_t(geometry.layout().cvs(c) - 1);
                writer.write(&segments, sizeof(segments));
            }
        }
    write_cvs(writer, curves, 3, [](const float* cv, float* to) { std::memcpy(to, cv, 3 * sizeof(float)); });
    write_cvs(writer, curves, 1, [](const float* cv, float* to) { *to = 2.0f * cv[3]; });
    writer.commit();
}

void write_curves_obj(const std::string& path, std::span<const CurveGeometry> curves) {
    check_curves(path, curves);
    ExportText text(path);
    text.add("# Curves baked by Marram: y up, metres\n");
    std::set<std::string> taken;
    uint64_t first = 1;
    for (const CurveGeometry& geometry : curves) {
        text.add("o {}\n", unique_name(geometry.name, "curves", taken));
        for_each_cv(geometry, [&](const float* cv) { text.add("v {} {} {}\n", cv[0], cv[1], cv[2]); });
        for (uint64_t c = 0; c < geometry.curve_count; ++c) {
            text.add("l");
            for (uint32_t i = 0; i < geometry.layout().cvs(c); ++i) text.add(" {}", first++);
            text.add("\n");
        }
    }
    text.commit();
}

void write_curves(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps) {
    const std::string extension = extension_of(path);
    if (extension == ".hair") return write_hair(path, curves);
    if (extension == ".usda") return write_usda(path, curves, frame, fps);
    if (extension == ".ply") return write_curves_ply(path, curves);
    if (extension == ".obj") return write_curves_obj(path, curves);
    refuse(path, fmt::format("curves cannot be written as \"{}\"", extension),
           "use " + listed_files(baked_strand_files));
}

void write_colliders_obj(const std::string& path, std::span<const MeshGeometry> meshes) {
    ExportText text(path);
    text.add("# Meshes baked by Marram: y up, metres\n");
    std::set<std::string> taken;
    uint64_t first = 1, first_uv = 1, first_normal = 1;
    for (const MeshGeometry& mesh : meshes) {
        const bool has_normals = !mesh.normals.empty() && !mesh.normals[0].empty();
        text.add("o {}\n", unique_name(mesh.name, "mesh", taken));
        for (const Vec3f& p : mesh.positions.at(0)) text.add("v {} {} {}\n", p.x(), p.y(), p.z());
        for (const Vec2f& uv : mesh.uvs) text.add("vt {} {}\n", uv.x(), uv.y());
        if (has_normals)
            for (const Vec3f& n : mesh.normals[0]) text.add("vn {} {} {}\n", n.x(), n.y(), n.z());
        for (const std::array<uint32_t, 3>& triangle : mesh.triangles) {
            text.add("f");
            for (uint32_t v : triangle) {
                text.add(" {}", first + v);
                if (!mesh.uvs.empty() || has_normals) text.add("/");
                if (!mesh.uvs.empty()) text.add("{}", first_uv + v);
                if (has_normals) text.add("/{}", first_normal + v);
            }
            text.add("\n");
        }
        first += mesh.positions[0].size();
        first_uv += mesh.uvs.size();
        first_normal += has_normals ? mesh.normals[0].size() : 0;
    }
    text.commit();
}

} // namespace marram
