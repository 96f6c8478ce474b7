// SPDX-License-Identifier: Apache-2.0
// The live view: camera, meshes, sky, light, and the drawing of one picture. Meshes and sky by three.js, strands by strands.js in the
// same context.
import {state, on, emit, byId, remembered, remember, notice} from "./state.js";
import {view_of} from "./net.js";
import {mesh_vertex, mesh_fragment, sky_vertex, sky_fragment} from "./shaders.js";
import {Strands} from "./strands.js";
import {Density} from "./density.js";

const THREE = window.THREE;
const outline_share = 0.94;   // the film's frame takes this share of the view
const max_pixels = {hardware: 3840 * 2160, software: 1920 * 1080};

const min_lit_vertices = 2000;   // meshes of more are lit at their vertices by software GL

export const world = {
  strands: null, camera: null, controls: null, renderer: null, exposure: 0, frame: null,
  draw_overlay: null,        // draws over the strands: (camera, height of the view in pixels of the page)
  dirty: true, home: true,   // home: the camera is the scene's
};
let canvas, gl, scene3, meshes = [], sky, density, multisampled = false, drawn_size = [0, 0];

// While the camera moves on a slow machine, only each so many-th strand is drawn.
const motion = {moved: -Infinity, drawn: 0, every: 1, drawn_every: 1};
const camera_rest_ms = 250, slow_ms = 80, fast_ms = 28, min_moving_strands = 6000;
function strands_while_moving(now) {
  if (now - motion.moved > camera_rest_ms) return 1;
  const passed = now - motion.drawn;
  if (passed < 1500 && motion.drawn_every === motion.every) {
    if (passed > slow_ms && world.strands.shown / motion.every >= 2 * min_moving_strands) motion.every *= 2;
    else if (passed < fast_ms) motion.every = Math.max(1, motion.every / 2);
  }
  return motion.every;
}

const shared = {   // uniforms of all materials
  eye: {value: new THREE.Vector3()}, sun_direction: {value: new THREE.Vector3(0, 1, 0)}, sun_color: {value: new THREE.Vector3()},
  sky_color: {value: new THREE.Vector3(0.4, 0.5, 0.7)}, ground_color: {value: new THREE.Vector3(0.15, 0.14, 0.12)}, exposure: {value: 0},
  value_range: {value: new THREE.Vector2(0, 1)}, value_given: {value: new THREE.Vector2(0, 1)},
  density: {value: null}, density_lower: {value: new THREE.Vector3()}, density_scale: {value: new THREE.Vector3(1, 1, 1)},
};

// Whether WebGL runs on the processor: then antialiasing costs more than it gives.
function is_software() {
  const test = document.createElement("canvas").getContext("webgl2");
  if (!test) return null;
  const info = test.getExtension("WEBGL_debug_renderer_info");
  const name = test.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : test.RENDERER);
  test.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|softpipe/i.test(name);
}

export function start_world() {
  const software = is_software();
  if (software === null) {
    notice("This browser has no WebGL 2, which the live view needs.", true);
    return false;
  }
  state.software = software;
  canvas = byId("gl");
  gl = canvas.getContext("webgl2", {antialias: !software, alpha: false, depth: true, stencil: false, powerPreference: "high-performance"});
  multisampled = gl.getParameter(gl.SAMPLES) > 1;
  world.renderer = new THREE.WebGLRenderer({canvas, context: gl});
  world.renderer.autoClear = false;
  world.renderer.info.autoReset = true;
  scene3 = new THREE.Scene();
  world.camera = new THREE.PerspectiveCamera(40, 1, 0.1, 1000);
  world.camera.matrixAutoUpdate = true;
  density = new Density(shared);
  world.strands = new Strands(gl, world.renderer);
  make_sky();
  make_controls();
  canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); notice("The graphics driver lost the picture. Reload the page if it does not come back.", true); });
  canvas.addEventListener("webglcontextrestored", () => location.reload());
  new ResizeObserver(resize).observe(byId("live"));
  resize();
  return true;
}

function material(vertex, fragment, uniforms, more = {}) {
  return new THREE.RawShaderMaterial({vertexShader: vertex, fragmentShader: fragment, uniforms: {...shared, ...uniforms},
    side: THREE.DoubleSide, ...more});
}

