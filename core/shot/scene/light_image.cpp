// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/light_image.h"

#include "core/image/image.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {
namespace {

LightImage read(const ParamValue& file, double strength, std::vector<Problem>& warnings) {
    const Image image = read_image(file.text);
    if (image.width / 2 != image.height && (image.width + 1) / 2 != image.height)
        throw InputError(file.place,
                         fmt::format("\"{}\" is {} x {} pixels: all directions by longitude and latitude "
                                     "are twice as wide as high",
                                     file.text, image.width, image.height),
                         "convert it to a latitude-longitude map");
    LightImage light{uint32_t(image.width), uint32_t(image.height), {}};
    std::vector<Vec3f>& pixels = light.pixels.edit();
    pixels.reserve(size_t(image.width) * size_t(image.height));
    size_t negative = 0;
    float brightest = 0.0F;
    for (size_t i = 0; i < size_t(image.width) * size_t(image.height); ++i) {
        const float* p = image.pixels.data() + i * size_t(image.channels);
        const Vec3f color = image.channels >= 3 ? Vec3f(p[0], p[1], p[2]) : Vec3f::Constant(p[0]);
        negative += color.minCoeff() < 0.0F;
        pixels.push_back(color.cwiseMax(0.0F));
        brightest = std::max(brightest, pixels.back().maxCoeff());
    }
    if (negative > 0)
        warnings.push_back(
            {file.place,
             fmt::format("\"{}\" has {} pixels that are below 0: they give no light", file.text, negative),
             "", "light.negative"});
    constexpr float most = 1e15F; // its square does not overflow a float
    if (!(brightest * float(strength) <= most))
        throw InputError(file.place,
                         fmt::format("\"{}\" has a value of {:.3g} times strength, the limit is {:.0e}",
                                     file.text, brightest, most),
                         "fix its hot pixels, or use less strength");
    return light;
}

} // namespace

LightImageReader light_image_reader(std::vector<Problem>& warnings) {
    return [&warnings](const ParamValue& file, double strength) { return read(file, strength, warnings); };
}

} // namespace marram
