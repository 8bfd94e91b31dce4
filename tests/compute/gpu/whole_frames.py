"""Whole frames of 64 x 96 px of every kind that is rendered at once, and how they are compared with the CPU's."""

from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import numpy as np
import torch
from livehand.backend.geometry.rotation import matrix_to_axis_angle
from livehand.backend.hand.gestures import theta_of
from livehand.backend.hand.joint_axes import finger_axes
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import UPRIGHT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.hand.poses import POSES
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Light, Sky
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.lit_shots import reason_for_stages
from livehand.backend.surface.base_surface import whole_surface
from livehand.backend.surface.blood import DRAINS

from .conftest import AREAS, POINT, SKY, SPOT, SUN, shots

VALUE, FLIPPED = 2e-3, 2e-2  # as `test_frames` has them
FLIPPED_OF_LEFT = 2e-3


@cache
def kinds():
    """Shots by what they are of; a left hand's face the camera so that hardly a sample lies on an edge of two faces."""
    right, moving, cut, left = shots(load_default_hand())
    sculpted = right.vertices + 0.002 * np.sin(300 * right.vertices[:, ::-1])
    pressed = 0.0015 * (np.arange(len(right.vertices)) % 3 > 0)
    near = near_objects(left)
    return {
        "right": right,
        "left": left,
        "past the border": replace(cut, light=Light((SUN, SPOT))),
        "without lamps": replace(moving, light=Light((), SKY), quality="final"),
        "without a sky": replace(moving, light=Light((POINT, *AREAS)), quality="final"),
        "in the capture's light": replace(right, light=None),
        "sculpted": replace(right, vertices=sculpted, light=Light((SUN,), SKY)),
        "of another shape": replace(right, light=Light((POINT,), SKY), vertices=1.2 * right.vertices),
        "with hair, right": replace(right, hair=1.0),
        "with hair": replace(left, hair=0.6, light=Light((*AREAS, SUN), SKY)),
        "with hair, past the border": replace(cut, hair=1.0, light=Light((SUN, *AREAS), SKY)),
        "beside black objects": replace(left, light=Light((*AREAS, SUN), SKY, near)),
        "beside coloured objects": replace(left, light=Light((*AREAS, SUN), SKY, near, ALBEDO)),
        "beside coloured objects, right": replace(right, light=Light((POINT,), SKY, near_objects(right), ALBEDO)),
        "in fine shadows": replace(left, light=Light((*AREAS, SUN), SKY, shadow_quality="fine")),
        "in fine shadows of a bright window": replace(left, light=Light((SUN,), WINDOW, shadow_quality="fine")),
        "in fine shadows of objects": replace(
            left, hair=1.0, light=Light((POINT, *AREAS), SKY, near, ALBEDO, shadow_quality="fine")
        ),
        "in no shadows": replace(right, light=Light((*AREAS, SUN), SKY, shadow_quality="none")),
        "pressed": replace(left, pressed_m=pressed, light=Light((POINT,), SKY)),
        "moving": replace(left, quality="preview", light=Light((SUN,), SKY)),
    }


def with_blood_in_joints(avatar):
    """The avatar with joints that pale as they bend, unevenly over the hand: as people drawn from numbers are."""
    surface = avatar.surface
    count = len(whole_surface(surface).arrays["offset"])
    drains = (60 + 60 * np.sin(0.001 * np.arange(count))).astype(np.uint8)
    return replace(avatar, surface=replace(surface, arrays={**surface.arrays, DRAINS: drains}))


def knuckle_of_a_fist():
    """A right hand's ring finger's, at its outline, where the surface stands beyond the shell of the rays."""
    model = load_default_hand()
    theta = theta_of(POSES["Fist"].gesture.angles_deg(), finger_axes(model), matrix_to_axis_angle(UPRIGHT))
    pose = HandPose(theta, np.zeros(10), np.zeros(3))
    frames = bone_frames(model, pose)
    axes = frames[0, :3, :3] * (-1, 1, 1)  # distal, dorsal, radial
    towards = axes @ np.array([0.9, -0.6, 0.35]) / np.linalg.norm([0.9, -0.6, 0.35])
    at = frames[10, :3, 3] + axes @ np.array([-0.008, 0.008, 0])
    K = np.array([[2258.0, 0, 32], [0, 2258, 48], [0, 0, 1]])  # .31 mm a pixel: from .3 mm on faces are curved
    camera = Camera(K, look_at(at + 0.7 * towards, at, axes[:, 0]), (64, 96))
    return Shot(pose, posed_vertices(model, pose), camera, Light((), SKY), quality="final")


def near_objects(shot):
    """Three triangles a few centimetres from a hand, of which two shadow it."""
    rng, middle = np.random.default_rng(1), shot.vertices.mean(0)
    around = np.array([[[0.05, -0.06, 0.1]], [[-0.08, 0.0, 0.08]], [[0, 0, -0.1]]])
    return middle + around + rng.normal(0, 0.06, (3, 3, 3))


ALBEDO = np.array([[0.8, 0.2, 0.1], [0.1, 0.7, 0.2], [0.5, 0.5, 0.9]])
WINDOW = Sky(np.where(np.arange(32)[None, :, None] == 5, 40.0, 0.2) * np.ones((16, 1, 3)))


def rendered_at_once(renderer, shot):
    """A frame that was not rendered stage by stage."""
    assert reason_for_stages(shot) is None
    with torch.inference_mode():
        frame = renderer.pipeline.at_once(shot)
    assert frame is not None
    return frame


def off_by(one, other):
    """The share of values that differ, of colours and alpha the larger."""
    most = VALUE * max(1, other.rgb.max())
    return max((np.abs(getattr(one, name) - getattr(other, name)) > most).mean() for name in ("rgb", "alpha"))


def assert_same_frame(one, other, flipped=FLIPPED):
    assert off_by(one, other) < flipped
    solid = (one.alpha > 0.5) & (other.alpha > 0.5)
    assert solid.sum() > 300
    assert (np.abs(one.depth - other.depth)[solid] > 5e-4).mean() < flipped


@contextmanager
def new_buffers(renderer):
    """The same renderer without its buffers, within, and after it."""
    shots = renderer.pipeline._shots
    try:
        for side in ("right", "left"):
            shots._renderer(side)._kept.clear()
        yield renderer
    finally:
        for side in ("right", "left"):
            shots._renderer(side)._kept.clear()


def sequence_of(renderer, side="right"):
    """The sequence of the last frame's shape."""
    frames = renderer.pipeline._shots._renderers[side]
    return next(reversed(frames._kept.values())).buffers
