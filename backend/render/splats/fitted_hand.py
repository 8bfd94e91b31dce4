"""Splats of a hand, frame by frame, fitted to views of it, and how well they show views that are held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...system.child_job import JobProgress, Report
from .color_fit import ITERATIONS, ColorFit
from .flat_splats import HandSurface
from .gaussians import Splats
from .lit_hand import LitHand, SplatOptions
from .lit_views import HELD_OUT, LitView, views_around
from .splat_raster import rasterised

_NEXT_ITERATIONS = ITERATIONS // 2  # from the colours of the frame before


@dataclass(frozen=True)
class FittedSplats:
    """Splats, and the PSNR, dB, of each view that was held out, over all pixels of either picture with the hand."""

    splats: Splats
    held_out_db: np.ndarray


class SplatFitter:
    """Fits the splats of one hand in frame after frame; each splat stays where it is on the skin.

    Args:
        options: of the splats.
        axes: [3, 3] rotation from the world to the axes of the splats.
        should_stop: queried during renders.
    """

    def __init__(self, options: SplatOptions, axes: np.ndarray, should_stop: Callable[[], bool] = lambda: False):
        self._options, self._axes, self._should_stop = options, axes, should_stop
        self._surface: HandSurface | None = None
        self._harmonics: np.ndarray | None = None

    def fitted(self, hand: LitHand, report: Report = lambda progress: None) -> FittedSplats:
        """Fit the splats of a hand's shot, which follow those of the shot before.

        Raises:
            LiveHandError: the avatar is not relightable.
            RenderStopped: `should_stop` returned True.
        """
        if self._surface is None:
            self._surface = HandSurface(hand.renderer, hand.shot, self._options.count)
        flat = self._surface.flat_splats(hand.shot, self._axes)
        fit, total = ColorFit(flat), self._options.views + HELD_OUT
        views, held_out = views_around(hand, self._options, self._axes, self._should_stop)
        for number, view in enumerate(views, 1):
            fit.add(view)
            report(JobProgress(f"view {number} of {total}", 0.8 * number / total))
        report(JobProgress("fitting colors", 0.8))
        iterations = ITERATIONS if self._harmonics is None else _NEXT_ITERATIONS
        self._harmonics = fit.solved(self._harmonics, iterations)
        splats = replace(flat, harmonics=self._harmonics)
        report(JobProgress("comparing", 0.9))
        return FittedSplats(splats, np.array([psnr_db(splats, view) for view in held_out]))


def psnr_db(splats: Splats, view: LitView) -> float:
    """Compare what splats show in a view with its picture, over all pixels that show the hand in either."""
    found = rasterised(splats, view.camera)
    shown = (found[..., 3] > 0) | (view.picture[..., 3] > 0)
    squared = ((found - view.picture)[shown][:, :3] ** 2).mean()
    return float(-10 * np.log10(max(squared, 1e-10)))
