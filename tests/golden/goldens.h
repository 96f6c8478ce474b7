// SPDX-License-Identifier: Apache-2.0
// Golden frames: small reference pictures of every feature, in scenes/golden/NAME.exr. A golden is the mean of
// renders that differ only in their seed. Its file also holds the variance of one further render's difference
// from the mean, and the limits of the comparison. Both are measured from those renders; nothing is guessed
// (core/compare/compare.h says what is compared). By chance, a render exceeds each limit in at most 1 of 10,000
// cases.
//
// To add one: write a line in goldens.cpp, run tests/golden/update NAME --write, and check the picture.
#pragma once

#include "core/compare/compare.h"
#include "core/render/integrator.h"
#include "core/shot/shot.h"

#include <memory>
#include <ostream>
#include <span>
#include <string>
#include <vector>

namespace marram::golden {

struct Golden {
    std::string name, shows;
    std::string scene; // file in scenes/
    double frame = 1.0;
    std::vector<std::string> changes;  // key=value
    std::vector<std::string> layers{}; // besides the picture; from one render, not a mean
};

inline void PrintTo(const Golden& golden, std::ostream* out) { *out << golden.name; }

std::span<const Golden> goldens();
const Golden& golden_named(const std::string& name);
std::string path_of(const Golden& golden); // its EXR

// The built scene of a golden. It renders it with any number of seeds.
class Stage {
  public:
    // `faults`: further settings that plant a fault.
    explicit Stage(const Golden& golden, const std::vector<std::string>& faults = {});
    Picture render(uint64_t seed, uint32_t samples = 0) const; // 0: the scene's own number
    World& world() { return world_; } // for planting a fault by hand, before the first render

  private:
    Shot scene_;
    World world_;
    std::unique_ptr<Lights> lights_;
    std::vector<std::string> layers_;
    double frame_;
};

inline constexpr int seeds = 48; // renders that a golden is measured from

// Renders and measures a golden anew.
Picture made(const Golden& golden);
void write(const Picture& picture, const std::string& path, const Golden& golden);

} // namespace marram::golden
