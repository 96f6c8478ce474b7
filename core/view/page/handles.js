// SPDX-License-Identifier: Apache-2.0
// Gusts, fields and curves as shapes in the view that can be selected, moved, turned, scaled, keyed, added and deleted.
import {state, on, emit, byId, make, notice, remembered, remember} from "./state.js";
import {world} from "./world.js";
import {player, play, set_time, show_marks} from "./player.js";
import {set_value} from "./edits.js";
import {picture} from "./render.js";
import {reveal} from "./panel.js";
import {parse_value, number_text} from "./toml.js";
import {keys_of, pose_at, with_key, without_key, nearest_turn, transform_text, triples, points_text, elements_of, list_of_tables_text,
  sphere_element} from "./handle_values.js";
import {HandleView, Drifting, drawn_shapes, pick} from "./handle_shapes.js";

const THREE = window.THREE;
const least_pause = 1000 / 15, answer_ms = 10000;   // between values sent; until an answer counts as lost
const click_reach = 4, arm_pixels = 78, doubling_pixels = 110;   // arm: of the gizmo; doubling: of the pointer for twice the size
const new_share = 0.15;   // radius of a new gust in distances of the camera
const gust_list = "wind.gusts.control";
const soft_colors = {ff0000: 0xff6464, "00ff00": 0x8fe05a, "0000ff": 0x6aa6ff};

export const overlay = new THREE.Scene();
const knob = new THREE.Object3D();   // knob: at the selected point of a curve
let gizmo = null, drifting = null, drawing = false;
let views = new Map(), selected = null, hovered = null;   // {view, point}
let press = null, drag = null, wanted = null;             // wanted: key of a handle that is selected when it comes
const marks = new Map();        // key of a handle -> frame of its only key, which K made
const sender = {next: null, open: 0, last: -Infinity, timer: 0, lost: 0};
let shown = remembered("show", {gusts: true}).gusts;

const live = () => byId("live");
const visible = () => shown && picture.mode !== "over";
const present = () => Math.round(player.time ?? 1);
const shown_frame = () => world.frame ?? player.time ?? 1;
export const redraw = () => { if (!drawing) world.dirty = true; };
const all_params = () => state.scene ? state.scene.groups.flatMap(group => group.params) : [];
const has_wind = () => all_params().some(param => param.key === "wind.speed");

// Shapes that are no part of the scene: {handles(): list of handles with on_page and a pose, moved(key, pose), remove(key)}.
export const page_shapes = [];
const owner_of = handle => page_shapes.find(owner => owner.handles().some(one => one.key === handle.key));
export const reload_shapes = () => sync();
export const select_shape = key => select(views.get(key));

// For tests and the console.
export const handles = {
  selected: () => selected && {key: selected.view.handle.key, point: selected.point},
  views: () => views, visible, gizmo: () => gizmo, drifting: () => drifting, dragging: () => !!drag,
  // The place of a point of the world in the page.
  on_screen(point) {
    const box = live().getBoundingClientRect(), place = new THREE.Vector3(...point).project(world.camera);
    return [box.left + (place.x + 1) / 2 * box.width, box.top + (1 - place.y) / 2 * box.height];
  },
};

// ---- values ----
function animated(view) { return view.keys.length > 1 || view.keyed_text || marks.get(view.handle.key) === view.keys[0].frame; }
const text_of = view => view.points ? points_text(view.points) : transform_text(view.keys, view.interpolation, animated(view));

function take(view, handle) {
  view.handle = handle;
  if (handle.kind === "points") { view.points = [...handle.points]; return; }
  if (handle.on_page) { view.keys = [{frame: 0, ...handle.pose}]; return; }
  view.keys = keys_of(handle.keys);
  view.interpolation = handle.interpolation || "linear";
  const param = all_params().find(one => one.key === handle.key), value = param && parse_value(param.value);
  view.keyed_text = !!(value && value.keys);
}

