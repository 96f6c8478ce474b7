// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/scene_meshes.h"
#include "core/read/mesh_file.h"

#include "core/geometry/mesh_sides.h"
#include "core/image/data_image.h"
#include "core/math/frame_name.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"
#include "core/world/build.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

namespace marram {
namespace {

Vec2f vec2f(const ParamSet& params, std::string_view name) { return params.vec2(name).cast<float>(); }
Vec3f vec3f(const ParamSet& params, std::string_view name) { return params.vec3(name).cast<float>(); }

// Heights from the first channel of an image, resampled to (divisions + 1)^2 if the scene gives divisions.
Mesh load_heightfield(const ParamSet& params, std::vector<Problem>& warnings) {
    std::vector<std::string> notes;
    const Image image = read_data_image(params.text("image"), notes);
    for (const std::string& note : notes)
        warnings.push_back({{params.text("image")}, note, "", "image.data"});
    const bool resample = params.has("divisions");
    const int width = resample ? params.integer("divisions") + 1 : image.width;
    const int height = resample ? params.integer("divisions") + 1 : image.height;
    const auto pixel = [&](int x, int y) {
        return double(image.pixels[(size_t(y) * size_t(image.width) + size_t(x)) * size_t(image.channels)]);
    };
    std::vector<float> heights(size_t(width) * size_t(height));
    for (int j = 0; j < height; ++j)
        for (int i = 0; i < width; ++i) {
            const double x = width > 1 ? double(i) * (image.width - 1) / (width - 1) : 0.0;
            const double y = height > 1 ? double(j) * (image.height - 1) / (height - 1) : 0.0;
            const int x0 = std::min(int(x), image.width - 1), y0 = std::min(int(y), image.height - 1);
            const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
            const double fx = x - x0, fy = y - y0;
            heights[size_t(j) * size_t(width) + size_t(i)] =
                float((1 - fy) * ((1 - fx) * pixel(x0, y0) + fx * pixel(x1, y0)) +
                      fy * ((1 - fx) * pixel(x0, y1) + fx * pixel(x1, y1)));
        }
    return heightfield_mesh(heights, width, height, vec2f(params, "size"), float(params.number("height")));
}

Mesh built_in_mesh(const Item& item, std::vector<Problem>& warnings) {
    const ParamSet& params = item.params;
    if (item.type == "plane") return plane_mesh(vec2f(params, "size"), params.integer("divisions"));
    if (item.type == "box") return box_mesh(vec3f(params, "size"));
    if (item.type == "sphere")
        return sphere_mesh(float(params.number("radius")), params.integer("divisions"),
                           float(params.number("bumps")), float(params.number("frequency")));
    return load_heightfield(params, warnings);
}

// One line for triangles that were turned, one for closed parts that are inside out.
void warn_of_sides(const Item& item, const MeshSides& sides, size_t triangles,
                   std::vector<Problem>& warnings) {
    const Place& place = item.params.at("file").place;
    const auto at = [](const Vec3f& p) {
        return fmt::format("({:.4g}, {:.4g}, {:.4g})", p.x(), p.y(), p.z());
    };
    if (sides.turned > 0)
        warnings.push_back(
            {place,
             fmt::format(
                 "mesh \"{}\": {} of {} triangles are wound against their neighbours or their vertex "
                 "normals, the first at {} of the file: they are turned, and strands grow on the side "
                 "of the majority of each connected part",
                 item.name, sides.turned, triangles, at(sides.first_turned)),
             "make the winding consistent where the mesh was made", "mesh.winding"});
    if (sides.inside_out == 0 || item.params.boolean("flip")) return;
    const bool all = sides.inside_out == sides.closed_parts;
    warnings.push_back(
        {place,
         fmt::format(
             "mesh \"{}\" is inside out: {} (negative volume), so strands grow inwards", item.name,
             all ? "it is closed and its triangles face inwards"
                 : fmt::format("the triangles of {} of its {} closed parts face inwards, those of the "
                               "first at {} of the file",
                               sides.inside_out, sides.closed_parts, at(sides.first_inside_out))),
         all ? "add flip = true to the mesh" : "turn these parts where the mesh was made",
         "mesh.inside_out"});
}

Mesh load_mesh_item(const Item& item, std::vector<Problem>& warnings) {
    const bool flip = item.params.boolean("flip");
    if (item.type != "file") {
        Mesh mesh = built_in_mesh(item, warnings);
        if (flip) flip_sides(mesh);
        return mesh;
    }
    MeshSides sides;
    Mesh mesh = load_mesh(
        numbered_files(item).front().second,
        {.smooth = item.params.boolean("smooth"), .flip = flip, .sides = &sides, .warnings = &warnings});
    warn_of_sides(item, sides, mesh.triangles.size(), warnings);
    return mesh;
}

} // namespace

std::vector<std::pair<double, std::string>> numbered_files(const Item& item) {
    const ParamSet& params = item.params;
    std::vector<std::pair<double, std::string>> files;
    if (!params.has("file_frames")) return {{0.0, params.text("file")}};
    const Vec2d range = params.vec2("file_frames");
    for (double frame = range.x(); frame <= range.y(); frame += 1.0)
        files.emplace_back(frame, numbered(params.text("file"), frame));
    return files;
}

Mesh load_scene_mesh(const Item& item, std::vector<Problem>& warnings) {
    try {
        return load_mesh_item(item, warnings);
    } catch (const InputError& error) {
        std::vector<Problem> problems = error.problems;
        for (Problem& problem : problems)
            if (problem.place.file.empty()) problem.place = item.place;
        throw InputError(std::move(problems));
    }
}

namespace {

// Vertices in the layout of MarramCurves. The radius is half the width.
std::vector<float> vertices_of(const StrandSample& sample, const std::vector<uint64_t>& offsets) {
    const size_t curves = offsets.size() - 1;
    std::vector<float> vertices(4 * (offsets.back() + 2 * curves));
    tbb::parallel_for(tbb::blocked_range<size_t>(0, curves, 1024), [&](const auto& range) {
        for (size_t c = range.begin(); c < range.end(); ++c) {
            const uint64_t first = offsets[c], count = offsets[c + 1] - first;
            float* to = vertices.data() + 4 * (first + 2 * c);
            for (uint64_t i = 0; i < count; ++i) {
                const Vec3f& p = sample.points[first + i];
                float* vertex = to + 4 * (i + 1);
                for (int axis = 0; axis < 3; ++axis) vertex[axis] = p[axis];
                vertex[3] = sample.widths.empty() ? 0.0F : 0.5F * sample.widths[first + i];
            }
            for (size_t k = 0; k < 4; ++k) {
                to[k] = 2.0F * to[4 + k] - to[8 + k];
                to[4 * (count + 1) + k] = 2.0F * to[4 * count + k] - to[4 * (count - 1) + k];
            }
        }
    });
    return vertices;
}

// Warnings about the files of one item, each reported once.
class FileWarnings {
  public:
    explicit FileWarnings(std::vector<Problem>& all) : all_(all) {}
    void add(const std::string& file, const std::string& what) {
        if (reported_.insert(what).second) all_.push_back({{file}, what, "", "curves.file"});
    }

