"""Light on normals that detail bends away from the surface (bump mapping, Blinn 1978).

A bent normal knows nothing of the heights that bend it. Light from along the surface must not shine on bumps far beyond
the terminator, the view that a bump mirrors must leave the surface, and of the lobe around it what runs into the
surface is lost. All as Cycles has it.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

LEAST_MIRRORED, LEAST_OF_EYE = 0.01, 0.9
"""The least cosine of the mirrored view and the surface; of this share of the eye's, where that is less."""
_TINY = 1e-8
_LEAST_BEND = 1e-4  # sine of the angle between both normals


def bump_shadowing(
    normal: Float[Tensor, "*#n 3"], surface_normal: Float[Tensor, "*#n 3"], towards: Float[Tensor, "*#n 3"]
) -> Float[Tensor, "*n"]:
    """The share of a light's diffuse reflection that remains (Chiang, Li and Burley 2019); without gradients.

    Args:
        normal: unit, bent.
        surface_normal: unit, of the surface without the detail.
        towards: unit, towards the light.
    """
    normal, surface_normal = normal.detach(), surface_normal.detach()
    facing = (normal * towards).sum(-1) * (normal * surface_normal).sum(-1)
    share = ((surface_normal * towards).sum(-1) / facing.clamp(min=_TINY)).clamp(0, 1)
    return share * (1 + share - share * share)


def mirroring_normal(
    normal: Float[Tensor, "P 3"], surface_normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"]
) -> Float[Tensor, "P 3"]:
    """The normals, bent back towards the surface's as far as the mirrored view would run into the surface.

    Those that are have no gradients.

    In the plane of both normals, at an angle t to the surface's, the mirrored view has the cosine r cos(2 t - p) to the
    surface's normal; r and p are the polar coordinates of the eye in that plane.

    Args:
        normal: unit, bent.
        surface_normal: unit, of the surface without the detail.
        view: unit, from the camera.
    """
    bent_back, is_bent_back = _bent_back(normal.detach(), surface_normal.detach(), view.detach())
    return torch.where(is_bent_back, bent_back, normal)


def leaving_share(
    normal: Float[Tensor, "P 3"],
    surface_normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    alpha_squared: Float[Tensor, "P L"],
) -> Float[Tensor, "P L"]:
    """The share of a lobe's light that comes from above the surface, against that from above the bump's own plane.

    A lobe of half vectors after the distribution of GGX has its part ``(1 + s / (alpha^2 + s^2)^0.5) / 2`` on one side
    of a plane; s is the tangent of half the angle between that plane and the mirrored view. Without gradients.

    Args:
        normal: unit, bent, as `mirroring_normal` leaves it.
        surface_normal: unit, of the surface without the detail.
        view: unit, from the camera.
        alpha_squared: of L lobes.
    """
    normal, surface_normal, view = normal.detach(), surface_normal.detach(), view.detach()
    to_eye = -(normal * view).sum(-1, keepdim=True)
    above = (surface_normal * view).sum(-1, keepdim=True) + 2 * to_eye * (normal * surface_normal).sum(-1, keepdim=True)
    share, whole = (_part_of_lobe(cosine, alpha_squared) for cosine in (above, to_eye.clamp(min=0)))
    return (share / whole).clamp(max=1)


def _part_of_lobe(cosine: Float[Tensor, "P 1"], alpha_squared: Float[Tensor, "P L"]) -> Float[Tensor, "P L"]:
    """Twice the part above a plane, by the cosine of the mirrored view and the plane's normal."""
    tangent = cosine / (1 + (1 - cosine * cosine).clamp(min=0).sqrt())
    return 1 + tangent / (alpha_squared + tangent * tangent).sqrt()


def _bent_back(normal: Tensor, surface_normal: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:
    along = (normal * surface_normal).sum(-1, keepdim=True).clamp(max=1)
    aside = normal - along * surface_normal
    bend = aside.norm(dim=-1, keepdim=True)
    axis = aside / bend.clamp(min=_TINY)
    up, across = (-(way * view).sum(-1, keepdim=True) for way in (surface_normal, axis))
    least = (LEAST_OF_EYE * up).clamp(max=LEAST_MIRRORED)
    reach = torch.acos((least / torch.hypot(up, across).clamp(min=_TINY)).clamp(-1, 1))
    kept = (torch.atan2(across, up) + reach) / 2
    bent_back = normalize(kept.cos() * surface_normal + kept.sin() * axis, dim=-1)
    mirrored = 2 * along * -(normal * view).sum(-1, keepdim=True) - up
    return bent_back, (mirrored < least) & (up > 0) & (bend > _LEAST_BEND)
