"""The thumbnail in the file of an avatar, by which users recognise it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..avatars.avatar import Avatar
from ..geometry.framing import fitting_camera
from ..geometry.rotation import matrix_to_axis_angle
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel, upright
from ..image.decode import straight_srgb
from ..records.frame import Frame
from ..records.shot import HandPose, Shot
from .renderer import Renderer
from .studio_light import studio_light

SIDE_PX = 192
# The hand in rest pose, upright and slightly turned, seen from the side of the dome's key light.
_TOWARDS_CAMERA = (-0.35, -1.0, 0.15)
_FILL = 0.92  # share of the image that the hand takes up
_SUPERSAMPLING = 2  # sharper than rendering small, because it is closer to the image size of training


def with_thumbnail(avatar: Avatar, hand: HandModel, device: str = "auto") -> Avatar:
    """Return the avatar with a new thumbnail.

    Args:
        avatar: of `hand`, or of a hand model that differs from it only by a refined surface.
        hand: the hand model to render.
        device: to render on.
    """
    renderer = Renderer(replace(avatar, hand_sha256=hand.sha256), hand, device)
    return replace(avatar, thumbnail=render_thumbnail(renderer))


def render_thumbnail(renderer: Renderer) -> np.ndarray:
    """Render [192, 192, 4] uint8: sRGB with straight alpha, top row first; drawn people in their own shape."""
    theta = np.zeros((16, 3))
    theta[0] = matrix_to_axis_angle(upright(renderer.hand.side))
    pose = HandPose(theta, _beta(renderer.avatar), np.zeros(3), renderer.hand.side)
    vertices = posed_vertices(renderer.hand, pose)
    framed = vertices[renderer.hand.for_side(pose.side).framed_vertices]
    camera = fitting_camera(framed, _TOWARDS_CAMERA, (SIDE_PX * _SUPERSAMPLING, SIDE_PX * _SUPERSAMPLING), _FILL)
    frame = renderer.render(Shot(pose, vertices, camera, studio_light()))
    small = Frame(_averaged(frame.rgb), _averaged(frame.alpha), _averaged(frame.depth))
    return (straight_srgb(small) * 255).round().astype(np.uint8)


def _beta(avatar: Avatar) -> np.ndarray:
    """Return the shape [10] to show: the person's own if it is known, else the hand's."""
    return np.zeros(10) if avatar.surface is None else np.array(avatar.surface.person.beta)


def _averaged(plane: np.ndarray) -> np.ndarray:
    """Average [H, W, ...] over blocks of pixels; colours are linear and premultiplied."""
    return (
        plane.reshape(SIDE_PX, _SUPERSAMPLING, SIDE_PX, _SUPERSAMPLING, -1)
        .mean((1, 3), dtype=np.float32)
        .reshape(SIDE_PX, SIDE_PX, *plane.shape[2:])
    )