function make_sky() {
  const geometry = new THREE.PlaneBufferGeometry(2, 2, 40, 24);   // lit at its vertices
  const ray = () => ({value: new THREE.Vector3()});
  sky = new THREE.Mesh(geometry, material(sky_vertex, sky_fragment, {ray_center: ray(), ray_x: ray(), ray_y: ray()},
    {depthWrite: false, depthTest: true}));
  sky.frustumCulled = false;
  sky.renderOrder = 1;   // after the meshes: only where nothing is in front
  scene3.add(sky);
}

function make_controls() {
  if (world.controls) world.controls.dispose();
  const controls = world.controls = new THREE.OrbitControls(world.camera, byId("live"));
  controls.enableKeys = false;
  controls.screenSpacePanning = true;
  controls.zoomSpeed = 0.7;
  controls.addEventListener("change", () => {
    if (world.quiet) return;
    world.home = false;
    motion.moved = performance.now();
    moved();
  });
}

function moved() {
  world.dirty = true;
  name_outline();
  remember("camera", {home: world.home, position: world.camera.position.toArray(), target: world.controls.target.toArray(),
    up: world.camera.up.toArray(), fov: world.fov, file: state.scene && state.scene.file});
  emit("camera");
}

// fov of the film's frame; the view sees more around it.
function set_camera(position, target, up, fov) {
  world.quiet = true;
  const turned = world.camera.up.distanceTo(new THREE.Vector3(...up)) > 1e-6;
  world.camera.position.set(...position);
  world.camera.up.set(...up);
  if (turned) make_controls();
  world.controls.target.set(...target);
  world.fov = fov;
  update_fov();
  world.controls.update();
  world.quiet = false;
}

export function go_home() {
  const camera = state.scene && state.scene.camera;
  if (!camera) return;
  set_camera(camera.position, camera.target, camera.up, camera.fov);
  world.home = true;
  moved();
}

export function frame_all() {
  const bounds = world.strands.bounds() || (state.scene && state.scene.bounds);
  if (!bounds) return;
  const lower = new THREE.Vector3(...bounds.lower), upper = new THREE.Vector3(...bounds.upper);
  const center = lower.clone().add(upper).multiplyScalar(0.5), radius = Math.max(1e-4, upper.distanceTo(lower) / 2);
  const way = world.camera.position.clone().sub(world.controls.target).normalize();
  const half = Math.tan(world.camera.fov * Math.PI / 360) * Math.min(1, world.camera.aspect);
  set_camera(center.clone().addScaledVector(way, 0.85 * radius / Math.sin(Math.atan(half))).toArray(), center.toArray(),
    world.camera.up.toArray(), world.fov);
  world.home = false;
  moved();
}

function update_fov() {
  const size = state.scene ? state.scene.camera.size : [16, 9], shape = size[0] / size[1];
  const width = byId("live").clientWidth, height = byId("live").clientHeight;
  const frame_height = outline_share * Math.min(height, width / shape);
  world.camera.aspect = width / Math.max(1, height);
  world.camera.fov = Math.min(175, 360 / Math.PI * Math.atan(Math.tan((world.fov || 40) * Math.PI / 360) * height / Math.max(1, frame_height)));
  world.camera.updateProjectionMatrix();
  const outline = byId("outline"), style = outline.style;
  outline.hidden = !state.scene;
  style.width = frame_height * shape + "px";
  style.height = frame_height + "px";
  style.left = (width - frame_height * shape) / 2 + "px";
  style.top = (height - frame_height) / 2 + "px";
  name_outline();
}
function name_outline() {
  const size = state.scene ? state.scene.camera.size : [16, 9];
  byId("outline").firstElementChild.textContent = world.home ? `camera of the scene, ${size[0]} × ${size[1]}` : "";
}

function resize() {
  const box = byId("live"), width = box.clientWidth, height = box.clientHeight;
  if (!width || !height) return;
  const most = state.software ? max_pixels.software : max_pixels.hardware;
  const ratio = Math.min(window.devicePixelRatio, 2, Math.sqrt(most / (width * height)));
  world.renderer.setPixelRatio(ratio);
  world.renderer.setSize(width, height, false);
  drawn_size = [canvas.width, canvas.height];
  update_fov();
  world.dirty = true;
  emit("camera");
}

