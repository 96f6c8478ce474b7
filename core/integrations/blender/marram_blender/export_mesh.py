# SPDX-License-Identifier: Apache-2.0
"""Meshes as triangles: static, moved by keys, or with a file per frame.

A static mesh is one file in world space. A rigidly moving mesh is one file and a transform with a key per frame.
A mesh that deforms, shears or is mirrored while it moves has one file per frame in world space. A mesh with
several materials is written once as a whole, invisible, for strands to grow on and collide with, and once for
each material, only visible.
"""
import math
import os
from dataclasses import dataclass, field

import numpy as np
from mathutils import Matrix

from . import axes, ply


@dataclass
class Surface:
    """The triangles of an object in object space, with normals and uvs per loop (face corner)."""
    positions: np.ndarray   # of Blender's vertices, object space
    normals: np.ndarray     # of Blender's loops; empty: all faces are flat
    loop_vertex: np.ndarray
    uvs: np.ndarray         # of loops; empty: none
    triangles: np.ndarray   # indices of loops
    material: np.ndarray    # slot of each triangle


def read_surface(thing) -> Surface | None:
    """The evaluated object's triangles; None if it has none."""
    mesh = thing.to_mesh()
    if mesh is None:
        return None
    try:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        if count == 0:
            return None
        flat = _get(mesh.polygons, "use_smooth", len(mesh.polygons), "?")
        normals = np.empty((0, 3), "f4")
        if flat.any():
            mesh.calc_normals_split()
            normals = _get(mesh.loops, "normal", 3 * len(mesh.loops)).reshape(-1, 3)
        layer = mesh.uv_layers.active
        uvs = _get(layer.data, "uv", 2 * len(mesh.loops)).reshape(-1, 2) if layer else np.empty((0, 2), "f4")
        return Surface(_get(mesh.vertices, "co", 3 * len(mesh.vertices)).reshape(-1, 3), normals,
                       _get(mesh.loops, "vertex_index", len(mesh.loops), "i4"), uvs,
                       _get(mesh.loop_triangles, "loops", 3 * count, "i4").reshape(-1, 3),
                       _get(mesh.loop_triangles, "material_index", count, "i4"))
    finally:
        thing.to_mesh_clear()


def _get(collection, name: str, count: int, kind: str = "f4") -> np.ndarray:
    values = np.empty(count, kind)
    collection.foreach_get(name, values)
    return values


def same_shape(a: Surface, b: Surface) -> bool:
    return np.array_equal(a.positions, b.positions) and np.array_equal(a.normals, b.normals)


def same_topology(a: Surface, b: Surface) -> bool:
    return (len(a.positions) == len(b.positions) and len(a.normals) == len(b.normals)
            and np.array_equal(a.triangles, b.triangles) and np.array_equal(a.loop_vertex, b.loop_vertex))


def is_open(surface: Surface) -> bool:
    """Whether it has a boundary edge, which belongs to only one triangle."""
    corners = surface.loop_vertex[surface.triangles]
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 1).any())


class Part:
    """Some triangles of a surface. Loops with equal vertex, normal and uv share a corner; corners stay the same
    while the surface deforms."""

    def __init__(self, surface: Surface, triangles: np.ndarray):
        loops = np.unique(triangles)
        keys = [surface.loop_vertex[loops, None].astype("f8")]
        if len(surface.normals):
            keys.append(np.round(surface.normals[loops].astype("f8"), 5))
        if len(surface.uvs):
            keys.append(surface.uvs[loops].astype("f8"))
        _, first, group = np.unique(np.concatenate(keys, axis=1), axis=0, return_index=True, return_inverse=True)
        corner_of = np.zeros(len(surface.loop_vertex), dtype="i4")
        corner_of[loops] = group
        self.corners = loops[first]  # one loop of each corner
        self.triangles = corner_of[triangles]

    def write(self, path: str, surface: Surface, matrix: Matrix, unit: float):
        """matrix: applied to the vertices of the file, in Blender's axes."""
        vertices = surface.positions[surface.loop_vertex[self.corners]]
        positions = axes.to_marram(axes.transformed(vertices, matrix), unit)
        normals = axes.to_marram(axes.turned_normals(surface.normals[self.corners], matrix)) if len(surface.normals) else None
        uvs = surface.uvs[self.corners] if len(surface.uvs) else None
        triangles = self.triangles[:, ::-1] if matrix.determinant() < 0 else self.triangles
        ply.write_mesh(path, positions, triangles, normals, uvs)


