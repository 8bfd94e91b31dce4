"""Rasterises all layers of a mesh: one fragment per face and pixel centre that it covers.

This is the depth pass of the method (paper section 3.3), but it keeps front and back faces of every layer, so that each
ray gets one interval per surface layer instead of a single near and far.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .tolerances import MIN_AREA_PX2, NEAR_M


class Fragments(NamedTuple):
    """N unordered fragments: pixel (row * width + column), face, depth along the optical axis m, front-facing."""

    pixel: Tensor
    face: Tensor
    depth: Tensor
    is_front: Tensor


def rasterise(
    positions_px: Float[Tensor, "V 2"],
    depth: Float[Tensor, " V"],
    faces: Int[Tensor, "F 3"],
    size_px: tuple[int, int],
    is_orthographic: bool = False,
) -> Fragments:
    """Find all fragments of the projected mesh inside the image.

    Args:
        positions_px: projected vertices; the centre of pixel (i, j) is at (i + 0.5, j + 0.5).
        depth: of the vertices along the optical axis, m; positive in front of the camera.
        faces: wound outward by the right-hand rule in the world, clockwise on screen (y down) when front-facing.
        size_px: (width, height).
        is_orthographic: whether the depth of a face is linear on screen, as its inverse is before a pinhole.
    """
    corners, corner_depth = positions_px[faces], depth[faces]  # [F, 3, 2], [F, 3]
    area = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_drawn = (corner_depth.amin(1) > NEAR_M) & (area.abs() > MIN_AREA_PX2)
    face, column, row = _candidate_pixels(corners, is_drawn, size_px)
    centre = torch.stack([column, row], -1).to(corners.dtype) + 0.5
    weights = _barycentric(corners[face], area[face], centre)
    is_inside = (weights >= 0).all(-1)
    face, weights = face[is_inside], weights[is_inside]
    if is_orthographic:
        fragment_depth = (weights * corner_depth[face]).sum(-1)
    else:
        fragment_depth = 1 / (weights / corner_depth[face]).sum(-1)
    pixel = (row * size_px[0] + column)[is_inside]
    return Fragments(pixel, face, fragment_depth, area[face] < 0)


def _candidate_pixels(
    corners: Float[Tensor, "F 3 2"], is_drawn: Tensor, size_px: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Find (face, column, row) of every pixel in the bounding box of every drawn face."""
    limit = torch.tensor(size_px, device=corners.device)
    first = (corners.amin(1) - 0.5).ceil().long().clamp(min=0)
    last = torch.minimum((corners.amax(1) - 0.5).floor().long(), limit - 1)
    extent = torch.where(is_drawn[:, None], (last - first + 1).clamp(min=0), torch.zeros_like(first))
    count = extent.prod(-1)
    face = torch.repeat_interleave(torch.arange(len(count), device=count.device), count)
    within = torch.arange(len(face), device=face.device) - (torch.cumsum(count, 0) - count)[face]
    width = extent[face, 0]
    return face, first[face, 0] + within % width, first[face, 1] + within // width


def _barycentric(
    corners: Float[Tensor, "N 3 2"], area: Float[Tensor, " N"], point: Float[Tensor, "N 2"]
) -> Float[Tensor, "N 3"]:
    a, b, c = corners.unbind(1)
    w0 = _cross(c - b, point - b)
    w1 = _cross(a - c, point - c)
    w2 = _cross(b - a, point - a)
    return torch.stack([w0, w1, w2], -1) / area[:, None]


def _cross(a: Float[Tensor, "*n 2"], b: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n"]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


class NearestFronts(NamedTuple):
    """The first front face in each of P pixels: depth [P] m, infinite for none, and face [P], -1 for none."""

    depth: Tensor
    face: Tensor


def nearest_fronts(fragments: Fragments, size_px: tuple[int, int]) -> NearestFronts:
    """Find the first front face in the centre of each pixel of an image."""
    width, height = size_px
    front = fragments.is_front.nonzero()[:, 0]
    order = front[torch.argsort(fragments.depth[front], descending=True, stable=True)]  # the nearest comes last
    last = torch.arange(len(order), device=order.device)
    nearest = torch.full((width * height,), -1, device=order.device)
    nearest = nearest.scatter_reduce(0, fragments.pixel[order], last, "amax")
    is_seen, hit = nearest >= 0, order[nearest[nearest >= 0]]
    face, depth = torch.full_like(nearest, -1), fragments.depth.new_full(nearest.shape, torch.inf)
    face[is_seen], depth[is_seen] = fragments.face[hit], fragments.depth[hit]
    return NearestFronts(depth, face)
