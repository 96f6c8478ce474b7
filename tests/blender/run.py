# SPDX-License-Identifier: Apache-2.0
"""Tests of the add-on, called by ./run in a Blender without a window. Prints what it measures; raises at the end where a check failed."""
import math
import os
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
ADDON = HERE.parents[1] / "core/integrations/blender/marram_blender"
MARRAM = os.environ["MARRAM"]
CV_LIMIT = 1e-6  # of the scene's size
sys.path.insert(0, str(HERE))
sys.dont_write_bytecode = True

import scenes  # noqa: E402

failures = []


def check(what: str, passed, measured=""):
    print(f"{'ok    ' if passed else 'FAILED'} {what}{f': {measured}' if str(measured) else ''}", flush=True)
    if not passed:
        failures.append(what)


def check_close(what: str, a, b, limit=CV_LIMIT):
    if a.shape != b.shape:
        return check(what, False, f"shapes {a.shape} and {b.shape}")
    size = max(1.0, float(np.abs(b).max()))
    worst = float(np.abs(a.astype("f8") - b).max()) / size
    check(what, worst <= limit, f"{worst:.3g} of the scene's size, at most {limit:g}")


def refused(what: str, call, *words):
    """One error, which has all of these words."""
    try:
        call()
        check(what, False, "nothing was said")
    except RuntimeError as error:
        lines = [line for line in str(error).splitlines() if line.startswith("Error")]
        check(what, len(lines) == 1 and all(word in lines[0] for word in words), lines[0] if lines else str(error))


def install(folder: Path):
    package = folder / "marram_blender.zip"
    with zipfile.ZipFile(package, "w") as zipped:
        for file in sorted(ADDON.glob("*.py")):
            zipped.write(file, f"marram_blender/{file.name}")
    bpy.ops.preferences.addon_install(filepath=str(package))
    for _ in range(2):  # and taken out again
        bpy.ops.preferences.addon_enable(module="marram_blender")
        on = hasattr(bpy.types.Scene, "marram")
        bpy.ops.preferences.addon_disable(module="marram_blender")
        check("the add-on comes and goes", on and not hasattr(bpy.types.Scene, "marram"))
    bpy.ops.preferences.addon_enable(module="marram_blender")


# ---- The scene

