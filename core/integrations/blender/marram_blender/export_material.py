# SPDX-License-Identifier: Apache-2.0
"""Materials: converts the surface shader of a node tree to the most similar one of Marram. Sockets give their
constant, or the linked image."""
import math
import os

import bpy
import numpy as np

from .program import on_main_thread

GREY = 0.8  # diffuse colour of objects without a material in Cycles
SPECULAR_AT_ONE = 0.08  # reflectance at normal incidence of Principled's Specular at 1

# Absorption of the two melanins per unit of concentration, as in Cycles.
_EUMELANIN = np.array([0.506, 0.841, 1.653])
_PHEOMELANIN = np.array([0.343, 0.733, 1.924])


def _roughness_polynomial(b: float) -> float:
    """Relates the colour of many fibres to their absorption: Chiang et al. 2016, equation 9."""
    return 5.969 + b * (-0.215 + b * (2.532 + b * (-10.73 + b * (5.574 + b * 0.245))))


def colour_of_absorption(sigma, azimuthal_roughness: float) -> list[float]:
    return [math.exp(-math.sqrt(max(float(s), 0.0)) * _roughness_polynomial(azimuthal_roughness)) for s in sigma]


def absorption_of_colour(colour, azimuthal_roughness: float) -> np.ndarray:
    return np.array([(math.log(max(float(c), 1e-5)) / _roughness_polynomial(azimuthal_roughness)) ** 2 for c in colour])


class Materials:
    """Writes each material once for meshes and once for strands, under unique names."""

    def __init__(self, folder: str, notes):
        self.folder, self.notes = folder, notes
        self.entries: list[dict] = []
        self.radiance: dict[str, list[float]] = {}  # of emitters, by material name in the scene
        self.animated: list[str] = []  # names in Blender
        self._names: dict[tuple, str] = {}

    def name_for(self, material, on_strands: bool) -> str:
        key = (material.name_full if material else None, on_strands)
        if key not in self._names:
            entry = self._entry(material, on_strands)
            entry = {"name": self._free_name(material, on_strands), **entry}
            self.radiance[entry["name"]] = entry.pop("radiance", None)
            self.entries.append(entry)
            self._names[key] = entry["name"]
            if material and any(_is_animated(owner) for owner in (material.original, material.original.node_tree)):
                self.animated.append(material.name)
        return self._names[key]

    def _free_name(self, material, on_strands: bool) -> str:
        name = (material.name if material else "default") + (" of strands" if on_strands else "")
        taken = {entry["name"] for entry in self.entries}
        free, number = name, 1
        while free in taken:
            free, number = f"{name}.{number}", number + 1
        return free

    def _entry(self, material, on_strands: bool) -> dict:
        if not material:
            return {"type": "diffuse", "color": [GREY] * 3}
        if not (material.use_nodes and material.node_tree):
            return {"type": "surface", "color": material.diffuse_color[:3], "roughness": material.roughness,
                    "specular": SPECULAR_AT_ONE * material.specular_intensity}
        output = material.node_tree.get_output_node("CYCLES")
        if output and output.inputs["Displacement"].is_linked:
            self.notes.add("displacement is not exported", material.name)
        node = _source(output.inputs["Surface"]) if output else None
        return _Shader(self, material.name, on_strands).entry(node)


def _is_animated(owner) -> bool:
    data = owner.animation_data if owner else None
    return bool(data and (data.action or data.drivers or data.nla_tracks))


def _source(socket):
    """The node that is linked to a socket, through reroutes."""
    while socket.is_linked:
        link = socket.links[0]
        if link.from_node.type != "REROUTE":
            return link.from_node
        socket = link.from_node.inputs[0]
    return None


def _save_copy(image, path: str):
    copy = image.copy()
    copy.filepath_raw = path
    copy.file_format = "OPEN_EXR" if image.is_float else "PNG"
    copy.save()
    bpy.data.images.remove(copy)


