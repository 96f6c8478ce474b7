// SPDX-License-Identifier: Apache-2.0
#include "procedural/abi/contract_checks.h"

#include "core/math/known_part.h"
#include "core/math/nearest_point.h"
#include "core/math/vec.h"
#include "procedural/abi/param.h"
#include "procedural/abi/values.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

namespace marram {
namespace {

// A fault and its remedy. `what` is "" if there is no fault.
struct Fault {
    std::string what, remedy;
    explicit operator bool() const { return !what.empty(); }
};

constexpr size_t longest_quote = 60;

// Quotes a host's text on one line: control characters become '?', long texts are cut.
std::string quoted(std::string_view text) {
    std::string out(text.substr(0, longest_quote));
    for (char& c : out)
        if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
    return "\"" + out + (text.size() > longest_quote ? "...\"" : "\"");
}

// A list and the index of one of its elements.
struct ListElement {
    std::string list; // "gusts.control", "layer[0].edit"
    long index;
};

// "gusts.control[12].shape" -> "gusts.control[].shape", "layer[0].edit[1].id" -> "layer[].edit[].id". Appends
// the list elements in the name to `elements`.
std::string declared_name(std::string_view name, std::vector<ListElement>& elements) {
    constexpr size_t max_digits = 9;
    std::string declared;
    size_t begin = 0;
    while (true) {
        const size_t open = name.find('[', begin), close = name.find("].", open);
        if (open == std::string_view::npos || close == std::string_view::npos) break;
        const std::string_view digits = name.substr(open + 1, close - open - 1);
        if (digits.empty() || digits.size() > max_digits ||
            digits.find_first_not_of("0123456789") != std::string_view::npos)
            break;
        elements.push_back({std::string(name.substr(0, open)), std::stol(std::string(digits))});
        declared += std::string(name.substr(begin, open + 1 - begin)) + "].";
        begin = close + 2;
    }
    return declared + std::string(name.substr(begin));
}

std::string wanted(const MarramParam& param, const MarramTypeForm& form) {
    if (form.flags & MARRAM_ZERO_OR_ONE) return "give 0 or 1";
    if (form.range_bits == 0) return fmt::format("give {}", form.written);
    return fmt::format("give {} from {:g} to {:g}{}{}", form.written, param.minimum, param.maximum,
                       *param.unit ? " " : "", param.unit);
}

// The fault of numbers and text.
Fault content_fault(const MarramParam& param, const MarramTypeForm& form, const MarramValue& value) {
    size_t index = 0;
    switch (marram_value_fault(&form, param.minimum, param.maximum, param.choices, value.numbers,
                               value.number_count, value.text, &index)) {
    case MARRAM_WRONG_COUNT:
        return {fmt::format("has {} numbers", value.number_count),
                form.flags & MARRAM_ITEMS
                    ? fmt::format("give {} an item, at least one item: {}", form.numbers, form.written)
                    : fmt::format("give {}", form.numbers)};
    case MARRAM_WRONG_NUMBER:
        return {fmt::format("has numbers[{}] = {:g}", index, value.numbers[index]), wanted(param, form)};
    case MARRAM_WRONG_ORDER:
        return {fmt::format("does not ascend at numbers[{}] = {:g}", index, value.numbers[index]),
                form.flags & MARRAM_ITEMS ? "sort its items by their first numbers, each once"
                                          : "give the lower number first"};
    case MARRAM_WRONG_TEXT: {
        const std::string_view choices = form.text == MARRAM_CHOICE_TEXT ? param.choices : form.keywords;
        return {fmt::format("is {}", quoted(value.text)),
                choices.empty() ? wanted(param, form) : fmt::format("give one of {}", choices)};
    }
    case MARRAM_GOOD:
        break;
    }
    return {};
}

Fault grid_fault(const MarramTypeForm& form, const MarramValue& value) {
    const MarramGrid* grid = value.grid;
    if (!grid || !grid->values || grid->nx < 1 || grid->ny < 1 || grid->nz < 1)
        return {"has no values", "read the file and hand over what it holds"};
    if (grid->components < 1 || grid->components > form.components)
        return {fmt::format("has {} components", grid->components),
                fmt::format("give 1 to {}", form.components)};
    if (value.type == MARRAM_TABLE &&
        size_t(std::ranges::count(std::string_view(value.text), ',')) + 1 != grid->nx)
        return {fmt::format("is a table of {} columns with the names {}", grid->nx, quoted(value.text)),
                "name each column"};
    return {};
}

// Branch-free, so that it vectorises. NaN counts as out of range.
bool within(const float* numbers, size_t count, float most) {
    unsigned beyond = 0;
    for (size_t i = 0; i < count; ++i) beyond |= unsigned(!(std::fabs(numbers[i]) <= most));
    return beyond == 0;
}

// Reads all of its numbers.
Fault volume_fault(const MarramVolume* given) {
    if (!given) return {"has no volume", "read the files and hand over what they hold"};
    if (!is_sized(given)) return {"has a volume whose size is 0", "set MarramVolume.size"};
    const MarramVolume volume = known_part(given);
    const std::vector<MarramGrid> grids = known_parts(volume.grids, volume.count, volume.grid_stride);
    if (grids.empty()) return {"is a volume without grids", "give one or more"};
    if (!volume.frames && grids.size() > 1)
        return {"is a volume of several grids without frames", "say when each of them holds"};
    for (size_t g = 0; g < grids.size(); ++g) {
        const MarramGrid& grid = grids[g];
        const auto refuse = [&](const char* what, const char* remedy) -> Fault {
            return {fmt::format("is a volume whose grid {} {}", g, what), remedy};
        };
        if (volume.frames &&
            (!std::isfinite(volume.frames[g]) || (g > 0 && !(volume.frames[g] > volume.frames[g - 1]))))
            return refuse("does not ascend in frames", "sort them by frame, each frame once");
        const double numbers = 3.0 * grid.nx * grid.ny * grid.nz;
        if (!grid.values || grid.components != 3 || !(numbers >= 3.0) || !(numbers < 0x1p31))
            return refuse("does not have 1 to 715 million samples of 3 components", "resample it");
        Eigen::Matrix3d axes;
        for (int axis = 0; axis < 3; ++axis) axes.col(axis) = Vec3d(grid.axes[axis]);
        const Vec3d origin(grid.origin);
        if (!axes.allFinite() || !origin.allFinite() || !axes.inverse().allFinite())
            return refuse("has a place that is not usable", "give a finite origin, and axes that span space");
        constexpr float largest = 1e6F;
        if (!within(grid.values, size_t(numbers), largest))
            return refuse("has vectors that are not finite, or beyond 1e6", "repair them");
    }
    return {};
}

Fault keyframes_fault(const MarramParam& param, const MarramTypeForm& form, const MarramValue& value) {
    if (!param.keyable) return {"has keyframes", "it is constant in time (MarramParam.keyable)"};
    if (!is_sized(value.keyframes)) return {"has keyframes whose size is 0", "set MarramKeyframes.size"};
    const MarramKeyframes keys = known_part(value.keyframes);
    if (keys.count == 0 || !keys.frames || !keys.numbers || !keys.interpolation)
        return {"has keyframes without frames, numbers or interpolation", "fill them in"};
    if (!key_interpolation(keys.interpolation))
        return {fmt::format("has keyframes with the interpolation {}", quoted(keys.interpolation)),
                fmt::format("give one of {}", key_interpolations)};
    for (uint32_t i = 0; i < keys.count; ++i) {
        if (!std::isfinite(keys.frames[i]) || (i > 0 && !(keys.frames[i] > keys.frames[i - 1])))
            return {fmt::format("has keyframes that do not ascend at {:g}", keys.frames[i]),
                    "sort them by frame, each frame once"};
        MarramValue at_key = value;
        at_key.numbers = keys.numbers + i * value.number_count;
        if (Fault fault = content_fault(param, form, at_key)) {
            fault.what = fmt::format("at frame {:g} {}", keys.frames[i], fault.what);
            return fault;
        }
    }
    return {};
}

Fault value_fault(const MarramParam& param, const MarramValue& value) {
    const bool type_of_element = std::string_view(param.name) == "type" && value.type == MARRAM_CHOICE;
    if (type_of_element) return {}; // find() has already matched it
    const MarramTypeForm* form = marram_type_form(param.type);
    if (value.type != param.type || !form)
        return {fmt::format("has the type {}", int(value.type)),
                fmt::format("this parameter is declared with type {} (MarramParamType)", int(param.type))};
    if (value.number_count > 0 && !value.numbers) return {"has numbers that are NULL", "point to them"};
    if (!value.text) return {"has a text that is NULL", "give \"\" where there is none"};
    if (Fault fault = content_fault(param, *form, value)) return fault;
    if (value.keyframes)
        if (Fault fault = keyframes_fault(param, *form, value)) return fault;
    if (value.type == MARRAM_VOLUME) return volume_fault(value.volume);
    return form->components > 0 ? grid_fault(*form, value) : Fault{};
}

// Reports lists whose element indices are not 0, 1, 2, ... without gaps.
void find_gaps(const std::map<std::string, std::unordered_set<long>>& lists,
               std::vector<ContractFault>& faults) {
    for (const auto& [list, indices] : lists)
        for (long i = 0; i < long(indices.size()); ++i)
            if (!indices.contains(i)) {
                faults.push_back({"",
                                  fmt::format("{} elements of {} are given, but none is number {}",
                                              indices.size(), list, i),
                                  "number them from 0 without gaps"});
                break;
            }
}

// The declared parameters, by name.
class Declarations {
  public:
    Declarations(std::span<const MarramParam> params, std::span<const MarramItemType> items,
                 std::span<const MarramValue> values)
        : items_(items) {
        for (const MarramParam& param : params) plain_.emplace(param.name, &param);
        for (const MarramValue& value : values)
            if (value.name && value.text && std::string_view(value.name).ends_with("].type"))
                types_.emplace(value.name, value.text);
    }

