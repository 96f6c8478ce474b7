#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests the page of `marram view` without the program: fake_server.js answers in its place, so that what a program does not do on purpose
can be tried: lost connections, malformed messages, answers that come late.   tests/view/page_test.py [FOLDER OF THREE.JS]"""
import http.server
import json
import os
import shutil
import sys
import threading

sys.dont_write_bytecode = True
from browser import Browser, BrowserError
import browser_test
from browser_test import View, check

HERE = os.path.dirname(os.path.abspath(__file__))
PAGE = os.path.join(HERE, "../../core/view/page")


class Handler(http.server.SimpleHTTPRequestHandler):
    """The files of the page, as the program serves them."""
    three = "/usr/share/javascript/three"
    extensions_map = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}

    def translate_path(self, path):
        name = path.split("?")[0].split("/")[-1] or "index.html"
        if name == "three.min.js":
            return os.path.join(self.three, "build", name)
        if name.endswith("Controls.js"):
            return os.path.join(self.three, "examples/js/controls", name)
        return os.path.join(PAGE, name)

    def end_headers(self):
        self.send_header("Content-Security-Policy", "default-src 'self'; img-src 'self' data: blob:")
        self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, *_):
        pass


class FakedView(View):
    def __init__(self, browser, address):
        with open(os.path.join(HERE, "fake_server.js")) as file:
            fake = file.read()
        # Few strands: the tests wait for states, not for pictures.
        self.page = browser.open(address, "sessionStorage['marram.player'] ??= JSON.stringify({full: 2000});" + fake)
        self.page.wait_for("window.marram && marram.player.frames > 0", "the first frame")


def test_messages(view):
    before = len(view.page.warnings)
    view.js("fake_socket.give('{'); fake_socket.give('{\"type\":\"unknown\"}'); fake_socket.give('null'); fake_socket.give(new ArrayBuffer(2)); "
            "fake_socket.give(new Uint8Array([255, 255, 255, 255, 1, 2, 3, 4]).buffer)")
    view.wait("new Promise(done => setTimeout(() => done(true), 50))")
    ignored = [warning for warning in view.page.warnings[before:] if "ignored" in warning]
    check("malformed messages are ignored with a line each", len(ignored) == 5, f"{len(ignored)} of 5")
    frames = view.js("marram.player.frames")
    view.page.key("ArrowRight")
    check("and the page goes on", view.wait(f"marram.player.frames > {frames}"))


def test_requests(view):
    view.settle()
    view.js("fake_log.length = 0; window.most = 0; marram.on('shown', () => { most = Math.max(most, marram.player.unanswered()); })")
    view.view_focus()
    view.page.key(" ")
    view.wait("fake_log.filter(m => m.type === 'frame').length > 12")
    view.page.key(" ")
    check("at most two requests wait", view.js("most") <= 2)
    check("parts of frames are asked for while it plays", view.js("fake_log.some(m => m.type === 'frame' && !Number.isInteger(m.frame))"))
    check("with fewer bytes", view.js("fake_log.filter(m => m.type === 'frame').slice(3, 9).every(m => m.encoding === 'u16')"))
    check("at rest all strands are asked for", view.settle() and view.js("fake_log[fake_log.length - 1].budget === 2000"))
    shown = view.js("marram.world.frame")
    view.js("fake_socket.give(fake_frame({seq: 1, frame: 3, budget: 2000, encoding: 'u16'}).pop())")
    view.wait("new Promise(done => setTimeout(() => done(true), 50))")
    check("an answer that comes late is dropped", view.js("marram.world.frame") == shown)


def test_hidden(view):
    view.settle()
    hide = "Object.defineProperty(document, 'hidden', {value: %s, configurable: true}); document.dispatchEvent(new Event('visibilitychange'));"
    view.js(hide % "true" + "fake_log.length = 0; document.querySelector('#play').click()")
    view.wait("new Promise(done => { let n = 0; const next = () => ++n > 20 ? done(true) : requestAnimationFrame(next); next(); })")
    check("a hidden tab asks for nothing", view.js("fake_log.length") == 0)
    view.js(hide % "false")
    check("and goes on when it is shown", view.wait("fake_log.length > 3"))
    view.js("document.querySelector('#play').click()")


def test_sliders(view):
    row = view.open_row("wind.speed")
    view.settle()
    view.js("fake_log.length = 0")
    view.page.drag(row + " input[type=range]", (0.3, 0.5), (0.7, 0.5), steps=40)
    view.settle()
    log = view.js("fake_log.filter(m => m.type === 'set' || m.type === 'frame').map(m => m.type)")
    check("sets wait for frames", not any(a == b == "set" for a, b in zip(log, log[1:])), " ".join(log))
    last = view.js("fake_log.filter(m => m.type === 'set').pop().value")
    check("the newest value is sent last", float(last) == float(view.js(f"document.querySelector('{row} .number').value")))
    place = lambda: float(view.js(f"document.querySelector('{row} input[type=range]').value"))
    view.fill(row + " .number", "8")
    view.settle()
    before = place()
    view.fill(row + " .number", "150")
    check("a slider is widened for a value beyond it", view.wait(f"marram.player.idle() && marram.state.scene.groups[0].params[0].value === '150'") and place() <= 1000)
    view.fill(row + " .number", "8")
    view.wait("marram.player.idle() && marram.state.scene.groups[0].params[0].value === '8'")
    check("and as it was without it", place() == before, f"{place()} {before}")
    check("a gust has the same name in the panel", "gust 2 gusts.control[1]" in view.js("[...document.querySelectorAll('.sub')].map(s => s.textContent)"))
    view.fill(view.open_row("grass.seed") + " .number", "17")
    check("an integer is sent as such", view.wait("fake_log.some(m => m.key === 'grass.seed' && m.value === '17')"))
    view.fill(view.open_row("blade.note") + " .control input", 'a "quoted" text')
    check("texts are quoted", view.wait(r"""fake_log.some(m => m.key === 'blade.note' && m.value === '"a \\"quoted\\" text"')"""))
    view.page.click(view.open_row("blade.two_sided") + " input")
    check("a box", view.wait("fake_log.some(m => m.key === 'blade.two_sided' && m.value === 'false')"))
    row = view.open_row("blade.tip_color")
    view.js(f"(() => {{ const c = document.querySelector('{row} input[type=color]'); c.value = '#ff8000'; c.dispatchEvent(new Event('input')); }})()")
    check("a colour is linear", view.wait("fake_log.some(m => m.key === 'blade.tip_color' && m.value === '[1, 0.2159, 0]')"))
    view.js("document.querySelector('#reset').click()")
    view.wait("marram.state.scene.changes.length === 0")


VALUES = """import('./handle_values.js').then(v => {
  const keys = v.keys_of([1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 11, 10, 0, -5, 0, 90, 0, 2, 2, 2]), at = (...a) => v.pose_at(keys, ...a);
  const near = (a, b) => a.every((x, k) => Math.abs(x - b[k]) < 1e-9), one = {...v.identity(), frame: 1};
  const groups = [{params: [["a.b[0].shape", '"box"', true], ["a.b[0].strength", "1", false], ["a.b[2].noise.size", "[1, 2]", true], ["a.bc[5].x", "1", true]]
    .map(([key, value, given]) => ({key, value, given}))}];
  return {
    "constant before the first and after the last key": near(at(-3).translate, [0, 0, 0]) && near(at(40).translate, [10, 0, -5]),
    "linear between": near(at(3.5).translate, [2.5, 0, -1.25]) && near(at(3.5).rotate, [0, 22.5, 0]) && near(at(6).scale, [1.5, 1.5, 1.5]),
    "smooth": near(at(3.5, "smooth").translate, [1.5625, 0, -0.78125]),
    "no key is the identity": v.keys_of([]).length === 1 && v.transform_text(v.keys_of([])) === "{ translate = [0, 0, 0] }",
    "identity is left out": v.transform_text([{...one, scale: [2, 2, 2]}]) === "{ scale = [2, 2, 2] }",
    "a text of keys": v.transform_text(keys, "smooth") ===
      '{ keys = [{ frame = 1 }, { frame = 11, translate = [10, 0, -5], rotate = [0, 90, 0], scale = [2, 2, 2] }], interpolation = "smooth" }',
    "one key as keys": v.transform_text([one], "linear", true) === "{ keys = [{ frame = 1 }] }",
    "what is tiny is 0": v.vector_text([1, 1e-9, -2.3456789]) === "[1, 0, -2.3457]",
    "a key is put in its place": v.with_key(keys, 5, one).map(k => k.frame).join() === "1,5,11" && v.with_key(keys, 11, one)[1].translate[0] === 0,
    "and taken away": v.without_key(keys, 1).length === 1,
    "angles turn the short way": near(v.nearest_turn([-170, 0, 0], [180, 0, 0]), [190, 0, 0]) && near(v.nearest_turn([180, 60, 180], [0, 110, 0]), [0, 120, 0]),
    "points": v.points_text([0, 1, 2, 3, 4, 5.5]) === "[[0, 1, 2], [3, 4, 5.5]]",
    "a list of tables": v.list_of_tables_text(v.elements_of(groups, "a.b", new Map([["a.b[1].transform", "{ scale = 2 }"]]))) ===
      '[{ shape = "box" }, { transform = { scale = 2 } }, { noise.size = [1, 2] }]',
  }; })"""


def pointer(view, start, end=None, steps=3, modifiers=0, hold=False):
    """A click at a point of the page, or a drag to another."""
    end, page = end or start, view.page
    page.mouse("mouseMoved", *start, "none")
    page.mouse("mousePressed", *start, clickCount=1, buttons=1, modifiers=modifiers)
    for i in range(1, steps + 1) if end != start else ():
        page.mouse("mouseMoved", *(a + (b - a) * i / steps for a, b in zip(start, end)), buttons=1, modifiers=modifiers)
    if not hold:
        page.mouse("mouseReleased", *end, clickCount=1, modifiers=modifiers)


def test_handles(view):
    for what, fine in view.js(VALUES).items():
        check("values of shapes: " + what, fine)
    view.settle()
    view.view_focus()
    view.page.key("Home")
    view.wait("marram.world.frame === 1")
    view.js("window.handle = key => marram.state.scene.handles.find(h => h.key === key)")
    box = "wind.gusts.control[1].transform"
    selected = lambda: (view.js("marram.handles.selected()") or {}).get("key")
    middle = lambda key: view.js(f"marram.handles.on_screen(marram.handles.views().get('{key}').center().toArray())")
    # The middle of the gizmo's arm along an axis, on the screen; it points to the camera's side.
    arm = lambda axis: view.js(f"(() => {{ const g = marram.handles.gizmo(), p = g.object.getWorldPosition(new THREE.Vector3()), c = marram.world.camera;"
                               f"p.{axis} += Math.sign(c.position.{axis} - p.{axis}) * 0.6 * p.distanceTo(c.position) * g.size / 7; return marram.handles.on_screen(p.toArray()); }})()")
    last = lambda key: view.js(f"(fake_log.filter(m => m.type === 'set' && m.key === '{key}').pop() || {{}}).value")
    camera = view.js("JSON.stringify(marram.world.camera.position.toArray())")
    drifting = "marram.handles.drifting().spheres.filter(s => s.visible).length"
    check("the gusts of a frame are shown", view.js(drifting) == 2)
    pointer(view, middle(box))
    check("a click selects a shape", selected() == box)
    check("its line tells where it is", view.js("document.querySelector('#handle_line').textContent").startswith("gust 2at 2.2, 0.9, 0.5"))
    view.wait("!marram.world.dirty")
    start = arm("y")
    view.js("fake_log.length = 0; fake_socket.changed = () => {}")   # no answer to the first value
    pointer(view, start, (start[0], start[1] - 90), steps=6, hold=True)
    view.wait("new Promise(done => setTimeout(() => done(true), 150))")
    check("no value is sent before the last is answered", view.js("fake_log.filter(m => m.type === 'set').length") == 1)
    view.js("delete fake_socket.changed")
    view.page.mouse("mouseReleased", start[0], start[1] - 90, clickCount=1)
    check("no orbit meanwhile", view.js("JSON.stringify(marram.world.camera.position.toArray())") == camera)
    settled = "fake_log.length && marram.player.idle() && JSON.stringify(handle('wind.gusts.control[1].transform').keys.slice(1, 4).map(x => x.toFixed(3))) === " \
              f"JSON.stringify(marram.handles.views().get('{box}').object.position.toArray().map(x => x.toFixed(3)))"
    check("a drag moves it, and the last value sent is where it is", view.wait(settled) and view.js("handle('wind.gusts.control[1].transform').keys[2] > 1.2"))
    check("it is written as one pose", last(box).startswith("{ translate = [2.2, ") and "keys" not in last(box), last(box))
    height = f"marram.handles.views().get('{box}').object.position.y"
    high = view.js(height)
    view.page.key("z", "ctrl")
    check("undo takes it back", view.wait(f"{height} < {high} - 0.01"))
    view.js("document.querySelector('#reset').click()")
    check("and reset to the file's place, still selected", view.wait(f"{height} === 0.9") and selected() == box)
    view.page.key("k")
    check("K makes a key", view.wait("marram.state.scene.changes.length === 1") and last(box).startswith("{ keys = [{ frame = 1, "), last(box))
    view.page.key("ArrowRight", "shift")
    view.wait("marram.world.frame === 11 && !marram.world.dirty")
    view.page.key("3")
    start = middle(box)
    pointer(view, start, (start[0] + 55, start[1] - 55))
    check("a drag at another frame makes the next, the middle scales all sides",
          view.wait("handle('wind.gusts.control[1].transform').keys.length === 20 && marram.player.idle()") and
          "frame = 11" in last(box) and "scale = [2, 1.2, 1.6]" in last(box), last(box))
    view.js("[...document.querySelectorAll('#handle_line button')].find(b => b.textContent === 'remove key').click()")
    check("a button removes it", view.wait("handle('wind.gusts.control[1].transform').keys.length === 10"))
    view.page.key("g")
    new = "wind.gusts.control[2].transform"
    check("G adds a gust and selects it", view.wait(f"(marram.handles.selected() || {{}}).key === '{new}'"))
    check("where the camera looks", view.js("handle('wind.gusts.control[2].transform').keys.slice(1, 4).every((x, k) => "
                                            "Math.abs(x - marram.world.controls.target.getComponent(k)) < 1e-3)"))
    text = last("wind.gusts.control")
    check("the others are as they were", "strength = 0.5" in text and text.count("shape =") == 3, text)
    view.page.key("Delete")
    check("Delete deletes it", view.wait(f"!marram.handles.views().has('{new}')") and selected() is None and last("wind.gusts.control").count("shape =") == 2)
    dot = view.js("marram.handles.on_screen([0, 2.4, -1.5])")
    pointer(view, dot)
    check("a click selects a point of a curve", view.js("(marram.handles.selected() || {}).point") == 2)
    view.wait("!marram.world.dirty")
    start = arm("y")
    pointer(view, start, (start[0], start[1] - 40))
    check("which can be dragged", view.wait("handle('curves.ridge.points').points[7] > 2.6") and last("curves.ridge.points").startswith("[[-3, 1.2, -1], "))
    view.settle()
    value = last("curves.ridge.points")
    start = arm("y")
    pointer(view, start, (start[0], start[1] - 30), hold=True)
    view.page.key("Escape")
    view.page.mouse("mouseReleased", start[0], start[1] - 30, clickCount=1)
    check("Escape takes a drag back", view.wait("marram.player.idle() && !marram.handles.dragging()") and last("curves.ridge.points") == value)
    count = lambda: view.js("handle('curves.ridge.points').points.length / 3")
    view.page.key("n")
    check("N adds a point behind it", view.wait("handle('curves.ridge.points').points.length === 15") and view.js("marram.handles.selected().point") == 3)
    view.settle()
    check("half way to the next", view.js("(() => { const p = handle('curves.ridge.points').points; return [0, 1, 2].every(k => Math.abs(p[9 + k] - (p[6 + k] + p[12 + k]) / 2) < 1e-3); })()"))
    view.page.key("x")
    check("X deletes it", view.wait("handle('curves.ridge.points').points.length === 12") and last("curves.ridge.points") == value, last("curves.ridge.points"))
    view.settle()
    view.page.key("x")
    view.wait("handle('curves.ridge.points').points.length === 9")
    view.settle()
    view.page.key("x")
    view.wait("handle('curves.ridge.points').points.length === 6")
    view.settle()
    view.page.key("x")
    check("two points stay", view.js("document.querySelector('#notice').textContent") == "A curve has two points at least." and count() == 2)
    for _ in range(2):
        view.page.key("z", "ctrl")
    check("undo brings points back", view.wait("handle('curves.ridge.points').points.length === 12"))
    view.page.key("Escape")
    check("and then unselects", selected() is None)
    pointer(view, middle(box))
    view.page.drag("#live", (0.3, 0.85), (0.33, 0.85), steps=3)
    check("a drag of the view is no click", selected() == box and view.js("JSON.stringify(marram.world.camera.position.toArray())") != camera)
    pointer(view, (200, 80))
    check("a click beside all unselects", selected() is None)
    view.page.key("c")
    view.page.key("w")
    check("W hides the shapes, which is remembered", not view.js("marram.handles.visible()") and view.js("JSON.parse(sessionStorage['marram.show']).gusts === false"))
    view.page.key("w")
    view.page.key("r")
    check("a picture over the view hides them", not view.js("marram.handles.visible()"))
    view.page.key("Escape")


def test_compass(view):
    view.js("document.querySelector('#reset').click()")
    view.wait("marram.state.scene.changes.length === 0")
    view.settle()
    box = view.page.box("#compass")
    x, y, radius = box["x"] + box["width"] / 2, box["y"] + box["width"] / 2, 0.33 * box["width"]
    pointer(view, (x, y - radius), (x + radius, y))
    right = view.js("(() => { const e = marram.world.camera.matrixWorld.elements, s = Math.hypot(1, 0.25) / Math.hypot(e[0], e[2]); "
                    "return [s * e[0], 0, s * e[2]]; })()")
    value = lambda: view.js("(fake_log.filter(m => m.key === 'wind.direction').pop() || {value: '[0, 0, 0]'}).value")
    near = lambda: all(abs(a - b) < 0.02 for a, b in zip(json.loads(value()), right))
    check("the dial turns the wind", view.wait("marram.player.idle() && marram.state.scene.changes.length === 1") and near(), f"{value()} {right}")
    pointer(view, (x + 5, y), (x + radius / 2, y), modifiers=8)
    check("with Shift it sets the speed", view.wait("marram.player.idle() && Math.abs(Number(marram.state.scene.changes[0].split('=')[1]) - 5) < 0.3"))
    view.js("marram.state.scene.groups[0].params.find(p => p.key === 'wind.speed').keyed = true; fake_socket.give(JSON.stringify(marram.state.scene))")
    check("it goes away when the speed has keys", view.wait("document.querySelector('#compass').hasAttribute('hidden')"))
    view.js("document.querySelector('#reset').click()")
    check("and comes back", view.wait("!document.querySelector('#compass').hasAttribute('hidden')"))


def test_values(view):
    view.view_focus()
    colors = """(() => { const gl = document.querySelector('#gl').getContext('webgl2'), c = gl.canvas; marram.world.redraw();
      const p = new Uint8Array(4 * c.width * c.height); gl.readPixels(0, 0, c.width, c.height, gl.RGBA, gl.UNSIGNED_BYTE, p);
      let red = 0, blue = 0; for (let i = 0; i < p.length; i += 4) { red += p[i] > 200 && p[i + 1] < 90; blue += p[i + 2] > p[i] + 40 && p[i + 2] > p[i + 1] + 20; } return [red, blue]; })()"""
    plain = view.js(colors)
    view.page.key("v")
    view.wait("marram.player.idle() && marram.player.shown.values")
    check("V colours by an attribute", view.js("fake_log.filter(m => m.type === 'frame').pop().values") == "gust")
    check("its legend tells the range", view.js("document.querySelector('#legend').textContent") == "gust01.5", view.js("document.querySelector('#legend').textContent"))
    view.page.key("v")
    view.wait("marram.player.idle() && marram.player.shown.values?.name === 'contact'")
    check("classes have colours of their own", view.js(colors)[0] > plain[0] + 100, f"{plain} {view.js(colors)}")
    check("and names", "met a mesh" in view.js("document.querySelector('#legend').textContent"))
    view.page.key("v")
    view.wait("marram.player.idle() && !marram.player.shown.values")
    check("at last the materials", view.js("document.querySelector('#legend').hidden") and view.js(colors)[0] <= plain[0] + 50)


def test_flip_book(view):
    first, last = view.js("marram.state.scene.frames")
    view.js(f"marram.state.scene.frames = [{first}, {first + 7}]; const s = document.querySelector('#samples'); s.add(new Option('1')); s.value = '1'")
    view.view_focus()
    before = view.js("fake_log.length")
    view.page.key("b")
    check("B makes a flip-book", view.wait("marram.flip_book.done() && marram.flip_book.frames() === 8"))
    # A late answer to what came before lets it ask for a picture anew: what counts is the order of those that it took.
    frames = view.js(f"[...new Set(fake_log.slice({before}).filter(m => m.type === 'render').map(m => m.frame))].join()")
    check("of every frame in order", frames == ",".join(str(first + i) for i in range(8)), frames)
    asked = view.js("fake_log.filter(m => m.type === 'frame').length")
    view.js("window.leaves = new Set(); window.watch_leaves = setInterval(() => leaves.add(marram.flip_book.seen()), 5)")
    check("it is played", view.js("marram.player.playing") and view.wait("leaves.size === 8"))
    check("without frames of the strands", view.js("fake_log.filter(m => m.type === 'frame').length") <= asked + 1)
    view.page.key(" ")
    view.page.drag("#live", (0.4, 0.5), (0.45, 0.5))
    check("another camera ends it", view.wait("marram.flip_book.frames() === 0"))
    view.page.key("Escape")
    view.js(f"clearInterval(watch_leaves); marram.state.scene.frames = [{first}, {last}]; document.querySelector('#samples').value = '64'")


def test_connection(view):
    view.settle()
    view.view_focus()
    view.page.key("End")
    view.page.drag("#live", (0.4, 0.5), (0.5, 0.52))
    view.settle()
    where = view.js("JSON.stringify(marram.world.camera.position.toArray())")
    view.js("fake_gone = true; fake_socket.close()")
    check("a lost connection is told", view.wait("document.querySelector('#notice').textContent.startsWith('The program has ended') && !document.querySelector('#notice').hidden"))
    frames = view.js("marram.player.frames")
    view.js("fake_gone = false")
    check("the page connects anew", view.wait(f"marram.state.connected && marram.player.frames > {frames}"))
    check("the line goes away", view.wait("document.querySelector('#notice').hidden"))
    check("time and camera stay", view.js("JSON.stringify(marram.world.camera.position.toArray())") == where and view.js("marram.player.time === 96"))
    view.page.send("Page.reload")
    view.wait("window.marram && marram.player.frames > 0 && marram.player.frames < 100 && marram.player.idle()")
    near = view.js(f"JSON.parse('{where}').every((x, k) => Math.abs(x - marram.world.camera.position.getComponent(k)) < 1e-6)")
    check("also when the page is loaded anew", near and view.js("marram.player.time === 96"))


def main():
    if len(sys.argv) > 1:
        Handler.three = sys.argv[1]
    if not shutil.which("chromium"):
        print("skipped: there is no chromium")
        return 77
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with Browser() as browser:
            view = FakedView(browser, f"http://127.0.0.1:{server.server_port}/token/")
            for test in (test_messages, test_requests, test_hidden, test_sliders, test_handles, test_compass, test_values, test_flip_book, test_connection):
                test(view)
            check("no errors in the console", not view.page.errors, "; ".join(view.page.errors))
    except BrowserError as error:
        check(str(error), False)
    server.shutdown()
    print(f"{browser_test.failed} failed" if browser_test.failed else "all passed")
    return 1 if browser_test.failed else 0


if __name__ == "__main__":
    sys.exit(main())
