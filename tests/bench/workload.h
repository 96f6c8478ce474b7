// SPDX-License-Identifier: Apache-2.0
// What is measured: strands on a bumpy sphere in a gusty wind, and the chain over all of them on all threads.
#pragma once

#include "tests/bench/literal.h"
#include "tests/chain/furred_world.h"

#include <tbb/enumerable_thread_specific.h>

#include <chrono>

namespace marram::bench {

template <typename Work>
double seconds_of(Work&& work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

struct Size {
    const char* name;
    uint64_t strands;
    int cvs;
    int divisions;     // of the sphere: 8 times the square of it triangles
    double width;      // of a strand
    uint32_t keys = 1; // motion samples, at each of which the sphere has another shape
};

inline constexpr Size T{"T", 10000, 5, 71, 0.009};    // the talk's
inline constexpr Size T2{"T2", 10000, 5, 500, 0.009}; // the same on 2,000,000 triangles
inline constexpr Size T10k{"10k", 10000, 5, 35, 0.009}, T4M{"4M", 10000, 5, 707, 0.009};
inline constexpr Size D{"D", 10000, 5, 71, 0.009, 3}; // the first with its skin deforming
inline constexpr Size F{"F", 1000000, 8, 71, 0.0009}; // a fine coat

class Workload {
  public:
    explicit Workload(const Size& size);

    // The whole chain, jiggle off, at all motion samples: gusts, shielding of each CV, bend with two octaves, offset scale,
    // collision. Where the skin deforms the making of what a frame keeps is in it, else that was made before. Returns seconds.
    double run_chain();
    double run_literally();
    // From the roots to the CVs as Embree reads them: strands laid out, the whole chain, x, y, z and radius written.
    double run_from_roots();
    // Embree's own BVH over what run_from_roots() has written.
    double build_bvh();
    // The bare Embree queries that a straightforward exact chain makes: a shield ray a CV, in streams; for each segment
    // the heights of its end at rest and bent and the triangles near it, each one point query within a segment's reach.
    double run_floor();
    // Of exact collision: the tree over the colliders.
    double make_tree();

    StageClock clock() const; // thread seconds of run_chain() since it was made

  private:
    struct Thread {
        ChainScratch chain;
        Strands work;
    };
    Wind wind_;
    Groom groom_;
    Ramp whole_;
    std::vector<float> profile_;
    FurredWorld world_;
    ChainFrame frame_chain();

    uint32_t keys_;
    ChainFrame chain_;
    std::vector<Root> roots_;
    std::vector<std::vector<Strands>> rest_; // [motion sample]
    std::vector<Strands> bent_;              // at the first
    std::vector<float> vertices_; // x, y, z, radius of each CV, a phantom before and behind each strand's
    std::vector<LiteralStrands> literal_; // [motion sample]
    tbb::enumerable_thread_specific<Thread> threads_;
};

} // namespace marram::bench
