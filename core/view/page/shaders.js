// SPDX-License-Identifier: Apache-2.0
// Light and tone that strands, meshes and the sky share. Values are linear radiance until encoded(): radiance * 2^exposure, clipped, sRGB.
// `density` holds how much sun (r) and sky (g) reaches a point through the strands (density.js), over the box at
// density_lower with the inverse size density_scale.

export const shading_glsl = `
uniform vec3 eye, sun_direction, sun_color, sky_color, ground_color;
uniform float exposure;
uniform highp sampler3D density;
uniform vec3 density_lower, density_scale;
vec3 encoded(vec3 radiance) {
  vec3 v = clamp(radiance * exp2(exposure), 0.0, 1.0);
  return mix(v * 12.92, 1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}
vec2 open_at(vec3 place) {
  vec3 at = (place - density_lower) * density_scale;
  return textureLod(density, clamp(at, 0.0, 1.0), 0.0).rg;
}
vec3 ambient(vec3 normal) { return mix(ground_color, sky_color, 0.5 + 0.5 * normal.y); }
`;

// Colours of values, sRGB: from dark blue to yellow, and of classes 0, 1, 2, ...
export const value_stops = [[0.19, 0.10, 0.36], [0.19, 0.36, 0.62], [0.12, 0.60, 0.56], [0.52, 0.77, 0.28], [0.99, 0.90, 0.25]];
export const class_colors = [[0.45, 0.50, 0.55], [0.98, 0.68, 0.20], [1.0, 0.16, 0.22]];
const glsl_colors = colors => `vec3[](${colors.map(c => `vec3(${c.map(x => x.toFixed(3)).join()})`).join()})`;
// value_mode: 0 the material's colour, 1 values, 2 classes. value_range: of the colours; a value is 0 ... 1 of value_given.
export const value_glsl = `
uniform int value_mode;
uniform vec2 value_range, value_given;
const vec3 value_stops[${value_stops.length}] = ${glsl_colors(value_stops)};
const vec3 class_colors[${class_colors.length}] = ${glsl_colors(class_colors)};
vec3 value_color(float share) {
  float value = mix(value_given.x, value_given.y, share);
  if (value_mode == 2) return class_colors[clamp(int(value + 0.5), 0, ${class_colors.length - 1})];
  float at = clamp((value - value_range.x) / max(value_range.y - value_range.x, 1e-30), 0.0, 1.0) * ${(value_stops.length - 1).toFixed(1)};
  int low = min(int(at), ${value_stops.length - 2});
  return mix(value_stops[low], value_stops[low + 1], at - float(low));
}
`;

// Kajiya and Kay, "Rendering fur with three dimensional textures", 1989: diffuse by the sine between strand and light, and a highlight
// along the cone of the mirror direction. A second, coloured highlight is shifted towards the tip (Marschner et al. 2003).
export const hair_shading_glsl = `
vec3 hair_radiance(vec3 albedo, vec3 place, vec3 along, float u, float random) {
  vec2 open = open_at(place);
  vec3 view = normalize(eye - place);
  float tl = dot(along, sun_direction), tv = dot(along, view);
  float sl = sqrt(max(0.0, 1.0 - tl * tl)), sv = sqrt(max(0.0, 1.0 - tv * tv));
  float cone = max(0.0, sl * sv - tl * tv), cone2 = cone * cone, cone4 = cone2 * cone2, cone16 = cone4 * cone4 * cone4 * cone4;
  float forward = 0.5 - 0.5 * dot(view, sun_direction);   // light that is transmitted towards the eye
  vec3 sun = sun_color * open.x;
  vec3 scattered = albedo * (0.54 * sl * (0.75 + 0.6 * forward * forward));
  vec3 shine = vec3(0.05) * cone16 * cone4 + 0.16 * sqrt(albedo) * cone4 * cone4 * (0.4 + 0.6 * random);
  return sun * (scattered + shine * sl) + albedo * ambient(vec3(0.0, 0.6 * sqrt(1.0 - along.y * along.y), 0.0)) * open.y * 0.8;
}
`;

// Meshes: Lambert. by_vertex: lit at their vertices.
const lit = `
uniform vec3 albedo;
uniform float facetted, shadow_offset;
vec3 albedo_of(float value) { return value_mode == 0 ? albedo : pow(value_color(value), vec3(2.2)); }
vec3 lit(vec3 place, vec3 n, float value) {
  if (dot(n, eye - place) < 0.0) n = -n;
  vec2 open = open_at(place + shadow_offset * (n + sun_direction));
  vec3 light = sun_color * max(0.0, dot(n, sun_direction)) * open.x + ambient(n) * (0.25 + 0.75 * open.y);
  return encoded(albedo_of(value) * light);
}
`;
export const mesh_vertex = by_vertex => `#version 300 es
precision highp float;
in vec3 position; in vec3 normal; in float value;
uniform mat4 viewMatrix, projectionMatrix;
out vec3 place, upright;
out float share;
${by_vertex ? shading_glsl + value_glsl + lit : ""}
void main() {
  place = position;
  share = value;
  upright = ${by_vertex ? "lit(position, normalize(normal + vec3(0.0, 1e-12, 0.0)), value)" : "normal"};
  gl_Position = projectionMatrix * viewMatrix * vec4(position, 1.0);
}`;
export const mesh_fragment = by_vertex => by_vertex ? `#version 300 es
precision mediump float;
in vec3 upright;
out vec4 pixel;
void main() { pixel = vec4(upright, 1.0); }` : `#version 300 es
precision highp float;
in vec3 place, upright;
in float share;
out vec4 pixel;
${shading_glsl}
${value_glsl}
${lit}
void main() {
  pixel = vec4(lit(place, facetted > 0.5 ? normalize(cross(dFdx(place), dFdy(place))) : normalize(upright), share), 1.0);
}`;

// A grid over the view, behind everything, lit at its vertices; the fragment chooses the side of the horizon.
export const sky_vertex = `#version 300 es
precision highp float;
in vec3 position;
uniform vec3 ray_center, ray_x, ray_y;
out vec4 above;   // and the height over the horizon
out vec3 below;
${shading_glsl}
void main() {
  gl_Position = vec4(position.xy, 0.999999, 1.0);
  vec3 way = ray_center + position.x * ray_x + position.y * ray_y, d = normalize(way);
  float grey = dot(sky_color, vec3(0.2126, 0.7152, 0.0722));
  vec3 horizon = mix(sky_color, vec3(grey), 0.55) * 1.25, zenith = sky_color * 0.8;
  vec3 high = mix(horizon, zenith, pow(clamp(d.y, 0.0, 1.0), 0.5));
  float glow = max(0.0, dot(d, sun_direction));
  high += sun_color * (0.05 * pow(glow, 24.0) + 0.02 * pow(glow, 4.0));
  above = vec4(encoded(high), way.y);
  below = encoded(mix(horizon * 0.75, ground_color, clamp(-d.y * 3.0, 0.0, 1.0)));
}`;
export const sky_fragment = `#version 300 es
precision mediump float;
in vec4 above;
in vec3 below;
out vec4 pixel;
void main() { pixel = vec4(mix(below, above.rgb, smoothstep(-0.003, 0.003, above.w)), 1.0); }`;