    // The parameter for `given`, e.g. "layer[2].height", with the declared name `name`, "layer[].height". For
    // list elements it is searched in the type of the element, "layer[2].type". nullptr: unknown.
    const MarramParam* find(std::string_view given, std::string_view name) const {
        if (const auto found = plain_.find(name); found != plain_.end()) return found->second;
        const size_t open = name.find("[]."), close = given.find("].");
        if (open == std::string_view::npos) return nullptr;
        const std::string_view list = name.substr(0, open), field = name.substr(open + 3);
        const auto type = types_.find(std::string(given.substr(0, close)) + "].type");
        if (type == types_.end()) return nullptr;
        for (const MarramItemType& item : items_) {
            if (list != item.list || type->second != item.type) continue;
            if (field == "type") return &item_type_;
            for (uint32_t p = 0; p < item.param_count; ++p) {
                const auto* param = MARRAM_AT(MarramParam, item.params, item.param_stride, p);
                if (field == param->name) return param;
            }
        }
        return nullptr;
    }

  private:
    static constexpr MarramParam item_type_ = param::text("type", "", "");
    std::span<const MarramItemType> items_;
    std::unordered_map<std::string_view, const MarramParam*> plain_;
    std::unordered_map<std::string, std::string_view> types_; // "layer[2].type" -> the element's type
};

} // namespace

std::vector<ContractFault> value_faults(std::span<const MarramParam> params,
                                        std::span<const MarramValue> values,
                                        std::span<const MarramItemType> items) {
    std::vector<ContractFault> faults;
    const Declarations declared(params, items, values);
    std::unordered_set<std::string_view> seen;
    std::map<std::string, std::unordered_set<long>> lists;
    for (size_t i = 0; i < values.size(); ++i) {
        const MarramValue& value = values[i];
        const std::string place = value.place ? value.place : "";
        if (!value.name) {
            faults.push_back({place, fmt::format("value {} has no name", i), "give a declared one"});
            continue;
        }
        std::vector<ListElement> elements;
        const std::string name = declared_name(value.name, elements);
        const MarramParam* param = declared.find(value.name, name);
        const auto add = [&](const Fault& fault) {
            faults.push_back(
                {place, fmt::format("the parameter {} {}", quoted(value.name), fault.what), fault.remedy});
        };
        if (!param) {
            add({"is unknown", "hand over declared parameters only (MarramProcedural.params)"});
            continue;
        }
        if (!seen.insert(value.name).second) add({"is given twice", "give it once"});
        for (const ListElement& element : elements) lists[element.list].insert(element.index);
        if (const Fault fault = value_fault(*param, value)) add(fault);
    }
    find_gaps(lists, faults);
    return faults;
}

namespace {

bool finite(const float* numbers, size_t count) {
    return within(numbers, count, std::numeric_limits<float>::max());
}

Fault attribute_fault(const MarramMesh& mesh) {
    if (mesh.attribute_count > 0 && !mesh.attributes)
        return {"has attributes that are NULL", "list those that are counted"};
    for (const MarramAttribute& attribute :
         known_parts(mesh.attributes, mesh.attribute_count, mesh.attribute_stride)) {
        if (!attribute.name || !attribute.values || attribute.components < 1 || attribute.components > 4 ||
            (attribute.rate != MARRAM_PER_VERTEX && attribute.rate != MARRAM_PER_FACE))
            return {"has an attribute without name or values, or not 1 to 4 floats a vertex or face",
                    "fill it in"};
        const size_t count = attribute.rate == MARRAM_PER_FACE ? mesh.triangle_count : mesh.vertex_count;
        if (!finite(attribute.values, attribute.components * count))
            return {fmt::format("has an attribute {} that is not finite", quoted(attribute.name)),
                    "give finite numbers"};
    }
    return {};
}

// Checks the numbers of a mesh whose pointers are valid.
Fault mesh_content_fault(const MarramMesh& mesh) {
    const size_t vertices = mesh.vertex_count;
    for (uint32_t t = 0; t < mesh.time_count; ++t) {
        if (!usable_coordinates(mesh.positions[t], 3 * vertices))
            return {fmt::format("has a vertex that is not finite, or beyond {:g} m", embree_limit),
                    "give finite positions near the origin"};
        if (mesh.normals && !finite(mesh.normals[t], 3 * vertices))
            return {"has a normal that is not finite", "give unit vectors"};
    }
    if (mesh.uvs && !finite(mesh.uvs, 2 * vertices))
        return {"has a uv that is not finite", "give finite uvs"};
    uint32_t most = 0;
    for (size_t i = 0; i < 3 * size_t(mesh.triangle_count); ++i) most = std::max(most, mesh.triangles[i]);
    if (mesh.triangle_count > 0 && most >= mesh.vertex_count)
        return {fmt::format("has a triangle with vertex {} of {}", most, mesh.vertex_count),
                "count vertices from 0"};
    return attribute_fault(mesh);
}

Fault mesh_fault(const MarramMesh& mesh, uint32_t time_count) {
    if (mesh.time_count != 1 && mesh.time_count != time_count)
        return {fmt::format("has {} motion samples", mesh.time_count),
                fmt::format("give 1 or the frame's {}", time_count)};
    bool there = mesh.positions && (mesh.triangles || mesh.triangle_count == 0);
    for (uint32_t t = 0; there && t < mesh.time_count; ++t)
        there = (mesh.positions[t] || mesh.vertex_count == 0) &&
                (!mesh.normals || mesh.normals[t] || mesh.vertex_count == 0);
    if (!there) return {"lacks positions, normals or triangles", "point to them"};
    return mesh_content_fault(mesh);
}

Fault curves_fault(const MarramCurves& curves, uint32_t time_count) {
    if (curves.time_count != 1 && curves.time_count != time_count)
        return {fmt::format("have {} motion samples", curves.time_count),
                fmt::format("give 1 or the frame's {}", time_count)};
    if (curves.curve_count == 0) return {};
    bool there = curves.vertices != nullptr;
    for (uint32_t t = 0; there && t < curves.time_count; ++t) there = curves.vertices[t] != nullptr;
    if (!there) return {"lack vertices", "point to them"};
    uint64_t cvs = curves.curve_count * curves.cvs_per_curve;
    if (curves.offsets) {
        bool ascend = curves.offsets[0] == 0;
        for (uint64_t c = 0; ascend && c < curves.curve_count; ++c)
            ascend = curves.offsets[c + 1] > curves.offsets[c];
        if (!ascend) return {"have offsets that do not ascend from 0", "give each curve its CVs"};
        cvs = curves.offsets[curves.curve_count];
    } else if (curves.cvs_per_curve < 1) {
        return {"have no CVs", "give cvs_per_curve or offsets"};
    }
    for (uint32_t t = 0; t < curves.time_count; ++t)
        if (!usable_coordinates(curves.vertices[t], 4 * (cvs + 2 * curves.curve_count)))
            return {fmt::format("have a vertex that is not finite, or beyond {:g} m", embree_limit),
                    "give finite positions near the origin"};
    return {};
}

// True if the steps over the shutter are equal, to a thousandth of a step.
bool equally_spaced(const double* times, uint32_t count) {
    if (count < 3) return true;
    constexpr double share = 1e-3; // of a step
    const double step = (times[count - 1] - times[0]) / (count - 1);
    for (uint32_t t = 1; t + 1 < count; ++t)
        if (!(std::fabs(times[t] - times[0] - t * step) <= share * step)) return false;
    return true;
}

// Beyond it samples cannot be told apart, and steps between them cannot be counted.
constexpr double latest_time = 1e12; // frames
constexpr double lowest_fps = 1e-3, highest_fps = 1e6;

bool usable_time(double frame) { return std::fabs(frame) <= latest_time; } // false for NaN

ContractFault times_fault(const double* times, uint32_t count) {
    constexpr uint32_t max_times = 64;
    if (!times || count < 1 || count > max_times)
        return {"", fmt::format("there are {} motion samples", times ? count : 0),
                fmt::format("give 1 to {}", max_times)};
    for (uint32_t t = 0; t < count; ++t)
        if (!std::isfinite(times[t]) || (t > 0 && !(times[t] > times[t - 1])))
            return {"", "the motion samples are not finite and ascending", "sort them, each once"};
    for (const double time : {times[0], times[count - 1]})
        if (!usable_time(time))
            return {"", fmt::format("a motion sample is at frame {:g}", time),
                    fmt::format("give frames from {:g} to {:g}", -latest_time, latest_time)};
    return {};
}

// Checks that the colliders belong to the frame's RTCDevice.
ContractFault device_fault(const MarramFrame& frame) {
    if (!frame.colliders || !frame.device) return {};
    const RTCDevice device = rtcGetSceneDevice(frame.colliders);
    const bool same = device == frame.device;
    rtcReleaseDevice(device);
    if (same) return {};
    return {"", "MarramFrame.colliders is a scene of another device than MarramFrame.device",
            "make both with one RTCDevice"};
}

std::array<Vec3d, 3> corners_of(const MarramMesh& mesh, size_t triangle) {
    std::array<Vec3d, 3> corners;
    for (size_t i = 0; i < 3; ++i) {
        const float* p = mesh.positions[0] + 3 * size_t(mesh.triangles[3 * triangle + i]);
        corners[i] = {double(p[0]), double(p[1]), double(p[2])};
    }
    return corners;
}

// A short ray through the middle of a triangle, at the first motion sample.
struct Probe {
    size_t triangle = 0;
    Vec3d middle, normal;
    double half_length = 0.0; // length, m
};

// Through the last triangle of a usable size: if the host attached quads, its number differs from the
// primitive's. Empty if there is none.
std::optional<Probe> probe_of(const MarramMesh& mesh) {
    constexpr double min_shape = 1e-3; // area over the square of the longest side
    constexpr double min_size = 1e-3;  // relative to the coordinates, whose floats resolve 1e-7
    constexpr double min_side = 1e-8;  // m; Embree multiplies four lengths, and floats end at 1e-38
    for (size_t t = mesh.triangle_count; t-- > 0;) {
        const std::array<Vec3d, 3> p = corners_of(mesh, t);
        const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0], n = e1.cross(e2);
        const double area = 0.5 * n.norm();
        const double side = std::max({e1.squaredNorm(), e2.squaredNorm(), (p[2] - p[1]).squaredNorm()});
        const Vec3d middle = (p[0] + p[1] + p[2]) / 3.0;
        if (!(side > min_side * min_side) || !(area >= min_shape * side) ||
            !(std::sqrt(area) > min_size * middle.cwiseAbs().maxCoeff()))
            continue;
        return Probe{t, middle, n / (2.0 * area), 0.05 * std::sqrt(area)};
    }
    return {};
}

enum class ProbeResult { found, missing, instance };

// True if a lent mesh with the hit's geometry ID has the hit triangle at the point, and if no mesh is lent by
// this ID, which cannot be judged.
bool has_triangle_at(std::span<const MarramMesh> meshes, const RTCHit& hit, const Vec3d& point,
                     double tolerance) {
    bool none = true;
    for (const MarramMesh& mesh : meshes) {
        if (mesh.geometry_id != hit.geomID) continue;
        none = false;
        if (hit.primID < mesh.triangle_count &&
            (nearest_point(corners_of(mesh, hit.primID), point) - point).norm() < tolerance)
            return true;
    }
    return none;
}

// Traces the probe, past surfaces in front of the triangle. Another lent mesh in the same place counts as
// found. Gives up after 16 hits, and returns found.
ProbeResult find_triangle(RTCScene scene, std::span<const MarramMesh> meshes, const MarramMesh& mesh,
                          const Probe& probe) {
    constexpr int max_hits = 16;
    const double same_place = 0.1 * probe.half_length;
    const Vec3d from = probe.middle + probe.half_length * probe.normal;
    RTCRayHit ray{};
    ray.ray.org_x = float(from.x()), ray.ray.org_y = float(from.y()), ray.ray.org_z = float(from.z());
    ray.ray.dir_x = float(-probe.normal.x()), ray.ray.dir_y = float(-probe.normal.y()),
    ray.ray.dir_z = float(-probe.normal.z());
    ray.ray.mask = ~0U;
    for (int hits = 0; hits < max_hits; ++hits) {
        ray.ray.tfar = float(2.0 * probe.half_length);
        ray.hit.geomID = ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        marram_intersect1(scene, &ray, 1);
        if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return ProbeResult::missing;
        const bool instance = ray.hit.instID[0] != RTC_INVALID_GEOMETRY_ID;
        if (!instance && ray.hit.geomID == mesh.geometry_id && ray.hit.primID == probe.triangle)
            return ProbeResult::found;
        if (std::abs(double(ray.ray.tfar) - probe.half_length) < same_place) {
            if (instance) return ProbeResult::instance;
            return has_triangle_at(meshes, ray.hit, probe.middle, same_place) ? ProbeResult::found
                                                                              : ProbeResult::missing;
        }
        ray.ray.tnear = std::nextafter(ray.ray.tfar, std::numeric_limits<float>::infinity());
    }
    return ProbeResult::found;
}

// True if the scene is committed. If not, Embree also reports an error to the device.
bool is_committed(RTCScene scene) {
    RTCBounds bounds{};
    bounds.lower_x = std::numeric_limits<float>::quiet_NaN(); // stays if Embree sets nothing
    rtcGetSceneBounds(scene, &bounds);
    return !std::isnan(bounds.lower_x);
}

// Checks that the colliders hold a lent mesh itself, not an instance of it, at time 0.
ContractFault collider_fault(RTCScene colliders, std::span<const MarramMesh> meshes, const MarramMesh& mesh) {
    const std::optional<Probe> probe = probe_of(mesh);
    if (!probe) return {};
    switch (find_triangle(colliders, meshes, mesh, *probe)) {
    case ProbeResult::found:
        return {};
    case ProbeResult::instance:
        return {"",
                fmt::format("the mesh {} is an Embree instance in MarramFrame.colliders", quoted(mesh.name)),
                "attach the mesh itself, in world space"};
    default:
        return {"",
                fmt::format("MarramFrame.colliders does not have triangle {} of the mesh {} in geometry {}",
                            probe->triangle, quoted(mesh.name), mesh.geometry_id),
                "attach the mesh by this id, with the same triangles and positions"};
    }
}

} // namespace

