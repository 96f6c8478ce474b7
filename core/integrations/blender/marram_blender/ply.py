# SPDX-License-Identifier: Apache-2.0
"""Binary little-endian PLY files: writes meshes and strands for Marram, reads baked strands."""
from dataclasses import dataclass

import numpy as np

_TYPES = {"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4", "float": "<f4",
          "double": "<f8"}


def _header(elements) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0"]
    for name, count, properties in elements:
        lines += [f"element {name} {count}"] + [f"property {kind} {of}" for kind, of in properties]
    return ("\n".join(lines) + "\nend_header\n").encode()


def write_mesh(path: str, positions, triangles, normals=None, uvs=None):
    """(n, 3) positions and normals, (n, 2) uvs, (m, 3) triangles."""
    columns = [positions] + [more for more in (normals, uvs) if more is not None]
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else []) + (["s", "t"] if uvs is not None else [])
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    with open(path, "wb") as file:
        file.write(_header([("vertex", len(positions), [("float", name) for name in names]),
                            ("face", len(triangles), [("list uchar int", "vertex_indices")])]))
        file.write(np.concatenate(columns, axis=1).astype("<f4").tobytes())
        file.write(faces.tobytes())


@dataclass
class Strands:
    counts: np.ndarray  # CVs of each strand, 2 or more
    points: np.ndarray  # (CVs, 3)
    widths: np.ndarray  # diameters, one per CV
    ids: np.ndarray     # one per strand
    groom: np.ndarray   # one per strand: number of its groom in the export


def write_strands(path: str, strands: Strands):
    index = np.arange(len(strands.counts), dtype="<i4")
    cvs = np.empty(len(strands.points), dtype=[("point", "<f4", 3), ("width", "<f4"), ("strand", "<i4")])
    cvs["point"], cvs["width"], cvs["strand"] = strands.points, strands.widths, np.repeat(index, strands.counts)
    entries = np.stack([index, strands.ids, strands.groom], axis=1).astype("<i4")
    with open(path, "wb") as file:
        file.write(_header([("vertex", len(cvs), [("float", "x"), ("float", "y"), ("float", "z"), ("float", "width"),
                                                  ("int", "strand_id")]),
                            ("strand", len(entries), [("int", "strand_id"), ("int", "id"), ("int", "groom")])]))
        file.write(cvs.tobytes())
        file.write(entries.tobytes())


def _read_elements(path: str) -> dict[str, np.ndarray]:
    """Reads the elements, which must have only scalar properties; each is an array of records."""
    with open(path, "rb") as file:
        content = file.read()
    end = content.find(b"end_header\n")
    if end < 0 or not content.startswith(b"ply\nformat binary_little_endian"):
        raise ValueError(f"{path} is no PLY file of Marram's")
    elements, at = [], end + len(b"end_header\n")
    for words in (line.split() for line in content[:end].decode().splitlines()):
        if words and words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words and words[0] == "property":
            elements[-1][2].append((words[2], _TYPES[words[1]]))
    found = {}
    for name, count, columns in elements:
        kind = np.dtype(columns)
        found[name] = np.frombuffer(content, kind, count, at)
        at += count * kind.itemsize
    return found


def read_strands(path: str) -> Strands:
    elements = _read_elements(path)
    cvs, entries = elements["vertex"], elements["strand"]
    none = np.zeros(len(entries), dtype="i4")
    names = entries.dtype.names
    return Strands(np.bincount(cvs["strand_id"], minlength=len(entries)), np.stack([cvs["x"], cvs["y"], cvs["z"]], axis=1),
                   cvs["width"].copy(), entries["id"].copy() if "id" in names else none,
                   entries["groom"].copy() if "groom" in names else none)
