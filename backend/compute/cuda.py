"""Torch on the GPU; shadow maps on the CPU, where launching hundreds of small ones does not dominate."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from ..light.shadow_maps import PointShadows, ShadowScene, ShadowViews
from .reference import ReferenceBackend


class CudaBackend(ReferenceBackend):
    """Has the reference's values on a GPU, beside a CPU whose backend makes shadow maps."""

    def __init__(self, cpu: ReferenceBackend) -> None:
        self._cpu = cpu

    def look_up(self, scene: ShadowScene, map_points: Float[Tensor, "P 3"]) -> PointShadows:
        """Look up shadows as the CPU does, of what lies on any device."""
        here = scene._replace(
            views=ShadowViews(*(values.cpu() for values in scene.views)),
            vertices=scene.vertices.cpu(),
            faces=scene.faces.cpu(),
            others=scene.others.cpu(),
        )
        return PointShadows(*(values.to(map_points.device) for values in self._cpu.look_up(here, map_points.cpu())))
