"""Settings of training: the loss, the optimisation, and what is reported.

The names, the order and the defaults of these fields are part of the identity of a run in its checkpoint.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Literal

from ..system.command import parse_count
from ..system.options import number_parser

Count = Annotated[int, parse_count]
Minutes = Annotated[float, number_parser("a number of minutes", lambda value: 0 <= value < inf)]
Budget = Annotated[float, number_parser("a number of minutes above 0", lambda value: 0 < value < inf)]
Decay = Annotated[float, number_parser("a number from 0 to below 1", lambda value: 0 <= value < 1)]
Region = Literal["crop", "patch", "patch_all"]


@dataclass(frozen=True)
class LossConfig:
    """Weights of the terms of the loss. Colour is sRGB-encoded, premultiplied, and in [0, 1]."""

    colour_l2: float = 10.0
    """Squared colour error at full resolution."""
    colour_l1: float = 0.5
    """Absolute colour error at full resolution; it gives sharper images than squared error alone."""
    alpha_l2: float = 4.0
    """Squared alpha error at full resolution."""
    low_l2: float = 5.0
    """Squared error of the low-resolution colour and alpha before super-resolution."""
    perceptual: float = 0.01
    """Weight of the perceptual loss, a VGG feature distance at both resolutions; 0 turns it off."""
    perceptual_share: float = 0.2
    """Share of training, at its end, that has the perceptual term: on a CPU the term doubles the time of a step."""
    perceptual_rise: float = 0.1
    """Share of that part, at its start, over which the weight of the term rises linearly from 0."""
    perceptual_region: Region = "crop"
    """What the perceptual loss sees: the whole crop that holds the hand (the paper's full image without its empty
    border), or one random 64x64 patch on the hand. `patch_all`: every term sees that patch alone (the paper's
    ablation)."""
    perceptual_patch_px: int = 64
    """Side of that patch at full resolution; at half resolution it covers the same skin."""


@dataclass(frozen=True)
class TrainConfig:
    """Settings of the optimisation."""

    steps: Count = 10000
    """Number of optimiser steps."""
    minutes: Budget | None = None
    """Wall-clock budget instead of a number of steps; the schedules then follow the elapsed time."""
    batch: Count = 1
    """Images per step, over all processes; their gradients are averaged."""
    seed: int = 0
    """Seed of the weights, the order of the images, and the jitter of the samples."""
    learning_rate: float = 2e-3
    """Learning rate of the networks."""
    plane_learning_rate: float = 8e-3
    """Learning rate of the feature planes, each texel of which sees few samples."""
    final_learning_rate: float = 0.02
    """Share of the learning rates that remains at the end."""
    decay: Literal["cosine", "exponential"] = "cosine"
    """How the learning rates fall to that share."""
    warmup_steps: int = 100
    """Steps over which the learning rates rise linearly at the start."""
    warmup_share: float = 0.01
    """The same as a share of `minutes`."""
    ema_decay: Decay = 0.0
    """Decay of the moving average of the weights that the avatar gets; 0 keeps the weights of the last step, which are
    settled already because the learning rates decay."""
    max_skipped: int = 10
    """Number of successive steps skipped for a non-finite loss or gradient after which training stops."""
    jitter_sets: int = 1
    """Number of different sample jitters per image; each is traced once and kept."""
    checkpoint_every: int = 500
    """Steps between checkpoints."""
    checkpoint_minutes: float = 5.0
    """Longest time between checkpoints, minutes."""
    licence: str = "not stated"
    """Licence of the avatar, kept in the header of its file."""
    loss: LossConfig = LossConfig()
    """Weights of the loss."""


PAPER = TrainConfig(
    steps=300_000,
    learning_rate=2.5e-3,
    final_learning_rate=0.1 ** (300 / 250),
    decay="exponential",
    warmup_steps=1,
    loss=LossConfig(
        colour_l2=1.0,
        colour_l1=0.0,
        alpha_l2=1.0,
        low_l2=4 / 3,  # the mean over colour and alpha; colour gets 1
        perceptual=1.0,
        perceptual_share=1.0,
        perceptual_rise=0.0,
    ),
)
"""The paper's training: squared error and LPIPS 1 : 1 at both resolutions from the first step, and a tenth of the
learning rate after each 250,000 steps. Alpha, which its pictures do not have, is ours."""
PAPER_CAMERA_RATE = 1e-4
"""Learning rate of the gains and biases of its cameras."""


@dataclass(frozen=True)
class ReportConfig:
    """What is reported and how often; it does not change the result."""

    log_every: int = 50
    """Steps between log entries, each of which holds the means over these steps."""
    preview_minutes: Minutes = 5.0
    """Minutes between contact sheets of held-out views, written beside the avatar; 0 turns them off."""
    preview_views: int = 8
    """Number of held-out views in a preview."""
    tensorboard: Path | None = None
    """Folder in which TensorBoard event files are written."""
