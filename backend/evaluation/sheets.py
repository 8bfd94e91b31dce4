"""The contact sheets of an evaluation: evenly spread views, and the worst views. Only these stay in memory."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from .contact_sheet import comparison_sheet, save_sheet
from .evaluate import ScoredView

CONTACT_SHEET, WORST_SHEET = "contact_sheet.png", "worst.png"


class SheetViews:
    """Selects the views for both sheets while an evaluation runs.

    Args:
        expected: the largest number of views that the evaluation can yield.
        spread: number of evenly spaced views on the contact sheet.
        worst: number of views on the sheet of the worst: those with the lowest PSNR on the hand, lowest first.
    """

    def __init__(self, expected: int, spread: int, worst: int):
        self._every, self._spread_count, self._worst_count = max(1, expected // max(spread, 1)), spread, worst
        self._spread: list[ScoredView] = []
        self._worst: list[tuple[float, int, ScoredView]] = []
        self._indices = count()

    def watch(self, views: Iterable[ScoredView]) -> Iterator[ScoredView]:
        """Yield the views, keeping those for the sheets."""
        for view in views:
            index = next(self._indices)
            if index % self._every == 0 and len(self._spread) < self._spread_count:
                self._spread.append(view)
            # The heap's root is the best of the worst; the index breaks ties, so that images are never compared.
            heapq.heappush(self._worst, (-view.score.figures["psnr_hand"], -index, view))
            if len(self._worst) > self._worst_count:
                heapq.heappop(self._worst)
            yield view

    @property
    def spread(self) -> list[ScoredView]:
        """Evenly spread views, in the order of the evaluation."""
        return self._spread

    @property
    def worst(self) -> list[ScoredView]:
        """The worst views, worst first."""
        return [view for *_, view in sorted(self._worst, key=lambda entry: entry[:2], reverse=True)]

    def save(self, folder: Path) -> None:
        """Write both sheets; a sheet without views is not written.

        Raises:
            LiveHandError: the folder cannot be written.
        """
        for views, name, per_row in ((self.spread, CONTACT_SHEET, 4), (self.worst, WORST_SHEET, 2)):
            if views:
                _save(views, folder / name, per_row)


def label_of(view: ScoredView) -> str:
    """Word the label above a view."""
    score, figures = view.score, view.score.figures
    angle_deg = score.train_view_angle_deg
    angle = f"  angle {angle_deg:.0f}\N{DEGREE SIGN}" if np.isfinite(angle_deg) else ""
    decibels = f"{figures['psnr_full']:.2f} dB  hand {figures['psnr_hand']:.2f} dB"
    light = f" {score.light_kind}" if score.light_kind else ""
    return f"{Path(score.file).stem}  {score.split}{light}{angle}  {decibels}"


def _save(views: Sequence[ScoredView], path: Path, triples_per_row: int) -> None:
    pairs, labels = [(view.truth, view.image) for view in views], [label_of(view) for view in views]
    try:
        save_sheet(comparison_sheet(pairs, triples_per_row, labels), path)
    except OSError as error:
        raise LiveHandError(f"{path} must be writable ({error}); choose another folder with -o") from error