function sync() {
  const from = (state.scene.handles || []).filter(handle => handle.kind === "points" || drawn_shapes.has(handle.shape));
  from.push(...page_shapes.flatMap(owner => owner.handles()));
  const keys = new Set(from.map(handle => handle.key));
  for (const [key, view] of views) if (!keys.has(key)) { view.dispose(); views.delete(key); }
  for (const handle of from) {
    let view = views.get(handle.key);
    const form = JSON.stringify([handle.kind, handle.shape, handle.inner]);
    if (!view) views.set(handle.key, view = new HandleView(handle, overlay));
    else if (view.held) continue;
    else if (view.form !== form) { view.handle = handle; view.rebuild(); }
    else if (view.points && JSON.stringify(view.points) !== JSON.stringify(handle.points)) view.set_points(handle.points);
    view.form = form;
    take(view, handle);
  }
  if (wanted && views.has(wanted)) { select(views.get(wanted)); reveal(wanted); wanted = null; }
  if (selected && views.get(selected.view.handle.key) !== selected.view) select(null);
  if (selected && selected.point >= (selected.view.points || []).length / 3) select(null);
  if (hovered && views.get(hovered.view.handle.key) !== hovered.view) hovered = null;
  pose_all();
}

function pose_all() {
  const frame = shown_frame();
  for (const view of views.values()) if (!view.points && !(drag && drag.view === view)) view.place(pose_at(view.keys, frame, view.interpolation));
  if (selected && selected.point >= 0 && !drag) knob.position.set(...triples(selected.view.points)[selected.point]);
  paint();
}
function paint() {
  for (const view of views.values())
    view.paint(selected && selected.view === view ? "selected" : hovered && hovered.view === view ? "hovered" : "");
  show_line();
  show_marks(selected && selected.view.keys && animated(selected.view) ? selected.view.keys.map(key => key.frame) : []);
  redraw();
}

// ---- sending: not faster than the program answers; the last value always ----
function push(key, text) {
  sender.next = {key, text};
  pump();
}
function pump(now = performance.now(), last = false) {
  clearTimeout(sender.timer);
  if (!sender.next || sender.open && !last) return;
  const pause = sender.last + least_pause - now;
  if (pause > 0 && !last) { sender.timer = setTimeout(pump, pause); return; }
  const {key, text} = sender.next;
  Object.assign(sender, {next: null, open: sender.open + 1, last: now});
  clearTimeout(sender.lost);
  sender.lost = setTimeout(() => { answered(true); sync(); }, answer_ms);
  set_value(key, text);
}
function answered(all = false) {
  sent_list = null;
  sender.open = all ? 0 : Math.max(0, sender.open - 1);
  const held = [...views.values()].filter(view => view.held), done = held.filter(is_in_scene);
  if (done.length && !sender.next) sender.open = 0;   // values that waited together were answered by one scene
  if (!sender.open) clearTimeout(sender.lost);
  pump();
  for (const view of held)
    if (!(drag && drag.view === view) && (done.includes(view) || !sender.next && !sender.open)) view.held = false;
}
function is_in_scene(view) {
  const scene = state.scene.handles?.find(handle => handle.key === view.handle.key);
  return scene && (view.points ? points_text(scene.points) : transform_text(keys_of(scene.keys), scene.interpolation, animated(view))) === text_of(view);
}
function put(view) {
  view.held = true;
  push(view.handle.key, text_of(view));
  pose_all();
}
const held_texts = () => new Map([...views.values()].filter(view => view.held).map(view => [view.handle.key, text_of(view)]));

// ---- selecting ----
function select(view, point = -1) {
  if (drag) end_drag(false);
  selected = view ? {view, point} : null;
  if (!gizmo) return;
  if (selected && (point >= 0 || !view.points)) {
    if (point >= 0) { knob.position.set(...triples(view.points)[point]); set_mode("translate"); }
    gizmo.attach(point >= 0 ? knob : view.object);
  } else gizmo.detach();
  paint();
}

function set_mode(mode) {
  if (!selected || selected.point >= 0 && mode !== "translate") return;
  gizmo.setMode(mode);
  gizmo.setSpace(mode === "translate" ? "world" : "local");
  show_line();
  redraw();
}