bool usable_coordinates(const float* numbers, size_t count) {
    return within(numbers, count, float(embree_limit));
}

ContractFault frame_fault(const MarramFrame& frame, std::span<const MarramMesh> meshes,
                          std::span<const MarramCurves> curves) {
    if (!frame.pose)
        return {"", "MarramFrame.pose is NULL", "give a function that poses the meshes at any time"};
    if (ContractFault fault = times_fault(frame.times, frame.time_count); !fault.what.empty()) return fault;
    if (!equally_spaced(frame.times, frame.time_count))
        return {"", "the motion samples are not equally spaced", "give equal steps over the shutter"};
    if (!usable_time(frame.frame) || !usable_time(frame.bind_frame) ||
        !(frame.fps >= lowest_fps && frame.fps <= highest_fps))
        return {"", "frame, bind_frame or fps is no usable number",
                fmt::format("give frames from {0:g} to {1:g}, fps from {2:g} to {3:g}", -latest_time,
                            latest_time, lowest_fps, highest_fps)};
    if (!(frame.tolerance >= 0.0) || !std::isfinite(frame.tolerance))
        return {"", fmt::format("the tolerance is {:g}", frame.tolerance), "give metres, 0 or more"};
    if (frame.stage != MARRAM_REST && frame.stage != MARRAM_BENT && frame.stage != MARRAM_FINAL)
        return {"", fmt::format("the stage is {}", int(frame.stage)), "give 0 to 2 (MarramStage)"};
    if (meshes.size() != frame.mesh_count)
        return {"", "MarramFrame.meshes is NULL", "list the meshes that are counted"};
    if (curves.size() != frame.curves_count)
        return {"", "MarramFrame.curves is NULL", "list the curves that are counted"};
    for (size_t m = 0; m < meshes.size(); ++m) {
        if (!meshes[m].name) return {"", fmt::format("mesh {} has no name", m), "give it one"};
        if (const Fault fault = mesh_fault(meshes[m], frame.time_count))
            return {"", fmt::format("the mesh {} {}", quoted(meshes[m].name), fault.what), fault.remedy};
        if (meshes[m].instance_of == 0) continue;
        const auto refuse = [&](const char* what, const char* remedy) -> ContractFault {
            return {"", fmt::format("the instance {} {}", quoted(meshes[m].name), what), remedy};
        };
        if (meshes[m].instance_of > m) return refuse("stands before its mesh", "list the mesh first");
        const MarramMesh& mesh = meshes[meshes[m].instance_of - 1];
        if (mesh.instance_of != 0)
            return refuse("is one of another instance", "make it an instance of the mesh itself");
        if (mesh.vertex_count != meshes[m].vertex_count || mesh.triangle_count != meshes[m].triangle_count)
            return refuse("has other triangles than its mesh", "lend it with the same");
        if (!frame.instance_transform)
            return refuse("cannot be placed: MarramFrame.instance_transform is NULL",
                          "give a function that places instances");
    }
    for (size_t c = 0; c < curves.size(); ++c) {
        if (!curves[c].name) return {"", fmt::format("curves {} have no name", c), "give them one"};
        if (const Fault fault = curves_fault(curves[c], frame.time_count))
            return {"", fmt::format("the curves {} {}", quoted(curves[c].name), fault.what), fault.remedy};
    }
    if (ContractFault fault = device_fault(frame); !fault.what.empty() || !frame.colliders) return fault;
    if (!is_committed(frame.colliders))
        return {"", "MarramFrame.colliders is not committed", "call rtcCommitScene() before begin"};
    for (const MarramMesh& mesh : meshes)
        if (ContractFault fault = collider_fault(frame.colliders, meshes, mesh); !fault.what.empty())
            return fault;
    return {};
}

