// SPDX-License-Identifier: Apache-2.0
// Shows a film in a viewer while it renders.
#pragma once

#include "core/image/display.h"
#include "core/render/film.h"

#include <string>

namespace marram {

class FilmDisplay {
  public:
    FilmDisplay(Display& display, std::string name) : display_(display), name_(std::move(name)) {}

    // Resolves and shows the film if that is due: at most five times a second, in at most about 2 % of the
    // render's wall time, and only if the viewer has taken what was shown before. Neither function waits for
    // the viewer, nor throws if it is gone (Display::take_fault).
    void show_if_due(Film& film);

    void show(const Film& film); // resolved, with all layers, as in an EXR

  private:
    Display& display_;
    std::string name_;  // of the image in the viewer
    double next_ = 0.0; // time of the next update, on the clock of wall_seconds()
};

} // namespace marram
