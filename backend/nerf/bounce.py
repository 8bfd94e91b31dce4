"""Light that the hand sheds on itself: one bounce, from skin that is lit to skin that faces it.

The surface is taken for equal discs around some of its vertices, whose light is known. What a point receives from a
disc is the form factor of a small surface and a disc (Wallace et al. 1989, "A ray tracing algorithm for progressive
radiosity"); what stands between them is left out. Where skin nearly touches, discs are coarse: the factors' sum is at
most 1.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.mesh import PosedMesh, Topology

PROBES = 256
_LEAST_SQUARED_M = 1e-8


class Probes(NamedTuple):
    """P discs of skin.

    Attributes:
        position: [P, 3] m, world.
        normal: [P, 3] unit.
        area_m2: [] of each.
    """

    position: Tensor
    normal: Tensor
    area_m2: Tensor

    @classmethod
    def of(cls, mesh: PosedMesh, topology: Topology) -> Probes:
        """Discs around vertices all over the hand, which together have its area."""
        a, b, c = mesh.vertices[topology.faces].unbind(1)
        area_m2 = torch.linalg.cross(b - a, c - a).norm(dim=-1).sum() / 2
        chosen = probe_vertices(len(mesh.vertices)).to(a.device)
        return cls(mesh.vertices[chosen], mesh.normals[chosen], area_m2 / PROBES)


def probe_vertices(count: int) -> Tensor:
    """[P] which of a hand's vertices are probes."""
    return torch.linspace(0, count - 1, PROBES).round().long()


def bounced(
    position: Float[Tensor, "R 3"], normal: Float[Tensor, "R 3"], probes: Probes, shed: Float[Tensor, "P 3"]
) -> Float[Tensor, "R 3"]:
    """What points receive, as the radiance of a white diffuse surface there.

    Args:
        position: m, world.
        normal: unit.
        probes: the skin.
        shed: radiance of each probe.
    """
    offset = probes.position - position[:, None]
    squared = (offset * offset).sum(-1)
    here = (offset * normal[:, None]).sum(-1).clamp(min=0)
    there = -(offset * probes.normal).sum(-1).clamp(max=0)
    factors = here * there * probes.area_m2 / (squared.clamp(min=_LEAST_SQUARED_M) * (pi * squared + probes.area_m2))
    return factors @ shed / factors.sum(1, keepdim=True).clamp(min=1)
