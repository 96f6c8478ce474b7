# SPDX-License-Identifier: Apache-2.0
"""Lamps and the world. Lamps with a surface become mesh lights."""
import math
import os

import numpy as np
from mathutils import Matrix, Vector

from . import axes, ply, world_image
from .export_material import _source

# Radiance of a lamp of one watt with a surface of one square metre, as in Cycles.
AREA_RADIANCE = 0.25
POINT_RADIANCE = 0.25 / math.pi
SPHERE_RINGS = 12
UNSEEN = {"collides": False, "shelters": False, "seen_by_camera": False}


def lamp_entries(thing, matrix: Matrix, name: str, file: str, folder: str, unit: float, notes) -> tuple[list[dict], list[dict]]:
    """The tables [[mesh]] and [[light]] of a lamp."""
    lamp = thing.data
    if lamp.use_nodes and lamp.node_tree and any(node.type not in ("OUTPUT_LIGHT", "EMISSION") for node in lamp.node_tree.nodes):
        notes.add("nodes of lamps are not exported: colour and power are", name)
    colour = [lamp.color[c] * lamp.energy for c in range(3)]
    if max(colour) <= 0:
        return [], []
    if lamp.type == "SUN":
        return [], [{"name": name, "type": "sun", "direction": axes.vector_to_marram(matrix.to_3x3() @ Vector((0, 0, 1))),
                     "angle": math.degrees(lamp.angle), "irradiance": colour}]
    if lamp.type == "AREA":
        positions, triangles, area = _panel(lamp, matrix, unit)
        radiance = AREA_RADIANCE / area
    elif lamp.type == "POINT":
        radius = max(lamp.shadow_soft_size, 1e-3)
        positions, triangles = _sphere(radius)
        positions = axes.to_marram(positions + np.array(matrix.translation), unit)
        radiance = 4 * POINT_RADIANCE / _area(positions, triangles)  # same power as an exact sphere
    else:
        notes.add("spot lamps are not exported", name)
        return [], []
    ply.write_mesh(os.path.join(folder, file + ".ply"), positions, triangles)
    mesh = {"name": name, "type": "file", "file": file + ".ply", "smooth": False, **UNSEEN}
    return [mesh], [{"name": f"{name} light", "type": "mesh", "mesh": name, "radiance": [radiance * c for c in colour]}]


def _panel(lamp, matrix: Matrix, unit: float):
    """Points and triangles of a panel that emits along the lamp's -z, and its area in square metres."""
    width, height = lamp.size, lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size
    if lamp.shape in ("SQUARE", "RECTANGLE"):
        rim = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], "f8")
    else:
        angles = np.arange(48) * (2 * math.pi / 48)
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rim = rim * (0.5 * width, 0.5 * height)
    points = axes.to_marram(axes.transformed(np.concatenate([rim, np.zeros((len(rim), 1))], axis=1), matrix), unit)
    fan = np.array([(0, k + 1, k) for k in range(1, len(rim) - 1)], "i4")
    return points, fan, max(_area(points, fan), 1e-12)


def _area(points, triangles) -> float:
    a, b, c = (points[triangles[:, k]].astype("f8") for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def _sphere(radius: float):
    """(vertices, triangles) in Blender's axes, facing outward."""
    rows, columns = SPHERE_RINGS, 2 * SPHERE_RINGS
    polar, around = np.meshgrid(np.linspace(0, math.pi, rows + 1), np.arange(columns) * (2 * math.pi / columns), indexing="ij")
    points = radius * np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    triangles = []
    for i in range(rows):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            if i > 0:
                triangles.append((a, a + columns, b))
            if i < rows - 1:
                triangles.append((b, a + columns, b + columns))
    return points.reshape(-1, 3), np.array(triangles, "i4")


# ---- The world

DARK = {"name": "world", "type": "sky", "zenith": [0] * 3, "horizon": [0] * 3, "ground": [0] * 3}
# Brightness of Blender's skies relative to Marram's daylight at strength 1, measured on a grey plane: Nishita
# sun and sky, with the sun 20 to 50 degrees high; its sky alone; the other models, which have their own unit.
NISHITA, NISHITA_SKY, OTHER_SKY = 29.0, 11.0, 0.4


def world_entries(world, as_daylight: bool, folder: str, notes, cancelled) -> list[dict]:
    """The tables [[light]] of the world. A plain colour becomes a sky; a sky texture becomes Marram's daylight
    if as_daylight is set. Other worlds are rendered into an image by Cycles in a separate Blender process, with
    the disc of a sun as a separate light."""
    if world is None:
        return [DARK]
    plain = _plain_colour(world)
    if plain is not None:
        return [{**DARK, "zenith": plain, "horizon": plain, "ground": plain}]
    skies = [node for node in world.node_tree.nodes if node.type == "TEX_SKY"]
    if as_daylight and skies:
        return [_daylight(skies[0], world, notes)]
    made = world_image.draw(world, folder, cancelled)
    lights = [{"name": "world", "type": "environment", "file": made["file"]}]
    if made["sun"]:
        lights.append({"name": "sun of the world", "type": "sun", **made["sun"]})
    return lights


def _plain_colour(world) -> list[float] | None:
    if not (world.use_nodes and world.node_tree):
        return list(world.color)
    output = world.node_tree.get_output_node("CYCLES")
    node = _source(output.inputs["Surface"]) if output else None
    if node is None:
        return [0.0] * 3
    if node.type != "BACKGROUND" or node.inputs["Strength"].is_linked:
        return None
    source = _source(node.inputs["Color"])
    if source is not None and source.type != "RGB":
        return None
    colour = source.outputs[0].default_value if source else node.inputs["Color"].default_value
    return [node.inputs["Strength"].default_value * c for c in colour[:3]]


def _daylight(sky, world, notes) -> dict:
    background = next((node for node in world.node_tree.nodes if node.type == "BACKGROUND"), None)
    strength = background.inputs["Strength"].default_value if background else 1.0
    common = {"name": "world", "type": "daylight"}
    if sky.sky_type != "NISHITA":
        notes.add(f"the sky texture {sky.sky_type.title()} becomes Marram's daylight without a sun", world.name)
        return {**common, "strength": OTHER_SKY * strength, "direction": axes.vector_to_marram(sky.sun_direction), "sun": False,
                "turbidity": sky.turbidity, "ground_albedo": sky.ground_albedo}
    return {**common, "strength": (NISHITA if sky.sun_disc else NISHITA_SKY) * strength,
            "direction": axes.vector_to_marram(world_image.towards_sun(sky)), "sun": sky.sun_disc, "angle": math.degrees(sky.sun_size),
            "altitude": sky.altitude, "turbidity": min(max(1 + 1.5 * sky.dust_density, 1), 10), "ozone": 300 * sky.ozone_density}
