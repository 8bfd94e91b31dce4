"""When and through which points of the lens a frame is exposed: motion blur and depth of field by accumulation.

A blurred frame is the mean, in linear light, of sharp ones at moments spread over the shutter, each seen through
another point of a thin lens. Both spreads are even and fixed, so that a frame is the same whenever it is rendered.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...backend.records.camera import Camera

# Turns by this angle, and the square root of the share as radius, spread points evenly over a disc (Vogel 1979).
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class ExposureSample:
    """One of a frame's moments.

    Attributes:
        offset_frames: when, from the frame itself.
        lens: [2] where on the lens, in its radii, camera axes.
    """

    offset_frames: float
    lens: tuple[float, float]


@dataclass(frozen=True)
class Lens:
    """A thin lens: radius, m, and depth of its plane of focus, m."""

    radius_m: float
    focus_m: float


SHARP = ExposureSample(0.0, (0.0, 0.0))


def exposure_samples(scene: bpy.types.Scene, lens: Lens | None) -> tuple[ExposureSample, ...]:
    """The moments of a frame, the one nearest to the frame itself first."""
    is_moving = scene.render.use_motion_blur
    if not is_moving and lens is None:
        return (SHARP,)
    count = scene.livehand.blur_samples
    share = (np.arange(count) + 0.5) / count
    offsets = _shutter_start(scene) + scene.render.motion_blur_shutter * share if is_moving else 0 * share
    angle = _GOLDEN_ANGLE * np.arange(count)
    # Which point of the lens goes with which moment is shuffled, or a moving hand would be sharper at one side.
    radius = np.sqrt(np.random.default_rng(0).permutation(share)) if lens else 0 * share
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    order = np.argsort(np.abs(offsets), kind="stable")
    return tuple(ExposureSample(float(offsets[k]), (float(points[k, 0]), float(points[k, 1]))) for k in order)


def read_lens(camera: bpy.types.Object) -> Lens | None:
    """The lens of an evaluated camera; None where its depth of field is off."""
    settings = camera.data.dof
    if not settings.use_dof:
        return None
    radius_m = camera.data.lens * 1e-3 / (2 * settings.aperture_fstop)
    return Lens(radius_m, max(_focus_m(camera, settings), camera.data.clip_start))


def seen_at(camera: Camera, lens: Lens | None, moment: ExposureSample) -> Camera:
    """The camera as it sees through the moment's point of the lens."""
    return camera if lens is None else camera.through_lens(lens.radius_m * np.array(moment.lens), lens.focus_m)


def _focus_m(camera: bpy.types.Object, settings: bpy.types.CameraDOFSettings) -> float:
    """Depth of the plane of focus along the camera's axis, as Blender has it."""
    target = settings.focus_object
    if target is None:
        return settings.focus_distance
    place = target.matrix_world
    if settings.focus_subtarget and target.type == "ARMATURE":
        bone = target.pose.bones.get(settings.focus_subtarget)
        place = place @ bone.matrix if bone else place
    matrix = np.array(camera.matrix_world)
    axis = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    return float(abs(axis @ (np.array(place)[:3, 3] - matrix[:3, 3])))


def _shutter_start(scene: bpy.types.Scene) -> float:
    """From the frame, in frames."""
    shutter = scene.render.motion_blur_shutter
    return {"START": 0.0, "CENTER": -shutter / 2, "END": -shutter}[scene.render.motion_blur_position]
