// SPDX-License-Identifier: Apache-2.0
#include "core/view/strand_packing.h"

#include "core/math/digest.h"
#include "core/math/hash.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

namespace marram {
namespace {

using nlohmann::json;

constexpr size_t strands_per_chunk = 2048;
constexpr double top = 65535.0; // largest 16-bit number

// A hash of each strand's id; of its index without ids.
uint32_t hash_of(const AttributeValues* ids, uint64_t strand) {
    const uint64_t id = ids ? std::bit_cast<uint32_t>(ids->values[strand]) : strand;
    return uint32_t(hash(0x7669'6577, id) >> 32); // "view"
}

const AttributeValues* ids_of(const CurveGeometry& curves) {
    const AttributeValues* ids = find_attribute(curves.attributes, "id");
    return ids && ids->rate == MARRAM_PER_CURVE && ids->components == 1 &&
                   ids->values.size() == curves.curve_count
               ? ids
               : nullptr;
}

void lay_out(const CurveGeometry& curves, StrandPart& part) {
    const CurveLayout layout = curves.layout();
    part.first_vertex = {0};
    for (const uint32_t strand : part.strands)
        part.first_vertex.push_back(part.first_vertex.back() + layout.cvs(strand) + 2);
    for (size_t first = 0; first < part.strands.size(); first += strands_per_chunk) {
        const size_t last = std::min(first + strands_per_chunk, part.strands.size());
        part.chunks.push_back(
            {part.first_vertex[first], part.first_vertex[last] - part.first_vertex[first], first, last});
    }
}

// Calls use(vertex of the part, its x, y, z, radius) for the chosen strands first ... last - 1.
template <typename Use>
void each_vertex(const CurveGeometry& curves, const StrandPart& part, size_t first, size_t last, Use&& use) {
    const CurveLayout layout = curves.layout();
    const float* const vertices = curves.vertices.front();
    for (size_t i = first; i < last; ++i) {
        const float* at = vertices + 4 * layout.first_vertex(part.strands[i]);
        for (uint64_t v = part.first_vertex[i]; v < part.first_vertex[i + 1]; ++v, at += 4) use(v, at);
    }
}

float largest_radius(const CurveGeometry& curves, const StrandPart& part) {
    float radius = 0.0F;
    each_vertex(curves, part, 0, part.strands.size(),
                [&](uint64_t, const float* at) { radius = std::max(radius, at[3]); });
    return radius;
}

// Four bytes a vertex: u, the radius, whether a segment begins there, a random number of the strand.
void write_attributes(const CurveGeometry& curves, const StrandPart& part, float radius, uint8_t* out) {
    const AttributeValues* const ids = ids_of(curves);
    const float scale = radius > 0.0F ? 255.0F / radius : 0.0F;
    for (size_t i = 0; i < part.strands.size(); ++i) {
        const auto count = part.first_vertex[i + 1] - part.first_vertex[i];
        const auto random = uint8_t(hash_of(ids, part.strands[i]));
        uint64_t k = 0;
        each_vertex(curves, part, i, i + 1, [&](uint64_t v, const float* at) {
            const double u = std::clamp((double(k) - 1.0) / double(count - 3), 0.0, 1.0);
            out[4 * v] = uint8_t(std::lround(255.0 * u));
            out[4 * v + 1] = uint8_t(std::lround(std::clamp(at[3] * scale, 0.0F, 255.0F)));
            out[4 * v + 2] = k + 3 < count ? 255 : 0;
            out[4 * v + 3] = random;
            ++k;
        });
    }
}

const char* name_of(MarramBasis basis) {
    return basis == MARRAM_BSPLINE ? "bspline" : basis == MARRAM_CATMULL_ROM ? "catmull-rom" : "linear";
}

void write_floats(const CurveGeometry& curves, const StrandPart& part, const StrandChunk& chunk, char* out) {
    auto* to = reinterpret_cast<float*>(out);
    each_vertex(curves, part, chunk.first, chunk.last,
                [&](uint64_t, const float* at) { to = std::copy_n(at, 3, to); });
}

struct Box {
    Vec3f lower = Vec3f::Zero(), step = Vec3f::Zero();
};

Box write_16_bits(const CurveGeometry& curves, const StrandPart& part, const StrandChunk& chunk, char* out) {
    Box3f box;
    each_vertex(curves, part, chunk.first, chunk.last,
                [&](uint64_t, const float* at) { box.extend(Vec3f(at[0], at[1], at[2])); });
    const Vec3f lower = box.min();
    const Vec3f step = (box.sizes().cast<double>() / top).cast<float>();
    std::array<double, 3> per_step{};
    for (int a = 0; a < 3; ++a) per_step[size_t(a)] = step[a] > 0.0F ? 1.0 / double(step[a]) : 0.0;
    auto* to = reinterpret_cast<uint16_t*>(out);
    each_vertex(curves, part, chunk.first, chunk.last, [&](uint64_t, const float* at) {
        for (int a = 0; a < 3; ++a) {
            const double steps = (double(at[a]) - double(lower[a])) * per_step[size_t(a)];
            *to++ = uint16_t(std::min(steps + 0.5, top));
        }
    });
    return {lower, step};
}

uint64_t all_of(const CurveGeometry& curves) { return std::max(curves.all_curves, curves.curve_count); }

} // namespace

uint64_t all_strands(const World& world) {
    uint64_t all = 0;
    for (const CurveGeometry& curves : world.curves) all += all_of(curves);
    return all;
}

double share_for(uint32_t budget, uint64_t all) { return all <= budget ? 1.0 : double(budget) / double(all); }

uint64_t layout_digest(const World& world) {
    Digest digest;
    for (const CurveGeometry& curves : world.curves) {
        digest.add(curves.name).add(curves.curve_count).add(uint64_t(curves.cvs_per_curve));
        digest.add(uint64_t(curves.basis)).add(curves.offsets);
        if (const AttributeValues* ids = ids_of(curves)) digest.add(ids->values);
    }
    return digest.value();
}

StrandSelection select_strands(const World& world, uint32_t budget, uint64_t layout) {
    StrandSelection selection{layout, budget, std::vector<StrandPart>(world.curves.size())};
    const double share = share_for(budget, all_strands(world));
    const auto below = uint64_t(std::ldexp(share, 32));
    for (size_t c = 0; c < world.curves.size(); ++c) {
        const CurveGeometry& curves = world.curves[c];
        const AttributeValues* const ids = ids_of(curves);
        StrandPart& part = selection.parts[c];
        const bool whole = share >= 1.0 || curves.all_curves > curves.curve_count; // or thinned already
        for (uint64_t strand = 0; strand < curves.curve_count; ++strand)
            if (whole || hash_of(ids, strand) < below) part.strands.push_back(uint32_t(strand));
        lay_out(curves, part);
    }
    return selection;
}

std::optional<uint32_t> strand_of(const StrandSelection& selection, uint32_t part, uint32_t vertex) {
    if (part >= selection.parts.size()) return {};
    const StrandPart& of = selection.parts[part];
    if (of.strands.empty() || vertex >= of.first_vertex.back()) return {};
    const auto next = std::ranges::upper_bound(of.first_vertex, uint64_t(vertex));
    return of.strands[size_t(next - of.first_vertex.begin()) - 1];
}

WireMessage strands_message(const World& world, const StrandSelection& selection, uint64_t number,
                            const std::vector<StrandColors>& colors) {
    WireMessage message;
    message.header = {{"type", "strands"}, {"selection", number}, {"parts", json::array()}};
    for (size_t c = 0; c < selection.parts.size(); ++c) {
        const CurveGeometry& curves = world.curves[c];
        const StrandPart& part = selection.parts[c];
        const float radius = largest_radius(curves, part);
        const uint64_t vertices = part.first_vertex.back();
        const size_t offset = message.add(4 * vertices);
        write_attributes(curves, part, radius, reinterpret_cast<uint8_t*>(message.at(offset)));
        message.header["parts"].push_back(
            {{"name", curves.name},
             {"basis", name_of(curves.basis)},
             {"of", all_of(curves)},
             {"strands", part.strands.size()},
             {"widen", double(all_of(curves)) / double(std::max<size_t>(part.strands.size(), 1))},
             {"radius", radius},
             {"root_color", json_of(colors[c].root)},
             {"tip_color", json_of(colors[c].tip)},
             {"vertices", vertices},
             {"attributes", offset}});
    }
    return message;
}

void add_strand_positions(const World& world, const StrandSelection& selection, bool as_floats,
                          WireMessage& message) {
    struct Job {
        size_t part, offset;
        const StrandChunk* chunk;
        Box box;
    };
    std::vector<Job> jobs;
    const size_t bytes_a_vertex = as_floats ? 3 * sizeof(float) : 3 * sizeof(uint16_t);
    for (size_t c = 0; c < selection.parts.size(); ++c)
        for (const StrandChunk& chunk : selection.parts[c].chunks)
            jobs.push_back({c, message.add(bytes_a_vertex * chunk.vertices), &chunk, {}});
    tbb::parallel_for(size_t(0), jobs.size(), [&](size_t i) {
        Job& job = jobs[i];
        const CurveGeometry& curves = world.curves[job.part];
        const StrandPart& part = selection.parts[job.part];
        if (as_floats)
            write_floats(curves, part, *job.chunk, message.at(job.offset));
        else
            job.box = write_16_bits(curves, part, *job.chunk, message.at(job.offset));
    });
    json parts = json::array();
    for (size_t c = 0; c < selection.parts.size(); ++c) parts.push_back({{"chunks", json::array()}});
    for (const Job& job : jobs) {
        json chunk = {{"first_vertex", job.chunk->first_vertex},
                      {"vertices", job.chunk->vertices},
                      {"offset", job.offset}};
        if (!as_floats) chunk["lower"] = json_of(job.box.lower), chunk["step"] = json_of(job.box.step);
        parts[job.part]["chunks"].push_back(std::move(chunk));
    }
    message.header["parts"] = std::move(parts);
}

} // namespace marram
