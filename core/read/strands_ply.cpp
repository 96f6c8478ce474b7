// SPDX-License-Identifier: Apache-2.0
// Reads strands from PLY files; strand_file.h says what is supported.
#include "core/read/curves_ply.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <unordered_map>

namespace marram {

namespace {

constexpr size_t no_column = ~size_t(0);

// The largest value of an integer type; 1 for others.
double full_scale(PlyScalar type) {
    switch (type) {
    case PlyScalar::int8:
        return std::numeric_limits<int8_t>::max();
    case PlyScalar::uint8:
        return std::numeric_limits<uint8_t>::max();
    case PlyScalar::int16:
        return std::numeric_limits<int16_t>::max();
    case PlyScalar::uint16:
        return std::numeric_limits<uint16_t>::max();
    case PlyScalar::int32:
        return std::numeric_limits<int32_t>::max();
    case PlyScalar::uint32:
        return std::numeric_limits<uint32_t>::max();
    case PlyScalar::float32:
    case PlyScalar::float64:
        break;
    }
    return 1.0;
}

// Columns that form one attribute.
struct PlyGroup {
    std::string name;
    std::vector<size_t> columns;
    bool is_color = false;
};

class PlyGroups {
  public:
    explicit PlyGroups(const std::vector<PlyColumn>& columns)
        : columns_(columns), taken_(columns.size(), false) {}
    // Takes a column by its name; no_column if there is none, or it is already taken.
    size_t take(std::string_view name);
    std::vector<PlyGroup> rest(); // in the file's order

  private:
    size_t find(std::string_view name) const;
    PlyGroup group_at(size_t column) const;

    const std::vector<PlyColumn>& columns_;
    std::vector<char> taken_;
};

size_t PlyGroups::find(std::string_view name) const {
    for (size_t i = 0; i < columns_.size(); ++i)
        if (!taken_[i] && columns_[i].name == name) return i;
    return no_column;
}

size_t PlyGroups::take(std::string_view name) {
    const size_t found = find(name);
    if (found != no_column) taken_[found] = true;
    return found;
}

PlyGroup PlyGroups::group_at(size_t column) const {
    struct Known {
        const char* name;
        std::vector<const char*> parts;
    };
    static const Known known[] = {{"normal", {"nx", "ny", "nz"}},
                                  {"uv", {"s", "t"}},
                                  {"uv", {"u", "v"}},
                                  {"color", {"red", "green", "blue"}},
                                  {"alpha", {"alpha"}}};
    const std::string& name = columns_[column].name;
    for (const Known& one : known) {
        if (name != one.parts[0]) continue;
        PlyGroup group{one.name, {}, name == "red" || name == "alpha"};
        for (const char* part : one.parts)
            if (const size_t found = find(part); found != no_column) group.columns.push_back(found);
        if (group.columns.size() == one.parts.size()) return group;
    }
    PlyGroup group{name, {column}};
    if (!name.ends_with("_0") || name.size() == 2) return group;
    const std::string base = name.substr(0, name.size() - 2);
    for (size_t k = 1; k < 4; ++k) {
        const size_t found = find(fmt::format("{}_{}", base, k));
        if (found == no_column) break;
        group.columns.push_back(found);
    }
    if (group.columns.size() > 1) group.name = base;
    return group;
}

std::vector<PlyGroup> PlyGroups::rest() {
    std::vector<PlyGroup> groups;
    for (size_t i = 0; i < columns_.size(); ++i) {
        if (taken_[i]) continue;
        groups.push_back(group_at(i));
        for (const size_t column : groups.back().columns) taken_[column] = true;
    }
    return groups;
}

// Points of each strand if longer steps at equal distances part them; 0: they do not.
size_t likely_points_a_strand(const std::vector<Vec3d>& points) {
    for (size_t each = 2; 2 * each <= points.size(); ++each) {
        if (points.size() % each != 0) continue;
        double within = 0.0, between = std::numeric_limits<double>::infinity();
        for (size_t i = 1; i < points.size(); ++i) {
            const double step = (points[i] - points[i - 1]).norm();
            if (i % each == 0)
                between = std::min(between, step);
            else
                within = std::max(within, step);
            if (within >= between) break;
        }
        if (within < between) return each;
    }
    return 0;
}

class PlyStrandsReader {
  public:
    PlyStrandsReader(const std::string& path, std::string_view bytes, uint32_t cvs_per_strand)
        : path_(path), content_(read_ply_curves(path, bytes, true, cvs_per_strand)),
          is_guess_(content_.is_cloud && cvs_per_strand == 0) {}
    StrandFile read();

  private:
    void find_rows();
    void find_entries();
    void add_attributes(const std::vector<PlyColumn>& columns, std::vector<PlyGroup> groups,
                        const std::vector<uint32_t>& rows, MarramRate rate);
    std::vector<float> widths_of(const std::vector<PlyColumn>& columns, PlyGroups& groups,
                                 const std::vector<uint32_t>& rows);

