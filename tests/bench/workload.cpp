// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload.h"

#include "core/math/nearest_point.h"
#include "core/plugin/embree.h"
#include "procedural/wind/bend.h"
#include "procedural/wind/blade/blade.h"
#include "procedural/wind/blade/elastica.h"
#include "procedural/wind/keyed_wind.h"
#include "procedural/wind/shield.h"
#include "tests/bench/fields.h"

#include <tbb/parallel_for.h>

#include <array>
#include <atomic>

namespace marram::bench {
namespace {

// Calls visit(mesh, triangle, limit) for every triangle that may lie within `radius` of `centre`; others may
// be visited too. visit returns the radius to continue with: the same, a smaller one (farther triangles are
// then skipped), or a negative one to stop. Visits nothing if centre or radius is not finite. Cost: about 0.1
// us if there is nothing, 10 ns a triangle.
template <typename Visit>
void near_triangles(const Colliders& colliders, const Vec3d& centre, double radius, Visit&& visit) {
    // Embree's nodes are boxes of floats: the radius grows by their possible rounding error.
    const double spare = 4.0 * 0x1p-24 * (centre.cwiseAbs().maxCoeff() + radius);
    const double limit = radius + spare;
    if (!(limit < 1e18) || !(centre.cwiseAbs().maxCoeff() < 1e18)) return;
    struct Call {
        const Colliders& colliders;
        std::remove_reference_t<Visit>& visit;
        double radius, spare;
        bool stopped;
    } call{colliders, visit, radius, spare, false};
    RTCPointQuery query;
    query.x = float(centre.x());
    query.y = float(centre.y());
    query.z = float(centre.z());
    query.time = colliders.time;
    query.radius = float(limit * (1.0 + 0x1p-22));
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(
        colliders.scene, &query, &context,
        [](RTCPointQueryFunctionArguments* args) {
            Call& c = *static_cast<Call*>(args->userPtr);
            const MarramMesh* mesh = c.colliders.mesh_of(args->geomID);
            if (c.stopped || !mesh) return false;
            const double wanted = c.visit(*mesh, args->primID, c.radius);
            if (wanted >= c.radius) return false;
            c.stopped = wanted < 0.0;
            c.radius = wanted;
            args->query->radius = c.stopped ? 0.0F : float((wanted + c.spare) * (1.0 + 0x1p-22));
            return true;
        },
        &call);
}

Wind gusty_wind() {
    Wind wind = plain_wind(Vec3d::UnitX(), 0.6);
    wind.calm = 0.6;
    Gusts gusts;
    gusts.num_gusts = 50;
    gusts.radius = {0.3, 0.6};
    gusts.speed = {2.0, 4.0};
    gusts.start_frame = {-24.0, 24.0};
    gusts.life = {40.0, 60.0};
    gusts.decay = {8.0, 8.0};
    gusts.ramp = Ramp(std::vector<double>{0, 1, 1, 0}, "smooth");
    set_gust_plane(gusts, Vec3d::Constant(-1.3), Vec3d::Constant(1.3), wind.direction);
    wind.gusts = gusts;
    Shielding shielding;
    shielding.shield = 0.7;
    shielding.offset = 0.8;
    shielding.per_cv = true;
    wind.shielding = shielding;
    wind.collision = Collision{};
    wind.collision->offset_scale = 0.3;
    return wind;
}

// Keys of speed, direction and strength that change the wind by so little that strands stay where they are.
void key(Wind& wind) {
    constexpr std::array frames = {-240.0, 480.0};
    const double speed = wind.speed, rotate = wind.global_rotate;
    const std::array speeds = {speed, (1.0 + 1e-9) * speed}, rotates = {rotate, (1.0 + 1e-9) * rotate};
    constexpr std::array directions = {1.0, 0.0, 0.0, 1.0, 0.0, 1e-7};
    std::array<MarramKeyframes, 3> keys;
    std::array<MarramValue, 3> values{};
    const auto set = [&](size_t i, const char* name, std::span<const double> numbers) {
        keys[i] = {sizeof(MarramKeyframes), 2, frames.data(), numbers.data(), "linear"};
        values[i].name = name;
        values[i].numbers = numbers.data();
        values[i].number_count = numbers.size() / 2;
        values[i].text = values[i].place = "";
        values[i].keyframes = &keys[i];
    };
    set(0, "wind.speed", speeds);
    set(1, "wind.direction", directions);
    set(2, "wind.global_rotate", rotates);
    read_keys(Values(values), wind);
}

Vec3f lane_of(const Wide3f& v, int lane) { return {v.x[lane], v.y[lane], v.z[lane]}; }

template <typename Visit>
void each_cv(const std::vector<Strands>& patches, Visit&& visit) { // visit(patch, strand, k)
    for (const Strands& patch : patches)
        for (int i = 0; i < patch.count; ++i)
            for (int k = 0; k < patch.cvs; ++k) visit(patch, i, k);
}

// Positions at the motion samples from the second on: the sphere swells and leans.
std::vector<std::vector<FurredWorld::Positions>> deformed(const Mesh& mesh, uint32_t keys) {
    std::vector<FurredWorld::Positions> later(keys - 1, mesh.positions);
    for (uint32_t t = 1; t < keys; ++t)
        for (Vec3f& p : later[t - 1]) {
            const float much = 0.04F * float(t) / float(keys - 1);
            p += much * Vec3f(p.y(), std::sin(4.0F * p.x()), p.z());
        }
    return {later};
}

size_t at(const Strands& patch, int strand, int k) {
    return size_t(strand / lanes) * size_t(patch.cvs) + size_t(k);
}

} // namespace

Workload::Workload(const Size& size)
    : wind_(gusty_wind()), groom_(plain_coat(size.strands, size.cvs, 0.18, 0.26, size.width)),
      world_({sphere_mesh(1.0F, size.divisions, 0.03F, 9.0F)},
             deformed(sphere_mesh(1.0F, size.divisions, 0.03F, 9.0F), size.keys)),
      keys_(size.keys) {
    if (size.jiggles) {
        Jiggle jiggle;
        jiggle.stiffness = Ramp(std::vector<double>{0, 4, 1, 1}, "linear");
        jiggle.step = 0.5; // as `marram render scenes/talk.toml` chooses it
        wind_.jiggle = jiggle;
    }
    if (size.keyed) key(wind_);
    for (int k = 0; k < size.cvs; ++k)
        profile_.push_back(float(0.5 * groom_.width_profile(double(k) / (size.cvs - 1))));
    chain_ = frame_chain();
    roots_ = place_roots(groom_, world_.surface(0), [] { return false; }).roots;
    if (size.strands >= F.strands) return; // the literal baseline would take too much memory
    for (uint32_t t = 0; t < keys_; ++t) {
        std::vector<Strands>& rest =
            rest_.emplace_back(grow(groom_, wind_, SkinPoses{world_.surface(0), world_.surface(0, t)}));
        LiteralStrands& literal = literal_.emplace_back();
        literal.cvs = size.cvs;
        each_cv(rest, [&](const Strands& patch, int i, int k) {
            literal.rest.push_back(lane_of(patch.rest[at(patch, i, k)], i % lanes));
        });
    }
    bent_ = rest_[0];
    ChainScratch scratch;
    for (Strands& patch : bent_) marram::run_chain(chain_, 0, patch, scratch);
}

ChainFrame Workload::frame_chain() {
    return make_chain_frame({wind_, whole_, world_.frame(), &world_.mesh(0), profile_, MARRAM_BSPLINE});
}

namespace {
constexpr double shown_frame = 24.0, tolerance = 1e-3, longest = 0.26; // m
} // namespace

double Workload::run_frame(double time, std::vector<JiggleState>* kept) {
    MarramFrame frame = world_.frame();
    frame.frame = time;
    frame.times = &time;
    frame.tolerance = tolerance;
    const JiggleWindow window =
        jiggle_window(*wind_.jiggle, std::span(&time, 1), frame.fps, 2.0 * longest, tolerance);
    ChainInput input{wind_, whole_, frame, &world_.mesh(0), profile_, MARRAM_BSPLINE, window};
    input.trees = &trees_;
    input.past_wind = past_wind_.get();
    const ChainFrame chain = make_chain_frame(input);
    past_wind_ = chain.past_wind;
    if (kept) kept->resize(rest_[0].size());
    return seconds_of([&] {
        tbb::parallel_for(size_t(0), rest_[0].size(), [&](size_t i) {
            Thread& thread = threads_.local();
            RestStrandSource still;
            still.at_time = [&](auto, Strands& strands) { strands = rest_[0][i]; };
            still.moves = still.moved = false;
            jiggle_patch(chain, still, thread.work, thread.chain, uint32_t(i), kept ? &(*kept)[i] : nullptr);
            marram::run_chain(chain, 0, thread.work, thread.chain);
        });
    });
}

double Workload::run_next_frame() { return run_frame(next_frame_++, &kept_); }

double Workload::run_next_frame_literally() {
    const MarramFrame frame = world_.frame();
    const Colliders& colliders = chain_.instants[0].colliders;
    const GustField field = gusts_at(*wind_.gusts, wind_.direction, next_literal_frame_++, frame.fps);
    return seconds_of([&] {
        simulate_literally(wind_, frame.fps, field, colliders,
                           shelter_literally(wind_, colliders, literal_[0]), true, literal_[0]);
    });
}

double Workload::run_chain() {
    if (wind_.jiggle) return run_frame(shown_frame, nullptr);
    return seconds_of([&] {
        if (keys_ > 1) chain_ = frame_chain();
        tbb::parallel_for(size_t(0), rest_[0].size(), [&](size_t i) {
            Thread& thread = threads_.local();
            for (uint32_t t = 0; t < keys_; ++t) {
                thread.work = rest_[t][i];
                marram::run_chain(chain_, t, thread.work, thread.chain);
            }
        });
    });
}

double Workload::run_literally() {
    if (wind_.jiggle) {
        const MarramFrame frame = world_.frame();
        const Colliders& colliders = chain_.instants[0].colliders;
        const JiggleWindow window =
            jiggle_window(*wind_.jiggle, std::span(&shown_frame, 1), frame.fps, 2.0 * longest, tolerance);
        const double first = shown_frame - std::ceil(double(window.length) * wind_.jiggle->step);
        std::vector<GustField> fields;
        for (double f = first; f <= shown_frame; ++f)
            fields.push_back(gusts_at(*wind_.gusts, wind_.direction, f, frame.fps));
        LiteralStrands& strands = literal_[0];
        strands.swung.clear();
        strands.velocity.clear();
        return seconds_of([&] {
            const std::vector<float> shelter = shelter_literally(wind_, colliders, strands);
            for (const GustField& field : fields)
                simulate_literally(wind_, frame.fps, field, colliders, shelter, &field == &fields.back(),
                                   strands);
        });
    }
    return seconds_of([&] {
        for (uint32_t t = 0; t < keys_; ++t)
            blow_literally(wind_, chain_.instants[t].wind.gusts, chain_.instants[t].colliders, literal_[t]);
    });
}

double Workload::run_floor() {
    const Colliders& colliders = chain_.instants[0].colliders;
    std::atomic<size_t> seen{0}; // keeps the compiler from removing the queries
    return seconds_of([&] {
        tbb::parallel_for(size_t(0), bent_.size(), [&](size_t p) {
            Thread& thread = threads_.local();
            thread.work = rest_[0][p];
            shield(*wind_.shielding, wind_.direction, colliders, {}, thread.work);
            size_t found = 0;
            const auto ask = [&](const Vec3f& where, double radius, bool nearest) {
                near_triangles(colliders, where.cast<double>(), radius,
                               [&](const MarramMesh& mesh, uint32_t triangle, double limit) {
                                   ++found;
                                   if (!nearest) return limit;
                                   const Vec3d q = where.cast<double>();
                                   return std::min(
                                       limit,
                                       (nearest_point(colliders.corners(mesh, triangle), q) - q).norm());
                               });
            };
            const Strands &rest = rest_[0][p], &bent = bent_[p];
            for (int i = 0; i < rest.count; ++i)
                for (int k = 1; k < rest.cvs; ++k) {
                    const int lane = i % lanes;
                    const Vec3f from = lane_of(rest.rest[at(rest, i, k - 1)], lane),
                                end = lane_of(rest.rest[at(rest, i, k)], lane),
                                turned = lane_of(bent.pose[at(bent, i, k)], lane);
                    const auto reach = double((end - from).norm());
                    ask(end, reach, true);
                    ask(turned, reach, true);
                    ask(from, reach, false);
                }
            seen += found;
        });
    });
}

double Workload::run_from_roots() {
    constexpr size_t patch = 512;
    const auto cvs = size_t(groom_.cvs), stride = cvs + 2;
    vertices_.resize(roots_.size() * stride * 4);
    const Surface surface = world_.surface(0);
    return seconds_of([&] {
        tbb::parallel_for(size_t(0), (roots_.size() + patch - 1) / patch, [&](size_t p) {
            const size_t first = p * patch, count = std::min(patch, roots_.size() - first);
            Thread& thread = threads_.local();
            Strands& strands = thread.work;
            strands.resize(int(count), groom_.cvs, false);
            expand(groom_, wind_, {surface, surface}, std::span(roots_).subspan(first, count), strands);
            marram::run_chain(chain_, 0, strands, thread.chain);
            for (size_t i = 0; i < count; ++i) {
                float* out = vertices_.data() + (first + i) * stride * 4;
                const auto put = [&](size_t slot, const Vec3f& at, size_t k) {
                    std::copy_n(at.data(), 3, out + 4 * slot);
                    out[4 * slot + 3] = float(strands.width[i / lanes][i % lanes]) * profile_[k];
                };
                const auto cv = [&](size_t k) {
                    return lane_of(strands.pose[i / lanes * cvs + k], int(i % lanes));
                };
                for (size_t k = 0; k < cvs; ++k) put(k + 1, cv(k), k);
                put(0, 2.0F * cv(0) - cv(1), 0);
                put(cvs + 1, 2.0F * cv(cvs - 1) - cv(cvs - 2), cvs - 1);
            }
        });
    });
}

double Workload::build_bvh() {
    const auto cvs = size_t(groom_.cvs), stride = cvs + 2;
    RTCDevice device = world_.frame().device;
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, vertices_.data(), 0,
                               16, vertices_.size() / 4);
    auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, roots_.size() * (cvs - 1)));
    for (size_t i = 0; i < roots_.size(); ++i)
        for (size_t k = 0; k + 1 < cvs; ++k) *indices++ = unsigned(i * stride + k);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    const double seconds = seconds_of([&] { rtcCommitScene(scene); });
    rtcReleaseScene(scene);
    return seconds;
}

