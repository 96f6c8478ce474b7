# SPDX-License-Identifier: Apache-2.0
"""The camera: its motion, angle of view and lens over the frames, and its shutter."""
import math

from mathutils import Vector

from . import axes, toml_text
from .notes import ExportError


def vertical_fov(camera, width: int, height: int) -> float:
    """Vertical angle of view, radians. sensor_fit selects the side of the picture that the sensor spans."""
    if camera.sensor_fit == "VERTICAL":
        return 2 * math.atan(0.5 * camera.sensor_height / camera.lens)
    across = width if camera.sensor_fit == "HORIZONTAL" else max(width, height)
    return 2 * math.atan(0.5 * camera.sensor_width / camera.lens * height / across)


def shutter(scene) -> list[float]:
    """Times of opening and closing in frames, relative to the frame."""
    if not scene.render.use_motion_blur:
        return [0, 0]
    length = scene.render.motion_blur_shutter
    position = scene.cycles.motion_blur_position if hasattr(scene, "cycles") else "CENTER"
    opens = {"START": 0.0, "CENTER": -0.5, "END": -1.0}[position] * length
    return [opens, opens + length]


class MovingCamera:
    def __init__(self, notes):
        self.notes = notes
        self.frames, self.matrices = [], []
        self.fovs: dict[int, float] = {}         # by frame, degrees
        self.distances: dict[int, float] = {}    # metres, of the frames with depth of field
        self.lens_radii: dict[int, float] = {}   # metres; 0 without depth of field
        self.name = ""

    def add(self, frame: int, scene, depsgraph, size: tuple[int, int], unit: float):
        original = depsgraph.scene_eval.camera or scene.camera
        if original is None:
            raise ExportError("the scene has no camera: add one")
        thing = original.evaluated_get(depsgraph)
        camera = thing.data
        self.name = thing.name
        if camera.type != "PERSP":
            raise ExportError(f"the camera {thing.name} is no perspective one: Marram has no other")
        self._note_what_is_missing(camera)
        self.frames.append(frame)
        self.matrices.append(thing.matrix_world.copy())
        self.fovs[frame] = math.degrees(vertical_fov(camera, *size))
        self.lens_radii[frame] = 0.5 * camera.lens * 1e-3 / camera.dof.aperture_fstop * unit if camera.dof.use_dof else 0.0
        if camera.dof.use_dof:
            self.distances[frame] = _focus_distance(thing, camera, depsgraph) * unit

    def _note_what_is_missing(self, camera):
        if camera.shift_x or camera.shift_y:
            self.notes.add("the camera's shift is not exported: the picture shows another part of the scene", self.name)
        if camera.dof.use_dof and (camera.dof.aperture_blades or camera.dof.aperture_ratio != 1):
            self.notes.add("the lens is a round disc", self.name)

    def entry(self, shutter_times: list[float], nearest: float, unit: float, shot: range) -> dict:
        """The table [camera]. nearest: distance of the target in metres, if the camera has no focus distance.
        shot: its frames. Marram reads the angle of view and the lens at these, but the motion around them too."""
        target = toml_text.held(self.distances, shot)[shot[0]] if self.distances else nearest
        moves = any(matrix != self.matrices[0] for matrix in self.matrices)
        if moves:
            entry = {"position": [0, 0, 0], "target": [0, 0, -target], "transform": {"keys": self._keys(unit)}}
        else:
            turn, there = self.matrices[0].to_quaternion(), self.matrices[0].translation * unit
            look = turn @ Vector((0, 0, -1))
            entry = {"position": axes.vector_to_marram(there), "target": axes.vector_to_marram(there + target * look),
                     "up": axes.vector_to_marram(turn @ Vector((0, 1, 0)))}
        return {**entry, "fov": toml_text.over_time(toml_text.held(self.fovs, shot)), **self._lens(shot),
                "shutter": shutter_times if any(shutter_times) else None}

    def _lens(self, shot: range) -> dict:
        """Radius and focus. Frames without depth of field have the radius 0 and the focus of frames that have it."""
        radii = toml_text.held(self.lens_radii, shot)
        if not any(radii.values()):
            return {}
        return {"lens_radius": toml_text.over_time(radii), "focus": toml_text.over_time(toml_text.held(self.distances, shot))}

    def _keys(self, unit: float) -> list[dict]:
        """Keys of the transform. Cameras look along -z with y up in both programs: only world axes change."""
        keys, before = [], None
        for frame, matrix in zip(self.frames, self.matrices):
            turn = (axes.TO_MARRAM @ matrix).to_quaternion()
            before = turn.to_euler("XYZ", before) if before else turn.to_euler("XYZ")
            keys.append({"frame": frame, "translate": axes.vector_to_marram(matrix.translation * unit),
                         "rotate": [math.degrees(angle) for angle in before]})
        return keys

    def distance_to(self, point, unit: float) -> float:
        """Depth of a point along the view direction at the first frame, in metres."""
        ahead = self.matrices[0].to_quaternion() @ Vector((0, 0, -1))
        return ahead.dot(Vector(point) - self.matrices[0].translation) * unit


def _focus_distance(thing, camera, depsgraph) -> float:
    focus = camera.dof.focus_object
    if focus is None:
        return max(camera.dof.focus_distance, 1e-4)
    ahead = thing.matrix_world.to_quaternion() @ Vector((0, 0, -1))
    away = focus.evaluated_get(depsgraph).matrix_world.translation - thing.matrix_world.translation
    return max(abs(ahead.dot(away)), 1e-4)
