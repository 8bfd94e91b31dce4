"""Pose, camera and mesh in; a photoreal frame out: the main path of the product.

A renderer chooses one of two pipelines, by its avatar and once: `baked.BakedPipeline`, or
`relightable.RelightablePipeline`. Their docstrings are the stages of a frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from ..avatars.avatar import Avatar
from ..compute.precision import Precision
from ..compute.reference import ReferenceBackend
from ..field.relightable import RelightableField
from ..field.sampler import SamplerConfig
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..records.frame import Frame
from ..records.render_hooks import OnStage
from ..records.shot import Shot, SurfaceMesh
from .backends import choose_backend, gpu_renderer
from .baked import BakedPipeline
from .device import rendering_device
from .lit_shots import reason_of_avatar
from .progress import RenderProgress
from .relightable import RelightablePipeline


@dataclass(frozen=True)
class Renderer:
    """One avatar on one hand model and device. It copies the avatar's networks at its first render and uses the copies.

    Attributes:
        avatar: the trained appearance.
        hand: the model of the meshes to render, of either side.
        device: as `rendering_device` takes it; `cuda` needs no CUDA build of torch where Warp works.
        precision: of the networks; geometry is always fp32.
        backend: computes the costly stages; None: the best one for the device.
        has_skin_detail: whether outline, normals and detail are the skin's own, where it is known (`avatar_surface`).

    Raises:
        LiveHandError: the avatar belongs to another hand model, or the device is not available.
    """

    avatar: Avatar
    hand: HandModel
    device: str = "auto"
    precision: Precision = "fp32"
    backend: ReferenceBackend | None = None
    has_skin_detail: bool = True

    def __post_init__(self):
        if self.hand.sha256 != self.avatar.hand_sha256:
            raise LiveHandError(
                f"avatar '{self.avatar.name}' must be given its own hand model '{self.avatar.hand_name}' "
                f"(sha256 {self.avatar.hand_sha256[:12]}...), got '{self.hand.name}' ({self.hand.sha256[:12]}...); "
                "choose that hand, or an avatar of this one"
            )
        if self._on_gpu is None:
            rendering_device(self.device)

    @torch.inference_mode()
    def render(
        self,
        shot: Shot,
        should_stop: Callable[[], bool] = lambda: False,
        on_stage: OnStage = lambda stage: None,
    ) -> Frame:
        """Render one frame of the shot's size.

        Args:
            shot: the posed hand and its camera.
            should_stop: queried at every stage, and between chunks of rays and bands of super-resolution.
            on_stage: called when a stage begins; the last stage ends with the call.

        Raises:
            LiveHandError: the shot's mesh is not of this hand model.
            RenderStopped: `should_stop` returned True.
        """
        return self.pipeline.render(shot, RenderProgress(should_stop, on_stage))

    @cached_property
    def pipeline(self) -> BakedPipeline | RelightablePipeline:
        """The way of this avatar from a shot to a frame."""
        given = self.avatar, self.hand, self.torch_device, self.precision, self._backend
        if isinstance(self.avatar.field, RelightableField):
            return RelightablePipeline(*given, self.has_skin_detail)
        return BakedPipeline(*given)

    def posed_surface(self, shot: Shot) -> SurfaceMesh | None:
        """Return the avatar's surface as frames show it; None: there is none, they show the mesh's."""
        return self.pipeline.posed_surface(shot)

    def forget(self) -> None:
        """Forget this thread's last hand, so that its next frame is rendered from its pose on, whatever it shows."""
        self.pipeline.forget()

    @property
    def sampler(self) -> SamplerConfig:
        """How rays that meet the hand are sampled."""
        return self.pipeline.sampler

    @property
    def is_relightable(self) -> bool:
        """Whether frames depend on the shot's light."""
        return isinstance(self.avatar.field, RelightableField)

    @property
    def mean_albedo(self) -> np.ndarray | None:
        """[3] linear diffuse reflectance of the skin; None: not known, as light is baked into its colours."""
        return self.pipeline.mean_albedo

    @property
    def frames_at_once(self) -> int:
        """As in `HandRenderer`: any number of threads may render."""
        return self._backend.frames_at_once

    @property
    def renders_at_once(self) -> bool:
        """As in `HandRenderer`."""
        return self.pipeline.renders_at_once

    @cached_property
    def torch_device(self) -> torch.device:
        """The device of torch's stages."""
        return rendering_device(self.device) if self._on_gpu is None else torch.device("cpu")

    @cached_property
    def _backend(self) -> ReferenceBackend:
        return self.backend or self._on_gpu or choose_backend(self.torch_device)

    @cached_property
    def _on_gpu(self) -> ReferenceBackend | None:
        """What renders whole frames on a GPU, if that is asked for; None: torch's stages must, and it knows the GPU."""
        if self.device != "cuda" or self.backend is not None:
            return None
        by_stages = reason_of_avatar(self.avatar, self.hand) is not None or not self.has_skin_detail
        return None if by_stages and torch.cuda.is_available() else gpu_renderer()
