"""The colours of splats, fitted to views by linear least squares while their shapes stay.

What a pixel shows is linear in the harmonics of all splats, with the rasteriser's weights; colours below 0, which
viewers clip, are not kept from. The normal equations are solved by conjugate gradients, preconditioned by each splat's
own block.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ...records.camera import Camera
from .gaussians import DEGREE, MIDDLE, Splats, harmonic_basis
from .lit_views import LitView
from .splat_raster import SplatWeights, splat_weights

ITERATIONS = 8
_LEAST_WEIGHT = 1e-3  # smaller ones are left out, which most are
_LEAST_SUM = 0.05  # of the weights of a splat that has a colour of its own before the fit
_DAMPING = (0.02, 0.1, 0.2, 0.4)
"""By degree, against the sum of squared weights: what few views tell of a splat is not believed."""


class ColorFit:
    """Views of splats as a linear system; views can be added until it is solved.

    Args:
        splats: whose shapes stay.
    """

    def __init__(self, splats: Splats):
        self._splats = splats
        self._weights: list[SplatWeights] = []
        self._bases: list[np.ndarray] = []
        self._targets: list[np.ndarray] = []

    def add(self, view: LitView) -> None:
        """Add a view's picture to what is fitted."""
        weights = splat_weights(self._splats, view.camera).pruned(_LEAST_WEIGHT)
        self._weights.append(weights)
        self._bases.append(_basis(self._splats, view.camera))
        opacity = weights.shown(np.ones((len(self._splats), 1)))
        self._targets.append(view.picture[..., :3].reshape(-1, 3).astype(np.float32) - MIDDLE * opacity)

    def solved(self, start: np.ndarray | None = None, iterations: int = ITERATIONS) -> np.ndarray:
        """Solve for the harmonics [N, 16, 3].

        Args:
            start: of the last frame; None: each splat's mean colour in the views.
            iterations: of conjugate gradients.
        """
        found = self._means() if start is None else start.astype(np.float32)
        damping = np.repeat(np.array(_DAMPING, np.float32), [2 * degree + 1 for degree in range(DEGREE + 1)])[:, None]
        inverse = np.linalg.inv(self._blocks() + np.diag(damping[:, 0]))
        residual = self._gathered(
            target - shown for target, shown in zip(self._targets, self._shown(found), strict=True)
        )
        step = preconditioned = inverse @ residual
        length = (residual * preconditioned).sum((0, 1))
        found = found.copy()
        for _ in range(iterations):
            moved = self._gathered(self._shown(step)) + damping * step
            stride = length / np.maximum((step * moved).sum((0, 1)), np.finfo(np.float32).tiny)
            found += stride * step
            residual -= stride * moved
            preconditioned = inverse @ residual
            before, length = length, (residual * preconditioned).sum((0, 1))
            step = preconditioned + length / np.maximum(before, np.finfo(np.float32).tiny) * step
        return found

    def _means(self) -> np.ndarray:
        """Return harmonics of each splat's mean colour, and of the mean of all for those that no view shows."""
        given, total = np.zeros((len(self._splats), 3)), np.zeros((len(self._splats), 1))
        for weights, target in zip(self._weights, self._targets, strict=True):
            given += weights.gathered(target)
            total += weights.gathered(weights.shown(np.ones((len(self._splats), 1))))
        mean = np.where(total > _LEAST_SUM, given / np.maximum(total, _LEAST_SUM), given.sum(0) / total.sum())
        found = np.zeros((len(self._splats), (DEGREE + 1) ** 2, 3), np.float32)
        found[:, 0] = mean / self._bases[0][0, 0]
        return found

    def _blocks(self) -> np.ndarray:
        """Sum each splat's own block [N, 16, 16] of the normal equations."""
        size = (DEGREE + 1) ** 2
        blocks = np.zeros((len(self._splats), size, size), np.float32)
        for weights, basis in zip(self._weights, self._bases, strict=True):
            squared = weights.squared().gathered(np.ones((weights.pixels, 1)))
            blocks += (squared * basis)[:, :, None] * basis[:, None]
        return blocks

    def _shown(self, harmonics: np.ndarray) -> Iterator[np.ndarray]:
        """Yield what each view shows of harmonics [N, 16, 3]: [H * W, 3]."""
        for weights, basis in zip(self._weights, self._bases, strict=True):
            yield weights.shown((basis[:, None] @ harmonics)[:, 0])

    def _gathered(self, pictures: Iterable[np.ndarray]) -> np.ndarray:
        """Gather pictures of all views onto the harmonics, the transpose of `_shown`."""
        total = np.zeros((len(self._splats), (DEGREE + 1) ** 2, 3), np.float32)
        for weights, basis, picture in zip(self._weights, self._bases, pictures, strict=True):
            total += basis[:, :, None] * weights.gathered(picture)[:, None]
        return total


def _basis(splats: Splats, camera: Camera) -> np.ndarray:
    return harmonic_basis(splats.positions - camera.origin, DEGREE).astype(np.float32)
