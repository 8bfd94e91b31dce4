"""Frames of lit hands as files of splats, one or a numbered sequence, and how well they show held-out views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...records.errors import LiveHandError
from ...system.child_job import JobProgress, Report
from .color_fit import ITERATIONS, ColorFit
from .flat_splats import SplatGround
from .gaussians import Splats, joined
from .lit_hand import LitHand, SplatOptions
from .lit_views import HELD_OUT, LitView, views_around
from .splat_files import file_axes, write_splats
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
        self._surface: SplatGround | None = None
        self._harmonics: np.ndarray | None = None

    def fitted(self, hand: LitHand, report: Report = lambda progress: None) -> FittedSplats:
        """Fit the splats of a hand's shot, which follow those of the shot before.

        Raises:
            LiveHandError: the avatar is not relightable.
            RenderStopped: `should_stop` returned True.
        """
        if self._surface is None:
            self._surface = SplatGround(hand.renderer, hand.shot, self._options.count)
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


class SplatSequence(NamedTuple):
    """What was written.

    Attributes:
        files: a frame each.
        held_out_db: [frames] mean PSNR of the views that were held out.
        least_db: of all these views.
        size: splats in the last file.
    """

    files: tuple[Path, ...]
    held_out_db: np.ndarray
    least_db: float
    size: int

    @property
    def summary(self) -> str:
        """A line for people."""
        files = str(self.files[0]) if len(self.files) == 1 else f"{self.files[0]} to {self.files[-1].name}"
        mean = f"{self.held_out_db.mean():.1f} dB in views that were held out (least {self.least_db:.1f})"
        return f"{files}: {self.size} splats, {mean}"


def frame_path(path: Path, frame: int, is_alone: bool) -> Path:
    """Return the file of a frame: hand.ply itself if it is alone, else hand_0012.ply."""
    return path if is_alone else path.with_name(f"{path.stem}_{frame:04d}{path.suffix}")


def write_sequence(
    frames: Mapping[int, Sequence[LitHand]],
    path: Path,
    options: SplatOptions,
    report: Report = lambda progress: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> SplatSequence:
    """Fit and write frames; a file holds all hands of its frame.

    Args:
        frames: by number, at least one.
        path: to be written; with more frames than one, each file has its frame's number before the suffix.
        options: of the splats.
        report: is told what is done.
        should_stop: queried during renders.

    Raises:
        LiveHandError: a frame has no hand, an avatar is not relightable, or a file cannot be written.
        RenderStopped: `should_stop` returned True; the files of finished frames stay.
    """
    axes = file_axes(path)
    empty = [number for number, hands in frames.items() if not hands]
    if empty:
        raise LiveHandError(f"splats need a hand in every frame, got none in {empty[:5]}; choose other frames")
    fitters: dict[str, SplatFitter] = {}
    files, means, least_db, count = [], [], np.inf, 0
    for done, (number, hands) in enumerate(frames.items()):
        fits = []
        for index, hand in enumerate(hands):
            fitter = fitters.setdefault(hand.name, SplatFitter(options, axes, should_stop))
            part = done + index / len(hands), 1 / len(hands), len(frames)
            fits.append(fitter.fitted(hand, _within(report, f"frame {number}, ", *part)))
        files.append(frame_path(path, number, len(frames) == 1))
        splats = joined([fit.splats for fit in fits])
        write_splats(files[-1], splats, facts_of(hands, fits))
        held_out_db = np.concatenate([fit.held_out_db for fit in fits])
        means.append(held_out_db.mean())
        least_db, count = min(least_db, float(held_out_db.min())), len(splats)
    report(JobProgress("done", 1.0))
    return SplatSequence(tuple(files), np.array(means), least_db, count)


def facts_of(hands: Iterable[LitHand], fits: Iterable[FittedSplats]) -> dict[str, str]:
    """Describe whose hands a file shows, under which licence and consent, and how well its splats fit."""
    origins = {hand.origin.name: hand.origin for hand in hands}.values()
    held_out_db = np.concatenate([fit.held_out_db for fit in fits])
    mean_db, least_db = held_out_db.mean(), held_out_db.min()
    facts = {
        "LiveHand/Avatar": "; ".join(one.name for one in origins),
        "LiveHand/License": "; ".join(one.licence for one in origins if one.licence),
        "LiveHand/Consent": "; ".join(one.consent for one in origins if one.consent),
        "LiveHand/PSNR": f"{mean_db:.2f} dB in {len(held_out_db)} held-out views, least {least_db:.2f}",
    }
    return {key: value for key, value in facts.items() if value}


def _within(report: Report, prefix: str, begun: float, length: float, total: int) -> Report:
    """Return a report of a part of the work, told as a part of all of it."""

    def part(progress: JobProgress) -> None:
        share = (begun + length * (progress.share or 0)) / total
        report(JobProgress(prefix + progress.text, share))

    return part
