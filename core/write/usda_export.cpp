// SPDX-License-Identifier: Apache-2.0
// Writes curves and meshes as USD text.
#include "core/math/problem.h"
#include "core/write/curve_export.h"
#include "core/write/export_name.h"
#include "core/write/export_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <set>

namespace marram {

// A numeric array of a prim, `components` per element.
struct UsdaArray {
    std::string declaration;        // "point3f[] points"
    const char* interpolation = ""; // metadata; "": none
    uint32_t components = 1;
    bool is_whole = false; // integers stored as floats
    std::vector<float> values;
};

namespace {

void write_array_values(ExportText& text, const UsdaArray& array) {
    text.add("[");
    for (size_t i = 0; i < array.values.size(); i += array.components) {
        const float* one = array.values.data() + i;
        if (i > 0) text.add(", ");
        if (array.components > 1) text.add("(");
        for (uint32_t k = 0; k < array.components; ++k) {
            if (k > 0) text.add(", ");
            if (array.is_whole)
                text.add("{}", std::llrint(double(one[k])));
            else
                text.add("{}", one[k]);
        }
        if (array.components > 1) text.add(")");
    }
    text.add("]");
}

void write_array_metadata(ExportText& text, const UsdaArray& array) {
    if (*array.interpolation)
        text.add(" (\n            interpolation = \"{}\"\n        )", array.interpolation);
    text.add("\n");
}

void write_array(ExportText& text, const UsdaArray& array) {
    text.add("        {} = ", array.declaration);
    write_array_values(text, array);
    write_array_metadata(text, array);
}

// ---- Arrays of a prim

UsdaArray primvar(const AttributeValues& attribute, std::set<std::string>& taken) {
    static constexpr const char* types[] = {"float", "float2", "float3", "float4"};
    static constexpr const char* whole_types[] = {"int64", "int2", "int3", "int4"};
    const bool uniform = attribute.rate == MARRAM_PER_CURVE || attribute.rate == MARRAM_PER_FACE;
    return {fmt::format("{}[] primvars:{}",
                        (attribute.discrete ? whole_types : types)[attribute.components - 1],
                        unique_name(attribute.name, "attribute", taken)),
            uniform ? "uniform" : "vertex", attribute.components, attribute.discrete, attribute.values};
}

// Bounds of the curves. A B-spline stays in the box of its CVs and phantom points. A Catmull-Rom segment can
// leave it: its Bezier points p1 + (p2 - p0) / 6 and p2 - (p3 - p1) / 6 are added.
UsdaArray extent_of(const CurveGeometry& geometry) {
    Box3f box;
    const auto add = [&](const Vec4f& vertex) {
        const Vec3f reach = Vec3f::Constant(std::fabs(vertex[3]));
        box.extend(Vec3f(vertex.head<3>() - reach));
        box.extend(Vec3f(vertex.head<3>() + reach));
    };
    const CurveLayout layout = geometry.layout();
    for (uint64_t c = 0; c < geometry.curve_count; ++c) {
        const uint64_t first = layout.first_vertex(c), end = first + layout.cvs(c) + 2; // phantom points
        const auto vertex = [&](uint64_t v) { return Vec4f(geometry.vertices[0] + v * vertex_floats); };
        for (uint64_t v = first; v < end; ++v) add(vertex(v));
        if (geometry.basis != MARRAM_CATMULL_ROM) continue;
        for (uint64_t v = first + 1; v + 2 < end; ++v) {
            add(vertex(v) + (vertex(v + 1) - vertex(v - 1)) / 6.0F);
            add(vertex(v + 1) - (vertex(v + 2) - vertex(v)) / 6.0F);
        }
    }
    UsdaArray extent{"float3[] extent", "", 3};
    for (const Vec3f& corner : {box.min(), box.max()})
        extent.values.insert(extent.values.end(), corner.data(), corner.data() + 3);
    return extent;
}

// Normals of a ribbon have the layout of its vertices.
UsdaArray normals_of(const CurveGeometry& geometry) {
    UsdaArray normals{"normal3f[] normals", "vertex", 3};
    const CurveLayout layout = geometry.layout();
    normals.values.reserve(3 * layout.cv_count());
    for (uint64_t c = 0; c < geometry.curve_count; ++c) {
        const float* first = geometry.normals[0] + (layout.first_vertex(c) + 1) * 3;
        normals.values.insert(normals.values.end(), first, first + size_t(layout.cvs(c)) * 3);
    }
    return normals;
}

constexpr std::string_view points_declaration = "point3f[] points";

// Calls visit(array) for each array in turn; each is made only then.
template <typename Visit>
void for_each_array(const CurveGeometry& geometry, Visit visit) {
    const size_t cvs = geometry.layout().cv_count();
    if (geometry.curve_count > 0) visit(extent_of(geometry));
    const AttributeValues* id = find_attribute(geometry.attributes, "id");
    if (id && id->rate == MARRAM_PER_CURVE && id->components == 1)
        visit(UsdaArray{"int64[] ids", "", 1, true, id->values});
    if (!geometry.normals.empty() && geometry.normals[0]) visit(normals_of(geometry));
    UsdaArray points{std::string(points_declaration), "", 3};
    points.values.reserve(3 * cvs);
    for_each_cv(geometry, [&](const float* cv) { points.values.insert(points.values.end(), cv, cv + 3); });
    visit(std::move(points));
    std::set<std::string> taken;
    for (const AttributeValues& attribute : geometry.attributes) visit(primvar(attribute, taken));
    UsdaArray widths{"float[] widths", "vertex"};
    widths.values.reserve(cvs);
    for_each_cv(geometry, [&](const float* cv) { widths.values.push_back(2.0F * cv[3]); });
    visit(std::move(widths));
}

std::vector<uint32_t> cv_counts_of(const CurveGeometry& geometry) {
    std::vector<uint32_t> counts(geometry.curve_count);
    for (uint64_t c = 0; c < geometry.curve_count; ++c) counts[c] = geometry.layout().cvs(c);
    return counts;
}

void write_usda_head(ExportText& text, const char* what, double first, double last, double fps) {
    text.add("#usda 1.0\n(\n    defaultPrim = \"marram\"\n    doc = \"{} baked by Marram\"\n", what);
    text.add(
        "    endTimeCode = {}\n    framesPerSecond = {}\n    metersPerUnit = 1\n    startTimeCode = {}\n",
        last, fps, first);
    text.add("    timeCodesPerSecond = {}\n    upAxis = \"Y\"\n)\n\n", fps);
    text.add("def Xform \"marram\"\n{{\n");
}

void write_curves_head(ExportText& text, const std::string& name, MarramBasis basis,
                       const std::vector<uint32_t>& counts) {
    text.add("    def BasisCurves \"{}\"\n    {{\n", name);
    text.add("        uniform token basis = \"{}\"\n",
             basis == MARRAM_CATMULL_ROM ? "catmullRom" : "bspline");
    text.add("        int[] curveVertexCounts = [");
    for (size_t c = 0; c < counts.size(); ++c) text.add("{}{}", c > 0 ? ", " : "", counts[c]);
    text.add("]\n        uniform token type = \"cubic\"\n        uniform token wrap = \"pinned\"\n");
}

} // namespace

void write_usda(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps) {
    check_curves(path, curves);
    ExportText text(path);
    write_usda_head(text, "Curves", frame, frame, fps);
    std::set<std::string> taken;
    for (const CurveGeometry& geometry : curves) {
        write_curves_head(text, unique_name(geometry.name, "curves", taken), geometry.basis,
                          cv_counts_of(geometry));
        for_each_array(geometry, [&](const UsdaArray& array) { write_array(text, array); });
        text.add("    }}\n");
    }
    text.add("}}\n");
    text.commit();
}

// ---- A range of frames

// An array over time: its first values and, once they have changed (or at once, if `always`), the samples of
// all frames, in a temporary file.
class AnimatedUsdaArray {
  public:
    AnimatedUsdaArray(std::string path, UsdaArray first, bool always = false)
        : path_(std::move(path)), first_(std::move(first)), always_(always) {}

