// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/curve_export.h"

#include "core/geometry/export_name.h"
#include "core/geometry/hair_format.h"
#include "core/image/atomic_file.h"
#include "core/math/problem.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <set>
#include <span>

namespace marram {

namespace {

constexpr size_t vertex_floats = 4;             // x, y, z, radius
constexpr size_t chunk_bytes = size_t(1) << 16; // of text gathered before it is written

[[noreturn]] void refuse(const std::string& path, const std::string& what, const std::string& fix) {
    throw InputError(Place{path}, what, fix);
}

// The first CV of a curve at the first motion sample; the others follow, 4 floats each.
const float* first_cv(const CurveGeometry& geometry, uint64_t curve) {
    return geometry.vertices[0] + (geometry.layout().first_vertex(curve) + 1) * vertex_floats;
}

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
                           "report this: no scene should lead here");
    }
}

// Text on its way into a file.
class Text {
  public:
    explicit Text(const std::string& path) : writer_(path) { buffer_.reserve(2 * chunk_bytes); }

    template <typename... Values>
    void add(fmt::format_string<Values...> format, Values&&... values) {
        fmt::format_to(std::back_inserter(buffer_), format, std::forward<Values>(values)...);
        if (buffer_.size() >= chunk_bytes) flush();
    }
    void commit() {
        flush();
        writer_.commit();
    }

  private:
    void flush() {
        writer_.write(buffer_.data(), buffer_.size());
        buffer_.clear();
    }

    AtomicFile writer_;
    fmt::basic_memory_buffer<char> buffer_;
};

} // namespace

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

// For each CV of all curves `count` floats, made by `pick(cv, to)`.
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

// ---- USD

// "name = [a, b, ...]", one element from each add().
class UsdArray {
  public:
    UsdArray(Text& text, const char* declaration) : text_(text) { text_.add("        {} = [", declaration); }
    template <typename... Values>
    void add(fmt::format_string<Values...> format, Values&&... values) {
        text_.add("{}", first_ ? "" : ", ");
        text_.add(format, std::forward<Values>(values)...);
        first_ = false;
    }
    void end(const char* interpolation) {
        text_.add("]");
        if (*interpolation) text_.add(" (\n            interpolation = \"{}\"\n        )", interpolation);
        text_.add("\n");
    }

  private:
    Text& text_;
    bool first_ = true;
};

template <typename Visit>
void for_each_cv(const CurveGeometry& geometry, Visit visit) {
    for (uint64_t c = 0; c < geometry.curve_count; ++c) {
        const float* cv = first_cv(geometry, c);
        for (uint32_t i = 0; i < geometry.layout().cvs(c); ++i) visit(cv + i * vertex_floats);
    }
}

// The box of what is drawn: a pinned curve can leave its CVs' box by no more than the phantom points do.
void write_extent(Text& text, const CurveGeometry& geometry) {
    Box3f box;
    const uint64_t vertices = geometry.layout().vertex_count();
    for (uint64_t v = 0; v < vertices; ++v) {
        const float* vertex = geometry.vertices[0] + v * vertex_floats;
        const Vec3f centre(vertex[0], vertex[1], vertex[2]), reach = Vec3f::Constant(std::fabs(vertex[3]));
        box.extend(Vec3f(centre - reach));
        box.extend(Vec3f(centre + reach));
    }
    if (box.isEmpty()) return;
    text.add("        float3[] extent = [({}, {}, {}), ({}, {}, {})]\n", box.min().x(), box.min().y(),
             box.min().z(), box.max().x(), box.max().y(), box.max().z());
}

// Attributes as primvars. Discrete ones of one number are whole numbers that travel as floats.
void write_primvars(Text& text, const std::vector<AttributeValues>& attributes) {
    static constexpr const char* types[] = {"float", "float2", "float3", "float4"};
    std::set<std::string> taken;
    for (const AttributeValues& attribute : attributes) {
        const bool whole = attribute.discrete && attribute.components == 1;
        const bool uniform = attribute.rate == MARRAM_PER_CURVE || attribute.rate == MARRAM_PER_FACE;
        const std::string declaration =
            fmt::format("{}[] primvars:{}", whole ? "int64" : types[attribute.components - 1],
                        unique_name(attribute.name, "attribute", taken));
        UsdArray values(text, declaration.c_str());
        for (size_t i = 0; i < attribute.values.size(); i += attribute.components) {
            const std::span one(attribute.values.data() + i, attribute.components);
            if (whole)
                values.add("{}", std::llrint(double(one[0])));
            else if (one.size() == 1)
                values.add("{}", one[0]);
            else
                values.add("({})", fmt::join(one, ", "));
        }
        values.end(uniform ? "uniform" : "vertex");
    }
}

