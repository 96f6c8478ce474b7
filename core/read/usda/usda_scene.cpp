// SPDX-License-Identifier: Apache-2.0
#include "core/read/usda/usda_scene.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

UsdaTransform layer_placing(const std::string& path, const UsdaLayer& layer) {
    UsdaTransform placing = UsdaTransform::Identity();
    const std::string_view up = find_metadata(layer.metadata, "upAxis"),
                           unit = find_metadata(layer.metadata, "metersPerUnit");
    if (up == "Z") {
        placing.row(1) << 0.0, 0.0, 1.0, 0.0;
        placing.row(2) << 0.0, -1.0, 0.0, 0.0;
    } else if (!up.empty() && up != "Y") {
        throw InputError({path}, fmt::format("the upAxis is \"{}\"", up.substr(0, 32)),
                         "export it with Y or Z up");
    }
    double metres = 0.01; // USD's default
    if (!unit.empty() && (parse_number(unit, metres) != NumberFault::none || !(metres > 0.0)))
        throw InputError({path}, fmt::format("metersPerUnit is \"{}\"", unit.substr(0, 32)),
                         "give a number above 0, such as 1");
    placing.topRows<3>() *= metres;
    return placing;
}

Eigen::Matrix3d turned_about(char axis, double degrees) {
    return Eigen::AngleAxisd(degrees * degree, Vec3d::Unit(axis - 'X')).toRotationMatrix();
}

constexpr std::string_view op_head = "xformOp:";
constexpr std::string_view op_inverse = "!invert!", op_reset = "!resetXformStack!";

// "rotateXYZ" of "xformOp:rotateXYZ:name".
std::string_view op_kind(std::string_view op) {
    return op.substr(op_head.size(), op.find(':', op_head.size()) - op_head.size());
}

Eigen::Quaterniond quaternion(const double* n) { return {n[0], n[1], n[2], n[3]}; }

} // namespace

UsdaScene::UsdaScene(const std::string& path, std::string_view bytes)
    : path_(path), bytes_(bytes), layer_(read_usda(path, bytes)), root_(layer_placing(path, layer_)) {}

std::string_view UsdaScene::choice(const UsdaPrim& prim, std::string_view name, std::string_view otherwise,
                                   std::initializer_list<std::string_view> known) const {
    size_t at = 0;
    const auto* texts = elements<std::vector<std::string_view>>(prim, name, &at);
    if (!texts) return otherwise;
    if (texts->size() == 1)
        for (const std::string_view one : known)
            if (one == (*texts)[0]) return one;
    fail(at,
         fmt::format("the {} \"{}\" of curves is not read", name,
                     texts->empty() ? "" : (*texts)[0].substr(0, 32)),
         fmt::format("export them with one of {}", fmt::join(known, ", ")));
}

// ---- Transforms

std::optional<std::vector<double>> UsdaScene::op_numbers(const UsdaPrim& prim, std::string_view op,
                                                         std::optional<double> time, size_t& at) const {
    if (!op.starts_with(op_head)) return {};
    const UsdaPrim::Samples samples = time ? prim.samples_around(op, *time) : UsdaPrim::Samples();
    if (!samples.of) {
        const auto* numbers = elements<std::vector<double>>(prim, op, &at);
        return numbers ? std::optional(*numbers) : std::nullopt;
    }
    at = samples.of->at;
    const auto numbers_of = [&](const std::pair<double, UsdaValue>& sample) -> const auto& {
        const auto* found = std::get_if<std::vector<double>>(&sample.second);
        if (!found)
            fail(at, fmt::format("\"{}\" has the type {}", op, samples.of->type), "export the curves anew");
        return *found;
    };
    if (!samples.before) return numbers_of(*samples.after);
    const std::vector<double>& a = numbers_of(*samples.before);
    if (!samples.after || samples.before->first == *time) return a;
    const std::vector<double>& b = numbers_of(*samples.after);
    if (a.size() != b.size()) return a; // op_of reports the error
    const double share = (*time - samples.before->first) / (samples.after->first - samples.before->first);
    if (op_kind(op) == "orient" && a.size() == 4) {
        const Eigen::Quaterniond q =
            quaternion(a.data()).normalized().slerp(share, quaternion(b.data()).normalized());
        return std::vector{q.w(), q.x(), q.y(), q.z()};
    }
    std::vector<double> between(a.size());
    for (size_t i = 0; i < a.size(); ++i) between[i] = a[i] + share * (b[i] - a[i]);
    return between;
}

