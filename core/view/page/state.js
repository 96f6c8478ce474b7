// SPDX-License-Identifier: Apache-2.0
// What all parts of the page share: the scene as the server last described it, events, small helpers.

export const state = {
  scene: null,      // the newest "scene" message
  connected: false,
  software: false,  // WebGL runs on the processor
};

// Events: "scene", "strands", "meshes", "frame", "skipped", "rays", "image", "render_done", "series", "series_picture", "series_done", "problems", "progress", "saved" as they come from the
// server; "open", "closed" of the connection; "camera" at each move; "edit" when a value is sent; "picture" when one is shown or hidden; "crop" when another part of it is traced; "handles" when shapes are shown or hidden; "redraw" wants a new
// drawing.
const listeners = new Map();
export function on(type, listener) {
  if (!listeners.has(type)) listeners.set(type, []);
  listeners.get(type).push(listener);
}
export function emit(type, ...values) {
  for (const listener of listeners.get(type) || []) listener(...values);
}

export const byId = id => document.getElementById(id);
export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

// An element with attributes, listeners (on...) and children.
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

// The keyboard is the view's again, so that space plays.
export function leave(input) {
  input.blur();
  byId("live").focus({preventScroll: true});
}

export const grouped = number => Math.round(number).toLocaleString("en-US");

// Settings of the page that survive its reload.
export function remembered(name, otherwise) {
  try {
    const text = sessionStorage.getItem("marram." + name);
    return text === null ? otherwise : JSON.parse(text);
  } catch { return otherwise; }
}
export function remember(name, value) {
  try { sessionStorage.setItem("marram." + name, JSON.stringify(value)); } catch { /* no storage: nothing is remembered */ }
}

// A line at the bottom of the view that goes away by itself, or stays until it is replaced: then in the middle, unless it is a hint.
let noticeTimer = 0;
export function notice(text, stays = false, hint = !stays) {
  const element = byId("notice");
  clearTimeout(noticeTimer);
  element.textContent = text;
  element.hidden = !text;
  element.classList.toggle("brief", hint);
  if (text && !stays) noticeTimer = setTimeout(() => { element.hidden = true; }, 2500);
}
