# SPDX-License-Identifier: Apache-2.0
"""Operators: write a scene for Marram; blow strands and bring them back."""
import json
import os
import tempfile
from contextlib import contextmanager

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from . import engine, export_scene, import_strands
from .export_mesh import frame_text
from .notes import ExportError, Notes
from .program import Cancelled, find_marram, run_marram

WHICH = [("CURRENT", "This frame", "The frame that is shown"), ("RANGE", "The scene's frames", "From its first to its last frame")]


def _frames(scene, which: str) -> tuple[int, int]:
    return (scene.frame_current, scene.frame_current) if which == "CURRENT" else (scene.frame_start, scene.frame_end)


@contextmanager
def _settings_for_render(scene):
    """Sets up a render without compositing, by Marram's engine; restores the settings."""
    render, names = scene.render, ("engine", "use_compositing", "use_sequencer")
    before = {name: getattr(render, name) for name in names}
    render.engine, render.use_compositing, render.use_sequencer = engine.MarramEngine.bl_idname, False, False
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(render, name, value)


def export_as_rendered(context, folder: str, shot: tuple[int, int], with_picture: bool) -> tuple[str, Notes]:
    """Exports the frames of the shot and those around it that they need. The export runs inside a render, as only
    a render evaluates objects with their render settings. Raises ExportError."""
    first, last = engine.frames_around(context.scene, shot[0])[0], engine.frames_around(context.scene, shot[1])[1]
    if bpy.app.is_job_running("RENDER"):
        raise ExportError("a render is running: wait for its end")
    camera = context.scene.camera
    with_camera = with_picture or (camera is not None and camera.type == "CAMERA" and camera.data.type == "PERSP")
    scene, notes, done, faults = context.scene, Notes(), [], []
    frame, subframe = scene.frame_current, scene.frame_subframe
    lent = None

    def task(render_engine, depsgraph):
        try:
            job = render_engine.frames_of(depsgraph, first, last, folder, notes, with_camera, with_picture)
            job.shot = shot
            done.append(export_scene.export(job, scene))
        except (ExportError, Cancelled) as fault:
            faults.append(fault)
    if scene.camera is None:  # a render needs one
        if with_picture:
            raise ExportError("the scene has no camera: add one")
        lent = bpy.data.objects.new("lent", bpy.data.cameras.new("lent"))
        scene.camera = lent
    engine.instead = task
    try:
        with _settings_for_render(scene):
            bpy.ops.render.render(layer=context.view_layer.name, scene=scene.name)
    except RuntimeError as error:
        raise ExportError(str(error).strip()) from error
    finally:
        engine.instead = None
        if lent:
            camera = lent.data
            bpy.data.objects.remove(lent)
            bpy.data.cameras.remove(camera)
        scene.frame_set(frame, subframe=subframe)
    if faults:
        raise faults[0]
    if not done:
        raise ExportError("Blender did not render the scene: see what it says of it")
    return done[0], notes


class _Operator:
    def execute(self, context):
        try:
            said = self.act(context)
        except ExportError as error:
            self.report({"ERROR"}, f"Marram: {error}")
            return {"CANCELLED"}
        except Cancelled:
            return {"CANCELLED"}
        for line in said:
            self.report({"WARNING"}, f"Marram: {line}")
        return {"FINISHED"}


class MARRAM_OT_export(_Operator, bpy.types.Operator):
    bl_idname = "marram.export"
    bl_label = "Export Marram scene"
    bl_description = "Writes the scene for the program marram into a folder: scene.toml and its files"
    directory: StringProperty(subtype="DIR_PATH", description="Folder, made where there is none")
    which: EnumProperty(name="Frames", items=WHICH, default="RANGE")

    def act(self, context):
        folder = bpy.path.abspath(self.directory)
        if not folder:
            raise ExportError("no folder was given to export to")
        try:
            os.makedirs(folder, exist_ok=True)
            path, notes = export_as_rendered(context, folder, _frames(context.scene, self.which), True)
        except OSError as error:
            raise ExportError(f"{error.filename or folder} cannot be written: {error.strerror}") from error
        self.report({"INFO"}, f"Marram: wrote {path}")
        return notes.lines()

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class MARRAM_OT_blow(_Operator, bpy.types.Operator):
    bl_idname = "marram.blow"
    bl_label = "Blow strands by Marram"
    bl_description = "Brings the scene's hair back as Curves objects, blown by the wind: any engine renders them"
    bl_options = {"REGISTER", "UNDO"}
    which: EnumProperty(name="Frames", items=WHICH)
    hide: BoolProperty(name="Hide what was blown", description="The hair that they were made of is no longer drawn", default=True)

    def act(self, context):
        find_marram()
        earlier = import_strands.EarlierBlown(context.scene)
        try:
            things, grooms, said = self._blow(context, earlier)
        except BaseException:
            earlier.put_back()
            raise
        for groom in grooms:
            import_strands.show_source(groom["object"], groom["system"], not self.hide)
        self.report({"INFO"}, f"Marram: {', '.join(thing.name for thing in things)}")
        return said

    def _blow(self, context, earlier):
        scene = context.scene
        first, last = _frames(scene, self.which)
        with tempfile.TemporaryDirectory(prefix="marram_") as folder:
            path, notes = export_as_rendered(context, folder, (first, last), False)
            with open(os.path.join(folder, export_scene.GROOMS), encoding="utf-8") as file:
                grooms = json.load(file)
            if not grooms:
                raise ExportError("the scene has no hair to blow: no Curves objects, no particle system that draws paths")
            files, said = bake(scene, path, folder, first, last)
            earlier.remove()
            return import_strands.import_strands(files, grooms, context.collection), grooms, notes.lines() + said


def bake(scene, path: str, folder: str, first: int, last: int) -> tuple[list[tuple[int, str]], list[str]]:
    """Frames and their files; marram's warnings."""
    out = os.path.join(folder, "blown.####.ply")
    frames = ["--frame", str(first)] if first == last else ["--frames", f"{first}-{last}"]
    said = run_marram(["bake", path, "-o", out, "--attributes", "groom", *frames, *engine.threads(scene),
                       *export_scene.further_settings(scene)])
    return [(frame, os.path.join(folder, f"blown.{frame_text(frame)}.ply")) for frame in range(first, last + 1)], said


CLASSES = (MARRAM_OT_export, MARRAM_OT_blow)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)


def unregister():
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
