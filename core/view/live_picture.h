// SPDX-License-Identifier: Apache-2.0
// The path tracer's picture for a page, from the page's camera: coarse first, refining.
#pragma once

#include "core/geometry/world.h"
#include "core/render/integrator.h"
#include "core/shot/shot.h"
#include "core/view/inbox.h"
#include "core/view/wire.h"
#include "core/world/build.h"

#include <array>
#include <functional>
#include <optional>

namespace marram {

// Appends a layer of a resolved film as RGBA, 8 bits, each so many-th pixel of both sides. Sets width and
// height in the header. exposure: stops, of the beauty. Values that are no colours: from black to white over
// their range.
void add_pixels(const Film& film, const std::string& layer, double exposure, uint32_t step,
                WireMessage& message);

class LivePicture {
  public:
    // share: of the strands, 0: all (BuildSettings::share)
    LivePicture(ViewClient client, const PictureRequest& request, double share);

    ViewClient client() const { return client_; }
    const PictureRequest& request() const { return request_; }

    // Builds the world if there is none, and adds samples until the picture is done or `stop` is set;
    // `show` is called between passes. memory: bytes that the process may take; 0: as many as there are. True:
    // done. Work that was stopped can go on later with the same bits. Throws InputError and Cancelled.
    bool work(Shot& shot, KeptGeometry kept, uint64_t memory, const std::atomic<bool>& stop,
              BuildProgress& progress, const std::function<void()>& show);

    // "image": RGBA, 8 bits, of the samples so far; width, height: of what is traced, which begins at x, y of
    // a picture of of_width, of_height.
    WireMessage message() const;
    double seconds() const;       // since it was asked for
    uint32_t samples() const;     // taken, of each pixel
    KeptGeometry take_geometry(); // frees the world; the samples stay

  private:
    void build(Shot& shot, KeptGeometry kept, uint64_t memory, const std::atomic<bool>& stop,
               BuildProgress& progress);

    ViewClient client_;
    PictureRequest request_;
    std::array<uint32_t, 4> part_; // that is traced: x, y, width, height
    double share_, begin_;
    std::optional<World> world_;
    std::optional<Film> film_;
    Camera camera_;
    RenderSettings settings_;
};

} // namespace marram
