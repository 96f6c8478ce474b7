// SPDX-License-Identifier: Apache-2.0
// The strands of one patch as the chain of stages processes them: structure of arrays, eight strands a block.
//
// Element [block * cvs + k] holds CV k of strands 8 * block ... 8 * block + 7. Positions are the floats that
// will be stored; stages compute in double from them and round once. Unused lanes repeat the last strand.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

namespace marram {

inline void set_lane(Wide3d& v, int lane, const Vec3d& value) {
    v.x[lane] = value.x();
    v.y[lane] = value.y();
    v.z[lane] = value.z();
}
// Rounds to float.
inline void set_lane(Wide3f& v, int lane, const Vec3d& value) {
    v.x[lane] = float(value.x());
    v.y[lane] = float(value.y());
    v.z[lane] = float(value.z());
}

// What collision did to a segment.
enum class Contact : unsigned char {
    none,
    contact,    // it stopped at a mesh, or was turned out of one
    unresolved, // it has no free direction
};

struct Strands {
    int count = 0;  // strands
    int cvs = 0;    // a strand
    int blocks = 0; // of eight strands
    bool oriented = false;
    bool has_wind_share = false;          // else every strand takes the full wind
    const MarramMesh* instance = nullptr; // the mesh they grow on instead of the chain's skin
    bool has_contact = false;             // `contact` is wanted
    bool irregular = false; // segments of a strand differ in length, and each CV has its own radius

    WideVector<Wide3f> rest, pose;               // [blocks * cvs]
    WideVector<Wide3f> rest_normal, pose_normal; // [blocks * cvs] if `oriented`, else empty
    WideVector<VFloat> gust;         // [blocks * cvs], sum of the influences of all gusts, not clamped
    WideVector<VFloat> envelope;     // [blocks * cvs], 0 ... 1
    WideVector<VFloat> shield;       // [blocks * cvs], 0 ... 1: sheltered fraction
    WideVector<Wide3d> noise_origin; // [blocks]: root position that noise is sampled from
    WideVector<Wide3d> root_normal;  // [blocks]: normal of the skin at the root, unit
    WideVector<VDouble> width;       // [blocks]: width of a strand, metres; the radius profile scales it
    WideVector<VFloat> wind_share;   // [blocks] if has_wind_share: factor of the envelope
    // Where the wind has fields or ground, else empty: [blocks], at the roots; [blocks * cvs] if wind_at_cvs.
    WideVector<Wide3d> wind_direction;   // unit
    WideVector<VFloat> wind_response;    // response(speed)
    WideVector<VFloat> wind_unsheltered; // the same without the ground's shelter, if rays find shelter, too
    WideVector<VFloat> wind_speed;       // m/s
    bool wind_at_cvs = false;
    WideVector<VFloat>
        canopy; // [blocks * cvs] if strands stand in a canopy, else empty: share of the wind's speed
    WideVector<VFloat> contact; // [blocks * cvs] if has_contact: the Contact of the segment before a CV
    WideVector<VDouble> u;      // [blocks * cvs] if irregular; else CV k is at k / (cvs - 1)
    WideVector<VFloat> radius;  // [blocks * cvs] if irregular, metres
    WideVector<Wide3d> points;  // [cvs] scratch
    WideVector<Wide3f> values;  // [2 * cvs] scratch

    size_t bytes() const {
        return (rest.capacity() + pose.capacity() + rest_normal.capacity() + pose_normal.capacity() +
                values.capacity()) *
                   sizeof(Wide3f) +
               (envelope.capacity() + shield.capacity() + gust.capacity() + wind_share.capacity() +
                radius.capacity() + wind_response.capacity() + wind_unsheltered.capacity() +
                wind_speed.capacity() + canopy.capacity() + contact.capacity()) *
                   sizeof(VFloat) +
               (noise_origin.capacity() + root_normal.capacity() + points.capacity() +
                wind_direction.capacity()) *
                   sizeof(Wide3d) +
               (width.capacity() + u.capacity()) * sizeof(VDouble);
    }

    // Element of wind_direction, wind_response, wind_unsheltered and wind_speed.
    size_t wind_at(int block, int cv) const {
        return wind_at_cvs ? size_t(block) * size_t(cvs) + size_t(cv) : size_t(block);
    }

    // Copies what expansion fills.
    void copy_rest(const Strands& other) {
        canopy.clear();
        rest = other.rest;
        rest_normal = other.rest_normal;
        noise_origin = other.noise_origin;
        root_normal = other.root_normal;
        width = other.width;
        wind_share = other.wind_share;
        u = other.u;
        radius = other.radius;
    }

    void resize(int strand_count, int cvs_per_strand, bool with_normals) {
        count = strand_count;
        cvs = cvs_per_strand;
        oriented = with_normals;
        blocks = (count + lanes - 1) / lanes;
        const size_t size = size_t(blocks) * size_t(cvs);
        rest.resize(size);
        pose.resize(size);
        rest_normal.resize(with_normals ? size : 0);
        pose_normal.resize(with_normals ? size : 0);
        gust.resize(size);
        envelope.resize(size);
        shield.resize(size);
        noise_origin.resize(size_t(blocks));
        root_normal.resize(size_t(blocks));
        width.resize(size_t(blocks));
        wind_share.resize(has_wind_share ? size_t(blocks) : 0);
        contact.assign(has_contact ? size : 0, VFloat{});
        u.resize(irregular ? size : 0);
        radius.resize(irregular ? size : 0);
        points.resize(size_t(cvs));
        values.resize(size_t(cvs) * 2);
    }
};

} // namespace marram
