"""Pixels in which one part of a surface ends before or against another: how much they show of each (anti-aliasing).

Light, normal and colour of a pixel are those of what its centre shows. Where a finger ends before the palm, or lies
against it, its outline would be one of whole pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import max_pool2d

from ..field.rays import CameraTensors
from ..image.shading import MIN_ALPHA

STEP_M, STEP_PX = 0.001, 4.0
"""Depths that differ by more are of two parts: template metres, and how many pixels' width."""
SPREAD = (0.0447, 0.9106, 0.0447)
"""Weights of a pixel and of its neighbours along a row or column in what it shows.

With the pixel's own square they have the variance of Cycles' filter, Blackman-Harris of 1.5 pixels."""
_ITSELF = 4  # of the nine pixels around one: itself


class SurfaceBones(NamedTuple):
    """Which bones the M faces of a surface follow.

    Attributes:
        of_face: [M] the bone that moves a face most.
        apart: [B, B] whether skin of two bones is of two parts: bones neither equal nor joined.
    """

    of_face: Tensor
    apart: Tensor

    @classmethod
    def of(cls, weights: Float[Tensor, "N B"], faces: Int[Tensor, "M 3"], parents: tuple[int, ...]) -> SurfaceBones:
        """Assign faces to bones by skinning weights; the parent of the root is negative."""
        child = torch.arange(len(parents), device=faces.device)
        parent = torch.as_tensor(parents, device=faces.device).clamp(min=0)
        joined = torch.eye(len(parents), dtype=torch.bool, device=faces.device)
        joined[child, parent], joined[parent, child] = True, True
        return cls(weights[faces].sum(1).argmax(1).to(torch.int8), ~joined)

    def at(self, face: Int[Tensor, "*p"]) -> Int[Tensor, "*p"]:
        """Look up the bones of faces; -1 for none."""
        return torch.where(face >= 0, self.of_face[face.long().clamp(min=0)], -1).long()


class SurfaceFragments(NamedTuple):
    """What points in an image show of a surface.

    Attributes:
        depth: [*p] m; infinite beside it.
        bone: [*p] -1 beside it.
    """

    depth: Tensor
    bone: Tensor


class EdgePixels(NamedTuple):
    """S pixels that show two parts.

    Attributes:
        pixel: [S] row * width + column.
        shows_first: [9, S] whether the centres of the 3 x 3 pixels around, the fifth of which is itself, show the first
            of both parts (the nearer, if their depths differ enough); undefined beside the surface.
        share: [S] of that part in what the pixel shows of both.
    """

    pixel: Tensor
    shows_first: Tensor
    share: Tensor

    @classmethod
    def of(
        cls,
        centres: SurfaceFragments,
        samples: SurfaceFragments,
        bones: SurfaceBones,
        camera: CameraTensors,
        scale: Tensor,
    ) -> EdgePixels:
        """Find the edges in an image.

        Args:
            centres: [P] of pixels.
            samples: [N, P] of N points in each pixel.
            bones: of the surface.
            camera: of the image.
            scale: of the surface against the template.
        """
        between, part = _between(centres.depth, camera, scale), _first_part(centres.bone, bones.apart, camera)
        pixel = ((between > 0) | (part >= 0)).nonzero()[:, 0]
        around = _around(pixel, camera.size_px)
        has_samples = torch.zeros(len(between), dtype=torch.bool, device=pixel.device)
        has_samples[pixel] = True

        def is_first(seen: SurfaceFragments) -> Tensor:
            by_bone = ~bones.apart[seen.bone.clamp(min=0), part[pixel].clamp(min=0)]
            return torch.where(between[pixel] > 0, seen.depth < between[pixel], by_bone)

        at = SurfaceFragments(centres.depth[around], centres.bone[around])
        within = SurfaceFragments(samples.depth[:, around], samples.bone[:, around])
        shows_first, is_seen = is_first(at), within.depth.isfinite()
        of_squares = (is_first(within) & is_seen).sum(0) / is_seen.sum(0).clamp(min=1)
        # What pixels around show that have one part by their centres.
        shown = torch.where(has_samples[around], of_squares, shows_first.float())
        row = shown.new_tensor(SPREAD)
        weight = (row[:, None] * row).flatten()[:, None] * at.depth.isfinite()
        weight[_ITSELF] = row[1] ** 2
        return cls(pixel, shows_first, (weight * shown).sum(0) / weight.sum(0))


