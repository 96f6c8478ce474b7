// SPDX-License-Identifier: Apache-2.0
// Time: playing, stepping, the scrub bar; the requests for frames; how many strands are asked for.
import {state, on, emit, byId, clamp, grouped, remembered, remember, make} from "./state.js";
import {send} from "./net.js";
import {world, show_frame} from "./world.js";
import {Budget} from "./budget.js";

const max_unanswered = 2, lost_after = 30000;   // ms until an answer counts as lost
const speeds = [["every", "every frame"], ["0.1", "0.1 ×"], ["0.25", "0.25 ×"], ["0.5", "0.5 ×"], ["1", "real time"], ["2", "2 ×"], ["4", "4 ×"]];
const budgets = [2000, 5000, 10000, 20000, 50000, 100000, 200000];

const saved = remembered("player", {});
export const player = {
  time: saved.time ?? null, playing: false, loop: saved.loop ?? true, speed: saved.speed ?? "1",
  shown: null,        // header of the frame on the screen
  frames: 0,          // frames shown since the page was opened
  wanted: true,       // something changed: ask even if the time has not
  max_revision: 0,
  marks: [],          // frames of keys that the time bar shows
  covered: false,     // what is played is not seen: no frames are asked for
};
let seq = 0, unanswered = new Map(), last_asked = null, last_tick = 0, chain = null, line = null, next_every = null;
let newest_shown = 0, dragging = false;
const budget = new Budget();

export const frames_of = () => state.scene ? state.scene.frames : [1, 1];
export const shown_strands = () => world.strands ? world.strands.shown : 0;
const keep = () => remember("player", {time: player.time, loop: player.loop, speed: player.speed, rate: budget.rate, full: budget.full});

export function set_time(time, whole = true) {
  const [first, last] = frames_of();
  player.time = clamp(whole ? Math.round(time) : time, first, last);
  next_every = null;
  keep();
  show_time();
}

