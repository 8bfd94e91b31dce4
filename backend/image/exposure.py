"""Motion blur and depth of field by accumulation: when, and through which points of the lens, a frame is sampled.

A blurred frame is the mean, in linear light, of sharp ones at times spread over the shutter, each seen through another
point of a thin lens. Both sets of samples are even and fixed, so a frame is the same whenever it is rendered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..records.camera import Camera

# Turning by this angle, with the square root of the share as radius, spreads points evenly over a disc (Vogel 1979).
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class Shutter:
    """When the shutter opens, in frames from the frame itself, and for how many frames it stays open."""

    start_frames: float
    length_frames: float


@dataclass(frozen=True)
class Lens:
    """A thin lens: its radius, m, and the depth of its plane of focus, m."""

    radius_m: float
    focus_m: float


@dataclass(frozen=True)
class ExposureSample:
    """One of the sharp images whose mean is the frame.

    Attributes:
        offset_frames: its time, from the frame itself.
        lens: [2] its point on the lens, in radii of the lens, camera axes.
    """

    offset_frames: float
    lens: tuple[float, float]


SHARP = ExposureSample(0.0, (0.0, 0.0))


def exposure_samples(count: int, shutter: Shutter | None, lens: Lens | None) -> tuple[ExposureSample, ...]:
    """Make the samples of a frame, the one nearest to the frame itself first.

    Args:
        count: how many, if the frame is blurred at all.
        shutter: None without motion blur.
        lens: None without depth of field.
    """
    if shutter is None and lens is None:
        return (SHARP,)
    share = (np.arange(count) + 0.5) / count
    offsets = shutter.start_frames + shutter.length_frames * share if shutter else 0 * share
    angle = _GOLDEN_ANGLE * np.arange(count)
    # Any stretch of the exposure must see the whole lens, or a moving hand would be sharper on one side.
    radius = np.sqrt(share[_scattered(count)]) if lens else 0 * share
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    order = np.argsort(np.abs(offsets), kind="stable")
    return tuple(ExposureSample(float(offsets[k]), (float(points[k, 0]), float(points[k, 1]))) for k in order)


def _scattered(count: int) -> np.ndarray:
    """Order the numbers 0..count - 1 so that any few in a row are spread evenly: by their bits reversed."""
    bits = max(1, (count - 1).bit_length())
    reversed_bits = [int(f"{number:0{bits}b}"[::-1], 2) for number in range(count)]
    return np.argsort(np.argsort(reversed_bits))


def camera_of_sample(camera: Camera, lens: Lens | None, sample: ExposureSample) -> Camera:
    """Return the camera that looks through the sample's point of the lens."""
    return camera if lens is None else camera.through_lens(lens.radius_m * np.array(sample.lens), lens.focus_m)
