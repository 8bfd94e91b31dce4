"""Neighbouring frames compared where they show the same skin, which the known mesh's motion tells.

Light that changes with view and pose differs in true pictures, too. So a difference is set beside the truth's own, at
the same pixels; and flicker is what is left of three frames when a steady change is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch

from ...geometry.closest_point import closest_on_triangles
from ...geometry.rasterise import NearestFronts, nearest_fronts, rasterise
from ...records.camera import Camera

LEVELS = 255.0
_SAME_M = 0.002  # between depths of one place of skin
_SOLID = 0.99


@dataclass(frozen=True)
class MeshView:
    """A posed mesh in a view.

    Attributes:
        vertices: [V, 3] m, world.
        faces: [F, 3].
        camera: a pinhole.
    """

    vertices: np.ndarray
    faces: np.ndarray
    camera: Camera

    @cached_property
    def fronts(self) -> NearestFronts:
        """What each pixel's centre shows."""
        positions_px, depth = (torch.as_tensor(values) for values in self.camera.project(self.vertices))
        size_px = self.camera.size_px
        return nearest_fronts(rasterise(positions_px, depth, torch.as_tensor(self.faces), size_px), size_px)

    def visible_points(self) -> FrontPoints:
        """Find the places of skin at the centres of all pixels that show some."""
        pixel = (self.fronts.face >= 0).nonzero()[:, 0].numpy()
        face, depth = self.fronts.face[pixel], self.fronts.depth[pixel].numpy()
        centres_px = np.stack([pixel % self.camera.size_px[0], pixel // self.camera.size_px[0]], -1) + 0.5
        points = self.camera.cam2world[:3, 3] + depth[:, None] * self.camera.ray_directions(centres_px)
        triangles = torch.as_tensor(self.vertices[self.faces[face]])
        weights, _ = closest_on_triangles(torch.as_tensor(points), triangles)
        return FrontPoints(pixel, face.numpy(), weights.numpy())

    def positions(self, points: FrontPoints) -> tuple[np.ndarray, np.ndarray]:
        """Return where places of skin are in the picture [P, 2] px, and whether each is seen there [P]."""
        corners = self.vertices[self.faces[points.face]]
        px, depth = self.camera.project((corners * points.weights[..., None]).sum(1))
        width, height = self.camera.size_px
        column, row = np.floor(px).astype(int).T
        is_inside = (column > 0) & (column < width - 1) & (row > 0) & (row < height - 1)
        pixel = np.where(is_inside, row * width + column, 0)
        return px, is_inside & (np.abs(self.fronts.depth.numpy()[pixel] - depth) < _SAME_M)


class FrontPoints(NamedTuple):
    """P places of skin: the pixel of the view that they were found in, their face, and their barycentric weights."""

    pixel: np.ndarray
    face: np.ndarray
    weights: np.ndarray


class Warped(NamedTuple):
    """Differences of a frame from its neighbours, at pixels that show the same skin in all three.

    Attributes:
        pixel: [P] of the frame.
        before: [P, 3] levels of 255: the frame minus its predecessor.
        flicker: [P, 3] levels: the frame minus the mean of its neighbours.
    """

    pixel: np.ndarray
    before: np.ndarray
    flicker: np.ndarray


def warped(views: tuple[MeshView, MeshView, MeshView], images: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Warped:
    """Compare the middle one of three frames with its neighbours, brought there by the mesh.

    Args:
        views: of the frames, in their order.
        images: [H, W, 4] sRGB-encoded colour times alpha, and alpha, of each.
    """
    points = views[1].visible_points()
    here = images[1].reshape(-1, 4)[points.pixel]
    is_kept, colours = here[:, 3] >= _SOLID, []
    for view, image in ((views[0], images[0]), (views[2], images[2])):
        px, is_seen = view.positions(points)
        sampled = _bilinear(image, px)
        is_kept &= is_seen & (sampled[:, 3] >= _SOLID)
        colours.append(sampled[:, :3])
    before, after = (LEVELS * one[is_kept] for one in colours)
    middle = LEVELS * here[is_kept, :3]
    return Warped(points.pixel[is_kept], middle - before, middle - (before + after) / 2)


def _bilinear(image: np.ndarray, px: np.ndarray) -> np.ndarray:
    """Interpolate [H, W, C] at positions [P, 2] px; beyond the border the nearest pixel counts."""
    height, width = image.shape[:2]
    at = np.clip(px - 0.5, 0, [width - 1.001, height - 1.001])
    column, row = np.floor(at).astype(int).T
    right, down = (at - np.floor(at)).T[..., None]
    upper = image[row, column] * (1 - right) + image[row, column + 1] * right
    lower = image[row + 1, column] * (1 - right) + image[row + 1, column + 1] * right
    return upper * (1 - down) + lower * down
