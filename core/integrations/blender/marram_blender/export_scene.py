# SPDX-License-Identifier: Apache-2.0
"""Exports a Blender scene to Marram: scene.toml and its files in a folder.

The caller evaluates the frames one by one, as only a render may move its dependency graph to another frame.
"""
import json
import os
from dataclasses import dataclass, field
from typing import Callable

import numpy as np

from . import axes, toml_text
from .export_camera import MovingCamera, shutter
from .export_hair import MovingHair, curves_hair, particle_hair
from .export_light import DARK, LAMPS, UNSEEN, MovingLamp, world_entries
from .export_material import Materials
from .export_mesh import MovingMesh, is_open, read_surface
from .import_strands import is_blown
from .notes import ExportError, Notes
from .program import Cancelled

SCENE, GROOMS = "scene.toml", "grooms.json"
WITH_A_SURFACE = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
NOT_EXPORTED = {"VOLUME": "volumes are not exported", "POINTCLOUD": "point clouds are not exported",
                "GPENCIL": "grease pencil is not exported", "LIGHT_PROBE": ""}
# Pixels, for all approximations, such as motion keys and straight curve pieces.
TOLERANCE_PIXELS = 0.25
WIND_IN_TIME = ("direction", "speed", "bend", "stiff_root", "turbulence", "calm", "jiggle", "damping", "shield")  # settings


@dataclass
class Job:
    """An export. first, last: whole frames, inclusive: those of the shot, and those around it that its shutter
    and jiggle need. goto(frame) evaluates a frame and returns the dependency graph."""
    folder: str
    first: int
    last: int
    goto: Callable
    shot: tuple[int, int] | None = None  # its first and last frame; None: all
    rendered: bool = True           # the graph of a render: use render counts of children and steps
    with_camera: bool = True        # its pixels set the tolerance
    with_picture: bool = True       # film and world
    cancelled: Callable = lambda: False
    progress: Callable = lambda phase, fraction: None
    notes: Notes = field(default_factory=Notes)


def export(job: Job, scene) -> str:
    """Writes the scene and returns the path of its file."""
    os.makedirs(job.folder, exist_ok=True)
    writer = _Writer(job, scene)
    for frame in range(job.first, job.last + 1):
        if job.cancelled():
            raise Cancelled()
        job.progress("exporting", (frame - job.first) / (job.last - job.first + 1))
        writer.add_frame(frame, job.goto(frame))
    return writer.write()


def picture_size(scene) -> tuple[int, int]:
    render = scene.render
    return tuple(max(1, int(side * render.resolution_percentage / 100)) for side in (render.resolution_x, render.resolution_y))


