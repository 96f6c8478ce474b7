# SPDX-License-Identifier: Apache-2.0
"""One .blend by Marram and by Cycles, side by side, and how bright each is.

    MARRAM=build/marram blender -b --factory-startup -P tests/blender/beside_cycles.py -- [--scene hill|wind|lamps] [--blend FILE]
        [--frame F] [--size 480x360] [--samples 64] [--out build/beside]

Without --blend the scene is one made here, and kept as OUT.blend:
    hill   fur on a ball, grass on the ground, a sun and a sky
    wind   the same in the wind: Cycles renders the strands that Marram has blown and given back
    lamps  the same indoors: an area lamp, a point lamp, a plain world

OUT.png has Marram left, Cycles right. Cycles' curves stay as the .blend has them (ribbons), without a denoiser.
"""
import argparse
import math
import os
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.dont_write_bytecode = True
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "core/integrations/blender")]

import addon_utils  # noqa: E402
import scenes  # noqa: E402


def make_hill(lamps: bool):
    from marram_blender import import_strands
    scene = scenes.empty((1, 12))
    skin = scenes.material("skin", values={"Base Color": (0.35, 0.2, 0.12, 1), "Roughness": 0.6})
    earth = scenes.material("earth", "ShaderNodeBsdfDiffuse", {"Color": (0.32, 0.27, 0.2, 1)})
    coat = scenes.material("coat", "ShaderNodeBsdfHairPrincipled", {"Melanin": 0.55, "Melanin Redness": 0.3, "Roughness": 0.35},
                           parametrization="MELANIN")
    grass = scenes.material("grass", values={"Base Color": (0.18, 0.3, 0.06, 1), "Roughness": 0.7, "Specular": 0.2})
    stone = scenes.material("stone", values={"Base Color": (0.5, 0.5, 0.52, 1), "Roughness": 0.25})
    body = scenes.sphere("body", skin, coat, radius=0.5, rings=32, location=(-0.35, 0, 0.55))
    scenes.particle_hair(body, 800, 0.16, 2, children=12, radius=0.006)
    scenes.add(bpy.ops.mesh.primitive_cube_add, "block", stone, smooth=False, size=0.4, location=(0.75, 0.35, 0.2), rotation=(0, 0, 0.5))
    ground = scenes.add(bpy.ops.mesh.primitive_plane_add, "ground", earth, smooth=False, size=6)
    counts, points, radii = scenes.blades(6000, 6, 3.2, 0.16, 3)
    things = import_strands.new_curves("grass", counts, points, 0.003 * radii, material=grass)
    things.data.surface = ground
    scenes.look(scene, (0.6, -3.6, 1.5), (0.05, 0, 0.38), lens=52)
    if lamps:
        scenes.plain_world(scene, (0.05, 0.06, 0.08))
        add_lamp(scene, "AREA", 120, (1.6, -1.2, 2.4), (-0.2, 0, 0.3), size=0.8)
        add_lamp(scene, "POINT", 40, (-1.6, -0.9, 1.0), (0, 0, 0), shadow_soft_size=0.1, color=(1, 0.7, 0.4))
    else:
        scenes.nishita_world(scene, math.radians(25), math.radians(130), 0.1)
    return scene


def add_lamp(scene, kind, energy, where, towards, **more):
    from mathutils import Vector
    lamp = bpy.data.lights.new(kind.lower(), kind)
    lamp.energy = energy
    for name, value in more.items():
        setattr(lamp, name, value)
    thing = bpy.data.objects.new(kind.lower(), lamp)
    thing.location = where
    thing.rotation_euler = (Vector(towards) - Vector(where)).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(thing)


def blow_in(scene):
    settings = scene.marram
    settings.speed, settings.direction, settings.bend, settings.collide = 7, (1, 0.2, 0), 0.8, True


def pixels_of(path, width=None):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Raw"
    pixels = np.empty(4 * image.size[0] * image.size[1], "f4")
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    return pixels


def render(scene, engine, out: Path):
    scene.render.engine = engine
    bpy.ops.render.render()
    settings, result = scene.render.image_settings, bpy.data.images["Render Result"]
    pixels = {}
    for kind, end in (("PNG", ".png"), ("OPEN_EXR", ".exr")):
        settings.file_format = kind
        settings.color_depth = "8" if kind == "PNG" else "32"
        result.save_render(str(out) + end)
        pixels[kind] = pixels_of(str(out) + end)
        os.remove(str(out) + end)
    return pixels


def join(pictures, path):
    both = np.concatenate(pictures, axis=1)
    image = bpy.data.images.new("both", both.shape[1], both.shape[0])
    image.colorspace_settings.name = "Raw"
    image.pixels.foreach_set(both.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


def blocks(picture, across=8):
    """Mean of squares: noise goes, light stays."""
    side = picture.shape[1] // across
    rows = picture.shape[0] // side
    return picture[:rows * side, :across * side, :3].reshape(rows, side, across, side, 3).mean((1, 3))


def report(marram, cycles):
    ratio = marram[..., :3].mean((0, 1)) / cycles[..., :3].mean((0, 1))
    parts = blocks(marram).mean(-1) / blocks(cycles).mean(-1)
    print(f"brightness of Marram over Cycles: {marram[..., :3].mean() / cycles[..., :3].mean():.3f}, red {ratio[0]:.3f}, "
          f"green {ratio[1]:.3f}, blue {ratio[2]:.3f}; squares of an eighth of the width: {parts.min():.3f} to {parts.max():.3f}")


def main():
    parser = argparse.ArgumentParser(prog="beside_cycles")
    parser.add_argument("--scene", choices=("hill", "wind", "lamps"), default="hill")
    parser.add_argument("--blend")
    parser.add_argument("--frame", type=int)
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--out", default="build/beside")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else [])
    out = Path(args.out).resolve()
    out.parent.mkdir(parents=True, exist_ok=True)
    addon_utils.enable("marram_blender", default_set=True)
    if args.blend:
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(args.blend))
        scene = bpy.context.scene
    else:
        scene = make_hill(args.scene == "lamps")
        if args.scene == "wind":
            blow_in(scene)
        bpy.ops.wm.save_as_mainfile(filepath=str(out) + ".blend", compress=True)
    if args.frame is not None:
        scene.frame_set(args.frame)
    scene.render.resolution_x, scene.render.resolution_y = map(int, args.size.split("x"))
    scene.render.resolution_percentage = 100
    scene.marram.samples = scene.cycles.samples = args.samples
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = "CPU", False, False
    marram = render(scene, "MARRAM", out)
    if scene.marram.speed > 0:
        bpy.ops.marram.blow()
    cycles = render(scene, "CYCLES", out)
    report(marram["OPEN_EXR"], cycles["OPEN_EXR"])
    join([marram["PNG"], cycles["PNG"]], str(out) + ".png")
    print(f"wrote {out}.png")


main()
