"""Perceptual distances between two images, by networks whose weights the user supplies."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .metrics import Similarity, mask_box
from .perceptual.fetched import fetched_lpips
from .perceptual.lpips import LpipsDistance, RangeMode, load_lpips
from .perceptual.vgg import load_vgg_distance

_MARGIN_PX = 16


class Distance(NamedTuple):
    """A distance of images.

    Attributes:
        name: of its column.
        between: of two images [1, 3, H, W], sRGB-encoded in [0, 1].
        device: of both.
        min_side_px: of an image; the distance of smaller ones is undefined.
    """

    name: str
    between: Callable[[Tensor, Tensor], Tensor]
    device: torch.device = torch.device("cpu")
    min_side_px: int = 1


def vgg19_distance(weights: Path, device: torch.device) -> Distance:
    """Load the perceptual loss of training: relative L1 between VGG19 features, uncalibrated and not LPIPS.

    Raises:
        LiveHandError: the file does not hold VGG19.
    """
    return Distance("vgg19", load_vgg_distance(weights).to(device), device)


def lpips_distances(weights: Path, heads: Path, device: torch.device) -> list[Distance]:
    """Load LPIPS if both files are the published ones, else `uncalibrated`: the same formula, images in [-1, 1].

    AlexNet's column is `lpips`, another network's `lpips_NETWORK`. `..._reference` follows: on images in [0, 1], as the
    paper's authors measured.

    Raises:
        LiveHandError: a file is missing or of another network.
    """
    return _in_both_ranges(partial(load_lpips, weights, heads), device)


def fetched_lpips_distances(network: str, device: torch.device) -> list[Distance]:
    """Load LPIPS by a network, `alexnet` or `vgg16`, that `livehand fetch-perceptual` has brought; columns as above.

    Raises:
        LiveHandError: it has not been fetched.
    """
    return _in_both_ranges(partial(fetched_lpips, network), device)


def _in_both_ranges(load: Callable[[RangeMode], LpipsDistance], device: torch.device) -> list[Distance]:
    modes: tuple[tuple[RangeMode, str], ...] = ("standard", ""), ("reference", "_reference")
    distances = [(load(mode).to(device), ending) for mode, ending in modes]
    return [Distance(one.column + ending, one, device, one.backbone.min_side_px) for one, ending in distances]


@torch.inference_mode()
def distance_of(
    distance: Distance, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]
) -> Similarity:
    """Measure the whole image, and the hand's bounding box with a margin of 16 px, within it; NaN if too small."""
    a, b = (x.permute(2, 0, 1)[None].float().to(distance.device) for x in (image, truth))
    box = mask_box(hand, _MARGIN_PX)
    assert box is not None, "views without the hand are skipped"
    return Similarity(_between(distance, a, b), _between(distance, a[..., *box], b[..., *box]))


def _between(distance: Distance, a: Tensor, b: Tensor) -> float:
    return float(distance.between(a, b)) if min(a.shape[-2:]) >= distance.min_side_px else math.nan