def small_scene():
    from marram_blender import import_strands
    scene = scenes.empty((1, 4))
    skin = scenes.material("skin", values={"Base Color": (0.4, 0.2, 0.1, 1)})
    coat = scenes.material("coat", "ShaderNodeBsdfHairPrincipled", {"Melanin": 0.5}, parametrization="MELANIN")
    body = scenes.sphere("body", skin, coat, radius=0.5, rings=12, location=(-0.6, 0, 0.6))
    scenes.particle_hair(body, 60, 0.2, 2, children=3, radius=0.02)
    for frame in (1, 4):
        body.location.y = -0.1 * frame
        body.rotation_euler.z = 0.2 * frame
        body.keyframe_insert("location", frame=frame)
        body.keyframe_insert("rotation_euler", frame=frame)
    ground = scenes.add(bpy.ops.mesh.primitive_grid_add, "ground", skin, smooth=False, size=4, x_subdivisions=8, y_subdivisions=8)
    counts, points, radii = scenes.blades(200, 5, 2.0, 0.3, 7)
    counts, points, radii = shortened(counts, points, radii)
    grass = import_strands.new_curves("grass", counts, points, 0.004 * radii, material=coat)
    grass.data.surface = ground
    moving_ball(skin)
    waving_flag(skin)
    camera = scenes.look(scene, (0, -4, 1.5), (0, 0, 0.4))
    for frame, x in ((1, 0.0), (4, 0.3)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    scenes.sun(scene, (1, -1, 2))
    scenes.plain_world(scene, (0.3, 0.4, 0.6))
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 48, 100
    scene.marram.samples = scene.cycles.samples = 4
    return scene


def shortened(counts, points, radii):
    """Every third strand a CV shorter: counts need not be the same."""
    keep = np.ones(len(points), bool)
    keep[np.cumsum(counts)[::3] - 1] = False
    counts = counts.copy()
    counts[::3] -= 1
    return counts, points[keep], radii[keep]


def moving_ball(skin):
    ball = scenes.add(bpy.ops.mesh.primitive_ico_sphere_add, "ball", skin, subdivisions=2, radius=0.2, location=(0.6, -0.4, 0.3))
    for frame in (1, 4):
        ball.location.z = 0.3 + 0.05 * frame
        ball.rotation_euler = (0.2 * frame, 0, 0.5 * frame)
        ball.keyframe_insert("location", frame=frame)
        ball.keyframe_insert("rotation_euler", frame=frame)


def waving_flag(skin):
    flag = scenes.add(bpy.ops.mesh.primitive_grid_add, "flag", skin, size=0.5, x_subdivisions=6, y_subdivisions=6, location=(0.8, 0.5, 0.6),
                      rotation=(math.pi / 2, 0, 0))
    wave = flag.modifiers.new("wave", "WAVE")
    wave.height, wave.width, wave.narrowness, wave.speed = 0.1, 0.3, 5, 0.05


# ---- Strands, read by other ways than the add-on's

def particles_in_blender():
    graph = bpy.context.evaluated_depsgraph_get()
    body = bpy.data.objects["body"].evaluated_get(graph)
    system = body.particle_systems[0]
    first, last = len(system.particles), len(system.particles) + len(system.child_particles)
    return np.array([system.co_hair(body, particle_no=k, step=step) for k in range(first, last) for step in range(9)], "f4")


def curves_in_blender(name):
    data = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(3 * len(data.points), "f4")
    data.attributes["position"].data.foreach_get("vector", points)
    radii = np.empty(len(data.points), "f4")
    data.attributes["radius"].data.foreach_get("value", radii)
    counts = np.empty(len(data.curves), "i4")
    data.curves.foreach_get("points_length", counts)
    return counts, points.reshape(-1, 3), radii


def marram(*arguments):
    return subprocess.run([MARRAM, *map(str, arguments)], capture_output=True, text=True)


def baked(scene_file, frame, *more):
    """(points in Blender's axes, diameters) of all strands, from a .hair file."""
    out = Path(scene_file).parent / "baked.hair"
    said = marram("bake", scene_file, "-o", out, "--frame", frame, *more)
    assert said.returncode == 0, said.stderr
    content = out.read_bytes()
    strands, points, flags, _ = np.frombuffer(content, "<u4", 4, 4)
    at = 128 + (2 * int(strands) if flags & 1 else 0)
    p = np.frombuffer(content, "<f4", 3 * points, at).reshape(-1, 3)
    return np.stack([p[:, 0], -p[:, 2], p[:, 1]], axis=1), np.frombuffer(content, "<f4", points, at + 12 * int(points))


def remove_blown():
    for thing in [thing for thing in bpy.data.objects if " blown" in thing.name]:
        bpy.data.objects.remove(thing)


# ---- Tests

def test_export(scene, folder):
    bpy.ops.marram.export(directory=str(folder), which="RANGE")
    file = folder / "scene.toml"
    said = marram("info", file)
    check("marram info accepts the scene", said.returncode == 0 and not said.stderr, said.stderr.strip())
    for frame in (1, 3):
        scene.frame_set(frame)
        out = folder / "colliders.obj"
        marram("bake", file, "-o", folder / "x.hair", "--frame", frame, "--colliders", out)
        for name in ("ball", "flag"):
            check_close(f"vertices of the {name} at frame {frame}", *nearest(obj_vertices(out, name), blender_vertices(name)))
    scene.frame_set(1)
    return file


def obj_vertices(path, name):
    rows, inside = [], False
    for line in open(path):
        if line.startswith("o "):
            inside = line.split()[1] == name
        elif inside and line.startswith("v "):
            x, y, z = map(float, line.split()[1:])
            rows.append((x, -z, y))
    return np.array(rows)


def blender_vertices(name):
    thing = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([thing.matrix_world @ vertex.co for vertex in thing.data.vertices])


def nearest(a, b):
    """Each of b's points and a's nearest to it: vertices come in another order, some more than once."""
    return a[((a[None] - b[:, None]) ** 2).sum(-1).argmin(1)], b


def test_render(scene, folder):
    scene.render.engine = "MARRAM"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(folder / "picture.exr")
    scene.render.use_motion_blur = True
    bpy.ops.render.render(write_still=True)
    scene.render.use_motion_blur = False
    pixels = picture(folder / "picture.exr")
    check("a picture of the right size comes back", pixels.shape == (48, 64, 4) and pixels[..., 3].min() == 1)
    sky, ground = pixels[-3, :, :3].mean(0), pixels[2, :, :3].mean(0)
    check("the sky is above, as bright as in Blender", np.allclose(sky, (0.3, 0.4, 0.6), rtol=0.01), sky.round(3))
    check("the ground is below, brown", ground[0] > 1.5 * ground[2] > 0.05, ground.round(3))


def picture(path):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Raw"
    pixels = np.empty(4 * image.size[0] * image.size[1], "f4")
    image.pixels.foreach_get(pixels)
    return pixels.reshape(image.size[1], image.size[0], 4)


def test_calm(scene):
    bpy.data.objects["body"].particle_systems[0].settings.child_nbr = 3  # what the viewport shows is what is rendered
    particles, (counts, points, radii) = particles_in_blender(), curves_in_blender("grass")
    bpy.ops.marram.blow(hide=False)
    check_close("particles there and back in calm air", curves_in_blender("body fur blown")[1], particles)
    back = curves_in_blender("grass strands blown")
    check("curves have their counts", np.array_equal(back[0], counts), f"{len(counts)} curves")
    check_close("curves there and back in calm air", back[1], points)
    check_close("radii there and back", back[2], radii)
    material = bpy.data.objects["grass strands blown"].material_slots[0].material
    check("and their material", material and material.name == "coat")
    bpy.ops.marram.blow(which="RANGE", hide=False)
    scene.frame_set(3)
    check_close("particles on a body that moves, at frame 3 of a range", curves_in_blender("body fur blown")[1], particles_in_blender())
    bpy.ops.marram.blow(hide=False)
    check_close("and at frame 3 alone", curves_in_blender("body fur blown")[1], particles_in_blender())
    scene.marram.hair_motion = "CARRIED"
    scene.frame_set(1)
    bpy.ops.marram.blow(which="RANGE", hide=False)
    scene.frame_set(3)
    check_close("carried by the body that moves", curves_in_blender("body fur blown")[1], particles_in_blender())
    scene.marram.hair_motion = "FRAMES"
    scene.frame_set(1)
    remove_blown()


def in_wind(scene, on=True):
    settings = scene.marram
    settings.speed, settings.direction = (8, (1, 0.3, 0)) if on else (0, (1, 0, 0))
    settings.collide, settings.shield, settings.jiggle, settings.gusts = on, 0.5 * on, 2.0 * on, 20 * on


def test_wind(scene, folder):
    in_wind(scene)
    bpy.ops.marram.export(directory=str(folder), which="CURRENT")
    points, diameters = baked(folder / "scene.toml", 1)
    rest = np.concatenate([particles_in_blender(), curves_in_blender("grass")[1]])
    bpy.ops.marram.blow(hide=False)
    back = [curves_in_blender(name) for name in ("body fur blown", "grass strands blown")]
    blown = np.concatenate([one[1] for one in back])
    check_close("in the wind strands are where marram bake has them", blown, points)
    check_close("with the same radii", np.concatenate([one[2] for one in back]), diameters / 2)
    moved = float(np.linalg.norm(blown - rest, axis=1).max())
    check("the wind moves them", moved > 0.05, f"up to {moved:.3g}")
    remove_blown()


def test_range(scene, folder):
    bpy.ops.marram.export(directory=str(folder), which="RANGE")
    bpy.ops.marram.blow(which="RANGE", hide=False)
    at = {}
    for frame in (1, 2, 4):
        scene.frame_set(frame)
        at[frame] = np.concatenate([curves_in_blender(name)[1] for name in ("body fur blown", "grass strands blown")])
        check_close(f"a range of frames, at frame {frame}", at[frame], baked(folder / "scene.toml", frame)[0])
    scene.frame_set(1, subframe=0.5)
    half = np.concatenate([curves_in_blender(name)[1] for name in ("body fur blown", "grass strands blown")])
    check_close("straight from frame to frame", half, (at[1].astype("f8") + at[2]) / 2)
    scene.frame_set(1)
    remove_blown()


def test_wind_in_time(scene, folder):
    """F-curves of the wind's settings, and of the object that it follows, become keys."""
    in_wind(scene)
    settings = scene.marram
    for frame, speed, shelter in ((1, 2.0, 0.0), (4, 9.0, 0.6)):
        settings.speed, settings.shield = speed, shelter
        settings.keyframe_insert("speed", frame=frame)
        settings.keyframe_insert("shield", frame=frame)
    for curve in scene.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    vane = bpy.data.objects.new("Vane", None)
    scene.collection.objects.link(vane)
    for frame, angle in ((1, 0.0), (4, 0.9)):
        vane.rotation_euler = (math.pi / 2, 0, angle)
        vane.keyframe_insert("rotation_euler", frame=frame)
    settings.wind_object = vane
    bpy.ops.marram.export(directory=str(folder), which="RANGE")
    with open(folder / "scene.toml", "rb") as file:
        wind = tomllib.load(file)["wind"]
    keys = {frame: value for frame, value in wind["speed"]["keys"]}
    check("a straight f-curve is two keys", abs(keys[1] - 2) < 1e-6 and abs(keys[4] - 9) < 1e-6, str(wind["speed"]))
    check("a setting of another stage has keys", len(wind["shielding"]["shield"]["keys"]) >= 2)
    first, last = wind["direction"]["keys"][0][1], wind["direction"]["keys"][-1][1]
    turn = math.acos(min(1, float(np.dot(first, last))))
    check("the wind turns with its object", abs(turn - 0.9) < 1e-4, f"{turn:.5g}")
    check("what is constant has no keys", isinstance(wind["global_rotate"], (int, float)))
    moved = np.abs(baked(folder / "scene.toml", 4)[0] - baked(folder / "scene.toml", 1)[0]).max()
    check("and marram blows it", moved > 0.02, f"up to {moved:.3g}")
    settings.wind_object = None
    bpy.data.objects.remove(vane)
    scene.animation_data_clear()
    in_wind(scene)


def animate(owner, path, values):
    """values: by frame; Blender's curves between them are not straight."""
    for frame, value in values.items():
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame)


