"""One step of training: render a step's views, compare, and move the weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

import torch
from torch import Tensor

from ..captures.capture import CaptureView
from ..nerf.avatar import Avatar
from ..nerf.backend import Precision
from ..nerf.maps import image_of, low_resolution_maps
from ..nerf.rays import HandInView
from .clock import Clock
from .config import TrainConfig
from .losses import crop_loss
from .parts import Correction, Rendered, TrainedParts, set_rates
from .perceptual import PerceptualDistance
from .processes import Processes
from .schedule import ScheduleState, views_of_step
from .views import TrainingView, TrainingViews


@dataclass(frozen=True)
class Machine:
    """What training runs on.

    Attributes:
        device: of this process.
        precision: bf16 is autocast; weights, losses and gradients of weights are fp32.
        processes: this one among all.
    """

    device: torch.device
    precision: Precision = "fp32"
    processes: Processes = field(default_factory=Processes)


class StepResult(NamedTuple):
    """What a step came to.

    Attributes:
        terms: the loss's, by name, and `total`: means over the step's views.
        faulty_files: images whose loss or gradient was not finite; then the weights are as before.
    """

    terms: dict[str, float]
    faulty_files: tuple[str, ...]


@dataclass(frozen=True)
class Stepper:
    """Takes steps.

    Attributes:
        avatar: wears the networks in `parts`.
        parts: all that is trained.
        optimiser: of the parts.
        views: what is shown.
        config: the optimisation.
        machine: what it runs on.
        clock: is told of the time spent waiting for images.
        perceptual: None: without that term.
        corrections: of the capture, in the order in which they are applied.
    """

    avatar: Avatar
    parts: TrainedParts
    optimiser: torch.optim.Optimizer
    views: TrainingViews
    config: TrainConfig
    machine: Machine
    clock: Clock
    perceptual: PerceptualDistance | None = None
    corrections: tuple[Correction, ...] = ()

    def take(self, moment: ScheduleState) -> StepResult:
        """Render and compare the step's views, and move the weights unless something is not finite."""
        set_rates(self.optimiser, moment.rate)
        self.optimiser.zero_grad(set_to_none=True)
        for correction in self.corrections:
            correction.begin(self.views, moment)
        visits = views_of_step(moment.step, len(self.views), self.config)
        terms, losses = self._losses(visits, moment)
        self.machine.processes.sum_gradients(self.parts.parameters())
        faulty = [visit for visit, loss in zip(visits, losses, strict=True) if not isfinite(loss)]
        if not faulty and not _has_finite_gradients(self.parts):
            faulty = visits
        if not faulty:
            self.optimiser.step()
        return StepResult(terms, tuple(self.views.views[index].file for index, _ in faulty))

    def _losses(self, visits: list[tuple[int, int]], moment: ScheduleState) -> tuple[dict[str, float], list[float]]:
        """Mean terms, and the loss of each visit; leaves this process's share of the gradient behind."""
        mine = self.machine.processes.share(range(len(visits)))
        means: dict[str, Tensor] = {}
        losses = torch.zeros(len(visits), device=self.machine.device)
        for place in mine:
            index, jitter = visits[place]
            loss, terms = self._loss(index, jitter, moment)
            (loss / len(visits)).backward()
            losses[place] = loss.detach()
            for name, value in {**terms, "total": loss}.items():
                means[name] = means.get(name, 0) + value.detach().float() / len(visits)
        summed = self.machine.processes.sum(torch.cat([losses, torch.stack(list(means.values()))])).tolist()
        return dict(zip(means, summed[len(visits) :], strict=True)), summed[: len(visits)]

    def _loss(self, index: int, jitter: int, moment: ScheduleState) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss of one view, and its terms by name."""
        view, source = self.views.get(index, jitter), self.views.views[index]
        self.clock.waiting_s = self.views.waited_s
        for correction in self.corrections:
            view = correction.before(view, source)
        rendered = self._rendered(view, source)
        perceptual = self.perceptual if moment.perceptual > 0 else None
        patches = torch.Generator().manual_seed(hash((self.config.seed, moment.step, index)) % 2**63)
        with self._autocast():
            terms = crop_loss(
                *rendered, view.target, view.is_inside, self.config.loss, perceptual, moment.perceptual, patches
            )
        penalties = {name: value for correction in self.corrections for name, value in correction.penalty().items()}
        return sum(penalties.values(), terms.total), {**terms._asdict(), **penalties}

    def _rendered(self, view: TrainingView, source: CaptureView) -> Rendered:
        with self._autocast():
            low, image = render_view(self.avatar, self.views, view)
        rendered = Rendered(low.float(), image.float())
        for correction in self.corrections:
            rendered = correction.after(rendered, source)
        return rendered

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.machine.device.type, torch.bfloat16, enabled=self.machine.precision == "bf16")


def render_view(avatar: Avatar, views: TrainingViews, view: TrainingView) -> Rendered:
    """A training view's window."""
    shell_m = avatar.config.sampler.shell_m
    hand = HandInView(view.mesh, views.topology, view.view)
    composite = views.backend.shade(avatar.field, view.rays, hand, view.conditions, shell_m)
    maps, _ = low_resolution_maps(composite, view.rays.pixel, view.view.size_px)
    image, _ = image_of(avatar.superres, composite, view.rays.pixel, view.view.size_px)
    return Rendered(torch.cat([maps[:3], maps[-1:]]), image)


def _has_finite_gradients(parts: TrainedParts) -> bool:
    """By their norm, which is finite where all of them are."""
    gradients = [p.grad for p in parts.parameters() if p.grad is not None]
    return bool(torch.nn.utils.get_total_norm(gradients).isfinite())
