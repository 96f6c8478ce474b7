// SPDX-License-Identifier: Apache-2.0
// OpenVDB level sets as meshes, and back: libmarram_level_set.so, which level_set_file.cpp loads on use. The only file
// of core that includes OpenVDB.
//
// OpenVDB trusts its files: a damaged one can make it write outside its buffers. So a child process reads the
// file, with limits on its memory and time, and sends the narrow band as plain arrays: leaves of 8 x 8 x 8
// distances. If it crashes, the file is damaged.
#include "core/read/vdb/level_set_library.h"

#include <fmt/format.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <new>
#include <sstream>
#include <utility>

namespace marram {
namespace {

using openvdb::FloatGrid;

using FloatTree = openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

constexpr uint64_t max_leaves = 0x1p22; // of a file: 2^31 voxels, 9 GB

// What the child process writes: the status and a text (what is wrong, a newline, the remedy), or the status,
// a header, and leaves.
enum class ReadStatus : uint32_t { refused = 1, read = 2 };
struct GridHeader {
    double matrix[16]; // from voxels to metres, row vectors
    float background;
    uint64_t leaves;
};
struct LeafRecord {
    int32_t origin[3];
    uint64_t active[Leaf::NUM_VALUES / 64];
    float values[Leaf::NUM_VALUES];
};

struct Refusal {
    std::string what, remedy;
};

// ---- The child process. It has one thread, so OpenVDB's parallel functions must not be called. ----

void write_all(int file, const void* data, size_t count) {
    const char* bytes = static_cast<const char*>(data);
    while (count > 0) {
        const ssize_t n = ::write(file, bytes, count);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) ::_exit(1);
        bytes += n, count -= size_t(n);
    }
}

// The only level set of floats. Throws Refusal.
FloatGrid::Ptr read_level_set(std::string& bytes) {
    FloatGrid::Ptr found;
    std::string others;
    std::istringstream in(std::move(bytes));
    in.exceptions(std::ios::failbit | std::ios::badbit); // OpenVDB does not check for the end
    constexpr bool read_values_later = false;
    auto* stream =
        new openvdb::io::Stream(in, read_values_later); // not deleted: OpenVDB would do it in parallel
    for (const openvdb::GridBase::Ptr& grid : *stream->getGrids()) {
        if (grid->isType<FloatGrid>() && grid->getGridClass() == openvdb::GRID_LEVEL_SET) {
            if (found)
                throw Refusal{fmt::format("holds several level sets, \"{}\" and \"{}\"", found->getName(),
                                          grid->getName()),
                              "write each to a file of its own"};
            found = openvdb::gridPtrCast<FloatGrid>(grid);
            continue;
        }
        others += fmt::format("{}\"{}\" ({}, {})", others.empty() ? "" : ", ", grid->getName(),
                              grid->valueType(), openvdb::GridBase::gridClassToString(grid->getGridClass()));
    }
    if (found) return found;
    throw Refusal{others.empty() ? "holds no grids" : "holds no level set of 32-bit floats, but " + others,
                  "write the surface as a level set (signed distances) of floats"};
}

void check_level_set(const FloatGrid& grid) {
    if (!grid.transform().isLinear()) throw Refusal{"has a transform that is not linear", "resample it"};
    const FloatTree& tree = grid.tree();
    auto tiles = tree.cbeginValueOn();
    tiles.setMaxDepth(FloatTree::ValueOnCIter::LEAF_DEPTH - 1);
    if (tiles)
        throw Refusal{"has active tiles", "write a level set whose active voxels are near the surface"};
    if (tree.leafCount() > max_leaves)
        throw Refusal{fmt::format("has {} leaves, the limit is {}", tree.leafCount(), max_leaves),
                      "write it with larger voxels"};
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf)
        for (auto value = leaf->cbeginValueOn(); value; ++value)
            if (!std::isfinite(*value)) throw Refusal{"has a distance that is not finite", "repair it"};
}

