"""Reads a scene's motion blur and depth of field."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.image.exposure import ExposureSample, Lens, Shutter, exposure_samples


def read_exposure(scene: bpy.types.Scene, lens: Lens | None) -> tuple[ExposureSample, ...]:
    """The exposure samples of a frame, the one nearest to the frame itself first."""
    return exposure_samples(scene.livehand.blur_samples, _read_shutter(scene.render), lens)


def read_lens(camera: bpy.types.Object) -> Lens | None:
    """The lens of an evaluated camera; None if its depth of field is off."""
    settings = camera.data.dof
    if not settings.use_dof:
        return None
    radius_m = camera.data.lens * 1e-3 / (2 * settings.aperture_fstop)
    return Lens(radius_m, max(_focus_m(camera, settings), camera.data.clip_start))


def _read_shutter(render: bpy.types.RenderSettings) -> Shutter | None:
    if not render.use_motion_blur:
        return None
    length = render.motion_blur_shutter
    return Shutter({"START": 0.0, "CENTER": -length / 2, "END": -length}[render.motion_blur_position], length)


def _focus_m(camera: bpy.types.Object, settings: bpy.types.CameraDOFSettings) -> float:
    """The depth of the plane of focus along the camera's axis, computed as Blender does."""
    target = settings.focus_object
    if target is None:
        return settings.focus_distance
    focus = target.matrix_world
    if settings.focus_subtarget and target.type == "ARMATURE":
        bone = target.pose.bones.get(settings.focus_subtarget)
        focus = focus @ bone.matrix if bone else focus
    matrix = np.array(camera.matrix_world)
    axis = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    return float(abs(axis @ (np.array(focus)[:3, 3] - matrix[:3, 3])))
