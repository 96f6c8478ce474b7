// SPDX-License-Identifier: Apache-2.0
#include "core/compare/page_style.h"

namespace marram::page {

// Pictures have a grey surround in both colour schemes, since surrounding colours change their appearance.
// Frames are yellow and black, to be visible on any picture.
const char* const style = R"(<style>
:root{color-scheme:light dark;--back:#fff;--ink:#1f2328;--soft:#5b636d;--line:#d8dce1;--bar:#f3f4f6;--around:#777;
--good:#e7f4ea;--good-edge:#2e7d32;--bad:#fdeceb;--bad-edge:#b3261e;--other:#fff5d6;--accent:#4b4fa3}
@media (prefers-color-scheme:dark){:root{--back:#17191c;--ink:#e2e5e9;--soft:#9aa3ad;--line:#363b42;--bar:#22262b;--around:#444;
--good:#16301c;--good-edge:#58a862;--bad:#3c1b1a;--bad-edge:#e5675f;--other:#3a3213;--accent:#a5a8f0}}
*{box-sizing:border-box}
body{font:15px/1.5 system-ui,sans-serif;max-width:1960px;margin:0 auto 3em;padding:0 1em;color:var(--ink);background:var(--back);
overflow-wrap:anywhere}
h2{font-size:1.25em;margin:2em 0 .4em} h3{font-size:1.05em;margin:1.6em 0 .2em} p{margin:.3em 0;max-width:75em}
main{container-type:inline-size}
.small,figcaption{font-size:13px;color:var(--soft);max-width:95em}
kbd{font:inherit;padding:0 .35em;border:1px solid var(--line);border-radius:3px;background:var(--bar);white-space:nowrap}
.verdict{padding:.8em 1.1em;margin:1em 0;border-left:.5em solid;border-radius:4px}
.verdict h1{margin:0;font-size:1.6em;line-height:1.3} .verdict .files{margin-top:.6em}
.alike{background:var(--good);border-color:var(--good-edge)} .different{background:var(--bad);border-color:var(--bad-edge)}
.doubt{background:var(--other);border-color:var(--accent)}
.controls{position:sticky;top:0;z-index:2;display:flex;flex-wrap:wrap;gap:.4em 1.6em;align-items:center;max-width:none;
margin:.4em 0 .8em;padding:.4em .7em;background:var(--bar);border-radius:4px;font-size:14px;white-space:nowrap}
.controls span,.controls label{display:flex;align-items:center;gap:.3em} .controls input{width:11em;min-width:0;accent-color:var(--accent)}
.controls output{min-width:5.6em;font-variant-numeric:tabular-nums}
button{font:inherit;padding:.1em .7em;border:1px solid var(--line);border-radius:4px;background:var(--back);color:var(--ink);
cursor:pointer}
button[aria-pressed=true]{background:var(--accent);border-color:var(--accent);color:var(--back)}
.views,.group{display:flex;flex-wrap:wrap;gap:1em 1.2em;align-items:flex-start;max-width:100%} figure{margin:0;max-width:100%}
figcaption{margin-top:.35em}
.box{position:relative;overflow:hidden;background:var(--around)} .box img{position:absolute;left:0;top:0;width:100%;height:100%}
.pixelated img{image-rendering:pixelated}
.pair{cursor:ew-resize;touch-action:pan-y;user-select:none} .pair img{pointer-events:none}
.pair:focus-visible{outline:2px solid var(--accent);outline-offset:2px}
.side{position:absolute;inset:0;isolation:isolate} .side .highlights,.side .shadows{display:none;mix-blend-mode:lighten}
[data-exposed=darker] .highlights{display:block;filter:url(#expose-highlights)}
[data-exposed=brighter] .shadows{display:block;filter:url(#expose-shadows)}
[data-exposed=darker] .base,[data-exposed=brighter] .base{filter:url(#expose-base)}
.divider{position:absolute;top:0;bottom:0;width:2px;margin-left:-1px;background:#fff;box-shadow:0 0 0 1px #0009;pointer-events:none}
.divider::after{content:"";position:absolute;top:50%;left:-8px;width:18px;height:18px;margin-top:-9px;border-radius:50%;
background:#fff;box-shadow:0 0 0 1px #0009}
.which{position:absolute;bottom:6px;background:#000a;color:#fff;padding:0 .5em;border-radius:3px;font-size:13px;pointer-events:none}
.which:empty{display:none} .which.left{left:6px} .which.right{right:6px}
.frame{position:absolute;outline:2px solid #ffd21f;outline-offset:1px;box-shadow:0 0 0 1px #000b,0 0 0 4px #000b;pointer-events:none}
.unframed .frame{display:none}
.histogram{display:block;width:100%;height:56px;margin-top:6px;fill:var(--soft)}
.scale{height:12px;border:1px solid var(--line)}
.ticks{display:flex;justify-content:space-between;font-size:12px;color:var(--soft);font-variant-numeric:tabular-nums}
.wide{overflow-x:auto;margin:.6em 0} table{border-collapse:collapse;font-variant-numeric:tabular-nums}
.wide table{overflow-wrap:normal} td,th{padding:3px 12px;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{font-weight:600;font-size:13px;color:var(--soft)} .number{text-align:right}
tr.bad td{background:var(--bad)} tr.other td,.mark{background:var(--other)} .mark{padding:0 .4em}
tr.bad td:first-child{box-shadow:inset 3px 0 var(--bad-edge)}
.says{width:100%;table-layout:fixed;margin:.6em 0} .says th:first-child{width:24%}
.says div{max-height:9em;overflow:auto;white-space:pre-wrap}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.1em 1em;max-width:70em;font-size:13px;color:var(--soft)}
dt{font-weight:600} dd{margin:0} .filters{position:absolute;width:0;height:0}
@media (max-width:600px){.controls{position:static} .controls input{width:7em} body{padding:0 .7em}
td,th{padding:3px 7px} .says td:first-child{font-size:13px}
dl{grid-template-columns:1fr} dd{margin-bottom:.4em}}
</style>
)";

// The exposure filter is a table of 256 entries, which browsers apply exactly (rounding down); their
// linear-light filters round to 8 linear bits.
const char* const script = R"(<script>
const linear = v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4;
const encoded = v => v <= .0031308 ? v * 12.92 : 1.055 * v ** (1 / 2.4) - .055;
const filterBy = (name, stops) => {
  const table = Array.from({length: 256}, (_, i) => 
    (Math.round(255 * Math.min(1, encoded(linear(i / 255) * 2 ** stops))) + .1) / 255).join(" ");
  for (const channel of document.getElementById(name).firstElementChild.children) channel.setAttribute("tableValues", table);
};
for (const controls of document.querySelectorAll(".controls")) {
  const section = controls.closest("section"), pair = document.getElementById(controls.dataset.for);
  const top = pair.querySelector(".a"), divider = pair.querySelector(".divider");
  const [left, right] = pair.querySelectorAll(".which"), range = controls.querySelector(".where");
  const stops = controls.querySelector(".stops"), output = controls.querySelector("output");
  let state = "slider", swapped = false, dragged = false, from = null;
  const draw = () => {
    const shows = pair.dataset.shows = state === "swap" ? (swapped ? "b" : "a") : state;
    top.style.visibility = shows === "b" ? "hidden" : "visible";
    top.style.clipPath = shows === "slider" ? `inset(0 ${100 - range.value}% 0 0)` : "none";
    divider.style.left = range.value + "%";
    divider.hidden = shows !== "slider";
    left.textContent = shows === "slider" ? "A" : {a: "A: judged", b: "B: reference"}[shows];
    right.textContent = shows === "slider" ? "B" : "";
    for (const button of controls.querySelectorAll("[data-show]"))
      button.setAttribute("aria-pressed", button.dataset.show === shows);
  };
  const show = what => { state = what; draw(); };
  const swap = () => { swapped = state === "swap" ? !swapped : pair.dataset.shows !== "b"; show("swap"); };
  const divide = at => { range.value = at; show("slider"); };
  const frames = controls.querySelector("[data-frame]");
  const frame = () => {
    if (frames) frames.setAttribute("aria-pressed", !section.classList.toggle("unframed"));
  };
  const expose = value => {
    if (!stops) return;
    stops.value = value;
    const by = Number(stops.value), parts = section.dataset;
    output.textContent = `${by < 0 ? "\u2212" : "+"}${Math.abs(by).toFixed(2)} stops`;
    parts.exposed = by < 0 ? "darker" : by > 0 ? "brighter" : "base";
    filterBy("expose-base", by);
    filterBy("expose-highlights", by - parts.highlights);
    filterBy("expose-shadows", by - parts.shadows);
  };
  for (const button of controls.querySelectorAll("[data-show]"))
    button.addEventListener("click", () => button.dataset.show === "swap" ? swap() : show(button.dataset.show));
  range.addEventListener("input", () => show("slider"));
  if (frames) frames.addEventListener("click", frame);
  if (stops) {
    stops.addEventListener("input", () => expose(stops.value));
    controls.querySelector("[data-reset]").addEventListener("click", () => expose(0));
  }
  pair.tabIndex = 0;
  pair.addEventListener("pointerenter", () => pair.focus({preventScroll: true}));
  pair.addEventListener("pointerdown", event => {
    if (event.button === 0) { from = event.clientX; dragged = false; }
  });
  addEventListener("pointermove", event => {
    if (from === null || (!dragged && Math.abs(event.clientX - from) < 4)) return;
    dragged = true;
    const box = pair.getBoundingClientRect();
    divide((event.clientX - box.left) / box.width * 100);
  });
  for (const end of ["pointerup", "pointercancel"]) addEventListener(end, () => { from = null; });
  pair.addEventListener("click", () => { if (!dragged) swap(); dragged = false; });
  const keys = {" ": swap, a: () => show("a"), b: () => show("b"), s: () => show("slider"), f: frame,
    ArrowLeft: () => divide(Number(range.value) - 1), ArrowRight: () => divide(Number(range.value) + 1),
    "+": () => expose(Number(stops?.value) + .5), "-": () => expose(Number(stops?.value) - .5), "0": () => expose(0)};
  keys["="] = keys["+"];
  pair.addEventListener("keydown", event => {
    const act = !event.ctrlKey && !event.metaKey && !event.altKey && keys[event.key.length > 1 ? event.key : event.key.toLowerCase()];
    if (act) { event.preventDefault(); act(); }
  });
  draw();
  expose(0);
}
</script>
)";

} // namespace marram::page
