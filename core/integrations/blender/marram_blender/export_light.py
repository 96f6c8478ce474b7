# SPDX-License-Identifier: Apache-2.0
"""Lamps and the world. Lamps with a surface become mesh lights, which move as other meshes do."""
import functools
import math

import numpy as np
from mathutils import Matrix, Vector

from . import axes, toml_text, world_image
from .export_material import _source
from .export_mesh import Surface

# Radiance of a lamp of one watt with a surface of one square metre, as in Cycles.
AREA_RADIANCE = 0.25
POINT_RADIANCE = 0.25 / math.pi
SPHERE_RINGS = 12
LAMPS = {"SUN", "AREA", "POINT"}
LEAST_SIZE = 1e-3  # of a lamp with a surface, in Blender's units
MOST_TURN = math.radians(165)  # of a direction from key to key; Marram's limit is 170 degrees
UNSEEN = {"collides": False, "shelters": False, "seen_by_camera": False}


class MovingLamp:
    """A sun, an area lamp or a point lamp over the frames of an export. At frames that are not added it is off."""

    def __init__(self, kind: str, name: str):
        self.kind, self.name = kind, name
        self.lights: dict[int, dict] = {}  # by frame: the values of its [[light]] that may change
        self.places: dict[int, tuple[Surface, Matrix]] = {}  # by frame: its mesh, if it has one, and its transform

    def add(self, frame: int, thing, matrix: Matrix, unit: float, notes):
        """thing: the evaluated object."""
        lamp = thing.data
        if lamp.type != self.kind:
            notes.add("lamps do not change their kind: it is off while it is of another", self.name)
            return
        colour = _colour(lamp, self.name, notes)
        if self.kind == "SUN":
            towards = (matrix.to_3x3() @ Vector((0, 0, 1))).normalized()
            self.lights[frame] = {"direction": axes.vector_to_marram(towards), "angle": math.degrees(lamp.angle), "irradiance": colour}
            return
        self.places[frame] = _panel(lamp, matrix) if self.kind == "AREA" else _ball(lamp, matrix)
        radiance = _radiance(self.kind, *self.places[frame], unit)
        self.lights[frame] = {"radiance": [radiance * c for c in colour]}

    def entries(self, frames: range, shot: range, new_mesh) -> tuple[list[dict], list[dict]]:
        """The tables [[mesh]] and [[light]]; none if the lamp is dark in all of the shot. Marram reads the values of a
        light at the frames of the shot, but the motion of its mesh around them too. new_mesh(surface): a MovingMesh."""
        power = "irradiance" if self.kind == "SUN" else "radiance"
        lights = toml_text.held(self.lights, shot)
        lights = {frame: now if frame in self.lights else {**now, power: [0.0] * 3} for frame, now in lights.items()}
        if not any(max(now[power]) > 0 for now in lights.values()):
            return [], []
        values = {name: _over_time(name, {frame: now[name] for frame, now in lights.items()}) for name in lights[shot[0]]}
        if self.kind == "SUN":
            return [], [{"name": self.name, "type": "sun", **values}]
        places = toml_text.held(self.places, frames)
        mesh = new_mesh(places[frames[0]][0])
        for frame, (surface, matrix) in places.items():
            mesh.add(frame, surface, matrix)
        return mesh.entries(), [{"name": f"{self.name} light", "type": "mesh", "mesh": self.name, **values}]


def _colour(lamp, name: str, notes) -> list[float]:
    """Colour and strength of the lamp, and of the Emission of its nodes."""
    factor = [1.0] * 3
    if lamp.use_nodes and lamp.node_tree:
        output = lamp.node_tree.get_output_node("CYCLES")
        node = _source(output.inputs["Surface"]) if output else None
        if node is None:
            return [0.0] * 3
        if node.type != "EMISSION" or any(socket.is_linked for socket in node.inputs):
            notes.add("of the nodes of lamps only Emission is exported, without what is linked to it", name)
        if node.type == "EMISSION":
            tint, strength = (None if node.inputs[one].is_linked else node.inputs[one].default_value for one in ("Color", "Strength"))
            factor = [(tint[c] if tint else 1.0) * (1.0 if strength is None else strength) for c in range(3)]
    return [max(lamp.color[c] * lamp.energy * factor[c], 0.0) for c in range(3)]


def _over_time(name: str, values: dict[int, object]):
    """As toml_text.over_time(). A direction that jumps further than Marram turns it has a key at each frame and does not turn."""
    keys = toml_text.over_time(values)
    if name == "direction" and isinstance(keys, dict):
        ways = [Vector(way) for _, way in keys["keys"]]
        if any(a.angle(b, 0.0) > MOST_TURN for a, b in zip(ways, ways[1:])):
            return {"keys": [[frame, values[frame]] for frame in sorted(values)], "interpolation": "constant"}
    return keys


def _flat_surface(points: np.ndarray, triangles: np.ndarray) -> Surface:
    return Surface(points, np.empty((0, 3), "f4"), np.arange(len(points), dtype="i4"), np.empty((0, 2), "f4"), triangles,
                   np.zeros(len(triangles), "i4"))


def _panel(lamp, matrix: Matrix) -> tuple[Surface, Matrix]:
    """An area lamp's surface in its own space, and its transform to the world. The size is part of the transform, which
    may have keys."""
    sides = lamp.size, lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size
    width, height = (max(side, LEAST_SIZE) for side in sides)
    return _unit_panel(lamp.shape in ("DISK", "ELLIPSE")), matrix @ Matrix.Diagonal((width, height, 1, 1))


def _ball(lamp, matrix: Matrix) -> tuple[Surface, Matrix]:
    """The same of a point lamp, which its object neither scales nor turns."""
    radius = max(lamp.shadow_soft_size, LEAST_SIZE)
    return _unit_sphere(), Matrix.Translation(matrix.translation) @ Matrix.Diagonal((radius, radius, radius, 1))


def _radiance(kind: str, surface: Surface, matrix: Matrix, unit: float) -> float:
    """Of a lamp of one watt. That of a point lamp gives its polyhedron the power of an exact sphere."""
    area = max(_area(axes.transformed(surface.positions, matrix), surface.triangles) * unit**2, 1e-12)
    return (AREA_RADIANCE if kind == "AREA" else 4 * POINT_RADIANCE) / area


def _area(points, triangles) -> float:
    a, b, c = (points[triangles[:, k]].astype("f8") for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@functools.cache  # the same numbers at each frame: those of numpy may differ in their last bit from call to call
def _unit_panel(is_round: bool) -> Surface:
    """Facing along -z, 1 wide and high."""
    rim = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], "f8")
    if is_round:
        angles = np.arange(48) * (2 * math.pi / 48)
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fan = np.array([(0, k + 1, k) for k in range(1, len(rim) - 1)], "i4")
    return _flat_surface(np.concatenate([0.5 * rim, np.zeros((len(rim), 1))], axis=1), fan)


@functools.cache
def _unit_sphere() -> Surface:
    """Facing outward, of radius 1."""
    rows, columns = SPHERE_RINGS, 2 * SPHERE_RINGS
    polar, around = np.meshgrid(np.linspace(0, math.pi, rows + 1), np.arange(columns) * (2 * math.pi / columns), indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    triangles = []
    for i in range(rows):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            if i > 0:
                triangles.append((a, a + columns, b))
            if i < rows - 1:
                triangles.append((b, a + columns, b + columns))
    return _flat_surface(points.reshape(-1, 3), np.array(triangles, "i4"))


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
