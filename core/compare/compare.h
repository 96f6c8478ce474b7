// SPDX-License-Identifier: Apache-2.0
// Compares two pictures. The picture proper (R, G, B) has to pass three tests, each with its own limits:
//
//   noise       If variance is known (layer "variance": variance of each pixel's mean), differences are
//               measured in standard deviations: of single pixels, of squares of 2, 4, 8, ... pixels and of
//               the whole picture, where small systematic differences add up. The limits are those of a
//               golden frame (measured from renders with other seeds); otherwise all squares are tested
//               together at the level 0.001 (Bonferroni), with Student's t for the degrees of freedom of the
//               samples. In this case small differences all over the picture are found as well: the ratio of
//               the squared differences to the variance, of squares of 1, 2, 4, 8, 16 pixels, in blocks of
//               16 x 16, averaged over the blocks with noise. It is at most 1 if noise is all (0.5 to 0.7 on
//               a lawn with 16 samples, since samples are stratified and the variance is an upper estimate);
//               the limit is 1.1 plus what Student's t allows for the spread of the blocks.
//   perception  Mean and 99th percentile of FLIP (flip.h), and its mean in the worst window of 16 x 16
//               pixels.
//   structure   Mean SSIM of the luminance.
//
// Noise may be too great for its tests. So if the pictures pass them, and yet the looks are beyond the limits
// without variance (below), the greatest difference that noise could hide is judged by its own looks: B is
// compared with B plus, in squares of 1, 4 and 16 pixels, the standard deviation of the difference times the
// root of the ratio's limit. (The ratio is 0 without a difference if both have the same seed, so that is
// found no earlier.) If that is beyond the limits (mean FLIP 0.1, which is just noticed everywhere, and 0.35
// in the worst window), whether the pictures are alike cannot be told, and `doubt` has the samples that it
// takes.
//
// A single sample a pixel has no variance, whatever its layer says. Then pictures with such a layer that look
// different cannot be told, unless the mean FLIP is above 0.5.
//
// Without variance noise cannot be distinguished from errors. Then perception and structure alone decide,
// with the limits in compare.cpp. The limit for the worst window (every 8th pixel, and the last) is 0.35. 238
// pairs of renders that differ only in the seed (of fur, default, talk, dune, figure1c, figure2, gust_field,
// strand and golden/room, fur, sheet in scenes/; 240 x 160 and 96 x 64 pixels) have at most 0.19 with 64
// samples a pixel, 0.28 with 16, 0.39 with 4. A square of 8 x 8 pixels painted black into room, dune and the
// PNG files of scenes/pictures has 0.38 to 0.51. Negative values, which FLIP treats as 0, may then differ by
// 0.03 of the reference's light.
//
// If only one picture carries limits it is the reference, independent of the order.
//
// Other layers (depth, normal, ...) are alike if
//   - the mean of each channel differs by at most 0.01 of the layer's range (or 4 standard errors, if that is
//     greater: for few pixels);
//   - in each window of 16 x 16 pixels the mean excess is small. The excess of a value is its distance from
//     the range of the 3 x 3 values around its place in the other picture. Noise is measured as its distance
//     from the range of the 8 neighbours in its own picture. The excess may be 1.25 times the noise plus 0.03
//     of the layer's range. In smooth layers this detects the loss of 4 x 4 pixels; in noisy layers such as
//     hair it allows other noise;
//   - the means of each window of 16 x 16 pixels differ by at most 0.1 of the layer's range, or what
//     Student's t allows at the level 0.001 (over all windows) for the spread of the differences of pixels.
//     If the pictures differ in samples a pixel, this is tested for alpha, albedo and normal only: others are
//     means over the samples that hit, and 0 where none hits;
//   - for layers with a mean difference above 0.03 of the range: the mean excess of the whole picture is at
//     most 0.015 of the range, and no shift by up to 2 pixels has a correlation that is higher than without
//     shift by more than 4 / sqrt(pixels).
// In the same pairs, with 64, 16 and 4 samples a pixel (depth, normal, albedo, alpha, strand_u, envelope,
// shield), the worst means differed by 0.0036, 0.0038, 0.0055 (3.5 standard errors), and the worst windows
// had 0.0073, 0.0127, 0.0152. A wide-open lens, a filter of 4 pixels and a shutter of 4 frames gave no more.
// The test of means is the one that noise cannot blind: of values that are at random at either end of the
// range, means of windows that differ by 0.3 of the range are found. Where most windows need more than half
// of the range (in pictures of a few pixels), whether the layers are alike cannot be told; of alpha, which
// people see in the picture and whose noise is not in the layer of variance, where they need more than 0.1.
//
// Id layers (named id, one channel of integers, 0 for none) compare ids exactly. An id is unknown if it is
// not among the 3 x 3 pixels around its place in the other picture. Noise is the fraction of ids that are
// not among their own 8 neighbours. Id layers are alike if
//   - the fraction of unknown ids is at most 1.1 times the noise plus 0.05, and at most halfway between the
//     noise and 1;
//   - in each window, unknown ids minus 1.1 times the noise are at most 0.1 of the pixels;
//   - no shift has more equal ids (limit as above).
// Between seeds the fraction of unknown ids exceeded the noise by at most 0.002. It ranged from 0.4 % in the
// room to 70 % where many hairs share a pixel, and 91 % there with 96 x 64 pixels; it is 100 % if strands
// have different ids. The worst window had 0.041. Where more than 82 % of a window's ids are noise, other ids
// are found only if half of those of the whole picture are others. If noise is so near to 100 % that these
// are not found either, whether the layers are alike cannot be told.
#pragma once

