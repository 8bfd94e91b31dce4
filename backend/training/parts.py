"""Everything that training changes: the avatar's networks, and corrections of the capture trained with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

import torch
from torch import Tensor, nn

from ..avatars.avatar import Avatar
from ..capture.capture import CaptureView
from ..field.encoding import FeaturePlane
from ..field.field import PaperField
from .config import TrainConfig
from .schedule import ScheduleState
from .views import TrainingView, TrainingViews

Module = TypeVar("Module", bound=nn.Module)


class Rendered(NamedTuple):
    """RGBA of a crop before [4, h, w] and after [4, 2h, 2w] super-resolution, not clamped."""

    low: Tensor
    image: Tensor


@dataclass(frozen=True)
class Correction:
    """A module that is trained beside the networks and corrects what the capture has wrong.

    Attributes:
        name: its key in checkpoints.
        module: holds its parameters.
        learning_rate: of its parameters; it follows the schedule of the networks.
        begin: called before each step, in every process alike.
        before: maps the training view to the one that the networks see (poses, positions); fp32, with gradients.
        after: maps the rendered crop to what the capture would show (colours); fp32, with gradients.
        penalty: named scalars that are added to the loss of each image.
        finish: stores in the finished avatar what it keeps of the correction.
        settings: what determines the result, in JSON types, for checkpoints and the header of the avatar.
    """

    name: str
    module: nn.Module
    learning_rate: float
    begin: Callable[[TrainingViews, ScheduleState], None] = lambda views, state: None
    before: Callable[[TrainingView, CaptureView], TrainingView] = lambda view, source: view
    after: Callable[[Rendered, CaptureView], Rendered] = lambda rendered, source: rendered
    penalty: Callable[[], Mapping[str, Tensor]] = dict
    finish: Callable[[Avatar], Avatar] = lambda avatar: avatar
    settings: Mapping[str, object] = field(default_factory=dict)


class TrainedParts(nn.Module):
    """The networks and the modules of the corrections, as one module."""

    def __init__(self, avatar: Avatar, corrections: Sequence[Correction] = ()):
        super().__init__()
        self.networks = nn.ModuleList([avatar.field, avatar.superres])
        self.corrections = nn.ModuleDict({correction.name: correction.module for correction in corrections})

    def freeze_all_but_codes(self) -> None:
        """Let only the codes of people learn."""
        for module in self.networks.modules():
            for name, parameter in module.named_parameters(recurse=False):
                parameter.requires_grad_(name == "codes" and isinstance(module, PaperField))

    def with_networks(self, avatar: Avatar) -> Avatar:
        """Return the avatar with these networks."""
        radiance_field, superres = self.networks
        return replace(avatar, field=radiance_field, superres=superres)


class WeightAverage(Generic[Module]):
    """Exponential moving average of a module's parameters (Polyak averaging).

    The decay rises with the steps, min(decay, (1 + step) / (10 + step)): at first the average spans a tenth of the
    steps so far, so that the initial weights are soon forgotten.

    Attributes:
        module: a copy that holds the averages; its buffers are those of the last step.
    """

    def __init__(self, module: Module, decay: float):
        self.module = deepcopy(module).requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def update(self, module: Module, step: int) -> None:
        """Add the weights after a step, counted from 0."""
        decay = min(self._decay, (1 + step) / (10 + step))
        for average, value in zip(self.module.parameters(), module.parameters(), strict=True):
            average.lerp_(value, 1 - decay)
        for average, value in zip(self.module.buffers(), module.buffers(), strict=True):
            average.copy_(value)


def optimiser_of(
    parts: TrainedParts, config: TrainConfig, corrections: Sequence[Correction] = ()
) -> torch.optim.Optimizer:
    """Make the Adam optimiser; `initial_lr` of each parameter group is its full learning rate."""
    planes = [module.table for module in parts.networks.modules() if isinstance(module, FeaturePlane)]
    is_plane = {id(table) for table in planes}
    others = [parameter for parameter in parts.networks.parameters() if id(parameter) not in is_plane]
    groups = [(others, config.learning_rate), (planes, config.plane_learning_rate)]
    groups += [(list(correction.module.parameters()), correction.learning_rate) for correction in corrections]
    return torch.optim.Adam(
        [{"params": parameters, "initial_lr": rate} for parameters, rate in groups if parameters],
        lr=config.learning_rate,
        betas=(0.9, 0.99),
        eps=1e-8,
        fused=True,
    )


def set_rates(optimiser: torch.optim.Optimizer, factor: float) -> None:
    """Set the learning rate of every group to a factor of its full one."""
    for group in optimiser.param_groups:
        group["lr"] = group["initial_lr"] * factor
