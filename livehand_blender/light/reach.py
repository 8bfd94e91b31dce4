"""Where an object must stand to shadow a hand or reflect light on it: capsules towards each lamp, and a ball around.

The test is conservative: no triangle that casts a shadow within these lengths is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...backend.records.light import Lamp

# How far from the hand an object is looked for: towards a sun, and all around.
SUN_M, AROUND_M = 3.0, 0.5


@dataclass(frozen=True)
class Reach:
    """Capsules: every point within a radius of a segment.

    Attributes:
        start: [3] the middle of the hand, world, m; all segments begin here.
        ends: [C, 3] of the segments.
        radii: [C] m.
    """

    start: np.ndarray
    ends: np.ndarray
    radii: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, lamps: Sequence[Lamp], around_m: float) -> Reach:
        """Compute the reach of vertices [V, 3] in the light of lamps that cast shadows, and `around_m` all around."""
        middle = middle_of(vertices)
        radius = float(np.linalg.norm(vertices - middle, axis=1).max())
        ends, radii = [middle], [radius + around_m]
        for lamp in lamps:
            if lamp.casts_shadow:
                is_sun = lamp.kind == "sun"
                ends.append(middle - SUN_M * lamp.direction if is_sun else lamp.position)
                size = SUN_M * np.tan(min(lamp.angle_rad / 2, 1.5)) if is_sun else _lamp_radius(lamp)
                radii.append(radius + size if is_sun else max(radius, size))
        return cls(middle, np.array(ends), np.array(radii))

    def touches(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Mark [N] balls, given by centres [N, 3] and radii [N], m, that touch a capsule."""
        touched = np.zeros(len(centres), bool)
        offset = centres - self.start
        for end, radius in zip(self.ends, self.radii, strict=True):
            axis = end - self.start
            share = np.clip(offset @ axis / max(axis @ axis, 1e-12), 0, 1)
            touched |= np.linalg.norm(offset - share[:, None] * axis, axis=1) <= radii + radius
        return touched


def middle_of(vertices: np.ndarray) -> np.ndarray:
    """Compute the middle [3] of the box around vertices [V, 3]."""
    return (vertices.min(0) + vertices.max(0)) / 2


def _lamp_radius(lamp: Lamp) -> float:
    return lamp.radius_m if lamp.kind != "area" else float(np.hypot(*lamp.size_m) / 2)


def bounding_balls(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute centres [T, 3] and radii [T] of balls around triangles [T, 3, 3]."""
    centres = triangles.mean(1)
    return centres, np.linalg.norm(triangles - centres[:, None], axis=-1).max(1)
