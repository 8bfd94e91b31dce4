"""Glossy lobes as pairs of round ones, which light from all directions can be looked up for.

Seen from the side, a lobe is long in the plane of view and normal, narrow across it, and leans away from the mirrored
view, as half of it would lie below the surface. Here it is two round lobes in that plane, one for the lower and one for
the upper half of its light: each as wide as its half is across the plane, and so far from the middle of all light that
both together are as long as the lobe.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from .gloss import LEAST_TO_EYE, glossy

WIDTHS = tuple(float(alpha) for alpha in np.geomspace(0.02, 1, 7))
"""Alpha of the round lobes for which light is known (`round_weight`)."""
LEAST_ROUGHNESS, ROUGHNESSES = 0.2, 9
"""Blender's, the square root of alpha: from which, up to 1, and how many are tabulated."""
COSINES = 65
"""Of the view, that are tabulated: 1 - x^2 for x from 0 to 1, for straight on directions turn with the angle."""
SHARE, AHEAD, UP, WIDTH = range(4)
"""What is known of a round lobe: how much it reflects of even light; its direction, along the surface away from the eye
and along the normal; its width, a place among `WIDTHS`, between which the light of both is mixed."""
_HALF_VECTORS = 48  # along each of their two coordinates
_LEAST_COSINE = 1e-3  # so that a sky of few texels has some around every direction


def round_weight(cosine: Float[Tensor, "*n"], alpha: float) -> Float[Tensor, "*n"]:
    """Weight of light in a round lobe, by the cosine of its direction and the lobe's."""
    to_half_squared = (1 + cosine) / 2
    return cosine.clamp(min=_LEAST_COSINE) / (to_half_squared * (alpha**2 - 1)).add_(1).square_()


@lru_cache(maxsize=1)
def round_lobes() -> Float[np.ndarray, "A C 2 4"]:
    """Both round lobes for each roughness and cosine of the view, the lower one first."""
    return torch.stack([_pair(float(alpha)) for alpha in np.linspace(LEAST_ROUGHNESS, 1, ROUGHNESSES) ** 2]).numpy()


def lobes_at(to_eye: Float[Tensor, " P"], alpha_squared: Float[Tensor, " P"], table: Tensor) -> Float[Tensor, "P 2 4"]:
    """The round lobes of P points, from the table.

    Args:
        to_eye: cosine of normal and eye.
        alpha_squared: of the lobe.
        table: `round_lobes`.
    """
    step = (1 - LEAST_ROUGHNESS) / (ROUGHNESSES - 1)
    rough = ((alpha_squared.sqrt().sqrt() - LEAST_ROUGHNESS) / step).clamp(0, ROUGHNESSES - 1)
    column = (1 - to_eye.clamp(0, 1)).sqrt() * (COSINES - 1)
    row, at = rough.floor().clamp(max=ROUGHNESSES - 2), column.floor().clamp(max=COSINES - 2)
    over, below = (column - at)[:, None, None], (rough - row)[:, None, None]
    row, at = row.long(), at.long()
    upper = torch.lerp(table[row, at], table[row, at + 1], over)
    return torch.lerp(upper, torch.lerp(table[row + 1, at], table[row + 1, at + 1], over), below)


def _pair(alpha: float) -> Float[Tensor, "C 2 4"]:
    """Of a lobe, by half vectors drawn after its distribution; the plane is x, z."""
    to_eye = (1 - torch.linspace(0, 1, COSINES) ** 2).clamp(min=LEAST_TO_EYE)
    view = torch.stack([(1 - to_eye**2).sqrt(), torch.zeros(COSINES), -to_eye], -1)[:, None]
    drawn, turn = torch.meshgrid(*[(torch.arange(_HALF_VECTORS) + 0.5) / _HALF_VECTORS] * 2, indexing="ij")
    to_half = ((1 - drawn) / (1 + (alpha**2 - 1) * drawn)).sqrt().flatten()
    across, angle = (1 - to_half**2).clamp(min=0).sqrt(), 2 * pi * turn.flatten()
    half = torch.stack([across * angle.cos(), across * angle.sin(), to_half], -1)
    along = (half * view).sum(-1, keepdim=True)
    towards = view - 2 * along * half
    squared = torch.tensor(alpha**2)
    lobes = glossy(torch.tensor([0.0, 0, 1]), towards, view, torch.zeros(()), broad_squared=squared)[..., 1]
    # pi times the density of half vectors, and what is lost of it at the turn to directions of light.
    density = alpha**2 * to_half / (1 + to_half**2 * (alpha**2 - 1)) ** 2
    light = lobes * 4 * along[..., 0].abs() / density * (along[..., 0] < 0) / len(half)
    return torch.stack([_round(light * is_in, light, towards) for is_in in _halves(light, towards)], 1)


def _halves(light: Float[Tensor, "C N"], towards: Float[Tensor, "C N 3"]) -> tuple[Tensor, Tensor]:
    """Which directions are the lower and which the upper half of the light, [C, N] each."""
    order = torch.atan2(towards[..., 2], towards[..., 0]).argsort(1)
    summed = light.gather(1, order).cumsum(1)
    is_lower = torch.zeros_like(light).scatter(1, order, (summed <= 0.5 * summed[:, -1:]).float())
    return is_lower, 1 - is_lower


def _round(part: Float[Tensor, "C N"], light: Float[Tensor, "C N"], towards: Float[Tensor, "C N 3"]) -> Tensor:
    """[C, 4] the round lobe of a part of the light."""
    middle = torch.nn.functional.normalize((light[..., None] * towards).sum(1), dim=-1)
    upward = torch.stack([-middle[:, 2], torch.zeros(COSINES), middle[:, 0]], -1)
    share = part.sum(1)

    def mean(values: Tensor) -> Tensor:
        return (part * values).sum(1) / share

    height = (towards * upward[:, None]).sum(-1)
    across = mean(towards[..., 1] ** 2)
    offset = (mean(height**2) - across).clamp(min=0).sqrt().clamp(max=0.95) * mean(height).sign()
    direction = (1 - offset**2).sqrt()[:, None] * middle + offset[:, None] * upward
    return torch.stack([share, direction[:, 0], direction[:, 2], _places(across)], -1)


def _places(across: Float[Tensor, " C"]) -> Float[Tensor, " C"]:
    """Among `WIDTHS`, of a round lobe of this second moment across its direction."""
    cosine = torch.linspace(-1, 1, 20001)
    moments = []
    for alpha in WIDTHS:
        weight = round_weight(cosine, alpha)
        moments.append(float((weight * (1 - cosine**2)).sum() / weight.sum() / 2))
    return torch.as_tensor(np.interp(across.numpy(), moments, np.arange(len(WIDTHS))), dtype=torch.float32)
