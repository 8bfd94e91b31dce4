"""LISA as the paper's authors re-implemented it in essence: a signed distance and a colour of each bone, blended.

In bone k's frame, two independent MLPs give (s_k, a_k) and c_k; with w = softmax(a), s = sum w_k s_k and
c = sum w_k c_k, and the density is (1 / b) Psi_b(-s), Psi_b being the CDF of Laplace's distribution (VolSDF). Lengths
are the template's millimetres. Sizes, schedule and weights of the losses are our choice: none is published.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor, nn
from torch.nn.functional import relu

from ...capture.capture import Capture
from ...field.encoding import positional_encoding
from ...geometry.bones import points_in_bones
from ...hand.model import HandModel
from ...training.schedule import ScheduleState
from .fitting import fit_network, identity_of
from .method import Budget, Fitted, FittingMachine
from .pixel_rays import PixelRays, RayBatch, RayBatches, RaysInFrame, composite_steps
from .posed_views import PosedViews
from .weights_file import load_network, parameter_count, save_method

BONES = 16
WIDTH, OCTAVES, UNIT_MM = 64, 6, 30.0
SAMPLES = 32
_RAYS = 512
_INPUTS = 3 * (1 + 2 * OCTAVES)
_START_B_MM, _MIN_B_MM = 1.0, 0.05
_RADIUS_MM, _THUMB_RADIUS_MM = 8.0, 10.0
_SOFTNESS_MM = 2.0  # of the weights before training: the nearest capsule's bone has most
_EIKONAL, _SKINNING, _SKINNING_SHARE = 0.1, 0.1, 0.5
_EIKONAL_POINTS = 1024
_FIRST_DISTANCE = 0.05  # scale of the networks' first offsets from the capsules, mm


class BoneMlps(nn.Module):
    """One MLP for each bone, side by side; the pose's part of the first layer is the same for a frame."""

    def __init__(self, layers: int, outputs: int):
        super().__init__()
        sizes = [(_INPUTS, WIDTH), *[(WIDTH, WIDTH)] * (layers - 1), (WIDTH, outputs)]
        self.weights = nn.ParameterList(_uniform(BONES, *size, fan=size[0]) for size in sizes)
        self.biases = nn.ParameterList(_uniform(BONES, 1, size[1], fan=size[0]) for size in sizes)
        self.pose = _uniform(BONES, 48, WIDTH, fan=48)

    def forward(self, encoded: Float[Tensor, "16 S 39"], theta: Float[Tensor, " 48"]) -> Float[Tensor, "16 S O"]:
        """Compute each bone's outputs."""
        of_pose = torch.einsum("p,kpw->kw", theta, self.pose)[:, None]
        hidden = encoded
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            hidden = torch.baddbmm(bias + of_pose if index == 0 else bias, hidden, weight)
            hidden = relu(hidden) if index < len(self.weights) - 1 else hidden
        return hidden


class LisaField(nn.Module):
    """The two sets of networks and b.

    Args:
        segments_mm: [16, M, 2, 3] the lines of each bone's capsule, in its frame.
        radius_mm: [16] of the capsules.
    """

    segments_mm: Tensor
    radius_mm: Tensor

    def __init__(self, segments_mm: Float[Tensor, "16 M 2 3"], radius_mm: Float[Tensor, " 16"]):
        super().__init__()
        self.shape, self.colour = BoneMlps(4, 2), BoneMlps(3, 3)
        self.log_b = nn.Parameter(torch.tensor(_START_B_MM).log())
        self.register_buffer("segments_mm", segments_mm)
        self.register_buffer("radius_mm", radius_mm)
        with torch.no_grad():
            self.shape.weights[-1].mul_(_FIRST_DISTANCE)
            self.shape.biases[-1].zero_()

    @property
    def b_mm(self) -> Tensor:
        """Deviation of the density's edge."""
        return self.log_b.exp().clamp(min=_MIN_B_MM)

    def shapes(
        self, points_mm: Float[Tensor, "S 16 3"], encoded: Float[Tensor, "16 S 39"], theta: Float[Tensor, " 48"]
    ) -> tuple[Float[Tensor, "S 16"], Float[Tensor, "S 16"]]:
        """Compute each bone's signed distance, mm, and its weight's logit; both start from the bone's capsule."""
        found = self.shape(encoded, theta)
        capsule = capsule_distance(points_mm, self.segments_mm, self.radius_mm)
        return capsule + found[..., 0].T, found[..., 1].T - capsule / _SOFTNESS_MM

    def forward(
        self, points_mm: Float[Tensor, "S 16 3"], theta: Float[Tensor, " 48"]
    ) -> tuple[Float[Tensor, " S"], Float[Tensor, "S 3"], Float[Tensor, "S 16"]]:
        """Compute the blended signed distance, mm, colour, and the bones' log weights."""
        encoded = encoded_in_bones(points_mm)
        distance, logit = self.shapes(points_mm, encoded, theta)
        colour = self.colour(encoded, theta).permute(1, 0, 2).sigmoid()
        return (*blended(distance, colour, logit), logit.log_softmax(-1))


