"""Fits poses to images with a finished avatar, for an evaluation that does not depend on errors of the given poses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import torch
from torch import nn
from tqdm import tqdm

from ..avatars.avatar import Avatar
from ..capture.capture import Capture, Split
from ..hand.model import HandModel
from ..training.config import LossConfig
from ..training.losses import crop_loss
from ..training.refinement import Refinement, RefinementConfig
from ..training.step import render_view
from ..training.views import TrainingViews


@dataclass(frozen=True)
class PoseFitConfig:
    """Settings of a pose fit."""

    visits: int = 30
    """Number of steps per image."""
    refinement: RefinementConfig = field(
        default_factory=lambda: RefinementConfig(
            beta_deviation=0.0, learning_rate=2e-2, start_share=0.0, retrace_every=25, is_centred=False
        )
    )
    """What is fitted: joint angles and translations."""
    loss: LossConfig = field(default_factory=LossConfig)
    """The loss; its perceptual term is not used."""
    seed: int = 0
    """Seed of the order of the images and of the jitter of the samples."""


def fit_poses(
    avatar: Avatar, capture: Capture, split: Split, hand: HandModel, config: PoseFitConfig, device: torch.device
) -> Capture:
    """Fit the poses of one split of the capture to its images; the avatar is not changed.

    Scores on the same images no longer include the errors of the poses, which a report must state. Poses fitted to the
    images of `novel_pose` may be scored on those of `test`, which show the same poses from other cameras.

    Raises:
        LiveHandError: the capture is of another hand, or the avatar is relightable.
    """
    networks = torch.nn.ModuleList([avatar.field, avatar.superres]).to(device)
    views = TrainingViews(capture, capture.of_split(split), hand, avatar.config.sampler, device, config.seed)
    refinement = Refinement(capture, hand, config.refinement, device, split)
    with _frozen(networks):
        _fit(refinement, views, avatar, config)
    return replace(capture, poses=refinement.poses())


def _fit(refinement: Refinement, views: TrainingViews, avatar: Avatar, config: PoseFitConfig) -> None:
    rate = config.refinement.learning_rate
    optimiser = torch.optim.Adam(refinement.parameters(), lr=rate, betas=(0.9, 0.99))
    random = torch.Generator().manual_seed(config.seed)
    order = [index for _ in range(config.visits) for index in torch.randperm(len(views), generator=random).tolist()]
    for step, index in enumerate(tqdm(order, unit="step", desc="fit poses")):
        progress = step / len(order)
        optimiser.param_groups[0]["lr"] = rate * (1 - progress)
        refinement.begin_step(views, step, progress)
        view = refinement.refined(views.get(index, 0), views.views[index].pose_index)
        low, image = render_view(avatar, views, view)
        loss = crop_loss(low, image, view.target, view.is_inside, config.loss, None).total + refinement.penalty()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()


@contextmanager
def _frozen(networks: nn.Module) -> Iterator[None]:
    """Switch off the gradients of the networks within the context."""
    trained = [parameter for parameter in networks.parameters() if parameter.requires_grad]
    networks.requires_grad_(False)
    try:
        yield
    finally:
        for parameter in trained:
            parameter.requires_grad_(True)