// Escape: whether there was something to leave.
export function leave_handles() {
  if (drag) { end_drag(true); return true; }
  if (!selected || !visible()) return false;
  select(null);
  return true;
}

// ---- the pointer ----
function pointer_of(event) {
  const box = live().getBoundingClientRect(), at = [event.clientX - box.left, event.clientY - box.top];
  return {x: 2 * at[0] / box.width - 1, y: 1 - 2 * at[1] / box.height, button: 0, at, width: box.width, height: box.height};
}
function update_matrices() {
  world.camera.updateMatrixWorld();
  overlay.updateMatrixWorld();
}
function under(pointer) {
  update_matrices();
  return pick([...views.values()], pointer.at, world.camera, pointer.width, pointer.height);
}
const in_view = event => event.target.id === "live" || event.target.id === "gl";

function on_down(event) {
  press = null;
  if (event.button !== 0 || drag || !visible() || !in_view(event)) return;
  const pointer = pointer_of(event);
  update_matrices();
  if (selected && gizmo.object) {
    gizmo.pointerHover(pointer);
    if (gizmo.axis) { begin_drag(event, pointer); return; }
  }
  if (views.size) press = {x: event.clientX, y: event.clientY, moved: false};
}
function begin_drag(event, pointer) {
  const {view, point} = selected;
  if (sent_list && view.handle.list === sent_list.list) return;   // its number may change
  if (!view.points && animated(view)) {   // the key of a whole frame is changed
    play(false);
    set_time(present());
    view.place(pose_at(view.keys, present(), view.interpolation));
    update_matrices();
  }
  drag = {view, point, id: event.pointerId, keys: view.keys, points: view.points, scale: view.object.scale.clone(), x: event.clientX, y: event.clientY,
    frame: present(), sent: false};
  world.controls.enabled = false;   // no orbit
  live().setPointerCapture(event.pointerId);
  gizmo.pointerDown(pointer);
}
function on_move(event) {
  if (drag) {
    if (event.pointerId !== drag.id) return;
    if (gizmo.mode === "scale" && /^XYZ/.test(gizmo.axis)) drag.view.object.scale.copy(drag.scale).multiplyScalar(times_of(event));
    else gizmo.pointerMove(pointer_of(event));
    dragged();
    return;
  }
  if (press && Math.hypot(event.clientX - press.x, event.clientY - press.y) >= click_reach) press.moved = true;
  if (event.buttons || !visible() || !in_view(event)) return;
  const pointer = pointer_of(event);
  update_matrices();
  if (selected && gizmo.object) gizmo.pointerHover(pointer);
  const over = gizmo.axis ? null : under(pointer);
  if ((over && over.view) !== (hovered && hovered.view)) { hovered = over; paint(); }
  live().style.cursor = over || gizmo.axis ? "pointer" : "";
}
// All sides alike: by the distance from the middle, or, of the handle in the middle, by the way of the pointer.
function times_of(event) {
  if (gizmo.axis === "XYZ") return 2 ** ((event.clientX - drag.x - event.clientY + drag.y) / doubling_pixels);
  const [x, y] = handles.on_screen(drag.view.object.position.toArray());
  return Math.hypot(event.clientX - x, event.clientY - y) / Math.max(10, Math.hypot(drag.x - x, drag.y - y));
}
function dragged() {
  const {view, point} = drag, object = view.object;
  if (point >= 0) {
    view.points = [...view.points];
    view.points.splice(3 * point, 3, ...knob.position.toArray());
    view.set_points(view.points);
  } else {
    for (const k of ["x", "y", "z"]) object.scale[k] = Math.max(1e-5, Math.abs(object.scale[k]));
    const before = pose_at(drag.keys, drag.frame, view.interpolation), turn = object.rotation;
    const angles = [turn.x, turn.y, turn.z].map(angle => angle * 180 / Math.PI);
    const pose = {translate: object.position.toArray(), rotate: nearest_turn(angles, before.rotate), scale: object.scale.toArray()};
    view.keys = animated(view) ? with_key(drag.keys, drag.frame, pose) : [{...pose, frame: drag.keys[0].frame}];
  }
  if (view.handle.on_page) { owner_of(view.handle).moved(view.handle.key, pose_of(view)); paint(); return; }
  drag.sent = view.held = true;
  push(view.handle.key, text_of(view));
  paint();
}
function on_up(event) {
  if (drag) { if (event.pointerId === drag.id) end_drag(event.type === "pointercancel"); return; }
  const click = press && !press.moved && event.type === "pointerup";
  press = null;
  if (!click) return;
  const found = under(pointer_of(event));
  select(found && found.view, found ? found.point : -1);
  if (found) reveal(found.view.handle.key);
}
const pose_of = ({keys: [{translate, rotate, scale}]}) => ({translate, rotate, scale});
function end_drag(back) {
  const {view, keys, points, sent, id} = drag;
  gizmo.pointerUp({button: 0});
  if (live().hasPointerCapture(id)) live().releasePointerCapture(id);
  drag = null;
  world.controls.enabled = true;
  if (back && view.handle.on_page) { view.keys = keys; owner_of(view.handle).moved(view.handle.key, pose_of(view)); }
  if (back && sent) {
    Object.assign(view, {keys, points});
    if (points) view.set_points(points);
    push(view.handle.key, text_of(view));
  }
  pump(performance.now(), true);
  pose_all();
}

