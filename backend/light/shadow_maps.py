"""Shadows at points on a mesh: how much light reaches them from a direction, and how deep they lie behind the surface.

A shadow map holds, per pixel, where light enters the mesh and where it leaves it. A point is lit if it lies before the
middle of the two (Woo 1992, "The shadow depth map revisited"), so that a surface neither shadows itself nor leaks light
where parts touch, without a bias that would depend on the angle; and no more than a few of the map's pixels behind
where light enters: the middle of a finger that points at a lamp lies deep in it. Other triangles block light where they
begin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..geometry.mesh import PosedMesh
from ..geometry.rasterise import Fragments, rasterise
from ..geometry.tolerances import LEAST_SQUARED, LEAST_WINDOW, STEEPEST

MAX_DEPTH_IN_M = 0.025
"""Depths behind the surface are measured up to this, template metres; no light passes through more skin."""
FAR = 1000.0
"""Distance of parallel light, in radii of the mesh: its rays are then parallel to 0.1 degrees."""
CELL_MAP_PX, SKY_MAP_PX, LAMP_MAP_PX, SOFT_MAP_PX, SURFEL_MAP_PX = 40, 64, 256, 192, 64
"""Sides of the shadow maps of one cell of the sky; of one part of a cell, or of a cell at patches; and of one sample of
a lamp: at rays and patches; at rays, of a lamp whose shadows are too soft to show their pixels; at surfels."""
# Where light grazes, smooth normals face it on faces that do not; the middle of the mesh is far enough to allow for it.
_GRAZING_M = 0.001
# An object in contact with the skin touches a mesh that is coarser than both; template metres.
_CONTACT_M = 0.001


class Bounds(NamedTuple):
    """A sphere around a mesh: centre [3] m, radius [] m."""

    centre: Tensor
    radius: Tensor

    @classmethod
    def of(cls, mesh: PosedMesh) -> Bounds:
        """Return the sphere about the mean vertex."""
        return cls.around(mesh.vertices)

    @classmethod
    def around(cls, vertices: Float[Tensor, "V 3"]) -> Bounds:
        """Return the sphere about the mean of vertices."""
        centre = vertices.mean(0)
        return cls(centre, (vertices - centre).norm(dim=-1).amax())


class ShadowViews(NamedTuple):
    """K views of a mesh from its light.

    Attributes:
        frames: [K, 3, 3] rows: right, down, and towards the light, world.
        distance: [K] from the centre of the bounds, in radii; `FAR` for parallel light.
    """

    frames: Tensor
    distance: Tensor

    @classmethod
    def along(cls, towards: Float[Tensor, "K 3"], distance: Float[Tensor, " K"]) -> ShadowViews:
        """Make the views from these unit directions."""
        least = torch.nn.functional.one_hot(towards.abs().argmin(-1), 3).to(towards.dtype)
        right = torch.nn.functional.normalize(torch.linalg.cross(least, towards), dim=-1)
        return cls(torch.stack([right, torch.linalg.cross(right, towards), towards], 1), distance)

    def chosen(self, which: Int[Tensor, " N"]) -> ShadowViews:
        """Select views by index."""
        return ShadowViews(self.frames[which], self.distance[which])


class PointShadows(NamedTuple):
    """What P points receive from K views.

    Attributes:
        lit: [K, P] share of the nearby map pixels in which the point is lit.
        depth_in_m: [K, P] depth behind the surface that faces the light, template metres, 0 to `MAX_DEPTH_IN_M`, which
            also stands for points behind other triangles.
    """

    lit: Tensor
    depth_in_m: Tensor


class MapWindows(NamedTuple):
    """The part of each of K views that its map shows, in radii at the distance of the centre.

    Attributes:
        centre: [K, 2].
        px_per_radius: [K, 2].
    """

    centre: Tensor
    px_per_radius: Tensor

    @classmethod
    def around(cls, points: Float[Tensor, "P 3"], views: ShadowViews, map_px: int) -> MapWindows:
        """Fit windows that just hold these points: whatever shadows them lies within, before or behind.

        Maps so become as fine as what is seen of the mesh is small. A window's border of a pixel holds no point.
        """
        distance = views.distance[:, None]
        reach = distance / (distance**2 - 1).clamp(min=LEAST_SQUARED).sqrt()  # of the unit sphere
        if len(points) == 0:
            return cls(torch.zeros_like(views.frames[:, 0, :2]), ((map_px / 2 - 1) / reach).expand(-1, 2))
        across, depth = _across(points, views)
        across = torch.where((depth > 0)[..., None], across, 0).clamp(-reach[..., None], reach[..., None])
        least, most = across.amin(1), across.amax(1)
        half = ((most - least) / 2).clamp(min=LEAST_WINDOW)
        return cls((least + most) / 2, (map_px / 2 - 1) / half)


class ProjectedPoints(NamedTuple):
    """Points in K shadow maps: px [K, P, 2], depth [K, P] in radii."""

    px: Tensor
    depth: Tensor


class ShadowScene(NamedTuple):
    """What casts shadows, seen in K views by maps of `map_px` pixels a side; lengths are in radii, from the centre.

    Attributes:
        views: from the light.
        vertices: [V, 3] of the mesh.
        faces: [F, 3] of the mesh.
        others: [3 T, 3] corners of other triangles.
        map_px: width and height of a map.
        tolerance: by which a point may lie behind the middle of the mesh.
        contact: by which it may lie behind another triangle.
        max_depth_in: of `PointShadows`.
        template_m: of a radius.
    """

    views: ShadowViews
    vertices: Tensor
    faces: Tensor
    others: Tensor
    map_px: int
    tolerance: float
    contact: float
    max_depth_in: float
    template_m: float


ShadowLookup = Callable[[ShadowScene, Tensor], PointShadows]
"""(scene, points [P, 3] in radii from the centre) -> their shadows, by maps around these points."""


def point_shadows(
    mesh: PosedMesh,
    faces: Int[Tensor, "F 3"],
    occluders: Float[Tensor, "T 3 3"],
    views: ShadowViews,
    points: Float[Tensor, "P 3"],
    map_px: int,
    bounds: Bounds | None = None,
    look_up: ShadowLookup | None = None,
) -> PointShadows:
    """Compute the shadows at points on or near a mesh.

    Args:
        mesh: a closed surface.
        faces: of the mesh.
        occluders: corners of other triangles that cast shadows on it, world, m.
        views: from the light.
        points: world, m.
        map_px: width and height of a shadow map.
        bounds: around the points, about whose centre the views are; None: of the mesh.
        look_up: makes the maps and compares the points with them; None: `look_up_reference`.
    """
    bounds = bounds or Bounds.of(mesh)
    tolerance, contact, max_depth_in, template_m = scene_lengths(float(mesh.scale / bounds.radius))
    vertices, others, local = ((at - bounds.centre) / bounds.radius for at in (mesh.vertices, occluders, points))
    scene = ShadowScene(
        views=views,
        vertices=vertices,
        faces=faces,
        others=others.reshape(-1, 3),
        map_px=map_px,
        tolerance=tolerance,
        contact=contact,
        max_depth_in=max_depth_in,
        template_m=template_m,
    )
    return (look_up or look_up_reference)(scene, local)


def scene_lengths(in_template: float) -> tuple[float, float, float, float]:
    """Compute tolerance, contact, max_depth_in and template_m of `ShadowScene`; `in_template`: radii of a metre."""
    return _GRAZING_M * in_template, _CONTACT_M * in_template, MAX_DEPTH_IN_M * in_template, 1 / in_template


def projected(points: Float[Tensor, "P 3"], scene: ShadowScene, windows: MapWindows) -> ProjectedPoints:
    """Project points into the scene's maps."""
    across, depth = _across(points, scene.views)
    centre, px_per_radius = windows
    return ProjectedPoints((across - centre[:, None]) * px_per_radius[:, None] + scene.map_px / 2, depth)


