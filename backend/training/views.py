"""Training images with everything that training does not change: their crop, target, and rays on the surface.

Tracing takes as long as a training step, so each image is traced once per jitter set and kept in half precision. Images
are decoded once, in advance (`crop_store`).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..capture.capture import Capture, CaptureView
from ..compute.reference import ReferenceBackend
from ..field.conditions import FrameConditions
from ..field.rays import CameraTensors, HandInView, SurfaceRays, camera_tensors, ray_directions
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..geometry.uvh import SurfaceSamples
from ..hand.lbs import SkinTensors, pose_hand
from ..hand.model import HandModel
from ..hand.posed_bones import bone_frames
from ..hand.topology import Skinning, topology_of
from ..image.crop import Crop, crop_of
from ..records.errors import LiveHandError
from ..render.backends import choose_backend
from .crop_store import CropStore


class TrainingView(NamedTuple):
    """One image, ready for a step.

    Attributes:
        camera: the low-resolution camera of the crop.
        target: [4, 2h, 2w] (times `scale`) RGBA of the crop: sRGB-encoded colour times alpha, and alpha.
        is_inside: [2h, 2w] whether the pixel of the crop lies in the image.
        rays: with samples on the surface.
        conditions: of the pose.
        mesh: of the pose.
        light: for a relightable avatar, the light of the image: `lit_views.ViewLight`, mixed `lit_views.MixedLight`.
    """

    camera: CameraTensors
    target: Tensor
    is_inside: Tensor
    rays: SurfaceRays
    conditions: FrameConditions
    mesh: PosedMesh
    light: Any = None


class TrainingViews:
    """The views of a capture that show the hand, traced on first use.

    Raises:
        LiveHandError: the capture is of another hand.

    Attributes:
        views: those of the given views that show the hand.
        scale: pixels of the image per ray, along each side.
    """

    def __init__(
        self,
        capture: Capture,
        views: tuple[CaptureView, ...],
        hand: HandModel,
        sampler: SamplerConfig,
        device: torch.device,
        seed: int,
        scale: int = 2,
    ):
        if capture.hand_sha256 != hand.sha256:
            raise LiveHandError(
                f"capture {capture.folder} must be of hand '{hand.name}', got one of hand {capture.hand_sha256[:12]}..."
            )
        self.capture, self.hand, self.sampler, self.device, self.seed = capture, hand, sampler, device, seed
        self.scale = scale
        crops = [(view, crop) for view in views if (crop := self._crop(view)) is not None]
        self.views = [view for view, _ in crops]
        self._crops = [crop for _, crop in crops]
        self._traced: dict[tuple[int, int], tuple[Tensor, ...]] = {}

    def __len__(self) -> int:
        return len(self.views)

    @property
    def waited_s(self) -> float:
        """Total time spent waiting for images that had not been read and decoded in advance, s."""
        return self._pixels.waited_s

    @cached_property
    def topology(self) -> Topology:
        """Of the hand."""
        return topology_of(self.hand, self.device)

    @cached_property
    def backend(self) -> ReferenceBackend:
        """Traces and shades the views' rays."""
        return choose_backend(self.device)

    @cached_property
    def _skinning(self) -> Skinning:
        return Skinning.of(self.hand, self.device)

    def _conditions(self, theta: Float[Tensor, "16 3"], mesh: PosedMesh) -> FrameConditions:
        visibility = self._visibility(mesh)
        return FrameConditions.of(theta, self._skinning, self.topology, mesh, visibility)

    def _visibility(self, mesh: PosedMesh) -> Tensor:
        return self.backend.visibility(mesh, self.topology)

    @cached_property
    def _poses(self) -> list[tuple[PosedMesh, FrameConditions]]:
        skin = SkinTensors.of(self.hand, self.device)
        posed = []
        identities = self.capture.identities or (0,) * len(self.capture.poses)
        for pose, identity in zip(self.capture.poses, identities, strict=True):
            if pose.side != self.hand.side:
                raise LiveHandError(
                    f"a capture's poses must all be of the {self.hand.side} hand, got a {pose.side} one"
                )
            arrays = (pose.theta, pose.beta, pose.transl, pose.forearm)
            theta, *others = (torch.as_tensor(a, dtype=torch.float32, device=self.device) for a in arrays)
            mesh = posed_mesh(self.topology, pose_hand(skin, theta, *others).vertices)
            bones = torch.as_tensor(bone_frames(self.hand, pose), dtype=torch.float32, device=self.device)
            conditions = self._conditions(theta, mesh)
            of_bones = {"bones": bones, "bone_weights": self._skinning.lbs_weights}
            posed.append((mesh, conditions._replace(**of_bones, identity=identity)))
        return posed

    def get(self, index: int, jitter: int) -> TrainingView:
        """Return view `index` with its `jitter`-th set of samples."""
        crop = self._crops[index]
        mesh, conditions = self._poses[self.views[index].pose_index]
        camera = camera_tensors(crop.camera_of(self.views[index].camera), self.device)
        return TrainingView(
            camera=camera,
            target=self._target(index),
            is_inside=self._inside(index, crop),
            rays=self._rays(index, jitter, camera, mesh),
            conditions=conditions,
            mesh=mesh,
        )

    def move_pose(self, pose_index: int, theta: Float[Tensor, "16 3"], vertices: Float[Tensor, "V 3"]) -> None:
        """Replace a pose; its views are traced again on their next use, with the same crops.

        Args:
            pose_index: of the pose.
            theta: axis-angle, rad.
            vertices: posed, world, m; without gradients.
        """
        mesh = posed_mesh(self.topology, vertices)
        self._poses[pose_index] = mesh, self._conditions(theta, mesh)
        of_pose = {index for index, view in enumerate(self.views) if view.pose_index == pose_index}
        self._traced = {key: rays for key, rays in self._traced.items() if key[0] not in of_pose}

    def _crop(self, view: CaptureView) -> Crop | None:
        mesh, _ = self._poses[view.pose_index]
        return crop_of(mesh, view.camera, self.sampler, self.scale)

    def _target(self, index: int) -> Float[Tensor, "4 H W"]:
        pixels = torch.as_tensor(self._pixels.get(index)).to(self.device)
        target = pixels.permute(2, 0, 1).contiguous() / 255
        target[:3] *= target[3:]
        return target

    @cached_property
    def _pixels(self) -> CropStore:
        sizes_px = [crop.full_size_px for crop in self._crops]
        capture, views, crops = self.capture, self.views, self._crops  # the store's threads must not reference self

        def decode(index: int) -> np.ndarray:
            return crops[index].cut(capture.read_pixels(views[index]))

        return CropStore(sizes_px, decode, capture.folder)

    def _inside(self, index: int, crop: Crop) -> Tensor:
        width, height = self.views[index].camera.size_px
        columns, rows = crop.full_size_px
        x = torch.arange(columns, device=self.device) + crop.scale * crop.x0
        y = torch.arange(rows, device=self.device) + crop.scale * crop.y0
        return ((y >= 0) & (y < height))[:, None] & ((x >= 0) & (x < width))

    def _met_hand(self, index: int, mesh: PosedMesh, camera: CameraTensors) -> HandInView:
        """Return the hand as the rays of view `index` meet it: no avatar's surface is given here."""
        return HandInView(mesh, self.topology, camera)

    def _rays(self, index: int, jitter: int, camera: CameraTensors, mesh: PosedMesh) -> SurfaceRays:
        if (index, jitter) not in self._traced:
            generator = torch.Generator(self.device).manual_seed(hash((self.seed, index, jitter)) % 2**63)
            hand = self._met_hand(index, mesh, camera)
            self._traced[index, jitter] = _packed(self.backend.trace(hand, self.sampler, generator))
        return _unpacked(self._traced[index, jitter], camera)


def _packed(rays: SurfaceRays) -> tuple[Tensor, ...]:
    """Pack the rays in 12 bytes per sample; half precision moves a sample by less than 3 micrometres on the surface."""
    samples = rays.samples
    barycentric = samples.barycentric[:, 1:].half()
    face = samples.face.int() if (samples.face >= 2**15).any() else samples.face.short()
    return rays.pixel.int(), rays.t, rays.dt, rays.is_stopped, face, barycentric, (samples.height_m * 1000).half()


def _unpacked(packed: tuple[Tensor, ...], camera: CameraTensors) -> SurfaceRays:
    pixel, t, dt, is_stopped, face, barycentric, height_mm = packed
    pixel, barycentric = pixel.long(), barycentric.float()
    barycentric = torch.cat([1 - barycentric.sum(1, keepdim=True), barycentric], 1)
    samples = SurfaceSamples(face.long(), barycentric, height_mm.float() / 1000)
    return SurfaceRays(pixel, ray_directions(camera, pixel), t, dt, is_stopped, samples)
