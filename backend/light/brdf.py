"""The BRDF of skin: two GGX lobes, shading normals that detail bends, and lobes as pairs of isotropic ones.

A bent normal knows nothing of the heights that bend it. Light from along the surface must not shine on bumps far beyond
the terminator, the view that a bump mirrors must leave the surface, and of the lobe around it what runs into the
surface is lost. All as Cycles has it.

Seen from the side, a lobe is long in the plane of view and normal, narrow across it, and leans away from the mirrored
view, as half of it would lie below the surface. Here it is two isotropic lobes in that plane, one for the lower and
one for the upper half of its light: each as wide as its half is across the plane, and so far from the middle of all
light that both together are as long as the lobe.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

ROUGHNESS = (0.3, 0.55)
"""Of the two glossy lobes; Blender's, the square root of the microfacets' alpha."""
NAIL_ROUGHNESS = 0.22
"""Of the first lobe on nails."""
SKIN_ROUGHNESS = 0.51
"""Of skin by itself, the mean of captures'; what the second lobe is rougher, it is by bumps that a pixel hides."""
INDEX = 1.4
"""Of refraction, of skin: it reflects 2.8 % of light that falls straight on it."""
LEAST_TO_EYE = 0.05
"""The least cosine between normal and eye: lobes grow without bound at grazing views."""
TAIL = 8.0
"""Squared slopes, in squared alphas, from which on bumps widen a lobe by half as much: of Gaussian slopes, by sums."""
FACES_TURN = 0.05
"""Half the sine by which neighbouring faces of a detail mesh turn: of 0.8 mm, on a finger's radius of 8 mm."""
STEEPER = 1 / 0.9
"""Slopes of bumps as gloss of lamps shows them, over those of normals: what is mirrored does not blur in the skin."""
_TINY = 1e-8
POSITIVE_PART = 2 / pi
"""Of Gaussian values of mean 0 and variance v, the mean of those above 0 (the others for 0) is half the root of so
many v."""


def ggx(
    normal: Float[Tensor, "*#n 3"],
    towards: Float[Tensor, "*#n 3"],
    view: Float[Tensor, "*#n 3"],
    light_radius_rad: Float[Tensor, "*#n"],
    nail: Float[Tensor, "*#n"] | None = None,
    broad_squared: Float[Tensor, "*#n"] | None = None,
    hidden: Float[Tensor, "*#n"] | None = None,
    surface_normal: Float[Tensor, "*#n 3"] | None = None,
) -> Float[Tensor, "... 2"]:
    """Compute the light reflected in two lobes per unit of arriving light (GGX, Smith, Fresnel; Walter et al. 2007).

    Bumps that a pixel hides widen the second lobe by the variance of their slopes. But those that mirror a light face
    it, and so shadow and mask it less than a rough surface that lies flat would: they are taken to lie as the mean of
    those whose mirrored light is seen (Tweedie's formula), and differ from it by what is left of their variance: where
    light grazes, some of them are lit though their mean is not. Far from its middle a lobe is not wider by them.

    A light of some size widens the lobe: half vectors fill a disc of half its angle t, and the mean of the distribution
    over that disc is, in its middle, exactly that of a lobe with alpha^2 + t^2.

    Args:
        normal: unit.
        towards: unit, towards the light.
        view: unit, from the camera.
        light_radius_rad: half the angle of the light.
        nail: 1 on nails, 0 on skin, which stands for None.
        broad_squared: squared alpha of the second lobe, where it is known.
        hidden: what of it is the variance of slopes of bumps; None: nothing.
        surface_normal: unit, of the surface whose bumps the normal shows, and whose own shadow begins where it turns
            away from the light; None: where the normal does.
    """
    half = torch.nn.functional.normalize(towards - view, dim=-1)
    to_light, to_eye = (normal * towards).sum(-1), -(normal * view).sum(-1)
    to_half = (normal * half).sum(-1).clamp(0, 1)
    along_half = (towards * half).sum(-1).clamp(0, 1)
    reflectance = fresnel(along_half)
    if surface_normal is None:
        arriving = (to_light > 0).to(to_light.dtype)
    else:
        arriving = share_above((surface_normal * towards).sum(-1), light_radius_rad)
    lobes = []
    for squared, bumps in zip(squared_alphas(nail, broad_squared), (None, hidden), strict=True):
        squared = (squared + (light_radius_rad / 2) ** 2).clamp(max=1)
        smooth, lit, seen = squared, to_light, to_eye
        if bumps is not None:
            smooth = squared - bumps
            across = 1 - to_half**2
            towards_half = bumps * to_half / (squared * to_half**2 + across)
            length = (1 + towards_half**2 * across).sqrt()
            lit, seen = (
                ((1 - towards_half * to_half) * cosine + towards_half * along_half) / length
                for cosine in (to_light, to_eye)
            )
            variance = 0.5 * bumps * (1 - towards_half) * (1 - lit**2).clamp(min=0)
            lit = 0.5 * (lit + (lit**2 + POSITIVE_PART * variance).clamp(min=_TINY**2).sqrt())
            reach = TAIL * squared * to_half**2
            squared = smooth + bumps * reach / (reach + across)
        is_lit = lit > 0
        lit, seen = lit.clamp(min=1e-4), seen.clamp(min=LEAST_TO_EYE)
        # pi times the distribution: light is in units of irradiance / pi.
        distribution = squared / (to_half**2 * (squared - 1) + 1) ** 2
        shadowing = 0.5 / (
            lit * (seen**2 * (1 - smooth) + smooth).sqrt() + seen * (lit**2 * (1 - smooth) + smooth).sqrt()
        )
        reflected = distribution * shadowing * reflectance * lit * arriving
        lobes.append(torch.where(is_lit, reflected, torch.zeros_like(lit)))
    return torch.stack(lobes, -1)