def _across(points: Float[Tensor, "P 3"], views: ShadowViews) -> tuple[Float[Tensor, "K P 2"], Float[Tensor, "K P"]]:
    """Find where the rays through points cross the plane of the centre, and the points' depths."""
    local = torch.einsum("kij,pj->kpi", views.frames, points)
    distance = views.distance[:, None]
    depth = distance - local[..., 2]
    return local[..., :2] * (distance / torch.where(depth.abs() > 1e-6, depth, 1e-6))[..., None], depth


def look_up_reference(scene: ShadowScene, map_points: Float[Tensor, "P 3"]) -> PointShadows:
    """Compare each point with the four nearest pixels of each map, bilinearly; points outside a map are lit."""
    if not len(scene.views.distance):
        return PointShadows(map_points.new_zeros(0, len(map_points)), map_points.new_zeros(0, len(map_points)))
    windows = MapWindows.around(map_points, scene.views, scene.map_px)
    entry, blocker = _maps(scene, windows)
    points = projected(map_points, scene, windows)
    position = points.px - 0.5
    is_inside = ((position >= 0) & (position < scene.map_px - 1)).all(-1) & (points.depth > 0)
    position = torch.where(is_inside[..., None], position, torch.zeros_like(position))
    first = position.floor()
    share = position - first
    column, row = first.long().unbind(-1)
    lit, depth_in = torch.zeros_like(points.depth), torch.zeros_like(points.depth)
    for dy, weight_y in ((0, 1 - share[..., 1]), (1, share[..., 1])):
        for dx, weight_x in ((0, 1 - share[..., 0]), (1, share[..., 0])):
            pixel = (row + dy) * scene.map_px + column + dx
            weight = weight_x * weight_y
            lit = lit + weight * (points.depth <= blocker.gather(1, pixel) + scene.tolerance)
            begins = entry.gather(1, pixel)
            behind = (points.depth - begins).clamp(-scene.max_depth_in, scene.max_depth_in)
            is_skin = begins < torch.inf
            depth_in = depth_in + weight * torch.where(is_skin, behind, 0)
    outside = ~is_inside
    return PointShadows(
        torch.where(outside, torch.ones_like(lit), lit),
        scene.template_m * torch.where(outside, torch.zeros_like(depth_in), depth_in.clamp(min=0)),
    )