    bool is_like(const UsdaArray& other) const {
        return other.declaration == first_.declaration && other.values.size() == first_.values.size();
    }
    bool changes() const { return samples_ != nullptr; }
    const std::string& declaration() const { return first_.declaration; }
    // frames: those of all values so far, including this one.
    void add(const UsdaArray& array, std::span<const double> frames);
    void write(ExportText& text);

  private:
    void add_sample(const UsdaArray& array, double frame) {
        samples_->add("            {}: ", frame);
        write_array_values(*samples_, array);
        samples_->add(",\n");
    }

    bool is_first(const UsdaArray& array) const { // bit-identical
        return array.values.empty() || std::memcmp(array.values.data(), first_.values.data(),
                                                   array.values.size() * sizeof(float)) == 0;
    }

    std::string path_;
    UsdaArray first_;
    bool always_;
    std::unique_ptr<ExportText> samples_;
};

void AnimatedUsdaArray::add(const UsdaArray& array, std::span<const double> frames) {
    if (!samples_ && !always_ && is_first(array)) return;
    if (!samples_) {
        samples_ = std::make_unique<ExportText>(path_);
        for (const double frame : frames.first(frames.size() - 1)) add_sample(first_, frame);
    }
    add_sample(array, frames.back());
}

void AnimatedUsdaArray::write(ExportText& text) {
    if (!samples_) return write_array(text, first_);
    if (*first_.interpolation) {
        text.add("        {}", first_.declaration);
        write_array_metadata(text, first_);
    }
    text.add("        {}.timeSamples = {{\n", first_.declaration);
    text.add_all_of(*samples_);
    text.add("        }}\n");
}

namespace {

// Velocities at the middle of three frames, units per second: the derivative of the parabola through them,
// which is the central difference if they are equally spaced.
UsdaArray central_velocities(std::span<const std::vector<float>, 3> points,
                             std::span<const double, 3> times) {
    UsdaArray velocities{"vector3f[] velocities", "", 3};
    velocities.values.resize(points[0].size());
    const double before = times[1] - times[0], behind = times[2] - times[1];
    const double of_first = behind / (before * (before + behind)),
                 of_second = before / (behind * (before + behind));
    for (size_t n = 0; n < velocities.values.size(); ++n) {
        const double middle = double(points[1][n]);
        velocities.values[n] =
            float(of_first * (middle - double(points[0][n])) + of_second * (double(points[2][n]) - middle));
    }
    return velocities;
}

UsdaArray velocities_between(const std::vector<float>& a, const std::vector<float>& b, double seconds) {
    UsdaArray velocities{"vector3f[] velocities", "", 3};
    velocities.values.resize(a.size());
    for (size_t n = 0; n < a.size(); ++n)
        velocities.values[n] = float((double(b[n]) - double(a[n])) / seconds);
    return velocities;
}

} // namespace

// The curves of a geometry over time.
struct UsdaSequence::Curves {
    std::string name, prim;
    MarramBasis basis;
    std::vector<uint32_t> counts;
    std::vector<AnimatedUsdaArray> arrays;
    std::vector<std::vector<float>> points; // of the last two frames
    std::optional<AnimatedUsdaArray> velocities;
};

UsdaSequence::UsdaSequence(std::string path, double fps) : path_(std::move(path)), fps_(fps), text_(path_) {}

UsdaSequence::~UsdaSequence() = default;

void UsdaSequence::add(std::span<const CurveGeometry> curves, double frame) {
    check_curves(path_, curves);
    const bool is_first = frames_.empty();
    if (!is_first && !(frame > frames_.back())) throw std::invalid_argument("frames of a sequence ascend");
    if (!is_first && curves.size() != curves_.size()) refuse_change("the scene", frame);
    frames_.push_back(frame);
    for (size_t i = 0; i < curves.size(); ++i) {
        if (is_first) {
            Curves& one = curves_.emplace_back();
            one.name = curves[i].name;
            one.prim = unique_name(one.name, "curves", taken_);
            one.basis = curves[i].basis;
            one.counts = cv_counts_of(curves[i]);
        }
        add_curves(curves[i], curves_[i], frame);
    }
}

void UsdaSequence::add_curves(const CurveGeometry& geometry, Curves& curves, double frame) {
    const bool is_first = frames_.size() == 1;
    if (!is_first && (geometry.name != curves.name || geometry.basis != curves.basis ||
                      cv_counts_of(geometry) != curves.counts))
        refuse_change(curves.name, frame);
    size_t next = 0;
    for_each_array(geometry, [&](UsdaArray array) {
        const bool is_points = array.declaration == points_declaration;
        if (is_points) curves.points.push_back(array.values);
        if (is_first) {
            curves.arrays.emplace_back(path_, std::move(array));
            return;
        }
        if (next == curves.arrays.size() || !curves.arrays[next].is_like(array))
            refuse_change(curves.name, frame);
        curves.arrays[next++].add(array, frames_);
    });
    if (!is_first) {
        if (next != curves.arrays.size()) refuse_change(curves.name, frame);
        add_velocities(curves);
    }
}

// Adds the velocities of the frame before the last one, which need the points of the last one. For the first
// frame they are the difference of two frames.
void UsdaSequence::add_velocities(Curves& curves) {
    const size_t count = frames_.size();
    const std::span<const double> frames(frames_);
    if (count == 2) {
        curves.velocities.emplace(
            path_, velocities_between(curves.points[0], curves.points[1], (frames[1] - frames[0]) / fps_),
            true);
        return;
    }
    double times[3];
    for (size_t i = 0; i < 3; ++i) times[i] = frames[count - 3 + i] / fps_;
    curves.velocities->add(central_velocities(std::span<const std::vector<float>, 3>(curves.points),
                                              std::span<const double, 3>(times)),
                           frames.first(count - 1));
    curves.points.erase(curves.points.begin());
}

void UsdaSequence::refuse_change(const std::string& name, double frame) const {
    throw InputError(
        {path_},
        fmt::format("at frame {} the number of curves or CVs of {} differs from the frames before", frame,
                    name),
        "put a #### into the name: a file for each frame; or fix the number of CVs");
}

void UsdaSequence::commit() {
    write_usda_head(text_, "Curves", frames_.front(), frames_.back(), fps_);
    for (Curves& curves : curves_) {
        write_curves_head(text_, curves.prim, curves.basis, curves.counts);
        bool moves = false;
        for (AnimatedUsdaArray& array : curves.arrays) {
            moves = moves || (array.changes() && array.declaration() == points_declaration);
            array.write(text_);
        }
        if (moves) {
            const size_t count = frames_.size();
            curves.velocities->add(velocities_between(curves.points[0], curves.points[1],
                                                      (frames_[count - 1] - frames_[count - 2]) / fps_),
                                   frames_);
            curves.velocities->write(text_);
        }
        text_.add("    }}\n");
    }
    text_.add("}}\n");
    text_.commit();
}

// ---- Meshes

namespace {

void write_usda_mesh(ExportText& text, const MeshGeometry& mesh, const std::string& name) {
    text.add("    def Mesh \"{}\"\n    {{\n        int[] faceVertexCounts = [", name);
    for (size_t i = 0; i < mesh.triangles.size(); ++i) text.add("{}3", i > 0 ? ", " : "");
    text.add("]\n        int[] faceVertexIndices = [");
    for (size_t i = 0; i < mesh.triangles.size(); ++i)
        text.add("{}{}, {}, {}", i > 0 ? ", " : "", mesh.triangles[i][0], mesh.triangles[i][1],
                 mesh.triangles[i][2]);
    text.add("]\n");
    const auto array = [&](const char* declaration, const char* interpolation, const auto& vectors) {
        if (vectors.empty()) return;
        UsdaArray all{declaration, interpolation, uint32_t(vectors.front().size())};
        for (const auto& v : vectors) all.values.insert(all.values.end(), v.data(), v.data() + v.size());
        write_array(text, all);
    };
    if (!mesh.normals.empty()) array("normal3f[] normals", "vertex", mesh.normals[0]);
    array("point3f[] points", "", mesh.positions.at(0));
    std::set<std::string> taken;
    for (const AttributeValues& attribute : mesh.attributes) write_array(text, primvar(attribute, taken));
    array("texCoord2f[] primvars:st", "vertex", mesh.uvs);
    text.add("        uniform token subdivisionScheme = \"none\"\n    }}\n");
}

} // namespace

void write_colliders_usda(const std::string& path, std::span<const MeshGeometry> meshes, double frame,
                          double fps) {
    ExportText text(path);
    write_usda_head(text, "Colliders", frame, frame, fps);
    std::set<std::string> taken;
    for (const MeshGeometry& mesh : meshes)
        write_usda_mesh(text, mesh, unique_name(mesh.name, "mesh", taken));
    text.add("}}\n");
    text.commit();
}

} // namespace marram
