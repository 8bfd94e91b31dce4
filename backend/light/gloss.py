"""What the layer of sebum and horn on the skin reflects: two glossy lobes."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

ROUGHNESS = (0.3, 0.55)
"""Of the two glossy lobes; Blender's, the square root of the microfacets' alpha."""
NAIL_ROUGHNESS = 0.22
"""Of the first lobe on nails."""
INDEX = 1.4
"""Of refraction, of skin: it reflects 2.8 % of light that falls straight on it."""
LEAST_TO_EYE = 0.05
"""The least cosine between normal and eye: lobes grow without bound at grazing views."""


def glossy(
    normal: Float[Tensor, "*#n 3"],
    towards: Float[Tensor, "*#n 3"],
    view: Float[Tensor, "*#n 3"],
    light_radius_rad: Float[Tensor, "*#n"],
    nail: Float[Tensor, "*#n"] | None = None,
    broad_squared: Float[Tensor, "*#n"] | None = None,
) -> Float[Tensor, "... 2"]:
    """Reflected light in two lobes per unit of arriving light (GGX, Smith, Fresnel; Walter et al. 2007).

    A light of some size widens the lobe: half vectors fill a disc of half its angle t, and the mean of the distribution
    over that disc is, in its middle, exactly that of a lobe with alpha^2 + t^2.

    Args:
        normal: unit.
        towards: unit, towards the light.
        view: unit, from the camera.
        light_radius_rad: half the angle of the light.
        nail: 1 on nails, 0 on skin, which stands for None.
        broad_squared: squared alpha of the second lobe, where it is known.
    """
    half = torch.nn.functional.normalize(towards - view, dim=-1)
    to_light = (normal * towards).sum(-1)
    to_eye = -(normal * view).sum(-1).clamp(max=-LEAST_TO_EYE)
    to_half = (normal * half).sum(-1).clamp(0, 1)
    reflectance = fresnel((towards * half).sum(-1).clamp(0, 1))
    is_lit = to_light > 0
    to_light = to_light.clamp(min=1e-4)
    lobes = []
    for squared in squared_alphas(nail, broad_squared):
        squared = (squared + (light_radius_rad / 2) ** 2).clamp(max=1)
        # pi times the distribution: light is in units of irradiance / pi.
        distribution = squared / (to_half**2 * (squared - 1) + 1) ** 2
        shadowing = 0.5 / (
            to_light * (to_eye**2 * (1 - squared) + squared).sqrt()
            + to_eye * (to_light**2 * (1 - squared) + squared).sqrt()
        )
        lobes.append(torch.where(is_lit, distribution * shadowing * reflectance * to_light, torch.zeros_like(to_light)))
    return torch.stack(lobes, -1)


def fresnel(cosine: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """The share of light that a smooth surface reflects, by the cosine; Schlick's is a fifth less at 60 degrees."""
    inside = (INDEX**2 - 1 + cosine**2).sqrt()
    less, more = inside - cosine, inside + cosine
    return 0.5 * (less / more) ** 2 * (1 + ((cosine * more - 1) / (cosine * less + 1)) ** 2)


def squared_alphas(nail: Tensor | None, broad_squared: Tensor | None) -> tuple[float | Tensor, float | Tensor]:
    """Of both lobes; arguments as of `glossy`."""
    tight, broad = alphas(nail)
    return tight**2, broad**2 if broad_squared is None else broad_squared


def alphas(nail: Tensor | None) -> tuple[float | Tensor, float]:
    """Of the microfacets in both lobes; `nail` as in `glossy`."""
    tight, broad = (roughness**2 for roughness in ROUGHNESS)
    return (tight if nail is None else tight + (NAIL_ROUGHNESS**2 - tight) * nail), broad
