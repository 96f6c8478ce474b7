# SPDX-License-Identifier: Apache-2.0
"""Panels: rendering and wind in the render tab, roles in the object tab."""
import bpy

from .engine import MarramEngine


class _RenderPanel:
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "render"


class MARRAM_PT_render(_RenderPanel, bpy.types.Panel):
    bl_label = "Marram"

    @classmethod
    def poll(cls, context):
        return context.engine == MarramEngine.bl_idname

    def draw(self, context):
        layout, settings = self.layout, context.scene.marram
        layout.use_property_split = True
        for name in ("samples", "max_depth", "noise", "sky", "more"):
            layout.prop(settings, name)
        render = context.scene.render
        layout.prop(render, "use_motion_blur")
        if render.use_motion_blur:
            layout.prop(render, "motion_blur_shutter")
        if hasattr(context.scene, "cycles_curves"):
            layout.prop(context.scene.cycles_curves, "shape", text="Curves")
        layout.operator("marram.export")


class MARRAM_PT_wind(_RenderPanel, bpy.types.Panel):
    """For every engine: strands that were blown are curves that all of them render."""
    bl_label = "Marram: wind on hair"

    def draw(self, context):
        layout, settings = self.layout, context.scene.marram
        layout.use_property_split = True
        column = layout.column(align=True)
        column.prop(settings, "speed")
        column.prop(settings, "wind_object")
        if not settings.wind_object:
            column.prop(settings, "direction")
        for group in (("bend", "stiff_root"), ("turbulence", "turbulence_scale"), ("gusts", "gust_radius", "calm"),
                      ("jiggle", "damping", "jiggle_past"), ("shield", "collide", "hair_motion")):
            column = layout.column(align=True)
            for name in group:
                column.prop(settings, name)
        column = layout.column()
        column.operator("marram.blow", text="Blow this frame").which = "CURRENT"
        column.operator("marram.blow", text="Blow the scene's frames").which = "RANGE"


class MARRAM_PT_object(bpy.types.Panel):
    bl_label = "Marram"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "object"

    @classmethod
    def poll(cls, context):
        return context.object and context.object.type in {"MESH", "CURVE", "SURFACE", "FONT", "META"}

    def draw(self, context):
        layout, thing = self.layout, context.object
        layout.use_property_split = True
        layout.prop(thing.marram, "collides")
        layout.prop(thing.marram, "shelters")
        if context.engine == MarramEngine.bl_idname:
            layout.prop(thing, "visible_camera", text="Seen by camera")
            layout.prop(thing, "visible_shadow", text="Casts shadows")


CLASSES = (MARRAM_PT_render, MARRAM_PT_wind, MARRAM_PT_object)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)


def unregister():
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
