"""The small picture of an avatar that its file carries, so that people can choose among avatars by sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.framing import fitting_camera
from ..geometry.rotation import matrix_to_axis_angle
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel, upright
from ..nerf.avatar import Avatar
from ..records.shot import Frame, HandPose, Shot
from ..rendering.decode import straight_srgb
from ..rendering.renderer import Renderer

SIDE_PX = 192
# The hand at rest, upright, from the side that the captures' light comes from, a little turned.
_TOWARDS_CAMERA = (-0.35, -1.0, 0.15)
_FILLED = 0.92
_FINER = 2  # rendered nearer to the size that avatars learn at, then averaged: sharper than rendered small


def with_thumbnail(avatar: Avatar, hand: HandModel, device: str = "auto") -> Avatar:
    """The avatar with a new picture of itself.

    Args:
        avatar: of `hand`, or of one that differs from it by a refined surface only.
        hand: what it is shown on.
        device: to render on.
    """
    renderer = Renderer(replace(avatar, hand_sha256=hand.sha256), hand, device)
    return replace(avatar, thumbnail=render_thumbnail(renderer))


def render_thumbnail(renderer: Renderer) -> np.ndarray:
    """[192, 192, 4] uint8: sRGB with straight alpha, top row first."""
    theta = np.zeros((16, 3))
    theta[0] = matrix_to_axis_angle(upright(renderer.hand.side))
    pose = HandPose(theta, np.zeros(10), np.zeros(3), renderer.hand.side)
    vertices = posed_vertices(renderer.hand, pose)
    camera = fitting_camera(vertices, _TOWARDS_CAMERA, (SIDE_PX * _FINER, SIDE_PX * _FINER), _FILLED)
    frame = renderer.render(Shot(pose, vertices, camera))
    small = Frame(_averaged(frame.rgb), _averaged(frame.alpha), _averaged(frame.depth))
    return (straight_srgb(small) * 255).round().astype(np.uint8)


def _averaged(plane: np.ndarray) -> np.ndarray:
    """[H, W, ...] at a smaller size; linear and premultiplied, as light adds."""
    return (
        plane.reshape(SIDE_PX, _FINER, SIDE_PX, _FINER, -1)
        .mean((1, 3), dtype=np.float32)
        .reshape(SIDE_PX, SIDE_PX, *plane.shape[2:])
    )
