"""Rays through full-resolution pixels, for fields that live in space rather than in the shell.

A ray is kept where it meets the mesh inflated by 10 mm, and runs from that mesh's first surface to its last. `t` is
depth along the optical axis, m; steps are lengths along the ray in the template's millimetres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...evaluation.shot_renderer import no_stage
from ...field.rays import CameraTensors, project, ray_directions, ray_origin
from ...field.sampler import strata
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.rasterise import rasterise
from ...hand.model import MIRROR_AXIS_ANGLE, HandModel
from ...hand.posed_bones import bone_frames, check_on_pose
from ...image.decode import decode_frame
from ...records.frame import Frame, empty_frame
from ...records.render_hooks import OnStage
from ...records.shot import Shot
from .posed_views import PosedViews, ShotMeshes

INFLATED_M = 0.01
_RAYS_AT_ONCE = 512


class PixelRays(NamedTuple):
    """R rays of one hand.

    Attributes:
        pixel: [R] row * width + column.
        origin: [3] world, m.
        directions: [R, 3] world, depth 1.
        near: [R] m.
        far: [R] m.
        scale: [] size of the hand against its template.
    """

    pixel: Tensor
    origin: Tensor
    directions: Tensor
    near: Tensor
    far: Tensor
    scale: Tensor

    def chosen(self, index: Tensor) -> PixelRays:
        """Select some of the rays."""
        pixel, directions, near, far = (x[index] for x in (self.pixel, self.directions, self.near, self.far))
        return PixelRays(pixel, self.origin, directions, near, far, self.scale)

    def points(self, t: Float[Tensor, "R N"]) -> Float[Tensor, "R N 3"]:
        """Compute world points at these depths, m."""
        return self.origin + t[..., None] * self.directions[:, None, :]

    def steps_mm(self, t: Float[Tensor, "R N"]) -> Float[Tensor, "R N"]:
        """Measure from each sample to the next, the last one to `far`; a ray's end is never opaque by itself."""
        ends = torch.cat([t[:, 1:], self.far[:, None]], 1)
        return (ends - t).clamp(min=0) * self.directions.norm(dim=-1)[:, None] / self.scale * 1000

    def stratified(self, count: int, generator: torch.Generator | None) -> Float[Tensor, "R N"]:
        """Draw depths in equal strata between near and far."""
        at = strata(len(self.near), count, self.near, generator)
        return self.near[:, None] + at * (self.far - self.near)[:, None]


def pixel_rays(mesh: PosedMesh, topology: Topology, camera: CameraTensors) -> PixelRays:
    """Find all rays that meet the inflated mesh."""
    vertices = mesh.vertices + INFLATED_M * mesh.scale * mesh.normals
    fragments = rasterise(*project(camera, vertices), topology.faces, camera.size_px)
    empty = mesh.vertices.new_full((camera.size_px[0] * camera.size_px[1],), torch.inf)
    near = empty.scatter_reduce(0, fragments.pixel, fragments.depth, "amin")
    far = (-empty).scatter_reduce(0, fragments.pixel, fragments.depth, "amax")
    (pixel,) = torch.where(far > near)
    origin = ray_origin(camera)
    return PixelRays(pixel, origin, ray_directions(camera, pixel), near[pixel], far[pixel], mesh.scale)


def composite_steps(
    density: Float[Tensor, "R N"], channels: Float[Tensor, "R N C"], steps: Float[Tensor, "R N"]
) -> tuple[Float[Tensor, "R C"], Float[Tensor, " R"], Float[Tensor, "R N"]]:
    """Composite densities per unit of the steps: premultiplied channels, alpha, and the samples' weights."""
    optical = density * steps
    before = torch.exp(-(optical.cumsum(1) - optical))
    weights = before * -torch.expm1(-optical)
    return (weights[..., None] * channels).sum(1), weights.sum(1), weights


