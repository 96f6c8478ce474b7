// SPDX-License-Identifier: Apache-2.0
// The workload of the benchmarks: strands on a bumpy sphere in a gusty wind, and the chain over all of them
// on all threads.
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
    int divisions;     // of the sphere, which has 8 times their square triangles
    double width;      // of a strand
    uint32_t keys = 1; // motion samples; the sphere has a different shape at each
    bool jiggles = false;
    bool keyed = false; // speed, direction and strength of the wind have keys
};

inline constexpr Size T{"T", 10000, 5, 71, 0.009, 1, true};         // as in the talk: all stages
inline constexpr Size Tk{"Tk", 10000, 5, 71, 0.009, 1, true, true}; // T with keys
inline constexpr Size T0{"T0", 10000, 5, 71, 0.009};                // T without jiggle
inline constexpr Size T100k{"100k", 100000, 5, 71, 0.0028, 1, true};
inline constexpr Size T2{"T2", 10000, 5, 500, 0.009}; // T0 on 2,000,000 triangles
inline constexpr Size T10k{"10k", 10000, 5, 35, 0.009}, T4M{"4M", 10000, 5, 707, 0.009};
inline constexpr Size D{"D", 10000, 5, 71, 0.009, 3}; // T0 on a deforming skin
inline constexpr Size F{"F", 1000000, 8, 71, 0.0009}; // a fine coat

class Workload {
  public:
    explicit Workload(const Size& size);

    // Runs the whole chain at all motion samples: gusts, shielding of each CV, bend with two octaves, jiggle of 2 Hz
    // and damping 0.3 if the size has it, offset scale, collision. On a deforming skin the time includes the chain's
    // per-frame data; otherwise that was made before. Returns seconds. With jiggle, a frame alone: frame 24.
    double run_chain();
    double run_literally(); // jiggle: a simulation from a window before that frame
    // With jiggle: the next frame of a sequence, from what the frame before has kept.
    double run_next_frame();
    double run_next_frame_literally();
    // From the roots to CVs in Embree's format: lays out strands, runs the whole chain, writes x, y, z and
    // radius.
    double run_from_roots();
    // Builds Embree's BVH over the output of run_from_roots().
    double build_bvh();
    // Runs only the Embree queries of a straightforward exact chain: a shield ray for each CV, in streams;
    // for each segment, point queries within its reach for the height of its end at rest, its height bent,
    // and the triangles near it.
    double run_floor();
    // What a field of the wind costs: seconds of local_wind() for all roots, with a field around them less
    // without one, on one thread.
    double run_field();
    double run_field_grid();
    double run_field_between_frames(); // two grids
    double run_field_staggered();
    double run_field_staggered_between();
    double run_field_image();
    double run_field_curves();
    // Seconds of the bend alone, on one thread, in a full wind: of the talk, and of blades at this Ca
    // (elastica.cpp).
    double run_bend();
    double run_blades(double ca);
    double run_ground(); // the same with ground below all of them, without fields
    size_t strands() const;
    // Builds the tree over the colliders for exact collision.
    double make_tree();

    StageClock clock() const; // sum of all threads' seconds in run_chain() so far

  private:
    struct Thread {
        ChainScratch chain;
        Strands work;
    };
    double seconds_of_field(const PlacedField& field, double frame);
    Wind wind_;
    Groom groom_;
    Ramp whole_;
    std::vector<float> profile_;
    FurredWorld world_;
    ChainFrame frame_chain();
    double run_frame(double frame, std::vector<JiggleState>* kept);

    uint32_t keys_;
    ChainFrame chain_;
    std::vector<Root> roots_;
    std::vector<std::vector<Strands>> rest_; // [motion sample]
    std::vector<Strands> bent_;              // at the first motion sample
    std::vector<float> vertices_; // x, y, z, radius of each CV; a phantom before and after each strand
    std::vector<LiteralStrands> literal_; // [motion sample]
    double next_frame_ = 24.0, next_literal_frame_ = 24.0;
    std::vector<JiggleState> kept_; // [patch]
    ColliderTrees trees_;
    std::shared_ptr<PastWind> past_wind_;
    tbb::enumerable_thread_specific<Thread> threads_;
};

} // namespace marram::bench