#include "core/image/picture.h"

#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// The largest deviation in standard deviations, over the squares of one size.
struct ScaleResult {
    int size = 1; // side in pixels; 0: the whole picture
    double worst = 0.0, limit = 0.0;
    int x = 0, y = 0, channel = 0; // of the worst square
    double deviation = 0.0;        // standard deviation of a square's mean, the median over the squares
    bool fails() const { return !(worst <= limit); }
};

// Squared differences of squares of one size relative to the variance, averaged over the picture.
struct RatioResult {
    int size = 1; // side in pixels
    double ratio = 0.0,
           limit = std::numeric_limits<double>::infinity(); // infinite: too few blocks have noise
    bool fails() const { return !(ratio <= limit); }
};

// Limits of a golden frame, measured from renders that differ only in the seed.
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
           psnr = 0.0;              // psnr: relative to the reference's range; infinite if equal
    double most = 0.0;              // maximum difference of a value
    double mean = 0.0, range = 0.0; // mean difference; reference's range (picture proper: at least 1)
    // For layers other than the picture proper.
    bool ids = false;        // compared as ids
    double found_from = 0.0; // difference of a window's means that is found, the median; 0: not tested
    std::string fault;       // "": alike
    std::string doubt;       // why a plain difference would not be found; "": it would
};

struct Comparison {
    int width = 0, height = 0;
    std::vector<LayerResult> layers;
    bool equal = false;   // bit for bit
    bool display = false; // both are display-encoded (8-bit or similar): LDR-FLIP
    bool has_noise_estimate = false;
    std::string unknown;  // why noise is unknown
    bool golden = false;  // the reference carries limits
    bool swapped = false; // only the first picture carries limits: it was the reference
    std::vector<ScaleResult> scales;
    std::vector<RatioResult> ratios; // of sizes 1, 2, 4, ...; none for a golden frame
    double light = 0.0;              // mean of the reference's colours
    double flip_mean = 0.0, flip_99 = 0.0, ssim = 1.0;
    double flip_window = 0.0;                 // mean FLIP of the worst 16 x 16 pixels
    int flip_window_x = 0, flip_window_y = 0; // their first pixel
    double flip_mean_limit = 0.0, flip_99_limit = 0.0, ssim_limit = 1.0; // if not tested: -, infinite, -1
    double flip_window_limit = 0.0;                                      // if not tested: infinite
    std::vector<std::string> faults; // messages of failed tests; none: alike
    std::string doubt;               // why it cannot be told whether they are alike; "": it can
    std::vector<std::string> notes;  // messages that are not faults
    std::vector<float> flip;         // FLIP map
    bool different() const { return !faults.empty(); }
    bool alike() const { return faults.empty() && doubt.empty(); }
    const char* flip_kind() const {
        return display ? "of what a display shows" : "of linear light, exposed for all its range";
    }
    const ScaleResult* worst_scale() const; // relative to its limit; nullptr if noise is unknown
};

// Throws InputError if sizes or channels differ; a layer "variance" may be in one picture only. The names
// are for messages.
Comparison compare_pictures(const Picture& test, const Picture& reference, const std::string& test_name,
                            const std::string& reference_name);

// Worst deviation at each scale, from colours and the variance of their difference (3 floats a pixel each). A
// variance below the mean of its eight neighbours is raised to that: a few samples may have missed rare
// bright paths.
enum class Halves { none, colours, variance }; // values stored as half floats, which round; minimum 2^-24
std::vector<ScaleResult> deviations(const std::vector<float>& test, const std::vector<float>& reference,
                                    const std::vector<float>& variance, Halves halves, int width, int height);

// Two-sided quantile of Student's t: exceeded with probability p, for degrees >= 4. The normal quantile,
// corrected after D. Gaver & K. Kafadar, "A Retrievable Recipe for Inverse t" (1984); accurate to 0.3 % from
// ten degrees on.
double student_limit(double p, double degrees);

// Mean SSIM over windows of 8 x 8 pixels, of sRGB-encoded luminance: Z. Wang, A. Bovik, H. Sheikh & E.
// Simoncelli, "Image Quality Assessment: From Error Visibility to Structural Similarity" (2004).
double mean_ssim(const std::vector<float>& test, const std::vector<float>& reference, int width, int height);

} // namespace marram
