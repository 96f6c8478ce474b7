// SPDX-License-Identifier: Apache-2.0
// Cem Yuksel's HAIR (hair_format.h): a header of 128 bytes, then arrays according to its flags, in this
// order: segments of each strand, points, thickness, transparency, color. Arrays are read directly to where
// they belong, and checked while they are in the cache.
#include "core/read/hair_format.h"
#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>

namespace marram {

namespace {

// A file that is read in parts.
class RandomAccessFile {
  public:
    explicit RandomAccessFile(const std::string& path);
    ~RandomAccessFile() {
        if (descriptor_ >= 0) ::close(descriptor_);
    }
    RandomAccessFile(const RandomAccessFile&) = delete;
    RandomAccessFile& operator=(const RandomAccessFile&) = delete;
    uint64_t size() const { return size_; }
    void read(uint64_t at, void* to, size_t count) const; // from any thread

  private:
    const std::string& path_;
    int descriptor_;
    uint64_t size_ = 0;
};

RandomAccessFile::RandomAccessFile(const std::string& path)
    : path_(path), descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
    struct stat status {};
    if (descriptor_ < 0 && errno == ENOENT)
        throw InputError({path}, "there is no such file", "check the path");
    const bool known = descriptor_ >= 0 && ::fstat(descriptor_, &status) == 0;
    if (!known && descriptor_ >= 0) ::close(descriptor_); // no destructor runs
    if (!known) throw InputError({path}, "cannot be read", "check the file's permissions");
    if (!S_ISREG(status.st_mode)) {
        ::close(descriptor_);
        throw InputError({path}, "is not an ordinary file", "give the path of a .hair file");
    }
    size_ = uint64_t(status.st_size);
}

void RandomAccessFile::read(uint64_t at, void* to, size_t count) const {
    for (char* next = static_cast<char*>(to); count > 0;) {
        const ssize_t got = ::pread(descriptor_, next, count, off_t(at));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0)
            throw InputError({path_}, got == 0 ? "became shorter while it was read" : "cannot be read",
                             "check that nobody writes it, and the disk");
        next += got;
        at += uint64_t(got);
        count -= size_t(got);
    }
}

class HairReader {
  public:
    explicit HairReader(const std::string& path) : path_(path), file_(path) {}
    StrandFile read();

  private:
    void read_header();
    void read_counts();
    template <typename Check>
    void read_floats(float* to, uint64_t count, float low, float high, Check complain);
    void read_color(const float* neutral, uint32_t components, const char* name, bool has_array,
                    const float* given);
    float default_of(float value, const char* what) const {
        if (!std::isfinite(value))
            throw InputError({path_}, fmt::format("the header's {} is not finite", what), "write a number");
        return value;
    }

    const std::string& path_;
    RandomAccessFile file_;
    HairHeader header_;
    uint64_t at_ = sizeof(HairHeader);
    StrandFile strands_;
};

void HairReader::read_header() {
    if (file_.size() >= sizeof header_) file_.read(0, &header_, sizeof header_);
    const HairHeader right;
    if (file_.size() < sizeof header_ || std::memcmp(header_.magic, right.magic, sizeof right.magic) != 0)
        throw InputError({path_}, "has no header of a .hair file", "check that it is one, and complete");
    if ((header_.flags & hair_points) == 0)
        throw InputError({path_}, "its flags say that it has no points", "export the strands anew");
    if (header_.strands == 0 || header_.points == 0)
        throw InputError({path_}, "has no strands", "check that the strands were exported");
    constexpr uint32_t known = hair_segments | hair_points | hair_thickness | hair_transparency | hair_color;
    if ((header_.flags & ~known) != 0)
        throw InputError({path_}, fmt::format("its flags {:#x} are not all known", header_.flags),
                         "export it with flags up to 0x1f");
    const uint64_t floats = 3 + ((header_.flags & hair_thickness) ? 1 : 0) +
                            ((header_.flags & hair_transparency) ? 1 : 0) +
                            ((header_.flags & hair_color) ? 3 : 0);
    const uint64_t expected = sizeof header_ +
                              ((header_.flags & hair_segments) ? 2 * uint64_t(header_.strands) : 0) +
                              sizeof(float) * floats * header_.points;
    if (file_.size() != expected)
        throw InputError({path_},
                         fmt::format("{} strands with {} points take {} bytes, the file has {}",
                                     header_.strands, header_.points, expected, file_.size()),
                         file_.size() < expected ? "check that the file is complete"
                                                 : "check the counts in the header");
}

