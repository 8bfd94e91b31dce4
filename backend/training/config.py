"""How an avatar is fitted."""

from __future__ import annotations

from dataclasses import dataclass
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
    """The optimisation; one image per step, the whole of it that holds the hand."""

    steps: int = 10000
    """Optimiser steps."""
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
    jitter_sets: int = 1
    """How many different jitters of its samples each image is seen with; each is traced once and kept."""
    checkpoint_every: int = 500
    """Steps between checkpoints."""
    licence: str = "not stated"
    """Of the avatar, kept in its header."""
    loss: LossConfig = LossConfig()
    """The loss's weights."""