ContractFault view_fault(const MarramView& view) {
    if (ContractFault fault = times_fault(view.times, view.time_count); !fault.what.empty()) return fault;
    if (!view.positions || !view.directions || !view.ups)
        return {"", "the view lacks positions, directions or ups", "give one of each a motion sample"};
    constexpr double shortest = 0.5; // shortest accepted length of a unit vector
    for (uint32_t t = 0; t < view.time_count; ++t) {
        const double *p = view.positions + 3 * t, *d = view.directions + 3 * t, *u = view.ups + 3 * t;
        bool good = std::hypot(d[0], d[1], d[2]) >= shortest && std::hypot(u[0], u[1], u[2]) >= shortest;
        for (int i = 0; i < 3; ++i)
            good = good && std::fabs(p[i]) <= embree_limit && std::isfinite(d[i]) && std::isfinite(u[i]);
        if (!good)
            return {"", "the view has a position or direction that is no usable vector",
                    "give finite positions and unit directions"};
    }
    if (!(view.fov > 0.0 && view.fov < pi))
        return {"", fmt::format("the view's angle is {:g}", view.fov), "give radians between 0 and pi"};
    if (view.width < 1 || view.height < 1)
        return {"", fmt::format("the view has {} x {} pixels", view.width, view.height),
                "give at least 1 x 1"};
    if (!(view.tolerance >= 0.0 && view.tolerance_pixels >= 0.0) || !std::isfinite(view.tolerance) ||
        !std::isfinite(view.tolerance_pixels))
        return {"", "the view's tolerance is no usable number", "give metres or pixels, 0 or more"};
    return {};
}

} // namespace marram
