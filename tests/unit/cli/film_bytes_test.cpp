// SPDX-License-Identifier: Apache-2.0
// What the memory budget of a build leaves for the film, against films.
#include "core/shot/settings.h"
#include "program.h"

namespace marram::testing {
namespace {

template <typename T>
uint64_t bytes_of(const std::vector<T>& values) {
    return values.capacity() * sizeof(T);
}

// A film of 7 x 5 pixels.
uint64_t bytes_of_film(const std::vector<std::string>& layers, const World& world) {
    Film film = make_film(7, 5, layers, world);
    resolve(film);
    uint64_t bytes =
        bytes_of(film.sums) + bytes_of(film.counts) + bytes_of(film.pixel_states) + bytes_of(film.catchers);
    for (const FilmLayer& layer : film.layers) bytes += bytes_of(layer.values);
    return bytes;
}

TEST(FilmBytes, AreThoseOfAFilm) {
    World world;
    std::vector<std::string> layers = {"beauty", "alpha"};
    const uint64_t without_catchers = bytes_of_film(layers, world);
    EXPECT_EQ(film_bytes(7, 5, layers, false), without_catchers);
    EXPECT_EQ(film_bytes(7, 5, layers, true), without_catchers + 7 * 5 * sizeof(CatcherSums));
    world.meshes.emplace_back().shadow_catcher = true;
    EXPECT_EQ(film_bytes(7, 5, layers, true), bytes_of_film(layers, world));
    for (const BuiltInLayer& layer : built_in_layers())
        if (!layer.always) layers.emplace_back(layer.name);
    EXPECT_EQ(film_bytes(7, 5, layers, true), bytes_of_film(layers, world));
    world.meshes[0].attributes.push_back({.name = "rgba", .components = 4});
    world.meshes[0].attributes.push_back({.name = "id", .components = 1, .discrete = true});
    layers.emplace_back("rgba");
    EXPECT_EQ(film_bytes(7, 5, layers, true), bytes_of_film(layers, world)) << "attributes have no more";
    layers.emplace_back("id");
    EXPECT_GT(film_bytes(7, 5, layers, true), bytes_of_film(layers, world));
    EXPECT_EQ(film_bytes(0, 5, layers, true), 0u);
    EXPECT_EQ(film_bytes(65536, 65536, {}, true), (sizeof(FilmPixel) + sizeof(CatcherSums)) << 32);
}

} // namespace
} // namespace marram::testing
