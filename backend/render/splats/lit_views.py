"""Pictures of a lit hand from all around, to which splats are fitted, and from between, by which they are judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...geometry.framing import fitting_camera
from ...image.decode import straight_srgb
from ...image.grade import graded
from ...records.camera import Camera
from .lit_hand import LitHand, SplatOptions

HELD_OUT = 8
_GOLDEN_RAD = np.pi * (1 + 5**0.5)
_FILLED = 0.94
_WHOLE_EACH = 3  # each third view shows the arm, too, the others the hand


class LitView(NamedTuple):
    """A view in the axes of the splats, and its picture [H, W, 4]: sRGB-encoded colour on black, and alpha."""

    camera: Camera
    picture: np.ndarray


def views_around(
    hand: LitHand, options: SplatOptions, axes: np.ndarray, should_stop: Callable[[], bool]
) -> tuple[Iterator[LitView], Iterator[LitView]]:
    """Render a hand from `options.views` directions, evenly spread over the sphere, and from others that are held out.

    Args:
        hand: to be seen; its arm ends opaque.
        options: of the views.
        axes: [3, 3] rotation from the world to the axes of the splats.
        should_stop: queried during renders.

    Raises:
        RenderStopped: `should_stop` returned True.
    """
    shot = replace(hand.shot, wrist_fade_m=0.0)
    whole = shot.vertices
    framed = whole[hand.renderer.hand.framed_vertices]
    size_px = (options.size_px, options.size_px)

    def view(index: int, towards: np.ndarray) -> LitView:
        points = framed if index % _WHOLE_EACH else whole
        camera = fitting_camera(points, tuple(towards.tolist()), size_px, _FILLED)
        frame = hand.renderer.render(shot.with_camera(camera), should_stop)
        straight = straight_srgb(graded(frame, hand.grade))
        picture = np.concatenate([straight[..., :3] * straight[..., 3:], straight[..., 3:]], -1)
        return LitView(replace(camera, cam2world=turned(axes) @ camera.cam2world), picture)

    fitted = (view(index, towards) for index, towards in enumerate(directions(options.views)))
    return fitted, (view(1, towards) for towards in directions(HELD_OUT, _GOLDEN_RAD / 3))


def directions(count: int, turn_rad: float = 0.0) -> np.ndarray:
    """Spread unit directions [count, 3] evenly over the sphere, none along Z (a spiral of the golden angle)."""
    index = np.arange(count) + 0.5
    z, angle = 1 - 2 * index / count, _GOLDEN_RAD * index + turn_rad
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], 1)


def turned(axes: np.ndarray) -> np.ndarray:
    """Return a rotation [3, 3] as [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    return matrix
