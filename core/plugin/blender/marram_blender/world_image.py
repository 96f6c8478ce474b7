# SPDX-License-Identifier: Apache-2.0
"""A world as an image around the scene, by Cycles in a Blender of its own: the one that asks may be rendering.

Run by itself it draws:  blender -b --factory-startup -P world_image.py -- WORLD.blend WORLD.exr WORLD.json
The disc of a Nishita sky's sun is left out of the image, measured, and told in WORLD.json as a sun.
"""
import json
import math
import os
import subprocess
import sys

import bpy

WIDTH, SAMPLES = 1024, 16
MOST_WIDTH = 2048         # where the world has images
DISC_PIXELS = 64
# Middle of the picture towards +y, up to +z: Marram's -z and y.
AHEAD = (math.pi / 2, 0.0, 0.0)


def draw(world, folder: str, cancelled=lambda: False) -> dict:
    """The image's name in the folder, and a [[light]] "sun" without name and type, or None."""
    from .notes import ExportError
    from .program import Cancelled, on_main_thread
    blend, image, told = (os.path.join(folder, "world" + end) for end in (".blend", ".exr", ".json"))
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
    if child.returncode != 0 or not os.path.isfile(told):
        raise ExportError(f"the world {world.name} could not be drawn by Cycles: is its add-on there?")
    with open(told) as file:
        sun = json.load(file)
    os.remove(told)
    return {"file": os.path.basename(image), "sun": sun}


# ---- In a Blender of its own

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
    return pixels.reshape(height, width, 4)[..., :3].astype("f8")  # from the bottom up


def _set_discs(world, on: bool):
    for node in world.node_tree.nodes:
        if node.type == "TEX_SKY" and node.sky_type == "NISHITA":
            node.sun_disc = on


def _around(scene, world, path: str):
    images = [node.image for node in world.node_tree.nodes if node.type == "TEX_ENVIRONMENT" and node.image]
    width = min(max([WIDTH] + [image.size[0] for image in images]), MOST_WIDTH)
    scene.camera.data.type, scene.camera.rotation_euler = "PANO", AHEAD
    scene.camera.data.cycles.panorama_type = "EQUIRECTANGULAR"
    scene.render.resolution_x, scene.render.resolution_y = width, width // 2
    return _render(scene, path)


def _disc(scene, world, sky, around, path: str):
    """What the disc adds to the irradiance of a plane that faces it, and where it is."""
    import numpy as np
    from mathutils import Vector
    _set_discs(world, True)
    added = np.maximum(_around(scene, world, path) - around, 0).sum(-1)
    height, width = added.shape
    if added.max() <= 0:
        return None  # below the horizon
    row, column = np.unravel_index(added.argmax(), added.shape)
    near = np.argwhere(added > 0.05 * added.max())
    near = near[np.abs(near - (row, column)).max(axis=1) <= max(4, 2 * sky.sun_size / math.pi * height)]
    up = ((near[:, 0] + 0.5) / height - 0.5) * math.pi
    right = ((near[:, 1] + 0.5) / width - 0.5) * 2 * math.pi
    rays = np.stack([np.sin(right) * np.cos(up), np.cos(right) * np.cos(up), np.sin(up)], axis=1)
    towards = Vector((rays * added[near[:, 0], near[:, 1], None]).sum(0)).normalized()

    camera, side = scene.camera.data, math.tan(1.5 * sky.sun_size + 0.01)
    camera.type, camera.sensor_fit, camera.angle = "PERSP", "HORIZONTAL", 2 * math.atan(side)
    scene.camera.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    scene.render.resolution_x = scene.render.resolution_y = DISC_PIXELS
    disc = _render(scene, path)
    _set_discs(world, False)
    disc = np.maximum(disc - _render(scene, path), 0)
    at = (np.arange(DISC_PIXELS) + 0.5) / DISC_PIXELS * 2 - 1
    slope = 1 + side**2 * (at[None, :]**2 + at[:, None]**2)
    solid_angle = (2 * side / DISC_PIXELS) ** 2 / slope**1.5
    irradiance = (disc * (solid_angle / np.sqrt(slope))[..., None]).sum((0, 1))
    weight = disc.sum(-1)
    shift = [float((weight * x).sum() / weight.sum()) * side for x in (at[None, :], at[:, None])]
    towards = scene.camera.rotation_euler.to_matrix() @ Vector((shift[0], shift[1], -1)).normalized()
    return {"direction": [towards.x, towards.z, -towards.y], "angle": math.degrees(sky.sun_size), "irradiance": irradiance.tolist()}


def _main(blend: str, image: str, told: str):
    with bpy.data.libraries.load(blend) as (there, here):
        here.worlds = there.worlds
    world = here.worlds[0]
    scene = _set_up(world)
    sky = next((node for node in world.node_tree.nodes if node.type == "TEX_SKY" and node.sky_type == "NISHITA" and node.sun_disc), None)
    _set_discs(world, False)
    around = _around(scene, world, image)
    sun = _disc(scene, world, sky, around, image + ".disc.exr") if sky else None
    if sky and os.path.exists(image + ".disc.exr"):
        os.remove(image + ".disc.exr")
    with open(told, "w") as file:
        json.dump(sun, file)


if __name__ == "__main__":
    _main(*sys.argv[sys.argv.index("--") + 1:])
