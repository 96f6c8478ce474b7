// SPDX-License-Identifier: Apache-2.0
#include "core/cli/texture.h"

#include "core/image/image.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/texture.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace marram {
namespace {

namespace fs = std::filesystem;

// A directory that goes with what is in it.
class TemporaryDirectory {
  public:
    TemporaryDirectory() {
        std::string name = (fs::temp_directory_path() / "marram-textures-XXXXXX").string();
        if (mkdtemp(name.data())) path_ = name;
    }
    ~TemporaryDirectory() {
        std::error_code error;
        if (!path_.empty()) fs::remove_all(path_, error);
    }
    TemporaryDirectory(const TemporaryDirectory&) = delete;
    TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

// One for the program: its cache is shared by all materials.
OIIO::TextureSystem& texture_system() {
    static OIIO::TextureSystem* const system = [] {
        OIIO::TextureSystem* made = OIIO::TextureSystem::create(true);
        made->attribute("max_memory_MB", 1024.0F);
        return made;
    }();
    return *system;
}

class FileTexture : public Texture {
  public:
    FileTexture(std::string file, int channels) : file_(std::move(file)), channels_(std::min(channels, 3)) {
        handle_ = texture_system().get_texture_handle(OIIO::ustring(file_));
    }
    bool good() const { return handle_ && texture_system().good(handle_); }

    Vec3f at(const Vec2f& uv, float width) const override {
        OIIO::TextureOpt options;
        options.swrap = options.twrap = OIIO::TextureOpt::WrapPeriodic;
        options.mipmode = OIIO::TextureOpt::MipModeTrilinear;
        options.interpmode = OIIO::TextureOpt::InterpBilinear;
        float value[3] = {0.0F, 0.0F, 0.0F};
        // Whole turns are taken off before they cost digits; rows run down from the top in files.
        const float s = uv.x() - std::floor(uv.x()), t = 1.0F - (uv.y() - std::floor(uv.y()));
        const float w = std::clamp(width, 0.0F, 1.0F);
        if (!texture_system().texture(handle_, texture_system().get_perthread_info(), options, s, t, w, 0.0F,
                                      0.0F, w, channels_, value))
            texture_system().geterror(); // a tile that went bad after it was checked: black
        if (channels_ < 3) value[1] = value[2] = value[0];
        return Vec3f(value[0], value[1], value[2]).cwiseMax(0.0F).cwiseMin(1.0F);
    }

  private:
    std::string file_;
    int channels_;
    OIIO::TextureSystem::TextureHandle* handle_ = nullptr;
};

// Channels of a file that can be used as it is; 0: it cannot.
int ready_channels(const std::string& file, TextureContent content) {
    const auto input = OIIO::ImageInput::open(file);
    if (!input) return 0;
    const OIIO::ImageSpec spec = input->spec();
    const std::string space = spec.get_string_attribute("oiio:ColorSpace");
    const bool encoded =
        space.empty() ? spec.format == OIIO::TypeDesc::UINT8 : !OIIO::Strutil::iequals(space, "linear");
    if (spec.tile_width == 0 || !input->seek_subimage(0, 1)) return 0;
    return content == TextureContent::color && encoded ? 0 : spec.nchannels;
}

std::string make_texture(const Image& image) {
    static const TemporaryDirectory directory;
    static int number = 0;
    if (directory.path().empty()) return "";
    const std::string path = (directory.path() / fmt::format("{}.exr", number++)).string();
    OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::FLOAT);
    OIIO::ImageBuf pixels(spec, const_cast<float*>(image.pixels.data()));
    OIIO::ImageSpec config;
    config.attribute("maketx:nomipmap", 0);
    config.set_format(OIIO::TypeDesc::HALF);
    return OIIO::ImageBufAlgo::make_texture(OIIO::ImageBufAlgo::MakeTxTexture, pixels, path, config) ? path
                                                                                                     : "";
}

} // namespace

std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place) {
    int channels = ready_channels(file, content);
    std::string ready = file;
    if (channels == 0) {
        const Image image =
            read_image(file, content == TextureContent::color ? ColorSpace::color : ColorSpace::linear_data);
        channels = image.channels;
        ready = make_texture(image);
        if (ready.empty())
            throw InputError(place, "\"" + file + "\" cannot be made into a texture: " + OIIO::geterror(),
                             "give the directory for temporary files room, or set TMPDIR to another");
    }
    auto texture = std::make_shared<FileTexture>(ready, channels);
    if (!texture->good())
        throw InputError(place, "\"" + file + "\" cannot be read as a texture",
                         "save it again as PNG, TIFF or EXR");
    return texture;
}

} // namespace marram