// op: such as "xformOp:rotateXYZ:name".
UsdaTransform UsdaScene::op_of(const UsdaPrim& prim, std::string_view op, std::optional<double> time) const {
    size_t at = prim.at;
    const std::optional<std::vector<double>> numbers = op_numbers(prim, op, time, at);
    if (!numbers)
        fail(at, fmt::format("xformOpOrder names \"{}\", which is not there", op.substr(0, 64)),
             "export the transforms anew");
    for (const double number : *numbers)
        if (!std::isfinite(number))
            fail(at, fmt::format("\"{}\" is not finite", op.substr(0, 64)), "write finite numbers");
    const std::string_view kind = op_kind(op);
    const size_t count = numbers->size();
    const double* n = numbers->data();
    UsdaTransform placing = UsdaTransform::Identity();
    if (kind == "translate" && count == 3) {
        placing.topRightCorner<3, 1>() = Vec3d(n);
    } else if (kind == "scale" && count == 3) {
        placing.topLeftCorner<3, 3>() = Vec3d(n).asDiagonal();
    } else if (kind == "orient" && count == 4 && Eigen::Map<const Vec4d>(n).stableNorm() > 0.0) {
        placing.topLeftCorner<3, 3>() = quaternion(n).normalized().toRotationMatrix();
    } else if (kind == "transform" && count == 16) {
        placing = Eigen::Map<const UsdaTransform>(n); // USD's rows are our columns, as Eigen stores them
        if (placing.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0))
            fail(at, fmt::format("\"{}\" is a perspective", op.substr(0, 64)),
                 "let its last column be 0, 0, 0, 1");
    } else if (kind.starts_with("rotate") && (kind.size() == 7 || kind.size() == 9) &&
               count == kind.size() - 6 && kind.find_first_not_of("XYZ", 6) == std::string_view::npos) {
        Eigen::Matrix3d turn = Eigen::Matrix3d::Identity(); // the first axis turns first
        for (size_t i = 0; i < count; ++i) turn = turned_about(kind[6 + i], n[i]) * turn;
        placing.topLeftCorner<3, 3>() = turn;
    } else {
        fail(at, fmt::format("the transform \"{}\" is not read", op.substr(0, 64)),
             "use translate, rotate, orient, scale or transform");
    }
    return placing;
}

UsdaTransform UsdaScene::transform_of(const UsdaPrim& prim, const UsdaTransform& above,
                                      std::optional<double> time) const {
    UsdaTransform placing = above;
    size_t at = prim.at;
    const auto* order = elements<std::vector<std::string_view>>(prim, "xformOpOrder", &at);
    if (!order) return placing;
    for (std::string_view op : *order) {
        if (op == op_reset) {
            placing = root_;
            continue;
        }
        const bool inverse = op.starts_with(op_inverse);
        if (inverse) op.remove_prefix(op_inverse.size());
        UsdaTransform one = op_of(prim, op, time);
        if (inverse) {
            if (!(std::abs(one.determinant()) > 0.0))
                fail(at, fmt::format("\"{}\" has no inverse", op.substr(0, 64)), "do not scale by 0");
            one = one.inverse().eval();
        }
        placing = (placing * one).eval();
    }
    return placing;
}

std::vector<double> UsdaScene::transform_times(const UsdaPrim& prim) const {
    std::vector<double> times;
    const auto* order = elements<std::vector<std::string_view>>(prim, "xformOpOrder");
    if (!order) return times;
    for (std::string_view op : *order) {
        if (op.starts_with(op_inverse)) op.remove_prefix(op_inverse.size());
        for (const auto& [time, value] : prim.samples(op)) times.push_back(time);
    }
    return times;
}

bool is_usda_def(const UsdaPrim& prim) {
    const std::string_view active = find_metadata(prim.metadata, "active");
    return prim.specifier == "def" && active != "false" && active != "0";
}

} // namespace marram
