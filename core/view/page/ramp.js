// SPDX-License-Identifier: Apache-2.0
// The editor of a ramp: drag knots, double click adds or removes one, Delete removes the picked one, arrows move it.
import {state, make, clamp, leave} from "./state.js";
import {number_text, parse_ramp, ramp_text} from "./toml.js";

const ns = "http://www.w3.org/2000/svg";
const shape = (tag, attributes) => {
  const element = document.createElementNS(ns, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};
// Where a ramp is read now, if it is known: the response at the speed of the wind.
function present_of(key) {
  const speed = key === "wind.response" && state.scene.groups.flatMap(group => group.params).find(param => param.key === "wind.speed");
  const value = speed && !speed.keyed ? Number(speed.value) : NaN;
  return Number.isFinite(value) ? value : null;
}
const knot_radius = 5, pick_radius = 11, samples = 96;

function value_at(ramp, x) {
  const knots = ramp.knots;
  if (x <= knots[0][0]) return knots[0][1];
  for (let i = 1; i < knots.length; ++i) {
    if (x > knots[i][0]) continue;
    const [x0, y0] = knots[i - 1], [x1, y1] = knots[i];
    let t = x1 > x0 ? (x - x0) / (x1 - x0) : 1;
    if (ramp.interpolation === "constant") t = x === x1 ? 1 : 0;
    if (ramp.interpolation === "smooth") t = t * t * (3 - 2 * t);
    return y0 + t * (y1 - y0);
  }
  return knots[knots.length - 1][1];
}

// param: of the scene; change(text): called at each edit.
export function ramp_control(param, change) {
  let ramp = null, picked = -1, dragging = false, frame = null, low_y = -Infinity, high_y = Infinity, shown = "";
  let present = null;
  const writing = () => document.activeElement === text && text.value !== shown;
  const svg = shape("svg", {tabindex: 0, role: "application", "aria-label": "Ramp: arrows move the picked knot, Page Up and Down pick, Delete removes"});
  const text = make("input", {spellcheck: "false", "aria-label": "The ramp as text"});
  const kind = make("select", {"aria-label": "Interpolation"}, ...["linear", "smooth", "constant"].map(name => make("option", {}, name)));
  const element = make("div", {class: "ramp"}, svg, make("div", {class: "under"}, text, kind));

  const fit = () => {   // the visible range: all knots, and 0 to 1 where that is not much larger
    const xs = ramp.knots.map(knot => knot[0]), ys = ramp.knots.map(knot => knot[1]);
    const range = values => {
      let low = Math.min(0, ...values), high = Math.max(...values);
      if (high <= 1 && high > 0.2 || high <= 0) high = 1;
      return [low, high > low ? high : low + 1];
    };
    frame = {x: range(xs), y: range(ys)};
  };
  const box = () => { const b = svg.getBoundingClientRect(); return {w: b.width || 200, h: b.height || 90, left: b.left, top: b.top}; };
  const pad = 9;
  const to_screen = ([x, y], b) => [pad + (x - frame.x[0]) / (frame.x[1] - frame.x[0]) * (b.w - 2 * pad),
    b.h - pad - (y - frame.y[0]) / (frame.y[1] - frame.y[0]) * (b.h - 2 * pad)];
  const to_ramp = (px, py, b) => [frame.x[0] + (px - pad) / (b.w - 2 * pad) * (frame.x[1] - frame.x[0]),
    frame.y[0] + (b.h - pad - py) / (b.h - 2 * pad) * (frame.y[1] - frame.y[0])];

  function draw() {
    svg.replaceChildren();
    if (!ramp) return;
    const b = box(), points = [];
    for (let i = 0; i <= 4; ++i) {
      const x = pad + i / 4 * (b.w - 2 * pad), y = pad + i / 4 * (b.h - 2 * pad);
      svg.append(shape("line", {class: "grid", x1: x, x2: x, y1: pad, y2: b.h - pad}), shape("line", {class: "grid", y1: y, y2: y, x1: pad, x2: b.w - pad}));
    }
    const steps = ramp.interpolation === "constant" ? 400 : samples;
    for (let i = 0; i <= steps; ++i) {
      const x = frame.x[0] + i / steps * (frame.x[1] - frame.x[0]);
      points.push(to_screen([x, value_at(ramp, x)], b));
    }
    const path = points.map(point => point.map(v => v.toFixed(1)).join()).join(" ");
    svg.append(shape("polygon", {class: "area", points: `${pad},${b.h - pad} ${path} ${b.w - pad},${b.h - pad}`}), shape("polyline", {class: "curve", points: path}));
    const label = (x, y, anchor, words) => { const t = shape("text", {class: "scale", x, y, "text-anchor": anchor}); t.textContent = words; svg.append(t); };
    label(3, 12, "start", number_text(frame.y[1], 3));
    label(b.w - 3, b.h - 3, "end", number_text(frame.x[1], 3));
    if (present !== null) {   // beyond the ramp: at its end
      const [x] = to_screen([clamp(present, ...frame.x), 0], b);
      svg.append(shape("line", {class: "now", x1: x, x2: x, y1: pad, y2: b.h - pad}));
    }
    ramp.knots.forEach((knot, index) => {
      const [cx, cy] = to_screen(knot, b);
      svg.append(shape("circle", {cx, cy, r: knot_radius, class: index === picked ? "picked" : ""}));
    });
    if (!writing()) text.value = shown = ramp_text(ramp);
    kind.value = ramp.interpolation;
  }
  const send = () => { text.value = shown = ramp_text(ramp); draw(); change(ramp_text(ramp)); };
  const limit = (index, [x, y]) => {
    const knots = ramp.knots, digits = v => Number(v.toFixed(Math.max(0, 3 - Math.floor(Math.log10(Math.abs(frame.x[1] - frame.x[0]))))));
    const fine = v => Number(v.toFixed(Math.max(0, 3 - Math.floor(Math.log10(Math.abs(frame.y[1] - frame.y[0]))))));
    x = clamp(x, index > 0 ? knots[index - 1][0] : frame.x[0], index + 1 < knots.length ? knots[index + 1][0] : frame.x[1]);
    return [digits(x), clamp(fine(clamp(y, frame.y[0], frame.y[1])), low_y, high_y)];
  };
  const nearest = event => {
    const b = box();
    let best = -1, distance = pick_radius;
    ramp.knots.forEach((knot, index) => {
      const [x, y] = to_screen(knot, b), d = Math.hypot(event.clientX - b.left - x, event.clientY - b.top - y);
      if (d < distance) { distance = d; best = index; }
    });
    return best;
  };
  svg.addEventListener("pointerdown", event => {
    if (!ramp || event.button !== 0) return;
    picked = nearest(event);
    dragging = picked >= 0;
    if (dragging) svg.setPointerCapture(event.pointerId);
    draw();
  });
  svg.addEventListener("pointermove", event => {
    if (!dragging) return;
    const b = box();
    ramp.knots[picked] = limit(picked, to_ramp(event.clientX - b.left, event.clientY - b.top, b));
    send();
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { if (dragging) { dragging = false; fit(); draw(); } });
  svg.addEventListener("dblclick", event => {
    if (!ramp) return;
    const there = nearest(event), b = box();
    if (there >= 0) { remove(there); return; }
    const point = to_ramp(event.clientX - b.left, event.clientY - b.top, b);
    let index = ramp.knots.findIndex(knot => knot[0] > point[0]);
    if (index < 0) index = ramp.knots.length;
    ramp.knots.splice(index, 0, [0, 0]);
    ramp.knots[index] = limit(index, point);
    picked = index;
    send();
  });
  function remove(index) {
    if (ramp.knots.length < 2 || index < 0) return;
    ramp.knots.splice(index, 1);
    picked = Math.min(index, ramp.knots.length - 1);
    fit();
    send();
  }
  svg.addEventListener("keydown", event => {
    if (!ramp) return;
    const move = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
    if (event.key === "Delete" || event.key === "Backspace") remove(picked);
    else if (event.key === "PageDown" || event.key === "PageUp") {
      picked = (picked + (event.key === "PageDown" ? 1 : ramp.knots.length - 1) + ramp.knots.length) % ramp.knots.length;
      draw();
    } else if (move && picked >= 0) {
      const share = event.shiftKey ? 0.1 : 0.01, [x, y] = ramp.knots[picked];
      ramp.knots[picked] = limit(picked, [x + move[0] * share * (frame.x[1] - frame.x[0]), y + move[1] * share * (frame.y[1] - frame.y[0])]);
      send();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  kind.addEventListener("change", () => { if (ramp) { ramp.interpolation = kind.value; ramp.plain = false; send(); } });
  const commit = () => {
    if (text.value === shown) return;
    shown = text.value;
    change(text.value.trim() || null);
  };
  text.addEventListener("change", commit);
  text.addEventListener("keydown", event => {
    if (event.key === "Enter") { commit(); leave(text); }
    if (event.key === "Escape") { text.value = shown; text.blur(); }
  });
  new ResizeObserver(draw).observe(svg);

  return {element, tall: true, update(now) {
    if (dragging) return;
    low_y = now.min ?? -Infinity;
    high_y = now.max ?? Infinity;
    const read = parse_ramp(now.value), was = present;
    present = present_of(now.key);
    if (present === was && read && ramp && ramp_text(read) === ramp_text(ramp)) return;
    ramp = read;
    picked = ramp ? Math.min(picked, ramp.knots.length - 1) : -1;
    svg.toggleAttribute("hidden", !ramp);
    kind.hidden = !ramp;
    if (ramp) fit();
    if (!writing()) text.value = shown = now.value === "none" ? "" : now.value;
    text.placeholder = "none";
    draw();
  }};
}