def importance_samples(
    t: Float[Tensor, "R N"], weights: Float[Tensor, "R N"], far: Float[Tensor, " R"], at: Float[Tensor, "R M"]
) -> Float[Tensor, "R M"]:
    """Draw depths from a histogram: bin i, from t_i to t_i+1 (the last to `far`), has the weight w_i.

    `at` are the quantiles in (0, 1), ascending. Weights are detached; a ray without any is sampled evenly.
    """
    edges = torch.cat([t, far[:, None]], 1).detach()
    share = weights.detach() + 1e-5
    cumulative = torch.cat([torch.zeros_like(share[:, :1]), share.cumsum(1) / share.sum(1, keepdim=True)], 1)
    index = torch.searchsorted(cumulative.contiguous(), at.contiguous(), right=True) - 1
    index = index.clamp(0, t.shape[1] - 1)
    low, high = cumulative.gather(1, index), cumulative.gather(1, index + 1)
    start, end = edges.gather(1, index), edges.gather(1, index + 1)
    return start + (at - low) / (high - low) * (end - start)


class RayBatch(NamedTuple):
    """Rays of one training view, the bones they see, and what they should show [R, 4]."""

    rays: PixelRays
    bones: Tensor
    theta: Tensor
    target: Tensor
    file: str


@dataclass
class RayBatches:
    """The rays of each step: functions of seed and step alone.

    Attributes:
        views: the training views.
        rays: in a step, shared by `views_per_step` views.
        seed: of the choice.
    """

    views: PosedViews
    rays: int
    seed: int
    views_per_step: int = 4

    def __post_init__(self):
        self._rays: dict[int, PixelRays] = {}

    def generator(self, step: int) -> torch.Generator:
        """Seed the generator of a step."""
        return torch.Generator(self.views.device).manual_seed(self.seed * 1_000_003 + step)

    def at(self, generator: torch.Generator) -> list[RayBatch]:
        """Draw the batches of a step, one for each of its views."""
        device = self.views.device
        count = min(self.views_per_step, len(self.views))
        chosen = torch.randperm(len(self.views), generator=generator, device=device)[:count].tolist()
        return [self._batch(index, self.rays // count, generator) for index in chosen]

    def _batch(self, index: int, count: int, generator: torch.Generator) -> RayBatch:
        window = self.views.window(index)
        if index not in self._rays:
            found = pixel_rays(window.mesh, self.views.topology, window.camera)
            self._rays[index] = found.chosen(window.is_inside.flatten()[found.pixel].nonzero()[:, 0])
        rays = self._rays[index]
        drawn = torch.randint(len(rays.pixel), (count,), generator=generator, device=rays.pixel.device)
        chosen = rays.chosen(drawn)
        target = window.target.flatten(1).T[chosen.pixel]
        return RayBatch(chosen, window.bones, window.theta, target, window.file)


Query = Callable[[PixelRays, Tensor, Tensor], Float[Tensor, "R 4"]]
"""(rays, bone frames [16, 4, 4], theta [16, 3]) -> RGBA, premultiplied."""


class RaysInFrame:
    """Renders a field in space ray by ray.

    Attributes:
        hand: the model of its shots.
    """

    def __init__(self, hand: HandModel, query: Query, device: torch.device):
        self.hand, self._query, self._device = hand, query, device
        self._meshes = ShotMeshes(hand, device)

    @torch.inference_mode()
    def render(self, shot: Shot, *, on_stage: OnStage = no_stage) -> Frame:
        """Render as `ShotRenderer` does."""
        on_stage("pose")
        mesh, topology = self._meshes.mesh(shot)
        check_on_pose(shot, self.hand)
        bones, theta = (self._tensor(values) for values in (bone_frames(self.hand, shot.pose), self._theta(shot)))
        window = self._meshes.window(shot, mesh)
        if window is None:
            return empty_frame(shot.camera.size_px)
        crop, camera = window
        on_stage("sample")
        rays = pixel_rays(mesh, topology, camera)
        on_stage("field")
        width, height = camera.size_px
        image = torch.zeros(height * width, 4, device=self._device)
        for chunk in torch.arange(len(rays.pixel), device=self._device).split(_RAYS_AT_ONCE):
            part = rays.chosen(chunk)
            image[part.pixel] = self._query(part, bones, theta).float()
        on_stage("decode")
        depth = torch.full((height * width,), torch.inf, device=self._device)
        depth[rays.pixel] = (rays.near + rays.far) / 2
        shape = (height, width)
        return decode_frame(image.T.reshape(4, *shape), depth.reshape(shape), crop, shot.camera.size_px)

    def _theta(self, shot: Shot) -> np.ndarray:
        return shot.pose.theta if shot.pose.side == self.hand.side else shot.pose.theta * MIRROR_AXIS_ANGLE

    def _tensor(self, values: np.ndarray) -> Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self._device)
