# SPDX-License-Identifier: Apache-2.0
"""Drives headless chromium through its DevTools pipe, with Python's standard library alone.

    with Browser() as browser:
        page = browser.open("http://127.0.0.1:8000/")
        page.wait_for("document.title === 'ready'")
        page.click("#play")

Messages are JSON separated by NUL, written to file descriptor 3 of chromium and read from 4.
"""
import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

PATIENCE = float(os.environ.get("MARRAM_VIEW_PATIENCE", 120))  # seconds until something is given up


class BrowserError(Exception):
    pass


class Browser:
    """A chromium with software OpenGL and a profile of its own, which goes away with it."""

    def __init__(self, width=1280, height=720, scale=1):
        self.program = shutil.which("chromium") or shutil.which("chromium-browser")
        if not self.program:
            raise BrowserError("there is no chromium")
        self.size = (width, height, scale)
        self.home = tempfile.mkdtemp(prefix="marram_view_")
        read_end, self.to = os.pipe()
        self.from_, write_end = os.pipe()

        def place_pipes():  # dup2 leaves them open in chromium; they may be 3 and 4 already, so by way of others
            a, b = os.dup(read_end), os.dup(write_end)
            high_a, high_b = 100, 101
            os.dup2(a, high_a)
            os.dup2(b, high_b)
            os.dup2(high_a, 3)
            os.dup2(high_b, 4)

        arguments = [self.program, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--use-angle=swiftshader",
                     "--enable-unsafe-swiftshader", "--disable-dev-shm-usage", "--disable-background-networking", "--no-first-run",
                     "--disable-component-update", "--disable-extensions", "--hide-scrollbars", "--mute-audio",
                     f"--force-device-scale-factor={scale}", f"--window-size={width},{height}", f"--user-data-dir={self.home}/profile",
                     "about:blank"]
        environment = dict(os.environ, HOME=self.home, TMPDIR=self.home)
        self.process = subprocess.Popen(arguments, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                        preexec_fn=place_pipes, close_fds=False, env=environment)
        os.close(read_end)
        os.close(write_end)
        self.buffer = b""
        self.last_id = 0
        self.answers = {}
        self.pages = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        try:
            self.send("Browser.close")
            self.process.wait(20)
        except (BrowserError, OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        os.close(self.to)
        os.close(self.from_)
        shutil.rmtree(self.home, ignore_errors=True)

    def send(self, method, session=None, **params):
        """Sends a command and returns its result."""
        self.last_id += 1
        number = self.last_id
        message = {"id": number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self.to, data):]
        until = time.monotonic() + PATIENCE
        while number not in self.answers:
            self.receive(until, method)
        answer = self.answers.pop(number)
        if "error" in answer:
            raise BrowserError(f"{method}: {answer['error'].get('message')}")
        return answer["result"]

    def receive(self, until, what):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.from_], [], [], max(0, until - time.monotonic()))
            if not ready:
                raise BrowserError(f"chromium does not answer to {what}")
            data = os.read(self.from_, 1 << 20)
            if not data:
                raise BrowserError("chromium has ended")
            self.buffer += data
        text, self.buffer = self.buffer.split(b"\0", 1)
        message = json.loads(text)
        if "id" in message:
            self.answers[message["id"]] = message
        elif message.get("sessionId") in self.pages:
            self.pages[message["sessionId"]].event(message["method"], message["params"])

    def open(self, url, script=None):
        """A new tab. `script` runs in it before the page's own."""
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = self.pages[session] = Page(self, session, target)
        for domain in ("Page", "Runtime", "Log"):
            page.send(domain + ".enable")
        width, height, scale = self.size
        page.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False)
        if script:
            page.send("Page.addScriptToEvaluateOnNewDocument", source=script)
        page.navigate(url)
        return page


KEYS = {" ": ("Space", 32), "Enter": ("Enter", 13), "Escape": ("Escape", 27), "Delete": ("Delete", 46), "Tab": ("Tab", 9), "Home": ("Home", 36),
        "End": ("End", 35), "ArrowLeft": ("ArrowLeft", 37), "ArrowUp": ("ArrowUp", 38), "ArrowRight": ("ArrowRight", 39), "ArrowDown": ("ArrowDown", 40),
        "/": ("Slash", 191), "?": ("Slash", 191), "Backspace": ("Backspace", 8)}
