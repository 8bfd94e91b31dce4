"""The surface of an invented person for an avatar with the networks of somebody else, whose albedo it makes up for."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ...hand.model import HandModel
from ..albedo_ratio import RATIO_ARRAY, ratio_steps
from ..base_surface import base_arrays, base_sha256
from ..hair_growth import REGIONS, HairRegion
from ..stored_surface import StoredSurface
from .drawing import AtlasSizes, drawn_person
from .look import PersonLook

USUAL_DENSITY = 1.8
"""Of hairs of 1, against the densities of the captured people."""
_THINNER = 0.65  # than theirs
_LEAST_ALBEDO = 0.003


def drawn_surface(
    hand: HandModel,
    look: PersonLook,
    network_albedo: np.ndarray,
    sizes: AtlasSizes = AtlasSizes(),  # noqa: B008
) -> StoredSurface:
    """Draw a person's surface.

    Args:
        hand: the built-in right one.
        look: of the person.
        network_albedo: [B, B, 3] of the networks that will show it.
        sizes: of the maps.
    """
    drawn = drawn_person(hand, look, base_arrays(), sizes)
    ratio = albedo_ratio_arrays(drawn.log_albedo, network_albedo)
    regions = {region: grown(grows, look) for region, grows in REGIONS.items()}
    return StoredSurface(hand.sha256, look.person(), {**drawn.arrays, **ratio}, base_sha256(), regions)


def albedo_ratio_arrays(log_albedo: np.ndarray, network_albedo: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the ratio's array from what is to be seen [A, A, 3] and what the networks show [B, B, 3]."""
    shown = log_albedo_map(network_albedo, len(log_albedo))
    return {RATIO_ARRAY: ratio_steps(torch.as_tensor(log_albedo) - shown).numpy()}


def log_albedo_map(albedo: np.ndarray, resolution: int) -> Tensor:
    """Compute the logarithm [A, A, 3] of an albedo [B, B, 3] at another resolution."""
    log_albedo = torch.as_tensor(np.log(albedo.clip(_LEAST_ALBEDO))).permute(2, 0, 1)[None].float()
    return interpolate(log_albedo, size=(resolution, resolution), mode="bilinear")[0].permute(1, 2, 0)


def grown(region: HairRegion, look: PersonLook) -> HairRegion:
    """Return how a person's hairs grow: more and thinner ones than the base's, which are those of its captures.

    Whose hairs are few has fine ones.
    """
    radius_m = region.radius_m * _THINNER * (1 - 0.2 * look.aged) * (0.5 + 0.5 * min(look.hair, 1.0))
    return region._replace(per_m2=region.per_m2 * USUAL_DENSITY * look.hair, radius_m=radius_m)
