"""Corrections of a capture's poses, shape and proxy surface, learnt through the renderer (the paper's future work).

Fitted hands are millimetres off, differently in each frame, and what is not aligned is learnt as blur. So each training
pose gets a small correction of its joint angles and its place, the subject one shape for all frames, and, if asked for,
the proxy surface one offset along its normals. Held-out poses keep their own angles and places.

Rays are not traced anew at every step: a sample keeps its face while the hand moves a little (`geometry.reprojection`),
and the views of a pose that has moved farther are traced again.

What cannot be told from pictures, and is settled here:
- a correction that all poses share could be the look's as well as the poses'. The mean correction over the training
  poses is taken out, so that poses that are used as given, held-out ones and those of Blender, still fit the avatar;
- shape and surface overlap, as does what a joint's twist does to a round finger: a weak pull to zero decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..captures.capture import Capture, Split
from ..geometry.mesh import posed_mesh, vertex_normals
from ..geometry.reprojection import reproject
from ..hand.lbs import SkinTensors, pose_hand
from ..hand.model import HandModel
from ..hand.topology import Skinning, topology_of
from ..nerf.conditions import FrameConditions
from ..nerf.rays import ray_origin
from ..records.shot import HandPose, Side
from .views import TrainingView, TrainingViews


@dataclass(frozen=True)
class RefinementConfig:
    """What is refined, and how far.

    Parameters count in the expected deviations below, so that one learning rate and one pull to zero serve all.
    """

    theta_deviation_rad: float = 0.05
    """Of a joint's axis-angle, each coordinate; 0: as given."""
    transl_deviation_m: float = 0.005
    """Of the hand's place, each coordinate; 0: as given."""
    beta_deviation: float = 0.5
    """Of the one shape's coefficients from the mean of the capture's; 0: that mean."""
    surface_deviation_m: float = 0.0
    """Of the proxy surface along its normals; 0: the hand model's own surface."""
    learning_rate: float = 1e-2
    """In deviations a step."""
    pull: float = 1e-3
    """Weight of the mean squared corrections in the loss."""
    smoothness: float = 10.0
    """Weight, beside the pull's, of the surface offset's squared differences along edges."""
    start_share: float = 0.1
    """Of training, before which the avatar has nothing to align poses with."""
    is_centred: bool = True
    """Whether what all poses share is taken out of their corrections: not where the avatar is given."""
    retrace_every: int = 250
    """Steps between looks at how far the poses have moved."""
    retrace_m: float = 2e-4
    """A pose that has moved farther, at any vertex, has its views traced anew."""


class Corrected(NamedTuple):
    """Poses with their corrections: theta [*b, 16, 3] rad, beta [*b, 10], transl [*b, 3] m."""

    theta: Tensor
    beta: Tensor
    transl: Tensor


class Corrections(NamedTuple):
    """In deviations: theta [*b, 16, 3], beta [*b, 10], transl [*b, 3], surface [*b, V]."""

    theta: Tensor
    beta: Tensor
    transl: Tensor
    surface: Tensor


