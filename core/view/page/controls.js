// SPDX-License-Identifier: Apache-2.0
// The control of a parameter by its type. Each is {element, update(param), tall}; change(text or null) sends a value.
import {make, clamp, leave} from "./state.js";
import {parse_value, number_text, list_text, string_text, hex_of, color_of} from "./toml.js";
import {ramp_control} from "./ramp.js";

const decades_for_log = 100, steps = 1000;

// A number that is typed, dragged sideways (Shift: finer), or moved by the arrow keys.
export function number_field(get_step, change, whole = false) {
  const input = make("input", {class: "number", inputmode: "decimal", spellcheck: "false", autocomplete: "off"});
  let shown = "", from = null;
  const read = () => {
    const text = input.value.trim().replace(",", ".");
    return text === "" ? null : Number(text);
  };
  const tidy = value => whole ? Math.round(value) : Number(value.toPrecision(5));
  const put = value => { input.value = shown = number_text(value); input.classList.remove("bad"); change(value); };
  const commit = () => {
    if (input.value === shown) return;
    const value = read();
    if (Number.isNaN(value)) { input.classList.add("bad"); return; }
    shown = input.value;
    input.classList.remove("bad");
    change(value === null ? null : whole ? Math.round(value) : value);
  };
  input.addEventListener("change", commit);
  input.addEventListener("blur", commit);
  input.addEventListener("keydown", event => {
    if (event.key === "Enter") { commit(); if (!input.classList.contains("bad")) leave(input); }
    if (event.key === "Escape") { input.value = shown; input.classList.remove("bad"); input.blur(); }
    const sign = {ArrowUp: 1, ArrowDown: -1}[event.key];
    if (!sign) return;
    event.preventDefault();
    put(tidy((read() || 0) + sign * get_step(event.shiftKey ? 10 : 1)));
  });
  input.addEventListener("pointerdown", event => {
    if (event.button === 0 && document.activeElement !== input) from = {x: event.clientX, value: read(), moved: false};
    if (from) event.preventDefault();
  });
  input.addEventListener("pointermove", event => {
    if (!from || !Number.isFinite(from.value)) return;
    if (!from.moved && Math.abs(event.clientX - from.x) < 4) return;
    if (!from.moved) { from.moved = true; input.setPointerCapture(event.pointerId); from.x = event.clientX; }
    const value = tidy(from.value + (event.clientX - from.x) * get_step(event.shiftKey ? 0.1 : 1) * (whole ? 0.2 : 1));
    if (value !== read()) put(value);
  });
  input.addEventListener("pointerup", () => {
    if (from && !from.moved) { input.focus(); input.select(); }
    from = null;
  });
  input.addEventListener("pointercancel", () => { from = null; });
  return {input, busy: () => !!(from && from.moved) || (document.activeElement === input && input.value !== shown), show(text) {
    if (from && from.moved || document.activeElement === input && input.value !== shown) return;
    input.value = shown = text;
    input.classList.remove("bad");
  }};
}

// A round number of at least `value`.
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map(n => n * power).find(n => n >= value * 0.999999);
}

// The value of the scene file, as far as the page has seen it: by key.
const in_file = new Map();
function file_value(param) {
  if (!param.changed || !in_file.has(param.key)) in_file.set(param.key, Number(param.value) || 0);
  return in_file.get(param.key);
}

