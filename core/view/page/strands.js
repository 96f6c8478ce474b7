// SPDX-License-Identifier: Apache-2.0
// Draws strands with WebGL2. The vertices of a part lie in two textures as they come from the server: positions (uint16 or float32 x3) and
// attributes (uint8 x4). The vertex shader fetches the four control points of its segment by gl_VertexID, evaluates the cubic at a few
// parameters and widens it on the screen. One draw call a chunk, a strip whose strands are linked by empty triangles. (Instances would do
// the same with attributes, but GPUs are slow at instances of ten vertices, and software GL takes 100 times as long.)
import {state} from "./state.js";
import {view_of} from "./net.js";
import {shading_glsl, hair_shading_glsl, value_glsl} from "./shaders.js";

// Where all strands of a part have as many vertices (`period`), a strip is a strand, else it is a segment.
export const vertex_source = floats => `#version 300 es
precision highp float; precision highp int;
uniform highp ${floats ? "sampler2D" : "usampler2D"} positions;
uniform highp sampler2D attributes;             // u, radius, begins, random
uniform highp usampler2D values;
uniform int row_shift, first_vertex, period, corners, every;  // corners: vertices of a strip; every: strips from one drawn to the next
uniform float spacing;                          // segments from one station of the strip to the next
uniform mat4 basis, slope;                      // weights of the control points: columns multiply 1, t, t^2, t^3
uniform mat4 to_clip;
uniform vec3 lower, step_size;
uniform vec3 root_color, tip_color;
uniform vec2 pixels;                            // size of the view
uniform float radius, pixel_scale, min_half;    // pixel_scale: pixels of a unit at distance 1
out vec4 color;
${shading_glsl}
${hair_shading_glsl}
${value_glsl}
ivec2 texel(int vertex) { return ivec2(vertex & ((1 << row_shift) - 1), vertex >> row_shift); }
float value(int vertex) { return float(texelFetch(values, texel(vertex), 0).x) / 65535.0; }
vec3 position(int vertex) { return vec3(texelFetch(positions, texel(vertex), 0).xyz); }
void main() {
  int strip = gl_VertexID / corners, corner = clamp(gl_VertexID - strip * corners - 1, 0, corners - 3);
  int segments = period > 0 ? period - 3 : 1;
  float station = min(float(corner >> 1) * spacing, float(segments));
  int segment = min(int(station), segments - 1);
  int vertex = first_vertex + strip * every * max(period, 1) + segment;
  vec4 a1 = texelFetch(attributes, texel(vertex + 1), 0), a2 = texelFetch(attributes, texel(vertex + 2), 0);
  color = vec4(0.0);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (period == 0 && texelFetch(attributes, texel(vertex), 0).z < 0.5) return;
  float t = station - float(segment), side = float(corner & 1) * 2.0 - 1.0;
  vec4 powers = vec4(1.0, t, t * t, t * t * t);
  vec4 w = basis * powers, d = slope * powers;
  vec3 p0 = position(vertex), p1 = position(vertex + 1), p2 = position(vertex + 2), p3 = position(vertex + 3);
  vec3 place = lower + step_size * (w.x * p0 + w.y * p1 + w.z * p2 + w.w * p3);
  vec3 along = step_size * (d.x * p0 + d.y * p1 + d.z * p2 + d.w * p3);
  vec2 shape = mix(a1.xy, a2.xy, t);            // u, radius
  vec4 clip = to_clip * vec4(place, 1.0), way = to_clip * vec4(along, 0.0);
  vec2 screen = (way.xy * clip.w - clip.xy * way.w) * pixels;
  float size = length(screen);
  vec2 across = size > 0.0 ? vec2(-screen.y, screen.x) / size : vec2(1.0, 0.0);
  float wanted = radius * shape.y * pixel_scale / max(clip.w, 1e-6), half_width = max(wanted, min_half);
  gl_Position = clip + vec4(across * (side * half_width * 2.0 / pixels) * clip.w, 0.0, 0.0);
  vec3 albedo = mix(root_color, tip_color, shape.x) * (0.8 + 0.4 * a1.w);
  vec3 seen = encoded(hair_radiance(albedo, place, normalize(along + vec3(1e-20)), shape.x, a1.w));
  // Classes do not mix along a segment: it is that of its end.
  if (value_mode != 0) seen = value_color(value_mode == 2 ? value(vertex + 2) : mix(value(vertex + 1), value(vertex + 2), t)) * (0.85 + 0.3 * a1.w);
  color = vec4(seen, wanted / half_width);
}`;
export const fragment_source = `#version 300 es
precision mediump float;
in vec4 color;
out vec4 pixel;
void main() { pixel = color; }`;

