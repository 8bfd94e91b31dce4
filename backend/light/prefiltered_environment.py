"""The sky prefiltered for glossy lobes: radiance by the direction of reflection, on an octahedral map.

Each specular lobe of a pixel is a pair of round ones (`isotropic_lobes`): the mean radiance of the sky around their
directions, times what they reflect of even light, times the share of that light which the hand lets through to the ray
(`LightFeatures.lobe_visibility`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import Sky, sky_directions
from .brdf import AHEAD, SHARE, UP, WIDTH, WIDTHS, isotropic_lobes, isotropic_weight, lobes_at


def on_square(towards: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n"]]:
    """Map directions of any length but 0 to (u, v) in [-1, 1]."""
    x, y, z = (towards / towards.abs().sum(-1, keepdim=True)).unbind(-1)
    below = z < 0
    return torch.where(below, (1 - y.abs()).copysign(x), x), torch.where(below, (1 - x.abs()).copysign(y), y)


def from_square(u: Float[Tensor, "*n"], v: Float[Tensor, "*n"]) -> Float[Tensor, "*n 3"]:
    """Map (u, v) to unit directions; up to 1 beyond an edge, the sphere goes on there on the same square."""
    u, v = torch.where(u.abs() > 1, (2 - u.abs()).copysign(u), u), torch.where(u.abs() > 1, -v, v)
    u, v = torch.where(v.abs() > 1, -u, u), torch.where(v.abs() > 1, (2 - v.abs()).copysign(v), v)
    z = 1 - u.abs() - v.abs()
    below = z < 0
    x, y = torch.where(below, (1 - v.abs()).copysign(u), u), torch.where(below, (1 - u.abs()).copysign(v), v)
    return torch.nn.functional.normalize(torch.stack([x, y, z], -1), dim=-1)


SIDE = 32
"""Texels along the square of directions; with a border of one they are `SIDE` + 2."""
_MOST_ROWS, _MOST_COLUMNS = 32, 64  # of the sky, whose finer texels are averaged
_DIRECTIONS_AT_ONCE = 128  # whose weights stay in the cache


class PrefilteredEnvironment(NamedTuple):
    """Gloss of a sky that nothing hides.

    Attributes:
        radiance: [(SIDE + 2)^2, W, 3] mean radiance around each direction of the octahedral map, in isotropic lobes of
            each of the W `WIDTHS`; RGB.
        lobes: [A, C, 2, 4] `isotropic_lobes`.
    """

    radiance: Tensor
    lobes: Tensor

    @classmethod
    def of(cls, sky: Sky | None, device: torch.device | str) -> PrefilteredEnvironment:
        """Prefilter a sky; None is black."""
        lobes = torch.as_tensor(isotropic_lobes(), device=device)
        if sky is None:
            return cls(torch.zeros((SIDE + 2) ** 2, len(WIDTHS), 3, device=device), lobes)
        coarse = _coarse(sky)
        radiance = _around_directions(coarse.tobytes(), coarse.shape[:2])
        return cls(torch.as_tensor(radiance, device=device), lobes)

    def specular(
        self, normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"], alpha_squared: Float[Tensor, "P G"]
    ) -> Float[Tensor, "P G 3"]:
        """Look up the light in G lobes; without gradients.

        Args:
            normal: unit.
            view: unit, from the camera.
            alpha_squared: of the lobes.
        """
        normal, view = normal.detach(), view.detach()
        along = (normal * view).sum(-1, keepdim=True)
        ahead = torch.nn.functional.normalize(view - along * normal, dim=-1)
        specular = []
        for squared in alpha_squared.detach().unbind(1):
            pair = lobes_at(-along[:, 0], squared, self.lobes)
            towards = pair[..., AHEAD, None] * ahead[:, None] + pair[..., UP, None] * normal[:, None]
            around = self._around(towards.flatten(0, 1), pair[..., WIDTH].flatten()).unflatten(0, (-1, 2))
            specular.append((pair[..., SHARE, None] * around).sum(1))
        return torch.stack(specular, 1)

    def of_even_light(
        self, normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"], alpha_squared: Float[Tensor, "P G"]
    ) -> Float[Tensor, "P G"]:
        """Compute what the lobes would reflect of light of radiance 1 from everywhere; arguments as in `specular`."""
        to_eye = -(normal.detach() * view.detach()).sum(-1)
        pairs = (lobes_at(to_eye, squared, self.lobes) for squared in alpha_squared.detach().unbind(1))
        return torch.stack([pair[..., SHARE].sum(1) for pair in pairs], 1)

    def _around(self, towards: Float[Tensor, "P 3"], width: Float[Tensor, " P"]) -> Float[Tensor, "P 3"]:
        """Look up the means around directions in lobes of a width, bilinear in the map."""
        column, row = ((value + 1) * (SIDE / 2) + 0.5 for value in on_square(towards))
        left, top, narrow = (value.floor() for value in (column, row, width))
        left, top, narrow = left.clamp(0, SIDE), top.clamp(0, SIDE), narrow.clamp(0, len(WIDTHS) - 2)
        right, below, wide = (
            (value - start)[:, None] for value, start in ((column, left), (row, top), (width, narrow))
        )
        at, level = (top * (SIDE + 2) + left).long(), narrow.long()

        def texels(at: Tensor) -> Tensor:
            return torch.lerp(self.radiance[at, level], self.radiance[at, level + 1], wide)

        upper = torch.lerp(texels(at), texels(at + 1), right)
        lower = torch.lerp(texels(at + SIDE + 2), texels(at + SIDE + 3), right)
        return torch.lerp(upper, lower, below)


def _coarse(sky: Sky) -> Float[np.ndarray, "h w 3"]:
    """Average the sky's radiance over whole cells where it is finer than the lobes resolve."""
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


@lru_cache(maxsize=64)  # a person's light is looked for in 32 skies
def _around_directions(radiance: bytes, size: tuple[int, int]) -> Float[np.ndarray, "N W 3"]:
    """Compute `PrefilteredEnvironment.radiance` of a sky [h, w, 3] fp32: the same for all frames of most animations."""
    sky = Sky(np.frombuffer(radiance, np.float32).reshape(*size, 3))
    texels = torch.as_tensor(sky_directions(*size).reshape(-1, 3), dtype=torch.float32)
    energy = torch.as_tensor((sky.radiance * sky.solid_angles[..., None]).reshape(-1, 3), dtype=torch.float32)
    angle = torch.as_tensor(sky.solid_angles.reshape(-1), dtype=torch.float32)
    both, means = torch.cat([energy, angle[:, None]], 1), []
    for directions in _map_directions().split(_DIRECTIONS_AT_ONCE):
        cosine = directions @ texels.T
        means.append(torch.stack([isotropic_weight(cosine, alpha) @ both for alpha in WIDTHS], 1))
    around = torch.cat(means)
    return (around[..., :3] / around[..., 3:]).numpy()


def _map_directions() -> Float[Tensor, "N 3"]:
    """Return the directions of the map's texels, with its border."""
    middle = (torch.arange(-1, SIDE + 1) + 0.5) * (2 / SIDE) - 1
    v, u = torch.meshgrid(middle, middle, indexing="ij")
    return from_square(u, v).reshape(-1, 3)