class Refinement(nn.Module):
    """The corrections of a capture's P poses as parameters.

    Its state also holds where each pose was when its views were last traced, so that a resumed training goes on with
    the same rays.
    """

    def __init__(
        self,
        capture: Capture,
        hand: HandModel,
        config: RefinementConfig,
        device: torch.device,
        split: Split = "train",
    ):
        super().__init__()
        self.config = config
        self._side: Side = hand.side
        self._skin, self._topology = SkinTensors.of(hand, device), topology_of(hand, device)
        self._skinning = Skinning.of(hand, device)
        self._normals = vertex_normals(self._skin.v_template, self._topology.faces)
        trained = {view.pose_index for view in capture.of_split(split)}
        self._is_trained = torch.tensor([index in trained for index in range(len(capture.poses))], device=device)
        self._given = _given_poses(capture.poses, self._is_trained)
        self.theta = nn.Parameter(torch.zeros_like(self._given.theta))
        self.beta = nn.Parameter(torch.zeros(10, device=device))
        self.transl = nn.Parameter(torch.zeros_like(self._given.transl))
        self.surface = nn.Parameter(torch.zeros(len(self._normals), device=device))
        for name, values in self._now()._asdict().items():
            self.register_buffer(f"traced_{name}", values.detach().clone())
        self._has_placed = False
        self.is_active = False

    @torch.no_grad()
    def begin_step(self, views: TrainingViews, step: int, share: float) -> None:
        """Bring the views up to the poses' movement, before a step.

        Args:
            views: whose hands follow, the same at every step.
            step: counted from 0.
            share: of training that is done.
        """
        self.is_active = share >= self.config.start_share
        if self.config.is_centred:
            self._centre()
        if not self._has_placed:
            self._move(views, torch.arange(len(self.theta)))
            self._has_placed = True
        if step % self.config.retrace_every == 0:
            self._retrace(views)

    def refined(self, view: TrainingView, pose_index: int) -> TrainingView:
        """The view with its hand where the corrections put it, with gradients; as it is before refinement starts."""
        if not self.is_active:
            return view
        with torch.autocast(self.theta.device.type, enabled=False):
            corrected, vertices = self.pose(pose_index)
            mesh = posed_mesh(self._topology, vertices)
            rays = view.rays
            points = ray_origin(view.view) + rays.t[..., None] * rays.directions[:, None]
            samples = reproject(points.flatten(0, 1), rays.samples.face, self._topology, mesh)
            visibility = view.conditions.visibility
            conditions = FrameConditions.of(corrected.theta, self._skinning, self._topology, mesh, visibility)
        return view._replace(rays=rays._replace(samples=samples), conditions=conditions, mesh=mesh)

    def pose(self, pose_index: int) -> tuple[Corrected, Float[Tensor, "V 3"]]:
        """A pose as refined, and its vertices, world, m; with gradients."""
        given = Corrected(*(values[pose_index] for values in self._given))
        return self._posed(given, Corrections(self.theta[pose_index], self.beta, self.transl[pose_index], self.surface))

    def penalty(self) -> Float[Tensor, ""]:
        """The pull to zero, once an image."""
        corrections = (self.theta, self.beta, self.transl, self.surface)
        size = torch.stack([values.square().mean() for values in corrections]).sum()
        along_edges = self.surface[self._topology.edges].diff(dim=1).square().mean()
        return self.config.pull * (size + self.config.smoothness * along_edges)

    @torch.no_grad()
    def poses(self) -> tuple[HandPose, ...]:
        """All poses as refined; held-out ones with the one shape and their own angles and place."""
        corrected, _ = self._posed(self._given, self._now())
        rows = zip(*(values.double().cpu().numpy() for values in corrected), strict=True)
        return tuple(HandPose(theta, beta, transl, self._side) for theta, beta, transl in rows)

    @torch.no_grad()
    def template(self) -> Float[Tensor, "V 3"]:
        """The hand model's template with the surface's offset, m."""
        return self._displaced(self.surface)

    def _posed(self, given: Corrected, corrections: Corrections) -> tuple[Corrected, Float[Tensor, "*b V 3"]]:
        config = self.config
        corrected = Corrected(
            given.theta + config.theta_deviation_rad * corrections.theta,
            given.beta + config.beta_deviation * corrections.beta,
            given.transl + config.transl_deviation_m * corrections.transl,
        )
        skin = self._skin._replace(v_template=self._displaced(corrections.surface))
        return corrected, pose_hand(skin, *corrected).vertices

    def _displaced(self, surface: Float[Tensor, "*b V"]) -> Float[Tensor, "*b V 3"]:
        return self._skin.v_template + self.config.surface_deviation_m * surface[..., None] * self._normals

    def _now(self) -> Corrections:
        """Of all poses."""
        count = len(self.theta)
        return Corrections(self.theta, self.beta.expand(count, -1), self.transl, self.surface.expand(count, -1))

    def _traced(self) -> Corrections:
        """Of all poses, when their views were last traced."""
        return Corrections(*(self.get_buffer(f"traced_{name}") for name in Corrections._fields))

    def _centre(self) -> None:
        """Take out what all training poses share."""
        for values in (self.theta, self.transl):
            values[self._is_trained] -= values[self._is_trained].mean(0)

    def _retrace(self, views: TrainingViews) -> None:
        """Have the views of poses that have moved traced anew."""
        _, now = self._posed(self._given, self._now())
        _, then = self._posed(self._given, self._traced())
        moved = ((now - then).norm(dim=-1).amax(1) > self.config.retrace_m).nonzero()[:, 0]
        for traced, values in zip(self._traced(), self._now(), strict=True):
            traced[moved] = values[moved]
        self._move(views, moved)

    def _move(self, views: TrainingViews, poses: Int[Tensor, " M"]) -> None:
        corrected, vertices = self._posed(self._given, self._traced())
        for index in poses.tolist():
            views.move_pose(index, corrected.theta[index], vertices[index])


def _given_poses(poses: tuple[HandPose, ...], is_trained: Bool[Tensor, " P"]) -> Corrected:
    """The capture's poses, with the mean shape of the training ones for all."""
    arrays = (np.stack([getattr(pose, name) for pose in poses]) for name in Corrected._fields)
    theta, beta, transl = (torch.as_tensor(a, dtype=torch.float32, device=is_trained.device) for a in arrays)
    return Corrected(theta, beta[is_trained].mean(0).expand(len(beta), -1), transl)
