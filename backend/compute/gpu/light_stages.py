"""Light, without gradients: as `light.{shadow_maps, visibility, lighting, indirect_diffuse, near_field_light}`."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...geometry.mesh import PosedMesh, Topology
from ...light.indirect_diffuse import MeshPoints, Surfels
from ...light.lighting import AmbientOcclusion, DirectFeatures, FrameShadows, LightFeatures, SurfacePoints
from ...light.near_field_light import NearFieldFeatures, sky_cells
from ...light.nearby_geometry import Patches
from ...light.samples import LightSamples
from ...light.shadow_maps import PointShadows, ShadowScene
from ...light.sky_samples import SkySamples
from ...light.visibility import MAP_PX, ShadowMapPoints
from ..reference import ReferenceBackend
from .kernels.compiled import INFINITE_BITS, lanes_of, launch
from .kernels.features import add_lamps, add_surfels, sky_features, sum_surfels
from .kernels.features import ambient_occlusion as fill_ambient_occlusion
from .kernels.features import mesh_points as fill_mesh_points
from .kernels.nearby import near_field_light as add_near_light
from .kernels.shadow import (
    draw_nearest,
    draw_occluders,
    draw_sides,
    fill_lit_share,
    find_bounds,
    project_casters,
)
from .kernels.shadow import look_up as fill_shadows

_MOST = torch.iinfo(torch.int32).max
_BOUND_PARTS, _SURFEL_PARTS = 32, 1  # times the lanes: threads of a view, and of a point


def look_up(scene: ShadowScene, map_points: Float[Tensor, "P 3"]) -> PointShadows:
    """Look up shadows, as `light.shadow_maps.look_up_reference`, in all views at once."""
    frames, distance = scene.views
    views, count, device = len(distance), len(map_points), map_points.device
    shadows = PointShadows(distance.new_empty(views, count), distance.new_empty(views, count))
    if not views:
        return shadows
    mesh = view_table(views, scene.map_px, count, len(scene.vertices), len(scene.faces), device)
    bounds, parts = torch.full((views, 4), _MOST, dtype=torch.int32, device=device), _parts(_BOUND_PARTS, device)
    spheres = distance.new_tensor(((0.0, 0.0, 0.0, 1.0),))
    launch(find_bounds, (views, parts), spheres, frames, distance, mesh, map_points, parts, bounds)
    maps = torch.full((views * 3 * scene.map_px**2,), INFINITE_BITS, dtype=torch.int32, device=device)
    placed = distance.new_empty(views, len(scene.vertices), 3)
    launch(project_casters, placed.shape[:2], spheres, frames, distance, mesh, bounds, scene.vertices, placed)
    launch(draw_sides, (views, len(scene.faces)), mesh, placed, scene.faces, maps)
    if triangles := len(scene.others) // 3:
        lanes = lanes_of(device)
        count_of = torch.tensor([triangles], dtype=torch.int32, device=device)
        others = scene.others, count_of, lanes, maps
        launch(draw_occluders, (views, triangles, lanes), spheres, frames, distance, mesh, bounds, *others)
    lengths = distance.new_tensor(((scene.tolerance, scene.contact, scene.max_depth_in, scene.template_m),))
    seen = spheres, frames, distance, mesh, map_points, bounds, maps, lengths
    launch(fill_shadows, (views, count), *seen, *shadows, distance.new_empty(0, count))
    return shadows


def view_table(
    views: int, map_px: int, points: int, vertices: int, faces: int, device: torch.device
) -> Int[Tensor, "K 10"]:
    """Make the table of views that share all points, vertices and faces."""
    table = torch.tensor([[map_px, 0, 0, points, 0, 0, vertices, 0, faces, 0]], dtype=torch.int32).repeat(views, 1)
    table[:, 1] = 3 * map_px**2 * torch.arange(views)
    return table.to(device)


def _parts(per_lane: int, device: torch.device) -> int:
    lanes = lanes_of(device)
    return 1 if lanes == 1 else per_lane * lanes


def lit_share(points: ShadowMapPoints, topology: Topology) -> Float[Tensor, "K V"]:
    """Compute lit shares, as `light.visibility.lit_share_reference`."""
    views, count = points.depth.shape
    placed, lifted = (
        torch.cat([px, depth[..., None]], -1)
        for px, depth in ((points.px, points.depth), (points.lifted_px, points.lifted_depth))
    )
    maps = torch.full((views, MAP_PX**2), INFINITE_BITS, dtype=torch.int32, device=placed.device)
    launch(draw_nearest, (views, len(topology.faces)), placed, topology.faces, MAP_PX, maps)
    lit = placed.new_empty(views, count)
    launch(fill_lit_share, (views, count), lifted, maps, MAP_PX, points.bias.reshape(1), lit)
    return lit


def light_features(light: LightSamples, shadows: FrameShadows, points: SurfacePoints) -> LightFeatures:
    """Compute the light features of points."""
    sky, lamps = light
    position, normal, relief_normal, view = points[:4]
    count = len(position)
    vectors = position.new_empty(count, len(lamps.rgb), 3)
    of_sky, seen, scattered = (position.new_empty(count, *shape) for shape in ((3, 3), (2,), (2, 3)))
    cells = sky.towards, sky.flux, sky.brightness, sky.share, *shadows.sky
    launch(sky_features, count, normal, relief_normal, view, *cells, of_sky, seen, scattered)
    of_lamps = *lamps[:-1], *shadows.lamps
    if len(lamps.lamp):
        launch(add_lamps, count, position, normal, relief_normal, *of_lamps, vectors, scattered)
    return DirectFeatures(vectors, of_sky, seen, scattered).with_indirect(
        light, shadows.surfels, points, indirect_diffuse
    )


def indirect_diffuse(
    position: Float[Tensor, "R 3"], normal: Float[Tensor, "R 3"], surfels: Surfels, emitted: Float[Tensor, "P 3"]
) -> Float[Tensor, "R 3"]:
    """Compute indirect diffuse light, as `light.indirect_diffuse.indirect_diffuse`."""
    count, parts = len(position), _parts(_SURFEL_PARTS, position.device)
    sums, received = position.new_empty(count, parts, 4), position.new_empty(count, 3)
    discs = surfels.position, surfels.normal, surfels.area_m2, emitted
    launch(add_surfels, (count, parts), position, normal, *discs, parts, sums)
    launch(sum_surfels, count, sums, received)
    return received


def ambient_occlusion(sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> AmbientOcclusion:
    """Compute the ambient occlusion of points with these normals."""
    found = AmbientOcclusion(normal.new_empty(len(normal)), normal.new_empty(len(normal), 3))
    launch(fill_ambient_occlusion, len(normal), sky.towards, normal, shadows.lit, *found)
    return found


def mesh_points(
    mesh: PosedMesh, faces: Int[Tensor, "F 3"], face: Int[Tensor, " R"], position: Float[Tensor, "R 3"]
) -> MeshPoints:
    """Locate points on the mesh, as `light.indirect_diffuse.MeshPoints.of`; face -1 is none."""
    found = MeshPoints(faces.new_empty(len(face), 3), position.new_empty(len(face), 3))
    launch(fill_mesh_points, len(face), mesh.vertices, faces, face.long(), position, *found)
    return found


def near_field_light(
    patches: Patches, sky_visibility: PointShadows, emitted: Float[Tensor, "P 3"], points: SurfacePoints
) -> NearFieldFeatures:
    """Compute near-field light, as `light.near_field_light.near_field_light`."""
    count = len(points.position)
    found = NearFieldFeatures(*(emitted.new_zeros(count, *shape) for shape in ((3, 3), (2, 3), (2, 3))))
    many = torch.tensor([len(patches.position)], dtype=torch.int32, device=emitted.device)
    around = (
        many,
        patches.position,
        patches.normal,
        patches.area_m2,
        emitted,
        sky_visibility.lit,
        *sky_cells(emitted.device),
    )
    launch(add_near_light, count, *points[:4], *around, *found)
    return found


class RadianceStages(ReferenceBackend):
    """Light by Warp."""

    look_up = staticmethod(look_up)
    lit_share = staticmethod(lit_share)
    ambient_occlusion = staticmethod(ambient_occlusion)
    light_features = staticmethod(light_features)
    indirect_diffuse = staticmethod(indirect_diffuse)
    mesh_points = staticmethod(mesh_points)
    near_field_light = staticmethod(near_field_light)