// Columns: coefficients of 1, t, t^2, t^3 for the four control points (core/geometry/cubic.h).
const bases = {
  "bspline": [[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]].map(c => c.map(x => x / 6)),
  "catmull-rom": [[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]].map(c => c.map(x => x / 2)),
  "linear": [[0, 1, 0, 0], [0, -1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
};
const zero = [0, 0, 0, 0];
const slope_of = b => [b[1], b[2].map(x => 2 * x), b[3].map(x => 3 * x), zero];
const row_shift = 11, row = 1 << row_shift;   // vertices in a row of a texture: every WebGL 2 has textures of 2048

// Puts values of `vertices` vertices, `size` numbers each, into rows of a texture from vertex `first` on.
function fill_rows(gl, format, type, values, first, vertices, size) {
  for (let done = 0; done < vertices;) {
    const x = (first + done) % row, y = (first + done) / row | 0;
    const whole = x === 0 && vertices - done >= row, width = Math.min(row - x, vertices - done);
    const rows = whole ? (vertices - done) / row | 0 : 1;
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, rows, format, type, values, size * done);
    done += width * rows;
  }
}

export function compile(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); ++i) {
    const name = gl.getActiveUniform(program, i).name;
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return {program, uniforms};
}

// Vertices of a strand if all strands of the part have as many, else 0.
function period_of(attributes, vertices, strands) {
  const period = vertices / strands;
  if (!Number.isInteger(period) || period < 4) return 0;
  for (let s = 0; s < strands; ++s)
    for (let i = 0, v = s * period; i < period; ++i, ++v)
      if ((attributes[4 * v + 2] > 0) !== (i < period - 3)) return 0;
  return period;
}

// Box of floats x3, from every third of them.
function box_of(values) {
  const lower = [Infinity, Infinity, Infinity], upper = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i + 2 < values.length; i += 9)
    for (let k = 0; k < 3; ++k) {
      lower[k] = Math.min(lower[k], values[i + k]);
      upper[k] = Math.max(upper[k], values[i + k]);
    }
  return {lower, upper};
}

// Strands that stand for many are widened, but less than to the area of all: leaves are no grass.
const widening = 0.6;
const many_vertices = 600000, max_software_vertices = 60000;

