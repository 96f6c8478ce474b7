// SPDX-License-Identifier: Apache-2.0
// The path-traced picture of the live view's camera: over the view or beside it, refining, compared with a picture kept as A; and a
// flip-book of the scene's frames, which is played with the view's time.
import {state, on, emit, byId, clamp, make, remembered, remember, notice} from "./state.js";
import {send} from "./net.js";
import {world, camera_message, set_exposure} from "./world.js";
import {player, play, frames_of} from "./player.js";

const settle_ms = 150;                       // stillness before a picture is begun
const max_width = 960, first_share = 4, first_samples = 4;
const draft_strands = 40000;                 // of the first picture, which comes at once
export const max_book = 500e6;                      // bytes of a flip-book's pictures: else it leaves frames out

export const picture = {mode: "off", samples: 0, of: 0, images: 0, done: false,   // mode: off, over, beside
  crop: null};   // the part that is traced: its left, top, right, bottom in shares of the picture; null: all
let seq = 0, stage = 0, timer = 0, has_a = false, at = remembered("divider", 0.5), started = 0;
const canvas_a = byId("picture_a"), canvas_b = byId("picture_b");

function size_of(share) {
  const box = byId("live"), ratio = window.devicePixelRatio, width = Math.min(max_width, box.clientWidth * ratio);
  return [Math.max(16, Math.round(width / share)), Math.max(16, Math.round(width / share * box.clientHeight / Math.max(1, box.clientWidth)))];
}

// What a picture shows, but for its frame.
function look_of(size, samples) {
  const look = {camera: camera_message(), size, layer: byId("layer").value || "beauty", exposure: world.exposure, samples};
  if (!picture.crop) return look;
  const [left, top, right, bottom] = picture.crop.map((share, k) => share * size[k % 2]);
  const x = Math.floor(left), y = Math.floor(top);
  return {...look, crop: [x, y, Math.ceil(right) - x, Math.ceil(bottom) - y]};
}
const wanted_samples = () => Number(byId("samples").value);

export function set_crop(part) {
  picture.crop = part;
  emit("crop");
  again();
}

// ---- flip-book ----
// {of: what its pictures show, frames: the frames that it takes, next: index of the one that is made, images: frame -> ImageBitmap}
let book = null, leaf = null;   // leaf: the frame that is seen
export const flip_book = {frames: () => book ? book.images.size : 0, done: () => !!book && book.next >= book.frames.length, seen: () => leaf};
const making_book = () => !!book && book.next < book.frames.length;
const what_is_seen = () => JSON.stringify([state.scene.revision, look_of(size_of(1), wanted_samples())]);

export function start_book() {
  if (!state.scene) return;
  if (picture.mode === "off") set_mode("over");
  if (making_book()) { drop_book(); again(); return; }
  drop_book();
  play(false);
  const [first, last] = frames_of(), [width, height] = size_of(1), all = last - first + 1;
  const every = Math.ceil(all * 4 * width * height / max_book), frames = [];
  for (let frame = first; frame <= last; frame += every) frames.push(frame);
  book = {of: what_is_seen(), frames, next: 0, images: new Map()};
  clearTimeout(timer);
  timer = setTimeout(() => { timer = 0; next_leaf(); }, settle_ms);
  show_book();
}
function drop_book() {
  if (!book) return;
  for (const image of book.images.values()) image.close();
  book = leaf = null;
  player.covered = false;
  show_book();
}
function end_book(why) {
  drop_book();
  status(why);
}
function show_book() {
  byId("book").textContent = making_book() ? "stop" : "flip-book";
  byId("book").setAttribute("aria-pressed", !!book);
}
function next_leaf() {
  if (!making_book() || !state.connected) return;
  started = 1;
  send({type: "render", seq: ++seq, frame: book.frames[book.next], ...look_of(size_of(1), wanted_samples())});
}
async function take_leaf() {
  const own = book, frame = book.frames[book.next];
  let image;
  try { image = await createImageBitmap(canvas_b); } catch { end_book("the flip-book does not fit into memory"); return; }
  if (own !== book) { image.close(); return; }
  book.images.set(frame, image);
  ++book.next;
  show_book();
  if (making_book()) { next_leaf(); return; }
  picture.done = true;
  status(`flip-book of ${book.images.size} frames`);
  play(true);
}
// Pictures that were made elsewhere, by frame.
export function show_book_of(images) {
  if (picture.mode === "off") set_mode("over");
  drop_book();
  clearTimeout(timer);
  if (started) send({type: "stop"});
  timer = started = 0;
  ++seq;
  book = {of: what_is_seen(), frames: [...images.keys()].sort((a, b) => a - b), next: images.size, images};
  show_book();
  picture.done = true;
  status(`flip-book of ${images.size} frames`);
  play(true);
}
// The leaf at a time: the last one up to it.
function leaf_at(time) {
  for (let i = book.frames.length; --i >= 0;) if (book.frames[i] <= time + 1e-6) return book.frames[i];
  return book.frames[0];
}
// Once for each picture of the screen. A whole book is played by itself: no frame is asked for.
export function turn_leaf() {
  player.covered = !!book && !making_book() && picture.mode === "over" && player.playing;
  if (!book || making_book() || picture.mode === "off") return;
  const frame = leaf_at(player.time);
  if (frame === leaf) return;
  leaf = frame;
  const image = book.images.get(frame);
  canvas_b.width = image.width;   // also clears it
  canvas_b.height = image.height;
  canvas_b.getContext("2d").drawImage(image, 0, 0);
  Object.assign(picture, {images: picture.images + 1, part: [0, 0, image.width, image.height]});
  byId("picture").classList.remove("waiting");
}

