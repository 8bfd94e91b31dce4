"""How consistent a renderer is on a turntable and in a wave, beside the truth where there is one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...evaluation.evaluate import encoded_on_black
from ...evaluation.shot_renderer import ShotRenderer
from ...hand.model import HandModel
from ...records.camera import look_at
from ..benchmark.motion import MotionFrame, MovingHand
from .warping import MeshView, warped

MotionName = Literal["turntable", "wave"]
Truth = Callable[[MotionFrame], np.ndarray]
"""Renders the true picture of a frame: [H, W, 4] sRGB-encoded colour times alpha, and alpha."""


@dataclass(frozen=True)
class Consistency:
    """Means over the pixels that show the same skin in three frames, levels of 255.

    Attributes:
        pixels: how many there are, in all frames.
        difference: absolute, of a frame from the one before, on the moving skin.
        flicker: absolute, of a frame from the mean of its neighbours.
        truth_difference: of the truth at the same pixels; None: there is no truth.
        truth_flicker: the same.
    """

    pixels: int
    difference: float
    flicker: float
    truth_difference: float | None = None
    truth_flicker: float | None = None

    @property
    def beyond(self) -> float | None:
        """The difference beyond the truth's own."""
        return None if self.truth_difference is None else self.difference - self.truth_difference


def motion_frames(
    name: MotionName, hand: HandModel, size_px: tuple[int, int], count: int, per_turn: int
) -> list[MotionFrame]:
    """List successive frames of a motion.

    Args:
        name: the benchmark's wave, in which fingers, wrist and camera move, or its first pose on a turntable.
        hand: the model.
        size_px: (width, height).
        count: of frames.
        per_turn: frames in which the motion comes back to its begin.
    """
    frames = MovingHand(hand, size_px).frames(per_turn)
    if name == "wave":
        return [frames[k % per_turn] for k in range(count)]
    return [_turned(frames[0], 2 * np.pi * k / per_turn) for k in range(count)]


def measure(renderer: ShotRenderer, frames: Sequence[MotionFrame], truth: Truth | None = None) -> Consistency:
    """Render the frames, of which there are three or more, and compare neighbours; raises as the renderer does."""
    moving = MovingHand(renderer.hand, frames[0].camera.size_px)
    shots = [moving.shot(frame) for frame in frames]
    views = [MeshView(np.asarray(shot.vertices, float), renderer.hand.f, shot.camera) for shot in shots]
    images = [encoded_on_black(renderer.render(shot)) for shot in shots]
    true = None if truth is None else [truth(frame) for frame in frames]
    parts = np.concatenate([*_compared(views, images, true)], 1)
    ours, theirs = parts[:, :, 0].mean(1), parts[:, :, 1].mean(1)
    made = Consistency(parts.shape[1], *map(float, ours))
    return made if true is None else replace(made, truth_difference=float(theirs[0]), truth_flicker=float(theirs[1]))


def _compared(
    views: Sequence[MeshView], images: Sequence[np.ndarray], true: Sequence[np.ndarray] | None
) -> Iterator[np.ndarray]:
    """Yield [2, P, 2] of each frame with two neighbours: difference and flicker, of ours and of the truth."""
    for k in range(1, len(views) - 1):
        three = (views[k - 1], views[k], views[k + 1])
        ours = warped(three, (images[k - 1], images[k], images[k + 1]))
        theirs = ours if true is None else warped(three, (true[k - 1], true[k], true[k + 1]))
        _, at, other = np.intersect1d(ours.pixel, theirs.pixel, assume_unique=True, return_indices=True)
        both = [(ours.before[at], theirs.before[other]), (ours.flicker[at], theirs.flicker[other])]
        yield np.abs(np.array(both)).mean(-1).transpose(0, 2, 1)


def _turned(frame: MotionFrame, angle_rad: float) -> MotionFrame:
    """Turn the camera about the vertical through the wrist's origin."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    pose, camera = frame
    position, towards = turn @ camera.cam2world[:3, 3], turn @ camera.cam2world[:3, 2]
    cam2world = look_at(position, position + towards, np.array([0, 0, 1.0]))
    return MotionFrame(pose, replace(camera, cam2world=cam2world))
