"""Corrections of a capture's poses, shape and proxy surface, trained through the renderer (the paper's future work).

Fitted poses are wrong by millimetres, differently in each frame, and misalignment makes the avatar blurred. So each
training pose gets a small correction of its joint angles and translation, all frames share one shape, and optionally
the proxy surface gets an offset along its normals. Held-out poses keep their own angles and translations.

Rays are not traced at every step: a sample keeps its face while the hand moves a little (`geometry.reprojection`), and
the views of a pose that has moved farther are traced again.

Images leave two things ambiguous, which are resolved as follows:
- a correction that all poses share can be compensated by the networks. The mean correction over the training poses is
  removed, so that poses that are used without corrections (held-out ones, and those from Blender) fit the avatar;
- shape and surface overlap, and the twist of a round finger changes little. Weight decay keeps such corrections small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..capture.capture import Capture, Split
from ..field.conditions import FrameConditions
from ..field.rays import ray_origin
from ..geometry.mesh import posed_mesh, vertex_normals
from ..geometry.reprojection import reproject
from ..hand.lbs import SkinTensors, pose_hand
from ..hand.model import HandModel
from ..hand.topology import Skinning, topology_of
from ..records.shot import HandPose
from ..records.side import Side
from .views import TrainingView, TrainingViews


@dataclass(frozen=True)
class RefinementConfig:
    """What is refined, and how far.

    Parameters are in units of the expected deviations below, so that one learning rate and one weight decay suit all.
    """

    theta_deviation_rad: float = 0.05
    """Of each coordinate of a joint's axis-angle; 0 keeps the given angles."""
    transl_deviation_m: float = 0.005
    """Of each coordinate of the translation; 0 keeps the given translations."""
    beta_deviation: float = 0.5
    """Of the shape coefficients from the mean of the capture's; 0 keeps that mean."""
    surface_deviation_m: float = 0.0
    """Of the proxy surface along its normals; 0 keeps the surface of the hand model."""
    learning_rate: float = 1e-2
    """Deviations per step."""
    pull: float = 1e-3
    """Weight of the mean squared corrections in the loss."""
    smoothness: float = 10.0
    """Weight, relative to `pull`, of the squared differences of the surface offset along edges."""
    start_share: float = 0.1
    """Share of training before refinement starts: the avatar must first have something to align poses with."""
    is_centred: bool = True
    """Whether the mean correction is removed; not needed if the avatar is fixed."""
    retrace_every: int = 250
    """Steps between checks of how far the poses have moved."""
    retrace_m: float = 2e-4
    """The views of a pose are traced again if any of its vertices has moved farther than this."""


class CorrectedPoses(NamedTuple):
    """Poses with their corrections applied: theta [*b, 16, 3] rad, beta [*b, 10], transl [*b, 3] m.

    `forearm` [*b, 3] rad stays as it is given.
    """

    theta: Tensor
    beta: Tensor
    transl: Tensor
    forearm: Tensor


class Corrections(NamedTuple):
    """Corrections in units of the deviations: theta [*b, 16, 3], beta [*b, 10], transl [*b, 3], surface [*b, V]."""

    theta: Tensor
    beta: Tensor
    transl: Tensor
    surface: Tensor