double Workload::seconds_of_field(const PlacedField& field, double frame) {
    const std::vector<FieldAt> fields = fields_at({&field, 1}, frame), none;
    const auto seconds = [&](const std::vector<FieldAt>& list) {
        return seconds_of([&] {
            for (Strands& patch : bent_)
                local_wind({wind_.direction, wind_.speed, wind_.response, list}, patch);
        });
    };
    seconds(none);
    const double without = seconds(none);
    seconds(fields);
    return seconds(fields) - without;
}

double Workload::run_field() { return seconds_of_field(whirl_field(), 1.0); }
double Workload::run_field_grid() {
    static const PlacedField field = grid_field(1, false);
    return seconds_of_field(field, 1.0);
}
double Workload::run_field_between_frames() {
    static const PlacedField field = grid_field(2, false);
    return seconds_of_field(field, 1.4);
}
double Workload::run_field_staggered() {
    static const PlacedField field = grid_field(1, true);
    return seconds_of_field(field, 1.0);
}
double Workload::run_field_staggered_between() {
    static const PlacedField field = grid_field(2, true);
    return seconds_of_field(field, 1.4);
}
double Workload::run_field_image() {
    static const PlacedField field = image_field();
    return seconds_of_field(field, 1.0);
}
double Workload::run_field_curves() {
    static const PlacedField field = curves_field();
    return seconds_of_field(field, 1.0);
}

