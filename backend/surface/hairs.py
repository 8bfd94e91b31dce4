"""Hairs on a lit image: thin curves on the detail surface (`surface.hair_growth`), drawn over the skin in its light.

A hair is far thinner than a pixel: pixels take of it the area that it covers. It is lit as a fibre: as a diffuse
cylinder (Kajiya and Kay 1989), whose surface mirrors a cone of light (the R lobe of Marschner et al. 2003, normalised
as d'Eon et al. 2011 have it). The light is what arrives at the skin where the hair grows.
"""

from __future__ import annotations

from math import ceil, pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor
from torch.nn.functional import normalize

from ..field.rays import CameraTensors, project, ray_origin
from ..geometry.tolerances import NEAR_M
from ..image.maps import ray_of_pixel
from ..image.shading import ray_rows, with_ray_rows
from ..light.lighting import LightFeatures, sky_on
from .detail_mesh import DetailMesh, blend_corners
from .hair_growth import Hairs

SEGMENTS = 6
"""Pieces of a hair, each of which is lit by itself."""
STEP_PX = 0.8
"""Between the points that a piece is drawn as, at most."""
MOST_POINTS = 64
ABOVE_SKIN_M = 0.0002
"""Template metres that a hair may be behind the skin which its pixel shows: at its root it is in it."""
MIRRORED_RAD, REFLECTED = 0.15, 0.05
"""Deviation of the cone of mirrored light, by half vectors, and the share of light that a hair mirrors."""
ALBEDO = (0.06, 0.04, 0.028), (0.02, 0.015, 0.012)
"""Of diffuse light: brown hairs on light skin, black ones on deep."""
EVEN = 0.7
"""Of the light that falls on the skin evenly: half of what is around a hair is skin."""
LEAST_COSINE_SQUARED = 0.1
"""Of the angle to the plane across a hair: its cone grows without bound where light comes along it."""
_TINY = 1e-8


class PosedHairs(NamedTuple):
    """N hairs in a pose.

    Attributes:
        points: [N, S + 1, 3] m, world.
        normal: [N, 3] unit, of the skin at the root.
        radius_m: [N].
        albedo: [3].
        behind_m: [] as `ABOVE_SKIN_M`, world.
    """

    points: Tensor
    normal: Tensor
    radius_m: Tensor
    albedo: Tensor
    behind_m: Tensor

    @classmethod
    def of(cls, hairs: Hairs, mesh: DetailMesh, albedo: tuple[float, ...]) -> PosedHairs:
        """Pose the hairs on a surface."""

        def own(values: np.ndarray) -> Tensor:
            return torch.as_tensor(values).to(mesh.vertices)

        corners = torch.as_tensor(hairs.corners, device=mesh.faces.device)
        weights, corner_points = own(hairs.weights), mesh.vertices[corners]
        normal = normalize(blend_corners(mesh.normals[corners], weights), dim=-1)
        axes = torch.stack(
            [corner_points[:, 1] - corner_points[:, 0], corner_points[:, 2] - corner_points[:, 0], mesh.scale * normal],
            1,
        )
        rise, bend = ((own(way)[..., None] * axes).sum(1)[:, None] for way in (hairs.rise, hairs.bend))
        t = torch.linspace(0, 1, SEGMENTS + 1, device=axes.device)[:, None]
        points = blend_corners(corner_points, weights)[:, None] + t * rise + t * t * bend
        radius_m = mesh.scale * own(hairs.radius_m)
        return cls(points, normal, radius_m, points.new_tensor(albedo), ABOVE_SKIN_M * mesh.scale)


class VisibleHairs(NamedTuple):
    """What an image of H x W pixels shows of G pieces of hairs, in no light.

    Attributes:
        piece: [F] of each of F points on them.
        pixel: [F, 4] around it, row * W + column.
        area: [F, 4] that it covers of them, pixels.
        tangent, normal, view: [G, 3] unit, world: of the hair, of the skin at its root, and from the camera.
        ray: [G] from whose point the light is taken.
        albedo: [3].
        depth: [H, W] m, of the skin or of hairs beside it.
    """

    piece: Tensor
    pixel: Tensor
    area: Tensor
    tangent: Tensor
    normal: Tensor
    view: Tensor
    ray: Tensor
    albedo: Tensor
    depth: Tensor


def hair_albedo(melanin: float) -> tuple[float, ...]:
    """Return the albedo of a person's hairs, by the skin's melanin."""
    light, deep = np.array(ALBEDO)
    return tuple((light + min(melanin, 1.0) * (deep - light)).tolist())


