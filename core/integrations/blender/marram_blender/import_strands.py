# SPDX-License-Identifier: Apache-2.0
"""Imports baked strands as Curves objects, which Cycles renders as hair.

In Blender 3.4 Python cannot add curves to a Curves object. Geometry nodes make them from a mesh whose edges form
a chain for each strand; order and positions are exact. With one frame the result is applied, and the object is
an ordinary one. With several frames the mesh of chains is kept, with a shape key for each frame and linear
interpolation between them, so the file plays without this add-on.
"""
import bpy
import numpy as np

from . import axes, ply

FRAMES_BEHIND = " frames"
SOURCE = "marram_source"  # property of a blown object: its source, (object, particle system or "")


def split(strands: ply.Strands) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """For each groom, masks of its strands and of its CVs."""
    of_cvs = np.repeat(strands.groom, strands.counts)
    return {int(groom): (strands.groom == groom, of_cvs == groom) for groom in np.unique(strands.groom)}


def import_strands(files: list[tuple[int, str]], grooms: list[dict], collection) -> list:
    """files: frames and baked files, with the same strands in all. grooms: as in grooms.json. Returns the
    objects."""
    first = ply.read_strands(files[0][1])
    unit = grooms[0]["unit"] if grooms else 1.0
    made = []
    for number, (of_strands, of_cvs) in split(first).items():
        groom = grooms[number]
        thing = bpy.data.objects.new(f"{groom['name']} blown", bpy.data.hair_curves.new(f"{groom['name']} blown"))
        collection.objects.link(thing)
        chains = _chains(thing.name, first.counts[of_strands], axes.to_blender(first.points[of_cvs], unit),
                         0.5 * first.widths[of_cvs].astype("f8") / unit, first.ids[of_strands])
        thing[SOURCE] = (groom["object"], groom["system"])
        _add_nodes(thing, chains, _material(groom))
        made.append((thing, chains, of_cvs))
    if len(files) > 1:
        for index, (frame, path) in enumerate(files):
            strands = first if index == 0 else ply.read_strands(path)
            for _, chains, of_cvs in made:
                _add_key(chains, frame, axes.to_blender(strands.points[of_cvs], unit))
        for _, chains, _ in made:
            _play(chains, [frame for frame, _ in files])
    else:
        for thing, chains, _ in made:
            _apply(thing, chains)
    return [thing for thing, _, _ in made]


def new_curves(name: str, counts, points, radii, ids=None, material=None):
    """A Curves object in the current collection, like an import of one frame. Points in world space."""
    thing = bpy.data.objects.new(name, bpy.data.hair_curves.new(name))
    bpy.context.collection.objects.link(thing)
    chains = _chains(name, counts, points, radii, np.arange(len(counts)) if ids is None else ids)
    _add_nodes(thing, chains, material)
    _apply(thing, chains)
    return thing


def _chains(name: str, counts, points, radii, ids):
    """An unlinked mesh object whose edges are the segments of the strands."""
    mesh = bpy.data.meshes.new(name + FRAMES_BEHIND)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, "f4").ravel())
    starts = np.arange(len(points), dtype="i4")
    is_tip = np.zeros(len(points), dtype=bool)
    is_tip[np.cumsum(counts) - 1] = True
    starts = starts[~is_tip]
    mesh.edges.add(len(starts))
    mesh.edges.foreach_set("vertices", np.stack([starts, starts + 1], axis=1).ravel())
    mesh.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.ascontiguousarray(radii, "f4"))
    mesh.attributes.new("strand", "INT", "POINT").data.foreach_set("value", np.repeat(ids, counts).astype("i4"))
    return bpy.data.objects.new(name + FRAMES_BEHIND, mesh)


def _add_nodes(thing, chains, material):
    nodes = bpy.data.node_groups.new(thing.name, "GeometryNodeTree")
    nodes.outputs.new("NodeSocketGeometry", "Geometry")
    info = nodes.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = chains
    convert = nodes.nodes.new("GeometryNodeMeshToCurve")
    out = nodes.nodes.new("NodeGroupOutput")
    nodes.links.new(info.outputs["Geometry"], convert.inputs["Mesh"])
    end = convert.outputs["Curve"]
    if material:
        thing.data.materials.append(material)
        paint = nodes.nodes.new("GeometryNodeSetMaterial")
        paint.inputs["Material"].default_value = material
        nodes.links.new(end, paint.inputs["Geometry"])
        end = paint.outputs["Geometry"]
    nodes.links.new(end, out.inputs[0])
    thing.modifiers.new("Blown strands", "NODES").node_group = nodes


def _apply(thing, chains):
    layer = bpy.context.view_layer
    before = layer.objects.active
    layer.objects.active = thing
    nodes = thing.modifiers[0].node_group
    bpy.ops.object.modifier_apply(modifier=thing.modifiers[0].name)
    layer.objects.active = before
    mesh = chains.data
    bpy.data.objects.remove(chains)
    bpy.data.meshes.remove(mesh)
    bpy.data.node_groups.remove(nodes)


def _add_key(chains, frame: int, points):
    key = chains.shape_key_add(name=f"frame {frame}", from_mix=False)
    key.interpolation = "KEY_LINEAR"
    key.data.foreach_set("co", np.ascontiguousarray(points, "f4").ravel())


def _play(chains, frames: list[int]):
    """Animates the shape keys: exact at each key's frame, linear in between."""
    keys = chains.data.shape_keys
    keys.use_relative = False
    for frame, key in zip(frames, keys.key_blocks):
        keys.eval_time = key.frame
        keys.keyframe_insert("eval_time", frame=frame)
    for point in keys.animation_data.action.fcurves[0].keyframe_points:
        point.interpolation = "LINEAR"


def _material(groom: dict):
    source = bpy.data.objects.get(groom["object"])
    slots = source.material_slots if source else ()
    return slots[min(max(groom["slot"], 0), len(slots) - 1)].material if len(slots) else None


def is_blown(thing) -> bool:
    return SOURCE in thing


class EarlierBlown:
    """Strands blown earlier. While new ones are made, their sources are shown instead."""

    def __init__(self, scene):
        self.things = [thing for thing in scene.objects if is_blown(thing)]
        self.sources = {tuple(thing[SOURCE]) for thing in self.things}
        self.hidden = {source for source in self.sources if not _is_drawn(*source)}
        for thing in self.things:
            thing.hide_render = True
        for source in self.hidden:
            show_source(*source, True)

    def put_back(self):
        for thing in self.things:
            thing.hide_render = False
        for source in self.hidden:
            show_source(*source, False)

    def remove(self):
        for thing in self.things:
            bpy.data.objects.remove(thing)
        self.things = []


def _particle_modifier(thing, system: str):
    return next((modifier for modifier in thing.modifiers
                 if modifier.type == "PARTICLE_SYSTEM" and modifier.particle_system.name == system), None)


def _is_drawn(name: str, system: str) -> bool:
    thing = bpy.data.objects.get(name)
    drawn = _particle_modifier(thing, system) if thing and system else None
    return drawn.show_render if drawn else not (thing and thing.hide_render)


def show_source(name: str, system: str, shown: bool):
    """Shows or hides the source of blown strands, so that they are not rendered twice."""
    thing = bpy.data.objects.get(name)
    if thing is None:
        return
    if not system:
        thing.hide_render = thing.hide_viewport = not shown
    elif modifier := _particle_modifier(thing, system):
        modifier.show_render = modifier.show_viewport = shown
