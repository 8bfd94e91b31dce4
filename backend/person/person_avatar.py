"""The avatar of a person: a base's networks, and a surface with the person's numbers, albedo and confidence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..avatars.avatar import Avatar
from ..avatars.file import load_avatar
from ..avatars.library import shipped_avatar_path
from ..avatars.network_albedo import in_network_colours
from ..capture.person import Person
from ..hand.model import HandModel
from ..records.side import Side
from ..render.thumbnail import with_thumbnail
from ..surface.albedo_ratio import MARKS_ARRAYS, RATIO_ARRAY
from ..surface.atlas_masks import confidence_map, marks_map
from ..surface.base_surface import whole_surface
from ..surface.detail_surface import OFFSET_STEP_M
from .bases import Bases
from .lit_model.model import PersonModel
from .making import MadePerson

_MOST_BETA = 3.0
_MOST_MELANIN, _MOST_BLOOD = 1.2, 2.0


def person_avatar(
    made: MadePerson, hand: HandModel, beta: np.ndarray, name: str, side: Side, provenance: dict[str, Any]
) -> Avatar:
    """Make the avatar.

    Args:
        made: what the pictures gave.
        hand: the model.
        beta: [10] the person's shape.
        name: for display.
        side: of the hand that was pictured, which alone has its marks.
        provenance: of the pictures: source, consent.
    """
    base, completed = made.model.avatar, made.completed
    assert base.surface is not None
    arrays: dict[str, np.ndarray] = {
        **base.surface.arrays,
        RATIO_ARRAY: made.steps,
        "confidence": confidence_map(made.texels, completed.confidence),
    }
    nail = whole_surface(base.surface).arrays["nail"]
    marks = marks_map(made.texels, completed.log_ratio, completed.confidence, nail)
    if marks.any():
        arrays[MARKS_ARRAYS[side]] = marks
    if made.model.offset_m.any():
        arrays["offset"] = _offset(made, whole_surface(base.surface).arrays["offset"])
    surface = replace(base.surface, arrays=arrays, person=_person(made, base.surface.person, beta))
    facts = {"made_by": "livehand person", "base": base.name, "side": side, **provenance}
    avatar = replace(base, name=name, surface=surface, provenance=facts, metrics={}, thumbnail=None)
    return with_thumbnail(avatar, hand, "cpu")


def _person(made: MadePerson, base: Person, beta: np.ndarray) -> Person:
    numbers = made.completed.numbers
    shape = tuple(float(value) for value in np.clip(beta, -_MOST_BETA, _MOST_BETA).round(4))
    melanin, blood = (
        round(float(np.clip(value, 0, most)), 3)
        for value, most in ((numbers.melanin, _MOST_MELANIN), (numbers.blood, _MOST_BLOOD))
    )
    return replace(base, melanin=melanin, blood=blood, beta=shape)


def _offset(made: MadePerson, base_offset: np.ndarray) -> np.ndarray:
    """Return the offsets [N, 3] int16: the base's and the person's, along the normals at rest."""
    along = made.model.at_detail(made.model.offset_m[:, None])
    moved = base_offset + along * made.model.template.normals.numpy() / OFFSET_STEP_M
    return moved.round().clip(-32767, 32767).astype(np.int16)


BASES = "light", "middle", "deep"


def shipped_bases(hand: HandModel) -> Bases:
    """Load them, in the colours of their networks: what is drawn on them is nobody else's."""
    avatars = [load_avatar(shipped_avatar_path(name)) for name in BASES]
    return Bases.of(PersonModel.of(in_network_colours(avatar), hand) for avatar in avatars)
