#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests the page of `marram view` without the program: fake_server.js answers in its place, so that what a program does not do on purpose
can be tried: lost connections, malformed messages, answers that come late.   tests/view/page_test.py [FOLDER OF THREE.JS]"""
import http.server
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
            for test in (test_messages, test_requests, test_hidden, test_sliders, test_connection):
                test(view)
            check("no errors in the console", not view.page.errors, "; ".join(view.page.errors))
    except BrowserError as error:
        check(str(error), False)
    server.shutdown()
    print(f"{browser_test.failed} failed" if browser_test.failed else "all passed")
    return 1 if browser_test.failed else 0


if __name__ == "__main__":
    sys.exit(main())