def _between(depth: Float[Tensor, " P"], camera: CameraTensors, scale: Tensor) -> Float[Tensor, " P"]:
    """Find a depth behind the nearer part around a pixel and before the other, m; 0 for one part."""
    width, height = camera.size_px
    image = depth.reshape(1, 1, height, width)
    low = -max_pool2d(-image, 3, 1, 1).flatten()
    high = max_pool2d(torch.where(image.isfinite(), image, -torch.inf), 3, 1, 1).flatten()
    step_m, step_per_m = part_steps(camera, scale)
    return torch.where(high - low > step_m + step_per_m * low, 0.5 * (low + high), 0.0)


def part_steps(camera: CameraTensors, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Return by how much depths of two parts differ at least, m, and by how much more for each metre of depth."""
    of_pixels = STEP_PX / camera.focal_px
    if camera.is_orthographic:
        return STEP_M * scale + of_pixels, torch.zeros_like(of_pixels)
    return STEP_M * scale, of_pixels


def _first_part(bone: Int[Tensor, " P"], apart: Bool[Tensor, "B B"], camera: CameraTensors) -> Int[Tensor, " P"]:
    """Find the lower of a pixel's bone and the first around it that is of another part; -1 for one part or none."""
    others = bone[_around(torch.arange(len(bone), device=bone.device), camera.size_px)]
    is_other = apart[bone.clamp(min=0), others.clamp(min=0)] & (others >= 0) & (bone >= 0)
    other = others.gather(0, is_other.int().argmax(0, keepdim=True))[0]
    return torch.where(is_other.any(0), torch.minimum(bone, other), -1)


def _around(pixel: Int[Tensor, " S"], size_px: tuple[int, int]) -> Int[Tensor, "9 S"]:
    """Find the 3 x 3 pixels around each, within the image; the fifth is itself."""
    width, height = size_px
    x, y = pixel % width, torch.div(pixel, width, rounding_mode="floor")
    offsets = (-1, 0, 1)
    rows = [(y + dy).clamp(0, height - 1) * width for dy in offsets]
    columns = [(x + dx).clamp(0, width - 1) for dx in offsets]
    return torch.stack([row + column for row in rows for column in columns])


def blended(
    colours: Float[Tensor, "3 H W"],
    alpha: Float[Tensor, "H W"],
    depth: Float[Tensor, "H W"],
    edges: EdgePixels,
) -> Float[Tensor, "3 H W"]:
    """Blend both parts in the pixels that show them.

    A pixel has its own colour of the part in its centre, and the mean of its neighbours' of the other.

    Args:
        colours: premultiplied, of what pixels' centres show.
        alpha: of the pixels.
        depth: m.
        edges: in the image.
    """
    height, width = depth.shape
    around = _around(edges.pixel, (width, height))
    opacity = alpha.flatten()
    straight = colours.flatten(1)[:, around] / opacity[around].clamp(min=MIN_ALPHA)  # [3, 9, S]
    is_shown = depth.flatten()[around].isfinite() & (opacity[around] > MIN_ALPHA)
    parts = [_part(straight, is_shown & side) for side in (edges.shows_first, ~edges.shows_first)]
    both = torch.lerp(parts[1][0], parts[0][0], edges.share)
    has_both = parts[0][1] & parts[1][1]
    at = edges.pixel[has_both]
    result = colours.flatten(1).clone()
    result[:, at] = both[:, has_both] * opacity[at].clamp(max=1)
    return result.reshape(colours.shape)


def _part(straight: Float[Tensor, "3 9 S"], is_of_it: Tensor) -> tuple[Float[Tensor, "3 S"], Tensor]:
    """Find the colour of a part in pixels, their own or the mean around them, and where it is defined."""
    weight = is_of_it.to(straight.dtype)
    mean = (straight * weight).sum(1) / weight.sum(0).clamp(min=1)
    return torch.where(is_of_it[_ITSELF], straight[:, _ITSELF], mean), is_of_it.any(0)
