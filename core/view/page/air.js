// SPDX-License-Identifier: Apache-2.0
// What is seen of the wind besides the strands: arrows of the air on a plane that can be dragged, and the rays by which a strand that was
// picked finds shelter. Nothing is asked for while it is not shown.
import {state, on, byId, notice, remembered, remember} from "./state.js";
import {send, view_of} from "./net.js";
import {world} from "./world.js";
import {player, ask_again} from "./player.js";
import {handles, page_shapes, overlay, redraw, reload_shapes, select_shape} from "./handles.js";
import {value_stops} from "./shaders.js";
import {arm} from "./tools.js";

const THREE = window.THREE;
const arrows_a_side = 20, barb = 0.25, dim = [0.42, 0.45, 0.48], plane_key = "plane of the air";
const ray_colors = {free: [0.45, 0.75, 1.0], sheltered: [1.0, 0.35, 0.25], rest: [1.0, 1.0, 1.0]};
const plane = {shown: false, pose: null};
let arrows = null, rays = null, strand = null;   // strand: {part, vertex, selection} that was picked
export const air = {arrows: () => arrows.count, rays: () => rays.count, strand: () => strand, plane};

// Lines with colours at their ends, made anew each time.
class Lines {
  constructor() {
    this.count = 0;
    this.object = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({vertexColors: THREE.VertexColors, transparent: true, opacity: 0.9}));
    this.object.frustumCulled = false;
    this.object.visible = false;
    overlay.add(this.object);
  }
  // points, colors: flat, two points a line
  show(points, colors) {
    this.object.geometry.dispose();
    this.object.geometry = new THREE.BufferGeometry();
    this.object.geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    this.object.geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
    this.count = points.length / 6;
    this.object.visible = points.length > 0;
    redraw();
  }
  hide() { if (this.count) this.show([], []); }
}

// ---- the plane ----
// Over a lawn, through the middle of a head.
function first_pose() {
  const bounds = world.strands.bounds() || state.scene.bounds || {lower: [-1, 0, -1], upper: [1, 1, 1]};
  const middle = k => (bounds.lower[k] + bounds.upper[k]) / 2, half = k => 0.7 * Math.max(1e-3, bounds.upper[k] - bounds.lower[k]);
  const flat = half(1) < 0.4 * Math.max(half(0), half(2));
  return {translate: [middle(0), flat ? bounds.upper[1] : middle(1), middle(2)], rotate: [0, 0, 0], scale: [half(0), 1, half(2)]};
}
function sides() {
  const {translate, rotate, scale} = plane.pose, turn = new THREE.Euler(...rotate.map(angle => angle * Math.PI / 180), "ZYX");
  return {center: translate, u: new THREE.Vector3(scale[0], 0, 0).applyEuler(turn).toArray(), v: new THREE.Vector3(0, 0, scale[2]).applyEuler(turn).toArray()};
}
function asked_for() {
  if (!plane.shown || !handles.visible()) return null;
  const {center, u, v} = sides(), long = Math.max(plane.pose.scale[0], plane.pose.scale[2]), count = size => Math.max(2, Math.round(arrows_a_side * size / long));
  return {center, u, v, columns: count(plane.pose.scale[0]), rows: count(plane.pose.scale[2])};
}
export function show_plane(on) {
  if (!state.scene || plane.shown === on) return;
  if (on && !state.scene.groups.some(group => group.params.some(param => param.key === "wind.speed"))) { notice("The scene has no wind."); return; }
  plane.shown = on;
  if (on) plane.pose ??= first_pose();
  else arrows.hide();
  byId("show_plane").setAttribute("aria-pressed", on);
  keep();
  reload_shapes();
  if (on) select_shape(plane_key);
  ask_again();
}
export const toggle_plane = () => show_plane(!plane.shown);
const keep = () => remember("plane", {...plane, file: state.scene?.file});

