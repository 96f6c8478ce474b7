# SPDX-License-Identifier: Apache-2.0
"""User settings: wind and rendering of a scene, roles of an object, the path of the program."""
import bpy
from bpy.props import (BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty,
                       StringProperty)


class MarramPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(name="Program", subtype="FILE_PATH",
                            description="The program marram. Empty: that of the environment variable MARRAM, or on PATH")

    def draw(self, context):
        self.layout.prop(self, "program")


class MarramScene(bpy.types.PropertyGroup):
    # Rendering
    samples: IntProperty(name="Samples", description="Paths a pixel", default=64, min=1, max=65536)
    max_depth: IntProperty(name="Bounces", description="Bounces of a path; 1: direct light", default=12, min=0, max=1024)
    noise: FloatProperty(name="Noise", description="A pixel is done once its standard deviation is below this share of its "
                         "brightness; 0: after all samples", default=0, min=0, max=1, precision=3)
    sky: EnumProperty(name="Sky", items=[
        ("IMAGE", "As in Cycles", "Worlds are drawn into an image by Cycles"),
        ("DAYLIGHT", "Marram's daylight", "Sky textures become Marram's own sun and sky, of the same direction and air")])
    hair_motion: EnumProperty(name="Moving hair", items=[
        ("FRAMES", "As in Blender", "Strands that move are exported frame by frame: exact, and large"),
        ("CARRIED", "Carried by its mesh", "Strands are exported once; the mesh that they grow on carries them")])
    jiggle_past: FloatProperty(name="Look back", description="When a single frame is made, jiggle sees meshes move from this long "
                               "before it", default=1, min=0, soft_max=5, unit="TIME_ABSOLUTE")
    # Wind
    wind_object: PointerProperty(name="Along", type=bpy.types.Object,
                                 description="The air moves along this object's z axis, as a force field's wind does. None: along Direction")
    direction: FloatVectorProperty(name="Direction", description="Where the air moves to", default=(1, 0, 0), subtype="DIRECTION")
    speed: FloatProperty(name="Speed", description="0: calm, strands stay as they are", default=0, min=0, soft_max=30, unit="VELOCITY")
    bend: FloatProperty(name="Bend", description="How far strands turn towards the wind: softness, 0 to 1", default=0.6, min=0, soft_max=1)
    stiff_root: FloatProperty(name="Root", description="Share of the turn that reaches the root; the tip has all of it", default=0.2,
                              min=0, max=1)
    turbulence: FloatProperty(name="Turbulence", description="Strength of the noise in the wind", default=0.5, min=0, soft_max=2)
    turbulence_scale: FloatProperty(name="Scale", description="Noise: cells a metre", default=1, min=1e-3, soft_max=100)
    gusts: IntProperty(name="Gusts", description="Gusts in each period of 240 frames; 0: none", default=0, min=0, soft_max=1000)
    gust_radius: FloatVectorProperty(name="Radius", size=2, description="Smallest and largest radius of a gust, in metres", default=(2, 4),
                                     min=1e-3)
    calm: FloatProperty(name="Between gusts", description="Share of the wind between gusts", default=0.3, min=0, max=1)
    jiggle: FloatProperty(name="Jiggle", description="Natural frequency of strands in hertz; 0: they follow the wind at once", default=0,
                          min=0, soft_max=10)
    damping: FloatProperty(name="Damping", description="Below 1 strands overshoot", default=0.3, min=0.01, soft_max=2)
    shield: FloatProperty(name="Shelter", description="Share of the wind that a strand behind a mesh loses", default=0, min=0, max=1)
    collide: BoolProperty(name="Collide", description="Strands do not enter meshes", default=False)
    more: StringProperty(name="More", description="Further keys of a scene, separated by semicolons, such as "
                         "wind.noise.octaves=2; film.clamp=4 (marram info --keys SCENE lists them)")


class MarramObject(bpy.types.PropertyGroup):
    collides: BoolProperty(name="Collides", description="Strands do not enter it", default=True)
    shelters: BoolProperty(name="Shelters", description="Strands behind it stand in its lee", default=True)


CLASSES = (MarramPreferences, MarramScene, MarramObject)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.marram = PointerProperty(type=MarramScene)
    bpy.types.Object.marram = PointerProperty(type=MarramObject)


def unregister():
    del bpy.types.Object.marram
    del bpy.types.Scene.marram
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
