// SPDX-License-Identifier: Apache-2.0
// The panel at the right: groups of parameters, search, changes, problems.
import {state, on, byId, make, notice, remembered, remember} from "./state.js";
import {set_value, edits, command} from "./edits.js";
import {control_of, kind_of} from "./controls.js";

let groups = [];        // {title, details, rows_element, rows: Map key -> row, params, count}
let outline = "";       // titles and keys: the panel is built anew when they change
let open = new Set(remembered("open", null) || []), opened_before = remembered("open", null) !== null;
let hovered = null, search = "";

const keep_open = () => remember("open", [...open]);

function build(scene) {
  const searched = byId("search").value;
  if (!opened_before) {   // at first: the wind, or else the first group
    const wind = scene.groups.filter(group => /^wind\b/.test(group.title)).slice(0, 1);
    open = new Set((wind.length ? wind : scene.groups.slice(0, 1)).map(group => group.title));
    opened_before = true;
  }
  groups = scene.groups.map(from => {
    const count = make("span", {class: "count"}), rows_element = make("div", {class: "rows"});
    const details = make("details", {}, make("summary", {}, make("span", {}, from.title), count), rows_element);
    const group = {title: from.title, details, rows_element, rows: new Map(), params: from.params, count, built: false};
    details.open = open.has(from.title);
    details.addEventListener("toggle", () => {
      if (details.open) fill(group);
      if (search) return;
      if (details.open) open.add(group.title); else open.delete(group.title);
      keep_open();
    });
    return group;
  });
  byId("groups").replaceChildren(...groups.map(group => group.details), make("div", {class: "none", hidden: true}, "No parameter has this in its name or help."));
  for (const group of groups) if (group.details.open) fill(group);
  if (searched) filter(searched);
}

// Gusts and fields have the names that they have in the view.
function heading(prefix) {
  const [, list, index] = /^(gusts\.control|field)\[(\d+)\]/.exec(prefix) || [];
  return index === undefined ? [prefix] : [make("b", {}, `${list === "field" ? "field" : "gust"} ${Number(index) + 1}`), ` ${prefix}`];
}

// Rows are made when a group is first opened.
function fill(group) {
  if (group.built) return;
  group.built = true;
  let prefix = "";   // of names with dots: one heading for all that share it
  for (const param of group.params) {
    const label = param.label || param.key, dot = label.lastIndexOf("."), now = label.slice(0, Math.max(0, dot));
    if (now !== prefix && now) group.rows_element.append(make("div", {class: "sub"}, ...heading(now)));
    if (now !== prefix && !now) group.rows_element.append(make("div", {class: "sub", "aria-hidden": true}));
    prefix = now;
    group.rows_element.append(row_of(group, param, label.slice(dot + 1)).element);
  }
}

function row_of(group, param, name) {
  const row = {param, control: null};
  const dot = make("button", {class: "dot", tabindex: -1, onclick: () => set_value(row.param.changed_by || param.key, null)});
  const unit = param.unit ? [make("span", {class: "unit"}, param.unit)] : [];
  const parts = name.split("_").flatMap((part, i) => i ? ["_", make("wbr"), part] : [part]);   // a long name has two lines
  const label = make("span", {class: "label", title: name + (param.unit ? ` in ${param.unit}` : "")}, ...parts, ...unit);
  row.element = make("div", {class: "row", "data-key": param.key, onpointerenter: () => hint(row.param), onfocusin: () => hint(row.param)}, dot, label);
  row.dot = dot;
  row.update = next => {
    row.param = next;
    if (!row.control || row.control.kind !== kind_of(next)) {
      row.control?.element.remove();
      row.control = control_of(next, value => set_value(next.key, value));
      row.element.append(row.control.element);
      row.element.classList.toggle("tall", !!row.control.tall);
    } else row.control.update(next);
    row.element.classList.toggle("changed", next.changed);
    row.element.classList.toggle("given", next.given && !next.changed);
    dot.disabled = !next.changed;
    dot.tabIndex = next.changed ? 0 : -1;
    dot.title = next.changed ? "Back to the file's value" : next.given ? "In the file" : "";
    dot.setAttribute("aria-label", next.changed ? `${next.key} back to the file's value` : "");
  };
  row.update(param);
  group.rows.set(param.key, row);
  return row;
}

const no_limit = 1e8;   // limits beyond it only keep numbers finite
function hint(param) {
  if (!param) return;
  hovered = param.key;
  const facts = [];
  if (param.unit) facts.push(param.unit);
  const min = Math.abs(param.min ?? Infinity) < no_limit ? param.min : null, max = Math.abs(param.max ?? Infinity) < no_limit ? param.max : null;
  if (min !== null || max !== null) facts.push(max === null ? `at least ${min}` : min === null ? `at most ${max}` : `${min} to ${max}`);
  if (param.initial !== "") facts.push(`default ${param.initial}`);
  if (param.keyed) facts.push("changes in time");
  byId("hint").replaceChildren(make("p", {}, make("b", {}, param.key), facts.length ? ` · ${facts.join(" · ")}` : ""), make("p", {}, param.help));
}

