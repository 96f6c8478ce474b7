// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/measured_wind.h"

#include "procedural/abi/values.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>

namespace marram {
namespace {

struct Unit {
    std::string_view name;
    double factor;
};

struct Column {
    std::vector<std::string_view> names; // the first is that of messages
    std::vector<Unit> units;             // the first is the default
};

// A column's name without its unit, "speed" of "speed (m/s)" or "speed [m/s]", and the unit; "" if it has
// none.
std::pair<std::string_view, std::string_view> name_and_unit(std::string_view header) {
    const auto trimmed = [](std::string_view text) {
        text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
        return text.substr(0, text.find_last_not_of(' ') + 1);
    };
    const size_t open = std::min(header.find_first_of("(["), header.size());
    const std::string_view unit = header.substr(std::min(open + 1, header.size()));
    return {trimmed(header.substr(0, open)), trimmed(unit.substr(0, unit.find_last_of(")]")))};
}

std::string lower(std::string_view text) {
    std::string result(text);
    std::ranges::transform(result, result.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    return result;
}

struct Table {
    const MarramValue& value;
    const char* id;
    const std::string& place;
    std::vector<std::string> headers{};

    [[noreturn]] void refuse(const std::string& what, const std::string& remedy) const {
        throw SceneFault(id, place, what, remedy);
    }

    std::vector<double> column(const Column& wanted, double& unit_factor) const {
        constexpr const char* needed =
            "it needs time (h, min, s or d), speed (m/s, km/h, kn or mph) and direction (deg or rad)";
        const auto found = std::ranges::find_if(headers, [&](const std::string& header) {
            return std::ranges::count(wanted.names, lower(name_and_unit(header).first)) > 0;
        });
        if (found == headers.end())
            refuse(fmt::format("the record has no column '{}', but {}", wanted.names[0], value.text), needed);
        const std::string unit = lower(name_and_unit(*found).second);
        const auto known =
            unit.empty() ? wanted.units.begin() : std::ranges::find(wanted.units, unit, &Unit::name);
        if (known == wanted.units.end())
            refuse(fmt::format("the record's column '{}' is in another unit", *found), needed);
        unit_factor = known->factor;
        const MarramGrid& grid = *value.grid;
        std::vector<double> list(grid.ny);
        for (uint32_t row = 0; row < grid.ny; ++row)
            list[row] = double(grid.values[size_t(row) * grid.nx + size_t(found - headers.begin())]);
        return list;
    }
};

void scale(std::vector<double>& numbers, double factor) {
    if (factor == 1.0) return;
    for (double& number : numbers) number *= factor;
}

std::string problem_of(const MeasuredWind& wind) {
    constexpr double fastest = 150.0, most_turns = 720.0;
    if (wind.time.size() < 2) return "needs two entries";
    for (size_t k = 0; k < wind.time.size(); ++k) {
        const std::string entry = fmt::format("entry {}: ", k + 1);
        if (!std::isfinite(wind.time[k]) || !std::isfinite(wind.from[k])) return entry + "not a number";
        if (!(wind.speed[k] >= 0.0) || !std::isfinite(wind.speed[k]))
            return entry + "speed below 0, or not a number";
        if (wind.speed[k] > fastest) return entry + "speed above 150 m/s";
        if (std::abs(wind.from[k]) > most_turns) return entry + "direction beyond 720 degrees";
        if (k > 0 && !(wind.time[k] > wind.time[k - 1])) return entry + "time does not ascend";
    }
    return {};
}

// The table's numbers are floats.
void check_resolution(const Table& table, const std::vector<double>& seconds) {
    if (seconds.size() < 2) return;
    constexpr double hour = 3600.0;
    const double latest = std::max(std::abs(seconds.front()), std::abs(seconds.back())) / hour,
                 resolution = latest * 0x1p-23;
    std::vector<double> intervals;
    for (size_t k = 1; k < seconds.size(); ++k) intervals.push_back(seconds[k] - seconds[k - 1]);
    const auto middle = intervals.begin() + long((intervals.size() - 1) / 2);
    std::ranges::nth_element(intervals, middle);
    // Rows that rounding has put at one time are as far apart as it allows, or not at all.
    const double usual = *middle > 0.0 ? *middle : std::ranges::max(intervals);
    if (*middle >= 0.0 && resolution > 0.01 * (usual / hour))
        table.refuse(fmt::format("the record's times are known to {:.2g} h only, as they are up to {:.0f} h",
                                 resolution, latest),
                     "count hours from the beginning of the record, or use a part of it");
}

Vec3d towards(double from) {
    const double angle = from * degree;
    return {-std::sin(angle), 0.0, std::cos(angle)};
}

// Degrees from a to b the short way, clockwise if both are as short.
double turn_between(double a, double b) {
    const double turn = std::remainder(b - a, 360.0);
    return turn > -180.0 ? turn : 180.0;
}

void add_key(MeasuredKeys& keys, double frame, double speed, double from) {
    keys.speeds.frames.push_back(frame);
    keys.speeds.numbers.push_back(speed);
    keys.directions.frames.push_back(frame);
    for (const double x : towards(from)) keys.directions.numbers.push_back(x);
}

} // namespace

MeasuredWind read_measured_wind(const MarramValue& value, const char* id, const std::string& place) {
    static const Column time = {
        {"time", "t", "hours"},
        {{"h", 3600.0}, {"hours", 3600.0}, {"s", 1.0}, {"min", 60.0}, {"d", 86400.0}}};
    static const Column speed = {
        {"speed", "wind_speed", "ws", "u", "u10"},
        {{"m/s", 1.0}, {"km/h", 1.0 / 3.6}, {"kn", 1852.0 / 3600.0}, {"mph", 0.44704}}};
    static const Column direction = {
        {"direction", "wind_direction", "dir", "wd"},
        {{"deg", 1.0}, {"degrees", 1.0}, {"\u00b0", 1.0}, {"rad", 1.0 / degree}}};
    Table table{value, id, place};
    for (std::string_view text = value.text; !text.empty();) {
        const size_t comma = std::min(text.find(','), text.size());
        table.headers.emplace_back(text.substr(0, comma));
        text.remove_prefix(std::min(comma + 1, text.size()));
    }
    MeasuredWind wind;
    double of_speed = 1.0, of_direction = 1.0;
    wind.time = table.column(time, wind.time_unit);
    wind.speed = table.column(speed, of_speed);
    wind.from = table.column(direction, of_direction);
    scale(wind.time, wind.time_unit);
    scale(wind.speed, of_speed);
    scale(wind.from, of_direction);
    check_resolution(table, wind.time);
    if (const std::string problem = problem_of(wind); !problem.empty())
        table.refuse("the record: " + problem, "correct the file");
    return wind;
}

MeasuredKeys keys_of(const MeasuredWind& wind, double first, double last) {
    constexpr double quarter_turn = 1e-9; // cosine of a turn that needs a key on the way
    const double begin = wind.time.front(), length = wind.time.back() - begin;
    MeasuredKeys keys;
    double before = 0.0;
    for (size_t k = 0; k < wind.time.size(); ++k) {
        const double frame = first + (last - first) * ((wind.time[k] - begin) / length);
        if (k > 0 && towards(wind.from[k - 1]).dot(towards(wind.from[k])) < -quarter_turn)
            add_key(keys, 0.5 * (before + frame), 0.5 * (wind.speed[k - 1] + wind.speed[k]),
                    wind.from[k - 1] + 0.5 * turn_between(wind.from[k - 1], wind.from[k]));
        add_key(keys, frame, wind.speed[k], wind.from[k]);
        before = frame;
    }
    return keys;
}

} // namespace marram
