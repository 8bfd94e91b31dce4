"""What stands around a hand, as flat patches that shed light on it.

What of the surfaces the hand sees is taken in small points, at which light is looked up, and these in as few patches as
light can be shed by.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import Light
from .bounce import Probes
from .screens import Screens
from .surface_pieces import Pieces

MOST_PATCHES = 128
"""If the coarsest cells are more, those that fill most of the hand's view are kept."""
_MOST_POINTS = 4096
# Sides of pieces and cells against their distance from the hand: as fine as gives few.
_FINENESS = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
_MOST_NEAR = 64  # vertices of the hand whose nearest stands for it
_NEAREST_M = 0.001  # that count
_TINY = 1e-12


class PatchPoints(NamedTuple):
    """S points of P patches, at which light is looked up: a shadow may end within a patch.

    Attributes:
        position: [S, 3] m, world; a little before the surface.
        normal: [S, 3] unit, on the side of the hand.
        area_m2: [S].
        patch: [S] of which each is.
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor
    patch: Tensor

    @property
    def probes(self) -> Probes:
        """The points as discs."""
        every = torch.arange(len(self.position), device=self.position.device)
        return Probes(self.position, self.normal, every, self.area_m2)


class Patches(NamedTuple):
    """P patches, each with the side that the hand sees.

    Attributes:
        position: [P, 3] m, world; a little before the surface.
        normal: [P, 3] unit, on the side of the hand.
        area_m2: [P].
        albedo: [P, 3].
        points: on them.
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor
    albedo: Tensor
    points: PatchPoints

    @classmethod
    def around(cls, light: Light, vertices: Float[Tensor, "V 3"]) -> Patches:
        """The patches of a light's occluders around a hand with these vertices; none if their albedo is not known."""
        step = -(-len(vertices) // _MOST_NEAR)
        near = vertices[::step].cpu().double().numpy()
        if len(light.occluder_albedo) == 0:
            return cls._of(Pieces.none(), Pieces.none(), np.zeros(0, int), vertices.device)
        points = _seen_points(light, near)
        patches, patch = _gathered(points, near, MOST_PATCHES)
        is_kept = patch >= 0
        return cls._of(patches, points.chosen(is_kept), patch[is_kept], vertices.device)

    @classmethod
    def _of(cls, patches: Pieces, points: Pieces, patch: np.ndarray, device: torch.device) -> Patches:
        def tensors(*arrays: np.ndarray) -> tuple[Tensor, ...]:
            return tuple(torch.as_tensor(array, dtype=torch.float32, device=device) for array in arrays)

        on_them = PatchPoints(*tensors(*_flat(points)), patch=torch.as_tensor(patch, device=device))
        return cls(*tensors(*_flat(patches), patches.albedo), points=on_them)

    def mean(self, of_points: Float[Tensor, "K S"]) -> Float[Tensor, "K P"]:
        """Of the points' values on each patch."""
        patch, area_m2 = self.points.patch, self.points.area_m2
        total = area_m2.new_zeros(len(self.position)).index_add(0, patch, area_m2)
        return of_points.new_zeros(len(of_points), len(total)).index_add(1, patch, of_points * (area_m2 / total[patch]))

    def factors(
        self, position: Float[Tensor, "R 3"]
    ) -> tuple[Float[Tensor, "R P 3"], Float[Tensor, "R P"], Float[Tensor, "R P"]]:
        """Unit directions from points to the patches, what a surface that faces one receives of it, and distances, m.

        That is the form factor of a small surface and a disc without the surface's cosine, as in `light.bounce`.
        """
        offset = self.position - position[:, None]
        distance = offset.norm(dim=-1).clamp(min=_NEAREST_M)
        towards = offset / distance[..., None]
        there = -(towards * self.normal).sum(-1).clamp(max=0)
        return towards, there * self.area_m2 / (pi * distance**2 + self.area_m2), distance

    def exchanged(self) -> Float[Tensor, "P P"]:
        """What each patch receives of the light that the others shed."""
        towards, factors, _ = self.factors(self.position)
        factors = factors * (towards * self.normal[:, None]).sum(-1).clamp(min=0)
        return factors / factors.sum(1, keepdim=True).clamp(min=1)


def _seen_points(light: Light, near: np.ndarray) -> Pieces:
    """What a hand with these vertices sees of a light's occluders."""
    triangles = np.asarray(light.occluders, float)
    cut = Pieces.of(triangles, np.asarray(light.occluder_albedo, float), near, _FINENESS[0])
    points, _ = _gathered(cut, near, _MOST_POINTS)
    return Screens.of(triangles, near).seen(points)


def _gathered(pieces: Pieces, near: np.ndarray, most: int) -> tuple[Pieces, np.ndarray]:
    """The pieces in cells so coarse that these are few, and which each has become; -1: of the smallest, left out."""
    found, number = pieces, np.arange(len(pieces.area))
    for fineness in _FINENESS:
        found, number = pieces.gathered(pieces.cells(fineness), near)
        if len(found.area) <= most:
            break
    kept, numbers = found.largest(most), np.full(len(found.area), -1)
    numbers[kept] = np.arange(len(kept))
    return found.chosen(kept), numbers[number]


def _flat(pieces: Pieces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, normals and areas."""
    area_m2 = np.linalg.norm(pieces.area, axis=-1)
    return pieces.position, pieces.area / np.maximum(area_m2, _TINY)[:, None], area_m2
