"""An avatar of an invented person: the networks of the nearest base, and a surface that is drawn from numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ...avatars.avatar import Avatar
from ...avatars.file import load_avatar
from ...avatars.library import SKINS, shipped_avatar_path
from ...avatars.network_albedo import FIELD_RESOLUTION, network_albedo
from ...hand.model import HandModel
from ...render.thumbnail import with_thumbnail
from ...surface.albedo_ratio import RATIO_ARRAY, ratio_steps
from ...surface.base_surface import base_arrays, base_sha256
from ...surface.hair_growth import REGIONS, HairRegion
from ...surface.stored_surface import StoredSurface
from .drawing import AtlasSizes, drawn_person
from .look import PersonLook

MADE_BY = "livehand new-person"
_LEAST_ALBEDO = 0.003
USUAL_DENSITY = 1.8  # of hairs of 1, against the densities of the captured people
_THINNER = 0.65  # than theirs


def new_person(
    hand: HandModel,
    look: PersonLook,
    name: str,
    log: Callable[[str], None] = lambda line: None,
    sizes: AtlasSizes = AtlasSizes(),  # noqa: B008
) -> Avatar:
    """Make the avatar, relightable and without training.

    Args:
        hand: the built-in right one.
        look: of the person.
        name: for display.
        log: is told what begins.
        sizes: of the maps.
    """
    log("choosing the nearest base")
    base = nearest_base(look.tone)
    log("drawing the skin")
    drawn = drawn_person(hand, look, base_arrays(), sizes)
    log("comparing with the base's colors")
    ratio = albedo_ratio_arrays(drawn.log_albedo, network_albedo(base, hand, FIELD_RESOLUTION))
    regions = {region: grown(grows, look) for region, grows in REGIONS.items()}
    surface = StoredSurface(hand.sha256, look.person(), {**drawn.arrays, **ratio}, base_sha256(), regions)
    avatar = replace(base, name=name, surface=surface, provenance=_provenance(base, look), metrics={}, thumbnail=None)
    log("rendering the thumbnail")
    return with_thumbnail(avatar, hand, "cpu")


def nearest_base(tone: float) -> Avatar:
    """Load the avatar that ships whose skin is nearest to a tone."""
    avatars = [load_avatar(shipped_avatar_path(skin)) for skin in SKINS]
    return min(avatars, key=lambda avatar: abs(_melanin(avatar) - tone))


def albedo_ratio_arrays(log_albedo: np.ndarray, network_albedo: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the ratio's array from what is to be seen [A, A, 3] and what the networks show [B, B, 3]."""
    shown = log_albedo_map(network_albedo, len(log_albedo))
    return {RATIO_ARRAY: ratio_steps(torch.as_tensor(log_albedo) - shown).numpy()}


def log_albedo_map(albedo: np.ndarray, resolution: int) -> Tensor:
    """Compute the logarithm [A, A, 3] of an albedo [B, B, 3] at another resolution."""
    log_albedo = torch.as_tensor(np.log(albedo.clip(_LEAST_ALBEDO))).permute(2, 0, 1)[None].float()
    return interpolate(log_albedo, size=(resolution, resolution), mode="bilinear")[0].permute(1, 2, 0)


def grown(region: HairRegion, look: PersonLook) -> HairRegion:
    """Return how a person's hairs grow: more and thinner ones than the base's, which are those of its captures."""
    radius_m = region.radius_m * _THINNER * (1 - 0.2 * look.aged)
    return region._replace(per_m2=region.per_m2 * USUAL_DENSITY * look.hair, radius_m=radius_m)


def _melanin(avatar: Avatar) -> float:
    assert avatar.surface is not None
    return avatar.surface.person.melanin


def _provenance(base: Avatar, look: PersonLook) -> dict[str, Any]:
    facts = {"made_by": MADE_BY, "base": base.name, "look": look.facts()}
    return facts | {key: base.provenance[key] for key in ("licence",) if key in base.provenance}
