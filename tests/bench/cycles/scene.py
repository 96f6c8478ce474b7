# SPDX-License-Identifier: Apache-2.0
# Blender's side: ball.toml as a Blender scene, and a timed render of it.
#
#     blender -b -P scene.py -- build  BALL.toml STRANDS.hair BODY.obj SKY.exr LIGHTS OUT.blend
#     blender -b BALL.blend -t 2 -P scene.py -- render SHAPE SAMPLES SIZE SEED OUT.exr OUT.json
#
# Marram has y up, Blender z; points turn as (x, y, z) -> (x, -z, y), which keeps the sky's up.
import json
import math
import sys
import time
import tomllib

import bpy
import numpy as np
from mathutils import Matrix, Vector


def turned(points):
    x, y, z = np.asarray(points, "f4").reshape(-1, 3).T
    return np.stack([x, -z, y], -1)


def read_hair(path):
    """Points (strand, cv, xyz) and radii (strand, cv) of a .hair file whose strands have equally many CVs."""
    with open(path, "rb") as file:
        magic, strands, points, flags, segments = np.frombuffer(file.read(20), "S4,u4,u4,u4,u4")[0]
        has_segments, has_points, has_thickness = 1, 2, 4
        assert magic == b"HAIR" and flags == has_points | has_thickness and not flags & has_segments
        file.seek(128)
        xyz = np.frombuffer(file.read(12 * points), "f4").reshape(strands, segments + 1, 3)
        diameter = np.frombuffer(file.read(4 * points), "f4").reshape(strands, segments + 1)
    return xyz, diameter / 2


def link(name, data):
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_strands(xyz, radius):
    """Python cannot add curves in 3.4; geometry nodes make them, in order and exactly, of a mesh's chains of edges."""
    strands, cvs, _ = xyz.shape
    chains = bpy.data.meshes.new("chains")
    chains.vertices.add(strands * cvs)
    chains.vertices.foreach_set("co", turned(xyz).ravel())
    index = np.arange(strands * cvs, dtype="i4").reshape(strands, cvs)
    chains.edges.add(strands * (cvs - 1))
    chains.edges.foreach_set("vertices", np.stack([index[:, :-1], index[:, 1:]], -1).ravel())
    chains.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radius.ravel())
    source = link("chains", chains)

    nodes = bpy.data.node_groups.new("curves of chains", "GeometryNodeTree")
    nodes.outputs.new("NodeSocketGeometry", "Geometry")
    info = nodes.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = source
    convert = nodes.nodes.new("GeometryNodeMeshToCurve")
    nodes.links.new(info.outputs["Geometry"], convert.inputs["Mesh"])
    nodes.links.new(convert.outputs["Curve"], nodes.nodes.new("NodeGroupOutput").inputs[0])

    fur = link("fur", bpy.data.hair_curves.new("fur"))
    modifier = fur.modifiers.new("curves of chains", "NODES")
    modifier.node_group = nodes
    bpy.context.view_layer.objects.active = fur
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    bpy.data.objects.remove(source)
    bpy.data.meshes.remove(chains)

    made = np.empty(strands * cvs * 3, "f4")
    fur.data.attributes["position"].data.foreach_get("vector", made)
    assert len(fur.data.curves) == strands and np.array_equal(made, turned(xyz).ravel())
    return fur


def add_body(path):
    lines = [line.split() for line in open(path)]
    column = lambda key: [[float(v) for v in line[1:]] for line in lines if line and line[0] == key]
    faces = [[int(corner.split("/")[0]) - 1 for corner in line[1:]] for line in lines if line and line[0] == "f"]
    mesh = bpy.data.meshes.new("body")
    mesh.from_pydata(turned(column("v")).tolist(), [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.use_auto_smooth = True
    mesh.normals_split_custom_set_from_vertices(turned(column("vn")).tolist())
    return link("body", mesh)


def material(thing, node_type, values, **properties):
    made = bpy.data.materials.new(thing.name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(node_type)
    for key, value in properties.items():
        setattr(node, key, value)
    for key, value in values.items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    thing.data.materials.append(made)


def add_camera(camera):
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(camera["fov"])
    data.clip_start, data.clip_end = 1e-3, 1e3
    thing = link("camera", data)
    eye, target = (Vector(turned(camera[key])[0].tolist()) for key in ("position", "target"))
    thing.matrix_world = Matrix.Translation(eye) @ (target - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    bpy.context.scene.camera = thing


def add_sun(sun, found_by_fibres):
    data = bpy.data.lights.new("sun", "SUN")
    data.energy, data.color = 1.0, sun["irradiance"]
    data.angle = math.radians(sun["angle"])
    data.cycles.use_multiple_importance_sampling = found_by_fibres
    towards = Vector(turned(sun["direction"])[0].tolist())
    link("sun", data).rotation_euler = towards.to_track_quat("Z", "Y").to_euler()


def add_sky(path):
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    picture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    picture.image = bpy.data.images.load(path)
    picture.image.colorspace_settings.name = "Linear"
    picture.image.pack()
    world.node_tree.links.new(picture.outputs[0], world.node_tree.nodes["Background"].inputs["Color"])


def build(ball_path, hair_path, body_path, sky_path, lights, out):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ball = tomllib.load(open(ball_path, "rb"))
    named = lambda table, name: next(entry for entry in ball[table] if entry["name"] == name)
    fibre, skin = named("material", "fur"), named("material", "skin")

    material(add_strands(*read_hair(hair_path)), "ShaderNodeBsdfHairPrincipled",
             {"Color": [*fibre["color"], 1], "Roughness": fibre["roughness"],
              "Radial Roughness": fibre["azimuthal_roughness"], "Coat": 0, "IOR": fibre["ior"],
              "Offset": math.radians(fibre["tilt"]), "Random Color": 0, "Random Roughness": 0},
             parametrization="COLOR")
    material(add_body(body_path), "ShaderNodeBsdfDiffuse", {"Color": [*skin["color"], 1], "Roughness": 0})
    add_camera(ball["camera"])
    add_sun(named("light", "sun"), lights == "all")
    add_sky(sky_path)

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.view_settings.view_transform = "Raw"
    scene.render.film_transparent = True  # for alpha; report.py puts the sky behind
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.use_persistent_data = False
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"

    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    bounces = ball["film"]["max_depth"] - 1  # Cycles counts what follows direct light
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.transparent_max_bounces = bounces
    cycles.min_light_bounces = 0  # both end dim paths by roulette
    cycles.light_sampling_threshold = cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", ball["film"]["filter_radius"]
    bpy.ops.wm.save_as_mainfile(filepath=out, compress=False)


def render(shape, samples, size, seed, out, stats):
    import _cycles
    assert _cycles.with_embree
    scene = bpy.context.scene
    scene.cycles_curves.shape = {"round": "THICK", "ribbon": "RIBBONS"}[shape]
    scene.cycles_curves.subdivisions = 3  # ribbons: 4 pieces a segment, as Embree's default
    scene.cycles.samples, scene.cycles.seed = int(samples), int(seed)
    scene.render.resolution_x = scene.render.resolution_y = int(size)
    scene.render.resolution_percentage = 100
    begin = time.perf_counter()
    bpy.ops.render.render()
    seconds = time.perf_counter() - begin
    bpy.data.images["Render Result"].save_render(out)
    json.dump({"seconds": seconds}, open(stats, "w"))


if __name__ == "__main__":
    verb, *arguments = sys.argv[sys.argv.index("--") + 1:]
    {"build": build, "render": render}[verb](*arguments)
