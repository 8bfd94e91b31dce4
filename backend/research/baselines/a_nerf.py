"""A-NeRF: a radiance field that is given where a sample lies relative to every joint (Su et al., NeurIPS 2021).

In joint k's frame a sample has the position x_k, in units of a body: a hand's metres times 9, so that the published
frequencies and the cutoff at 0.5 m mean on a hand what they mean on a body. v_k is the length of x_k.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import normalize, relu

from ...capture.capture import Capture
from ...field.encoding import positional_encoding
from ...field.sampler import strata
from ...geometry.bones import directions_in_bones, points_in_bones
from ...hand.model import HandModel
from ...training.schedule import ScheduleState
from .fitting import fit_network, identity_of
from .method import Budget, Fitted, FittingMachine
from .pixel_rays import PixelRays, RayBatches, RaysInFrame, composite_steps, importance_samples
from .posed_views import PosedViews
from .weights_file import load_network, parameter_count, save_method

JOINTS = 16
DISTANCE_OCTAVES, VIEW_OCTAVES = 7, 4
BODY_PER_HAND = 1.7 / 0.19
CUTOFF = 0.5
"""Distance, in units of a body, at which a joint counts half."""
_FIRST_SHARPNESS, _SHARPER = 20.0, 4.0
_MIN_DISTANCE = 1e-6
_RAYS = 1024


@dataclass(frozen=True)
class ANerfSize:
    """Sizes: those that are published, or less.

    Attributes:
        width: of the eight layers.
        view_width: of the layer that sees the ray.
        samples: stratified, asked of the coarse network.
        fine_samples: by importance, asked of the fine one together with the others.
    """

    width: int = 128
    view_width: int = 64
    samples: int = 24
    fine_samples: int = 8


PUBLISHED = ANerfSize(256, 128, 64, 16)


class JointMlp(nn.Module):
    """Eight layers on positions, whose input is given again after the fifth; one more that sees the ray."""

    def __init__(self, width: int, view_width: int):
        super().__init__()
        inputs = JOINTS * (1 + 2 * DISTANCE_OCTAVES) + 3 * JOINTS
        sizes = [inputs, *[width] * 4, width + inputs, width, width]
        self.trunk = nn.ModuleList(nn.Linear(size, width) for size in sizes)
        self.density = nn.Linear(width, 1)
        self.bottleneck = nn.Linear(width, width)
        self.view = nn.Linear(width + 3 * JOINTS * (1 + 2 * VIEW_OCTAVES), view_width)
        self.colour = nn.Linear(view_width, 3)

    def forward(self, place: Float[Tensor, "S P"], view: Float[Tensor, "S D"]) -> tuple[Tensor, Tensor]:
        """Compute raw density [S] and colour [S, 3]."""
        hidden = place
        for index, layer in enumerate(self.trunk):
            hidden = relu(layer(torch.cat([hidden, place], -1) if index == 5 else hidden))
        seen = relu(self.view(torch.cat([self.bottleneck(hidden), view], -1)))
        return self.density(hidden)[:, 0], self.colour(seen).sigmoid()


class ANerfNetworks(nn.Module):
    """The coarse and the fine network."""

    def __init__(self, size: ANerfSize):
        super().__init__()
        self.size = size
        self.coarse, self.fine = (JointMlp(size.width, size.view_width) for _ in range(2))

    def forward(
        self, rays: PixelRays, bones: Float[Tensor, "16 4 4"], sharpness: float, generator: torch.Generator | None
    ) -> tuple[Float[Tensor, "R 4"], Float[Tensor, "R 4"]]:
        """Render RGBA of the coarse and the fine network; `generator` jitters samples and densities, as in training."""
        size = self.size
        t = rays.stratified(size.samples, generator)
        coarse, weights = self._render(self.coarse, rays, bones, t, sharpness, generator)
        at = strata(len(t), size.fine_samples, t, generator)
        drawn = importance_samples(t, weights, rays.far, at)
        t = torch.cat([t, drawn], 1).sort(1).values
        fine, _ = self._render(self.fine, rays, bones, t, sharpness, generator)
        return coarse, fine

    def _render(
        self,
        network: nn.Module,
        rays: PixelRays,
        bones: Tensor,
        t: Float[Tensor, "R N"],
        sharpness: float,
        generator: torch.Generator | None,
    ) -> tuple[Tensor, Tensor]:
        place, cutoff = encoded_points(points_in_bones(rays.points(t), bones).flatten(0, 1), sharpness)
        directions = normalize(rays.directions, dim=-1)[:, None, None, :].expand(-1, t.shape[1], JOINTS, 3)
        view = encoded_views(directions_in_bones(directions.flatten(0, 1), bones), cutoff)
        raw, colour = network(place, view)
        if generator is not None:
            raw = raw + torch.randn(raw.shape, generator=generator, device=raw.device)
        steps = rays.steps_mm(t) / 1000 * BODY_PER_HAND
        channels, alpha, weights = composite_steps(relu(raw).reshape(t.shape), colour.reshape(*t.shape, 3), steps)
        return torch.cat([channels, alpha[:, None]], 1), weights


def encoded_points(
    positions: Float[Tensor, "S 16 3"], sharpness: float
) -> tuple[Float[Tensor, "S 288"], Float[Tensor, "S 16"]]:
    """Encode positions in bones, m, for the trunk, with the cutoff w_k = 1 - sigmoid(sharpness (v_k - t)).

    Distances, encoded and times w_k, of all joints; then directions, without cutoff.
    """
    positions = positions * BODY_PER_HAND
    distance = positions.norm(dim=-1)
    cutoff = torch.sigmoid(-sharpness * (distance - CUTOFF))
    waves = positional_encoding(distance[..., None], DISTANCE_OCTAVES) * cutoff[..., None]
    directions = positions / distance.clamp(min=_MIN_DISTANCE)[..., None]
    return torch.cat([waves.flatten(1), directions.flatten(1)], 1), cutoff


def encoded_views(directions: Float[Tensor, "S 16 3"], cutoff: Float[Tensor, "S 16"]) -> Float[Tensor, "S 432"]:
    """Encode the ray in every joint's frame, times the cutoff."""
    return (positional_encoding(directions, VIEW_OCTAVES) * cutoff[..., None]).flatten(1)