void send_grid(int file, const FloatGrid& grid) {
    const ReadStatus status = ReadStatus::read;
    GridHeader header{};
    const openvdb::Mat4R matrix = grid.transform().baseMap()->getAffineMap()->getMat4();
    std::copy_n(matrix.asPointer(), 16, header.matrix);
    header.background = grid.background();
    header.leaves = grid.tree().leafCount();
    write_all(file, &status, sizeof status);
    write_all(file, &header, sizeof header);
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
        LeafRecord record{};
        for (int axis = 0; axis < 3; ++axis) record.origin[axis] = leaf->origin()[axis];
        for (openvdb::Index k = 0; k < Leaf::NUM_VALUES; ++k) {
            record.values[k] = leaf->getValue(k);
            if (leaf->isValueOn(k)) record.active[k / 64] |= uint64_t(1) << (k % 64);
        }
        write_all(file, &record, sizeof record);
    }
}

void set_limit(int resource, rlim_t most) {
    const rlimit limits{most, most};
    ::setrlimit(resource, &limits);
}

[[noreturn]] void child_main(int file, std::string& bytes) {
    ::alarm(unsigned(30 + bytes.size() / 1'000'000)); // s
    size_t pages = 0;                                 // virtual memory now
    std::ifstream("/proc/self/statm") >> pages;
    set_limit(RLIMIT_AS, pages * size_t(::sysconf(_SC_PAGESIZE)) + 64 * bytes.size() + (size_t(512) << 20));
    set_limit(RLIMIT_CPU, 10 + bytes.size() / 2'000'000); // s
    set_limit(RLIMIT_CORE, 0);
    if (const int null = ::open("/dev/null", O_WRONLY); null >= 0) ::dup2(null, STDERR_FILENO);
    for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGTERM}) ::signal(signal, SIG_DFL);
    ::signal(SIGINT, SIG_IGN); // Ctrl-C is for the parent
    Refusal refusal;
    try {
        const FloatGrid::Ptr grid = read_level_set(bytes);
        check_level_set(*grid);
        send_grid(file, *grid);
        ::_exit(0);
    } catch (const Refusal& fault) {
        refusal = fault;
    } catch (const std::bad_alloc&) {
        refusal = {"needs too much memory, or is damaged", "write it with larger voxels, or again"};
    } catch (...) { // OpenVDB's texts say nothing to a user
        refusal = {"is no OpenVDB file, or is damaged", "write it again"};
    }
    const ReadStatus status = ReadStatus::refused;
    std::replace(refusal.what.begin(), refusal.what.end(), '\n', ' '); // names of grids
    const std::string text = refusal.what.substr(0, 1000) + '\n' + refusal.remedy;
    write_all(file, &status, sizeof status);
    write_all(file, text.data(), text.size());
    ::_exit(0);
}

// ---- The parent ----

// Returns false at the end of the pipe.
bool read_all(int file, void* data, size_t count) {
    char* bytes = static_cast<char*>(data);
    while (count > 0) {
        const ssize_t n = ::read(file, bytes, count);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes += n, count -= size_t(n);
    }
    return true;
}

// Rebuilds the grid from what the child passes on. Throws Refusal.
FloatGrid::Ptr receive_grid(int file) {
    const Refusal damaged{"is damaged", "write it again"};
    ReadStatus status{};
    if (!read_all(file, &status, sizeof status)) throw damaged;
    if (status != ReadStatus::read) {
        std::string text;
        for (char c = 0; text.size() < 4096 && read_all(file, &c, 1);) text += c;
        const size_t newline = text.find('\n');
        if (status != ReadStatus::refused || newline == std::string::npos) throw damaged;
        throw Refusal{text.substr(0, newline), text.substr(newline + 1)};
    }
    GridHeader header;
    if (!read_all(file, &header, sizeof header) || header.leaves > max_leaves ||
        !std::isfinite(header.background))
        throw damaged;
    for (const double number : header.matrix)
        if (!std::isfinite(number)) throw damaged;
    const FloatGrid::Ptr grid = FloatGrid::create(header.background);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(openvdb::Mat4R(header.matrix)));
    LeafRecord record;
    for (uint64_t k = 0; k < header.leaves; ++k) {
        if (!read_all(file, &record, sizeof record)) throw damaged;
        Leaf* leaf = grid->tree().touchLeaf({record.origin[0], record.origin[1], record.origin[2]});
        for (openvdb::Index n = 0; n < Leaf::NUM_VALUES; ++n)
            leaf->setValueOnly(n, record.values[n]),
                leaf->setActiveState(n, (record.active[n / 64] >> n % 64) & 1U);
    }
    openvdb::tools::signedFloodFill(grid->tree());
    return grid;
}

