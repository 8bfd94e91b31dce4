"""The crop of the image that holds the hand: only this part is rendered.

A crop lies on the low-resolution grid (half the image's size) and extends past the hand by a margin, past the image's
border too if the hand does, so that super-resolution never sees an artificial edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ..field.rays import CameraTensors, camera_tensors, project
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh
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

    def tensors_of(self, camera: Camera) -> CameraTensors:
        """Return `camera_of` as the CPU's tensors, of a camera that is known to be one."""
        tensors, shift = camera_tensors(camera, "cpu"), np.array([[0, 0, self.x0], [0, 0, self.y0], [0, 0, 0.0]])
        K = np.array([[1 / self.scale], [1 / self.scale], [1.0]]) * camera.K - shift
        return tensors._replace(K=torch.as_tensor(K, dtype=torch.float32), size_px=(self.width, self.height))

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
    limit = (np.array(size_px) + scale - 1) // scale
    first = np.maximum(np.floor((low - reach).min(1)), 0)
    last = np.minimum(np.ceil((low + reach).max(1)), limit)
    if (last <= first).any():
        return None
    first, last = first.astype(int) - MARGIN_PX, last.astype(int) + MARGIN_PX
    width, height = (-(-(last - first) // BUCKET_PX) * BUCKET_PX).tolist()
    return Crop(int(first[0]), int(first[1]), width, height, scale)


def _overlap_1d(start: int, length: int, limit: int) -> tuple[slice, slice]:
    """Find where [start, start + length) overlaps [0, limit): as a slice of the image, and as one of the crop."""
    first, last = max(start, 0), max(min(start + length, limit), 0)
    return slice(first, max(first, last)), slice(first - start, max(first, last) - start)