// {low, high, log} of a slider: the declared ends where they are reasonable, else from the default and the value in the file. A value
// beyond them widens it, while it is there.
export function range_of(param, value, anchor = value) {
  const range = plain_range(param, anchor);
  if (value > range.high) range.high = Math.min(param.max ?? Infinity, Math.max(value, nice(value)));
  if (value < range.low) range.low = Math.max(param.min ?? -Infinity, value < 0 ? Math.min(value, -nice(-value)) : value);
  return range;
}
function plain_range(param, value) {
  const whole = param.type === "integer", initial = Number(param.initial);
  const sizes = [Math.abs(value), Math.abs(initial)].filter(size => size > 0 && Number.isFinite(size));
  const size = sizes.length ? Math.max(...sizes) : whole ? 4 : 0.5;
  const declared = param.min !== null && param.max !== null;
  if (declared && param.min > 0 && param.max / param.min > decades_for_log) {
    const log_low = Math.max(param.min, Math.min(...(sizes.length ? sizes : [1])) / 100), log_high = Math.min(param.max, size * 100);
    return {low: log_low, high: log_high, log: true};
  }
  if (declared && param.max - param.min <= Math.max(10 * size, whole ? 16 : 1)) return {low: param.min, high: param.max, log: false};
  let high = nice(2.5 * size), low = value < 0 || initial < 0 || param.min === null && initial === 0 && value === 0 ? -high : 0;
  if (param.min !== null) low = Math.max(param.min, Math.min(low, value));
  if (param.max !== null) high = Math.min(param.max, high);
  return {low, high: Math.max(high, value, low + (whole ? 1 : 1e-6)), log: false};
}

function number_control(param, change) {
  const range_now = of => range_of(of, Number(of.value) || 0, file_value(of));
  let now = param, range = range_now(param), held = false;
  const whole = param.type === "integer";
  const slider = make("input", {type: "range", min: 0, max: steps, step: 1, "aria-label": param.key});
  const to_share = value => range.log ? Math.log(Math.max(value, range.low) / range.low) / Math.log(range.high / range.low)
    : (value - range.low) / (range.high - range.low);
  const to_value = share => {
    const value = range.log ? range.low * (range.high / range.low) ** share : range.low + share * (range.high - range.low);
    if (whole) return Math.round(value);
    if (share === 0 || share === 1) return value;
    return range.log ? Number(value.toPrecision(3)) : Number(value.toFixed(Math.max(0, Math.ceil(2.5 - Math.log10(range.high - range.low)))));
  };
  const grain = times => whole ? Math.max(1, times) : times * (range.log ? Math.abs(Number(now.value)) / 100 || 1e-3
    : 10 ** Math.floor(Math.log10((range.high - range.low) / 60)));
  const limited = value => value === null ? null : clamp(value, param.min ?? -Infinity, param.max ?? Infinity);
  const field = number_field(grain, value => {
    // A typed value is sent as it is: the program explains what is wrong with it.
    change(value === null ? null : number_text(field.busy() ? limited(value) : value));
    if (value !== null) place(value);
  }, whole);
  field.input.classList.add("beside");
  const place = value => { slider.value = steps * clamp(to_share(value), 0, 1); };
  slider.addEventListener("input", () => {
    held = true;
    const value = to_value(slider.value / steps);
    field.show(number_text(value));
    change(number_text(value));
  });
  slider.addEventListener("change", () => { held = false; });
  slider.addEventListener("keydown", event => {   // the arrows of a slider move by what can be read in the field
    const sign = {ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1}[event.key];
    if (!sign) return;
    event.preventDefault();
    event.stopPropagation();
    const value = limited(Number((Number(field.input.value) + sign * grain(event.shiftKey ? 10 : 1)).toPrecision(6)));
    field.show(number_text(value));
    place(value);
    change(number_text(value));
  });
  return {elements: [slider, field.input], update(next) {
    now = next;
    const value = Number(next.value), fine = next.value !== "" && Number.isFinite(value);
    field.input.placeholder = fine ? "" : "none";
    slider.classList.toggle("empty", !fine);
    if (!held) field.show(fine ? next.value : "");
    if (!fine || held) return;
    range = range_now(next);
    place(value);
  }};
}

