// SPDX-License-Identifier: Apache-2.0
// A dial that shows the wind from above as the camera sees it: up is away from the camera, N is -z. The arrow turns by dragging; with Shift
// its length sets the speed.
import {on, byId, clamp} from "./state.js";
import {world} from "./world.js";
import {set_value} from "./edits.js";
import {parse_value, number_text, list_text} from "./toml.js";
import {picture} from "./render.js";

const THREE = window.THREE;
const snap = 3 * Math.PI / 180;   // to steps of 15 degrees
const ring = 42, tip = 33, least_limit = 10;   // of a view box of 100; m/s
const ns = "http://www.w3.org/2000/svg";
let wind = null;     // {direction, speed} of the scene; null: nothing to show
let limit = 2 * least_limit, drag = false, parts = null;

const shape = (tag, attributes, ...children) => {
  const element = document.createElementNS(ns, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
};

export const compass = {wind: () => wind};   // for the console and for tests

// [to the right, up] in the dial of a horizontal direction, and back.
function axes() {
  world.camera.updateMatrixWorld();
  const e = world.camera.matrixWorld.elements, flat = Math.hypot(e[8], e[10]);
  const [x, z] = flat > 0.02 ? [-e[8] / flat, -e[10] / flat] : new THREE.Vector2(e[4], e[6]).normalize().toArray();   // or looking down: up
  return {up: [x, z], right: [-z, x]};
}
const dot = (a, b) => a[0] * b[0] + a[1] * b[1];

function read(scene) {
  const params = scene.groups.flatMap(group => group.params), find = key => params.find(param => param.key === key);
  const direction = find("wind.direction"), speed = find("wind.speed"), record = find("wind.record");
  if (!direction || !speed || direction.keyed || speed.keyed) return null;
  if (record && record.given && record.value !== "" && record.value !== "none") return null;
  const vector = parse_value(direction.value), value = parse_value(speed.value);
  const fine = Array.isArray(vector) && vector.length === 3 && vector.every(Number.isFinite) && Number.isFinite(value);
  return fine ? {direction: vector, speed: value} : null;
}

function show() {
  const element = byId("compass");
  element.toggleAttribute("hidden", !wind || picture.mode === "over");
  if (!wind || !parts) return;
  const {up, right} = axes(), flat = [wind.direction[0], wind.direction[2]], size = Math.hypot(...flat);
  const at = size > 0 ? [dot(flat, right) / size, dot(flat, up) / size] : [0, 0];
  const angle = Math.atan2(at[0], at[1]) * 180 / Math.PI, length = tip * Math.sqrt(clamp(wind.speed / limit, 0, 1));   // so that a breeze is seen
  const north = [dot([0, -1], right), dot([0, -1], up)];
  parts.north.setAttribute("x", 50 + 46 * north[0]);
  parts.north.setAttribute("y", 50 - 46 * north[1]);
  parts.ticks.setAttribute("transform", `rotate(${Math.atan2(north[0], north[1]) * 180 / Math.PI} 50 50)`);
  parts.arrow.setAttribute("transform", `rotate(${angle} 50 50)`);
  parts.arrow.setAttribute("visibility", size > 0 ? "visible" : "hidden");
  parts.shaft.setAttribute("y2", 50 - length + Math.min(4, length));
  parts.head.setAttribute("transform", `translate(50 ${50 - length}) scale(${clamp(length / 8, 0, 1)})`);
  parts.speed.textContent = `${number_text(wind.speed, 3)} m/s`;
  element.setAttribute("aria-label", `Wind ${parts.speed.textContent}`);
}

// The dial's point under the pointer, from its middle, up is positive.
function point_of(event) {
  const box = byId("compass").getBoundingClientRect();
  return [100 * (event.clientX - box.left) / box.width - 50, 50 - 100 * (event.clientY - box.top) / box.width];
}
function move(event) {
  const point = point_of(event), size = Math.hypot(...point);
  if (event.shiftKey) {
    wind.speed = Number((limit * clamp(size / tip, 0, 1) ** 2).toFixed(limit < 50 ? 1 : 0));
    set_value("wind.speed", number_text(wind.speed));
  } else if (size > 3) {
    const {up, right} = axes(), flat = Math.hypot(wind.direction[0], wind.direction[2]) || 1;
    const turn = Math.atan2(point[0] * right[1] + point[1] * up[1], point[0] * right[0] + point[1] * up[0]);
    const step = Math.PI / 12, round = Math.round(turn / step) * step, angle = Math.abs(turn - round) < snap && !event.altKey ? round : turn;
    const tidy = value => Number(value.toFixed(3)) || 0;
    wind.direction = [tidy(flat * Math.cos(angle)), wind.direction[1], tidy(flat * Math.sin(angle))];
    set_value("wind.direction", list_text(wind.direction));
  }
  show();
}

export function start_compass() {
  const element = byId("compass");
  parts = {
    ticks: shape("path", {class: "ticks", d: "M50 9v4M50 87v4M9 50h4M87 50h4"}),
    north: shape("text", {class: "north", "text-anchor": "middle", dy: 3}),
    shaft: shape("line", {x1: 50, y1: 50, x2: 50, y2: 50}), head: shape("path", {d: "M0 -1l6 10h-12z"}),
    speed: shape("text", {class: "speed", x: 50, y: 108, "text-anchor": "middle"}),
  };
  parts.north.textContent = "N";
  parts.arrow = shape("g", {class: "arrow"}, shape("path", {class: "mark", d: "M50 9.5l3.5 6h-7z"}), parts.shaft, parts.head);
  const title = shape("title", {});
  title.textContent = "The wind from above: it blows towards the arrow. Drag turns it, Alt: without steps; Shift drag sets its speed";
  element.append(title, shape("circle", {cx: 50, cy: 50, r: ring}), parts.ticks, parts.arrow, shape("circle", {class: "hub", cx: 50, cy: 50, r: 2}),
    parts.north, parts.speed);
  for (const type of ["pointerdown", "mousedown", "touchstart", "wheel"]) element.addEventListener(type, event => event.stopPropagation());
  element.addEventListener("pointerdown", event => {
    if (event.button !== 0 || !wind) return;
    drag = true;
    limit = 2 * Math.max(wind.speed, least_limit);
    element.setPointerCapture(event.pointerId);
    byId("live").focus({preventScroll: true});
    move(event);
  });
  element.addEventListener("pointermove", event => { if (drag) move(event); });
  for (const end of ["pointerup", "pointercancel"])
    element.addEventListener(end, () => { drag = false; });
  const take = scene => {
    if (drag) return;
    wind = read(scene);
    if (wind) limit = 2 * Math.max(wind.speed, least_limit);
    show();
  };
  on("scene", take);
  for (const type of ["camera", "picture"]) on(type, show);
  on("closed", () => { drag = false; });
}
