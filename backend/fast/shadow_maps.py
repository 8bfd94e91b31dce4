"""`geometry.shadow_maps.look_up_reference` by the kernels."""

from __future__ import annotations

import numpy as np
import torch

from ..geometry.shadow_maps import PointShadows, ProjectedPoints, ShadowScene
from .kernels.compiled import in_parallel
from .kernels.records import ShadowCasters
from .kernels.shadow import look_up_points


def look_up_by_kernel(scene: ShadowScene, points: ProjectedPoints) -> PointShadows:
    """Make the maps of one view after the other and compare each point with the four nearest pixels."""
    others = np.arange(scene.others.depth.shape[1]).reshape(-1, 3)
    arrays = (values.contiguous().numpy() for values in (*scene.mesh, scene.faces, *scene.others))
    lengths = (np.float32(value) for value in (scene.tolerance, scene.contact, scene.max_depth_in))
    casters = ShadowCasters._make((*arrays, others, scene.map_px, *lengths))
    px, depth = (values.contiguous().numpy() for values in points)
    shadows = PointShadows(torch.empty(points.depth.shape), torch.empty(points.depth.shape))
    lit, depth_in = (values.numpy() for values in shadows)
    in_parallel(
        lambda first, last: look_up_points(casters, px, depth, first, last, lit, depth_in),
        len(lit),
        torch.get_num_threads(),
    )
    return shadows