double Workload::run_ground() {
    HeightGrid hill{513, 513, 0.05, -12.8, -12.8, std::vector<float>(513 * 513)};
    for (int j = 0; j < hill.nz; ++j)
        for (int i = 0; i < hill.nx; ++i)
            hill.heights[hill.index(i, j)] = float(std::exp(
                -0.1 * (std::pow(hill.x0 + i * hill.cell, 2) + std::pow(hill.z0 + j * hill.cell, 2))));
    GroundAir air(std::move(hill));
    const GroundAir::At over = air.at(wind_.direction, false);
    const auto seconds = [&](const GroundAir::At& ground) {
        return seconds_of([&] {
            for (Strands& patch : bent_)
                local_wind({wind_.direction, wind_.speed, wind_.response, {}, ground}, patch);
        });
    };
    seconds({});
    const double without = seconds({});
    return seconds(over) - without;
}

double Workload::run_bend() {
    for (Strands& patch : bent_) std::ranges::fill(patch.envelope, splat_float(0.5F));
    return seconds_of([&] {
        for (Strands& patch : bent_) marram::bend(wind_, 24.0, 24.0, patch);
    });
}

double Workload::run_blades(double ca) {
    constexpr double speed = 5.0, length = 0.22; // m/s, m: the mean strand
    Wind wind = wind_;
    set_blade_wind(wind);
    Blade blade;
    const Ramp whole(std::vector<double>{0, 1}, "linear");
    blade.flat = false;
    blade.taper = blade.mass_taper = blade.width_profile = whole;
    blade.width = 0.009;
    blade.drag = 1.0;
    blade.rigidity = 0.5 * blade.air_density * blade.width * speed * speed * length * length * length / ca;
    blade.tolerance = 1e-3 * length;
    blade.pieces = elastica_pieces(bent_.front().cvs, ca, 0.0, 1e-3);
    for (Strands& patch : bent_)
        std::ranges::fill(patch.envelope, splat_float(float(speed / blade_response_speed)));
    return seconds_of([&] {
        for (Strands& patch : bent_) bend_blades(wind, blade, 24.0, 24.0, patch);
    });
}

size_t Workload::strands() const { return roots_.size(); }

double Workload::make_tree() {
    return seconds_of([&] { world_.colliders(); });
}

StageClock Workload::clock() const {
    StageClock sum;
    for (const Thread& thread : threads_) sum += thread.chain.clock;
    return sum;
}

} // namespace marram::bench