def share_above(to_light: Float[Tensor, "*#n"], light_radius_rad: Float[Tensor, "*#n"]) -> Float[Tensor, "*n"]:
    """Compute the share of a light above a surface that shadows itself, by the cosine of its middle and the normal.

    It rises over its own radius, and over the angle by which faces turn: some are lit as a whole, the next ones not.
    """
    return (0.5 + 0.5 * to_light / (FACES_TURN + light_radius_rad)).clamp(0, 1)


def hidden_bumps(alpha_squared: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """Return what of the squared alpha of skin is the variance of slopes of bumps."""
    return (alpha_squared - SKIN_ROUGHNESS**4).clamp(min=0)


def fresnel(cosine: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """Compute the share of light that a smooth surface reflects, by the cosine; Schlick's is 20% less at 60 degrees."""
    inside = (INDEX**2 - 1 + cosine**2).sqrt()
    less, more = inside - cosine, inside + cosine
    return 0.5 * (less / more) ** 2 * (1 + ((cosine * more - 1) / (cosine * less + 1)) ** 2)


def squared_alphas(nail: Tensor | None, broad_squared: Tensor | None) -> tuple[float | Tensor, float | Tensor]:
    """Return the squared alphas of both lobes; arguments as of `ggx`."""
    tight, broad = alphas(nail)
    return tight**2, broad**2 if broad_squared is None else broad_squared


def alphas(nail: Tensor | None) -> tuple[float | Tensor, float]:
    """Return the alphas of the microfacets in both lobes; `nail` as in `ggx`."""
    tight, broad = (roughness**2 for roughness in ROUGHNESS)
    return (tight if nail is None else tight + (NAIL_ROUGHNESS**2 - tight) * nail), broad


LEAST_MIRRORED, LEAST_OF_EYE = 0.01, 0.9
"""The least cosine of the mirrored view and the surface; of this share of the eye's, where that is less."""
_LEAST_BEND = 1e-4  # sine of the angle between both normals


def bump_shadowing(
    normal: Float[Tensor, "*#n 3"], surface_normal: Float[Tensor, "*#n 3"], towards: Float[Tensor, "*#n 3"]
) -> Float[Tensor, "*n"]:
    """Compute the share of a light's diffuse reflection that remains (Chiang et al. 2019); without gradients.

    Args:
        normal: unit, bent.
        surface_normal: unit, of the surface without the detail.
        towards: unit, towards the light.
    """
    normal, surface_normal = normal.detach(), surface_normal.detach()
    facing = (normal * towards).sum(-1) * (normal * surface_normal).sum(-1)
    share = ((surface_normal * towards).sum(-1) / facing.clamp(min=_TINY)).clamp(0, 1)
    return share * (1 + share - share * share)


def clamped_reflection_normal(
    normal: Float[Tensor, "P 3"], surface_normal: Float[Tensor, "P 3"], view: Float[Tensor, "P 3"]
) -> Float[Tensor, "P 3"]:
    """Bend the normals back towards the surface's as far as the mirrored view would run into the surface.

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


def glossy_normal(normal: Float[Tensor, "P 3"], surface_normal: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
    """Bend the normals away from the surface's until slopes are `STEEPER` times as steep; both unit."""
    along = (normal * surface_normal).sum(-1, keepdim=True)
    return normalize(STEEPER * normal - (STEEPER - 1) * along * surface_normal, dim=-1)


def horizon_occlusion(
    normal: Float[Tensor, "P 3"],
    surface_normal: Float[Tensor, "P 3"],
    view: Float[Tensor, "P 3"],
    alpha_squared: Float[Tensor, "P L"],
) -> Float[Tensor, "P L"]:
    """Compute the share of a lobe's light that comes from above the surface, against that from above the bump's plane.

    A lobe of half vectors after the distribution of GGX has its part ``(1 + s / (alpha^2 + s^2)^0.5) / 2`` on one side
    of a plane; s is the tangent of half the angle between that plane and the mirrored view. Without gradients.

    Args:
        normal: unit, bent, as `clamped_reflection_normal` leaves it.
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
    """Compute twice the part of a lobe above a plane, by the cosine of the mirrored view and the plane's normal."""
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


WIDTHS = tuple(float(alpha) for alpha in np.geomspace(0.02, 1, 7))
"""Alpha of the isotropic lobes for which light is known (`isotropic_weight`)."""
LEAST_ROUGHNESS, ROUGHNESSES = 0.2, 9
"""Blender's, the square root of alpha: from which, up to 1, and how many are tabulated."""
COSINES = 65
"""Of the view, that are tabulated: 1 - x^2 for x from 0 to 1, for straight on directions turn with the angle."""
SHARE, AHEAD, UP, WIDTH = range(4)
"""What is known of an isotropic lobe: how much it reflects of even light; its direction, along the surface away from
the eye and along the normal; its width, a position among `WIDTHS`, between which the light of both is mixed."""
_HALF_VECTORS = 48  # along each of their two coordinates
_LEAST_COSINE = 1e-3  # so that a sky of few texels has some around every direction


def isotropic_weight(cosine: Float[Tensor, "*n"], alpha: float) -> Float[Tensor, "*n"]:
    """Compute the weight of light in an isotropic lobe, by the cosine of its direction and the lobe's."""
    to_half_squared = (1 + cosine) / 2
    return cosine.clamp(min=_LEAST_COSINE) / (to_half_squared * (alpha**2 - 1)).add_(1).square_()


@lru_cache(maxsize=1)
def isotropic_lobes() -> Float[np.ndarray, "A C 2 4"]:
    """Compute both isotropic lobes for each roughness and cosine of the view, the lower one first."""
    return torch.stack([_pair(float(alpha)) for alpha in np.linspace(LEAST_ROUGHNESS, 1, ROUGHNESSES) ** 2]).numpy()


def lobes_at(to_eye: Float[Tensor, " P"], alpha_squared: Float[Tensor, " P"], table: Tensor) -> Float[Tensor, "P 2 4"]:
    """Look up the isotropic lobes of P points in the table.

    Args:
        to_eye: cosine of normal and eye.
        alpha_squared: of the lobe.
        table: `isotropic_lobes`.
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
    """Fit both isotropic lobes to a lobe, by half vectors drawn after its distribution; the plane is x, z."""
    to_eye = (1 - torch.linspace(0, 1, COSINES) ** 2).clamp(min=LEAST_TO_EYE)
    view = torch.stack([(1 - to_eye**2).sqrt(), torch.zeros(COSINES), -to_eye], -1)[:, None]
    drawn, turn = torch.meshgrid(*[(torch.arange(_HALF_VECTORS) + 0.5) / _HALF_VECTORS] * 2, indexing="ij")
    to_half = ((1 - drawn) / (1 + (alpha**2 - 1) * drawn)).sqrt().flatten()
    across, angle = (1 - to_half**2).clamp(min=0).sqrt(), 2 * pi * turn.flatten()
    half = torch.stack([across * angle.cos(), across * angle.sin(), to_half], -1)
    along = (half * view).sum(-1, keepdim=True)
    towards = view - 2 * along * half
    squared = torch.tensor(alpha**2)
    lobes = ggx(
        torch.tensor([0.0, 0, 1]), towards, view, torch.zeros(()), broad_squared=squared, hidden=hidden_bumps(squared)
    )[..., 1]
    # pi times the density of half vectors, and what is lost of it at the turn to directions of light.
    density = alpha**2 * to_half / (1 + to_half**2 * (alpha**2 - 1)) ** 2
    light = lobes * 4 * along[..., 0].abs() / density * (along[..., 0] < 0) / len(half)
    return torch.stack([_round(light * is_in, light, towards) for is_in in _halves(light, towards)], 1)


def _halves(light: Float[Tensor, "C N"], towards: Float[Tensor, "C N 3"]) -> tuple[Tensor, Tensor]:
    """Split the light by direction into its lower and its upper half, [C, N] each."""
    order = torch.atan2(towards[..., 2], towards[..., 0]).argsort(1)
    summed = light.gather(1, order).cumsum(1)
    is_lower = torch.zeros_like(light).scatter(1, order, (summed <= 0.5 * summed[:, -1:]).float())
    return is_lower, 1 - is_lower


def _round(part: Float[Tensor, "C N"], light: Float[Tensor, "C N"], towards: Float[Tensor, "C N 3"]) -> Tensor:
    """Fit an isotropic lobe [C, 4] to a part of the light."""
    middle = torch.nn.functional.normalize((light[..., None] * towards).sum(1), dim=-1)
    upward = torch.stack([-middle[:, 2], torch.zeros(COSINES), middle[:, 0]], -1)
    share = part.sum(1)

    def mean(values: Tensor) -> Tensor:
        return (part * values).sum(1) / share

    height = (towards * upward[:, None]).sum(-1)
    across = mean(towards[..., 1] ** 2)
    offset = (mean(height**2) - across).clamp(min=0).sqrt().clamp(max=0.95) * mean(height).sign()
    direction = (1 - offset**2).sqrt()[:, None] * middle + offset[:, None] * upward
    return torch.stack([share, direction[:, 0], direction[:, 2], _points(across)], -1)


def _points(across: Float[Tensor, " C"]) -> Float[Tensor, " C"]:
    """Find the position among `WIDTHS` of an isotropic lobe of this second moment across its direction."""
    cosine = torch.linspace(-1, 1, 20001)
    moments = []
    for alpha in WIDTHS:
        weight = isotropic_weight(cosine, alpha)
        moments.append(float((weight * (1 - cosine**2)).sum() / weight.sum() / 2))
    return torch.as_tensor(np.interp(across.numpy(), moments, np.arange(len(WIDTHS))), dtype=torch.float32)