// A ribbon's normals have the layout of its vertices.
void write_normals(Text& text, const CurveGeometry& geometry) {
    if (geometry.normals.empty() || !geometry.normals[0]) return;
    UsdArray normals(text, "normal3f[] normals");
    const CurveLayout layout = geometry.layout();
    for (uint64_t c = 0; c < geometry.curve_count; ++c)
        for (uint32_t i = 0; i < layout.cvs(c); ++i) {
            const float* n = geometry.normals[0] + (layout.first_vertex(c) + 1 + i) * 3;
            normals.add("({}, {}, {})", n[0], n[1], n[2]);
        }
    normals.end("vertex");
}

void write_basis_curves(Text& text, const CurveGeometry& geometry, const std::string& name) {
    text.add("    def BasisCurves \"{}\"\n    {{\n", name);
    text.add("        uniform token basis = \"{}\"\n",
             geometry.basis == MARRAM_CATMULL_ROM ? "catmullRom" : "bspline");
    UsdArray counts(text, "int[] curveVertexCounts");
    for (uint64_t c = 0; c < geometry.curve_count; ++c) counts.add("{}", geometry.layout().cvs(c));
    counts.end("");
    write_extent(text, geometry);
    write_normals(text, geometry);
    UsdArray points(text, "point3f[] points");
    for_each_cv(geometry, [&](const float* cv) { points.add("({}, {}, {})", cv[0], cv[1], cv[2]); });
    points.end("");
    write_primvars(text, geometry.attributes);
    text.add("        uniform token type = \"cubic\"\n");
    UsdArray widths(text, "float[] widths");
    for_each_cv(geometry, [&](const float* cv) { widths.add("{}", 2.0f * cv[3]); });
    widths.end("vertex");
    text.add("        uniform token wrap = \"pinned\"\n    }}\n");
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

namespace {

void write_usda_head(Text& text, const char* what, double frame, double fps) {
    text.add("#usda 1.0\n(\n    defaultPrim = \"marram\"\n    doc = \"{} baked by Marram\"\n", what);
    text.add(
        "    endTimeCode = {}\n    framesPerSecond = {}\n    metersPerUnit = 1\n    startTimeCode = {}\n",
        frame, fps, frame);
    text.add("    timeCodesPerSecond = {}\n    upAxis = \"Y\"\n)\n\n", fps);
    text.add("def Xform \"marram\"\n{{\n");
}

} // namespace

void write_usda(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps) {
    check_curves(path, curves);
    Text text(path);
    write_usda_head(text, "Curves", frame, fps);
    std::set<std::string> taken;
    for (const CurveGeometry& geometry : curves)
        write_basis_curves(text, geometry, unique_name(geometry.name, "curves", taken));
    text.add("}}\n");
    text.commit();
}

void write_curves_obj(const std::string& path, std::span<const CurveGeometry> curves) {
    check_curves(path, curves);
    Text text(path);
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
    const std::string extension = std::filesystem::path(path).extension().string();
    if (extension == ".hair") return write_hair(path, curves);
    if (extension == ".usda") return write_usda(path, curves, frame, fps);
    if (extension == ".obj") return write_curves_obj(path, curves);
    refuse(path, fmt::format("curves cannot be written as \"{}\"", extension), "use .hair, .usda or .obj");
}

namespace {

void write_usd_mesh(Text& text, const MeshGeometry& mesh, const std::string& name) {
    text.add("    def Mesh \"{}\"\n    {{\n", name);
    UsdArray counts(text, "int[] faceVertexCounts");
    for (size_t i = 0; i < mesh.triangles.size(); ++i) counts.add("3");
    counts.end("");
    UsdArray indices(text, "int[] faceVertexIndices");
    for (const auto& t : mesh.triangles) indices.add("{}, {}, {}", t[0], t[1], t[2]);
    indices.end("");
    if (!mesh.normals.empty()) {
        UsdArray normals(text, "normal3f[] normals");
        for (const Vec3f& n : mesh.normals[0]) normals.add("({}, {}, {})", n.x(), n.y(), n.z());
        normals.end("vertex");
    }
    UsdArray points(text, "point3f[] points");
    for (const Vec3f& p : mesh.positions.at(0)) points.add("({}, {}, {})", p.x(), p.y(), p.z());
    points.end("");
    write_primvars(text, mesh.attributes);
    if (!mesh.uvs.empty()) {
        UsdArray uvs(text, "texCoord2f[] primvars:st");
        for (const Vec2f& uv : mesh.uvs) uvs.add("({}, {})", uv.x(), uv.y());
        uvs.end("vertex");
    }
    text.add("        uniform token subdivisionScheme = \"none\"\n    }}\n");
}

} // namespace

void write_colliders_usda(const std::string& path, std::span<const MeshGeometry> meshes, double frame,
                          double fps) {
    Text text(path);
    write_usda_head(text, "Colliders", frame, fps);
    std::set<std::string> taken;
    for (const MeshGeometry& mesh : meshes) write_usd_mesh(text, mesh, unique_name(mesh.name, "mesh", taken));
    text.add("}}\n");
    text.commit();
}

void write_colliders_obj(const std::string& path, std::span<const MeshGeometry> meshes) {
    Text text(path);
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