// ---- keys, adding, deleting ----
function with_selection(act) {
  if (selected && visible() && !drag && selected.view.keys && !selected.view.handle.on_page) act(selected.view);
  else if (!drag) notice(has_wind() ? "Click a gust or a field first." : "The scene has no wind.");
}
const add_key = () => with_selection(view => {
  const frame = present(), pose = pose_at(view.keys, frame, view.interpolation);
  view.keys = animated(view) ? with_key(view.keys, frame, pose) : [{...pose, frame}];
  marks.set(view.handle.key, frame);
  put(view);
  notice(`Key at frame ${frame}. Go to another frame and drag for the next.`);
});
const remove_key = () => with_selection(view => {
  if (!has_key(view)) return;
  const rest = without_key(view.keys, present());
  marks.delete(view.handle.key);
  view.keyed_text = false;
  view.keys = rest.length ? rest : view.keys;
  put(view);
});
const has_key = view => animated(view) && view.keys.some(key => key.frame === present());

// A list that was sent, until it is answered: what is added meanwhile is added to it.
let sent_list = null;
const elements_now = list => sent_list && sent_list.list === list ? sent_list.elements : elements_of(state.scene.groups, list, held_texts());
function set_list(list, elements) {
  sent_list = {list, elements};
  for (const key of marks.keys()) if (key.startsWith(list + "[")) marks.delete(key);
  for (const view of views.values()) if (view.handle.list === list) view.held = false;
  sender.next = null;
  set_value(list, list_of_tables_text(elements));
}
export function add_gust() {
  if (!has_wind()) { notice("The scene has no wind."); return; }
  if (drag) return;
  show_gusts(true);
  const elements = [...elements_now(gust_list)], {target} = world.controls;
  elements.push(sphere_element(target.toArray(), Number((new_share * world.camera.position.distanceTo(target)).toPrecision(3))));
  wanted = `${gust_list}[${elements.length - 1}].transform`;
  set_list(gust_list, elements);
  const calm = all_params().find(param => param.key === "wind.calm");
  if (elements.length === 1 && calm && !calm.given) notice("With gusts the wind between them is calm, which is 0: give calm for more.");
}
const remove = () => {
  const handle = selected && visible() && !drag ? selected.view.handle : null;
  if (handle && handle.on_page) owner_of(handle).remove(handle.key);
  else if (handle && handle.kind === "points") remove_point();
  else remove_gust();
};
const remove_gust = () => with_selection(view => {
  const {list, index} = view.handle;
  if (sent_list) return;
  const elements = [...elements_now(list)];
  if (!(index < elements.length)) return;
  elements.splice(index, 1);
  select(null);
  set_list(list, elements);
});