function request() {
  timer = 0;
  if (picture.mode === "off" || player.playing || !state.scene || !state.connected || document.hidden) return;
  const first = stage === 0, samples = first ? Math.min(first_samples, wanted_samples()) : wanted_samples();
  const sent = send({type: "render", seq: ++seq, frame: Number(player.time.toFixed(4)), ...look_of(size_of(first ? first_share : 1), samples),
    budget: first ? draft_strands : 0});
  if (!sent) return;
  picture.done = false;
  status(first ? "starting" : null);
}

// Anything that the picture shows has changed: it goes away, and begins anew when all is still.
function again() {
  if (picture.mode === "off") return;
  if (book && book.of === what_is_seen()) {   // only the time has changed
    clearTimeout(timer);
    if (making_book()) timer = setTimeout(() => { timer = 0; next_leaf(); }, settle_ms);
    return;
  }
  drop_book();
  if (!timer && started) send({type: "stop"});
  started = 0;
  clearTimeout(timer);
  stage = 0;
  ++seq;   // answers of the picture before are not shown
  byId("picture").classList.add("waiting");
  picture.done = false;
  if (!player.playing) timer = setTimeout(() => { started = 1; request(); }, settle_ms);
  status(player.playing ? "paused while playing" : "");
}

function status(text) { if (text !== null) byId("render_status").textContent = text; }

export function set_mode(mode) {
  const was = picture.mode;
  picture.mode = mode;
  const shown = mode !== "off";
  byId("picture").hidden = byId("render_bar").hidden = !shown;
  byId("view").classList.toggle("split", mode === "beside");
  byId("beside").setAttribute("aria-pressed", mode === "beside");
  if (!shown) {
    drop_book();
    clearTimeout(timer);
    timer = 0;
    ++seq;
    if (was !== "off") send({type: "stop"});
    started = 0;
    if (world.scene_exposure !== undefined) set_exposure(world.scene_exposure);
    show_exposure();
  } else again();
  emit("picture", mode);
}
export const toggle = () => set_mode(picture.mode === "off" ? "over" : "off");
export const toggle_beside = () => set_mode(picture.mode === "beside" ? "over" : "beside");

export function keep_a() {
  if (picture.mode === "off" || !picture.images) return;
  canvas_a.width = canvas_b.width;
  canvas_a.height = canvas_b.height;
  canvas_a.getContext("2d").drawImage(canvas_b, 0, 0);
  has_a = true;
  compare();
  notice("A kept. Change something, then drag the line between A and B. Shift-A drops A.");
}
export function drop_a() {
  has_a = false;
  compare();
}
function compare() {
  canvas_a.hidden = byId("divider").hidden = !has_a;
  canvas_a.style.clipPath = `inset(0 ${100 - 100 * at}% 0 0)`;
  byId("divider").style.left = 100 * at + "%";
  const [left, right] = document.querySelectorAll(".which");
  left.textContent = has_a ? "A" : "";
  right.textContent = has_a ? "B" : "";
  byId("keep_a").textContent = has_a ? "drop A" : "keep as A";
}

