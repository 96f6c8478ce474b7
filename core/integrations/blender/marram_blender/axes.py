# SPDX-License-Identifier: Apache-2.0
"""Conversion between Blender's axes and units (z up, Blender units) and Marram's (y up, metres).

A point (x, y, z) of Blender is (x, z, -y) in Marram. This only swaps axes and changes signs, so nothing is
rounded if a Blender unit is a metre.
"""
import numpy as np
from mathutils import Matrix

# Its columns are Blender's axes in Marram's axes.
TO_MARRAM = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))


def metres_per_unit(scene) -> float:
    return scene.unit_settings.scale_length


def to_marram(points: np.ndarray, unit: float = 1.0) -> np.ndarray:
    """Converts (n, 3) points or, with unit 1, vectors."""
    turned = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
    return (turned if unit == 1.0 else turned.astype("f8") * unit).astype("f4")


def to_blender(points: np.ndarray, unit: float = 1.0) -> np.ndarray:
    turned = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    return (turned if unit == 1.0 else turned.astype("f8") / unit).astype("f4")


def transformed(points: np.ndarray, matrix: Matrix) -> np.ndarray:
    """Transforms points in Blender's axes by a 4 x 4 matrix in double precision; unchanged for the identity."""
    if matrix == Matrix.Identity(4):
        return points
    m = np.array(matrix, dtype="f8")
    return points.astype("f8") @ m[:3, :3].T + m[:3, 3]


def turned_normals(normals: np.ndarray, matrix: Matrix) -> np.ndarray:
    """Transforms normals by the inverse transpose."""
    if matrix == Matrix.Identity(4):
        return normals
    turned = normals.astype("f8") @ np.array(matrix.to_3x3().inverted_safe(), dtype="f8")
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned / np.where(length > 0, length, 1.0)


def vector_to_marram(vector) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[2]), -float(vector[1]))


def matrix_to_marram(matrix: Matrix) -> Matrix:
    """The same transform in Marram's axes."""
    return TO_MARRAM @ matrix @ TO_MARRAM.transposed()


def mean_scale(matrix: Matrix) -> float:
    return abs(matrix.to_3x3().determinant()) ** (1.0 / 3.0)