def lamp(name, kind, **values):
    thing = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
    for key, value in values.items():
        setattr(thing.data if hasattr(thing.data, key) else thing, key, value)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def lit_scene():
    """A camera whose lens changes, and lamps of all kinds: moved, turned, scaled, hidden, coloured, still."""
    scene = scenes.empty((1, 5))
    grey = scenes.material("grey", "ShaderNodeBsdfDiffuse", {"Color": (0.5, 0.5, 0.5, 1)})
    scenes.add(bpy.ops.mesh.primitive_grid_add, "ground", grey, smooth=False, size=6)
    scenes.add(bpy.ops.mesh.primitive_cube_add, "block", grey, smooth=False, size=0.6, location=(0, 0, 0.3))
    scenes.plain_world(scene, (0.05, 0.05, 0.05))
    camera = scenes.look(scene, (0, -4, 1.5), (0, 0, 0.4))
    sharp = bpy.data.objects.new("sharp", None)
    scene.collection.objects.link(sharp)
    animate(camera, "location", {1: (0, -4, 1.5), 5: (0.4, -4, 1.5)})
    animate(camera.data, "lens", {1: 50, 5: 30})
    animate(sharp, "location", {1: (0, -1, 0.4), 5: (0.2, 2, 0.4)})
    camera.data.dof.use_dof, camera.data.dof.focus_object = True, sharp
    animate(camera.data.dof, "aperture_fstop", {1: 2.8, 5: 0.4})

    sun = lamp("sun", "SUN", angle=0.1)
    animate(sun, "rotation_euler", {1: (0.2, 0, 0), 5: (0.9, 0.3, 1.2)})
    animate(sun.data, "energy", {1: 0.5, 5: 2})
    jumps = lamp("jumps", "SUN", angle=0.1, energy=0.1)
    animate(jumps, "rotation_euler", {3: (0, 0.1, 0), 4: (math.pi, 0.1, 0)})
    panel = lamp("panel", "AREA", shape="RECTANGLE", energy=30)
    animate(panel, "location", {1: (-1, -1, 2), 5: (1, -1.5, 1.5)})
    animate(panel, "rotation_euler", {1: (0.3, 0, 0), 5: (0.8, 0.4, 0.5)})
    animate(panel, "scale", {1: (1, 1, 1), 5: (2, 1, 1)})
    animate(panel.data, "size", {1: 0.5, 5: 1})
    animate(panel.data, "color", {1: (1, 1, 1), 5: (1, 0.5, 0.2)})
    panel.data.size_y = 0.3
    lamp("still", "POINT", energy=10, shadow_soft_size=0.2, location=(1.5, 0, 1))
    moon = lamp("moon", "AREA", shape="DISK", size=0.4, energy=5)
    animate(moon, "location", {1: (0, 1, 1), 5: (0.7, 0.8, 1)})
    animate(moon, "rotation_euler", {1: (0.3, 0, 0), 5: (0, 0.3, 0)})
    glow = lamp("glow", "POINT", energy=5, location=(-1.5, 0, 1))
    glow.data.use_nodes = True
    emission = glow.data.node_tree.nodes["Emission"].inputs
    emission["Color"].default_value = (1, 0.5, 0.2, 1)
    animate(emission["Strength"], "default_value", {1: 1, 5: 3})
    bulb = lamp("bulb", "POINT", energy=20, shadow_soft_size=0.1, parent=sharp, location=(-0.8, -1, 0.6))
    animate(bulb, "hide_render", {1: True, 3: False, 5: True})  # seen later than the others, it comes last in every file
    lamp("dark", "POINT", energy=0)
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 48, 100
    scene.marram.samples = 16
    return scene