void HairReader::read_counts() {
    uint64_t sum = 0;
    const uint64_t strands = header_.strands;
    if (header_.flags & hair_segments) {
        std::vector<uint16_t> segments(strands);
        file_.read(at_, segments.data(), segments.size() * sizeof(uint16_t));
        at_ += segments.size() * sizeof(uint16_t);
        strands_.counts.resize(strands);
        for (size_t s = 0; s < strands; ++s) sum += strands_.counts[s] = segments[s] + 1U;
    } else {
        sum = strands * (uint64_t(header_.default_segments) + 1);
        if (sum == header_.points) strands_.counts.assign(strands, header_.default_segments + 1);
    }
    if (sum != header_.points)
        throw InputError(
            {path_},
            fmt::format("its strands have {} points together, the header says {}", sum, header_.points),
            "export the strands anew");
}

// complain(i) throws for the first number i that is not within low ... high.
template <typename Check>
void HairReader::read_floats(float* to, uint64_t count, float low, float high, Check complain) {
    constexpr uint64_t part = uint64_t(1) << 17;
    std::atomic<uint64_t> first_fault = ~uint64_t(0);
    tbb::parallel_for(uint64_t(0), (count + part - 1) / part, [&](uint64_t p) {
        const uint64_t begin = p * part, end = std::min(begin + part, count);
        file_.read(at_ + begin * sizeof(float), to + begin, size_t(end - begin) * sizeof(float));
        unsigned bad = 0;
        for (uint64_t i = begin; i < end; ++i) bad |= unsigned(!(to[i] >= low)) | unsigned(!(to[i] <= high));
        if (bad == 0) return;
        uint64_t fault = begin;
        while (to[fault] >= low && to[fault] <= high) ++fault;
        uint64_t known = first_fault.load();
        while (fault < known && !first_fault.compare_exchange_weak(known, fault)) {
        }
    });
    at_ += count * sizeof(float);
    if (first_fault.load() < count) complain(first_fault.load());
}

// Color or transparency of all points, or the header's if it differs from `neutral`.
void HairReader::read_color(const float* neutral, uint32_t components, const char* name, bool has_array,
                            const float* given) {
    constexpr float greatest = std::numeric_limits<float>::max();
    AttributeValues attribute{name, components, has_array ? MARRAM_PER_CV : MARRAM_PER_CURVE, {}};
    if (has_array) {
        attribute.values.resize(size_t(header_.points) * components);
        read_floats(attribute.values.data(), attribute.values.size(), -greatest, greatest, [&](uint64_t i) {
            throw InputError({path_}, fmt::format("the {} of point {} is not finite", name, i / components),
                             "export the strands anew");
        });
    } else {
        bool is_neutral = true;
        for (uint32_t k = 0; k < components; ++k)
            is_neutral = is_neutral && default_of(given[k], name) == neutral[k];
        if (is_neutral) return;
        attribute.values.reserve(size_t(header_.strands) * components);
        for (uint32_t s = 0; s < header_.strands; ++s)
            attribute.values.insert(attribute.values.end(), given, given + components);
    }
    strands_.attributes.push_back(std::move(attribute));
}

StrandFile HairReader::read() {
    read_header();
    read_counts();
    StrandSample& sample = strands_.samples.emplace_back();
    sample.points = std::vector<Vec3f>(header_.points);
    constexpr auto farthest = float(max_curve_coordinate);
    float* coordinates = sample.points.front().data();
    read_floats(coordinates, 3 * uint64_t(header_.points), -farthest, farthest, [&](uint64_t i) {
        throw InputError(
            {path_},
            fmt::format("point {} {}", i / 3,
                        std::isfinite(coordinates[i]) ? "is beyond 1e8 m" : "is not three finite numbers"),
            "write finite numbers, and scale the strands down");
    });
    const float thickness = default_of(header_.default_thickness, "thickness");
    if (header_.flags & hair_thickness) {
        sample.widths.resize(header_.points);
        read_floats(sample.widths.data(), header_.points, 0.0F, farthest, [&](uint64_t i) {
            throw InputError({path_}, fmt::format("the thickness of point {} is {}", i, sample.widths[i]),
                             "write diameters, 0 or more");
        });
    } else if (thickness != HairHeader().default_thickness && thickness != 1.0F) {
        // 1 is what writers leave there: no width. Who needs one and is given none says so.
        if (!(thickness >= 0.0F && thickness <= farthest))
            throw InputError({path_}, fmt::format("the header's thickness is {}", thickness),
                             "write a diameter, 0 or more");
        sample.widths.assign(header_.points, thickness);
    }
    const HairHeader neutral;
    read_color(&neutral.default_transparency, 1, "transparency", (header_.flags & hair_transparency) != 0,
               &header_.default_transparency);
    read_color(neutral.default_color, 3, "color", (header_.flags & hair_color) != 0, header_.default_color);
    remove_short_curves(path_, strands_);
    return std::move(strands_);
}

} // namespace

StrandFile read_hair_strands(const std::string& file) { return HairReader(file).read(); }

} // namespace marram
