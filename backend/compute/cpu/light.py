"""Light by kernels, no gradients: `light.{indirect_diffuse, lighting, shadow_maps, near_field_light, visibility}`."""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...geometry.mesh import PosedMesh, Topology
from ...light.brdf import INDEX, NAIL_ROUGHNESS, ROUGHNESS, SKIN_ROUGHNESS
from ...light.indirect_diffuse import MeshPoints, Surfels
from ...light.lighting import (
    BELOW_HORIZON,
    SCATTER_M,
    SCATTERED_SCALE,
    SKY_CELL_RAD,
    WRAP,
    AmbientOcclusion,
    DirectFeatures,
    FrameShadows,
    LightFeatures,
    SurfacePoints,
)
from ...light.near_field_light import CELLS, NearFieldFeatures, sky_cells
from ...light.nearby_geometry import Patches
from ...light.samples import LightSamples
from ...light.shadow_maps import PointShadows, ShadowScene
from ...light.sky_samples import SkySamples
from ...light.visibility import MAP_PX, ShadowMapPoints
from ..kernels.brdf import Lobes
from ..kernels.light import FeatureArrays, LampArrays, PointArrays, SkyArrays, SurfelArrays, indirect
from ..kernels.light import ambient_occlusion as fill_ambient_occlusion
from ..kernels.light import light_features as fill_features
from ..kernels.nearby import NearArrays, PatchArrays
from ..kernels.nearby import near_field_light as fill_near_light
from ..kernels.shadow import ShadowCasters, ShadowPoints, look_up_points
from ..kernels.shadow import lit_share as fill_lit_share
from ..kernels.surface import mesh_points as fill_points
from ..reference import ReferenceBackend
from .arrays import as_arrays, whole_rows
from .threads import in_parallel


def light_features(light: LightSamples, shadows: FrameShadows, points: SurfacePoints) -> LightFeatures:
    """Compute the light features of points."""
    sky, lamps = light
    count = len(points.position)
    vectors, of_sky, seen, scattered = (
        torch.zeros(count, *shape) for shape in ((len(lamps.rgb), 3), (3, 3), (2,), (2, 3))
    )
    out = FeatureArrays(*as_arrays(vectors, of_sky, seen, scattered))
    arrays = PointArrays(*as_arrays(*points[:-1]))
    of_sky_cells = as_arrays(sky.towards, sky.flux, sky.brightness, sky.share)
    sky_arrays = SkyArrays(*of_sky_cells, *(whole_rows(values) for values in shadows.sky))
    lamp_arrays = LampArrays(*as_arrays(*lamps[:-1], *shadows.lamps))
    in_parallel(lambda first, last: fill_features(arrays, sky_arrays, lamp_arrays, lobes(), first, last, out), count)
    return DirectFeatures(vectors, of_sky, seen, scattered).with_indirect(
        light, shadows.surfels, points, indirect_diffuse
    )


def indirect_diffuse(
    position: Float[Tensor, "R 3"], normal: Float[Tensor, "R 3"], surfels: Surfels, emitted: Float[Tensor, "P 3"]
) -> Float[Tensor, "R 3"]:
    """Compute indirect diffuse light, as `light.indirect_diffuse.indirect_diffuse`."""
    arrays = SurfelArrays(*as_arrays(surfels.position.T, surfels.normal.T, surfels.area_m2, emitted.T))
    at, unit, received = as_arrays(position, normal, torch.empty(len(position), 3))
    in_parallel(lambda first, last: indirect(at, unit, arrays, first, last, received), len(position))
    return torch.as_tensor(received)