def tables_of(file):
    with open(file, "rb") as stream:
        told = tomllib.load(stream)
    return told["camera"], {one["name"]: one for one in told["light"]}, {one["name"]: one for one in told["mesh"]}


def at(value, frame):
    """A number or vector of a scene file at a frame, in Blender's axes if it is a direction."""
    if not isinstance(value, dict):
        return np.array(value)
    frames, values = [key[0] for key in value["keys"]], np.array([key[1] for key in value["keys"]], "f8").reshape(len(value["keys"]), -1)
    if value.get("interpolation") == "constant":
        return values[np.searchsorted(frames, frame, "right") - 1]
    return np.array([np.interp(frame, frames, column) for column in values.T]).squeeze()


def corners(folder, mesh, frame):
    """The vertices of a mesh in a scene file at a frame that has a key, in Blender's axes."""
    from mathutils import Euler, Matrix, Vector
    content = (folder / mesh["file"]).read_bytes()
    count = int(content.split(b"element vertex ")[1].split()[0])
    points = np.frombuffer(content, "<f4", 3 * count, content.find(b"end_header\n") + 11).reshape(-1, 3)
    if "transform" in mesh:
        key = next(key for key in mesh["transform"]["keys"] if key["frame"] == frame)
        turn = Euler([math.radians(angle) for angle in key["rotate"]], "XYZ")
        matrix = Matrix.LocRotScale(Vector(key["translate"]), turn, Vector(key["scale"]))
        points = np.array([matrix @ Vector(point) for point in points.tolist()])
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def test_lamps_and_lens(folder):
    """F-curves of lamps and of the camera's lens become keys; a frame alone has plain values."""
    scene = lit_scene()
    bpy.ops.marram.export(directory=str(folder), which="RANGE")
    camera, lights, meshes = tables_of(folder / "scene.toml")
    said = marram("info", folder / "scene.toml")
    check("marram info accepts lamps and lens with keys", said.returncode == 0 and not said.stderr, said.stderr.strip())
    worst = {}
    for frame in range(1, 6):
        scene.frame_set(frame)
        for what, (a, b) in {**lens_pairs(scene, camera, frame), **lamp_pairs(folder, lights, meshes, frame)}.items():
            worst[what] = max(worst.get(what, 0), float(np.abs(np.array(a) - np.array(b)).max() / max(1, np.abs(b).max())))
    check("keys of camera and lamps are Blender's values at all frames", max(worst.values()) < 2e-6,
          ", ".join(f"{what} {off:.2g}" for what, off in worst.items()))
    check("a lamp that only moves has no other keys", isinstance(lights["moon light"]["radiance"], list) and "transform" in meshes["moon"])
    check("what is constant has no keys", isinstance(lights["still light"]["radiance"], list) and "transform" not in meshes["still"]
          and isinstance(lights["sun"]["angle"], float))
    check("a lamp that is dark all along is left out", "dark" not in meshes and "dark light" not in lights)

    scene.frame_set(3)
    bpy.ops.marram.export(directory=str(folder / "alone"), which="CURRENT")
    check("a frame alone has no keys", "keys" not in (folder / "alone/scene.toml").read_text())
    pictures = []
    for file in (folder / "scene.toml", folder / "alone/scene.toml"):
        marram("render", file, "-o", file.with_suffix(".exr"), "--frame", 3, "--threads", 1)
        pictures.append(picture(file.with_suffix(".exr"))[..., :3])
    off = np.abs(pictures[0] - pictures[1]).mean() / pictures[1].mean()
    check("and the same picture as in the range", off < 1e-3 and pictures[1].mean() > 0.02, f"{off:.3g} of its brightness {pictures[1].mean():.3g}")
    alone = tables_of(folder / "alone/scene.toml")
    scene.render.use_motion_blur = True
    bpy.ops.marram.export(directory=str(folder / "blurred"), which="CURRENT")
    scene.render.use_motion_blur = False
    blurred = tables_of(folder / "blurred/scene.toml")
    check("with motion blur only transforms have keys", blurred[1] == alone[1] and "transform" in blurred[2]["panel"] and all(
        blurred[0][name] == alone[0][name] for name in ("fov", "focus", "lens_radius")))
    test_lamp_notes(scene, folder)


