"""The lamp of a scene: lobes of a sky are soft and far, a window or a lamp is neither.

Near the brightest lobe a lamp is tried in some directions, then in finer ones, then at some distances; at each the sky
and the lamp are fitted together. It stays if it explains the pictures better than the sky alone does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...records.light import Lamp, Light, rotation_facing
from ...system.parallel_map import parallel_map
from .illumination import LitPixels, fitted_light, lobe_directions
from .model import PersonModel
from .numbers import PixelTones

_DISTANCE_M, _DISTANCES_M = 1.2, (0.45, 0.7, 2.5)
_RINGS_RAD = ((0.0, 0.22, 0.45), (0.1,))
_AROUND = 6  # directions in a ring
_SIDE = 0.28  # of a square lamp, over its distance
_BETTER = 0.98  # error with a lamp over that without


def with_lamp(model: PersonModel, tones: PixelTones, melanin: float) -> PixelTones:
    """Return the pixels in the light of one lamp more, if there seems to be one.

    Args:
        model: that rendered the pixels' other lights.
        tones: of one scene.
        melanin: of the skin.
    """
    ratio, pixels = tones.ratio(melanin), tones.pixels
    alone = fitted_light(pixels, ratio)
    directions = lobe_directions()
    brightest = alone.strengths[: len(directions)] @ directions
    if not np.linalg.norm(brightest) > 0:
        return tones
    middle = np.mean([part.picture.pose.transl for part in pixels.parts], 0)
    best, direction, error = pixels, brightest / np.linalg.norm(brightest), alone.error * _BETTER
    distance_m = _DISTANCE_M
    for rings_rad in _RINGS_RAD:
        tried = [turned for ring in rings_rad for turned in _ring(direction, ring)]
        lamps = [_lamp(middle, towards, distance_m) for towards in tried]
        found, at, least = _best(model, pixels, lamps, ratio)
        if least < error:
            best, direction, error = found, tried[at], least
    if best is pixels:
        return tones
    lamps = [_lamp(middle, direction, distance_m) for distance_m in _DISTANCES_M]
    found, _, least = _best(model, pixels, lamps, ratio)
    return tones._replace(pixels=found if least < error else best)


def _best(
    model: PersonModel, pixels: LitPixels, lamps: Sequence[Light], ratio: np.ndarray
) -> tuple[LitPixels, int, float]:
    """Return the pixels with the best of some lamps, which it is, and its error."""
    count, tried = len(pixels.sources), pixels.with_sources(model, lamps)
    each = [tried.of_sources([*range(count), count + index]) for index in range(len(lamps))]
    errors = parallel_map(lambda one: fitted_light(one, ratio).error, each)
    at = int(np.argmin(errors))
    return each[at], at, errors[at]


def _ring(axis: np.ndarray, angle_rad: float) -> list[np.ndarray]:
    """Return unit directions [3] at an angle around an axis; the axis alone at none."""
    if not angle_rad:
        return [axis]
    across = rotation_facing(axis)[:, 0]
    tilted = axis_angle_to_matrix(across * angle_rad) @ axis
    turns = 2 * np.pi * np.arange(_AROUND) / _AROUND
    return [axis_angle_to_matrix(axis * turn) @ tilted for turn in turns]


def _lamp(middle: np.ndarray, towards: np.ndarray, distance_m: float) -> Light:
    """Return a white square lamp that gives about as much light at any distance."""
    side_m, power_w = _SIDE * distance_m, np.pi * distance_m**2
    rotation = rotation_facing(towards)
    return Light((Lamp("area", np.full(3, power_w), middle + distance_m * towards, rotation, size_m=(side_m, side_m)),))
