"""Torch on a GPU, but for shadow maps: hundreds of small ones, which a GPU spends its time starting and not making."""

from __future__ import annotations

from functools import partial

from jaxtyping import Float
from torch import Tensor

from ...light.shadow_maps import LightViews, PointShadows, ShadowScene, point_shadows
from ..reference import ReferenceBackend
from .shadow_maps import look_up_by_kernel


def look_up_beside_gpu(scene: ShadowScene, points: Float[Tensor, "P 3"]) -> PointShadows:
    """`look_up_by_kernel` on the CPU, of what lies on any device."""
    here = scene._replace(
        views=LightViews(*(values.cpu() for values in scene.views)),
        vertices=scene.vertices.cpu(),
        faces=scene.faces.cpu(),
        others=scene.others.cpu(),
    )
    return PointShadows(*(values.to(points.device) for values in look_up_by_kernel(here, points.cpu())))


class GpuBackend(ReferenceBackend):
    """Equals `compute.reference.ReferenceBackend`, on a GPU beside a CPU with numba."""

    point_shadows = staticmethod(partial(point_shadows, look_up=look_up_beside_gpu))
