"""Perceptual distances between two images, by networks whose weights the user supplies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .metrics import Similarity, mask_box
from .perceptual.lpips import RangeMode, load_lpips
from .perceptual.vgg import load_vgg_distance

_MARGIN_PX = 16


class Distance(NamedTuple):
    """A column's name, the distance of two images [1, 3, H, W], sRGB-encoded in [0, 1], and its device."""

    name: str
    between: Callable[[Tensor, Tensor], Tensor]
    device: torch.device = torch.device("cpu")


def vgg19_distance(weights: Path, device: torch.device) -> Distance:
    """Load the perceptual loss of training: relative L1 between VGG19 features, uncalibrated and not LPIPS.

    Raises:
        LiveHandError: the file does not hold VGG19.
    """
    return Distance("vgg19", load_vgg_distance(weights).to(device), device)


def lpips_distances(weights: Path, heads: Path, device: torch.device) -> list[Distance]:
    """Load `lpips` if both files are the published ones, else `uncalibrated`: the same formula, images in [-1, 1].

    `..._reference` follows: on images in [0, 1], as the paper's authors measured.

    Raises:
        LiveHandError: a file is missing or of another network.
    """
    modes: tuple[tuple[RangeMode, str], ...] = ("standard", ""), ("reference", "_reference")
    distances = [(load_lpips(weights, heads, mode).to(device), ending) for mode, ending in modes]
    return [Distance(("lpips" if d.is_lpips else "uncalibrated") + ending, d, device) for d, ending in distances]


@torch.inference_mode()
def distance_of(
    distance: Distance, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]
) -> Similarity:
    """Measure the whole image, and the hand's bounding box with a margin of 16 px, within the image."""
    a, b = (x.permute(2, 0, 1)[None].float().to(distance.device) for x in (image, truth))
    box = mask_box(hand, _MARGIN_PX)
    assert box is not None, "views without the hand are skipped"
    return Similarity(float(distance.between(a, b)), float(distance.between(a[..., *box], b[..., *box])))
