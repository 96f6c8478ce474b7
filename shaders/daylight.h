// SPDX-License-Identifier: Apache-2.0
// daylight: the sun and the sky, from noon to the end of dusk, computed from the composition of the air
// (molecules, aerosol, ozone) and the ground below. Includes single scattering with the exact phase
// functions, multiple scattering, and light reflected by the ground.
//
//   parameter      unit  default    meaning
//   direction      -     [1, 2, 1]  towards the sun, as for the light "sun": the two are interchangeable
//   angle          deg   0.53       angular diameter of the sun; larger: softer shadows
//   sun            -     true       false: only the sky
//   turbidity      1     2.5        haze: vertical optical depth of molecules and aerosol over that of
//                                   molecules at 550 nm. 1 pure air, 2 very clear, 3 clear, 6 hazy, 10 thick
//   ozone          DU    300        ozone column, which makes the zenith blue at dusk; 100 ... 500 on earth
//   altitude       m     100        of the scene above sea level
//   ground_albedo  1     0.2        reflectance of the surrounding land, a number or a colour
//   strength       1     1          factor on sun and sky
//   seen_by_camera -     true       false: they light the scene, but the camera does not see them
//
//   [[light]]
//   type = "daylight"
//   direction = [-2, 1, -1]
//   turbidity = 3
//
// Units: at strength 1 the sun above the air gives an irradiance of 5 in each of red, green and blue. White
// is sunlight above the air, to which the viewer's eye is assumed to be adapted (Bradford's transform; CIE
// 15:2004); at noon the radiance of a white ground is about 1.6. Below the horizon: the land, of one colour,
// seen through the air from `altitude`; the air itself is lit by a grey land of the same luminance. After
// sunset only the sky is left; with the sun 18 degrees or more below the horizon the sky is black: there are
// no moon, stars or airglow. There is no refraction and no cloud. Colours outside linear sRGB (parts of a blue sky and of a red dusk) have their negative component
// set to 0.
//
// Bodhaine et al. 1999 (molecules); Hess et al. 1998 (aerosol); Gorshelev et al. 2014 (ozone); Hillaire 2020
// (multiple scattering); Wyman, Sloan, Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching
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
    Vec3d ground_albedo = Vec3d::Constant(0.2);
};

AirSettings air_of(const DaylightSettings& settings);

// Linear sRGB of a spectrum relative to the sun's: all ones is white. Components may be negative.
Vec3f color_of(const Spectrum& spectrum);

// Irradiance of a plane that faces the sun: the mean over the part of the disc above the horizon, times that
// fraction. `air` may be built without scattering.
Vec3f sun_irradiance(const DaylightSettings& settings, const Atmosphere& air);

class Daylight {
  public:
    explicit Daylight(const DaylightSettings& settings, const Loop& loop = serial_loop);

    // Radiance of sky and ground, without the sun's disc; y is up. W/(m2 sr), never negative.
    Vec3f radiance(const Vec3d& direction) const;

    Vec3f sun_irradiance() const { return marram::sun_irradiance(settings_, atmosphere_); }

    // One row of a latitude-longitude image, rows from the top (+y), the sun in the centre column. Much
    // faster than radiance() for each pixel: scattering along the path is computed at 17 azimuths and
    // interpolated; only the phase functions, which are steep around the sun, are evaluated at each pixel.
    void image_row(size_t row, size_t height, std::span<Vec3f> pixels) const;

    const Atmosphere& atmosphere() const { return atmosphere_; }

  private:
    DaylightSettings settings_;
    Atmosphere atmosphere_;
    double sun_cosine_; // with the vertical
    Vec3f ground_tint_; // the ground's albedo less that of the grey ground that lights the air
};

} // namespace marram
