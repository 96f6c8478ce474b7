// SPDX-License-Identifier: Apache-2.0
// The steps from the faces of a mesh to scour and deposits at each sample. The model is documented in
// ruin.cpp.
#pragma once

#include "procedural/abi/parallel.h"
#include "procedural/terrain/ruin/ruin.h"
#include "procedural/terrain/ruin/ruin_faces.h"
#include "procedural/terrain/ruin/ruin_grid.h"

#include <cstddef>
#include <functional>
#include <vector>

namespace marram {

// The enclosure of a sample.
struct RuinRoom {
    double share = 0.0, walls = 0.0; // enclosure, 0 to 1; height of the walls, m
};

// Computes scour and deposits, in metres, for the samples of `rect`. The other arguments must outlive it. Its
// grid has 67 bytes a sample; the sweeps (ruin_cones.h) are serial, everything else is parallel.
class RuinShaper {
  public:
    RuinShaper(const Domain& domain, const Fields& below, const RuinMesh& mesh, const RuinSettings& settings,
               const Rect& rect)
        : domain_(domain), below_(below), mesh_(mesh), settings_(settings), grid_(rect) {}

    // Fills the grid, and counts faces and rooms in `result`. False: cancelled.
    bool shape(RuinResult& result, const std::function<bool()>& cancelled);
    const RuinGrid& grid() const { return grid_; }

  private:
    Vec2d place(int i, int j) const {
        return mesh_.frame().frame({domain_.x(grid_.rect.i0 + i), domain_.z(grid_.rect.j0 + j)});
    }
    bool near(const Vec2d& p, double margin) const {
        return p.x() >= mesh_.lower().x() - margin && p.x() <= mesh_.upper().x() + margin &&
               p.y() >= mesh_.lower().z() - margin && p.y() <= mesh_.upper().z() + margin;
    }
    template <typename F>
    void rows(F&& f) {
        marram::parallel_for(0, grid_.nz, [&](int j) {
            for (int i = 0; i < grid_.nx; ++i) f(i, j, grid_.at(i, j));
        });
    }
    void read(const RuinLines& lines);
    void find_walls();
    bool within(const Vec2d& p, double y) const;
    bool wall(const Vec2d& p, const Vec2d& q, double y) const;
    void smooth_field(std::vector<double>& field);
    void collapse_pit_rim();
    void limit_deposit_slope();

    // ruin_rooms.cpp
    void fill_rooms(RuinResult& result);
    void find_rooms();
    RuinRoom room_at(const Vec2d& p, double ground) const;
    double around(const Vec2d& p, double y, double reach) const;
    bool hits_front_faces(const Vec2d& p, double y, double reach) const;
    std::vector<size_t> flood(size_t first, std::vector<char>& seen) const;
    double level_of(const std::vector<size_t>& room) const;

    const Domain& domain_;
    const Fields& below_;
    const RuinMesh& mesh_;
    const RuinSettings& settings_;
    RuinGrid grid_;
};

} // namespace marram