def lens_pairs(scene, told, frame):
    """The exported value and Blender's, by name."""
    graph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera.evaluated_get(graph)
    projection = camera.calc_matrix_camera(graph, x=64, y=48)
    away = camera.matrix_world.inverted() @ bpy.data.objects["sharp"].evaluated_get(graph).matrix_world.translation
    return {"fov": (1 / math.tan(math.radians(at(told["fov"], frame)) / 2), projection[1][1]),
            "focus": (at(told["focus"], frame), -away.z),
            "lens radius": (at(told["lens_radius"], frame) * 2000 * camera.data.dof.aperture_fstop, camera.data.lens)}


def lamp_pairs(folder, lights, meshes, frame):
    from mathutils import Vector
    graph = bpy.context.evaluated_depsgraph_get()
    sun, jumps, panel, bulb = (bpy.data.objects[name].evaluated_get(graph) for name in ("sun", "jumps", "panel", "bulb"))
    pairs = {}
    for thing in (sun, jumps):
        towards = at(lights[thing.name]["direction"], frame)
        pairs[f"{thing.name}'s direction"] = towards / np.linalg.norm(towards), np.array(thing.matrix_world.col[2].xyz)[[0, 2, 1]] * (1, 1, -1)
    pairs["sun's irradiance"] = at(lights["sun"]["irradiance"], frame), sun.data.energy * np.array(sun.data.color)
    half = Vector((panel.data.size / 2, panel.data.size_y / 2))
    rim = np.array([panel.matrix_world @ Vector((x * half.x, y * half.y, 0)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    pairs["panel's corners"] = corners(folder, meshes["panel"], frame), rim
    area = np.linalg.norm(np.cross(rim[1] - rim[0], rim[3] - rim[0]))
    pairs["panel's power"] = 4 * area * at(lights["panel light"]["radiance"], frame), panel.data.energy * np.array(panel.data.color)
    emission = bpy.data.objects["glow"].evaluated_get(graph).data.node_tree.nodes["Emission"].inputs
    shine, first = (at(lights["glow light"]["radiance"], one) for one in (frame, 1))
    pairs["glow of nodes"] = shine / first[0], emission["Strength"].default_value * np.array(emission["Color"].default_value)[:3]
    ball = corners(folder, meshes["bulb"], frame)
    on = not bulb.hide_render
    if on:  # while it is off it stays where it was
        pairs["bulb's place"] = (ball.min(0) + ball.max(0)) / 2, np.array(bulb.matrix_world.translation)
        pairs["bulb's size"] = ball[:, 2].max() - ball[:, 2].min(), 2 * bulb.data.shadow_soft_size
    pairs["bulb is on"] = float(at(lights["bulb light"]["radiance"], frame).max() > 0), float(on)
    return pairs


def test_lamp_notes(scene, folder):
    """One line a kind, with names."""
    from marram_blender import export_scene
    from marram_blender.notes import Notes
    for name in ("still", "bulb"):
        animate(bpy.data.lights[name], "type", {1: "POINT", 4: "SPOT"})
    scene.camera.data.shift_x = 0.1
    colour = bpy.data.materials["grey"].node_tree.nodes["Diffuse BSDF"].inputs["Color"]
    animate(colour, "default_value", {1: (0.5, 0.5, 0.5, 1), 5: (1, 0, 0, 1)})
    tree = bpy.data.lights["glow"].node_tree
    tree.links.new(tree.nodes.new("ShaderNodeLightFalloff").outputs[0], tree.nodes["Emission"].inputs["Strength"])
    notes = Notes()

    def goto(frame):
        scene.frame_set(frame)
        return bpy.context.evaluated_depsgraph_get()
    export_scene.export(export_scene.Job(str(folder / "notes"), 1, 5, goto, rendered=False, notes=notes), scene)
    lines = notes.lines()
    check("what is not exported of lamps, lens and materials is told once a kind", len(lines) == 4 and all(
        any(all(word in line for word in words) for line in lines) for words in (("bulb", "still"), ("shift",), ("glow",), ("grey",))),
        "; ".join(lines))


def test_world(scene, folder):
    """A sky of nodes is drawn by Cycles; its sun stands apart from it."""
    before = scene.world
    sky = scenes.nishita_world(scene, 0.1, 1.0)
    for frame, elevation in ((1, 0.1), (3, 0.5)):
        sky.sun_elevation = elevation
        sky.keyframe_insert("sun_elevation", frame=frame)
    scene.frame_set(3)
    bpy.ops.marram.export(directory=str(folder), which="CURRENT")
    with open(folder / "scene.toml", "rb") as file:
        lights = {light["name"]: light for light in tomllib.load(file)["light"]}
    expected = np.array([math.sin(1) * math.cos(0.5), math.sin(0.5), -math.cos(1) * math.cos(0.5)])
    off = math.degrees(math.acos(min(1, float(np.dot(expected, lights["sun of the world"]["direction"])))))
    check("the sun of a sky is where it is at that frame", off < 0.05, f"{off:.3g} degrees off")
    around = picture(folder / lights["world"]["file"])
    check("the image of a sky is as wide as twice its height", around.shape[1] == 2 * around.shape[0], around.shape[:2])
    check("and brighter above than below", around[around.shape[0] // 2:].mean() > 2 * around[:around.shape[0] // 2, :, :3].mean())
    scene.world = before
    scene.frame_set(1)


def test_cycles(scene, folder):
    """What has come back is drawn in place of what it was made of."""
    scene.render.engine, scene.render.filepath = "CYCLES", str(folder / "cycles.exr")
    bpy.ops.marram.blow()
    scene.render.film_transparent, scene.cycles.use_denoising = True, False
    meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    for thing in meshes:
        thing.hide_render = True
    bpy.ops.render.render(write_still=True)
    for thing in meshes:
        thing.hide_render = False
    covered = float(picture(folder / "cycles.exr")[..., 3].mean())
    check("Cycles draws blown strands as curves", covered > 0.02, f"they cover {covered:.3f} of the picture")


def test_again(scene):
    """Strands that were blown are blown anew from what they were made of; those that are kept go out and come back where they were."""
    names = sorted(thing.name for thing in bpy.data.objects if " blown" in thing.name)
    before = curves_in_blender("grass strands blown")[1]
    bpy.ops.marram.blow()
    check("blown again they replace what was blown", names == sorted(thing.name for thing in bpy.data.objects if " blown" in thing.name)
          and np.array_equal(curves_in_blender("grass strands blown")[1], before), ", ".join(names))
    kept = bpy.data.objects["grass strands blown"]
    kept.name = "meadow"
    del kept["marram_source"]
    in_wind(scene, False)
    bpy.ops.marram.blow()
    check_close("blown strands there and back once more", curves_in_blender("meadow strands blown")[1], before)


def test_reports(scene, folder):
    from marram_blender import export_scene
    from marram_blender.notes import Notes
    spot = bpy.data.objects.new("Spot", bpy.data.lights.new("Spot", "SPOT"))
    fog = bpy.data.objects.new("Fog", bpy.data.volumes.new("Fog"))
    for thing in (spot, fog):
        scene.collection.objects.link(thing)
    notes = Notes()
    export_scene.export(export_scene.Job(str(folder), 1, 1, lambda frame: bpy.context.evaluated_depsgraph_get(), rendered=False, notes=notes), scene)
    lines = notes.lines()
    check("what is not exported is told by name", any("Spot" in line for line in lines) and any("Fog" in line for line in lines), "; ".join(lines))
    for thing in (spot, fog):
        bpy.data.objects.remove(thing)


def test_blown_stays(scene, folder):
    """Marram does not blow a second time what it has blown."""
    from marram_blender import export_scene
    in_wind(scene)
    bpy.ops.marram.blow()
    names = ["body fur blown", "grass strands blown"]
    points = np.concatenate([curves_in_blender(name)[1] for name in names])
    job = export_scene.Job(str(folder), 1, 1, lambda frame: bpy.context.evaluated_depsgraph_get(), rendered=False)
    check_close("blown strands stay in Marram's pictures", baked(export_scene.export(job, scene), 1)[0], points)


def test_faults(scene, folder):
    from marram_blender import program
    scene.render.engine = "MARRAM"
    os.environ["MARRAM"] = "/no/such/program"
    refused("no program: the render says so", bpy.ops.render.render, "/no/such/program")
    refused("and the import", bpy.ops.marram.blow, "/no/such/program")
    os.environ["MARRAM"] = MARRAM
    scene.marram.more = "wind.sped=3"
    refused("a setting that is none", bpy.ops.render.render, "sped")
    scene.marram.more = ""
    broken = folder / "broken.toml"
    broken.write_text("[camera\n")
    try:
        program.run_marram(["render", str(broken)])
        check("a scene that cannot be read", False)
    except program.ExportError as error:
        check("a scene that cannot be read", "broken.toml:1" in str(error), error)
    try:
        program.run_marram(["render", str(folder / "scene.toml"), "-o", str(folder / "never.exr"), "--spp", "60000"], cancelled=lambda: True)
        check("a run that is cancelled", False)
    except program.Cancelled:
        check("a run that is cancelled leaves no picture", not (folder / "never.exr").exists())
    camera, scene.camera = scene.camera, None
    refused("no camera", lambda: bpy.ops.marram.export(directory=str(folder)), "camera")
    scene.camera = camera
    for thing in [thing for thing in bpy.data.objects if thing.type == "CURVES" or thing.particle_systems]:
        bpy.data.objects.remove(thing)
    refused("nothing to blow", bpy.ops.marram.blow, "no hair")


def main():
    with tempfile.TemporaryDirectory(prefix="marram_test_") as name:
        folder = Path(name)
        install(folder)
        scene = small_scene()
        test_export(scene, folder / "export")
        test_render(scene, folder)
        test_calm(scene)
        test_wind(scene, folder / "wind")
        test_range(scene, folder / "range")
        test_wind_in_time(scene, folder / "time")
        test_reports(scene, folder / "reports")
        test_world(scene, folder / "world")
        test_blown_stays(scene, folder / "stays")
        test_cycles(scene, folder)
        test_again(scene)
        test_faults(scene, folder / "wind")
        test_lamps_and_lens(folder / "lit")
    if failures:
        raise RuntimeError(f"{len(failures)} of the add-on's checks failed: {'; '.join(failures)}")
    print("all checks passed")


main()
