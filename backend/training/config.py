"""How an avatar is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss's terms; colour is sRGB-encoded, premultiplied, in [0, 1]."""

    colour_l2: float = 10.0
    """Squared colour error, full resolution."""
    colour_l1: float = 0.5
    """Absolute colour error, full resolution: sharper than squares alone."""
    alpha_l2: float = 4.0
    """Squared alpha error, full resolution."""
    low_l2: float = 5.0
    """Squared error of the low-resolution colour and alpha before super-resolution."""
    perceptual: float = 0.01
    """VGG feature distance, at both resolutions."""
    perceptual_share: float = 0.2
    """The last part of training that has the perceptual term: on a CPU it doubles a step's cost."""
    perceptual_rise: float = 0.1
    """Share of that part over whose start the term's weight rises linearly from nothing."""
    perceptual_region: Literal["window", "patch"] = "window"
    """What the term sees: the whole window that holds the hand, which is the paper's full image without its empty
    border, or one random patch on the hand, the paper's ablation."""
    perceptual_patch_px: int = 64
    """Side of that patch at full resolution; the same skin at half resolution."""


@dataclass(frozen=True)
class TrainConfig:
    """The optimisation; of each image the whole of it that holds the hand."""

    steps: int = 10000
    """Optimiser steps; without meaning where `minutes` is given."""
    minutes: float | None = None
    """Wall-clock budget; the schedules follow its elapsed share instead of the share of the steps."""
    batch: int = 1
    """Images per step, of all processes together; their gradients are averaged."""
    seed: int = 0
    """Of weights, order of images, and jitter."""
    learning_rate: float = 2e-3
    """Of the networks."""
    plane_learning_rate: float = 8e-3
    """Of the feature planes, which see few samples each."""
    final_learning_rate: float = 0.02
    """Share of the learning rates that is left at the end (cosine decay)."""
    warmup_steps: int = 100
    """Linear rise of the learning rates at the start."""
    warmup_share: float = 0.01
    """The same as a share of `minutes`."""
    ema_decay: float = 0.0
    """Of the moving average of the weights, which is what the avatar gets; 0: the last step's weights, which the decay
    of the learning rates has calmed already."""
    max_skipped: int = 10
    """Steps in a row that may be skipped because a loss or gradient was not finite; after that training ends."""
    jitter_sets: int = 1
    """How many different jitters of its samples each image is seen with; each is traced once and kept."""
    checkpoint_every: int = 500
    """Steps between checkpoints."""
    checkpoint_minutes: float = 5.0
    """Minutes after which there is a checkpoint in any case."""
    licence: str = "not stated"
    """Of the avatar, kept in its header."""
    loss: LossConfig = LossConfig()
    """The loss's weights."""


@dataclass(frozen=True)
class ReportConfig:
    """What to tell, and how often; nothing of it changes the result."""

    log_every: int = 50
    """Steps between lines of the log, which hold the means over them."""
    preview_minutes: float = 5.0
    """Between previews, and one at the end; 0: none."""
    preview_views: int = 8
    """Held-out views in a preview."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files."""
