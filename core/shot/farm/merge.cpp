// SPDX-License-Identifier: Apache-2.0
#include "core/shot/farm/merge.h"

#include "core/image/atomic_file.h"
#include "core/image/run_files.h"
#include "core/math/file_types.h"
#include "core/shot/picture_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace marram {
namespace {

bool is_state_name(const std::string& path) { return extension_of(path) == ".tif"; }

FilmPart whole_of(const FilmState& state) { return {0, 0, state.width, state.height, 0, state.samples}; }

// "a; b; c and 5 more parts"
std::string listed(const std::vector<FilmPart>& parts) {
    constexpr size_t max_listed = 4;
    std::vector<std::string> texts;
    for (size_t i = 0; i < std::min(parts.size(), max_listed); ++i) texts.push_back(to_string(parts[i]));
    const std::string more =
        parts.size() > max_listed ? fmt::format(" and {} more parts", parts.size() - max_listed) : "";
    return fmt::format("{}{}", fmt::join(texts, "; "), more);
}

// All states, checked by themselves and against the first.
std::vector<FilmState> read_states(const std::vector<std::string>& files) {
    std::vector<FilmState> states(files.size());
    ProblemCollector collect_problems;
    const FilmState* first = nullptr;
    for (size_t i = 0; i < files.size(); ++i)
        collect_problems([&] {
            states[i] = read_state(files[i]);
            if (!states[i].finished)
                throw InputError({files[i]}, "is unfinished",
                                 "render it to its end, with the same command and --resume");
            if (first && states[i].film_digest != first->film_digest)
                throw InputError({files[i]},
                                 fmt::format("belongs to another frame, scene or setting, size or layer list "
                                             "than '{}'",
                                             files[size_t(first - states.data())]),
                                 "merge states of one frame, rendered with the same options");
            if (!first) first = &states[i];
        });
    collect_problems.raise();
    return states;
}

void check_overlaps(const std::vector<std::string>& files, const std::vector<FilmState>& states) {
    struct Entry {
        FilmPart part;
        size_t file;
    };
    std::vector<Entry> entries;
    for (size_t i = 0; i < states.size(); ++i)
        for (const FilmPart& part : states[i].parts) entries.push_back({part, i});
    std::vector<Problem> problems;
    for (size_t b = 0; b < entries.size(); ++b)
        for (size_t a = 0; a < b; ++a) {
            if (!overlap(entries[a].part, entries[b].part)) continue;
            problems.push_back({{files[entries[b].file]},
                                fmt::format("some of {} are also in '{}'", to_string(entries[b].part),
                                            files[entries[a].file]),
                                "leave one of them out",
                                ""});
            break;
        }
    if (!problems.empty()) throw InputError(std::move(problems));
}

// The state whose picture has the most samples.
const FilmState& with_most_samples(const std::vector<FilmState>& states) {
    return *std::ranges::max_element(states, {}, &FilmState::samples);
}

void write_pictures(const MergeRequest& request, const FilmState& all, const std::string& name,
                    const std::string& digest, const Film& film, Merged& merged) {
    const std::vector<Metadata> metadata = picture_metadata(film, all.scene, all.frame, all.seconds, digest);
    for (const LayerPicture& layer : request.pictures) {
        std::vector<Metadata> more = metadata;
        more.emplace_back(layer_key, layer_text(layer));
        save_layer_picture(layer, film, all.exposure, more);
        merged.files.push_back(layer.file);
    }
    save_picture(name, film, all.exposure, metadata);
    merged.files.push_back(name);
}

} // namespace

Merged merge_states(const MergeRequest& request, const std::atomic<bool>& cancel,
                    std::atomic<size_t>& added) {
    const bool to_state = is_state_name(request.output);
    if (!to_state) check_picture_name(request.output);
    if (to_state && !request.pictures.empty())
        throw InputError({"--png " + request.pictures.front().layer}, "a state is merged, not a picture",
                         "leave --png out, or name the output .exr or .png");
    const std::vector<FilmState> states = read_states(request.states);
    check_overlaps(request.states, states);

    FilmState all = with_most_samples(states);
    all.seconds = 0.0;
    all.parts.clear();
    for (const FilmState& state : states) {
        all.seconds += state.seconds;
        all.parts.insert(all.parts.end(), state.parts.begin(), state.parts.end());
    }
    all.parts = join_neighbours(std::move(all.parts));
    const FilmPart whole = whole_of(all);
    Merged merged;
    if (!to_state) merged.missing = missing_of(whole, all.parts);
    if (!merged.missing.empty() && !request.partial)
        throw InputError({request.output},
                         fmt::format("of this picture are missing: {}", listed(merged.missing)),
                         "render them, or add --partial for a picture of what is there");
    const bool complete = merged.missing.empty();
    const std::string name = to_state || complete ? request.output : partial_name(request.output);

    RunFiles files(request.states);
    files.write(name);
    check_writable(name);
    if (!complete) check_partial_name(name);
    if (to_state) check_state_overwrite(name);
    const Film layers = empty_film(all, {0, 0, 1, 1, 0, 1});
    for (const LayerPicture& layer : request.pictures) {
        if (!find_layer(layers, layer.layer))
            throw InputError({"--png " + layer.layer}, "the states have no such layer",
                             "render them with --aov " + layer.layer);
        files.write(layer.file);
        check_writable(layer.file);
    }

    const FilmPart bounds = to_state ? bounds_of(all.parts) : whole;
    Film film = empty_film(all, bounds);
    for (size_t i = 0; i < states.size(); ++i) {
        if (cancel) throw Cancelled();
        add_state(request.states[i], states[i], bounds, film);
        ++added;
    }
    if (to_state) {
        all.finished = true;
        save_state(name, all, film);
        merged.files.push_back(name);
        return merged;
    }
    resolve(film);
    write_pictures(request, all, name, complete ? all.picture_digest : unfinished, film, merged);
    if (complete) remove_partial(name);
    return merged;
}

} // namespace marram
