#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests `marram view` in a headless chromium: tests/view/browser_test.py [PROGRAM [SCENE]]

Each check prints a line; the exit code is 1 if one failed. No check depends on how fast the machine is: each waits for a state, up to
MARRAM_VIEW_PATIENCE seconds (120). Screenshots go to the folder MARRAM_VIEW_PICTURES if that is set.
"""
import json
import os
import shutil
import sys
import tempfile
import time

sys.dont_write_bytecode = True
from browser import Browser, BrowserError
from client import Program

SCENE = """
fps = 24
frames = [1, 48]
[camera]
position = [0, 1.1, 3.2]
target = [0, 0.15, 0]
fov = 35
[film]
size = [320, 180]
samples = 8
max_depth = 4
[wind]
direction = [1, 0, -0.2]
speed = 6
response = [[0, 0], [12, 1]]
global_rotate = 0.6
ramp_rotate = { knots = [[0, 0.2], [1, 1]], interpolation = "smooth" }
noise = { amplitude = 0.5, frequency = 0.5, octaves = 2 }
gusts = { num_gusts = 6, radius_range = [0.5, 1], period = 48 }
[[light]]
name = "day"
type = "daylight"
direction = [-0.8, 0.6, 0.3]
[[material]]
name = "soil"
type = "diffuse"
color = [0.12, 0.09, 0.06]
[[material]]
name = "blade"
type = "grass"
root_color = [0.1, 0.16, 0.03]
tip_color = [0.4, 0.56, 0.1]
[[mesh]]
name = "ground"
type = "plane"
size = [3, 3]
material = "soil"
[[procedural]]
type = "groom"
name = "grass"
on = "ground"
material = "blade"
count = 3000
length = [0.2, 0.4]
lean = 15
width = 0.008
cvs = 6
seed = 2
"""

failed = 0


def check(what, fine, detail=""):
    global failed
    failed += not fine
    print(("passed: " if fine else "FAILED: ") + what + (f" ({detail})" if detail and not fine else ""), flush=True)


class View:
    """A tab with the page."""

    def __init__(self, browser, address):
        self.page = browser.open(address)
        self.page.wait_for("window.marram && marram.player.frames > 0", "the first frame")

    def js(self, expression):
        return self.page.evaluate(expression)

    def wait(self, expression, what=None):
        try:
            return self.page.wait_for(expression, what)
        except BrowserError as error:
            print("  " + str(error), flush=True)
            return False

    # All that was asked for has come, and the strands shown are those at rest.
    def settle(self):
        return self.wait("(() => { const p = marram.player; return !p.playing && p.idle() && marram.world.frame !== null; })()", "stillness")

    def digest(self):
        self.settle()
        return self.js("marram.world.strands.digest()")

    def row(self, key):
        return f'.row[data-key="{key}"]'

    def open_row(self, key):
        self.js(f"""(() => {{ const groups = marram.state.scene.groups, i = groups.findIndex(g => g.params.some(p => p.key === {json.dumps(key)}));
          document.querySelectorAll('#groups details')[i].open = true; }})()""")
        self.wait(f"!!document.querySelector({json.dumps(self.row(key))})")
        return self.row(key)

    def param(self, key):
        return self.js(f"marram.state.scene.groups.flatMap(g => g.params).find(p => p.key === {json.dumps(key)})")

    def fill(self, selector, text):
        """Writes into a field and presses Enter."""
        self.page.click(selector)
        self.js(f"document.querySelector({json.dumps(selector)}).select()")
        self.page.type(text)
        self.page.key("Enter")

    def view_focus(self):
        self.js("document.querySelector('#live').focus()")

    def picture(self, name):
        folder = os.environ.get("MARRAM_VIEW_PICTURES")
        if folder:
            os.makedirs(folder, exist_ok=True)
            self.page.screenshot(os.path.join(folder, f"view_{name}.png"))


def test_opening(view):
    check("the page opens on a scene", view.js("marram.state.scene.groups.length") > 0)
    check("strands are drawn", view.js("marram.world.strands.shown") > 0)
    view.settle()
    view.wait("!marram.world.dirty")
    colors = view.js("""(() => { const gl = document.querySelector('#gl').getContext('webgl2'), c = gl.canvas; marram.world.redraw();
      const p = new Uint8Array(4 * c.width * c.height); gl.readPixels(0, 0, c.width, c.height, gl.RGBA, gl.UNSIGNED_BYTE, p);
      const seen = new Set(); for (let i = 0; i < p.length; i += 4) seen.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]); return seen.size; })()""")
    check("the view has many colours", colors > 200, str(colors))
    check("the status line tells strands and times", view.wait("/strands, .*chain .* ms, line /.test(document.querySelector('#status').textContent)"))
    view.picture("view")


def test_playing(view):
    view.view_focus()
    before = view.digest()
    view.page.key(" ")
    check("space plays", view.js("marram.player.playing"))
    seen = view.js("marram.player.frames")
    check("new frames come", view.wait(f"marram.player.frames > {seen} + 5"))
    check("other frames are shown", view.wait(f"marram.world.strands.digest() !== {before}"))
    view.page.key(" ")
    check("space pauses", not view.js("marram.player.playing"))
    view.settle()
    check("at rest the frame is whole", view.js("Number.isInteger(marram.world.frame) && marram.world.frame === marram.player.time"))
    view.page.key("Home")
    first = view.js("marram.state.scene.frames[0]")
    check("Home goes to the first frame", view.wait(f"marram.world.frame === {first}"))
    one = view.digest()
    view.page.key("ArrowRight")
    check("an arrow steps one frame", view.wait(f"marram.world.frame === {first} + 1"))
    check("which looks different", view.digest() != one)
    view.page.key("ArrowRight", "shift")
    check("with Shift ten", view.wait(f"marram.world.frame === {first} + 11"))
    view.page.key("End")
    check("End goes to the last frame", view.wait("marram.world.frame === marram.state.scene.frames[1]"))
    view.page.drag("#scrub", (0.5, 0.5), (0.25, 0.5))
    check("the bar scrubs", view.wait("marram.player.idle() && marram.world.frame > marram.state.scene.frames[0] && "
                                      "marram.world.frame < marram.state.scene.frames[1] / 2"))
    view.fill("#frame", "7.5")
    check("a part of a frame can be asked for", view.wait("marram.world.frame === 7.5"))
    view.js("(() => { const s = document.querySelector('#speed'); s.value = 'every'; s.dispatchEvent(new Event('change')); })()")
    view.js("window.shown_frames = []; marram.on('shown', h => shown_frames.push(h.frame)); document.querySelector('#play').click()")
    view.wait("shown_frames.length > 6")
    view.js("document.querySelector('#play').click(); const s = document.querySelector('#speed'); s.value = '1'; s.dispatchEvent(new Event('change'))")
    frames = view.js("shown_frames.slice(1, 7)")
    check("every frame in turn", all(b == a + 1 or b == first for a, b in zip(frames, frames[1:])), str(frames))
    view.page.key("Home")
    view.settle()


def test_editing(view):
    row = view.open_row("wind.speed")
    at_first, value = view.digest(), view.param("wind.speed")["value"]
    view.page.drag(row + " input[type=range]", (0.4, 0.5), (0.85, 0.5), steps=12)
    check("a slider changes the value", view.wait("marram.state.scene.changes.length === 1") and view.param("wind.speed")["value"] != value)
    check("the strands move", view.wait(f"marram.player.idle() && marram.world.strands.digest() !== {at_first}"))
    check("the value is marked", view.js(f"document.querySelector('{row}').classList.contains('changed')"))
    view.picture("changed")
    text = view.js("marram.options_text()")
    check("copy gives --set", text.startswith("--set 'wind.speed="), text)
    view.view_focus()
    view.page.key("z", "ctrl")
    view.wait("!marram.state.scene.undo")
    check("one undo takes the whole drag back", view.param("wind.speed")["value"] == value and not view.js("marram.state.scene.changes.length"))
    check("and restores the strands", view.digest() == at_first)
    view.page.key("Z", "ctrl", "shift")
    check("redo", view.wait("marram.state.scene.changes.length === 1"))
    view.page.click(row + " .dot")
    check("the dot resets the value", view.wait("marram.state.scene.changes.length === 0"))


def test_searching(view):
    view.view_focus()
    view.page.key("/")
    check("/ goes to the search", view.js("document.activeElement.id") == "search")
    view.page.type("speed")
    check("a search shows what it finds", view.wait("document.querySelector('.row[data-key=\"wind.speed\"]').offsetHeight > 0"))
    shown = view.js("[...document.querySelectorAll('.row')].filter(r => r.offsetHeight).length")
    everything = view.js("marram.state.scene.groups.flatMap(g => g.params).length")
    check("and hides the rest", 0 < shown < everything, f"{shown} of {everything}")
    view.picture("search")
    view.page.key("Escape")
    check("Escape ends it", view.js("document.querySelector('#search').value") == "")


def test_ramps(view):
    row = view.open_row("wind.ramp_rotate")
    before, strands = view.param("wind.ramp_rotate")["value"], view.digest()
    knots = lambda: view.js(f"document.querySelectorAll('{row} circle').length")
    count = knots()
    view.page.click(row + " svg", count=2, at=(0.5, 0.3))
    check("a double click adds a knot", view.wait(f"document.querySelectorAll('{row} circle').length === {count + 1}"))
    check("the program has it", view.wait(f"marram.state.scene.changes.some(c => c.startsWith('wind.ramp_rotate'))"))
    check("it bends the strands", view.wait(f"marram.player.idle() && marram.world.strands.digest() !== {strands}"))
    value = view.param("wind.ramp_rotate")["value"]
    view.page.drag(row + " svg", (0.5, 0.3), (0.6, 0.8))
    check("a knot can be dragged", view.wait(f"marram.state.scene.groups.flatMap(g => g.params).find(p => p.key === 'wind.ramp_rotate').value !== {json.dumps(value)}"))
    view.js(f"document.querySelector('{row} svg').focus()")
    view.page.key("Delete")
    check("Delete removes it", view.wait(f"document.querySelectorAll('{row} circle').length === {count}"))
    view.fill(row + " .under input", "[[0, 0.1], [0.5, 0.9], [1, 1]]")
    check("its text can be written", view.wait(f"document.querySelectorAll('{row} circle').length === 3"))
    view.picture("ramp")
    view.js("document.querySelector('#reset').click()")
    check("reset", view.wait("marram.state.scene.changes.length === 0") and view.param("wind.ramp_rotate")["value"] == before)


def test_problems(view):
    row = view.open_row("wind.global_rotate")
    good = view.digest()
    view.fill(row + " .number", "-7")
    check("a bad value shows a problem", view.wait("!document.querySelector('#problems').hidden && document.querySelector('#problems').textContent.includes('global_rotate')"))
    check("its field is marked", view.js(f"document.querySelector('{row}').classList.contains('wrong')"))
    view.picture("problem")
    check("the strands stay", view.digest() == good)
    view.fill(row + " .number", "0.3")
    check("a good value ends it", view.wait("document.querySelector('#problems').hidden || document.querySelector('#problems').classList.contains('mild')"))
    check("and takes effect", view.wait(f"marram.player.idle() && marram.world.strands.digest() !== {good}"))
    view.js("document.querySelector('#reset').click()")
    view.wait("marram.state.scene.changes.length === 0")


def test_camera(view):
    view.view_focus()
    at = "JSON.stringify(marram.world.camera.position.toArray().map(x => +x.toFixed(4)))"
    home = view.js(at)
    view.page.drag("#live", (0.4, 0.5), (0.6, 0.55))
    check("a drag orbits", view.js(at) != home)
    view.page.key("c")
    check("C goes back to the scene's camera", view.js(at) == home)
    view.page.key("f")
    check("F frames the strands", view.js(at) != home)
    view.page.key("c")


def test_rendering(view):
    view.settle()
    view.view_focus()
    view.js("(() => { const s = document.querySelector('#samples'); s.add(new Option('4')); s.value = '4'; })()")
    view.page.key("r")
    check("R shows a picture", view.wait("marram.picture.images > 0 && !document.querySelector('#picture').classList.contains('waiting')"))
    view.wait("marram.picture.width > 240 || marram.picture.done")
    few = view.js("marram.picture.images")
    check("it refines until done", view.wait("marram.picture.done") and view.js("marram.picture.images") >= few)
    check("with all samples", view.js("marram.picture.samples") == 4)
    colors = """(() => { const c = document.querySelector('#picture_b'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      const seen = new Set(); for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]); return seen.size; })()"""
    check("the picture has many colours", view.js(colors) > 200)
    view.picture("render")
    view.page.key("a")
    check("A keeps it", view.js("!document.querySelector('#picture_a').hidden"))
    images = view.js("marram.picture.images")
    view.page.drag("#live", (0.2, 0.6), (0.25, 0.6))
    check("a camera move begins anew", not view.js("marram.picture.done") and view.wait(f"marram.picture.done && marram.picture.images > {images}"))
    view.picture("compare")
    view.page.key("A", "shift")
    view.page.key("m")
    view.page.drag("#tool_layer", (0.3, 0.4), (0.6, 0.7), steps=3)
    traced = "(() => { const c = document.querySelector('#picture_b'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let n = 0;" \
             " for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n / (c.width * c.height); })()"
    check("M and a drag: a part alone is traced", view.wait("marram.picture.done") and abs(view.js(traced) - 0.09) < 0.005, view.js(traced))
    view.picture("crop")
    view.page.key("m")
    check("M again: the whole", view.wait("marram.picture.done") and view.js(traced) == 1)
    view.page.key("p")
    check("P places it beside", view.wait("marram.picture.done && document.querySelector('#picture').getBoundingClientRect().left > 100"))
    view.picture("beside")
    view.page.key("Escape")
    check("Escape goes back to the live view", view.js("document.querySelector('#picture').hidden"))
    view.page.key("c")
    view.settle()


def test_focus(view):
    view.settle()
    view.view_focus()
    at = view.js("(() => { const box = document.querySelector('#live').getBoundingClientRect(), p = new THREE.Vector3(0.4, 0, 0.5).project(marram.world.camera);"
                 "return [(p.x + 1) / 2, (1 - p.y) / 2]; })()")
    deep = view.js("new THREE.Vector3(0.4, 0.1, 0.5).sub(marram.world.camera.position).dot(marram.world.camera.getWorldDirection(new THREE.Vector3()))")
    view.page.key("d")
    view.page.click("#tool_layer", at=at)
    check("D and a click: the camera focuses there", view.wait("marram.state.scene.changes.length === 1") and
          deep - 0.9 < float(view.param("camera.focus")["value"]) < deep + 0.1, f"{view.param('camera.focus')['value']} {deep}")
    check("told that the lens is a point", view.js("document.querySelector('#notice').textContent.includes('lens_radius is 0')"))
    view.page.key("z", "ctrl")
    check("which is undone", view.wait("marram.state.scene.changes.length === 0"))
    view.page.key("d")
    view.page.click("#tool_layer", at=(0.5, 0.02))
    check("in the sky nothing is sharp", view.js("document.querySelector('#notice').textContent.startsWith('There is only sky')"))
    view.page.key("d")
    view.page.key("Escape")
    check("Escape drops the tool", view.js("marram.tools.armed() === null && document.querySelector('#tool_layer').hidden"))


def test_air(view):
    view.settle()
    view.view_focus()
    check("nothing is asked for that is not shown", view.js("marram.world.air() === null && marram.air.arrows() === 0"))
    view.page.key("W", "shift")
    check("Shift W shows arrows on a plane", view.wait("marram.air.arrows() >= 4 * 400") and view.js("marram.handles.selected().key") == "plane of the air")
    view.picture("air")
    before = view.js("JSON.stringify(marram.air.plane.pose.translate)")
    x, y = view.js("""(() => { const g = marram.handles.gizmo(), p = g.object.getWorldPosition(new THREE.Vector3()), c = marram.world.camera;
      p.y += 0.6 * p.distanceTo(c.position) * g.size / 7; const box = document.querySelector('#live').getBoundingClientRect(), at = marram.handles.on_screen(p.toArray());
      return [(at[0] - box.left) / box.width, (at[1] - box.top) / box.height]; })()""")
    view.page.drag("#live", (x, y), (x, y + 0.05), steps=3)
    check("it can be dragged", view.js("JSON.stringify(marram.air.plane.pose.translate)") != before)
    check("which changes no value", view.js("marram.state.scene.changes.length") == 0)
    view.page.key("X")
    check("X takes it away", view.wait("marram.air.arrows() === 0 && marram.world.air() === null"))
    view.page.key("i")
    view.page.click("#tool_layer", at=(0.5, 0.6))
    check("I and a click on a strand: without shielding a line says so", view.wait("document.querySelector('#notice').textContent.includes('wind.shielding.shield')"))
    row = view.open_row("wind.shielding.shield")
    view.fill(row + " .number", "1")
    view.wait("marram.state.scene.changes.length === 1")
    view.settle()
    view.view_focus()
    view.page.key("i")
    view.page.click("#tool_layer", at=(0.5, 0.6))
    check("with it its rays are shown", view.wait("marram.air.rays() >= 6") and view.wait("/Shelter [0-9.]+: \\d+ of 6 rays/.test(document.querySelector('#notice').textContent)"),
          view.js("document.querySelector('#notice').textContent"))
    view.picture("rays")
    view.page.key("Escape")
    check("Escape takes them away", view.js("marram.air.rays()") == 0)
    view.js("document.querySelector('#reset').click()")
    view.wait("marram.state.scene.changes.length === 0")


def test_gusts(view):
    view.settle()
    view.view_focus()
    view.page.key("g")
    key, count = "wind.gusts.control[0].transform", "marram.state.scene.handles.length"
    check("G adds a gust", view.wait(f"{count} === 1 && marram.handles.selected()"))
    before = view.digest()
    x, y, width, height = view.js(f"""(() => {{ const box = document.querySelector('#live').getBoundingClientRect(),
      at = marram.handles.on_screen(marram.handles.views().get({json.dumps(key)}).keys[0].translate);
      return [at[0] - box.left, at[1] - box.top, box.width, box.height]; }})()""")
    view.page.drag("#live", (x / width, y / height), (x / width - 0.15, y / height + 0.05), steps=4)
    check("its values are in sight", view.js(f"""(() => {{ const row = document.querySelector('.row[data-key={json.dumps(key)}]')?.getBoundingClientRect();
      return !!row && row.top > 0 && row.bottom < innerHeight; }})()"""))
    check("dragged, it is elsewhere", view.wait(f"marram.state.scene.changes.some(c => c.startsWith({json.dumps(key)}))"))
    check("and bends other strands", view.digest() != before)
    view.view_focus()
    view.page.key("v")
    check("V colours by the wind", view.wait("marram.player.idle() && marram.player.shown.values && marram.player.shown.values.upper > 0"))
    view.page.key("v")
    view.wait("marram.player.idle() && marram.player.shown.values && marram.player.shown.values.name === 'gust'")
    view.settle()
    view.picture("gust")
    view.view_focus()
    view.page.key("Delete")
    check("Delete removes it", view.wait(f"{count} === 0"))
    view.js("document.querySelector('#reset').click(); document.querySelector('#values').value = ''; document.querySelector('#values').dispatchEvent(new Event('change'))")
    view.wait("marram.state.scene.changes.length === 0")


def test_files(view, folder):
    view.settle()
    view.view_focus()
    view.page.key("B", "shift")
    check("Shift B asks for a folder", view.js("document.querySelector('#series').open && document.querySelector('#series_folder').value.endsWith('/lawn_frames')"))
    view.fill("#series_folder", os.path.join(folder, "none/out"))
    check("a folder that cannot be made is told", view.wait("document.querySelector('#series_problems').textContent.includes('none/out: this folder cannot be made')"))
    view.picture("files_refused")
    view.js("document.querySelector('#series_folder').value = 'out'")
    view.js("document.querySelector('#series_frames').value = '1-3'")
    view.page.click("#series_start")
    check("a line tells how far it is", view.wait("/Frame 2, 2 of 3/.test(document.querySelector('#series_text').textContent)"))
    view.picture("files")
    check("and where they are", view.wait("document.querySelector('#series_text').textContent.startsWith('3 of 3 frames are in /')"))
    check("named as by marram render", sorted(os.listdir(os.path.join(folder, "out"))) == [f"lawn.000{i}.exr" for i in (1, 2, 3)])
    check("they are played as a flip-book", view.wait("marram.flip_book.frames() === 3 && marram.player.playing && marram.flip_book.seen() !== null"))
    view.picture("files_book")
    view.page.key(" ")
    view.page.click("#series_stop")
    view.page.key("Escape")
    check("the line is closed", view.js("document.querySelector('#series_line').hidden"))


def test_tabs(browser, program, first):
    second = View(browser, program.address)
    check("a second tab opens", second.js("marram.world.strands.shown") > 0)
    row = second.open_row("wind.speed")
    second.fill(row + " .number", "9")
    check("tabs share values", second.wait("marram.state.scene.changes.length === 1") and first.wait("marram.state.scene.changes.length === 1"))
    second.view_focus()
    second.page.key(" ")
    second.wait("marram.player.frames > 8")
    errors = list(second.page.errors)
    second.page.close()
    check("no errors in the second tab", not errors, "; ".join(errors))
    first.page.activate()
    seen = first.js("marram.player.frames")
    first.view_focus()
    first.page.key("ArrowRight")
    check("the first goes on after the second was closed while it played", first.wait(f"marram.player.frames > {seen}") and program.alive())
    third = View(browser, program.address)
    third.page.key("r")
    third.wait("marram.picture.images > 0")
    third.page.close()
    first.page.activate()
    first.page.key("ArrowRight")
    check("and after one was closed while it rendered", first.wait(f"marram.player.frames > {seen} + 1") and program.alive())


def test_end(view, program):
    check("no errors in the console", not view.page.errors, "; ".join(view.page.errors))
    check("no message was ignored", not [w for w in view.page.warnings if "ignored" in w], "; ".join(view.page.warnings))
    program.stop()
    check("a line tells that the program has ended", view.wait("document.querySelector('#notice').textContent.startsWith('The program has ended') && !document.querySelector('#notice').hidden"))
    view.picture("ended")
    check("the view stays", view.js("marram.world.strands.shown") > 0)


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    program_path = sys.argv[1] if len(sys.argv) > 1 else os.path.join(here, "../../build/marram")
    if not shutil.which("chromium"):
        print("skipped: there is no chromium")
        return 77
    folder = tempfile.mkdtemp(prefix="marram_view_test_")
    scene = sys.argv[2] if len(sys.argv) > 2 else os.path.join(folder, "lawn.toml")
    if len(sys.argv) <= 2:
        with open(scene, "w") as file:
            file.write(SCENE)
    program = None
    try:
        program = Program(program_path, scene)
        if not program.address:
            raise BrowserError("no address: " + program.process.stderr.read())
        with Browser() as browser:
            view = View(browser, program.address)
            for test in (test_opening, test_playing, test_editing, test_searching, test_ramps, test_problems, test_camera, test_focus, test_air, test_gusts, test_rendering):
                begin = time.monotonic()
                test(view)
                print(f"  {time.monotonic() - begin:.1f} s", flush=True)
            test_files(view, folder)
            test_tabs(browser, program, view)
            test_end(view, program)
    except BrowserError as error:
        check(str(error), False)
    finally:
        if program:
            program.stop()
        shutil.rmtree(folder, ignore_errors=True)
    print(f"{failed} failed" if failed else "all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
