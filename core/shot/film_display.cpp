// SPDX-License-Identifier: Apache-2.0
#include "core/shot/film_display.h"

#include "core/math/clock.h"
#include "core/shot/picture_file.h"

#include <algorithm>
#include <new>

namespace marram {
namespace {

constexpr double between_updates = 0.2;   // s
constexpr double most_of_the_time = 0.02; // for updates

} // namespace

void FilmDisplay::show_if_due(Film& film) {
    const double begin = wall_seconds();
    if (begin < next_ || !display_.is_ready()) return;
    resolve(film);
    show(film);
    const double end = wall_seconds();
    next_ = end + std::max(between_updates, (end - begin) / most_of_the_time);
}

void FilmDisplay::show(const Film& film) {
    try {
        display_.show(name_, int(film.width), int(film.height), picture_layers(film).layers);
    } catch (const std::bad_alloc&) {
        display_.give_up("the picture does not fit into memory once more");
    }
}

} // namespace marram
