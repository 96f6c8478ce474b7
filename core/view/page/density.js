// SPDX-License-Identifier: Apache-2.0
// How much sun and sky reach a point through the strands: a grid of cells over the strands, in which the projected area of a sample of
// the strands is counted and then summed along the way to the sun and along the vertical (Beer's law). Compact meshes count as opaque.
// It is coarse and made anew a few times a second, which is enough for soft shadows in hair and on the ground.
import {state} from "./state.js";

const THREE = window.THREE;
const max_samples = 24000;   // vertices counted
const extinction = 0.9;      // mean projected width of a segment over the part's largest radius
const opaque = 4;            // optical depth of a cell with a vertex of a compact mesh

export class Density {
  constructor(uniforms) {
    this.uniforms = uniforms;
    this.cell = {value: 0};   // size of a cell, a uniform of meshes
    this.changed = false;
    this.made = -Infinity;
    this.bodies = [];
    this.resize(state.software ? 32 : 48);
    this.texture.image.data.fill(255);
  }
  resize(n) {
    this.n = n;
    const cells = n * n * n;
    this.counts = new Float32Array(cells);
    this.sun = new Float32Array(cells);
    this.sky = new Float32Array(cells);
    this.texture = new THREE.DataTexture3D(new Uint8Array(4 * cells), n, n, n);
    this.texture.format = THREE.RGBAFormat;
    this.texture.type = THREE.UnsignedByteType;
    this.texture.minFilter = this.texture.magFilter = THREE.LinearFilter;
    this.texture.unpackAlignment = 1;
    this.texture.needsUpdate = true;
    this.uniforms.density.value = this.texture;
  }
  // Meshes that are about as high as wide cast shadows; ground does not.
  set_bodies(meshes) {
    this.bodies = meshes.map(mesh => mesh.geometry.attributes.position.array).filter(positions => {
      const size = new THREE.Box3().setFromArray(positions).getSize(new THREE.Vector3());
      return size.y > 0.4 * Math.max(size.x, size.z);
    });
    this.changed = true;
  }
  update(strands, now) {
    if (!this.changed || now - this.made < (state.software ? 600 : 150) && this.selection === strands.selection) return;
    const box = strands.bounds();
    if (!box) return;
    this.changed = false;
    this.made = now;
    this.selection = strands.selection;
    this.count(strands, box);
    const toward = this.uniforms.sun_direction.value, size = this.size;
    this.sweep(this.sun, [toward.x / size[0], toward.y / size[1], toward.z / size[2]]);
    this.sweep(this.sky, [0, 1 / size[1], 0]);
    const data = this.texture.image.data;
    for (let i = 0; i < this.counts.length; ++i) {
      data[4 * i] = 255 * (0.06 + 0.94 * Math.exp(-this.sun[i]));
      data[4 * i + 1] = 255 * (0.15 + 0.85 * Math.exp(-0.6 * this.sky[i]));
    }
    this.texture.needsUpdate = true;
  }
  // Fills counts with optical depth per unit of length.
  count(strands, box) {
    const {n, counts} = this, cells = counts.length;
    const span = box.upper.map((upper, k) => upper - box.lower[k]), widest = Math.max(...span);
    const lower = box.lower.map((low, k) => low - Math.max(0.02 * widest, 0.04 * span[k]));
    const upper = box.upper.map((high, k) => high + Math.max(0.02 * widest, 0.04 * span[k]));
    this.size = upper.map((high, k) => (high - lower[k]) / n);
    this.cell.value = 0.6 * Math.min(...this.size);
    this.uniforms.density_lower.value.set(...lower);
    this.uniforms.density_scale.value.set(...upper.map((high, k) => 1 / (high - lower[k])));
    counts.fill(0);
    const volume = this.size[0] * this.size[1] * this.size[2], scale = this.size.map(s => 1 / s);
    const total = strands.vertices();
    const every = Math.max(1, Math.floor(total / max_samples)) | 1;
    for (const part of strands.parts)
      for (const chunk of part.chunks) {
        const {values, step, lower: low} = chunk;
        for (let v = 1; v + 1 < chunk.vertices; v += every) {
          if (!part.begins[4 * (chunk.first + v - 1) + 2]) continue;
          const at = 3 * v, px = low[0] + step[0] * values[at], py = low[1] + step[1] * values[at + 1], pz = low[2] + step[2] * values[at + 2];
          const dx = step[0] * (values[at + 3] - values[at]), dy = step[1] * (values[at + 4] - values[at + 1]);
          const dz = step[2] * (values[at + 5] - values[at + 2]);
          const x = (px - lower[0]) * scale[0], y = (py - lower[1]) * scale[1], z = (pz - lower[2]) * scale[2];
          const length = Math.sqrt(dx * dx + dy * dy + dz * dz);   // of the segment
          counts[(x | 0) + n * ((y | 0) + n * (z | 0))] += every * length * part.radius * part.widen * extinction / volume;
        }
      }
    for (const positions of this.bodies)
      for (let v = 0; v < positions.length; v += 3) {
        const x = (positions[v] - lower[0]) * scale[0], y = (positions[v + 1] - lower[1]) * scale[1], z = (positions[v + 2] - lower[2]) * scale[2];
        if (x >= 0 && y >= 0 && z >= 0 && x < n && y < n && z < n) counts[(x | 0) + n * ((y | 0) + n * (z | 0))] = opaque / this.size[0];
      }
    return cells;
  }
  // into = optical depth from the cell's middle on along `way` (in cells): slice after slice from the side that it points to.
  sweep(into, way) {
    const {n, counts} = this, strides = [1, n, n * n];
    const main = [0, 1, 2].reduce((best, k) => Math.abs(way[k]) > Math.abs(way[best]) ? k : best, 0);
    const [a, b] = [0, 1, 2].filter(k => k !== main), forward = way[main] > 0 ? 1 : -1, length = 1 / Math.abs(way[main]);
    const shift_a = way[a] * length, shift_b = way[b] * length, sm = strides[main], sa = strides[a], sb = strides[b];
    const ia = Math.floor(shift_a), ib = Math.floor(shift_b), fa = shift_a - ia, fb = shift_b - ib;
    const inside = v => v < 0 ? 0 : v >= n ? n - 1 : v;
    for (let s = 0; s < n; ++s) {
      const m = forward > 0 ? n - 1 - s : s, before = (m + forward) * sm;
      for (let j = 0; j < n; ++j) {
        const b0 = inside(j + ib) * sb, b1 = inside(j + ib + 1) * sb;
        for (let i = 0; i < n; ++i) {
          const cell = m * sm + i * sa + j * sb;
          let depth = 0;
          if (s > 0) {
            const a0 = inside(i + ia) * sa, a1 = inside(i + ia + 1) * sa;
            depth = (1 - fb) * ((1 - fa) * (into[before + a0 + b0] + length * counts[before + a0 + b0]) +
                fa * (into[before + a1 + b0] + length * counts[before + a1 + b0])) +
              fb * ((1 - fa) * (into[before + a0 + b1] + length * counts[before + a0 + b1]) +
                fa * (into[before + a1 + b1] + length * counts[before + a1 + b1]));
          }
          into[cell] = depth;
        }
      }
    }
  }
}
