"""Distances between the distributions of two sets of images: Frechet and kernel distance of a network's features.

Frechet distance (Heusel et al. 2017): that of the Gaussians with the features' means and covariances. Kernel distance
(Binkowski et al. 2018): the unbiased squared maximum mean discrepancy with the kernel (x.y / D + 1)^3; it may be
negative. Everything is computed in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ...evaluation.perceptual.vgg import PerceptualLoss
from .inception import InceptionFeatures

MIN_IMAGES = 2
"""Below this number of images there is no distance."""
_RESAMPLES = 32
_MAX_RESAMPLED_CHANNELS = 512  # larger covariances take seconds each
_MIN_HAND = 0.5  # of a position's block of pixels


class ImageFeatures(NamedTuple):
    """Features of one image: at P positions [P, D], and their mean [D]; float64 on the CPU."""

    local: Tensor
    mean: Tensor


@runtime_checkable
class FeatureNetwork(Protocol):
    """A named network whose features are compared."""

    @property
    def name(self) -> str:
        """The beginning of the columns' names."""
        ...

    @property
    def is_relative(self) -> bool:
        """Whether features are divided by the mean of the true images', as their scale is arbitrary."""
        ...

    def __call__(self, image: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]) -> ImageFeatures:
        """Compute features of an sRGB-encoded image on black; `hand`: the true hand's pixels."""
        ...


class HandVggFeatures:
    """VGG19's relu3_4, 256 channels, at all positions whose 4 x 4 pixels are mostly the true hand's.

    Few images give thousands of positions, so that the covariance has full rank. Published weights of this network
    differ in the scale of their features.
    """

    name, is_relative = "vgg19", True

    def __init__(self, network: PerceptualLoss):
        self._network = network

    @torch.inference_mode()
    def __call__(self, image: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]) -> ImageFeatures:
        """Compute features as the protocol says."""
        device = self._network.mean.device
        deepest = self._network.features(image.permute(2, 0, 1)[None].float().to(device))[-1][0].double().cpu()
        share = avg_pool2d(hand[None].double(), 4)[0]
        rows, columns = (min(pair) for pair in zip(share.shape, deepest.shape[1:], strict=True))
        is_hand = share[:rows, :columns] > _MIN_HAND
        local = deepest[:, :rows, :columns][:, is_hand].T
        return ImageFeatures(local, local.mean(0) if len(local) else deepest.flatten(1).mean(1))


class WholeInceptionFeatures:
    """The 2048 features of Inception of a whole image, as in published FIDs."""

    name, is_relative = "inception", False

    def __init__(self, network: InceptionFeatures):
        self._network = network

    @torch.inference_mode()
    def __call__(self, image: Float[Tensor, "H W 3"], hand: Bool[Tensor, "H W"]) -> ImageFeatures:
        """Compute features as the protocol says; the hand is not marked out."""
        device = next(self._network.parameters()).device
        found = self._network(image.permute(2, 0, 1)[None].float().to(device))[0].double().cpu()
        return ImageFeatures(found[None], found)


class Distributions:
    """Collects the features of true and rendered images.

    Args:
        network: whose features are compared.
    """

    def __init__(self, network: FeatureNetwork):
        self._network = network
        self._pairs: list[tuple[ImageFeatures, ImageFeatures]] = []

    def add(self, truth: np.ndarray, image: np.ndarray) -> None:
        """Add a true and a rendered image [H, W, 4], encoded on black."""
        true, ours = (torch.as_tensor(x, dtype=torch.float32) for x in (truth, image))
        hand = true[..., 3] > 0.5
        self._pairs.append((self._network(true[..., :3], hand), self._network(ours[..., :3], hand)))

    def figures(self) -> dict[str, float]:
        """Compute `..._frechet` of all positions, `..._kid` of images' means; `..._deviation` by bootstrap over images.

        Empty with fewer than two images, or if none shows the hand.
        """
        if len(self._pairs) < MIN_IMAGES or sum(len(true.local) for true, _ in self._pairs) < MIN_IMAGES:
            return {}
        name, pairs = self._network.name, self._in_units()
        found = {f"{name}_frechet": self._frechet(pairs), f"{name}_kid": self._kid(pairs)}
        if pairs[0][0].mean.shape[0] <= _MAX_RESAMPLED_CHANNELS:
            moments = [tuple(Moments.of(side.local) for side in pair) for pair in pairs]
            found[f"{name}_frechet_deviation"] = _deviation(moments, _frechet_of_moments)
        found[f"{name}_kid_deviation"] = _deviation(pairs, self._kid)
        return found

    def _in_units(self) -> list[tuple[ImageFeatures, ImageFeatures]]:
        """Divide features of true and rendered images by the true ones' mean, if the network asks for it."""
        unit = torch.cat([true.local for true, _ in self._pairs]).mean() if self._network.is_relative else 1.0
        units = [[ImageFeatures(of.local / unit, of.mean / unit) for of in pair] for pair in self._pairs]
        return [(true, ours) for true, ours in units]

    @staticmethod
    def _frechet(pairs: Sequence[tuple[ImageFeatures, ImageFeatures]]) -> float:
        return frechet_distance(*(torch.cat([of.local for of in side]) for side in zip(*pairs, strict=True)))

    @staticmethod
    def _kid(pairs: Sequence[tuple[ImageFeatures, ImageFeatures]]) -> float:
        return kernel_distance(*(torch.stack([of.mean for of in side]) for side in zip(*pairs, strict=True)))


