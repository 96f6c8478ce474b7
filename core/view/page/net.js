// SPDX-License-Identifier: Apache-2.0
// The connection to the program: a WebSocket beside the page, that is opened anew when it is lost.
import {state, emit, notice} from "./state.js";

const first_pause = 500, longest_pause = 8000; // ms between attempts
let socket = null, pause = first_pause, timer = 0;

export function connect() {
  clearTimeout(timer);
  socket = new WebSocket(new URL("socket", location.href).href.replace(/^http/, "ws").replace(/[?#].*$/, ""));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    pause = first_pause;
    state.connected = true;
    notice("");
    emit("open");
  };
  socket.onmessage = event => receive(event.data);
  socket.onclose = () => {
    if (state.connected) emit("closed");
    state.connected = false;
    notice("The program has ended or the connection is lost. Trying again.", true);
    emit("progress", {fraction: -1});
    timer = setTimeout(connect, pause);
    pause = Math.min(longest_pause, pause * 1.6);
  };
}

export function send(message) {
  if (!state.connected || socket.readyState !== 1) return false;
  socket.send(JSON.stringify(message));
  return true;
}

const text_types = new Set(["scene", "problems", "progress", "saved", "skipped", "render_done", "series", "series_done", "rays"]);
const binary_types = new Set(["meshes", "strands", "frame", "image", "series_picture"]);

function receive(data) {
  try {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (!text_types.has(message.type)) throw new Error(`type "${message.type}"`);
      if (message.type === "scene") state.scene = message;
      emit(message.type, message);
      return;
    }
    const length = new DataView(data).getUint32(0, true), base = 4 + length;
    if (base > data.byteLength) throw new Error("the header is longer than the message");
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    if (!binary_types.has(header.type)) throw new Error(`type "${header.type}"`);
    emit(header.type, header, {buffer: data, base});
  } catch (error) {
    console.warn("A message that the page cannot read was ignored:", error.message);
  }
}

// A typed array over the payload; throws if it would end outside.
export function view_of(payload, type, offset, count) {
  return new type(payload.buffer, payload.base + offset, count);
}
