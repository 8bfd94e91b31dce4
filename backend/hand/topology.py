"""A hand model as the tensors that rendering needs: its mesh topology and its skinning weights."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..geometry.mesh import Topology
from ..records.side import Side
from .model import MIRROR_POINT, HandModel


class Skinning(NamedTuple):
    """Which joints move which vertices.

    Attributes:
        lbs_weights: [V, 16].
        parents: [16] parent joint; -1 at the root.
    """

    lbs_weights: Tensor
    parents: Tensor

    @classmethod
    def of(cls, model: HandModel, device: torch.device | str = "cpu") -> Skinning:
        """Build the skinning of a model; both sides share it."""
        weights = torch.as_tensor(model.lbs_weights, dtype=torch.float32, device=device)
        return cls(weights, torch.as_tensor(model.parents, device=device))


def topology_of(model: HandModel, device: torch.device | str = "cpu", canonical_side: Side | None = None) -> Topology:
    """Build the mesh topology of a model.

    Args:
        model: of either side.
        device: of the tensors.
        canonical_side: the side that the avatar was trained on; None: the model's own.
    """
    mirror = None if canonical_side in (None, model.side) else MIRROR_POINT
    return Topology.of(model.v_template, model.f, model.vt[model.ft], device, mirror)
