"""Other numbers for a person who is there: tone, blood, age, veins, folds and hair, as sliders set them.

What is the person's own stays: the atlas is multiplied by what pigment and blood change, by place, between the people
who ship. Where that is more than a factor can hold, the networks are those of the nearest of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ...avatars.avatar import Avatar
from ...avatars.drawn_people import nearest_base
from ...avatars.file import load_avatar
from ...avatars.library import shipped_avatar_path
from ...avatars.network_albedo import FIELD_RESOLUTION, network_albedo
from ...capture.person import Person
from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...render.thumbnail import with_thumbnail
from ...surface.albedo_ratio import MOST_LOG_RATIO, RATIO_ARRAY, RATIO_STEP, ratio_steps
from ...surface.blood import BLOOD_LOG_ALBEDO
from ...surface.hair_growth import REGIONS, HairRegion
from ...surface.people.drawn_surface import USUAL_DENSITY, log_albedo_map
from ...surface.people.look import ADJUSTABLE, PERSON_NUMBERS, checked_number, numbers_of_age
from ...surface.stored_surface import StoredSurface

_BARE_RESOLUTION = 512  # of the factor of a person who has none
_MOST_CLIPPED = 0.01
_LIGHT, _DEEP = "light", "deep"
_USUAL_PER_M2 = {name: USUAL_DENSITY * region.per_m2 for name, region in REGIONS.items()}


def adjusted_person(
    avatar: Avatar,
    hand: HandModel,
    given: Mapping[str, float | None],
    name: str,
    log: Callable[[str], None] = lambda line: None,
) -> Avatar:
    """Make the same person with other numbers.

    Args:
        avatar: relightable, with a surface.
        hand: its model, the right one.
        given: by the names of `ADJUSTABLE`, as in `look.NUMBERS`; None: as it is. An age sets folds and veins
            that are not given.
        name: of the new avatar, for display.
        log: is told what begins.

    Raises:
        LiveHandError: a number is beyond its limits, nothing is given, or the avatar has no surface.
    """
    surface = avatar.surface
    if surface is None:
        raise LiveHandError(
            f"only avatars with a surface can be adjusted, '{avatar.name}' has none; use one of a person that ships, "
            "or of livehand person or new-person"
        )
    numbers = {key: checked_number(key, value) for key, value in given.items() if value is not None}
    if not numbers:
        raise LiveHandError(f"one of {', '.join(ADJUSTABLE)} must be given, got none")
    numbers = {**(numbers_of_age(numbers["age"]) if "age" in numbers else {}), **numbers}
    person = _with_numbers(surface.person, numbers)
    log("changing the colors")
    base, arrays = avatar, dict(surface.arrays)
    if (person.melanin, person.blood) != (surface.person.melanin, surface.person.blood):
        log_ratio = _log_ratio_of(surface, person, hand)
        if (log_ratio.abs() > MOST_LOG_RATIO).float().mean() > _MOST_CLIPPED:
            base = nearest_base(person.melanin, load_avatar)
            size = len(log_ratio)
            log_ratio = log_ratio + _network_log_albedo(avatar, hand, size) - _network_log_albedo(base, hand, size)
        arrays[RATIO_ARRAY] = ratio_steps(log_ratio).numpy()
    hair = surface.hair if "hair" not in numbers else _grown(surface.hair, numbers["hair"])
    facts = {**avatar.provenance, "adjusted": numbers}
    changed = replace(surface, person=person, arrays=arrays, hair=hair)
    adjusted = replace(base, name=name, surface=changed, provenance=facts, metrics={}, thumbnail=None)
    log("rendering the thumbnail")
    return with_thumbnail(adjusted, hand, "cpu")


def current_numbers(surface: StoredSurface) -> dict[str, float]:
    """Tell the numbers of a person that can be adjusted, but for the age, which nothing tells."""
    person = surface.person
    densities = [surface.hair[name].per_m2 / density for name, density in _USUAL_PER_M2.items() if name in surface.hair]
    numbers = {name: getattr(person, attribute) for name, attribute in PERSON_NUMBERS.items()}
    return {**numbers, "hair": float(np.mean(densities)) if densities else 0.0}


def _with_numbers(person: Person, numbers: Mapping[str, float]) -> Person:
    return replace(person, **{PERSON_NUMBERS[name]: value for name, value in numbers.items() if name in PERSON_NUMBERS})


def _log_ratio_of(surface: StoredSurface, person: Person, hand: HandModel) -> Tensor:
    """Compute the factor's logarithm [A, A, 3] with the pigment and blood of a person."""
    steps = surface.arrays.get(RATIO_ARRAY, np.zeros((_BARE_RESOLUTION, _BARE_RESOLUTION, 3), np.int8))
    log_ratio = torch.as_tensor(steps, dtype=torch.float32) * RATIO_STEP
    more_melanin, more_blood = person.melanin - surface.person.melanin, person.blood - surface.person.blood
    if more_melanin:
        log_ratio = log_ratio + more_melanin * _per_melanin(hand, len(steps))
    return log_ratio + more_blood * torch.tensor(BLOOD_LOG_ALBEDO)


def _per_melanin(hand: HandModel, resolution: int) -> Tensor:
    """Return by what melanin of 1 changes the logarithm of albedo [A, A, 3], by place: little in the palm."""
    light, deep = (load_avatar(shipped_avatar_path(skin)) for skin in (_LIGHT, _DEEP))
    assert light.surface is not None
    assert deep.surface is not None
    melanins = deep.surface.person.melanin - light.surface.person.melanin
    return (_network_log_albedo(deep, hand, resolution) - _network_log_albedo(light, hand, resolution)) / melanins


def _network_log_albedo(avatar: Avatar, hand: HandModel, resolution: int) -> Tensor:
    """Compute the logarithm of the albedo [A, A, 3] of an avatar's networks alone."""
    return log_albedo_map(network_albedo(avatar, hand, FIELD_RESOLUTION), resolution)


def _grown(regions: Mapping[str, HairRegion], hair: float) -> dict[str, HairRegion]:
    """Return the regions with another density, in which 1 is usual, as for an invented person."""
    return {
        name: region._replace(per_m2=_USUAL_PER_M2.get(name, region.per_m2) * hair) for name, region in regions.items()
    }