export function play(playing = !player.playing) {
  if (player.playing === playing) return;
  const [first, last] = frames_of();
  player.playing = playing;
  if (playing && player.time >= last) player.time = first;
  next_every = null;
  if (!playing) set_time(player.shown && player.speed === "every" ? player.shown.frame : player.time);
  budget.restart();
  byId("play").setAttribute("aria-pressed", playing);
  byId("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  emit("play", playing);
}

export function step(by) {
  play(false);
  const [first, last] = frames_of(), count = last - first + 1;
  let time = Math.round(player.time) + by;
  if (player.loop) time = first + ((time - first) % count + count) % count;
  set_time(time);
}

// Something moves, and the strands shown should keep up: playing, a slider that is dragged.
export const touch = () => budget.touch(performance.now());
export function ask_again() { player.wanted = true; }

const wanted_strands = now => budget.strands(now, player.playing || dragging, player.frames === 0);

function ask(time, now) {
  const strands = wanted_strands(now), at_rest = !budget.moving;
  const small = world.strands.vertices() < 400000;
  const message = {type: "frame", seq: ++seq, frame: Number(time.toFixed(4)), budget: strands, encoding: at_rest && small ? "f32" : "u16"};
  if (world.values?.name) message.values = world.values.name;
  message.gusts = !world.shows_gusts || world.shows_gusts();
  const air = world.air?.();
  if (air) message.air = air;
  if (!send(message)) return;
  unanswered.set(seq, {sent: now, revision: player.max_revision});
  last_asked = {time: message.frame, budget: strands, encoding: message.encoding};
  player.wanted = false;
}
// Nothing is to be asked for, and all that was asked has come.
player.idle = () => !unanswered.size && !player.wanted && !player.playing && last_asked !== null &&
  last_asked.time === Number(player.time.toFixed(4)) && !budget.moving && last_asked.budget === budget.full;
player.unanswered = () => unanswered.size;
export const last_seq = () => seq;

// Once for each picture of the screen: moves the clock and asks for what it says.
export function tick(now) {
  const passed = Math.min(now - last_tick, 500);
  last_tick = now;
  if (!state.scene || document.hidden || !state.connected) return;
  const [first, last] = frames_of();
  if (player.covered) next_every = null;
  if (player.playing && (player.speed !== "every" || player.covered)) {
    const count = last - first + 1;
    let time = player.time + passed / 1000 * (state.scene.fps || 24) * (Number(player.speed) || 1);
    if (time > last + 1 || (!player.loop && time > last)) {
      if (!player.loop) { player.time = last; play(false); return; }
      time = first + (time - first) % count;
    }
    player.time = time;
    show_time();
  }
  for (const [number, request] of unanswered) if (now - request.sent > lost_after) unanswered.delete(number);
  while (unanswered.size < max_unanswered && !player.covered) {
    let time = clamp(player.time, first, last);
    const every = player.playing && player.speed === "every";
    if (every) {
      time = next_every ?? Math.round(time);
      next_every = time + 1 > last ? (player.loop ? first : null) : time + 1;
    }
    const strands = wanted_strands(now);
    const same = last_asked && last_asked.time === Number(time.toFixed(4)) && last_asked.budget === strands;
    const single = first === last && every;   // a scene of one frame
    if (same && !player.wanted && !single) break;
    ask(time, now);
    if (every && next_every === null) { play(false); set_time(last); break; }
    if (!every) break;
  }
  budget.measure(now, player.playing);
}

on("open", () => { unanswered.clear(); last_asked = null; player.wanted = true; next_every = null; newest_shown = seq; });
on("closed", () => { unanswered.clear(); show_status(); });
on("scene", scene => {
  player.wanted = true;
  player.max_revision = scene.revision;
  const [first, last] = scene.frames;
  if (player.time === null) player.time = first;
  player.time = clamp(player.time, first, Math.max(last + 1, first));
  byId("transport").classList.toggle("single", first === last);
  show_time(true);
});
on("skipped", message => { unanswered.delete(message.seq); });
on("frame", (header, payload) => {
  const request = unanswered.get(header.seq), now = performance.now();
  unanswered.delete(header.seq);
  emit("answered", header);
  if (header.seq < newest_shown) return;
  if (!show_frame(header, payload)) { player.wanted = true; return; }
  newest_shown = header.seq;
  player.shown = header;
  ++player.frames;
  const smooth = (old, value) => old === null ? value : old + 0.2 * (value - old);
  chain = smooth(chain, header.chain_ms);
  if (request) line = smooth(line, Math.max(0, now - request.sent - header.chain_ms));
  if (player.frames > 1) budget.answered(world.strands.shown, header.chain_ms + (header.other_ms || 0));
  if (player.playing && player.speed === "every") { player.time = header.frame; show_time(); }
  emit("shown", header, payload);
});

// The rate of drawn frames, as told by the drawing loop.
export function drawn(now) { budget.drawn(now, player.frames); }

export function show_status() {
  if (!state.scene || !player.shown) return;
  const parts = [`${grouped(world.strands.shown)} of ${grouped(world.strands.total)} strands`];
  if (player.playing && !player.covered) parts.push(`${budget.rate_now()} frames/s`);
  if (chain !== null) parts.push(`chain ${ms(chain)}`);
  if (line !== null) parts.push(`line ${ms(line)}`);
  byId("status").textContent = byId("status").title = state.connected ? parts.join(", ") : "not connected";
}
const ms = value => value < 9.95 ? `${Number(value.toFixed(1))} ms` : value < 2000 ? `${Math.round(value)} ms` : `${(value / 1000).toFixed(1)} s`;

// ---- the scrub bar ----
let scrub_drawn = "";
export function show_marks(frames) {
  const [first, last] = frames_of();
  player.marks = frames.filter(frame => frame >= first && frame <= last);
  show_time();
}
function show_time(force = false) {   // also the field
  const field = byId("frame"), [first, last] = frames_of(), time = clamp(player.time ?? first, first, last);
  const text = player.playing ? String(Math.round(time)) : String(Number(time.toFixed(3)));
  if (document.activeElement !== field || player.playing) field.value = text;
  const scrub = byId("scrub"), ratio = window.devicePixelRatio, width = scrub.clientWidth, height = scrub.clientHeight;
  const key = [width, height, ratio, first, last, time.toFixed(2), player.marks].join();
  if (key === scrub_drawn && !force) return;
  scrub_drawn = key;
  const wanted = [width * ratio, height * ratio].map(Math.floor);
  if (scrub.width !== wanted[0] || scrub.height !== wanted[1]) [scrub.width, scrub.height] = wanted;   // which clears it, at a cost
  for (const [name, value] of [["valuemin", first], ["valuemax", last], ["valuenow", text]]) scrub.setAttribute("aria-" + name, value);
  const context = scrub.getContext("2d", {willReadFrequently: state.software}),   // not by software GL
    rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.font = `${0.85 * rem}px system-ui, sans-serif`;
  context.textAlign = "center";
  const x = frame => margin(rem) + (last > first ? (frame - first) / (last - first) : 0.5) * (width - 2 * margin(rem));
  context.fillStyle = "#121416";
  context.fillRect(0, 0, width, height);
  const each = (width - 2 * margin(rem)) / Math.max(1, last - first), wide = 3.6 * rem;
  const label = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find(n => n * each >= wide) || 10000;
  const tick_every = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(n => n * each >= 4) || label;
  for (let frame = Math.ceil(first / tick_every) * tick_every; frame <= last; frame += tick_every) {
    const major = frame % label === 0 || frame === first && label > 1;
    context.fillStyle = major ? "#8b939d" : "#3d434b";
    context.fillRect(Math.round(x(frame)) - 0.5, height - (major ? 0.55 : 0.35) * rem, 1, (major ? 0.55 : 0.35) * rem);
    if (frame % label === 0 && Math.abs(x(frame) - x(time)) > 2.2 * rem) {
      context.fillStyle = "#9aa3ad";
      context.fillText(frame, x(frame), height - 0.95 * rem);
    }
  }
  for (const frame of player.marks) {   // a diamond
    const size = 0.32 * rem, y = height - 0.35 * rem;
    context.fillStyle = "#ffd75e";
    context.beginPath();
    for (const [a, b] of [[0, -1], [1, 0], [0, 1], [-1, 0]]) context.lineTo(x(frame) + a * size, y + b * size);
    context.fill();
  }
  context.fillStyle = "#a5a8f0";
  context.fillRect(x(time) - 1, 0, 2, height);
  const words = String(Math.round(time)), half = Math.max(1.1 * rem, context.measureText(words).width / 2 + 0.4 * rem);
  const middle = clamp(x(time), half, width - half);
  context.beginPath();
  context.roundRect(middle - half, 0, 2 * half, 1.25 * rem, 0.25 * rem);
  context.fill();
  context.fillStyle = "#17191c";
  context.fillText(words, middle, 0.93 * rem);
}
const margin = rem => 1.1 * rem;

function scrub_to(event) {
  const box = byId("scrub").getBoundingClientRect(), [first, last] = frames_of();
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const share = (event.clientX - box.left - margin(rem)) / (box.width - 2 * margin(rem));
  set_time(first + share * (last - first), !event.shiftKey);
  touch();
}

export function start_player() {
  const scrub = byId("scrub");
  scrub.addEventListener("pointerdown", event => {
    if (event.button !== 0) return;
    play(false);
    scrub.setPointerCapture(event.pointerId);
    dragging = true;
    scrub_to(event);
  });
  scrub.addEventListener("pointermove", event => { if (dragging) scrub_to(event); });
  for (const end of ["pointerup", "pointercancel"]) scrub.addEventListener(end, () => { dragging = false; });
  byId("frame").addEventListener("change", event => {
    const time = Number(event.target.value.replace(",", "."));
    if (Number.isFinite(time) && event.target.value.trim()) { play(false); set_time(time, false); }
    show_time(true);
    event.target.blur();
  });
  byId("play").onclick = () => play();
  byId("back").onclick = () => step(-1);
  byId("forward").onclick = () => step(1);
  byId("home").onclick = () => { play(false); set_time(frames_of()[0]); };
  byId("end").onclick = () => { play(false); set_time(frames_of()[1]); };
  const loop = () => byId("loop").setAttribute("aria-pressed", player.loop);
  byId("loop").onclick = () => { player.loop = !player.loop; loop(); keep(); };
  loop();
  byId("speed").append(...speeds.map(([value, text]) => make("option", {value}, text)));
  byId("speed").value = player.speed;
  byId("speed").onchange = event => { player.speed = event.target.value; next_every = null; budget.restart(); keep(); };
  budget.rate = saved.rate ?? 12;
  budget.full = saved.full ?? (state.software ? 50000 : 200000);
  byId("rate").value = String(budget.rate);
  byId("rate").onchange = event => { budget.rate = Number(event.target.value); budget.restart(); keep(); };
  byId("budget").append(...budgets.map(value => make("option", {value}, grouped(value))));
  byId("budget").value = String(budget.full);
  byId("budget").onchange = event => { budget.full = Number(event.target.value); budget.restart(); keep(); };
  new ResizeObserver(() => show_time(true)).observe(scrub);
  document.addEventListener("visibilitychange", () => { budget.restart(); if (!document.hidden) { player.wanted = true; world.dirty = true; } });
  setInterval(show_status, 250);
  player.budget = budget;
}
