// SPDX-License-Identifier: Apache-2.0
// Measures the renderer as a whole: scenes/talk.toml from its file to the first ray, through the plug-in,
// with a given number of strands; and the same curves baked and read back.
#pragma once

#include "core/shot/settings.h"

namespace marram::bench {

struct Coat {
    uint64_t strands;
    int cvs;
    double width;
};

class Product {
  public:
    explicit Product(const Coat& coat);

    // Runs a whole frame until the first ray can be traced. Without `traced` the curves are made, but not
    // their BVH.
    struct Frame {
        double load = 0.0;                         // reading the scene and the files that it names
        double colliders = 0.0;                    // meshes and their BVH
        double strands = 0.0;                      // from roots to buffers
        double bvh = 0.0;                          // over the curves
        uint64_t curve_bytes = 0, extra_bytes = 0; // Embree's buffers; our own data
        double sum() const { return load + colliders + strands + bvh; }
    };
    Frame run(bool traced, double frame = 1.0);

    // Writes the curves as `marram bake` does. Returns seconds, including the time to make the curves.
    double bake(const std::string& path, double frame);
    // Reads such a file into Embree's buffers and builds their BVH. Throws if bake() did not write the file.
    struct Baked {
        double read = 0.0, bvh = 0.0;
    };
    Baked load_baked(const std::string& path);

    // Each returns seconds. By the integrator: camera rays, one sample a pixel, traced and shaded with paths
    // of no bounce. By Embree: the same rays, precomputed and passed to Embree one by one from as many
    // threads. Whole paths: also gives their number of rays.
    double primary_by_integrator();
    double primary_by_embree();
    double whole_paths(uint64_t& rays);

  private:
    RenderSettings settings() const;

    Coat coat_;
    double load_seconds_ = 0.0;
    Shot scene_;
    World world_;
    std::vector<Ray> rays_; // of primary_by_embree(), tile by tile
};

} // namespace marram::bench