  private:
    std::vector<Problem>& all_;
    std::set<std::string> reported_;
};

// Refuses files that cannot be the same strands at different frames, whatever their counts.
void check_same_kind(const std::string& file, const StrandFile& strands, const std::string& first_file,
                     const StrandFile& first) {
    const std::string fix = "export every frame from the same groom";
    if (strands.basis != first.basis)
        throw InputError({file}, fmt::format("its curve basis differs from that of '{}'", first_file), fix);
    if (strands.samples.front().widths.empty() != first.samples.front().widths.empty())
        throw InputError({file}, fmt::format("either it or '{}' has widths, the other has none", first_file),
                         fix);
}

std::vector<uint64_t> offsets_of(const StrandFile& strands) {
    std::vector<uint64_t> offsets{0};
    offsets.reserve(strands.counts.size() + 1);
    for (const uint32_t count : strands.counts) offsets.push_back(offsets.back() + count);
    return offsets;
}

// The files of one item, read one after the other.
class StrandSequence {
  public:
    StrandSequence(const Item& item, double fps, const std::atomic<bool>& cancel,
                   std::vector<Problem>& warnings)
        : files_(numbered_files(item)), cancel_(cancel), warnings_(warnings) {
        const ParamSet& params = item.params;
        reading_ = {fps, params.at("prims").texts,
                    params.has("cvs_per_strand") ? uint32_t(params.integer("cvs_per_strand")) : 0,
                    params.boolean("reverse")};
    }
    void read(SceneCurves& curves);