FloatGrid::Ptr read_in_child_process(const std::string& path, std::string& bytes) {
    openvdb::initialize();
    int pipe_ends[2];
    if (::pipe2(pipe_ends, O_CLOEXEC) != 0)
        throw InputError(Place{path}, "cannot be read: too many files are open", "close some");
    const pid_t child = ::fork();
    const int fork_error = errno;
    if (child == 0) {
        ::close(pipe_ends[0]); // so that it ends if the parent does
        child_main(pipe_ends[1], bytes);
    }
    ::close(pipe_ends[1]);
    bytes.clear();
    bytes.shrink_to_fit();
    FloatGrid::Ptr grid;
    Refusal refusal;
    try {
        if (child < 0)
            throw Refusal{
                fmt::format("cannot be read: no process can be started ({})", std::strerror(fork_error)),
                "raise the limit on processes (ulimit -u), or free some memory"};
        grid = receive_grid(pipe_ends[0]);
    } catch (const Refusal& fault) {
        refusal = fault;
    } catch (const std::bad_alloc&) {
        refusal = {"does not fit into memory", "write it with larger voxels"};
    } catch (const std::exception&) { // a transform without an inverse
        refusal = {"is damaged", "write it again"};
    }
    ::close(pipe_ends[0]);
    if (child > 0) {
        if (!grid) ::kill(child, SIGKILL);
        while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
        }
    }
    if (!grid) throw InputError(Place{path}, refusal.what, refusal.remedy);
    return grid;
}

Mesh read_level_set_mesh(const std::string& path, std::string& bytes) {
    const FloatGrid::Ptr grid = read_in_child_process(path, bytes);
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(*grid, points, quads);
    if (quads.empty())
        throw InputError(Place{path}, "is a level set without a surface",
                         "write distances that are below 0 inside, and above 0 outside");
    Mesh mesh;
    mesh.positions.reserve(points.size());
    for (const openvdb::Vec3s& p : points) {
        const Vec3f position(p.x(), p.y(), p.z());
        if (!(double(position.cwiseAbs().maxCoeff()) <= embree_limit))
            throw InputError(Place{path}, "has a vertex beyond 1e18", "check its transform");
        mesh.positions.push_back(position);
    }
    mesh.triangles.reserve(2 * quads.size());
    const auto at = [&](const openvdb::Vec4I& quad, int k) { return mesh.positions[quad[k]]; };
    for (const openvdb::Vec4I& q : quads) { // along the shorter diagonal
        const bool first = (at(q, 2) - at(q, 0)).squaredNorm() <= (at(q, 3) - at(q, 1)).squaredNorm();
        mesh.triangles.push_back({q[0], q[1], first ? q[2] : q[3]});
        mesh.triangles.push_back({first ? q[0] : q[1], q[2], q[3]});
    }
    if (grid->transform().baseMap()->getAffineMap()->getMat4().det() < 0.0) // the transform mirrors the faces
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    return mesh;
}

std::string level_set_bytes(const std::string& path, const MeshGeometry& mesh, double voxel) {
    const std::vector<Vec3f>& positions = mesh.positions.at(0);
    std::vector<openvdb::Vec3s> points;
    points.reserve(positions.size());
    for (const Vec3f& p : positions) points.emplace_back(p.x(), p.y(), p.z());
    std::vector<openvdb::Vec3I> triangles;
    triangles.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    std::ostringstream bytes;
    try {
        openvdb::initialize();
        const FloatGrid::Ptr grid = openvdb::tools::meshToLevelSet<FloatGrid>(
            *openvdb::math::Transform::createLinearTransform(voxel), points, triangles);
        grid->setName(mesh.name);
        openvdb::io::Stream(bytes).write(openvdb::GridPtrVec{grid});
    } catch (const openvdb::Exception& error) {
        throw InputError({path}, fmt::format("'{}' cannot be written: {}", mesh.name, error.what()),
                         "bake it to .ply or .obj");
    }
    return bytes.str();
}

} // namespace

} // namespace marram

extern "C" __attribute__((visibility("default"))) const marram::LevelSetLibrary* marram_level_set_library() {
    static const marram::LevelSetLibrary library = {
        .version = MARRAM_VERSION,
        .size = sizeof(marram::LevelSetLibrary),
        .read = marram::read_level_set_mesh,
        .bytes = marram::level_set_bytes,
    };
    return &library;
}
