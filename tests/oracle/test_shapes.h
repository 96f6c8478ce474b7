// SPDX-License-Identifier: Apache-2.0
// Meshes that the oracle's tests share.
#pragma once

#include "core/math/hash.h"
#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

inline const Vec3d x = Vec3d::UnitX(), y = Vec3d::UnitY(), z = Vec3d::UnitZ();

// A sequence of random numbers from a seed; for tests only.
class Draw {
  public:
    explicit Draw(uint64_t seed) : seed_(seed) {}
    double unit() { return unit_double(hash(seed_, next_++)); }
    double signed_unit() { return 2.0 * unit() - 1.0; }
    Vec3d in_cube() { return {signed_unit(), signed_unit(), signed_unit()}; }
    Vec3d direction() {
        for (;;)
            if (const Vec3d v = in_cube(); v.norm() > 0.1 && v.norm() < 1.0) return v.normalized();
    }
    int below(int n) { return int(unit() * n); }

  private:
    uint64_t seed_, next_ = 0;
};

// Two triangles around the origin in the plane y = height, facing up.
inline std::vector<Triangle> floor_mesh(double height, double half_width) {
    const double w = half_width;
    const Vec3d a(-w, height, -w), b(-w, height, w), c(w, height, w), d(w, height, -w);
    return {{a, b, c}, {a, c, d}};
}

// The six faces of an axis-parallel box, facing out.
inline std::vector<Triangle> box_mesh(const Vec3d& low, const Vec3d& high) {
    std::vector<Triangle> mesh;
    for (int axis = 0; axis < 3; ++axis)
        for (int side = 0; side < 2; ++side) {
            auto corner = [&](int i, int j) {
                Vec3d p;
                p[axis] = side == 1 ? high[axis] : low[axis];
                p[(axis + 1) % 3] = i == 1 ? high[(axis + 1) % 3] : low[(axis + 1) % 3];
                p[(axis + 2) % 3] = j == 1 ? high[(axis + 2) % 3] : low[(axis + 2) % 3];
                return p;
            };
            const Vec3d a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
            if (side == 1)
                mesh.insert(mesh.end(), {{a, b, c}, {a, c, d}});
            else
                mesh.insert(mesh.end(), {{a, c, b}, {a, d, c}});
        }
    return mesh;
}

// A sphere of rows x 2 rows quads, cut in triangles facing out; radius(direction) makes it bumpy.
template <typename Radius>
std::vector<Triangle> sphere_mesh(int rows, Radius&& radius) {
    auto at = [&](int i, int j) {
        if (i == 0 || i == rows)
            return Vec3d(Vec3d::UnitY() * (i == 0 ? 1.0 : -1.0) * radius(Vec3d::UnitY()));
        const double theta = pi * i / rows, phi = pi * (j % (2 * rows)) / rows;
        const Vec3d u(std::sin(theta) * std::cos(phi), std::cos(theta), -std::sin(theta) * std::sin(phi));
        return Vec3d(u * radius(u));
    };
    std::vector<Triangle> mesh;
    for (int i = 0; i < rows; ++i)
        for (int j = 0; j < 2 * rows; ++j) {
            const Vec3d a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
            if (i + 1 < rows) mesh.push_back({a, b, c});
            if (i > 0) mesh.push_back({a, c, d});
        }
    return mesh;
}

// Random triangles in a cube of half-width 1; one in eight is degenerate, one in eight repeats an earlier
// one.
inline std::vector<Triangle> soup(Draw& draw, int count, double size) {
    std::vector<Triangle> mesh;
    for (int i = 0; i < count; ++i) {
        const Vec3d at = draw.in_cube();
        Triangle t{at + size * draw.in_cube(), at + size * draw.in_cube(), at + size * draw.in_cube()};
        const int kind = draw.below(24);
        if (kind == 0) t.c = t.a;
        if (kind == 1) t.b = t.c = t.a;
        if (kind == 2) t.c = t.a + 0.5 * (t.b - t.a);
        if (kind >= 3 && kind < 6 && i > 0) t = mesh[size_t(draw.below(i))];
        mesh.push_back(t);
    }
    return mesh;
}

inline std::vector<Triangle> moved(std::vector<Triangle> mesh, double scale, const Vec3d& by) {
    for (Triangle& t : mesh) t = {t.a * scale + by, t.b * scale + by, t.c * scale + by};
    return mesh;
}

} // namespace marram::oracle
