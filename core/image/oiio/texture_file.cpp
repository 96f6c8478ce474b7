// SPDX-License-Identifier: Apache-2.0
#include "core/image/texture_file.h"

#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/image/oiio/image_input.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/texture.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace marram {
namespace {

namespace fs = std::filesystem;

// One per program: its cache is shared by all materials.
OIIO::TextureSystem& texture_system() {
    static OIIO::TextureSystem* const system = [] {
        OIIO::TextureSystem* made = OIIO::TextureSystem::create(true);
        made->attribute("max_memory_MB", 1024.0F);
        made->attribute("unassociatedalpha", 1); // as in read_image: colour is not multiplied by alpha
        return made;
    }();
    return *system;
}

class TiledTexture final : public Texture {
  public:
    // made: the temporary file, if `file` was converted.
    TiledTexture(const std::string& file, int channels, std::unique_ptr<TemporaryFile> made)
        : made_(std::move(made)), channels_(std::min(channels, 3)),
          handle_(texture_system().get_texture_handle(OIIO::ustring(file))) {}
    bool good() const { return handle_ && texture_system().good(handle_); }

    Vec3f at(const Vec2f& uv, float width, Wrap wrap) const override {
        const bool repeat = wrap == Wrap::repeat;
        OIIO::TextureOpt options;
        options.swrap = options.twrap = repeat ? OIIO::TextureOpt::WrapPeriodic : OIIO::TextureOpt::WrapClamp;
        options.mipmode = OIIO::TextureOpt::MipModeTrilinear;
        options.interpmode = OIIO::TextureOpt::InterpBilinear;
        float value[3] = {0.0F, 0.0F, 0.0F};
        // Brought to 0 ... 1 here, for precision; rows run down from the top in files.
        const auto within = [&](float v) { return repeat ? v - std::floor(v) : std::clamp(v, 0.0F, 1.0F); };
        const float s = within(uv.x()), t = 1.0F - within(uv.y());
        const float w = std::clamp(width, 0.0F, 1.0F);
        if (!texture_system().texture(handle_, texture_system().get_perthread_info(), options, s, t, w, 0.0F,
                                      0.0F, w, channels_, value))
            texture_system().geterror(); // a tile became unreadable after the check: black
        if (channels_ < 3) value[1] = value[2] = value[0];
        const auto share = [](float v) { return v > 0.0F ? std::min(v, 1.0F) : 0.0F; }; // NaN: 0
        return {share(value[0]), share(value[1]), share(value[2])};
    }

  private:
    std::unique_ptr<TemporaryFile> made_; // removed with this object, or when the program is interrupted
    int channels_;
    OIIO::TextureSystem::TextureHandle* handle_;
};

// True if a file has tiles and MIP levels.
bool is_tiled(const std::string& file) {
    std::string why;
    const auto input = open_format(file, {}, why);
    return input && input->spec().tile_width > 0 && input->seek_subimage(0, 1);
}

std::unique_ptr<TemporaryFile> make_texture(Image& image, const std::string& file, const Place& place) {
    std::error_code error;
    const fs::path folder = fs::temp_directory_path(error);
    if (error)
        throw InputError(place,
                         "there is no directory for temporary files to make a texture of \"" + file + "\" in",
                         "set TMPDIR to one that exists");
    auto made = std::make_unique<TemporaryFile>(file, folder / "texture.exr");
    for (float& value : image.pixels) value = std::clamp(value, 0.0F, 1.0F); // before it affects averages
    const OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::FLOAT);
    const OIIO::ImageBuf pixels(spec, image.pixels.data());
    OIIO::ImageSpec config;
    config.set_format(OIIO::TypeDesc::HALF);
    const auto refuse = [&](const std::string& why) {
        throw InputError(place, "\"" + file + "\" cannot be made into a texture: " + why,
                         "make room in the directory for temporary files, or set TMPDIR to another");
    };
    if (!OIIO::ImageBufAlgo::make_texture(OIIO::ImageBufAlgo::MakeTxTexture, pixels, made->name(), config))
        refuse(OIIO::geterror());
    if (!made->lock_again()) refuse("the file was removed while it was made");
    try {
        // The writer does not report a full disk when it closes its file.
        read_image(made->name(), ColorSpace::linear_data);
    } catch (const InputError& error) {
        refuse(error.problems.front().what);
    }
    return made;
}

} // namespace

std::shared_ptr<const Texture> open_texture_file(const std::string& file, ColorSpace space,
                                                 const Place& place) {
    // The whole file is read even if it is used as it is: truncated files and non-finite pixels must not be
    // found while rendering.
    Image image = read_image(file, space);
    const bool ready = image.as_in_file && !image.turned &&
                       is_tiled(file) && // else encoded values would be averaged
                       std::ranges::all_of(image.pixels, [](float v) { return v >= 0.0F && v <= 1.0F; });
    std::unique_ptr<TemporaryFile> made = ready ? nullptr : make_texture(image, file, place);
    const std::string path = made ? made->name() : file;
    auto texture = std::make_shared<TiledTexture>(path, image.channels, std::move(made));
    if (!texture->good())
        throw InputError(place, "\"" + file + "\" cannot be read as a texture",
                         "save it again as PNG, TIFF or EXR");
    return texture;
}

} // namespace marram
