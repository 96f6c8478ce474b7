# SPDX-License-Identifier: Apache-2.0
"""Renders a world to an environment image, by Cycles in a separate Blender process, as this one may be rendering.

As a script it renders the image:  blender -b --factory-startup -P world_image.py -- WORLD.blend WORLD.exr WORLD.json
WORLD.json has the values of the world's nodes at the frame, as they may be animated. The sun disc of a Nishita
sky is left out of the image and measured. The script overwrites WORLD.json with it as a light "sun".

Images are cached until Blender ends, so that frames of an animation share one while the world does not change.
"""
import atexit
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile

import bpy

WIDTH, SAMPLES = 1024, 4
SEARCH_WIDTH, SEARCH_SAMPLES = 256, 64
MOST_WIDTH = 2048         # for worlds with images
DISC_PIXELS, DISC_SAMPLES = 64, 16
# Camera rotation: the center of the image is +y and up is +z, which are Marram's -z and y.
AHEAD = (math.pi / 2, 0.0, 0.0)


MOST_KEPT = 8
OF_THE_EDITOR = {"location", "width", "width_hidden", "height", "color", "select"}  # node properties without effect on the image
_kept: dict[str, tuple[str, dict | None]] = {}  # values of a world -> its image, its sun
_store = ""


def draw(world, folder: str, cancelled=lambda: False) -> dict:
    """world: evaluated. Returns the name of the image in the folder, and a [[light]] "sun" without name and type,
    or None."""
    global _store
    key = json.dumps([world.name_full, values_of(world), images_of(world)], sort_keys=True)
    if key not in _kept:
        if not _store:
            _store = tempfile.mkdtemp(prefix="marram_worlds_")
            atexit.register(shutil.rmtree, _store, ignore_errors=True)
        if len(_kept) >= MOST_KEPT:
            os.remove(_kept.pop(next(iter(_kept)))[0])
        _kept[key] = _draw(world, tempfile.mkdtemp(dir=_store), cancelled)
    image, sun = _kept[key]
    shutil.copy(image, os.path.join(folder, "world.exr"))
    return {"file": "world.exr", "sun": sun}


def values_of(world) -> dict:
    """Numbers and choices of all nodes and of their inputs, and the links."""
    nodes = {}
    for node in world.node_tree.nodes:
        nodes[node.name] = {
            "type": node.bl_idname,
            "properties": {one.identifier: _plain(getattr(node, one.identifier)) for one in node.bl_rna.properties
                           if not one.is_readonly and one.type in ("FLOAT", "INT", "BOOLEAN", "ENUM")
                           and not one.identifier.startswith("bl_") and one.identifier not in OF_THE_EDITOR},
            "inputs": [_plain(socket.default_value) if hasattr(socket, "default_value") else None for socket in node.inputs],
            "ramp": [[_plain(element.position), _plain(element.color)] for element in node.color_ramp.elements]
            if hasattr(node, "color_ramp") else None}
    links = sorted([link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier]
                   for link in world.node_tree.links)
    return {"nodes": nodes, "links": links}


def images_of(world) -> list:
    images = [node.image for node in world.node_tree.nodes if getattr(node, "image", None)]
    return [[image.name_full, image.filepath, list(image.size), image.is_dirty, image.colorspace_settings.name] for image in images]


def _plain(value):
    if isinstance(value, (bool, int, float, str)):
        return value
    return list(value) if hasattr(value, "__len__") and not isinstance(value, set) else None