MODIFIERS = {"alt": 1, "ctrl": 2, "meta": 4, "shift": 8}


class Page:
    def __init__(self, browser, session, target):
        self.browser, self.session, self.target = browser, session, target
        self.errors = []    # of the console, and exceptions
        self.warnings = []

    def send(self, method, **params):
        return self.browser.send(method, self.session, **params)

    def event(self, method, params):
        if method == "Runtime.consoleAPICalled":
            text = " ".join(str(part.get("value", part.get("description", ""))) for part in params["args"])
            if params["type"] in ("error", "assert"):
                self.errors.append(text)
            elif params["type"] == "warning":
                self.warnings.append(text)
        elif method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")

    def navigate(self, url):
        self.send("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")

    def activate(self):
        self.browser.send("Target.activateTarget", targetId=self.target)

    def close(self):
        self.browser.send("Target.closeTarget", targetId=self.target)

    def evaluate(self, expression):
        """The value of a JavaScript expression; promises are awaited."""
        result = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True)
        if "exceptionDetails" in result:
            details = result["exceptionDetails"]
            raise BrowserError(details.get("exception", {}).get("description") or details["text"])
        return result["result"].get("value")

    def wait_for(self, expression, what=None, patience=None):
        """Waits until the expression is true, and returns its value."""
        until = time.monotonic() + (patience or PATIENCE)
        while True:
            try:
                value = self.evaluate(expression)
            except BrowserError as error:
                if "Cannot find context" not in str(error) and "navigat" not in str(error):
                    raise
                value = None
            if value:
                return value
            if time.monotonic() > until:
                raise BrowserError(f"waited in vain for {what or expression}")
            time.sleep(0.05)

    def box(self, selector):
        box = self.evaluate(f"(() => {{ const e = document.querySelector({json.dumps(selector)}); if (!e) return null; "
                            "e.scrollIntoView({block: 'nearest'}); const b = e.getBoundingClientRect(); "
                            "return {x: b.x, y: b.y, width: b.width, height: b.height}; })()")
        if not box or not box["width"]:
            raise BrowserError(f"{selector} is not shown")
        return box

    def mouse(self, kind, x, y, button="left", **more):
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, **more)

    def click(self, selector, count=1, at=(0.5, 0.5)):
        box = self.box(selector)
        x, y = box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"]
        self.mouse("mouseMoved", x, y, "none")
        for number in range(1, count + 1):
            self.mouse("mousePressed", x, y, clickCount=number, buttons=1)
            self.mouse("mouseReleased", x, y, clickCount=number)

    def drag(self, selector, start, end, steps=6, button="left", hold=False):
        """From one point of an element to another, both in shares of its size."""
        box = self.box(selector)
        point = lambda share: (box["x"] + share[0] * box["width"], box["y"] + share[1] * box["height"])
        (x0, y0), (x1, y1) = point(start), point(end)
        buttons = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mouseMoved", x0, y0, "none")
        self.mouse("mousePressed", x0, y0, button, clickCount=1, buttons=buttons)
        for i in range(1, steps + 1):
            self.mouse("mouseMoved", x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps, button, buttons=buttons)
        if not hold:
            self.mouse("mouseReleased", x1, y1, button, clickCount=1)

    def key(self, key, *modifiers):
        code, number = KEYS.get(key, ("Key" + key.upper(), ord(key.upper()[0])))
        bits = sum(MODIFIERS[modifier] for modifier in modifiers)
        text = key if len(key) == 1 and not bits & 6 else "\r" if key == "Enter" else ""
        down = {"type": "keyDown" if text else "rawKeyDown", "key": key, "code": code, "windowsVirtualKeyCode": number, "modifiers": bits}
        if text:
            down["text"] = text
        self.send("Input.dispatchKeyEvent", **down)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, code=code, windowsVirtualKeyCode=number, modifiers=bits)

    def type(self, text):
        self.send("Input.insertText", text=text)

    def screenshot(self, path):
        data = base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])
        with open(path, "wb") as file:
            file.write(data)
        return data
