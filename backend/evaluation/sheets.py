"""What an evaluation shows: views spread over all of it, and the worst ones. Only these are kept in memory."""

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


class ShownViews:
    """Chooses among views as they pass by.

    Args:
        expected: how many views will pass at most.
        spread: how many of them the contact sheet shows, evenly spaced.
        worst: how many the worst sheet shows: those of the lowest PSNR on the hand, the lowest first.
    """

    def __init__(self, expected: int, spread: int, worst: int):
        self._every, self._spread_count, self._worst_count = max(1, expected // max(spread, 1)), spread, worst
        self._spread: list[ScoredView] = []
        self._worst: list[tuple[float, int, ScoredView]] = []
        self._passed = count()

    def watch(self, views: Iterable[ScoredView]) -> Iterator[ScoredView]:
        """Pass the views on, and keep what will be shown."""
        for view in views:
            index = next(self._passed)
            if index % self._every == 0 and len(self._spread) < self._spread_count:
                self._spread.append(view)
            # The heap's root is the best of the worst; the index breaks ties, so that pictures are never compared.
            heapq.heappush(self._worst, (-view.score.figures["psnr_hand"], -index, view))
            if len(self._worst) > self._worst_count:
                heapq.heappop(self._worst)
            yield view

    @property
    def spread(self) -> list[ScoredView]:
        """Views from the whole evaluation, in its order."""
        return self._spread

    @property
    def worst(self) -> list[ScoredView]:
        """The worst views, worst first."""
        return [view for *_, view in sorted(self._worst, key=lambda entry: entry[:2], reverse=True)]

    def save(self, folder: Path) -> None:
        """Write both sheets; none of a kind that shows nothing.

        Raises:
            LiveHandError: the folder cannot be written.
        """
        for views, name, per_row in ((self.spread, CONTACT_SHEET, 4), (self.worst, WORST_SHEET, 2)):
            if views:
                _save(views, folder / name, per_row)


def label_of(view: ScoredView) -> str:
    """What a sheet writes above a view."""
    score, figures = view.score, view.score.figures
    gap = f"  gap {score.camera_gap_deg:.0f}\N{DEGREE SIGN}" if np.isfinite(score.camera_gap_deg) else ""
    decibels = f"{figures['psnr_full']:.2f} dB  hand {figures['psnr_hand']:.2f} dB"
    return f"{Path(score.file).stem}  {score.split}{gap}  {decibels}"


def _save(views: Sequence[ScoredView], path: Path, triples_per_row: int) -> None:
    pairs, labels = [(view.truth, view.image) for view in views], [label_of(view) for view in views]
    try:
        save_sheet(comparison_sheet(pairs, triples_per_row, labels), path)
    except OSError as error:
        raise LiveHandError(f"{path} must be writable ({error}); choose another folder with -o") from error
