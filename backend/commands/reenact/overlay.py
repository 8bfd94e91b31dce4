"""A rendered hand over a picture: its colours matched to the real hand's, and its cut at the wrist faded out."""

from __future__ import annotations

import numpy as np
import torch

from ...image.srgb import linear_to_srgb, srgb_to_linear
from ...records.camera import Camera
from ...records.frame import DEPTH_BACKGROUND, Frame

_FADE_M = 0.015
_GAINS = (0.1, 4.0)
_LEAST_PIXELS = 12
_SOLID = 0.95  # alpha
_SMOOTH_S, _FAR = 2.0, 40.0
_MOST_CHANGE = 0.2  # of a gain's logarithm within a take


def over(frame: Frame, ground: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Lay a frame over uint8 [H, W, 3], the frame's light multiplied by gain [3]."""
    rows, columns = _box(frame.alpha > 0)
    alpha = frame.alpha[rows, columns, None]
    hand = frame.rgb[rows, columns] * gain.astype(np.float32)
    below = _linear(ground[rows, columns])
    picture = ground.copy()
    picture[rows, columns] = _encoded(hand + below * (1 - alpha))
    return picture


def faded(frame: Frame, fade: np.ndarray) -> Frame:
    """Multiply the frame's light and alpha by fade [H, W]."""
    return Frame(frame.rgb * fade[..., None], frame.alpha * fade, frame.depth, is_lit=frame.is_lit)


def wrist_fade(frame: Frame, camera: Camera, along: np.ndarray, reach_m: float) -> np.ndarray:
    """Fade [H, W] from 0 at the cut of the wrist to 1 at 15 mm before it.

    Args:
        frame: with depth.
        camera: of the frame.
        along: [3] direction of the forearm in the world.
        reach_m: how far along it the hand reaches.
    """
    fade = np.ones_like(frame.alpha)
    rows, columns = np.nonzero((frame.alpha > 0) & (frame.depth < DEPTH_BACKGROUND))
    rays = camera.ray_directions(np.stack([columns + 0.5, rows + 0.5], -1))
    points = camera.origin + rays * frame.depth[rows, columns, None]
    fade[rows, columns] = np.clip((reach_m - points @ along) / _FADE_M, 0, 1)
    return fade


def colour_gain(frame: Frame, picture: np.ndarray, shown: np.ndarray | None = None) -> np.ndarray | None:
    """Find [3] by which the frame's light must be multiplied to have the picture's colour; None if too little shows.

    Args:
        frame: of the avatar.
        picture: uint8 [H, W, 3].
        shown: [H, W] bool, where the picture shows the real hand; None: wherever the frame shows the avatar.
    """
    solid = frame.alpha > _SOLID
    if shown is not None:
        solid &= shown
    if solid.sum() < _LEAST_PIXELS:
        return None
    real, made = np.median(_linear(picture[solid]), 0), np.median(frame.rgb[solid], 0)
    return np.clip(real / np.maximum(made, 1e-4), *_GAINS)


def smooth_gains(times: np.ndarray, gains: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Smooth gains [N, 3] to wanted times: [T, 3], means of their logarithms weighted by nearness.

    What differs much from the take's median comes from a hand that covers the filmed one badly, and counts little.
    """
    logs = np.log(gains)
    usual = np.median(logs, 0)
    logs = usual + np.clip(logs - usual, -_MOST_CHANGE, _MOST_CHANGE)
    distance = (np.asarray(wanted)[:, None] - np.asarray(times)[None]) / _SMOOTH_S
    weights = np.exp(-0.5 * np.minimum(distance**2, _FAR))
    return np.exp(weights @ logs / weights.sum(1, keepdims=True))


def _box(mask: np.ndarray) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _linear(picture: np.ndarray) -> np.ndarray:
    return srgb_to_linear(torch.from_numpy(picture.astype(np.float32) / 255)).numpy()


def _encoded(linear: np.ndarray) -> np.ndarray:
    encoded = linear_to_srgb(torch.from_numpy(np.clip(linear, 0, 1).astype(np.float32)))
    return (encoded.numpy() * 255).round().astype(np.uint8)