function fields_control(param, change, count) {
  const color = param.type === "color";
  let numbers = [], size = 1;
  const send = () => change(list_text(numbers));
  const fields = Array.from({length: count}, (_, k) => {
    const field = number_field(times => times * 10 ** Math.floor(Math.log10(Math.max(size, 1e-6) / (color ? 30 : 60))), value => {
      if (value === null) return;
      numbers[k] = field.busy() ? clamp(value, param.min ?? (color ? 0 : -Infinity), param.max ?? Infinity) : value;
      send();
    });
    field.input.setAttribute("aria-label", `${param.key} ${param.type === "range" ? ["from", "to"][k] : (color ? "rgb" : "xyz")[k]}`);
    return field;
  });
  const swatch = color ? make("input", {type: "color", "aria-label": param.key}) : null;
  if (swatch) swatch.addEventListener("input", () => { numbers = color_of(swatch.value); fields.forEach((field, k) => field.show(number_text(numbers[k], 4))); send(); });
  return {elements: [...(swatch ? [swatch] : []), ...fields.map(field => field.input)], update(next) {
    const value = parse_value(next.value);
    numbers = typeof value === "number" ? Array(count).fill(value) : Array.isArray(value) ? value.slice(0, count) : [];
    const fine = numbers.length === count;
    if (!fine) numbers = Array(count).fill(0);
    const initial = parse_value(next.initial);
    size = Math.max(...numbers.map(Math.abs), ...(Array.isArray(initial) ? initial.map(x => Math.abs(Number(x)) || 0) : [0])) || 1;
    fields.forEach((field, k) => { field.input.placeholder = fine ? "" : "none"; field.show(fine ? number_text(numbers[k]) : ""); });
    if (swatch && fine && document.activeElement !== swatch) swatch.value = hex_of(numbers);
  }};
}

function boolean_control(param, change) {
  const box = make("input", {type: "checkbox", "aria-label": param.key});
  box.addEventListener("change", () => change(String(box.checked)));
  return {elements: [box], update(next) { box.checked = next.value === "true"; }};
}

function choice_control(param, change) {
  const select = make("select", {"aria-label": param.key});
  select.addEventListener("change", () => change(string_text(select.value)));
  return {elements: [select], update(next) {
    const value = parse_value(next.value), shown = typeof value === "string" ? value : next.value;
    const names = next.choices.includes(shown) ? next.choices : [shown, ...next.choices];
    select.replaceChildren(...names.map(name => make("option", {value: name}, name || "none")));
    select.value = shown;
  }};
}

// Texts are shown without their quotes; everything else as it is written in a scene file.
function text_control(param, change, quoted) {
  const input = make("input", {spellcheck: "false", autocomplete: "off", "aria-label": param.key});
  let shown = "", strings = quoted;
  const commit = () => {
    if (input.value === shown) return;
    shown = input.value;
    const text = input.value.trim();
    change(text === "" ? null : strings && !/^[[{"']/.test(text) ? string_text(input.value) : text);
  };
  input.addEventListener("change", commit);
  input.addEventListener("keydown", event => {
    if (event.key === "Enter") { commit(); leave(input); }
    if (event.key === "Escape") { input.value = shown; input.blur(); }
  });
  return {elements: [input], update(next) {
    const value = quoted ? parse_value(next.value) : undefined;
    strings = quoted && (typeof value === "string" || next.value === "" || next.value === "none");
    const text = typeof value === "string" ? value : next.value === "none" ? "" : next.value;
    input.placeholder = text === "" ? next.initial && next.initial !== '""' ? next.initial : "none" : "";
    if (document.activeElement === input && input.value !== shown) return;
    input.value = shown = text;
  }};
}

const counts = {vec2: 2, range: 2, vec3: 3, color: 3};
const quoted_types = new Set(["text", "file", "image", "reference", "table"]);

// Which control a parameter has now: a keyed number is a text.
export function kind_of(param) {
  const value = parse_value(param.value);
  if (param.keyed || (value && typeof value === "object" && !Array.isArray(value) && param.type !== "ramp")) return "raw";
  return param.type;
}

export function control_of(param, change) {
  const kind = kind_of(param);
  if (kind === "ramp") return finished(ramp_control(param, change), param);
  const made = kind === "boolean" ? boolean_control(param, change)
    : kind === "integer" || kind === "number" ? number_control(param, change)
    : counts[kind] ? fields_control(param, change, counts[kind])
    : kind === "choice" ? choice_control(param, change)
    : text_control(param, change, quoted_types.has(kind));
  return finished({...made, element: make("div", {class: "control"}, ...made.elements)}, param);
}
function finished(control, param) {
  control.kind = kind_of(param);
  control.update(param);
  return control;
}
