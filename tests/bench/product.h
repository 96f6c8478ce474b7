// SPDX-License-Identifier: Apache-2.0
// What is measured of the renderer as a whole: scenes/talk.toml from its file to the first ray, through the plug-in, with as many
// strands as asked; and the same curves baked and read back.
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

    // The whole frame, up to where the first ray may be traced. Without `traced` the curves are made, but no BVH over them.
    struct Frame {
        double load = 0.0;                         // reading the scene and what it names
        double colliders = 0.0;                    // meshes and their BVH
        double strands = 0.0;                      // from roots to buffers
        double bvh = 0.0;                          // over the curves
        uint64_t curve_bytes = 0, extra_bytes = 0; // Embree's buffers, and what is ours besides
        double sum() const { return load + colliders + strands + bvh; }
    };
    Frame run(bool traced, double frame = 1.0);

    // Writes the curves as `marram bake` does; returns seconds, the making included.
    double bake(const std::string& path, double frame);
    // Reads such a file into buffers of Embree's and builds the BVH over them. Throws where it is not what bake() writes.
    struct Baked {
        double read = 0.0, bvh = 0.0;
    };
    Baked load_baked(const std::string& path);

    // Seconds: camera rays of one sample a pixel, found and shaded by the path tracer with paths of no bounce; the same rays made
    // before and given to Embree one by one by as many threads; whole paths, and how many rays these have.
    double primary_by_integrator();
    double primary_by_embree();
    double whole_paths(uint64_t& rays);

  private:
    RenderSettings settings() const;

    Coat coat_;
    double load_seconds_ = 0.0;
    Shot scene_;
    World world_;
    std::vector<Ray> rays_; // of primary_by_embree(), tile after tile
};

} // namespace marram::bench
