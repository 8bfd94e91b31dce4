"""Colours of skin by place on the hand, in CIE Lab (D65), and the ranges that are usual for light and for deep skin.

Ranges were measured on published photographs and on textures made of photographs, eleven skins in all; only the figures
are here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

_RGB_TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
_LINEAR_BELOW = 6 / 29


def lab(rgb_linear: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Convert to L*, a* and b*."""
    matrix = rgb_linear.new_tensor(_RGB_TO_XYZ)
    x, y, z = _curve(rgb_linear @ (matrix / matrix.sum(1, keepdim=True)).T).unbind(-1)
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)


def lightness(rgb_linear: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Convert to L* alone."""
    return 116 * _curve(rgb_linear @ rgb_linear.new_tensor(_RGB_TO_XYZ[1])) - 16


def _curve(share: Float[Tensor, "*any"]) -> Float[Tensor, "*any"]:
    """Take the cube root of a share of white's X, Y or Z; of dark ones, its tangent."""
    root = share.clamp(min=_LINEAR_BELOW**3) ** (1 / 3)
    return torch.where(share > _LINEAR_BELOW**3, root, share / (3 * _LINEAR_BELOW**2) + 4 / 29)


BACK = "back"
"""The place that others are compared with."""
_LIGHTEST_DEEP_L = 45.0  # L* of the back, between the two tables


@dataclass(frozen=True)
class LabRange:
    """Smallest and largest L*, a* and b* of a place; None: not known. Other places than the back: less the back's."""

    l_star: tuple[int, int] | None = None
    a_star: tuple[int, int] | None = None
    b_star: tuple[int, int] | None = None

    def misses(self, lab: np.ndarray) -> dict[str, tuple[float, tuple[int, int]]]:
        """Map each coordinate outside its range to (its value, the range)."""
        rows = zip(("L*", "a*", "b*"), lab.tolist(), (self.l_star, self.a_star, self.b_star), strict=True)
        return {name: (value, at) for name, value, at in rows if at and not at[0] <= value <= at[1]}


LIGHT_SKIN = {
    BACK: LabRange((59, 75), (11, 18), (18, 24)),
    "palm": LabRange((8, 12), (-6, -2), (-11, -6)),
    "knuckles": LabRange((-4, 0), (0, 3), (-4, -1)),
    "middle joints": LabRange(None, (-3, 2)),
    "nails": LabRange((7, 12), (-9, -4), (-14, -8)),
    "forearm": LabRange((-14, -5)),
}
DEEP_SKIN = {
    BACK: LabRange((27, 29), (14, 19), (18, 23)),
    "palm": LabRange((23, 31), None, (3, 7)),
    "knuckles": LabRange((-2, 0)),
    "middle joints": LabRange((-5, -3)),
    "nails": LabRange((25, 28)),
    "forearm": LabRange((-3, 3)),
}


def colour_findings(points: Mapping[str, np.ndarray]) -> list[str]:
    """Find what is unusual in the colours of places (Lab [3]); the back's lightness chooses the table.

    Of a hand whose back is not known, nothing is.
    """
    if BACK not in points:
        return []
    back = points[BACK]
    ranges = DEEP_SKIN if back[0] < _LIGHTEST_DEEP_L else LIGHT_SKIN
    found = []
    for place, usual in ranges.items():
        if place not in points:
            continue
        relative = points[place] - (0 if place == BACK else back)
        than = "" if place == BACK else " from the back's"
        found += [
            f"{place}: {name} {value:.1f}{than}, usual {low:g} to {high:g}"
            for name, (value, (low, high)) in usual.misses(relative).items()
        ]
    return found
