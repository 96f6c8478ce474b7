// SPDX-License-Identifier: Apache-2.0
// Sends changed values. While one is on its way, only the newest value of each key waits: at most one is sent per answered frame.
import {state, on, emit} from "./state.js";
import {send} from "./net.js";
import {ask_again, last_seq, touch} from "./player.js";

const waiting = new Map();
let in_flight = null, timer = 0;
export const edits = {last_key: null};

export function set_value(key, value) {
  edits.last_key = key;
  waiting.delete(key);
  waiting.set(key, value);
  touch();
  flush();
}

function flush() {
  if (in_flight || !waiting.size || !state.connected) return;
  const [key, value] = waiting.entries().next().value;
  waiting.delete(key);
  if (!send({type: "set", key, value})) return;
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
  if (type !== "reset") for (const [key, value] of waiting) send({type: "set", key, value});
  waiting.clear();
  if (send({type})) { touch(); emit("edit", null); }
}
