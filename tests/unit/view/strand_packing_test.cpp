// SPDX-License-Identifier: Apache-2.0
#include "core/view/strand_packing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <set>

namespace marram {
namespace {

// Strands of 3 to 6 CVs in a field, with ids.
struct Field {
    explicit Field(uint32_t strands) {
        curves.name = "grass";
        curves.curve_count = strands;
        curves.offsets = {0};
        AttributeValues ids{"id", 1, MARRAM_PER_CURVE, {}, true, false};
        for (uint32_t s = 0; s < strands; ++s) {
            const uint32_t cvs = 3 + s % 4;
            curves.offsets.push_back(curves.offsets.back() + cvs);
            ids.values.push_back(std::bit_cast<float>(7 * s + 1));
            for (uint32_t v = 0; v < cvs + 2; ++v)
                vertices.insert(vertices.end(), {float(s % 100) * 0.37F, float(v) * 0.11F,
                                                 float(s / 100) * 0.41F, 0.001F * float(cvs + 2 - v)});
        }
        curves.attributes.push_back(std::move(ids));
        curves.vertices = {vertices.data()};
        world.curves.push_back(curves);
    }
    std::vector<float> vertices;
    CurveGeometry curves;
    World world;
};

std::vector<float> positions_of(const StrandPart& part, const WireMessage& message, bool floats) {
    std::vector<float> out(3 * part.first_vertex.back());
    for (const auto& chunk : message.header["parts"][0]["chunks"]) {
        const size_t first = chunk["first_vertex"], count = chunk["vertices"], offset = chunk["offset"];
        for (size_t i = 0; i < 3 * count; ++i)
            if (floats) {
                std::memcpy(&out[3 * first + i], message.payload.data() + offset + 4 * i, 4);
            } else {
                uint16_t steps = 0;
                std::memcpy(&steps, message.payload.data() + offset + 2 * i, 2);
                out[3 * first + i] =
                    float(double(chunk["lower"][i % 3]) + steps * double(chunk["step"][i % 3]));
            }
    }
    return out;
}

TEST(StrandPacking, ChoosesTheSameStrandsAndMoreOfThem) {
    const Field field(20000);
    const uint64_t layout = layout_digest(field.world);
    std::set<uint32_t> before;
    for (const uint32_t budget : {100U, 1000U, 5000U, 15000U, 20000U, 30000U}) {
        const StrandSelection selection = select_strands(field.world, budget, layout);
        const std::vector<uint32_t>& strands = selection.parts[0].strands;
        const std::set<uint32_t> now(strands.begin(), strands.end());
        EXPECT_TRUE(std::ranges::includes(now, before)) << budget;
        EXPECT_TRUE(std::ranges::is_sorted(strands));
        const double expected = std::min(budget, 20000U);
        EXPECT_NEAR(double(now.size()), expected, 5.0 * std::sqrt(expected));
        before = now;
    }
    EXPECT_EQ(before.size(), 20000U);
}

TEST(StrandPacking, FollowsIdsAndNotIndices) {
    Field field(2000);
    const StrandSelection first = select_strands(field.world, 500, 0);
    std::set<float> ids;
    for (const uint32_t s : first.parts[0].strands) ids.insert(field.world.curves[0].attributes[0].values[s]);
    auto& values = field.world.curves[0].attributes[0].values;
    std::ranges::reverse(values);
    std::set<float> again;
    const StrandSelection second = select_strands(field.world, 500, 0);
    for (const uint32_t s : second.parts[0].strands) again.insert(values[s]);
    EXPECT_EQ(ids, again);
    EXPECT_NE(layout_digest(field.world), layout_digest(Field(2000).world));
}

TEST(StrandPacking, FloatsAreTheStrandsBits) {
    const Field field(5000);
    const StrandSelection selection = select_strands(field.world, 3000, 0);
    WireMessage message;
    add_strand_positions(field.world, selection, true, message);
    const StrandPart& part = selection.parts[0];
    const std::vector<float> sent = positions_of(part, message, true);
    const CurveLayout layout = field.world.curves[0].layout();
    for (size_t i = 0; i < part.strands.size(); ++i)
        for (uint64_t v = part.first_vertex[i]; v < part.first_vertex[i + 1]; ++v)
            for (uint64_t a = 0; a < 3; ++a)
                ASSERT_EQ(
                    sent[3 * v + a],
                    field
                        .vertices[4 * (layout.first_vertex(part.strands[i]) + v - part.first_vertex[i]) + a]);
    EXPECT_GT(part.chunks.size(), 1U);
}

TEST(StrandPacking, SixteenBitsAreWithinHalfAStep) {
    const Field field(5000);
    const StrandSelection selection = select_strands(field.world, 5000, 0);
    WireMessage exact, packed;
    add_strand_positions(field.world, selection, true, exact);
    add_strand_positions(field.world, selection, false, packed);
    const StrandPart& part = selection.parts[0];
    const std::vector<float> want = positions_of(part, exact, true), got = positions_of(part, packed, false);
    for (const auto& chunk : packed.header["parts"][0]["chunks"]) {
        const size_t first = chunk["first_vertex"], count = chunk["vertices"];
        for (size_t i = 3 * first; i < 3 * (first + count); ++i) {
            const double step = chunk["step"][i % 3];
            // Positions are floats: their rounding comes on top.
            ASSERT_LE(std::abs(double(want[i]) - double(got[i])),
                      0.5 * step + 1e-6 * std::abs(double(want[i])))
                << i;
        }
    }
}

TEST(StrandPacking, MarksWhereSegmentsBegin) {
    const Field field(300);
    const StrandSelection selection = select_strands(field.world, 300, 0);
    const WireMessage message = strands_message(field.world, selection, 1, {{}});
    const StrandPart& part = selection.parts[0];
    const size_t offset = message.header["parts"][0]["attributes"];
    const auto* bytes = reinterpret_cast<const uint8_t*>(message.payload.data() + offset);
    for (size_t i = 0; i < part.strands.size(); ++i) {
        const uint64_t begin = part.first_vertex[i], count = part.first_vertex[i + 1] - begin;
        uint64_t segments = 0;
        for (uint64_t v = 0; v < count; ++v) segments += bytes[4 * (begin + v) + 2] == 255 ? 1 : 0;
        EXPECT_EQ(segments, count - 3);                 // CVs - 1
        EXPECT_EQ(bytes[4 * (begin + 1)], 0);           // u of the root
        EXPECT_EQ(bytes[4 * (begin + count - 2)], 255); // and of the tip
    }
    EXPECT_FLOAT_EQ(float(message.header["parts"][0]["radius"]), 0.008F);
}

TEST(StrandPacking, TakesNoStrands) {
    const Field field(0);
    const StrandSelection selection = select_strands(field.world, 100, layout_digest(field.world));
    WireMessage message = strands_message(field.world, selection, 1, {{}});
    add_strand_positions(field.world, selection, false, message);
    EXPECT_EQ(message.payload.size(), 0U);
    EXPECT_EQ(to_bytes(message)->size() % 8, 0U);
}

} // namespace
} // namespace marram