def sharpness_at(progress: float) -> float:
    """Schedule the cutoff's sharpness: 20 at the start, 80 at the end."""
    return _FIRST_SHARPNESS * _SHARPER**progress


@dataclass(frozen=True)
class ANerf:
    """The method."""

    name: str = "a_nerf"
    label: str = "A-NeRF"
    tables: tuple[str, ...] = ("comparison",)
    version: int = 1
    size: ANerfSize = ANerfSize()
    notes: str = (
        "Our re-implementation, as the paper's row is its authors': two networks 128 wide instead of 256, 24 + 8 "
        "samples instead of 64 + 16, 1,024 rays a step; a hand's metres times 9; rays between the first and last "
        "surface of the mesh inflated by 10 mm, kinder than the published cylinder; colour and alpha; poses as given."
    )

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Train both networks."""
        views = PosedViews(capture, hand, machine.device, machine.seed)
        config = budget.train_config(learning_rate=5e-4, final_learning_rate=0.1, seed=machine.seed)
        networks, batches = self._networks(machine.seed).to(machine.device), RayBatches(views, _RAYS, machine.seed)

        def step_loss(state: ScheduleState) -> tuple[Tensor, tuple[str, ...]]:
            generator, losses = batches.generator(state.step), []
            batch = batches.at(generator)
            for part in batch:
                found = networks(part.rays, part.bones, sharpness_at(state.progress), generator)
                losses += [((image - part.target) ** 2).mean() for image in found]
            return torch.stack(losses).sum() / len(batch), tuple(part.file for part in batch)

        identity = identity_of(capture, config, views.views, f"{self.name} {self.size}", self.version)
        progress = fit_network(networks, step_loss, config, folder, identity, self.name)
        save_method(folder, self.name, networks.state_dict())
        return Fitted(progress.step, progress.seconds / 60, parameter_count(networks))

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> RaysInFrame:
        """Load the trained method."""
        networks = load_network(folder, self.name, self._networks(0)).to(device)

        def query(rays: PixelRays, bones: Tensor, theta: Tensor) -> Tensor:
            return networks(rays, bones, sharpness_at(1.0), None)[1]

        return RaysInFrame(hand, query, device)

    def _networks(self, seed: int) -> ANerfNetworks:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return ANerfNetworks(self.size)


A_NERF = ANerf()