  private:
    StrandFile load(size_t i);
    bool add_samples(StrandFile& first, SceneCurves& curves);
    void add_take(double frame, const std::string& file, StrandFile strands, SceneCurves& curves);

    std::vector<std::pair<double, std::string>> files_;
    const std::atomic<bool>& cancel_;
    FileWarnings warnings_;
    StrandReading reading_;
};

StrandFile StrandSequence::load(size_t i) {
    if (cancel_.load()) throw Cancelled{};
    StrandFile strands = load_strand_file(files_[i].second, reading_);
    for (const std::string& warning : strands.warnings) warnings_.add(files_[i].second, warning);
    return strands;
}

// Strands that are the same at all frames and move from one to the next. False if their counts change.
bool StrandSequence::add_samples(StrandFile& first, SceneCurves& curves) {
    curves.offsets = offsets_of(first);
    if (files_.size() == 1) {
        for (const StrandSample& sample : first.samples)
            curves.samples.push_back({sample.frame, vertices_of(sample, curves.offsets)});
    } else {
        curves.samples.push_back({files_[0].first, vertices_of(first.samples.front(), curves.offsets)});
        if (first.samples.size() > 1)
            warnings_.add(files_[0].second,
                          "has motion samples: only the first sample of each file of file_frames is used");
    }
    for (size_t i = 1; i < files_.size(); ++i) {
        const auto& [frame, file] = files_[i];
        const StrandFile strands = load(i);
        check_same_kind(file, strands, files_[0].second, first);
        if (strands.counts != first.counts) return false;
        for (const AttributeValues& attribute : first.attributes) {
            const AttributeValues* same = find_attribute(strands.attributes, attribute.name);
            if (!same || same->values != attribute.values)
                warnings_.add(file, fmt::format("\"{}\" is not as in the first file, whose values are taken",
                                                attribute.name));
        }
        curves.samples.push_back({frame, vertices_of(strands.samples.front(), curves.offsets)});
    }
    curves.closed.assign(first.counts.size(), 0);
    const bool is_static = curves.samples.size() == 1;
    curves.vertices =
        is_static ? std::move(curves.samples.front().vertices) : curves.samples.front().vertices;
    if (is_static) curves.samples.clear();
    curves.attributes = std::move(first.attributes);
    return true;
}

// All takes have the attributes of the first.
void StrandSequence::add_take(double frame, const std::string& file, StrandFile strands,
                              SceneCurves& curves) {
    CurvesTake take{frame, offsets_of(strands), {}, {}};
    take.vertices = vertices_of(strands.samples.front(), take.offsets);
    const auto& wanted = curves.takes.empty() ? strands.attributes : curves.takes.front().attributes;
    for (const AttributeValues& one : wanted) {
        const AttributeValues* same = find_attribute(strands.attributes, one.name);
        if (!same || same->components != one.components || same->rate != one.rate)
            throw InputError({file},
                             fmt::format("its strands have no \"{}\" as those of the first frame", one.name),
                             "export every frame from the same groom");
        take.attributes.push_back(*same);
    }
    curves.takes.push_back(std::move(take));
}

void StrandSequence::read(SceneCurves& curves) {
    StrandFile first = load(0);
    curves.basis = first.basis;
    if (files_.size() == 1 && !first.takes.empty()) {
        for (StrandFile& take : first.takes) {
            const double frame = take.samples.front().frame; // read before the take is moved
            add_take(frame, files_[0].second, std::move(take), curves);
        }
    } else if (!add_samples(first, curves)) {
        curves.samples.clear();
        for (size_t i = 0; i < files_.size(); ++i) {
            StrandFile strands = load(i);
            check_same_kind(files_[i].second, strands, files_[0].second, first);
            add_take(files_[i].first, files_[i].second, std::move(strands), curves);
        }
    }
    if (curves.takes.empty()) return;
    warnings_.add(files_[0].second,
                  "its strands or CVs change over time: each frame has those of its time, without "
                  "motion blur of their own");
    curves.offsets = {0};
    curves.select_take(curves.takes.front().frame);
}

} // namespace

SceneCurves load_scene_curves(const Item& item, double fps, const std::atomic<bool>& cancel,
                              std::vector<Problem>& warnings) {
    SceneCurves curves;
    curves.name = item.name;
    if (item.type == "strands") {
        const ParamValue& keys = item.params.at("transform");
        curves.transform = KeyedTransform(keys.numbers, keys.text);
        StrandSequence(item, fps, cancel, warnings).read(curves);
        return curves;
    }
    const bool closed = item.params.boolean("closed");
    const auto add = [&](const std::vector<Vec3d>& points, bool ring, const Place& place) {
        if (points.size() < 2) throw InputError(place, "a curve has fewer than 2 points", "give 2 or more");
        curves.add(points, closed || ring);
    };
    if (item.type == "file") {
        const std::string& file = item.params.text("file");
        std::vector<std::string> left_out;
        for (const Polyline& line : load_polylines(file, item.params.at("prims").texts, &left_out))
            add(line.points, line.closed, {file});
        FileWarnings of_file(warnings);
        for (const std::string& warning : left_out) of_file.add(file, warning);
    } else {
        const ParamValue& value = item.params.at("points");
        std::vector<Vec3d> points;
        for (size_t i = 0; i < value.numbers.size(); i += 3) points.emplace_back(value.numbers.data() + i);
        add(points, false, value.place);
    }
    return curves;
}

std::vector<MeshShape> load_shapes(const Item& item, const Mesh& first, const std::atomic<bool>& cancel) {
    const auto files = numbered_files(item);
    std::vector<MeshShape> shapes;
    if (files.size() < 2) return shapes;
    shapes.push_back({files[0].first, first.positions, first.normals});
    for (size_t i = 1; i < files.size(); ++i) {
        if (cancel.load()) throw Cancelled{};
        const auto& [frame, file] = files[i];
        Mesh mesh = load_mesh(file, {.smooth = item.params.boolean("smooth"),
                                     .flip = item.params.boolean("flip"),
                                     .first_shape = &first});
        if (mesh.triangles != first.triangles && mesh.triangles.size() == first.triangles.size() &&
            mesh.positions.size() == first.positions.size())
            throw InputError(
                {file}, fmt::format("its triangles join other vertices than those of '{}'", files[0].second),
                "a mesh that deforms keeps its triangles: export every frame from the same mesh");
        if (mesh.triangles != first.triangles || mesh.positions.size() != first.positions.size() ||
            mesh.normals.size() != first.normals.size())
            throw InputError(
                {file},
                fmt::format("has {} triangles of {} vertices that are not those of '{}', {} of {}",
                            mesh.triangles.size(), mesh.positions.size(), files[0].second,
                            first.triangles.size(), first.positions.size()),
                "a mesh that deforms keeps its triangles: export every frame from the same mesh");
        shapes.push_back({frame, std::move(mesh.positions), std::move(mesh.normals)});
    }
    return shapes;
}

} // namespace marram