class Refinement(nn.Module):
    """The corrections of a capture's P poses as parameters.

    Its state also holds the corrections with which the views of each pose were last traced, so that a resumed training
    continues with the same rays.
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
        for name, values in self._current()._asdict().items():
            self.register_buffer(f"traced_{name}", values.detach().clone())
        self._has_placed = False
        self.is_active = False

    @torch.no_grad()
    def begin_step(self, views: TrainingViews, step: int, progress: float) -> None:
        """Update the views for the movement of the poses, before a step.

        Args:
            views: the views to update, the same at every step.
            step: counted from 0.
            progress: share of training that is done.
        """
        self.is_active = progress >= self.config.start_share
        if self.config.is_centred:
            self._centre()
        if not self._has_placed:
            self._move(views, torch.arange(len(self.theta)))
            self._has_placed = True
        if step % self.config.retrace_every == 0:
            self._retrace(views)

    def refined(self, view: TrainingView, pose_index: int) -> TrainingView:
        """Return the view with the corrected pose, with gradients; before refinement starts, the view itself."""
        if not self.is_active:
            return view
        with torch.autocast(self.theta.device.type, enabled=False):
            corrected, vertices = self.pose(pose_index)
            mesh = posed_mesh(self._topology, vertices)
            rays = view.rays
            points = ray_origin(view.camera) + rays.t[..., None] * rays.directions[:, None]
            samples = reproject(points.flatten(0, 1), rays.samples.face, self._topology, mesh)
            visibility = view.conditions.visibility
            conditions = FrameConditions.of(corrected.theta, self._skinning, self._topology, mesh, visibility)
        return view._replace(rays=rays._replace(samples=samples), conditions=conditions, mesh=mesh)

    def pose(self, pose_index: int) -> tuple[CorrectedPoses, Float[Tensor, "V 3"]]:
        """Return a refined pose and its vertices, world, m; with gradients."""
        given = CorrectedPoses(*(values[pose_index] for values in self._given))
        return self._posed(given, Corrections(self.theta[pose_index], self.beta, self.transl[pose_index], self.surface))

    def penalty(self) -> Float[Tensor, ""]:
        """Compute the weight decay of the corrections, added to the loss of each image."""
        corrections = (self.theta, self.beta, self.transl, self.surface)
        size = torch.stack([values.square().mean() for values in corrections]).sum()
        along_edges = self.surface[self._topology.edges].diff(dim=1).square().mean()
        return self.config.pull * (size + self.config.smoothness * along_edges)

    @torch.no_grad()
    def poses(self) -> tuple[HandPose, ...]:
        """Return all refined poses; held-out ones have the shared shape and their own angles and translation."""
        corrected, _ = self._posed(self._given, self._current())
        rows = zip(*(values.double().cpu().numpy() for values in corrected), strict=True)
        return tuple(HandPose(theta, beta, transl, self._side, forearm) for theta, beta, transl, forearm in rows)

    @torch.no_grad()
    def template(self) -> Float[Tensor, "V 3"]:
        """Return the hand model's template with the surface offset, m."""
        return self._displaced(self.surface)

    def _posed(self, given: CorrectedPoses, corrections: Corrections) -> tuple[CorrectedPoses, Float[Tensor, "*b V 3"]]:
        config = self.config
        corrected = CorrectedPoses(
            given.theta + config.theta_deviation_rad * corrections.theta,
            given.beta + config.beta_deviation * corrections.beta,
            given.transl + config.transl_deviation_m * corrections.transl,
            given.forearm,
        )
        skin = self._skin._replace(v_template=self._displaced(corrections.surface))
        return corrected, pose_hand(skin, *corrected).vertices

    def _displaced(self, surface: Float[Tensor, "*b V"]) -> Float[Tensor, "*b V 3"]:
        return self._skin.v_template + self.config.surface_deviation_m * surface[..., None] * self._normals

    def _current(self) -> Corrections:
        """Return the corrections of all poses."""
        count = len(self.theta)
        return Corrections(self.theta, self.beta.expand(count, -1), self.transl, self.surface.expand(count, -1))

    def _traced(self) -> Corrections:
        """Return the corrections of all poses when their views were last traced."""
        return Corrections(*(self.get_buffer(f"traced_{name}") for name in Corrections._fields))

    def _centre(self) -> None:
        """Remove the mean correction of the training poses."""
        for values in (self.theta, self.transl):
            values[self._is_trained] -= values[self._is_trained].mean(0)

    def _retrace(self, views: TrainingViews) -> None:
        """Trace the views of poses that have moved again."""
        _, now = self._posed(self._given, self._current())
        _, then = self._posed(self._given, self._traced())
        moved = ((now - then).norm(dim=-1).amax(1) > self.config.retrace_m).nonzero()[:, 0]
        for traced, values in zip(self._traced(), self._current(), strict=True):
            traced[moved] = values[moved]
        self._move(views, moved)

    def _move(self, views: TrainingViews, poses: Int[Tensor, " M"]) -> None:
        corrected, vertices = self._posed(self._given, self._traced())
        for index in poses.tolist():
            views.move_pose(index, corrected.theta[index], vertices[index])


def _given_poses(poses: tuple[HandPose, ...], is_trained: Bool[Tensor, " P"]) -> CorrectedPoses:
    """Return the capture's poses, all with the mean shape of the training poses."""
    arrays = (np.stack([getattr(pose, name) for pose in poses]) for name in CorrectedPoses._fields)
    given = CorrectedPoses(*(torch.as_tensor(a, dtype=torch.float32, device=is_trained.device) for a in arrays))
    return given._replace(beta=given.beta[is_trained].mean(0).expand(len(given.beta), -1))