// ---- points of a drawn curve ----
function with_point(act) {
  if (selected && visible() && !drag && selected.point >= 0) act(selected.view, triples(selected.view.points), selected.point);
  else if (!drag) notice("Click a point of a drawn curve first.");
}
function put_points(view, points, point) {
  select(null);
  view.points = points.flat();
  view.set_points(view.points);
  put(view);
  select(view, point);
}
// Half way to the next point or, after the last, as far again.
const add_point = () => with_point((view, points, point) => {
  const here = points[point], next = points[point + 1] || view.handle.closed && points[0], before = points[point - 1];
  const new_point = here.map((value, k) => next ? (value + next[k]) / 2 : 2 * value - before[k]);
  put_points(view, points.toSpliced(point + 1, 0, new_point), point + 1);
});
const remove_point = () => with_point((view, points, point) => {
  const least = view.handle.closed ? 3 : 2;
  if (points.length <= least) { notice(`A ${view.handle.closed ? "closed curve has three points" : "curve has two points"} at least.`); return; }
  put_points(view, points.toSpliced(point, 1), Math.min(point, points.length - 2));
});

function show_gusts(on) {
  if (shown === on) return;
  shown = on;
  remember("show", {...remembered("show", {}), gusts: shown});
  if (!shown) { select(null); hovered = null; live().style.cursor = ""; }
  byId("show_gusts").setAttribute("aria-pressed", shown);
  redraw();
  emit("handles");
}
const mode_key = mode => () => { if (selected && visible() && !drag) set_mode(mode); };
export const handle_keys = {
  w: () => show_gusts(!shown), g: add_gust, k: add_key, n: add_point, Delete: remove, x: remove,
  1: mode_key("translate"), 2: mode_key("rotate"), 3: mode_key("scale"), t: mode_key("translate"), e: mode_key("rotate"), s: mode_key("scale"),
};

// ---- the line about what is selected ----
let line = null, line_text = "";
const short = value => number_text(Number(value.toFixed(2)), 4).replace("-", "−");
function facts(view, point) {
  const {handle, object} = view;
  if (view.points) return [handle.key, point >= 0 ? `point ${point + 1}: ${triples(view.points)[point].map(short).join(", ")}` : ""];
  const size = object.scale.toArray().map(short), same = size.every(one => one === size[0]);
  const sizes = handle.shape === "sphere" ? (same ? `radius ${size[0]}` : `radii ${size.join(" × ")}`)
    : handle.shape === "grid" ? `scale ${same ? size[0] : size.join(" × ")}` : `half sides ${(handle.shape === "image" ? [size[0], size[2]] : size).join(" × ")}`;
  return [handle.on_page ? handle.name : `${handle.kind} ${handle.index + 1}`, `at ${object.position.toArray().map(short).join(", ")}`, sizes,
    animated(view) ? `${view.keys.length} key${view.keys.length > 1 ? "s" : ""}` : ""];
}
function show_line() {
  if (!line) return;
  const view = selected && visible() ? selected.view : null;
  line.box.hidden = !view;
  if (!view) return;
  const [name, ...rest] = facts(view, selected.point), text = [name, ...rest].join("\n");
  if (text !== line_text) {
    line_text = text;
    line.name.textContent = name;
    line.facts.replaceChildren(...rest.filter(Boolean).map(fact => make("span", {}, fact)));
  }
  for (const [mode, button] of Object.entries(line.modes)) button.setAttribute("aria-pressed", gizmo.mode === mode);
  for (const button of [...Object.values(line.modes), line.add, line.remove]) button.hidden = !!view.points;
  line.insert.hidden = !(selected.point >= 0);
  line.erase.hidden = !!view.points && line.insert.hidden;
  if (view.points) return;
  line.add.hidden = line.remove.hidden = !!view.handle.on_page;
  line.add.disabled = has_key(view);
  line.remove.disabled = !has_key(view);
}
function make_line() {
  const button = (text, title, onclick) => make("button", {title, onclick}, text);
  line = {box: byId("handle_line"), name: make("b"), facts: make("span", {class: "facts"}),
    modes: {translate: button("move", "Move (1 or T)", mode_key("translate")), rotate: button("turn", "Turn (2 or E)", mode_key("rotate")),
      scale: button("scale", "Scale (3 or S)", mode_key("scale"))},
    add: button("key", "A key at this frame (K)", add_key), remove: button("remove key", "Remove the key of this frame", remove_key),
    insert: button("add point", "A point behind this one (N)", add_point), erase: button("delete", "Delete (Delete or X)", remove)};
  line.box.replaceChildren(line.name, line.facts, make("span", {class: "joined"}, ...Object.values(line.modes)), line.add, line.remove, line.insert, line.erase);
}