class _Writer:
    def __init__(self, job: Job, scene):
        self.job, self.notes, self.folder = job, job.notes, job.folder
        self.settings = scene.marram
        self.shot = job.shot or (job.first, job.last)
        self.scene = scene
        self.unit = axes.metres_per_unit(scene)
        self.materials = Materials(job.folder, job.notes)
        self.camera = MovingCamera(job.notes)
        self.meshes: dict[tuple, MovingMesh] = {}
        self.grooms: dict[tuple, MovingHair] = {}
        self.lamps: dict[tuple, MovingLamp] = {}
        self.world: list[dict] = [DARK]
        self.winds: dict[int, dict] = {}  # by frame
        self.files = 0
        self.names: set[str] = set()

    # ---- A frame

    def add_frame(self, frame: int, depsgraph):
        seen: set[tuple] = set()
        self.winds[frame] = self._wind_now(depsgraph)
        if self.job.with_camera:
            self.camera.add(frame, self.scene, depsgraph, picture_size(self.scene), self.unit)
        if self.job.with_picture and frame == self.shot[0]:
            self.world = world_entries(depsgraph.scene_eval.world, self.settings.sky == "DAYLIGHT", self.folder, self.notes,
                                       self.job.cancelled)
        for instance in depsgraph.object_instances:
            thing = instance.object
            key = (thing.name_full, thing.type, *(instance.persistent_id if instance.is_instance else ()))
            if instance.is_instance:
                key += (instance.parent.name_full if instance.parent else "",)
            if instance.show_self:
                self._add_self(frame, key, thing, instance.matrix_world.copy(), seen)
            if instance.show_particles and thing.type == "MESH":
                self._add_particles(frame, key, thing, instance, seen)
        for key, moving in {**self.meshes, **self.grooms}.items():
            if key not in seen:
                moving.add(frame, None) if isinstance(moving, MovingHair) else moving.add(frame, None, moving.matrices[0])
        if frame == self.job.first:
            for groom in self.grooms.values():
                mesh = self.meshes.get(groom.surface)
                groom.on = mesh.name if mesh else None

    def _add_self(self, frame, key, thing, matrix, seen):
        if thing.type in WITH_A_SURFACE:
            self._add_mesh(frame, key, thing, matrix, seen)
        elif thing.type == "CURVES":
            self._add_curves(frame, key, thing, matrix, seen)
        elif thing.type == "LIGHT" and self.job.with_picture:
            self._add_lamp(frame, key, thing, matrix)
        elif NOT_EXPORTED.get(thing.type):
            self.notes.add(NOT_EXPORTED[thing.type], thing.name)

    def _add_lamp(self, frame, key, thing, matrix):
        if key not in self.lamps:
            if thing.data.type not in LAMPS:
                self.notes.add("spot lamps are not exported", thing.name)
                return
            self.lamps[key] = MovingLamp(thing.data.type, self._free_name(thing.name))
        self.lamps[key].add(frame, thing, matrix, self.unit, self.notes)

    def _lamp_entries(self, lamp: MovingLamp) -> tuple[list[dict], list[dict]]:
        return lamp.entries(range(self.job.first, self.job.last + 1), self._shot_frames(), lambda surface: MovingMesh(
            lamp.name, self._file(lamp.name), self.folder, self.unit, self.notes, surface, UNSEEN, [None]))

    def _shot_frames(self) -> range:
        return range(self.shot[0], self.shot[1] + 1)

    def _add_mesh(self, frame, key, thing, matrix, seen):
        surface = read_surface(thing)
        if surface is None:
            if thing.type == "MESH" and not thing.particle_systems and not thing.modifiers and frame == self.job.first:
                self.notes.add("has no faces: is not exported", thing.name)
            return
        if key not in self.meshes:
            if frame > self.job.first:
                self.notes.add(f"appears at frame {frame}: is not exported", thing.name)
                return
            self.meshes[key] = self._new_mesh(thing, surface)
        seen.add(key)
        self.meshes[key].add(frame, surface, matrix)

    def _new_mesh(self, thing, surface) -> MovingMesh:
        original = thing.original
        roles = {"collides": original.marram.collides, "shelters": original.marram.shelters,
                 "casts_shadows": original.visible_shadow, "seen_by_camera": original.visible_camera}
        roles = {role: None if value else False for role, value in roles.items()}
        name = self._free_name(thing.name)
        slots = [slot.material for slot in thing.material_slots] or [None]
        used = set(np.minimum(surface.material, len(slots) - 1).tolist())
        names = [self.materials.name_for(one, False) if index in used else None for index, one in enumerate(slots)]
        return MovingMesh(name, self._file(name), self.folder, self.unit, self.notes, surface, roles, names)

    # ---- Hair

    def _add_particles(self, frame, key, thing, instance, seen):
        for modifier in thing.modifiers:
            if modifier.type != "PARTICLE_SYSTEM" or not (modifier.show_render if self.job.rendered else modifier.show_viewport):
                continue
            system = modifier.particle_system
            whole = key + (system.name,)
            hair = particle_hair(thing, system, self.notes, self.job.rendered)
            if hair is None:
                continue
            if instance.is_instance:
                hair.points = axes.transformed(hair.points, instance.matrix_world @ thing.matrix_world.inverted_safe())
            self._add_hair(frame, whole, hair, thing, key, system.name, system.settings.material - 1, seen)

    def _add_curves(self, frame, key, thing, matrix, seen):
        hair = curves_hair(thing.data, matrix)
        if hair is None:
            return
        surface = thing.original.data.surface if thing.original.type == "CURVES" else None
        self._add_hair(frame, key, hair, thing, (surface.name_full, surface.type) if surface else None, "", 0, seen)

    def _add_hair(self, frame, key, hair, thing, on, system: str, slot: int, seen):
        if key not in self.grooms:
            if frame > self.job.first:
                self.notes.add(f"appears at frame {frame}: is not exported", thing.name)
                return
            name = self._free_name(f"{thing.name} {system}".strip() if system else f"{thing.name} strands")
            slots = thing.material_slots
            material = slots[min(max(slot, 0), len(slots) - 1)].material if len(slots) else None
            self.grooms[key] = MovingHair(name, self._file(name), self.folder, self.unit, self.notes, len(self.grooms),
                                          on, self.settings.hair_motion == "CARRIED",
                                          self.materials.name_for(material, True), (thing.original.name, system), slot,
                                          is_blown(thing.original))
        seen.add(key)
        self.grooms[key].add(frame, hair)

    # ---- Names

    def _free_name(self, name: str) -> str:
        free, number = name, 1
        while free in self.names:
            free, number = f"{name} {number}", number + 1
        self.names.add(free)
        return free

    def _file(self, name: str) -> str:
        self.files += 1
        return f"{self.files:04d}_" + "".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:40]

    # ---- The scene

    def write(self) -> str:
        meshes = [entry for mesh in self.meshes.values() for entry in mesh.entries()]
        lights = [light for mesh in self.meshes.values() for light in self._shining(mesh)]
        for more_meshes, more_lights in map(self._lamp_entries, self.lamps.values()):
            meshes += more_meshes
            lights += more_lights
        lights = lights + self.world if self.job.with_picture else [DARK]
        shape = "round" if hasattr(self.scene, "cycles_curves") and self.scene.cycles_curves.shape == "THICK" else "ribbon"
        strands = [groom.entries(shape) for groom in self.grooms.values()]
        tables = [self._globals(), toml_text.table_text("[camera]", self._camera())]
        tables.append(toml_text.table_text("[film]", self._film()))
        tables.append(toml_text.table_text("[wind]", self._wind()))
        for kind, entries in (("light", lights), ("material", self.materials.entries), ("mesh", meshes),
                              ("curves", [one for one, _ in strands]), ("procedural", [one for _, one in strands])):
            tables += [toml_text.table_text(f"[[{kind}]]", entry) for entry in entries]
        path = os.path.join(self.folder, SCENE)
        with open(path, "w", encoding="utf-8") as file:
            file.write("\n".join(tables))
        self._write_grooms()
        self._note_settings()
        return path

    def _write_grooms(self):
        """What an import needs to know of each groom, by its number."""
        told = [{"name": groom.name, "object": groom.source[0], "system": groom.source[1], "slot": groom.slot, "unit": self.unit}
                for groom in self.grooms.values()]
        with open(os.path.join(self.folder, GROOMS), "w", encoding="utf-8") as file:
            json.dump(told, file)

    def _note_settings(self):
        for owner in (self.scene, self.scene.world and self.scene.world.node_tree):
            if owner and owner.animation_data and owner.animation_data.action:
                paths = [curve.data_path for curve in owner.animation_data.action.fcurves]
                constant = [path for path in paths if path.startswith("marram.") and path.removeprefix("marram.") not in WIND_IN_TIME]
                if owner == self.scene and constant:
                    self.notes.add(f"does not change over the frames: {', '.join(sorted(set(constant)))}", owner.name)
                if owner != self.scene and paths and self.shot[1] > self.shot[0]:
                    self.notes.add(f"the world does not change: it is as at frame {self.shot[0]}", self.scene.world.name)
        for material in self.materials.animated if self.job.with_picture and self.job.last > self.job.first else ():
            self.notes.add(f"materials do not change: it is as at frame {self.job.first}", material)
        render = self.scene.render
        if render.use_border:
            self.notes.add("the render region is not exported: the whole picture is rendered", self.scene.name)
        if render.pixel_aspect_x != render.pixel_aspect_y:
            self.notes.add("pixels are square in Marram", self.scene.name)
        if render.film_transparent and self.job.with_picture:
            self.notes.add("the sky stays in a transparent film: its alpha alone is transparent", self.scene.name)

    def _globals(self) -> str:
        render = self.scene.render
        return "# Exported from Blender: z up there is y up here\n" + toml_text.table_text("", {
            "fps": render.fps / render.fps_base, "frames": self.shot, "bind_frame": self.job.first,
            **({"tolerance_pixels": TOLERANCE_PIXELS} if self.job.with_camera else {"tolerance": 0})})

    def _camera(self) -> dict:
        if not self.job.with_camera:  # not rendered, but every scene needs a camera
            return {"position": [0, 0, 1], "target": [0, 0, 0]}
        middles = [groom.hair.points.mean(axis=0) for groom in self.grooms.values()]
        distance = self.camera.distance_to(np.mean(middles, axis=0), self.unit) if middles else 0
        return self.camera.entry(shutter(self.scene), distance if distance > 1e-2 else 1.0, self.unit, self._shot_frames())

    def _film(self) -> dict:
        cycles = getattr(self.scene, "cycles", None)
        return {"size": picture_size(self.scene), "samples": self.settings.samples, "max_depth": self.settings.max_depth,
                "noise": self.settings.noise or None, "seed": cycles.seed if cycles else None,
                "filter_radius": cycles.filter_width if cycles and cycles.pixel_filter_type == "BLACKMAN_HARRIS" else None}

    def _wind_now(self, depsgraph) -> dict:
        """What may change over the frames, at the frame of the graph."""
        s = depsgraph.scene_eval.marram
        along = s.wind_object.original.evaluated_get(depsgraph) if s.wind_object else None
        direction = (along.matrix_world.to_3x3().col[2] if along else s.direction).copy()
        if direction.length == 0:
            raise ExportError("the wind has no direction: set one in the scene's panel Wind")
        return {"direction": axes.vector_to_marram(direction.normalized()),
                "stiff_root": [[0, s.stiff_root], [1, 1]],
                **{name: getattr(s, name) for name in ("speed", "bend", "turbulence", "calm", "jiggle", "damping", "shield")}}

    def _wind(self) -> dict:
        s = self.settings
        of = {name: toml_text.over_time({frame: now[name] for frame, now in self.winds.items()}) for name in WIND_IN_TIME}
        jiggles, shelters = (any(now[name] for now in self.winds.values()) for name in ("jiggle", "shield"))
        if jiggles and not all(now["jiggle"] for now in self.winds.values()):
            raise ExportError("Jiggle is 0 at some frames and not at others: keep it above 0")
        return {"direction": of["direction"], "speed": of["speed"], "global_rotate": of["bend"], "ramp_rotate": of["stiff_root"],
                "noise": {"amplitude": of["turbulence"], "frequency": s.turbulence_scale}, "calm": of["calm"] if s.gusts else None,
                "gusts": {"num_gusts": s.gusts, "radius_range": sorted(s.gust_radius)} if s.gusts else None,
                "jiggle": {"frequency": of["jiggle"], "damping": of["damping"]} if jiggles else None,
                "shielding": {"shield": of["shield"]} if shelters else None,
                "collision": {"solver": "exact"} if s.collide else None}

    def _shining(self, mesh: MovingMesh) -> list[dict]:
        """Lights of meshes whose material emits."""
        names = [mesh.name] if len(mesh.parts) == 1 else [mesh.name + suffix for suffix, _ in mesh.parts[1:]]
        lights = []
        for name, slot in zip(names, mesh.used):
            radiance = self.materials.radiance[mesh.materials[slot]]
            if radiance and max(radiance) > 0 and mesh.roles["casts_shadows"] is False:
                self.notes.add("casts no shadows: does not shine either", mesh.name)
            elif radiance and max(radiance) > 0:
                lights.append({"name": f"{name} light", "type": "mesh", "mesh": name, "radiance": radiance})
                if is_open(mesh.surface):
                    self.notes.add("shines from its outer side alone", mesh.name)
        return lights


def further_settings(scene) -> list[str]:
    """Arguments of marram from the scene's setting More."""
    return [word for key in scene.marram.more.split(";") if key.strip() for word in ("--set", key.strip())]
