"""The sky as glossy skin mirrors it: bright where the mirrored view meets it, brighter the flatter one looks.

A pixel's gloss is the mean radiance of the sky around the mirrored view, times what a lobe reflects of even light at
the cosine of the view (the split sum of Karis 2013, with the exact integral), times the share of that light which the
hand lets through to the ray (`LightFeatures.sky_seen`).
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import Sky, sky_directions
from .gloss import LEAST_TO_EYE, alphas, glossy
from .octahedral import from_square, on_square

SIDE = 32
"""Texels along the square of directions; with a border of one they are `SIDE` + 2."""
COSINES = 65
"""Of the view, from 0 to 1, whose reflectance is tabulated."""
_MOST_ROWS, _MOST_COLUMNS = 32, 64  # of the sky, whose finer texels are averaged
_HALF_VECTORS = 64  # along each of their two coordinates
_LEAST_COSINE = 1e-3  # so that a sky of few texels has some around every direction


class MirroredSky(NamedTuple):
    """Gloss of a sky that nothing hides.

    Attributes:
        radiance: [(SIDE + 2)^2, 3, 3] mean radiance around each direction of the octahedral map: in the tight, the
            broad and the nails' lobe; RGB.
        reflectance: [COSINES, 3] of these lobes, at cosines of the view from 0 to 1.
    """

    radiance: Tensor
    reflectance: Tensor

    @classmethod
    def of(cls, sky: Sky | None, device: torch.device | str) -> MirroredSky:
        """Of a sky; None is black."""
        reflectance = torch.as_tensor(_reflectance(), device=device)
        if sky is None:
            return cls(torch.zeros((SIDE + 2) ** 2, 3, 3, device=device), reflectance)
        coarse = _coarse(sky)
        radiance = _around_directions(coarse.tobytes(), coarse.shape[:2])
        return cls(torch.as_tensor(radiance, device=device), reflectance)

    def gloss(
        self, normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"], nail: Float[Tensor, " P"] | None = None
    ) -> Float[Tensor, "P 2 3"]:
        """Light in both lobes; without gradients.

        Args:
            normal: unit.
            view: unit, from the camera.
            nail: 1 on nails, 0 on skin, which stands for None.
        """
        normal, view = normal.detach(), view.detach()
        along = (normal * view).sum(-1, keepdim=True)
        around = self._around(view - 2 * along * normal)
        lobes = around * self.reflected(-along[:, 0])[..., None]
        share = normal.new_zeros(len(normal)) if nail is None else nail
        tight = torch.lerp(lobes[:, 0], lobes[:, 2], share[:, None])
        return torch.stack([tight, lobes[:, 1]], 1)

    def of_even_light(
        self, normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"], nail: Float[Tensor, " P"] | None = None
    ) -> Float[Tensor, "P 2"]:
        """What both lobes would reflect of light of radiance 1 from everywhere; arguments as in `gloss`."""
        lobes = self.reflected(-(normal.detach() * view.detach()).sum(-1))
        share = normal.new_zeros(len(normal)) if nail is None else nail
        return torch.stack([torch.lerp(lobes[:, 0], lobes[:, 2], share), lobes[:, 1]], 1)

    def _around(self, towards: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3 3"]:
        """The means around directions, bilinear in the map."""
        column, row = ((value + 1) * (SIDE / 2) + 0.5 for value in on_square(towards))
        left, top = (value.floor().clamp(0, SIDE) for value in (column, row))
        right, below = ((value - start)[:, None, None] for value, start in ((column, left), (row, top)))
        at = (top * (SIDE + 2) + left).long()
        upper = torch.lerp(self.radiance[at], self.radiance[at + 1], right)
        lower = torch.lerp(self.radiance[at + SIDE + 2], self.radiance[at + SIDE + 3], right)
        return torch.lerp(upper, lower, below)

    def reflected(self, to_eye: Float[Tensor, " P"]) -> Float[Tensor, "P 3"]:
        """What the lobes reflect of even light, by the cosine of the view."""
        place = to_eye.clamp(0, 1) * (COSINES - 1)
        lower = place.floor().clamp(max=COSINES - 2)
        at = lower.long()
        return torch.lerp(self.reflectance[at], self.reflectance[at + 1], (place - lower)[:, None])


def _coarse(sky: Sky) -> Float[np.ndarray, "h w 3"]:
    """The sky's radiance, averaged over whole cells where it is finer than is told apart."""
    height, width = sky.radiance.shape[:2]
    rows, columns = min(height, _MOST_ROWS), min(width, _MOST_COLUMNS)
    if (rows, columns) == (height, width):
        return sky.radiance.astype(np.float32)
    angles = sky.solid_angles[..., None]
    energy = np.concatenate([sky.radiance * angles, angles], 2)
    for axis, count in enumerate((rows, columns)):
        starts = np.ceil(np.arange(count) * energy.shape[axis] / count).astype(int)
        energy = np.add.reduceat(energy, starts, axis)
    return (energy[..., :3] / energy[..., 3:]).astype(np.float32)


