"""Avatars that ship, to begin a person with: the one whose skin is nearest, and the family of skins between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..records.hand_picture import PicturedHand
from .lit_model.model import PersonModel
from .lit_model.numbers import FIRST_MELANIN, ToneFamily

_LEAST_ALBEDO = 0.003


@dataclass(frozen=True)
class Bases:
    """Avatars that ship, to begin with.

    Attributes:
        models: by the melanin of their skin.
        family: of skins between them.
    """

    models: Mapping[float, PersonModel]
    family: ToneFamily

    @classmethod
    def of(cls, models: Iterable[PersonModel]) -> Bases:
        """Sort the models of a light and a deep skin, and of any between."""
        by_melanin = {_melanin(model): model for model in models}
        any_model = _nearest(by_melanin, FIRST_MELANIN)  # all have one mesh; it is made for those in use
        lightest, deepest = (by_melanin[melanin] for melanin in (min(by_melanin), max(by_melanin)))
        return cls(by_melanin, ToneFamily(*(_log_albedo(any_model, one.base_albedo) for one in (lightest, deepest))))

    def nearest(self, melanin: float) -> PersonModel:
        """Choose the model whose skin is nearest."""
        return _nearest(self.models, melanin)


def _nearest(models: Mapping[float, PersonModel], melanin: float) -> PersonModel:
    return models[min(models, key=lambda one: abs(one - melanin))]


def shaped(model: PersonModel, hand: PicturedHand) -> PersonModel:
    """Return the model in the hand's own shape, where it is known."""
    return model if hand.offset_m is None else model.with_offset(hand.offset_m)


def _melanin(model: PersonModel) -> float:
    surface = model.avatar.surface
    assert surface is not None
    return surface.person.melanin


def family_at_base(model: PersonModel) -> np.ndarray:
    """Return the logarithm [N, 3] of a base's albedo at the vertices of its surface."""
    return _log_albedo(model, model.base_albedo)


def _log_albedo(model: PersonModel, albedo: np.ndarray) -> np.ndarray:
    return np.log(model.at_detail(albedo).clip(_LEAST_ALBEDO))
