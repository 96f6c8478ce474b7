// SPDX-License-Identifier: Apache-2.0
// Begins the page: connects its parts, handles the keys, shows the help.
import {state, on, byId, make} from "./state.js";
import {connect} from "./net.js";
import {start_world, draw_world, go_home, frame_all, world} from "./world.js";
import {start_player, player, tick, drawn, play, step, set_time, frames_of, touch} from "./player.js";
import {start_panel, options_text} from "./panel.js";
import {command, edits} from "./edits.js";
import {start_values, next_value, take_range} from "./values.js";
import {start_render, toggle, toggle_beside, keep_a, drop_a, set_mode, picture, start_book, turn_leaf, flip_book} from "./render.js";
import {start_handles, handles, handle_keys, leave_handles} from "./handles.js";
import {start_tools, toggle_crop, toggle_focus, arm, disarm, tools} from "./tools.js";
import {start_air, toggle_plane, forget_strand, air} from "./air.js";
import {open_series, start_series, series} from "./series.js";
import {start_compass, compass} from "./compass.js";

const help = {
  "Time": [["space", "play, pause"], ["← →", "one frame back, on"], ["Shift ← →", "ten frames"], ["Home End", "first, last frame"], ["L", "loop"],
    ["drag the bar", "go to a frame; Shift: to parts of frames"]],
  "Camera": [["drag", "orbit"], ["right drag, Shift drag", "move sideways"], ["wheel, middle drag", "nearer, farther"], ["F", "frame all strands"],
    ["C", "the camera of the scene"]],
  "Colours": [["V", "by an attribute: share of the wind, gusts, shelter, contacts; again: the next, at last the materials"]],
  "Picture": [["R", "path-traced picture over the view"], ["P", "picture beside the view"], ["A", "keep the picture as A, compare with B"], ["Shift A", "drop A"],
    ["M", "trace a part alone: drag a rectangle; again: the whole"], ["D", "focus: click what is to be sharp"],
    ["B", "flip-book: all frames as pictures, then played"], ["Shift B", "frames as files in a folder"], ["Escape", "back to the live view"]],
  "Wind": [["W", "show or hide gusts and fields"], ["click", "select one; beside all: none"], ["1 2 3 or T E S", "move, turn, scale it"], ["K", "a key at this frame; then drag at another"],
    ["G", "new gust"], ["X or Delete", "delete"], ["N", "new point behind the selected one of a drawn curve"], ["Escape", "unselect, take a drag back"], ["Shift W", "arrows of the air on a plane, which is moved, turned, scaled like a gust"],
    ["I", "click a strand: the rays by which it finds shelter"], ["dial", "drag turns the wind; Shift: its speed"]],
  "Parameters": [["/", "search"], ["Ctrl Z", "undo"], ["Ctrl Shift Z", "redo"], ["Ctrl S", "write the changes to the scene file"],
    ["orange dot", "the value differs from the file; click: back to it"], ["drag a number", "change it; Shift: finer"], ["↑ ↓ in a number", "change it; Shift: ten times"],
    ["ramp", "drag knots; double click adds and removes; Delete removes"]],
  "Page": [["H or ?", "this help"]],
};

function show_help() {
  const dialog = byId("help");
  if (dialog.open) { dialog.close(); return; }
  const sections = Object.entries(help).map(([title, rows]) => make("section", {}, make("h3", {}, title), make("dl", {},
    ...rows.flatMap(([keys, what]) => [make("dt", {}, make("kbd", {}, keys)), make("dd", {}, what)]))));
  dialog.replaceChildren(make("h2", {}, "Keys"), make("div", {class: "columns"}, ...sections));
  dialog.showModal();
}

function first_frame() { play(false); set_time(frames_of()[0]); }
function last_frame() { play(false); set_time(frames_of()[1]); }
const keys = {
  " ": () => play(), Home: first_frame, End: last_frame, f: frame_all, c: go_home, r: toggle, p: toggle_beside, h: show_help, "?": show_help,
  v: event => next_value(event.shiftKey ? -1 : 1), b: event => event.shiftKey ? open_series() : start_book(), l: () => byId("loop").click(), "/": () => { byId("search").focus(); byId("search").select(); },
  a: event => event.shiftKey ? drop_a() : keep_a(),
  ArrowLeft: event => { touch(); step(event.shiftKey ? -10 : -1); }, ArrowRight: event => { touch(); step(event.shiftKey ? 10 : 1); },
  m: toggle_crop, d: toggle_focus, i: () => arm("rays"),
  Escape: () => { if (!disarm() && !leave_handles() && !forget_strand() && picture.mode !== "off") set_mode("off"); },
  ...handle_keys,
  w: event => event.shiftKey ? toggle_plane() : handle_keys.w(),
};

const is_text = element => element.matches("input:not([type=range],[type=checkbox],[type=color]),textarea");

function on_key(event) {
  const target = event.target, letter = event.key.length > 1 ? event.key : event.key.toLowerCase();
  if (event.ctrlKey || event.metaKey) {
    if (event.altKey) return;
    if (letter === "s") { event.preventDefault(); document.activeElement.blur(); command("save"); }
    // A text that is being written has its own undo.
    const writing = is_text(target) && target.id !== "frame" && !target.classList.contains("number");
    if (letter === "z" && !writing) { event.preventDefault(); command(event.shiftKey ? "redo" : "undo"); }
    if (letter === "y" && !writing) { event.preventDefault(); command("redo"); }
    return;
  }
  if (event.altKey || byId("series").open || byId("help").open && !["h", "?"].includes(letter)) return;
  if (is_text(target)) return;
  // Sliders, lists and buttons keep the keys that they use themselves.
  const own = target.matches("select") ? letter !== "Escape" : target.matches("input[type=range]") ? /^(Arrow|Home|End|Page)/.test(letter)
    : target.matches("button,summary,input[type=checkbox],input[type=color]") ? letter === " " || letter === "Enter" : false;
  if (own) return;
  const act = keys[letter];
  if (act) { event.preventDefault(); act(event); }
}

function loop(now) {
  requestAnimationFrame(loop);
  try {
    tick(now);
    turn_leaf();
    if (draw_world(now)) drawn(now);
  } catch (error) { console.error(error); }
}

function start() {
  document.addEventListener("keydown", on_key);
  byId("help_button").onclick = show_help;
  byId("help").addEventListener("click", event => { if (event.target === byId("help")) byId("help").close(); });
  // A button that was clicked gives the keyboard back to the view, so that space plays.
  document.addEventListener("click", event => {
    const button = event.target.closest("button");
    if (button && event.detail > 0 && !button.closest("dialog")) { button.blur(); byId("live").focus({preventScroll: true}); }
  });
  byId("live").addEventListener("pointerdown", () => byId("live").focus({preventScroll: true}));
  for (const select of document.querySelectorAll("#transport select,#render_bar select"))
    select.addEventListener("change", () => byId("live").focus({preventScroll: true}));
  on("progress", message => {
    byId("loading").hidden = !(message.fraction >= 0);
    byId("loading").classList.toggle("aside", player.frames > 0);
    byId("loading").firstElementChild.textContent = message.phase || "";
    byId("loading").lastElementChild.value = message.fraction;
  });
}

start();
if (start_world()) {
  start_player();
  start_panel();
  start_render();
  start_values();
  on("shown", header => take_range(header.values));
  start_handles();
  start_air();
  start_tools();
  start_series();
  start_compass();
  connect();
  requestAnimationFrame(loop);
}
window.marram = {state, on, world, player, picture, flip_book, edits, handles, compass, tools, series, air, options_text};   // for the console and for tests