class _Shader:
    def __init__(self, materials: Materials, name: str, on_strands: bool):
        self.materials, self.name, self.on_strands = materials, name, on_strands

    def note(self, what: str):
        self.materials.notes.add(what, self.name)

    def entry(self, node) -> dict:
        if node is None:
            return {"type": "diffuse", "color": [0.0] * 3}
        made = getattr(self, "_" + node.type.lower(), None)
        if made:
            return made(node)
        if node.type in ("MIX_SHADER", "ADD_SHADER"):
            self.note("of mixed shaders the first one is exported")
            first = next((_source(socket) for socket in node.inputs if socket.type == "SHADER" and socket.is_linked), None)
            return self.entry(first)
        self.note(f"the shader {node.bl_label} is exported as a matt one of its colour")
        return self.matt(node)

    def matt(self, node) -> dict:
        """Marram's "diffuse" has no image parameters: uses an equivalent surface without specular reflection."""
        colour = self.colour(node, "Color")
        return {"type": "surface", "specular": 0, **colour} if "color_map" in colour else {"type": "diffuse", **colour}

    def plain_colour(self, node, name: str) -> list[float]:
        colour = self.colour(node, name)
        if "color_map" in colour:
            self.note(f"the image that is linked to {name} is not exported")
        return list(colour["color"])

    # ---- Sockets

    def number(self, node, name: str) -> float:
        socket = node.inputs[name]
        if socket.is_linked:
            self.note(f"what is linked to {name} is not exported: its value {socket.default_value:.3g} is")
        return socket.default_value

    def colour(self, node, name: str) -> dict:
        """`color`, and `color_map` where an image is linked."""
        socket = node.inputs.get(name)
        if not socket:
            return {"color": [GREY] * 3}
        source = _source(socket)
        if source and source.type == "RGB":
            return {"color": source.outputs[0].default_value[:3]}
        if source and source.type == "TEX_IMAGE" and source.image and not self.on_strands:
            if source.inputs["Vector"].is_linked and _source(source.inputs["Vector"]).type not in ("UVMAP", "TEX_COORD"):
                self.note("images are placed by the mesh's uvs; what else is linked to their Vector is not exported")
            return {"color": [1.0] * 3, "color_map": self._image_file(source.image)}
        if source:
            self.note(f"what is linked to {name} is not exported: its plain value is")
        return {"color": socket.default_value[:3]}

    def _image_file(self, image) -> str:
        path = bpy.path.abspath(image.filepath, library=image.library)
        if image.source == "FILE" and not image.packed_file and os.path.isfile(path):
            return os.path.abspath(path)
        stem = "".join(c if c.isalnum() else "_" for c in image.name)
        if image.packed_file:
            name = stem + (os.path.splitext(path)[1] or ".png")
            with open(os.path.join(self.materials.folder, name), "wb") as file:
                file.write(image.packed_file.data)
            return name
        name = stem + (".exr" if image.is_float else ".png")
        on_main_thread(lambda: _save_copy(image.original, os.path.join(self.materials.folder, name)))
        return name

    # ---- Shaders, by their type in Blender

    def _bsdf_principled(self, node) -> dict:
        for name, plain in (("Metallic", 0), ("Transmission", 0), ("Subsurface", 0), ("Sheen", 0), ("Clearcoat", 0)):
            if node.inputs[name].is_linked or node.inputs[name].default_value != plain:
                self.note(f"{name} is not exported")
        if node.inputs["Alpha"].is_linked or node.inputs["Alpha"].default_value != 1:
            self.note("Alpha is not exported: what is transparent is opaque")
        if node.inputs["Normal"].is_linked:
            self.note("bump and normal maps are not exported")
        entry = {"type": "surface", **self.colour(node, "Base Color"), "roughness": max(self.number(node, "Roughness"), 0.03),
                 "specular": SPECULAR_AT_ONE * self.number(node, "Specular")}
        strength = self.number(node, "Emission Strength")
        shine = [strength * c for c in node.inputs["Emission"].default_value[:3]]
        return entry if max(shine) <= 0 else {**entry, "radiance": shine}

    def _bsdf_diffuse(self, node) -> dict:
        return self.matt(node)

    def _bsdf_translucent(self, node) -> dict:
        return {"type": "diffuse", "color": [0.0] * 3, "transmission": self.plain_colour(node, "Color")}

    def _bsdf_glossy(self, node) -> dict:
        self.note("the shader Glossy BSDF is exported as a glossy boundary over a matt body of its colour")
        return {"type": "surface", **self.colour(node, "Color"), "roughness": max(self.number(node, "Roughness"), 0.03)}

    def _emission(self, node) -> dict:
        strength = self.number(node, "Strength")
        return {"type": "diffuse", "color": [0.0] * 3, "radiance": [strength * c for c in self.plain_colour(node, "Color")]}

    def _bsdf_hair_principled(self, node) -> dict:
        if not self.on_strands:
            self.note("a shader of hair on a mesh is exported as a matt one")
            return self.matt(node)
        radial = self.number(node, "Radial Roughness")
        for name in ("Coat", "Random Color", "Random Roughness"):
            if node.inputs[name].is_linked or node.inputs[name].default_value != 0:
                self.note(f"{name} of hair is not exported")
        return {"type": "hair", "color": self._hair_colour(node, radial), "roughness": self.number(node, "Roughness"),
                "azimuthal_roughness": radial, "ior": self.number(node, "IOR"),
                "tilt": math.degrees(self.number(node, "Offset"))}

    def _hair_colour(self, node, radial: float) -> list[float]:
        """The colour of many such fibres. Melanin is converted, as its coefficients differ in both programs."""
        if node.parametrization == "COLOR":
            return list(self.colour(node, "Color")["color"])
        if node.parametrization == "ABSORPTION":
            return colour_of_absorption(node.inputs["Absorption Coefficient"].default_value, radial)
        amount = -math.log(max(1.0 - self.number(node, "Melanin"), 1e-4))
        red = self.number(node, "Melanin Redness")
        sigma = amount * ((1 - red) * _EUMELANIN + red * _PHEOMELANIN)
        return colour_of_absorption(sigma + absorption_of_colour(self.colour(node, "Tint")["color"], radial), radial)

    def _bsdf_hair(self, node) -> dict:
        self.note("the shader Hair BSDF is exported as Principled Hair of its colour")
        return {"type": "hair" if self.on_strands else "diffuse", "color": self.plain_colour(node, "Color")}
