"""Everything that training changes: the avatar's networks, and corrections of the capture trained along with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ..captures.capture import CaptureView
from ..nerf.avatar import Avatar
from ..nerf.encoding import FeaturePlane
from .config import TrainConfig
from .schedule import ScheduleState
from .views import TrainingView, TrainingViews


class Rendered(NamedTuple):
    """A window's RGBA before [4, h, w] and after [4, 2h, 2w] super-resolution, not clamped."""

    low: Tensor
    image: Tensor


def _begin_nothing(views: TrainingViews, moment: ScheduleState) -> None:
    pass


def _same_view(view: TrainingView, source: CaptureView) -> TrainingView:
    return view


def _same_picture(rendered: Rendered, source: CaptureView) -> Rendered:
    return rendered


def _same_avatar(avatar: Avatar) -> Avatar:
    return avatar


@dataclass(frozen=True)
class Correction:
    """A module that is trained beside the networks and stands between them and the capture.

    Attributes:
        name: its key in checkpoints.
        module: holds its parameters.
        learning_rate: of these; it follows the networks' schedule.
        begin: is told of each step before it is taken, in every process alike.
        before: the training view as the networks shall see it (poses, places); in fp32, with gradients.
        after: the rendered window as the capture would show it (colours); in fp32, with gradients.
        penalty: named scalars that are added to the loss once an image.
        finish: what the finished avatar keeps of it.
        settings: what shapes its course, for checkpoints and the avatar's header; as JSON has it.
    """

    name: str
    module: nn.Module
    learning_rate: float
    begin: Callable[[TrainingViews, ScheduleState], None] = _begin_nothing
    before: Callable[[TrainingView, CaptureView], TrainingView] = _same_view
    after: Callable[[Rendered, CaptureView], Rendered] = _same_picture
    penalty: Callable[[], Mapping[str, Tensor]] = dict
    finish: Callable[[Avatar], Avatar] = _same_avatar
    settings: Mapping[str, object] = field(default_factory=dict)


class TrainedParts(nn.Module):
    """The networks and the corrections' modules, as one module."""

    def __init__(self, avatar: Avatar, corrections: Sequence[Correction] = ()):
        super().__init__()
        self.networks = nn.ModuleList([avatar.field, avatar.superres])
        self.corrections = nn.ModuleDict({correction.name: correction.module for correction in corrections})

    def with_networks(self, avatar: Avatar) -> Avatar:
        """The avatar with these networks."""
        radiance_field, superres = self.networks
        return replace(avatar, field=radiance_field, superres=superres)


def optimiser_of(
    parts: TrainedParts, config: TrainConfig, corrections: Sequence[Correction] = ()
) -> torch.optim.Optimizer:
    """Adam; each group of parameters has its rate at full height as `initial_lr`."""
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


def set_rates(optimiser: torch.optim.Optimizer, share: float) -> None:
    """Every group's learning rate, as a share of its full height."""
    for group in optimiser.param_groups:
        group["lr"] = group["initial_lr"] * share
