// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/texture.h"

#include "core/image/texture_file.h"
#include "core/math/udim.h"

#include <cmath>
#include <map>
#include <utility>

namespace marram {
namespace {

// One file for each unit square of uv.
class TiledFiles final : public Texture {
  public:
    TiledFiles(const std::string& pattern, ColorSpace space, const Place& place) {
        for (const UdimTile& tile : udim_tiles(pattern))
            files_[{tile.u, tile.v}] = open_texture_file(tile.file, space, place);
        if (files_.empty())
            throw InputError(place, "there is no tile of \"" + pattern + "\"",
                             "name tiles by 1001 + u + 10 v, or check the path");
    }
    Vec3f at(const Vec2f& uv, float width, Wrap) const override {
        if (!uv.allFinite() || uv.cwiseAbs().maxCoeff() > 1e6F) return Vec3f::Zero();
        const int u = static_cast<int>(std::floor(uv.x())), v = static_cast<int>(std::floor(uv.y()));
        // A border between squares belongs to the one that has a file.
        const bool on_u = static_cast<float>(u) == uv.x(), on_v = static_cast<float>(v) == uv.y();
        for (const auto& [i, j] : {std::pair(u, v), {u - 1, v}, {u, v - 1}, {u - 1, v - 1}}) {
            if ((i < u && !on_u) || (j < v && !on_v)) continue;
            const auto found = files_.find({i, j});
            if (found == files_.end()) continue;
            return found->second->at(uv - Vec2f(static_cast<float>(i), static_cast<float>(j)), width,
                                     Wrap::clamp);
        }
        return Vec3f::Zero();
    }

  private:
    std::map<std::pair<int, int>, std::shared_ptr<const Texture>> files_; // by u, v
};

} // namespace

std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place) {
    const ColorSpace space = content == TextureContent::color ? ColorSpace::color : ColorSpace::linear_data;
    if (has_udim(file)) return std::make_shared<TiledFiles>(file, space, place);
    return open_texture_file(file, space, place);
}

} // namespace marram
