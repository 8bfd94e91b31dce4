"""Camera rays as tensors: their origins and directions and, once traced, where their samples lie over the skin.

Along a ray, `t` is depth in metres along the optical axis (ray directions have depth 1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.uvh import SurfaceSamples
from ..light.samples import FINAL, LightQuality
from ..records.camera import Camera
from .volume import Composite


class CameraTensors(NamedTuple):
    """A camera as tensors: K [3, 3] px, world2cam [4, 4], (width, height) px, and whether its rays are parallel."""

    K: Tensor
    world2cam: Tensor
    size_px: tuple[int, int]
    is_orthographic: bool = False

    @property
    def focal_px(self) -> Tensor:
        """[] focal length, px; px per m of an orthographic camera: the geometric mean of both axes."""
        return (self.K[0, 0] * self.K[1, 1]).abs().sqrt()

    def divisor(self, depth: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Return what the projection divides lengths at a depth by: the depth, m, or 1."""
        return torch.ones_like(depth) if self.is_orthographic else depth

    @property
    def every_pixel(self) -> Int[Tensor, " P"]:
        """Of the image, row by row."""
        width, height = self.size_px
        return torch.arange(width * height, device=self.K.device)


class HandInView(NamedTuple):
    """A posed hand and the (low-resolution) camera that sees it.

    Attributes:
        mesh: the mesh.
        topology: of the mesh.
        camera: sees it.
        surface_depth: [H * W] depth of its avatar's surface at the pixels' centres, m, infinite beside it;
            None: it has none.
        light_quality: of the light on it.
    """

    mesh: PosedMesh
    topology: Topology
    camera: CameraTensors
    surface_depth: Tensor | None = None
    light_quality: LightQuality = FINAL


class SurfaceRays(NamedTuple):
    """R rays as in `RaySamples`, with their N samples projected onto the surface."""

    pixel: Tensor
    directions: Tensor
    t: Tensor
    dt: Tensor
    is_stopped: Tensor
    samples: SurfaceSamples


class RenderedRays(NamedTuple):
    """R low-resolution rays of N samples, rendered.

    Attributes:
        pixel: [R] row * width + column, in the crop.
        composite: of each ray.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step of the samples, m.
    """

    pixel: Tensor
    composite: Composite
    t: Tensor
    dt: Tensor


def camera_tensors(camera: Camera, device: torch.device | str) -> CameraTensors:
    """Convert the camera to tensors.

    The rigid matrix is inverted by hand: numpy's inverse wakes a BLAS thread that then spins for 100 ms on a core that
    the frame needs.
    """
    rotation, centre = camera.cam2world[:3, :3], camera.cam2world[:3, 3]
    world2cam = np.eye(4, dtype=np.float32)
    world2cam[:3, :3], world2cam[:3, 3] = rotation.T, -(rotation.T * centre).sum(1)
    return CameraTensors(
        K=torch.from_numpy(np.array(camera.K, np.float32)).to(device),
        world2cam=torch.from_numpy(world2cam).to(device),
        size_px=camera.size_px,
        is_orthographic=camera.is_orthographic,
    )


def project(camera: CameraTensors, points: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n 2"], Float[Tensor, "*n"]]:
    """Project world points to (px, depth m)."""
    in_camera = points @ camera.world2cam[:3, :3].T + camera.world2cam[:3, 3]
    depth = in_camera[..., 2]
    if camera.is_orthographic:
        in_camera = torch.cat([in_camera[..., :2], torch.ones_like(depth)[..., None]], -1)
    homogeneous = in_camera @ camera.K.T
    return homogeneous[..., :2] / homogeneous[..., 2:], depth


def ray_directions(camera: CameraTensors, pixel: Tensor) -> Float[Tensor, "R 3"]:
    """Compute world directions of depth 1 through pixel centres."""
    return _at_centres(camera, pixel, direction_axes(camera))


def ray_origins(camera: CameraTensors, pixel: Tensor) -> Float[Tensor, "R 3"]:
    """Compute where rays through pixel centres have depth 0, world, m; in perspective, views of one point."""
    if not camera.is_orthographic:
        return ray_origin(camera).expand(len(pixel), 3)
    return _at_centres(camera, pixel, origin_axes(camera))


def direction_axes(camera: CameraTensors) -> Float[Tensor, "3 3"]:
    """Compute what (x, y, 1) px is multiplied by to get a ray's direction."""
    if not camera.is_orthographic:
        return torch.linalg.inv(camera.K).T @ camera.world2cam[:3, :3]
    return torch.stack([torch.zeros_like(camera.world2cam[2, :3])] * 2 + [camera.world2cam[2, :3]])


def origin_axes(camera: CameraTensors) -> Float[Tensor, "3 3"]:
    """Compute what (x, y, 1) px is multiplied by to get a ray's point of depth 0, m."""
    centre = ray_origin(camera)
    if not camera.is_orthographic:
        return torch.stack([torch.zeros_like(centre)] * 2 + [centre])
    axes = torch.linalg.inv(camera.K).T[:, :2] @ camera.world2cam[:2, :3]
    return torch.stack([axes[0], axes[1], axes[2] + centre])


def _at_centres(camera: CameraTensors, pixel: Tensor, axes: Float[Tensor, "3 3"]) -> Float[Tensor, "R 3"]:
    across, down, ahead = axes
    width = camera.size_px[0]
    row = torch.div(pixel, width, rounding_mode="floor")
    x, y = (place.to(camera.K.dtype)[:, None] + 0.5 for place in (pixel - width * row, row))
    return x * across + (y * down + ahead)


def view_directions(camera: CameraTensors, pixel: Tensor) -> Float[Tensor, "R 3"]:
    """Compute unit world directions through pixel centres."""
    return normalize(ray_directions(camera, pixel), dim=-1)


def ray_origin(camera: CameraTensors) -> Float[Tensor, 3]:
    """Return the camera's centre, world, m."""
    return -camera.world2cam[:3, :3].T @ camera.world2cam[:3, 3]


def split_rays(rays: SurfaceRays, size: int) -> list[SurfaceRays]:
    """Split the rays into chunks of `size` rays; at least one chunk, even if there are no rays."""
    per_ray = rays.t.shape[1]
    by_ray = zip(*(values.split(size) for values in rays[:5]), strict=True)
    by_sample = zip(*(values.split(size * per_ray) for values in rays.samples), strict=True)
    return [SurfaceRays(*r, samples=SurfaceSamples(*s)) for r, s in zip(by_ray, by_sample, strict=True)]
