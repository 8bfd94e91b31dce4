"""Three made people whom no number of the skins that ship describes: a factor on albedo, drawn on the hand at rest.

A fourth, `insider`, is described by numbers alone.

Points are anatomical, mm: x distal, y dorsal, z radial; the wrist's joint is near the origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from ...backend.capture.person import Person
from ...backend.teacher.smooth import smoothstep

LOG_LIMITS = (float(np.log(0.16)), float(np.log(1.6)))
"""Of the factor's logarithm."""
_WAVES = 64
# Blotches: standard deviation of their width, mm; of the logarithm, by pigment, by blood and by channel.
_BLOTCHES = ((17.0, 0.12, 0.12, 0.025), (5.0, 0.08, 0.08, 0.015), (1.7, 0.05, 0.05, 0.01))
_PIGMENT_RGB, _BLOOD_RGB = np.array([0.75, 1.0, 1.2]), np.array([0.1, 1.0, 0.9])
_SPOT_MM, _SPOT_DEPTH = (0.7, 2.0), (0.3, 1.1)
_REACH = 4.0  # deviations of a spot that are drawn
_SOFT_MM = 0.35  # of a stroke's edge
_SIDE_COSINE = 0.15  # of normals that belong to the side of a drawing


@dataclass(frozen=True)
class Stroke:
    """A line that is drawn on a side of the hand.

    Attributes:
        points_mm: [P, 2] along x and z.
        width_mm: of the line.
        log_rgb: [3] what it adds to the factor's logarithm.
        is_dorsal: on the back, or in the palm.
    """

    points_mm: np.ndarray
    width_mm: float
    log_rgb: tuple[float, float, float]
    is_dorsal: bool = True


@dataclass(frozen=True)
class Stranger:
    """A person of numbers, and what numbers do not say.

    Attributes:
        person: numbers.
        seed: of blotches and spots.
        spots: how many.
        strokes: tattoos and scars.
        has_blotches: whether the skin is of uneven colour beyond what numbers say.
    """

    person: Person
    seed: int
    spots: int
    strokes: tuple[Stroke, ...] = ()
    has_blotches: bool = True


def _circle(x: float, z: float, radius_mm: float) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, 49)
    return np.stack([x + radius_mm * np.cos(turn), z + radius_mm * np.sin(turn)], 1)


def _line(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, float)


_INK, _PALE, _DARK = (-1.6, -1.2, -0.7), (0.35, 0.4, 0.45), (-0.25, -0.5, -0.55)
TATTOO = tuple(
    Stroke(points, 1.8, _INK)
    for points in (
        _circle(66, 10, 11),
        _line((55, 10), (77, 10)),
        _line((56, -4), (42, -4), (42, -11)),  # L
        _line((56, -16), (42, -16)),  # H
        _line((56, -23), (42, -23)),
        _line((49, -16), (49, -23)),
        _line((20, -12), (26, -4), (20, 4), (26, 12), (20, 20)),
    )
)
_SCARS = (
    Stroke(_line((30, 22), (48, 30)), 2.2, _PALE),
    Stroke(_line((36, -20), (60, 2)), 2.0, _PALE, is_dorsal=False),
)
STRANGERS: Mapping[str, Stranger] = {
    "stranger1": Stranger(
        Person(0.5, 1.1, 0.35, 1.2, 0.6, beta=(0.9, -0.4, 0.5, 0.6, -0.3, 0.4, -0.5, 0.3, 0.2, -0.4)),
        seed=7,
        spots=220,
        strokes=(*TATTOO, *_SCARS),
    ),
    "stranger2": Stranger(
        Person(0.15, 0.9, 0.1, 0.7, 1.8, beta=(-0.6, 0.8, -0.4, 0.5, 0.7, -0.3, 0.4, -0.6, 0.3, 0.2)),
        seed=11,
        spots=500,
        strokes=(Stroke(_circle(40, 10, 2.5), 5.0, _DARK), *_SCARS),
    ),
    "stranger3": Stranger(
        Person(0.9, 1.0, 0.3, 0.85, 1.0, beta=(0.5, 0.6, -0.6, -0.5, 0.4, 0.6, 0.3, -0.4, -0.3, 0.5)),
        seed=13,
        spots=120,
        strokes=(Stroke(_line((18, -20), (24, 10), (58, 18)), 3.5, _PALE), *_SCARS),
    ),
    "insider": Stranger(
        Person(0.65, 1.05, 0.2, 0.9, 0.6, beta=(-0.3, -0.5, 0.7, -0.4, 0.6, -0.2, 0.3, 0.2, -0.5, 0.4)),
        seed=17,
        spots=0,
        has_blotches=False,
    ),
}


