"""The feature planes of an avatar, carried over to another hand model's atlas by nearest places of the two surfaces.

Both templates must lie over each other, as two versions of a hand do. What the new surface has beside the old one gets
the features of the old one's nearest place.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..field.encoding import FeaturePlane
from ..field.field import PlaneField
from ..hand.model import HandModel
from ..records.errors import LiveHandError

_SAMPLES = 1_000_000
_FARTHEST_MEDIAN_M = 0.003


def transfer_planes(ours: PlaneField, hand: HandModel, theirs: PlaneField, their_hand: HandModel) -> None:
    """Fill the planes of `ours`, relief included, with those of `theirs`.

    Raises:
        LiveHandError: the templates do not lie over each other, or the planes differ.
    """
    own, others = (*ours.feature_planes, ours.relief), (*theirs.feature_planes, theirs.relief)
    if [(plane.heights, plane.channels) for plane in own] != [(plane.heights, plane.channels) for plane in others]:
        raise LiveHandError("planes can be carried over between equal configurations only; choose the same --config")
    rng = np.random.default_rng(0)
    place, uv = _samples(hand, rng)
    their_place, their_uv = _samples(their_hand, rng)
    distance, nearest = KDTree(their_place).query(place)
    if np.median(distance) > _FARTHEST_MEDIAN_M:
        raise LiveHandError(
            f"the hand of the avatar to start from must lie over '{hand.name}', got one whose surface is "
            f"{1000 * np.median(distance):.0f} mm away; start without --from"
        )
    to, at = (torch.as_tensor(value, dtype=torch.float32) for value in (uv, their_uv[nearest]))
    with torch.no_grad():
        for plane, source in zip(own, others, strict=True):
            _fill(plane, source, to, at)


def _samples(hand: HandModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random places [N, 3] m of the template's surface, uniform by area, and their atlas coordinates [N, 2]."""
    corners = hand.v_template[hand.f]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = rng.choice(len(area), _SAMPLES, p=area / area.sum())
    weights = rng.dirichlet((1, 1, 1), _SAMPLES)
    place = np.einsum("nk,nkc->nc", weights, corners[face])
    return place, np.einsum("nk,nkc->nc", weights, hand.vt[hand.ft[face]])


def _fill(plane: FeaturePlane, source: FeaturePlane, to: Tensor, at: Tensor) -> None:
    """Each texel gets the mean over its samples; those without samples, between the charts, that of the nearest."""
    size = plane.resolution
    column, row = (to * size).long().clamp(0, size - 1).unbind(-1)
    texel = row * size + column
    count = torch.zeros(size * size).index_add(0, texel, torch.ones(len(texel)))
    is_filled = (count > 0).numpy()
    grid = np.stack(np.divmod(np.arange(size * size), size), -1)
    nearest = torch.as_tensor(np.flatnonzero(is_filled)[KDTree(grid[is_filled]).query(grid)[1]])
    table = plane.table.view(size * size, plane.heights, plane.channels)
    for layer in range(plane.heights):
        height = torch.full((len(at),), -1.0 + 2.0 * layer / max(plane.heights - 1, 1))
        values = source(at, height, torch.ones(len(at)))
        mean = torch.zeros(size * size, plane.channels).index_add(0, texel, values) / count.clamp(min=1)[:, None]
        table[:, layer] = mean[nearest]
