// SPDX-License-Identifier: Apache-2.0
// Sends changed values. While one is on its way, only the newest value of each key waits: at most one is sent per answered frame.
import {state, on, emit} from "./state.js";
import {send} from "./net.js";
import {ask_again, last_seq, touch} from "./player.js";

// Values that one drag or one key press sends are one step of undo: all have its number, which no other page uses.
const page_number = Math.floor(Math.random() * 2 ** 26) * 2 ** 26;
let gesture = 1;
export const new_gesture = () => { gesture = gesture % (2 ** 26 - 1) + 1; };
// Escape takes a drag back, which is part of it; the others only change what it does.
const not_of_their_own = new Set(["Escape", "Shift", "Alt", "Control", "Meta"]);
for (const type of ["pointerdown", "keydown"])
  document.addEventListener(type, event => { if (!event.repeat && !not_of_their_own.has(event.key)) new_gesture(); }, true);

const waiting = new Map();   // key -> {value, gesture}
let in_flight = null, timer = 0;
export const edits = {last_key: null};

export function set_value(key, value) {
  edits.last_key = key;
  waiting.delete(key);
  waiting.set(key, {value, gesture: page_number + gesture});
  touch();
  flush();
}

function flush() {
  if (in_flight || !waiting.size || !state.connected) return;
  const [key, edit] = waiting.entries().next().value;
  waiting.delete(key);
  if (!send({type: "set", key, ...edit})) return;
  in_flight = {after: last_seq(), scene: false};
  ask_again();
  emit("edit", key);
  clearTimeout(timer);
  timer = setTimeout(done, document.hidden ? 1000 : 5000);   // a hidden tab asks for no frames
}
function done() {
  clearTimeout(timer);
  in_flight = null;
  flush();
}
on("answered", header => { if (in_flight && header.seq > in_flight.after) done(); });
on("problems", message => { if (in_flight && message.problems.length) done(); });
on("closed", () => { in_flight = null; waiting.clear(); clearTimeout(timer); });

// What still waits belongs before the command; a reset takes it back.
export function command(type) {
  if (type !== "reset") for (const [key, edit] of waiting) send({type: "set", key, ...edit});
  waiting.clear();
  if (send({type})) { touch(); emit("edit", null); }
}
