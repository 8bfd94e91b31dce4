"""The doubt of a take's frames over its time, one panel a hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..motion.landmarks.take_fit import DOUBTFUL, TakeFit
from ..records.side import Side

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL_IN = (9.0, 2.4)
"""Width and height of a panel."""


def draw_doubt(figure: Figure, fits: Mapping[Side, TakeFit]) -> None:
    """Plot doubt in percent of the hand's size; shaded where the motion has no keys, dotted where it is a mistake."""
    for axes, (side, fit) in zip(figure.subplots(len(fits), 1, squeeze=False)[:, 0], fits.items(), strict=True):
        step_s = 1 / (fit.motion.fps or 30.0)
        times = fit.start_s + np.arange(len(fit.doubt)) * step_s
        is_seen = fit.doubt < 1
        axes.plot(times, np.where(is_seen, 100 * fit.doubt, np.nan), marker=".", markersize=3)
        for first, last in _runs(~fit.is_keyed):
            axes.axvspan(times[first] - step_s / 2, times[last] + step_s / 2, alpha=0.3, color="grey")
        axes.axhline(100 * DOUBTFUL, linestyle=":")
        axes.set(title=f"{side} hand", xlabel="s", ylabel="doubt, % of the hand's size", ylim=(0, None))
        axes.grid(alpha=0.4)


def _runs(is_in: np.ndarray) -> list[tuple[int, int]]:
    """Find the first and last index of every run."""
    edges = np.diff(np.r_[0, is_in.astype(int), 0])
    return list(zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True))