// Near plane: as far as can be, as depth is finest then. A point at distance z is resolved to z^2 / (near 2^24).
function set_planes() {
  const camera = world.camera, to_target = camera.position.distanceTo(world.controls.target);
  const bounds = state.scene && state.scene.bounds;
  let outside = 0, reach = 10 * to_target;
  if (bounds) {
    const box = new THREE.Box3(new THREE.Vector3(...bounds.lower), new THREE.Vector3(...bounds.upper));
    const strands = world.strands.bounds();
    const near_box = strands ? new THREE.Box3(new THREE.Vector3(...strands.lower), new THREE.Vector3(...strands.upper)).union(box) : box;
    outside = near_box.distanceToPoint(camera.position);
    reach = Math.max(reach, 2 * (near_box.getSize(new THREE.Vector3()).length() + outside));
  }
  for (const mesh of meshes) reach = Math.max(reach, 2 * (mesh.reach + camera.position.length()));
  camera.near = Math.max(0.01 * to_target, 0.3 * outside);
  camera.far = reach + camera.near;
  camera.updateProjectionMatrix();
}

// The mesh's shadow on itself is left out by looking up light this far away from it.
function set_light(light) {
  shared.sun_direction.value.set(...(light.sun ? light.sun.direction : [0, 1, 0])).normalize();
  shared.sun_color.value.set(...(light.sun ? light.sun.color : [0, 0, 0]));
  shared.sky_color.value.set(...light.sky);
  shared.ground_color.value.set(...light.ground);
  density.changed = true;
}

export function set_exposure(stops) {
  world.exposure = shared.exposure.value = stops;
  world.dirty = true;
}

on("scene", scene => {
  const first = world.fov === undefined, camera = scene.camera;
  const saved = first ? remembered("camera", null) : null;
  if (saved && saved.file === scene.file && !saved.home) {
    set_camera(saved.position, saved.target, saved.up, saved.fov);
    world.home = false;
  } else if (first || world.home) set_camera(camera.position, camera.target, camera.up, camera.fov);
  set_light(scene.light);
  if (world.scene_exposure !== scene.exposure) set_exposure(world.scene_exposure = scene.exposure);
  update_fov();
  world.dirty = true;
  emit("camera");
});

on("meshes", (header, payload) => {
  for (const mesh of meshes) { scene3.remove(mesh); mesh.geometry.dispose(); mesh.material.dispose(); }
  meshes = header.meshes.map(from => {
    const geometry = new THREE.BufferGeometry();
    const positions = view_of(payload, Float32Array, from.positions, 3 * from.vertices);
    const put = (name, values) => geometry.setAttribute(name, new THREE.BufferAttribute(values, 3));
    put("position", positions);
    put("normal", from.normals >= 0 ? view_of(payload, Float32Array, from.normals, 3 * from.vertices) : new Float32Array(positions));
    const by_vertex = state.software && from.vertices > min_lit_vertices;
    geometry.setIndex(new THREE.BufferAttribute(view_of(payload, Uint32Array, from.indices, 3 * from.triangles), 1));
    if (by_vertex && !(from.normals >= 0)) geometry.computeVertexNormals();
    const mesh = new THREE.Mesh(geometry, material(mesh_vertex(by_vertex), mesh_fragment(by_vertex), {albedo: {value: new THREE.Vector3(...from.color)},
      value_mode: {value: 0}, facetted: {value: from.normals >= 0 ? 0 : 1}, shadow_offset: density.cell}));
    mesh.frustumCulled = false;
    mesh.matrixAutoUpdate = false;
    const box = new THREE.Box3().setFromArray(positions);
    mesh.reach = from.vertices ? box.getSize(new THREE.Vector3()).length() + box.getCenter(new THREE.Vector3()).length() : 0;
    scene3.add(mesh);
    return mesh;
  });
  density.set_bodies(meshes);
  world.dirty = true;
});

on("strands", (header, payload) => {
  world.strands.select(header, payload);
  world.frame = null;
});

