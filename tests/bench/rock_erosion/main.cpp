// SPDX-License-Identifier: Apache-2.0
// Measures the wear of rock, and prints tables. Its speed: build/marram_bench.
//
//     rock_erosion sphere              a sphere worn evenly: error and order
//     rock_erosion planes              planes at angles to the grid
//     rock_erosion parity              each level against the next finer one, smoothed
//     rock_erosion mesh                meshes of level sets beside those of OpenVDB's volumeToMesh
//     rock_erosion ventifact OUT [voxel]    writes OUT.0.obj, OUT.1.obj, ...: one per level
//     rock_erosion yardang OUT [voxel]
#include "core/math/clock.h"
#include "procedural/erosion/erosion.h"
#include "tests/unit/erosion/rock_shapes.h"

#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace marram::testing {
namespace {

void print_sphere() {
    std::printf("a sphere of 1 m loses 0.5 m evenly\n%8s %8s %10s %10s %8s %10s %14s\n", "voxel", "passes",
                "error h", "error m", "order", "spread h", "volume ratio");
    double before = 0.0;
    for (const int n : {10, 20, 40, 80}) {
        const double h = 1.0 / n;
        const SphereWear wear = wear_sphere(h);
        std::printf("%8.4f %8d %10.4f %10.6f %8.2f %10.4f %14.5f\n", h, wear.passes, wear.error / h,
                    wear.error, before > 0.0 ? std::log2(before / wear.error) : 0.0, wear.spread / h,
                    wear.removed / wear.integral);
        before = wear.error;
    }
}

void print_planes() {
    std::printf("planes lose 20 times 0.37 h; error of the depth in h\n%8s %8s %10s %10s %10s\n", "about x",
                "about z", "mean", "least", "greatest");
    for (const double x : {0.0, 0.2, 0.4636, 0.7854})
        for (const double z : {0.0, 0.3, 0.7854}) {
            const double h = 1.0 / 40.0;
            const PlaneWear wear = wear_plane(x, z, h, 0.37);
            std::printf("%8.3f %8.3f %10.5f %10.5f %10.5f\n", x, z, wear.mean / h, wear.least / h,
                        wear.greatest / h);
        }
}

// Meshes of one shape: seconds, medians of runs in turn, and the distance of the vertices from the shape in
// voxels.
void print_meshes_of(const char* name, const LevelMesh& shape, double voxel,
                     const std::function<double(const Vec3d&)>& distance) {
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec3I> faces;
    for (size_t v = 0; v < shape.positions.size(); v += 3)
        points.emplace_back(float(double(shape.positions[v]) / voxel),
                            float(double(shape.positions[v + 1]) / voxel),
                            float(double(shape.positions[v + 2]) / voxel));
    for (size_t t = 0; t < shape.triangles.size(); t += 3)
        faces.emplace_back(shape.triangles[t], shape.triangles[t + 1], shape.triangles[t + 2]);
    const openvdb::tools::QuadAndTriangleDataAdapter<openvdb::Vec3s, openvdb::Vec3I> adapter(points, faces);
    const auto grid = openvdb::tools::meshToVolume<openvdb::FloatGrid>(
        adapter, *openvdb::math::Transform::createLinearTransform(1.0), 3.0F, 3.0F);
    const LevelSet rock = LevelSet::from_mesh(shape.positions, shape.triangles, voxel);
    struct Row {
        std::vector<double> seconds;
        double most = 0.0, squares = 0.0;
        size_t count = 0;
        void add(double d) { most = std::max(most, std::abs(d)), squares += d * d, ++count; }
    } rows[2];
    constexpr int runs = 7;
    for (int run = 0; run < runs; ++run) {
        LevelSet own = rock;
        double start = wall_seconds();
        const LevelMesh& mesh = own.mesh();
        rows[0].seconds.push_back(wall_seconds() - start);
        start = wall_seconds();
        std::vector<openvdb::Vec3s> vertices;
        std::vector<openvdb::Vec4I> quads;
        openvdb::tools::volumeToMesh(*grid, vertices, quads);
        rows[1].seconds.push_back(wall_seconds() - start);
        if (run > 0) continue;
        for (size_t v = 0; v < mesh.positions.size(); v += 3)
            rows[0].add(distance({mesh.positions[v], mesh.positions[v + 1], mesh.positions[v + 2]}) / voxel);
        for (const openvdb::Vec3s& p : vertices)
            rows[1].add(distance(voxel * Vec3d(p.x(), p.y(), p.z())) / voxel);
    }
    for (Row& row : rows) {
        std::ranges::sort(row.seconds);
        std::printf("%8s %14s %9zu %9.3f %9.4f %9.4f\n", name, &row == rows ? "level set" : "volumeToMesh",
                    row.count, row.seconds[runs / 2], std::sqrt(row.squares / double(row.count)), row.most);
    }
}

void print_meshes() {
    std::printf("%8s %14s %9s %9s %9s %9s   distances in voxels\n", "shape", "mesh", "vertices", "seconds",
                "rms", "most");
    const double h = 1.0 / 256.0;
    print_meshes_of("sphere", rock_sphere(Vec3d::Zero(), 0.95, 600), h,
                    [](const Vec3d& p) { return p.norm() - 0.95; });
    const Eigen::Matrix3d turn =
        (Eigen::AngleAxisd(0.37, Vec3d::UnitX()) * Eigen::AngleAxisd(0.61, Vec3d::UnitY()))
            .toRotationMatrix();
    print_meshes_of("planes", rock_box(Vec3d::Zero(), Vec3d::Constant(0.5), turn), h, [&](const Vec3d& p) {
        const Vec3d q = (turn.transpose() * p).cwiseAbs();
        Vec3d sorted = q;
        std::ranges::sort(sorted);
        return sorted[1] > 0.48 ? 0.0 : sorted[2] - 0.5; // not at the edges
    });
}

struct RockDevice {
    RTCDevice device = rtcNewDevice(nullptr);
    ~RockDevice() { rtcReleaseDevice(device); }
};

struct Showcase {
    LevelMesh rock;
    ErosionSettings settings;
    std::vector<RockWind> winds;
};

// A boulder of layered sandstone on a plain, worn by two winds: facets that meet in a keel.
Showcase ventifact(double voxel) {
    Showcase show;
    show.rock = rock_box({0.0, 0.12, 0.0}, {0.24, 0.17, 0.18},
                         (Eigen::AngleAxisd(0.5, Vec3d::UnitY()) * Eigen::AngleAxisd(0.12, Vec3d::UnitX()))
                             .toRotationMatrix());
    show.settings.voxel = voxel;
    show.settings.levels = 3;
    show.settings.years = 800.0;
    HardnessSettings& hard = show.settings.hardness;
    hard.strata.thickness = 0.03, hard.strata.contrast = 1.6, hard.strata.dip = 15.0 * degree;
    hard.noise = 1.5, hard.noise_length = 0.1;
    for (const double azimuth : {35.0 * degree, 155.0 * degree}) {
        RockWind wind{rock_grains(azimuth, 600000), 1.0};
        wind.grains.height = 0.15;
        show.winds.push_back(wind);
    }
    return show;
}

// A block of layered sandstone along one wind.
Showcase yardang(double voxel) {
    Showcase show;
    show.rock = rock_box({0.0, 0.7, 0.0}, {3.0, 0.9, 1.1});
    show.settings.voxel = voxel;
    show.settings.levels = 3;
    show.settings.years = 2500.0;
    HardnessSettings& hard = show.settings.hardness;
    hard.strata.thickness = 0.3, hard.strata.contrast = 5.0, hard.strata.laminae = 0.4;
    hard.strata.dip = 6.0 * degree, hard.strata.fold = 0.06, hard.strata.fold_length = 3.0;
    hard.noise = 2.0, hard.noise_length = 0.8;
    RockWind wind{rock_grains(0.0, 1500000), 1.0};
    wind.grains.height = 0.5, wind.grains.speed_height = 1.0, wind.grains.speed = 14.0,
    wind.grains.transport = 1e5;
    wind.grains.reach = 6.0;
    show.winds.push_back(wind);
    return show;
}

void write_obj(const std::string& file, const LevelMesh& mesh) {
    std::FILE* const out = std::fopen(file.c_str(), "w");
    if (!out) return;
    for (size_t v = 0; v < mesh.positions.size(); v += 3)
        std::fprintf(out, "v %.6g %.6g %.6g\n", double(mesh.positions[v]), double(mesh.positions[v + 1]),
                     double(mesh.positions[v + 2]));
    for (size_t v = 0; v < mesh.normals.size(); v += 3)
        std::fprintf(out, "vn %.4f %.4f %.4f\n", double(mesh.normals[v]), double(mesh.normals[v + 1]),
                     double(mesh.normals[v + 2]));
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const unsigned a = mesh.triangles[t] + 1, b = mesh.triangles[t + 1] + 1,
                       c = mesh.triangles[t + 2] + 1;
        std::fprintf(out, "f %u//%u %u//%u %u//%u\n", a, a, b, b, c, c);
    }
    std::fclose(out);
}