export class Strands {
  constructor(gl, renderer) {
    this.gl = gl;
    this.renderer = renderer;
    this.parts = [];
    this.selection = -1;
    this.shown = 0;
    this.total = 0;
    this.given = [0, 0];   // range of the values of a frame
    this.create();
  }
  create() {
    this.programs = [false, true].map(floats => compile(this.gl, vertex_source(floats), fragment_source));
    this.vao = this.gl.createVertexArray();   // without attributes
    this.no_values = this.texture(this.gl.R16UI, 1);
  }
  texture(format, vertices) {
    const gl = this.gl, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, row, Math.max(1, Math.ceil(vertices / row)));
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }
  begin_upload() {
    const gl = this.gl;
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.activeTexture(gl.TEXTURE0);
  }
  end_upload() {   // three.js keeps track of what is bound
    this.gl.bindTexture(this.gl.TEXTURE_2D, null);
    this.renderer.state.reset();
  }
  // A "strands" message.
  select(header, payload) {
    const gl = this.gl;
    const all = header.parts.map(part => view_of(payload, Uint8Array, part.attributes, 4 * part.vertices));
    for (const part of this.parts) for (const name of ["attributes", "positions", "values"]) gl.deleteTexture(part[name]);
    this.begin_upload();
    this.parts = header.parts.map((part, index) => {
      const attributes = this.texture(gl.RGBA8, part.vertices);
      fill_rows(gl, gl.RGBA, gl.UNSIGNED_BYTE, all[index], 0, part.vertices, 4);
      return {...part, attributes, begins: all[index], positions: null, floats: null, values: null, has_values: false, chunks: [], period: period_of(all[index], part.vertices, part.strands)};
    });
    this.end_upload();
    this.selection = header.selection;
    this.shown = header.parts.reduce((sum, part) => sum + part.strands, 0);
    this.total = header.parts.reduce((sum, part) => sum + part.of, 0);
  }
  // A "frame" message of the present selection.
  update(header, payload) {
    const gl = this.gl;
    if (header.parts.length !== this.parts.length) throw new Error("a frame has other parts than the strands");
    this.begin_upload();
    header.parts.forEach((from, index) => {
      const part = this.parts[index];
      part.has_values = from.chunks.length > 0 && from.chunks.every(chunk => chunk.values >= 0);
      part.chunks = from.chunks.map(chunk => {
        const floats = !chunk.step;
        if (chunk.first_vertex + chunk.vertices > part.vertices) throw new Error("a chunk is longer than its part");
        const values = view_of(payload, floats ? Float32Array : Uint16Array, chunk.offset, 3 * chunk.vertices);
        if (part.floats !== floats) {
          gl.deleteTexture(part.positions);
          part.positions = this.texture(floats ? gl.RGB32F : gl.RGB16UI, part.vertices);
          part.floats = floats;
        }
        gl.bindTexture(gl.TEXTURE_2D, part.positions);
        fill_rows(gl, floats ? gl.RGB : gl.RGB_INTEGER, floats ? gl.FLOAT : gl.UNSIGNED_SHORT, values, chunk.first_vertex, chunk.vertices, 3);
        if (part.has_values) {
          part.values ??= this.texture(gl.R16UI, part.vertices);
          gl.bindTexture(gl.TEXTURE_2D, part.values);
          fill_rows(gl, gl.RED_INTEGER, gl.UNSIGNED_SHORT, view_of(payload, Uint16Array, chunk.values, chunk.vertices), chunk.first_vertex, chunk.vertices, 1);
        }
        return {first: chunk.first_vertex, vertices: chunk.vertices, values, lower: chunk.lower || [0, 0, 0], step: chunk.step || [1, 1, 1],
          box: chunk.step ? {lower: chunk.lower, upper: chunk.lower.map((low, k) => low + 65535 * chunk.step[k])} : box_of(values)};
      });
    });
    this.end_upload();
    this.given = header.values ? [header.values.lower, header.values.upper] : [0, 0];
  }
  vertices() {
    return this.parts.reduce((sum, part) => sum + part.vertices, 0);
  }
  // view: {to_clip: Float32Array(16), pixels: [w, h], pixel_scale, multisampled, every, value_mode, value_range, set_shading(gl, uniforms)}
  // every: draws only each so many-th strand.
  draw(view) {
    const gl = this.gl;
    if (!this.parts.length) return;
    gl.bindVertexArray(this.vao);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.depthMask(true);
    gl.disable(gl.CULL_FACE);
    gl.disable(gl.BLEND);
    const smooth = view.multisampled, every = view.every || 1, many = this.vertices() / every;
    if (smooth) gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    for (const part of this.parts) {
      const {program, uniforms} = this.programs[part.floats ? 1 : 0], basis = bases[part.basis] || bases.linear;
      gl.useProgram(program);
      view.set_shading(gl, uniforms);
      [part.positions, part.attributes, part.has_values ? part.values : this.no_values].forEach((texture, unit) => {
        gl.activeTexture(gl.TEXTURE1 + unit);
        gl.bindTexture(gl.TEXTURE_2D, texture);
      });
      gl.uniform1i(uniforms.positions, 1);
      gl.uniform1i(uniforms.attributes, 2);
      gl.uniform1i(uniforms.values, 3);
      gl.uniform1i(uniforms.value_mode, part.has_values ? view.value_mode : 0);
      gl.uniform2fv(uniforms.value_range, view.value_range);
      gl.uniform2fv(uniforms.value_given, this.given);
      gl.uniform1i(uniforms.row_shift, row_shift);
      gl.uniformMatrix4fv(uniforms.to_clip, false, view.to_clip);
      gl.uniform2fv(uniforms.pixels, view.pixels);
      gl.uniform1f(uniforms.pixel_scale, view.pixel_scale);
      gl.uniform1f(uniforms.min_half, smooth ? 0.5 : 0.4);
      gl.uniformMatrix4fv(uniforms.basis, false, basis.flat());
      gl.uniformMatrix4fv(uniforms.slope, false, slope_of(basis).flat());
      gl.uniform3fv(uniforms.root_color, part.root_color);
      gl.uniform3fv(uniforms.tip_color, part.tip_color);
      gl.uniform1f(uniforms.radius, part.radius * (part.widen * every) ** widening);
      // Four straight pieces a segment, fewer of many; software GL takes its time for each, so there every other CV may have to do.
      const curved = part.basis !== "linear";
      const spacing = state.software && many > max_software_vertices && curved ? 2 : state.software || !curved || many > 2 * many_vertices ? 1
        : many > many_vertices ? 0.5 : 0.25;
      gl.uniform1f(uniforms.spacing, spacing);
      for (const chunk of part.chunks) {
        const whole = part.period && chunk.vertices % part.period === 0 && chunk.first % part.period === 0, period = whole ? part.period : 0;
        const corners = 2 * (Math.ceil((whole ? period - 3 : 1) / spacing) + 1) + 2, strips = whole ? Math.ceil(chunk.vertices / period / every) : chunk.vertices - 3;
        gl.uniform1i(uniforms.every, whole ? every : 1);
        gl.uniform1i(uniforms.period, period);
        gl.uniform1i(uniforms.corners, corners);
        gl.uniform1i(uniforms.first_vertex, chunk.first);
        gl.uniform3fv(uniforms.lower, chunk.lower);
        gl.uniform3fv(uniforms.step_size, chunk.step);
        if (strips > 0) gl.drawArrays(gl.TRIANGLE_STRIP, 0, strips * corners);
      }
    }
    if (smooth) gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.bindVertexArray(null);
  }
  // Box of the strands last drawn: {lower, upper} or null.
  bounds() {
    const boxes = this.parts.flatMap(part => part.chunks.map(chunk => chunk.box));
    if (!boxes.length) return null;
    return {lower: [0, 1, 2].map(k => Math.min(...boxes.map(box => box.lower[k]))),
      upper: [0, 1, 2].map(k => Math.max(...boxes.map(box => box.upper[k])))};
  }
  // A number that changes with the positions: a hash of some of them. For tests.
  digest() {
    let hash = 2166136261;
    for (const part of this.parts)
      for (const chunk of part.chunks)
        for (let i = 0; i < chunk.values.length; i += 97) {
          const place = chunk.lower[i % 3] + chunk.step[i % 3] * chunk.values[i];
          hash = Math.imul(hash ^ Math.round(1e5 * place), 16777619);
        }
    return hash >>> 0;
  }
}