def visible_hairs(
    hairs: PosedHairs, camera: CameraTensors, depth: Float[Tensor, "H W"], ray_pixel: Int[Tensor, " R"]
) -> VisibleHairs:
    """Find what an image shows of hairs.

    Args:
        hairs: posed.
        camera: of the full-size image.
        depth: of the skin there, m; infinite beside it.
        ray_pixel: of the rays, in the image of half that size.
    """
    place_px, place_depth = project(camera, hairs.points)
    half_px = camera.size_px[0] // 2, camera.size_px[1] // 2
    ray = _at_points(ray_of_pixel(ray_pixel, half_px[0] * half_px[1]), place_px[:, 0] / 2, half_px, -1)
    skin_depth = _at_points(depth.flatten(), place_px, camera.size_px, -torch.inf)
    shown = (ray >= 0) & (place_depth > NEAR_M).all(1) & (place_depth - hairs.behind_m <= skin_depth).any(1)
    points, ray = hairs.points[shown], ray[shown]
    drawn = _drawn(points, hairs.radius_m[shown], camera)
    pixel, weights = _around(drawn.place_px, camera.size_px)
    is_before = drawn.depth[:, None] - hairs.behind_m <= depth.flatten()[pixel]
    area = drawn.area[:, None] * weights * is_before
    seen = (area > 0).any(1)
    nearest = depth.flatten().scatter_reduce(
        0, pixel[seen].flatten(), drawn.depth[seen].repeat_interleave(pixel.shape[1]), "amin"
    )
    middle = 0.5 * (points[:, :-1] + points[:, 1:]).flatten(0, 1)
    return VisibleHairs(
        piece=drawn.piece[seen],
        pixel=pixel[seen],
        area=area[seen],
        tangent=normalize(points.diff(dim=1), dim=-1).flatten(0, 1),
        normal=hairs.normal[shown].repeat_interleave(SEGMENTS, 0),
        view=_view_of(camera, middle),
        ray=ray.repeat_interleave(SEGMENTS),
        albedo=hairs.albedo,
        depth=torch.where(depth.isfinite(), depth, nearest.reshape(depth.shape)),
    )


def _view_of(camera: CameraTensors, points: Float[Tensor, "G 3"]) -> Float[Tensor, "G 3"]:
    """Compute the unit directions in which the camera sees points of the world."""
    if camera.is_orthographic:
        return camera.world2cam[2, :3].expand_as(points)
    return normalize(points - ray_origin(camera), dim=-1)


def with_hairs(
    colours: Float[Tensor, "3 H W"],
    alpha: Float[Tensor, "H W"],
    seen: VisibleHairs,
    features: LightFeatures,
) -> tuple[Float[Tensor, "3 H W"], Float[Tensor, "H W"]]:
    """Composite the hairs over colours and alpha.

    Args:
        colours: premultiplied.
        alpha: of the skin.
        seen: the hairs.
        features: of the rays.
    """
    at_roots = with_ray_rows(features, ray_rows(features)[seen.ray])
    of_pieces = hair_colours(at_roots, seen.tangent, seen.normal, seen.view, seen.albedo)
    covered = torch.cat([of_pieces[seen.piece], torch.ones_like(seen.area[:, :1])], 1)
    total = colours.new_zeros(alpha.numel(), 4)
    for corner in range(4):
        total.index_add_(0, seen.pixel[:, corner], covered * seen.area[:, corner : corner + 1])
    share = total[:, 3].clamp(max=1)
    colour = total[:, :3] * (share / total[:, 3].clamp(min=_TINY))[:, None]
    share = share.reshape(alpha.shape)
    return colours * (1 - share) + colour.T.reshape(colours.shape), alpha + share * (1 - alpha)


def hair_colours(
    features: LightFeatures,
    tangent: Float[Tensor, "G 3"],
    normal: Float[Tensor, "G 3"],
    view: Float[Tensor, "G 3"],
    albedo: Float[Tensor, 3],
) -> Float[Tensor, "G 3"]:
    """Compute the scene-linear colours of pieces of hair.

    Args:
        features: of the light at each.
        tangent: unit, along the hair.
        normal: unit, of the skin below.
        view: unit, from the camera.
        albedo: of diffuse light.
    """
    strength = features.lamp_vectors.norm(dim=-1)
    towards = features.lamp_vectors / strength.clamp(min=_TINY)[..., None]
    sine_in, sine_out = (towards * tangent[:, None]).sum(-1), -(view * tangent).sum(-1, keepdim=True)
    cosine_in, cosine_out = ((1 - sine * sine).clamp(min=0).sqrt() for sine in (sine_in, sine_out))
    facing = (-(towards * view[:, None]).sum(-1) - sine_in * sine_out) / (cosine_in * cosine_out).clamp(min=_TINY)
    across, facing = torch.acos(facing.clamp(-1, 1)), facing.clamp(-1, 1)
    diffuse = cosine_in * (across.sin() + (pi - across) * facing) / 4
    mirrored = cosine_in * _mirrored(sine_in, sine_out) * 0.25 * (across / 2).cos()
    of_lamps = (strength * diffuse) @ features.lamp_rgb * albedo + (strength * mirrored) @ features.lamp_rgb
    even = sky_on(features, normal) * features.arriving + features.reflected
    return of_lamps * features.arriving + EVEN * (albedo + REFLECTED) * even