const mode_of_values = () => world.values?.classes ? 2 : 1;
function set_mesh_values(header, payload) {
  const given = header.values ? [header.values.lower, header.values.upper] : [0, 0];
  shared.value_given.value.set(...given);
  for (const mesh of meshes) mesh.material.uniforms.value_mode.value = 0;
  for (const {index, offset} of header.mesh_values || []) {
    const mesh = meshes[index];
    if (!mesh) continue;
    const count = mesh.geometry.attributes.position.count, steps = view_of(payload, Uint16Array, offset, count);
    if (!mesh.geometry.attributes.value) mesh.geometry.setAttribute("value", new THREE.BufferAttribute(new Float32Array(count), 1));
    const attribute = mesh.geometry.attributes.value;
    steps.forEach((step, vertex) => { attribute.array[vertex] = step / 65535; });
    attribute.needsUpdate = true;
    mesh.material.uniforms.value_mode.value = mode_of_values();
  }
}

// Called by the player for frames that are to be shown.
export function show_frame(header, payload) {
  if (header.selection !== world.strands.selection) return false;
  world.strands.update(header, payload);
  for (const moved_mesh of header.meshes || []) {
    const mesh = meshes[moved_mesh.index];
    if (!mesh) continue;
    for (const [name, offset] of [["position", moved_mesh.positions], ["normal", moved_mesh.normals]]) {
      const attribute = mesh.geometry.attributes[name];
      if (!(offset >= 0)) continue;
      attribute.array.set(view_of(payload, Float32Array, offset, attribute.array.length));
      attribute.needsUpdate = true;
    }
    mesh.geometry.boundingSphere = mesh.geometry.boundingBox = null;   // three.js computes them again for rays
  }
  set_mesh_values(header, payload);
  world.frame = header.frame;
  world.dirty = true;
  density.changed = true;
  return true;
}

const to_clip = new THREE.Matrix4();
function set_shading(context, uniforms) {
  for (const name of ["eye", "sun_direction", "sun_color", "sky_color", "ground_color", "density_lower", "density_scale"])
    if (uniforms[name]) context.uniform3fv(uniforms[name], shared[name].value.toArray());
  context.uniform1f(uniforms.exposure, shared.exposure.value);
  context.activeTexture(context.TEXTURE0);
  context.bindTexture(context.TEXTURE_3D, world.renderer.properties.get(shared.density.value).__webglTexture);
  context.uniform1i(uniforms.density, 0);
}

world.meshes = () => meshes;
world.redraw = () => { world.dirty = true; draw_world(performance.now()); };
export function draw_world(now) {
  if (motion.drawn_every > 1 && now - motion.moved > camera_rest_ms) world.dirty = true;
  if (!world.dirty || document.hidden || !drawn_size[0]) return false;
  world.dirty = false;
  const every = motion.drawn_every = strands_while_moving(now);
  motion.drawn = now;
  draw_all(now, every);
  return true;
}

function draw_all(now, every) {
  density.update(world.strands, now);
  const camera = world.camera;
  set_planes();
  camera.updateMatrixWorld();
  const half = Math.tan(camera.fov * Math.PI / 360), e = camera.matrixWorld.elements, u = sky.material.uniforms;
  u.ray_x.value.set(e[0], e[1], e[2]).multiplyScalar(half * camera.aspect);
  u.ray_y.value.set(e[4], e[5], e[6]).multiplyScalar(half);
  u.ray_center.value.set(-e[8], -e[9], -e[10]);
  shared.eye.value.copy(camera.position);
  const range = world.values ? [world.values.lower, world.values.upper] : [0, 1];
  shared.value_range.value.set(...range);
  world.renderer.clear();
  world.renderer.render(scene3, camera);
  to_clip.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
  world.strands.draw({to_clip: new Float32Array(to_clip.elements), pixels: drawn_size, pixel_scale: drawn_size[1] / (2 * half),
    multisampled, every, value_mode: mode_of_values(), value_range: range, set_shading});
  world.renderer.state.reset();
  world.draw_overlay?.(camera, byId("live").clientHeight);
}

// The camera as the server's path tracer wants it, for a picture of the whole view.
export function camera_message() {
  return {position: world.camera.position.toArray(), target: world.controls.target.toArray(), up: world.camera.up.toArray(),
    fov: world.camera.fov};
}