def log_factor(stranger: Stranger, points_mm: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Compute the factor's logarithm [N, 3] at points [N, 3] of the skin with unit normals [N, 3]."""
    rng = np.random.default_rng(stranger.seed)
    total = blotches(rng, points_mm) if stranger.has_blotches else np.zeros((len(points_mm), 3))
    total += spots(rng, points_mm, stranger.spots)
    for stroke in stranger.strokes:
        total += ink(stroke, points_mm, normals)[:, None] * np.array(stroke.log_rgb)
    return np.clip(total, *LOG_LIMITS)


def blotches(rng: np.random.Generator, points_mm: np.ndarray) -> np.ndarray:
    """Draw smooth noise [N, 3] of three sizes, most of it in the colours of pigment and blood."""
    total = np.zeros((len(points_mm), 3))
    for size_mm, pigment, blood, by_channel in _BLOTCHES:
        total += pigment * smooth_noise(rng, points_mm, size_mm)[:, None] * _PIGMENT_RGB
        total += blood * smooth_noise(rng, points_mm, size_mm)[:, None] * _BLOOD_RGB
        total += by_channel * np.stack([smooth_noise(rng, points_mm, size_mm) for _ in range(3)], 1)
    return total


def smooth_noise(rng: np.random.Generator, points_mm: np.ndarray, size_mm: float) -> np.ndarray:
    """Draw noise [N] of deviation 1 whose correlation over a distance d is exp(-(d / size)^2 / 2), by random waves."""
    waves = rng.normal(0, 1 / size_mm, (_WAVES, 3))
    phases = rng.uniform(0, 2 * np.pi, _WAVES)
    total = np.zeros(len(points_mm))
    for wave, phase in zip(waves, phases, strict=True):
        total += np.cos(points_mm @ wave + phase)
    return total * np.sqrt(2 / _WAVES)


def spots(rng: np.random.Generator, points_mm: np.ndarray, count: int) -> np.ndarray:
    """Draw dark round spots [N, 3] around some of the points."""
    total = np.zeros(len(points_mm))
    tree = KDTree(points_mm)
    for centre in points_mm[rng.integers(len(points_mm), size=count)]:
        sigma_mm, depth = rng.uniform(*_SPOT_MM), rng.uniform(*_SPOT_DEPTH)
        near = tree.query_ball_point(centre, _REACH * sigma_mm)
        squared = ((points_mm[near] - centre) ** 2).sum(1)
        total[near] -= depth * np.exp(-squared / (2 * sigma_mm**2))
    return total[:, None] * _PIGMENT_RGB


def ink(stroke: Stroke, points_mm: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Compute the share [N] of a stroke's colour: 1 within its line, 0 beyond a soft edge and on the other side."""
    flat, at = points_mm[:, [0, 2]], stroke.points_mm
    distance_mm = np.min([_to_segment(flat, a, b) for a, b in pairwise(at)], 0)
    half_mm = stroke.width_mm / 2
    height = normals[:, 1] * (1 if stroke.is_dorsal else -1)
    within = smoothstep(distance_mm, half_mm + _SOFT_MM, half_mm - _SOFT_MM)
    return within * smoothstep(height, 0, _SIDE_COSINE)


def _to_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    share = np.clip((points - a) @ along / max(along @ along, 1e-12), 0, 1)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)
