// SPDX-License-Identifier: Apache-2.0
// Whether two pictures are alike. Three questions are asked of the picture proper (R, G, B), and each has its limits:
//
//   noise       Where a picture knows its variance (layer "variance": of each pixel's mean), a difference is measured in standard
//               deviations: of single pixels, of squares of 2, 4, 8, ... pixels and of the whole, where small steady
//               differences add up. With limits that a golden frame carries, measured from renders with other seeds; else by a
//               test of all squares at once at the level 0.001 (Bonferroni), for Student's t of as many degrees as samples
//               allow.
//   perception  Mean and 99th percentile of FLIP (flip.h).
//   structure   Mean SSIM of the luminance.
//
// Without variance nobody can tell noise from a fault: then perception and structure alone decide, by limits stated below.
//
// Other layers (depth, normal, ...) are alike where they differ by less than 0.03 of their range in the mean; or, since their edges
// are noisy and dense hair is all edges, where no channel's mean is off by more than 0.01 and pixels are beyond what stands in the 3 x 3
// pixels around their place in the other picture by less than 0.015 in the mean, and it fits nowhere better: moved by up to 2 pixels
// it must not correlate more than in its place, by more than 4 / sqrt(pixels). Layers of names (called id, one channel of whole
// numbers, 0 for none) are alike where at most 90 in 100 names are not among those 3 x 3, and not more are the same when moved:
// between seeds up to 74 in 100 are not, where dense hair shares pixels, and 100 where strands are named differently.
#pragma once

#include "core/image/image.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

// Standard deviations that the picture is off by, in the worst of the squares of one size.
struct ScaleResult {
    int size = 1; // pixels a side; 0: the whole picture
    double worst = 0.0, limit = 0.0;
    int x = 0, y = 0, channel = 0; // where
    bool fails() const { return !(worst <= limit); }
};

// What a golden frame was measured to allow: of renders that differ in the seed alone.
struct Limits {
    std::vector<std::pair<int, double>> deviations; // [scale]: size, limit
    double flip_mean = 0.0, flip_99 = 0.0, ssim = 1.0;
};
std::string to_text(const Limits& limits); // "1:5.2 2:4.8 0:4.1 flip 0.031 0.12 ssim 0.97"
std::optional<Limits> limits_from(const std::string& text);

struct LayerResult {
    std::string name; // "" is the picture proper
    int channels = 0;
    double rmse = 0.0, relative_mse = 0.0,
           psnr = 0.0;              // psnr: against the reference's range; infinite where they are equal
    double most = 0.0;              // the greatest difference of a number
    double mean = 0.0, range = 0.0; // mean difference; reference's range, 1 at least in a picture proper
    std::string fault;              // of layers other than the picture proper; "": alike
};

struct Comparison {
    int width = 0, height = 0;
    std::vector<LayerResult> layers;
    bool equal = false; // bit for bit
    bool display = false; // both are 8-bit or the like: FLIP is of what a display shows
    bool knows_noise = false;
    std::string unknown; // why noise is not known
    bool golden = false; // limits are the reference's own
    std::vector<ScaleResult> scales;
    double flip_mean = 0.0, flip_99 = 0.0, ssim = 1.0;
    double flip_mean_limit = 0.0, flip_99_limit = 0.0, ssim_limit = 1.0; // not judged: -, infinite, -1
    std::vector<std::string> faults;                                     // what fails, in words; none: alike
    std::vector<float> flip;                                             // map
    bool alike() const { return faults.empty(); }
    const char* flip_kind() const {
        return display ? "of what a display shows" : "of linear light, exposed for all its range";
    }
    const ScaleResult* worst_scale() const; // for its limit; nullptr where noise is not known
};

// The picture's layers by name: "R", "G", "B", or a grey "Y", are "", "A" is "alpha", "albedo.R" is of "albedo".
struct Picture {
    struct Layer {
        std::string name;
        std::vector<std::string> channels;
        std::vector<float> pixels; // interleaved
    };
    int width = 0, height = 0, samples = 0; // 0: not known
    std::string limits;                     // metadata of golden frames
    std::vector<Layer> layers;
    bool grey = false;    // in the file; R, G and B are equal here
    bool display = false; // its colours were encoded for a display
    bool half = false;    // stored as half floats
    const Layer* find(const std::string& name) const;
};

// Throws InputError. A picture whose one channel is Y is grey: three equal channels.
Picture read_picture(const std::string& path);

// Throws InputError where the sizes or the channels differ; a layer "variance" may be in either alone. `names` for messages.
Comparison compare_pictures(const Picture& test, const Picture& reference, const std::string& test_name,
                            const std::string& reference_name);

// Worst deviation of each scale, from colours and the variances of their difference (3 floats a pixel each). Variance that is less than
// the mean of its eight neighbours' counts as that: what few samples have not met they know nothing of.
enum class Halves { none, colours, variance }; // what was stored as half floats, which round and end at 2^-24
std::vector<ScaleResult> deviations(const std::vector<float>& test, const std::vector<float>& reference,
                                    const std::vector<float>& variance, Halves halves, int width, int height);

// Student's t that a number is beyond with probability p, both sides together, for degrees >= 4: the normal distribution's, corrected
// after D. Gaver & K. Kafadar, "A Retrievable Recipe for Inverse t" (1984); to 0.3 % from ten degrees on.
double student_limit(double p, double degrees);

// Mean over windows of 8 x 8 pixels, of the luminance after the sRGB curve: Z. Wang, A. Bovik, H. Sheikh & E. Simoncelli, "Image
// Quality Assessment: From Error Visibility to Structural Similarity" (2004).
double mean_ssim(const std::vector<float>& test, const std::vector<float>& reference, int width, int height);

} // namespace marram