function filter(text) {
  const was = search;
  search = text.trim().toLowerCase();
  const words = search.split(/\s+/).filter(Boolean);
  let found = 0;
  for (const group of groups) {
    let in_group = 0;
    const hits = group.params.map(param => {
      const all = `${group.title} ${param.key} ${param.label} ${param.help}`.toLowerCase();
      return words.every(word => all.includes(word));
    });
    if (words.length && hits.some(Boolean)) fill(group);
    group.params.forEach((param, index) => {
      const row = group.rows.get(param.key), hit = !words.length || hits[index];
      if (row) row.element.hidden = !hit;
      if (hit) ++in_group;
    });
    found += in_group;
    for (const sub of group.rows_element.querySelectorAll(".sub")) {
      let any = false;
      for (let row = sub.nextElementSibling; row && row.className !== "sub"; row = row.nextElementSibling) any = any || !row.hidden;
      sub.hidden = !any;
    }
    group.details.hidden = words.length > 0 && !in_group;
    if (words.length) group.details.open = in_group > 0;
    else if (was) { group.details.open = open.has(group.title); if (group.details.open) fill(group); }
  }
  const none = byId("groups").lastElementChild;
  if (none) none.hidden = !words.length || found > 0;
}

function update(scene) {
  const keys = JSON.stringify(scene.groups.map(group => [group.title, ...group.params.map(param => param.key + param.type)]));
  scene.groups.forEach((from, index) => { if (groups[index]) groups[index].params = from.params; });
  if (keys !== outline) {
    outline = keys;
    const top = byId("groups").scrollTop;
    build(scene);
    byId("groups").scrollTop = top;
  } else
    for (const group of groups)
      for (const param of group.params) group.rows.get(param.key)?.update(param);
  for (const group of groups) {
    const changed = group.params.filter(param => param.changed).length;
    group.count.textContent = changed ? `${changed} changed` : "";
    group.count.classList.toggle("changed", changed > 0);
  }
  const name = scene.file.split(/[\\/]/).pop(), count = scene.changes.length;
  byId("file").textContent = name + (count ? " •" : "");
  byId("file").title = scene.file;
  document.title = `${count ? "• " : ""}${name} – marram view`;
  byId("undo").disabled = !scene.undo;
  byId("redo").disabled = !scene.redo;
  for (const id of ["reset", "copy", "save"]) byId(id).disabled = !count;
  if (hovered) hint(groups.flatMap(group => group.params).find(param => param.key === hovered));
}

// Opens the group of a parameter and brings its row into sight.
export function reveal(key) {
  const group = groups.find(one => one.params.some(param => param.key === key));
  if (!group) return;
  group.details.open = true;
  fill(group);
  group.rows_element.querySelector(`.row[data-key="${CSS.escape(key)}"]`)?.scrollIntoView({block: "center"});
}

export function options_text() {
  const changes = state.scene ? state.scene.changes : [];
  return changes.map(change => `--set '${change.replaceAll("'", "'\\''")}'`).join(" ");
}
export async function copy() {
  const text = options_text();
  if (!text) return;
  try { await navigator.clipboard.writeText(text); }
  catch {
    const area = make("textarea", {readonly: true});
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  notice(`Copied: ${text.length > 90 ? text.slice(0, 90) + " ..." : text}`);
}

function show_problems(problems, mild = false) {
  const element = byId("problems");
  element.hidden = !problems.length;
  element.classList.toggle("mild", mild);
  element.classList.remove("read");
  element.replaceChildren(...problems.map(problem => make("p", {},
    ...(problem.place ? [`${problem.place}: `] : []), make(mild ? "span" : "b", {}, problem.what), ...(problem.fix ? [": ", make("span", {class: "fix"}, problem.fix)] : []))));
  for (const row of document.querySelectorAll(".row.wrong")) row.classList.remove("wrong");
  if (!problems.length || mild || !edits.last_key) return;
  // A mistake in the file is no fault of the value that was changed last, which is not taken, either.
  if (!problems.some(problem => problem.place.startsWith("--set") || problem.what.includes(edits.last_key))) { if (state.scene) update(state.scene); return; }
  document.querySelector(`.row[data-key="${CSS.escape(edits.last_key)}"]`)?.classList.add("wrong");
}

export function start_panel() {
  byId("problems").title = "Click to hide; warnings: click to read, again to hide";
  byId("problems").addEventListener("click", () => {
    const element = byId("problems");
    if (String(getSelection())) return;
    if (element.classList.contains("mild") && !element.classList.contains("read")) element.classList.add("read");
    else element.hidden = true;
  });
  byId("search").addEventListener("input", event => filter(event.target.value));
  byId("search").addEventListener("keydown", event => {
    if (event.key === "Escape") { event.target.value = ""; filter(""); event.target.blur(); }
    if (event.key === "Enter" || event.key === "ArrowDown")
      byId("groups").querySelector("details:not([hidden]) .row:not([hidden]) .control :is(input,select), details:not([hidden]) .row:not([hidden]) .ramp svg")?.focus();
  });
  for (const id of ["undo", "redo", "reset", "save"]) byId(id).onclick = () => command(id);
  byId("copy").onclick = copy;
  byId("hint").textContent = "Point at a parameter to read what it does. H shows the keys.";
  on("problems", message => {
    show_problems(message.problems);
    if (message.problems.length) return;
    if (state.scene && state.scene.warnings.length) show_problems(state.scene.warnings.map(what => ({place: "", what, fix: ""})), true);
  });
  on("saved", message => notice(`Saved ${message.file}`));
  let warned = "";
  on("scene", scene => {
    update(scene);
    const warnings = scene.warnings.join("\n");
    if (warnings !== warned && byId("problems").hidden || byId("problems").classList.contains("mild"))
      show_problems(scene.warnings.map(what => ({place: "", what, fix: ""})), true);
    warned = warnings;
  });
  on("closed", () => { for (const id of ["undo", "redo", "reset", "save"]) byId(id).disabled = true; });
}
