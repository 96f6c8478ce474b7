// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_library.h"
#include "core/math/own_library.h"

#include <algorithm>
#include <new>
#include <thread>

#include <sys/mman.h>

namespace marram {
namespace {

constexpr const char* file = "libmarram_images.so"; // found through the program's RUNPATH
// Address space in bytes: with Debian 12's libraries loading takes 429 MiB. Some of their initialisers print
// errors of their own if they cannot allocate, so the space is checked first.
constexpr size_t room = size_t(448) << 20;

void check_room(size_t bytes) {
    void* at =
        ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (at == MAP_FAILED) throw std::bad_alloc();
    ::munmap(at, bytes);
}

const ImageLibrary* load() {
    check_room(room);
    try {
        const auto& library = load_own_library<ImageLibrary>(file, image_library_entry, MARRAM_VERSION);
        also_remove_temporary_files(library.remove_temporary_files);
        return &library;
    } catch (const std::runtime_error& error) {
        throw InputError({file},
                         std::string("the library that reads and writes pictures cannot be loaded (") +
                             error.what() + ")",
                         "install marram and Debian's OpenImageIO again");
    }
}

const ImageLibrary& library() {
    static const ImageLibrary* const loaded = load();
    return *loaded;
}

// OpenEXR starts one thread per processor when it opens its first file. If one of them cannot be created, it
// frees objects that the earlier ones wait on, and the process ends: so check first that their stacks fit.
const ImageLibrary& library_for_exr() {
    static const bool has_room = [] {
        constexpr size_t stack = size_t(9) << 20; // Debian's 8 MiB, and per-thread data
        check_room(stack * std::max(std::thread::hardware_concurrency(), 1U));
        return true;
    }();
    (void)has_room;
    return library();
}

} // namespace

void load_image_library() { library(); }

// ---- Declared in the headers of this folder

Image read_image(const std::string& path, ColorSpace space) {
    return library_for_exr().read_image(path, space);
}

void write_exr(const std::string& path, int width, int height, std::span<const Layer> layers,
               std::span<const Metadata> metadata) {
    library_for_exr().write_exr(path, width, height, layers, metadata);
}

std::vector<unsigned char> png_bytes(int width, int height, int channels, const float* pixels,
                                     double exposure_stops) {
    return library().png_bytes(width, height, channels, pixels, exposure_stops);
}

void write_png(const std::string& path, int width, int height, int channels, const float* pixels,
               double exposure_stops, std::span<const Metadata> metadata) {
    library().write_png(path, width, height, channels, pixels, exposure_stops, metadata);
}

void write_grey_png(const std::string& path, int width, int height, const uint16_t* pixels,
                    std::span<const Metadata> metadata) {
    library().write_grey_png(path, width, height, pixels, metadata);
}

void write_grey_tiff(const std::string& path, int width, int height, const float* pixels,
                     const std::string& description) {
    library().write_grey_tiff(path, width, height, pixels, description);
}

ImageHeader image_header(const std::string& path) { return library().image_header(path); }

std::vector<std::pair<std::string, std::string>> read_all_metadata(const std::string& path) {
    return library().read_all_metadata(path);
}

std::optional<std::string> read_metadata(const std::string& path, const std::string& key) {
    return library().read_metadata(path, key);
}

std::optional<std::string> whole_metadata(const std::string& path, const std::string& key) {
    return library().whole_metadata(path, key);
}

void write_words(const std::string& path, const WordsHeader& header,
                 const std::function<void(int, uint32_t*)>& row) {
    library_for_exr().write_words(path, header, row);
}

WordsHeader read_words_header(const std::string& path) { return library().read_words_header(path); }

void read_words(const std::string& path, const WordsHeader& header,
                const std::function<void(int, const uint32_t*)>& row) {
    library_for_exr().read_words(path, header, row);
}

void write_range_png(const std::string& path, int width, int height, int channels, const float* pixels,
                     const ValueRange& range, std::span<const Metadata> metadata) {
    library().write_range_png(path, width, height, channels, pixels, range, metadata);
}

bool write_sheet(const std::string& output, const std::vector<SheetPicture>& pictures,
                 const SheetLayout& layout, const std::function<void(size_t)>& at) {
    return library().write_sheet(output, pictures, layout, at);
}

std::shared_ptr<const Texture> open_texture_file(const std::string& file, ColorSpace space,
                                                 const Place& place) {
    return library_for_exr().open_texture_file(file, space, place);
}

} // namespace marram
