"""Distances between what a network sees in two pictures, for which the user brings the weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .metrics import Similarity

_MARGIN_PX = 16


class Distance(NamedTuple):
    """A column's name, and the distance of two pictures [1, 3, H, W], sRGB-encoded in [0, 1]."""

    name: str
    between: Callable[[Tensor, Tensor], Tensor]


@torch.inference_mode()
def distance_of(
    distance: Distance, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]
) -> Similarity:
    """Distance of the whole image, and of the hand's crop (its bounding box and 16 px around, within the image)."""
    a, b = (x.permute(2, 0, 1)[None].float() for x in (image, truth))
    box = _hand_box(hand)
    return Similarity(float(distance.between(a, b)), float(distance.between(a[..., *box], b[..., *box])))


def _hand_box(hand: Bool[Tensor, "H W"]) -> tuple[slice, slice]:
    rows, columns = (hand.any(axis).nonzero() for axis in (1, 0))
    return _around(rows), _around(columns)


def _around(places: Tensor) -> slice:
    return slice(max(int(places[0]) - _MARGIN_PX, 0), int(places[-1]) + 1 + _MARGIN_PX)
