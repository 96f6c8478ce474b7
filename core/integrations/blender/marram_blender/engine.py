# SPDX-License-Identifier: Apache-2.0
"""The render engine "Marram": exports the requested frame, runs the program, and returns its picture."""
import math
import os
import tempfile
import traceback

import bpy

from . import export_scene
from .export_camera import shutter
from .notes import ExportError, Notes
from .program import Cancelled, find_marram, run_marram

# Called with (engine, depsgraph) by the next render, instead of rendering. Operators set it if they need
# objects with their render settings, which only a render has.
instead = None


class MarramEngine(bpy.types.RenderEngine):
    bl_idname = "MARRAM"
    bl_label = "Marram"
    bl_use_preview = False
    bl_use_eevee_viewport = True  # solid and material views are Blender's own
    bl_use_shading_nodes_custom = False

    def render(self, depsgraph):
        global instead
        task, instead = instead, None
        try:
            (task or MarramEngine._picture)(self, depsgraph)
        except Cancelled:
            pass
        except ExportError as error:
            self._fail(str(error))
        except Exception as error:  # an error of the add-on must not break Blender's render job
            traceback.print_exc()
            self._fail(f"the add-on has failed: {error}")

    def _fail(self, message: str):
        self.report({"ERROR"}, f"Marram: {message}")
        self.error_set(f"Marram: {message}")

    def _progress(self, phase: str, fraction: float):
        self.update_stats("", f"Marram: {phase}")
        self.update_progress(fraction)

    def frames_of(self, depsgraph, first: int, last: int, folder: str, notes: Notes, with_camera=True,
                  with_picture=True) -> export_scene.Job:
        """An export job of these frames, evaluated as for rendering. The caller restores the current frame."""
        def goto(frame):
            if depsgraph.scene.frame_current != frame or depsgraph.scene.frame_subframe != 0:
                self.frame_set(frame, 0.0)
            return depsgraph
        return export_scene.Job(folder, first, last, goto, with_camera=with_camera, with_picture=with_picture, cancelled=self.test_break,
                                progress=self._progress, notes=notes)

    def _picture(self, depsgraph):
        find_marram()  # fails before the export
        scene = depsgraph.scene
        frame = scene.frame_current
        notes = Notes()
        with tempfile.TemporaryDirectory(prefix="marram_") as folder:
            first, last = frames_around(scene, frame)
            job = self.frames_of(depsgraph, first, last, folder, notes)
            job.shot = (frame, frame)
            path = export_scene.export(job, scene)
            if scene.frame_current != frame:
                self.frame_set(frame, 0.0)
            picture = os.path.join(folder, "picture.exr")
            width, height = export_scene.picture_size(scene)
            result = self.begin_result(0, 0, width, height, layer=depsgraph.view_layer.name)
            watched = _Watched(self, result, os.path.join(folder, "preview.exr"), not scene.render.film_transparent)
            try:
                said = run_marram(["render", path, "-o", picture, "--frame", str(frame), *threads(scene), *watched.arguments(),
                                   *export_scene.further_settings(scene)], self.test_break, watched.progress)
                watched.show(picture)
            finally:
                self.end_result(result)
            for line in notes.lines() + said:
                self.report({"WARNING"}, f"Marram: {line}")


class _Watched:
    """Shows previews of a picture while it is rendered, unless Blender runs in the background."""

    def __init__(self, engine, result, preview: str, opaque: bool):
        self.engine, self.result, self.preview, self.opaque, self.shown = engine, result, preview, opaque, None

    def arguments(self) -> list[str]:
        return [] if bpy.app.background else ["--preview", self.preview]

    def progress(self, phase: str, fraction: float):
        self.engine._progress(phase, fraction)
        written = os.path.getmtime(self.preview) if os.path.exists(self.preview) else None
        if written != self.shown:
            self.shown = written
            self.show(self.preview)
            self.engine.update_result(self.result)

    def show(self, path: str):
        if self.opaque:
            hide_alpha(path)
        self.result.layers[0].load_from_file(path)


def frames_around(scene, frame: int) -> tuple[int, int]:
    """First and last whole frame needed to render a frame: those of its shutter, and earlier ones for jiggle."""
    opens, closes = shutter(scene)
    first, last = frame + math.floor(opens), frame + math.ceil(closes)
    if scene.marram.jiggle > 0:
        back = math.ceil(scene.marram.jiggle_past * scene.render.fps / scene.render.fps_base)
        first = min(first, max(frame - back, scene.frame_start))
    return min(first, frame), last


def threads(scene) -> list[str]:
    return ["--threads", str(scene.render.threads)] if scene.render.threads_mode == "FIXED" else []


def hide_alpha(path: str):
    """Renames the channel A of an EXR file: without it Blender takes alpha as 1, so that the sky is part of the
    picture. The new name also sorts before B, so the order of channels, and the pixels, stay as they are.
    Blender's images could do the same, but must not be made in the thread of a render."""
    head = b"channels\0chlist\0"
    with open(path, "r+b") as file:
        at = file.read(4096).find(head)
        first = at + len(head) + 4  # after the size of the list
        file.seek(first)
        if at >= 0 and file.read(2) == b"A\0":
            file.seek(first)
            file.write(b"0")


LEFT_OUT = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes"}
# Panels of Eevee that apply here too: materials, worlds and lamps have the same nodes and values.
OF_EEVEE = {"EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface", "DATA_PT_EEVEE_light"}


def _panels():
    for panel in bpy.types.Panel.__subclasses__():
        if panel.__name__ in OF_EEVEE or (panel.__name__ not in LEFT_OUT and "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ())):
            yield panel


def register():
    bpy.utils.register_class(MarramEngine)
    for panel in _panels():
        panel.COMPAT_ENGINES.add(MarramEngine.bl_idname)


def unregister():
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(MarramEngine.bl_idname)
    bpy.utils.unregister_class(MarramEngine)
