# SPDX-License-Identifier: Apache-2.0
"""Hair: the paths of particle systems, including children, and the points of Curves objects.

Marram gets the same CVs and radii as Cycles. Both render Catmull-Rom curves through them.
"""
import os
from dataclasses import dataclass, field

import numpy as np

from . import axes, ply
from .export_mesh import frame_text

# Wind settings that leave strands unchanged.
CALM = {"speed": 0, "jiggle": {"frequency": 0}, "collision": {"solver": "none"}}
DEFAULT_RADIUS = 0.005  # of Cycles, for Curves without the attribute "radius"


@dataclass
class Hair:
    """Strands in world space, in Blender's axes and units."""
    counts: np.ndarray
    points: np.ndarray
    radii: np.ndarray


def particle_hair(thing, system, notes, rendered: bool) -> Hair | None:
    """thing: the evaluated object. None if the system does not render paths."""
    settings = system.settings
    if settings.type != "HAIR" or settings.render_type != "PATH":
        if settings.type == "EMITTER" and settings.render_type not in ("NONE", "OBJECT", "COLLECTION"):
            notes.add("particles that are no hair are not exported", f"{thing.name}: {system.name}")
        return None
    steps = 2 ** (settings.render_step if rendered else settings.display_step) + 1
    if settings.kink == "SPIRAL":
        steps += settings.kink_extra_steps
    parents, children = len(system.particles), len(system.child_particles)
    first = parents if children and settings.child_type != "NONE" else 0
    counts, points = [], []
    for index in range(first, parents + children):
        path = [tuple(system.co_hair(thing, particle_no=index, step=step)) for step in range(steps)]
        while path and path[-1] == (0.0, 0.0, 0.0):  # missing points of a shortened path
            path.pop()
        if len(path) < 2:
            notes.add("strands of no length are left out", f"{thing.name}: {system.name}")
            continue
        counts.append(len(path))
        points.append(np.array(path, dtype="f4"))
    if not counts:
        return None
    counts, points = np.array(counts, dtype="i4"), np.concatenate(points)
    return Hair(counts, points, _particle_radii(settings, counts, points) * axes.mean_scale(thing.matrix_world))


def _particle_radii(settings, counts, points) -> np.ndarray:
    """Radii from root to tip by arc length, with the profile set by Hair Shape."""
    ends = np.cumsum(counts)
    firsts = ends - counts
    steps = np.zeros(len(points))
    steps[1:] = np.linalg.norm(np.diff(points.astype("f8"), axis=0), axis=1)
    steps[firsts] = 0
    along = np.cumsum(steps)
    along -= np.repeat(along[firsts], counts)
    length = np.repeat(along[ends - 1], counts)
    left = 1 - np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    left = np.clip(left, 0, 1)
    shape = settings.shape
    if shape != 0:
        left = left ** (1 + shape if shape < 0 else 1 / max(1 - shape, 1e-6))
    half = 0.5 * settings.radius_scale
    radii = half * (settings.tip_radius + left * (settings.root_radius - settings.tip_radius))
    if settings.use_close_tip:
        radii[ends - 1] = 0
    return radii


def curves_hair(curves, matrix) -> Hair | None:
    """curves: the evaluated data of a Curves object."""
    if not len(curves.points) or not len(curves.curves):
        return None
    points = np.empty(3 * len(curves.points), "f4")
    curves.attributes["position"].data.foreach_get("vector", points)
    counts = np.empty(len(curves.curves), "i4")
    curves.curves.foreach_get("points_length", counts)
    radii = np.full(len(curves.points), DEFAULT_RADIUS, "f4")
    if radius := curves.attributes.get("radius"):
        radius.data.foreach_get("value", radii)
    keep = counts >= 2
    of_points = np.repeat(keep, counts)
    if not keep.any():
        return None
    return Hair(counts[keep], axes.transformed(points.reshape(-1, 3)[of_points], matrix),
                np.maximum(radii[of_points], 0) * axes.mean_scale(matrix))


@dataclass
class MovingHair:
    """One groom over the frames of an export. One file per frame if Blender moves its points, else one file."""
    name: str
    file: str
    folder: str
    unit: float
    notes: object
    number: int
    surface: tuple | None  # the exporter's key of the mesh that it grows on
    carried: bool    # moved by that mesh in Marram, not by Blender
    material: str
    source: tuple    # for an import to find the object: (object, particle system or "")
    slot: int        # its material slot of the object
    blown: bool      # it is the result of an import from Marram
    on: str | None = None  # name of the mesh that it grows on
    hair: Hair | None = None
    frames: list[int] = field(default_factory=list)
    moves: bool = False
    alone: bool = False

    def add(self, frame: int, hair: Hair | None):
        if self.alone or (self.frames and self.carried and self.on):
            return
        if self.hair is None:
            self.hair = hair
        elif hair is None or not np.array_equal(hair.counts, self.hair.counts):
            self.notes.add(f"has other strands at frame {frame}: stays as it was before", self.name)
            self.alone = True
            return
        elif not self.moves and not np.array_equal(hair.points, self.hair.points):
            self.moves = True
            for earlier in self.frames:
                self._write(earlier, self.hair)
        self.frames.append(frame)
        if self.moves:
            self._write(frame, hair)

    def _write(self, frame: int | None, hair: Hair):
        strands = len(hair.counts)
        number = "" if frame is None else f".{frame_text(frame)}"
        ply.write_strands(os.path.join(self.folder, self.file + number + ".ply"),
                          ply.Strands(hair.counts, axes.to_marram(hair.points, self.unit), 2 * self.unit * hair.radii,
                                      np.arange(strands), np.full(strands, self.number)))

    def entries(self, shape: str) -> tuple[dict, dict]:
        """The tables [[curves]] and [[procedural]]. Writes the file of a groom that does not move."""
        if not self.moves:
            self._write(None, self.hair)
        curves = {"name": f"{self.name} curves", "type": "strands", "file": self.file + (".####.ply" if self.moves else ".ply"),
                  "file_frames": [self.frames[0], self.frames[-1]] if self.moves else None}
        strands = {"name": self.name, "type": "strands", "curves": curves["name"], "on": self.on, "material": self.material,
                   "basis": "catmull-rom", "shape": shape, "wind": CALM if self.blown else None}
        return curves, strands
