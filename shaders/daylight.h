// SPDX-License-Identifier: Apache-2.0
// daylight: the sun and the sky that it lights, from noon to the end of dusk, computed from what the air is made of:
// molecules, aerosol, ozone, and the ground below. Light scattered once keeps its direction; all further scattering
// and the ground's light are in.
//
//   parameter      unit  default    meaning
//   direction      -     [1, 2, 1]  towards the sun, as of the light "sun": the one can stand for the other
//   angle          deg   0.53       the sun's angular diameter; larger: softer shadows
//   sun            -     true       false: the sky alone
//   turbidity      1     2.5        haze: optical depth of molecules and aerosol over that of molecules, straight up
//                                   at 550 nm. 1 pure air, 2 very clear, 3 clear, 6 hazy, 10 thick
//   ozone          DU    300        what makes dusk blue overhead; 100 ... 500 on earth
//   altitude       m     100        of the scene above the sea
//   ground_albedo  1     0.2        share of light that the land around reflects
//   strength       1     1          factor on everything
//
//   [[light]]
//   type = "daylight"
//   direction = [-2, 1, -1]
//   turbidity = 3
//
// Units: at strength 1 the sun above the air gives an irradiance of 5 in each of red, green and blue. So white is
// sunlight above the air, to which a viewer's eye is taken to be adapted (Bradford's transform; CIE 15:2004); at noon
// a white ground shows as about 1.6. Below the horizon: the land, evenly grey, seen through the air from `altitude`.
// Once the sun's disc has set, only the sky is left; from 18 degrees below the horizon on the sky is black: there are
// no moon, stars or airglow. There is no refraction and no cloud. Colours that linear sRGB cannot show (parts of a blue
// sky and of a red dusk) have their negative component set to 0.
//
// Bodhaine et al. 1999 (molecules); Hess et al. 1998 (aerosol); Gorshelev et al. 2014 (ozone); Hillaire 2020 (the way
// to sum many scatterings); Wyman, Sloan, Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching
// Functions", 2013. atmosphere.cpp opens with the formulas.
#pragma once

#include "shaders/atmosphere.h"

#include <cstdint>
#include <span>

namespace marram {

inline constexpr float sun_above_air = 5.0F; // irradiance at strength 1, in each component

struct DaylightSettings {
    Vec3d direction = Vec3d(1.0, 2.0, 1.0); // towards the sun, any length; y is up
    double angle = 0.533 * degree;          // angular diameter, radians
    double turbidity = 2.5;
    double ozone = 300.0;    // Dobson units
    double altitude = 100.0; // m
    double ground_albedo = 0.2;
};

AirSettings air_of(const DaylightSettings& settings);

// Linear sRGB of a spectrum relative to the sun's: all ones give white. Components may be negative.
Vec3f color_of(const Spectrum& spectrum);

// On a plane that faces the sun: the mean over the part of its disc that is above the horizon, times that part. `air` may be one that
// only transmits.
Vec3f sun_irradiance(const DaylightSettings& settings, const Atmosphere& air);

class Daylight {
  public:
    explicit Daylight(const DaylightSettings& settings, const Loop& loop = one_by_one);

    // Of sky and ground, without the sun's disc; y is up. W/(m2 sr), never negative.
    Vec3f radiance(const Vec3d& direction) const;

    Vec3f sun_irradiance() const { return marram::sun_irradiance(settings_, atmosphere_); }

    // One row of a latitude-longitude image, rows from the top (+y), the sun above or below its centre. Costs far
    // less than radiance() for each pixel: what lies along a path is computed at 17 azimuths and interpolated, the
    // phase functions, which make the sky steep around the sun, are evaluated at each pixel.
    void image_row(size_t row, size_t height, std::span<Vec3f> pixels) const;

    const Atmosphere& atmosphere() const { return atmosphere_; }

  private:
    DaylightSettings settings_;
    Atmosphere atmosphere_;
    double sun_cosine_; // with the vertical
};

} // namespace marram
