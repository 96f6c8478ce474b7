// SPDX-License-Identifier: Apache-2.0
// Shear stress of the wind over a smooth surface, by linear theory. See shear.cpp for the model.
#pragma once

#include "procedural/air/transform.h"

#include <memory>

namespace marram {

struct ShearCoefficients {
    double in_phase = 3.5;     // A: stress in phase with the surface, per unit of slope
    double out_of_phase = 2.0; // B: stress a quarter wave upwind of the crest
    double cross = 0.75;       // ratio of the response across the wind to that along it
    bool operator==(const ShearCoefficients&) const = default;
};

// Grids are rows of `columns` floats, `pitch(columns)` apart.
class Shear {
  public:
    // `resolution`, above 0 to 1: of the wave numbers along a column, the share that makes stress: those with
    // a wavelength of at least 2 cells / resolution, and always one. The others are not transformed along the
    // rows.
    Shear(int rows, int columns, double cell, double resolution = 1.0);

    int rows() const { return rows_.size(); }
    int columns() const { return columns_.size(); }
    // A multiple of 16 but not of 256: rows a multiple of 1 KB apart would share few cache sets.
    static int pitch(int columns) {
        const int least = (columns + 15) / 16 * 16;
        return least % 256 == 0 ? least + 16 : least;
    }

    // Relative perturbation of the stress, for a wind along the unit vector (wind_row, wind_column): `along`
    // the wind and `across` it, towards (-wind_column, wind_row). The surface is periodic, in metres. Writes
    // only `keep_rows` by `keep_columns` values, with the pitch of keep_columns.
    void perturbation(const ShearCoefficients& coefficients, double wind_row, double wind_column,
                      const float* surface, int keep_rows, int keep_columns, float* along, float* across);

  private:
    void forward(const float* surface);
    void convolve(const ShearCoefficients& coefficients, double wind_row, double wind_column);
    void inverse(int keep_rows, int keep_columns, float* along, float* across);

    Transform rows_, columns_; // along a column (over rows), along a row
    double cell_;
    int last_wave_; // greatest wave number along a column that makes stress
    size_t blocks_; // of eight wave numbers
    WideVector<WideComplex> spectrum_, across_;
};

// Ground that is not periodic is padded to a size that transforms well, by at least a quarter.
int padded_size(int size);
// Fills the padding of a surface of `rows` by `columns` values with a pitch of
// Shear::pitch(padded_columns): it is blended smoothly from border to border.
void pad_surface(int rows, int columns, int padded_rows, int padded_columns, float* surface);

} // namespace marram
