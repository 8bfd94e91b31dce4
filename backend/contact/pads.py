"""Pads that flatten where they press: skin inside a thing is moved to its surface, and its neighbours a little.

How far skin is moved is how hard it presses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..hand.lbs import SkinTensors, posed_vertices, skin_motion
from ..hand.model import HandModel
from ..records.shot import HandPose
from .placed_solids import PlacedSolid, Solids

_SOFT_M = 0.0004  # over which free skin becomes pressed skin
_NEAR_M = 0.003
_MOST_M = 0.003  # skin that is deeper does not flatten: it passes through


@dataclass(frozen=True)
class FlatPads:
    """How a model's V vertices yield in a pose.

    Attributes:
        offsets: [V, 3] m, in the hand's space.
        rest_offsets: [V, 3] m, of the unposed skin, which skinning turns into `offsets`.
        pressed_m: [V] how far.
    """

    offsets: np.ndarray
    rest_offsets: np.ndarray
    pressed_m: np.ndarray


def flat_pads(model: HandModel, pose: HandPose, things: Sequence[PlacedSolid]) -> FlatPads:
    """Flatten a posed hand of either side on things in its own space; the arm does not yield."""
    own = model.for_side(pose.side)
    vertices, found = posed_vertices(own, pose), np.flatnonzero(own.arm_weights == 0)
    distances = Solids(things).distances(vertices[found])
    signed = distances.signed_m
    yields = (signed < _NEAR_M) & (signed > -_MOST_M)
    pressed = np.zeros(len(vertices))
    # A smooth maximum of the distance and zero is the new distance.
    pressed[found[yields]] = (np.hypot(signed, _SOFT_M) - signed)[yields] / 2
    offsets = np.zeros_like(vertices)
    offsets[found] = pressed[found, None] * distances.outward
    transforms = skin_motion(SkinTensors.of(own), pose).transforms[..., :3].double().numpy()
    return FlatPads(offsets, np.linalg.solve(transforms, offsets[..., None])[..., 0], pressed)
