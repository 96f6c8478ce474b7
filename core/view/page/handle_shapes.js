// SPDX-License-Identifier: Apache-2.0
// The shapes of gusts, fields and curves as lines in the view, and which of them lies under the pointer.
import {state} from "./state.js";
import {triples} from "./handle_values.js";

const THREE = window.THREE;
const colors = {gust: 0xffd75e, drifting: 0xe6dfc4, field: 0x6fd6ff, points: 0xf29bd8, selected: 0xffffff};
const hidden_opacity = 0.3, inner_opacity = 0.5, drifting_opacity = 0.5;   // hidden: behind strands or ground
const line_reach = 6, dot_reach = 9;   // pixels
export const drawn_shapes = new Set(["sphere", "box", "image", "grid"]);

// Ends of segments, in the shape's own space.
function circles(count) {
  const ends = [], at = (k, i) => {
    const angle = 2 * Math.PI * i / count, point = [0, 0, 0];
    point[(k + 1) % 3] = Math.cos(angle);
    point[(k + 2) % 3] = Math.sin(angle);
    return point;
  };
  for (let k = 0; k < 3; ++k) for (let i = 0; i < count; ++i) ends.push(at(k, i), at(k, i + 1));
  return ends;
}
function box_edges([x, y, z]) {
  const ends = [], corner = bits => [bits & 1 ? x : -x, bits & 2 ? y : -y, bits & 4 ? z : -z];
  for (let a = 0; a < 8; ++a) for (const bit of [1, 2, 4]) if (!(a & bit)) ends.push(corner(a), corner(a | bit));
  return ends;
}
const square = [[-1, 0, -1], [1, 0, -1], [1, 0, -1], [1, 0, 1], [1, 0, 1], [-1, 0, 1], [-1, 0, 1], [-1, 0, -1]];
const cross = [[-0.5, 0, 0], [0.5, 0, 0], [0, -0.5, 0], [0, 0.5, 0], [0, 0, -0.5], [0, 0, 0.5]];
const sphere = circles(72);

function ends_of(handle) {
  if (handle.kind === "points") {
    const points = triples(handle.points), count = points.length - (handle.closed ? 0 : 1);
    return Array.from({length: Math.max(0, count)}, (_, i) => [points[i], points[(i + 1) % points.length]]).flat();
  }
  return {sphere, image: square, grid: cross}[handle.shape] || box_edges([1, 1, 1]);
}

function geometry_of(points) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points.flat(), 3));
  return geometry;
}

// Drawn twice: what is in front of all that is drawn, and, dimmer, what is behind.
function lines(geometry, opacity, type = THREE.LineSegments, material = THREE.LineBasicMaterial, more = {}) {
  return [[THREE.LessEqualDepth, opacity], [THREE.GreaterDepth, opacity * hidden_opacity]].map(([depthFunc, share]) => {
    const object = new type(geometry, new material({transparent: true, opacity: share, depthFunc, depthWrite: false, ...more}));
    object.frustumCulled = false;
    object.share = share;
    return object;
  });
}

export class HandleView {
  constructor(handle, parent) {
    this.handle = handle;
    this.parent = parent;
    this.object = new THREE.Object3D();
    this.object.rotation.order = "ZYX";
    this.held = false;   // the pointer's value is shown, until the scene has it
    parent.add(this.object);
    this.rebuild();
  }
  rebuild() {
    const {handle, object} = this;
    this.clear();
    this.ends = ends_of(handle);
    this.parts = lines(geometry_of(this.ends), 1);
    if (handle.kind === "points")
      this.parts.push(...lines(geometry_of(triples(handle.points)), 1, THREE.Points, THREE.PointsMaterial, {size: 7, sizeAttenuation: false}));
    if (handle.shape === "box") {
      const inner = box_edges(handle.inner || [0.5, 0.5, 0.5]);
      this.parts.push(...lines(geometry_of(inner), inner_opacity));
    }
    object.add(...this.parts);
    this.paint("");
  }
  set_points(points) {
    const count = this.ends.length;
    this.handle = {...this.handle, points};
    this.ends = ends_of(this.handle);
    if (this.ends.length !== count) { this.rebuild(); return; }
    for (const [part, values] of [[this.parts[0], this.ends.flat()], [this.parts[2], points]]) {   // each with a second that shares its geometry
      const attribute = part.geometry.attributes.position;
      attribute.array.set(values);
      attribute.needsUpdate = true;
    }
  }
  clear() {
    for (const part of this.parts || []) { this.object.remove(part); part.geometry.dispose(); part.material.dispose(); }
    this.parts = [];
  }
  dispose() { this.clear(); this.parent.remove(this.object); }
  // state: "", "hovered", "selected"
  paint(state) {
    const own = colors[this.handle.kind] || colors.field;
    for (const part of this.parts) {
      part.material.color.setHex(state === "selected" ? colors.selected : own);
      if (state === "hovered") part.material.color.lerp(new THREE.Color(0xffffff), 0.6);
      part.material.opacity = state ? Math.min(1, 1.5 * part.share) : 0.9 * part.share;
    }
  }
  place(pose) {
    const {object} = this;
    object.position.set(...pose.translate);
    object.rotation.set(...pose.rotate.map(angle => angle * Math.PI / 180));
    object.scale.set(...pose.scale.map(size => size || 1e-6));
  }
  center() {
    if (this.handle.kind !== "points") return this.object.position.clone();
    const points = triples(this.handle.points);
    return points.reduce((sum, point) => sum.add(new THREE.Vector3(...point)), new THREE.Vector3()).divideScalar(Math.max(1, points.length));
  }
  // Where the ray enters the shape, if it does and begins outside: its volume, else null.
  volume_under(ray) {
    const shape = this.handle.shape, scale = this.object.scale, volume = Math.abs(scale.x * scale.y * scale.z);
    if (this.handle.kind === "points" || shape === "grid") return null;
    const local = ray.clone().applyMatrix4(new THREE.Matrix4().getInverse(this.object.matrixWorld)), from = local.origin, hit = new THREE.Vector3();
    if (shape === "sphere") return from.length() > 1 && local.intersectSphere(new THREE.Sphere(new THREE.Vector3(), 1), hit) ? volume * 4 / 3 * Math.PI : null;
    const high = new THREE.Vector3(1, shape === "image" ? 1e-3 : 1, 1), box = new THREE.Box3(high.clone().negate(), high);
    return !box.containsPoint(from) && local.intersectBox(box, hit) ? volume * 8 : null;
  }
}

