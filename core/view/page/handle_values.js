// SPDX-License-Identifier: Apache-2.0
// Values of the shapes in the view: poses of keyed transforms, and the texts of transforms, points and lists for scene files.
import {number_text} from "./toml.js";

const digits = 5, numbers_a_key = 10;

// A pose is {translate, rotate (degrees), scale}; a key is a pose with a frame.
export const identity = () => ({translate: [0, 0, 0], rotate: [0, 0, 0], scale: [1, 1, 1]});

// From the numbers of a "scene" message, ten a key.
export function keys_of(numbers) {
  const keys = [];
  for (let at = 0; at + numbers_a_key <= numbers.length; at += numbers_a_key) {
    const part = (from) => numbers.slice(at + from, at + from + 3);
    keys.push({frame: numbers[at], translate: part(1), rotate: part(4), scale: part(7)});
  }
  return keys.length ? keys : [{frame: 0, ...identity()}];
}

export function pose_at(keys, frame, interpolation = "linear") {
  const after = keys.findIndex(key => key.frame > frame);
  const a = keys[after < 0 ? keys.length - 1 : Math.max(0, after - 1)], b = after <= 0 ? a : keys[after];
  let t = a === b ? 0 : (frame - a.frame) / (b.frame - a.frame);
  if (interpolation === "smooth") t = t * t * (3 - 2 * t);
  const mix = name => a[name].map((value, k) => value + t * (b[name][k] - value));
  return {translate: mix("translate"), rotate: mix("rotate"), scale: mix("scale")};
}

// The keys with the pose at a frame, whose key is changed or made.
export function with_key(keys, frame, pose) {
  return [...keys.filter(key => key.frame !== frame), {...pose, frame}].sort((a, b) => a.frame - b.frame);
}
export const without_key = (keys, frame) => keys.filter(key => key.frame !== frame);

// The angles of the same turn that are the nearest to others, so that keys turn the short way. Order: Rz Ry Rx.
export function nearest_turn(angles, to) {
  const near = turn => turn.map((angle, k) => angle + 360 * Math.round((to[k] - angle) / 360));
  const far = turn => turn.reduce((sum, angle, k) => sum + Math.abs(angle - to[k]), 0);
  const one = near(angles), other = near([angles[0] + 180, 180 - angles[1], angles[2] + 180]);
  return far(other) < far(one) - 1e-6 ? other : one;
}

// What is tiny beside `size` is 0.
export const vector_text = (vector, size = Math.max(...vector.map(Math.abs))) =>
  `[${vector.map(value => number_text(Math.abs(value) < 1e-5 * size ? 0 : value, digits)).join(", ")}]`;

function pose_members(pose) {
  const members = [], size = Math.max(...pose.translate.map(Math.abs), ...pose.scale.map(Math.abs));
  const differs = (vector, from, by) => vector.some(value => Math.abs(value - from) > by);
  if (differs(pose.translate, 0, 1e-6 * size)) members.push(`translate = ${vector_text(pose.translate, size)}`);
  if (differs(pose.rotate, 0, 1e-4)) members.push(`rotate = ${vector_text(pose.rotate, 360)}`);
  if (differs(pose.scale, 1, 1e-6)) members.push(`scale = ${vector_text(pose.scale)}`);
  return members;
}

// keyed: as keys, also if there is only one.
export function transform_text(keys, interpolation = "linear", keyed = keys.length > 1) {
  if (!keyed) {
    const members = pose_members(keys[0]);
    return `{ ${members.length ? members.join(", ") : "translate = [0, 0, 0]"} }`;
  }
  const list = keys.map(key => `{ ${[`frame = ${number_text(key.frame)}`, ...pose_members(key)].join(", ")} }`);
  return `{ keys = [${list.join(", ")}]${interpolation === "linear" ? "" : `, interpolation = "${interpolation}"`} }`;
}

// points: flat, three numbers each.
export const triples = points => Array.from({length: Math.floor(points.length / 3)}, (_, i) => points.slice(3 * i, 3 * i + 3));
export const points_text = points => `[${triples(points).map(point => vector_text(point)).join(", ")}]`;

// The elements of a list of tables, each a Map of what is given by its name. `texts`: values by key that replace those of the scene.
export function elements_of(groups, list, texts = new Map()) {
  const elements = [], start = `${list}[`;
  for (const param of groups.flatMap(group => group.params)) {
    if (!param.key.startsWith(start)) continue;
    const end = param.key.indexOf("].", start.length), index = Number(param.key.slice(start.length, end));
    if (end < 0 || !Number.isInteger(index)) continue;
    while (elements.length <= index) elements.push(new Map());
    const text = texts.get(param.key) ?? (param.given ? param.value : "");
    if (text !== "") elements[index].set(param.key.slice(end + 2), text);
  }
  for (const [key, text] of texts) {   // of parameters that the scene does not list
    const found = key.startsWith(start) && /^(\d+)\]\.(.+)$/.exec(key.slice(start.length));
    if (found && elements[found[1]]) elements[found[1]].set(found[2], text);
  }
  return elements;
}
export const list_of_tables_text = elements =>
  `[${elements.map(element => element.size ? `{ ${[...element].map(([name, text]) => `${name} = ${text}`).join(", ")} }` : "{}").join(", ")}]`;

export const sphere_element = (center, radius) => new Map([["shape", '"sphere"'],
  ["transform", transform_text([{frame: 0, translate: center, rotate: [0, 0, 0], scale: [radius, radius, radius]}])]]);