@lru_cache(maxsize=8)
def _around_directions(radiance: bytes, size: tuple[int, int]) -> Float[np.ndarray, "N 3 3"]:
    """`MirroredSky.radiance` of a sky [h, w, 3] fp32: the same for all frames of most animations."""
    sky = Sky(np.frombuffer(radiance, np.float32).reshape(*size, 3))
    texels = torch.as_tensor(sky_directions(*size).reshape(-1, 3), dtype=torch.float32)
    energy = torch.as_tensor((sky.radiance * sky.solid_angles[..., None]).reshape(-1, 3), dtype=torch.float32)
    angle = torch.as_tensor(sky.solid_angles.reshape(-1), dtype=torch.float32)
    cosine = _map_directions() @ texels.T
    falloff, to_half = cosine.clamp(min=_LEAST_COSINE), (1 + cosine) / 2
    means = []
    for alpha in _lobes():
        weight = falloff / (1 + to_half * (alpha**2 - 1)) ** 2
        means.append((weight @ energy) / (weight @ angle)[:, None])
    return torch.stack(means, 1).numpy()


def _map_directions() -> Float[Tensor, "N 3"]:
    """Of the map's texels, with its border."""
    middle = (torch.arange(-1, SIDE + 1) + 0.5) * (2 / SIDE) - 1
    v, u = torch.meshgrid(middle, middle, indexing="ij")
    return from_square(u, v).reshape(-1, 3)


@lru_cache(maxsize=1)
def _reflectance() -> Float[np.ndarray, "C 3"]:
    """What each lobe reflects of even light: the mean over half vectors drawn after its distribution."""
    to_eye = torch.linspace(0, 1, COSINES).clamp(min=LEAST_TO_EYE)
    view = -torch.stack([(1 - to_eye**2).sqrt(), torch.zeros(COSINES), to_eye], -1)[:, None]
    drawn, turn = torch.meshgrid(*[(torch.arange(_HALF_VECTORS) + 0.5) / _HALF_VECTORS] * 2, indexing="ij")
    up, columns = torch.tensor([0.0, 0, 1]), []
    for lobe, alpha in enumerate(_lobes()):
        to_half = ((1 - drawn) / (1 + (alpha**2 - 1) * drawn)).sqrt().flatten()
        across, angle = (1 - to_half**2).clamp(min=0).sqrt(), 2 * pi * turn.flatten()
        half = torch.stack([across * angle.cos(), across * angle.sin(), to_half], -1)
        along = (half * view).sum(-1, keepdim=True)
        towards = view - 2 * along * half
        lobes = glossy(up, towards, view, torch.zeros(()), torch.tensor(float(lobe == 2)))[..., lobe % 2]
        # pi times the density of half vectors, and what is lost of it at the turn to directions of light.
        density = alpha**2 * to_half / (1 + to_half**2 * (alpha**2 - 1)) ** 2
        found = lobes * 4 * along[..., 0].abs() / density * (along[..., 0] < 0)
        columns.append(found.mean(1))
    return torch.stack(columns, 1).numpy()


def _lobes() -> tuple[float, float, float]:
    """Alpha of the tight, the broad and the nails' lobe."""
    (tight, broad), (on_nails, _) = alphas(None), alphas(torch.tensor(1.0))
    return float(tight), float(broad), float(on_nails)
