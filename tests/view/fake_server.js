// SPDX-License-Identifier: Apache-2.0
// A WebSocket that answers as the program does, with a lawn of bending strands: the page can be tried without the program.
(() => {
  const seeded = seed => () => { seed = (seed * 1664525 + 1013904223) >>> 0; return seed / 4294967296; };
  const cvs = 6, total = 423000, frames = [1, 96];
  const parameter = (key, type, value, more = {}) => ({key, label: key.split(".").pop(), type, unit: "", min: null, max: null, choices: [], help: `The ${key} of this stand-in.`,
    file_value: value, value, initial: value, given: false, changed: false, keyable: false, keyed: false, ...more});
  // Values as texts of TOML, and back: enough for what the page writes.
  const toml = value => Array.isArray(value) ? `[${value.map(toml).join(", ")}]`
    : typeof value === "object" ? `{ ${Object.entries(value).map(([name, one]) => `${name} = ${toml(one)}`).join(", ")} }` : JSON.stringify(value);
  const plain = text => JSON.parse(text.replace(/([\w.]+) = /g, '"$1": '));
  const types = {shape: "choice", transform: "keys"};
  const element_params = (list, elements) => elements.flatMap((element, i) => Object.entries({strength: 1, ...element}).map(([name, value]) =>
    parameter(`${list}[${i}].${name}`, types[name] || "number", toml(value), {given: name in element, label: `${list.slice(5)}[${i}].${name}`,
      choices: name === "shape" ? ["sphere", "box"] : [], keyed: !!value.keys})));
  const groups = [
    {title: "wind", params: [
      parameter("wind.speed", "number", "8", {unit: "m/s", min: 0, max: 200, given: true, initial: "0", help: "Speed of the wind, which response turns into strength. Strands bend more in faster wind."}),
      parameter("wind.direction", "vec3", "[1, 0, -0.25]", {given: true}), parameter("wind.global_rotate", "number", "0.65", {min: 0, max: 1, given: true}),
      parameter("wind.calm", "number", "0.35", {min: 0, max: 1}), parameter("wind.waviness", "number", "0.6", {min: 0, max: null}),
      parameter("wind.response", "ramp", "[[0, 0], [12, 1]]", {given: true, min: 0}), parameter("wind.ramp_rotate", "ramp", '{ knots = [[0, 0.25], [0.5, 0.4], [1, 1]], interpolation = "smooth" }'),
      parameter("wind.noise.frequency", "number", "0.45", {unit: "1/m", min: 0.001, max: 1000}), parameter("wind.noise.octaves", "integer", "3", {min: 1, max: 12}),
      parameter("wind.gusts.radius_range", "range", "[1.5, 3]", {unit: "m", min: 0}),
      ...element_params("wind.gusts.control", [
        {shape: "sphere", transform: {keys: [{frame: 1, translate: [-2, 1.6, 1], scale: [0.9, 0.9, 0.9]}, {frame: 96, translate: [2.5, 1.6, 1], scale: [0.9, 0.9, 0.9]}]}},
        {shape: "box", transform: {translate: [2.2, 0.9, 0.5], rotate: [0, 25, 0], scale: [1, 0.6, 0.8]}, strength: 0.5}]),
      ...element_params("wind.field", [{shape: "sphere", swirl: 2, transform: {translate: [-2.4, 0.7, 1.5], scale: [0.6, 0.6, 0.6]}}]),
      parameter("wind.over", "reference", "none", {initial: "none", help: "Name of the terrain that the wind flows over."})]},
    {title: "grass", params: [
      parameter("grass.density", "number", "1500", {unit: "1/m²", min: 0}), parameter("grass.length", "range", "[0.18, 0.42]", {unit: "m", min: 0, given: true}),
      parameter("grass.shape", "choice", '"ribbon"', {choices: ["round", "ribbon", "flat"]}), parameter("grass.seed", "integer", "3", {min: 0, max: 4294967295}),
      parameter("grass.on", "reference", '"hill"', {given: true})]},
    {title: "material blade", params: [parameter("blade.root_color", "color", "[0.1, 0.16, 0.03]", {min: 0}), parameter("blade.tip_color", "color", "[0.4, 0.56, 0.1]", {min: 0, given: true}),
      parameter("blade.two_sided", "boolean", "true"), parameter("blade.note", "text", '"meadow"')]},
    {title: "camera", params: [parameter("camera.position", "vec3", "[-1.2, 1.15, 8.6]", {unit: "m"}), parameter("camera.fov", "number", "36", {unit: "deg", min: 0.01, max: 179}),
      parameter("camera.path", "keys", '[{ frame = 1, translate = [0, 0, 0] }]'), parameter("camera.roll", "number", "{ keys = [[1, 0], [48, 20]] }", {keyable: true, keyed: true, unit: "deg"})]},
  ];
  let ridge = [-3, 1.2, -1, -1.5, 1.9, -1, 0, 2.4, -1.5, 1.5, 1.9, -1];   // a drawn curve
  const find = key => groups.flatMap(group => group.params).find(param => param.key === key);
  const num = key => Number(find(key).value);
  let revision = 1, selection = 0, cache = null;
  const undos = [], redos = [];
  const state_text = () => JSON.stringify({groups, ridge, lists: [...lists]}), lists = new Map();   // lists: texts that replace whole lists
  function restore(text) {
    const from = JSON.parse(text);
    groups.splice(0, groups.length, ...from.groups);
    ridge = from.ridge;
    lists.clear();
    for (const [key, value] of from.lists) lists.set(key, value);
  }
  function set_list(list, text) {
    const others = groups[0].params.filter(param => !param.key.startsWith(list + "[")), at = others.findIndex(param => param.key === "wind.over");
    others.splice(at, 0, ...element_params(list, plain(text)));
    groups[0].params = others;
    lists.set(list, text);
  }
  function handles() {
    const found = groups[0].params.filter(param => param.key.endsWith(".transform")).map(({key, value}) => {
      const [, list, index] = /^(.*)\[(\d+)\]/.exec(key), given = plain(value), keys = given.keys || [{frame: 1, ...given}];
      return {key, list, index: Number(index), kind: list === "wind.field" ? "field" : "gust", shape: JSON.parse(find(`${list}[${index}].shape`).value), inner: null,
        keys: keys.flatMap(one => [one.frame, ...(one.translate || [0, 0, 0]), ...(one.rotate || [0, 0, 0]), ...(one.scale || [1, 1, 1])]),
        interpolation: given.interpolation || "linear"};
    });
    return [...found, {key: "curves.ridge.points", kind: "points", points: ridge, closed: false}];
  }
  const sum = Math.sin;
  const height = (x, z) => 1.6 * Math.exp(-(x * x + z * z) / 14) + 0.1 * sum(x * 1.3) * Math.cos(z * 1.7);
  function scene() {
    return {type: "scene", revision, file: "/scenes/lawn.toml", fps: 24, frames, seconds_per_frame: 1 / 24,
      camera: {position: [-1.2, 1.35, 7.6], target: [0.2, 1.1, 0], up: [0, 1, 0], fov: 36, size: [1280, 720]}, exposure: 0.4,
      light: {sun: {direction: [-0.76, 0.36, -0.54], color: [1.5, 1.25, 0.95]}, sky: [0.32, 0.42, 0.62], ground: [0.12, 0.11, 0.08]},
      layers: ["beauty", "albedo", "normal", "depth"], bounds: {lower: [-8, -0.2, -8], upper: [8, 2.2, 8]}, groups, handles: handles(),
      values: [{name: "gust", help: "sum of the gusts", discrete: false}, {name: "contact", help: "0 nothing, 1 contact", discrete: true}],
      changes: [...groups.flatMap(group => group.params).filter(param => param.changed).map(param => `${param.key}=${param.value}`), ...[...lists].map(([key, text]) => `${key}=${text}`)],
      undo: undos.length > 0, redo: redos.length > 0, warnings: []};
  }
  function packed(header, parts) {
    let text = JSON.stringify(header);
    while ((4 + text.length) % 8) text += " ";
    const size = parts.reduce((sum, part) => sum + part.byteLength, 0), buffer = new ArrayBuffer(4 + text.length + size), bytes = new Uint8Array(buffer);
    new DataView(buffer).setUint32(0, text.length, true);
    bytes.set(new TextEncoder().encode(text), 4);
    let at = 4 + text.length;
    for (const part of parts) { bytes.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength), at); at += part.byteLength; }
    return buffer;
  }
  function meshes() {
    const n = 96, positions = new Float32Array(3 * (n + 1) ** 2), indices = [];
    for (let j = 0; j <= n; ++j) for (let i = 0; i <= n; ++i) {
      const x = 16 * i / n - 8, z = 16 * j / n - 8;
      positions.set([x, height(x, z), z], 3 * (j * (n + 1) + i));
      if (i < n && j < n) { const v = j * (n + 1) + i; indices.push(v, v + n + 1, v + 1, v + 1, v + n + 1, v + n + 2); }
    }
    const ints = new Uint32Array(indices);
    return packed({type: "meshes", revision, meshes: [{name: "hill", color: [0.1, 0.075, 0.045], vertices: positions.length / 3, triangles: ints.length / 3, positions: 0, normals: -1, indices: positions.byteLength}]}, [positions, ints]);
  }
  function select(budget) {
    const random = seeded(7), count = budget, stride = cvs + 2, attributes = new Uint8Array(4 * stride * count);
    const roots = Array.from({length: count}, () => {
      const x = 12 * random() - 6, z = 12 * random() - 6;
      return {x, z, y: height(x, z), length: 0.18 + 0.24 * random(), phase: 6 * random(), lean: random() - 0.5, lean2: random() - 0.5, byte: Math.floor(256 * random())};
    });
    for (let s = 0; s < count; ++s) for (let v = 0; v < stride; ++v) {
      const u = Math.min(1, Math.max(0, (v - 1) / (cvs - 1)));
      attributes.set([255 * u, 255 * (u < 0.35 ? 0.8 + 0.2 * u / 0.35 : 1 - (u - 0.35) / 0.65), v < cvs - 1 ? 255 : 0, roots[s].byte], 4 * (s * stride + v));
    }
    const part = {name: "grass", basis: "bspline", of: total, strands: count, widen: Math.min(4, Math.sqrt(total / count)), radius: 0.0045,
      root_color: JSON.parse(find("blade.root_color").value), tip_color: JSON.parse(find("blade.tip_color").value), vertices: stride * count, attributes: 0};
    cache = {budget, roots, stride, selection: ++selection, message: packed({type: "strands", selection, parts: [part]}, [attributes])};
  }
  function frame(request) {
    const budget = Math.min(request.budget, total), out = [], start = performance.now();
    if (!cache || cache.budget !== budget || cache.revision !== revision) { select(budget); cache.revision = revision; out.push(cache.message); }
    const {roots, stride} = cache, n = roots.length * stride, floats = new Float32Array(3 * n), speed = num("wind.speed"), time = request.frame / 24;
    let at = 0;
    for (const root of roots) {
      const gust = 0.5 + 0.5 * Math.sin(0.8 * root.x - 2.2 * time + 0.6 * Math.sin(root.z)), bend = Math.min(1.3, speed / 12 * (0.35 + gust)) + 0.1 * Math.sin(9 * time + root.phase);
      for (let v = -1; v <= cvs; ++v) {
        const u = v / (cvs - 1), s = u * root.length, angle = bend * u * 0.9, side = root.length * u * u;
        floats[at++] = root.x + s * Math.sin(angle) + root.lean * side; floats[at++] = root.y + s * Math.cos(angle); floats[at++] = root.z + root.lean2 * side - 0.2 * s * angle;
      }
    }
    const chunk = {first_vertex: 0, vertices: n, offset: 0};
    let payload = floats;
    if (request.encoding === "u16") {
      chunk.lower = [-8, -1, -8];
      chunk.step = [16 / 65535, 4 / 65535, 16 / 65535];
      payload = new Uint16Array(3 * n + (3 * n & 1));
      for (let i = 0; i < 3 * n; ++i) payload[i] = Math.round(Math.min(65535, Math.max(0, (floats[i] - chunk.lower[i % 3]) / chunk.step[i % 3])));
    }
    const more = {}, value = new Uint16Array(n + (n & 1));
    if (request.values) {
      for (let i = 0; i < n; ++i) value[i] = request.values === "gust" ? 65535 * (i % stride) / stride : 65535 * (i % 3 === 0);
      chunk.values = payload.byteLength;
      more.values = {name: request.values, lower: 0, upper: request.values === "gust" ? 1.5 : 2};
    }
    out.push(packed({...more, type: "frame", seq: request.seq, frame: request.frame, revision, selection: cache.selection, chain_ms: performance.now() - start, other_ms: 1, parts: [{chunks: [chunk]}], meshes: [],
      gusts: [{center: [(request.frame / 12) % 8 - 4, 1, -1], radius: 0.8, strength: 1}, {center: [3 - (request.frame / 20) % 6, 0.6, 2.4], radius: 0.5, strength: 0.4}]}, request.values ? [payload, value] : [payload]));
    return out;
  }
  const as_in_file = state_text();
  const log = window.fake_log = [];
  window.fake_frame = frame;
  window.WebSocket = class {
    constructor(url) { this.url = url; this.readyState = 0; setTimeout(() => this.open(), 20); window.fake_socket = this; }
    open() {
      if (window.fake_gone) { this.readyState = 3; this.onclose?.({}); return; }
      this.readyState = 1;
      this.onopen?.({});
      this.give(JSON.stringify(scene()));
      this.give(meshes());
    }
    give(data, after = 0) { setTimeout(() => { if (this.readyState === 1) this.onmessage?.({data}); }, after); }
    close() { this.readyState = 3; this.onclose?.({}); }
    send(text) {
      const request = JSON.parse(text);
      log.push(request);
      if (request.type === "frame") setTimeout(() => frame(request).forEach(data => this.give(data)), 2);
      if (request.type === "set") this.set(request.key, request.value, request.gesture);
      if (request.type === "reset") { restore(as_in_file); this.changed(); }
      if (request.type === "undo" && undos.length) { redos.push(state_text()); restore(undos.pop()); this.changed(); }
      if (request.type === "redo" && redos.length) { undos.push(state_text()); restore(redos.pop()); this.changed(); }
      if (request.type === "save") { for (const param of groups.flatMap(group => group.params)) { param.file_value = param.value; param.changed = false; } this.give('{"type":"saved","file":"/scenes/lawn.toml"}'); this.changed(); }
      if (request.type === "render") this.render(request);
      if (request.type === "stop") clearInterval(this.timer);
    }
    remember(gesture) {   // one step of undo a gesture
      redos.length = 0;
      if (!gesture || gesture !== this.gesture) undos.push(state_text());
      this.gesture = gesture;
    }
    set(key, value, gesture) {
      const param = find(key);
      if (!param) {
        this.remember(gesture);
        if (key === "curves.ridge.points") ridge = plain(value).flat();
        else set_list(key, value);
        this.changed();
        return;
      }
      if (value !== null && param.type === "number" && (Number(value) < (param.min ?? -Infinity) || Number(value) > (param.max ?? Infinity))) {
        this.give(JSON.stringify({type: "problems", problems: [{place: "lawn.toml:3:5", what: `${key} is ${value}`, fix: `write a number from ${param.min} to ${param.max}`}]}));
        return;
      }
      this.remember(gesture);
      this.apply(param, value ?? param.file_value);
      this.changed();
    }
    apply(param, value) { param.value = value; param.changed = value !== param.file_value; param.given = param.given || param.changed; }
    changed() { ++revision; this.give('{"type":"problems","problems":[]}'); this.give(JSON.stringify(scene())); }
    render(request) {
      clearInterval(this.timer);
      const [of_width, of_height] = request.size, [left, top, width, height] = request.crop || [0, 0, of_width, of_height], pixels = new Uint8Array(4 * width * height), start = performance.now();
      let samples = 0;
      this.timer = setInterval(() => {
        samples = Math.min(request.samples, samples ? 2 * samples : 1);
        for (let i = 0; i < width * height; ++i) {
          const x = (left + i % width) / of_width, y = (top + i / width) / of_height, noise = 90 * (Math.random() - 0.5) / Math.sqrt(samples);
          pixels.set([120 + 100 * x + noise, 140 - 60 * y + noise, 90 + 100 * (1 - x) * (1 - y) + noise, 255], 4 * i);
        }
        const seconds = (performance.now() - start) / 1000;
        this.give(packed({type: "image", seq: request.seq, width, height, x: left, y: top, of_width, of_height, samples, of: request.samples, seconds}, [pixels]));
        if (samples === request.samples) { clearInterval(this.timer); this.give(JSON.stringify({type: "render_done", seq: request.seq, samples, seconds})); }
      }, 60);
    }
  };
})();