// Places on the screen, in pixels; null behind the camera.
function projector(camera, width, height, object) {
  const matrix = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(object.matrixWorld), place = new THREE.Vector4();
  return ([x, y, z]) => {
    place.set(x, y, z, 1).applyMatrix4(matrix);
    return place.w > 1e-6 ? [(place.x / place.w + 1) / 2 * width, (1 - place.y / place.w) / 2 * height] : null;
  };
}
function distance_to_segment(p, a, b) {
  const way = [b[0] - a[0], b[1] - a[1]], size = way[0] * way[0] + way[1] * way[1];
  const t = size > 0 ? Math.min(1, Math.max(0, ((p[0] - a[0]) * way[0] + (p[1] - a[1]) * way[1]) / size)) : 0;
  return Math.hypot(a[0] + t * way[0] - p[0], a[1] + t * way[1] - p[1]);
}

// {view, point} at a place in pixels, or null: a dot of a curve, else the nearest line, else the smallest shape. point: -1 if none.
export function pick(views, at, camera, width, height) {
  let best = null, reach = line_reach, dots = dot_reach;
  for (const view of views) {
    const project = projector(camera, width, height, view.object);
    if (view.handle.kind === "points")
      triples(view.handle.points).forEach((point, index) => {
        const place = project(point), far = place ? Math.hypot(place[0] - at[0], place[1] - at[1]) : Infinity;
        if (far < dots) { dots = far; best = {view, point: index}; }
      });
  }
  if (best) return best;
  for (const view of views) {
    if (view.handle.kind === "points") continue;
    const places = view.ends.map(projector(camera, width, height, view.object));
    for (let i = 0; i + 1 < places.length; i += 2) {
      const far = places[i] && places[i + 1] ? distance_to_segment(at, places[i], places[i + 1]) : Infinity;
      if (far < reach) { reach = far; best = {view, point: -1}; }
    }
  }
  if (best) return best;
  const caster = new THREE.Raycaster();
  caster.setFromCamera({x: 2 * at[0] / width - 1, y: 1 - 2 * at[1] / height}, camera);
  let least = Infinity;
  for (const view of views) {
    const volume = view.volume_under(caster.ray);
    if (volume !== null && volume < least) { least = volume; best = {view, point: -1}; }
  }
  return best;
}

// Random gusts of a frame: thin spheres, which fade with their strength; many are paler. Software GL takes its time for each line: fewer
// there, and only those in front.
export class Drifting {
  constructor(parent) {
    this.parent = parent;
    this.geometry = geometry_of(circles(state.software ? 20 : 40));
    this.spheres = [];
  }
  show(gusts) {
    while (this.spheres.length < gusts.length) {
      const sphere = new THREE.Object3D();
      const passes = lines(this.geometry, drifting_opacity, THREE.LineSegments, THREE.LineBasicMaterial, {color: colors.drifting});
      sphere.add(...passes.slice(0, state.software ? 1 : 2));
      this.parent.add(sphere);
      this.spheres.push(sphere);
    }
    const pale = Math.max(0.3, Math.min(1, 12 / Math.max(1, gusts.length)));
    this.spheres.forEach((sphere, index) => {
      const gust = gusts[index];
      sphere.visible = !!gust && gust.radius > 0 && Math.abs(gust.strength) > 0.01;
      if (!sphere.visible) return;
      sphere.position.set(...gust.center);
      sphere.scale.setScalar(gust.radius);
      for (const part of sphere.children) part.material.opacity = pale * part.share * Math.min(1, Math.abs(gust.strength));
    });
  }
}