// ---- drawing, beginning ----
function draw(camera, height) {
  if (!visible()) return;
  drawing = true;   // what changes below is drawn now
  gizmo.camera = camera;
  gizmo.size = 14 * arm_pixels * Math.tan(camera.fov * Math.PI / 360) / height;
  world.renderer.render(overlay, camera);
  drawing = false;
}

export function start_handles() {
  drifting = new Drifting(overlay);
  overlay.add(knob);
  // It is told of the pointer below, by the pointer's events; its element gets none.
  gizmo = new THREE.TransformControls(world.camera, document.createElement("div"));
  for (const [kind, size, opacity] of [["gizmo", 0.16, 0.7], ["picker", 0.22, 0]]) {   // a handle in the middle for all sides alike
    const middle = new THREE.Mesh(new THREE.BoxBufferGeometry(size, size, size),
      new THREE.MeshBasicMaterial({depthTest: false, depthWrite: false, transparent: true, opacity, side: THREE.DoubleSide}));
    middle.name = "XYZ";
    middle.renderOrder = Infinity;
    gizmo.children[0][kind].scale.add(middle);
  }
  gizmo.traverse(part => {
    const soft = part.material && part.material.color && soft_colors[part.material.color.getHexString()];
    if (soft) part.material.color.setHex(soft);
  });
  gizmo.addEventListener("change", redraw);
  overlay.add(gizmo);
  world.draw_overlay = draw;
  world.shows_gusts = visible;
  make_line();
  const element = live();
  element.addEventListener("pointerdown", on_down, true);
  element.addEventListener("pointermove", on_move);
  element.addEventListener("pointerleave", () => { if (hovered && !drag) { hovered = null; paint(); } });
  for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, on_up);
  // A hand that trembles in a click does not orbit.
  window.addEventListener("mousemove", event => { if (press && !press.moved && event.buttons) event.stopPropagation(); }, true);
  for (const type of ["pointerdown", "mousedown", "touchstart", "wheel"]) byId("over_view").addEventListener(type, event => event.stopPropagation());
  byId("show_gusts").setAttribute("aria-pressed", shown);
  byId("show_gusts").onclick = () => show_gusts(!shown);
  byId("add_gust").onclick = add_gust;
  on("scene", () => { answered(); sync(); for (const id of ["show_plane", "show_rays"]) byId(id).hidden = !has_wind(); byId("show_bar").hidden = !has_wind() && !views.size && !state.scene.values.length; });
  on("problems", message => {
    if (!message.problems.length) return;
    wanted = null;
    answered(!sender.next);
    if (state.scene && !drag) sync();
  });
  on("closed", () => {
    clearTimeout(sender.timer);
    clearTimeout(sender.lost);
    Object.assign(sender, {next: null, open: 0});
    if (drag) end_drag(false);
    for (const view of views.values()) view.held = false;
  });
  on("shown", header => { drifting.show(header.gusts || []); pose_all(); });
  on("picture", () => { show_line(); byId("over_view").classList.toggle("covered", picture.mode === "over"); redraw(); emit("handles"); });
}
