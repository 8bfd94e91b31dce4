"""A capture's poses as meshes, each posed when it is first asked for."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..capture import Capture, CaptureView
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..hand.lbs import SkinTensors, pose_hand
from ..hand.model import HandModel
from ..rays import view_of
from ..shot import HandPose, Side
from .seen_surface import SeenSurface, seen_surface, vertex_openness


class _Posed(NamedTuple):
    topology: Topology
    mesh: PosedMesh
    openness: Tensor


class PosedHands:
    """The capture's hand in each of its poses."""

    def __init__(self, hand: HandModel, capture: Capture):
        self.hand, self.poses = hand, capture.poses
        self._topologies: dict[Side, Topology] = {}
        self._posed: dict[int, _Posed] = {}

    @cached_property
    def vertices(self) -> list[np.ndarray]:
        """[V, 3] m, world, of each pose."""
        return [posed_vertices(self.hand, pose) for pose in self.poses]

    @cached_property
    def centres(self) -> Float[np.ndarray, "P 3"]:
        """Mean vertex of each pose, m, world."""
        return np.array([vertices.mean(0) for vertices in self.vertices])

    def seen_by(self, view: CaptureView) -> SeenSurface:
        """The posed mesh as a view sees it."""
        posed = self._posed_mesh(view.pose_index)
        return seen_surface(posed.mesh, posed.topology, posed.openness, view_of(view.camera, "cpu"))

    def _posed_mesh(self, index: int) -> _Posed:
        if index not in self._posed:
            side = self.poses[index].side
            if side not in self._topologies:
                self._topologies[side] = Topology.of(self.hand.for_side(side))
            topology = self._topologies[side]
            mesh = posed_mesh(topology, torch.as_tensor(self.vertices[index], dtype=torch.float32))
            self._posed[index] = _Posed(topology, mesh, vertex_openness(mesh, topology))
        return self._posed[index]


def posed_vertices(hand: HandModel, pose: HandPose) -> np.ndarray:
    """[V, 3] m, world."""
    skin = SkinTensors.of(hand.for_side(pose.side), dtype=torch.float64)
    parameters = (torch.as_tensor(value, dtype=torch.float64) for value in (pose.theta, pose.beta, pose.transl))
    return pose_hand(skin, *parameters).vertices.numpy()
