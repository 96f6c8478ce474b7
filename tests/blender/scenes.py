# SPDX-License-Identifier: Apache-2.0
"""Scenes made by script, for run.py and beside_cycles.py."""
import math

import bpy
import numpy as np
from mathutils import Vector


def empty(frames=(1, 4)):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = frames
    scene.frame_set(frames[0])
    return scene


def look(scene, eye, target, lens=50.0):
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.lens = lens
    camera.location = eye
    camera.rotation_euler = (Vector(target) - Vector(eye)).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def sun(scene, towards, energy=3.0, angle=3.0, colour=(1, 0.95, 0.85)):
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = energy, math.radians(angle), colour
    thing = bpy.data.objects.new("sun", lamp)
    thing.rotation_euler = Vector(towards).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(thing)


def plain_world(scene, colour, strength=1.0):
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*colour, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = strength
    scene.world = world


def nishita_world(scene, elevation, rotation, strength=0.1):
    plain_world(scene, (0, 0, 0), strength)
    tree = scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.sun_elevation, sky.sun_rotation = "NISHITA", elevation, rotation
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    return sky


def material(name, node_type="ShaderNodeBsdfPrincipled", values=(), **properties):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(node_type)
    for key, value in properties.items():
        setattr(node, key, value)
    for key, value in dict(values).items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return made


def add(operator, name, *materials, smooth=True, **arguments):
    operator(**arguments)
    thing = bpy.context.object
    thing.name = name
    for one in materials:
        thing.data.materials.append(one)
    if smooth:
        thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))
    return thing


def sphere(name, *materials, radius, rings=16, location=(0, 0, 0)):
    """Blender's own sphere has its faces in another order at each start, and hair with them."""
    columns = 2 * rings
    polar, around = np.meshgrid(np.linspace(0, math.pi, rings + 1)[1:-1], np.arange(columns) * (2 * math.pi / columns), indexing="ij")
    points = radius * np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1).reshape(-1, 3)
    top, bottom = len(points), len(points) + 1
    row = lambda i, j: i * columns + j % columns
    faces = [(top, row(0, j), row(0, j + 1)) for j in range(columns)]
    faces += [(row(i, j), row(i + 1, j), row(i + 1, j + 1), row(i, j + 1)) for i in range(rings - 2) for j in range(columns)]
    faces += [(row(rings - 2, j + 1), row(rings - 2, j), bottom) for j in range(columns)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.concatenate([points, [(0, 0, radius), (0, 0, -radius)]]).tolist(), [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    for one in materials:
        mesh.materials.append(one)
    thing = bpy.data.objects.new(name, mesh)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def particle_hair(thing, count, length, slot, children=0, seed=1, radius=0.01, name="fur"):
    modifier = thing.modifiers.new(name, "PARTICLE_SYSTEM")
    settings = modifier.particle_system.settings
    settings.type, settings.count, settings.hair_length, settings.hair_step = "HAIR", count, length, 5
    modifier.particle_system.seed = seed
    settings.material = slot
    settings.render_step = settings.display_step = 3
    settings.root_radius, settings.tip_radius, settings.radius_scale = 1.0, 0.1, radius
    settings.use_close_tip = False
    if children:
        settings.child_type, settings.rendered_child_count, settings.child_nbr = "INTERPOLATED", children, 2
        settings.child_length = 1.0
    settings.brownian_factor = 0.05 * length
    return modifier


def curves_hair(add_curves, surface, counts, points, radii, made_of, name="grass"):
    """add_curves: how the add-on makes a Curves object of arrays."""
    thing = add_curves(name, counts, points, radii)
    thing.data.materials.append(made_of)
    thing.data.surface = surface
    return thing


def blades(strands, cvs, size, length, seed):
    """(counts, points, radii) of strands that stand on z = 0 and lean, no two alike."""
    rng = np.random.default_rng(seed)
    roots = np.concatenate([rng.uniform(-size / 2, size / 2, (strands, 2)), np.zeros((strands, 1))], axis=1)
    lean = np.concatenate([rng.uniform(-0.4, 0.4, (strands, 2)), np.ones((strands, 1))], axis=1)
    lean /= np.linalg.norm(lean, axis=1, keepdims=True)
    along = np.linspace(0, 1, cvs)[None, :, None] * (length * rng.uniform(0.6, 1, (strands, 1, 1)))
    droop = np.array([0, 0, -0.25 / length]) * along**2
    points = roots[:, None] + along * lean[:, None] + droop
    radii = np.broadcast_to(np.linspace(1, 0.2, cvs), (strands, cvs))
    return np.full(strands, cvs), points.reshape(-1, 3).astype("f4"), radii.ravel().astype("f4")
