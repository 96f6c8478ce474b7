// SPDX-License-Identifier: Apache-2.0
// Frames rendered into a folder by the program: the dialog that orders them, how far they are, and at the end the flip-book of them.
import {state, on, byId, make, remembered, remember} from "./state.js";
import {send} from "./net.js";
import {world} from "./world.js";
import {show_book_of, max_book} from "./render.js";

const first_seq = Math.floor(Math.random() * 2 ** 40);
let order = null, number = first_seq;   // {seq, images: frame -> ImageBitmap, bytes, waiting: pictures that are being read}
export const series = {busy: () => !!order, pictures: () => order ? order.images.size : 0};

const field = name => byId("series").querySelector(`[name=${name}]`);
const line_of = problem => `${problem.place ? problem.place + ": " : ""}${problem.what}: ${problem.fix}`;
function show_problems(lines) {
  byId("series_problems").replaceChildren(...lines.map(text => make("p", {}, text)));
}

export function open_series() {
  const dialog = byId("series");
  if (!state.scene || dialog.open) return;
  const [first, last] = state.scene.frames, path = state.scene.file, saved = remembered("series", {});
  field("folder").value = saved.file === path ? saved.folder : path.replace(/\.[^./\\]*$/, "") + "_frames";
  field("frames").value = first === last ? String(first) : `${first}-${last}`;
  field("replace").checked = false;   // an order of its own each time
  const film = name => state.scene.groups.flatMap(group => group.params).find(param => param.key === `film.${name}`)?.value ?? "";
  byId("series_what").textContent = `${world.home ? "The camera of the scene" : "The camera of this view, which stands still"}; film.size ${film("size")}, film.samples ${film("samples")}.`;
  show_problems([]);
  dialog.showModal();
  field("folder").focus();
}

function give_order() {
  drop();
  const folder = field("folder").value.trim(), camera = world.camera;
  remember("series", {file: state.scene.file, folder});
  order = {seq: ++number, images: new Map(), bytes: 0, waiting: []};
  send({type: "series", seq: order.seq, folder, frames: field("frames").value.trim(), format: field("format").value, replace: field("replace").checked,
    camera: world.home ? null : {position: camera.position.toArray(), target: world.controls.target.toArray(), up: camera.up.toArray(), fov: world.fov}});
  byId("series_start").disabled = true;
}
function drop() {
  if (order) for (const image of order.images.values()) image.close();
  order = null;
}
export function stop_series() {
  if (!order) return;
  send({type: "stop_series"});
  show_line(`Stopped: ${order.of ? `${order.index} of ${order.of} frames are there` : "nothing was written"}.`, false);
  drop();
}

function show_line(text, runs) {
  byId("series_line").hidden = !text;
  byId("series_text").textContent = text;
  byId("series_stop").textContent = runs ? "stop" : "close";
  byId("series_share").hidden = !runs;
}

const is_mine = message => order && message.seq === order.seq;
on("series", message => {
  if (!is_mine(message)) return;
  Object.assign(order, {index: message.index, of: message.of});
  byId("series").close();
  show_line(`Frame ${message.frame}, ${message.index + 1} of ${message.of}: ${message.samples} of ${message.of_samples} samples`, true);
  byId("series_share").value = (message.index + (message.of_samples ? message.samples / message.of_samples : 0)) / message.of;
});
on("series_picture", (header, payload) => {
  if (!is_mine(header)) return;
  const {width, height, frame} = header, own = order;
  own.index = (own.index || 0) + 1;
  own.bytes += 4 * width * height;
  if (own.bytes > max_book) return;   // the rest is in the files alone
  own.waiting.push(createImageBitmap(new ImageData(new Uint8ClampedArray(payload.buffer, payload.base, 4 * width * height), width, height))
    .then(image => { own.images.set(frame, image); }, () => {}));
});
on("series_done", async message => {
  if (!is_mine(message)) return;
  byId("series_start").disabled = false;
  const lines = message.problems.map(line_of), own = order;
  if (byId("series").open) {   // refused at once: the dialog stays
    show_problems(lines);
    drop();
    return;
  }
  const there = `${message.pictures} of ${message.of} frames are in ${message.folder}`;
  show_line([lines.length ? `${there}. ${lines.join(" ")}` : `${there}.`, ...message.warnings].join("\n"), false);
  await Promise.all(own.waiting);
  if (own !== order) return;
  order = null;
  if (own.images.size > 1 && !lines.length) show_book_of(own.images);
});
on("closed", () => {
  if (!order) return;
  show_line("The connection was lost: the frames that were ready are there.", false);
  byId("series_start").disabled = false;
  drop();
});

export function start_series() {
  byId("files").onclick = open_series;
  byId("series").querySelector("form").addEventListener("submit", event => { event.preventDefault(); give_order(); });
  byId("series_cancel").onclick = () => byId("series").close();
  byId("series").addEventListener("close", () => { byId("series_start").disabled = false; if (order && order.of === undefined) stop_series(); });
  byId("series_stop").onclick = () => { if (order) stop_series(); else show_line("", false); };
}
