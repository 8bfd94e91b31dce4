"""The albedo of a person over that of the avatar's networks, as a pyramid of maps over the atlas.

Networks learn the colours of the people whom they are trained on. Whose pictures gave no networks but a map has this:
a factor on what light is multiplied by (`shading_detail`), so that everything else stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate

from ..records.side import SIDES, Side
from .detail_maps_file import ATLAS_MM
from .map_pyramid import LEVELS, pyramid_levels, trilinear

RATIO_STEP = 0.015
"""What one step of the stored logarithms is worth."""
RATIO_ARRAY = "albedo/ratio"
MOST_LOG_RATIO = 127 * RATIO_STEP
MARKS_ARRAYS: Mapping[Side, str] = {side: f"marks/{side}" for side in SIDES}
"""Where the factor shows what one hand alone has, as a tattoo or a scar: 0 to 255."""


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
        for _ in range(LEVELS):
            levels.append(ratio_steps(level[0].permute(1, 2, 0).flatten(0, 1).log()))
            level = avg_pool2d(level, 2)
        return cls(torch.cat(levels).to(device), len(steps))

    @classmethod
    def of_side(
        cls, arrays: Mapping[str, np.ndarray], side: Side, device: torch.device | str = "cpu"
    ) -> AlbedoRatio | None:
        """Make the pyramid of one hand of a surface's arrays, without the other hand's marks; None: they have none."""
        steps = arrays.get(RATIO_ARRAY)
        if steps is None:
            return None
        others = [arrays[name] for other, name in MARKS_ARRAYS.items() if other != side and name in arrays]
        for marks in others:
            steps = without_marks(steps, marks)
        return cls.of(steps, device)

    @property
    def texel_m(self) -> float:
        """Side of a texel of the finest level, template metres."""
        return ATLAS_MM / 1000 / self.resolution

    @property
    def first_rows(self) -> list[int]:
        """Of each level in the table."""
        return [first for first, _ in pyramid_levels(self.resolution)]

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 3"]:
        """Sample the logarithm of the factor, trilinear."""
        return RATIO_STEP * trilinear(self.table, self.resolution, uv, level)


def ratio_steps(log_ratio: Float[Tensor, ...]) -> Tensor:
    """Store logarithms of factors as int8."""
    return (log_ratio / RATIO_STEP).round().clamp(-127, 127).to(torch.int8)


def without_marks(steps: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Fill marks with what is around them, from coarse to fine.

    Args:
        steps: [A, A, 3] int8 of the factor.
        marks: [K, K] uint8: where 255, nothing of the texel is kept.

    Returns:
        [A, A, 3] int8; `steps` itself beyond the marks.
    """
    at = (np.arange(len(steps)) * len(marks)) // len(steps)
    hidden = torch.as_tensor(marks[np.ix_(at, at)], dtype=torch.float32)[None, None] / 255
    values = torch.as_tensor(steps, dtype=torch.float32).permute(2, 0, 1)[None]
    filled = _filled_from_around(values, (hidden == 0).float())
    blended = torch.where(hidden > 0, values + hidden * (filled - values), values)
    return blended[0].permute(1, 2, 0).round().to(torch.int8).numpy()


def _filled_from_around(values: Tensor, kept: Tensor) -> Tensor:
    """Blend values [1, C, H, W] whose weights [1, 1, H, W] are below 1 with means over ever wider areas."""
    if len(values[0, 0]) % 2 or bool((kept == 1).all()):
        return values * kept + (1 - kept) * _mean(values, kept)
    weight = avg_pool2d(kept, 2)
    coarse = avg_pool2d(values * kept, 2) / weight.clamp(min=1e-6)
    coarse = _filled_from_around(coarse, (weight * 2).clamp(max=1))
    return values * kept + (1 - kept) * interpolate(coarse, scale_factor=2, mode="bilinear")


def _mean(values: Tensor, weights: Tensor) -> Tensor:
    total = weights.sum().clamp(min=1e-6)
    return ((values * weights).sum((2, 3)) / total)[..., None, None]


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
