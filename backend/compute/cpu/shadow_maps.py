"""`light.shadow_maps.look_up_reference` by the kernels."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...light.shadow_maps import PointShadows, ShadowScene
from ..kernels.records import ShadowCasters
from ..kernels.shadow import look_up_points
from .threads import in_parallel


def look_up_by_kernel(scene: ShadowScene, points: Float[Tensor, "P 3"]) -> PointShadows:
    """Make the maps of one view after the other and compare each point with the four nearest pixels."""
    tensors = (*scene.views, scene.vertices.T, scene.faces, scene.others.T)
    arrays = (values.contiguous().numpy() for values in tensors)
    lengths = map(np.float32, (scene.tolerance, scene.contact, scene.max_depth_in, scene.template_m))
    others = np.arange(len(scene.others)).reshape(-1, 3)
    casters = ShadowCasters._make((*arrays, others, scene.map_px, *lengths))
    shape, places = (len(scene.views.distance), len(points)), points.T.contiguous().numpy()
    shadows = PointShadows(torch.empty(shape), torch.empty(shape))
    lit, depth_in = (values.numpy() for values in shadows)
    in_parallel(lambda first, last: look_up_points(casters, places, first, last, lit, depth_in), len(lit))
    return shadows
