// SPDX-License-Identifier: Apache-2.0
// The fields of a wind, [[wind.field]]: their parameters and where they are. local_wind.h says what they do.
#pragma once

#include "core/math/ramp.h"
#include "core/math/transform.h"
#include "core/math/vec.h"
#include "procedural/abi/values.h"
#include "procedural/wind/field/guide_map.h"
#include "procedural/wind/field/velocities.h"

#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace marram {

enum class FieldShape { sphere, box, grid, curves, image };
inline constexpr const char* field_shapes = "sphere|box|grid|curves|image";

struct PlacedField {
    FieldShape shape = FieldShape::sphere;
    bool replaces = false;
    KeyedTransform transform;
    Vec3d velocity = Vec3d::Zero();                 // m/s, in the field's axes
    double swirl = 0.0, pull = 0.0;                 // m/s
    double core = 0.3;                              // share of the field's size, > 0
    double weight = 1.0;                            // 0 ... 1
    Ramp ramp;                                      // from the centre (0) to the surface (1)
    std::string location{};                         // in the scene, for messages
    std::shared_ptr<const Velocities> velocities{}; // of a grid
    std::string along{};                            // names curves
    double reach = 0.0;                             // of curves, m
    std::shared_ptr<const PlanMap> map{};           // of an image; of curves once they are lent
};

// Parameters of [wind] that start with "field[].".
std::span<const MarramParam> field_params();

// "wind.field[].shape", for procedurals that do not feel fields: they can then say so.
MarramParam ignored_field_param();
// Says at each field that `who` does not feel it: "the sand of a dune_solver is".
void tell_of_ignored_fields(const MarramHost& host, const Values& values, const std::string& who);

// Reads values named "wind.field[0]....", ... Throws SceneFault.
std::vector<PlacedField> read_fields(const Values& values);

// The fields of shape "curves" take their curves from the frame. Returns whether any has changed. Throws
// SceneFault: no such curves, or curves that move.
bool lend_guides(const MarramFrame& frame, std::span<PlacedField> fields);

// Upper bound of what the field adds to the speed of a mean wind, m/s.
double max_added_speed(const PlacedField& field, double mean_speed);

// Whether it differs from time to time, weights and velocities with keys aside.
bool field_moves(const PlacedField& field);

// "grid, 24 frames of 64 x 32 x 64 voxels"
std::string field_text(const PlacedField& field);
size_t field_bytes(const PlacedField& field); // of maps that it holds

// A grid's samples at one time: of the file before, or after it.
struct SamplesAt {
    const VelocitySamples* samples = nullptr; // nullptr: none
    double share = 1.0;                       // of the time
    Vec3d center = Vec3d::Zero();
    Eigen::Matrix3d to_unit = Eigen::Matrix3d::Identity(); // from the centre to |x_a| < 1 in its box
    bool in_the_same_box = false;                          // and of as many samples as the one before
};

// A field at one time.
struct FieldAt {
    const PlacedField* field;
    Vec3d center;
    Eigen::Matrix3d to_unit; // M
    Eigen::Matrix3d axes;    // R: unit columns
    Vec3d lower, upper;      // bounds in world space
    std::array<SamplesAt, 2> grids{};
};
// Without those of no volume or no weight, and curves that are not lent. `fields` must outlive the result.
std::vector<FieldAt> fields_at(std::span<const PlacedField> fields, double frame);

// Whether its bounds meet the box, in metres, at some time within frames [first, last]: each frame is
// tried, or 1000 times of a longer shot, so one that flies through between two is missed. For warnings.
bool field_touches(const PlacedField& field, const Vec2d& frames, const Eigen::AlignedBox3d& box);

} // namespace marram
