// SPDX-License-Identifier: Apache-2.0
// mass_desert: a field of many dunes. Each dune is a description (crest curves with DuneSettings) with an id,
// and can be edited individually. Its surface is that of dune_shape.cpp.
//
//     mass_parameters.cpp   the parameters of a scene and their ranges
//     mass_places.cpp       where the dunes are, and their ids
//     mass_shapes.cpp       size, crest and profile of each kind
//     mass_desert.cpp       kinds; dunes from places and shapes; edits
//     mass_layer.cpp        dunes merged on the terrain's grid; export
//
// Kind. The regime chart follows Wasson and Hyde (Nature 304, 1983): cover c (for the equivalent sand
// thickness) against variability v = 1 - RDP/DP of the wind direction. The chart of the field data has no
// sharp borders; those used here are
//     plants > 0.3             parabolic where c >= 0.35 and v < 0.5, else nabkha
//     v < 0.35                 barchan for c < 0.35, barchanoid for c < 0.65, transverse above
//     v >= 0.35                star for c >= 1.3 - v, else seif for c < 0.65, transverse above
// c and v of each dune deviate by at most `kind_mixing`, so that kinds mix near a border. If the chart gives
// a barchan lower than 1 m, it becomes a dome, because it would have no slip face (the smallest barchans in
// the field are about that high).
//
// The layer generates dunes up to mass_reach() beyond the domain, so that a cropped terrain matches the
// whole. Cost: a dune takes about 10 us to describe and 30 us to resample and to bound, plus the cost of
// DuneShape a sample and segment. 1,013 dunes of 2 to 6 m on 2048^2 samples: 0.05 s and 0.4 s of CPU time on
// two threads.
//
//     [[procedural.layer]]
//     type = "mass_desert"
//     sand_cover = 0.2
//     height = [2, 6]
//     spacing = [80, 140]
//     [[procedural.layer.edit]]
//     id = 2251801961172992
//     move = [12, -4]
#include "procedural/terrain/mass/mass_desert.h"

#include "core/math/hash.h"
#include "procedural/abi/parallel.h"
#include "procedural/terrain/dune/dune_layer.h"
#include "procedural/terrain/mass/mass_math.h"
#include "procedural/terrain/mass/mass_parameters.h"
#include "procedural/terrain/mass/mass_places.h"
#include "procedural/terrain/mass/mass_shapes.h"

#include <algorithm>
#include <unordered_map>

namespace marram {

namespace {

MassKind mass_kind(const MassSettings& s, const MassHash& random, double height) {
    if (s.kind) return *s.kind;
    const double cover = s.sand_cover + s.kind_mixing * random.jitter(MassRandomKey::cover);
    const double variability = s.wind_variability + s.kind_mixing * random.jitter(MassRandomKey::variability);
    const MassKind kind = regime_kind(cover, variability, s.plants);
    constexpr double lowest_barchan = 1.0; // metres: lower barchans have no slip face
    return kind == MassKind::barchan && height < lowest_barchan ? MassKind::dome : kind;
}

// Sets smoothing to just round the corners of the polyline, and resampling to about as many segments as it
// has points.
void resample_as_drawn(MassDune& dune) {
    double length = 0.0, segments = 0.0;
    for (const std::vector<Vec2d>& crest : dune.crests)
        for (size_t i = 0; i + 1 < crest.size(); ++i, segments += 1.0)
            length += (crest[i + 1] - crest[i]).norm();
    const double spacing = length / segments, width = dune.settings.slope_width;
    dune.settings.smoothing = 0.5 * spacing / width;
    const double most = dune.kind == MassKind::parabolic ? 24.0 : 8.0; // its nose bends sharply
    dune.settings.search_accuracy = std::clamp(1.25 * width / spacing, 1.0, most);
}

void apply(const DuneEdit& edit, MassDune& dune) {
    dune.at += edit.move;
    dune.angle += edit.rotate;
    for (std::vector<Vec2d>& crest : dune.crests)
        for (Vec2d& p : crest) p *= edit.scale;
    dune.height *= edit.scale * edit.height_factor;
    dune.width *= edit.scale;
    dune.length *= edit.scale;
    dune.settings.slope_width *= edit.scale;
    dune.settings.boundary_noise *= edit.scale;
    dune.settings.boundary_noise_length *= edit.scale;
    dune.settings.max_height = dune.height;
}

MassDune make_dune(const MassSettings& s, const MassPlace& place, const std::vector<const DuneEdit*>& edits) {
    const MassHash random{hash(mass_seed(s), place.id)};
    MassDune dune;
    dune.id = place.id;
    dune.at = place.at;
    dune.angle = place.angle + s.dispersion * random.normal(MassRandomKey::angle);
    dune.height = random.in(s.height, MassRandomKey::height);
    dune.kind = mass_kind(s, random, dune.height);
    dune.settings.max_height = dune.height;
    dune.settings.crest_radius = s.crest_radius;
    dune.settings.boundary_noise = s.boundary_noise;
    dune.settings.boundary_noise_length = s.boundary_noise_length;
    dune.settings.flip =
        true; // crests run from left to right seen along the wind, so the windward side is on their right
    constexpr uint64_t max_seeds = 1'000'000'000; // range of a layer's seed parameter
    dune.noise_seed = hash(random.word, uint64_t(MassRandomKey::noise)) % max_seeds;
    dune.settings.seed = dune_noise_seed(s.terrain_seed, dune.noise_seed, 0);
    make_mass_shape(s, random, dune);
    resample_as_drawn(dune);
    for (const DuneEdit* edit : edits) apply(*edit, dune);
    for (std::vector<Vec2d>& crest : dune.crests)
        for (Vec2d& p : crest) p = dune.at + mass_turned(p, dune.angle);
    return dune;
}

} // namespace

MassKind regime_kind(double sand_cover, double wind_variability, double plants) {
    constexpr double some_plants = 0.3;
    if (plants > some_plants)
        return sand_cover >= 0.35 && wind_variability < 0.5 ? MassKind::parabolic : MassKind::nabkha;
    if (wind_variability < 0.35)
        return sand_cover < 0.35   ? MassKind::barchan
               : sand_cover < 0.65 ? MassKind::barchanoid
                                   : MassKind::transverse;
    if (sand_cover >= 1.3 - wind_variability) return MassKind::star;
    return sand_cover < 0.65 ? MassKind::seif : MassKind::transverse;
}

std::vector<MassDune> generate_dunes(const MassSettings& given, const Vec2d& lower, const Vec2d& upper) {
    const MassSettings settings = bounded_mass_settings(given);
    std::vector<MassPlace> places = mass_places(settings, {lower, upper});
    std::unordered_map<uint64_t, std::vector<const DuneEdit*>> edits;
    for (const DuneEdit& edit : settings.edits) edits[edit.id].push_back(&edit);
    const auto edits_of = [&](uint64_t id) {
        const auto found = edits.find(id);
        return found == edits.end() ? std::vector<const DuneEdit*>() : found->second;
    };
    std::erase_if(places, [&](const MassPlace& place) {
        return std::ranges::any_of(edits_of(place.id), [](const DuneEdit* edit) { return edit->remove; });
    });
    std::vector<MassDune> dunes(places.size());
    marram::parallel_for(size_t(0), places.size(), [&](size_t i) {
        dunes[i] = make_dune(settings, places[i], edits_of(places[i].id));
    });
    return dunes;
}

} // namespace marram