@dataclass
class MovingMesh:
    """One mesh over the frames of an export. Call add() in the order of frames."""
    name: str
    file: str       # without folder, number and extension
    folder: str
    unit: float
    notes: object
    surface: Surface
    roles: dict
    materials: list[str | None]  # of each slot with triangles
    frames: list[int] = field(default_factory=list)
    matrices: list[Matrix] = field(default_factory=list)
    deforms: bool = False
    alone: bool = False  # at some frame it is missing or has other triangles

    def __post_init__(self):
        slots = np.minimum(self.surface.material, len(self.materials) - 1)
        self.used = np.unique(slots).tolist()
        self.parts = [("", Part(self.surface, self.surface.triangles))]
        if len(self.used) > 1:
            self.parts += [(f"-{slot}", Part(self.surface, self.surface.triangles[slots == slot])) for slot in self.used]

    def add(self, frame: int, surface: Surface | None, matrix: Matrix):
        if self.alone:
            return
        if surface is None or (self.frames and not same_topology(surface, self.surface)):
            self.notes.add(f"has other triangles at frame {frame}: stays as it was before", self.name)
            self.alone = True
            return
        if self.frames and not self.deforms and not (same_shape(surface, self.surface) and self._keys_can_hold(matrix)):
            self.deforms = True
            for earlier, there in zip(self.frames, self.matrices):
                self._write_frame(earlier, self.surface, there)
        self.frames.append(frame)
        self.matrices.append(matrix.copy())
        if self.deforms:
            self._write_frame(frame, surface, matrix)

    def _keys_can_hold(self, matrix: Matrix) -> bool:
        return matrix == self.matrices[0] or all(_is_rigid(one) for one in (matrix, self.matrices[0]))

    def _path(self, part: str, frame: int | None) -> str:
        return os.path.join(self.folder, self.file + part + ("" if frame is None else f".{frame_text(frame)}") + ".ply")

    def _write_frame(self, frame: int, surface: Surface, matrix: Matrix):
        for suffix, part in self.parts:
            part.write(self._path(suffix, frame), surface, matrix, self.unit)

    def entries(self) -> list[dict]:
        """The tables [[mesh]]. Writes the files of meshes that do not deform."""
        moves = any(matrix != self.matrices[0] for matrix in self.matrices)
        keyed = moves and not self.deforms
        if not self.deforms:
            for suffix, part in self.parts:
                part.write(self._path(suffix, None), self.surface, Matrix.Identity(4) if keyed else self.matrices[0], self.unit)
        common = {"file_frames": [self.frames[0], self.frames[-1]] if self.deforms and len(self.frames) > 1 else None,
                  "smooth": None if len(self.surface.normals) else False,
                  "transform": {"keys": self._keys()} if keyed else None}
        files = [self.file + suffix + (".####" if common["file_frames"] else f".{frame_text(self.frames[0])}" if self.deforms else "")
                 + ".ply" for suffix, _ in self.parts]
        whole = {"name": self.name, "type": "file", "file": files[0], **common, "material": self.materials[self.used[0]], **self.roles}
        if len(self.parts) == 1:
            return [whole]
        hidden = {**whole, "material": None, "seen_by_camera": False, "casts_shadows": False}
        seen = [{**whole, "name": f"{self.name}{suffix}", "file": file, "material": self.materials[slot], "collides": False,
                 "shelters": False} for (suffix, _), file, slot in zip(self.parts[1:], files[1:], self.used)]
        return [hidden] + seen

    def _keys(self) -> list[dict]:
        keys, before = [], None
        for frame, matrix in zip(self.frames, self.matrices):
            there, turn, scale = axes.matrix_to_marram(matrix).decompose()
            before = turn.to_euler("XYZ", before) if before else turn.to_euler("XYZ")
            keys.append({"frame": frame, "translate": [c * self.unit for c in there],
                         "rotate": [math.degrees(angle) for angle in before], "scale": list(scale)})
        return keys


def _is_rigid(matrix: Matrix) -> bool:
    """Whether it consists of a translation, a rotation and a scale above 0 only."""
    there, turn, scale = matrix.decompose()
    again = Matrix.LocRotScale(there, turn, scale)
    size = max(abs(c) for row in matrix.to_3x3() for c in row)
    return min(scale) > 0 and all(abs(a - b) <= 1e-6 * size for x, y in zip(again.to_3x3(), matrix.to_3x3()) for a, b in zip(x, y))


def frame_text(frame: int) -> str:
    """The text that marram substitutes for ####."""
    return f"-{-frame:04d}" if frame < 0 else f"{frame:04d}"
