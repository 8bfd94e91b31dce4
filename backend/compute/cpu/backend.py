"""The numba backend: the stages of `compute.backend.RenderBackend` on the CPU, by compiled kernels."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...field.field import MlpField, PlaneField
from ...field.sampler import SamplerConfig
from ...geometry.mesh import Topology
from ...image.relighting import lit_image
from ...light.shadow_maps import point_shadows
from ...light.visibility import MAP_PX, ShadowMapPoints, visibility_transfer
from ..backend import Precision, RayRenderer
from ..kernels.records import ShadowPoints
from ..kernels.shadow import lit_share
from ..reference import ChunkedRayRenderer
from .decoder import decoder, decoder_inputs
from .fine_mesh import fine_mesh, seen_surface
from .fused_render import FusedRayRenderer
from .lighting import bounced, light_features, openness
from .part_edges import blended
from .places import skin_places
from .posing import local_rotations, posed_mesh, skin_motion
from .ray_hits import ray_hits
from .relighting import normals_at_steps, relit, shares_of_rays, smooth_enlarged_rays, view_directions
from .shade import shade
from .shadow_maps import look_up_by_kernel
from .shell import first_hit
from .skin_detail import detailed_image
from .superres import superres
from .surface_means import surface_means
from .surroundings import near_light
from .threads import in_parallel, on_all_threads, threads_of_frame
from .trace import trace


def lit_share_by_kernel(points: ShadowMapPoints, topology: Topology) -> Float[Tensor, "K V"]:
    """`light.visibility.lit_share_reference` by a kernel."""
    px, depth, lifted_px, lifted_depth = (values.numpy() for values in points[:4])
    arrays = ShadowPoints(px, depth, lifted_px, lifted_depth, np.float32(points.bias))
    faces, lit = topology.faces.numpy(), torch.empty(points.depth.shape)
    out = lit.numpy()
    in_parallel(lambda first, last: lit_share(arrays, faces, MAP_PX, first, last, out), len(lit))
    return lit


class NumbaBackend:
    """Equals `compute.reference.ReferenceBackend` on the CPU; it takes tensors that lie there only."""

    frames_at_once = 2

    threads_of_frame = staticmethod(threads_of_frame)
    skin_motion = staticmethod(skin_motion)
    posed_mesh = staticmethod(posed_mesh)
    local_rotations = staticmethod(local_rotations)
    visibility = staticmethod(partial(visibility_transfer, lit_share=lit_share_by_kernel))
    point_shadows = staticmethod(partial(point_shadows, look_up=look_up_by_kernel))
    first_hit = staticmethod(first_hit)
    openness = staticmethod(openness)
    light_features = staticmethod(light_features)
    skin_places = staticmethod(skin_places)
    bounced = staticmethod(bounced)
    near_light = staticmethod(near_light)
    surface_means = staticmethod(surface_means)
    decoder = staticmethod(decoder)
    decoder_inputs = staticmethod(decoder_inputs)
    superres = staticmethod(superres)
    lit_image = staticmethod(
        partial(
            lit_image,
            enlarged=smooth_enlarged_rays,
            shares=shares_of_rays,
            normals=normals_at_steps,
            views=view_directions,
        )
    )
    fine_mesh = staticmethod(fine_mesh)
    seen_surface = staticmethod(seen_surface)
    ray_hits = staticmethod(ray_hits)
    detailed_image = staticmethod(detailed_image)
    relit = staticmethod(relit)
    blended = staticmethod(blended)
    trace = staticmethod(trace)
    shade = staticmethod(shade)

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """As the protocol; the paper's field is traced by the kernels and queried by torch."""
        if isinstance(field, PlaneField):
            return FusedRayRenderer(field, config, precision)
        return on_all_threads(ChunkedRayRenderer(self, field, config, precision))
