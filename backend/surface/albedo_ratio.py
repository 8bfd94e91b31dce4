"""The albedo of a person over that of the avatar's networks, as a pyramid of maps over the atlas.

Networks learn the colours of the people whom they are trained on. Whose pictures gave no networks but a map has this:
a factor on what light is multiplied by (`shading_detail`), so that everything else stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .detail_maps_file import ATLAS_MM

RATIO_STEP = 0.015
"""What one step of the stored logarithms is worth."""
RATIO_ARRAY = "albedo/ratio"
MOST_LOG_RATIO = 127 * RATIO_STEP
_LEVELS = 6


class AlbedoRatio(NamedTuple):
    """A person's factor on albedo.

    Attributes:
        table: [T, 3] int8: logarithms in steps, RGB; the texels of all levels, rows of the finest first, the smallest v
            first. Each level is half as wide as the one before, its factors the means of those.
        resolution: of the finest level.
    """

    table: Tensor
    resolution: int

    @classmethod
    def of(cls, steps: np.ndarray, device: torch.device | str = "cpu") -> AlbedoRatio:
        """Make the pyramid of a map [A, A, 3] int8 (`stored_surface.ARRAYS`)."""
        level = torch.exp(torch.as_tensor(steps, dtype=torch.float32) * RATIO_STEP).permute(2, 0, 1)[None]
        levels = []
        for _ in range(_LEVELS):
            levels.append(ratio_steps(level[0].permute(1, 2, 0).flatten(0, 1).log()))
            level = avg_pool2d(level, 2)
        return cls(torch.cat(levels).to(device), len(steps))

    @property
    def texel_m(self) -> float:
        """Side of a texel of the finest level, template metres."""
        return ATLAS_MM / 1000 / self.resolution

    @property
    def first_rows(self) -> list[int]:
        """Of each level in the table."""
        return [sum((self.resolution >> finer) ** 2 for finer in range(level)) for level in range(_LEVELS)]

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 3"]:
        """Sample the logarithm of the factor, trilinear."""
        level = level.clamp(0, _LEVELS - 1)
        fine = level.floor().long()
        share, coarse = (level - fine)[:, None], (fine + 1).clamp(max=_LEVELS - 1)
        return RATIO_STEP * (self._bilinear(uv, fine) * (1 - share) + self._bilinear(uv, coarse) * share)

    def _bilinear(self, uv: Tensor, level: Int[Tensor, " P"]) -> Float[Tensor, "P 3"]:
        start, size = torch.tensor(self.first_rows, device=uv.device)[level], self.resolution >> level
        place = (uv * size[:, None] - 0.5).clamp(min=0).minimum(size[:, None] - 1.0)
        first = place.floor().minimum(size[:, None] - 2.0)
        (fu, fv), (u, v) = (place - first).unbind(1), first.long().unbind(1)
        corner = start + v * size + u
        rows = (corner, corner + 1, corner + size, corner + size + 1)
        weights = ((1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv)
        return sum(
            (self.table[row].float() * weight[:, None] for row, weight in zip(rows, weights, strict=True)),
            start=uv.new_zeros(len(uv), 3),
        )


def ratio_steps(log_ratio: Float[Tensor, ...]) -> Tensor:
    """Store logarithms of factors as int8."""
    return (log_ratio / RATIO_STEP).round().clamp(-127, 127).to(torch.int8)


def vertex_ratio(arrays: Mapping[str, np.ndarray], corner_uv: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Sample the factor at a mesh's vertices, over a texel of the fourth level; None: the surface has none.

    Args:
        arrays: of the surface.
        corner_uv: [F, 3, 2] of the mesh's faces.
        faces: [F, 3].

    Returns:
        [V, 3], the mean over each vertex's corners: charts may show two sides of a border.
    """
    if RATIO_ARRAY not in arrays:
        return None
    ratio = AlbedoRatio.of(arrays[RATIO_ARRAY])
    uv = torch.as_tensor(corner_uv.reshape(-1, 2), dtype=torch.float32)
    factor = torch.exp(ratio.sample(uv, torch.full((len(uv),), 3.0))).numpy()
    count = int(faces.max()) + 1
    sums, vertex = np.zeros((count, 3), np.float32), faces.reshape(-1)
    np.add.at(sums, vertex, factor)
    return sums / np.bincount(vertex, minlength=count).clip(1)[:, None]
