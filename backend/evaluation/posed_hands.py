"""The meshes of a capture's poses, each computed at its first use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..capture.capture import CaptureView
from ..field.rays import camera_tensors
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..hand.model import HandModel
from ..hand.topology import topology_of
from ..records.side import Side
from .seen_surface import SeenSurface, seen_surface, vertex_openness


class _Posed(NamedTuple):
    topology: Topology
    mesh: PosedMesh
    openness: Tensor


class PosedHands:
    """The hand of a capture in each of its poses.

    Args:
        hand: the model, of either side.
        sides: the side of each pose.
        vertices: of each pose, [V, 3] m, world.
    """

    def __init__(self, hand: HandModel, sides: Sequence[Side], vertices: Sequence[np.ndarray]):
        self._hand, self._sides, self._vertices = hand, sides, vertices
        self._topologies: dict[Side, Topology] = {}
        self._posed: dict[int, _Posed] = {}

    def seen_by(self, view: CaptureView) -> SeenSurface:
        """Look at the posed mesh as a view does."""
        posed = self._posed_mesh(view.pose_index)
        return seen_surface(posed.mesh, posed.topology, posed.openness, camera_tensors(view.camera, "cpu"))

    def _posed_mesh(self, index: int) -> _Posed:
        if index not in self._posed:
            side = self._sides[index]
            if side not in self._topologies:
                self._topologies[side] = topology_of(self._hand.for_side(side))
            topology = self._topologies[side]
            mesh = posed_mesh(topology, torch.as_tensor(self._vertices[index], dtype=torch.float32))
            self._posed[index] = _Posed(topology, mesh, vertex_openness(mesh, topology))
        return self._posed[index]
