#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`marram view` without a browser: who is served and who is refused, frames against `marram bake`, changes, pictures,
several pages, floods. usage: server_test.py MARRAM"""
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import time

from client import Page, Program, request

marram = os.path.abspath(sys.argv[1])
scenes = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../scenes")
failures = 0


def check(name, good, more=""):
    global failures
    failures += not good
    print(f"{'ok' if good else 'FAILED'}: {name}{': ' + str(more) if more != '' and not good else ''}", flush=True)


SCENE = """# A ball of hair.
fps = 24
frames = [1, 48]
tolerance = 0.001

[camera]
position = [0, 0.5, 3]
target = [0, 0, 0]

[film]
size = [160, 90]

[wind]
speed = 6 # m/s
noise.amplitude = 0.5
jiggle = { frequency = 3, damping = 0.3 }
collision.solver = "exact"

[[light]]
name = "sun"
type = "sun"
direction = [1, 2, 1]

[[material]]
name = "hair"
type = "hair"
color = [0.4, 0.2, 0.1]

[[mesh]]
name = "ball"
type = "sphere"
radius = 0.5

[[procedural]]
name = "fur"
type = "groom"
on = "ball"
count = 3000
length = 0.3
width = 0.002
material = "hair"
"""


def ask(page, seq, frame, budget=100000, encoding="f32"):
    page.send(type="frame", seq=seq, frame=frame, budget=budget, encoding=encoding)


def cvs_of_hair(path):
    """The CVs of a .hair file (C. Yuksel's format), as bytes of 3 floats each, and how many each strand has."""
    with open(path, "rb") as file:
        data = file.read()
    strands, points, flags, segments = struct.unpack("<IIII", data[4:20])
    at = 128
    counts = [segments + 1] * strands
    if flags & 1:
        counts = [1 + n for n in struct.unpack(f"<{strands}H", data[at:at + 2 * strands])]
        at += 2 * strands
    return data[at:at + 12 * points], counts


def vertices_of_frame(page):
    """The positions of all vertices of a part in float mode, strand by strand as bytes."""
    header, payload = page.until("frame")
    return b"".join(payload[c["offset"]:c["offset"] + 12 * c["vertices"]] for c in header["parts"][0]["chunks"]), header


def who_is_served(address):
    token = address.rstrip("/").rsplit("/", 1)[1]
    status, body = request(address)
    check("the page is served", status == 200 and b"<html" in body, status)
    for name in re.findall(rb'(?:src|href)="([^":,]+)"', body):
        check(f"its file {name.decode()} is served", request(address, f"/{token}/{name.decode()}")[0] == 200)
    wrong = token[:-1] + ("0" if token[-1] != "0" else "1")
    for path in ("/", "/index.html", f"/{wrong}/", f"/{token}", f"/{token}/../../etc/passwd", f"/{token}/%2e%2e/x",
                 f"/{token}//etc/passwd", f"/{token}/nothing.js", "/" + "a" * 9000):
        status = request(address, path)[0]
        check(f"{path[:40]} is refused", status in (400, 403, 404, 431), status)
    for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost.evil.example:1"):
        check(f"the host {host} is refused", request(address, host=host)[0] == 403)
        check(f"a socket of the host {host} is refused", Page(address, host=host).status == 403)
    check("a tunnel's port is served", request(address, host="localhost:9")[0] == 200)
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1", "https://" + address[7:].split("/")[0]):
        check(f"a page of {origin} is refused", Page(address, origin=origin).status == 403)
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        check(f"{method} is refused", request(address, method=method)[0] in (400, 405))
    status, _ = request(address, method="POST", headers={"Content-Length": str(1 << 30)})
    check("a request of 1 GB is refused", status in (0, 400, 405, 413), status)


def floods(address):
    page = Page(address)
    try:
        for i in range(20000):
            page.send(type="set", key=f"key{i}", value="1")
        page.until("never")
        check("a flood ends", False)
    except (ConnectionError, OSError):
        check("a flood ends", True)
    page = Page(address)
    try:
        page.send_bytes(b"{" * 200000)
        page.until("never")
        check("a huge message ends", False)
    except (ConnectionError, OSError):
        check("a huge message ends", True)
    page = Page(address)
    page.send_bytes(b"\xff\xff")
    try:
        page.until("never")
        check("text that is not UTF-8 ends", False)
    except ConnectionError:
        check("text that is not UTF-8 ends", True)
    for data in (b"", b"[[[[", b'{"type":"frame"}', b'{"type":"render","seq":1}'):
        page = Page(address)
        page.send_bytes(data)
        page.send_bytes(data, 2)  # binary
        page.until("scene")
        ask(page, 1, 1, 100)
        check(f"{data[:20]} is passed over", page.until("frame")[0]["seq"] == 1)
        page.close()


def frames_are_those_of_bake(folder, scene, address):
    page = Page(address)
    page.until("scene")
    last = None
    for number, frame in enumerate((1, 2, 2.25, 7, 3.5, 7)):
        ask(page, number, frame)
        if number == 0:
            part = page.until("strands")[0]["parts"][0]
            check("all strands are chosen", part["strands"] == part["of"] == 3000, part)
        vertices, header = vertices_of_frame(page)
        out = os.path.join(folder, "a.hair")
        subprocess.run([marram, "bake", scene, "-o", out, "--frame", str(frame), "--quiet"], check=True, stdout=subprocess.DEVNULL)
        cvs, counts = cvs_of_hair(out)
        at, first, same = 0, 0, True
        for count in counts:
            same = same and vertices[at + 12:at + 12 * (count + 1)] == cvs[first:first + 12 * count]
            at += 12 * (count + 2)
            first += 12 * count
        check(f"frame {frame} has the bits of marram bake", same and at == len(vertices), (at, len(vertices)))
        if frame == 7:
            check("the same frame again: the same bits", last is None or last == vertices)
            last = vertices
        ask(page, 100 + number, frame, encoding="u16")
        coarse, payload = page.until("frame", seq=100 + number)
        worst = 0.0
        exact = struct.unpack(f"<{len(vertices) // 4}f", vertices)
        for chunk in coarse["parts"][0]["chunks"]:
            n, begin = 3 * chunk["vertices"], 3 * chunk["first_vertex"]
            steps = struct.unpack(f"<{n}H", payload[chunk["offset"]:chunk["offset"] + 2 * n])
            for i in range(0, n, 7):
                a = i % 3
                off = abs(chunk["lower"][a] + steps[i] * chunk["step"][a] - exact[begin + i])
                worst = max(worst, (off - 1e-6) / chunk["step"][a])
        check(f"16 bits are within half a unit: {worst:.3f}", worst <= 0.5)
    page.close()


def changes(folder, scene, address):
    one, two = Page(address), Page(address)
    one.until("scene"), two.until("scene")
    one.send(type="set", key="wind.speed", value="9")
    a, b = one.until("scene", undo=True), two.until("scene", undo=True)
    check("both pages hear of a change", a["changes"] == b["changes"] == ["wind.speed=9"])
    value = [p for g in a["groups"] for p in g["params"] if p["key"] == "wind.speed"][0]
    check("a changed value is marked", value["changed"] and value["value"] == "9" and value["unit"] == "m/s", value)
    ask(two, 1, 5)
    vertices, _ = vertices_of_frame(two)
    out = os.path.join(folder, "b.hair")
    subprocess.run([marram, "bake", scene, "-o", out, "--frame", "5", "--set", "wind.speed=9", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    cvs, counts = cvs_of_hair(out)
    check("a change has the bits of --set", vertices[12:12 * (counts[0] + 1)] == cvs[:12 * counts[0]])
    one.send(type="set", key="wind.speed", value='"fast"')
    problems = two.until("problems")["problems"]
    check("a mistake is told to all", len(problems) == 1 and "wind.speed" in problems[0]["what"], problems)
    one.until("problems")
    one.send(type="set", key="wind.speed", value='"fast"')
    check("the same mistake is told again", one.until("problems")["problems"] == problems and two.until("problems")["problems"] == problems)
    ask(two, 2, 5)
    check("the last good state stays", vertices_of_frame(two)[0] == vertices)
    one.send(type="undo")
    check("undo", one.until("scene", undo=False)["changes"] == [])
    check("and the mistake is gone", two.until("problems")["problems"] == [])
    one.send(type="redo")
    check("redo", one.until("scene", redo=False)["changes"] == ["wind.speed=9"])
    before = open(scene).read()
    one.send(type="save")
    one.until("saved")
    text = open(scene).read()
    check("save changes one line", text == before.replace("speed = 6 # m/s", "speed = 9 # m/s"))
    with open(scene, "w") as file:
        file.write(before.replace("fps = 24", "fps = "))
    place = one.until("problems")["problems"][0]["place"]
    check("a mistake in the file is told at its line", place.endswith("ball.toml:2:6") or ":2" in place or ":3" in place, place)
    ask(two, 3, 5)
    check("and the last good state stays", vertices_of_frame(two)[0] == vertices)
    with open(scene, "w") as file:
        file.write(before)
    check("a corrected file is taken up", one.until("problems")["problems"] == [] and one.until("scene")["changes"] == [])
    for pause in (0, 0.001, 0.003, 0.01):  # some arrive while the one before loads the scene anew
        one.send(type="set", key="mesh.ball.divisions", value=str(64 + round(1000 * pause)))
        time.sleep(pause)
    one.send(type="set", key="wind.speed", value="3")
    one.send(type="set", key="wind.calm", value="0.5")
    scenes = [one.until("scene")["changes"]]
    while len(scenes) < 20 and not any(c.startswith("wind.calm") for c in scenes[-1]):
        scenes.append(one.until("scene")["changes"])
    check("no change is lost while another loads", scenes[-1] == ["mesh.ball.divisions=74", "wind.calm=0.5", "wind.speed=3"], scenes)
    one.send(type="reset")
    one.close()
    two.until("scene", changes=[])  # a frame that is asked for before is skipped if the change arrives then
    ask(two, 4, 5)
    two.until("frame", seq=4)
    check("a page closes in the middle, the other goes on", True)
    two.close()


def values_and_gusts(address):
    page = Page(address)
    scene = page.until("scene")
    names = [v["name"] for v in scene["values"]]
    check("attributes to colour by", {"envelope", "gust", "shield", "contact"} <= set(names) and "id" not in names, names)
    gusts = "{ num_gusts = 12, radius_range = [0.8, 1.5], period = 24 }"
    for key, value in (("wind.gusts", gusts), ("wind.speed", "10"), ("wind.calm", "0.6"), ("wind.global_rotate", "1")):
        page.send(type="set", key=key, value=value)
    while len(page.until("scene", undo=True)["changes"]) < 4:
        pass
    some = 0
    for seq, (name, frame) in enumerate((("gust", 9), ("contact", 9), ("envelope", 12.5), ("nothing", 1)), 1):
        page.send(type="frame", seq=seq, frame=frame, budget=1000, encoding="u16", values=name)
        header, payload = page.until("frame", seq=seq)
        chunk, span = header["parts"][0]["chunks"][0], header["values"]
        if name == "nothing":
            check("an unknown attribute has no values", "values" not in chunk and span["upper"] == 0)
            continue
        check(f"{name} has values", span["name"] == name and 0 <= span["lower"] < span["upper"] <= {"contact": 2, "gust": 9, "envelope": 1}[name], span)
        steps = struct.unpack(f"<{chunk['vertices']}H", payload[chunk["values"]:chunk["values"] + 2 * chunk["vertices"]])
        check(f"{name} has many values", len(set(steps)) > (1 if name == "contact" else 50), len(set(steps)))
        some += len(header["gusts"])
    check("random gusts are told", some > 0, some)
    page.send(type="set", key="wind.gusts.control", value="[{ transform = { translate = [1, 2, 3] } }]")
    handles = page.until("scene")["handles"]
    check("a gust by hand has a handle", len(handles) == 1 and handles[0]["keys"][1:4] == [1, 2, 3] and handles[0]["kind"] == "gust", handles)
    page.send(type="reset")
    page.until("scene", undo=True)
    page.close()


def pictures(folder, scene, address):
    page = Page(address)
    camera = page.until("scene")["camera"]
    view = {k: camera[k] for k in ("position", "target", "up", "fov")}
    picture = dict(type="render", frame=3, camera=view, size=[160, 90], layer="beauty", exposure=0, samples=16)
    page.send(seq=1, **picture)
    images, samples = [], []
    while True:
        message = page.receive()
        if message[1]["type"] == "image":
            samples.append(message[1]["samples"])
            images.append(message[2])
        if message[1]["type"] == "render_done":
            break
    check("a picture refines", samples == sorted(set(samples)) and samples[-1] == 16 and len(samples) > 1, samples)
    check("it is a picture", len(images[-1]) == 160 * 90 * 4 and len(set(images[-1])) > 20)
    out = os.path.join(folder, "a.png")
    subprocess.run([marram, "render", scene, "-o", out, "--frame", "3", "--size", "160x90", "--spp", "16", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    check("marram render's picture is there", os.path.getsize(out) > 1000)
    page.send(seq=2, **{**picture, "samples": 60000})
    page.until("image", seq=2)
    begin = time.time()
    ask(page, 9, 4, 100)
    page.until("frame", seq=9)
    print(f"     a frame while a picture is traced: {1e3 * (time.time() - begin):.0f} ms")
    for seq, layer in enumerate(("albedo", "normal", "depth", "alpha"), 3):
        page.send(seq=seq, **{**picture, "layer": layer, "samples": 1})
        header, pixels = page.until("image", seq=seq)
        check(f"layer {layer}", len(set(pixels)) > 1)
    page.send(seq=10, **{**picture, "samples": 1})
    whole = page.until("image", seq=10)[1]
    page.send(seq=13, **{**picture, "samples": 1, "crop": [50, 20, 40, 30]})
    header, part = page.until("image", seq=13)
    rows = b"".join(whole[4 * (160 * y + 50):4 * (160 * y + 90)] for y in range(20, 50))
    check("a part of a picture is that of the whole", part == rows and [header[k] for k in ("x", "y", "width", "height")] == [50, 20, 40, 30], header)
    page.send(seq=7, **{**picture, "samples": 1, "budget": 300})
    draft = page.until("image", seq=7)[1]
    far = sum(abs(a - b) for a, b in zip(draft, whole)) / len(whole)
    check("a draft of a tenth of the strands looks alike", draft != whole and far < 25, far)
    page.send(seq=11, **{**picture, "layer": "nothing"})
    check("an unknown layer is a mistake", "nothing" in page.until("problems")["problems"][0]["what"])
    page.send(seq=12, **picture)
    page.until("render_done", seq=12)
    page.close()


def files(folder, scene, address):
    page = Page(address)
    camera = page.until("scene")["camera"]
    order = dict(type="series", seq=1, folder="out", frames="2-4x2", format="png")
    page.send(**order)
    first = page.until("series")
    header, pixels = page.until("series_picture")
    done = page.until("series_done")
    there = lambda: sorted(os.listdir(os.path.join(folder, "out")))
    check("frames are rendered into a folder", there() == ["ball.0002.png", "ball.0004.png"] and done["pictures"] == 2 and not done["problems"], (done, there()))
    check("told how far", first["frame"] == 2 and first["of"] == 2 and first["of_samples"] == 64, first)
    check("each is shown", header["frame"] == 2 and len(pixels) == 4 * 160 * 90 and len(set(pixels)) > 20)
    out = os.path.join(folder, "b.png")
    subprocess.run([marram, "render", scene, "-o", out, "--frame", "4", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    alike = subprocess.run([marram, "compare", out, os.path.join(folder, "out", "ball.0004.png")], capture_output=True, text=True)
    check("they are those of marram render", alike.returncode == 0, alike.stdout + alike.stderr)
    time_of = lambda: os.stat(os.path.join(folder, "out", "ball.0004.png")).st_mtime_ns
    before = time_of()
    for more, word in (({}, "exists already"), ({"frames": "4-2"}, "frames"), ({"folder": "none/out"}, "cannot be made"), ({"folder": ""}, "none is given"),
                       ({"frames": "1-9999999"}, "frames"), ({"folder": "ball.toml"}, "cannot be made")):
        page.send(**{**order, "seq": 2, **more})
        lines = page.until("series_done", seq=2)["problems"]
        check(f"{more or 'the same again'} is refused", len(lines) > 0 and word in lines[0]["place"] + lines[0]["what"] and lines[0]["fix"], lines)
    check("and nothing was written", time_of() == before and there() == ["ball.0002.png", "ball.0004.png"])
    page.send(**{**order, "seq": 3, "frames": "4", "replace": True, "camera": {k: camera[k] for k in ("target", "up", "fov")} | {"position": [0, 0.5, 9]}})
    page.until("series_done", seq=3)
    other = subprocess.run([marram, "compare", out, os.path.join(folder, "out", "ball.0004.png")], capture_output=True)
    check("with the view's camera, if it is told to replace", time_of() != before and other.returncode == 1)
    page.send(**{**order, "seq": 4, "folder": "long", "frames": "1-1000"})
    page.until("series_picture", seq=4)
    ask(page, 5, 7, 100)
    page.until("frame", seq=5)
    page.until("series_picture", seq=4)
    check("frames of the strands come meanwhile", True)
    page.send(type="set", key="wind.speed", value="7")
    done = page.until("series_done", seq=4)
    count = len(os.listdir(os.path.join(folder, "long")))
    check("a change of the scene ends it", done["pictures"] == count and "changed" in done["problems"][0]["what"], done)
    page.send(type="reset")
    page.until("scene", undo=True)
    page.send(**{**order, "seq": 6, "folder": "long", "frames": "500-1000"})
    page.until("series_picture", seq=6)
    page.send(type="stop_series")
    ask(page, 7, 1, 100)
    page.until("frame", seq=7)
    whole = [name for name in os.listdir(os.path.join(folder, "long")) if not name.startswith("ball.") or not name.endswith(".png")]
    check("stopped, it leaves whole pictures alone", whole == [], whole)
    for name in ("out", "long"):
        shutil.rmtree(os.path.join(folder, name))
    os.remove(out)
    page.close()


def main():
    folder = tempfile.mkdtemp(prefix="marram_view_")
    try:
        scene = os.path.join(folder, "ball.toml")
        with open(scene, "w") as file:
            file.write(SCENE)
        with Program(marram, scene) as program:
            who_is_served(program.address)
            floods(program.address)
            frames_are_those_of_bake(folder, scene, program.address)
            changes(folder, scene, program.address)
            values_and_gusts(program.address)
            pictures(folder, scene, program.address)
            files(folder, scene, program.address)
            left = sorted(os.listdir(folder))
            check("nothing else is written", set(left) == {"ball.toml", "a.hair", "b.hair", "a.png"}, left)
            idle = Page(program.address)
            code, messages = program.close()
            check("Ctrl-C ends it", code == 0 and messages == "", (code, messages))
            idle.close()
        with open(scene, "w") as file:
            file.write("fps = \n")
        with Program(marram, scene) as program:
            page = Page(program.address)
            check("a scene with a mistake opens", page.until("problems")["problems"][0]["place"] != "")
            with open(scene, "w") as file:
                file.write(SCENE)
            check("and is taken up when it is corrected", page.until("scene")["frames"] == [1, 48])
            page.close()
        shutil.copy(os.path.join(scenes, "wind_bend.toml"), folder)
        with Program(marram, os.path.join(folder, "wind_bend.toml")) as program:
            page = Page(program.address)
            page.until("scene")
            ask(page, 1, 2, 100)
            page.until("frame")
            check("a simulation leaves no states behind", not os.path.exists(os.path.join(folder, "wind_bend.states")))
        taken = Program(marram, scene)
        port = taken.address.split(":")[2].split("/")[0]
        second = subprocess.run([marram, "view", scene, "--no-open", "--port", port], capture_output=True, text=True)
        check("a port in use is a mistake", second.returncode == 2 and f"--port {port}" in second.stderr, second.stderr)
        taken.close()
    finally:
        shutil.rmtree(folder)
    print(f"{failures} failures")
    return failures > 0


sys.exit(main())
