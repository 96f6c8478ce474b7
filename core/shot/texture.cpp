// SPDX-License-Identifier: Apache-2.0
#include "core/shot/texture.h"

#include "core/image/texture_file.h"

namespace marram {
namespace {

class FileTexture final : public Texture {
  public:
    explicit FileTexture(std::shared_ptr<const TextureFile> file) : file_(std::move(file)) {}
    Vec3f at(const Vec2f& uv, float width) const override { return file_->at(uv, width); }

  private:
    std::shared_ptr<const TextureFile> file_;
};

} // namespace

std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place) {
    const ColorSpace space = content == TextureContent::color ? ColorSpace::color : ColorSpace::linear_data;
    return std::make_shared<FileTexture>(open_texture_file(file, space, place));
}

} // namespace marram
