// SPDX-License-Identifier: Apache-2.0
#include "core/shot/frame.h"

#include "core/image/atomic_file.h"
#include "core/math/frame_name.h"
#include "core/math/hash.h"
#include "core/render/adaptive.h"
#include "core/scene/keyed_values.h"
#include "core/shot/film_state.h"
#include "core/shot/picture_file.h"
#include "core/shot/scene/material_checks.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/scene/scene_files.h"
#include "core/shot/settings.h"
#include "core/world/lazy_curves.h"

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <tuple>

namespace marram {
namespace {

namespace fs = std::filesystem;

uint64_t hash_text(uint64_t h, std::string_view text) {
    for (const char c : text) h = hash(h, static_cast<unsigned char>(c));
    return hash(h, text.size());
}

// Metadata of a picture.
std::vector<Metadata> metadata_of(const Frame& frame, const std::string& digest) {
    const double seconds = frame.stats.load + wall_seconds() - frame.begin;
    return picture_metadata(frame.film, frame.options.scene, frame.files.frame, seconds, digest);
}

double exposure_of(const Frame& frame) {
    return values_at(frame.shot.description.film, frame.files.frame).number("exposure");
}

void save(const Frame& frame, const std::string& path, const std::vector<Metadata>& metadata) {
    save_picture(path, frame.film, exposure_of(frame), metadata);
}

// The size of a pixel is measured at camera.target. If the target is far behind the strands, the tolerance is
// too coarse for them.
void warn_far_target(Frame& frame) {
    const SceneDescription& scene = frame.shot.description;
    if (!scene.globals.has("tolerance_pixels")) return;
    const double target = (scene.camera.vec3("target") - scene.camera.vec3("position")).norm(),
                 strands = median_distance(scene, frame.files.frame, frame.stats.build.patch_bounds);
    if (strands < 0.5 * target)
        frame.stats.build.warnings.push_back(
            {scene.globals.at("tolerance_pixels").place,
             fmt::format(
                 "tolerance_pixels holds at camera.target, {:.3g} m away; half of the strands in view "
                 "are nearer than {:.3g} m, where it is {:.2g} times as many pixels",
                 target, strands, target / strands),
             "put the target among them, or give tolerance in metres", "camera.far_target"});
}

// What is rendered of a frame.
FilmPart part_of_frame(const Shot& shot, const PartRequest& part) {
    const auto [width, height] = film_size(shot);
    return part_of(part, width, height, uint32_t(shot.description.film.integer("samples")));
}

// What the film's state says of itself.
FilmState state_of(const Frame& frame, bool finished) {
    FilmState state;
    state.scene = frame.options.scene;
    state.frame = frame.files.frame;
    std::tie(state.width, state.height) = film_size(frame.shot);
    state.samples = uint32_t(frame.shot.description.film.integer("samples"));
    state.film_digest = frame.files.film_digest;
    state.picture_digest = frame.files.digest;
    state.exposure = exposure_of(frame);
    state.seconds = frame.stats.load + wall_seconds() - frame.begin;
    state.parts = {frame.files.part};
    state.finished = finished;
    return state;
}

// A setting that names a file says no more than its key: the file's contents are in the digest, its path is
// not.
std::string setting_without_path(const std::string& setting, const std::vector<NamedFiles>& named) {
    const auto names_file = [&](const NamedFiles& one) {
        return one.value->place.file.starts_with("--set ") && setting.starts_with(one.key + "=") &&
               one.value->numbers.empty() && one.value->texts.empty(); // frames and grid of a volume
    };
    const auto found = std::ranges::find_if(named, names_file);
    return found == named.end() ? setting : found->key;
}

// Whether a state was kept of the same picture with more samples than these. It is worth more than this one.
bool has_more_samples(const FrameFiles& files) {
    std::error_code error;
    if (!fs::exists(files.state, error)) return false;
    try {
        const FilmState state = read_state(files.state);
        return state.finished && state.film_digest == files.film_digest &&
               bounds_of(state.parts).end_sample > files.part.end_sample;
    } catch (const InputError&) {
        return false;
    }
}

void save_film(const Frame& frame, bool finished) {
    if (has_more_samples(frame.files))
        throw InputError({frame.files.state}, "has more samples than this render, and is kept",
                         "move it, to save the state of this one");
    save_state(frame.files.state, state_of(frame, finished), frame.film);
}

} // namespace

uint64_t shot_digest(const Shot& shot, const FrameOptions& options,
                     const std::vector<std::string>& settings) {
    std::ifstream file(options.scene, std::ios::binary);
    uint64_t h = hash_text(0, std::string(std::istreambuf_iterator<char>(file), {}));
    h = hash_text(h, MARRAM_VERSION);
    const std::vector<NamedFiles> named = named_files(shot);
    for (const std::string& setting : settings) h = hash_text(h, setting_without_path(setting, named));
    for (const std::string& layer : options.layers) h = hash_text(h, layer);
    const auto [width, height] = film_size(shot);
    h = hash(hash(h, width), height);
    return hash(h, files_digest(named));
}

FrameFiles frame_files(double frame, const Shot& shot, uint64_t digest, const std::string& picture,
                       const std::string& preview, const std::vector<LayerPicture>& layers,
                       const PartRequest& part) {
    FrameFiles files;
    files.frame = frame;
    files.picture = numbered(picture, frame);
    if (!preview.empty()) files.preview = numbered(preview, frame);
    files.is_part = part.given();
    files.part = part_of_frame(shot, part);
    files.state = state_name(files.picture, part);
    files.layers = layers;
    for (LayerPicture& layer : files.layers) layer.file = numbered(layer.file, frame);
    files.film_digest = fmt::format("{:016x}", hash(digest, std::bit_cast<uint64_t>(frame)));
    // Does not include the frame: OpenImageIO never frees distinct metadata strings, 8 KB each.
    files.digest = fmt::format("{:016x}", hash(digest, uint64_t(shot.description.film.integer("samples"))));
    return files;
}

namespace {

// A part of an adaptive picture is one round, and what was sampled before it is known.
void check_round(const FilmPart& part, const FilmPart& whole, const FrameOptions& options) {
    const bool crops = part.width() != whole.width() || part.height() != whole.height();
    if (part.first_sample == 0 && !crops) return;
    const uint32_t first = part.first_sample;
    const bool is_round = first % samples_per_round == 0 &&
                          part.end_sample == std::min(first + samples_per_round, whole.end_sample);
    if (!is_round)
        throw InputError({"--samples"},
                         fmt::format("film.noise decides after each {} samples, from all pixels, and these "
                                     "are {}",
                                     samples_per_round, to_string(part)),
                         fmt::format("render one round at a time, such as --samples {}-{}, or all with "
                                     "film.noise=0",
                                     first / samples_per_round * samples_per_round,
                                     (first / samples_per_round + 1) * samples_per_round - 1));
    if (first > 0 && options.after.empty())
        throw InputError({"--samples"}, "film.noise asks which pixels have converged before these samples",
                         "give --after the state of all samples before, such as what `marram merge` "
                         "writes to a .tif");
}

} // namespace

void check_parts(const Shot& shot, const FrameOptions& options, const std::vector<FrameFiles>& frames) {
    const FilmPart whole = part_of_frame(shot, {});
    for (const FrameFiles& files : frames) {
        if (files.is_part && shot.description.film.number("noise") > 0.0)
            check_round(files.part, whole, options);
        if (options.after.empty()) continue;
        if (files.part.first_sample == 0)
            throw InputError({"--after " + options.after}, "nothing comes before sample 0",
                             "leave it out, or give --samples that begin later");
        FilmPart earlier = whole;
        earlier.end_sample = files.part.first_sample;
        const std::string after = numbered(options.after, files.frame);
        const FilmState state = read_state(after);
        if (state.film_digest != files.film_digest)
            throw InputError({after}, "belongs to another scene, size, layer list, frame or program version",
                             "give the state of this frame");
        if (!state.finished || state.parts != std::vector{earlier})
            throw InputError({after}, fmt::format("has not just {}", to_string(earlier)),
                             "merge the states of these samples to a .tif, and give that");
    }
}

namespace {

bool is_part_rendered(const FrameFiles& files) {
    std::error_code error;
    if (!files.is_part || !fs::exists(files.state, error)) return false;
    try {
        const FilmState state = read_state(files.state);
        if (!state.finished || state.film_digest != files.film_digest ||
            state.parts != std::vector{files.part})
            return false;
        check_sums(files.state, state);
        return true;
    } catch (const InputError&) { // damaged
        return false;
    }
}

} // namespace

bool is_rendered(const FrameFiles& files) { return is_part_rendered(files) || is_picture_rendered(files); }

bool is_picture_rendered(const FrameFiles& files) {
    const auto is_whole = [&](const std::string& file) {
        return read_metadata(file, frame_key) == fmt::format("{}", files.frame) &&
               whole_metadata(file, digest_key) == files.digest;
    };
    return std::ranges::all_of(files.layers,
                               [&](const LayerPicture& layer) {
                                   return read_metadata(layer.file, layer_key) == layer_text(layer) &&
                                          is_whole(layer.file);
                               }) &&
           is_whole(files.picture);
}

std::vector<std::string> layer_names(const Shot& shot, const std::vector<std::string>& more) {
    std::vector<std::string> names = {"beauty", "alpha"};
    for (const auto* list : {&shot.description.film.at("aovs").texts, &more})
        for (const std::string& name : *list)
            if (std::ranges::find(names, name) == names.end()) names.push_back(name);
    if (shot.description.film.number("noise") > 0.0 && std::ranges::find(names, "variance") == names.end())
        names.emplace_back("variance"); // adaptive sampling reads it
    return names;
}

void check_layers(const Shot& shot, const std::vector<std::string>& more, const std::string& option) {
    std::vector<std::string> known;
    for (const BuiltInLayer& layer : built_in_layers()) known.emplace_back(layer.name);
    for (const auto& procedural : shot.geometry.procedurals)
        for (const MarramAttribute& attribute : procedural->attributes()) known.emplace_back(attribute.name);
    std::ranges::sort(known);
    known.erase(std::unique(known.begin(), known.end()), known.end());
    const auto check = [&](const std::vector<std::string>& names, const Place& place) {
        for (const std::string& name : names)
            if (std::ranges::find(known, name) == known.end())
                throw InputError(place, "this scene has no image layer '" + name + "'",
                                 fmt::format("choose among {}", fmt::join(known, ", ")));
    };
    const ParamValue& aovs = shot.description.film.at("aovs");
    check(aovs.texts, aovs.place);
    for (const std::string& name : more) check({name}, {option + " " + name});
}

namespace {

// Of the frame's film, and of that with the samples before.
uint64_t bytes_of_films(const Frame& frame) {
    const bool catchers = has_shadow_catcher(frame.shot);
    uint64_t bytes = film_bytes(frame.files.part.width(), frame.files.part.height(), frame.layers, catchers);
    const auto [width, height] = film_size(frame.shot);
    if (!frame.options.after.empty()) bytes += film_bytes(width, height, frame.layers, catchers);
    return bytes;
}

} // namespace

World build_frame(Frame& frame, KeptGeometry kept) {
    set_frame(frame.shot, frame.files.frame);
    frame.settings = render_settings(frame.shot, frame.files.frame);
    frame.settings.seconds = frame.options.seconds;
    frame.settings.first_sample = frame.files.part.first_sample;
    frame.settings.samples = frame.files.part.end_sample;
    BuildSettings settings = build_settings(frame.shot, frame.files.frame);
    settings.attributes = wanted_attributes(frame.shot, frame.layers);
    settings.render_meshes = true;
    const std::string& geometry = frame.shot.description.film.text("geometry");
    settings.lazy = geometry == "lazy" ? Lazy::always : geometry == "auto" ? Lazy::automatic : Lazy::never;
    settings.memory = {.limit = frame.options.memory, .reserved = bytes_of_films(frame)};
    World world = build_world(frame.shot.geometry, settings, frame.cancel, frame.progress.build,
                              frame.stats.build, std::move(kept));
    check_root_uvs(frame.shot, world);
    std::ranges::move(check_tiles(frame.shot, world), std::back_inserter(frame.stats.build.warnings));
    warn_far_target(frame);
    frame.film = make_film(frame.files.part.width(), frame.files.part.height(), frame.layers, world);
    frame.film.transparent = is_transparent(frame.shot);
    if (frame.files.is_part) {
        const auto [width, height] = film_size(frame.shot);
        frame.settings.crop = Crop{frame.files.part.x0, frame.files.part.y0, width, height};
    }
    if (!frame.options.after.empty()) {
        const std::string after = numbered(frame.options.after, frame.files.frame);
        const FilmState state = read_state(after);
        const FilmPart bounds = bounds_of(state.parts);
        frame.before = empty_film(state, bounds);
        add_state(after, state, bounds, frame.before);
        frame.settings.before = &frame.before;
    }
    return world;
}

ResumedFrame resume_frame(Frame& frame) {
    const FrameFiles& files = frame.files;
    std::error_code error;
    if (!frame.options.resume || !fs::exists(files.state, error)) return {};
    const std::string reason = load_state(files.state, files.film_digest, frame.files.part, frame.film);
    if (!reason.empty())
        return {Problem{{files.state}, reason, "the frame is rendered from the start", "state.refused"}, ""};
    return {std::nullopt, fmt::format("{}: resumed at {:.4g} samples per pixel", files.picture,
                                      count_samples(frame.film).mean)};
}

void trace_frame(Frame& frame, const World& world, Preview& preview) {
    const double before = wall_seconds();
    const Lights lights(frame.shot.lights, world); // computes skies the first time
    const double begin = wall_seconds();
    frame.stats.load += begin - before;
    frame.begin += begin - before; // or the frame's total would count it twice
    FrameProgress& progress = frame.progress;
    progress.render.cancel = &frame.cancel;
    progress.render.between_passes = [&](Film&) {
        preview.show_if_due();
        if (frame.between_passes) frame.between_passes();
    };
    const uint64_t done = progress_of(frame.film).sum, // 0: no sample yet
        earlier = uint64_t(frame.film.width) * frame.film.height * frame.settings.first_sample;
    progress.render.samples_done = done - std::min(done, earlier); // set before progress.samples
    progress.samples = uint64_t(frame.film.width) * frame.film.height *
                       (frame.settings.samples - frame.settings.first_sample);
    double off = 0.0;
    const Camera camera = camera_at(frame.shot.description, frame.files.frame, &off);
    frame.stats.camera_poses = uint32_t(camera.poses.size());
    if (off > 1.0)
        frame.stats.build.warnings.push_back(
            {{},
             fmt::format("the camera turns so fast that {} poses are off by {:.3g} pixels",
                         camera.poses.size(), off),
             "shorten camera.shutter",
             "camera.motion"});
    frame.stats.render =
        render(world, lights, frame.shot.materials, camera, frame.settings, frame.film, &progress.render);
    add_lazy_stats(world, frame.stats.build);
    frame.stats.trace = wall_seconds() - begin;
}

void save_checkpoint(const Frame& frame) { save_film(frame, false); }

void save_preview(Frame& frame) {
    resolve(frame.film);
    std::vector<Metadata> metadata = metadata_of(frame, "preview");
    metadata.emplace_back("marram:preview", std::string("yes"));
    save(frame, frame.files.preview, metadata);
}

std::vector<Problem> render_warnings(const Frame& frame) {
    const Place picture{frame.files.picture};
    const RenderStats& render = frame.stats.render;
    std::vector<Problem> warnings;
    if (render.out_of_time)
        warnings.push_back({picture,
                            fmt::format("time was up after {} of {} samples a pixel", render.max_samples,
                                        frame.settings.samples),
                            "give more --seconds for less noise, or go on with --resume",
                            "frame.out_of_time"});
    warnings.insert(warnings.end(), frame.stats.build.warnings.begin(), frame.stats.build.warnings.end());
    constexpr double dark = 0.05; // share of the light whose loss is visible
    const int depth = frame.shot.description.film.integer("max_depth");
    if (depth > 1 && render.cut_throughput > dark) // 0 and 1 are deliberate choices
        warnings.push_back(
            {picture,
             fmt::format("film.max_depth = {} ends paths that carry up to {:.2g} % of the light, the "
                         "picture is too dark",
                         depth, 100.0 * render.cut_throughput),
             "raise film.max_depth", "film.dark"});
    const BuildStats& build = frame.stats.build;
    if (build.rebuilt_patches > 2 * build.patches)
        warnings.push_back(
            {{"--memory"},
             fmt::format("patches of strands were built {} times more than there are, as memory is "
                         "short, which takes longer",
                         build.rebuilt_patches),
             "allow more than " + fmt::format("{} MB", frame.options.memory / 1'000'000),
             "memory.short"});
    if (render.nonfinite_samples > 0)
        warnings.push_back({picture,
                            fmt::format("{} samples were discarded because their radiance was not finite",
                                        render.nonfinite_samples),
                            "look for huge values in lights and materials", "film.not_finite"});
    return warnings;
}

SavedFrame save_frame(Frame& frame) {
    const FrameFiles& files = frame.files;
    const RenderStats& render = frame.stats.render;
    frame.stats.total = frame.stats.load + wall_seconds() - frame.begin;
    SavedFrame saved;
    saved.whole = !render.cancelled && !render.out_of_time;
    const bool is_part = files.is_part;
    saved.picture = is_part ? files.state : render.cancelled ? partial_name(files.picture) : files.picture;
    const auto write_picture = [&] {
        const std::vector<Metadata> metadata = metadata_of(frame, saved.whole ? files.digest : unfinished);
        for (const LayerPicture& layer : files.layers) {
            if (render.cancelled) break; // --resume writes them
            std::vector<Metadata> more = metadata;
            more.emplace_back(layer_key, layer_text(layer));
            save_layer_picture(layer, frame.film, exposure_of(frame), more);
            saved.layers.push_back(layer.file);
        }
        if (render.cancelled) remove_link(saved.picture);
        save(frame, saved.picture, metadata);
    };
    const auto write_state = [&] {
        try {
            save_film(frame, saved.whole);
        } catch (const InputError& error) { // reported separately: the picture may still be saved
            saved.state_error = error.problems.front();
        }
    };
    if (is_part) {
        save_film(frame, saved.whole);
        return saved;
    }
    if (saved.whole && frame.options.keep_state && !has_more_samples(files)) write_state();
    if (!saved.whole) { // in parallel: the user who pressed Ctrl-C is waiting
        tbb::parallel_invoke(write_picture, write_state);
        return saved;
    }
    try {
        write_picture();
    } catch (const InputError& error) {
        write_state();
        if (saved.state_error) throw;
        std::vector<Problem> problems = error.problems;
        Problem& kept = problems.emplace_back();
        kept.place.file = files.state;
        kept.what = "kept";
        kept.fix = "--resume saves the picture";
        throw InputError(std::move(problems));
    }
    return saved;
}

void remove_unfinished(const FrameFiles& files, bool keep_state) {
    std::error_code error;
    if (files.is_part || (!keep_state && has_more_samples(files)) ||
        (!keep_state && !fs::remove(files.state, error)))
        return;
    remove_partial(files.picture);
}

} // namespace marram
