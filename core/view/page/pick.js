// SPDX-License-Identifier: Apache-2.0
// What is under a point of the view: the strands that are drawn, and the meshes.
import {byId} from "./state.js";
import {world} from "./world.js";

const THREE = window.THREE;
const reach = 4;   // pixels beside a strand that count as it
// Weights of three control points in a knot of the curve, where its cubic pieces meet.
const knots = {"bspline": [1 / 6, 4 / 6, 1 / 6], "catmull-rom": [0, 1, 0], "linear": [0, 1, 0]};

// Calls use(x, y, depth, vertex) for each knot, in pixels of the view and metres along its axis; a segment of the strand begins at `vertex`.
function each_knot(part, chunk, matrix, width, height, use) {
  const [a, b, c] = knots[part.basis] || knots.linear, {values, lower, step} = chunk, m = matrix.elements;
  const mix = (at, k) => lower[k] + step[k] * (a * values[at + k] + b * values[at + 3 + k] + c * values[at + 6 + k]);
  for (let i = 0; i + 2 < chunk.vertices; ++i) {
    const x = mix(3 * i, 0), y = mix(3 * i, 1), z = mix(3 * i, 2), w = m[3] * x + m[7] * y + m[11] * z + m[15];
    use(width * (0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w), height * (0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w), w, chunk.first + i);
  }
}

// The nearest strand to the camera within reach: {part, vertex, depth}, or null. x, y: pixels of the view.
function strand_at(x, y) {
  const box = byId("live"), matrix = new THREE.Matrix4().multiplyMatrices(world.camera.projectionMatrix, world.camera.matrixWorldInverse);
  let found = null;
  for (const part of world.strands.parts)
    for (const chunk of part.chunks) {
      let last_x = 0, last_y = 0, last_depth = 0;
      each_knot(part, chunk, matrix, box.clientWidth, box.clientHeight, (at_x, at_y, depth, vertex) => {
        const [from_x, from_y, from_depth] = [last_x, last_y, last_depth];
        [last_x, last_y, last_depth] = [at_x, at_y, depth];
        if (vertex === chunk.first || !part.begins[4 * (vertex - 1) + 2] || !(depth > 0 && from_depth > 0)) return;
        const dx = at_x - from_x, dy = at_y - from_y, size = dx * dx + dy * dy;
        const t = size > 0 ? Math.min(1, Math.max(0, ((x - from_x) * dx + (y - from_y) * dy) / size)) : 0;
        const there = from_depth + t * (depth - from_depth);
        if (Math.hypot(from_x + t * dx - x, from_y + t * dy - y) > reach || found && found.depth <= there) return;
        found = {part, vertex: vertex - 1, depth: there};
      });
    }
  return found;
}

// {depth: metres along the camera's axis, strand: {part, vertex} or null}, or null where the sky is. x, y: of the page.
export function pick(client_x, client_y) {
  const box = byId("live").getBoundingClientRect(), x = client_x - box.left, y = client_y - box.top;
  world.camera.updateMatrixWorld();
  const ray = new THREE.Raycaster(), axis = world.camera.getWorldDirection(new THREE.Vector3());
  ray.setFromCamera({x: 2 * x / box.width - 1, y: 1 - 2 * y / box.height}, world.camera);
  const hit = ray.intersectObjects(world.meshes())[0], strand = strand_at(x, y);
  const mesh_depth = hit ? hit.point.sub(world.camera.position).dot(axis) : Infinity;
  if (strand && strand.depth <= mesh_depth + 0.02 * Math.abs(strand.depth)) return {depth: strand.depth, strand};
  return hit ? {depth: mesh_depth, strand: null} : null;
}