// An arrow points where strands there turn to, as long as the wind is strong. A dim line is the wind without noise and gusts.
function show_arrows(header, payload) {
  if (!header.air || !plane.shown) { arrows.hide(); return; }
  const [columns, rows] = header.air.counts, values = view_of(payload, Float32Array, header.air.offset, 7 * columns * rows), {center, u, v} = sides();
  const at = i => new THREE.Vector3().fromArray(values, i), cell = 2 * Math.hypot(...u) / columns, points = [], colors = [];
  let fastest = 1e-9;
  for (let i = 0; i < values.length; i += 7) fastest = Math.max(fastest, at(i).length());
  const eye = world.camera.position, middle = new THREE.Vector3(...center), across_u = new THREE.Vector3(...u), across_v = new THREE.Vector3(...v);
  const line = (a, b, color) => { points.push(...a.toArray(), ...b.toArray()); colors.push(...color, ...color); };
  for (let j = 0; j < rows; ++j)
    for (let i = 0; i < columns; ++i) {
      const k = 7 * (j * columns + i), velocity = at(k), speed = velocity.length(), strength = speed / fastest * values[k + 6];
      const from = middle.clone().addScaledVector(across_u, 2 * (i + 0.5) / columns - 1).addScaledVector(across_v, 2 * (j + 0.5) / rows - 1);
      const mean = velocity.clone().multiplyScalar(cell / fastest), way = mean.clone().multiplyScalar(values[k + 6]).addScaledVector(at(k + 3), strength * cell);
      const tip = from.clone().add(way), side = way.clone().cross(eye.clone().sub(tip)).normalize().multiplyScalar(barb * way.length());
      const color = color_of(strength), back = tip.clone().addScaledVector(way, -barb);
      line(from, from.clone().add(mean), dim);
      line(from, tip, color);
      for (const sign of [1, -1]) line(tip, back.clone().addScaledVector(side, 0.6 * sign), color);
    }
  arrows.show(points, colors);
}
function color_of(share) {
  const at = Math.min(Math.max(share, 0), 1) * (value_stops.length - 1), low = Math.min(Math.floor(at), value_stops.length - 2);
  return value_stops[low].map((c, k) => 0.25 + 0.75 * (c + (at - low) * (value_stops[low + 1][k] - c)));
}

// ---- the rays of a strand ----
let asked = 0, asked_what = "";
export function pick_strand(found) {
  if (!found) { notice("There is no strand."); return; }
  strand = {part: world.strands.parts.indexOf(found.part), vertex: found.vertex, selection: world.strands.selection};
  asked_what = "";
  ask_for_rays();
}
export function forget_strand() {
  if (!strand) return false;
  strand = null;
  rays.hide();
  return true;
}
// While it plays the rays go away: those of each frame would cost as much as the frame.
function ask_for_rays() {
  if (!strand) return;
  if (player.playing || !handles.visible() || strand.selection !== world.strands.selection) { rays.hide(); asked_what = ""; return; }
  const what = JSON.stringify([strand, world.frame, state.scene.revision]);
  if (what === asked_what || world.frame === null) return;
  asked_what = what;
  send({type: "rays", seq: ++asked, frame: world.frame, ...strand});
}
function show_rays(message) {
  if (message.seq !== asked || !strand) return;
  const points = [], colors = [];
  for (const [from, to, shelter] of message.rays) {
    points.push(...from, ...to);
    const color = ray_colors.free.map((free, k) => free + shelter * (ray_colors.sheltered[k] - free));
    colors.push(...color, ...color);
  }
  for (let k = 0; k + 1 < message.rest.length; ++k) { points.push(...message.rest[k], ...message.rest[k + 1]); colors.push(...ray_colors.rest, ...ray_colors.rest); }
  rays.show(points, colors);
  const hits = message.rays.filter(ray => ray[2] > 0).length;
  notice(message.rays.length ? `Shelter ${Number(message.shelter.toFixed(2))}: ${hits} of ${message.rays.length} rays upwind meet a mesh.`
    : "Its wind has no shelter: give wind.shielding.shield.");
}

export function start_air() {
  arrows = new Lines();
  rays = new Lines();
  const saved = remembered("plane", null);
  page_shapes.push({
    handles: () => plane.shown ? [{key: plane_key, kind: "plane", name: "plane", shape: "image", on_page: true, pose: plane.pose}] : [],
    moved(key, pose) { plane.pose = pose; keep(); ask_again(); },
    remove: () => show_plane(false),
  });
  world.air = asked_for;
  byId("show_plane").onclick = toggle_plane;
  byId("show_rays").onclick = () => arm("rays");
  on("shown", (header, payload) => { show_arrows(header, payload); ask_for_rays(); });
  on("rays", show_rays);
  on("play", ask_for_rays);
  on("strands", () => { forget_strand(); });
  on("handles", () => { ask_again(); ask_for_rays(); });
  on("scene", scene => {
    if (saved && saved.file === scene.file && !plane.pose) {
      plane.pose = saved.pose;
      if (saved.shown) show_plane(true);
    }
  });
}