def blended(
    distance: Float[Tensor, "S 16"], colour: Float[Tensor, "S 16 3"], logit: Float[Tensor, "S 16"]
) -> tuple[Float[Tensor, " S"], Float[Tensor, "S 3"]]:
    """Blend distance and colour with the weights softmax(logit)."""
    weight = logit.softmax(-1)
    return (weight * distance).sum(-1), (weight[..., None] * colour).sum(1)


def laplace_density(distance: Float[Tensor, "*n"], b: Tensor) -> Float[Tensor, "*n"]:
    """Compute (1 / b) Psi_b(-s) per unit of length: 1 / b deep inside, 0 far outside."""
    half = 0.5 * torch.exp(-distance.abs() / b)
    return torch.where(distance > 0, half, 1 - half) / b


def capsule_distance(
    positions: Float[Tensor, "S 16 3"], segments: Float[Tensor, "16 M 2 3"], radius: Float[Tensor, " 16"]
) -> Float[Tensor, "S 16"]:
    """Compute distance to the nearest of each bone's lines, less its radius."""
    start, along = segments[:, :, 0], segments[:, :, 1] - segments[:, :, 0]
    offset = positions[:, :, None, :] - start
    share = ((offset * along).sum(-1) / (along**2).sum(-1).clamp(min=1e-9)).clamp(0, 1)
    squared = ((offset - share[..., None] * along) ** 2).sum(-1).amin(-1)
    return squared.clamp(min=1e-9).sqrt() - radius


def capsules(hand: HandModel) -> tuple[Float[Tensor, "16 5 2 3"], Float[Tensor, " 16"]]:
    """Draw each bone at rest as lines in its frame, mm: to the next joints; from a last joint to the fingertip."""
    joints, children = hand.joints, [np.flatnonzero(hand.parents == k) for k in range(BONES)]
    segments = np.zeros((BONES, 5, 2, 3))
    for k in range(BONES):
        ends = joints[children[k]] if len(children[k]) else _tip(hand, k)[None]
        segments[k, :, 1] = (np.resize(ends, (5, 3)) if len(ends) != 5 else ends) - joints[k]
    radius = np.full(BONES, _RADIUS_MM)
    radius[13:] = _THUMB_RADIUS_MM
    return torch.as_tensor(1000 * segments, dtype=torch.float32), torch.as_tensor(radius, dtype=torch.float32)


def _tip(hand: HandModel, joint: int) -> np.ndarray:
    """Find the end of a finger's last bone, a radius before its skin."""
    towards = hand.joints[joint] - hand.joints[hand.parents[joint]]
    towards = towards / np.linalg.norm(towards)
    own = hand.v_template[hand.lbs_weights[:, joint] > 0.5] - hand.joints[joint]
    reach = float((own @ towards).max(initial=0.02))
    return hand.joints[joint] + max(reach - _RADIUS_MM / 1000, 0.005) * towards


def render_rays(
    field: LisaField,
    rays: PixelRays,
    bones: Float[Tensor, "16 4 4"],
    theta: Float[Tensor, "16 3"],
    generator: torch.Generator | None = None,
) -> tuple[Float[Tensor, "R 4"], Float[Tensor, "S 16"], Float[Tensor, "S 3"]]:
    """Render RGBA, and of all samples the bones' log weights and the positions in the world, m."""
    t = rays.stratified(SAMPLES, generator)
    points = rays.points(t).flatten(0, 1)
    points_mm = 1000 / rays.scale * points_in_bones(points, bones)
    distance, colour, log_weights = field(points_mm, theta.flatten())
    density = laplace_density(distance, field.b_mm).reshape(t.shape)
    channels, alpha, _ = composite_steps(density, colour.reshape(*t.shape, 3), rays.steps_mm(t))
    return torch.cat([channels, alpha[:, None]], 1), log_weights, points


