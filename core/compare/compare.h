// SPDX-License-Identifier: Apache-2.0
// Whether two pictures are alike. Three questions are asked of the picture proper (R, G, B), and each has its limits:
//
//   noise       Where a picture knows its variance (layer "variance": of each pixel's mean), a difference is measured in standard
//               deviations: of single pixels, of squares of 2, 4, 8, ... pixels and of the whole, where small steady
//               differences add up. With limits that a golden frame carries, measured from renders with other seeds; else by a
//               test of all squares at once at the level 0.001 (Bonferroni), for Student's t of as many degrees as samples
//               allow.
//   perception  Mean and 99th percentile of FLIP (flip.h); and its mean in the worst window of 16 x 16 pixels.
//   structure   Mean SSIM of the luminance.
//
// Without variance nobody can tell noise from a fault: then perception and structure alone decide, by limits stated in compare.cpp. That
// of the worst window (every 8th pixel, and the last) is 0.35: 238 pairs of renders that differ in the seed alone (of fur, default, talk,
// dune, figure1c, figure2, gust_field, strand and golden/room, fur, sheet in scenes/; 240 x 160 and 96 x 64 pixels) have at most 0.19
// with 64 samples a pixel, 0.28 with 16, 0.39 with 4; a square of 8 x 8 pixels painted black into room, dune and the PNG files of
// scenes/pictures has 0.38 to 0.51. What FLIP takes for none, light below 0, may then differ by 0.03 of the reference's light.
//
// Where only one picture carries limits it is the reference, whichever is named first.
//
// Other layers (depth, normal, ...) are alike where
//   - no channel's mean is off by more than 0.01 of the layer's range (and 4 standard errors: of few pixels);
//   - in no window of 16 x 16 pixels numbers lie beyond all of the 3 x 3 around their place in the other picture by more, in the mean,
//     than 1.25 times as far as they lie beyond their 8 neighbours in their own, and 0.03 of the range. Where a layer is smooth the
//     loss of 4 x 4 pixels is seen; where it is noise, as in hair, it may be other noise;
//   - if they differ by more than 0.03 of the range in the mean, what is beyond is less than 0.015 of it in the whole picture, and it fits
//     nowhere better: moved by up to 2 pixels it must not correlate more than in its place, by more than 4 / sqrt(pixels).
// Of the same pairs, with 64, 16 and 4 samples a pixel (depth, normal, albedo, alpha, strand_u, envelope, shield), the worst means were
// off by 0.0036, 0.0038, 0.0055 (3.5 standard errors), the worst windows had 0.0073, 0.0127, 0.0152; a lens wide open, a filter of 4
// pixels and a shutter of 4 frames brought no more. With 1 sample strand_u of gust_field is too noisy to be told from another.
//
// Layers of names (called id, one channel of whole numbers, 0 for none) are alike where not more names are unknown among those 3 x 3
// than 1.1 times as many as are among their own 8 neighbours, and 0.05, nor more than halfway between these and all; where of no window's
// pixels more than 0.1 are, less 1.1 times the latter; and not more are the same when moved. Between seeds no more were unknown in the
// other picture than among their own, but for 0.002: from 0.4 in 100 in the room to 70 where dense hair shares pixels, and 91 of it in 96
// x 64 pixels; all are where strands are named differently. The worst window had 0.041.
#pragma once

#include "core/image/picture.h"

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
    bool equal = false;   // bit for bit
    bool display = false; // both are 8-bit or the like: FLIP is of what a display shows
    bool knows_noise = false;
    std::string unknown;  // why noise is not known
    bool golden = false;  // limits are the reference's own
    bool swapped = false; // the first picture carries limits and the second none: the first was the reference
    std::vector<ScaleResult> scales;
    double flip_mean = 0.0, flip_99 = 0.0, ssim = 1.0;
    double flip_window = 0.0;                                            // mean of the worst 16 x 16 pixels
    int flip_window_x = 0, flip_window_y = 0;                            // where these begin
    double flip_mean_limit = 0.0, flip_99_limit = 0.0, ssim_limit = 1.0; // not judged: -, infinite, -1
    double flip_window_limit = 0.0;                                      // not judged: infinite
    std::vector<std::string> faults;                                     // what fails, in words; none: alike
    std::vector<std::string> notes; // what is no fault but should be known
    std::vector<float> flip;        // map
    bool alike() const { return faults.empty(); }
    const char* flip_kind() const {
        return display ? "of what a display shows" : "of linear light, exposed for all its range";
    }
    const ScaleResult* worst_scale() const; // for its limit; nullptr where noise is not known
};

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