def frechet_distance(a: Float[Tensor, "N D"], b: Float[Tensor, "M D"]) -> float:
    """Compute |m1 - m2|^2 + tr(S1 + S2 - 2 (S1 S2)^(1/2)) of two sets of features; NaN with fewer than two."""
    if min(len(a), len(b)) < MIN_IMAGES:
        return float("nan")
    return gaussian_frechet(*_moments(a), *_moments(b))


def gaussian_frechet(
    mean1: Float[Tensor, " D"], cov1: Float[Tensor, "D D"], mean2: Float[Tensor, " D"], cov2: Float[Tensor, "D D"]
) -> float:
    """Compute the squared Frechet distance of two Gaussians; trace (S1 S2)^(1/2) is that of S1^(1/2) S2 S1^(1/2)."""
    root = _square_root(cov1)
    eigenvalues = torch.linalg.eigvalsh(root @ cov2 @ root)
    trace = cov1.trace() + cov2.trace() - 2 * eigenvalues.clamp(min=0).sqrt().sum()
    return max(0.0, float(((mean1 - mean2) ** 2).sum() + trace))  # rounding may leave it below 0


def kernel_distance(a: Float[Tensor, "N D"], b: Float[Tensor, "M D"]) -> float:
    """Compute unbiased squared maximum mean discrepancy of two sets; NaN with fewer than two of either."""
    n, m = len(a), len(b)
    if min(n, m) < MIN_IMAGES:
        return float("nan")
    within_a, within_b, between = _kernel(a, a), _kernel(b, b), _kernel(a, b)
    of_a = (within_a.sum() - within_a.trace()) / (n * (n - 1))
    of_b = (within_b.sum() - within_b.trace()) / (m * (m - 1))
    return float(of_a + of_b - 2 * between.mean())


@dataclass(frozen=True)
class Moments:
    """Number, sum [D] and sum of outer products [D, D] of vectors."""

    number: int
    total: Tensor
    outer: Tensor

    @classmethod
    def of(cls, x: Float[Tensor, "N D"]) -> Moments:
        """Describe one set."""
        return cls(len(x), x.sum(0), x.T @ x)

    def __add__(self, other: Moments) -> Moments:
        """Merge the moments of both sets."""
        return Moments(self.number + other.number, self.total + other.total, self.outer + other.outer)

    @property
    def gaussian(self) -> tuple[Tensor, Tensor]:
        """Mean and covariance."""
        mean = self.total / self.number
        return mean, (self.outer - self.number * torch.outer(mean, mean)) / (self.number - 1)


def _frechet_of_moments(pairs: Sequence[tuple[Moments, ...]]) -> float:
    sides = [reduce(add, side) for side in zip(*pairs, strict=True)]
    if min(side.number for side in sides) < MIN_IMAGES:
        return float("nan")
    return gaussian_frechet(*sides[0].gaussian, *sides[1].gaussian)


def _deviation(pairs: Sequence, distance: Callable[[Sequence], float]) -> float:
    """Measure the deviation of a distance over bootstrap samples of the images."""
    random = np.random.default_rng(0)
    drawn = (random.integers(0, len(pairs), len(pairs)).tolist() for _ in range(_RESAMPLES))
    return float(np.nanstd([distance([pairs[index] for index in indices]) for indices in drawn]))


def _moments(x: Float[Tensor, "N D"]) -> tuple[Tensor, Tensor]:
    return x.mean(0), torch.cov(x.T).reshape(2 * x.shape[1:])


def _kernel(a: Tensor, b: Tensor) -> Tensor:
    return (a @ b.T / a.shape[1] + 1) ** 3


def _square_root(matrix: Float[Tensor, "D D"]) -> Float[Tensor, "D D"]:
    values, vectors = torch.linalg.eigh(matrix)
    return (vectors * values.clamp(min=0).sqrt()) @ vectors.T