def _maps(scene: ShadowScene, windows: MapWindows) -> tuple[Float[Tensor, "K M"], Float[Tensor, "K M"]]:
    """Compute, per map pixel, the depth at which light enters the mesh (minus infinity: blocked) and where it ends."""
    count = len(scene.views.distance)
    fragments = _fragments(projected(scene.vertices, scene, windows), scene.faces, scene.map_px)
    size = count * scene.map_px**2
    entry = _nearest(fragments, fragments.is_front, size)
    leaving = _nearest(fragments, ~fragments.is_front, size)
    most = (STEEPEST / windows.px_per_radius.amin(1)).repeat_interleave(scene.map_px**2)
    middle = torch.where(leaving.isfinite(), entry + torch.minimum((leaving - entry) / 2, most), entry)
    corners = torch.arange(len(scene.others), device=entry.device).reshape(-1, 3)
    others = _fragments(projected(scene.others, scene, windows), corners, scene.map_px)
    other = _nearest(others, torch.ones_like(others.is_front), size) + scene.contact
    is_blocked = other < entry
    entry = torch.where(is_blocked, -torch.inf, entry)
    return entry.reshape(count, -1), torch.minimum(middle, other).reshape(count, -1)


def _fragments(points: ProjectedPoints, faces: Tensor, map_px: int) -> Fragments:
    """Rasterise the fragments of all maps; pixels count on from map to map."""
    fragments = []
    for index in range(len(points.depth)):
        one = rasterise(points.px[index], points.depth[index], faces, (map_px, map_px))
        fragments.append(one._replace(pixel=one.pixel + index * map_px**2))
    return Fragments(*(torch.cat(values) for values in zip(*fragments, strict=True)))


def _nearest(fragments: Fragments, which: Tensor, size: int) -> Float[Tensor, " M"]:
    nearest = fragments.depth.new_full((size,), torch.inf)
    return nearest.scatter_reduce(0, fragments.pixel[which], fragments.depth[which], "amin")
