"""The crop of the image that holds the hand: only this part is rendered.

A crop lies on the low-resolution grid (half the image's size) and extends past the hand by a margin, past the image's
border too if the hand does, so that super-resolution never sees an artificial edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..field.rays import CameraTensors, camera_tensors, project
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh, Topology, mean_edge_length
from ..geometry.tolerances import NEAR_M
from ..records.camera import Camera

MARGIN_PX = 6
"""Low-resolution pixels around the hand: the reach of the super-resolution's convolutions."""
BUCKET_PX = 16
"""Crop sizes are multiples of this, so that convolutions see few shapes."""


@dataclass(frozen=True)
class Crop:
    """Upper left corner (may be negative) and size, in low-resolution pixels.

    Attributes:
        scale: pixels of the image per low-resolution pixel, along each side; 1 where every pixel has a ray.
    """

    x0: int
    y0: int
    width: int
    height: int
    scale: int = 2

    @property
    def full_size_px(self) -> tuple[int, int]:
        """(width, height) in pixels of the image."""
        return self.scale * self.width, self.scale * self.height

    @property
    def pixels(self) -> int:
        """Of the image."""
        return self.scale**2 * self.width * self.height

    def camera_of(self, camera: Camera) -> Camera:
        """Return the low-resolution camera of the crop."""
        return camera.scaled(1 / self.scale).cropped(self.x0, self.y0, (self.width, self.height))

    def tensors_of(self, camera: Camera, tensors: CameraTensors) -> CameraTensors:
        """Return `camera_of` as the CPU's tensors; `tensors` are the camera's own."""
        K, far = np.array(camera.K, np.float64), 1 / self.scale
        K[:2] *= far
        K[0, 2] -= self.x0
        K[1, 2] -= self.y0
        return tensors._replace(K=torch.from_numpy(K.astype(np.float32)), size_px=(self.width, self.height))

    def paste(self, values: np.ndarray, image: np.ndarray) -> None:
        """Copy full-resolution crop values [2 height, 2 width, ...] (times `scale`) into the image, in place."""
        rows, columns, inner_rows, inner_columns = self.overlap(image.shape[:2])
        image[rows, columns] = values[inner_rows, inner_columns]

    def paste_low_resolution(self, values: np.ndarray, image: np.ndarray) -> None:
        """Copy low-resolution crop values [height, width, ...] into an image of half the size, in place."""
        rows, inner_rows = _overlap_1d(self.y0, self.height, image.shape[0])
        columns, inner_columns = _overlap_1d(self.x0, self.width, image.shape[1])
        image[rows, columns] = values[inner_rows, inner_columns]

    def cut(self, image: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """Cut the full-resolution crop [2 height, 2 width, ...] out of an image; `outside` fills what lies beyond."""
        rows, columns, inner_rows, inner_columns = self.overlap(image.shape[:2])
        width, height = self.full_size_px
        values = np.full((height, width, *image.shape[2:]), outside, image.dtype)
        values[inner_rows, inner_columns] = image[rows, columns]
        return values

    def overlap(self, shape: tuple[int, ...]) -> tuple[slice, slice, slice, slice]:
        """Find where the crop lies over an image [H, W]: its rows and columns there, and the crop's own."""
        width, height = self.full_size_px
        rows, inner_rows = _overlap_1d(self.scale * self.y0, height, shape[0])
        columns, inner_columns = _overlap_1d(self.scale * self.x0, width, shape[1])
        return rows, columns, inner_rows, inner_columns


def crop_of(mesh: PosedMesh, camera: Camera, config: SamplerConfig, scale: int = 2) -> Crop | None:
    """Find the crop of a posed hand and its shell; None if nothing of it is in view."""
    tensors = camera_tensors(camera, mesh.vertices.device)
    positions_px, depth = project(tensors, mesh.vertices)
    reach_px = tensors.K.diagonal()[:2].abs().amax() * config.shell_m * mesh.scale / tensors.divisor(depth)
    return hand_crop(positions_px.cpu().numpy(), depth.cpu().numpy(), reach_px.cpu().numpy(), camera.size_px, scale)


class HandExtent(NamedTuple):
    """How large a posed hand is, and where an image shows it.

    Attributes:
        scale: against its template.
        centre: [3] mean of its vertices, m, world.
        radius: of the sphere about that which holds them, m.
        first: [2] least column and row that it reaches with its shell, px; None: nothing of it is before the camera.
        last: [2] and the largest.
    """

    scale: float
    centre: np.ndarray
    radius: float
    first: np.ndarray | None
    last: np.ndarray

    def crop(self, size_px: tuple[int, int], scale: int) -> Crop | None:
        """Find its crop in an image of this size, as `crop_of`; None if nothing of it is in view."""
        if self.first is None:
            return None
        return _crop_between(np.floor(self.first / scale), np.ceil(self.last / scale), size_px, scale)


def hand_extent(
    topology: Topology, vertices: Float[Tensor, "V 3"], camera: CameraTensors, shell_m: float
) -> HandExtent:
    """Measure a posed hand; `shell_m` is the half-width of its shell, template metres."""
    scale = mean_edge_length(vertices, topology.edges) / topology.edge_length_m
    centre = vertices.mean(0)
    radius = float((vertices - centre).norm(dim=-1).amax())
    positions_px, depth = project(camera, vertices)
    reach_px = (camera.K.diagonal()[:2].abs().amax() * shell_m * scale / camera.divisor(depth))[:, None]
    is_before = depth > NEAR_M
    if not is_before.any():
        return HandExtent(float(scale), centre.numpy(), radius, None, np.zeros(2))
    positions_px, reach_px = positions_px[is_before], reach_px[is_before]
    first, last = (positions_px - reach_px).amin(0), (positions_px + reach_px).amax(0)
    return HandExtent(float(scale), centre.numpy(), radius, first.numpy(), last.numpy())


def hand_crop(
    positions_px: np.ndarray, depth: np.ndarray, reach_px: np.ndarray, size_px: tuple[int, int], scale: int = 2
) -> Crop | None:
    """Find the crop of projected vertices [V, 2], each extended by `reach_px` [V]; None if nothing is in view."""
    in_front = depth > NEAR_M
    if not in_front.all():
        if not in_front.any():
            return None
        positions_px, reach_px = positions_px[in_front], reach_px[in_front]
    low, reach = np.ascontiguousarray(positions_px.T) / scale, reach_px / scale
    return _crop_between(np.floor((low - reach).min(1)), np.ceil((low + reach).max(1)), size_px, scale)


def _crop_between(first: np.ndarray, last: np.ndarray, size_px: tuple[int, int], scale: int) -> Crop | None:
    """Find the crop from the first low-resolution column and row to the last, those before and behind included."""
    (x0, y0), (x1, y1) = first.tolist(), last.tolist()
    x0, y0 = max(int(x0), 0), max(int(y0), 0)
    x1, y1 = (min(int(end), (size + scale - 1) // scale) for end, size in zip((x1, y1), size_px, strict=True))
    if x1 <= x0 or y1 <= y0:
        return None
    width, height = (-(-(end + 2 * MARGIN_PX) // BUCKET_PX) * BUCKET_PX for end in (x1 - x0, y1 - y0))
    return Crop(x0 - MARGIN_PX, y0 - MARGIN_PX, width, height, scale)


def _overlap_1d(start: int, length: int, limit: int) -> tuple[slice, slice]:
    """Find where [start, start + length) overlaps [0, limit): as a slice of the image, and as one of the crop."""
    first, last = max(start, 0), max(min(start + length, limit), 0)
    return slice(first, max(first, last)), slice(first - start, max(first, last) - start)
