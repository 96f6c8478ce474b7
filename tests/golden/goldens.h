// SPDX-License-Identifier: Apache-2.0
// Golden frames: what small pictures of every feature are to look like, in scenes/golden/NAME.exr. A golden is the mean of renders that
// differ in their seed alone. With it stand the variance of one more render's difference from it, and the limits that comparison is to
// keep, both measured from those renders: nothing is guessed (core/compare/compare.h says what is compared). No limit is nearer than
// what chance alone passes in one of 10,000 renders.
//
// To add one: a line in goldens.cpp, then tests/golden/update NAME --write, and a look at what it made.
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
    std::string scene; // in scenes/
    double frame = 1.0;
    std::vector<std::string> changes;  // key=value
    std::vector<std::string> layers{}; // beside the picture; they are one render's, not a mean
};

inline void PrintTo(const Golden& golden, std::ostream* out) { *out << golden.name; }

std::span<const Golden> goldens();
const Golden& golden_named(const std::string& name);
std::string path_of(const Golden& golden); // of its EXR

// A golden's scene, built: renders it with as many seeds as wanted.
class Stage {
  public:
    // `faults` are changes that plant one.
    explicit Stage(const Golden& golden, const std::vector<std::string>& faults = {});
    Picture render(uint64_t seed, uint32_t samples = 0) const; // 0: as many as the scene asks for
    World& world() { return world_; } // to plant a fault by hand, before the first render

  private:
    Shot scene_;
    World world_;
    std::unique_ptr<Lights> lights_;
    std::vector<std::string> layers_;
    double frame_;
};

inline constexpr int seeds = 48; // that a golden is measured from

// Renders and measures it anew.
Picture made(const Golden& golden);
void write(const Picture& picture, const std::string& path, const Golden& golden);

} // namespace marram::golden
