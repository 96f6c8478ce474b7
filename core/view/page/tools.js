// SPDX-License-Identifier: Apache-2.0
// Tools for one drag or click over the view or the picture: the part that is traced, what the camera focuses on.
import {state, on, byId, clamp, notice} from "./state.js";
import {picture, set_crop, set_mode} from "./render.js";
import {set_value} from "./edits.js";
import {number_text} from "./toml.js";
import {pick} from "./pick.js";
import {pick_strand} from "./air.js";

const least_part = 4;   // pixels: less was a click
const buttons = {crop: "crop", rays: "show_rays", focus: "focus"};
let armed = null, drag = null;
export const tools = {armed: () => armed};

// The view or the picture beside it, where an event is; and its place there.
function box_of(event) {
  const boxes = [byId("picture"), byId("live")].filter(element => !element.hidden).map(element => element.getBoundingClientRect());
  return boxes.find(box => event.clientX >= box.left && event.clientX <= box.right) || boxes[0];
}

// The place of the view that is under a place of the view or, with its camera, of the picture.
function place_in_view(from, to, box) {
  const live = byId("live").getBoundingClientRect();
  return [live.left + (to.clientX - box.left) / box.width * live.width, live.top + (to.clientY - box.top) / box.height * live.height];
}

const kinds = {
  crop: {
    hint: "Drag a rectangle: only that part of the picture is traced.",
    move(from, to, box) {
      const at = (event, side) => side ? clamp((event.clientY - box.top) / box.height, 0, 1) : clamp((event.clientX - box.left) / box.width, 0, 1);
      const sides = [0, 1].map(side => [at(from, side), at(to, side)].sort((a, b) => a - b));
      const large = sides[0][1] - sides[0][0] > least_part / box.width && sides[1][1] - sides[1][0] > least_part / box.height;
      return large ? [sides[0][0], sides[1][0], sides[0][1], sides[1][1]] : null;
    },
    end(part) { if (part) set_crop(part); },
  },
  rays: {
    hint: "Click a strand: the rays by which it finds shelter.",
    move: place_in_view,
    end(at) { pick_strand(pick(...at)?.strand); },
  },
  focus: {
    hint: "Click what is to be sharp.",
    move: place_in_view,
    end(at) {
      const found = pick(...at);
      if (!found) { notice("There is only sky: click a strand or a mesh."); return; }
      const param = name => state.scene.groups.flatMap(group => group.params).find(one => one.key === `camera.${name}`);
      if (param("focus").keyed) { notice("camera.focus has keys: change them in the panel."); return; }
      const text = number_text(Number(found.depth.toPrecision(4)));
      set_value("camera.focus", text);
      const lens = param("lens_radius");
      notice(lens.keyed || Number(lens.value) > 0 ? `Sharp at ${text} m.` : `Sharp at ${text} m, but camera.lens_radius is 0, so all is: give it a few millimetres.`);
    },
  },
};

export function arm(name) {
  if (!state.scene) return;
  armed = armed === name ? null : name;
  drag = null;
  byId("tool_layer").hidden = !armed;
  for (const kind of Object.keys(kinds)) byId(buttons[kind]).setAttribute("aria-pressed", armed === kind || kind === "crop" && !!picture.crop);
  show_part(picture.crop);
  notice(armed ? kinds[armed].hint + " Escape: not." : "", !!armed, true);
}
// A part is taken back by the same key.
export function toggle_crop() {
  if (armed === "crop" || !picture.crop) {
    if (picture.mode === "off") set_mode("over");
    arm("crop");
  } else set_crop(null);
}
export const toggle_focus = () => arm("focus");
export function disarm() {
  if (!armed) return false;
  arm(armed);
  return true;
}

function show_part(part) {
  const frame = byId("crop_frame");
  frame.hidden = !part;
  if (!part) return;
  const [left, top, right, bottom] = part.map(share => 100 * share);
  Object.assign(frame.style, {left: `${left}%`, top: `${top}%`, width: `${right - left}%`, height: `${bottom - top}%`});
}

export function start_tools() {
  const layer = byId("tool_layer");
  layer.addEventListener("pointerdown", event => {
    if (event.button !== 0) return;
    event.preventDefault();   // no text is selected
    drag = {from: event, box: box_of(event)};
    layer.setPointerCapture(event.pointerId);
  });
  layer.addEventListener("pointermove", event => {
    if (drag && armed === "crop") show_part(kinds.crop.move(drag.from, event, drag.box));
  });
  layer.addEventListener("pointerup", event => {
    if (!drag) return;
    const kind = kinds[armed], found = kind.move(drag.from, event, drag.box);
    disarm();
    kind.end(found);
  });
  layer.addEventListener("pointercancel", disarm);
  byId("crop").onclick = toggle_crop;
  byId("focus").onclick = toggle_focus;
  on("crop", () => { byId("crop").setAttribute("aria-pressed", !!picture.crop); show_part(picture.crop); });
  on("picture", mode => { if (mode === "off" && armed === "crop" || mode === "over" && armed === "rays") disarm(); });
}