def _draw(world, place: str, cancelled) -> tuple[str, dict | None]:
    from .notes import ExportError
    from .program import Cancelled, on_main_thread
    blend, image, told = (os.path.join(place, "world" + end) for end in (".blend", ".exr", ".json"))
    with open(told, "w") as file:
        json.dump(values_of(world)["nodes"], file)
    on_main_thread(lambda: bpy.data.libraries.write(blend, {world.original}, path_remap="ABSOLUTE", fake_user=True), cancelled)
    child = subprocess.Popen([bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "1", "-P", __file__, "--", blend,
                              image, told], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while True:
        try:
            child.wait(0.1)
            break
        except subprocess.TimeoutExpired:
            if cancelled():
                child.kill()
                child.wait()
                raise Cancelled() from None
    os.remove(blend)
    if child.returncode != 0:
        raise ExportError(f"the world {world.name} could not be drawn by Cycles: is its add-on there?")
    with open(told) as file:
        return image, json.load(file)


# ---- In the separate Blender process

def _set_up(world):
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene.world = world
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.engine = "CYCLES"
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", SAMPLES, False, False
    cycles.pixel_filter_type = "BOX"
    return scene


def _render(scene, path: str):
    import numpy as np
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(path)
    picture.colorspace_settings.name = "Raw"
    width, height = picture.size
    pixels = np.empty(width * height * 4, "f4")
    picture.pixels.foreach_get(pixels)
    bpy.data.images.remove(picture)
    return pixels.reshape(height, width, 4)[..., :3].astype("f8")  # rows from the bottom up


def _set_discs(world, on: bool):
    for node in world.node_tree.nodes:
        if node.type == "TEX_SKY" and node.sky_type == "NISHITA":
            node.sun_disc = on


def _around(scene, width: int, path: str):
    scene.camera.data.type, scene.camera.rotation_euler = "PANO", AHEAD
    scene.camera.data.cycles.panorama_type = "EQUIRECTANGULAR"
    scene.render.resolution_x, scene.render.resolution_y = width, width // 2
    return _render(scene, path)


def towards_sun(sky):
    from mathutils import Vector
    up, turn = sky.sun_elevation, sky.sun_rotation
    return Vector((math.sin(turn) * math.cos(up), math.cos(turn) * math.cos(up), math.sin(up)))


def _search_disc(scene, world, sky, path: str):
    """Direction of the disc if the sky is rotated by other nodes. None: not found."""
    import numpy as np
    from mathutils import Vector
    scene.cycles.samples = SEARCH_SAMPLES
    pictures = []
    for on in (True, False):
        _set_discs(world, on)
        pictures.append(_around(scene, SEARCH_WIDTH, path).sum(-1))
    added = np.maximum(pictures[0] - pictures[1], 0)
    height, width = added.shape
    row, column = np.unravel_index(added.argmax(), added.shape)
    if added[row, column] <= 0:
        return None
    up, right = ((row + 0.5) / height - 0.5) * math.pi, ((column + 0.5) / width - 0.5) * 2 * math.pi
    return Vector((math.sin(right) * math.cos(up), math.cos(right) * math.cos(up), math.sin(up)))


def _disc(scene, world, sky, path: str):
    """Irradiance of the disc on a plane that faces it, and its direction. None: it is below the horizon."""
    return _look_at_disc(scene, world, sky, towards_sun(sky), 0.01, path) or (
        (towards := _search_disc(scene, world, sky, path)) and _look_at_disc(scene, world, sky, towards, 0.05, path))


def _look_at_disc(scene, world, sky, towards, margin: float, path: str):
    import numpy as np
    from mathutils import Vector
    camera, side = scene.camera.data, math.tan(1.5 * sky.sun_size + margin)
    camera.type, camera.sensor_fit, camera.angle = "PERSP", "HORIZONTAL", 2 * math.atan(side)
    scene.camera.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    scene.render.resolution_x = scene.render.resolution_y = DISC_PIXELS
    scene.cycles.samples = DISC_SAMPLES
    pictures = []
    for on in (True, False):
        _set_discs(world, on)
        pictures.append(_render(scene, path))
    disc = np.maximum(pictures[0] - pictures[1], 0)
    if disc.max() <= 0:
        return None
    at = (np.arange(DISC_PIXELS) + 0.5) / DISC_PIXELS * 2 - 1
    slope = 1 + side**2 * (at[None, :]**2 + at[:, None]**2)
    solid_angle = (2 * side / DISC_PIXELS) ** 2 / slope**1.5
    irradiance = (disc * (solid_angle / np.sqrt(slope))[..., None]).sum((0, 1))
    weight = disc.sum(-1)
    shift = [float((weight * x).sum() / weight.sum()) * side for x in (at[None, :], at[:, None])]
    towards = scene.camera.rotation_euler.to_matrix() @ Vector((shift[0], shift[1], -1)).normalized()
    return {"direction": [towards.x, towards.z, -towards.y], "angle": math.degrees(sky.sun_size), "irradiance": irradiance.tolist()}


def _set_values(world, nodes: dict):
    for node in world.node_tree.nodes:
        values = nodes[node.name]
        for name, value in values["properties"].items():
            if value is not None and _plain(getattr(node, name)) != value:
                setattr(node, name, value)
        for socket, value in zip(node.inputs, values["inputs"]):
            if value is not None:
                socket.default_value = value
        for element, (position, colour) in zip(node.color_ramp.elements if values["ramp"] else (), values["ramp"] or ()):
            element.position, element.color = position, colour


def _main(blend: str, image: str, told: str):
    with bpy.data.libraries.load(blend) as (there, here):
        here.worlds = there.worlds
    world = here.worlds[0]
    world.node_tree.animation_data_clear()
    with open(told) as file:
        _set_values(world, json.load(file))
    scene = _set_up(world)
    sky = next((node for node in world.node_tree.nodes if node.type == "TEX_SKY" and node.sky_type == "NISHITA" and node.sun_disc), None)
    _set_discs(world, False)
    images = [node.image for node in world.node_tree.nodes if node.type == "TEX_ENVIRONMENT" and node.image]
    _around(scene, min(max([WIDTH] + [one.size[0] for one in images]), MOST_WIDTH), image)
    sun = _disc(scene, world, sky, image + ".disc.exr") if sky else None
    if sky and os.path.exists(image + ".disc.exr"):
        os.remove(image + ".disc.exr")
    with open(told, "w") as file:
        json.dump(sun, file)


if __name__ == "__main__":
    _main(*sys.argv[sys.argv.index("--") + 1:])