def _mirrored(sine_in: Float[Tensor, "G L"], sine_out: Float[Tensor, "G 1"]) -> Float[Tensor, "G L"]:
    """Compute the share of irradiance / pi in the cone of mirrored light, over all angles around the hair."""
    angle_in, angle_out = (torch.asin(sine.clamp(-1, 1)) for sine in (sine_in, sine_out))
    half, difference = (angle_in + angle_out) / 2, (angle_in - angle_out) / 2
    cone = torch.exp(-0.5 * (half / MIRRORED_RAD) ** 2) / (2 * MIRRORED_RAD * (2 * pi) ** 0.5)
    return pi * REFLECTED * cone / difference.cos().square().clamp(min=LEAST_COSINE_SQUARED)


class _DrawnPoints(NamedTuple):
    """F points on pieces of hairs: which piece [F], position [F, 2] and area [F], pixels, and depth [F], m."""

    piece: Tensor
    place_px: Tensor
    area: Tensor
    depth: Tensor


def _drawn(points: Float[Tensor, "N S 3"], radius_m: Float[Tensor, " N"], camera: CameraTensors) -> _DrawnPoints:
    """Draw points on hairs, as close as `STEP_PX`, with the area that the hair around each covers."""
    hairs, ends = points.shape[:2]
    place_px, depth = project(camera, points)
    way_px = place_px.diff(dim=1)
    length_px = way_px.norm(dim=-1, keepdim=True)
    longest_px = float(length_px.max()) if hairs else 0.0
    count = min(max(ceil(longest_px / STEP_PX), 1), MOST_POINTS)
    share = (torch.arange(count, device=points.device) + 0.5) / count
    along = (torch.arange(ends - 1, device=points.device)[:, None] + share) / (ends - 1)
    depth_at = depth[:, :-1, None] + share * depth.diff(dim=1)[..., None]
    width_px = 2 * radius_m[:, None, None] * (1 - along) * camera.focal_px / camera.divisor(depth_at)
    piece = torch.arange(hairs * (ends - 1), device=points.device).repeat_interleave(count)
    place_at = place_px[:, :-1, None] + share[:, None] * way_px[:, :, None]
    return _DrawnPoints(piece, place_at.flatten(0, 2), (width_px * length_px / count).flatten(), depth_at.flatten())


def _at_points(
    image: Shaped[Tensor, " P"], place_px: Float[Tensor, "*n 2"], size_px: tuple[int, int], besides: int | float
) -> Shaped[Tensor, "*n"]:
    """Read an image in the pixel in which each point lies."""
    column, row = place_px.nan_to_num(-1.0).floor().long().unbind(-1)
    is_inside = (column >= 0) & (column < size_px[0]) & (row >= 0) & (row < size_px[1])
    at = (row * size_px[0] + column).clamp(0, size_px[0] * size_px[1] - 1)
    return torch.where(is_inside, image[at], besides)


def _around(
    place_px: Float[Tensor, "F 2"], size_px: tuple[int, int]
) -> tuple[Int[Tensor, "F 4"], Float[Tensor, "F 4"]]:
    """Find the four pixels around each point, and their bilinear weights; 0 beside the image."""
    first = (place_px - 0.5).floor()
    right, below = (place_px - 0.5 - first).unbind(-1)
    column, row = first.long().unbind(-1)
    columns, rows = torch.stack([column, column + 1] * 2, 1), torch.stack([row, row, row + 1, row + 1], 1)
    across, down = torch.stack([1 - right, right] * 2, 1), torch.stack([1 - below, 1 - below, below, below], 1)
    is_inside = (columns >= 0) & (columns < size_px[0]) & (rows >= 0) & (rows < size_px[1])
    pixel = rows.clamp(0, size_px[1] - 1) * size_px[0] + columns.clamp(0, size_px[0] - 1)
    return pixel, across * down * is_inside
