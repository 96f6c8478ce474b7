// SPDX-License-Identifier: Apache-2.0
// Colours by an attribute of strands and meshes (the share of the wind, gusts, shelter, contacts, sand): which one, the range of its
// colours, and the legend. shaders.js has the colours.
import {state, on, byId, make, remembered, remember} from "./state.js";
import {ask_again} from "./player.js";
import {world} from "./world.js";
import {value_stops, class_colors} from "./shaders.js";

// The range only grows while nothing but the frame changes, so that colours keep their meaning.
export const values = {name: remembered("values", ""), lower: 0, upper: 0, known: false, classes: false};
const css = color => `rgb(${color.map(c => Math.round(255 * c)).join()})`;
const patch = (background, wide) => {   // the page's policy forbids styles in attributes
  const element = make("i", wide ? {class: "wide"} : {});
  element.style.background = background;
  return element;
};
const class_names = {contact: ["free", "met a mesh", "no room"]};

function forget_range() { Object.assign(values, {lower: 0, upper: 0, known: false}); }
export function show_values(name) {
  values.name = name;
  forget_range();
  remember("values", name);
  byId("values").value = name;
  show_legend();
  ask_again();
}

export function next_value(by = 1) {
  const names = ["", ...(state.scene?.values || []).map(v => v.name)];
  show_values(names[(names.indexOf(values.name) + by + names.length) % names.length]);
}

const short = x => String(Number(x.toPrecision(3)));
function show_legend() {
  const known = (state.scene?.values || []).find(v => v.name === values.name), legend = byId("legend");
  legend.hidden = !known;
  if (!known) return;
  values.classes = known.discrete;
  const parts = [make("b", {}, values.name)];
  if (known.discrete) {
    for (const [i, color] of class_colors.entries())
      parts.push(patch(css(color)), make("span", {}, (class_names[values.name] || [])[i] ?? String(i)));
  } else if (values.upper > values.lower) {
    const stops = value_stops.map((color, i) => `${css(color)} ${100 * i / (value_stops.length - 1)}%`);
    parts.push(make("span", {}, short(values.lower)), patch(`linear-gradient(90deg,${stops.join()})`, true),
      make("span", {}, short(values.upper)));
  } else parts.push(make("span", {}, !values.known ? "..." : values.upper ? `everywhere ${short(values.upper)}` : "0 everywhere"));
  legend.replaceChildren(...parts);
  legend.title = known.help;
}

// Of a frame that is shown.
export function take_range(range) {
  if (!range || range.name !== values.name) return;
  const lower = Math.min(values.lower, range.lower), upper = Math.max(values.upper, range.upper);
  if (lower === values.lower && upper === values.upper && values.known) return;
  Object.assign(values, {lower, upper, known: true});
  show_legend();
}

export function start_values() {
  let revision = null;
  byId("values").onchange = event => show_values(event.target.value);
  on("scene", scene => {
    const names = scene.values.map(v => v.name), select = byId("values");
    select.parentElement.hidden = !names.length;
    select.replaceChildren(make("option", {value: ""}, "material"), ...scene.values.map(v => make("option", {value: v.name, title: v.help}, v.name)));
    if (!names.includes(values.name)) values.name = "";
    select.value = values.name;
    if (scene.revision !== revision) forget_range();
    revision = scene.revision;
    show_legend();
  });
  world.values = values;
}
