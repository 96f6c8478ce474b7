// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/surface.h"

namespace marram {

SurfaceFrame frame_at(const Surface& surface, uint32_t triangle, const Vec3d& weights) {
    const auto p = surface.corners(triangle);
    const Vec3d plane = plane_normal(p);
    Vec3d normal = plane;
    if (surface.normals) {
        Vec3d sum = Vec3d::Zero();
        for (int i = 0; i < 3; ++i) {
            const float* n =
                surface.normals + 3 * size_t(surface.triangles[3 * size_t(triangle) + size_t(i)]);
            sum += weights[i] * Vec3d(double(n[0]), double(n[1]), double(n[2]));
        }
        // If the vertex normals cancel or point inwards, use the plane's normal.
        if (sum.dot(plane) > 0.0 && sum.norm() > 1e-3) normal = sum.normalized();
    }
    Vec3d tangent = p[1] - p[0];
    tangent -= normal * normal.dot(tangent);
    // The edge lies in the plane, and the normal is within a right angle of the plane's normal. So the
    // projected edge vanishes only by rounding in slivers, where any tangent will do.
    const double left = tangent.norm();
    if (left > 1e-6 * (p[1] - p[0]).norm()) {
        tangent /= left;
    } else {
        Vec3d unused;
        orthonormal_basis<double>(normal, tangent, unused);
    }
    return {tangent, normal.cross(tangent), normal};
}

} // namespace marram