function save_picture() {
  if (!picture.images) return;
  const [x, y, width, height] = picture.part, canvas = make("canvas", {width, height});
  canvas.getContext("2d").drawImage(canvas_b, -x, -y);
  canvas.toBlob(blob => {
    const name = state.scene.file.split(/[\\/]/).pop().replace(/\.[^.]*$/, ""), link = make("a", {download: `${name}.${Math.round(player.time)}.png`});
    link.href = URL.createObjectURL(blob);
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
}

function show_exposure() {
  byId("exposure").value = world.exposure;
  byId("exposure_value").textContent = `${world.exposure < 0 ? "−" : "+"}${Math.abs(world.exposure).toFixed(2)} stops`;
}

on("image", (header, payload) => {
  if (header.seq !== seq || picture.mode === "off") return;
  const {width, height, of_width, of_height} = header;
  const pixels = new Uint8ClampedArray(payload.buffer, payload.base, 4 * width * height), context = canvas_b.getContext("2d");
  if (canvas_b.width !== of_width || canvas_b.height !== of_height) { canvas_b.width = of_width; canvas_b.height = of_height; }
  else if (width * height < of_width * of_height) context.clearRect(0, 0, of_width, of_height);   // around a part nothing is known
  context.putImageData(new ImageData(pixels, width, height), header.x, header.y);
  byId("picture").classList.remove("waiting");
  Object.assign(picture, {width: of_width, part: [header.x, header.y, width, height], samples: header.samples, of: header.of, images: picture.images + 1});
  if (book) status(`frame ${book.frames[book.next]}, ${book.next + 1} of ${book.frames.length}: ${header.samples} of ${header.of} samples`);
  else status(stage === 0 ? `draft, ${header.seconds.toFixed(1)} s` : `${header.samples} of ${header.of} samples, ${header.seconds.toFixed(1)} s`);
});
on("problems", message => { if (making_book() && message.problems.length) end_book("the flip-book was stopped by a mistake"); });
on("render_done", message => {
  if (message.seq !== seq || picture.mode === "off") return;
  if (making_book()) { take_leaf(); return; }
  if (stage === 0) { stage = 1; request(); return; }
  picture.done = true;
  status(`${message.samples} samples, ${message.seconds.toFixed(1)} s`);
});

export function start_render() {
  for (const type of ["camera", "edit", "answered", "play"]) on(type, again);
  on("open", again);
  on("scene", scene => {
    const layer = byId("layer"), was = layer.value;
    layer.replaceChildren(...scene.layers.map(name => make("option", {}, name)));
    layer.value = scene.layers.includes(was) ? was : scene.layers[0] || "";
    show_exposure();
    again();
  });
  byId("layer").onchange = again;
  byId("samples").onchange = again;
  byId("exposure").addEventListener("input", event => { set_exposure(Number(event.target.value)); show_exposure(); again(); });
  byId("exposure").addEventListener("dblclick", () => { set_exposure(world.scene_exposure); show_exposure(); again(); });
  byId("keep_a").onclick = () => has_a ? drop_a() : keep_a();
  byId("beside").onclick = toggle_beside;
  const bar = byId("render_bar");   // other bars are below it, however many lines it has
  new ResizeObserver(() => document.documentElement.style.setProperty("--bar-end", bar.offsetTop + bar.offsetHeight + "px")).observe(bar);
  byId("book").onclick = start_book;
  byId("render").onclick = toggle;
  byId("save_picture").onclick = save_picture;
  const divider = byId("divider");
  let dragging = false;
  divider.addEventListener("pointerdown", event => { dragging = true; divider.setPointerCapture(event.pointerId); event.stopPropagation(); });
  divider.addEventListener("pointermove", event => {
    if (!dragging) return;
    const box = byId("picture").getBoundingClientRect();
    at = clamp((event.clientX - box.left) / box.width, 0, 1);
    remember("divider", at);
    compare();
  });
  for (const end of ["pointerup", "pointercancel"]) divider.addEventListener(end, () => { dragging = false; });
  compare();
}