@dataclass(frozen=True)
class Lisa:
    """The method."""

    name: str = "lisa"
    label: str = "LISA, as re-implemented"
    tables: tuple[str, ...] = ("comparison",)
    version: int = 1
    notes: str = (
        "After the paper's remark that its authors re-implemented the essential ideas; sizes, schedule and weights are "
        "ours: 16 bones, 4 x 64 for distance and weight, 3 x 64 for colour, no view, no codes, no pose refinement; "
        "distances and weights start from capsules; 512 rays of 32 samples a step, between the surfaces of the mesh "
        "inflated by 10 mm; L1 colour, L2 alpha, eikonal term, cross-entropy to skinning weights in the first half. "
        "Published figures of LISA itself are of unreleased data and stand in no relation to this row."
    )

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Train the bones' networks."""
        views = PosedViews(capture, hand, machine.device, machine.seed)
        config = budget.train_config(learning_rate=1e-3, seed=machine.seed)
        field, batches = self._field(hand, machine.seed).to(machine.device), RayBatches(views, _RAYS, machine.seed)
        skinning = _NearestSkinning(views)

        def step_loss(state: ScheduleState) -> tuple[Tensor, tuple[str, ...]]:
            generator = batches.generator(state.step)
            batch = batches.at(generator)
            losses = [_loss(field, part, skinning, state.progress, generator) for part in batch]
            return torch.stack(losses).mean(), tuple(part.file for part in batch)

        identity = identity_of(capture, config, views.views, self.name, self.version)
        progress = fit_network(field, step_loss, config, folder, identity, self.name)
        save_method(folder, self.name, field.state_dict())
        return Fitted(progress.step, progress.seconds / 60, parameter_count(field))

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> RaysInFrame:
        """Load the trained method."""
        field = load_network(folder, self.name, self._field(hand, 0)).to(device)
        assert isinstance(field, LisaField)

        def query(rays: PixelRays, bones: Tensor, theta: Tensor) -> Tensor:
            return render_rays(field, rays, bones, theta)[0]

        return RaysInFrame(hand, query, device)

    def _field(self, hand: HandModel, seed: int) -> LisaField:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return LisaField(*capsules(hand))


class _NearestSkinning:
    """Skinning weights of the vertex nearest to a point, in its pose."""

    def __init__(self, views: PosedViews):
        self._weights = torch.as_tensor(views.hand.lbs_weights, dtype=torch.float32, device=views.device)
        self._views = views
        self._trees: dict[str, KDTree] = {}

    def at(self, points: Float[Tensor, "S 3"], file: str) -> Float[Tensor, "S 16"]:
        """Compute weights at world points of the pose of an image."""
        if file not in self._trees:
            index = next(k for k, view in enumerate(self._views.views) if view.file == file)
            self._trees[file] = KDTree(self._views.window(index).mesh.vertices.cpu().numpy())
        _, nearest = self._trees[file].query(points.detach().cpu().numpy())
        return self._weights[torch.as_tensor(nearest, device=self._weights.device)]


def _loss(
    field: LisaField, part: RayBatch, skinning: _NearestSkinning, progress: float, generator: torch.Generator
) -> Tensor:
    image, log_weights, points = render_rays(field, part.rays, part.bones, part.theta, generator)
    error = image - part.target
    loss = error[:, :3].abs().mean() + (error[:, 3] ** 2).mean()
    if progress < _SKINNING_SHARE:
        loss = loss - _SKINNING * (skinning.at(points, part.file) * log_weights).sum(-1).mean()
    chosen = torch.randint(len(points), (_EIKONAL_POINTS // 4,), generator=generator, device=points.device)
    return loss + _EIKONAL * _eikonal(field, points[chosen], part)


def _eikonal(field: LisaField, points: Float[Tensor, "S 3"], part: RayBatch) -> Tensor:
    """Compute mean squared difference from 1 of the blended distance's slope."""
    positions = (points * 1000 / part.rays.scale).detach().requires_grad_()
    bones = part.bones.clone()
    bones[:, :3, 3] *= 1000 / part.rays.scale
    in_bones = points_in_bones(positions, bones)
    distance, logit = field.shapes(in_bones, encoded_in_bones(in_bones), part.theta.flatten())
    blend = (logit.softmax(-1) * distance).sum()
    (slope,) = torch.autograd.grad(blend, positions, create_graph=True)
    return ((slope.norm(dim=-1) - 1) ** 2).mean()


def encoded_in_bones(points_mm: Float[Tensor, "S 16 3"]) -> Float[Tensor, "16 S 39"]:
    """Encode the networks' inputs, bone by bone."""
    return positional_encoding(points_mm / UNIT_MM, OCTAVES).transpose(0, 1)


def _uniform(*shape: int, fan: int) -> nn.Parameter:
    bound = fan**-0.5
    return nn.Parameter(torch.empty(shape).uniform_(-bound, bound))


LISA = Lisa()
