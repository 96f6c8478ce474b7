# SPDX-License-Identifier: Apache-2.0
"""The program marram: finds it, and runs it with progress and cancellation."""
import os
import re
import selectors
import shutil
import signal
import subprocess
import tempfile
import threading

import bpy

from .notes import ExportError


def find_marram() -> str:
    """Path of the program: from the add-on's preferences, else the environment variable MARRAM, else PATH."""
    addon = bpy.context.preferences.addons.get(__package__)
    given = bpy.path.abspath(addon.preferences.program) if addon and addon.preferences.program else ""
    for path, source in ((given, "the add-on's preferences"), (os.environ.get("MARRAM", ""), "the environment variable MARRAM")):
        if not path:
            continue
        if os.path.isfile(path) and os.access(path, os.X_OK):
            return path
        raise ExportError(f"there is no program {path}: {source} should name marram")
    if found := shutil.which("marram"):
        return found
    raise ExportError("marram was not found: name it in the add-on's preferences, in the environment variable MARRAM, or put it on PATH")


class Cancelled(Exception):
    pass


def on_main_thread(call, cancelled=lambda: False):
    """Runs `call` on the main thread and waits. A render runs in its own thread, which must not create or write
    Blender data."""
    if bpy.app.background or threading.get_ident() == threading.main_thread().ident:
        return call()
    done, outcome = threading.Event(), []

    def there():
        try:
            outcome.append((call(), None))
        except Exception as error:
            outcome.append((None, error))
        done.set()
    bpy.app.timers.register(there)
    while not done.wait(0.1):
        if cancelled() and bpy.app.timers.is_registered(there):
            bpy.app.timers.unregister(there)
            raise Cancelled()
    value, error = outcome[0]
    if error:
        raise error
    return value


def _terminal():
    """A pseudo-terminal, as marram prints its progress only to terminals. None if the system has none."""
    try:
        import pty
        return pty.openpty()
    except (ImportError, OSError):
        return None


class _Progress:
    """Parses progress lines such as "rendering [###...]  42 %  0:10 left", and keeps all other lines."""
    _bar = re.compile(r"([^\r\n\[\]]*) \[[#.]*\] +(\d+) %")

    def __init__(self):
        self.phase, self.fraction, self._text = "", 0.0, ""
        self.messages: list[str] = []

    def feed(self, text: str):
        self._text += text.replace("\x1b[K", "")
        for phase, percent in self._bar.findall(self._text):
            self.phase, self.fraction = phase.strip() or self.phase, int(percent) / 100
        cut = max(self._text.rfind("\r"), self._text.rfind("\n"))
        self.messages += [line for line in re.split(r"[\r\n]+", self._text[:cut + 1]) if line.strip() and not self._bar.search(line)]
        self._text = self._text[cut + 1:]


def run_marram(arguments: list[str], cancelled=lambda: False, progress=lambda phase, fraction: None) -> list[str]:
    """Runs marram and returns its warnings. Raises ExportError with its first message if it fails, Cancelled if
    it was interrupted."""
    command = [find_marram(), *arguments]
    terminal = _terminal()
    reading, writing = terminal if terminal else os.pipe()
    state = _Progress()
    with tempfile.TemporaryFile() as said:
        try:
            child = subprocess.Popen(command, stdout=said, stderr=writing, stdin=subprocess.DEVNULL)
        except OSError as error:
            os.close(reading)
            os.close(writing)
            raise ExportError(f"{command[0]} cannot be run: {error.strerror}") from error
        os.close(writing)
        os.set_blocking(reading, False)
        asked, told = False, None
        with selectors.DefaultSelector() as wait:
            wait.register(reading, selectors.EVENT_READ)
            while True:
                chunk = _read(reading) if wait.select(0.1) else None
                if chunk == b"":  # end of file
                    break
                if chunk:
                    state.feed(chunk.decode(errors="replace"))
                if told != (state.phase, state.fraction):
                    told = state.phase, state.fraction
                    progress(*told)
                if cancelled() and not asked:
                    child.send_signal(signal.SIGINT)
                    asked = True
        os.close(reading)
        child.wait()
    state.feed("\n")
    if asked:
        raise Cancelled()
    messages = [re.sub(r"^/\S*/marram_[^/]*/scene\.toml:\d+:\d+: ", "", line) for line in state.messages]
    if child.returncode != 0:
        raise ExportError(messages[0] if messages else f"marram ended with exit code {child.returncode}")
    return messages


def _read(descriptor) -> bytes | None:
    try:
        return os.read(descriptor, 65536)
    except BlockingIOError:
        return None
    except OSError:  # a terminal whose other end is closed
        return b""