void print_parities(ErosionResult& result) {
    std::printf("%6s %6s %10s %10s %10s   in voxels of the coarse level\n", "coarse", "fine", "rms", "99 %",
                "most");
    for (size_t a = 0; a + 1 < result.levels.size(); ++a)
        for (size_t b = a + 1; b < result.levels.size(); ++b) {
            const LevelParity p = level_parity(result.levels[a].rock, result.levels[b].rock);
            std::printf("%6zu %6zu %10.3f %10.3f %10.3f\n", a, b, p.rms, p.at_99, p.most);
        }
}

void show(const Showcase& given, const std::string& out) {
    const RockDevice device;
    const ErosionHooks hooks{{}, [](double share, const std::string& words) {
                                 std::fprintf(stderr, "\r%3.0f %%  %s  ", 100.0 * share, words.c_str());
                             }};
    ErosionResult result = erode(given.rock.positions, given.rock.triangles, given.settings,
                                 grain_wear({.device = device.device, .winds = given.winds}), hooks);
    std::fprintf(stderr, "\n");
    std::printf("%6s %9s %7s %9s %9s %7s %9s %9s\n", "level", "voxel", "passes", "m^3", "removed", "pieces",
                "vertices", "seconds");
    for (size_t n = 0; n < result.levels.size(); ++n) {
        ErosionLevel& level = result.levels[n];
        if (!out.empty()) write_obj(out + "." + std::to_string(n) + ".obj", level.rock.mesh());
        std::printf("%6zu %9.4f %7d %9.4f %9.4f %7zu %9zu %9.2f\n", n, level.rock.voxel(), level.passes,
                    level.start, level.removed, level.pieces, level.rock.mesh().vertex_count(),
                    level.seconds);
    }
    std::printf("%.0f years of %.0f\n", result.years, given.settings.years);
    print_parities(result);
}

void print_parity() {
    Showcase rock = ventifact(0.005);
    rock.settings.levels = 4; // three octaves
    show(rock, "");
}

} // namespace
} // namespace marram::testing

int main(int count, char** words) {
    using namespace marram::testing;
    const std::string what = count > 1 ? words[1] : "";
    const auto number = [&](int n, double otherwise) { return count > n ? std::atof(words[n]) : otherwise; };
    if (what == "sphere")
        print_sphere();
    else if (what == "planes")
        print_planes();
    else if (what == "parity")
        print_parity();
    else if (what == "mesh")
        print_meshes();
    else if (what == "ventifact" && count > 2)
        show(ventifact(number(3, 0.004)), words[2]);
    else if (what == "yardang" && count > 2)
        show(yardang(number(3, 0.025)), words[2]);
    else
        return std::printf("rock_erosion sphere | planes | parity | mesh | ventifact OUT "
                           "[voxel] | yardang OUT [voxel]\n"),
               2;
    return 0;
}
