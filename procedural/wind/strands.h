// SPDX-License-Identifier: Apache-2.0
// The strands of one patch on their way through the chain: structure of arrays, eight strands side by side.
//
// Element [block * cvs + k] holds CV k of strands 8 * block ... 8 * block + 7. Positions are the floats that will be stored;
// stages compute in double from them and round once. The lanes behind the last strand repeat it.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

namespace marram {

struct Strands {
    int count = 0;  // strands
    int cvs = 0;    // a strand
    int blocks = 0; // of eight strands
    bool oriented = false;
    bool has_wind_share = false; // else all take the whole wind
    const MarramMesh* instance = nullptr; // that they stand on instead of the chain's skin
    bool irregular = false;               // the segments of a strand differ in length, and CVs have radii of their own

    WideVector<Wide3f> rest, pose;               // [blocks * cvs]
    WideVector<Wide3f> rest_normal, pose_normal; // [blocks * cvs] where `oriented`, else empty
    WideVector<VFloat> gust;                     // [blocks * cvs], sum of the gusts' influence, not clamped
    WideVector<VFloat> envelope;                 // [blocks * cvs], 0 ... 1
    WideVector<VFloat> shield;                   // [blocks * cvs], 0 ... 1: sheltered share
    WideVector<Wide3d> anchor;                   // [blocks]: where noise is sampled from
    WideVector<Wide3d> root_normal;              // [blocks]: of the skin, unit
    WideVector<VDouble> width;                   // [blocks]: of a strand, metres; its profile scales it
    WideVector<VFloat> wind_share;               // [blocks] where has_wind_share: factor of the envelope
    WideVector<VDouble> u;     // [blocks * cvs] where irregular, else CV k is at k / (cvs - 1)
    WideVector<VFloat> radius; // [blocks * cvs] where irregular, metres
    WideVector<Wide3d> points; // [cvs] scratch
    WideVector<Wide3f> values; // [2 * cvs] scratch

    size_t bytes() const {
        return (rest.capacity() + pose.capacity() + rest_normal.capacity() + pose_normal.capacity() +
                values.capacity()) *
                   sizeof(Wide3f) +
               (envelope.capacity() + shield.capacity() + gust.capacity() + radius.capacity()) *
                   sizeof(VFloat) +
               (anchor.capacity() + root_normal.capacity() + points.capacity()) * sizeof(Wide3d) +
               (width.capacity() + u.capacity()) * sizeof(VDouble);
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
        anchor.resize(size_t(blocks));
        root_normal.resize(size_t(blocks));
        width.resize(size_t(blocks));
        wind_share.resize(has_wind_share ? size_t(blocks) : 0);
        u.resize(irregular ? size : 0);
        radius.resize(irregular ? size : 0);
        points.resize(size_t(cvs));
        values.resize(size_t(cvs) * 2);
    }
};

} // namespace marram