def ambient_occlusion(sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> AmbientOcclusion:
    """Compute the ambient occlusion of points with these normals."""
    found = AmbientOcclusion(torch.empty(len(normal)), torch.empty(len(normal), 3))
    (towards, normals, share, mean), lit = as_arrays(sky.towards, normal.T, *found), whole_rows(shadows.lit)
    in_parallel(
        lambda first, last: fill_ambient_occlusion(towards, normals, lit, first, last, share, mean), len(normal)
    )
    return found


@cache
def lobes() -> Lobes:
    """Return the constants of the glossy lobes and of light in the skin."""
    constants = (np.array(values, np.float32) for values in (SCATTER_M, WRAP, SCATTERED_SCALE, np.square(ROUGHNESS)))
    numbers = NAIL_ROUGHNESS**2, SKY_CELL_RAD, INDEX**2, BELOW_HORIZON, SKIN_ROUGHNESS**4
    return Lobes._make((*constants, *(np.float32(value) for value in numbers)))


def mesh_points(
    mesh: PosedMesh, faces: Int[Tensor, "F 3"], face: Int[Tensor, " R"], position: Float[Tensor, "R 3"]
) -> MeshPoints:
    """Locate points on the mesh, as `light.indirect_diffuse.MeshPoints.of`; face -1 is none."""
    count = len(face)
    hit_points = MeshPoints(torch.empty(count, 3, dtype=faces.dtype), torch.empty(count, 3))
    arrays = as_arrays(mesh.vertices, faces, face.int(), position)  # the kernel is compiled for one type
    vertex, weight = (values.numpy() for values in hit_points)
    in_parallel(lambda first, last: fill_points(*arrays, first, last, vertex, weight), count)
    return hit_points


def look_up(scene: ShadowScene, map_points: Float[Tensor, "P 3"]) -> PointShadows:
    """Look up shadows, as `light.shadow_maps.look_up_reference`: makes the maps of one view after the other."""
    tensors = (*scene.views, scene.vertices.T, scene.faces, scene.others.T)
    arrays = (values.contiguous().numpy() for values in tensors)
    lengths = map(np.float32, (scene.tolerance, scene.contact, scene.max_depth_in, scene.template_m))
    others = np.arange(len(scene.others)).reshape(-1, 3)
    casters = ShadowCasters._make((*arrays, others, scene.map_px, *lengths))
    shape, points = (len(scene.views.distance), len(map_points)), map_points.T.contiguous().numpy()
    shadows = PointShadows(torch.empty(shape), torch.empty(shape))
    lit, depth_in = (values.numpy() for values in shadows)
    in_parallel(lambda first, last: look_up_points(casters, points, first, last, lit, depth_in), len(lit))
    return shadows


def near_field_light(
    patches: Patches, sky_visibility: PointShadows, emitted: Float[Tensor, "P 3"], points: SurfacePoints
) -> NearFieldFeatures:
    """Compute near-field light, as `light.near_field_light.near_field_light`."""
    count = len(points.position)
    found = NearFieldFeatures(*(torch.empty(count, *shape) for shape in ((3, 3), (2, 3), (2, 3))))
    out, at = NearArrays(*(values.numpy() for values in found)), PointArrays(*as_arrays(*points[:-1]))
    shapes = as_arrays(patches.position.T, patches.normal.T, patches.area_m2, emitted.T, sky_visibility.lit.T)
    nearest, weights = sky_cells(emitted.device)
    cells, weights = nearest.numpy().astype(np.int32), weights.numpy()
    arrays = PatchArrays(*shapes, sky_cell=cells, sky_weight=weights, cells=CELLS)
    in_parallel(lambda first, last: fill_near_light(at, arrays, lobes(), first, last, out), count)
    return found


def lit_share(points: ShadowMapPoints, topology: Topology) -> Float[Tensor, "K V"]:
    """Compute lit shares, as `light.visibility.lit_share_reference`."""
    px, depth, lifted_px, lifted_depth = (values.numpy() for values in points[:4])
    arrays = ShadowPoints(px, depth, lifted_px, lifted_depth, np.float32(points.bias))
    faces, lit = topology.faces.numpy(), torch.empty(points.depth.shape)
    out = lit.numpy()
    in_parallel(lambda first, last: fill_lit_share(arrays, faces, MAP_PX, first, last, out), len(lit))
    return lit


class LightKernels(ReferenceBackend):
    """Light by kernels."""

    lit_share = staticmethod(lit_share)
    look_up = staticmethod(look_up)
    ambient_occlusion = staticmethod(ambient_occlusion)
    light_features = staticmethod(light_features)
    mesh_points = staticmethod(mesh_points)
    indirect_diffuse = staticmethod(indirect_diffuse)
    near_field_light = staticmethod(near_field_light)
