// SPDX-License-Identifier: Apache-2.0
// The reader of strands_usda.cpp. Its attributes are read in usda/strands_attributes.cpp.
#pragma once

#include "core/read/strand_file.h"
#include "core/read/usda/usda_cvs.h"

#include <algorithm>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

using Numbers = std::vector<double>;

// A numeric attribute over time.
struct UsdaSeries {
    const UsdaAttribute* of = nullptr;
    std::vector<std::pair<double, const Numbers*>> samples; // one, or by ascending time
    bool is_there() const { return !samples.empty(); }
};

enum class Interpolation { constant, uniform, varying, vertex };

class UsdaStrandsReader {
  public:
    UsdaStrandsReader(const std::string& path, std::string_view bytes, const StrandReading& reading)
        : path_(path), bytes_(bytes), reading_(reading), scene_(path, bytes),
          frames_per_time_(reading.fps / time_codes_a_second()) {}
    StrandFile read();

  private:
    double time_codes_a_second() const;
    UsdaSeries series(const UsdaPrim& prim, std::string_view name) const;
    const Numbers& value_at(const UsdaSeries& series, double time, Numbers& between) const;
    std::string_view widths_name(const UsdaPrim& prim) const {
        return series(prim, "primvars:widths").is_there() ? "primvars:widths" : "widths";
    }

    UsdaTransform placing(const std::vector<const UsdaPrim*>& ancestors, double time) const;
    bool is_linear_within(const std::vector<const UsdaPrim*>& ancestors, const Eigen::AlignedBox3d& box,
                          double begin, double end) const;
    void bisect(const std::vector<const UsdaPrim*>& ancestors, const Eigen::AlignedBox3d& box, double begin,
                double end, int depth, std::set<double>& times) const;
    void find_bases();
    bool has_changing_counts() const;
    const UsdaValue* held(const UsdaPrim& prim, std::string_view name) const;
    StrandFile read_prims();
    StrandFile read_takes();
    void find_times();
    void check_room(size_t times, uint64_t floats) const;

    StrandFile read_prim(const UsdaCurvesPrim& prim);
    Numbers placed_points(const UsdaCurvesPrim& prim, const UsdaSeries& points, double time) const;
    bool cut_evenly(UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points, StrandFile& part);
    void cut(UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points, StrandFile& part);
    void read_samples(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& points,
                      StrandFile& part);
    std::vector<float> widths_at(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaSeries& widths,
                                 std::string_view name, double time) const;

    Interpolation interpolation_of(const UsdaPrim& prim, const UsdaAttribute& attribute,
                                   Interpolation otherwise) const;
    Interpolation width_interpolation(const UsdaCvs& cvs, const UsdaCurvesPrim& prim,
                                      const UsdaAttribute& widths, std::string_view name, size_t count) const;
    size_t expected(const UsdaCvs& cvs, Interpolation interpolation) const;
    Numbers interpolate_to_cvs(const UsdaCvs& cvs, const Numbers& values, size_t components,
                               Interpolation interpolation, bool discrete) const;
    void read_attributes(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, StrandFile& part);
    void read_attribute(const UsdaCvs& cvs, const UsdaCurvesPrim& prim, const UsdaAttribute& attribute,
                        std::string name, Interpolation otherwise, StrandFile& part);
    bool expand(const UsdaPrim& prim, const UsdaAttribute& attribute, size_t components,
                Numbers& values) const;
    void place_values(const UsdaCurvesPrim& prim, std::string_view type, Numbers& values) const;

    void drop_equal_samples(StrandFile& all) const;
    void warn(std::string what) {
        if (std::ranges::find(warnings_, what) == warnings_.end()) warnings_.push_back(std::move(what));
    }

    const std::string& path_;
    std::string_view bytes_;
    const StrandReading& reading_;
    UsdaScene scene_;
    double frames_per_time_;
    std::vector<UsdaCurvesPrim> prims_;
    std::vector<double> times_; // of the samples; one if nothing moves
    std::vector<std::string> warnings_;
    bool has_mixed_bases_ = false; // all curves become Catmull-Rom curves
    bool counts_change_ =
        false; // times_ has one time: that of the take being read, at which all values are held
};

} // namespace marram