    const std::string& path_;
    PlyCurvesContent content_;
    bool is_guess_;                  // nothing says that the points are one strand
    std::vector<uint32_t> vertices_; // of each CV
    std::vector<uint32_t> entries_;  // of each curve, if there are entries
    StrandFile strands_;
};

// Finds the vertices of the CVs. Closed strands are opened: they end where they begin.
void PlyStrandsReader::find_rows() {
    size_t rings = 0;
    for (size_t c = 0; c < content_.closed.size(); ++c) {
        const auto begin = content_.order.begin() + std::ptrdiff_t(content_.first[c]),
                   end = content_.order.begin() + std::ptrdiff_t(content_.first[c + 1]);
        const bool ring = content_.closed[c] != 0;
        vertices_.insert(vertices_.end(), begin, end);
        if (ring) vertices_.push_back(*begin);
        rings += ring;
        strands_.counts.push_back(uint32_t(end - begin) + (ring ? 1 : 0));
    }
    if (rings > 0)
        strands_.warnings.push_back(
            fmt::format("{} strands are closed: they are opened where they begin", rings));
}

void PlyStrandsReader::find_entries() {
    const size_t curves = strands_.counts.size();
    const auto refuse = [&](const std::string& what) {
        throw InputError({path_}, what, "give the element \"strand\" one entry for each strand");
    };
    if (content_.entries != curves)
        refuse(fmt::format("has {} strands, but {} entries in the element \"strand\"", curves,
                           content_.entries));
    entries_.resize(curves);
    if (content_.entry_ids.empty() || content_.ids.empty())
        return std::iota(entries_.begin(), entries_.end(), 0U);
    std::unordered_map<int64_t, uint32_t> entry_of;
    for (uint32_t i = 0; i < content_.entry_ids.size(); ++i)
        if (!entry_of.emplace(content_.entry_ids[i], i).second)
            refuse(fmt::format("has two entries about the strand {}", content_.entry_ids[i]));
    for (size_t c = 0; c < curves; ++c) {
        const auto found = entry_of.find(content_.ids[c]);
        if (found == entry_of.end()) refuse(fmt::format("has no entry about the strand {}", content_.ids[c]));
        entries_[c] = found->second;
    }
}

void PlyStrandsReader::add_attributes(const std::vector<PlyColumn>& columns, std::vector<PlyGroup> groups,
                                      const std::vector<uint32_t>& rows, MarramRate rate) {
    for (PlyGroup& group : groups) {
        AttributeValues attribute{std::move(group.name), uint32_t(group.columns.size()), rate, {}};
        if (rate == MARRAM_PER_CURVE && attribute.name == "uv") attribute.name = "root_uv";
        if (find_attribute(strands_.attributes, attribute.name))
            throw InputError({path_}, fmt::format("two attributes are called \"{}\"", attribute.name),
                             "rename one");
        attribute.discrete = !group.is_color && std::ranges::all_of(group.columns, [&](size_t column) {
            return columns[column].type < PlyScalar::float32;
        });
        attribute.values.reserve(rows.size() * group.columns.size());
        uint64_t folded = 0;
        for (const size_t column : group.columns) folded += columns[column].folded;
        for (const uint32_t row : rows)
            for (const size_t column : group.columns) {
                const float value = columns[column].values[row];
                attribute.values.push_back(
                    group.is_color ? float(double(value) / full_scale(columns[column].type)) : value);
            }
        if (folded > 0 && !group.is_color)
            strands_.warnings.push_back(
                fmt::format("\"{}\" has {} integers beyond 2^24, which a float cannot hold: they are hashed "
                            "to 24 bits, and different ones may become equal",
                            attribute.name, folded));
        strands_.attributes.push_back(std::move(attribute));
    }
}

std::vector<float> PlyStrandsReader::widths_of(const std::vector<PlyColumn>& columns, PlyGroups& groups,
                                               const std::vector<uint32_t>& rows) {
    for (const std::string_view name : {"width", "thickness", "radius"}) {
        const size_t column = groups.take(name);
        if (column == no_column) continue;
        std::vector<float> widths;
        widths.reserve(rows.size());
        for (const uint32_t row : rows) {
            const float value = columns[column].values[row];
            if (!(value >= 0.0F && value <= float(max_curve_coordinate)))
                throw InputError({path_}, fmt::format("the {} of entry {} is {}", name, row, value),
                                 "write 0 or more, in metres");
            widths.push_back(name == "radius" ? 2.0F * value : value);
        }
        return widths;
    }
    return {};
}

StrandFile PlyStrandsReader::read() {
    find_rows();
    if (is_guess_) {
        const size_t each = likely_points_a_strand(content_.points);
        strands_.warnings.push_back(fmt::format(
            "has neither edges nor a strand_id: its {} points are read as one strand; {}",
            content_.points.size(),
            each > 0 ? fmt::format("they look like strands of {0}: give cvs_per_strand = {0}", each)
                     : "give cvs_per_strand if they are several"));
    }
    StrandSample& sample = strands_.samples.emplace_back();
    sample.points.reserve(vertices_.size());
    for (const uint32_t vertex : vertices_) sample.points.push_back(content_.points[vertex].cast<float>());
    PlyGroups of_vertices(content_.of_vertices), of_entries(content_.of_entries);
    sample.widths = widths_of(content_.of_vertices, of_vertices, vertices_);
    if (content_.has_entries) {
        find_entries();
        std::vector<uint32_t> entry_of_cv;
        if (sample.widths.empty()) {
            for (size_t c = 0; c < entries_.size(); ++c)
                entry_of_cv.insert(entry_of_cv.end(), strands_.counts[c], entries_[c]);
            sample.widths = widths_of(content_.of_entries, of_entries, entry_of_cv);
        }
    }
    add_attributes(content_.of_vertices, of_vertices.rest(), vertices_, MARRAM_PER_CV);
    if (content_.has_entries)
        add_attributes(content_.of_entries, of_entries.rest(), entries_, MARRAM_PER_CURVE);
    remove_short_curves(path_, strands_);
    return std::move(strands_);
}

} // namespace

StrandFile read_ply_strands(const std::string& file, std::string_view bytes, const StrandReading& reading) {
    return PlyStrandsReader(file, bytes, reading.cvs_per_strand).read();
}

} // namespace marram
